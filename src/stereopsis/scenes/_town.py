"""Lays a street out: which solids stand where, drawn by the seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereopsis.scenes._ground import Paving, Road
from stereopsis.scenes._houses import GROUND_FLOOR, Facade, Roof
from stereopsis.scenes._noise import Dice
from stereopsis.scenes._shapes import Solid, box, cylinder, ellipsoid, ground, prism, wheel
from stereopsis.scenes._surfaces import Colour, Foliage, Item, Plain, Sign
from stereopsis.scenes._vehicles import Car, Tyre

STREET_END = 190.0
"""Metres ahead where a cross street closes the view."""

WALLS: tuple[tuple[Colour, bool], ...] = (
    ((0.66, 0.36, 0.28), True),
    ((0.58, 0.34, 0.27), True),
    ((0.74, 0.55, 0.40), True),
    ((0.86, 0.80, 0.66), False),
    ((0.84, 0.72, 0.52), False),
    ((0.72, 0.76, 0.78), False),
    ((0.80, 0.62, 0.52), False),
    ((0.70, 0.74, 0.64), False),
    ((0.60, 0.58, 0.54), True),
)
TRIMS: tuple[Colour, ...] = ((0.92, 0.91, 0.87), (0.86, 0.84, 0.78), (0.80, 0.80, 0.80))
SHOPS: tuple[Colour, ...] = (
    (0.65, 0.10, 0.12),
    (0.08, 0.35, 0.22),
    (0.12, 0.22, 0.50),
    (0.80, 0.55, 0.10),
    (0.2, 0.2, 0.22),
)
ROOFS: tuple[Colour, ...] = ((0.55, 0.29, 0.22), (0.42, 0.30, 0.27), (0.38, 0.38, 0.40))
CARS: tuple[Colour, ...] = (
    (0.70, 0.10, 0.12),
    (0.85, 0.86, 0.87),
    (0.16, 0.28, 0.55),
    (0.25, 0.26, 0.28),
    (0.62, 0.64, 0.66),
    (0.90, 0.88, 0.84),
    (0.18, 0.38, 0.32),
    (0.75, 0.60, 0.20),
)
LEAVES: tuple[Colour, ...] = ((0.30, 0.44, 0.17), (0.36, 0.50, 0.20), (0.42, 0.48, 0.18), (0.25, 0.40, 0.20))


Profile = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Make:
    """The shape of a car: profiles counter-clockwise in (metres from the rear bumper, height)."""

    belt: float
    """Height where the windows begin."""
    top: float
    wheels: tuple[float, float]
    body: Profile
    cabin: Profile


HATCHBACK = Make(
    0.94,
    1.48,
    (0.72, 3.15),
    (
        (0.02, 0.32),
        (0.2, 0.2),
        (3.65, 0.2),
        (3.88, 0.35),
        (3.9, 0.62),
        (3.7, 0.78),
        (2.85, 0.94),
        (0.02, 0.94),
    ),
    ((0.08, 0.94), (3.05, 0.94), (2.2, 1.43), (1.8, 1.48), (0.75, 1.48), (0.5, 1.42)),
)
SALOON = Make(
    0.93,
    1.44,
    (0.95, 3.6),
    ((0.02, 0.30), (0.25, 0.2), (4.25, 0.2), (4.48, 0.35), (4.5, 0.6), (4.2, 0.76), (3.2, 0.93), (0.1, 0.97)),
    ((0.55, 0.93), (3.35, 0.93), (2.45, 1.40), (2.0, 1.44), (1.45, 1.44), (1.1, 1.40)),
)
ESTATE = Make(
    0.96,
    1.56,
    (0.85, 3.5),
    (
        (0.02, 0.32),
        (0.2, 0.22),
        (4.15, 0.22),
        (4.38, 0.4),
        (4.4, 0.66),
        (4.2, 0.82),
        (3.3, 0.96),
        (0.0, 0.96),
    ),
    ((0.02, 0.96), (3.45, 0.96), (2.6, 1.51), (2.2, 1.56), (0.5, 1.56), (0.3, 1.5)),
)
VAN = Make(
    1.12,
    1.95,
    (0.95, 3.85),
    ((0.0, 0.34), (0.15, 0.24), (4.7, 0.24), (4.88, 0.4), (4.9, 0.75), (4.7, 0.98), (4.3, 1.12), (0.0, 1.12)),
    ((0.0, 1.12), (4.45, 1.12), (3.75, 1.9), (3.5, 1.95), (0.15, 1.95)),
)
MAKES = (HATCHBACK, HATCHBACK, SALOON, ESTATE, VAN)


@dataclass(frozen=True)
class Lanes:
    """x of what runs along the street; the cameras drive in the right lane, whose middle is x = 0."""

    centre: float = -1.75
    left_kerb: float = -7.45
    right_kerb: float = 3.95
    pavement: float = 3.1

    @property
    def left_front(self) -> float:
        """x of the houses on the left."""
        return self.left_kerb - self.pavement

    @property
    def right_front(self) -> float:
        return self.right_kerb + self.pavement


def town(seed: int) -> tuple[Item, ...]:
    """Return everything that stands in the street of a seed."""
    lanes = Lanes()
    dice = Dice(seed, 1)
    crossing = dice.between(30.0, 44.0)
    road = Road(
        lanes.left_kerb,
        lanes.right_kerb,
        lanes.centre,
        (lanes.left_kerb + 2.2, lanes.right_kerb - 2.2),
        crossing,
        dice.between(0.0, 9.0),
        seed & 0xFFFF,
    )
    items = [Item(ground(), road, shadow=False, shaded=True)]
    for kerb, front in (
        (lanes.left_kerb, lanes.left_front - 12.0),
        (lanes.right_kerb, lanes.right_front + 12.0),
    ):
        slab = box(min(kerb, front), max(kerb, front), -1.0, 0.13, -10.0, STREET_END)
        paving = Paving(kerb, dice.choice(((0.58, 0.57, 0.55), (0.60, 0.56, 0.52))), seed & 0xFFFF)
        items.append(Item(slab, paving, shadow=False, shaded=True))
    items += _houses(Dice(seed, 2), lanes)
    items += _traffic(Dice(seed, 3), lanes, crossing)
    items += _furniture(Dice(seed, 4), lanes, crossing)
    items += _backdrop(Dice(seed, 5))
    return tuple(items)


def _houses(dice: Dice, lanes: Lanes) -> list[Item]:
    items: list[Item] = []
    for side, front in ((-1.0, lanes.left_front), (1.0, lanes.right_front)):
        z = dice.between(-14.0, -6.0)
        while z < STREET_END - 12.0:
            length = dice.between(9.0, 17.0)
            if z > 25.0 and dice.chance(0.16):
                items += _garden(dice, side, front, z, length)
            else:
                setback = dice.between(0.0, 0.6) if dice.chance(0.7) else dice.between(1.0, 2.0)
                items += _house(dice, side, front + side * setback, z, length)
            z += length + (dice.between(2.0, 4.5) if dice.chance(0.25) else 0.0)
    return items


def _house(dice: Dice, side: float, front: float, z: float, length: float) -> list[Item]:
    floors = dice.integer(2, 3)
    height = GROUND_FLOOR + (floors - 1) * dice.between(2.7, 3.1) + 0.6
    depth = 9.0
    x0, x1 = min(front, front + side * depth), max(front, front + side * depth)
    wall, brick = dice.choice(WALLS)
    facade = Facade(
        front=0 if side > 0 else 1,
        start=z,
        length=length,
        height=height,
        floors=floors,
        columns=max(2, round(length / dice.between(2.3, 3.0))),
        colour=wall,
        trim=dice.choice(TRIMS),
        brick=brick,
        shop=dice.choice(SHOPS) if dice.chance(0.4) else None,
        seed=dice.integer(0, 1 << 20),
    )
    items = [Item(box(x0, x1, -0.5, height, z, z + length), facade)]
    if dice.chance(0.65):
        rise = dice.between(2.0, 3.2)
        eaves = ((x0 - 0.35, height), (x1 + 0.35, height), (0.5 * (x0 + x1), height + rise))
        tiles = Roof(dice.choice(ROOFS), dice.integer(0, 99))
        items.append(Item(prism(eaves, "z", z, z + length), tiles))
        at = dice.between(0.15, 0.8) * length + z
        top = height + rise + 0.7
        chimney = box(front + side * 2.6, front + side * 3.3, height, top, at, at + 0.9)
        items.append(Item(chimney, Plain((0.52, 0.33, 0.27), 0.3, 5, textured=True), shadow=False))
    return items


def _garden(dice: Dice, side: float, front: float, z: float, length: float) -> list[Item]:
    """A gap between houses: a hedge on the street and trees behind."""
    x0, x1 = min(front, front + side * 1.0), max(front, front + side * 1.0)
    hedge = box(x0, x1, 0.0, dice.between(1.2, 1.9), z + 0.4, z + length - 0.4)
    items = [Item(hedge, Foliage(dice.choice(LEAVES), dice.integer(0, 99)), occludes_sky=True)]
    for at in (0.25, 0.7):
        items += _tree(dice, front + side * dice.between(3.0, 5.0), z + at * length, dice.between(5.0, 7.0))
    return items


def _tree(dice: Dice, x: float, z: float, height: float) -> list[Item]:
    """A trunk under a crown of ellipsoids."""
    leaves = Foliage(dice.choice(LEAVES), dice.integer(0, 99))
    bark = Plain((0.36, 0.28, 0.22), 0.45, 6, 0.02, textured=True)
    items = [Item(cylinder(x, z, 0.024 * height, 0.0, 0.6 * height), bark)]
    spread = 0.25 * height
    items.append(Item(ellipsoid(x, 0.68 * height, z, spread, 0.27 * height, spread), leaves))
    for _ in range(26):
        # Tufts over the crown's surface break its outline; most look at the street's length, where we see
        # them.
        u, v, w = dice.between(-1.0, 1.0), dice.between(-1.0, 1.0), dice.between(-1.0, 0.6)
        size = max(float(np.sqrt(u * u + v * v + w * w)), 0.3)
        r = height * dice.between(0.055, 0.105)
        at = (x + u / size * spread, (0.68 + 0.27 * v / size) * height, z + w / size * spread)
        items.append(Item(ellipsoid(*at, r, 0.8 * r, r), leaves))
    return items


def _traffic(dice: Dice, lanes: Lanes, crossing: float) -> list[Item]:
    items: list[Item] = []
    # One car ahead in our lane, one or two that come towards us, and rows of parked ones.
    items += _car(dice, dice.between(-0.2, 0.2), dice.between(15.0, 21.0), 1.0)
    z = dice.between(24.0, 34.0)
    for _ in range(dice.integer(1, 2)):
        items += _car(dice, 2 * lanes.centre + dice.between(-0.2, 0.2), z, -1.0)
        z += dice.between(22.0, 50.0)
    for x, heading, first in (
        (lanes.right_kerb - 1.1, 1.0, dice.between(8.5, 11.0)),
        (lanes.left_kerb + 1.1, -1.0, dice.between(11.0, 17.0)),
    ):
        z = first
        while z < 120.0:
            near_crossing = crossing - 9.0 < z < crossing + 9.0
            if not near_crossing and dice.chance(0.72):
                items += _car(dice, x + dice.between(-0.1, 0.1), z if heading > 0 else z + 4.6, heading)
            z += dice.between(5.4, 6.6)
    return items


def _car(dice: Dice, x: float, z: float, heading: float) -> list[Item]:
    """Return a car whose rear bumper is at z and which drives away (+1) or towards us (-1)."""
    make = dice.choice(MAKES)
    colour = dice.choice(CARS)
    width = dice.between(1.72, 1.84)

    def lay(profile: Profile, half: float, lean: float) -> Solid:
        corners = [(z + heading * w, y) for w, y in profile]
        # Turning the car around mirrors its profile: the corners run the other way.
        return prism(corners if heading > 0 else corners[::-1], "x", x - half, x + half, lean)

    def paint(cabin: bool) -> Car:
        return Car(x, z, heading, width, make.belt, make.top, make.wheels, colour, cabin)

    items = [
        Item(lay(make.body, 0.5 * width, 0.0), paint(False), occludes_sky=True),
        Item(lay(make.cabin, 0.5 * width - 0.06, 0.26), paint(True)),
    ]
    for at in make.wheels:
        for side in (-1.0, 1.0):
            edge = x + side * (0.5 * width + 0.012)
            inner = edge - side * 0.2
            middle = z + heading * at
            solid = wheel(min(edge, inner), max(edge, inner), 0.31, middle, 0.31)
            items.append(Item(solid, Tyre(0.31, middle, 0.31), shadow=False))
    return items


def _furniture(dice: Dice, lanes: Lanes, crossing: float) -> list[Item]:
    items: list[Item] = []
    steel = Plain((0.42, 0.44, 0.45), 0.10, 7)
    for side, kerb in ((-1.0, lanes.left_kerb), (1.0, lanes.right_kerb)):
        x = kerb + side * 0.5
        z = dice.between(12.5, 17.0) if side > 0 else dice.between(16.0, 24.0)
        while z < 150.0:
            items += _lamp(x, z, -side, steel)
            z += 26.0
        z = dice.between(20.0, 26.0)
        while z < 140.0:
            if abs(z - crossing) > 6.0 and dice.chance(0.6):
                items += _tree(dice, kerb + side * 0.95, z, dice.between(4.6, 6.2))
            z += dice.between(10.0, 14.0)
        for _ in range(4):
            at = dice.between(14.0, 60.0)
            items.append(
                Item(cylinder(kerb + side * 0.55, at, 0.27, 0.1, 1.0), Plain((0.16, 0.30, 0.22), 0.15, 8))
            )
        for _ in range(5):
            items += _walker(dice, kerb + side * dice.between(1.2, 2.5), dice.between(13.0, 70.0))
    for x, z, kind in (
        (lanes.right_kerb + 0.4, dice.between(19.0, 26.0), 1),
        (lanes.right_kerb + 0.4, crossing - 1.0, 2),
        (lanes.left_kerb - 0.4, crossing + 4.5, 0),
    ):
        items.append(Item(cylinder(x, z, 0.035, 0.0, 2.9), steel))
        plate = Solid(
            (x - 0.36, 2.09, z - 0.07),
            (x + 0.36, 2.81, z - 0.04),
            box(x - 0.36, x + 0.36, 2.09, 2.81, z - 0.07, z - 0.04).planes,
        )
        items.append(Item(plate, Sign(x, 2.45, 0.34, kind)))
    return items


def _lamp(x: float, z: float, side: float, steel: Plain) -> list[Item]:
    reach = side * 1.5
    x0, x1 = min(x, x + reach), max(x, x + reach)
    end = x + reach
    head = Plain((0.95, 0.90, 0.75), 0.0, 9, glow=3.0)
    return [
        Item(cylinder(x, z, 0.075, 0.0, 6.8), steel),
        Item(cylinder(x, z, 0.12, 0.0, 1.1), steel, shadow=False),
        Item(box(x0, x1, 6.72, 6.80, z - 0.04, z + 0.04), steel),
        Item(
            box(min(end, end - side * 0.6), max(end, end - side * 0.6), 6.62, 6.73, z - 0.13, z + 0.13), head
        ),
    ]


def _walker(dice: Dice, x: float, z: float) -> list[Item]:
    """Someone on the pavement."""
    tall = dice.between(0.9, 1.05)
    coat = Plain(dice.choice(CARS), 0.25, 12, 0.03)
    trousers = Plain(dice.choice(((0.15, 0.17, 0.25), (0.2, 0.18, 0.16), (0.35, 0.36, 0.4))), 0.2, 13, 0.03)
    skin = Plain((0.80, 0.62, 0.52), 0.05, 14)
    hair = Plain(dice.choice(((0.12, 0.09, 0.07), (0.35, 0.22, 0.12), (0.6, 0.5, 0.35))), 0.2, 15)
    stride = dice.between(0.05, 0.14)
    return [
        Item(ellipsoid(x - 0.09, 0.55 * tall, z - stride, 0.095, 0.45 * tall, 0.11), trousers),
        Item(ellipsoid(x + 0.09, 0.55 * tall, z + stride, 0.095, 0.45 * tall, 0.11), trousers),
        Item(ellipsoid(x, 1.18 * tall, z, 0.21, 0.34 * tall, 0.14), coat),
        Item(ellipsoid(x - 0.23, 1.10 * tall, z, 0.055, 0.32 * tall, 0.07), coat, shadow=False),
        Item(ellipsoid(x + 0.23, 1.10 * tall, z, 0.055, 0.32 * tall, 0.07), coat, shadow=False),
        Item(ellipsoid(x, 1.63 * tall, z, 0.10, 0.13, 0.11), skin),
        Item(ellipsoid(x, 1.67 * tall, z + 0.02, 0.11, 0.12, 0.115), hair, shadow=False),
    ]


def _backdrop(dice: Dice) -> list[Item]:
    """What closes the view: houses and trees across the end of the street, hills behind."""
    items: list[Item] = []
    x = -70.0
    while x < 70.0:
        wide = dice.between(9.0, 16.0)
        wall, _ = dice.choice(WALLS)
        height = dice.between(7.0, 11.0)
        z = STREET_END + 20.0 + dice.between(0.0, 6.0)
        if dice.chance(0.7):
            plaster = Plain(wall, 0.25, 17, 0.05, textured=True)
            items.append(Item(box(x, x + wide, 0.0, height, z, z + 10.0), plaster, shadow=False))
        else:
            for at in (0.2, 0.6):
                items += _tree(dice, x + at * wide, z, dice.between(8.0, 12.0))
        x += wide
    for _ in range(7):
        middle, wide = dice.between(-420.0, 420.0), dice.between(120.0, 260.0)
        hill = ellipsoid(middle, -5.0, dice.between(640.0, 900.0), wide, dice.between(22.0, 55.0), 80.0)
        items.append(Item(hill, Foliage((0.36, 0.44, 0.30), dice.integer(0, 99)), shadow=False))
    return items
