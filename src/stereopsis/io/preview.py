"""Disparity maps as colour pictures."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from stereopsis import colormaps
from stereopsis.io._errors import StrPath
from stereopsis.io.disparity import check_disparity
from stereopsis.io.images import write_image
from stereopsis.types import DisparityMap


def colorize(disparity: DisparityMap, range: tuple[float, float] | None = None) -> npt.NDArray[np.uint8]:
    """Colours for disparities, from viridis: dark blue is far, yellow is near, light grey is invalid.

    Parameters
    ----------
    disparity : ndarray of floats, (H, W)
        In pixels; NaN where invalid.
    range : (float, float), optional
        The disparities of the first and the last colour; what lies outside gets the nearest one. By default
        the 1st and the 99th percentile of the valid pixels.

    Returns
    -------
    ndarray of uint8, (H, W, 3)
        RGB.

    Raises
    ------
    TypeError, ValueError
        `disparity` is not a map of floats, or `range` is not two finite numbers in order.
    """
    disparity = check_disparity(disparity)
    return colormaps.colours(disparity, colormaps.limits(disparity, range))


def write_preview(
    path: StrPath,
    disparity: DisparityMap,
    range: tuple[float, float] | None = None,
) -> None:
    """Write a colour picture of a disparity map, beside it a colour bar with numbers, whole or not at all.

    Parameters
    ----------
    path : str or path-like
        The file, ``.png``, ``.jpg``, ``.tif`` or ``.ppm``; an existing one is replaced.
    disparity, range
        See `colorize`.

    Raises
    ------
    TypeError, ValueError
        As `colorize`; or the suffix is another.
    OSError
        The file cannot be written.
    """
    disparity = check_disparity(disparity)
    limits = colormaps.limits(disparity, range)
    write_image(path, _with_bar(colormaps.colours(disparity, limits), limits))


def _with_bar(picture: npt.NDArray[np.uint8], limits: tuple[float, float]) -> npt.NDArray[np.uint8]:
    """`picture` with a colour bar at its right, the near end at the top."""
    from PIL import Image, ImageDraw, ImageFont

    low, high = limits
    height, width = picture.shape[:2]
    size = min(max(height // 28, 12), 64)  # of the letters, in pixels
    font = ImageFont.load_default(size)
    labels = colormaps.ticks(low, high)
    reach = math.ceil(max(font.getlength(text) for _, text in [*labels, (0.0, "px")]))
    canvas_height = max(height, 12 * size)
    top, bottom = 2 * size, canvas_height - size  # of the bar
    left, right = width + size, width + 2 * size
    canvas = Image.new("RGB", (right + size + reach, canvas_height), "white")
    canvas.paste(Image.fromarray(picture), (0, (canvas_height - height) // 2))
    bar = colormaps.VIRIDIS[np.linspace(255, 0, bottom - top).astype(np.uint8)]
    canvas.paste(Image.fromarray(np.repeat(bar[:, None], right - left, axis=1)), (left, top))
    draw = ImageDraw.Draw(canvas)
    draw.text((left, top - size / 2), "px", "black", font, anchor="lb")
    for value, text in labels:
        y = round(bottom - 1 - (value - low) / (high - low) * (bottom - 1 - top))
        draw.line((right, y, right + size // 4, y), "black", max(size // 12, 1))
        draw.text((right + size // 2, y), text, "black", font, anchor="lm")
    return np.asarray(canvas)
