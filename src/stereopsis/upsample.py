"""Upsample: images with more columns, so that whole candidates are fractions of a pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis.types import Halo

INTERPOLATIONS = ("nearest", "linear", "cubic", "lanczos", "area")


HALO = Halo.around(4, 0)
"""What a column between two others depends on, in columns of the image."""


def columns(image: npt.NDArray[Any], factor: int, interpolation: str) -> npt.NDArray[Any]:
    r"""Put `factor` - 1 columns between every two.

    Column :math:`X` of the result is the image at :math:`x = X / \text{factor}`, so the image's own columns
    stay as they are. With :math:`s` the distance in pixels, a column weighs

    - nearest: 1 where :math:`-\frac12 < s \le \frac12`, the right one of two that are equally near;
    - area: the share of ``[x - 1 / (2 factor), x + 1 / (2 factor)]`` that its pixel covers;
    - linear: :math:`1 - |s|`;
    - cubic: Keys' kernel [1]_ with :math:`a = -\frac12`;
    - lanczos: :math:`\operatorname{sinc}(s) \operatorname{sinc}(s / 4)` over eight columns, their sum made 1.

    Parameters
    ----------
    image : ndarray of uint8 or int32, (H, W, C)
        It goes on past its edges by repeating the edge pixel.
    factor : int
        At least 1.
    interpolation : {"nearest", "linear", "cubic", "lanczos", "area"}

    Returns
    -------
    ndarray of the same dtype, (H, factor * (W - 1) + 1, C)
        Weighed in float64 and rounded, to even where between two; uint8 clipped to 0 ... 255.

    References
    ----------
    .. [1] R. Keys, Cubic convolution interpolation for digital image processing, IEEE TASSP 29(6), 1981,
       doi:10.1109/TASSP.1981.1163711.
    """
    height, width, channels = image.shape
    fine = np.empty((height, factor * (width - 1) + 1, channels), image.dtype)
    fine[:, ::factor] = image
    reach = 4
    padded = np.pad(image, ((0, 0), (reach - 1, reach), (0, 0)), mode="edge").astype(np.float64)
    for step in range(1, factor):
        weights = _weights(step / factor, factor, interpolation, reach)
        total = np.zeros((height, width - 1, channels))
        for tap, weight in enumerate(weights):
            if weight:
                total += weight * padded[:, tap : tap + width - 1]
        total = np.rint(total)
        fine[:, step::factor] = np.clip(total, 0, 255) if image.dtype == np.uint8 else total
    return fine


def _weights(at: float, factor: int, interpolation: str, reach: int) -> npt.NDArray[np.float64]:
    """Weights of the columns 1 - reach ... reach for a place `at` between columns 0 and 1."""
    distance = np.arange(1 - reach, reach + 1) - at
    s = np.abs(distance)
    weights: npt.NDArray[np.float64]
    match interpolation:
        case "nearest":
            weights = ((distance > -0.5) & (distance <= 0.5)).astype(np.float64)
        case "area":
            half = 0.5 / factor
            covered = np.minimum(distance + 0.5, half) - np.maximum(distance - 0.5, -half)
            weights = np.maximum(covered, 0) / (2 * half)
        case "linear":
            weights = np.maximum(1 - s, 0)
        case "cubic":
            near, far = 1.5 * s**3 - 2.5 * s**2 + 1, -0.5 * s**3 + 2.5 * s**2 - 4 * s + 2
            weights = np.where(s <= 1, near, np.where(s < 2, far, 0))
        case "lanczos":
            weights = np.where(s < reach, np.sinc(s) * np.sinc(s / reach), 0)
            weights /= weights.sum()
        case _:
            raise ValueError(
                f"interpolation must be one of {', '.join(INTERPOLATIONS)}, not {interpolation!r}"
            )
    return weights
