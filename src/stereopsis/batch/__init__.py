"""A whole data set through `match`: on this machine or on a Dask cluster, nothing lost.

::

    from stereopsis import batch, datasets
    if __name__ == "__main__":
        report = batch.run(datasets.open("kitti2015"), out="out", evaluate=True)
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from stereopsis import _extras
from stereopsis._numbers import is_whole
from stereopsis.batch.work import FORMATS, Failure
from stereopsis.settings import DEFAULT_PRESET, PRESETS, Settings

if TYPE_CHECKING:
    from stereopsis.batch.job import Progress

__all__ = ["Failure", "Report", "require", "run"]


@dataclass(frozen=True)
class Report:
    """What came of a data set.

    Attributes
    ----------
    out : str
        Where the results are.
    pairs : int
        Pairs of the data set.
    done : int
        Those that have a result, `reused` among them.
    reused : int
        Those that an earlier run had finished.
    failures : tuple of Failure
        The others, each with its `name` and the `reason`, in the data set's order.
    means : mapping of str to float
        Means over the pairs with a result: ``density``, and of those with truth every measure of
        ``results.csv``; a measure that some pair has as infinite or not at all is left out of its mean.
    seconds : float
        Wall time.
    """

    out: str
    pairs: int
    done: int
    reused: int
    failures: tuple[Failure, ...]
    means: Mapping[str, float]
    seconds: float


def require() -> None:
    """Check that what the extra ``cluster`` brings is installed.

    Raises
    ------
    ModuleNotFoundError
        Something is missing; names it and the extra.
    """
    _extras.require("batch needs", "cluster", "dask", "distributed", "fsspec")


def run(
    samples: Iterable[Any],
    settings: Settings | None = None,
    out: str | os.PathLike[str] = "out",
    client: Any = None,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    evaluate: bool = False,
    format: str = "png",
    memory: int | str | None = None,
    resume: bool = True,
    overwrite: bool = False,
    storage_options: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> Report:
    """Match every pair of a data set, and keep each result as soon as it is there.

    Images are read and maps are written by the workers, each map whole or not at all, then its row; the
    client holds rows alone. A run that was ended by whatever goes on where it stopped when it is called
    again: no finished pair is computed twice, and the tables are those of an undisturbed run.

    The place gets ``disparity/NAME.FORMAT``, ``results.csv`` (a line a pair, in the data set's order),
    ``timings.csv``, ``failures.csv``, ``run.toml``, and ``rows/``, from which a run goes on.

    Parameters
    ----------
    samples : iterable of Sample
        Such as `stereopsis.datasets.open` gives; gone through once, only as far ahead as workers need. Each
        has a `name`, and `pair()`, `truth()` and `mask()`, which are called on a worker.
    settings : Settings, optional
        By default the preset "fast". `threads` is how many a pair may take: one where it is 0.
    out : str or path-like
        A folder that every worker sees, made if it is not there; or a URL that fsspec knows, such as
        ``s3://bucket/run``.
    client : distributed.Client, optional
        Of a Dask cluster. By default, processes of this machine; a script needs ``if __name__ ==
        "__main__":`` then.
    scheduler : str, optional
        The address of a Dask scheduler instead, such as ``tcp://host:8786``.
    workers : int, optional
        Processes of this machine. By default, one for each core, as far as `memory` lets them.
    evaluate : bool, default False
        Score each map that has truth, as its file has it, inside the data set's mask where it has one.
    format : {"png", "pfm", "npy", "tif", "tiff"}
        What the maps are written as; see `stereopsis.write_disparity`.
    memory : int or str, optional
        What a worker may take for a pair, in bytes or such as ``"2GiB"``. A larger pair of files is matched
        in tiles, which are spread over the workers: into "tif", "tiff", "npy" or "pfm", without a score.
    resume : bool, default True
        Go on with the run that `out` holds. False: refuse to.
    overwrite : bool, default False
        Remove the run that `out` holds, whatever it is, and begin anew.
    storage_options : mapping, optional
        What fsspec's file system is made with; sent to the workers, never written.
    progress : callable, optional
        Called with the pairs finished, the pairs there are or None, and a text.

    Returns
    -------
    Report

    Raises
    ------
    ModuleNotFoundError
        Without the extra ``cluster``.
    TypeError, ValueError
        An argument is not allowed; or `out` holds a run of other settings, of another data set or of another
        version, and `overwrite` is False.
    OSError
        `out` cannot be written or another run writes there; no scheduler or worker answers, or the scheduler
        is lost. What is finished is kept.
    KeyboardInterrupt
        After Ctrl-C; what is finished is kept.
    """
    require()
    from stereopsis.batch import cluster, job, record, store, work
    from stereopsis.tiling.memory import as_bytes

    start = time.monotonic()
    if isinstance(samples, str | os.PathLike):
        raise TypeError(f"samples must be what stereopsis.datasets.open({str(samples)!r}) gives, not a path")
    if settings is not None and not isinstance(settings, Settings):
        raise TypeError(f"settings must be Settings or None, not {type(settings).__name__}")
    if format not in FORMATS:
        raise ValueError(f"format must be one of {', '.join(FORMATS)}, not {format!r}")
    if (client is not None) + (scheduler is not None) + (workers is not None) > 1:
        raise ValueError("give at most one of client, scheduler and workers")
    if getattr(client, "asynchronous", False):
        raise ValueError("client must not be asynchronous")
    chosen = PRESETS[DEFAULT_PRESET] if settings is None else settings
    threads = max(1, chosen.threads)
    most = None if memory is None else as_bytes(memory)
    identity = record.Identity.of(samples, chosen, format, evaluate, most)
    place = store.at(out, storage_options)
    todo = work.Job(
        place,
        chosen.changed(threads=threads, keep=()),
        format,
        evaluate,
        identity.run,
        identity.version,
        most,
    )
    reached: AbstractContextManager[Any]
    if client is not None:
        reached = nullcontext(client)
    elif scheduler is not None:
        reached = cluster.connected(scheduler)
    else:
        room = None if most is None else cluster.room_for(most)
        reached = cluster.local(_workers(workers, threads, cluster.cores(), room))
    place.prepare()
    with place.lock():
        job.prepare(place, identity, resume=resume, overwrite=overwrite)
        table = job.carry_out(samples, todo, reached, progress)
    failures = tuple(table.failures)
    return Report(
        out=str(place),
        pairs=table.taken,
        done=table.taken - len(failures),
        reused=table.reused,
        failures=failures,
        means=_means(table),
        seconds=time.monotonic() - start,
    )


def _workers(asked: int | None, threads: int, cores: int, room: int | None = None) -> int:
    """So many that their threads do not exceed the cores, and by themselves not what there is room for."""
    if asked is None:
        return max(1, min(cores // threads, cores if room is None else room))
    if not is_whole(asked) or asked < 1 or asked * threads > max(cores, threads):
        several = f" with {threads} threads each" if threads > 1 else ""
        most = max(1, cores // threads)
        raise ValueError(f"workers must be a whole number from 1 to {most}{several}, not {asked!r}")
    return int(asked)


def _means(table: Any) -> dict[str, float]:
    sums: dict[str, tuple[float, int]] = {}
    for found in table.records():
        for name, value in found["row"].items():
            if (name == "density" or "_" in name) and isinstance(value, float) and math.isfinite(value):
                total, count = sums.get(name, (0.0, 0))
                sums[name] = total + value, count + 1
    return {name: total / count for name, (total, count) in sums.items()}
