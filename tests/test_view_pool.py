"""Jobs that are stopped, that fail, that wait, and processes that end."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import wait
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

import stereopsis as st
from stereopsis.types import Disparities
from stereopsis.view import pool as view_pool
from stereopsis.view.pool import BusyError, FailedError, Job, Pool, RefusedError, ReplacedError
from stereopsis.view.sources import Files, Scene
from view_help import busy

GIB = 2**30
STOPS_WITHIN = 0.5
"""What stopping a computation may take, on a machine that does nothing else."""
SLACK = 0.5


BEFORE: set[int] = set()
"""Processes that other tests have started and left."""


@pytest.fixture(autouse=True)
def alone() -> None:
    BEFORE.clear()
    BEFORE.update(child.pid for child in psutil.Process().children(recursive=True))


def _children() -> list[psutil.Process]:
    children = psutil.Process().children(recursive=True)
    return [child for child in children if child.is_running() and child.pid not in BEFORE]


def _pool(size: int = 1, waiting: int = 8, memory: int = 2 * GIB, held: int = GIB) -> Pool:
    return Pool(size, waiting=waiting, memory=memory, held=held)


@pytest.fixture
def pool() -> Iterator[Pool]:
    pool = _pool()
    yield pool
    pool.close()
    assert _children() == []


def _scene(width: int = 64, height: int = 48) -> Scene:
    street = st.scenes.street(width, height, 1)
    return Scene(street.left, street.right, None, None, None, None, Disparities(0, 16))


def _noise(width: int, height: int) -> Scene:
    left, right = np.random.default_rng(0).integers(0, 255, (2, height, width), np.uint8)
    return Scene(left, right, None, None, None, None, Disparities(0, 64))


LONG: dict[str, Callable[[], Job]] = {
    # In the core, which asks for signals; and in Python, between its calls.
    "core": lambda: _matching(_noise(1200, 1000), cost=st.ZSAD(31), disparities=(0, 256)),
    "python": lambda: _matching(
        _noise(800, 600), cost=st.SSD(5), disparities=(0, 128), optimize=st.Expansion(iterations=50)
    ),
}


def _matching(scene: Scene, **settings: Any) -> Job:
    return Job("matched", (st.Settings(**settings),), (f"{id(scene)}", scene))


def _used(process: psutil.Process) -> float:
    times = process.cpu_times()
    return times.user + times.system


@pytest.mark.parametrize("kind", LONG)
def test_a_job_is_stopped_and_the_next_is_done(
    pool: Pool, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    slowness = busy()
    if kind == "core":  # it is timed by its own clock: on a busy machine it may look up late
        monkeypatch.setattr(view_pool, "GRACE", 20.0)
    pool.submit(Job("nothing", ())).future.result(30)
    (process,) = _children()
    job = pool.submit(LONG[kind]())
    before = _used(process)
    deadline = time.monotonic() + 30
    while _used(process) < before + 0.3:  # it computes
        assert time.monotonic() < deadline
        time.sleep(0.02)
    start, worked = time.monotonic(), _used(process)
    pool.stop(job, "because")
    with pytest.raises(ReplacedError, match="because"):
        job.future.result(0)
    # The next is not begun before the first has really ended.
    pool.submit(_matching(_scene(), disparities=(0, 16))).future.result(30)
    if kind == "core":
        assert _children() == [process], "the core looks up: its process need not be ended"
        assert _used(process) - worked < (STOPS_WITHIN + SLACK) * (os.cpu_count() or 1)
    else:  # a process has to start
        took = time.monotonic() - start
        assert took < (STOPS_WITHIN + SLACK + 1) * max(slowness, busy())


def test_what_does_not_look_up_is_ended(pool: Pool, tmp_path: Path) -> None:
    """A job that no signal reaches: it reads a pipe that nobody writes."""
    if not hasattr(os, "mkfifo"):
        pytest.skip("needs named pipes")
    os.mkfifo(tmp_path / "left.png")
    job = pool.submit(Job("load", (Files(left=tmp_path / "left.png"), 1000)))
    deadline = time.monotonic() + 30
    while not _children():
        assert time.monotonic() < deadline
        time.sleep(0.02)
    time.sleep(1)
    slowness = busy()
    pool.stop(job, "because")
    start = time.monotonic()
    assert pool.submit(Job("nothing", ())).future.result(30) is None
    assert time.monotonic() - start < (STOPS_WITHIN + SLACK + 2) * slowness


def test_a_job_that_waits_is_never_begun(pool: Pool) -> None:
    long = pool.submit(LONG["core"]())
    waiting = pool.submit(LONG["core"]())
    last = pool.submit(Job("nothing", ()))
    pool.stop(waiting, "not wanted")
    pool.stop(long, "not wanted")
    assert last.future.result(30) is None
    with pytest.raises(ReplacedError):
        waiting.future.result(0)


def test_the_scene_of_a_job_that_was_never_begun_is_kept(pool: Pool) -> None:
    """The wish to stop may be read before the job is taken up."""
    pool.submit(Job("nothing", ())).future.result(30)
    settings = st.Settings(cost=st.SSD(5), disparities=(0, 16))
    scene = _scene()
    for turn in range(20):
        job = pool.submit(Job("matched", (settings,), (str(turn), scene)))
        while pool._clerks[0].job is not job and not job.future.done():
            pass
        pool.stop(job, "not wanted")
        facts, _ = pool.submit(Job("matched", (settings,), (str(turn), scene))).future.result(30)
        assert facts["path"] == "streaming"


def test_stopping_what_is_done_changes_nothing(pool: Pool) -> None:
    job = pool.submit(_matching(_scene(), disparities=(0, 16)))
    facts, arrays = job.future.result(30)
    pool.stop(job, "too late")
    assert job.future.result(0) == (facts, arrays)
    assert pool.submit(Job("nothing", ())).future.result(30) is None


def test_a_job_that_takes_too_long_is_ended(pool: Pool) -> None:
    job = LONG["core"]()
    job.seconds = 1.0
    with pytest.raises(FailedError, match="memory or time"):
        pool.submit(job).future.result(30)
    assert pool.submit(Job("nothing", ())).future.result(30) is None


def test_a_job_that_takes_too_much_memory_is_refused() -> None:
    pool = _pool(memory=600 * 2**20)
    try:
        job = _matching(_noise(1000, 1000), cost=st.SSD(5), disparities=(0, 512), optimize=st.ICM())
        with pytest.raises((RefusedError, FailedError), match="memory"):
            pool.submit(job).future.result(60)
        assert pool.submit(Job("nothing", ())).future.result(30) is None
    finally:
        pool.close()


def test_a_process_that_dies_is_started_again(pool: Pool) -> None:
    scene = _scene()

    def matched() -> dict[str, bytes]:
        _, arrays = pool.submit(_matching(scene, disparities=(0, 16))).future.result(30)
        return {name: array.tobytes() for name, array in arrays.items()}

    first = matched()
    (process,) = _children()
    process.kill()
    process.wait()
    assert matched() == first
    job = pool.submit(LONG["core"]())
    time.sleep(0.5)
    for child in _children():
        child.kill()
    with pytest.raises(FailedError):
        job.future.result(30)
    assert matched() == first


def test_too_many_are_refused() -> None:
    pool = _pool(waiting=2)
    try:
        jobs = [pool.submit(LONG["core"]()) for _ in range(3)]
        with pytest.raises(BusyError):
            pool.submit(Job("nothing", ()))
        pool.stop(jobs[1], "not wanted")
        pool.submit(Job("nothing", ()))
    finally:
        pool.close()
    assert all(job.future.done() for job in jobs)
    with pytest.raises(BusyError):
        pool.submit(Job("nothing", ()))


def test_scenes_are_sent_once_and_let_go(pool: Pool) -> None:
    small = _pool(held=3 * _scene().bytes)
    try:
        scenes = [(str(number), _scene()) for number in range(4)]
        for turn in range(3):
            jobs = [
                small.submit(Job("matched", (st.Settings(cost=st.SSD(5), disparities=(0, 8)),), scene))
                for scene in scenes
            ]
            wait([job.future for job in jobs], 60)
            assert len({job.future.result(0)[1]["disparity"].tobytes() for job in jobs}) == 1, turn
        assert len(small._clerks[0]._held) == 3
    finally:
        small.close()


def test_faults_of_the_program_are_told_apart(pool: Pool) -> None:
    with pytest.raises(RefusedError, match="left: No such file"):
        pool.submit(Job("load", (Files(left=Path("missing.png"), right=Path("x")), 10))).future.result(30)
    with pytest.raises(FailedError, match="KeyError"):
        pool.submit(Job("unknown", ())).future.result(30)
    assert pool.submit(Job("nothing", ())).future.result(30) is None
