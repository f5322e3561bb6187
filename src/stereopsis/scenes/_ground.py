"""Asphalt with its markings, and pavements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereopsis.scenes._noise import Floats, Floats32, texture, uniform
from stereopsis.scenes._surfaces import WHITE, Colour, Hit, Look, Paint, band, over, plain


@dataclass(frozen=True)
class Road:
    """The ground: asphalt between the kerbs with its markings, grass beyond them."""

    left: float
    """x of the left kerb; `right` that of the right one."""
    right: float
    centre: float
    edges: tuple[float, ...]
    """x of the solid lines."""
    crossing: float
    """z of the zebra crossing."""
    dash: float = 0.0
    """Phase of the dashed line."""
    seed: int = 0
    textured: bool = True

    def paint(self, hit: Hit, look: Look) -> Paint:
        x, z, wide = hit.x, hit.z, hit.size
        deep = hit.spread(look.height)
        stretch = look.stretch(look.height)
        fine = texture(x, z, hit.size, 11 + self.seed, stretch_v=stretch, octaves=3)
        broad = texture(x, z, np.maximum(hit.size, 0.3), 23 + self.seed, stretch_v=stretch / 4, octaves=3)
        contrast = np.float32(look.contrast)

        base = plain((0.37, 0.37, 0.385), x.size)
        tone = 1 + contrast * (np.float32(0.30) * fine + np.float32(0.14) * broad)
        lane = (x - self.centre) / 3.5
        track = np.abs(np.abs(lane - np.floor(lane) - 0.5) - 0.23)
        tone -= contrast * np.float32(0.12) * np.clip(1.0 - track / 0.12, 0.0, 1.0).astype(np.float32)
        tone *= 1 - contrast * np.float32(0.35) * self._patches(x, z, wide, deep)
        base *= np.maximum(np.float32(0.05), tone)

        worn = np.clip(
            1 - contrast * np.maximum(np.float32(0.0), np.float32(0.7) * (fine + broad) - 0.25), 0.2, 1
        )
        over(base, WHITE, self._markings(x, z, wide, deep) * worn)

        grass = 1 - band(x, self.left - 0.02, self.right + 0.02, wide)
        if np.any(grass > 0):
            green = plain((0.33, 0.42, 0.20), x.size)
            green *= np.maximum(
                np.float32(0.1), 1 + contrast * (np.float32(0.5) * fine + np.float32(0.25) * broad)
            )
            base += grass * (green - base)
        return Paint(base)

    def _patches(self, x: Floats, z: Floats, wide: Floats, deep: Floats) -> Floats32:
        """Return where the asphalt was mended and where its manholes are, (n,)."""
        column, row = np.floor((x - self.left) / 2.2), np.floor(z / 7.0)
        s, t = x - self.left - 2.2 * column, z - 7.0 * row
        chance = uniform(column, row, self.seed, 31)
        length = 1.0 + 5.0 * uniform(column, row, self.seed, 32).astype(np.float64)
        patch = band(s, 0.2, 1.7, wide) * band(t, 0.4, length, deep) * (chance < 0.22)
        distance = np.sqrt((s - 1.1) ** 2 + (t - 3.5) ** 2)
        manhole = band(distance, -1.0, 0.33, deep) * (chance > 0.93)
        ring = band(distance, 0.27, 0.31, deep) * (chance > 0.93)
        result: Floats32 = patch * np.float32(0.7) + manhole * np.float32(1.5) - ring
        return result

    def _markings(self, x: Floats, z: Floats, wide: Floats, deep: Floats) -> Floats32:
        """Return how much of each pixel is painted white, (n,)."""
        clear = 1 - band(z, self.crossing - 3.0, self.crossing + 5.0, deep)
        phase = (z + self.dash) / 9.0
        along = 9.0 * (phase - np.floor(phase))
        # Far away a pixel holds more than a dash and its gap: the coverage tends to the mean.
        blend = np.clip(deep / 9.0, 0.0, 1.0).astype(np.float32)
        dashes = band(along, 1.0, 5.0, np.minimum(deep, 2.0)) * (1 - blend) + blend * np.float32(4.0 / 9.0)
        paint = band(x, self.centre - 0.075, self.centre + 0.075, wide) * dashes
        for edge in self.edges:
            paint = paint + band(x, edge - 0.06, edge + 0.06, wide)
        paint = paint * clear
        bar = (x - self.left) / 1.0
        stripes = band(bar - np.floor(bar), 0.25, 0.75, wide)
        zebra = (
            stripes
            * band(z, self.crossing, self.crossing + 3.2, deep)
            * band(x, self.left + 0.3, self.right - 0.3, wide)
        )
        stop = band(z, self.crossing - 1.6, self.crossing - 1.2, deep) * band(
            x, self.centre, self.right - 2.2, wide
        )
        result: Floats32 = np.minimum(np.float32(1.0), paint + zebra + stop)
        return result


@dataclass(frozen=True)
class Paving:
    """A raised pavement of square slabs with a kerb of granite; `kerb` is the x of its edge."""

    kerb: float
    colour: Colour
    seed: int = 0
    textured: bool = True

    def paint(self, hit: Hit, look: Look) -> Paint:
        x, z, wide = hit.x, hit.z, hit.size
        deep = hit.spread(look.height)
        contrast = np.float32(look.contrast)
        stretch = look.stretch(look.height)
        base = plain(self.colour, x.size)
        tone = 1 + contrast * np.float32(0.28) * texture(
            x, z + hit.y, hit.size, 41 + self.seed, stretch_v=stretch
        )
        side = np.abs(x - self.kerb)
        column, row = np.floor(side / 0.5), np.floor(z / 0.75)
        s, t = side - 0.5 * column, z - 0.75 * row
        joint = 1 - band(s, 0.012, 0.488, wide) * band(t, 0.012, 0.738, deep)
        sharp = np.clip(1.4 - 2.0 * deep / 0.75, 0.0, 1.0).astype(np.float32)
        slab = uniform(column, row, self.seed, 42) - np.float32(0.5)
        tone *= 1 + contrast * (np.float32(0.28) * slab * sharp - np.float32(0.45) * joint * sharp)
        base *= np.maximum(np.float32(0.1), tone)
        kerb = band(side, -0.1, 0.16, wide)
        base += kerb * (plain((0.62, 0.61, 0.58), x.size) * tone - base)
        return Paint(base)
