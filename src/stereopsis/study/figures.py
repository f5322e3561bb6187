"""The figures of the page, as SVG that takes its text colour and font from the page around it."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from stereopsis import plot
from stereopsis.plot import COLOURS, MARKERS, STYLES, Series, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK: Final = "#010203"
"""Stands for the page's text colour until the figure is written."""


@dataclass(frozen=True)
class Panel:
    """One drawing: the SVG and what it shows in words."""

    svg: str
    alt: str


def lines(
    series: Sequence[Series],
    x: str,
    y: str,
    *,
    percent: bool = False,
    zero: bool = True,
    title: str = "",
    marks: Sequence[tuple[float, str]] = (),
) -> Panel:
    """Lines with bands; `marks` are vertical lines with a label."""

    def draw(axes: Axes) -> None:
        plot.lines(axes, series, percent=percent, zero=zero, marks=marks)

    said = "; ".join(
        f"{one.label}: from {one.y[0]:.3g} to {one.y[-1]:.3g}, least {min(one.y):.3g}, most {max(one.y):.3g}"
        for one in series
        if one.y
    )
    return _panel(draw, x, y + (" (%)" if percent else ""), title, f"{title or y} against {x}. {said}.")


def scatter(
    groups: Sequence[tuple[str, Sequence[tuple[float, float, str]]]],
    front: Sequence[tuple[float, float]],
    x: str,
    y: str,
    title: str = "",
) -> Panel:
    """Points (x, y, label) of each group joined in order, and the front of what nothing else betters."""

    def draw(axes: Axes) -> None:
        if front:
            axes.plot(*zip(*front, strict=True), color=INK, linewidth=5, alpha=0.18, label="Pareto front")
        for number, (label, points) in enumerate(groups):
            xs, ys = [p[0] for p in points], [p[1] for p in points]
            colour = COLOURS[number % len(COLOURS)]
            axes.plot(
                xs, ys, label=label, color=colour, linewidth=0.8, marker=MARKERS[number % len(MARKERS)],
                markersize=4.5, linestyle=STYLES[number % len(STYLES)],
            )  # fmt: skip
            for place, (px, py, text) in enumerate(points):
                if text and place in (0, len(points) - 1):
                    axes.annotate(
                        text, (px, py), (4, 3), textcoords="offset points", fontsize=7, color=colour
                    )
        axes.legend(**legend_above(len(groups) + 1))

    names = ", ".join(label for label, _ in groups)
    return _panel(draw, x, y, title, f"{y} against {x} of {names}.", height=4.2)


def bars(
    labels: Sequence[str],
    series: Sequence[Series],
    x: str,
    *,
    percent: bool = False,
    title: str = "",
) -> Panel:
    """Horizontal bars, a group a label; the x of a series is not used."""

    def draw(axes: Axes) -> None:
        import numpy as np

        places = np.arange(len(labels), dtype=float)
        thickness = 0.8 / len(series)
        scale = 100.0 if percent else 1.0
        for number, one in enumerate(series):
            y = np.array(one.y) * scale
            at = places + (number - (len(series) - 1) / 2) * thickness
            axes.barh(at, y, thickness * 0.9, label=one.label, color=COLOURS[number % len(COLOURS)])
            if one.low:
                low, high = (np.nan_to_num(np.abs(np.array(end) * scale - y)) for end in (one.low, one.high))
                axes.errorbar(y, at, xerr=[low, high], fmt="none", ecolor=INK, elinewidth=0.9, capsize=2)
        axes.set_yticks(places, labels)
        axes.invert_yaxis()
        axes.axvline(0, color=INK, linewidth=0.7)
        axes.grid(visible=False, axis="y")
        if len(series) > 1:
            axes.legend(**legend_above(len(series)))

    said = "; ".join(
        f"{label}: " + ", ".join(f"{one.label} {one.y[n]:.3g}" for one in series)
        for n, label in enumerate(labels)
    )
    height = 1.1 + 0.2 * len(labels) * max(1.6, len(series))
    return _panel(draw, x + (" (%)" if percent else ""), "", title, f"{title or x}. {said}.", height=height)


def _panel(draw: Any, x: str, y: str, title: str, alt: str, height: float = 3.4) -> Panel:
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    style = {
        "svg.fonttype": "none",
        "svg.hashsalt": "stereopsis",
        "font.family": "sans-serif",
        "font.size": 9,
        "axes.grid": True,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "grid.alpha": 0.25,
        "grid.linewidth": 0.6,
        "lines.linewidth": 1.6,
        **dict.fromkeys(
            ("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color", "grid.color"),
            INK,
        ),
    }
    with rc_context(style):  # type: ignore[arg-type]
        figure = Figure(figsize=(4.8, height), layout="constrained")
        axes = figure.add_subplot()
        draw(axes)
        axes.set_xlabel(x)
        axes.set_ylabel(y)
        if title:
            figure.suptitle(title, fontsize=10, fontweight="bold")
        text = io.StringIO()
        no_metadata = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        figure.savefig(text, format="svg", transparent=True, metadata=no_metadata)
    return Panel(text.getvalue(), alt)


def inline(panel: Panel, prefix: str) -> str:
    """The SVG as part of an HTML page: ids of its own, no declarations, the page's text colour and font."""
    svg = panel.svg[panel.svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r"<!--.*?-->", "", svg, flags=re.DOTALL)
    svg = re.sub(r"<style.*?</style>", "", svg, flags=re.DOTALL)  # it would hold for the whole page
    svg = re.sub(r' xmlns(:\w+)?="[^"]*"', "", svg).replace("xlink:href", "href")
    svg = re.sub(r'\bid="', f'id="{prefix}-', svg)
    svg = re.sub(r"url\(#", f"url(#{prefix}-", svg).replace('href="#', f'href="#{prefix}-')
    svg = svg.replace(INK, "currentColor")
    svg = re.sub(r"(font(-family)?: [^;\"]*?)'?(DejaVu Sans|sans-serif)[^;\"]*", r"\1inherit", svg)
    alt = panel.alt.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    head = f'<svg role="img" aria-label="{alt}" '
    # Without a fixed size it takes the width of its place.
    return head + re.sub(r'\b(width|height)="[\d.]+pt" ?', "", svg.removeprefix("<svg "), count=2).rstrip()
