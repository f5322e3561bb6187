"""The sections of the page: each one function from the report to a `Section`, or None without rows.

A new section is a function and a place in `SECTIONS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

from stereopsis.plot import Series
from stereopsis.study import ablation, methods, published
from stereopsis.study.figures import Panel, bars, lines, scatter
from stereopsis.study.measure import BINS, KEPT, MEASURES, RECOGNISED, STRATA
from stereopsis.study.methods import WINDOW, Method
from stereopsis.study.pairs import WEATHER
from stereopsis.study.plan import Study, ablated
from stereopsis.study.tables import (
    LABELS,
    NOTHING,
    SMALLER,
    Cell,
    Rows,
    Stat,
    Table,
    cell,
    compare,
    number,
    printed,
)

FRACTIONS: Final = tuple(reversed(MEASURES[:-1]))
WINDOW_AXIS: Final = "window size (px)"
RMSE_AXIS: Final = "RMSE (px)"


@dataclass(frozen=True)
class Report:
    """What the sections draw from."""

    study: Study
    name: str
    rows: Rows

    def methods(self, part: str) -> tuple[Method, ...]:
        """The study's methods of one part."""
        return tuple(method for method in methods.named(self.study.methods) if method.part == part)


@dataclass(frozen=True)
class Figure:
    """One or more panels under one caption."""

    caption: str
    panels: tuple[Panel, ...]
    numbers: Table | None = None


@dataclass(frozen=True)
class Picture:
    """A disparity map that the page is to show: of which method, with which setting."""

    method: str
    label: str
    window: int | None


@dataclass(frozen=True)
class Section:
    """A part of the page."""

    name: str
    title: str
    prose: tuple[str, ...]
    tables: tuple[Table, ...] = ()
    figures: tuple[Figure, ...] = ()
    pictures: tuple[Picture, ...] = field(default=())


def make(report: Report) -> tuple[Section, ...]:
    """Every section that has rows, in the order of the page."""
    return tuple(made for section in SECTIONS if (made := section(report)) is not None)


def summary(report: Report) -> Section | None:
    """The report's algorithms beside the corrected ones."""
    algorithms = [
        (f"Algorithm {n}, as published", f"published: {method}-{window}")
        for n, (method, window) in enumerate(published.TABLES.values(), 1)
    ]
    settings = [
        *algorithms,
        *((f"{m.label}, window {WINDOW}", m.setting(WINDOW)) for m in report.methods("sweep")),
        *((m.label, m.setting(WINDOW)) for m in report.methods("presets")),
    ]
    table = compare(f"Mean over the pairs of {report.name}", report.rows, settings)
    if table is None:
        return None
    corrected = [s for s in settings[2:] if report.rows.has(s[1])]
    if not corrected:
        return None
    best = max(corrected, key=lambda item: report.rows.stat(item[1], "within_1").mean)
    least = min(corrected, key=lambda item: report.rows.stat(item[1], "rmse").mean)
    prose = (
        f"Most pixels within 1 px: {best[0]}, {said(report.rows, best[1], 'within_1')}. "
        f"Least RMSE: {least[0]}, {said(report.rows, least[1], 'rmse')} px."
    )
    before = report.rows.stat(algorithms[0][1], "within_1")
    if before.count:
        prose += (
            f" The report's Algorithm 1, over the same pairs and in its own protocol: "
            f"{said(report.rows, algorithms[0][1], 'within_1')} and "
            f"{said(report.rows, algorithms[0][1], 'rmse')} px."
        )
    return Section("summary", "At a glance", (prose,), (table,))


def said(rows: Rows, setting: str, column: str) -> str:
    """A mean as part of a sentence."""
    return number(rows.stat(setting, column).mean, column)


