"""The pieces put together: into arrays, or into files."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stereopsis.io.parts import Map
from stereopsis.tiling.parts import Known, Piece, repeats_rows
from stereopsis.types import Flag, Rectangle


class Canvas(NamedTuple):
    """An array as a `Map`."""

    array: npt.NDArray[Any]

    def read(self, part: Rectangle) -> npt.NDArray[Any]:
        """What was written there."""
        return self.array[part.slices]

    def write(self, part: Rectangle, values: npt.NDArray[Any]) -> None:
        """The values of a rectangle."""
        self.array[part.slices] = values


class Mosaic:
    """Puts the pieces of one image together, in whatever order they come.

    Parameters
    ----------
    known : Known
    disparity : Map
        Of float32.
    confidence, flags : Map, optional
        Of float32, and of uint8.
    """

    def __init__(
        self, known: Known, disparity: Map, confidence: Map | None = None, flags: Map | None = None
    ) -> None:
        self._maps = disparity, confidence, flags
        self._shape = known.frame.shape
        self._repeats = repeats_rows(known.settings)
        self._answered_rows = np.zeros(self._shape[0], bool)
        self._outermost: dict[int, npt.NDArray[np.float32]] = {}
        self._answered = 0
        self._flagged = np.zeros(8, np.int64)

    @property
    def density(self) -> float:
        """The fraction of pixels that hold a disparity."""
        return self._answered / (self._shape[0] * self._shape[1])

    @property
    def flagged(self) -> dict[Flag, int]:
        """How many pixels hold each flag."""
        return {flag: int(self._flagged[flag.bit_length() - 1]) for flag in Flag}

    def add(self, piece: Piece) -> None:
        """Write a piece where it belongs."""
        maps: tuple[npt.NDArray[Any], ...] = piece.disparity, piece.confidence, piece.flags
        for into, values in zip(self._maps, maps, strict=True):
            if into is not None:
                into.write(piece.core, values)
        finite = np.isfinite(piece.disparity)
        self._answered += int(np.count_nonzero(finite))
        for bit in range(8):
            self._flagged[bit] += int(np.count_nonzero(piece.flags & np.uint8(1 << bit)))
        if self._repeats:
            rows = np.flatnonzero(finite.any(axis=1))
            self._answered_rows[piece.core.top + rows] = True
            for row in {rows[0], rows[-1]} if rows.size else set():
                self._outermost[piece.core.top + int(row)] = piece.disparity[row].copy()

    def finish(self) -> None:
        """What only all pieces together tell: rows beyond the first and the last answered one repeat it."""
        rows = np.flatnonzero(self._answered_rows)
        if not self._repeats or not rows.size:
            return
        first, last = int(rows[0]), int(rows[-1])
        outer = ((first, range(first)), (last, range(last + 1, self._shape[0])))
        for source, repeats in outer:
            for row in repeats:
                self._repeat(self._outermost[source], row)

    def _repeat(self, values: npt.NDArray[np.float32], row: int) -> None:
        disparity, _, flags = self._maps
        assert disparity is not None
        part, filled = Rectangle(row, row + 1, 0, self._shape[1]), np.isfinite(values)
        disparity.write(part, values[None])
        if flags is not None:
            flags.write(part, flags.read(part) | np.where(filled, np.uint8(Flag.FILLED), np.uint8(0)))
        self._answered += int(np.count_nonzero(filled))
        self._flagged[Flag.FILLED.bit_length() - 1] += int(np.count_nonzero(filled))
