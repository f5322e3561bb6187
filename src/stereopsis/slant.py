"""Slant: matching along planes in disparity, where a window on a fronto-parallel plane would not fit.

A support window that is matched at one disparity takes the surface under it to face the camera. On a road the
disparity changes by a third of a pixel from row to row, so a high window sees ten disparities at once. Along
a plane ``d(x, y) = a x + b y + c`` the right image is warped first, so that the plane itself has disparity 0;
then the window fits, and what is matched is the rest.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stereopsis import _core, _instructions
from stereopsis._numbers import quantile
from stereopsis.types import Disparities, DisparityMap, Flag, Halo, Image

FIRST_WINDOW = (25, 9)
"""Support window of the map that planes are fitted to: flat, so that even a road changes little within it."""
MARGIN = 8
NEAR = Disparities(-MARGIN, MARGIN)
"""Candidates along a plane, which are residuals: as many as the widest vectors hold."""
TOLERANCE = 1.0
"""How far from a plane a pixel of the first map may lie to count as on it, in pixels of disparity."""
NEIGHBOURS = 30
"""How far the second and third point of a sample may lie from the first, in columns and in rows."""
GRID = 65536
"""To about so many pixels is a map thinned before planes are fitted."""
FACADES = 2
"""How many planes that are not slanted may hold more pixels than the ground does."""
LEVEL_WITHIN = 0.75
"""A plane that rises by less over a window is no slant, in pixels of disparity."""
MOST_PLANES = 3
"""How many planes are looked for, the road included."""


def halo(window: tuple[int, int]) -> Halo:
    """What a match along a given plane depends on beyond its range: the window, residuals, and a cubic.

    The check of left against right works on the mirrored pair, where an even window reaches the other way.
    """
    return Halo.around(window[0] // 2, window[1] // 2).then(Halo.around(MARGIN + 3, 0))


class Plane(NamedTuple):
    """A plane in disparity, ``d(x, y) = a x + b y + c`` in pixels of the left image."""

    a: float
    b: float
    c: float

    def mirrored(self, width: int) -> Plane:
        """The same plane of the swapped pair: the right image, mirrored, for the left, and vice versa.

        Pixel ``x`` of the left image meets ``u = x - d(x, y)`` of the right, so seen from there the disparity
        is ``(a u + b y + c) / (1 - a)``, and mirroring turns ``u`` into ``width - 1 - u``.
        """
        a, b, c = (value / (1 - self.a) for value in self)
        return Plane(-a, b, c + a * (width - 1))

    def from_row(self, row: int) -> Plane:
        """The same plane, rows being counted from that one."""
        return Plane(self.a, self.b, self.c + self.b * row)

    def nearest(self, shape: tuple[int, int]) -> float:
        """Its disparity in the middle of the last row of (H, W)."""
        return self.a * (shape[1] - 1) / 2 + self.b * (shape[0] - 1) + self.c

    def first_row_above(self, disparity: float, shape: tuple[int, int]) -> int:
        """The first row of (H, W) with a pixel of the plane above a disparity; 0 where none is."""
        rows = np.arange(shape[0])
        highest = self.b * rows + self.c + max(0.0, self.a * (shape[1] - 1))
        return int(np.argmax(highest > disparity))


LEVEL = Plane(0.0, 0.0, 0.0)
"""No warp: fronto-parallel windows, as matching without slant has them."""


def road(
    disparity: DisparityMap, window: tuple[int, int], step: int | None = None, threads: int = 0
) -> Plane | None:
    """Fit the ground to a first disparity map, of which only reliable pixels have a value.

    Random sample consensus [1]_ over the lower six tenths of the map: of 512 planes through three points, the
    one with the least sum of truncated residuals, polished by least squares over what lies within `TOLERANCE`
    of it. The points are drawn by a generator of its own, so the answer is always the same. Maps of more than
    `GRID` pixels are thinned to about so many first.

    Parameters
    ----------
    disparity : ndarray of float32, (H, W)
        NaN where not reliable.
    window : (width, height)
        The support window, in pixels.
    step : int, optional
        The map is thinned already: it holds every so many-th row and column.
    threads : int
        0: all cores. Never changes the answer.

    Returns
    -------
    Plane or None
        None where no plane that comes nearer downwards, by up to 2 pixels a row, and by at most 0.2 a column
        to either side, holds enough of these pixels: a fiftieth of all, reliable or not, and of the reliable
        ones three times as many as random disparities would give it, or half. And where it changes by less
        than half a pixel across the window: fronto-parallel windows serve it as well.

    References
    ----------
    .. [1] M. A. Fischler, R. C. Bolles, Random sample consensus, CACM 24(6), 1981,
       doi:10.1145/358669.358692.
    """
    thinned, step = _thinned(disparity, step)
    ground = _ground(thinned, window, step, threads)
    return None if ground is None else _scaled(ground, step)


def planes(
    disparity: DisparityMap,
    window: tuple[int, int],
    most: int = MOST_PLANES,
    step: int | None = None,
    threads: int = 0,
) -> list[Plane]:
    """Fit the ground and further planes, such as walls and verges, each to the pixels that the others leave.

    The ground as `road` finds it; then random samples of three neighbouring points, anywhere in the map.

    Parameters
    ----------
    disparity : ndarray of float32, (H, W)
        NaN where not reliable.
    window : (width, height)
        The support window, in pixels.
    most : int
        How many planes at most.
    step : int, optional
        As for `road`.
    threads : int
        0: all cores. Never changes the answer.

    Returns
    -------
    list of Plane
        Those that hold enough pixels and are slanted enough, as for `road`; the ground first, if any.
    """
    rest, step = _thinned(disparity, step)
    found: list[Plane] = []
    for trial in range(2 * most):
        if trial == 0:
            plane = _ground(rest.copy(), window, step, threads)
            if plane is None:
                continue
        else:
            plane = _search(rest, 0, max(1, NEIGHBOURS // step), (0.5 * step, -step, 2.0 * step), threads)
            if plane is None or len(found) >= most:
                break
        if not _level(plane, window, step):
            found.append(plane)
        rest[_on(plane, rest)] = np.nan
    return [_scaled(plane, step) for plane in found]


def thinning(size: int) -> int:
    """Every how manyeth row and column of a map of so many pixels serves."""
    return max(1, round(float(np.sqrt(size / GRID))))


def _thinned(disparity: DisparityMap, step: int | None) -> tuple[DisparityMap, int]:
    if step is not None:
        return disparity.copy(), step
    step = thinning(disparity.size)
    return disparity[::step, ::step].copy(), step


def _scaled(plane: Plane, step: int) -> Plane:
    """From a thinned map's columns and rows to the image's."""
    return Plane(plane.a / step, plane.b / step, plane.c)


def _level(plane: Plane, window: tuple[int, int], step: int) -> bool:
    return abs(plane.a) * window[0] + abs(plane.b) * window[1] < LEVEL_WITHIN * step


def _ground(rest: DisparityMap, window: tuple[int, int], step: int, threads: int) -> Plane | None:
    """The ground, if need be behind what faces the camera across the street: that is taken out of `rest`."""
    for _ in range(FACADES + 1):
        plane = _road(rest, step, threads)
        if plane is None or not _level(plane, window, step):
            return plane
        rest[_on(plane, rest)] = np.nan
    return None


def _road(thinned: DisparityMap, step: int, threads: int) -> Plane | None:
    top = int(0.4 * thinned.shape[0])
    return _search(thinned, top, 0, (0.2 * step, 0.0, 2.0 * step), threads)


def _search(
    disparity: DisparityMap, top: int, radius: int, slopes: tuple[float, float, float], threads: int
) -> Plane | None:
    """The plane from row `top` on that most pixels are on, if they are enough."""
    found = np.zeros(3)
    searched = np.ascontiguousarray(disparity)
    forced = _instructions.forced()
    inliers = _core.find_plane(searched, top, radius, *slopes, TOLERANCE, 512, 4096, found, threads, forced)
    if inliers < max(3.0, 0.02 * searched[top:].size):
        return None
    known = np.isfinite(searched[top:])
    reliable = np.count_nonzero(known)
    if inliers < 0.5 * reliable:  # half of them are enough, however many there are by chance
        values = searched[top:][known]
        spread = quantile(values, 0.95) - quantile(values, 0.05)
        if inliers < 3 * reliable * min(1.0, 2 * TOLERANCE / max(spread, TOLERANCE)):
            return None
    return Plane(*found.tolist())


def _on(plane: Plane, disparity: DisparityMap) -> npt.NDArray[np.bool_]:
    rows, columns = disparity.shape
    x, y = np.arange(columns), np.arange(rows)[:, None]
    on: npt.NDArray[np.bool_] = np.abs(plane.a * x + (plane.b * y + plane.c) - disparity) <= 1.5 * TOLERANCE
    return on


def warped(
    left: Image, right: Image, plane: Plane, margin: int, threads: int = 0, *, floor: float = -math.inf
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Both images `margin` columns wider on either side, the right one moved so that the plane is at 0.

    ``warped(x, y) = right(x - d(x, y), y)``, by cubic convolution [1]_ along the row, rounded to the image's
    own whole numbers and kept within its range. The left image repeats its edge pixels, as every window does.

    Parameters
    ----------
    left, right : ndarray of uint8 or int32, (H, W, C)
    plane : Plane
    margin : int
        Columns; so a candidate that leaves the warped image can still be one that lies inside the right one.
    threads : int
        0: all cores.
    floor : float
        Where the plane lies below it, as a road does above the horizon, this disparity stands for it.

    Returns
    -------
    left, right : ndarray of the same dtype, (H, W + 2 margin, C)

    References
    ----------
    .. [1] R. G. Keys, Cubic convolution interpolation for digital image processing, IEEE TASSP 29(6), 1981,
       doi:10.1109/TASSP.1981.1163711.
    """
    wide = left if margin == 0 else np.pad(left, ((0, 0), (margin, margin), (0, 0)), "edge")
    wide = np.ascontiguousarray(wide)
    moved = np.empty_like(wide)
    _core.warp(right, tuple(plane), floor, int(right.min()), int(right.max()), moved, threads)
    return wide, moved


