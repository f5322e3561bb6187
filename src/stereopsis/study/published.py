"""The report's protocol in plain NumPy and SciPy, with a switch for each of its quirks.

It is kept as it was, candidate by candidate and filter by filter, to repeat the printed numbers and to be
taken apart. To match images, use `stereopsis.match`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType, ModuleType
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from stereopsis._extras import MissingExtraError
from stereopsis.study.quirks import CORRELATIONS, PUBLISHED, SMOOTHED, Quirks
from stereopsis.types import DisparityMap, Pair

__all__ = [
    "COLUMNS",
    "FIGURES",
    "METHODS",
    "PUBLISHED",
    "TABLES",
    "WINDOWS",
    "Quirks",
    "as_tables",
    "average",
    "disparity",
    "grey",
    "measures",
    "score",
    "smoothing_gain",
    "sweep",
    "tables",
]

Array = npt.NDArray[np.float64]
Bytes = npt.NDArray[np.uint8]
Smoother = Callable[[npt.NDArray[Any]], Array]

METHODS = (
    "ssd",
    "ssd_smoothed",
    "zssd",
    "zssd_smoothed",
    "ncc",
    "zncc",
    "zncc_smoothed",
    "zncc_gaussian",
)
BOUNDS = (0.25, 0.5, 1, 2, 4)
COLUMNS = (*(f"within_{bound}" for bound in BOUNDS), "rmse")
"""The measures, in the order of the report's tables as they are kept."""

WINDOWS = tuple(range(5, 95, 10))
"""The nine sizes of the report's figures."""

TABLES: Mapping[str, tuple[str, int]] = MappingProxyType(
    {"I_smoothed_zncc_30": ("zncc_smoothed", 30), "II_zncc_gaussian_15": ("zncc_gaussian", 15)}
)
"""Method and window of each of the report's tables."""

FIGURES: Mapping[int, tuple[str, ...]] = MappingProxyType(
    {
        3: ("ssd",),
        4: ("zssd",),
        5: ("zncc",),
        7: ("zncc", "zncc_smoothed", "zncc_gaussian"),
        8: ("zncc", "zncc_smoothed"),
    }
)
"""The methods that each of the report's figures sweeps over the windows."""

RANGE = (0, 128)
SMOOTHNESS = 0.5
FLAT = 1e-6
"""A variance in grey levels squared: no window of whole grey levels has a smaller one but 0."""


class Sample(Protocol):
    """A pair with its truth, as `stereopsis.datasets` and the study's own folders give it."""

    @property
    def name(self) -> str:
        """What tables call it."""

    def pair(self) -> Pair:
        """Read both views."""

    def truth(self) -> DisparityMap | None:
        """Read the left view's true disparity, NaN or 0 where unknown."""


