"""How an image is cut: as few tiles as the memory allows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from stereopsis.settings import Settings
from stereopsis.tiling import reach
from stereopsis.tiling.grid import Tile, tiles
from stereopsis.types import WHOLE, Halo

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
    best: tuple[int, Plan] | None = None
    least = WHOLE**3
    for width in _sides(shape[1]) if not reach.reaches_across(halo) else [shape[1]]:
        for height in _sides(shape[0]):
            found = tuple(tiles(shape, (height, width), halo, aligned))
            most = max(needs(tile) for tile in found)
            least = min(least, most)
            if most > room:
                continue
            work = sum(tile.part.size for tile in found)
            if best is None or work < best[0]:
                best = work, Plan(found, (height, width), halo, most)
            break  # lower tiles of this width only have more halo
    if best is None:
        raise ValueError(
            f"memory must leave at least {least / 2**20:.0f} MiB for a tile and its halo of "
            f"{min(halo.up + halo.down, shape[0])} rows and {min(halo.left + halo.right, shape[1])} columns, "
            f"not {max(room, 0) / 2**20:.0f} MiB"
        )
    return best[1]


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