def as_published(report: Report) -> Section | None:
    """The report's tables and figures, reproduced."""
    rows = report.rows
    tables = []
    found = {
        "as printed": printed(rows, as_printed=True),
        "mean of all pairs": printed(rows, as_printed=False),
    }
    for name, (method, window) in published.TABLES.items():
        if name in found["as printed"]:
            lines_ = tuple(
                (Cell(label), *(Cell(number(v, c)) for v, c in zip(values[name], MEASURES, strict=True)))
                for label, values in found.items()
            )
            title = f"Table {name.split('_')[0]}. {published_label(method)}, window {window}"
            note = "As printed: the sum without the last pair, divided by the number of all of them."
            tables.append(Table(title, ("", *(LABELS[c] for c in MEASURES)), lines_, note))
    windows = report.study.windows
    figures = []
    rows = rows.only(next(iter(rows.pairs()), ""))
    for method, figure in (("ssd", "3"), ("zssd", "4"), ("zncc", "5")):
        present = [w for w in windows if rows.has(f"published: {method}-{w}")]
        if len(present) > 1:
            caption = f"Figure {figure} as published: {published_label(method)} on the first pair."
            figures.append(_sweep(rows, [f"published: {method}-{w}" for w in present], present, caption))
    compared = ("zncc", "zncc_smoothed", "zncc_gaussian")
    present = [w for w in windows if all(rows.has(f"published: {m}-{w}") for m in compared)]
    if len(present) > 1:
        rmse = tuple(
            _series(published_label(m), rows, [f"published: {m}-{w}" for w in present], present, "rmse")
            for m in compared
        )
        caption = "Figure 7 as published: RMSE on the first pair."
        figures.append(
            Figure(caption, (lines(rmse, WINDOW_AXIS, RMSE_AXIS),), _numbers(rmse, "rmse", "window"))
        )
        panels = [
            lines(
                [
                    _series(LABELS[c], rows, [f"published: {m}-{w}" for w in present], present, c)
                    for c in FRACTIONS
                ],
                WINDOW_AXIS,
                "pixels",
                percent=True,
                title=published_label(m),
            )
            for m in compared[:2]
        ]
        figures.append(Figure("Figure 8 as published: fractions on the first pair.", tuple(panels)))
    if not tables and not figures:
        return None
    prose = [
        "The experiment as it was run: channels weighed in the wrong order, the search range read from the "
        "truth, a left image that wraps round, disparities of the right view scored against the left view's "
        "truth, and a squared difference that overflows its byte."
    ]
    drops = [
        (
            rows.stat(f"published: zncc-{w}", "rmse").mean
            / rows.stat(f"published: zncc_smoothed-{w}", "rmse").mean
        )
        - 1
        for w in present
    ]
    if drops:
        prose.append(
            f"Without smoothing the RMSE of ZNCC is higher by {100 * sum(drops) / len(drops):.2f} % of the "
            f"smoothed one's, in the mean over {len(drops)} windows on the first pair; the report prints "
            "“around 9 %”."
        )
    return Section("published", "The report, reproduced", tuple(prose), tuple(tables), tuple(figures))


def published_label(method: str) -> str:
    """A method of the report as its figures call it."""
    cost, _, more = method.partition("_")
    return (
        {"": "", "smoothed": "Smoothed ", "gaussian": ""}.get(more, "")
        + cost.upper()
        + (" with Gaussian filter" if more == "gaussian" else "")
    )


def the_ablation(report: Report) -> Section | None:
    """Each quirk of the published protocol switched off."""
    groups: dict[tuple[str, int], list[ablation.Case]] = {}
    for case in ablation.ablation_cases():
        if report.rows.has(ablated(case)):
            groups.setdefault((case.method, case.window), []).append(case)
    tables: list[Table] = []
    figures: list[Figure] = []
    for (method, window), cases in groups.items():
        if len(cases) > 1 and cases[0].name == ablation.BASE:
            made = _ablated(report.rows, f"{published_label(method)}, window {window}", cases)
            tables += made[0]
            figures += made[1]
    if not tables:
        return None
    prose = (
        "From the published protocol on, one quirk is switched off at a time, then all of them. What a quirk "
        "costs on its own need not add up: they act on the same pixels.",
    )
    return Section("ablation", "Ablation: what each mistake costs", prose, tuple(tables), tuple(figures))


