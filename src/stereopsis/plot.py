"""Maps, errors and curves on matplotlib's axes.

Every function draws on the axes that it is given, or on those of a new figure, and returns them: labels,
limits and size are the caller's to change. Nothing is shown, and no setting of matplotlib's is touched. It
needs the extra ``plot``; matplotlib is imported when the first function is called.
"""

from __future__ import annotations

import numbers
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from stereopsis import _extras, colormaps, refine
from stereopsis._numbers import is_number
from stereopsis.evaluate import FloatMap, Mask, known_pixels
from stereopsis.io.disparity import check_disparity
from stereopsis.reliability import Reliability
from stereopsis.sparsification import Sparsification
from stereopsis.types import DisparityMap, Flag, Result, worst_cost

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap

COLOURS: Final = tuple(colormaps.hex_code(colour) for colour in colormaps.LINES)
MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X")
STYLES: Final = ("-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1, 1, 1)), (0, (1, 1)))

_DISPARITY = "disparity (px)"


@dataclass(frozen=True)
class Series:
    """A line, with the interval of each point where there is one."""

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()


def disparity(
    estimate: Result | DisparityMap, ax: Axes | None = None, *, range: tuple[float, float] | None = None
) -> Axes:
    """Draw a disparity map in viridis, with a colour bar in pixels.

    Parameters
    ----------
    estimate : Result, or ndarray of floats (H, W)
        In pixels; NaN, where invalid, is light grey.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure.
    range : (float, float), optional
        The disparities of the first and the last colour; by default the 1st and the 99th percentile.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ModuleNotFoundError
        Without matplotlib, which the extra ``plot`` brings.
    TypeError, ValueError
        `estimate` is no map of floats, or `range` not two finite numbers in order.
    """
    values = _map(estimate)
    return _picture(values, colormaps.VIRIDIS, colormaps.limits(values, range), _DISPARITY, _axes(ax))


def confidence(result: Result, ax: Axes | None = None) -> Axes:
    """Draw a result's confidence in cividis, with a colour bar; light grey where there is no answer.

    Parameters
    ----------
    result : Result
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ModuleNotFoundError
        Without matplotlib.
    """
    _check("result", result, Result)
    answered = np.isfinite(result.disparity)
    values = np.where(answered, result.confidence, np.float32(np.nan))
    return _picture(values, colormaps.CIVIDIS, (0.0, 1.0), "confidence", _axes(ax))


def flags(result: Result, ax: Axes | None = None) -> Axes:
    """Draw why pixels are invalid, or how they were answered; the legend gives the share of each flag.

    Of several flags at a pixel, the one of the lowest bit shows; light grey has none.

    Parameters
    ----------
    result : Result
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ModuleNotFoundError
        Without matplotlib.
    """
    _check("result", result, Result)
    axes = _axes(ax)
    from matplotlib.patches import Patch

    axes.imshow(colormaps.flag_colours(result.flags), interpolation="nearest")
    _pixels(axes)
    handles = []
    for flag, colour in colormaps.FLAG_COLOURS.items():
        share = float(np.mean((result.flags & np.uint8(flag)) != 0)) if result.flags.size else 0.0
        if share:
            handles.append(Patch(color=colormaps.hex_code(colour), label=f"{flag.words} {100 * share:.1f} %"))
    if handles:
        axes.legend(handles=handles, **legend_above(len(handles)))
    return axes


def error(
    estimate: Result | DisparityMap,
    truth: FloatMap,
    ax: Axes | None = None,
    *,
    mask: Mask | None = None,
    limit: float | None = None,
) -> Axes:
    """Draw signed errors, ``estimate - truth``: blue is too far, brown too near, white right.

    Parameters
    ----------
    estimate : Result, or ndarray of floats (H, W)
        In pixels; NaN where invalid: light grey, where the truth is known.
    truth : ndarray of float32 or float64, (H, W)
        In pixels; NaN where unknown: left blank.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure.
    mask : ndarray of bool, (H, W), optional
        Draw as unknown the pixels where it is False.
    limit : float, optional
        The error of the last colour to either side, in pixels; by default the 99th percentile of the
        magnitudes.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ModuleNotFoundError
        Without matplotlib.
    TypeError, ValueError
        As for `stereopsis.evaluate`; or `limit` is not positive.
    """
    values = _map(estimate)
    known = known_pixels(values, truth, mask, name="estimate")
    errors = np.where(known, values - np.where(known, truth, 0), np.nan)
    if limit is None:
        found = np.abs(errors[np.isfinite(errors)])
        limit = float(np.percentile(found, 99)) if found.size else 0.0
        limit = limit if limit > 1e-6 else 1.0
    if not (is_number(limit) and limit > 0):
        raise ValueError(f"limit must be a positive number of pixels, not {limit!r}")
    axes = _axes(ax)
    missing = np.zeros((*errors.shape, 4), np.uint8)
    missing[known & np.isnan(values)] = (*colormaps.INVALID, 255)
    axes.imshow(missing, interpolation="nearest")
    return _picture(errors, colormaps.DIVERGING, (-limit, limit), "error (px)", axes, bad="none")


def cost_curve(result: Result, x: int, y: int, ax: Axes | None = None, *, truth: float | None = None) -> Axes:
    """Draw a pixel's costs over the candidates, with the winner, the sub-pixel fit and the answer.

    Parameters
    ----------
    result : Result
        Matched with ``keep=("costs",)``.
    x, y : int
        Column and row of the pixel in the left image. With a `step`, the nearest pixel that was matched.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure.
    truth : float, optional
        The true disparity in pixels, drawn as a line where it is finite.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ModuleNotFoundError
        Without matplotlib.
    TypeError
        `x` or `y` is not a whole number.
    ValueError
        The result holds no costs, or the pixel lies outside.
    """
    candidates, costs = _costs(result, x, y)
    if truth is not None and not isinstance(truth, numbers.Real):
        raise TypeError(f"truth must be a number or None, not {truth!r}")
    axes = _axes(ax)
    possible = costs < np.inf
    axes.plot(
        candidates, np.where(possible, costs, np.nan), color=COLOURS[0], marker=".", label="cost", zorder=2
    )
    kind = result.settings.subpixel
    if possible.any():
        best = int(np.argmin(costs))
        axes.plot(
            candidates[best],
            costs[best],
            color=COLOURS[1],
            marker="o",
            linestyle="none",
            label=f"winner {candidates[best]}",
            zorder=4,
        )
        fit = refine.fitted(kind, costs, best)
        if fit is not None:
            _, places, values = fit
            fine = candidates[best] + result.settings.disparity_step * places
            axes.plot(fine, values, color=COLOURS[1], linewidth=1.2, label=str(kind), zorder=3)
    answer = float(result.disparity[y, x])
    if np.isfinite(answer):
        axes.axvline(answer, color=COLOURS[2], linestyle="--", linewidth=1.2, label=f"answer {answer:.2f}")
    if truth is not None and np.isfinite(truth):
        axes.axvline(truth, color=COLOURS[-1], linestyle=":", linewidth=1.6, label=f"truth {truth:.2f}")
    axes.set_xlabel(_DISPARITY)
    axes.set_ylabel(f"cost ({type(result.settings.cost).__name__})")
    because = ", ".join(flag.words for flag in Flag if result.flags[y, x] & flag)
    axes.set_title(f"x = {x}, y = {y}" + (f": {because}" if because else ""), fontsize="medium", loc="left")
    axes.legend(frameon=False, fontsize="small")
    return axes


def sparsification(
    curves: Sparsification | Mapping[str, Sparsification], ax: Axes | None = None, *, measure: str = "bad-1"
) -> Axes:
    """Draw error against density as the least trusted pixels are removed; dotted, in the ideal order.

    Parameters
    ----------
    curves : Sparsification, or mapping of str to Sparsification
        One curve, or several by their labels.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure.
    measure : str
        What `stereopsis.sparsification` measured, for the axis: ``"bad-1"`` is a fraction, drawn in per cent;
        ``"epe"`` is in pixels.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ModuleNotFoundError
        Without matplotlib.
    """
    if isinstance(curves, Sparsification):
        curves = {"by confidence": curves}
    _check("curves", curves, Mapping)
    for curve in curves.values():
        _check("curves", curve, Sparsification)
    fractions = measure != "epe"
    axes = _axes(ax)
    series = []
    for number, (label, curve) in enumerate(curves.items()):
        kept = tuple((100 * curve.density).tolist())
        areas = f"area {_area(curve.auc, measure)}, ideal {_area(curve.ideal_auc, measure)}"
        series.append(Series(f"{label}: {areas}", kept, tuple(curve.error.tolist())))
        axes.plot(
            kept,
            (100 if fractions else 1) * curve.ideal,
            label="_" if number else "ideal order",
            color=COLOURS[number % len(COLOURS)],
            linewidth=0.9,
            linestyle=":",
        )
    lines(axes, series, percent=fractions)
    axes.set_xlabel("answers kept (%)")
    axes.set_ylabel(f"{measure} (%)" if fractions else "mean error (px)")
    return axes


def reliability(table: Reliability, ax: Axes | None = None) -> Axes:
    """Draw how many answers of like confidence are right, beside the diagonal of a calibrated one.

    Parameters
    ----------
    table : Reliability
        From `stereopsis.reliability`.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ModuleNotFoundError
        Without matplotlib.
    """
    _check("table", table, Reliability)
    axes = _axes(ax)
    axes.bar(
        table.edges[:-1],
        np.nan_to_num(table.share),
        np.diff(table.edges),
        align="edge",
        color=COLOURS[0],
        alpha=0.2,
        label="share of the answers",
    )
    axes.plot([0, 1], [0, 1], color=COLOURS[-1], linestyle=":", label="calibrated")
    some = np.isfinite(table.correct)
    label = f"right, error {table.error:.3f}"
    axes.plot(table.confidence[some], table.correct[some], color=COLOURS[1], marker="o", label=label)
    axes.set_xlim(0, 1)
    axes.set_ylim(0, 1)
    axes.set_xlabel("confidence")
    axes.set_ylabel("fraction")
    axes.legend(frameon=False, fontsize="small")
    return axes


def lines(
    axes: Axes,
    series: Sequence[Series],
    *,
    percent: bool = False,
    zero: bool = True,
    marks: Sequence[tuple[float, str]] = (),
) -> Axes:
    """Draw lines with bands, told apart by colour, marker and dashes, and a legend above.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    series : sequence of Series
    percent : bool
        Values are fractions, drawn in per cent.
    zero : bool
        The axis of the values begins at 0.
    marks : sequence of (float, str)
        Vertical lines with a label.

    Returns
    -------
    matplotlib.axes.Axes
    """
    from matplotlib import rcParams

    ink = rcParams["text.color"]
    scale = 100 if percent else 1
    for number, one in enumerate(series):
        colour = COLOURS[number % len(COLOURS)]
        axes.plot(
            one.x,
            [scale * value for value in one.y],
            label=one.label,
            color=colour,
            marker=MARKERS[number % len(MARKERS)],
            linestyle=STYLES[number % len(STYLES)],
            markersize=4,
            markevery=max(1, len(one.x) // 20),
        )
        if one.low:
            axes.fill_between(
                one.x,
                [scale * value for value in one.low],
                [scale * value for value in one.high],
                color=colour,
                alpha=0.16,
                linewidth=0,
            )
    if zero:
        axes.set_ylim(bottom=0)
    points = series[0].x if series else ()
    if 1 < len(points) <= 10 and all(float(place).is_integer() for place in points):
        axes.set_xticks(points)
    for at, label in marks:
        axes.axvline(at, color=ink, linewidth=0.7, linestyle=":")
        axes.annotate(
            label, (at, 1), (3, -3), xycoords=("data", "axes fraction"), textcoords="offset points",
            va="top", fontsize=8,
        )  # fmt: skip
    axes.legend(**legend_above(len(series)))
    return axes


def legend_above(entries: int) -> dict[str, Any]:
    """A legend above the axes, in as many columns as fit."""
    columns = 3 if entries > 4 else max(1, min(entries, 2))
    return {
        "loc": "lower center",
        "bbox_to_anchor": (0.5, 1.0),
        "ncols": columns,
        "frameon": False,
        "fontsize": 8,
        "handlelength": 2.6,
        "columnspacing": 1.2,
        "borderaxespad": 0.2,
    }


def _axes(ax: Axes | None) -> Axes:
    _extras.require("stereopsis.plot needs", "plot", "matplotlib")
    from matplotlib.axes import Axes

    if ax is None:
        from matplotlib import pyplot

        return pyplot.figure(layout="constrained").add_subplot()
    if not isinstance(ax, Axes):
        raise TypeError(f"ax must be matplotlib's Axes or None, not {type(ax).__name__}")
    return ax


def _check(name: str, value: object, kind: type) -> None:
    if not isinstance(value, kind):
        raise TypeError(f"{name} must be a {kind.__name__}, not {type(value).__name__}")


def _map(estimate: Result | DisparityMap) -> DisparityMap:
    return check_disparity(estimate.disparity if isinstance(estimate, Result) else estimate)


def _picture(
    values: npt.NDArray[Any],
    table: colormaps.Table,
    limits: tuple[float, float],
    label: str,
    axes: Axes,
    bad: str | None = None,
) -> Axes:
    """An image with its colour bar, whose ends are pointed where values lie beyond."""
    low, high = limits
    image = axes.imshow(values, _listed(table, bad), vmin=low, vmax=high, interpolation="nearest")
    _pixels(axes)
    figure = axes.get_figure(root=False)
    assert figure is not None
    beyond = bool((values < low).any()), bool((values > high).any())
    extend = {(True, True): "both", (True, False): "min", (False, True): "max"}.get(beyond, "neither")
    beside = axes.inset_axes((1.02, 0, 0.03, 1))  # as high as the picture, whatever its shape
    figure.colorbar(image, cax=beside, label=label, extend=extend)
    return axes


def _listed(table: colormaps.Table, bad: str | None) -> Colormap:
    from matplotlib.colors import ListedColormap

    invalid = colormaps.hex_code(colormaps.INVALID) if bad is None else bad
    return ListedColormap(table / 255).with_extremes(bad=invalid)


def _pixels(axes: Axes) -> None:
    axes.set_xlabel("x (px)")
    axes.set_ylabel("y (px)")


def _area(value: float, measure: str) -> str:
    return f"{value:.3f} px" if measure == "epe" else f"{100 * value:.2f} %"


def _costs(result: Result, x: int, y: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """The candidates of a pixel and their costs, infinite where a candidate is not possible."""
    _check("result", result, Result)
    if "costs" not in result.stages:
        raise ValueError('the result holds no costs: match with keep=("costs",)')
    height, width = result.disparity.shape
    for name, value, size in (("x", x, width), ("y", y, height)):
        if isinstance(value, bool) or not isinstance(value, int | np.integer):
            raise TypeError(f"{name} must be a whole number, not {value!r}")
        if not 0 <= value < size:
            raise ValueError(f"{name} must be from 0 to {size - 1}, not {value}")
    volume, step = result.stages["costs"], result.settings.step
    # As the pipeline answers the pixels between: by the nearest one that was matched, of two the first.
    row, column = (
        min((at + (step - 1) // 2) // step, n - 1) for at, n in zip((y, x), volume.shape, strict=False)
    )
    asked = result.settings.disparities
    assert asked is not None
    candidates = np.arange(asked.min, asked.max, result.settings.disparity_step)
    costs = volume[row, column]
    possible = costs < worst_cost(volume.dtype)
    return candidates, np.where(possible, costs.astype(np.float64), np.inf)