def disparity(
    left: Bytes,
    right: Bytes,
    method: str,
    window: int,
    quirks: Quirks,
    *,
    truth: npt.NDArray[Any] | None = None,
    disparities: tuple[int, int] = RANGE,
    subpixel: bool = False,
) -> Array:
    """Match a pair as the report did, quirk by quirk.

    Parameters
    ----------
    left, right : ndarray of uint8, (H, W, 3) or (H, W)
        A rectified pair, RGB or grey.
    method : str
        One of `METHODS`.
    window : int
        Side of the window in pixels. An even one reaches one pixel further to the left and up. What it says
        of a Gaussian is a matter of ``quirks.sigma_is_window``.
    quirks : Quirks
        The departures to make; `PUBLISHED` for those of the report.
    truth : ndarray, (H, W), optional
        The left view's true disparity. It sets the range where ``quirks.truth_range`` asks for that, and is
        not looked at otherwise.
    disparities : (int, int), default (0, 128)
        The candidates, the maximum excluded, where the truth does not set them.
    subpixel : bool, default False
        Refine as ``quirks.slope_subpixel`` says; the report's figures and tables do not. The slope is known
        for single-pass correlations only.

    Returns
    -------
    ndarray of float64, (H, W)
        Disparities in pixels; NaN where no candidate lies inside the image. Of equal costs the smallest
        disparity wins.

    Raises
    ------
    ValueError
        For an unknown method, images of unsuitable or different shape, a window below 1, an empty range, no
        truth where it is to set the range, or a slope where there is none.
    TypeError
        For images that are not uint8.
    ImportError
        Without SciPy, which the extra ``study`` brings.

    Notes
    -----
    With :math:`m` the mean over the window, SSD is :math:`m((l - r)^2)`, ZSSD the same of
    :math:`l - m(l) - r + m(r)`, NCC :math:`m(lr) / \\sqrt{m(l^2)\\,m(r^2)}`, ZNCC the same of
    :math:`l - m(l)` and :math:`r - m(r)`. The smoothed ones go over all candidates again and minimise
    :math:`m(\\text{data} + \\tfrac12 (D - d)^2)`, with :math:`D` the first map and the data that of SSD or
    ZSSD. Smoothed ZNCC takes ZSSD's too, or, with ``quirks.zssd_data`` off, twice
    :math:`1 - \\text{ZNCC}`, in units of the image's mean variance over a window: what ZSSD would be if both
    windows had that variance.
    """
    _check(left, right, method, window)
    first, stop = _range(truth) if quirks.truth_range else disparities
    if stop <= first:
        raise ValueError(f"disparities must hold at least one candidate, not {(first, stop)}")
    candidates = range(first, stop)
    greys = grey(left, swapped=quirks.swapped_grey), grey(right, swapped=quirks.swapped_grey)
    view = _View(*greys[::-1], 1, quirks) if quirks.right_frame else _View(*greys, -1, quirks)
    mean = _smoother(method, window, quirks)

    with np.errstate(divide="ignore", invalid="ignore"):
        if subpixel and quirks.slope_subpixel:
            if method not in CORRELATIONS or method in SMOOTHED:
                raise ValueError(f"the slope of the score needs a single-pass correlation, not {method!r}")
            scores = _correlations(view, mean, candidates, centred=False)
            return _winners(_slopes(scores), candidates[1:-1], view)
        costs = _costs(method.partition("_")[0], view, mean, candidates)
        if method in SMOOTHED:
            first_pass = _winners(costs, candidates, view)
            costs = _second_costs(method, view, mean, candidates, first_pass)
        return _winners(costs, candidates, view, fit=subpixel)


def _check(left: Bytes, right: Bytes, method: str, window: int) -> None:
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, not {method!r}")
    for name, image in (("left", left), ("right", right)):
        if image.dtype != np.uint8:
            raise TypeError(f"{name} must be uint8, not {image.dtype}")
        if not (image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)) or image.size == 0:
            raise ValueError(f"{name} must be (H, W, 3) or (H, W), not of shape {image.shape}")
    if left.shape != right.shape:
        raise ValueError(f"left and right must have the same shape, not {left.shape} and {right.shape}")
    if window < 1:
        raise ValueError(f"window must be 1 pixel or more, not {window}")


def _range(truth: npt.NDArray[Any] | None) -> tuple[int, int]:
    """0 to the whole part of the largest truth, plus one, that one included."""
    if truth is None or not np.any(truth > 0):
        raise ValueError("truth must hold a positive disparity where it sets the range")
    return 0, math.floor(np.nanmax(np.where(np.isfinite(truth), truth, np.nan))) + 2


def grey(image: Bytes, *, swapped: bool) -> Bytes:
    """Weigh the channels of an RGB image in 15-bit fixed point, by 0.299, 0.587 and 0.114.

    Parameters
    ----------
    image : ndarray of uint8, (H, W, 3) or (H, W)
        Grey stays as it is.
    swapped : bool
        Weigh blue by 0.299 and red by 0.114.

    Returns
    -------
    ndarray of uint8, (H, W)
    """
    if image.ndim == 2:
        return image
    weights = (3735, 19235, 9798) if swapped else (9798, 19235, 3735)
    return ((image @ np.array(weights, np.int32) + (1 << 14)) >> 15).astype(np.uint8)


