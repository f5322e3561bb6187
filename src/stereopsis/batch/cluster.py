"""Dask: workers of this machine, a scheduler elsewhere, and pairs handed out a few at a time."""

from __future__ import annotations

import logging
import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from itertools import islice
from typing import Any, Final, NamedTuple

from stereopsis.batch import preload, tiled, work
from stereopsis.batch.tiled import Tile
from stereopsis.batch.work import Answer, Failure, Found, Item, Job, UnwritableError
from stereopsis.io._errors import reason

PATIENCE: Final = 60.0
"""Seconds to wait for a scheduler's first worker."""

CONNECT: Final = 10.0
"""Seconds to wait for the scheduler itself."""

TASK: Final = 1.0
"""Seconds of work that a task holds at least, where there are pairs enough: handing it out takes some ms."""

ROUND: Final = 0.004
"""Seconds that a scheduler is given for each task; with more workers, tasks grow."""

LARGEST: Final = 64
"""Pairs in a task at most: what a client has to hold of each is small, and so is what it waits for."""


CALM: Final = {
    # An hour of profiles is kept, and is all that would grow in a worker.
    "distributed.worker.profile.enabled": False,
    # Looking after idle processes so often as Dask does takes 5 % of a core, which the workers need.
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.worker.memory.monitor-interval": "1s",
}
"""Dask's own settings, of processes of this machine."""

KEPT: Final = "what is finished is kept, and the same run again goes on"


class LostError(ConnectionError):
    """The scheduler is gone."""


def cores() -> int:
    """Cores that this process may use, as its affinity and its control group say."""
    from dask.system import cpu_count

    return max(1, int(cpu_count()))


def room_for(memory: int) -> int:
    """Workers for which this machine has memory; Dask ends one that comes near the end of its share."""
    from distributed.system import MEMORY_LIMIT

    return int(MEMORY_LIMIT // (1.25 * memory))


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
    import dask
    from distributed import Client, LocalCluster

    preload.steady()
    with _quiet(), dask.config.set(CALM):
        cluster = LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address="127.0.0.1:0",
            scheduler_kwargs={"dashboard": False},
            silence_logs=logging.CRITICAL,
            preload=[preload.__name__],
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

    preload.steady()
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
    from distributed.comm import CommClosedError

    hands, desk = _Hands(client, job), tiled.Desk()
    suspects: deque[Item | Tile] = deque()
    pace = _Pace()

    def taken(chunk: Chunk, found: list[Found]) -> Iterator[Answer]:
        for item, one in zip(chunk, found, strict=True):
            if (answer := desk.take(item, one)) is not None:
                yield item.index, answer

    def given(chunk: Chunk, alone: bool = False) -> Iterator[Answer]:
        for one, failure in hands.give(chunk, alone):
            yield from taken([one], [failure])

    def following() -> Chunk:
        if desk.waiting:
            return [desk.waiting.popleft()]
        return list(islice(items, pace.pairs(threads, left())))

    try:
        threads, counted = threads_of(client), time.monotonic()
        while True:
            while len(hands) < 2 * threads + 1 and (chunk := following()):
                yield from given(chunk)
            if not hands and suspects:
                yield from given([suspects.popleft()], alone=True)
            if not hands:
                return
            back = hands.take()
            if not isinstance(back, _Died):
                chunk, found, seconds = back
                if isinstance(chunk[0], Item):
                    pace.learn(seconds / len(found))
                yield from taken(chunk, found)
            elif len(back.chunk) > 1:
                for item in back.chunk:
                    yield from given([item])
            elif not back.alone:
                # Its worker died, perhaps of another pair that waited there.
                suspects.extend(back.chunk)
            else:
                yield from taken(back.chunk, [Failure(back.chunk[0].sample.name, back.reason)])
            if time.monotonic() - counted > 10:
                threads, counted = threads_of(client, patience=float("inf")), time.monotonic()
    except (CancelledError, CommClosedError):
        raise LostError(f"the Dask scheduler {_address(client)} is gone; {KEPT}") from None
    finally:
        hands.drop()


Chunk = Sequence[Item | Tile]
"""What a task holds: some pairs, or a tile."""


class _Died(NamedTuple):
    """A task over which workers died, or that they cannot take."""

    chunk: Chunk
    alone: bool
    reason: str


class _Hands:
    """Tasks that are at the workers."""

    def __init__(self, client: Any, job: Job) -> None:
        from distributed import as_completed

        self._client = client
        self._job = job
        self._waiting: dict[Any, tuple[Chunk, bool]] = {}
        self._ready = as_completed(raise_errors=False)

    def __len__(self) -> int:
        return len(self._waiting)

    def give(self, chunk: Chunk, alone: bool = False) -> list[tuple[Item | Tile, Failure]]:
        """Send a task; return what of it cannot be sent."""
        try:
            # Not pure: the same pair asked for again is a new task, not a failure that Dask remembers.
            future = self._client.submit(work.packed, work.pack(self._job, chunk), pure=False)
        # A sample that cannot be sent raises whatever its parts do.
        except Exception as error:
            if len(chunk) > 1:
                return [failed for item in chunk for failed in self.give([item])]
            why = f"cannot be sent to a worker: {reason(error)}"
            return [(chunk[0], Failure(chunk[0].sample.name, why))]
        self._waiting[future] = chunk, alone
        self._ready.add(future)
        return []

    def take(self) -> tuple[Chunk, list[Found], float] | _Died:
        """A task that comes back, what came of it, and the seconds that it took."""
        # Done, but its worker died before anybody fetched it: the scheduler has it done again.
        while (future := next(self._ready)).status == "lost":
            self._ready.add(future)
        chunk, alone = self._waiting.pop(future)
        try:
            found, seconds = future.result()
        except UnwritableError as error:
            raise UnwritableError(f"{error}; {KEPT}") from None
        except Exception as error:
            if future.status != "error":
                raise
            return _Died(chunk, alone, _of_the_task(error))
        return chunk, found, seconds

    def drop(self) -> None:
        """Take back what no worker has begun."""
        if self._waiting:
            with suppress(Exception):
                self._client.cancel(list(self._waiting), force=True)


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

    def learn(self, spent: float) -> None:
        """Take in the seconds that a pair has just taken; the newest count most."""
        self._seconds = spent if self._seconds is None else 0.8 * self._seconds + 0.2 * spent

    def pairs(self, threads: int, left: int | None) -> int:
        """Pairs for the next task."""
        if self._seconds is None:
            return 1
        wanted = max(TASK, 2 * threads * ROUND) / max(self._seconds, 1e-4)
        if left is not None:
            # Small ones at the end, so that all workers end together; none that is quicker done than sent.
            wanted = min(wanted, max(left / (3 * threads), 0.1 * TASK / max(self._seconds, 1e-4)))
        return max(1, min(LARGEST, math.ceil(wanted)))
