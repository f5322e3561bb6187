"""What surfaces look like: albedo as a function of their own coordinates, and the plainer materials."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from stereopsis.scenes._noise import Floats, Floats32, texture
from stereopsis.scenes._shapes import Solid

Colour = tuple[float, float, float]
"""Red, green, blue as they are displayed, in [0, 1]; squared where light is added up."""

WHITE: Colour = (0.93, 0.92, 0.88)
GLASS: Colour = (0.25, 0.30, 0.36)


@dataclass(frozen=True)
class Look:
    """What every surface needs to know of the rig and of the day."""

    pixel: float
    """Width of a pixel at one metre, in metres: 1 / focal length."""
    height: float
    """Metres of the cameras over the road."""
    contrast: float
    """Multiplies every texture."""
    night: float
    """0 in daylight, 1 when windows and lamps are what shines."""

    def stretch(self, distance: float) -> float:
        """Return the stretch along z that makes texture look round on a plane `distance` beside the axis.

        A cell six pixels wide is seen at ``z = cell / (6 pixel)``, where z is foreshortened ``z /
        distance`` times.
        """
        return 1.0 / (6.0 * self.pixel * distance)


@dataclass(frozen=True)
class Hit:
    """Surface points, each component (n,)."""

    x: Floats
    y: Floats
    z: Floats
    size: Floats
    """Width of a pixel at that depth, metres."""
    face: npt.NDArray[np.intp]
    nx: Floats
    ny: Floats
    nz: Floats

    def spread(self, distance: Floats | float) -> Floats:
        """Return how many metres of z a pixel covers on a surface that recedes `distance` beside the axis."""
        return self.size * np.maximum(1.0, self.z / np.maximum(np.abs(distance), 0.3))


@dataclass(frozen=True)
class Paint:
    """Linear albedo and glow, float32 (3, n) each; no glow is None."""

    albedo: Floats32
    glow: Floats32 | None = None


class Surface(Protocol):
    """A material; `textured` says whether an area matcher finds something to hold on to."""

    @property
    def textured(self) -> bool: ...

    def paint(self, hit: Hit, look: Look) -> Paint:
        """Colour surface points."""
        ...


def linear(colour: Colour) -> Floats32:
    """Return a displayed colour as linear light, (3, 1)."""
    return np.array([[c * c] for c in colour], np.float32)


def band(x: Floats, low: float | Floats, high: float | Floats, width: Floats | float) -> Floats32:
    """Return how much of a pixel of the given width lies in [low, high]: pattern edges without aliasing."""
    w = np.maximum(width, 1e-6)
    rise = np.clip((x - low) / w + 0.5, 0.0, 1.0)
    fall = np.clip((high - x) / w + 0.5, 0.0, 1.0)
    return (rise * fall).astype(np.float32)


def over(base: Floats32, colour: Colour, cover: Floats32) -> None:
    """Lay a colour over (3, n) albedo in place."""
    base += cover * (linear(colour) - base)


def plain(colour: Colour, count: int) -> Floats32:
    return np.repeat(linear(colour), count, axis=1)


def rough(hit: Hit, look: Look, amount: float, key: int, finest: float = 0.008, octaves: int = 4) -> Floats32:
    """Return ``1 + noise`` for any surface, (n,), over oblique coordinates: no face is blind to it."""
    u, v = 0.8 * hit.x + 0.6 * hit.z, hit.y + 0.37 * hit.x - 0.29 * hit.z
    noise = texture(u, v, hit.size, key, finest=finest, octaves=octaves)
    result: Floats32 = np.maximum(np.float32(0.05), 1 + np.float32(amount * look.contrast) * noise)
    return result


@dataclass(frozen=True)
class Plain:
    """A painted, nearly uniform thing."""

    colour: Colour
    amount: float = 0.12
    key: int = 1
    finest: float = 0.01
    glow: float = 0.0
    """Shines at night, as a lamp does."""
    textured: bool = False

    def paint(self, hit: Hit, look: Look) -> Paint:
        base = plain(self.colour, hit.x.size)
        shine = base * np.float32(self.glow * look.night) if self.glow else None
        return Paint(base * rough(hit, look, self.amount, self.key, self.finest), shine)


@dataclass(frozen=True)
class Foliage:
    """Leaves: dark gaps and lit tips."""

    colour: Colour
    seed: int = 0
    textured: bool = True

    def paint(self, hit: Hit, look: Look) -> Paint:
        # Crowns take the texture from the front, where only their rims stretch it; hedges each face its own
        # way.
        u, v = np.where(np.abs(hit.nx) == 1.0, hit.z, hit.x), np.where(np.abs(hit.ny) == 1.0, hit.z, hit.y)
        noise = texture(u, v, hit.size, 71 + self.seed, finest=0.07, octaves=3)
        # A steep curve parts lit leaves from the dark between them, which tells a tree from a green balloon.
        leaf = np.clip(np.float32(0.5) + np.float32(1.1) * noise, 0, 1)
        tone = 1 + np.float32(look.contrast) * (
            np.float32(1.5) * leaf * leaf * (3 - 2 * leaf) - np.float32(0.75)
        )
        return Paint(plain(self.colour, hit.x.size) * tone)


@dataclass(frozen=True)
class Sign:
    """A traffic sign: a disc, painted on the plate's front and grey behind; `kind` chooses its face."""

    x: float
    y: float
    radius: float
    kind: int
    textured: bool = False

    def paint(self, hit: Hit, look: Look) -> Paint:
        dx, dy = (hit.x - self.x) / self.radius, (hit.y - self.y) / self.radius
        w = hit.size / self.radius
        distance = np.sqrt(dx * dx + dy * dy)
        base = plain((0.5, 0.5, 0.5), dx.size)
        front = np.float32(1.0) * (hit.nz < -0.5)
        inside = front * band(distance, -1.0, 1.0, w)
        match self.kind:
            case 0:  # no entry
                over(base, (0.80, 0.08, 0.10), inside)
                over(base, WHITE, inside * band(dx, -0.7, 0.7, w) * band(dy, -0.18, 0.18, w))
            case 1:  # speed limit
                over(base, (0.80, 0.08, 0.10), inside)
                over(base, WHITE, front * band(distance, -1.0, 0.74, w))
                digit = band(np.abs(np.abs(dx) - 0.28), 0.0, 0.19, w) * band(dy, -0.4, 0.4, w)
                hollow = band(np.abs(np.abs(dx) - 0.28), 0.0, 0.08, w) * band(np.abs(dy), 0.07, 0.28, w)
                over(base, (0.05, 0.05, 0.05), front * digit * (1 - hollow))
            case _:  # this way
                over(base, (0.10, 0.25, 0.65), inside)
                shaft = band(dx, -0.12, 0.12, w) * band(dy, -0.6, 0.2, w)
                head = band(np.abs(dx) + dy, -9.0, 0.62, w) * band(dy, 0.1, 9.0, w)
                over(base, WHITE, inside * np.maximum(shaft, head))
        return Paint(base)


@dataclass(frozen=True)
class Item:
    """A solid and what it is made of."""

    solid: Solid
    surface: Surface
    shadow: bool = True
    """Throws a shadow on road and pavement."""
    shaded: bool = False
    """Receives the shadows of others."""
    occludes_sky: bool = False
    """Darkens the road beneath it."""
