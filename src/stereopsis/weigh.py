"""Weigh: costs over support windows beyond the box, from pixels to the cost volume in one stage.

Weights sum to 1, so all costs are those of means; they are accumulated in float64. Edge pixels are repeated
past the image's edge, but crosses end there. Only every `step`-th pixel and every `disparity_step`-th
candidate is computed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis import _core, _instructions
from stereopsis.supports import Adaptive, Bilateral, Cross, Gaussian, Support, window_size
from stereopsis.types import EVERY, Disparities, Halo, Sampling

KINDS = ("sad", "ssd", "zsad", "zssd", "ncc", "zncc")
"""In the core's order."""

Volume = npt.NDArray[np.float32]


def halo(support: Support) -> Halo:
    """What a cost over a support depends on, in both images."""
    match support:
        case Gaussian():
            return Halo.around(support.radius)
        case Bilateral():
            return Halo.box(window_size(support.size))
        case Cross():
            # A region's columns are arms of the pixels on its own arm; every arm looks as far as it goes.
            return Halo.around(support.arm + 1)
        case Adaptive():
            return Halo.box(support.size).then(Halo.around(1, 0))


def volume(
    support: Support,
    kind: str,
    left: npt.NDArray[Any],
    right: npt.NDArray[Any],
    unit: float,
    disparities: Disparities,
    sampling: Sampling = EVERY,
    threads: int = 0,
) -> Volume:
    r"""Costs over a support.

    With weights :math:`w` that sum to 1, :math:`L, R` the two windows, :math:`\bar L = \sum w L` and
    :math:`\bar R = \sum w R`:

    - SAD :math:`\sum w |L - R|`, SSD :math:`\sum w (L - R)^2`
    - ZSAD :math:`\sum w |L - \bar L - R + \bar R|`, ZSSD :math:`\sum w (L - \bar L - R + \bar R)^2`
    - NCC :math:`-\sum w L R / \sqrt{\sum w L^2 \sum w R^2}`
    - ZNCC :math:`-\sum w (L - \bar L)(R - \bar R) / \sqrt{\sum w (L - \bar L)^2 \sum w (R - \bar R)^2}`

    A correlation with a window that has no norm is 0; no norm, and for ZSSD no deviation, is what is under
    :math:`10^{-12}` of the mean square. Of a colour image the sums run over the channels, each with its own
    mean.

    Parameters
    ----------
    support : Gaussian, Bilateral, Cross or Adaptive
    kind : str
        One of `KINDS`.
    left, right : ndarray of uint8 or int32, (H, W, C)
    unit : float
        What one unit of the pixels is worth in grey levels.
    disparities : Disparities
    sampling : Sampling
    threads : int
        0: all cores.

    Returns
    -------
    ndarray of float32, (ceil(H / step), ceil(W / step), ceil(span / disparity_step))
        In units of the pixels. Infinity where the candidate lies outside the right image.
    """
    left, right = (np.ascontiguousarray(image, np.int32) for image in (left, right))
    step, disparity_step = sampling
    sides = left.shape[0], left.shape[1]
    costs = np.empty(
        (*(-(-side // step) for side in sides), -(-disparities.span // disparity_step)), np.float32
    )
    common = left, right, disparities.min, KINDS.index(kind), step, disparity_step
    rest = costs, threads, _instructions.forced()
    match support:
        case Gaussian():
            _core.separable_costs(*common, gaussian_taps(support), *rest)
        case Bilateral():
            width, height = window_size(support.size)
            sigma_colour = support.sigma_colour / unit
            _core.bilateral_costs(*common, width, height, support.sigma_space, sigma_colour, *rest)
        case Cross():
            _core.reach_costs(*common, True, cross_arms(left, support, unit, threads), *rest)
        case Adaptive():
            _core.reach_costs(*common, False, adaptive_reach(left, support, unit), *rest)
    return costs


def gaussian_taps(support: Gaussian) -> npt.NDArray[np.float64]:
    """The weights of one axis, from ``-radius`` to ``radius``."""
    offsets = np.arange(-support.radius, support.radius + 1)
    weights = np.exp(-0.5 * (offsets / support.sigma) ** 2)
    return np.asarray(weights / weights.sum(), np.float64)


def cross_arms(
    image: npt.NDArray[np.int32], support: Cross, unit: float = 1.0, threads: int = 0
) -> npt.NDArray[np.int32]:
    """Arms to the left, to the right, up and down from each pixel.

    Parameters
    ----------
    image : ndarray of int32, (H, W, C)
    support : Cross
    unit : float
        What one unit of the pixels is worth in grey levels.
    threads : int

    Returns
    -------
    ndarray of int32, (H, W, 4)
        Pixels.
    """
    arms = np.empty((*image.shape[:2], 4), np.int32)
    _core.cross_arms(image, support.arm, support.threshold / unit, arms, threads)
    return arms


def adaptive_reach(
    image: npt.NDArray[np.int32], support: Adaptive, unit: float = 1.0
) -> npt.NDArray[np.int32]:
    """How far each pixel's box reaches to the left, to the right, up and down.

    Of a colour image a pixel counts with the mean over the channels.

    Parameters
    ----------
    image : ndarray of int32, (H, W, C)
    support : Adaptive
    unit : float
        What one unit of the pixels is worth in grey levels.

    Returns
    -------
    ndarray of int32, (H, W, 4)
        Pixels.
    """
    beside = np.pad(image, ((0, 0), (1, 1), (0, 0)), mode="edge").astype(np.float64)
    square = ((beside[:, 2:] - beside[:, :-2]) * (unit / 2)) ** 2
    counted = (square / (square + float(support.gradient) ** 2)).mean(axis=2)
    # Millionths, so that the sums are exact, and the choice the same on every machine.
    counts = np.rint(counted * 1e6).astype(np.int64)
    width, height = support.size
    left, above = width // 2, height // 2
    padded = np.pad(counts, ((above + 1, height - 1 - above), (left + 1, width - 1 - left)), mode="edge")
    padded[0], padded[:, 0] = 0, 0
    total = padded.cumsum(axis=0).cumsum(axis=1)

    rows, columns = counts.shape
    reach = np.empty((rows, columns, 4), np.int32)
    undecided = np.ones((rows, columns), bool)
    for w, h in support.sizes:
        box = w // 2, w - 1 - w // 2, h // 2, h - 1 - h // 2
        top, bottom = above - box[2], above + box[3] + 1
        begin, end = left - box[0], left + box[1] + 1
        upper, lower = total[top : top + rows], total[bottom : bottom + rows]
        count = (lower[:, end : end + columns] - lower[:, begin : begin + columns]) - (
            upper[:, end : end + columns] - upper[:, begin : begin + columns]
        )
        reach[undecided] = box
        undecided &= count < float(support.pixels) * 1e6
    return reach
