"""Smooth along the edges of an image: weighted least squares, and the weighted median."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis import _core
from stereopsis.types import DisparityMap, Halo

SIGMA, SLOPE_SIGMA = 5.0, 20.0
"""Grey levels at which two neighbours hold together by 1 / e: their disparities, and their slopes."""
FILL_STRENGTH = 500.0
"""How strongly neighbours hold together where a hole is filled: over a reach of about its root, in pixels."""


def weighted_median_halo(size: int) -> Halo:
    """What `weighted_median` depends on, but for the step that the map's greatest value gives."""
    return Halo.box((size, size))


def edge_aware_halo(strength: float) -> Halo:
    """What hardly less than all of `edge_aware` depends on: four times its reach, where no edge ends it."""
    return Halo.around(int(4 * strength**0.5) + 8)


def edge_aware(
    disparity: DisparityMap,
    image: npt.NDArray[Any],
    strength: float = 3.0,
    sigma: float = SIGMA,
    iterations: int = 2,
    threads: int = 0,
) -> DisparityMap:
    r"""Weighted least squares along the image's edges, in linear time, from slanted surfaces.

    Along each row, then along each column, `iterations` times, the map u that minimises

    .. math:: \sum_i c_i (u_i - d_i)^2 + \lambda_t \sum_i w_i (u_{i+1} - u_i - s_i)^2

    to a good approximation: d less the running sum of s, times c, is smoothed by the tridiagonal system of
    [1]_, and divided by c smoothed alike. c is 1 where there is an answer, else 0; it becomes what the pass
    made of it. :math:`w_i = \exp(-\max |I_{i+1} - I_i| / \sigma)`, the largest difference of the channels;
    :math:`\lambda_t = \tfrac32\, 4^{T-t} / (4^T - 1)\, \lambda` in iteration t of T. s is the slope of
    the surface, measured on the map in cells of 4 x 4 pixels: without it a road would bend towards the
    fronto-parallel.

    Parameters
    ----------
    disparity : ndarray of float32, (H, W)
        NaN stays NaN, and does not count.
    image : ndarray of uint8 or int32, (H, W, C)
        The left image.
    strength : float
        :math:`\lambda`, up to 1e5. It reaches over about its root in pixels.
    sigma : float
        Grey levels, of 255.
    iterations : int
    threads : int

    Returns
    -------
    ndarray of float32, (H, W)

    References
    ----------
    .. [1] D. Min, S. Choi, J. Lu, B. Ham, K. Sohn, M. N. Do, Fast global image smoothing based on weighted
       least squares, IEEE TIP 23(12), 2014, doi:10.1109/TIP.2014.2366600.
    """
    smoothed = np.empty(disparity.shape, np.float32)
    _core.edge_aware(
        np.ascontiguousarray(disparity),
        guide_of(image),
        edge_tables(image, sigma),
        strength,
        iterations,
        smoothed,
        threads,
    )
    return smoothed


def weighted_median(
    disparity: DisparityMap,
    image: npt.NDArray[Any],
    size: int,
    sigma: float = 10.0,
    threads: int = 0,
) -> DisparityMap:
    r"""Median over ``size x size`` pixels, each counted as often as it looks like the middle one [1]_.

    The weight of a pixel is :math:`255 \max(0, 1 - \max |I - I_0| / (2.5 \sigma))^2`, the largest difference
    of the channels, and 1 at least: near :math:`\exp(-|I - I_0| / \sigma)`, in whole numbers. The answer is
    the least value whose weight together with that of all lesser values is half of the whole. Values count
    in steps of the finest power of two in which the map fits 15 bits (1/64 pixel up to 255); of those in the
    median's step the middle pixel stands for it, else the first of the window. Invalid pixels stay invalid
    and do not count; at borders the window is what lies inside the map.

    Parameters
    ----------
    disparity : ndarray of float32, (H, W)
    image : ndarray of uint8 or int32, (H, W, C)
        The left image.
    size : int
        Odd, in pixels; up to 11.
    sigma : float
        Grey levels, of 255; at least 0.4.
    threads : int

    Returns
    -------
    ndarray of float32, (H, W)

    References
    ----------
    .. [1] Z. Ma, K. He, Y. Wei, J. Sun, E. Wu, Constant time weighted median filtering for stereo matching
       and beyond, ICCV 2013, doi:10.1109/ICCV.2013.13.
    """
    bytes_ = image if image.dtype == np.uint8 else np.clip(image, 0, 255).astype(np.uint8)
    slope = min(round(16 * 255 / (2.5 * sigma)), 4080)
    filtered = np.empty(disparity.shape, np.float32)
    _core.weighted_median(
        np.ascontiguousarray(disparity), np.ascontiguousarray(bytes_), size, slope, filtered, threads
    )
    return filtered


def guide_of(image: npt.NDArray[Any]) -> npt.NDArray[np.int32]:
    """The image as the kernels take it."""
    return np.ascontiguousarray(image, np.int32)


def edge_tables(image: npt.NDArray[Any], sigma: float = SIGMA) -> npt.NDArray[np.float32]:
    """Weights by difference, (2, levels): of disparities and of slopes; at least 1e-6."""
    levels = _levels(image)
    return np.maximum(np.exp([-levels / sigma, -levels / SLOPE_SIGMA]), 1e-6).astype(np.float32)


def _levels(image: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    return np.arange(256 if image.dtype == np.uint8 else 65536, dtype=np.float64)
