"""What each quirk of the published protocol costs: switched off one at a time, then all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from stereopsis.study import published
from stereopsis.study.published import COLUMNS, PUBLISHED, TABLES, Quirks, Sample
from stereopsis.study.quirks import acts

BASE = "as published"
ALL = "all corrected"
MEAN = "last_pair_dropped"
RESAMPLES = 10_000

LABELS = {
    "swapped_grey": "standard grey",
    "truth_range": "range 0:128, not the truth's",
    "right_frame": "left frame",
    "wraps": "no wrapping round",
    "uint8_squares": "squares in floating point",
    "high_pass": "each window's own mean",
    "stale_mean": "the mean moves along",
    "zssd_data": "ZNCC as data term",
    "sigma_is_window": "Gaussian as wide as the box",
    "undefined_wins": "0 / 0 counts as 0",
    MEAN: "mean of all pairs",
}
"""What the protocol is called with one switch off."""


class Case(NamedTuple):
    """A protocol to try."""

    name: str
    method: str
    window: int
    quirks: Quirks


@dataclass(frozen=True)
class Row:
    """One pair under one case.

    Attributes
    ----------
    pair : str
        The pair's name.
    case : Case
    measures : dict of str to float
        As from `published.measures`.
    """

    pair: str
    case: Case
    measures: dict[str, float]


@dataclass(frozen=True)
class Change:
    """How one measure changes against the published protocol.

    Attributes
    ----------
    case : str
    method : str
    window : int
    measure : str
        One of `published.COLUMNS`.
    base : float
        The published protocol's true mean over the pairs.
    mean : float
        The mean change.
    low, high : float
        Between them lie 95 % of the mean changes of resampled pairs.
    pairs : tuple of float
        The change on each pair, in the order of the pairs; empty for the switch that only the mean knows.
    """

    case: str
    method: str
    window: int
    measure: str
    base: float
    mean: float
    low: float
    high: float
    pairs: tuple[float, ...]


def ablation_cases() -> list[Case]:
    """List what has to be matched, for both of the report's algorithms.

    Returns
    -------
    list of (name, method, window, quirks)
        For each algorithm the published protocol first, then that with each switch off that has a part in it,
        then the one with all off. ``last_pair_dropped`` changes no map and has no case: `changes` adds it.
    """
    cases = []
    for method, window in TABLES.values():
        cases.append(Case(BASE, method, window, PUBLISHED))
        for quirk in Quirks.names():
            if acts(quirk, method):
                cases.append(Case(LABELS[quirk], method, window, replace(PUBLISHED, **{quirk: False})))
        cases.append(Case(ALL, method, window, Quirks()))
    return cases


def row(sample: Sample, case: Case) -> Row:
    """Match and measure one pair under one case; each is independent of all others."""
    return Row(sample.name, case, published.score(sample, case.method, case.window, case.quirks))


def ablate(
    samples: Iterable[Sample],
    progress: Callable[[Row], None] | None = None,
    cases: Sequence[Case] | None = None,
) -> list[Row]:
    """Try all cases on all pairs.

    Parameters
    ----------
    samples : iterable of Sample
        In the order of their names.
    progress : callable, optional
        Told each row as it is done.
    cases : sequence of Case, optional
        Those of `ablation_cases`.

    Returns
    -------
    list of Row
        Pair by pair. `changes` makes the table of them.
    """
    rows = []
    for sample in samples:
        for case in ablation_cases() if cases is None else cases:
            rows.append(row(sample, case))
            if progress:
                progress(rows[-1])
    return rows


def changes(rows: Iterable[Row]) -> list[Change]:
    """Compare every case with the published protocol, pair by pair.

    Parameters
    ----------
    rows : iterable of Row
        Every case of an algorithm on the same pairs, the pairs in the same order.

    Returns
    -------
    list of Change
        In the order of the cases, measure by measure. The interval is the percentile bootstrap over pairs
        (10 000 resamples, always the same).

    Raises
    ------
    ValueError
        If a case lacks a pair, or an algorithm its published protocol.

    References
    ----------
    B. Efron: Bootstrap methods: another look at the jackknife. The Annals of Statistics 1979,
    doi:10.1214/aos/1176344552.
    """
    tried: dict[Case, dict[str, dict[str, float]]] = {}
    for each in rows:
        tried.setdefault(each.case, {})[each.pair] = each.measures
    bases = {(case.method, case.window): case for case in tried if case.name == BASE}
    found = []
    for case, by_pair in tried.items():
        base_case = bases.get((case.method, case.window))
        if base_case is None:
            raise ValueError(f"rows must hold {BASE!r} for {case.method} at {case.window}")
        base = tried[base_case]
        if [*by_pair] != [*base]:
            raise ValueError(f"rows must hold the same pairs for {case.name!r} as for {BASE!r}")
        if case.name == BASE:
            continue
        if case.name == ALL:
            found += [_of_the_mean(base_case, name, _column(base, name)) for name in COLUMNS]
        for name in COLUMNS:
            before = _column(base, name)
            by_pair_change = _column(by_pair, name) - before
            low, high = _interval(by_pair_change[_resamples(before.size)].mean(axis=1))
            mean = float(by_pair_change.mean())
            found.append(
                Change(*case[:3], name, float(before.mean()), mean, low, high, (*by_pair_change.tolist(),))
            )
    return found


def _of_the_mean(base: Case, measure: str, values: npt.NDArray[np.float64]) -> Change:
    """What it changes that the last pair counts: its share of the mean, whichever pair comes last."""
    last = values[_resamples(values.size)[:, -1]] / values.size
    return Change(
        LABELS[MEAN],
        base.method,
        base.window,
        measure,
        float(values.mean()),
        float(values[-1]) / values.size,
        *_interval(last),
        (),
    )


def _column(by_pair: dict[str, dict[str, float]], measure: str) -> npt.NDArray[np.float64]:
    return np.array([measures[measure] for measures in by_pair.values()])


def _resamples(count: int) -> npt.NDArray[np.int64]:
    return np.random.default_rng(0).integers(0, count, (RESAMPLES, count))


def _interval(draws: npt.NDArray[np.float64]) -> tuple[float, float]:
    low, high = np.quantile(draws, [0.025, 0.975])
    return float(low), float(high)


def markdown(found: Sequence[Change]) -> str:
    """Lay out changes as GitHub Markdown, a table an algorithm: percentage points, and pixels for RMSE.

    Parameters
    ----------
    found : sequence of Change
        From `changes`.

    Returns
    -------
    str
    """
    header = "| switched off | < 0.25 px | < 0.5 px | < 1 px | < 2 px | < 4 px | RMSE |"
    tables = []
    for method, window in dict.fromkeys((change.method, change.window) for change in found):
        here = [change for change in found if (change.method, change.window) == (method, window)]
        bases = {change.measure: change.base for change in here}
        lines = [
            header,
            "| --- |" + " ---: |" * len(COLUMNS),
            f"| nothing: {method}, {window} | "
            + " | ".join(f"{_scaled(name, bases[name]):.2f}" for name in COLUMNS)
            + " |",
        ]
        for case in dict.fromkeys(change.case for change in here):
            cells = [_cell(change) for change in here if change.case == case]
            lines.append(f"| {case} | " + " | ".join(cells) + " |")
        tables.append("\n".join(lines))
    return "\n\n".join(tables)


def _scaled(measure: str, value: float) -> float:
    return value if measure == "rmse" else 100 * value


def _cell(change: Change) -> str:
    mean, low, high = (
        # A zero is added so that none is negative.
        f"{round(_scaled(change.measure, value), 2) + 0.0:+.2f}".replace("-", "\N{MINUS SIGN}")
        for value in (change.mean, change.low, change.high)
    )
    return f"{mean} ({low} … {high})"
