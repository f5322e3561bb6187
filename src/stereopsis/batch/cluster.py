"""Dask: workers of this machine, a scheduler elsewhere, and pairs handed out a few at a time."""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from itertools import islice
from typing import Any, Final

from stereopsis.batch import work
from stereopsis.batch.work import Answer, Failure, Item, Job, UnwritableError
from stereopsis.io._errors import reason

PATIENCE: Final = 60.0
"""Seconds to wait for a scheduler's first worker."""

CONNECT: Final = 10.0
"""Seconds to wait for the scheduler itself."""

TASK: Final = 0.25
"""Seconds of work that a task holds at least, where there are pairs enough."""

ROUND: Final = 0.002
"""Seconds that a scheduler is given for each task; with more workers, tasks grow."""

LARGEST: Final = 64
"""Pairs in a task at most: what a client has to hold of each is small, and so is what it waits for."""


KEPT: Final = "what is finished is kept, and the same run again goes on"


class LostError(ConnectionError):
    """The scheduler is gone."""


def require() -> None:
    """Check that what the extra ``cluster`` brings is installed.

    Raises
    ------
    ModuleNotFoundError
        Something is missing; names it and the extra.
    """
    missing = [name for name in ("dask", "distributed", "fsspec") if find_spec(name) is None]
    if missing:
        raise ModuleNotFoundError(
            f"batch needs {', '.join(missing)}: install it with python -m pip install 'stereopsis[cluster]'"
        )


def cores() -> int:
    """Cores that this process may use, as its affinity and its control group say."""
    from dask.system import cpu_count

    return max(1, int(cpu_count()))


@contextmanager
def _quiet() -> Iterator[None]:
    """No log of Dask's on the terminal: whatever ends a run is said in one sentence."""
    import distributed  # noqa: F401, sets the levels of its own loggers up

    names = [
        name
        for name in logging.root.manager.loggerDict
        if name.partition(".")[0] in ("distributed", "tornado")
    ]
    before = {name: logging.getLogger(name).level for name in names}
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)


@contextmanager
def local(workers: int) -> Iterator[Any]:
    """A client of processes of this machine, one thread each; one that is killed is started again."""
    from distributed import Client, LocalCluster

    with _quiet():
        cluster = LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address="127.0.0.1:0",
            scheduler_kwargs={"dashboard": False},
            silence_logs=logging.CRITICAL,
            preload=["stereopsis.batch.preload"],
        )
        try:
            with Client(cluster) as client:
                yield client
        finally:
            cluster.close()


@contextmanager
def connected(scheduler: str) -> Iterator[Any]:
    """A client of a scheduler that runs already.

    Raises
    ------
    ConnectionError
        Nobody answers there, or no worker is there.
    """
    from distributed import Client

    with _quiet():
        try:
            client = Client(scheduler, timeout=CONNECT)
        except (OSError, ValueError, TypeError) as error:
            # Dask names the addresses and the errors beneath at length.
            why = "nobody answers" if isinstance(error, OSError) else reason(error)
            raise ConnectionError(f"no Dask scheduler at {scheduler}: {why}") from None
        try:
            yield client
        finally:
            with suppress(Exception):
                client.close(timeout=2)


def threads_of(client: Any, patience: float = PATIENCE) -> int:
    """Threads of all workers, waiting for the first."""
    until = time.monotonic() + patience
    while True:
        threads = sum(client.nthreads().values())
        if threads:
            return int(threads)
        if time.monotonic() > until:
            raise ConnectionError(
                f"no worker has joined {client.scheduler.address} in {patience:.0f} seconds"
            )
        time.sleep(0.1)


def answers(client: Any, job: Job, items: Iterator[Item], left: Callable[[], int | None]) -> Iterator[Answer]:
    """Hand out pairs and yield what comes of them, in the order in which it comes.

    Only so many pairs are at the workers at once that these have something to do: what is held does not grow
    with the data set.

    Parameters
    ----------
    client : distributed.Client
        Where the workers are.
    job : Job
        What is the same for every pair.
    items : iterator of Item
        The pairs, asked for when a worker can take them.
    left : callable
        How many pairs are still to be handed out; None where nobody knows.

    Raises
    ------
    UnwritableError
        The results cannot be written.
    LostError
        The scheduler is gone.
    """
    from distributed import as_completed

    waiting: dict[Any, list[Item]] = {}
    ready = as_completed(raise_errors=False)
    threads, counted = threads_of(client), time.monotonic()
    pace = _Pace()

    def submit(chunk: list[Item]) -> None:
        # Not pure: the same pair asked for again is a new task, not a failure that Dask remembers.
        future = client.submit(work.pairs, job, chunk, pure=False)
        waiting[future] = chunk
        ready.add(future)

    try:
        while True:
            while len(waiting) < 2 * threads + 1 and (
                chunk := list(islice(items, pace.pairs(threads, left())))
            ):
                submit(chunk)
            if not waiting:
                return
            future = next(ready)
            chunk = waiting.pop(future)
            if future.status in ("cancelled", "lost"):
                raise LostError(f"the Dask scheduler {_address(client)} is gone; {KEPT}")
            error = future.exception() if future.status == "error" else None
            if error is None:
                found = future.result()
                pace.learn(found)
                yield from found
            elif isinstance(error, UnwritableError):
                raise UnwritableError(f"{error}; {KEPT}")
            elif len(chunk) > 1:
                # One of them has killed its workers, or cannot be sent: each has to show alone.
                for item in chunk:
                    submit([item])
            else:
                yield chunk[0].index, Failure(chunk[0].sample.name, _of_the_task(error))
            if time.monotonic() - counted > 10:
                threads, counted = threads_of(client, patience=float("inf")), time.monotonic()
    finally:
        if waiting:
            with suppress(Exception):
                client.cancel(list(waiting), force=True)


def _of_the_task(error: BaseException) -> str:
    from distributed import KilledWorker

    if isinstance(error, KilledWorker):
        return f"{error.allowed_failures + 1} workers died over it, as they do when memory runs out"
    return reason(error)


def _address(client: Any) -> str:
    scheduler = getattr(client, "scheduler", None)
    return str(getattr(scheduler, "address", "")) or "of the run"


class _Pace:
    """How many pairs a task holds: some work for each, and little at the end."""

    def __init__(self) -> None:
        self._seconds: float | None = None

    def learn(self, found: list[Answer]) -> None:
        """Take in what pairs have just taken, the newest counting most."""
        for _, answer in found:
            if isinstance(answer, bytes):
                spent = sum(json.loads(answer)["seconds"].values())
                self._seconds = spent if self._seconds is None else 0.8 * self._seconds + 0.2 * spent

    def pairs(self, threads: int, left: int | None) -> int:
        """Pairs for the next task."""
        if self._seconds is None:
            return 1
        wanted = max(TASK, 2 * threads * ROUND) / max(self._seconds, 1e-4)
        if left is not None:
            wanted = min(wanted, left / (3 * threads))
        return max(1, min(LARGEST, int(wanted)))
