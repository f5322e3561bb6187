"""Cars: bodywork and wheels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereopsis.scenes._noise import Floats, Floats32
from stereopsis.scenes._surfaces import WHITE, Colour, Hit, Look, Paint, band, linear, over, plain, rough

BLACK: Colour = (0.10, 0.10, 0.11)
TAIL_LIGHT: Colour = (0.85, 0.10, 0.08)


@dataclass(frozen=True)
class _Frame:
    """Points on a car in its own frame: w from rear to front, a across, y up; the size of a pixel."""

    w: Floats
    a: Floats
    y: Floats
    wide: Floats
    tall: Floats
    flank: Floats32
    """1 on the sides; `front` and `rear` are the faces that look forwards and backwards."""
    front: Floats32
    rear: Floats32

    def along(self, low: float | Floats, high: float | Floats) -> Floats32:
        return band(self.w, low, high, self.wide)

    def across(self, low: float, high: float | Floats) -> Floats32:
        """Return where |a| lies in [low, high]: cars are symmetric."""
        return band(np.abs(self.a), low, high, self.tall)

    def up(self, low: float, high: float) -> Floats32:
        return band(self.y, low, high, self.tall)


@dataclass(frozen=True)
class Car:
    """Bodywork of a car: the body, or the cabin over it."""

    x: float
    z: float
    """Where the rear bumper is on the road, the middle of the car across it."""
    heading: float
    """+1 drives away from the cameras, -1 towards them."""
    width: float
    belt: float
    """Height of the lower edge of the windows."""
    top: float
    wheels: tuple[float, float]
    colour: Colour
    cabin: bool
    textured: bool = False

    def paint(self, hit: Hit, look: Look) -> Paint:
        base = plain(self.colour, hit.x.size) * rough(hit, look, 0.05, 81, 0.02)
        side = hit.face < 2
        forward = self.heading * hit.nz
        frame = _Frame(
            self.heading * (hit.z - self.z),
            hit.x - self.x,
            hit.y,
            np.where(side, hit.spread(hit.x), hit.size),
            hit.size,
            side.astype(np.float32),
            (~side & (forward > 0.3)).astype(np.float32),
            (~side & (forward < -0.3)).astype(np.float32),
        )
        if self.cabin:
            self._cabin(base, frame)
            return Paint(base)
        glow = self._body(base, frame)
        return Paint(base, glow * np.float32(look.night) if look.night else None)

    def _cabin(self, base: Floats32, frame: _Frame) -> None:
        rise = self.top - self.belt
        lean = (frame.y - self.belt) / rise
        glass = frame.up(self.belt + 0.05, self.top - 0.09)
        dark = linear((0.17, 0.20, 0.23)) * (0.8 + 0.5 * lean).astype(np.float32)
        rear, front = self.wheels
        windows = frame.along(rear - 0.35 + 0.45 * lean, front - 0.2 - 0.75 * lean)
        middle = 0.5 * (rear + front)
        pillar = frame.along(middle - 0.05, middle + 0.05)
        base += frame.flank * glass * windows * (1 - pillar) * (dark - base)
        half = 0.5 * self.width - 0.14 - 0.28 * (frame.y - self.belt)
        pane = (frame.front + frame.rear) * glass * frame.across(-1.0, half)
        base += pane * (dark * np.float32(1.3) - base)
        over(base, BLACK, pane * frame.across(0.24, 0.48) * band(lean, -1.0, 0.5, frame.tall / rise))

    def _body(self, base: Floats32, frame: _Frame) -> Floats32:
        """Paint the body and return the light of its lamps."""
        over(base, BLACK, frame.up(-1.0, 0.34))
        rear, front = self.wheels
        for axle in (rear, front):
            distance = np.sqrt((frame.w - axle) ** 2 + (frame.y - 0.31) ** 2)
            over(base, (0.06, 0.06, 0.06), frame.flank * band(distance, -1.0, 0.39, frame.wide))
        middle = 0.5 * (rear + front)
        for seam in (rear + 0.35, middle, front - 0.42):
            over(base, BLACK, frame.flank * frame.along(seam - 0.012, seam + 0.012) * frame.up(0.36, 2.0))
        for handle in (middle - 0.22, front - 1.55):
            over(base, BLACK, frame.flank * frame.along(handle, handle + 0.16) * frame.up(0.76, 0.79))
        half = 0.5 * self.width
        plate = frame.across(-1.0, 0.26)
        over(base, BLACK, frame.rear * frame.across(half - 0.38, half - 0.01) * frame.up(0.64, 0.88))
        tail = frame.rear * frame.across(half - 0.36, half - 0.03) * frame.up(0.66, 0.86)
        over(base, TAIL_LIGHT, tail)
        over(base, (0.95, 0.62, 0.25), tail * frame.up(0.66, 0.71))
        over(base, WHITE, frame.rear * plate * frame.up(0.60, 0.72))
        over(base, BLACK, (frame.front + frame.rear) * frame.up(0.42, 0.46))
        over(base, BLACK, frame.front * frame.across(-1.0, 0.55) * frame.up(0.46, 0.62))
        over(base, WHITE, frame.front * plate * frame.up(0.40, 0.50))
        lamp = frame.front * frame.across(half - 0.36, half - 0.03) * frame.up(0.56, 0.70)
        over(base, (0.95, 0.95, 0.92), lamp)
        result: Floats32 = np.float32(4.0) * lamp + tail * linear(TAIL_LIGHT)
        return result


@dataclass(frozen=True)
class Tyre:
    """A wheel seen from its side: rubber around a metal rim with holes between spokes."""

    y: float
    z: float
    radius: float
    textured: bool = False

    def paint(self, hit: Hit, look: Look) -> Paint:
        dy, dz = hit.y - self.y, hit.z - self.z
        wide = hit.spread(hit.x)
        distance = np.sqrt(dy * dy + dz * dz) / self.radius
        base = plain((0.10, 0.10, 0.10), dy.size) * rough(hit, look, 0.15, 91)
        side = np.float32(1.0) * (hit.face < 2)
        over(base, (0.55, 0.56, 0.58), side * band(distance, -1.0, 0.66, wide / self.radius))
        # The holes between the spokes, laid out by a product of coordinates rather than by an angle.
        star = dy * dz * (dy * dy - dz * dz) / np.square(dy * dy + dz * dz + 1e-12)
        holes = side * band(distance, 0.25, 0.58, wide / self.radius) * (star > 0.05)
        over(base, (0.13, 0.13, 0.14), holes)
        return Paint(base)
