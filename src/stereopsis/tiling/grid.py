"""Where the tiles of an image lie, and what of the images each is matched from."""

from __future__ import annotations

from typing import NamedTuple

from stereopsis.types import Halo, Rectangle


class Tile(NamedTuple):
    """A piece of the image, and the part of both images that it is matched from.

    Attributes
    ----------
    core : Rectangle
        What is answered.
    part : Rectangle
        The same columns of both images: the core and its halo, as far as the image goes.
    """

    core: Rectangle
    part: Rectangle

    @property
    def within(self) -> tuple[slice, slice]:
        """The core, as an index of the part."""
        return (
            slice(self.core.top - self.part.top, self.core.bottom - self.part.top),
            slice(self.core.left - self.part.left, self.core.right - self.part.left),
        )


def tile(core: Rectangle, shape: tuple[int, int], halo: Halo, aligned: int = 1) -> Tile:
    """A core with its halo; the part begins at multiples of `aligned`."""
    top, left = (
        max(0, first - around) // aligned * aligned
        for first, around in ((core.top, halo.up), (core.left, halo.left))
    )
    bottom, right = min(shape[0], core.bottom + halo.down), min(shape[1], core.right + halo.right)
    return Tile(core, Rectangle(top, bottom, left, right))


def tiles(shape: tuple[int, int], side: tuple[int, int], halo: Halo, aligned: int = 1) -> list[Tile]:
    """Tiles that cover an image, row by row.

    Parameters
    ----------
    shape : (H, W)
        Of the image.
    side : (height, width)
        Of a tile; those at the image's end are what is left.
    halo : Halo
    aligned : int
        What each part's first row and column are multiples of.
    """
    (height, width), (rows, columns) = shape, side
    return [
        tile(Rectangle(top, min(top + rows, height), left, min(left + columns, width)), shape, halo, aligned)
        for top in range(0, height, rows)
        for left in range(0, width, columns)
    ]
