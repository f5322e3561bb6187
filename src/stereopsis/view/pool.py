"""Worker processes, the jobs that wait for them, and who may have how many."""

from __future__ import annotations

import collections
import os
import queue
import subprocess
import sys
import threading
from concurrent.futures import Future, InvalidStateError
from contextlib import suppress
from dataclasses import dataclass, field
from io import RawIOBase
from typing import Any, cast

from stereopsis.view.sources import Scene
from stereopsis.view.wire import receive, send

GRACE = 0.35
"""Seconds that a job has to stop by itself before its process is ended."""


class RefusedError(Exception):
    """The job cannot be done as it was asked for; says why in a sentence."""


class FailedError(Exception):
    """The job met a fault of the program, or its process ended."""


class ReplacedError(Exception):
    """The job was stopped; says why in a sentence."""


class BusyError(Exception):
    """Too many jobs wait already."""


@dataclass(eq=False)
class Job:
    """Something to be computed.

    Attributes
    ----------
    function : str
        Which of `stereopsis.view.work`.
    arguments : tuple
    scene : (str, Scene) or None
        What it is computed on; sent only where the worker does not hold it already.
    seconds : float or None
        The longest that it may take.
    future : Future
        Its answer, or `RefusedError`, `FailedError`, `ReplacedError`.
    """

    function: str
    arguments: tuple[Any, ...]
    scene: tuple[str, Scene] | None = None
    seconds: float | None = None
    future: Future[Any] = field(default_factory=Future)


class Pool:
    """Processes that do jobs in the order in which they came.

    Parameters
    ----------
    size : int
        How many jobs are done at once.
    waiting : int
        How many more may wait.
    memory : int
        Bytes that a process may have; 0 for no limit.
    held : int
        Bytes of scenes that a process keeps for its next job.
    """

    def __init__(self, size: int, *, waiting: int, memory: int, held: int) -> None:
        self._jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._waiting = 0
        self._most = waiting
        self._closed = False
        self._clerks = [_Clerk(self, memory, held) for _ in range(size)]

    def submit(self, job: Job) -> Job:
        """Queue a job; raises `BusyError` where too many wait."""
        with self._lock:
            if self._closed:
                raise BusyError("the server is ending")
            if self._waiting >= self._most + len(self._clerks):
                raise BusyError("too many computations wait already: try again in a moment")
            self._waiting += 1
        job.future.add_done_callback(self._done)
        self._jobs.put(job)
        return job

    def _done(self, future: Future[Any]) -> None:
        with self._lock:
            self._waiting -= 1

    def stop(self, job: Job, reason: str) -> None:
        """Answer a job with `ReplacedError` now, and end what is computed for it."""
        with suppress(InvalidStateError):
            job.future.set_exception(ReplacedError(reason))
        for clerk in self._clerks:
            clerk.stop(job)

    def take(self) -> Job | None:
        """Wait for the next job; None where there will be none."""
        return self._jobs.get()

    def close(self) -> None:
        """End every process; jobs that wait or run are answered with `ReplacedError`."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
        ending = "the server is ending"
        with suppress(queue.Empty):
            while (job := self._jobs.get_nowait()) is not None:
                self.stop(job, ending)
        for clerk in self._clerks:
            if clerk.job is not None:
                self.stop(clerk.job, ending)
            self._jobs.put(None)
            clerk.kill()
        for clerk in self._clerks:
            clerk.thread.join(5)


class _Clerk:
    """A thread that hands jobs to one process, which it starts when it needs it."""

    def __init__(self, pool: Pool, memory: int, held: int) -> None:
        self._pool, self._memory, self._most = pool, memory, held
        self._lock = threading.Lock()  # of what follows, and of the process's input
        self._process: subprocess.Popen[bytes] | None = None
        self.job: Job | None = None
        self._number = 0
        self._held: collections.OrderedDict[str, int] = collections.OrderedDict()
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self) -> None:
        while (job := self._pool.take()) is not None:
            if not job.future.done():
                self._do(job)
        self.kill()

    def _do(self, job: Job) -> None:
        watch = threading.Timer(job.seconds, self.kill) if job.seconds else None
        if watch:
            watch.daemon = True
            watch.start()
        try:
            with self._lock:
                self.job = job
                self._number += 1
                process = self._start()
                send(
                    cast(RawIOBase, process.stdin),
                    (self._number, job.function, job.arguments, self._parcel(job)),
                )
            while True:
                number, how, answer = receive(cast(RawIOBase, process.stdout))
                if number == self._number:
                    break
        except (EOFError, OSError):
            self.kill()
            how, answer = "failed", "the computation ended without an answer: it took too much memory or time"
        finally:
            if watch:
                watch.cancel()
            with self._lock:
                self.job = None
        with suppress(InvalidStateError):
            match how:
                case "done":
                    job.future.set_result(answer)
                case "refused":
                    job.future.set_exception(RefusedError(answer))
                case "stopped":
                    job.future.set_exception(ReplacedError("stopped"))
                case _:
                    job.future.set_exception(FailedError(answer))

    def _start(self) -> subprocess.Popen[bytes]:
        if self._process is not None and self._process.poll() is None:
            return self._process
        self._discard()
        places = [path for path in sys.path if path]
        self._process = subprocess.Popen(
            # -P: nothing is imported from where the program happens to be started.
            [sys.executable, "-P", "-m", "stereopsis.view.worker", str(self._memory)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(places)},
        )
        return self._process

    def _parcel(self, job: Job) -> tuple[str | None, Scene | None, tuple[str, ...]]:
        """The scene's key, the scene where the process does not hold it, and what it is to let go."""
        if job.scene is None:
            return None, None, ()
        key, scene = job.scene
        new = key not in self._held
        self._held[key] = scene.bytes
        self._held.move_to_end(key)
        gone = []
        while sum(self._held.values()) > self._most and len(self._held) > 1:
            gone.append(self._held.popitem(last=False)[0])
        return key, scene if new else None, tuple(gone)

    def stop(self, job: Job) -> None:
        """End a job if this one does it: kindly at first."""
        with self._lock:
            if self.job is not job or self._process is None:
                return
            process, number = self._process, self._number
            with suppress(OSError):
                send(cast(RawIOBase, process.stdin), (number,))
        timer = threading.Timer(GRACE, self._kill_if, (process, number))
        timer.daemon = True
        timer.start()

    def _kill_if(self, process: subprocess.Popen[bytes], number: int) -> None:
        with self._lock:
            if self.job is None or self._number != number:
                return
        process.kill()

    def kill(self) -> None:
        """End the process now."""
        with self._lock:
            self._discard()

    def _discard(self) -> None:
        process, self._process = self._process, None
        self._held.clear()
        if process is None:
            return
        process.kill()
        process.wait()
        for stream in (process.stdin, process.stdout):
            with suppress(OSError):
                cast(RawIOBase, stream).close()
