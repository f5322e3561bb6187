"""A run that is killed, robbed of its folder or of its disk, and goes on: nothing lost, nothing done twice.

Real processes on loopback, killed for real.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

import stereopsis as st
from batch_data import QUIET, SETTINGS, Made, command, dataset, files, in_this_process, leftovers, table
from stereopsis import batch
from stereopsis.batch import cluster as cluster_module

pytest.importorskip("distributed")
psutil = pytest.importorskip("psutil")
pytestmark = [
    *(pytest.mark.filterwarnings(text) for text in QUIET),
    pytest.mark.skipif(os.name == "nt", reason="needs the signals of POSIX"),
]

PAIRS = 24
PATIENCE = 120.0


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Pairs that take long enough for something to happen meanwhile."""
    return dataset(tmp_path_factory.mktemp("chaos") / "data", PAIRS, 480, 320)


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory, data: Path) -> bytes:
    """The table of a run that nothing disturbed."""
    out = tmp_path_factory.mktemp("chaos") / "out"
    with in_this_process() as client:
        assert batch.run(st.datasets.open(data), SETTINGS, out, client).done == PAIRS
    return (out / "results.csv").read_bytes()


def until(true: Callable[[], Any], what: str) -> Any:
    """Wait for something to become true, and return it."""
    end = time.monotonic() + PATIENCE
    while not (found := true()):
        assert time.monotonic() < end, f"in {PATIENCE:.0f} seconds not {what}"
        time.sleep(0.002)
    return found


def finished(out: Path) -> int:
    """Pairs whose row is there."""
    return len(list((out / "rows").glob("*.json")))


@contextmanager
def started(*command_: object, **options: Any) -> Iterator[subprocess.Popen[str]]:
    """A program, of which nothing is left at the end."""
    process = subprocess.Popen(
        [str(part) for part in command_],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )
    try:
        yield process
    finally:
        family = descendants(process)
        for member in family:
            with suppress(psutil.NoSuchProcess):
                member.kill()
        process.kill()
        process.communicate()


def descendants(process: subprocess.Popen[str]) -> list[Any]:
    try:
        return list(psutil.Process(process.pid).children(recursive=True))
    except psutil.NoSuchProcess:
        return []


def workers(process: subprocess.Popen[str]) -> list[Any]:
    """The processes that a local run has started to work."""
    found = []
    for member in descendants(process):
        with suppress(psutil.Error):
            if any("spawn_main" in part for part in member.cmdline()):
                found.append(member)
    return found


def gone(members: list[Any]) -> bool:
    return not any(member.is_running() and member.status() != "zombie" for member in members)


def killed(process: subprocess.Popen[str]) -> None:
    """Kill a client, and wait until its workers have noticed."""
    family = workers(process)
    process.send_signal(signal.SIGKILL)
    process.wait()
    until(lambda: gone(family), "gone with their client")


def goes_on(data: Path, out: Path, expected: bytes, *, command_line: bool = False) -> None:
    """Run again: what is missing is computed and nothing else."""
    before = files(out)
    kept = finished(out)
    if command_line:
        asked = command(data, out, "--workers", "1", "--json")
        done = subprocess.run(asked, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        report = json.loads(done.stdout)
        assert (report["done"], report["reused"]) == (PAIRS, kept)
    else:
        with in_this_process() as client:
            again = batch.run(st.datasets.open(data), SETTINGS, out, client)
        assert (again.done, again.reused) == (PAIRS, kept)
    assert before.items() <= files(out).items(), "a finished pair was computed again"
    assert (out / "results.csv").read_bytes() == expected
    assert leftovers(out) == []
    assert {row["name"] for row in table(out, "timings.csv")} == {f"{n:03}" for n in range(PAIRS)}
    for row in table(out):
        st.read_disparity(out / row["file"])


@contextmanager
def cluster(tmp_path: Path) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """A scheduler and a worker as processes of their own; the address and the scheduler."""
    told = tmp_path / "scheduler.json"
    scheduler = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    scheduler += ["--dashboard-address", "127.0.0.1:0", "--no-show", "--scheduler-file", str(told)]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(told)]
    worker += ["--host", "127.0.0.1", "--nthreads", "1", "--no-nanny", "--no-dashboard"]
    worker += [
        "--dashboard-address",
        "127.0.0.1:0",
        "--local-directory",
        str(tmp_path),
        "--death-timeout",
        "60",
    ]
    with started(*scheduler) as first:
        until(lambda: told.exists() and told.read_text().rstrip().endswith("}"), "a scheduler")
        with started(*worker):
            yield json.loads(told.read_text())["address"], first


def test_killed_client(data: Path, expected: bytes, tmp_path: Path) -> None:
    """Twice, as power cuts come."""
    out = tmp_path / "out"
    for _ in range(2):
        some = finished(out)
        with started(*command(data, out, "--workers", "1")) as client:
            until(lambda some=some: finished(out) > some + 1, "two more pairs")
            killed(client)
        assert finished(out) < PAIRS
    goes_on(data, out, expected, command_line=True)


