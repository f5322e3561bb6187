"""A pair that is larger than a worker's memory: its tiles are tasks of their own, on any worker.

The worker that is given the pair finds what has to be found once and how it is cut. Each tile is matched and
kept in the run's place, then one worker puts all of them together: whatever is killed, what is kept stays.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from stereopsis import tiling
from stereopsis.batch.store import TILES, Store
from stereopsis.settings import Settings
from stereopsis.tiling.parts import Piece

RESIDENT: Final = 128 * 2**20
"""Bytes of a worker without a tile. Not measured: an image is cut alike on every worker, in every run."""

SUFFIXES: Final = ("tif", "tiff", "npy", "pfm")
"""Of the maps that are written in parts."""

VALUES: Final = np.dtype([("disparity", "<f4"), ("flags", "u1")])
"""What is kept of each pixel of a tile."""


@dataclass(frozen=True)
class Cut:
    """What becomes of a pair that is too large: its tiles, and the seconds that finding them took."""

    tiles: tiling.Job
    seconds: float


@dataclass(frozen=True)
class Tile:
    """A tile to be matched, or all of them to be put together.

    Attributes
    ----------
    index, sample, path
        Of the pair, as in `work.Item`.
    tiles : tiling.Job
    number : int or None
        Which tile; None: all are there.
    seconds : float
        That the tiles took so far.
    """

    index: int
    sample: Any
    path: str
    tiles: tiling.Job
    number: int | None
    seconds: float = 0.0


@dataclass(frozen=True)
class Matched:
    """A tile is there, after so many seconds."""

    seconds: float


@dataclass(frozen=True)
class Step:
    """How far a pair is."""

    name: str
    finished: int
    tiles: int

    def __str__(self) -> str:
        return f"{self.name}: tile {self.finished} of {self.tiles}"


def cut(sample: Any, settings: Settings, memory: int, format: str, *, scored: bool) -> tiling.Job | None:
    """The tiles of a pair; None where it has no files, or fits the memory as it is.

    Raises
    ------
    ValueError
        It has to be whole: for its format, a score, or settings that tiles cannot serve.
    OSError
        A file cannot be read.
    """
    left, right = (getattr(sample, name, None) for name in ("left_file", "right_file"))
    if left is None or right is None:
        return None
    if tiling.whole_fits(left, right, settings, memory, resident=RESIDENT)[0]:
        return None
    too_large = f"the pair is larger than a memory of {memory / 2**20:.0f} MiB"
    if format not in SUFFIXES:
        raise ValueError(f"{too_large}, and in tiles {', '.join(SUFFIXES)} are written, not {format}")
    if scored and getattr(sample, "truth_file", None) is not None:
        raise ValueError(f"{too_large}, and a score needs the whole map: allow more, or do without")
    return tiling.prepare(left, right, settings, memory=memory, resident=RESIDENT)


def is_there(store: Store, item: Tile) -> bool:
    """Whether a tile is kept already."""
    assert item.number is not None
    return store.size(name_of(item.path, item.number)) == _bytes(item.tiles, item.number)


def match(item: Tile) -> bytes:
    """Match a tile: what is kept of it."""
    assert item.number is not None
    piece = item.tiles.match(item.number)
    values = np.empty(piece.core.shape, VALUES)
    values["disparity"], values["flags"] = piece.disparity, piece.flags
    del piece
    return values.tobytes()


def join(store: Store, item: Tile, name: str) -> tiling.Tiled:
    """Put the tiles together, into the map of this name.

    Raises
    ------
    OSError
        The map cannot be written, or a tile is gone.
    """

    def pieces() -> Iterator[Piece]:
        for number, tile in enumerate(item.tiles.plan.tiles):
            data = store.read(name_of(item.path, number))
            if data is None or len(data) != _bytes(item.tiles, number):
                raise FileNotFoundError(f"tile {number} of {len(item.tiles)} is gone")
            values = np.frombuffer(data, VALUES).reshape(tile.core.shape)
            del data
            nothing = np.broadcast_to(np.float32(0), tile.core.shape)
            yield Piece(tile.core, values["disparity"], nothing, values["flags"])

    with store.place(name) as file:
        return tiling.assemble(item.tiles, pieces(), file)


def clear(store: Store, item: Tile) -> None:
    """Remove the tiles of a pair."""
    store.remove(name_of(item.path, number) for number in range(len(item.tiles)))


def path_of(name: str) -> str:
    """The path of the pair whose tile this file is."""
    return name.removeprefix(f"{TILES}/").rpartition(".")[0]


def name_of(path: str, number: int) -> str:
    """The file of a tile."""
    return f"{TILES}/{path}.{number:06}"


def _bytes(tiles: tiling.Job, number: int) -> int:
    return tiles.plan.tiles[number].core.size * VALUES.itemsize


@dataclass
class _Pair:
    """A pair of which tiles are still to come."""

    tiles: tiling.Job
    seconds: float
    missing: int


class Desk:
    """The client's side: tiles that are to be handed out, and what comes of them.

    Attributes
    ----------
    waiting : deque of Tile
    """

    def __init__(self) -> None:
        self.waiting: deque[Tile] = deque()
        self._open: dict[int, _Pair] = {}
        self._failed: set[int] = set()

    def take(self, item: Any, answer: Any) -> Any:
        """What came of an item: a `Step` where its pair is not settled yet, None where it was before."""
        match answer:
            case Cut():
                count = len(answer.tiles)
                self._open[item.index] = _Pair(answer.tiles, answer.seconds, count)
                self.waiting.extend(
                    Tile(item.index, item.sample, item.path, answer.tiles, number) for number in range(count)
                )
                return Step(item.sample.name, 0, count)
            case Matched():
                return self._matched(item, answer.seconds)
        if item.index in self._failed:
            return None
        if (
            self._open.pop(item.index, None) is not None
            and isinstance(item, Tile)
            and item.number is not None
        ):
            # Its other tiles are of no use any more.
            self._failed.add(item.index)
            self.waiting = deque(tile for tile in self.waiting if tile.index != item.index)
        return answer

    def _matched(self, item: Tile, seconds: float) -> Step | None:
        pair = self._open.get(item.index)
        if pair is None:
            return None
        pair.missing -= 1
        pair.seconds += seconds
        if not pair.missing:
            self.waiting.appendleft(replace(item, number=None, seconds=pair.seconds))
        return Step(item.sample.name, len(pair.tiles) - pair.missing, len(pair.tiles))