def _ablated(rows: Rows, label: str, cases: Sequence[ablation.Case]) -> tuple[list[Table], list[Figure]]:
    """One algorithm's ablation: changes, absolute values, and the changes of each pair."""
    measured = {case: rows.of(ablated(case)) for case in cases}
    # A pair that failed under one case is left out of all, so that each change is over the same pairs.
    pairs = [pair for pair in measured[cases[0]] if all(pair in found for found in measured.values())]
    if not pairs:
        return [], []
    each = [
        ablation.Row(pair, case, {column: found[pair][column] for column in MEASURES})
        for case, found in measured.items()
        for pair in pairs
    ]
    by_case: dict[str, dict[str, ablation.Change]] = {}
    for change in ablation.changes(each):
        by_case.setdefault(change.case, {})[change.measure] = change

    def stat(change: ablation.Change) -> Stat:
        return Stat(change.mean, change.low, change.high, len(pairs))

    changes = Table(
        f"{label}: change against “{ablation.BASE}”, over {len(pairs)} pairs",
        ("", *(LABELS[c] for c in MEASURES)),
        tuple(
            (Cell(case), *(cell(stat(found[c]), c, signed=True) for c in MEASURES))
            for case, found in by_case.items()
        ),
        "Mean over pairs (pp: percentage points), and the interval that holds 95 % of the means of "
        "resampled pairs. An interval without 0 is a change that does not hang on which pairs there are.",
    )
    absolute = compare(
        f"{label}: measures under each protocol", rows, [(case.name, ablated(case)) for case in cases]
    )
    tables = [changes, *([absolute] if absolute else [])]
    single = {case: found for case, found in by_case.items() if found["rmse"].pairs}
    for column in ("within_1", "rmse"):
        lines_ = tuple(
            (
                Cell(pair),
                *(Cell(number(found[column].pairs[n], column, signed=True)) for found in single.values()),
            )
            for n, pair in enumerate(pairs)
        )
        tables.append(Table(f"{label}: change of {LABELS[column]}, each pair", ("pair", *single), lines_))
    panels = tuple(
        bars(
            tuple(by_case),
            [_points("change", (), [stat(found[column]) for found in by_case.values()])],
            axis,
            percent=column == "within_1",
        )
        for column, axis in (("within_1", "change of pixels within 1 px"), ("rmse", "change of RMSE (px)"))
    )
    return tables, [Figure(f"{label}: what switching off each quirk changes.", panels)]


def windows(report: Report) -> Section | None:
    """Figures 3 to 5, corrected and on every pair."""
    rows, found = report.rows, report.methods("sweep")
    figures = []
    names = {"ssd": "Figure 3", "zssd": "Figure 4", "zncc": "Figure 5"}
    for method in sorted(found, key=lambda m: list(names).index(m.name) if m.name in names else 9):
        present = [w for w in report.study.windows if rows.has(method.setting(w))]
        if len(present) > 1:
            label = f"{names[method.name]}, corrected" if method.name in names else "Beside them"
            caption = f"{label}: {method.label} over {_pairs(rows, method.setting(present[0]))}."
            figures.append(_sweep(rows, [method.setting(w) for w in present], present, caption))
    if not figures:
        return None
    prose = (
        f"Matched in the left view over {_candidates(report)}, with exact sums and a sub-pixel fit. Each "
        "point is the mean over the pairs, each band the interval that holds 95 % of the means of "
        "resampled pairs.",
    )
    return Section("windows", "Window size", prose, _best_windows(report), tuple(figures))


def _candidates(report: Report) -> str:
    if report.study.disparities == "estimate":
        return "a range of disparities estimated from each pair's images alone"
    low, high = report.study.disparities
    return f"the same candidates for every pair, {low} … {high - 1} px, which no truth has set"


