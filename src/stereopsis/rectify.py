r"""Misrectification: what the right image lies too low or too high, found from the images and undone.

A pair is rectified when each point lies on the same row of both images. Where a calibration has aged it does
not: on public driving data a third of a pixel is common. Windows and census then see different rows.
What is found here is the field

.. math::
    v(x, y) = v_0 + v_x s + v_y t + v_{xy} s t,
    \quad s = \frac{x}{W - 1} - \frac12, \quad t = \frac{y}{H - 1} - \frac12

of rows that the right image lies too low: a left point at :math:`(x, y)` is seen at
:math:`(x - d, y + v(x - d, y))`. It is a shift, a roll, a scale and a keystone, which is what small errors of
a camera's attitude and focal length make. A camera that is turned sideways makes the last, and with it bows
the image by :math:`v_{xy} s^2 (W - 1) / (H - 1)` columns: so these are known too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stereopsis import _core, _instructions
from stereopsis._numbers import quantile
from stereopsis.types import Disparities, DisparityMap, Frame, Halo, Rectangle, Vertical

Bytes = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]

COLUMNS = 400
"""The coarsest level of the pyramid is the first with at most so many columns, and never the image itself."""
TILE = 15
"""A point is sought in each square of so many pixels, or more of a large image: in about `TILES` of them."""
TILES = 1400
STRIDE = 8
"""Every how many rows and columns of a tile."""
REACH = (6, 4)
"""A window goes so many columns and rows from its point: 13 x 9. The core's kernels are for 13 columns."""
LEAST_CORNER = 16.0
"""Least mean square of I(+1) - I(-1) in a window's weakest direction, in squared grey levels."""
ITERATIONS = 3
"""On each level."""
LEAST_CORRELATION = 0.9
MOST_ROWS, MOST_COLUMNS = 4.0, 3.0
"""How far a point may lie off its row, and off what the disparity map says, to be believed."""
FOLLOWED = 0.4
"""Where fewer of the points are believed, they may lie on other rows altogether."""
FAR, FAR_SMALL = 16, 4
"""So many up and down are looked at, and at least so many of the smallest images',"""
PEAK = 0.97
"""if the rows next to the first answer so nearly as many pixels as it does;"""
MORE = 1.05
"""and those that answer so many times as many are taken."""
NEAR, NEAR_SLOPES = 0.5, 2.0
"""Offset and slopes, in pixels, within which points are followed without loss; farther they are once more,"""
ROUNDS = 3
"""so often at most."""

CUBIC = 4
"""Rows around that cubic convolution may look at, and one for what is rounded."""
BEYOND = 2.0
"""Rows beyond the right image's first or last one that are no match: nearer, windows see enough of it."""

FEWEST = 40
"""Points that a field needs."""
SLOPE = 0.5
"""What a slope is expected to be, in pixels from edge to edge: few points are no reason for a steep one."""
SETTLED = 5e-4
"""Pixels by which a last iteration changes the field."""
SIGNIFICANT = 2.5
"""A field counts where its root mean square is so many times its own deviation,"""
LEAST = 0.08
"""and at least so many pixels: less is not worth resampling for."""


class Sights(NamedTuple):
    """Where points of the right image lie off the left one's rows; (N,) each.

    Attributes
    ----------
    x, y : ndarray of float64
        Column of the right image and row of the left one, in pixels.
    rows : ndarray of float64
        Pixels that the point lies lower in the right image.
    followed : int
        Points that were followed, of which these are believed.
    """

    x: Floats
    y: Floats
    rows: Floats
    followed: int = 0

    @property
    def lost(self) -> bool:
        """Whether so few are believed that the others may lie on other rows."""
        return len(self.rows) < FOLLOWED * self.followed


class FirstMap(NamedTuple):
    """What points are followed from.

    Attributes
    ----------
    disparity : ndarray of float32
        A map of the last level, in its own pixels; NaN where not reliable.
    field : Vertical
        What was undone for it, in pixels of the whole images; points are looked for there.
    """

    disparity: DisparityMap
    field: Vertical = Vertical(0.0)


def levels(width: int) -> int:
    """How often an image is halved for the disparity map that the search starts from."""
    count = 1
    while width >> count > COLUMNS:
        count += 1
    return count


def eight_bit(image: npt.NDArray[Any], ends: tuple[float, float] | None = None) -> Bytes:
    """An image of integers as bytes: as it is, or stretched from one of the `ends` to the other."""
    if image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    low, high = ends_of(image[::3, ::3]) if ends is None else ends
    stretched = np.empty(image.shape, np.uint8)
    factor = 255 / max(high - low, 1.0)
    _core.stretch(np.ascontiguousarray(image), low, factor, stretched, _instructions.forced())
    return stretched


