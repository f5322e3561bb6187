"""Disparity maps as colour pictures."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from stereopsis.io._errors import StrPath
from stereopsis.io.disparity import check_disparity
from stereopsis.io.images import write_image
from stereopsis.types import DisparityMap

INVALID = (205, 205, 205)
"""The colour of invalid pixels."""

# The red, green and blue of viridis as polynomials in t = 0 … 1, fitted by least squares to its table (S.
# van der Walt and N. Smith 2015, CC0, https://bids.github.io/colormap/): within 5 of 255. It is even in
# lightness, and readable with any colour vision.
_VIRIDIS = (
    (0.274, 0.006, 0.333),
    (0.108, 1.396, 1.387),
    (-0.327, 0.215, 0.092),
    (-4.6, -5.758, -19.292),
    (6.204, 14.154, 56.656),
    (4.752, -13.749, -65.321),
    (-5.432, 4.642, 26.272),
)


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
    return _colours(disparity, _limits(disparity, range), _table())


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
    limits = _limits(disparity, range)
    table = _table()
    write_image(path, _with_bar(_colours(disparity, limits, table), limits, table))


def _limits(disparity: DisparityMap, range: tuple[float, float] | None) -> tuple[float, float]:
    if range is not None:
        low, high = (float(limit) for limit in range)
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise ValueError(f"range must be two finite numbers in order, not {range}")
        return low, high
    valid = disparity[~np.isnan(disparity)].astype(np.float64)
    low, high = (float(limit) for limit in np.percentile(valid, (1, 99))) if valid.size else (0.0, 1.0)
    # Below this float32 cannot tell the limits apart.
    least = 1e-6 * max(abs(low), abs(high), 1.0)
    return (low, high) if high - low > least else (low - max(least, 0.5), low + max(least, 0.5))


def _table() -> npt.NDArray[np.uint8]:
    powers = np.linspace(0, 1, 256)[:, None] ** np.arange(len(_VIRIDIS))
    colours: npt.NDArray[np.float64] = powers @ np.array(_VIRIDIS)
    return np.rint(255 * np.clip(colours, 0, 1)).astype(np.uint8)


def _colours(
    disparity: DisparityMap, limits: tuple[float, float], table: npt.NDArray[np.uint8]
) -> npt.NDArray[np.uint8]:
    low, high = limits
    index = np.clip((disparity.astype(np.float64) - low) * (255 / (high - low)), 0, 255)
    valid = ~np.isnan(index)
    picture = table[np.rint(np.where(valid, index, 0)).astype(np.uint8)]
    picture[~valid] = INVALID
    return picture


def _with_bar(
    picture: npt.NDArray[np.uint8], limits: tuple[float, float], table: npt.NDArray[np.uint8]
) -> npt.NDArray[np.uint8]:
    """`picture` with a colour bar at its right, the near end at the top."""
    from PIL import Image, ImageDraw, ImageFont

    low, high = limits
    height, width = picture.shape[:2]
    size = min(max(height // 28, 12), 64)  # of the letters, in pixels
    font = ImageFont.load_default(size)
    labels = _ticks(low, high)
    reach = math.ceil(max(font.getlength(text) for _, text in [*labels, (0.0, "px")]))
    canvas_height = max(height, 12 * size)
    top, bottom = 2 * size, canvas_height - size  # of the bar
    left, right = width + size, width + 2 * size
    canvas = Image.new("RGB", (right + size + reach, canvas_height), "white")
    canvas.paste(Image.fromarray(picture), (0, (canvas_height - height) // 2))
    bar = table[np.linspace(255, 0, bottom - top).astype(np.uint8)]
    canvas.paste(Image.fromarray(np.repeat(bar[:, None], right - left, axis=1)), (left, top))
    draw = ImageDraw.Draw(canvas)
    draw.text((left, top - size / 2), "px", "black", font, anchor="lb")
    for value, text in labels:
        y = round(bottom - 1 - (value - low) / (high - low) * (bottom - 1 - top))
        draw.line((right, y, right + size // 4, y), "black", max(size // 12, 1))
        draw.text((right + size // 2, y), text, "black", font, anchor="lm")
    return np.asarray(canvas)


def _ticks(low: float, high: float) -> list[tuple[float, str]]:
    """Four to eleven round numbers from `low` to `high`, with their text."""
    rough = (high - low) / 4
    power = 10.0 ** math.floor(math.log10(rough))
    step = power * max(factor for factor in (1, 2, 5) if factor * power <= rough)
    decimals = max(0, -math.floor(math.log10(step)))
    numbers = np.arange(math.ceil(low / step), math.floor(high / step) + 1) * step + 0.0  # no "-0"
    return [(float(number), f"{number:.{decimals}f}") for number in numbers]