def _best_windows(report: Report) -> tuple[Table, ...]:
    """Which window is best, by each measure."""
    lines_ = []
    for method in report.methods("sweep"):
        present = [w for w in report.study.windows if report.rows.has(method.setting(w))]
        if not present:
            continue
        cells = [Cell(method.label)]
        for column in MEASURES:
            means = {w: report.rows.stat(method.setting(w), column).mean for w in present}
            best = (min if column in SMALLER else max)(means, key=lambda w: means[w])
            cells.append(Cell(str(best), number(means[best], column)))
        lines_.append(tuple(cells))
    if not lines_:
        return ()
    head = ("", *(LABELS[c] for c in MEASURES))
    return (Table("Best window in pixels by each measure, and what it reaches", head, tuple(lines_)),)


def maps(report: Report) -> Section | None:
    """Figure 6."""
    found = [
        m
        for m in (*report.methods("sweep"), *report.methods("presets"))
        if report.rows.has(m.setting(WINDOW))
    ]
    if not found:
        return None
    pictures = tuple(Picture(m.name, m.label, WINDOW if m.windowed else None) for m in found)
    prose = (
        f"Figure 6, corrected: the map of each cost at window {WINDOW}, and of each preset. Dark is far, "
        "light is near, grey is not answered. On the first pair; below it those on which the methods do "
        "worst and best.",
    )
    return Section("maps", "Disparity maps", prose, pictures=pictures)


def improvements(report: Report) -> Section | None:
    """Figures 7 and 8: smoothing and the Gaussian window."""
    rows = report.rows
    found = [
        m
        for m in report.methods("sweep")
        if m.name.startswith("zncc") and sum(rows.has(m.setting(w)) for w in report.study.windows) > 1
    ]
    if len(found) < 2:
        return None
    present = [w for w in report.study.windows if all(rows.has(m.setting(w)) for m in found)]
    rmse = [_series(m.label, rows, [m.setting(w) for w in present], present, "rmse") for m in found]
    panels = tuple(
        lines(
            [_series(LABELS[c], rows, [m.setting(w) for w in present], present, c) for c in FRACTIONS],
            WINDOW_AXIS,
            "pixels",
            percent=True,
            title=m.label,
        )
        for m in found
    )
    figures = (
        Figure(
            "Figure 7, corrected: RMSE.",
            (lines(rmse, WINDOW_AXIS, RMSE_AXIS),),
            _numbers(rmse, "rmse", "window"),
        ),
        Figure("Figure 8, corrected: fractions.", panels),
    )
    prose = (
        "A Gaussian is drawn at the box window of the same variance: the report's “window 15” was a "
        "standard deviation of 15 pixels, as wide as a box of 52, so it only seemed to need a small window.",
    )
    return Section("improvements", "Smoothing and the Gaussian window", prose, figures=figures)


def trade_off(report: Report) -> Section | None:
    """RMSE against fractions."""
    rows = report.rows
    groups, every = [], []
    for method in (*report.methods("sweep"), *report.methods("presets")):
        sizes = report.study.windows if method.part == "sweep" else (WINDOW,)
        points = [
            (
                rows.stat(method.setting(w), "rmse").mean,
                100 * rows.stat(method.setting(w), "within_1").mean,
                str(w) if method.windowed else "",
            )
            for w in sizes
            if math.isfinite(rows.stat(method.setting(w), "rmse").mean)
        ]
        if points:
            groups.append((method.label, points))
            every += [(method.label, *point) for point in points]
    if len(every) < 3:
        return None
    front = sorted(
        (rmse, within, label, window)
        for label, rmse, within, window in every
        if not any(r <= rmse and w >= within and (r, w) != (rmse, within) for _, r, w, _ in every)
    )
    panel = scatter(groups, [point[:2] for point in front], RMSE_AXIS, "pixels within 1 px (%)")
    table = Table(
        "The Pareto front: no other setting is better in one measure and as good in the other",
        ("", "window", LABELS["rmse"], LABELS["within_1"]),
        tuple(
            (Cell(label), Cell(window or NOTHING), Cell(f"{rmse:.3f}"), Cell(f"{within:.2f} %"))
            for rmse, within, label, window in front
        ),
    )
    prose = (
        "The report wonders why the window with the least RMSE loses pixels in the small-error ranges. A "
        "large window averages gross errors away, which the square in the RMSE rewards, and with them every "
        "slope and edge.",
    )
    figure = Figure(
        "RMSE against the fraction within 1 px; small numbers are windows. Up and left is better.", (panel,)
    )
    return Section("trade-off", "RMSE against fractions", prose, (table,), (figure,))


