"""One textured plane, slanted in disparity: the exact truth for tests of sub-pixel matching."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from stereopsis.scenes import _check as check
from stereopsis.scenes._noise import Floats, Floats32, lattice, words
from stereopsis.scenes._scene import Scene
from stereopsis.scenes._sensor import Sensor
from stereopsis.types import Calibration


def plane(
    width: int,
    height: int,
    seed: int = 0,
    *,
    disparity: float = 8.0,
    slant_x: float = 0.0,
    slant_y: float = 0.0,
    gray: bool = False,
    dtype: npt.DTypeLike = np.uint8,
    noise: float = 0.0,
    exposure: float = 1.0,
    offset: float = 0.0,
) -> Scene:
    """Render a plane of exact disparity ``d(x, y) = disparity + slant_x * x + slant_y * y``.

    The texture is a band-limited function ``T(x, y)`` of left pixel coordinates. The left image holds ``T(x,
    y)`` and the right one, at ``x_r``, holds ``T`` at the x with ``x - d(x, y) = x_r``: nothing is resampled.

    Parameters
    ----------
    width, height : int
        Size in pixels, 1 ... 16384.
    seed : int
        Which texture, 0 ... 2**32 - 1.
    disparity : float
        Disparity in pixels of pixel (0, 0); any sign.
    slant_x, slant_y : float
        Disparity gained a column and a row; `slant_x` is under 1, where a column would shrink to nothing.
    gray, dtype, noise, exposure, offset
        As for `street`.

    Returns
    -------
    Scene
        Nothing hides anything: `occluded` is `out_of_view`. `right_disparity` holds d where the texture goes
        on beyond the left image too. The calibration is nominal, its `doffs` such that every depth is
        positive.

    Raises
    ------
    TypeError, ValueError
        Where an argument has the wrong type or lies outside its range.
    """
    width = check.integer("width", width, 1, 16384)
    height = check.integer("height", height, 1, 16384)
    seed = check.integer("seed", seed, 0, 2**32 - 1)
    start = check.number("disparity", disparity, -1e5, 1e5)
    slope_x = check.number("slant_x", slant_x, -10.0, 0.99)
    slope_y = check.number("slant_y", slant_y, -10.0, 10.0)
    sensor = Sensor(
        view=0,
        seed=seed,
        dtype=check.image_dtype(dtype),
        gray=bool(gray),
        noise=check.number("noise", noise, 0.0, 255.0),
    )
    right_sensor = replace(
        sensor,
        view=1,
        gain=check.number("exposure", exposure, 0.01, 100.0),
        offset=check.number("offset", offset, -255.0, 255.0),
    )

    x, y = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    truth = start + slope_x * x + slope_y * y
    source = (x + start + slope_y * y) / (1.0 - slope_x)
    match = x - truth
    outside = (match < -0.5) | (match >= width - 0.5)
    return Scene(
        left=sensor.picture(_texture(x, y, seed)),
        right=right_sensor.picture(_texture(source, y, seed)),
        disparity=truth.astype(np.float32),
        right_disparity=(source - x).astype(np.float32),
        occluded=outside,
        out_of_view=outside.copy(),
        sky=np.zeros((height, width), np.bool_),
        textured=np.ones((height, width), np.bool_),
        calibration=Calibration(
            focal=float(width),
            cx=0.5 * (width - 1),
            cy=0.5 * (height - 1),
            baseline=0.1,
            doffs=max(0.0, 1.0 - float(truth.min())),
            width=width,
            height=height,
        ),
        name=f"plane-{width}x{height}-{seed}",
    )


def _texture(x: Floats, y: Floats, seed: int) -> Floats32:
    """Return linear light, (3, H, W): three octaves of noise, the finest with cells of 3.7 pixels."""
    result = np.empty((3, *x.shape), np.float32)
    for channel in range(3):
        total = np.zeros(x.shape, np.float32)
        for octave, weight in enumerate((0.42, 0.28, 0.2)):
            cell = 3.7 * 2.0**octave
            # The channels share two thirds of their texture, so that grey has contrast too.
            for key, share in ((3, 0.67), (channel, 0.33)):
                noise = lattice(x / cell, y / cell, int(words(seed, octave, key)))
                total += np.float32(weight * share) * noise
        grey = np.float32(0.5) + np.float32(0.5) * total
        result[channel] = grey * grey  # the display curve is a square root
    return result
