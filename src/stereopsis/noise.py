"""Noise: how much of an image's grey levels is not the scene's."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis import _core
from stereopsis._numbers import quantile

BLOCK = 16
"""Side of a block in pixels."""

SMOOTHEST = 0.2
"""Fraction of the blocks that are taken to hold no texture."""


def deviation(image: npt.NDArray[Any], threads: int = 0) -> float:
    r"""Standard deviation of an image's noise.

    In blocks of 16 x 16 pixels, :math:`\sqrt{\pi / 2} / 6` times the mean magnitude of the response to the
    mask (1, -2, 1; -2, 4, -2; 1, -2, 1), which is blind to ramps along rows and columns [1]_. Texture raises
    it, so the value is taken that a fifth of the blocks do not exceed; constant blocks, saturated ones for
    example, are left out.

    Parameters
    ----------
    image : ndarray of any real dtype, (H, W) or (H, W, C)
    threads : int
        0: all cores. Never changes the answer.

    Returns
    -------
    float
        In the image's grey levels; of colour images, of one channel. 0 for an image with fewer than three
        rows or columns.

    References
    ----------
    .. [1] J. Immerkær, Fast noise variance estimation, Computer Vision and Image Understanding 64(2), 1996,
       doi:10.1006/cviu.1996.0060.
    """
    return deviation_of(block_means(image, threads=threads))


def block_means(image: npt.NDArray[Any], height: int = BLOCK, threads: int = 0) -> npt.NDArray[np.float64]:
    """Mean magnitude of the response in each block of so many rows, or fewer in a small image, (N,).

    Bands of an image, each with two rows more than its blocks need, give the blocks of the whole.
    """
    pixels = np.ascontiguousarray(image if image.ndim == 3 else image[..., None], np.float32)
    within = pixels.shape[0] - 2, pixels.shape[1] - 2
    if min(within) < 1:
        return np.empty(0)
    height, width = min(height, within[0]), min(BLOCK, within[1])
    means = np.empty((within[0] // height, within[1] // width, pixels.shape[2]))
    _core.noise_means(pixels, height, width, means, threads)
    return means.ravel()


def deviation_of(means: npt.NDArray[np.float64]) -> float:
    """The deviation that these blocks speak for."""
    means = means[means > 0]
    return float(np.sqrt(np.pi / 2) / 6 * quantile(means, SMOOTHEST)) if means.size else 0.0