def test_killed_worker(data: Path, expected: bytes, tmp_path: Path) -> None:
    """The run itself starts another and ends well."""
    out = tmp_path / "out"
    with started(*command(data, out, "--workers", "1", "--json")) as client:
        until(lambda: finished(out) >= 3, "three pairs")
        (worker,) = workers(client)
        worker.kill()
        until(lambda: gone([worker]), "dead")
        before = files(out)
        assert finished(out) < PAIRS
        told, complaint = client.communicate(timeout=PATIENCE)
    assert (client.returncode, complaint) == (0, "")
    assert json.loads(told)["done"] == PAIRS
    assert before.items() <= files(out).items(), "a finished pair was computed again"
    assert (out / "results.csv").read_bytes() == expected
    assert leftovers(out) == []


def test_worker_killed_with_results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was done, and not yet fetched from a worker, is done again by the next: here 3 pairs of 4."""
    pairs = [Made(f"{number}", number) for number in range(4)]
    take: Callable[..., Any] = cluster_module._Hands.take

    def first_robbed(hands: Any) -> Any:
        monkeypatch.undo()
        tasks = list(hands._waiting)
        until(lambda: all(task.status == "finished" for task in tasks), "done")
        hands._client.cluster.scale(0)
        until(lambda: all(task.status == "lost" for task in tasks), "lost")
        hands._client.cluster.scale(1)
        return take(hands)

    monkeypatch.setattr(cluster_module._Hands, "take", first_robbed)
    with in_this_process(threads=1) as client:
        assert batch.run(pairs, SETTINGS, tmp_path / "out", client).done == 4
    assert len(table(tmp_path / "out")) == 4


def test_killed_scheduler(data: Path, expected: bytes, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with cluster(tmp_path) as (address, scheduler):
        with started(*command(data, out, "--scheduler", address)) as client:
            until(lambda: finished(out) >= 3, "three pairs")
            scheduler.send_signal(signal.SIGKILL)
            _, complaint = client.communicate(timeout=PATIENCE)
        assert client.returncode == 2
        assert complaint.count("\n") == 1
        assert f"the Dask scheduler {address} is gone; what is finished is kept" in complaint
    assert 3 <= finished(out) < PAIRS
    assert 3 <= len(table(out)) < PAIRS, "the rows so far"
    goes_on(data, out, expected)


def test_killed_worker_of_a_cluster(data: Path, expected: bytes, tmp_path: Path) -> None:
    """Its pairs wait for another worker."""
    out = tmp_path / "out"
    with cluster(tmp_path) as (address, _):
        alone = [
            sys.executable,
            "-m",
            "distributed.cli.dask_worker",
            address,
            "--no-nanny",
            "--nthreads",
            "1",
        ]
        alone += ["--dashboard-address", "127.0.0.1:0", "--local-directory", str(tmp_path / "second")]
        with (
            started(*command(data, out, "--scheduler", address, "--json")) as client,
            started(*alone) as second,
        ):
            until(lambda: finished(out) >= 5, "five pairs")
            second.kill()
            told, _ = client.communicate(timeout=PATIENCE)
    assert client.returncode == 0
    assert json.loads(told)["done"] == PAIRS
    assert (out / "results.csv").read_bytes() == expected


def test_interrupted_client(data: Path, expected: bytes, tmp_path: Path) -> None:
    """Ctrl-C reaches the whole group of processes, as from a terminal."""
    out = tmp_path / "out"
    with started(*command(data, out, "--workers", "1"), start_new_session=True) as client:
        until(lambda: finished(out) >= 3, "three pairs")
        os.killpg(client.pid, signal.SIGINT)
        _, complaint = client.communicate(timeout=PATIENCE)
    assert client.returncode == 130
    assert [line.partition(":")[0] for line in complaint.splitlines()] == ["stereopsis"] * 2
    assert "the same command goes on" in complaint
    assert len(table(out)) == finished(out) < PAIRS
    goes_on(data, out, expected)


def test_yanked_folder(data: Path, expected: bytes, tmp_path: Path) -> None:
    """The folder is gone in the middle: one sentence, no second folder in its place; then it is back."""
    out, away = tmp_path / "out", tmp_path / "away"
    with started(*command(data, out, "--workers", "1")) as client:
        until(lambda: finished(out) >= 3, "three pairs")
        out.rename(away)
        _, complaint = client.communicate(timeout=PATIENCE)
    assert client.returncode == 2
    assert complaint.count("\n") == 1
    assert "No such file or directory" in complaint
    assert "what is finished is kept" in complaint
    assert not out.exists()
    assert 3 <= finished(away) < PAIRS
    away.rename(out)
    goes_on(data, out, expected)


@contextmanager
def small_disk(where: Path, kilobytes: int) -> Iterator[None]:
    """A disk of its own in memory; skips where this user may not mount one."""
    where.mkdir()
    mount = shutil.which("mount")
    size = f"size={kilobytes}k"
    if (
        mount is None
        or subprocess.run(
            [mount, "-t", "tmpfs", "-o", size, "tmpfs", str(where)], capture_output=True, check=False
        ).returncode
    ):
        pytest.skip("this user may not mount a disk")
    try:
        yield
    finally:
        subprocess.run(["umount", str(where)], check=True)


def test_full_disk(data: Path, expected: bytes, tmp_path: Path) -> None:
    """A real one, which takes some of the pairs; then there is room again."""
    disk = tmp_path / "disk"
    with small_disk(disk, 900):
        out = disk / "out"
        with started(*command(data, out, "--workers", "1")) as client:
            _, complaint = client.communicate(timeout=PATIENCE)
        assert client.returncode == 2
        assert complaint.count("\n") == 1
        assert "No space left on device" in complaint
        assert 0 < finished(out) < PAIRS
        assert leftovers(out) == []
        subprocess.run(["mount", "-o", "remount,size=64m", str(disk)], check=True)
        goes_on(data, out, expected)


def test_files_may_not_grow(tmp_path: Path) -> None:
    """The same for any user: the system refuses files beyond a limit, which the first maps do not reach."""
    import resource

    data = dataset(tmp_path / "data", PAIRS - 4)
    for number in range(PAIRS - 4, PAIRS):
        shutil.copytree(dataset(tmp_path / f"large-{number}", 1, 480, 320), data, dirs_exist_ok=True)
        for part in ("left", "right", "disparity"):
            (data / f"000-{part}.png").rename(data / f"{number:03}-{part}.png")
    for file in dataset(tmp_path / "again", 1).iterdir():
        file.rename(data / file.name)
    with in_this_process() as client:
        batch.run(st.datasets.open(data), SETTINGS, tmp_path / "expected", client)

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (8192, resource.RLIM_INFINITY))

    out = tmp_path / "out"
    with started(*command(data, out, "--workers", "1"), preexec_fn=limited) as client:
        _, complaint = client.communicate(timeout=PATIENCE)
    assert client.returncode == 2
    assert complaint.count("\n") == 1
    assert "File too large" in complaint
    assert finished(out) == PAIRS - 4
    assert leftovers(out) == []
    goes_on(data, out, (tmp_path / "expected/results.csv").read_bytes())


# Real time plus the seconds that a file holds, for a process and all that it starts.
CLOCK = """
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>
static long jump(void) {
    long seconds = 0;
    FILE *file = fopen(getenv("CLOCK_FILE"), "r");
    if (file) { if (fscanf(file, "%ld", &seconds) != 1) seconds = 0; fclose(file); }
    return seconds;
}
int clock_gettime(clockid_t clock, struct timespec *now) {
    long failed = syscall(SYS_clock_gettime, clock, now);
    if (!failed && clock == CLOCK_REALTIME) now->tv_sec += jump();
    return (int)failed;
}
int gettimeofday(struct timeval *restrict now, void *restrict zone) {
    struct timespec exact;
    int failed = clock_gettime(CLOCK_REALTIME, &exact);
    now->tv_sec = exact.tv_sec, now->tv_usec = exact.tv_nsec / 1000;
    return failed;
}
time_t time(time_t *to) {
    struct timespec exact;
    clock_gettime(CLOCK_REALTIME, &exact);
    if (to) *to = exact.tv_sec;
    return exact.tv_sec;
}
"""


@pytest.mark.parametrize("seconds", [-1_000_000_000, 1_000_000_000])
def test_clock_jumps(seconds: int, data: Path, expected: bytes, tmp_path: Path) -> None:
    """By thirty years in the middle, for client, scheduler and workers; files are then from elsewhen."""
    compiler = shutil.which("cc")
    if compiler is None or not sys.platform.startswith("linux"):
        pytest.skip("needs a C compiler on Linux")
    (tmp_path / "clock.c").write_text(CLOCK)
    library, offset, out = tmp_path / "clock.so", tmp_path / "offset", tmp_path / "out"
    subprocess.run([compiler, "-shared", "-fPIC", "-o", library, tmp_path / "clock.c"], check=True)
    environment = os.environ | {"LD_PRELOAD": str(library), "CLOCK_FILE": str(offset)}
    offset.write_text(str(seconds))
    seen = subprocess.run(
        [sys.executable, "-c", "import time; print(time.time())"],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert float(seen.stdout) - time.time() == pytest.approx(seconds, abs=60), "the clock jumps"
    offset.unlink()
    with started(*command(data, out, "--workers", "1", "--json"), env=environment) as client:
        until(lambda: finished(out) >= 3, "three pairs")
        (tmp_path / "new").write_text(str(seconds))
        (tmp_path / "new").rename(offset)
        report, complaint = client.communicate(timeout=PATIENCE)
    assert (client.returncode, complaint) == (0, "")
    assert json.loads(report)["done"] == PAIRS
    assert 0 < json.loads(report)["seconds"] < PATIENCE
    assert (out / "results.csv").read_bytes() == expected
    for row in table(out, "timings.csv"):
        assert 0 < float(row["seconds"]) < PATIENCE
    for number, path in enumerate(sorted(out.rglob("*.*"))):
        os.utime(path, (1, 1) if number % 2 else (4e9, 4e9))
    before = files(out)
    with in_this_process() as near:
        assert batch.run(st.datasets.open(data), SETTINGS, out, near).reused == PAIRS
    assert files(out) == before