def corrected_tables(report: Report) -> Section | None:
    """Tables I and II, corrected, and every whole method."""
    settings = [(m.label, m.setting(WINDOW)) for m in report.methods("presets")]
    settings += [
        (f"{m.label}, window {WINDOW}", m.setting(WINDOW))
        for m in report.methods("sweep")
        if m.name.startswith("zncc")
    ]
    columns = (*MEASURES, "density", "own_within_1", "own_rmse")
    note = (
        "Over every pixel with known truth, holes filled from the background. Density: the share of them "
        "that the method answers by itself. The last two columns count those alone."
    )
    table = compare("Tables I and II, corrected: mean over all pairs", report.rows, settings, columns, note)
    if table is None:
        return None
    prose = ("Algorithm 1 is the preset paper-smoothed, Algorithm 2 the preset paper-gaussian.",)
    return Section("tables", "The report's tables, corrected", prose, (table,))


def sub_pixel(report: Report) -> Section | None:
    """Sub-pixel methods, and pixel-locking."""
    rows = report.rows
    found = [m for m in report.methods("subpixel") if rows.has(m.setting(WINDOW))]
    if len(found) < 2:
        return None
    base = found[0].setting(WINDOW)
    before = rows.stat(base, "within_0.25").mean
    settings = [(m.label, m.setting(WINDOW)) for m in found]
    table = compare(f"Sub-pixel methods: ZNCC, window {WINDOW}", rows, settings)
    assert table is not None
    gains = Table(
        "Gain over whole pixels within 0.25 px",
        ("", "change", "relative"),
        tuple(
            (
                Cell(m.label),
                cell(rows.change(m.setting(WINDOW), base, "within_0.25"), "within_0.25", signed=True),
                Cell(f"{100 * (rows.stat(m.setting(WINDOW), 'within_0.25').mean / before - 1):+.1f} %"),
            )
            for m in found[1:]
        ),
    )
    centres = tuple((n + 0.5) / BINS for n in range(BINS))
    histogram = [
        _points(m.label, centres, [rows.stat(m.setting(WINDOW), f"fractional_{n}") for n in range(BINS)])
        for m in found[1:]
    ]
    bias = [
        _points(m.label, centres, [rows.stat(m.setting(WINDOW), f"phase_bias_{n}") for n in range(BINS)])
        for m in found
    ]
    panels = (
        lines(
            histogram,
            "fractional part of the disparity (px)",
            "pixels",
            percent=True,
            title="Where answers fall",
        ),
        lines(
            bias, "fractional part of the truth (px)", "mean error (px)", zero=False, title="Bias by phase"
        ),
    )
    caption = (
        "Pixel-locking: a fit without it is flat on the left, and on the right has no slope. Pixels that "
        "err by less than 1 px."
    )
    prose = (
        "The report's sub-pixel attempts gave bad results because they picked the slope of the score, or "
        "enlarged what they then matched in the wrong frame. A fit through the winner's neighbours helps at "
        "once.",
    )
    return Section("sub-pixel", "Sub-pixel refinement", prose, (table, gains), (Figure(caption, panels),))


def supports(report: Report) -> Section | None:
    """Support windows."""
    settings = [(m.label, m.setting(WINDOW)) for m in report.methods("supports")]
    columns = (*MEASURES, "edge_within_1", "interior_within_1", "seconds")
    table = compare(
        f"Supports under ZNCC, about as wide as a box of {WINDOW}", report.rows, settings, columns
    )
    if table is None:
        return None
    prose = (
        "What the window's shape does, over the same candidates and with the same fit; the time is that of "
        "matching and measuring a pair on this machine.",
    )
    return Section("supports", "Support windows", prose, (table,))


