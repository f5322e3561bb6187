"""Pairs of images larger than memory, from files into files."""

from __future__ import annotations

import dataclasses
import math
import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis._files import as_path
from stereopsis.io import parts as files
from stereopsis.io._errors import StrPath
from stereopsis.settings import DEFAULT_PRESET, Settings, named
from stereopsis.tiling import memory as memory_
from stereopsis.tiling import reach
from stereopsis.tiling.grid import Tile
from stereopsis.tiling.mosaic import Mosaic
from stereopsis.tiling.parts import Known, Piece, match_tile
from stereopsis.tiling.plan import Plan, plan
from stereopsis.tiling.survey import BAND, survey, with_planes
from stereopsis.types import Flag, Rectangle

Progress = Callable[[int, int, str], None]
"""Called with how many tiles are finished, how many there are, and what is being done."""
DTYPES = (np.float32, np.float32, np.uint8)
"""Of the maps: disparity, confidence, flags."""
SURVEYED = 80
"""Bytes a pixel of the bands that the images are surveyed in, at most."""
SPARE = 16 * 2**20
"""Bytes that are kept free of the model: buffers of files, scratch rows of threads."""


@dataclass(frozen=True)
class Tiled:
    """A pair that was matched in tiles.

    Attributes
    ----------
    shape : (H, W)
    settings : Settings
        Everything that was used, what was estimated included.
    tiles : int
        How many there were.
    side : (height, width)
        Of a tile, but for those at the image's end.
    density : float
        The fraction of pixels that hold a disparity.
    flagged : mapping of Flag to int
        How many pixels hold each flag.
    seconds : float
        Wall time.
    measured : tuple of str
        Settings for which tiles agree with the whole image nearly, not to the bit: see docs/tiling.md. None
        where there was one tile.
    """

    shape: tuple[int, int]
    settings: Settings
    tiles: int
    side: tuple[int, int]
    density: float
    flagged: dict[Flag, int]
    seconds: float
    measured: tuple[str, ...]


@dataclass(frozen=True)
class Job:
    """A pair in files, cut into tiles that can be matched one by one, anywhere, and in any order.

    It can be pickled. `match` of a number gives a `Piece`; `assemble` takes them.

    Attributes
    ----------
    left, right : str
        The files.
    known : Known
        What was found once of the whole pair.
    plan : Plan
    """

    left: str
    right: str
    known: Known
    plan: Plan

    def __len__(self) -> int:
        return len(self.plan.tiles)

    def match(self, number: int) -> Piece:
        """Read, match and cut out one tile; the images are opened for it."""
        with files.open_parts(self.left) as left, files.open_parts(self.right) as right:
            return match_tile(left, right, self.known, self.plan.tiles[number])


def match(
    left: StrPath,
    right: StrPath,
    output: StrPath | Sequence[StrPath],
    *,
    settings: Settings | None = None,
    memory: int | str = "2GiB",
    confidence: StrPath | None = None,
    flags: StrPath | None = None,
    progress: Progress | None = None,
) -> Tiled:
    """Match a pair of any size within so much memory, from files into files.

    Range, rows that the right image lies too low, and whatever else no tile can tell alone are found first,
    in a pass over the files. Then as few tiles as fit are matched, each with its halo. Local methods give
    the same bits as the whole image, others nearly; see docs/tiling.md. Where everything fits at once there
    is one tile, and the result is that of `stereopsis.match`.

    Parameters
    ----------
    left, right : path
        A rectified pair. TIFF, NPY and Zarr are read in parts; other images are decoded whole.
    output : path, or sequence of paths
        Disparities as float32, NaN where invalid: TIFF, NPY, PFM or Zarr. Whole or not at all.
    settings : Settings, optional
        None: the preset "fast".
    memory : int or str
        The most that the whole process may take, in bytes, or such as ``"2GiB"``.
    confidence, flags : path, optional
        Write these too, as float32 and as uint8.
    progress : callable, optional
        Called with the numbers of tiles that are finished and that there are, and what is being done.

    Returns
    -------
    Tiled

    Raises
    ------
    TypeError
        For paths and settings that are none.
    ValueError
        For images that differ, a file that is written twice or also read, settings that need the whole
        image at once, or too little memory: it says how much is needed.
    OSError
        A file cannot be read or written.
    """
    start = time.perf_counter()
    outputs = _outputs((left, right), output, confidence, flags)
    told = progress or (lambda finished, total, what: None)
    with ExitStack() as stack:
        sources, job = _prepare(left, right, settings, memory, told, stack)

        def pieces() -> Iterator[Piece]:
            for number, tile in enumerate(job.plan.tiles):
                told(number, len(job), _place(tile))
                yield match_tile(*sources, job.known, tile)

        found = _assemble(job, pieces(), outputs)
    told(len(job), len(job), "")
    return dataclasses.replace(found, seconds=time.perf_counter() - start)


