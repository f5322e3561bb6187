"""What one bad pair, or a bad name, does to a run: a line in failures.csv, and nothing to the others.

Faults of single files are those of the readers; tests/test_batch_chaos.py kills processes and fills disks.
"""

from __future__ import annotations

import dataclasses
import os
import re
import shutil
import struct
import tempfile
import threading
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stereopsis as st
from batch_data import OPTIONS, QUIET, SETTINGS, Made, dataset, files, in_this_process, table
from stereopsis import batch
from stereopsis.batch import record, store, work
from stereopsis.cli import main
from stereopsis.io import disparity as io

pytest.importorskip("distributed")
pytestmark = [pytest.mark.filterwarnings(text) for text in QUIET]
posix = pytest.mark.skipif(os.name == "nt", reason="needs a POSIX file system")


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    with in_this_process() as client:
        yield client


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return dataset(tmp_path / "data", 3)


def one_fails(data: Path, out: Path, client: Any, **options: Any) -> str:
    """Run over three pairs of which the middle one is bad; the reason that failures.csv gives."""
    report = batch.run(st.datasets.open(data), SETTINGS, out, client, **options)
    assert [row["name"] for row in table(out)] == ["000", "002"]
    assert (report.pairs, report.done) == (3, 2)
    assert sorted(path.name for path in (out / "disparity").iterdir()) == ["000.png", "002.png"]
    ((failure),) = table(out, "failures.csv")
    assert failure["name"] == "001"
    assert report.failures == (batch.Failure("001", failure["reason"]),)
    assert "\n" not in failure["reason"]
    return failure["reason"]


# One bad file


def truncated(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-200])


def empty(file: Path) -> None:
    file.write_bytes(b"")


def text(file: Path) -> None:
    file.write_text("not a picture\n" * 100)


def folder(file: Path) -> None:
    file.unlink()
    file.mkdir()


def loop(file: Path) -> None:
    other = file.with_name("loop")
    file.unlink()
    file.symlink_to(other)
    other.symlink_to(file)


def missing(file: Path) -> None:
    file.unlink()


def no_right_view(file: Path) -> None:
    file.with_name(file.name.replace("left", "right")).unlink()


def bomb(file: Path) -> None:
    """A few bytes that announce 900 million pixels."""
    header = b"IHDR" + struct.pack(">IIBBBBB", 30_000, 30_000, 8, 0, 0, 0, 0)
    chunk = struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))
    file.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk + file.read_bytes()[33:])


