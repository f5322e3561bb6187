"""How an image is cut: as few tiles as the memory allows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from stereopsis.settings import Settings
from stereopsis.tiling import reach
from stereopsis.tiling.grid import Tile, tiles
from stereopsis.types import WHOLE, Halo, Rectangle

MULTIPLE = 256
"""Sides of tiles are multiples of those of a written TIFF, where there is room for it."""
SMALLEST = 32
"""A tile is at least so wide and high."""


@dataclass(frozen=True)
class Plan:
    """Tiles that cover an image.

    Attributes
    ----------
    tiles : tuple of Tile
    side : (height, width)
        Of a tile.
    halo : Halo
    bytes : int
        The most that a tile needs.
    """

    tiles: tuple[Tile, ...]
    side: tuple[int, int]
    halo: Halo
    bytes: int


def plan(shape: tuple[int, int], settings: Settings, room: int, needs: Callable[[Tile], int]) -> Plan:
    """The tiles of least total work of which each fits the memory.

    Parameters
    ----------
    shape : (H, W)
    settings : Settings
        With nothing left to be estimated.
    room : int
        Bytes that a tile may need.
    needs : callable
        Bytes that a tile needs.

    Raises
    ------
    ValueError
        Where the smallest tile needs more; it says how much.
    """
    halo, aligned = reach.halo(settings), reach.alignment(settings)
    best: tuple[int, tuple[int, int], int] | None = None
    least = WHOLE**3
    columns = [shape[1]] if reach.reaches_across(halo) else _sides(shape[1])
    across = {width: _parts(shape[1], width, halo.left, halo.right, aligned) for width in columns}
    down = {height: _parts(shape[0], height, halo.up, halo.down, aligned) for height in _sides(shape[0])}
    for width, widths in across.items():
        for height, heights in down.items():
            core = Rectangle(0, height, 0, width)
            most = needs(Tile(core, Rectangle(0, max(heights), 0, max(widths))))
            least = min(least, most)
            if most > room:
                continue
            work = sum(heights) * sum(widths)
            if best is None or work < best[0]:
                best = work, (height, width), most
            break  # lower tiles of this width only have more halo
    if best is None:
        raise ValueError(
            f"memory must leave at least {least / 2**20:.0f} MiB for a tile and its halo of "
            f"{min(halo.up + halo.down, shape[0])} rows and {min(halo.left + halo.right, shape[1])} columns, "
            f"not {max(room, 0) / 2**20:.0f} MiB"
        )
    _, side, most = best
    return Plan(tuple(tiles(shape, side, halo, aligned)), side, halo, most)


def _parts(length: int, side: int, before: int, behind: int, aligned: int) -> list[int]:
    """How long the parts are along one axis; see `grid.tile`."""
    return [
        min(length, min(length, first + side) + behind) - max(0, first - before) // aligned * aligned
        for first in range(0, length, side)
    ]


def _sides(side: int) -> list[int]:
    """Sides to try, the largest first: equal parts of the image, and what is a multiple of `MULTIPLE`."""
    sides = {side}
    count = 2
    while True:
        part = -(-side // count)
        rounded = -(-part // MULTIPLE) * MULTIPLE if part > MULTIPLE // 2 else max(SMALLEST, part)
        sides.add(min(side, rounded))
        if part <= SMALLEST:
            return sorted(sides, reverse=True)
        count = count + 1 if count < 16 else count * 5 // 4
