"""Houses: walls with windows, doors and shops, and roofs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereopsis.scenes._noise import Floats, Floats32, texture, uniform
from stereopsis.scenes._surfaces import (
    GLASS,
    WHITE,
    Colour,
    Hit,
    Look,
    Paint,
    band,
    linear,
    over,
    plain,
    rough,
)

GROUND_FLOOR = 3.5
"""Metres."""

DOORS: tuple[Colour, ...] = ((0.38, 0.22, 0.15), (0.15, 0.28, 0.20), (0.20, 0.22, 0.38), (0.45, 0.12, 0.12))


@dataclass(frozen=True)
class _Front:
    """The wall that is being painted: s along it, y up, the size of a pixel in each, and the colours."""

    s: Floats
    y: Floats
    wide: Floats
    tall: Floats
    mask: Floats32
    """1 on the street's side of the house, 0 on its ends."""
    base: Floats32
    glow: Floats32

    def across(self, s: Floats, low: float, high: float) -> Floats32:
        return band(s, low, high, self.wide)

    def up(self, low: float, high: float) -> Floats32:
        return band(self.y, low, high, self.tall)


@dataclass(frozen=True)
class Facade:
    """A house: windows in rows and columns, a door or a shop at the ground, a cornice, bricks or plaster."""

    front: int
    """Face that looks at the street: 0 is -x, 1 is +x."""
    start: float
    """z where the house begins."""
    length: float
    height: float
    floors: int
    columns: int
    colour: Colour
    trim: Colour
    brick: bool
    shop: Colour | None
    seed: int = 0
    textured: bool = True

    def paint(self, hit: Hit, look: Look) -> Paint:
        # The walls at the ends face the cameras: they run along x.
        along = hit.face < 2
        s = np.where(along, hit.z - self.start, hit.x)
        wide = np.where(along, hit.spread(hit.x), hit.size)
        base = plain(self.colour, s.size)
        tone = self._tone(s, hit, wide, look)
        base *= tone
        street = hit.face == self.front
        if not np.any(street):
            return Paint(base)
        front = _Front(s, hit.y, wide, hit.size, street.astype(np.float32), base, np.zeros_like(base))
        base += (
            front.mask
            * front.up(self.height - 0.45, np.inf)
            * (linear(self.trim) * (0.6 + 0.4 * tone) - base)
        )
        over(base, (0.16, 0.15, 0.15), front.mask * front.up(self.height - 0.53, self.height - 0.45))
        base += front.mask * front.up(-np.inf, 0.55) * (linear((0.45, 0.44, 0.43)) * tone - base)
        self._upper_floors(front, look)
        if self.shop is None:
            self._ground_floor(front, look)
        else:
            self._shop_window(front, look, self.shop)
        return Paint(base, front.glow if look.night else None)

    def _tone(self, s: Floats, hit: Hit, wide: Floats, look: Look) -> Floats32:
        """Return the tone of bare wall, (n,)."""
        contrast = np.float32(look.contrast)
        stretch = look.stretch(9.0)
        noise = texture(s, hit.y, hit.size, 51 + self.seed, stretch_u=stretch, finest=0.012, octaves=5)
        tone = 1 + contrast * np.float32(0.30 if self.brick else 0.24) * noise
        if self.brick:
            up = hit.y / 0.1
            row = np.floor(up)
            along = s / 0.3 + 0.5 * (row - 2.0 * np.floor(row / 2.0))
            column = np.floor(along)
            brick = band(along - column, 0.04, 0.96, wide / 0.3) * band(up - row, 0.1, 0.9, hit.size / 0.1)
            sharp = np.clip(1.3 - wide / 0.3, 0.0, 1.0).astype(np.float32)
            tint = uniform(column, row, self.seed, 52) - np.float32(0.5)
            tone *= 1 + contrast * sharp * (
                np.float32(0.6) * tint - np.float32(0.5) * brick + np.float32(0.4)
            )
        result: Floats32 = np.maximum(np.float32(0.1), tone)
        return result

    def _columns(self, front: _Front) -> tuple[Floats, Floats, float]:
        """Return the number of the column of windows, metres from its middle, and half a window's width."""
        pitch = self.length / self.columns
        column = np.floor(front.s / pitch)
        return column, front.s - (column + 0.5) * pitch, 0.27 * pitch

    def _upper_floors(self, front: _Front, look: Look) -> None:
        storey = (self.height - 0.6 - GROUND_FLOOR) / max(self.floors - 1, 1)
        column, a, half = self._columns(front)
        row = np.floor((front.y - GROUND_FLOOR) / storey)
        b = front.y - GROUND_FLOOR - row * storey
        upper = front.mask * ((row >= 0) & (row < self.floors - 1))
        sill, head = 0.28 * storey, 0.84 * storey
        frame = front.across(a, -half - 0.13, half + 0.13) * band(b, sill - 0.1, head + 0.12, front.tall)
        over(front.base, self.trim, upper * frame)
        ledge = front.across(a, -half - 0.2, half + 0.2) * band(b, sill - 0.16, sill - 0.1, front.tall)
        over(front.base, (0.3, 0.29, 0.28), upper * ledge)
        pane = upper * front.across(a, -half, half) * band(b, sill, head, front.tall)
        self._glass(front, look, pane, column, row, a / half, (b - sill) / (head - sill))
        bars = front.across(a, -0.035, 0.035) + band(b, head - 0.42, head - 0.36, front.tall)
        over(front.base, self.trim, pane * np.minimum(np.float32(1.0), bars))

    def _glass(
        self,
        front: _Front,
        look: Look,
        pane: Floats32,
        column: Floats,
        row: Floats,
        across: Floats,
        up: Floats,
    ) -> None:
        """Lay panes with curtains and a painted reflection: `across` in [-1, 1], `up` in [0, 1]."""
        base = front.base
        which = uniform(column, row, self.seed, 53)
        shade = (0.75 + 0.7 * up + 0.25 * across).astype(np.float32) * (np.float32(0.5) + which)
        base += pane * (linear(GLASS) * shade - base)
        drape = 0.25 + 0.55 * uniform(column, row, self.seed, 54)
        folds = (across * 9.0) - np.floor(across * 9.0)
        curtain = pane * (np.abs(across) > 1 - drape) * (which > 0.35)
        base += curtain * (linear((0.74, 0.72, 0.66)) * (0.7 + 0.3 * folds).astype(np.float32) - base)
        if look.night:
            shining = pane * (uniform(column, row, self.seed, 55) < 0.4)
            front.glow[...] += shining * linear((1.0, 0.82, 0.5)) * np.float32(1.3 * look.night)

    def _ground_floor(self, front: _Front, look: Look) -> None:
        column, a, half = self._columns(front)
        below = front.mask * (front.y < GROUND_FLOOR)
        is_door = np.float32(1.0) * (column == self.seed % self.columns)
        entry = below * is_door
        over(front.base, self.trim, entry * front.across(a, -0.68, 0.68) * front.up(0.1, 2.6))
        over(front.base, DOORS[self.seed % 4], entry * front.across(a, -0.52, 0.52) * front.up(0.12, 2.45))
        over(front.base, GLASS, entry * front.across(a, -0.36, 0.36) * front.up(1.5, 2.25))
        wall = below * (1 - is_door)
        over(front.base, self.trim, wall * front.across(a, -half - 0.13, half + 0.13) * front.up(0.95, 2.85))
        pane = wall * front.across(a, -half, half) * front.up(1.07, 2.72)
        self._glass(front, look, pane, column, np.full_like(a, -1.0), a / half, (front.y - 1.07) / 1.65)
        over(front.base, self.trim, pane * front.across(a, -0.035, 0.035))

    def _shop_window(self, front: _Front, look: Look, colour: Colour) -> None:
        column, a, _ = self._columns(front)
        pitch = self.length / self.columns
        inside = front.mask * front.across(front.s, 0.4, self.length - 0.4)
        pane = inside * front.up(0.55, 2.55)
        self._glass(front, look, pane, column, np.full_like(a, -1.0), 2.0 * a / pitch, (front.y - 0.55) / 2.0)
        over(
            front.base, (0.2, 0.2, 0.2), pane * (1 - front.across(a, 0.06 - 0.5 * pitch, 0.5 * pitch - 0.06))
        )
        over(front.base, colour, inside * front.up(2.6, 3.35))
        # A name in no alphabet: strokes in a grid of letters.
        place = front.s / 0.28
        letter = np.floor(place)
        stroke = uniform(letter, np.floor(front.y / 0.12), self.seed, 56) < 0.6
        there = uniform(letter, self.seed, 57) < 0.8
        ink = band(place - letter, 0.15, 0.85, front.wide / 0.28) * (stroke & there)
        line = front.across(front.s, 0.25 * self.length, 0.75 * self.length) * front.up(2.78, 3.18)
        over(front.base, WHITE, inside * line * ink)


@dataclass(frozen=True)
class Roof:
    """Tiles in rows."""

    colour: Colour
    seed: int = 0
    textured: bool = True

    def paint(self, hit: Hit, look: Look) -> Paint:
        contrast = np.float32(look.contrast)
        wide = hit.spread(hit.x)
        row, column = np.floor(hit.y / 0.22), np.floor(hit.z / 0.3)
        sharp = np.clip(1.4 - wide / 0.3, 0.0, 1.0).astype(np.float32)
        shade = (hit.y / 0.22 - row).astype(np.float32) - np.float32(0.5)
        tint = uniform(column, row, self.seed, 61) - np.float32(0.5)
        tone = rough(hit, look, 0.3, 62, 0.02) * (1 + contrast * sharp * np.float32(0.5) * (shade + tint))
        return Paint(plain(self.colour, hit.x.size) * np.maximum(np.float32(0.1), tone))
