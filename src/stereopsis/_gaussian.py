"""The filter of the streaming Gaussian windows: how far apart its knots are, and what is done between them.

A cubic B-spline gathers pixels into knots `stride` pixels apart, `taps` run over the knots, and a cubic
B-spline spreads them over the pixels again (Unser, Aldroubi & Eden 1993, doi:10.1109/78.193220). The taps are
the least squares solution for which the three together, at every place of a pixel between its knots, are the
Gaussian.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from stereopsis import _core
from stereopsis.types import Halo

_F64 = npt.NDArray[np.float64]

TOLERANCE = 1.5e-3
"""Sum of the absolute differences of a kernel from the Gaussian, of sum 1, along one axis: at most this."""

_STEPS = 2.0**30


class Filter(NamedTuple):
    """Stride in pixels, and taps: the middle one and those of one side."""

    stride: int
    taps: _F64


def halo(sigma: float, truncate: float) -> Halo:
    """What a window's sums depend on, of images that begin at a knot: taps, and a spline on either side."""
    chosen = filter_of(sigma, truncate)
    return Halo.around((len(chosen.taps) + 3) * chosen.stride)


def gaussian(sigma: float, truncate: float) -> _F64:
    """``exp(-i^2 / (2 sigma^2))``, ``0 <= i <= round(truncate * sigma)``, of sum 1 over both sides."""
    i = np.arange(round(truncate * sigma) + 1)
    weights: _F64 = np.exp(-(i**2) / (2.0 * sigma**2))
    side: _F64 = weights / (weights[0] + 2 * weights[1:].sum())
    return side


@lru_cache(maxsize=64)
def filter_of(sigma: float, truncate: float) -> Filter:
    """The filter of the largest stride that keeps to `TOLERANCE`."""
    side = gaussian(sigma, truncate)
    for stride in range(min(int(sigma / 1.25), _core.largest_stride), 1, -1):
        found = fit(side, stride)
        if abs(errors(found, side)).sum(axis=1).max() <= TOLERANCE:
            return found
    return Filter(1, side)


def fit(side: _F64, stride: int) -> Filter:
    """The filter of a stride whose kernels are nearest to the one that has `side` from its middle on."""
    reach = max(1, -(-(len(side) - 1) // stride) - 1)
    equations, wanted = _equations(side, stride, reach)
    equations, wanted = equations.reshape(-1, reach + 1), np.tile(wanted, len(equations))
    # The middle tap is what the others leave of 1.
    free, target = equations[:, 1:] - 2 * equations[:, :1], wanted - equations[:, 0]
    found = np.linalg.solve(free.T @ free, free.T @ target)
    # Rounded, so that the last digits of one machine's linear algebra make no difference.
    found = np.rint(found * _STEPS) / _STEPS
    return Filter(stride, np.concatenate([[1 - 2 * found.sum()], found]))


def errors(chosen: Filter, side: _F64) -> _F64:
    """How far the weights of a window's pixels are from those that have `side` from their middle on.

    Returns
    -------
    ndarray, (stride // 2 + 1, N)
        A row for each place of a pixel between its knots, but for mirror images.
    """
    equations, wanted = _equations(side, chosen.stride, len(chosen.taps) - 1)
    return equations @ chosen.taps - wanted


def _equations(side: _F64, stride: int, reach: int) -> tuple[npt.NDArray[np.float64], _F64]:
    """Kernels that each tap makes by itself, (stride // 2 + 1, N, reach + 1), and the wanted one, (N,)."""
    box = np.ones(stride) / stride
    spline = np.convolve(np.convolve(box, box), np.convolve(box, box))
    spread = 2 * (stride - 1)
    middle = max(stride * (reach + 2) + spread, len(side) - 1)
    kernels = np.zeros((stride // 2 + 1, 2 * middle + 1, reach + 1))
    for place in range(stride // 2 + 1):
        # From the knots' sums to a pixel `place` to the right of one; then from the pixels to the sums.
        by_itself = np.zeros(2 * (spread + 2 * stride) + 1)
        for knot in range(-1, 3):
            away = place - stride * knot + spread
            if 0 <= away < len(spline):
                start = 2 * stride + stride * knot - place
                by_itself[start : start + len(spline)] += stride * spline[away] * spline
        half = len(by_itself) // 2
        for tap in range(-reach, reach + 1):
            centre = middle + stride * tap
            lower, upper = max(centre - half, 0), min(centre + half + 1, 2 * middle + 1)
            kernels[place, lower:upper, abs(tap)] += by_itself[lower - centre + half : upper - centre + half]
    wanted = np.zeros(2 * middle + 1)
    wanted[middle : middle + len(side)] = side
    wanted[middle - len(side) + 1 : middle + 1] = side[::-1]
    return kernels, wanted
