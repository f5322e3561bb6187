"""Planes: a disparity map told anew by small segments of the image, each with a plane of its own.

What matching leaves open or gets wrong (occlusions, surfaces without texture, noise of a fraction of a pixel)
is settled by what surrounds it: the world is taken to be made of planes that go on, fold or hide each other.
"""

from __future__ import annotations

import enum
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stereopsis import _core, fill
from stereopsis.types import DisparityMap, Image

SIDE = 13
"""Side of a segment at the start, in pixels."""
TEXTURE = 4.5
"""Mean horizontal gradient, in 255ths of the image's range a pixel, from which a match counts in full."""
TEXTURE_WINDOW = (9, 7)
"""Width and height of the window that this mean is taken over."""
FAINT = 0.05
"""Least weight of a match, however little texture there is."""
GUESSED = 0.2
"""What a disparity that was filled from the background weighs beside one that was matched."""
SUNK = 2.0
"""How far below the ground a hole may be guessed to lie, in pixels of disparity."""
SWEEPS = (4, 2)
"""So many sweeps over the boundaries after the first fit, and after the second."""
AGREES = 2.0
"""How far from its segment's plane a match supports it, in pixels of disparity."""
TRIALS = 8
"""Random samples a segment and fit."""
ROUNDS = 6
"""How often every segment is offered its neighbours' planes."""


class Model(NamedTuple):
    """What the energy weighs; docs/planes.md says where each number stands in it.

    Attributes
    ----------
    side : float
        Of a segment at the start, in pixels.
    truncation : float
        Squared residual in pixels of disparity that counts no more.
    most_a, most_b : float
        Steepest plane, in pixels of disparity a column and a row.
    position, depth, boundary : float
        Against squared grey levels: the squared distance from the segment's middle as a fraction of `side`,
        the squared residual, and each of the eight neighbours in another segment.
    smoothness : float
        Weight of a pixel of boundary beside one of surface.
    hinge, occlusion : float
        What a fold and a step in depth cost, in squared pixels of disparity.
    """

    side: float = SIDE
    truncation: float = 6.0
    most_a: float = 0.6
    most_b: float = 1.5
    position: float = 400.0
    depth: float = 2000.0
    boundary: float = 300.0
    smoothness: float = 2.0
    hinge: float = 2.0
    occlusion: float = 6.0


class Meeting(enum.IntEnum):
    """How two neighbouring segments meet."""

    COPLANAR = 0
    """One plane goes through both."""
    HINGE = 1
    """Two planes meet at the boundary."""
    OCCLUSION = 2
    """The nearer surface hides part of the other."""


class Segmentation(NamedTuple):
    """Segments and their planes.

    Attributes
    ----------
    label : ndarray of int32, (H, W)
        Each pixel's segment, 0 ... N - 1; every segment is 4-connected.
    planes : ndarray of float64, (N, 3)
        ``a, b, c`` of ``d = a x + b y + c``; NaN where nothing is known of a segment or around it.
    disparity : ndarray of float32, (H, W)
        Each pixel's disparity on its segment's plane, in pixels; NaN where it has none.
    support : ndarray of float32, (N,)
        The fraction of a segment's pixels that were matched within `AGREES` of its plane: how far to believe
        it.
    """

    label: npt.NDArray[np.int32]
    planes: npt.NDArray[np.float64]
    disparity: DisparityMap
    support: npt.NDArray[np.float32]


class Boundaries(NamedTuple):
    """Where segments meet; arrays of one entry for each pair of neighbours.

    Attributes
    ----------
    first, second : ndarray of int32
        The two segments, the smaller number first.
    length : ndarray of int32
        How many pairs of pixels meet there.
    meeting : ndarray of uint8
        `Meeting`.
    step : ndarray of float32
        Mean of the first plane less the second along the boundary, in pixels of disparity: where they meet by
        occlusion, the first is in front if this is positive.
    """

    first: npt.NDArray[np.int32]
    second: npt.NDArray[np.int32]
    length: npt.NDArray[np.int32]
    meeting: npt.NDArray[np.uint8]
    step: npt.NDArray[np.float32]


