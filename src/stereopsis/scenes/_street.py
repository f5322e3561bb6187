"""A street seen by a rectified rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from stereopsis.scenes import _check as check
from stereopsis.scenes._noise import Dice, Floats, Floats32
from stereopsis.scenes._render import Bools, Camera, Day, bands, hidden, light, trace
from stereopsis.scenes._scene import Scene
from stereopsis.scenes._sensor import Sensor
from stereopsis.scenes._surfaces import Item, Look
from stereopsis.scenes._town import town
from stereopsis.types import Calibration, DisparityMap

BASELINE = 0.54
"""Metres between the cameras."""

HEIGHT = 1.6
"""Metres of the cameras over the road."""


def street(
    width: int = 880,
    height: int = 400,
    seed: int = 0,
    *,
    gray: bool = False,
    dtype: npt.DTypeLike = np.uint8,
    noise: float = 0.0,
    exposure: float = 1.0,
    offset: float = 0.0,
    gamma: float = 1.0,
    vignetting: float = 0.0,
    blur: float | tuple[float, float] = 0.0,
    fog: float = 0.0,
    rain: float = 0.0,
    low_light: float = 0.0,
    vertical_misalignment: float = 0.0,
    low_texture: float = 0.0,
    samples: int = 2,
) -> Scene:
    """Render a street as two rectified cameras see it, with exact truth.

    Every ray is intersected with planes, prisms, cylinders and ellipsoids in closed form; the nearest one
    gives the depth ``Z`` and ``d = focal * baseline / Z``. Colours are functions of the surface point alone,
    so both views see the same surface. The same arguments give the same bytes.

    Parameters
    ----------
    width, height : int
        Size in pixels, 1 ... 16384. The focal length is ``0.9 * width``, so every width shows the same view;
        the horizon lies at 0.46 of the height.
    seed : int
        Which street, 0 ... 2**32 - 1.
    gray : bool
        One channel (ITU-R BT.601) instead of red, green, blue.
    dtype : dtype
        uint8; uint16 for a 12-bit camera (0 ... 4095); or float32 in 0 ... 255, not rounded.
    noise : float
        Standard deviation of Gaussian noise in grey levels of 255, independent in the two views and in each
        channel.
    exposure, offset : float
        The right image is ``exposure * value + offset``, in grey levels of 255.
    gamma : float
        The right image is ``255 * (value / 255)**gamma`` before that.
    vignetting : float
        Light lost in the corners, 0 ... 1, growing with the square of the distance from the middle.
    blur : float or (float, float)
        Standard deviation in pixels of a Gaussian blur of both views, or of the left and the right one.
    fog : float
        Extinction of the air per metre: light from depth Z is weighed by ``exp(-fog * Z)`` against the fog's
        own. One sees ``3 / fog`` metres far.
    rain : float
        0 ... 1: an overcast sky, a veil, and streaks that are independent in the two views.
    low_light : float
        0 ... 1: less light, lamps and windows that shine, and photon noise.
    vertical_misalignment : float
        Rows that the right image is shifted down by. Rays are shifted, nothing is resampled.
    low_texture : float
        0 ... 1: takes this share of the contrast of every texture away. Windows, markings and edges stay.
    samples : int
        Colour is the mean of ``samples**2`` rays a pixel, 1 ... 8; the truth is that of the pixel's centre.

    Returns
    -------
    Scene
        No option but `width`, `height` and `seed` changes its left truth, and of the rest only
        `vertical_misalignment` changes `right_disparity`.

    Raises
    ------
    TypeError, ValueError
        Where an argument has the wrong type or lies outside its range.
    """
    width = check.integer("width", width, 1, 16384)
    height = check.integer("height", height, 1, 16384)
    seed = check.integer("seed", seed, 0, 2**32 - 1)
    samples = check.integer("samples", samples, 1, 8)
    fog = check.number("fog", fog, 0.0, 10.0)
    low_light = check.number("low_light", low_light, 0.0, 1.0)
    low_texture = check.number("low_texture", low_texture, 0.0, 1.0)
    shift = check.number("vertical_misalignment", vertical_misalignment, -1000.0, 1000.0)
    blurs = check.two("blur", blur, 0.0, 100.0)
    sensor = Sensor(
        view=0,
        seed=seed,
        dtype=check.image_dtype(dtype),
        gray=bool(gray),
        noise=check.number("noise", noise, 0.0, 255.0),
        vignetting=check.number("vignetting", vignetting, 0.0, 1.0),
        blur=blurs[0],
        rain=check.number("rain", rain, 0.0, 1.0),
        low_light=low_light,
    )
    right_sensor = replace(
        sensor,
        view=1,
        blur=blurs[1],
        gain=check.number("exposure", exposure, 0.01, 100.0),
        offset=check.number("offset", offset, -255.0, 255.0),
        gamma=check.number("gamma", gamma, 0.1, 10.0),
    )

    rig = Rig.make(width, height, seed)
    day = _day(seed, rig.left.focal, fog=fog, rain=sensor.rain, low_light=low_light, low_texture=low_texture)
    right = replace(rig.right, shift=shift)
    truth = rig.truth()
    return Scene(
        left=sensor.picture(rig.light(rig.left, day, samples)),
        right=right_sensor.picture(rig.light(right, day, samples)),
        disparity=truth.disparity,
        right_disparity=rig.disparity(right),
        occluded=truth.hidden | truth.out_of_view,
        out_of_view=truth.out_of_view,
        sky=truth.sky,
        textured=truth.textured,
        calibration=Calibration(
            rig.left.focal, rig.left.cx, rig.left.cy, BASELINE, width=width, height=height
        ),
        name=f"street-{width}x{height}-{seed}",
    )


@dataclass(frozen=True)
class Truth:
    """What is known of the left view, (H, W) each."""

    disparity: DisparityMap
    hidden: Bools
    out_of_view: Bools
    sky: Bools
    textured: Bools


@dataclass(frozen=True)
class Rig:
    """Two cameras in a street."""

    items: Sequence[Item]
    left: Camera
    right: Camera
    width: int
    height: int

    @classmethod
    def make(cls, width: int, height: int, seed: int) -> Rig:
        focal, cx, cy = 0.9 * width, 0.5 * (width - 1), 0.46 * (height - 1)
        left = Camera(focal, cx, cy, 0.0, HEIGHT)
        return cls(town(seed), left, replace(left, x=BASELINE), width, height)

    @property
    def columns(self) -> Floats:
        return np.arange(self.width, dtype=np.float64)

    @property
    def rows(self) -> Floats:
        return np.arange(self.height, dtype=np.float64)

    def depth(self, camera: Camera, rows: Floats) -> tuple[Floats, npt.NDArray[np.int32]]:
        """Return the depth in metres at the centres of some rows of pixels, and which item each sees."""
        return trace(self.items, camera.x, camera.height, *camera.directions(self.columns, rows))

    def disparity(self, camera: Camera) -> DisparityMap:
        """Return the true disparity of either view; NaN in the sky."""
        parts = [self.depth(camera, self.rows[part])[0] for part in bands(self.height, self.width)]
        return _disparity(camera.focal, np.concatenate(parts))

    def truth(self) -> Truth:
        """Return what is known of the left view."""
        camera = self.left
        solid = np.array([item.surface.textured for item in self.items] + [False])  # index -1 is the sky
        parts: list[tuple[Floats, Bools, Bools]] = []
        for part in bands(self.height, self.width):
            rows = self.rows[part]
            depth, index = self.depth(camera, rows)
            dx, dy = camera.directions(self.columns, rows)
            behind = hidden(self.items, camera.x, self.right.x, camera.height, dx, dy, depth)
            parts.append((depth, behind, solid[index]))
        depth = np.concatenate([p[0] for p in parts])
        match = self.columns - camera.focal * BASELINE / depth
        return Truth(
            disparity=_disparity(camera.focal, depth),
            hidden=np.concatenate([p[1] for p in parts]),
            out_of_view=match < -0.5,
            sky=np.isinf(depth),
            textured=np.concatenate([p[2] for p in parts]),
        )

    def light(self, camera: Camera, day: Day, samples: int) -> Floats32:
        """Return the light in each pixel, the mean over a grid of rays, (3, H, W)."""
        offsets = (np.arange(samples) + 0.5) / samples - 0.5
        columns = (self.columns[:, None] + offsets).reshape(-1)
        result = np.empty((3, self.height, self.width), np.float32)
        for part in bands(self.height, self.width * samples * samples):
            rows = (self.rows[part, None] + offsets).reshape(-1)
            fine = light(self.items, day, camera, columns, rows)
            total = np.zeros_like(result[:, part])
            for i in range(samples):
                for j in range(samples):
                    total += np.minimum(fine[:, i::samples, j::samples], 1)
            result[:, part] = total * np.float32(1.0 / (samples * samples))
        return result


def _disparity(focal: float, depth: Floats) -> DisparityMap:
    return np.where(np.isinf(depth), np.nan, focal * BASELINE / depth).astype(np.float32)


def _day(seed: int, focal: float, *, fog: float, rain: float, low_light: float, low_texture: float) -> Day:
    dice = Dice(seed, 9)
    side = dice.choice((-1.0, 1.0))
    x, y, z = side * dice.between(0.40, 0.62), dice.between(0.62, 0.80), -dice.between(0.30, 0.50)
    size = float(np.sqrt(x * x + y * y + z * z))
    return Day(
        sun=(x / size, y / size, z / size),
        sky=dice.integer(0, 1 << 20),
        haze=0.0016 + fog,
        fog=fog > 0,
        overcast=max(rain, min(1.0, 30.0 * fog)),
        look=Look(1.0 / focal, HEIGHT, 1.0 - low_texture, low_light),
    )