class Hypothesis(NamedTuple):
    """What is believed of each pixel so far, (H, W) each.

    Attributes
    ----------
    disparity, confidence : ndarray of float32
    cost : ndarray of float32
        The winner's; infinity where nothing has been found.
    misfit : ndarray of float32
        What the winner leaves unexplained, handicap included.
    flags : ndarray of uint8
    plane : ndarray of uint8
        Number of the plane that the winner was found along: 0 is fronto-parallel.
    """

    disparity: npt.NDArray[np.float32]
    confidence: npt.NDArray[np.float32]
    cost: npt.NDArray[np.float32]
    misfit: npt.NDArray[np.float32]
    flags: npt.NDArray[np.uint8]
    plane: npt.NDArray[np.uint8]

    @classmethod
    def nothing(cls, shape: tuple[int, int]) -> Hypothesis:
        """Before the first pass: every pixel out of view."""

        def every(value: float) -> npt.NDArray[np.float32]:
            return np.full(shape, value, np.float32)

        out_of_view = np.full(shape, Flag.OUT_OF_VIEW, np.uint8)
        return cls(
            every(np.nan), every(0), every(np.inf), every(np.inf), out_of_view, np.zeros(shape, np.uint8)
        )

    def from_row(self, row: int) -> Hypothesis:
        """What is believed of that row and those below, the same memory."""
        disparity, confidence, cost, misfit, flags, plane = self
        return Hypothesis(
            disparity[row:], confidence[row:], cost[row:], misfit[row:], flags[row:], plane[row:]
        )


