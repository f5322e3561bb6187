"""Pixel locking: whether disparities prefer whole numbers, and how the error goes with the phase."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis._numbers import is_whole
from stereopsis.types import DisparityMap

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class PixelLocking:
    """What `pixel_locking` found, by phase: the distance to the nearest whole disparity.

    Attributes
    ----------
    phase : ndarray of float64, (bins,)
        The middles of the bins, from -0.5 to 0.5 pixels.
    share : ndarray of float64, (bins,)
        Share of the disparities whose own phase lies in the bin; NaN where there are none at all.
    bias : ndarray of float64, (bins,)
        Mean of disparity less truth, over pixels whose true phase lies in the bin; NaN where there are none.
    spread : ndarray of float64, (bins,)
        Root of the mean squared error of the same pixels.
    """

    phase: Floats
    share: Floats
    bias: Floats
    spread: Floats

    @property
    def strength(self) -> float:
        """The share that would have to move for all phases to be alike: 0 without locking, near 1 at most."""
        return float(0.5 * np.abs(self.share - 1 / self.share.size).sum())

    @property
    def swing(self) -> float:
        """From the least bias to the greatest, in pixels; NaN where no bin has any."""
        known = self.bias[np.isfinite(self.bias)]
        return float(known.max() - known.min()) if known.size else math.nan


def pixel_locking(
    disparity: DisparityMap,
    truth: npt.NDArray[Any] | None = None,
    mask: npt.NDArray[np.bool_] | None = None,
    *,
    bins: int = 21,
    within: float = 1.0,
) -> PixelLocking:
    """Histogram of fractional parts, and the error by the true fractional part [1]_.

    Parameters
    ----------
    disparity : ndarray of float32, (H, W)
        NaN where invalid.
    truth : ndarray of float32, (H, W), optional
        True disparities, NaN where unknown.
    mask : ndarray of bool, (H, W), optional
        Count only the pixels where it is True.
    bins : int
        At least 2. With an odd number whole disparities lie in the middle of a bin.
    within : float
        Bias and spread leave out errors of this many pixels and more: wrong matches, which have no phase.

    Returns
    -------
    PixelLocking

    Raises
    ------
    TypeError
        For what is no array of floats, or no mask of bool.
    ValueError
        For fewer than 2 bins, or shapes that differ.

    References
    ----------
    .. [1] M. Shimizu, M. Okutomi, Sub-pixel estimation error cancellation on area-based matching,
       IJCV 63(3), 2005, doi:10.1007/s11263-005-6878-5.

    Examples
    --------
    >>> import numpy as np
    >>> found = pixel_locking(np.array([[3.0, 4.0, 5.5]], np.float32), bins=3)
    >>> found.share.round(2).tolist()
    [0.0, 0.67, 0.33]
    """
    if not is_whole(bins) or bins < 2:
        raise ValueError(f"bins must be a whole number of at least 2, not {bins!r}")
    for name, array, kind in (("disparity", disparity, "f"), ("truth", truth, "f"), ("mask", mask, "b")):
        if array is None and name != "disparity":
            continue
        if not isinstance(array, np.ndarray) or array.dtype.kind != kind:
            what = getattr(array, "dtype", type(array).__name__)
            raise TypeError(f"{name} must be an array of {'bool' if kind == 'b' else 'floats'}, not {what}")
    for name, other in (("truth", truth), ("mask", mask)):
        if other is not None and other.shape != disparity.shape:
            raise ValueError(f"{name} must have the shape of disparity, {disparity.shape}, not {other.shape}")
    counted = np.isfinite(disparity) & (True if mask is None else mask)
    own = _bin(disparity[counted], bins)
    counts = np.bincount(own, minlength=bins)
    share = counts / counts.sum() if own.size else np.full(bins, math.nan)
    bias, spread = np.full(bins, math.nan), np.full(bins, math.nan)
    if truth is not None:
        true = truth[counted].astype(np.float64)
        error = disparity[counted] - true
        judged = np.abs(error) < within
        where, error = _bin(true[judged], bins), error[judged]
        pixels = np.bincount(where, minlength=bins)
        some = pixels > 0
        bias[some] = np.bincount(where, error, bins)[some] / pixels[some]
        spread[some] = np.sqrt(np.bincount(where, error * error, bins)[some] / pixels[some])
    return PixelLocking((np.arange(bins) + 0.5) / bins - 0.5, share, bias, spread)


def _bin(values: npt.NDArray[Any], bins: int) -> npt.NDArray[np.intp]:
    """Which bin the distance to the nearest whole number, -0.5 <= phase < 0.5 or thereabouts, lies in."""
    exact = values.astype(np.float64)
    phase = exact - np.floor(exact + 0.5)
    return np.clip(np.floor((phase + 0.5) * bins), 0, bins - 1).astype(np.intp)
