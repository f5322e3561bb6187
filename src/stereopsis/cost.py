"""Cost: what two pixels, and from them two windows, have to do with each other.

A window of the left image at ``(x, y)`` is compared with the one of the right image at ``(x - d, y)``. Both
images go on past their edges by repeating the edge pixel. The arithmetic starts from integers: 8- and 16-bit
pixels as they are, float pixels as 21-bit fixed point.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stereopsis import _core, _instructions
from stereopsis.types import Disparities, Halo, Image

FLOAT_BITS = 21
FRACTION = 1 / 255
"""A grey level of float images from 0 to 1."""
KINDS = ("sad", "ssd", "zsad", "zssd", "ncc", "zncc")
"""In the core's order."""


class Pixels(NamedTuple):
    """A pair as the core takes it.

    Attributes
    ----------
    left, right : ndarray, (H, W, C)
        Contiguous; uint8, or int32.
    step : float
        What one unit is worth in the image's own grey levels: 1, but for float images and for bytes that
        came in another type (`stereopsis.quantum`).
    limits : (int, int) or None
        Least and greatest pixel of both images where these are parts of larger ones. None: their own.
    """

    left: npt.NDArray[Any]
    right: npt.NDArray[Any]
    step: float
    limits: tuple[int, int] | None = None

    @property
    def level(self) -> float:
        """Grey levels in one unit: the image's own, but of 255 where float images run from 0 to 1.

        They are taken to where they stay below 2.
        """
        dark = self.step <= 2.0 ** (1 - FLOAT_BITS) or self.step == FRACTION
        return 255 * self.step if dark else self.step


def halo(window: tuple[int, int]) -> Halo:
    """What a cost over a box depends on, in both images."""
    return Halo.box(window)


def pixels(
    left: Image, right: Image, channels: str = "grey", threads: int = 0, largest: float | None = None
) -> Pixels:
    """Integer pixels of a pair of images, of colour images as one grey channel or as three.

    8-bit images stay uint8, 16-bit ones become int32. Float images are scaled by the power of two that lets
    the larger magnitude of the two images, or `largest`, just fit `FLOAT_BITS` bits, and rounded.
    """
    integers = _integers(left, right, largest)
    if channels == "separate" or left.ndim == 2:
        return integers
    return Pixels(grey(integers.left, threads), grey(integers.right, threads), integers.step)


def grey(rgb: npt.NDArray[Any], threads: int = 0) -> npt.NDArray[Any]:
    """``0.299 R + 0.587 G + 0.114 B`` in 15-bit fixed point, to the bytes that OpenCV gives.

    Parameters
    ----------
    rgb : ndarray of uint8 or int32, (H, W, 3)

    Returns
    -------
    ndarray of the same dtype, (H, W, 1)
    """
    out = np.empty((*rgb.shape[:2], 1), rgb.dtype)
    _core.grey(rgb, out, threads, _instructions.forced())
    return out


def _integers(left: Image, right: Image, largest: float | None) -> Pixels:
    if left.dtype == np.uint8:
        return Pixels(_channels(left, np.uint8), _channels(right, np.uint8), 1.0)
    if left.dtype == np.uint16:
        return Pixels(_channels(left, np.int32), _channels(right, np.int32), 1.0)
    if largest is None:
        largest = max(float(np.abs(left).max()), float(np.abs(right).max()))
    exponent = FLOAT_BITS - int(np.frexp(largest)[1]) if largest > 0 else 0
    # Exact in single precision, apart from what then rounds to 0; but such a power may lie beyond it.
    power = np.ldexp(np.float32(1) if abs(exponent) < 127 else np.float64(1), exponent)

    def fixed(image: Image) -> npt.NDArray[np.int32]:
        scaled = image * power
        # The largest value may round up to the next power of two, which the sums' bounds allow for.
        return _channels(np.rint(scaled, out=scaled), np.int32)

    return Pixels(fixed(left), fixed(right), float(np.ldexp(1.0, -exponent)))


