"""Coarse to fine: which disparities each tile of a large image has to search, told by a small map.

A scene's disparities span much, but a small part of it spans little. A map of halved images says roughly
what; each tile is then matched over its own range, at full size, with as much around it as its windows see.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from stereopsis import fill
from stereopsis.types import Disparities, DisparityMap

SIDE = 256
"""About how wide and high a tile is, in pixels."""
AROUND = 2
"""How many pixels of the small map around a tile count for it too."""
MARGIN = 2
"""How many of its pixels of disparity are added to a tile's range, above and below."""
KNOWN = 0.25
"""Least fraction of a tile that the small map must answer: else as much as a tile around it counts too."""


class Tile(NamedTuple):
    """A rectangle of the left image and what it searches.

    Attributes
    ----------
    top, bottom, left, right : int
        Rows ``top, ..., bottom - 1`` and columns ``left, ..., right - 1``.
    disparities : Disparities
    """

    top: int
    bottom: int
    left: int
    right: int
    disparities: Disparities


class Cut(NamedTuple):
    """What of a pair is matched for a tile.

    Attributes
    ----------
    rows, left, right : slice
        Of both images; columns of the left one; columns of the right one, as many.
    shift : int
        By how many columns the right cut lies further left: what is to be added to each disparity.
    core : tuple of slice
        The tile within the cut.
    """

    rows: slice
    left: slice
    right: slice
    shift: int
    core: tuple[slice, slice]


def plan(first: DisparityMap, factor: int, shape: tuple[int, int], disparities: Disparities) -> list[Tile]:
    """Tiles that cover an image, each with the range that a small map gives it.

    Parameters
    ----------
    first : ndarray of float32, (h, w)
        Reliable disparities of shrunken images, in their own pixels; NaN where there is none.
    factor : int
        How many pixels of the image one of the map is wide and high.
    shape : (H, W)
        Of the image.
    disparities : Disparities
        The whole range.

    Returns
    -------
    list of Tile
        Row by row. The range of each spans what the map, its holes filled from the background, has in it and
        `AROUND` it, and `MARGIN`; where the map says nothing, everything.
    """
    filled = fill.background(first)
    tiles = []
    for top, bottom in _split(shape[0]):
        for left, right in _split(shape[1]):
            own = _part(first, factor, (top, bottom, left, right), 0)
            around = AROUND if np.isfinite(own).mean() >= KNOWN else AROUND + SIDE // factor
            seen = _part(filled, factor, (top, bottom, left, right), around)
            found = _range(seen, factor, disparities)
            tiles.append(Tile(top, bottom, left, right, found))
    return tiles


def _range(seen: DisparityMap, factor: int, disparities: Disparities) -> Disparities:
    finite = seen[np.isfinite(seen)]
    if not finite.size:
        return disparities
    low = int(np.floor((float(finite.min()) - MARGIN) * factor))
    high = int(np.ceil((float(finite.max()) + MARGIN) * factor)) + 1
    low, high = max(low, disparities.min), min(high, disparities.max)
    return Disparities(low, high) if low < high else disparities


def _split(side: int) -> list[tuple[int, int]]:
    count = max(1, round(side / SIDE))
    return list(itertools.pairwise(side * k // count for k in range(count + 1)))


def _part(map: DisparityMap, factor: int, ends: tuple[int, int, int, int], around: int) -> DisparityMap:
    """What of the small map lies in a tile, or near it; an odd rest of the image lies in its last ones."""
    top, bottom, left, right = ends
    rows, columns = (
        slice(
            max(0, min(first // factor, side - 1) - around),
            min(side, max(-(-last // factor), min(first // factor, side - 1) + 1) + around),
        )
        for first, last, side in ((top, bottom, map.shape[0]), (left, right, map.shape[1]))
    )
    return map[rows, columns]


def cut(tile: Tile, shape: tuple[int, int], halo: tuple[int, int]) -> Cut:
    """What a tile's winners, and their left-right check, can depend on.

    Parameters
    ----------
    tile : Tile
    shape : (H, W)
    halo : (columns, rows)
        How far a window reaches.

    Returns
    -------
    Cut
        The right columns lie further left by the range's minimum where they can, which keeps the cut narrow;
        near the image's sides both are cut at the same columns, so that what is out of view stays so.
    """
    height, width = shape
    low, high = tile.disparities
    reach = halo[0] + high - low
    first, last = tile.left - reach, tile.right + reach
    shift = low
    if first < 0 or last > width or first - low < 0 or last - low > width:
        shift = 0
        first = max(0, tile.left - reach - max(0, high))
        last = min(width, tile.right + reach + max(0, -low))
    top, bottom = max(0, tile.top - halo[1]), min(height, tile.bottom + halo[1])
    core = np.s_[tile.top - top : tile.bottom - top, tile.left - first : tile.right - first]
    columns = slice(first - shift, last - shift)
    return Cut(slice(top, bottom), slice(first, last), columns, shift, core)
