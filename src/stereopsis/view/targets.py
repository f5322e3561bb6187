"""What is looked at: the synthetic street, a pair, a disparity map, a data set, the folder of a batch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from stereopsis.settings import Settings
from stereopsis.types import Calibration
from stereopsis.view import choice
from stereopsis.view.sources import Files, Source, Street

if TYPE_CHECKING:
    from stereopsis.datasets import Sample

Kind = Literal["scene", "pair", "map", "dataset", "results"]
Value = float | str | None


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
    settings : mapping or None
        What the page matches it with at first, where that is its own.
    """

    name: str
    source: Source
    values: Mapping[str, Value] = field(default_factory=dict)
    settings: Mapping[str, Any] | None = None


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
            from stereopsis.view import runs

            return runs.read(folder) if runs.is_run(folder) else _dataset(folder)
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
    entries = tuple(Entry(sample.name, files_of(sample)) for sample in found)
    return Target("dataset", f"{found.name}, {folder.name}", entries)


def files_of(sample: Sample, disparity: Path | None = None) -> Files:
    """The files of a data set's sample, and the map that was made of it."""
    return Files(
        left=sample.left_file,
        right=sample.right_file,
        truth=sample.truth_file,
        disparity=disparity,
        read_truth=sample.truth,
        read_mask=sample.mask,
        read_calibration=sample.calibration,
    )
