"""What a worker does: read a pair, match it, write its map, then the row that says that it is done."""

from __future__ import annotations

import errno
import json
import math
import platform
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stereopsis.batch import tiled
from stereopsis.batch.store import MAPS, ROWS, Store
from stereopsis.batch.tiled import Cut, Matched, Step, Tile
from stereopsis.evaluate import Measures, Scores, evaluate
from stereopsis.io._errors import reason
from stereopsis.io.disparity import encode_disparity
from stereopsis.pipeline import match
from stereopsis.settings import Settings
from stereopsis.types import Disparities, DisparityMap, Flag, Result

FORMATS: Final = {"png": "kitti", "pfm": "pfm", "npy": "npy", "tif": "tiff", "tiff": "tiff"}
"""Suffixes of the maps, and what `stereopsis.io.write_disparity` calls them."""

STAGES: Final = ("read", "match", "evaluate", "write")

# Of this one pair's name, not of the place it is written to.
_NAMES_FAULT: Final = frozenset({errno.ENAMETOOLONG, errno.EINVAL, errno.EILSEQ, errno.EISDIR})

Row = dict[str, Any]


class UnwritableError(OSError):
    """The place of the results takes nothing more: no other pair would fare better."""


@dataclass(frozen=True)
class Job:
    """What is the same for every pair.

    Attributes
    ----------
    store : Store
        Where the results go.
    settings : Settings
        With the threads that one pair may take.
    format : str
        The maps' suffix, one of `FORMATS`.
    evaluate : bool
        Whether pairs that have truth are scored.
    run : str
        What rows of the same run carry.
    version : str
        Of this package, at the client.
    memory : int or None
        Bytes that a worker may take: larger pairs go in tiles.
    """

    store: Store
    settings: Settings
    format: str
    evaluate: bool
    run: str
    version: str
    memory: int | None = None


@dataclass(frozen=True)
class Item:
    """A pair to be matched: its place in the data set, its sample, and its file's path without a suffix."""

    index: int
    sample: Any
    path: str


@dataclass(frozen=True)
class Failure:
    """A pair without a result."""

    name: str
    reason: str


Answer = tuple[int, bytes | Failure | Step]
"""A pair's place in the data set, and its record, why there is none, or how far it is."""

Found = bytes | Failure | Cut | Matched
"""What comes of an item on a worker."""


def columns(*, scored: bool) -> tuple[str, ...]:
    """The names of a row's values."""
    flags = (str(flag.name).lower() for flag in Flag)
    own = ("name", "file", "width", "height", "disparity_min", "disparity_max", "density", *flags)
    if not scored:
        return own
    measures = Measures.__dataclass_fields__
    parts = (f"{part}_{measure}" for part in ("own", "all", "filled") for measure in measures)
    return (*own, "known", "answered", "known_density", *parts)


def pairs(job: Job, items: Sequence[Item | Tile]) -> tuple[list[Found], float]:
    """Work through some pairs or tiles on a worker, and say how many seconds it took.

    Raises
    ------
    UnwritableError
        The results cannot be written; what was written before is kept.
    """
    start = time.perf_counter()
    if version() != job.version:
        told = f"worker {platform.node()} runs stereopsis {version()}, the client {job.version}"
        return [Failure(item.sample.name, told) for item in items], 0.0
    return [_found(job, item) for item in items], time.perf_counter() - start


def packed(data: bytes) -> tuple[list[Found], float]:
    """`pairs` of a job and its items that `pack` has put together.

    Opaque to the scheduler, which then holds little and need not know the samples' classes.
    """
    from distributed.protocol import pickle

    job, items = pickle.loads(data)
    return pairs(job, items)


def pack(job: Job, items: Sequence[Item | Tile]) -> bytes:
    """The argument of `packed`; raises whatever a sample that cannot be pickled raises."""
    from distributed.protocol import pickle

    data: bytes = pickle.dumps((job, items))
    return data


def version() -> str:
    """The version of this package."""
    text: str = sys.modules[__name__.partition(".")[0]].__version__
    return text


def source(sample: Any) -> list[str]:
    """The files that a sample is read from."""
    names = ("left_file", "right_file", "truth_file", "calibration_file")
    return [str(getattr(sample, name, None) or "") for name in names]


def record_of(data: bytes | None, run: str) -> dict[str, Any] | None:
    """A record that a worker has written for this run; None where it is not whole or of another run."""
    try:
        record = json.loads(data or b"")
        of_this_run = record["run"] == run and isinstance(record["row"]["file"], str)
    except (ValueError, KeyError, TypeError):
        return None
    return record if of_this_run else None


def _found(job: Job, item: Item | Tile) -> Found:
    try:
        return _pair(job, item) if isinstance(item, Item) else _tile(job, item)
    except UnwritableError:
        raise
    # Whatever is wrong with one pair must not stop the others.
    except Exception as error:
        return Failure(item.sample.name, reason(error))


def _pair(job: Job, item: Item) -> bytes | Failure | Cut:
    if (before := _before(job, item)) is not None:
        return before
    watch = _Watch()
    if job.memory is not None:
        settings = _limited(job.settings)
        cut = tiled.cut(item.sample, settings, job.memory, job.format, scored=job.evaluate)
        watch.lap("match")
        if cut is not None:
            return Cut(cut, watch.seconds["match"])
    row, disparity = _matched(job, item, watch)
    name = _map(job, item)
    with _writing(job, name):
        job.store.write(name, disparity)
    watch.lap("write")
    return _record(job, item, len(disparity), row, watch.seconds)


