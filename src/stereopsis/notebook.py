"""Results and scores as notebooks show them: HTML that holds everything it needs, light or dark."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Final

import numpy as np

from stereopsis import colormaps
from stereopsis.io.disparity import check_disparity
from stereopsis.io.formats import png
from stereopsis.settings import Settings
from stereopsis.types import DisparityMap, Flag, Result

if TYPE_CHECKING:
    from stereopsis.evaluate import Scores

MOST_BYTES: Final = 150_000
"""The picture is thinned out until it has no more."""

LONGEST: Final = 1000
"""And until it has no more rows and columns."""

_WIDE, _HIGH = 880, 440  # what a picture is enlarged to, in pixels of the page
_BAR = 520, 12, 48  # the bar's length, thickness and margins, in units of the drawing
_STEPS = 64  # rectangles of the bar

# The text takes the notebook's colour, and lines a part of it: right on white and on black.
_LINE = "border:0;border-top:1px solid rgba(128,128,128,.35)"
_CELL = f"padding:.15em .8em;text-align:left;vertical-align:top;background:none;{_LINE}"
_NUMBER = f"padding:.15em .8em;text-align:right;white-space:nowrap;background:none;{_LINE}"
_TABLE = "border-collapse:collapse;border:0;margin:.4em 0;font-variant-numeric:tabular-nums"


def result(result: Result) -> str:
    """Show a result: its map with a colour bar, how dense it is, what it took, and why pixels are invalid.

    Parameters
    ----------
    result : Result

    Returns
    -------
    str
        HTML of less than 300 kB, without scripts, ids or anything from elsewhere.
    """
    height, width = result.disparity.shape
    facts = {
        "size": f"{width} x {height} px",
        "density": f"{100 * result.density:.2f} %",
        "time": _time(result),
        "path": result.path,
        "settings": _settings(result.settings),
        "flags": _flags(result),
    }
    picture = _picture(result.disparity) if result.disparity.size else ""
    rows = ((name, value) for name, value in facts.items() if value)
    return f'<div class="stereopsis">{picture}{_table(rows)}</div>'


def scores(scores: Scores) -> str:
    """Show scores as a table: own density, all known pixels, and filled.

    Parameters
    ----------
    scores : Scores

    Returns
    -------
    str
        HTML, without scripts, ids or anything from elsewhere.
    """
    density = "-" if math.isnan(scores.density) else f"{100 * scores.density:.2f} %"
    head = f"density {density} ({scores.answered} of {scores.known} known pixels)"
    rows = _table(scores.rows(), ("", "own", "all", "filled"))
    return f'<div class="stereopsis"><div>{escape(head)}</div>{rows}</div>'


def _table(rows: Iterable[Sequence[str]], head: Sequence[str] = ()) -> str:
    style = _NUMBER if head else _CELL
    top = "".join(f'<th scope="col" style="{_NUMBER}">{escape(name)}</th>' for name in head)
    body = (
        f'<tr style="background:none"><th scope="row" style="{_CELL}">{escape(name)}</th>'
        + "".join(f'<td style="{style}">{escape(cell)}</td>' for cell in cells)
        + "</tr>"
        for name, *cells in rows
    )
    top = f'<thead><tr style="background:none">{top}</tr></thead>' if head else ""
    return f'<table style="{_TABLE}">{top}<tbody>{"".join(body)}</tbody></table>'


def _picture(disparity: DisparityMap) -> str:
    """The map as `io.colorize` colours it, over a bar with numbers."""
    values = check_disparity(disparity)
    step = max(1, -(-max(values.shape) // LONGEST))
    limits = colormaps.limits(values[::step, ::step])
    while True:
        shown = values[::step, ::step]
        data = png.encode(colormaps.colours(shown, limits))
        if len(data) <= MOST_BYTES:
            break
        step += 1
    rows, columns = shown.shape
    scale = min(_WIDE / columns, _HIGH / rows)
    size = f'width="{max(1, round(columns * scale))}" height="{max(1, round(rows * scale))}"'
    says = "disparity of every pixel" if step == 1 else f"disparity of every {step}th row and column"
    uri = f"data:image/png;base64,{base64.b64encode(data).decode()}"
    sharp = "image-rendering:pixelated;" if scale >= 4 else ""
    image = f'<img src="{uri}" alt="{says}" {size} style="{sharp}max-width:100%;height:auto;display:block">'
    return image + _bar(*limits)


def _bar(low: float, high: float) -> str:
    """The colour bar as SVG: rectangles, not a gradient, which would need an id."""
    length, thick, margin = _BAR
    wide = length / _STEPS
    table = colormaps.VIRIDIS[np.linspace(0, 255, _STEPS).round().astype(int)]
    parts = [
        f'<rect x="{margin + number * wide:g}" y="2" width="{wide:g}" height="{thick}" '
        f'fill="{colormaps.hex_code(tuple(colour))}"/>'
        for number, colour in enumerate(table.tolist())
    ]
    for value, text in colormaps.ticks(low, high):
        x = f"{margin + (value - low) / (high - low) * length:.1f}"
        parts.append(f'<path d="M{x} {thick + 2}v4" stroke="currentColor"/>')
        parts.append(f'<text x="{x}" y="{thick + 20}" text-anchor="middle">{text}</text>')
    parts.append(f'<text x="{margin + length + 8}" y="{thick}">px</text>')
    wide_all, high_all = length + 2 * margin, thick + 26
    return (
        f'<svg role="img" aria-label="colour bar from {low:g} to {high:g} px" '
        f'viewBox="0 0 {wide_all} {high_all}" width="{wide_all}" height="{high_all}" fill="currentColor" '
        'font-family="sans-serif" font-size="12" shape-rendering="crispEdges" '
        f'style="max-width:100%;height:auto;display:block">{"".join(parts)}</svg>'
    )


def _time(result: Result) -> str:
    stages = ", ".join(f"{name} {1000 * seconds:.1f} ms" for name, seconds in result.timings.items())
    return f"{result.seconds:.3f} s" + (f" ({stages})" if stages else "")


def _settings(settings: Settings) -> str:
    """What differs from plain settings, as TOML has it; the preset comes first."""
    plain = set(Settings().to_toml().splitlines())
    lines = [line for line in settings.to_toml().splitlines() if line not in plain]
    return ", ".join(sorted(lines, key=lambda line: not line.startswith("preset ")))


def _flags(result: Result) -> str:
    counts = {flag: int(np.count_nonzero(result.flags & np.uint8(flag))) for flag in Flag}
    size = max(result.flags.size, 1)
    return ", ".join(
        f"{flag.words} {count} ({100 * count / size:.1f} %)" for flag, count in counts.items() if count
    )
