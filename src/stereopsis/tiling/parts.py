"""Match one tile, from what was found once of the whole pair."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stereopsis import pipeline
from stereopsis.io.parts import Source
from stereopsis.settings import Settings
from stereopsis.tiling import reach
from stereopsis.tiling.grid import Tile
from stereopsis.types import DisparityMap, Flag, Frame, Image, Rectangle


class Array(NamedTuple):
    """An image in memory, as a `Source`."""

    image: Image

    @property
    def shape(self) -> tuple[int, ...]:
        """``(H, W)`` or ``(H, W, 3)``."""
        return self.image.shape

    @property
    def dtype(self) -> np.dtype[Any]:
        """uint8, uint16 or float32."""
        return self.image.dtype

    def read(self, part: Rectangle) -> Image:
        """The pixels of a rectangle; a view."""
        return self.image[part.slices]


class Changed(NamedTuple):
    """An image whose pixels are changed as they are read, as a `Source`."""

    source: Source
    dtype: np.dtype[Any]
    change: Callable[[Image, Rectangle], Image]

    @property
    def shape(self) -> tuple[int, ...]:
        """``(H, W)`` or ``(H, W, 3)``."""
        return self.source.shape

    def read(self, part: Rectangle) -> Image:
        """The pixels of a rectangle."""
        return self.change(self.source.read(part), part)


def without_borders(sources: tuple[Source, Source], borders: pipeline.Borders) -> tuple[Source, Source]:
    """Both images, continued over the borders that they have."""
    left, right = (
        source if border is None else Changed(source, source.dtype, border.continued)
        for source, border in zip(sources, borders, strict=True)
    )
    return left, right


@dataclass(frozen=True)
class Known:
    """What is found once of the whole pair, and told to every tile.

    Attributes
    ----------
    settings : Settings
        With nothing left to be estimated.
    frame : Frame
        Of the whole images.
    largest : float or None
        Largest magnitude of their pixels, where these are floats.
    step : float or None
        What their pixels are whole multiples of, where they are matched as bytes (`quantum.of`).
    borders : (Border or None, Border or None)
        Their black borders, where these are left out.
    """

    settings: Settings
    frame: Frame
    largest: float | None = None
    step: float | None = None
    borders: pipeline.Borders = (None, None)


class Piece(NamedTuple):
    """What a tile is answered: the arrays of `Result`, of its core."""

    core: Rectangle
    disparity: DisparityMap
    confidence: npt.NDArray[np.float32]
    flags: npt.NDArray[np.uint8]


def match_tile(left: Source, right: Source, known: Known, tile: Tile) -> Piece:
    """Read a tile's part of both images, match it, and cut out its core.

    Parameters
    ----------
    left, right : Source
    known : Known
    tile : Tile

    Returns
    -------
    Piece
    """
    frame = dataclasses.replace(known.frame, top=tile.part.top, left=tile.part.left)
    left, right = without_borders((left, right), known.borders)
    found = pipeline.match_part(
        left.read(tile.part),
        right.read(tile.part),
        known.settings,
        frame,
        known.largest,
        known.step,
        known.borders,
    )
    if repeats_rows(known.settings):
        _empty_unanswered(found.disparity, found.confidence, found.flags)
    return Piece(
        tile.core,
        found.disparity[tile.within].copy(),
        found.confidence[tile.within].copy(),
        found.flags[tile.within].copy(),
    )


def repeats_rows(settings: Settings) -> bool:
    """Whether rows without any answer are to repeat those next to them."""
    return settings.fill == "background" and settings.confidence is None and not reach.measured(settings)


def _empty_unanswered(
    disparity: DisparityMap, confidence: npt.NDArray[np.float32], flags: npt.NDArray[np.uint8]
) -> None:
    """Take back what rows without any answer were given: which row they repeat, the whole image tells."""
    rows = np.all(flags & np.uint8(Flag.FILLED), axis=1)
    disparity[rows], confidence[rows] = np.nan, 0
    flags[rows] &= np.uint8(~np.uint8(Flag.FILLED))