def _channels(image: npt.NDArray[Any], dtype: Any) -> npt.NDArray[Any]:
    return np.ascontiguousarray(image if image.ndim == 3 else image[..., None], dtype=dtype)


def fits_narrow(window: tuple[int, int], channels: int) -> bool:
    """Whether 8-bit sums over the window fit 32 bits: at most 32 896 pixels, all channels counted."""
    return bool(window[0] * window[1] * channels <= _core.narrow_limit)


def dtype_of(kind: str) -> npt.DTypeLike:
    """The type of a cost: integer where the cost is one."""
    if kind not in KINDS:
        return np.uint16
    return np.int64 if kind in ("sad", "ssd") else np.float32


def terms(
    kind: str, pair: Pixels, disparities: Disparities, window: tuple[int, int], threads: int = 0
) -> npt.NDArray[np.int64]:
    """What the window sums, for every pixel that it reaches and every candidate.

    Parameters
    ----------
    kind : str
        "sad": ``sum_c |l - r|``; any other: ``sum_c l r``, from which, with the windows' own sums and
        squares, all squared costs and correlations follow.
    pair : Pixels
    disparities : Disparities
        D candidates.
    window : (width, height)
    threads : int

    Returns
    -------
    ndarray of int64, (H + height - 1, W + width - 1, D)
    """
    rows, columns = pair.left.shape[:2]
    out = np.empty((rows + window[1] - 1, columns + window[0] - 1, disparities.span), np.int64)
    left, right = (np.ascontiguousarray(image, np.int32) for image in pair[:2])
    _core.terms(left, right, disparities.min, *window, int(kind == "sad"), out, threads)
    return out


def score(
    kind: str,
    sums: npt.NDArray[np.int64],
    pair: Pixels,
    disparities: Disparities,
    window: tuple[int, int],
    threads: int = 0,
) -> npt.NDArray[Any]:
    r"""Costs from window sums.

    With :math:`n` pixels in the window, :math:`L, R` the two windows, :math:`\bar L, \bar R` their means:

    - SAD :math:`\sum |L - R|`, SSD :math:`\sum (L - R)^2`
    - ZSSD :math:`\sum (L - \bar L - R + \bar R)^2`
    - NCC :math:`-\sum L R / \sqrt{\sum L^2 \sum R^2}`
    - ZNCC :math:`-\sum (L - \bar L)(R - \bar R) / \sqrt{\sum (L - \bar L)^2 \sum (R - \bar R)^2}`

    A correlation with a window that has no norm is 0. Of a colour image the sums run over the channels, each
    with its own mean.

    Returns
    -------
    ndarray, (H, W, D)
        int64 for SAD and SSD, else float32. A candidate outside the right image costs the type's largest
        value, or infinity.
    """
    costs = np.empty(sums.shape, dtype_of(kind))
    narrow = pair.left.dtype == np.uint8 and fits_narrow(window, pair.left.shape[2])
    left, right = (np.ascontiguousarray(image, np.int32) for image in pair[:2])
    _core.score(left, right, disparities.min, *window, KINDS.index(kind), narrow, sums, costs, threads)
    return costs


def zsad(
    pair: Pixels, disparities: Disparities, window: tuple[int, int], threads: int = 0
) -> npt.NDArray[np.float32]:
    r"""ZSAD :math:`\sum |L - \bar L - R + \bar R|`, float32, (H, W, D); infinity outside the right image.

    Its terms depend on the window that they are summed over, so it does not go through `terms`.
    """
    rows, columns = pair.left.shape[:2]
    costs = np.empty((rows, columns, disparities.span), np.float32)
    left, right = (np.ascontiguousarray(image, np.int32) for image in pair[:2])
    _core.score_zsad(left, right, disparities.min, *window, costs, threads)
    return costs