def smoothing(report: Report) -> Section | None:
    """What neighbours' labels add."""
    rows = report.rows
    found = [(m.label, m.setting(WINDOW)) for m in report.methods("smoothing") if rows.has(m.setting(WINDOW))]
    table = compare("Smoothing, mean over all pairs", rows, found, (*MEASURES, "seconds"))
    if table is None:
        return None
    (base_name, base), *others = found
    changes = Table(
        f"Change against “{base_name}”, pair by pair",
        ("", *(LABELS[c] for c in MEASURES)),
        tuple(
            (Cell(label), *(cell(rows.change(setting, base, c), c, signed=True) for c in MEASURES))
            for label, setting in others
        ),
    )
    prose = (
        "The report prefers squared to absolute differences of neighbours' disparities. Both are here, on "
        "every pair, with the spread over pairs.",
    )
    return Section("smoothing", "Smoothing", prose, (table, changes))


def where(report: Report) -> Section | None:
    """Where the error lies."""
    tables, figures = [], []
    chosen = [
        (m.label, m.setting(WINDOW))
        for m in (*report.methods("sweep"), *report.methods("presets"))
        if report.rows.has(m.setting(WINDOW)) or report.rows.has(m.setting(WINDOW), "synthetic")
    ]
    for group, title, condition in (
        ("data", report.name, None),
        ("synthetic", "synthetic streets, clear", "clear"),
    ):
        present = [(label, s) for label, s in chosen if report.rows.has(s, group)]
        if not present:
            continue
        shown = [
            s for s in STRATA if report.rows.stat(present[0][1], f"{s}_within_1", group, condition).count
        ]
        lines_ = tuple(
            (
                Cell(stratum_label(stratum)),
                _share(report.rows, present[0][1], stratum, group, condition),
                *(
                    Cell(
                        number(
                            report.rows.stat(setting, f"{stratum}_within_1", group, condition).mean,
                            "within_1",
                        ),
                        number(report.rows.stat(setting, f"{stratum}_rmse", group, condition).mean, "rmse")
                        + " px",
                    )
                    for _, setting in present
                ),
            )
            for stratum in shown
        )
        head = ("", "share", *(label for label, _ in present))
        note = "Within 1 px, and RMSE beside it. Share: of the pixels with known truth."
        if group == "synthetic":
            note += " The sky counts as disparity 0; “visible” are the pixels that both views see."
        tables.append(Table(f"Where the error lies: {title}, window {WINDOW}", head, lines_, note))
        panels = []
        for name, axis in (
            ("distance", "true disparity (px)"),
            ("texture", "texture (mean gradient, grey levels)"),
        ):
            bands = [s for s in shown if s.startswith(f"{name}_")]
            if len(bands) > 1:
                panels.append(
                    bars(
                        [stratum_label(s).partition(": ")[2] for s in bands],
                        [
                            _points(
                                label,
                                (),
                                [report.rows.stat(s, f"{b}_within_1", group, condition) for b in bands],
                            )
                            for label, s in _few(present)
                        ],
                        "pixels within 1 px",
                        percent=True,
                        title=axis,
                    )
                )
        if panels:
            figures.append(Figure(f"Pixels within 1 px by distance and by texture: {title}.", tuple(panels)))
    if not tables:
        return None
    prose = (
        "Every known pixel belongs to one band of distance and one of texture, to an edge (the truth steps "
        "by more than 3 px within 7 px on its row) or to an interior; on synthetic streets also to what one "
        "view alone sees, and to the sky.",
    )
    return Section("where", "Where the error lies", prose, tuple(tables), tuple(figures))


def stratum_label(name: str) -> str:
    """A stratum in words."""
    kind, *bounds = name.split("_")
    match kind:
        case "distance" | "texture":
            low, high = bounds
            unit = "px" if kind == "distance" else "grey levels"
            span = f"{low} … {high} {unit}" if high != "inf" else f"over {low} {unit}"
            return f"{'disparity' if kind == 'distance' else 'texture'}: {span}"
        case "edge":
            return "at an edge"
        case "interior":
            return "away from edges"
        case "visible":
            return "seen by both views"
        case "occluded":
            return "occluded"
        case "textured":
            return "textured, and seen by both"
        case _:
            return name


