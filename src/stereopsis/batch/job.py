"""The client's side: which pairs are left, what came of each, and the tables of all of them."""

from __future__ import annotations

import json
import time
import zlib
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import AbstractContextManager, suppress
from typing import Any, Final

from stereopsis.batch import cluster, names, record, tiled, work
from stereopsis.batch.store import FOLDERS, MAPS, ROWS, TABLES, TILES, Store
from stereopsis.batch.work import Failure, Item, Job
from stereopsis.io.table import as_csv

Progress = Callable[[int, int | None, str], None]
"""Called with the pairs finished, the pairs there are (None: nobody knows), and what has been finished."""

INTERVAL: Final = 30.0
"""Seconds between the tables of the rows so far; more where writing them takes long."""


def prepare(store: Store, identity: record.Identity, *, resume: bool, overwrite: bool) -> None:
    """Make the place ready, or refuse it.

    Raises
    ------
    ValueError
        It holds another run, or one that is not to be gone on with.
    """
    store.sweep()
    found = store.read(record.NAME)
    if not overwrite:
        hint = "choose another folder, or overwrite it"
        if found is None and any(store.sizes(folder) for folder in FOLDERS):
            raise ValueError(f"{store} holds files but no {record.NAME}: {hint}")
        if found is not None:
            try:
                different = identity.differences(found.decode("utf-8", "replace"))
            except ValueError as error:
                raise ValueError(f"{store}/{record.NAME}: {error}; {hint}") from None
            if different:
                few = "; ".join(different[:3]) + ("; and more" if len(different) > 3 else "")
                raise ValueError(f"{store} holds a run with something else ({few}): {hint}")
            if not resume:
                raise ValueError(f"{store} holds a run already: go on with it, {hint}")
    else:
        # The rows first: what is left of a run that is being removed still agrees with its run.toml.
        for folder in (ROWS, MAPS):
            store.remove(store.sizes(folder))
        store.clear(TILES)
        store.remove((*TABLES, record.NAME))
        found = None
    if found is None:
        store.write(record.NAME, identity.to_toml().encode())


def finished(store: Store, job: Job) -> dict[str, bytes]:
    """The records of finished pairs, by their path; what belongs to no finished pair is removed.

    A pair is finished when its row is there and its map is, with as many bytes as the row says.
    """
    maps = store.sizes(MAPS)
    done: dict[str, bytes] = {}
    stale = []
    for name, data in store.read_all(ROWS):
        found = work.record_of(data, job.run)
        path = name.removeprefix(f"{ROWS}/").removesuffix(".json")
        if found is not None and maps.get(f"{MAPS}/{path}.{job.format}") == found["bytes"]:
            done[path] = data
        else:
            stale.append(name)
    kept = {f"{MAPS}/{path}.{job.format}" for path in done}
    # The row first: a map without one is nothing, a row without its map would be a lie.
    store.remove([*stale, *(name for name in maps if name not in kept)])
    store.remove([name for name in store.sizes(TILES) if tiled.path_of(name) in done])
    return done


class _Rows:
    """Records by number, packed: they are much alike, and there may be many."""

    def __init__(self) -> None:
        self._like = b""
        self._packed: dict[int, bytes] = {}

    def put(self, number: int, data: bytes) -> None:
        """Keep a record; the first shows how the others look."""
        self._like = self._like or data
        packer = zlib.compressobj(zdict=self._like)
        self._packed[number] = packer.compress(data) + packer.flush()

    def get(self, number: int) -> bytes | None:
        """The record of this number."""
        packed = self._packed.get(number)
        return None if packed is None else zlib.decompressobj(zdict=self._like).decompress(packed)

    def __iter__(self) -> Iterator[bytes]:
        """All, by their numbers."""
        for number in sorted(self._packed):
            data = self.get(number)
            assert data is not None
            yield data


