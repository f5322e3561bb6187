"""Validate: which winners are not to be believed, and why."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis import _core
from stereopsis.types import EVERY, Disparities, DisparityMap, Flag, Sampling

BoolMap = npt.NDArray[np.bool_]


def uniqueness(cost: npt.NDArray[Any], second: npt.NDArray[Any], perfect: float, margin: float) -> BoolMap:
    """Where another candidate, not next to the winner, costs at most `margin` percent more.

    Parameters
    ----------
    cost, second : ndarray, (H, W)
        The winner's cost and the least one apart from it and its neighbours; the type's largest value, or
        infinity, where there is none.
    perfect : float
        Cost of a perfect match, from which both are counted: -1 for correlations, 0 for differences.
    margin : float
        Percent.
    """
    none = np.iinfo(second.dtype).max if second.dtype.kind == "i" else np.inf
    excess = second.astype(np.float64) - perfect
    return (second < none) & (excess <= (cost.astype(np.float64) - perfect) * (1 + margin / 100))


def left_right(
    index: npt.NDArray[np.int32],
    right: npt.NDArray[np.int32],
    first: int,
    tolerance: float,
    sampling: Sampling = EVERY,
) -> npt.NDArray[np.uint8]:
    """Where the right view's winner at the match differs by more than `tolerance` pixels.

    A pixel that fails is `Flag.MISMATCHED` where some right pixel's winner lies within the tolerance of it, else
    `Flag.OCCLUDED` [1]_: nothing in the right image is its match.

    Parameters
    ----------
    index, right : ndarray of int32, (H, W') and (H, W)
        Winners of both views, as candidate numbers. Column k of the first is column ``k * step``.
    first : int
        Disparity of candidate 0; candidates lie ``disparity_step`` apart.
    tolerance : float
        Pixels.
    sampling : Sampling

    Returns
    -------
    ndarray of uint8, (H, W')
        Bits of `Flag`.

    References
    ----------
    .. [1] H. Hirschmueller, Stereo processing by semiglobal matching and mutual information,
       IEEE TPAMI 30(2), 2008, doi:10.1109/TPAMI.2007.1166.
    """
    width, apart = right.shape[1], sampling.disparity_step
    columns = np.arange(index.shape[1]) * sampling.step
    match = np.clip(columns - first - index * apart, 0, width - 1)
    failed = (index >= 0) & (np.abs(np.take_along_axis(right, match, axis=1) - index) * apart > tolerance)
    # Left columns that some right pixel's winner points to, counted from the left.
    claimed_columns = np.arange(width) + first + right * apart
    rows, there = np.nonzero((right >= 0) & (claimed_columns >= 0) & (claimed_columns < width))
    claims = np.zeros((index.shape[0], width + 1), np.int32)
    claims[rows, claimed_columns[rows, there] + 1] = 1
    claims = np.cumsum(claims, axis=1, dtype=np.int32)
    reach = int(min(tolerance, width))
    claimed = claims[:, np.minimum(columns + reach + 1, width)] > claims[:, np.maximum(columns - reach, 0)]
    flags = np.zeros(index.shape, np.uint8)
    flags[failed & claimed] = Flag.MISMATCHED
    flags[failed & ~claimed] = Flag.OCCLUDED
    return flags


def left_right_maps(
    left: DisparityMap, right: DisparityMap, disparities: Disparities, tolerance: float
) -> npt.NDArray[np.uint8]:
    """The same check of two maps with disparities between the candidates.

    A pixel is compared with the one of the right view that lies nearest to its match.

    Parameters
    ----------
    left, right : ndarray of float32, (H, W)
        Disparities of both views; NaN where there is none.
    disparities : Disparities
        The range, of which a candidate must be to have been agreed with.
    tolerance : float
        Pixels.

    Returns
    -------
    ndarray of uint8, (H, W)
        Bits of `Flag`; 0 where the left view has no answer.
    """
    height, width = left.shape
    columns = np.arange(width)
    answered = np.isfinite(left)
    there = np.rint(columns - np.where(answered, left, 0)).astype(np.int64)
    answer = np.take_along_axis(right, np.clip(there, 0, width - 1), axis=1)
    inside = (there >= 0) & (there < width)
    failed = answered & ~(inside & (np.abs(answer - left) <= tolerance))

    # Right pixel u claims the left pixels from u + d - tolerance to u + d + tolerance, the range permitting.
    low, high = columns + disparities.min, columns + disparities.max - 1
    claims = np.isfinite(right)
    match = columns + np.where(claims, right, 0)
    first = np.clip(np.maximum(np.ceil(match - tolerance), low), 0, width).astype(np.int64)
    last = np.clip(np.minimum(np.floor(match + tolerance), high) + 1, 0, width).astype(np.int64)
    claims &= first < last
    rows = np.broadcast_to(np.arange(height)[:, None] * (width + 1), claims.shape)[claims]
    size = height * (width + 1)
    changes = np.bincount(rows + first[claims], minlength=size) - np.bincount(
        rows + last[claims], minlength=size
    )
    possible = np.cumsum(changes.reshape(height, width + 1), axis=1)[:, :width] > 0

    flags = np.zeros(left.shape, np.uint8)
    flags[failed & possible] = Flag.MISMATCHED
    flags[failed & ~possible] = Flag.OCCLUDED
    return flags


def texture(image: npt.NDArray[Any], window: tuple[int, int], threads: int = 0) -> npt.NDArray[np.float32]:
    """Mean over the window and the channels of ``|I(x + 1) - I(x - 1)| / 2``, edge pixels repeated.

    Parameters
    ----------
    image : ndarray of uint8 or int32, (H, W, C)
    window : (width, height)
    threads : int

    Returns
    -------
    ndarray of float32, (H, W)
        Grey levels a pixel.
    """
    mean = np.empty(image.shape[:2], np.float32)
    _core.texture(np.ascontiguousarray(image, np.int32), *window, mean, threads)
    return mean


def speckle(disparity: DisparityMap, area: int, difference: float) -> BoolMap:
    """Regions too small to be believed.

    Parameters
    ----------
    disparity : ndarray of float32, (H, W)
    area : int
        Regions of fewer pixels than this are speckle.
    difference : float
        Neighbours, of which a pixel has four, belong to one region where they differ by at most this (pixels
        of disparity).
    """
    found = np.zeros(disparity.shape, np.uint8)
    _core.speckle(np.ascontiguousarray(disparity), area, difference, found)
    return found.astype(bool)