def ends_of(sample: npt.NDArray[Any]) -> tuple[float, float]:
    """The 0.5 and the 99.5 % quantile."""
    # Ordered before: whole numbers are put in order several times as fast as they are parted.
    ordered = np.sort(sample, axis=None)
    return quantile(ordered, 0.005), quantile(ordered, 0.995)


def halved(image: Bytes, threads: int = 0) -> Bytes:
    """The rounded mean of each 2 x 2 pixels; an odd last row or column is left out."""
    means = np.empty((image.shape[0] // 2, image.shape[1] // 2), np.uint8)
    _core.halve(image, means, threads, _instructions.forced())
    return means


def pyramid(image: Bytes, count: int, threads: int = 0) -> list[Bytes]:
    """The image, halved 0, 1, ... `count` times."""
    found = [image]
    for _ in range(count):
        found.append(halved(found[-1], threads))
    return found


def sights(
    left: list[Bytes],
    right: list[Bytes],
    points: npt.NDArray[np.int32],
    first: FirstMap,
    threads: int = 0,
) -> Sights:
    """Points with texture in both directions, and where the right image shows them.

    They are followed from the last level but one down by the iterations of Lucas and Kanade [1]_, in columns
    and rows at once, starting at the disparity and the row of a map of the last level. Each window's mean and
    gain are removed.

    Parameters
    ----------
    left, right : list of ndarray of uint8, (H, W)
        Pyramids, as `pyramid` gives them.
    points : ndarray of int32, (N, 2)
        `corners` of the left image.
    first : FirstMap
    threads : int
        0: all cores.

    Returns
    -------
    Sights
        Those points that were followed to a correlation of at least `LEAST_CORRELATION`, and not far.

    References
    ----------
    .. [1] J.-Y. Bouguet, Pyramidal implementation of the affine Lucas Kanade feature tracker, Intel, 2001.
    """
    last = len(left) - 1
    points, start = known(points, first, last, left[0].shape)
    motion, correlation = start.copy(), np.empty(len(points))
    follow(left[:-1], right[:-1], points, motion, correlation, threads)
    return believed(points, motion, correlation, start, last)


def known(
    points: npt.NDArray[np.int32], first: FirstMap, last: int, shape: tuple[int, ...]
) -> tuple[npt.NDArray[np.int32], Floats]:
    """Those points that a map of images halved `last` times answers, and columns and rows, (N, 2), by which
    they move as it has it, in pixels of the level before that. The whole images are of that shape.
    """
    at = _inside(points >> last, first.disparity.shape)
    disparity = first.disparity[at[:, 1], at[:, 0]].astype(np.float64)
    answered = np.isfinite(disparity)
    points = np.ascontiguousarray(points[answered])
    start = np.zeros((len(points), 2))
    np.multiply(disparity[answered], -2, out=start[:, 0])
    if any(first.field):
        x, y = points[:, 0] + start[:, 0] * 2 ** (last - 1), points[:, 1]
        start[:, 1] = _rows_at(first.field, shape, x, y) / 2 ** (last - 1)
    return points, start


def follow(
    left: list[Bytes],
    right: list[Bytes],
    points: npt.NDArray[np.int32],
    motion: Floats,
    correlation: Floats,
    threads: int = 0,
) -> None:
    """Follow points, (N, 2) in pixels of the first level, from the last level down to the first one.

    In place: `motion`, (N, 2), in pixels of the last level, becomes that in pixels of the first.
    """
    for level in range(len(left) - 1, -1, -1):
        seen = np.ascontiguousarray(_inside(points >> level, left[level].shape))
        _core.track(
            left[level],
            right[level],
            seen,
            REACH[1],
            ITERATIONS,
            motion,
            correlation,
            threads,
            _instructions.forced(),
        )
        if level:
            motion *= 2


def believed(
    points: npt.NDArray[np.int32], motion: Floats, correlation: Floats, start: Floats, last: int
) -> Sights:
    """Of the points that were followed those that were followed well, and not far."""
    moved = motion - start * 2 ** (last - 1)
    with np.errstate(invalid="ignore"):
        good = (correlation >= LEAST_CORRELATION) & (np.abs(moved[:, 1]) <= MOST_ROWS)
        good &= np.abs(moved[:, 0]) <= MOST_COLUMNS * 2 ** (last - 1)
    column, row = points[good, 0] + motion[good, 0], points[good, 1].astype(np.float64)
    return Sights(column, row, motion[good, 1].copy(), len(points))


def tile_of(size: int) -> int:
    """Side of the squares in which an image of so many pixels is searched for corners."""
    return max(TILE, int(np.sqrt(size / TILES)))


def corners(image: Bytes, tile: int, threads: int = 0) -> npt.NDArray[np.int32]:
    """Columns and rows, (N, 2), of at most one point in each square of `tile` pixels.

    It is the middle of that window whose gradients are strongest in their weakest direction [1]_.

    References
    ----------
    .. [1] J. Shi, C. Tomasi, Good features to track, CVPR 1994, doi:10.1109/CVPR.1994.323794.
    """
    stride = max(STRIDE, tile // 3)
    found = np.empty((image.shape[0] // tile, image.shape[1] // tile, 2), np.int32)
    pixels = (2 * REACH[0] + 1) * (2 * REACH[1] + 1)
    _core.corners(
        image, tile, stride, REACH[1], LEAST_CORNER * pixels, found, threads, _instructions.forced()
    )
    flat = found.reshape(-1, 2)
    return flat[flat[:, 0] >= 0]


def _inside(points: npt.NDArray[np.int32], shape: tuple[int, ...]) -> npt.NDArray[np.int32]:
    most = np.array([shape[1] - 1, shape[0] - 1], np.int32)
    inside: npt.NDArray[np.int32] = np.minimum(points, most)
    return inside


def far_from(field: Vertical, other: Vertical) -> bool:
    """Whether points that start where one field has them may get lost on the way to where the other does."""
    offset, across, down = (abs(mine - its) for mine, its in zip(field[:3], other[:3], strict=True))
    return offset > NEAR or max(across, down) > NEAR_SLOPES


def fit(seen: Sights, shape: tuple[int, ...]) -> Vertical:
    r"""The field that most points agree on; nothing where there is none worth undoing.

    Least squares with the weights :math:`(1 + r^2 / 4 s^2)^{-2}` of Geman and McClure [1]_, :math:`s` being
    the residuals' robust deviation, iterated from the median. The slopes and the keystone are drawn towards 0
    as if each had been seen once to be 0, with a deviation of `SLOPE`; of images more than four times as wide
    as high the keystone more, so that the bow is expected to be as much.

    Parameters
    ----------
    seen : Sights
    shape : (H, W, ...)
        Of the images.

    Returns
    -------
    Vertical
        Zero where there are fewer than `FEWEST` points, or the field's root mean square over the image is
        below `LEAST` or `SIGNIFICANT` of its own standard deviations.

    References
    ----------
    .. [1] S. Geman, D. E. McClure, Statistical methods for tomographic image reconstruction, Bulletin of the
       International Statistical Institute 52(4), 1987.
    """
    none = Vertical(0.0)
    if len(seen.rows) < FEWEST:
        return none
    height, width = shape[:2]
    across, down = seen.x / max(1, width - 1) - 0.5, seen.y / max(1, height - 1) - 0.5
    found = np.empty(4)
    # Nor is it one for a deep bow, which of a wide image little keystone makes.
    keystone = SLOPE * min(1.0, 4 * height / width)
    deviation = _core.fit_rows(across, down, seen.rows, SLOPE, keystone, SETTLED, found)
    # Over the image a coordinate from -1/2 to 1/2 has a mean square of 1/12.
    mean_square = found[0] ** 2 + (found[1] ** 2 + found[2] ** 2) / 12 + found[3] ** 2 / 144
    if mean_square < max(LEAST**2, SIGNIFICANT**2 * deviation):
        return none
    # To a ten-thousandth of a pixel, so that no compiler decides the last bits of a match.
    return Vertical(*np.round(found, 4).tolist())


def halo(vertical: Vertical) -> Halo:
    """What `undone` depends on: the rows that it moves by, and a cubic's."""
    rows = int(_most(vertical)) + CUBIC
    return Halo(up=rows, down=rows)


def _most(vertical: Vertical) -> float:
    """Rows that no pixel lies farther off than."""
    slopes = abs(vertical.across) + abs(vertical.down) + 0.5 * abs(vertical.keystone)
    return abs(vertical.offset) + 0.5 * slopes


def undone(
    image: npt.NDArray[Any], vertical: Vertical, threads: int = 0, frame: Frame | None = None
) -> npt.NDArray[Any]:
    """The right image as rectified, ``undone(x, y) = image(x, y + v(x, y))``.

    By cubic convolution [1]_ along the column, rounded to the image's own whole numbers and kept within its
    range. Beyond the first and the last row these are repeated.

    Parameters
    ----------
    image : ndarray of uint8 or int32, (H, W, C)
    vertical : Vertical
    threads : int
        0: all cores.
    frame : Frame, optional
        The whole image that this is a part of.

    Returns
    -------
    ndarray of the same dtype and shape

    References
    ----------
    .. [1] R. G. Keys, Cubic convolution interpolation for digital image processing, IEEE TASSP 29(6), 1981,
       doi:10.1109/TASSP.1981.1163711.
    """
    moved = np.empty_like(image)
    a, b, c, twist = _plane(vertical, image.shape if frame is None else frame.shape)
    least, most = int(image.min()), int(image.max())
    if frame is not None:
        c += a * frame.left + b * frame.top + twist * frame.left * frame.top
        a, b = a + twist * frame.top, b + twist * frame.left
        least, most = (least, most) if frame.limits is None else frame.limits[2:]
    _core.move_rows(image, (a, b, c, twist), least, most, moved, threads, _instructions.forced())
    return moved


def field(vertical: Vertical, shape: tuple[int, ...]) -> npt.NDArray[np.float32]:
    """Rows that each pixel of the right image lies too low, (H, W)."""
    x, y = np.arange(shape[1]), np.arange(shape[0])[:, None]
    return _rows_at(vertical, shape, x, y).astype(np.float32)


def out_of_view(
    vertical: Vertical, shape: tuple[int, int], part: Rectangle
) -> Iterator[tuple[slice, npt.NDArray[np.bool_]]]:
    """Where a part of images of that shape meets rows more than `BEYOND` above or below the right one.

    Yields
    ------
    rows : slice
        Rows of the part: as many at the top, and at the bottom, of the whole images as may do so.
    beyond : ndarray of bool
        Where they do.
    """
    most = max(0, math.ceil(_most(vertical) - BEYOND))
    ends = min(most, shape[0]), max(most, shape[0] - most)
    for top, bottom in ((0, ends[0]), (ends[1], shape[0])):
        strip = Rectangle(max(top, part.top), min(bottom, part.bottom), part.left, part.right)
        if strip.top < strip.bottom:
            x, y = np.arange(strip.left, strip.right), np.arange(strip.top, strip.bottom)[:, None]
            row = y + _rows_at(vertical, shape, x, y)
            beyond = (row < -BEYOND) | (row > shape[0] - 1 + BEYOND)
            yield slice(strip.top - part.top, strip.bottom - part.top), beyond


def _rows_at(vertical: Vertical, shape: tuple[int, ...], x: npt.NDArray[Any], y: npt.NDArray[Any]) -> Floats:
    """Rows that pixels of a right image of that shape lie too low."""
    a, b, c, twist = _plane(vertical, shape)
    rows: Floats = (a + twist * y) * x + (b * y + c)
    return rows


def unbow(
    disparity: DisparityMap,
    vertical: Vertical,
    disparities: Disparities,
    threads: int = 0,
    frame: Frame | None = None,
    of_right: bool = False,
) -> None:
    r"""Undo, in place, what a camera that is turned sideways does to disparities.

    Turned by :math:`\omega` about its vertical axis, with a focal length of :math:`f` pixels, it sees a point
    at :math:`(x, y)` from its middle at :math:`(x + \omega (f + x^2 / f),\; y + \omega x y / f)`. The rows
    tell :math:`\omega / f`, and so what to add: :math:`x^2 \omega / f`, with the column of the right image
    for :math:`x`. The constant :math:`\omega f` no image tells; a calibration takes it in.

    Parameters
    ----------
    disparity : ndarray of float32, (H, W)
        NaN stays NaN.
    vertical : Vertical
    disparities : Disparities
        Within their ends disparities stay.
    threads : int
        0: all cores.
    frame : Frame, optional
        The whole image that this is a part of.
    of_right : bool
        Whether the map is the right view's.
    """
    height, width = disparity.shape if frame is None else frame.shape
    bow = _plane(vertical, (height, width))[3]
    middle = 0.5 * (width - 1) - (0 if frame is None else frame.left)
    ends = disparities.min, disparities.max - 1
    _core.unbow(disparity, bow, middle, *ends, of_right, threads)


def _plane(vertical: Vertical, shape: tuple[int, ...]) -> tuple[float, float, float, float]:
    """As ``(a + twist y) x + b y + c``: a, b, c and the twist."""
    offset, across, down, keystone = vertical
    columns, rows = max(1, shape[1] - 1), max(1, shape[0] - 1)
    a, b = (across - 0.5 * keystone) / columns, (down - 0.5 * keystone) / rows
    return a, b, offset - 0.5 * (across + down) + 0.25 * keystone, keystone / (columns * rows)