@dataclass(frozen=True)
class _View:
    """The image whose pixels are answered, the one that moves, and which way a disparity moves it."""

    still: Bytes
    moving: Bytes
    direction: int
    quirks: Quirks

    def moved(self, image: npt.NDArray[Any], d: int) -> npt.NDArray[Any]:
        """Each pixel's match, `d` further on; past an edge, the edge pixel."""
        step = self.direction * d
        if self.quirks.wraps:
            return np.roll(image, -step, axis=1)
        last = image.shape[1] - 1
        return image[:, np.clip(np.arange(last + 1) + step, 0, last)]

    def hidden(self, d: int) -> npt.NDArray[np.bool_]:
        """The columns, (W,), whose match lies outside the image."""
        there = np.arange(self.still.shape[1]) + self.direction * d
        return ((there < 0) | (there >= there.size)) & (not self.quirks.wraps)


def _smoother(method: str, window: int, quirks: Quirks) -> Smoother:
    """The mean over a window, or under a Gaussian."""
    ndimage = _ndimage()
    if method == "zncc_gaussian":
        sigma = window if quirks.sigma_is_window else math.sqrt((window**2 - 1) / 12)
        return functools.partial(ndimage.gaussian_filter, sigma=sigma, output=np.float64)
    return functools.partial(ndimage.uniform_filter, size=window, output=np.float64)


def _ndimage() -> ModuleType:
    try:
        from scipy import ndimage
    except ImportError as error:
        raise MissingExtraError(
            "the report's protocol needs SciPy: pip install 'stereopsis[study]'"
        ) from error
    module: ModuleType = ndimage
    return module


def _costs(kind: str, view: _View, mean: Smoother, candidates: range) -> Iterator[Array]:
    match kind:
        case "ssd":
            return _differences(view, mean, candidates)
        case "zssd":
            return _centred_differences(view, mean, candidates)
        case "ncc":
            return _correlations(view, mean, candidates, centred=False)
        case _:
            return _correlations(view, mean, candidates, centred=True)


def _second_costs(
    method: str, view: _View, mean: Smoother, candidates: range, first: Array
) -> Iterator[Array]:
    """The energy of the second pass, given the map of the first."""

    def smoothness(d: int) -> Array:
        return np.asarray(SMOOTHNESS * np.square(first - d))

    if method == "ssd_smoothed":
        return _differences(view, mean, candidates, smoothness)
    if method == "zssd_smoothed" or view.quirks.zssd_data:
        return _centred_differences(view, mean, candidates, smoothness)
    still = view.still.astype(np.float64)
    variance = np.mean(mean(still * still) - np.square(mean(still)))
    return (
        2 * variance * (1 + cost) + mean(smoothness(d))
        for d, cost in zip(candidates, _correlations(view, mean, candidates, centred=True), strict=True)
    )


def _nothing(d: int) -> Array:
    return np.zeros(())


def _differences(
    view: _View, mean: Smoother, candidates: range, smoothness: Callable[[int], Array] = _nothing
) -> Iterator[Array]:
    """SSD: the mean of the squared difference, plus what the second pass adds."""
    kind = np.uint8 if view.quirks.uint8_squares else np.float64
    still, moving = view.still.astype(kind), view.moving.astype(kind)
    for d in candidates:
        yield mean(np.square(still - view.moved(moving, d)) + smoothness(d))