class Table:
    """What came of every pair, in the data set's order.

    Attributes
    ----------
    taken : int
        Pairs of the data set that were looked at.
    reused : int
        Those that an earlier run had finished.
    settled : int
        Those with a result or a failure.
    """

    def __init__(self, samples: Iterable[Any], done: dict[str, bytes]) -> None:
        self._samples = samples
        self._done = done
        self._seen: dict[str, int] = {}  # by path
        self._rows = _Rows()
        self._failures: dict[int, Failure] = {}
        self.taken = 0
        self.reused = 0
        self.settled = 0

    def items(self) -> Iterator[Item]:
        """The pairs that are left, one after the other; the others are entered here."""
        for index, sample in enumerate(self._samples):
            self.taken = index + 1
            name = sample.name
            try:
                path = names.escaped(name)
                if path in self._seen:
                    raise ValueError(f"pair {self._seen[path] + 1} of the data set has the same name")
            except ValueError as error:
                self.enter(index, Failure(str(name), str(error)))
                continue
            self._seen[path] = index
            before = self._done.pop(path, None)
            if before is None:
                yield Item(index, sample, path)
                continue
            was, now = json.loads(before)["source"], work.source(sample)
            if was != now:
                raise ValueError(
                    f"the results are of other files: {name} was {was[0] or 'no file'}, "
                    f"and is {now[0] or 'no file'}; choose another folder, or overwrite it"
                )
            self.reused += 1
            self.enter(index, before)

    def enter(self, index: int, answer: bytes | Failure) -> None:
        """Take in what came of a pair."""
        if isinstance(answer, Failure):
            self._failures[index] = answer
        else:
            self._rows.put(index, answer)
        self.settled += 1

    def catch_up(self, job: Job) -> None:
        """Take in pairs that were finished while nobody listened."""
        for path, index in self._seen.items():
            if index not in self._failures and self._rows.get(index) is None:
                data = job.store.read(f"{ROWS}/{path}.json")
                if data is not None and work.record_of(data, job.run) is not None:
                    self.enter(index, data)

    @property
    def failures(self) -> list[Failure]:
        """Pairs without a result."""
        return [self._failures[index] for index in sorted(self._failures)]

    def records(self) -> Iterator[dict[str, Any]]:
        """The records of finished pairs."""
        return map(json.loads, self._rows)

    def write(self, store: Store, *, scored: bool) -> None:
        """Write the three tables."""
        head = work.columns(scored=scored)
        rows = (record["row"] for record in self.records())
        store.write(TABLES[0], as_csv(head, ((row.get(name) for name in head) for row in rows)))
        times = (
            (
                record["row"]["name"],
                sum(record["seconds"].values()),
                *(record["seconds"].get(stage) for stage in work.STAGES),
                record["worker"],
            )
            for record in self.records()
        )
        store.write(TABLES[1], as_csv(("name", "seconds", *work.STAGES, "worker"), times))
        failed = ((failure.name, failure.reason) for failure in self.failures)
        store.write(TABLES[2], as_csv(("name", "reason"), failed))


def carry_out(
    samples: Iterable[Any],
    job: Job,
    client: AbstractContextManager[Any],
    progress: Progress | None = None,
) -> Table:
    """Match the pairs that are not finished, and write the tables.

    Raises
    ------
    OSError
        The results cannot be written, or the scheduler is gone. What is finished is kept.
    """
    store = job.store
    table = Table(samples, finished(store, job))
    total = len(samples) if isinstance(samples, Sized) else None
    items = table.items()
    first = next(items, None)

    def report(what: str) -> None:
        if progress:
            progress(table.settled, total, what)

    report("")
    if first is None:
        store.clear(TILES)
        table.write(store, scored=job.evaluate)
        return table

    def left() -> int | None:
        return None if total is None else max(0, total - table.taken)

    def remaining() -> Iterator[Item]:
        yield first
        yield from items

    written = time.monotonic()
    interval = INTERVAL
    try:
        with client as reached:
            for index, answer in cluster.answers(reached, job, remaining(), left):
                if isinstance(answer, tiled.Step):
                    report(str(answer))
                    continue
                table.enter(index, answer)
                report("")
                if time.monotonic() - written > interval:
                    start = time.monotonic()
                    table.write(store, scored=job.evaluate)
                    written = time.monotonic()
                    interval = max(INTERVAL, 20 * (written - start))
    except BaseException:
        # The rows so far, where they can still be written; the error that ended the run says more.
        with suppress(Exception):
            store.sweep()
            table.catch_up(job)
            table.write(store, scored=job.evaluate)
        raise
    # A worker that was killed midway, and whose pair another one took over, may have left a part of a file.
    store.sweep()
    store.clear(TILES)
    table.write(store, scored=job.evaluate)
    return table