def refine(
    image: Image,
    disparity: DisparityMap,
    bounds: tuple[float, float],
    model: Model | None = None,
    threads: int = 0,
    *,
    ground: tuple[float, float, float] | None = None,
) -> Segmentation:
    r"""Segment an image and fit a plane to the disparities of each segment [1]_.

    Squares of the image start as segments. Then twice each segment's plane is fitted to its pixels, and
    pixels at the boundaries go over to the neighbour that explains colour, place and disparity better. At
    last each segment weighs its own plane against its neighbours', and the best compromise with them.

    Parameters
    ----------
    image : ndarray of uint8, uint16 or float32, (H, W) or (H, W, 3)
        The left image. Other than uint8, its range is stretched to 255 grey levels.
    disparity : ndarray of float32, (H, W)
        In pixels; NaN where not to be believed.
    bounds : (float, float)
        Least and largest disparity that may be answered.
    model : Model, optional
    threads : int
        0: all cores. Never changes the result.
    ground : (float, float, float), optional
        ``a, b, c`` of the ground's plane, where one is seen: no hole is guessed to lie `SUNK` below it.

    Returns
    -------
    Segmentation

    Raises
    ------
    TypeError
        If `disparity` is not an array of float32, or `image` is of another dtype than it may be.
    ValueError
        If the shapes do not fit together, or a number of `model` is not finite, negative, or `side` below 1.

    Notes
    -----
    The energy is that of Yamaguchi et al. [1]_ but for three changes. A disparity counts by the texture at
    its place, as its variance is inversely proportional to the squared gradient [2]_. Holes are first filled
    from the background, or with the ground where that is nearer, and count by `GUESSED`. And which segment an
    edge in depth belongs to is not asked.

    References
    ----------
    .. [1] K. Yamaguchi, D. McAllester, R. Urtasun, Efficient joint segmentation, occlusion labeling, stereo
       and flow estimation, ECCV 2014, doi:10.1007/978-3-319-10602-1_49.
    .. [2] M. Okutomi, T. Kanade, A multiple-baseline stereo, IEEE TPAMI 15(4), 1993, doi:10.1109/34.206955.
    """
    chosen = Model() if model is None else model
    _check(image, disparity, chosen)
    levels = _levels(image)
    height, width = disparity.shape
    seen = (levels, *_weighted(levels, disparity, ground, bounds[0], threads))
    rows, columns = (min(side, max(1, round(side / chosen.side))) for side in (height, width))
    label = _squares(height, rows)[:, None] * np.int32(columns) + _squares(width, columns)
    planes = np.full((rows * columns, 3), np.nan)
    for sweeps in SWEEPS:
        _core.fit_planes(seen, tuple(chosen), label, TRIALS, planes, threads)
        _core.move_boundaries(seen, tuple(chosen), planes, sweeps, label, threads)
    _core.fit_planes(seen, tuple(chosen), label, TRIALS, planes, threads)
    _core.smooth_planes(seen, tuple(chosen), label, columns, ROUNDS, planes, threads)
    rendered = np.empty((height, width), np.float32)
    _core.render_planes(label, planes, *bounds, rendered, threads)
    agreed = np.abs(rendered - disparity) <= AGREES
    support = np.bincount(label[agreed], minlength=len(planes)) / np.bincount(label.ravel())
    return Segmentation(label, planes, rendered, support.astype(np.float32))


def boundaries(
    label: npt.NDArray[np.int32], planes: npt.NDArray[np.float64], model: Model | None = None
) -> Boundaries:
    r"""Find the segments that meet, and how.

    With :math:`\Delta` the difference of the two planes, :math:`S` the pixels of both segments and :math:`B`
    the places halfway between the pixels that meet, whichever costs least:

    .. math:: \text{coplanar: } \overline{\Delta^2}_S, \quad
              \text{hinge: } \lambda_h + \overline{\Delta^2}_B, \quad \text{occlusion: } \lambda_o .

    Parameters
    ----------
    label : ndarray of int32, (H, W)
    planes : ndarray of float64, (N, 3)
    model : Model, optional
        For :math:`\lambda_h` and :math:`\lambda_o`.

    Returns
    -------
    Boundaries
        Of all pairs with a plane each, ordered by `first`, then `second`.
    """
    chosen, count = Model() if model is None else model, len(planes)
    rows, columns = (axis.ravel() for axis in np.indices(label.shape))
    inside = _moments(label.ravel(), columns, rows, count)
    pairs, places = [], []
    for near, far, right, down in (
        (label[:, :-1], label[:, 1:], 0.5, 0.0),
        (label[:-1], label[1:], 0.0, 0.5),
    ):
        v, u = np.nonzero(near != far)
        one, other = near[v, u].astype(np.int64), far[v, u].astype(np.int64)
        pairs.append(np.minimum(one, other) * count + np.maximum(one, other))
        places.append((u + right, v + down))
    met, which, length = np.unique(np.concatenate(pairs), return_inverse=True, return_counts=True)
    x, y = (np.concatenate(axis) for axis in zip(*places, strict=True))
    along = _moments(which, x, y, len(met))
    first, second = met // count, met % count
    apart = planes[first] - planes[second]
    costs = np.stack(
        (
            _mean_square(inside[first] + inside[second], apart),
            chosen.hinge + _mean_square(along, apart),
            np.full(len(met), chosen.occlusion),
        )
    )
    step = (apart * along[:, [1, 2, 0]]).sum(axis=1) / along[:, 0]
    known = np.isfinite(step)
    return Boundaries(
        first[known].astype(np.int32),
        second[known].astype(np.int32),
        length[known].astype(np.int32),
        np.argmin(costs[:, known], axis=0).astype(np.uint8),
        step[known].astype(np.float32),
    )