def handicap(candidates: int, level: int, window: tuple[int, int]) -> float:
    r"""Factor on a pass's misfit that makes passes with different numbers of candidates comparable.

    The best of many candidates fits well by chance. If each pass is as likely as the other, and within a pass
    each candidate, then with Gaussian noise and :math:`n` independent samples in the window the logarithm of
    the odds of two candidates is :math:`\tfrac n2 \log (m_2 / m_1) + \log (D_2 / D_1)`, with :math:`m` the
    misfits and :math:`D` the numbers of candidates. So :math:`m_1` counts :math:`(D_1 / D_2)^{2 / n}` times.

    Parameters
    ----------
    candidates, level : int
        Candidates of the pass and of the fronto-parallel one.
    window : (width, height)
        Neighbouring pixels are alike: one in `PIXELS_A_SAMPLE` counts as a sample.
    """
    samples = window[0] * window[1] / PIXELS_A_SAMPLE
    return float((candidates / level) ** (2 / max(samples, 1)))


PIXELS_A_SAMPLE = 16
"""How many pixels of a window are taken to tell as much as one independent sample."""


AS_IT_IS = 1
"""The kind, in the core's order, of costs that are misfits as they are: squared differences, and sums of path
costs."""


def merge_pass(
    best: Hypothesis,
    found: tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.uint8]],
    cost: npt.NDArray[np.float32],
    kind: int,
    plane: Plane,
    number: int,
    factor: float,
    disparities: Disparities,
    threads: int = 0,
    *,
    floor: float = -math.inf,
    beyond: bool = False,
) -> None:
    r"""Take a pass's winners over into `best`, in place, where they leave less unexplained.

    The misfit of a correlation :math:`\rho` is :math:`1 - \rho |\rho|`: for :math:`\rho > 0` the fraction of
    the left window's variance that a regression on the right one leaves; of a squared difference it is the
    difference, of an absolute one its square. A residual :math:`r` at :math:`x` stands for the disparity
    :math:`r + d(x - r, y)`. A winner whose match lies outside the right image, or whose disparity lies more
    than half a candidate outside the range, is none.

    Parameters
    ----------
    best : Hypothesis
        (H, W). Of equal misfits the earlier pass's stays.
    found : disparity, confidence and flags, (H, W + 2 margin) each
    cost : ndarray of float32, (H, W + 2 margin)
    kind : int
        The cost's number in the core's order; `AS_IT_IS` for sums of path costs.
    plane : Plane
    number : int
        What `Hypothesis.plane` is to hold.
    factor : float
        The pass's `handicap`.
    disparities : Disparities
        The whole range.
    threads : int
    floor : float
        As for `warped`.
    beyond : bool
        Whether a winner whose match lies outside the right image is one all the same, `Flag.OUT_OF_VIEW`.
    """
    low, high = disparities.min - 0.5, disparities.max - 0.5
    disparity, confidence, flags = found
    _core.merge_pass(
        disparity,
        confidence,
        cost,
        flags,
        kind,
        tuple(plane),
        floor,
        factor,
        low,
        high,
        beyond,
        number,
        tuple(best),
        threads,
    )


