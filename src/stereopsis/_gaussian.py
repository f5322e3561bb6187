"""The filter of the streaming Gaussian windows: how far apart its knots are, and what is done between them.

A cubic B-spline gathers pixels into knots `stride` pixels apart, `taps` run over the knots, and a cubic B-spline
spreads them over the pixels again (Unser, Aldroubi & Eden 1993, doi:10.1109/78.193220). The taps are the least
squares solution for which the three together, at every place of a pixel between its knots, are the Gaussian.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from stereopsis import _core

_F64 = npt.NDArray[np.float64]

TOLERANCE = 2e-3
"""Sum of the absolute differences of a one-dimensional kernel from its definition, at most."""

_STEPS = 2.0**30


class Filter(NamedTuple):
    """Stride in pixels, and taps: the middle one and those of one side."""

    stride: int
    taps: _F64


def gaussian(sigma: float, truncate: float) -> _F64:
    """Weights ``exp(-i^2 / (2 sigma^2))`` for ``0 <= i <= round(truncate * sigma)``, of sum 1 over both sides."""
    i = np.arange(round(truncate * sigma) + 1)
    weights: _F64 = np.exp(-(i**2) / (2.0 * sigma**2))
    return weights / (weights[0] + 2 * weights[1:].sum())


@lru_cache(maxsize=64)
def filter_of(sigma: float, truncate: float) -> Filter:
    """The filter with the largest stride, up to half of sigma, that keeps to `TOLERANCE`."""
    for stride in range(min(int(sigma / 2), _core.largest_stride), 1, -1):
        found = Filter(stride, _fit(gaussian(sigma, truncate), stride))
        if abs(kernels(found) - _definition(found, sigma, truncate)).sum(axis=1).max() <= TOLERANCE:
            return found
    return Filter(1, gaussian(sigma, truncate))


def kernels(chosen: Filter) -> _F64:
    """What a window's pixels really weigh.

    Returns
    -------
    ndarray, (stride, N)
        A row for each place of a pixel between its knots, N odd, the pixel itself in the middle.
    """
    half = chosen.taps[1:]
    return _responses(chosen.stride, len(half)) @ np.concatenate([chosen.taps[:1], half])


def _definition(chosen: Filter, sigma: float, truncate: float) -> _F64:
    """The Gaussian, as wide as `kernels`."""
    side = gaussian(sigma, truncate)
    wide = np.zeros(kernels(chosen).shape[1])
    middle, reach = len(wide) // 2, len(side) - 1
    if middle < reach:
        raise ValueError("the filter is narrower than the Gaussian")
    wide[middle : middle + reach + 1] = side
    wide[middle - reach : middle + 1] = side[::-1]
    return wide


def _spline(stride: int) -> _F64:
    """Weights of a discrete cubic B-spline, of sum 1."""
    box = np.ones(stride) / stride
    twice = np.convolve(box, box)
    return np.convolve(twice, twice)


def _responses(stride: int, reach: int, width: int = 0) -> npt.NDArray[np.float64]:
    """Kernels, (stride, N, reach + 1), that each tap makes by itself; N is at least ``2 width + 1``."""
    spline = _spline(stride)
    spread = 2 * (stride - 1)
    middle = max(stride * (reach + 2) + spread, width)
    responses = np.zeros((stride, 2 * middle + 1, reach + 1))
    for place in range(stride):
        for knot in range(-1, 3):
            away = place - stride * knot + spread
            if stride == 1 and knot or not 0 <= away < len(spline):
                continue
            for tap in range(-reach, reach + 1):
                start = middle + stride * (knot + tap) - place - spread
                responses[place, start : start + len(spline), abs(tap)] += stride * spline[away] * spline
    return responses


def _fit(side: _F64, stride: int) -> _F64:
    """Taps, of sum 1 over both sides, whose kernels are nearest to the one of the given side."""
    width = len(side) - 1
    reach = max(1, -(-width // stride) - 1)
    responses = _responses(stride, reach, width)
    middle = responses.shape[1] // 2
    wanted = np.zeros(responses.shape[1])
    wanted[middle : middle + width + 1] = side
    wanted[middle - width : middle + 1] = side[::-1]
    equations = responses.reshape(-1, reach + 1)
    # The middle tap is what the others leave of 1.
    free = equations[:, 1:] - 2 * equations[:, :1]
    target = np.tile(wanted, stride) - equations[:, 0]
    found = np.linalg.solve(free.T @ free, free.T @ target)
    # Rounded, so that the last digits of one machine's linear algebra make no difference.
    found = np.rint(found * _STEPS) / _STEPS
    return np.concatenate([[1 - 2 * found.sum()], found])
