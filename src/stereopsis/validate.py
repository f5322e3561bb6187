"""Validate: which winners are not to be believed, and why."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis import _core
from stereopsis.types import DisparityMap, Flag

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
    index: npt.NDArray[np.int32], right: npt.NDArray[np.int32], first: int, count: int, tolerance: float
) -> npt.NDArray[np.uint8]:
    """Where the right view's winner at the match differs by more than `tolerance` pixels.

    A pixel that fails is `Flag.MISMATCHED` where some other candidate would have been agreed with, else
    `Flag.OCCLUDED` [1]_.

    Parameters
    ----------
    index, right : ndarray of int32, (H, W)
        Winners of both views, as candidate numbers.
    first, count : int
        Disparity of candidate 0, and how many there are.
    tolerance : float
        Pixels.

    Returns
    -------
    ndarray of uint8, (H, W)
        Bits of `Flag`.

    References
    ----------
    .. [1] H. Hirschmueller, Stereo processing by semiglobal matching and mutual information,
       IEEE TPAMI 30(2), 2008, doi:10.1109/TPAMI.2007.1166.
    """
    columns = np.arange(index.shape[1])

    def agrees(candidate: npt.NDArray[Any]) -> BoolMap:
        there = columns - first - candidate
        seen: BoolMap = (there >= 0) & (there < index.shape[1])
        answer = np.take_along_axis(right, np.clip(there, 0, index.shape[1] - 1), axis=1)
        close: BoolMap = np.abs(answer - candidate) <= tolerance
        return seen & close

    possible = np.zeros(index.shape, bool)
    for candidate in range(count):
        possible |= agrees(np.full(index.shape, candidate, np.int32))
    failed = (index >= 0) & ~agrees(index)
    flags = np.zeros(index.shape, np.uint8)
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


def texture_of_noise(deviation: float, window: tuple[int, int]) -> float:
    r"""The mean gradient that noise alone stays under: its expectation and three standard errors.

    For independent Gaussian noise of deviation :math:`\sigma`, ``|I(x + 1) - I(x - 1)| / 2`` has the mean
    :math:`\sigma / \sqrt{\pi}`, and its mean over n pixels the relative standard error
    :math:`\sqrt{(\pi - 2) / n}`, if every second pixel of the window is counted as a repetition.

    Parameters
    ----------
    deviation : float
        Grey levels.
    window : (width, height)
    """
    error = np.sqrt((np.pi - 2) / (window[0] * window[1]))
    return float(deviation / np.sqrt(np.pi) * (1 + 3 * error))


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
