"""From light to grey levels: what lens, weather and sensor do to a picture, and never to the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis.scenes._noise import Floats32, normal, uniform

MIN_BLUR = 0.05
"""Pixels: a Gaussian of this standard deviation leaves its neighbours less than a float32 holds."""

LUMA = (0.299, 0.587, 0.114)
"""Weights of red, green and blue in grey (ITU-R BT.601), as most image libraries use them."""


@dataclass(frozen=True)
class Sensor:
    """How one of the two cameras sees; the arguments of `street` with the same names say what each one is."""

    view: int
    """0 is the left camera, 1 the right one: their noise and their rain are independent."""
    seed: int
    dtype: np.dtype[Any]
    gray: bool
    noise: float = 0.0
    gain: float = 1.0
    offset: float = 0.0
    gamma: float = 1.0
    vignetting: float = 0.0
    blur: float = 0.0
    rain: float = 0.0
    low_light: float = 0.0

    def picture(self, light: Floats32) -> npt.NDArray[Any]:
        """Return the image of (3, H, W) linear light, (H, W, 3) or (H, W); `light` is used up."""
        if self.low_light:
            light *= np.float32(1.0 - 0.45 * self.low_light)
        if self.blur > MIN_BLUR:
            light = _blurred(light, self.blur)
        if self.rain:
            _rain(light, self.rain, self.seed, self.view)
        if self.vignetting:
            light *= 1 - np.float32(self.vignetting) * _corner_distance(*light.shape[1:])
        # The display curve: a square root, close to sRGB and exact on every machine.
        levels = np.sqrt(np.clip(light, 0, 1))
        if self.gray:
            red, green, blue = (np.float32(w) * c for w, c in zip(LUMA, levels, strict=True))
            levels = (red + green + blue)[None]
        if self.gamma != 1.0:
            levels = np.power(levels.astype(np.float64), self.gamma).astype(np.float32)
        levels *= np.float32(255.0 * self.gain)
        levels += np.float32(self.offset)
        if self.noise or self.low_light:
            levels += self._noise(levels)
        np.clip(levels, 0, 255, out=levels)
        image = np.ascontiguousarray(levels[0] if self.gray else np.moveaxis(levels, 0, -1))
        if self.dtype == np.float32:
            return image
        scale = 255.0 if self.dtype == np.uint8 else 4095.0
        rounded: npt.NDArray[Any] = np.floor(image * np.float32(scale / 255.0) + np.float32(0.5)).astype(
            self.dtype
        )
        return rounded

    def _noise(self, levels: Floats32) -> Floats32:
        """Return noise of the picture's shape: a constant part, and in the dark the photons' own."""
        channels, height, width = levels.shape
        draw = normal(
            self.seed,
            self.view,
            np.arange(channels)[:, None, None],
            np.arange(height)[:, None],
            np.arange(width),
        )
        variance = np.float32(self.noise * self.noise)
        if self.low_light:
            # At the darkest, a third of full scale carries a standard deviation of some seven grey levels.
            photons = np.float32(0.5 * self.low_light) * np.clip(levels, 0, 255)
            draw *= np.sqrt(variance + photons + np.float32(4.0 * self.low_light))
        else:
            draw *= np.float32(self.noise)
        return draw


def _corner_distance(height: int, width: int) -> Floats32:
    """Return the squared distance from the middle, 1 in the corners, (H, W)."""
    y, x = np.arange(height) - 0.5 * (height - 1), np.arange(width) - 0.5 * (width - 1)
    squares = (y * y)[:, None] + (x * x)[None, :]
    return (squares / max(float(squares[0, 0]), 1.0)).astype(np.float32)


def _blurred(light: Floats32, sigma: float) -> Floats32:
    """Return light convolved with a Gaussian cut at four sigma; the border repeats its last pixel."""
    reach = int(np.ceil(4.0 * sigma))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    weights /= weights.sum()
    for axis in (1, 2):
        pad = [(0, 0), (0, 0), (0, 0)]
        pad[axis] = (reach, reach)
        padded = np.pad(light, pad, mode="edge")
        total = np.zeros_like(light)
        for k, weight in enumerate(weights):
            part = [slice(None), slice(None), slice(None)]
            part[axis] = slice(k, k + light.shape[axis])
            total += np.float32(weight) * padded[tuple(part)]
        light = total
    return light


def _rain(light: Floats32, amount: float, seed: int, view: int) -> None:
    """Lay a veil and three layers of slanted streaks over the light, in place."""
    _, height, width = light.shape
    light *= np.float32(1.0 - 0.35 * amount)
    light += np.float32(0.16 * amount) * np.float32(np.mean(light, dtype=np.float64))
    unit = width / 880.0
    y = np.arange(height, dtype=np.float64)[:, None] / unit
    x = np.arange(width, dtype=np.float64)[None, :] / unit
    for layer, (length, pitch, thick, bright) in enumerate(
        ((26.0, 5.0, 0.5, 0.16), (60.0, 11.0, 0.7, 0.22), (130.0, 27.0, 1.1, 0.28))
    ):
        slanted = x + (0.10 + 0.02 * layer) * y
        column = np.floor(slanted / pitch)
        key = (seed, view, layer)
        shifted = y / length + 7.0 * uniform(column, *key, 1)
        row = np.floor(shifted)
        centre = 0.2 + 0.6 * uniform(column, row, *key, 2)
        across = np.abs(slanted / pitch - column - centre) * pitch
        along = shifted - row
        wide = max(thick, 0.5 / unit)
        streak = np.clip(1.0 + 0.5 - across / wide, 0.0, 1.0) * (4.0 * along * (1.0 - along))
        present = uniform(column, row, *key, 3) < 0.75 * amount
        light += (np.float32(bright) * (streak * present).astype(np.float32)) * (1 - light)