def prepare(
    left: StrPath,
    right: StrPath,
    settings: Settings | None = None,
    *,
    memory: int | str = "2GiB",
    resident: int | None = None,
    progress: Progress | None = None,
) -> Job:
    """What `match` finds before the first tile; the tiles can then be spread over workers.

    Parameters
    ----------
    left, right, settings, progress
        As for `match`.
    memory : int or str
        The most that each process may take.
    resident : int, optional
        Bytes of that which each takes without a tile, so that the tiles are the same wherever they are laid
        out; by default what this process takes now.

    Returns
    -------
    Job

    Examples
    --------
    >>> job = prepare("left.tif", "right.tif", memory="1GiB")  # doctest: +SKIP
    >>> assemble(job, pool.imap_unordered(job.match, range(len(job))), "out.tif")  # doctest: +SKIP
    """
    with ExitStack() as stack:
        return _prepare(left, right, settings, memory, progress or (lambda *_: None), stack, resident)[1]


def assemble(
    job: Job,
    pieces: Iterable[Piece],
    output: StrPath | Sequence[StrPath],
    *,
    confidence: StrPath | None = None,
    flags: StrPath | None = None,
) -> Tiled:
    """Write the pieces of a job, in whatever order they come.

    Parameters
    ----------
    job : Job
    pieces : iterable of Piece
        One for each tile.
    output, confidence, flags
        As for `match`.

    Returns
    -------
    Tiled

    Raises
    ------
    ValueError
        Where pieces are missing or come twice.
    """
    return _assemble(job, pieces, _outputs((job.left, job.right), output, confidence, flags))


