"""From rows to numbers: means with their spread over pairs, tables, files."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from stereopsis.io.atomic import write_bytes
from stereopsis.io.table import as_csv
from stereopsis.study import published
from stereopsis.study.job import Done
from stereopsis.study.measure import COLUMNS, MEASURES

IDENTITY: Final = ("group", "condition", "pair", "protocol", "setting", "method", "window")
RESAMPLES: Final = 2000


@dataclass(frozen=True)
class Stat:
    """A mean over pairs with the bootstrap interval that holds 95 % of the resampled means."""

    mean: float
    low: float
    high: float
    count: int

    @classmethod
    def of(cls, values: Iterable[float]) -> Stat:
        """Of one value a pair. Resamples pairs with a fixed seed: the same values give the same interval."""
        given = np.array([value for value in values if not math.isnan(value)])
        if not given.size:
            return cls(math.nan, math.nan, math.nan, 0)
        if not np.isfinite(given).all():  # a map without any answer has an infinite RMSE
            return cls(math.inf, math.inf, math.inf, given.size)
        means = given[_resamples(given.size)].mean(axis=1)
        low, high = np.quantile(means, [0.025, 0.975])
        return cls(float(given.mean()), float(low), float(high), given.size)


@lru_cache(maxsize=8)
def _resamples(count: int) -> npt.NDArray[np.int64]:
    return np.random.default_rng(0).integers(0, count, (RESAMPLES, count))


class Rows:
    """The measured rows of a study, by setting and pair; each has "seconds" too."""

    def __init__(self, done: Sequence[Done]) -> None:
        self._of: dict[tuple[str, str], dict[str, Mapping[str, float]]] = {}
        self.conditions: dict[str, str] = {}
        for item in done:
            source, setting = item.task.source, item.task.setting
            self._of.setdefault((source.group, setting.setting), {})[source.name] = {
                **item.row,
                "seconds": item.seconds,
            }
            if source.group == "synthetic":
                self.conditions[source.name] = source.condition

    def only(self, pair: str) -> Rows:
        """The rows of one pair of the data set."""
        rows = Rows(())
        rows._of = {
            (group, setting): {pair: found[pair]}
            for (group, setting), found in self._of.items()
            if group == "data" and pair in found
        }
        return rows

    def pairs(self, group: str = "data") -> tuple[str, ...]:
        """The pairs that have rows, in the study's order."""
        return tuple(
            dict.fromkeys(pair for (of, _), found in self._of.items() if of == group for pair in found)
        )

    def has(self, setting: str, group: str = "data") -> bool:
        """Whether any pair of the group was measured with the setting."""
        return (group, setting) in self._of

    def of(self, setting: str, group: str = "data") -> dict[str, Mapping[str, float]]:
        """The whole row of each pair, in the study's order."""
        return dict(self._of.get((group, setting), {}))

    def values(
        self, setting: str, column: str, group: str = "data", condition: str | None = None
    ) -> dict[str, float]:
        """The column's value of each pair that has one."""
        return {
            pair: row[column]
            for pair, row in self._of.get((group, setting), {}).items()
            if column in row
            and not math.isnan(row[column])
            and (condition is None or self.conditions.get(pair) == condition)
        }

    def stat(self, setting: str, column: str, group: str = "data", condition: str | None = None) -> Stat:
        """Mean and interval over the pairs."""
        return Stat.of(self.values(setting, column, group, condition).values())

    def change(self, setting: str, base: str, column: str, group: str = "data") -> Stat:
        """Mean and interval of the difference to another setting, pair by pair."""
        found, before = self.values(setting, column, group), self.values(base, column, group)
        return Stat.of(found[pair] - before[pair] for pair in found if pair in before)


@dataclass(frozen=True)
class Cell:
    """What stands in a table: a text, a smaller one beside it, and whether it is the best of its column."""

    text: str
    detail: str = ""
    best: bool = False