def _tile(job: Job, item: Tile) -> bytes | Failure | Matched:
    watch = _Watch()
    if item.number is not None:
        name = tiled.name_of(item.path, item.number)
        with _writing(job, name):
            there = tiled.is_there(job.store, item)
        if not there:
            values = tiled.match(item)
            with _writing(job, name):
                job.store.write(name, values)
        watch.lap("match")
        return Matched(watch.seconds["match"])
    found = _before(job, item)
    if found is None:
        name = _map(job, item)
        with _writing(job, name):
            whole = tiled.join(job.store, item, name)
            size = job.store.size(name)
        watch.lap("write")
        (height, width), chosen = whole.shape, whole.settings.disparities
        row = _row(width, height, chosen, whole.density, whole.flagged)
        found = _record(job, item, size, row, {"match": item.seconds, **watch.seconds})
    tiled.clear(job.store, item)
    return found


def _map(job: Job, item: Item | Tile) -> str:
    return f"{MAPS}/{item.path}.{job.format}"


def _before(job: Job, item: Item | Tile) -> bytes | Failure | None:
    """The record of a pair that is finished: its worker died after that, or an earlier client's did it."""
    row_file, map_file, name = f"{ROWS}/{item.path}.json", _map(job, item), item.sample.name
    with _writing(job, row_file):
        data = job.store.read(row_file)
        before = record_of(data, job.run)
        there = before is not None and job.store.size(map_file) == before["bytes"]
    if before is not None and before["row"].get("name") != name:
        return Failure(name, f"its file is that of the pair {before['row'].get('name')!r} here")
    return data if there else None


def _record(job: Job, item: Item | Tile, size: int | None, row: Row, seconds: Mapping[str, float]) -> bytes:
    """Write what says that a pair is done."""
    record = {
        "run": job.run,
        "source": source(item.sample),
        "bytes": size,
        "row": {"name": item.sample.name, "file": _map(job, item), **row},
        "seconds": {stage: round(spent, 6) for stage, spent in seconds.items()},
        "worker": platform.node(),
    }
    data = json.dumps(record, separators=(",", ":")).encode() + b"\n"
    row_file = f"{ROWS}/{item.path}.json"
    with _writing(job, row_file):
        job.store.write(row_file, data)
    return data


class _Watch:
    """Seconds by stage, on a clock that nobody sets."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, stage: str) -> None:
        """Count what has passed since the last lap to a stage."""
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now


@contextmanager
def _writing(job: Job, file: str) -> Iterator[None]:
    """Tell the errors of the results' place from those of a pair."""
    try:
        yield
    except Exception as error:
        if isinstance(error, OSError) and error.errno in _NAMES_FAULT:
            raise
        why = error.strerror if isinstance(error, OSError) and error.strerror else reason(error)
        raise UnwritableError(f"{job.store}/{file}: {why} (on {platform.node()})") from None


def _matched(job: Job, item: Item, watch: _Watch) -> tuple[Row, bytes]:
    """The row of a pair and the bytes of its map."""
    sample = item.sample
    pair = sample.pair()
    # Before the matching: a broken truth costs no time.
    truth = sample.truth() if job.evaluate else None
    mask = sample.mask() if truth is not None else None
    if truth is not None and truth.shape != pair.left.shape[:2]:
        (height, width), (rows, across) = pair.left.shape[:2], truth.shape
        raise ValueError(f"the truth is {across} x {rows} pixels, the images are {width} x {height}")
    watch.lap("read")
    result = match(pair, settings=_limited(job.settings))
    watch.lap("match")
    data, stored = encode_disparity(_in_front(result, job.format), FORMATS[job.format])
    row = _facts(result)
    watch.lap("write")
    if truth is not None:
        # Of the map as its file has it: whoever scores the file finds the same numbers.
        row |= _scores(evaluate(stored, truth, mask))
        watch.lap("evaluate")
    return row, data


def _in_front(result: Result, format: str) -> DisparityMap:
    """The map without what a sub-pixel fit has put behind infinity, where the range begins there."""
    chosen = result.settings.disparities
    if format != "png" or chosen is None or chosen.min < 0:
        return result.disparity
    return np.maximum(result.disparity, np.float32(0))


def _scores(scores: Scores) -> Row:
    found: Row = {"known": scores.known, "answered": scores.answered, "known_density": scores.density}
    for part in ("own", "all", "filled"):
        found |= {f"{part}_{name}": value for name, value in vars(getattr(scores, part)).items()}
    return {
        name: None if isinstance(value, float) and math.isnan(value) else value
        for name, value in found.items()
    }


def _limited(settings: Settings) -> Settings:
    """No more threads than this worker's share of its machine's cores."""
    if settings.threads <= 1:
        return settings
    from dask.system import cpu_count
    from distributed import get_worker

    share = int(cpu_count()) // max(1, get_worker().state.nthreads)
    return settings.changed(threads=max(1, min(settings.threads, share)))


def _facts(result: Result) -> Row:
    height, width = result.disparity.shape
    counts = np.bincount(result.flags.ravel(), minlength=256)
    flagged = {flag: int(counts[np.arange(256) & flag > 0].sum()) for flag in Flag}
    return _row(width, height, result.settings.disparities, result.density, flagged)


def _row(
    width: int, height: int, chosen: Disparities | None, density: float, flagged: Mapping[Flag, int]
) -> Row:
    return {
        "width": width,
        "height": height,
        "disparity_min": chosen.min if chosen else None,
        "disparity_max": chosen.max if chosen else None,
        "density": density,
        **{str(flag.name).lower(): flagged[flag] for flag in Flag},
    }