def weather(report: Report) -> Section | None:
    """The same methods under every condition."""
    chosen = [
        (m.label, m.setting(WINDOW))
        for m in (*report.methods("sweep"), *report.methods("presets"))
        if report.rows.has(m.setting(WINDOW), "synthetic")
    ]
    if not chosen:
        return None
    conditions = [name for name, _ in WEATHER]
    tables = tuple(
        Table(
            f"{LABELS[column]} of all known pixels under each condition",
            ("", *conditions),
            tuple(
                (
                    Cell(label),
                    *(cell(report.rows.stat(s, column, "synthetic", c), column) for c in conditions),
                )
                for label, s in chosen
            ),
        )
        for column in ("within_1", "rmse")
    )
    panel = bars(
        conditions,
        [
            _points(label, (), [report.rows.stat(s, "within_1", "synthetic", c) for c in conditions])
            for label, s in _few(chosen)
        ],
        "pixels within 1 px",
        percent=True,
    )
    options = "; ".join(
        f"{name}: " + ", ".join(f"{key.replace('_', ' ')} {value:g}" for key, value in given.items())
        for name, given in WEATHER
        if given
    )
    prose = (
        f"Rendered streets with exact truth, the same ones under every condition ({options}). An exposure "
        "difference takes SSD and SAD down and leaves ZNCC as it was; rain, whose streaks differ between "
        "the views, hurts all.",
    )
    figure = Figure("Pixels within 1 px by condition.", (panel,))
    return Section("weather", "Weather", prose, tables, (figure,))


def invalid(report: Report) -> Section | None:
    """Recognising what cannot be matched."""
    rows = report.rows
    found = [m for m in report.methods("checks") if rows.has(m.setting(WINDOW))]
    if not found:
        return None
    columns = ("density", "own_within_1", "own_within_4", "own_rmse")
    labels = ("density", "own: < 1 px", "own: < 4 px", "own: RMSE (px)")
    table = Table(
        f"Checks after ZNCC, window {WINDOW}: what is still answered, and how well",
        ("", *labels),
        tuple((Cell(m.label), *(cell(rows.stat(m.setting(WINDOW), c), c) for c in columns)) for m in found),
    )
    # Areas compare only where every pixel is answered: elsewhere the curve begins later.
    dense = [
        (m.label, m.setting(WINDOW))
        for m in report.methods("sweep")
        if rows.stat(m.setting(WINDOW), "density").mean == 1
    ]
    areas = Table(
        f"Area of the sparsification curve, window {WINDOW}",
        ("", "by confidence (px)", "ideal (px)"),
        tuple(
            (Cell(label), *(cell(rows.stat(setting, c), c) for c in ("sparse_auc", "ideal_auc")))
            for label, setting in dense
        ),
        "The mean RMSE of the most confident 100, 95, … 5 % of the pixels; ideal: in the order of the true "
        "errors.",
    )
    whole = [m for m in (*found, *report.methods("presets")) if rows.has(m.setting(WINDOW), "synthetic")]
    kinds = [f"found_{kind}_{measure}" for kind in RECOGNISED for measure in ("precision", "recall")]
    flags = Table(
        "Precision and recall of the flags on synthetic streets in clear air",
        ("", *(kind.removeprefix("found_").replace("_", ": ") for kind in kinds)),
        tuple(
            (
                Cell(m.label),
                *(cell(rows.stat(m.setting(WINDOW), kind, "synthetic", "clear"), kind) for kind in kinds),
            )
            for m in whole
        ),
        "Occluded: flagged as occluded or out of view, against what the left view alone sees. Sky: flagged "
        "as sky. Invalid: flagged with anything, against either.",
    )
    curves = []
    for label, prefix in (("by confidence", "sparse"), ("ideal", "ideal")):
        stats = [rows.stat(found[0].setting(WINDOW), f"{prefix}_{kept:g}") for kept in KEPT]
        curves.append(_points(label, tuple(100 * kept for kept in KEPT), stats))
    checked = [
        Series(
            m.label,
            (100 * rows.stat(m.setting(WINDOW), "density").mean,),
            (rows.stat(m.setting(WINDOW), "own_rmse").mean,),
        )
        for m in found[1:]
    ]
    panel = lines([*curves, *checked], "pixels answered (%)", RMSE_AXIS)
    prose = (
        "The report's algorithms “do not have abilities to recognize these information and invalid them”. "
        "Here each rejected pixel is NaN with a flag that says why, and each answer has a confidence: "
        "leaving the least confident out first lowers the error of the rest.",
    )
    figure = Figure(
        "Sparsification: the error of the most confident pixels, and of what each check leaves.", (panel,)
    )
    tables = (table, *([areas] if dense else []), *([flags] if whole else []))
    return Section("invalid", "Recognising what cannot be matched", prose, tables, (figure,))


