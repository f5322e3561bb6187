"""Match and score every pair of some data sets with every method; means over pairs, one table a data set."""

from __future__ import annotations

import csv
import io
import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from statistics import fmean
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from stereopsis import fill
from stereopsis.bench.methods import Method
from stereopsis.datasets import Dataset, Sample
from stereopsis.evaluate import Scores, evaluate
from stereopsis.types import Disparities, DisparityMap, Pair

Range: TypeAlias = Disparities | Literal["calibration"]
"""The same candidates for every pair, or up to the bound that each one's calibration gives."""


@dataclass(frozen=True)
class Row:
    """One pair, matched by one method.

    Attributes
    ----------
    dataset, pair, method : str
    own : Scores
        Of the map as it was answered.
    whole : Scores
        Of the map with every pixel answered: see `answered`.
    within_0_75 : float
        Of `whole`, the fraction within three quarters of a pixel.
    seconds : float
        From the images to the map.
    """

    dataset: str
    pair: str
    method: str
    own: Scores
    whole: Scores
    within_0_75: float
    seconds: float


@dataclass(frozen=True)
class Failure:
    """What could not be measured, and why; without a method the pair could not be read."""

    dataset: str
    pair: str
    method: str | None
    reason: str


@dataclass
class Report:
    """What came of a benchmark: rows data set by data set and pair by pair, and what failed."""

    rows: list[Row] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)


COLUMNS: tuple[tuple[str, str, Callable[[Row], float]], ...] = (
    ("D1", "{:.2%}", lambda row: row.whole.all.d1),
    ("< 1 px", "{:.1%}", lambda row: row.whole.all.within_1),
    ("< 3/4 px", "{:.1%}", lambda row: row.within_0_75),
    ("bad-2.0", "{:.2%}", lambda row: row.whole.all.bad_2),
    ("RMSE", "{:.2f}", lambda row: row.whole.all.rmse),
    ("density", "{:.3f}", lambda row: row.own.density),
    ("own D1", "{:.2%}", lambda row: row.own.own.d1),
    ("own < 1 px", "{:.1%}", lambda row: row.own.own.within_1),
    ("own RMSE", "{:.2f}", lambda row: row.own.own.rmse),
    ("s/pair", "{:.3f}", lambda row: row.seconds),
)
"""Every known pixel first, holes filled; then the pixels that the method answers."""

MORE: tuple[tuple[str, Callable[[Row], float]], ...] = (
    ("< 0.25 px", lambda row: row.whole.all.within_0_25),
    ("< 0.5 px", lambda row: row.whole.all.within_0_5),
    ("< 2 px", lambda row: row.whole.all.within_2),
    ("< 4 px", lambda row: row.whole.all.within_4),
    ("EPE", lambda row: row.whole.all.epe),
    ("answered < 1 px", lambda row: row.own.all.within_1),
)
"""What the file of single pairs holds besides; the last counts unanswered pixels as wrong."""

Progress = Callable[[int, int, str], None]
"""Called with the matches finished, the matches there are, and what has just been finished."""


def measure(
    found: Sequence[Dataset],
    methods: Sequence[Method],
    disparities: Range,
    *,
    pairs: int | None = None,
    threads: int = 1,
    progress: Progress | None = None,
) -> Report:
    """Match every pair with every method. What fails is reported, and the rest goes on.

    Parameters
    ----------
    found : sequence of Dataset
    methods : sequence of Method
    disparities : Disparities or "calibration"
        Never from the truth.
    pairs : int, optional
        Of each data set only so many, the first ones.
    threads : int
        For every method; 0: all cores.
    progress : callable, optional

    Returns
    -------
    Report
    """
    report, finished = Report(), 0
    work = [(dataset, sample) for dataset in found for sample in dataset[:pairs]]
    for dataset, sample in work:
        try:
            pair, truth, mask = _read(sample)
            candidates = _candidates(pair, disparities)
        except (ValueError, TypeError, OSError) as error:
            report.failures.append(Failure(dataset.name, sample.name, None, str(error)))
            finished += len(methods)
            continue
        for method in methods:
            try:
                start = time.perf_counter()
                disparity, own = method.match(pair, candidates, threads)
                seconds = time.perf_counter() - start
            except (ValueError, TypeError, MemoryError) as error:
                report.failures.append(Failure(dataset.name, sample.name, method.name, str(error)))
            else:
                row = score(disparity, truth, mask, own)
                named = replace(
                    row, dataset=dataset.name, pair=sample.name, method=method.name, seconds=seconds
                )
                report.rows.append(named)
            finished += 1
            if progress:
                progress(finished, len(work) * len(methods), f"{sample.name}, {method.name}")
    return report


def _read(sample: Sample) -> tuple[Pair, DisparityMap, npt.NDArray[np.bool_] | None]:
    truth = sample.truth()
    if truth is None:
        raise ValueError("there is no truth to score against")
    pair, mask = sample.pair(), sample.mask()
    if pair.left.shape[:2] != truth.shape:
        raise ValueError(f"the truth has the shape {truth.shape}, the images {pair.left.shape[:2]}")
    return pair, truth, mask