def _centred_differences(
    view: _View, mean: Smoother, candidates: range, smoothness: Callable[[int], Array] = _nothing
) -> Iterator[Array]:
    """ZSSD: that of the difference less its mean."""
    quirks = view.quirks
    still, moving = view.still.astype(np.float64), view.moving.astype(np.float64)
    still_mean, moving_mean = mean(still), mean(moving)
    for d in candidates:
        other = view.moved(moving, d)
        other_mean = moving_mean if quirks.stale_mean else view.moved(moving_mean, d)
        if quirks.high_pass:
            yield mean(np.square(still - still_mean - other + other_mean) + smoothness(d))
        else:
            # m((e - c)^2) with one c for the whole window; c is m(e) unless it was left behind.
            difference, removed = still - other, still_mean - other_mean
            left_over = 2 * mean(difference) - removed
            yield mean(np.square(difference) + smoothness(d)) - removed * left_over


def _correlations(view: _View, mean: Smoother, candidates: range, *, centred: bool) -> Iterator[Array]:
    """NCC, or ZNCC where `centred`; negated, as a cost."""
    still, moving = view.still.astype(np.float64), view.moving.astype(np.float64)
    own_mean = centred and not view.quirks.high_pass
    if centred and view.quirks.high_pass:
        still, moving = still - mean(still), moving - mean(moving)
    still_mean = mean(still) if own_mean else np.zeros(())
    still_power = mean(still * still) - np.square(still_mean)
    for d in candidates:
        other = view.moved(moving, d)
        other_mean = mean(other) if own_mean else np.zeros(())
        other_power = mean(other * other) - np.square(other_mean)
        common = mean(other * still) - still_mean * other_mean
        cost = -common / np.sqrt(other_power * still_power)
        if not view.quirks.undefined_wins:
            cost = np.where(np.minimum(other_power, still_power) > FLAT, cost, 0.0)
        yield cost


def _slopes(costs: Iterator[Array]) -> Iterator[Array]:
    """The negated quotient of slope and curvature, for all candidates but the first and the last."""
    before, here = next(costs), next(costs)
    for after in costs:
        yield (after - before) / (before + after - 2 * here)
        before, here = here, after


def _winners(costs: Iterable[Array], candidates: range, view: _View, *, fit: bool = False) -> Array:
    """The first of the least costs; like NumPy's argmin, the first NaN before any number."""
    winner = np.full(view.still.shape, np.nan)
    best = np.full(view.still.shape, np.inf)
    previous, before, after = best.copy(), best.copy(), best.copy()
    for d, cost in zip(candidates, costs, strict=True):
        cost[:, view.hidden(d)] = np.inf
        if fit:
            after = np.where(winner == d - 1, cost, after)
        better = (cost < best) | (np.isnan(cost) & ~np.isnan(best))
        winner[better], best[better] = d, cost[better]
        if fit:
            before, after = np.where(better, previous, before), np.where(better, np.inf, after)
            previous = cost
    if fit:
        with np.errstate(divide="ignore", invalid="ignore"):
            offset = (before - after) / (2 * (before - 2 * best + after))
        winner += np.where(np.isfinite(offset), offset, 0.0)
    return winner


def measures(disparity: npt.NDArray[Any], truth: npt.NDArray[Any]) -> dict[str, float]:
    """Score a map over the pixels whose truth is above 0.

    Parameters
    ----------
    disparity : ndarray, (H, W)
        In pixels; NaN counts as an infinite error.
    truth : ndarray, (H, W)
        In pixels; NaN or 0 where unknown.

    Returns
    -------
    dict of str to float
        Under the names of `COLUMNS`: the fractions with an error strictly below so many pixels, and the root
        of the mean squared error in pixels. NaN where no truth is known.
    """
    known = truth > 0
    if not known.any():
        return dict.fromkeys(COLUMNS, math.nan)
    errors = np.abs(disparity[known].astype(np.float64) - truth[known])
    errors[np.isnan(errors)] = np.inf
    within = [float(np.mean(errors < bound)) for bound in BOUNDS]
    return dict(zip(COLUMNS, (*within, float(np.sqrt(np.mean(errors**2)))), strict=True))


