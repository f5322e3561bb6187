"""Refine: from whole candidates to disparities between them; confidence; median."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis import _core
from stereopsis.types import DisparityMap


def _neighbours(
    cost: npt.NDArray[Any], before: npt.NDArray[Any], after: npt.NDArray[Any]
) -> tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[np.bool_]]:
    """The winner's and both neighbours' costs; and where there are two neighbours.

    Costs are 0 where nothing is in view; at an end of the range the one neighbour stands for the other.
    """
    none = np.iinfo(cost.dtype).max if cost.dtype.kind == "i" else np.inf
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


def median(disparity: DisparityMap, size: int, threads: int = 0) -> DisparityMap:
    """Median over those of ``size x size`` pixels that have a value.

    Invalid pixels stay invalid. At borders the window is what lies inside the map.
    """
    filtered = np.empty(disparity.shape, np.float32)
    _core.median(np.ascontiguousarray(disparity), size, filtered, threads)
    return filtered
