"""What is looked at: the synthetic street, a pair, a disparity map, a data set, the folder of a batch."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from stereopsis.settings import Settings
from stereopsis.types import Calibration
from stereopsis.view import choice
from stereopsis.view.sources import Files, Source, Street

Kind = Literal["scene", "pair", "map", "dataset", "results"]
Value = float | str | None

RESULTS = "results.csv"
MOST_ROWS = 100_000


@dataclass(frozen=True)
class Entry:
    """One thing of a target that can be opened.

    Attributes
    ----------
    name : str
        What the page calls it, and asks for it by.
    source : Source
        Where it comes from; only the server knows.
    values : mapping of str to float, str or None
        What the target's table says of it.
    """

    name: str
    source: Source
    values: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True)
class Target:
    """What was opened.

    Attributes
    ----------
    kind : {"scene", "pair", "map", "dataset", "results"}
    title : str
    entries : tuple of Entry
        In order; names are unique.
    columns : tuple of str
        Of the table that the entries' values fill.
    settings : mapping
        What the page matches with at first, in the form of the page's requests.
    """

    kind: Kind
    title: str
    entries: tuple[Entry, ...]
    columns: tuple[str, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)


def street(width: int = 880, height: int = 400, seed: int = 0) -> Target:
    """The synthetic street, with its exact truth."""
    source = Street(width, height, seed)
    return Target("scene", "synthetic street", (Entry("street", source),))


def open_target(
    paths: Sequence[Path],
    *,
    truth: Path | None = None,
    left: Path | None = None,
    calibration: Path | Calibration | None = None,
    settings: Settings | None = None,
) -> Target:
    """Recognise what some paths are.

    Parameters
    ----------
    paths : sequence of Path
        None: the synthetic street. Two files: a pair. One file: a disparity map. A folder: a data set in a
        layout that `stereopsis.datasets.open` knows, or one that holds a ``results.csv``.
    truth : Path, optional
        The true disparity of a pair or a map.
    left : Path, optional
        The left image of a map.
    calibration : Path or Calibration, optional
        The geometry of a pair or a map.
    settings : Settings, optional
        What the page matches with at first.

    Returns
    -------
    Target

    Raises
    ------
    ValueError
        The paths are none of these, or an option does not go with them.
    """
    chosen = {} if settings is None else choice.written(settings)
    match list(paths):
        case []:
            _refuse(truth=truth, left=left, calibration=calibration)
            return Target("scene", "synthetic street", street().entries, settings=chosen)
        case [folder] if folder.is_dir():
            _refuse(truth=truth, left=left, calibration=calibration)
            return _results(folder) if (folder / RESULTS).is_file() else _dataset(folder)
        case [disparity]:
            source = Files(left=left, truth=truth, calibration=calibration, disparity=disparity)
            return Target("map", disparity.name, (Entry(disparity.stem, source),), settings=chosen)
        case [first, second]:
            _refuse(left=left)
            source = Files(left=first, right=second, truth=truth, calibration=calibration)
            return Target("pair", first.name, (Entry(first.stem, source),), settings=chosen)
        case _:
            raise ValueError(
                f"{len(paths)} paths are too many: give LEFT and RIGHT, a disparity map, or a folder"
            )


def _refuse(**options: Any) -> None:
    for name, value in options.items():
        if value is not None:
            raise ValueError(f"--{name} does not go with what is opened here")


def _dataset(folder: Path) -> Target:
    from stereopsis import datasets

    found = datasets.open(folder)
    entries = tuple(
        Entry(
            sample.name,
            Files(
                left=sample.left_file,
                right=sample.right_file,
                truth=sample.truth_file,
                calibration=sample.calibration_file,
                read_truth=sample.truth,
                read_mask=sample.mask,
                read_calibration=sample.calibration,
            ),
        )
        for sample in found
    )
    return Target("dataset", f"{found.name}, {folder.name}", entries)


def _results(folder: Path) -> Target:
    """One entry a line of the table whose disparity lies beside it."""
    columns, rows = _read_table(folder / RESULTS)
    entries: dict[str, Entry] = {}
    for row in rows:
        name = row.get("name") or ""
        file = _map_of(folder, name)
        if file is not None and name not in entries:
            values = {column: _value(row.get(column)) for column in columns if column != "name"}
            entries[name] = Entry(name, Files(disparity=file), values)
    if not entries:
        raise ValueError(f"{folder / RESULTS} names no disparity map that lies in {folder / 'disparity'}")
    return Target("results", folder.name, tuple(entries.values()), tuple(c for c in columns if c != "name"))


def _map_of(folder: Path, name: str) -> Path | None:
    """The map that belongs to a name of the table: one that lies in the folder itself, links followed."""
    inside = (folder / "disparity").resolve()
    for suffix in (".png", ".pfm", ".npy", ".tif"):
        try:
            file = (folder / "disparity" / f"{name}{suffix}").resolve()
            if name and file.is_file() and file.is_relative_to(inside):
                return file
        except (OSError, ValueError):  # a name that no file can have
            return None
    return None


def _read_table(path: Path) -> tuple[tuple[str, ...], list[dict[str, str]]]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{path} is not a table: it is not text") from None
    reader = csv.DictReader(io.StringIO(text))
    columns = tuple(reader.fieldnames or ())
    if "name" not in columns:
        raise ValueError(f"{path} is no table of results: it has no column 'name'")
    rows = []
    for row in reader:
        rows.append({key: value for key, value in row.items() if isinstance(value, str)})
        if len(rows) > MOST_ROWS:
            raise ValueError(f"{path} has more than {MOST_ROWS} lines")
    return columns, rows


def _value(text: str | None) -> Value:
    if not text:
        return None
    try:
        number = float(text)
    except ValueError:
        return text
    return number if abs(number) < float("inf") else None
