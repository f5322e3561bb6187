"""The long job: run the rows of a plan, keep each as it comes, go on where an earlier run stopped."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import metadata
from multiprocessing import connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, BinaryIO, Final, TypeAlias

import numpy as np

from stereopsis import _core
from stereopsis.io._errors import reason
from stereopsis.pipeline import match
from stereopsis.study import published
from stereopsis.study.measure import Row, measure, strata
from stereopsis.study.pairs import Known, Source
from stereopsis.study.plan import Corrected, Plan, Quirky, Task

JOURNAL: Final = "journal.jsonl"
ASIDE: Final = (
    "__main__.py",
    "cli.py",
    "demo.py",
    *(
        f"batch/{name}.py"
        for name in ("__init__", "cluster", "job", "names", "preload", "record", "store", "work")
    ),
    *(f"bench/{name}.py" for name in ("__init__", "accuracy", "methods", "opencv", "speed")),
    *(f"study/{name}.py" for name in ("figures", "methods", "page", "plan", "sections", "tables")),
)
"""Files of the program that decide no row, or only by a setting that is in its key anyway."""


@dataclass(frozen=True)
class Done:
    """A measured row."""

    task: Task
    row: Row
    seconds: float
    reused: bool = False


@dataclass(frozen=True)
class Failed:
    """A row that could not be measured, or with no setting a pair that could not be read."""

    pair: str
    setting: str | None
    reason: str


@dataclass
class Outcome:
    """What came of a job: rows in the plan's order, and what failed."""

    done: list[Done] = field(default_factory=list)
    failed: list[Failed] = field(default_factory=list)


Progress = Callable[[int, int, str], None]
"""Called with the rows finished, the rows there are, and what has just been finished."""


def run(plan: Plan, folder: Path, workers: int = 1, progress: Progress | None = None) -> Outcome:
    """Measure every row of a plan that the journal in `folder` does not hold already.

    Parameters
    ----------
    plan : Plan
        The rows.
    folder : Path
        Where the journal is kept; made if it is not there.
    workers : int
        Processes. With one, everything runs in this process.
    progress : callable, optional
        See `Progress`.

    Returns
    -------
    Outcome
        The same rows, with the same bytes, for any number of workers and however often the job was stopped.

    Raises
    ------
    KeyboardInterrupt
        After Ctrl-C; what was finished is kept.
    OSError
        The journal cannot be written.
    """
    report = progress or _quietly
    folder.mkdir(parents=True, exist_ok=True)
    version = program()
    digests, unreadable = _digests([task.source for task in plan.tasks])
    keys = {task: _key(version, digests[task.source], task) for task in plan.tasks if task.source in digests}
    same: dict[str, list[Task]] = {}
    for task, key in keys.items():
        same.setdefault(key, []).append(task)
    with Journal(folder / JOURNAL) as journal:
        found = {key: journal.rows[key] for key in same if key in journal.rows}
        waiting = {tasks[0]: tasks for key, tasks in same.items() if key not in found}
        rows = {
            task: Done(task, row, seconds, True)
            for key, (row, seconds) in found.items()
            for task in same[key]
        }
        failures: dict[Task, Failed] = {}
        report(len(rows), len(keys), "")
        with _workers(workers, tuple(waiting), digests) as answers:
            for task, answer, seconds in answers:
                if isinstance(answer, Failed):
                    failures |= dict.fromkeys(waiting[task], answer)
                else:
                    journal.append(keys[task], answer, seconds)
                    rows |= {each: Done(each, answer, seconds) for each in waiting[task]}
                report(len(rows) + len(failures), len(keys), f"{task.source.name}, {task.setting.setting}")
    done = [rows[task] for task in plan.tasks if task in rows]
    failed = [*unreadable, *dict.fromkeys(failures[task] for task in plan.tasks if task in failures)]
    return Outcome(done, failed)


def _quietly(finished: int, total: int, what: str) -> None:
    pass


class Journal:
    """Rows on disk, one JSON line each, flushed to the disk before the next is begun.

    Attributes
    ----------
    rows : dict of str to (Row, float)
        By key: the row and the seconds that it took. Of equal keys the last line counts.
    """

    def __init__(self, path: Path) -> None:
        self.rows: dict[str, tuple[Row, float]] = {}
        self._file: BinaryIO = path.open("a+b")
        self._file.seek(0)
        good = 0
        for line in self._file:
            if not line.endswith(b"\n"):
                break  # torn: the program was killed while it wrote
            good += len(line)
            try:
                record = json.loads(line)
                self.rows[record["key"]] = record["row"], record["seconds"]
            except (ValueError, KeyError, TypeError):
                continue
        self._file.truncate(good)

    def append(self, key: str, row: Row, seconds: float) -> None:
        """Keep a row; when this returns, it is on the disk."""
        line = json.dumps({"key": key, "row": row, "seconds": seconds}, separators=(",", ":"))
        self._file.write(line.encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())
        self.rows[key] = row, seconds

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()


@lru_cache(maxsize=1)
def program() -> str:
    """Hash of what computes a row: this package's code, its compiled core, NumPy's and SciPy's versions."""
    digest = hashlib.sha256()
    for name in ("stereopsis", "numpy", "scipy", "pillow"):
        try:
            digest.update(f"{name} {metadata.version(name)}\n".encode())
        except metadata.PackageNotFoundError:
            digest.update(f"{name} none\n".encode())
    package = Path(__file__).parents[1]
    for file in sorted(package.rglob("*.py")):
        name = file.relative_to(package).as_posix()
        if name not in ASIDE:
            digest.update(f"{name}\n".encode() + file.read_bytes())
    if _core.__file__:
        digest.update(Path(_core.__file__).read_bytes())
    return digest.hexdigest()