def _check(image: Image, disparity: DisparityMap, model: Model) -> None:
    for name, array, dtypes in (
        ("image", image, (np.uint8, np.uint16, np.float32)),
        ("disparity", disparity, (np.float32,)),
    ):
        kind = array.dtype if isinstance(array, np.ndarray) else type(array).__name__
        if kind not in dtypes:
            allowed = ", ".join(np.dtype(dtype).name for dtype in dtypes)
            raise TypeError(f"{name} must be an array of {allowed}, not {kind}")
    if disparity.ndim != 2 or not disparity.size:
        raise ValueError(f"disparity must be (H, W), not of shape {disparity.shape}")
    if image.shape not in (disparity.shape, (*disparity.shape, 3)):
        raise ValueError(
            f"image must be (H, W) or (H, W, 3) with (H, W) = {disparity.shape}, not of shape {image.shape}"
        )
    for name, value in model._asdict().items():
        least = 1 if name == "side" else 0
        if not least <= value < np.inf:
            raise ValueError(f"{name} must be a finite number of at least {least}, not {value!r}")


def _levels(image: Image) -> npt.NDArray[np.float32]:
    """(H, W, C) grey levels, from 0 to 255 where the image is not of 8 bits."""
    levels = np.ascontiguousarray(image.reshape(*image.shape[:2], -1), np.float32)
    if image.dtype != np.uint8:
        low, high = levels.min(), levels.max()
        levels = (levels - low) * np.float32(255 / max(float(high) - float(low), 1e-30))
    return levels


def _squares(side: int, count: int) -> npt.NDArray[np.int32]:
    """Which of `count` stretches of nearly the same length each pixel of a side lies in."""
    return (np.arange(side) * count // side).astype(np.int32)


def _weighted(
    levels: npt.NDArray[np.float32],
    disparity: DisparityMap,
    ground: tuple[float, float, float] | None,
    least: float,
    threads: int,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Disparities without holes, and how far each is believed."""
    texture = np.empty(disparity.shape, np.float32)
    _core.texture(np.rint(levels).astype(np.int32), *TEXTURE_WINDOW, texture, threads)
    weight = np.clip(np.square(texture / np.float32(TEXTURE)), np.float32(FAINT), np.float32(1))
    holes = np.isnan(disparity)
    weight[holes] *= np.float32(GUESSED)
    filled = fill.background(disparity)
    if ground is not None:
        a, b, c = ground
        x, y = np.arange(disparity.shape[1]), np.arange(disparity.shape[0])[:, None]
        deepest = np.maximum(a * x + (b * y + (c - SUNK)), least).astype(np.float32)
        np.copyto(filled, np.fmax(filled, deepest), where=holes)
    unknown = np.isnan(filled)
    weight[unknown] = 0
    filled[unknown] = 0
    return np.ascontiguousarray(filled), weight


def _moments(
    which: npt.NDArray[Any], x: npt.NDArray[Any], y: npt.NDArray[Any], count: int
) -> npt.NDArray[np.float64]:
    """Sums of 1, x, y, xx, xy, yy over the points of each number, (count, 6)."""
    terms = (None, x, y, x * x, x * y, y * y)
    return np.stack([np.bincount(which, term, count) for term in terms], axis=1).astype(np.float64)


def _mean_square(moments: npt.NDArray[np.float64], plane: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    n, x, y, xx, xy, yy = moments.T
    a, b, c = plane.T
    squares: npt.NDArray[np.float64] = (
        a * a * xx + b * b * yy + c * c * n + 2 * (a * b * xy + a * c * x + b * c * y)
    ) / n
    return squares
