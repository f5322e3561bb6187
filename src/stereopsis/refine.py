"""Refine: from whole candidates to disparities between them; confidence; median."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis import _core, _instructions
from stereopsis.types import Disparities, DisparityMap, Halo, worst_cost


def aligned_halo(window: tuple[int, int]) -> Halo:
    """What a sub-pixel fit from the images depends on, in both: its window, and cubics about it."""
    return Halo.box(window).then(Halo.around(4, 1))


def symmetric_halo(window: tuple[int, int]) -> Halo:
    """What `symmetric` depends on, in both images: its window about the mean of another."""
    return Halo.box(window).then(Halo.box(window)).then(Halo.around(3, 1))


def median_halo(size: int) -> Halo:
    """What `median` depends on."""
    return Halo.box((size, size))


PHOTOMETRIC_HALO = Halo.around(15, 8)
"""What `photometric` depends on, but for what the pixels therein meet in the right image."""


def planar_halo(window: tuple[int, int]) -> Halo:
    """What `planar` depends on."""
    return Halo.box(window).beside(Halo.around(window[0] // 2, window[1] // 2))


def _neighbours(
    cost: npt.NDArray[Any], before: npt.NDArray[Any], after: npt.NDArray[Any]
) -> tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[np.bool_]]:
    """The winner's and both neighbours' costs; and where there are two neighbours.

    Costs are 0 where nothing is in view; at an end of the range the one neighbour stands for the other.
    """
    none = worst_cost(cost.dtype)
    if cost.dtype.kind == "u":  # differences may be negative
        cost, before, after = (array.astype(np.int32) for array in (cost, before, after))
    cost = np.where(cost < none, cost, cost.dtype.type(0))
    has_before, has_after = before < none, after < none
    lone = np.where(has_after, after, cost)
    before = np.where(has_before, before, lone)
    after = np.where(has_after, after, before)
    return cost, before, after, has_before & has_after


def subpixel(
    kind: str | None, cost: npt.NDArray[Any], before: npt.NDArray[Any], after: npt.NDArray[Any]
) -> npt.NDArray[np.float32]:
    r"""Offset of the fit's extremum from the winner, in [-0.5, 0.5] pixels; 0 at an end of the range.

    With :math:`a, b` the rise from the winner's cost to the one before and the one after:

    - parabola :math:`(a - b) / (2 (a + b))`, the exact extremum of a quadratic cost;
    - equiangular :math:`(a - b) / (2 \max(a, b))`, that of two straight flanks of equal slope [1]_.

    References
    ----------
    .. [1] M. Shimizu, M. Okutomi, Sub-pixel estimation error cancellation on area-based matching,
       IJCV 63(3), 2005, doi:10.1007/s11263-005-6878-5.
    """
    if kind is None:
        return np.zeros(cost.shape, np.float32)
    cost, before, after, both = _neighbours(cost, before, after)
    rise_before = (before - cost).astype(np.float32)
    rise_after = (after - cost).astype(np.float32)
    reach = rise_before + rise_after if kind == "parabola" else np.maximum(rise_before, rise_after)
    half = np.float32(0.5)
    offset = half * (rise_before - rise_after) / np.where(reach > 0, reach, np.float32(1))
    return np.where(both, offset, np.float32(0))


def fitted(
    kind: str | None, costs: npt.NDArray[Any], winner: int
) -> tuple[float, npt.NDArray[np.float64], npt.NDArray[np.float64]] | None:
    """The curve that `subpixel` lays through one pixel's least cost and its neighbours', to be drawn.

    Parameters
    ----------
    kind : str or None
    costs : ndarray, (D,)
    winner : int
        The index of the least.

    Returns
    -------
    offset : float
        Of the curve's lowest point from the winner, in candidates.
    places, values : ndarray of float64
        Points of the curve, from the candidate before to the one after: offsets, and costs.

    None where another kind of fit is asked for, or the winner has but one neighbour.
    """
    around = costs[max(winner - 1, 0) : winner + 2]
    if kind not in ("parabola", "equiangular") or len(around) < 3 or winner < 1:
        return None
    if not np.all(around < worst_cost(costs.dtype)):
        return None
    offset = float(subpixel(kind, around[1:2], around[:1], around[2:])[0])
    before, least, after = around.astype(np.float64)
    if kind == "parabola":
        places = np.linspace(-1, 1, 81)
        return (
            offset,
            places,
            least + (after - before) / 2 * places + ((before + after) / 2 - least) * places**2,
        )
    places = np.array([-1, offset, 1])
    slope = max(before, after) - least
    return offset, places, least + slope * (np.abs(places - offset) - abs(offset))


def correlation(
    left: npt.NDArray[Any],
    right: npt.NDArray[Any],
    winner: DisparityMap,
    window: tuple[int, int],
    centred: bool = True,
    threads: int = 0,
) -> DisparityMap:
    r"""The disparity within a pixel of the winner whose window correlates best, in closed form [1]_.

    Between two neighbouring right windows the image is a straight line, :math:`R_t = (1 - t) R_0 + t R_1`
    with :math:`0 \le t \le 1`. With :math:`\langle\cdot, \cdot\rangle` the sum of products over the window
    (each window's mean removed, for ZNCC), :math:`a_i = \langle L, R_i \rangle` and
    :math:`g_{ij} = \langle R_i, R_j \rangle`, the correlation
    :math:`\langle L, R_t \rangle / \sqrt{\langle L, L \rangle \langle R_t, R_t \rangle}` is largest at

    .. math:: t = \frac{a_1 g_{00} - a_0 g_{01}}{a_0 (g_{11} - g_{01}) + a_1 (g_{00} - g_{01})} .

    Both neighbours are tried, and the better one taken. The sums are those of whole numbers, and exact.

    Parameters
    ----------
    left, right : ndarray of uint8 or int32, (H, W, C)
    winner : ndarray of float32, (H, W)
        Whole disparities; NaN stays NaN.
    window : (width, height)
    centred : bool
        Remove each window's mean, for ZNCC; not for NCC.
    threads : int

    Returns
    -------
    ndarray of float32, (H, W)

    References
    ----------
    .. [1] E. Psarakis, G. Evangelidis, An enhanced correlation-based method for stereo correspondence with
       sub-pixel accuracy, ICCV 2005, doi:10.1109/ICCV.2005.33.
    """
    return _aligned(0, left, right, winner, window, centred, threads)


def lucas_kanade(
    left: npt.NDArray[Any],
    right: npt.NDArray[Any],
    start: DisparityMap,
    window: tuple[int, int],
    threads: int = 0,
) -> DisparityMap:
    """Lucas and Kanade's refinement [1]_: the window shifts until it fits, blind to gain and offset.

    Gauss-Newton steps on ``sum (L - o - g R(x - d))**2`` in o, g and d, from `start`, with cubics (Catmull
    and Rom's) between the right image's columns. The left image's slope stands for the right one's at the
    match, times the gain (the inverse of the usual roles, as in [1]_): interpolation smooths noise away
    between columns, and the right one's slope would follow it there. A step of less than a thousandth of a
    pixel ends it. The start stays where 20 steps do not suffice or the correlation ends lower than it began.

    What a step needs follows from inner products of windows at whole shifts, which slide over the image: the
    time does not grow with the window.

    Parameters
    ----------
    left, right : ndarray of uint8 or int32, (H, W, C)
        A colour image's channels share one gain, and have an offset each.
    start : ndarray of float32, (H, W)
        The result lies within a pixel of the whole disparity nearest to it; NaN stays NaN.
    window : (width, height)
    threads : int

    Returns
    -------
    ndarray of float32, (H, W)

    References
    ----------
    .. [1] B. Lucas, T. Kanade, An iterative image registration technique with an application to stereo
       vision, IJCAI 1981; S. Baker, I. Matthews, Lucas-Kanade 20 years on, IJCV 56(3), 2004,
       doi:10.1023/B:VISI.0000011205.11775.fd.
    """
    return _aligned(1, left, right, start, window, True, threads)


def _aligned(
    method: int,
    left: npt.NDArray[Any],
    right: npt.NDArray[Any],
    start: DisparityMap,
    window: tuple[int, int],
    centred: bool,
    threads: int,
) -> DisparityMap:
    refined = np.empty(start.shape, np.float32)
    pair = _whole(left), _whole(right)
    narrow = left.dtype == np.uint8
    _core.align(*pair, *window, method, centred, narrow, np.ascontiguousarray(start), refined, threads)
    return refined


def lucas_kanade_affine(
    left: npt.NDArray[Any],
    right: npt.NDArray[Any],
    start: DisparityMap,
    window: tuple[int, int],
    threads: int = 0,
) -> tuple[DisparityMap, npt.NDArray[np.float32]]:
    """Lucas and Kanade's refinement of a window that may slant: ``d + a u + b v`` at its column u and row v.

    As `lucas_kanade`, with a and b beside d, from a = b = 0. The left image's slope stands for the right
    one's at the match, so what depends on it is summed but once a pixel (the inverse of the usual roles, as
    in [1]_). A step that moves no corner of the window by a hundredth of a pixel ends it, or 8 steps.

    Parameters
    ----------
    left, right : ndarray of uint8 or int32, (H, W, C)
    start : ndarray of float32, (H, W)
        The result lies within a pixel of it; NaN stays NaN.
    window : (width, height)
    threads : int

    Returns
    -------
    disparity : ndarray of float32, (H, W)
    slopes : ndarray of float32, (H, W, 2)
        a and b: pixels of disparity gained a column, within 0.33 of 0, and a row, within 1.

    References
    ----------
    .. [1] S. Baker, I. Matthews, Lucas-Kanade 20 years on, IJCV 56(3), 2004,
       doi:10.1023/B:VISI.0000011205.11775.fd.
    """
    refined, slopes = np.empty(start.shape, np.float32), np.empty((*start.shape, 2), np.float32)
    _core.align_planes(
        _whole(left), _whole(right), *window, np.ascontiguousarray(start), refined, slopes, threads
    )
    return refined, slopes


def symmetric(
    left: npt.NDArray[Any],
    right: npt.NDArray[Any],
    winner: DisparityMap,
    window: tuple[int, int],
    centred: bool = False,
    threads: int = 0,
    *,
    steps: int = 4,
) -> DisparityMap:
    r"""Symmetric matching of interpolated lines by their intervals, within a pixel of the winner [1]_.

    Both lines run straight from pixel to pixel and are sampled `steps` times a pixel. About each sample
    :math:`X` the left line spans an interval :math:`[l^-, l^+]`, from the least to the greatest of the sample
    and the values half a step before and after it; so does the right one. What lies in both can match, so two
    samples are as far apart as their intervals:

    .. math:: g(X, X') = \max(0,\; l^-(X) - r^+(X'),\; r^-(X') - l^+(X)) .

    The cost of a disparity, a whole number :math:`K` of steps, sums :math:`g` between :math:`X` and
    :math:`X - K` over the samples within half a pixel of each pixel of the window. Neither image alone is
    interpolated. The least cost within a pixel of the winner is taken, and a parabola
    through its neighbours; at either end of these candidates there is none. Of a stretch of equal costs the
    middle is taken.

    Parameters
    ----------
    left, right : ndarray of uint8 or int32, (H, W, C)
    winner : ndarray of float32, (H, W)
        Whole disparities; NaN stays NaN.
    window : (width, height)
    centred : bool
        Take the mean of the window around it from each pixel first: blind to an offset of brightness.
    threads : int
    steps : int
        Samples a pixel, 1 ... 16.

    Returns
    -------
    ndarray of float32, (H, W)

    References
    ----------
    .. [1] R. Szeliski, D. Scharstein, Sampling the disparity space image, IEEE TPAMI 26(3), 2004,
       doi:10.1109/TPAMI.2004.1262341.
    """
    pair = (_centred(left, window), _centred(right, window)) if centred else (_whole(left), _whole(right))
    refined = np.empty(winner.shape, np.float32)
    _core.align_intervals(*pair, *window, steps, np.ascontiguousarray(winner), refined, threads)
    return refined


def _centred(image: npt.NDArray[Any], window: tuple[int, int]) -> npt.NDArray[np.int32]:
    """Pixels less the mean of the window around them; those of 8 bits in sixteenths of a grey level."""
    (width, height), (rows, columns) = window, image.shape[:2]
    around = ((height // 2, (height - 1) // 2), (width // 2, (width - 1) // 2), (0, 0))
    sums = np.pad(image.astype(np.int64), around, mode="edge")
    for axis, (side, length) in enumerate(((height, rows), (width, columns))):
        total = np.insert(sums.cumsum(axis), 0, 0, axis)
        first, last = np.arange(length), np.arange(length) + side
        sums = total.take(last, axis) - total.take(first, axis)
    scale = 16 if image.dtype == np.uint8 else 1
    return (scale * image.astype(np.int64) - np.rint(scale * sums / (width * height))).astype(np.int32)


def _whole(image: npt.NDArray[Any]) -> npt.NDArray[np.int32]:
    return np.ascontiguousarray(image, np.int32)


def confidence(
    perfect: float, cost: npt.NDArray[Any], before: npt.NDArray[Any], after: npt.NDArray[Any]
) -> npt.NDArray[np.float32]:
    """How far the winner stands below the mean of its neighbours.

    As a fraction of the way from that mean to a perfect match; in [0, 1].
    """
    cost, before, after, _ = _neighbours(cost, before, after)
    around = np.float32(0.5) * (before.astype(np.float32) + after.astype(np.float32))
    reach = around - np.float32(perfect)
    fraction = (around - cost.astype(np.float32)) / np.where(reach > 0, reach, np.float32(1))
    return np.where(reach > 0, np.clip(fraction, np.float32(0), np.float32(1)), np.float32(0))


def median(
    disparity: DisparityMap, size: int, threads: int = 0, *, into: DisparityMap | None = None
) -> DisparityMap:
    """Median over those of ``size x size`` pixels that have a value.

    Invalid pixels stay invalid. At borders the window is what lies inside the map. What is found goes to the
    contiguous array `into`, which may be the map itself; else to a new one.
    """
    filtered = np.empty(disparity.shape, np.float32) if into is None else into
    if not filtered.flags.c_contiguous:
        raise ValueError(f"into must be contiguous, not of strides {filtered.strides}")
    _core.median(np.ascontiguousarray(disparity), size, filtered, threads, _instructions.forced())
    return filtered


PLANAR_TOLERANCE = 1.5
"""How far off a plane a pixel may lie to count as on it, in pixels of disparity..."""
PLANAR_COLUMNS = 640
"""...of images of at least so many columns: in smaller ones surfaces lie as much closer together."""
PLANAR_ITERATIONS = 2


def planar_tolerance(columns: int) -> float:
    """The tolerance of `planar` for images of so many columns, in pixels of disparity."""
    return PLANAR_TOLERANCE * min(1.0, columns / PLANAR_COLUMNS)


def planar(
    disparity: DisparityMap,
    window: tuple[int, int],
    threads: int = 0,
    *,
    tolerance: float = PLANAR_TOLERANCE,
    iterations: int = PLANAR_ITERATIONS,
) -> DisparityMap:
    r"""Draw each pixel to the plane that its surroundings lie on.

    .. math:: \min_{d, a, b} \sum_q \min\left((D_q - d - a u_q - b v_q)^2, \tau^2\right)

    over the window's pixels :math:`q` at :math:`(u, v)` from its centre; the answer is :math:`d`. From the
    pixel as it is and no slope, each step fits a plane by least squares to what lies within :math:`\tau` of
    the last one, so an outline stays where it is, and a slanted surface slanted. That is a mean shift [1]_ of
    planes. Of the window every few pixels count, at most 9 columns and 7 rows.

    Parameters
    ----------
    disparity : ndarray of float32, (H, W)
        NaN where invalid: stays so, and does not count.
    window : (width, height)
        In pixels; an even one is taken a pixel smaller. At borders what lies inside the map counts.
    threads : int
        0: all cores. Never changes a result.
    tolerance : float
        :math:`\tau`, in pixels of disparity.
    iterations : int
        How many steps.

    Returns
    -------
    ndarray of float32, (H, W)

    References
    ----------
    .. [1] D. Comaniciu, P. Meer, Mean shift: a robust approach toward feature space analysis,
       IEEE TPAMI 24(5), 2002, doi:10.1109/34.1000236.
    """
    smooth = np.empty(disparity.shape, np.float32)
    source = np.ascontiguousarray(disparity)
    _core.planar(source, *window, tolerance, iterations, smooth, threads, _instructions.forced())
    return smooth


def photometric(
    disparity: DisparityMap,
    doubtful: npt.NDArray[np.bool_] | npt.NDArray[np.uint8],
    views: tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]],
    disparities: Disparities,
    threads: int = 0,
) -> DisparityMap:
    r"""Move disparities to where the grey levels of both views are most alike.

    What optimisers answer between whole candidates tells little: where a surface faces the camera their sums
    prefer whole disparities. So every pixel is compared with what it meets at its own disparity, to 1/128 of
    a pixel, and moves by one step of Gauss and Newton [1]_ of the window of 15 x 9 pixels around it, in the
    disparity and in the gain and the offset of one view's brightness,

    .. math:: \delta = \frac{k c_{gl} - c_{eg}}{(1 - k) (c_{gg} - c_{gl}^2 / c_{ll})}, \qquad
        k = \frac{c_{el}}{c_{ll}} \in [-1, 1/2],

    at most by half a pixel; :math:`e` is the difference of the grey levels, left less right, :math:`l` the
    left one and :math:`g` its gradient along the row, :math:`c_{ab} = n \sum a b - \sum a \sum b`, and
    :math:`n` the number of pixels that count: neither doubtful nor out of view, and less than 20 grey levels
    off the window's mean :math:`e`. Fewer than 45 of them tell nothing. :math:`c_{gg}` and :math:`c_{ll}` are
    larger by :math:`675 n`, so that noise alone moves nothing far. The right view's gradient is :math:`1 - k`
    times the left one's. All sums are exact.

    Parameters
    ----------
    disparity : ndarray of float32, (H, W)
        Disparity in pixels; NaN where there is none. Not changed.
    doubtful : ndarray of bool or uint8, (H, W)
        What does not count and stays; not 0 where so.
    views : two ndarrays of uint8, (H, W)
        Grey levels of the left and the right view.
    disparities : Disparities
        What moves stays between the first and the last of these candidates.
    threads : int
        0: all cores.

    Returns
    -------
    ndarray of float32, (H, W)

    References
    ----------
    .. [1] B. D. Lucas, T. Kanade, An iterative image registration technique with an application to stereo
       vision, IJCAI 1981, 674-679.
    """
    moved = np.empty(disparity.shape, np.float32)
    _core.photometric(
        np.ascontiguousarray(disparity),
        np.ascontiguousarray(doubtful, np.uint8),
        np.ascontiguousarray(views[0]),
        np.ascontiguousarray(views[1]),
        disparities.min,
        disparities.max - 1,
        moved,
        threads,
        _instructions.forced(),
    )
    return moved
