"""The folder of a batch or a study: its table, and what each line can be opened as."""

from __future__ import annotations

import csv
import io
import os
import tomllib
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stereopsis import datasets
from stereopsis.batch.names import unescaped
from stereopsis.datasets import Sample
from stereopsis.settings import Settings
from stereopsis.view import choice
from stereopsis.view.sources import Files, Source, Street
from stereopsis.view.targets import Entry, Target, Value, files_of

TABLE = "results.csv"
RECORD = "run.toml"
STUDY = "settings.toml"
MAPS = "disparity"
SUFFIXES = (".png", ".pfm", ".npy", ".tif", ".tiff")
MOST_ROWS = 100_000

Row = Mapping[str, str]


def is_run(folder: Path) -> bool:
    """Whether a folder holds a table of results."""
    return (folder / TABLE).is_file()


def read(folder: Path) -> Target:
    """Every line of the table that can be opened.

    A batch says in its ``run.toml`` which data set it went through, a study in its ``settings.toml``: what is
    opened beside the maps comes from there. Without it a batch's maps are opened alone.

    Raises
    ------
    ValueError
        The table is none of a batch or a study, or none of its lines can be opened.
    OSError
        A file cannot be read.
    """
    columns, rows = _table(folder / TABLE)
    if "name" in columns:
        return _batch(folder, columns, rows)
    if {"pair", "setting"} <= set(columns) and (folder / STUDY).is_file():
        return _study(folder, columns, rows)
    raise ValueError(f"{folder / TABLE} is no table of a batch or a study: it has no column 'name'")


def _batch(folder: Path, columns: tuple[str, ...], rows: list[Row]) -> Target:
    record = _toml(folder / RECORD) if (folder / RECORD).is_file() else {}
    samples, maps = _samples(record), _maps(folder / MAPS)
    shown = tuple(column for column in columns if column != "name")
    entries: dict[str, Entry] = {}
    for row in rows:
        name = row.get("name", "")
        sample, disparity = samples.get(name), maps.get(name)
        if sample is not None:
            source = files_of(sample, disparity)
        elif disparity is not None:
            source = Files(disparity=disparity)
        else:
            continue
        entries.setdefault(name, Entry(name, source, {column: _value(row.get(column)) for column in shown}))
    if not entries:
        raise ValueError(f"{folder / TABLE} names no map that lies in {folder / MAPS}")
    settings = choice.written(_settings(folder / RECORD)) if "settings" in record else {}
    return Target("results", _title(folder), tuple(entries.values()), shown, settings)


def _samples(record: Mapping[str, Any]) -> dict[str, Sample]:
    """The pairs of the data set that a batch went through, where it is still there."""
    data = record.get("data")
    place = data.get("folder") if isinstance(data, Mapping) else None
    if not isinstance(place, str) or not place:
        return {}
    try:
        return {sample.name: sample for sample in datasets.open(place)}
    except (ValueError, OSError):
        return {}


def _maps(folder: Path) -> dict[str, Path]:
    """The maps that lie in a folder, by the names that theirs stand for; links that lead out are left out."""
    inside = os.path.realpath(folder)
    found: dict[str, Path] = {}
    for file in sorted(folder.rglob("*")):
        if file.suffix in SUFFIXES and os.path.realpath(file).startswith(inside + os.sep) and file.is_file():
            found.setdefault(unescaped(file.relative_to(folder).with_suffix("").as_posix()), file)
    return found


def _study(folder: Path, columns: tuple[str, ...], rows: list[Row]) -> Target:
    """A line is a pair and a setting: opening it matches the pair with that setting."""
    from stereopsis.study import plan, tables

    study = plan.Study.from_toml((folder / STUDY).read_text(encoding="utf-8"), str(folder / STUDY))
    tasks = {
        tuple("" if value is None else str(value) for value in task.columns().values()): task
        for task in plan.make(study).tasks
    }
    keys = (tuple(row.get(name, "") for name in tables.IDENTITY) for row in rows)
    lines = [(tasks[key], row) for key, row in zip(keys, rows, strict=True) if key in tasks]
    if not lines:
        raise ValueError(f"{folder / TABLE} has no line of the study that {STUDY} describes")
    shown = tuple(column for column in columns[: columns.index("known")] if "known" in columns)
    named = Counter(f"{task.source.name}, {task.setting.setting}" for task, _ in lines)
    entries = []
    for task, row in lines:
        name = f"{task.source.name}, {task.setting.setting}"
        if named[name] > 1:
            name = f"{name}, {task.setting.protocol}, {task.source.group}"
        settings = choice.written(task.setting.settings) if isinstance(task.setting, plan.Corrected) else None
        values = {column: _value(row.get(column)) for column in shown}
        entries.append(Entry(name, _source(task.source), values, settings))
    unique = {entry.name: entry for entry in entries}
    return Target("results", _title(folder), tuple(unique.values()), shown)


def _source(source: Any) -> Source:
    from stereopsis.study.pairs import ScenePair

    if isinstance(source, ScenePair):
        return Street(*source.size, source.seed, source.options)
    return files_of(source.sample)


def _title(folder: Path) -> str:
    return folder.resolve().name


def _settings(path: Path) -> Settings:
    return Settings.from_toml(path.read_text(encoding="utf-8").partition("[settings]\n")[2])


def _toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise ValueError(f"{path} is not TOML: {error}") from None


def _table(path: Path) -> tuple[tuple[str, ...], list[Row]]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{path} is not a table: it is not text") from None
    rows: list[Row] = []
    try:
        reader = csv.DictReader(io.StringIO(text, newline=""))
        columns = tuple(reader.fieldnames or ())
        for row in reader:
            rows.append({name: value for name, value in row.items() if isinstance(value, str)})
            if len(rows) > MOST_ROWS:
                raise ValueError(f"{path} has more than {MOST_ROWS} lines")
    except csv.Error as error:
        raise ValueError(f"{path} is not a table: {error}") from None
    return columns, rows


def _value(text: str | None) -> Value:
    """A number where it is one that JSON has; None for nothing."""
    if not text:
        return None
    try:
        number = float(text)
    except ValueError:
        return text
    return number if abs(number) < float("inf") else None
