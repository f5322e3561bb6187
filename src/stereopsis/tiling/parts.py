"""Match one tile, from what was found once of the whole pair."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stereopsis import blank, pipeline
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


class Continued(NamedTuple):
    """An image that is continued over its black frame, as a `Source`."""

    source: Source
    frame: blank.Frame

    @property
    def shape(self) -> tuple[int, ...]:
        """``(H, W)`` or ``(H, W, 3)``."""
        return self.source.shape

    @property
    def dtype(self) -> np.dtype[Any]:
        """uint8, uint16 or float32."""
        return self.source.dtype

    def read(self, part: Rectangle) -> Image:
        """The pixels of a rectangle."""
        return blank.continued(self.source.read(part), self.frame, part)


def without_frames(sources: tuple[Source, Source], frames: pipeline.Frames) -> tuple[Source, Source]:
    """Both images, continued over the frames that they have."""
    left, right = (
        source if frame is None else Continued(source, frame)
        for source, frame in zip(sources, frames, strict=True)
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
    frames : (blank.Frame or None, blank.Frame or None)
        Their black frames, where these are left out.
    """

    settings: Settings
    frame: Frame
    largest: float | None = None
    step: float | None = None
    frames: pipeline.Frames = (None, None)


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
    left, right = without_frames((left, right), known.frames)
    found = pipeline.match_part(
        left.read(tile.part),
        right.read(tile.part),
        known.settings,
        frame,
        known.largest,
        known.step,
        known.frames,
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