def _key(version: str, digest: str, task: Task) -> str:
    parts = [version, digest, type(task.setting).__name__, task.setting.identity()]
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


def _digests(sources: Sequence[Source]) -> tuple[dict[Source, str], list[Failed]]:
    digests: dict[Source, str] = {}
    failed = []
    for source in dict.fromkeys(sources):
        try:
            digests[source] = source.digest()
        except (OSError, ValueError) as error:
            failed.append(Failed(source.name, None, reason(error)))
    return digests, failed


@dataclass
class _Subject:
    """A pair in memory, and its strata."""

    known: Known
    masks: dict[str, Any]


@dataclass
class _Bench:
    """Where rows are measured: it keeps the pair that it has last read."""

    threads: int
    digest: str = ""
    subject: _Subject | Failed | None = None

    def work(self, task: Task, digest: str) -> tuple[Row | Failed, float]:
        start = time.perf_counter()
        if digest != self.digest:
            self.digest, self.subject = digest, self._read(task.source, digest)
        assert self.subject is not None
        if isinstance(self.subject, Failed):
            return self.subject, 0.0
        try:
            row = self._row(task, self.subject)
        # One setting that cannot be run must not stop the rest; it is reported at the end.
        except Exception as error:
            return Failed(task.source.name, task.setting.setting, reason(error)), 0.0
        return row, time.perf_counter() - start

    def _read(self, source: Source, digest: str) -> _Subject | Failed:
        try:
            known = source.load()
            if source.digest() != digest:
                raise ValueError("its files changed while the study ran; run it again")
            return _Subject(known, dict(strata(known)))
        except Exception as error:
            return Failed(source.name, None, reason(error))

    def _row(self, task: Task, subject: _Subject) -> Row:
        known = subject.known
        match task.setting:
            case Corrected(settings=settings):
                result = match(known.pair, settings=settings.changed(threads=self.threads))
                return measure(result, known, subject.masks)
            case Quirky(method=method, window=window, quirks=quirks):
                left, right = rgb(known.pair.left), rgb(known.pair.right)
                found = published.disparity(left, right, method, window, quirks, truth=known.truth)
                return dict(published.measures(found, known.truth))


def rgb(image: Any) -> Any:
    """Three channels of 8 bits, as the report's experiment had them."""
    if image.dtype != np.uint8:
        raise ValueError(f"the published protocol takes 8-bit images, not {image.dtype}")
    return image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)


_Pipe: TypeAlias = Any  # multiprocessing names its class differently on every system
Answer = tuple[Task, Row | Failed, float]


@contextmanager
def _workers(count: int, tasks: Sequence[Task], digests: dict[Source, str]) -> Iterator[Iterator[Answer]]:
    """The answers to every task, in the order in which they come."""
    threads = max(1, (os.cpu_count() or 1) // count)
    if count <= 1 or len(tasks) <= 1:
        bench = _Bench(threads)
        yield ((task, *bench.work(task, digests[task.source])) for task in tasks)
        return
    pool: dict[_Pipe, tuple[BaseProcess, Task]] = {}
    try:
        yield _answers(pool, min(count, len(tasks)), threads, tasks, digests)
    finally:
        for process, _ in pool.values():
            process.kill()
            process.join()


def _answers(
    pool: dict[_Pipe, tuple[BaseProcess, Task]],
    count: int,
    threads: int,
    tasks: Sequence[Task],
    digests: dict[Source, str],
) -> Iterator[Answer]:
    """Hand out tasks one by one; a process that dies costs its task alone."""
    waiting = deque(tasks)
    while waiting or pool:
        while waiting and len(pool) < count:
            ours, process = _start(threads)
            pool[ours] = process, waiting[0]
            _send(ours, waiting.popleft(), digests)
        ready: list[_Pipe] = connection.wait(list(pool))
        for ours in ready:
            process, task = pool[ours]
            try:
                answer, seconds = ours.recv()
            except (EOFError, OSError):
                process.join()
                del pool[ours]
                reason = f"the process ended with code {process.exitcode}"
                yield task, Failed(task.source.name, task.setting.setting, reason), 0.0
                continue
            if waiting:
                pool[ours] = process, waiting[0]
                _send(ours, waiting.popleft(), digests)
            else:
                del pool[ours]
                ours.close()  # the worker ends when it has nobody to ask
                process.join()
            yield task, answer, seconds


def _start(threads: int) -> tuple[_Pipe, BaseProcess]:
    # Spawned: a fork would inherit threads, and the pipes that tell a worker that its parent is gone.
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs, threads), daemon=True)
    with _environment(OMP_NUM_THREADS=threads, OPENBLAS_NUM_THREADS=threads, MKL_NUM_THREADS=threads):
        process.start()
    theirs.close()
    return ours, process


def _send(ours: _Pipe, task: Task, digests: dict[Source, str]) -> None:
    with suppress(OSError):  # it died; reading from it says so
        ours.send((task, digests[task.source]))


def _serve(theirs: _Pipe, threads: int) -> None:
    """A worker: answer tasks until the parent is gone."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    bench = _Bench(threads)
    try:
        while True:
            theirs.send(bench.work(*theirs.recv()))
    except (EOFError, OSError):
        return


@contextmanager
def _environment(**values: int) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in values}
    os.environ.update({name: str(value) for name, value in values.items()})
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