def other_size(file: Path) -> None:
    st.write_image(file, np.zeros((24, 60), np.uint8))


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (truncated, "001-left.png"),
        (empty, "001-left.png: the file is empty"),
        (text, "001-left.png: not a PNG"),
        pytest.param(folder, "001-left.png: Is a directory", marks=posix),
        pytest.param(loop, "001-left.png: Too many levels of symbolic links", marks=posix),
        (missing, "001-left.png: No such file"),
        (no_right_view, "001-right.png: No such file"),
        (bomb, "001-left.png: .*pixels"),
        (other_size, "60 x 24"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_one_bad_file_costs_one_pair(
    fault: Callable[[Path], None], message: str, data: Path, tmp_path: Path, client: Any
) -> None:
    fault(data / "001-left.png")
    assert re.search(message, one_fails(data, tmp_path / "out", client))


def test_a_bad_truth_costs_one_pair_where_it_is_needed(data: Path, tmp_path: Path, client: Any) -> None:
    truncated(data / "001-disparity.png")
    assert "001-disparity.png" in one_fails(data, tmp_path / "out", client, evaluate=True)
    assert batch.run(st.datasets.open(data), SETTINGS, tmp_path / "plain", client).done == 3


def test_a_truth_of_another_size(data: Path, tmp_path: Path, client: Any) -> None:
    st.write_disparity(data / "001-disparity.png", np.full((24, 60), 3, np.float32))
    told = one_fails(data, tmp_path / "out", client, evaluate=True)
    assert told == "the truth is 60 x 24 pixels, the images are 64 x 24"


def test_disparities_that_the_format_cannot_hold(tmp_path: Path, client: Any) -> None:
    """KITTI's PNG has no negative ones: said, and another format offered."""
    settings = SETTINGS.changed(disparities=(-8, 16))
    flipped = Made("b", 3)

    class Negative(Made):
        def pair(self) -> st.Pair:
            pair = flipped.pair()
            return st.Pair(pair.right, pair.left)

    report = batch.run([Negative("a")], settings, tmp_path / "out", client)
    assert "write .pfm, .npy or .tif" in report.failures[0].reason
    assert batch.run([Negative("a")], settings, tmp_path / "floats", client, format="pfm").done == 1


def test_answers_behind_infinity_cost_no_pair() -> None:
    """Where the range begins at 0, what a sub-pixel fit puts below it is written as 0, in a PNG alone."""
    found = np.array([[-0.3, 2.5, np.nan]], np.float32)
    flags = np.zeros(found.shape, np.uint8)
    seen = st.Result(found, np.zeros_like(found), flags, SETTINGS, "composed", 0.0)
    _, stored = io.encode_disparity(work._in_front(seen, "png"), "kitti")
    np.testing.assert_array_equal(stored, np.array([[1 / 256, 2.5, np.nan]], np.float32))
    np.testing.assert_array_equal(work._in_front(seen, "pfm"), found)
    negative = dataclasses.replace(seen, settings=SETTINGS.changed(disparities=(-4, 16)))
    np.testing.assert_array_equal(work._in_front(negative, "png"), found)


@contextmanager
def without_privileges() -> Iterator[Path]:
    """A folder of a user whom the system refuses something, also when root runs the tests."""
    folder = Path(tempfile.mkdtemp())
    root = os.geteuid() == 0
    try:
        if root:
            os.chown(folder, 65534, 65534)
            os.seteuid(65534)
        yield folder
    finally:
        if root:
            os.seteuid(0)
        shutil.rmtree(folder)


@posix
def test_permission_denied(tmp_path: Path, client: Any) -> None:
    batch.run([Made("a")], SETTINGS, tmp_path / "warm", client)  # whatever is imported late is imported
    with without_privileges() as folder:
        data = dataset(folder / "data", 3)
        (data / "001-right.png").chmod(0)
        assert one_fails(data, folder / "out", client).endswith("001-right.png: Permission denied")
        (folder / "closed").mkdir(mode=0o500)
        with pytest.raises(PermissionError, match="closed"):
            batch.run(st.datasets.open(data), SETTINGS, folder / "closed/out", client)
        (folder / "out/disparity").chmod(0o500)
        (data / "001-right.png").chmod(0o600)
        with pytest.raises(OSError, match=r"001.png: Permission denied .*; what is finished is kept"):
            batch.run(st.datasets.open(data), SETTINGS, folder / "out", client)
        (folder / "out/disparity").chmod(0o700)
        again = batch.run(st.datasets.open(data), SETTINGS, folder / "out", client)
        assert (again.done, again.reused) == (3, 2)


# One bad sample


@pytest.mark.parametrize(
    "error", [MemoryError("too large"), KeyError("x"), RecursionError(), OSError("a\nb"), RuntimeError()]
)
def test_whatever_a_sample_raises(error: Exception, tmp_path: Path, client: Any) -> None:
    class Bad(Made):
        def pair(self) -> st.Pair:
            raise error

    report = batch.run([Made("a"), Bad("b"), Made("c")], SETTINGS, tmp_path / "out", client)
    assert [failure.name for failure in report.failures] == ["b"]
    assert report.failures[0].reason
    assert "\n" not in report.failures[0].reason


def test_a_sample_that_cannot_be_sent(tmp_path: Path) -> None:
    """It fails alone, also in a task with others."""
    from distributed import Client, LocalCluster

    class Locked(Made):
        pass

    bad = Locked("b")
    object.__setattr__(bad, "lock", threading.Lock())
    samples = [Made(f"a{n}") for n in range(20)] + [bad] + [Made(f"c{n}") for n in range(20)]
    options = {"n_workers": 1, "threads_per_worker": 1, "processes": True, "dashboard_address": ":0"}
    with LocalCluster(**options) as processes, Client(processes) as apart:
        report = batch.run(samples, SETTINGS, tmp_path / "out", apart)
    assert [failure.name for failure in report.failures] == ["b"]
    assert "cannot be sent to a worker" in report.failures[0].reason
    assert report.done == 40


class Deadly(Made):
    """A pair that takes its worker with it, as one does that needs more memory than there is."""

    def pair(self) -> st.Pair:
        os.kill(os.getpid(), 9)
        raise AssertionError


@posix
def test_a_pair_that_kills_its_workers(tmp_path: Path) -> None:
    """After Dask's patience is at its end, it is a failure; what waited beside it is done."""
    import dask

    samples = [*(Made(f"{n:02}") for n in range(9)), Deadly("09"), Made("10")]
    with dask.config.set({"distributed.scheduler.allowed-failures": 0}):
        report = batch.run(samples, SETTINGS, tmp_path / "out", workers=1)
    assert report.failures == (
        batch.Failure("09", "1 workers died over it, as they do when memory runs out"),
    )
    assert [row["name"] for row in table(tmp_path / "out")] == [f"{n:02}" for n in (*range(9), 10)]


def test_samples_that_end_in_an_error_lose_nothing(tmp_path: Path, client: Any) -> None:
    def samples() -> Iterator[Made]:
        yield from (Made(f"{n}") for n in range(5))
        raise RuntimeError("the list ends here")

    with pytest.raises(RuntimeError, match="the list ends here"):
        batch.run(samples(), SETTINGS, tmp_path / "out", client)
    report = batch.run([Made(f"{n}") for n in range(6)], SETTINGS, tmp_path / "out", client)
    assert report.done == 6
    assert len(table(tmp_path / "out")) == 6


# Names


def test_duplicate_names(tmp_path: Path, client: Any) -> None:
    """The first has the name; the second is a failure, in every run."""
    samples = [Made("a", 1), Made("b", 2), Made("a", 3)]
    for reused in (0, 2):
        report = batch.run(samples, SETTINGS, tmp_path / "out", client)
        assert (report.done, report.reused) == (2, reused)
        assert report.failures == (batch.Failure("a", "pair 1 of the data set has the same name"),)
    expected = st.match(Made("a", 1).pair(), settings=SETTINGS).disparity
    found = st.read_disparity(tmp_path / "out/disparity/a.png")
    np.testing.assert_allclose(found, np.where(expected < 1 / 256, 1 / 256, expected), atol=1 / 512)


NAMES = {
    "two words": "two words",
    "Straße/übung": "Straße/übung",
    "日本 🌉": "日本 🌉",
    "line\nbreak": "line%0Abreak",
    'quote", comma': "quote%22, comma",
    "100 %": "100 %25",
    ".hidden": "%2Ehidden",
    "con": "%63on",
    "../climbs": "%2E%2E/climbs",
    "../../../../tmp/climbs": "%2E%2E/%2E%2E/%2E%2E/%2E%2E/tmp/climbs",
    "/tmp/absolute": "%/tmp/absolute",
    "inside/../../out": "inside/%2E%2E/%2E%2E/out",
    "C:\\windows": "C%3A%5Cwindows",
    "undecodable \udcff": "undecodable %FF",
    "end.": "end%2E",
}


@posix
def test_odd_names(tmp_path: Path, client: Any) -> None:
    """Every map lies inside the folder, under a path that gives the name back."""
    out = tmp_path / "deep" / "out"
    samples = [Made(name, number) for number, name in enumerate(NAMES)]
    report = batch.run(samples, SETTINGS, out, client)
    assert report.failures == ()
    assert [row["file"] for row in table(out)] == [f"disparity/{path}.png" for path in NAMES.values()]
    told = [name.encode("utf-8", "backslashreplace").decode() for name in NAMES]
    assert [row["name"] for row in table(out)] == told
    inside = {str(path.relative_to(out / "disparity")) for path in out.rglob("*.png")}
    assert inside == {f"{path}.png" for path in NAMES.values()}
    assert [path.name for path in tmp_path.iterdir()] == ["deep"]
    assert batch.run(samples, SETTINGS, out, client).reused == len(NAMES)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("", "at least one letter"),
        (7, "must be a text"),
        ("x" * 300, "too long"),
        ("ü/" + "ü" * 130, "too long"),
    ],
)
def test_names_that_no_file_can_have(name: Any, message: str, tmp_path: Path, client: Any) -> None:
    report = batch.run([Made("a"), Made(name)], SETTINGS, tmp_path / "out", client)
    assert report.done == 1
    assert message in report.failures[0].reason


def test_a_name_that_another_pair_has_here(tmp_path: Path, client: Any) -> None:
    """Where a file system takes two names for one, the second pair does not take the first one's file."""
    out = tmp_path / "out"
    batch.run([Made("a", 1)], SETTINGS, out, client)
    identity = record.Identity.of([], SETTINGS, "png", False)
    job = work.Job(store.at(out), SETTINGS, "png", False, identity.run, identity.version)
    before = files(out)
    (answer,), _ = work.pairs(job, [work.Item(0, Made("A", 2), "a")])
    assert answer == batch.Failure("A", "its file is that of the pair 'a' here")
    assert files(out) == before


# The place


@posix
def test_the_output_is_a_loop_of_links(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").symlink_to(tmp_path / "other")
    (tmp_path / "other").symlink_to(tmp_path / "out")
    assert main(["batch", str(data), "-o", str(tmp_path / "out"), *OPTIONS]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert str(tmp_path / "out") in told


def test_the_output_is_a_file(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "out").write_text("x")
    assert main(["batch", str(data), "-o", str(tmp_path / "out"), *OPTIONS]) == 2
    assert capsys.readouterr().err.count("\n") == 1