def score(sample: Sample, method: str, window: int, quirks: Quirks) -> dict[str, float]:
    """Read, match and measure one pair: `disparity` and `measures` in one.

    Raises
    ------
    ValueError
        As `disparity`; also where the pair has no truth.
    """
    pair, truth = sample.pair(), sample.truth()
    if truth is None:
        raise ValueError(f"{sample.name} has no truth to score against")
    return measures(disparity(pair.left, pair.right, method, window, quirks, truth=truth), truth)


def sweep(
    sample: Sample,
    methods: Sequence[str] = METHODS,
    windows: Sequence[int] = WINDOWS,
    quirks: Quirks = PUBLISHED,
    progress: Callable[[str, int], None] | None = None,
) -> dict[str, dict[int, dict[str, float]]]:
    """Measure one pair by window size: what Figures 3, 4, 5, 7 and 8 draw.

    Parameters
    ----------
    sample : Sample
        The report's figures are of the first pair.
    methods : sequence of str
        Of `METHODS`; `FIGURES` says which figure draws which.
    windows : sequence of int
    quirks : Quirks
    progress : callable, optional
        Told method and window as each is done.

    Returns
    -------
    dict
        ``[method][window]``, each as from `measures`.
    """
    found: dict[str, dict[int, dict[str, float]]] = {}
    for method in methods:
        for window in windows:
            found.setdefault(method, {})[window] = score(sample, method, window, quirks)
            if progress:
                progress(method, window)
    return found


def smoothing_gain(by_window: Mapping[str, Mapping[int, Mapping[str, float]]]) -> float:
    """How much higher the RMSE of ZNCC is than that of smoothed ZNCC: the report's 9 %.

    Parameters
    ----------
    by_window : mapping
        From `sweep`, with ``zncc`` and ``zncc_smoothed`` over the same windows.

    Returns
    -------
    float
        The mean over the windows of ``(plain - smoothed) / smoothed``.
    """
    plain, smoothed = by_window["zncc"], by_window["zncc_smoothed"]
    return float(np.mean([plain[w]["rmse"] / smoothed[w]["rmse"] - 1 for w in plain]))


def average(rows: Sequence[Mapping[str, float]], quirks: Quirks) -> dict[str, float]:
    """Average the pairs' measures for a table.

    Parameters
    ----------
    rows : sequence of mapping
        One a pair, in the order of their names, each as from `measures`.
    quirks : Quirks
        With ``last_pair_dropped``, the sum leaves out the last pair and is divided by the number of all.

    Returns
    -------
    dict of str to float
        Under the names of `COLUMNS`.
    """
    counted = rows[:-1] if quirks.last_pair_dropped else rows
    return {column: math.fsum(row[column] for row in counted) / len(rows) for column in COLUMNS}


def tables(
    samples: Sequence[Sample],
    quirks: Quirks = PUBLISHED,
    progress: Callable[[str, str], None] | None = None,
) -> dict[str, Any]:
    """Compute Tables I and II.

    Parameters
    ----------
    samples : sequence of Sample
        In the order of their names.
    quirks : Quirks
    progress : callable, optional
        Told the table and the pair as each is done.

    Returns
    -------
    dict
        ``columns``: `COLUMNS`; under each name of `TABLES`, a list of the numbers as the protocol averages
        them, in the order of the columns; ``true_mean``: the same with the true means over all pairs.
    """
    rows: dict[str, list[dict[str, float]]] = {table: [] for table in TABLES}
    for sample in samples:
        for table, (method, window) in TABLES.items():
            rows[table].append(score(sample, method, window, quirks))
            if progress:
                progress(table, sample.name)
    return as_tables(rows, quirks)


def as_tables(rows: Mapping[str, Sequence[Mapping[str, float]]], quirks: Quirks) -> dict[str, Any]:
    """Lay out what `tables` returns from the measures of each pair, by table."""

    def laid_out(chosen: Quirks) -> dict[str, list[float]]:
        return {table: [*average(pairs, chosen).values()] for table, pairs in rows.items()}

    return {"columns": [*COLUMNS], **laid_out(quirks), "true_mean": laid_out(Quirks())}