def merge_window(
    best: Hypothesis,
    variance: npt.NDArray[np.float32],
    other: Hypothesis,
    kind: int,
    threads: int = 0,
) -> None:
    r"""Take another window's answers over into `best`, in place, where they promise the smaller variance.

    The variance of a disparity is the inverse of the log-likelihood's curvature at its maximum [1]_. With the
    winner's confidence :math:`\gamma`, its depth below its neighbours as a fraction, it is, for each sample,

    .. math:: \sigma^2 = \frac{1 + \rho}{2 \rho} \, \frac{1 - \gamma}{\gamma},

    the first factor for correlations alone. Over a window that no plane fits :math:`\gamma` is small, and so
    it is over one with little texture: the window grows where it may and has to. That a larger one holds more
    samples is left out: what a plane leaves unexplained is not noise, and does not average out.

    Parameters
    ----------
    best : Hypothesis
    variance : ndarray of float32, (H, W)
        Of `best`; infinity before the first window. Changed with it; of equal ones the earlier stays.
    other : Hypothesis
    kind : int
        The cost's number in the core's order.
    threads : int

    References
    ----------
    .. [1] T. Kanade, M. Okutomi, A stereo matching algorithm with an adaptive window: theory and experiment,
       IEEE TPAMI 16(9), 1994, doi:10.1109/34.310690.
    """
    _core.merge_window(tuple(other), kind, tuple(best), variance, threads)