def _candidates(pair: Pair, disparities: Range) -> Disparities:
    if disparities != "calibration":
        return disparities
    if pair.calibration is None or pair.calibration.ndisp is None:
        raise ValueError("there is no calibration that bounds the disparities")
    return Disparities(0, pair.calibration.ndisp)


def score(
    disparity: DisparityMap,
    truth: DisparityMap,
    mask: npt.NDArray[np.bool_] | None = None,
    own: DisparityMap | None = None,
) -> Row:
    """Score a map twice: with every pixel answered, and what the method stands for, by default all of it."""
    whole = answered(disparity)
    counted = np.isfinite(truth) if mask is None else np.isfinite(truth) & mask
    errors = np.abs(whole[counted].astype(np.float64) - truth[counted])
    within = float(np.mean(errors < 0.75)) if errors.size else math.nan
    stood_for = evaluate(disparity if own is None else own, truth, mask)
    return Row("", "", "", stood_for, evaluate(whole, truth, mask), within, math.nan)


def answered(disparity: DisparityMap) -> DisparityMap:
    """Every pixel answered: holes filled on their rows as KITTI does, then on their columns.

    KITTI's rule leaves a row without any answer that lies between answered rows; it takes the nearest
    answered row, of two the upper one. A map without any answer stays one.
    """
    filled = fill.background(disparity)
    rows = np.flatnonzero(np.isfinite(filled[:, :1]).all(axis=1))
    if not rows.size:
        return filled
    every = np.arange(len(filled))
    after = np.clip(np.searchsorted(rows, every), 0, len(rows) - 1)
    before = np.maximum(after - 1, 0)
    nearer_before = np.abs(every - rows[before]) <= np.abs(rows[after] - every)
    whole: DisparityMap = filled[np.where(nearer_before, rows[before], rows[after])]
    return whole


def by_method(rows: Iterable[Row]) -> dict[tuple[str, str], list[Row]]:
    """Rows of each data set and method, in the order of their coming."""
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.dataset, row.method), []).append(row)
    return groups


def means(rows: Sequence[Row]) -> dict[str, float]:
    """Each column's mean over pairs."""
    return {name: fmean(value(row) for row in rows) for name, _, value in COLUMNS}


def tables(report: Report, methods: Sequence[Method]) -> str:
    """The means as GitHub Markdown, a table a data set."""
    groups = by_method(report.rows)
    made = []
    for dataset in dict.fromkeys(row.dataset for row in report.rows):
        # A method that failed on some pairs has a mean over others, so its number of pairs stands beside it.
        own = {method.name: groups.get((dataset, method.name), []) for method in methods}
        most = max(map(len, own.values()))
        lines = [[f"{dataset}, {most} {'pair' if most == 1 else 'pairs'}", *(name for name, _, _ in COLUMNS)]]
        lines.append(["---"] + ["---:"] * len(COLUMNS))
        for name, rows in own.items():
            label = name if len(rows) == most else f"{name} ({len(rows)} pairs)"
            values = means(rows) if rows else {}
            cells = (form.format(values[column]) if rows else "" for column, form, _ in COLUMNS)
            lines.append([label, *cells])
        made.append("\n".join("| " + " | ".join(cells) + " |" for cells in lines))
    return "\n\n".join(made)


def as_dict(report: Report, methods: Sequence[Method]) -> dict[str, Any]:
    """Everything as plain data for JSON; None where a number is undefined or infinite."""
    groups = by_method(report.rows)
    return {
        "methods": [
            {"name": method.name, "settings": method.settings.to_dict() if method.settings else None}
            for method in methods
        ],
        "means": [
            {"dataset": dataset, "method": method, "pairs": len(rows), **_finite(means(rows))}
            for (dataset, method), rows in groups.items()
        ],
        "pairs": [
            {
                "dataset": row.dataset,
                "pair": row.pair,
                "method": row.method,
                "seconds": row.seconds,
                "scores": row.own.to_dict(),
                "answered": row.whole.to_dict()["all"] | _finite({"within_0_75": row.within_0_75}),
            }
            for row in report.rows
        ],
        "failed": [vars(failure) for failure in report.failures],
    }


def _finite(values: dict[str, float]) -> dict[str, float | None]:
    return {name: value if math.isfinite(value) else None for name, value in values.items()}


def as_csv(report: Report) -> str:
    """A line for each pair and method, with the columns of the tables and `MORE`."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    columns = {name: value for name, _, value in COLUMNS} | dict(MORE)
    writer.writerow(["dataset", "pair", "method", *columns])
    for row in report.rows:
        writer.writerow([row.dataset, row.pair, row.method, *(value(row) for value in columns.values())])
    return stream.getvalue()