SECTIONS: Final[tuple[Callable[[Report], Section | None], ...]] = (
    summary,
    as_published,
    the_ablation,
    windows,
    maps,
    improvements,
    trade_off,
    corrected_tables,
    sub_pixel,
    supports,
    smoothing,
    where,
    weather,
    invalid,
)


def _sweep(rows: Rows, settings: Sequence[str], windows: Sequence[int], caption: str) -> Figure:
    """The report's kind of figure: fractions and RMSE over windows, a panel each."""
    fractions = [_series(LABELS[c], rows, settings, windows, c) for c in FRACTIONS]
    rmse = _series("RMSE", rows, settings, windows, "rmse")
    panels = (
        lines(fractions, WINDOW_AXIS, "pixels", percent=True),
        lines([rmse], WINDOW_AXIS, RMSE_AXIS),
    )
    table = Table(
        "",
        ("window", *(LABELS[c] for c in MEASURES)),
        tuple(
            (Cell(str(w)), *(cell(rows.stat(s, c), c) for c in MEASURES))
            for w, s in zip(windows, settings, strict=True)
        ),
    )
    return Figure(caption, panels, table)


def _series(label: str, rows: Rows, settings: Sequence[str], x: Sequence[float], column: str) -> Series:
    return _points(label, tuple(x), [rows.stat(setting, column) for setting in settings])


def _points(label: str, x: tuple[float, ...], stats: Sequence[Stat]) -> Series:
    stats = [stat if math.isfinite(stat.mean) else Stat.of(()) for stat in stats]  # drawn as a gap
    means = tuple(stat.mean for stat in stats)
    if max((stat.count for stat in stats), default=0) < 2:
        return Series(label, x, means)
    return Series(label, x, means, tuple(s.low for s in stats), tuple(s.high for s in stats))


def _numbers(series: Sequence[Series], column: str, first: str) -> Table:
    """The numbers of lines over the same x."""
    return Table(
        "",
        (first, *(one.label for one in series)),
        tuple(
            (Cell(f"{x:g}"), *(Cell(number(one.y[n], column)) for one in series))
            for n, x in enumerate(series[0].x)
        ),
    )


def _share(rows: Rows, setting: str, stratum: str, group: str, condition: str | None) -> Cell:
    counts = rows.values(setting, f"{stratum}_count", group, condition)
    known = rows.values(setting, "known", group, condition)
    # The sky has no truth of its own.
    return Cell(
        NOTHING if stratum == "sky" else f"{100 * sum(counts.values()) / max(1, sum(known.values())):.1f} %"
    )


def _few(settings: Sequence[tuple[str, str]]) -> Sequence[tuple[str, str]]:
    """As many as a figure of bars can tell apart: plain ones that the report compares, then whole methods."""
    plain = [item for item in settings if item[1] in (f"ssd-{WINDOW}", f"zncc-{WINDOW}")]
    whole = [item for item in settings if item[0].startswith("preset")]
    return [*plain, *whole][:6] or settings[:6]


def _pairs(rows: Rows, setting: str) -> str:
    count = len(rows.values(setting, "rmse"))
    return f"{count} pair{'s' if count != 1 else ''}"