@dataclass(frozen=True)
class Table:
    """A table of the page. Each row begins with its label."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""


NOTHING: Final = "\N{EN DASH}"
MINUS: Final = "\N{MINUS SIGN}"
LABELS: Final = {
    "within_0.25": "< 0.25 px",
    "within_0.5": "< 0.5 px",
    "within_1": "< 1 px",
    "within_2": "< 2 px",
    "within_4": "< 4 px",
    "rmse": "RMSE (px)",
    "epe": "mean error (px)",
    "d1": "D1",
    "density": "density",
    "seconds": "s a pair",
    "own_within_1": "answered, < 1 px",
    "own_rmse": "answered, RMSE (px)",
    "edge_within_1": "at edges, < 1 px",
    "interior_within_1": "elsewhere, < 1 px",
}
SMALLER: Final = ("rmse", "epe", "d1")
"""Measures of which less is better."""

FRACTIONS: Final = (*MEASURES[:-1], "d1", "density")


def number(value: float, column: str, *, signed: bool = False) -> str:
    """A measure for people: fractions in per cent, errors in pixels; signed, a change: percentage points."""
    if math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "\N{INFINITY}"
    unit = _unit(column, signed=signed)
    text = f"{100 * value:{'+' if signed else ''}.2f}" if unit else f"{value:{'+' if signed else ''}.3f}"
    return text.replace("-", MINUS) + unit


def _unit(column: str, *, signed: bool) -> str:
    fraction = any(column.endswith(name) for name in (*FRACTIONS, "answered", "precision", "recall"))
    return "" if not fraction else " pp" if signed else " %"


def cell(stat: Stat, column: str, *, signed: bool = False) -> Cell:
    """A mean with its interval."""
    if not stat.count:
        return Cell(NOTHING)
    if stat.count == 1:
        return Cell(number(stat.mean, column, signed=signed))
    unit = _unit(column, signed=signed)
    low, high = (number(end, column, signed=signed).removesuffix(unit) for end in (stat.low, stat.high))
    return Cell(number(stat.mean, column, signed=signed), f"{low} … {high}")


def compare(
    caption: str,
    rows: Rows,
    settings: Sequence[tuple[str, str]],
    columns: Sequence[str] = MEASURES,
    note: str = "",
    group: str = "data",
) -> Table | None:
    """A table of (label, setting) against measures, the best of each column marked; None without rows."""
    present = [(label, setting) for label, setting in settings if rows.has(setting, group)]
    if not present:
        return None
    stats = {(setting, c): rows.stat(setting, c, group) for _, setting in present for c in columns}
    best = {}
    for column in columns:
        means = [stats[setting, column].mean for _, setting in present]
        finite = [mean for mean in means if math.isfinite(mean)]
        if finite and len(present) > 1 and column not in ("density", "seconds"):
            best[column] = min(finite) if column in SMALLER else max(finite)
    lines = []
    for label, setting in present:
        cells = []
        for column in columns:
            made = cell(stats[setting, column], column)
            cells.append(Cell(made.text, made.detail, stats[setting, column].mean == best.get(column)))
        lines.append((Cell(label), *cells))
    return Table(caption, ("", *(LABELS.get(c, c) for c in columns)), tuple(lines), note)


def printed(rows: Rows, *, as_printed: bool) -> dict[str, list[float]]:
    """Tables I and II of the report, in the order of `MEASURES`.

    As printed, the sum leaves the last pair out and is still divided by the number of all of them.
    """
    quirks = published.PUBLISHED if as_printed else published.Quirks()
    tables = {}
    for name, (method, window) in published.TABLES.items():
        pairs = list(rows.of(f"published: {method}-{window}").values())
        if pairs:
            tables[name] = [published.average(pairs, quirks)[column] for column in MEASURES]
    return tables


def write_tables(path: Path, rows: Rows) -> None:
    """Write Tables I and II as printed, at full precision, as JSON."""
    write_bytes(path, (json.dumps(printed(rows, as_printed=True), indent=1) + "\n").encode())


def write_results(path: Path, done: Sequence[Done]) -> None:
    """Write one line a (pair, setting); a float is written so that reading it gives the same bits."""
    head = (*IDENTITY, *COLUMNS)
    write_bytes(path, as_csv(head, (record.values() for record in records(done))))


def write_timings(path: Path, done: Sequence[Done]) -> None:
    """Write how long each row took when it was measured, matching and measuring together."""
    lines = ([*(item.task.columns()[name] for name in IDENTITY), item.seconds] for item in done)
    write_bytes(path, as_csv((*IDENTITY, "seconds"), lines))


def write_parquet(path: Path, done: Sequence[Done]) -> bool:
    """Write the table of results as Parquet, where pyarrow is installed; say whether it is."""
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError:
        return False
    columns: dict[str, Any] = {name: [] for name in (*IDENTITY, *COLUMNS)}
    for record in records(done):
        for name, value in record.items():
            columns[name].append(value)
    counts = {name for name in columns if name.endswith("_count")} | {"known", "window"}
    texts = set(IDENTITY) - {"window"}
    types = {
        name: pa.string() if name in texts else pa.int64() if name in counts else pa.float64()
        for name in columns
    }
    table = pa.table({name: pa.array(values, types[name]) for name, values in columns.items()})
    buffer = io.BytesIO()
    parquet.write_table(table, buffer)
    write_bytes(path, buffer.getvalue())
    return True


def records(done: Sequence[Done]) -> Iterable[dict[str, Any]]:
    """Each row as one flat mapping with every column, None where it has no value."""
    for item in done:
        yield {**item.task.columns(), **{column: item.row.get(column) for column in COLUMNS}}