def whole_fits(
    left: StrPath, right: StrPath, settings: Settings, memory: int | str, *, resident: int | None = None
) -> tuple[bool, int]:
    """Whether a pair can be matched at once within so much memory, and what of it that takes.

    Parameters
    ----------
    left, right, settings, memory
        As for `match`.
    resident : int, optional
        As for `prepare`.

    Returns
    -------
    fits : bool
    needed : int
        Bytes of the whole process.
    """
    reach.check(settings)
    with ExitStack() as stack:
        limit = memory_.as_bytes(memory)
        sources, taken = _open(left, right, limit, stack, resident)
        shape, channels = sources[0].shape, _channels(sources[0])
        chosen = settings.changed(disparities=settings.disparities or (0, max(1, shape[1] // 4)))
        chosen = chosen.changed(vertical=1.0 if chosen.vertical == "estimate" else chosen.vertical)
        per_pixel = memory_.needed(chosen, sources[0].dtype, channels)
        needed = taken + SPARE + int(shape[0] * shape[1] * per_pixel)
    return needed <= limit, needed


def _prepare(
    left: StrPath,
    right: StrPath,
    settings: Settings | None,
    memory: int | str,
    told: Progress,
    stack: ExitStack,
    resident: int | None = None,
) -> tuple[tuple[files.Parts, files.Parts], Job]:
    chosen = named(DEFAULT_PRESET) if settings is None else settings
    reach.refuse(chosen)
    limit = memory_.as_bytes(memory)
    told(0, 0, "opening")
    sources, taken = _open(left, right, limit, stack, resident)
    room = limit - taken - SPARE
    known = survey(
        *sources,
        chosen,
        band=min(BAND, max(2**16, room // SURVEYED)),
        progress=lambda what: told(0, 0, what),
    )
    if resident is None:
        room = min(room, limit - memory_.resident() - SPARE)
    dtype, channels = sources[0].dtype, _channels(sources[0])
    per_pixel = memory_.needed(known.settings, dtype, channels)

    def needs(tile: Tile) -> int:
        # The piece is cut out while the part's result is there, but no longer the images.
        cut = tile.part.size * memory_.OUT + tile.core.size * (memory_.OUT + 2)
        return max(int(tile.part.size * per_pixel), cut) + max(source.passing for source in sources)

    laid = plan(known.frame.shape, known.settings, room, needs)
    if len(laid.tiles) > 1:
        count = len(laid.tiles)
        known = with_planes(*sources, known, laid.tiles, lambda finished: told(finished, count, "planes"))
    return sources, Job(os.fspath(left), os.fspath(right), known, laid)


def _open(
    left: StrPath, right: StrPath, limit: int, stack: ExitStack, resident: int | None
) -> tuple[tuple[files.Parts, files.Parts], int]:
    """Both images, and what the process takes with them: what it takes now, or what it is said to."""
    opened: list[files.Parts] = []
    held = 0
    for path in (left, right):
        decoding = files.opening(path)
        needed = (memory_.resident() if resident is None else resident + held) + SPARE + decoding
        if decoding and needed > limit:
            raise ValueError(
                f"memory must be at least {needed / 2**20:.0f} MiB to decode {path} whole, not "
                f"{limit / 2**20:.0f} MiB; a TIFF, NPY or Zarr file is read in parts"
            )
        opened.append(stack.enter_context(files.open_parts(path)))
        if decoding:
            held += math.prod(opened[-1].shape) * opened[-1].dtype.itemsize
    first, second = opened
    if first.shape != second.shape or first.dtype != second.dtype:
        sides = [f"{path} is {_kind(image)}" for path, image in ((left, first), (right, second))]
        raise ValueError(f"the images of a pair must be alike: {sides[0]}, {sides[1]}")
    return (first, second), memory_.resident() if resident is None else resident + held


def _kind(image: files.Parts) -> str:
    return f"{image.shape[1]} x {image.shape[0]} {'RGB' if image.shape[2:] else 'grey'} {image.dtype}"


def _channels(source: files.Parts) -> int:
    return 3 if source.shape[2:] else 1


def _outputs(
    inputs: tuple[StrPath, StrPath],
    output: StrPath | Sequence[StrPath],
    confidence: StrPath | None,
    flags: StrPath | None,
) -> list[tuple[StrPath, int]]:
    """Files, and which of the maps each holds."""
    if not isinstance(output, str | os.PathLike | Sequence):
        raise TypeError(f"output must be a path, or a sequence of paths, not {type(output).__name__}")
    disparities: list[StrPath] = [output] if isinstance(output, str | os.PathLike) else list(output)
    if not disparities:
        raise ValueError("output must name at least one file")
    found = [(path, 0) for path in disparities]
    found += [(path, number) for path, number in ((confidence, 1), (flags, 2)) if path is not None]
    seen = {as_path(path).resolve() for path in inputs}
    for path, number in found:
        files.check_map(path, DTYPES[number])
        if Path(path).resolve() in seen:
            raise ValueError(f"{path} is also read, or written twice")
        seen.add(Path(path).resolve())
    return found


def _place(tile: Tile) -> str:
    return f"rows {tile.core.top} to {tile.core.bottom}, columns {tile.core.left} to {tile.core.right}"


class _Copies:
    """One map into several files."""

    def __init__(self, maps: list[files.Map]) -> None:
        self._maps = maps

    def read(self, part: Rectangle) -> npt.NDArray[Any]:
        return self._maps[0].read(part)

    def write(self, part: Rectangle, values: npt.NDArray[Any]) -> None:
        for map in self._maps:
            map.write(part, values)


def _assemble(job: Job, pieces: Iterable[Piece], outputs: list[tuple[StrPath, int]]) -> Tiled:
    start = time.perf_counter()
    missing = {tile.core for tile in job.plan.tiles}
    shape = job.known.frame.shape
    with ExitStack() as stack:
        maps: tuple[list[files.Map], ...] = ([], [], [])
        for path, number in outputs:
            maps[number].append(stack.enter_context(files.create_map(path, shape, DTYPES[number])))
        disparity, *others = maps
        copies = (_Copies(found) if found else None for found in others)
        mosaic = Mosaic(job.known, _Copies(disparity), *copies)
        arriving = iter(pieces)
        # A loop variable would keep the last piece while the next tile is matched.
        while (piece := next(arriving, None)) is not None:
            if piece.core not in missing:
                raise ValueError(f"the piece {tuple(piece.core)} is of no tile, or came twice")
            missing.remove(piece.core)
            mosaic.add(piece)
            del piece
        if missing:
            raise ValueError(f"{len(missing)} of {len(job)} tiles are missing, {tuple(min(missing))} first")
        mosaic.finish()
    measured = reach.measured(job.known.settings) if len(job) > 1 else ()
    return Tiled(
        shape,
        job.known.settings,
        len(job),
        job.plan.side,
        mosaic.density,
        mosaic.flagged,
        time.perf_counter() - start,
        measured,
    )
