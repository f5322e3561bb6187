"""A data set as one run: what it writes, what it computes again, what it refuses."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as some

import stereopsis as st
from batch_data import (
    OPTIONS,
    QUIET,
    SETTINGS,
    Made,
    command,
    dataset,
    files,
    in_this_process,
    leftovers,
    table,
)
from stereopsis import _extras, batch
from stereopsis.batch import cluster, job, names, record, store, work
from stereopsis.cli import main
from stereopsis.evaluate import Measures

pytest.importorskip("distributed")
pytestmark = [pytest.mark.filterwarnings(text) for text in QUIET]


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    with in_this_process() as client:
        yield client


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return dataset(tmp_path_factory.mktemp("batch") / "data", 6)


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory, data: Path, client: Any) -> tuple[Path, batch.Report]:
    """A scored run that nothing disturbed."""
    out = tmp_path_factory.mktemp("batch") / "out"
    return out, batch.run(st.datasets.open(data), SETTINGS, out, client, evaluate=True)


# What it writes


def test_every_pair_gets_its_map_and_its_row(done: tuple[Path, batch.Report], data: Path) -> None:
    out, report = done
    assert (report.pairs, report.done, report.reused, report.failures) == (6, 6, 0, ())
    assert sorted(path.name for path in out.iterdir() if path.name != ".lock") == [
        "disparity",
        "failures.csv",
        "results.csv",
        "rows",
        "run.toml",
        "timings.csv",
    ]
    rows = table(out)
    assert [row["name"] for row in rows] == [f"{number:03}" for number in range(6)]
    for row, sample in zip(rows, st.datasets.open(data), strict=True):
        result = st.match(sample.pair(), settings=SETTINGS)
        st.write_disparity(out.parent / "expected.png", result.disparity)
        assert (out / row["file"]).read_bytes() == (out.parent / "expected.png").read_bytes()
        assert float(row["density"]) == result.density
        assert (row["width"], row["height"]) == ("64", "24")
        assert (row["disparity_min"], row["disparity_max"]) == ("0", "16")
        for flag in st.Flag:
            assert int(row[str(flag.name).lower()]) == np.count_nonzero(result.flags & flag)


def test_scores_are_those_of_the_written_map(done: tuple[Path, batch.Report], data: Path) -> None:
    """Whoever gives the file to `stereopsis evaluate` finds the same numbers."""
    out, report = done
    for row in table(out):
        truth = st.read_disparity(data / f"{row['name']}-disparity.png")
        scores = st.evaluate(st.read_disparity(out / row["file"]), truth)
        assert (int(row["known"]), int(row["answered"])) == (scores.known, scores.answered)
        assert float(row["known_density"]) == scores.density
        for part in ("own", "all", "filled"):
            for name in Measures.__dataclass_fields__:
                assert float(row[f"{part}_{name}"]) == getattr(getattr(scores, part), name), name
    mean = np.mean([float(row["own_epe"]) for row in table(out)])
    assert report.means["own_epe"] == pytest.approx(mean, rel=1e-12)


def test_times_are_apart(done: tuple[Path, batch.Report]) -> None:
    out, _ = done
    assert "seconds" not in (out / "results.csv").read_text().splitlines()[0]
    times = table(out, "timings.csv")
    assert list(times[0]) == ["name", "seconds", "read", "match", "evaluate", "write", "worker"]
    for row in times:
        parts = [float(row[stage]) for stage in work.STAGES]
        assert float(row["seconds"]) == pytest.approx(sum(parts), abs=1e-5)
        assert min(parts) > 0
    assert (out / "failures.csv").read_text() == "name,reason\n"


def test_run_toml_tells_settings_versions_data_and_machine(
    done: tuple[Path, batch.Report], data: Path
) -> None:
    told = tomllib.loads((done[0] / "run.toml").read_text())
    assert told["data"] == {"name": st.datasets.open(data).name, "folder": str(data)}
    assert told["run"]["version"] == st.__version__
    assert (told["run"]["format"], told["run"]["evaluate"]) == ("png", True)
    assert told["machine"]["numpy"] == np.__version__
    text = (done[0] / "run.toml").read_text().partition("[settings]\n")[2]
    assert st.Settings.from_toml(text) == SETTINGS


@pytest.mark.parametrize("format", ["pfm", "npy", "tif", "tiff"])
def test_maps_of_floats_are_exact(format: str, tmp_path: Path, client: Any) -> None:
    batch.run([Made("a", 4)], SETTINGS, tmp_path / "out", client, format=format)
    expected = st.match(Made("a", 4).pair(), settings=SETTINGS).disparity
    np.testing.assert_array_equal(st.read_disparity(tmp_path / f"out/disparity/a.{format}"), expected)


def test_pairs_without_truth_have_no_scores(tmp_path: Path, client: Any) -> None:
    class Blind(Made):
        def truth(self) -> None:
            return None

    report = batch.run([Made("a"), Blind("b")], SETTINGS, tmp_path / "out", client, evaluate=True)
    seen, blind = table(tmp_path / "out")
    assert seen["own_epe"] != ""
    assert blind["own_epe"] == blind["known"] == ""
    assert report.means["own_epe"] == float(seen["own_epe"])


def test_scores_count_inside_the_mask(tmp_path: Path, client: Any) -> None:
    class Masked(Made):
        def mask(self) -> Any:
            return np.arange(64) < np.full((24, 1), 10)

    batch.run([Masked("a")], SETTINGS, tmp_path / "out", client, evaluate=True)
    assert table(tmp_path / "out")[0]["known"] == str(24 * 10)


def test_an_iterator_is_taken_only_as_workers_need_it(tmp_path: Path, client: Any) -> None:
    """Of two threads at most five tasks wait: what is held does not grow with the data set."""
    ahead = []

    def samples() -> Iterator[Made]:
        for number in range(300):
            finished = len(list((tmp_path / "out/rows").glob("*.json")))
            ahead.append(number - finished)
            yield Made(f"{number:03}", number)

    report = batch.run(samples(), SETTINGS, tmp_path / "out", client)
    assert report.done == 300
    assert max(ahead) <= 5 * cluster.LARGEST
    assert [row["name"] for row in table(tmp_path / "out")] == [f"{number:03}" for number in range(300)]


def test_progress_is_told_and_tables_are_written_meanwhile(
    tmp_path: Path, client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(job, "INTERVAL", 0.0)
    told: list[tuple[int, int | None]] = []
    lines: list[int] = []

    def progress(finished: int, total: int | None, what: str) -> None:
        told.append((finished, total))
        written = tmp_path / "out/results.csv"
        lines.append(len(table(tmp_path / "out")) if written.exists() else 0)

    samples = [Made(f"{n}", n, "broken" if n == 8 else "") for n in range(9)]
    batch.run(samples, SETTINGS, tmp_path / "out", client, progress=progress)
    assert told == [(n, 9) for n in range(10)]
    assert any(0 < count < 8 for count in lines)
    assert len(table(tmp_path / "out")) == 8


def test_what_a_worker_that_died_left_behind_is_removed(tmp_path: Path, client: Any) -> None:
    """Another worker took its pair over: the run ends well, and leaves nothing half written."""
    out = tmp_path / "out"
    left = out / "disparity" / f".{'0' * 12}.tmp"

    def progress(finished: int, total: int | None, what: str) -> None:
        if finished:
            left.write_bytes(b"half")

    batch.run([Made(f"{n}", n, "") for n in range(3)], SETTINGS, out, client, progress=progress)
    assert sorted(path.name for path in left.parent.iterdir()) == ["0.png", "1.png", "2.png"]


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="a setting of glibc")
def test_workers_keep_freed_memory() -> None:
    """Dask's setting for its workers lets every array fault its pages in anew: here 2048 for each of 20."""
    code = """
import resource, numpy as np
from stereopsis.batch import preload
preload.keep_memory()
for _ in range(20):
    np.ones(2**20)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt)
for _ in range(20):
    np.ones(2**20)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt)
"""
    dasks = os.environ | {"MALLOC_TRIM_THRESHOLD_": "65536"}
    told = subprocess.run([sys.executable, "-c", code], env=dasks, capture_output=True, text=True, check=True)
    before, after = map(int, told.stdout.split())
    assert after - before < 2048


def test_tasks_grow_with_the_workers_and_shrink_at_the_end() -> None:
    pace = cluster._Pace()
    assert pace.pairs(2, None) == 1
    pace.learn(0.125)
    assert pace.pairs(2, None) == 8
    assert pace.pairs(2, 12) == 2
    assert pace.pairs(2, 1) == 1
    assert pace.pairs(500, None) == 32
    assert pace.pairs(10_000, None) == cluster.LARGEST
    for _ in range(40):
        pace.learn(0.005)
    assert pace.pairs(2, 1) == 20


def test_rows_are_packed_and_come_back() -> None:
    rows = job._Rows()
    records = {number: f'{{"run":"same for all","row":{number}}}'.encode() for number in (3, 0, 7)}
    for number, data in records.items():
        rows.put(number, data)
    assert list(rows) == [records[0], records[3], records[7]]
    assert (rows.get(7), rows.get(5)) == (records[7], None)


# Going on


def test_the_same_run_computes_nothing_again(
    done: tuple[Path, batch.Report], data: Path, client: Any
) -> None:
    out, _ = done
    before, tables = files(out), [(out / name).read_bytes() for name in store.TABLES]
    report = batch.run(st.datasets.open(data), SETTINGS, out, client, evaluate=True)
    assert (report.done, report.reused) == (6, 6)
    assert files(out) == before
    assert [(out / name).read_bytes() for name in store.TABLES] == tables
    assert len(before) == 12


def copied(done: tuple[Path, batch.Report], to: Path) -> Path:
    for path in sorted(done[0].rglob("*")):
        target = to / path.relative_to(done[0])
        if path.is_file():
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(path.read_bytes())
    return to


@pytest.mark.parametrize(
    "damage", ["no map", "half a map", "no row", "half a row", "row of another run", "unfinished"]
)
def test_only_what_is_not_whole_is_computed_again(
    damage: str, done: tuple[Path, batch.Report], data: Path, tmp_path: Path, client: Any
) -> None:
    out = copied(done, tmp_path / "out")
    map_, row = out / "disparity/002.png", out / "rows/002.json"
    match damage:
        case "no map":
            map_.unlink()
        case "half a map":
            map_.write_bytes(map_.read_bytes()[:-7])
        case "no row":
            row.unlink()
        case "half a row":
            row.write_bytes(row.read_bytes()[:50])
        case "row of another run":
            row.write_text(row.read_text().replace('"run":"', '"run":"0'))
        case "unfinished":
            for folder in ("", "disparity", "rows"):
                (out / folder / ".0123456789ab.tmp").write_bytes(b"half")
    before = files(out)
    report = batch.run(st.datasets.open(data), SETTINGS, out, client, evaluate=True)
    lost = 0 if damage == "unfinished" else 1
    assert (report.done, report.reused) == (6, 6 - lost)
    same = {path: seen for path, seen in before.items() if "002" not in path or not lost}
    assert same.items() <= files(out).items()
    assert leftovers(out) == []
    assert (out / "results.csv").read_bytes() == (done[0] / "results.csv").read_bytes()
    assert map_.read_bytes() == (done[0] / "disparity/002.png").read_bytes()


def test_failed_pairs_are_tried_again(tmp_path: Path, client: Any) -> None:
    out = tmp_path / "out"
    first = batch.run([Made("a"), Made("b", 1, "broken"), Made("c", 2)], SETTINGS, out, client)
    assert first.failures == (batch.Failure("b", "broken"),)
    assert [row["name"] for row in table(out)] == ["a", "c"]
    assert table(out, "failures.csv") == [{"name": "b", "reason": "broken"}]
    second = batch.run([Made("a"), Made("b", 1), Made("c", 2)], SETTINGS, out, client)
    assert (second.done, second.reused, second.failures) == (3, 2, ())
    assert [row["name"] for row in table(out)] == ["a", "b", "c"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"settings": SETTINGS.changed(median=3)}, r"median none, not 3"),
        ({"settings": SETTINGS.changed(window=7)}, r"window \[5, 5\], not \[7, 7\]|window 5, not 7"),
        ({"evaluate": False}, "evaluate true, not false"),
        ({"format": "pfm"}, "format png, not pfm"),
        ({"resume": False}, "holds a run already"),
    ],
)
def test_another_run_into_the_same_place_is_refused(
    changes: dict[str, Any], message: str, done: tuple[Path, batch.Report], data: Path, client: Any
) -> None:
    asked = {"settings": SETTINGS, "evaluate": True} | changes
    before = files(done[0])
    with pytest.raises(ValueError, match=message):
        batch.run(st.datasets.open(data), out=done[0], client=client, **asked)
    assert files(done[0]) == before


def test_another_data_set_or_version_is_refused(
    done: tuple[Path, batch.Report], data: Path, tmp_path: Path, client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = dataset(tmp_path / "other", 6)
    with pytest.raises(ValueError, match=r"data folder .*data, not .*other"):
        batch.run(st.datasets.open(other), SETTINGS, done[0], client, evaluate=True)
    monkeypatch.setattr(record, "version", lambda: "9.9")
    with pytest.raises(ValueError, match=f"version {st.__version__}, not 9.9"):
        batch.run(st.datasets.open(data), SETTINGS, done[0], client, evaluate=True)


def test_other_files_of_the_same_names_are_refused(tmp_path: Path, client: Any) -> None:
    class Filed(Made):
        left_file = Path("somewhere.png")

    batch.run([Made("a")], SETTINGS, tmp_path / "out", client)
    with pytest.raises(ValueError, match=r"other files: a was no file, and is somewhere.png"):
        batch.run([Filed("a")], SETTINGS, tmp_path / "out", client)


def test_threads_and_kept_arrays_are_no_other_run(tmp_path: Path, client: Any) -> None:
    batch.run([Made("a")], SETTINGS, tmp_path / "out", client)
    changed = SETTINGS.changed(threads=2, keep=("costs",))
    assert batch.run([Made("a")], changed, tmp_path / "out", client).reused == 1


def test_overwrite_begins_anew(tmp_path: Path, client: Any) -> None:
    out = tmp_path / "out"
    batch.run([Made("a"), Made("b", 1)], SETTINGS, out, client)
    (out / "notes.txt").write_text("mine")
    report = batch.run([Made("a")], SETTINGS.changed(window=7), out, client, overwrite=True, format="pfm")
    assert (report.done, report.reused) == (1, 0)
    assert [path.name for path in (out / "disparity").iterdir()] == ["a.pfm"]
    assert (out / "notes.txt").read_text() == "mine"


def test_a_folder_of_something_else_is_refused(tmp_path: Path, client: Any) -> None:
    (tmp_path / "disparity").mkdir()
    (tmp_path / "disparity/precious.png").write_bytes(b"x")
    with pytest.raises(ValueError, match=r"holds files but no run.toml"):
        batch.run([Made("a")], SETTINGS, tmp_path, client)
    (tmp_path / "run.toml").write_text("half = [")
    with pytest.raises(ValueError, match="is no record of a run"):
        batch.run([Made("a")], SETTINGS, tmp_path, client)
    assert (tmp_path / "disparity/precious.png").read_bytes() == b"x"


def test_two_runs_at_once_are_refused(tmp_path: Path, client: Any) -> None:
    place = store.at(tmp_path / "out")
    place.prepare()
    with place.lock(), pytest.raises(OSError, match="is being written by another run"):
        batch.run([Made("a")], SETTINGS, tmp_path / "out", client)
    assert batch.run([Made("a")], SETTINGS, tmp_path / "out", client).done == 1


def test_a_pair_done_meanwhile_is_not_done_again(tmp_path: Path, client: Any) -> None:
    """As when a worker dies after the row is there and before the client has heard of it."""
    out = tmp_path / "out"
    batch.run([Made("a")], SETTINGS, out, client)
    identity = record.Identity.of([], SETTINGS, "png", False)
    asked = work.Job(store.at(out), SETTINGS, "png", False, identity.run, identity.version)
    before = files(out)
    (answer,), _ = work.pairs(asked, [work.Item(7, Made("a"), "a")])
    assert answer == (out / "rows/a.json").read_bytes()
    assert files(out) == before


def test_a_worker_of_another_version_does_nothing(tmp_path: Path) -> None:
    asked = work.Job(store.at(tmp_path), SETTINGS, "png", False, "run", "9.9")
    (answer,), _ = work.pairs(asked, [work.Item(0, Made("a"), "a")])
    assert isinstance(answer, batch.Failure)
    assert f"runs stereopsis {st.__version__}, the client 9.9" in answer.reason


# Where it writes


@pytest.mark.parametrize("whole", [True, False])
def test_a_place_that_fsspec_knows(
    whole: bool, done: tuple[Path, batch.Report], data: Path, client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An object is put as a whole; where that is not so, written beside its place and moved."""
    import fsspec

    if not whole:
        monkeypatch.setattr(store, "ONE_PUT", frozenset())
    system = fsspec.filesystem("memory")
    url = f"memory://runs/{whole}"
    samples = st.datasets.open(data)
    report = batch.run(samples, SETTINGS, url, client, evaluate=True)
    assert (report.out, report.done) == (url, 6)
    found = {path.removeprefix(f"/runs/{whole}/") for path in system.find(f"/runs/{whole}")}
    assert found == {str(path.relative_to(done[0])) for path in done[0].rglob("*") if path.is_file()} - {
        ".lock"
    }
    system.rm_file(f"/runs/{whole}/rows/003.json")
    system.pipe_file(f"/runs/{whole}/rows/.0123456789ab.tmp", b"half")
    again = batch.run(samples, SETTINGS, url, client, evaluate=True)
    assert (again.done, again.reused) == (6, 5)
    assert system.cat_file(f"/runs/{whole}/results.csv") == (done[0] / "results.csv").read_bytes()
    assert not any(path.endswith(".tmp") for path in system.find("/runs"))
    with pytest.raises(ValueError, match="holds a run with something else"):
        batch.run(samples, SETTINGS, url, client)


def test_an_s3_bucket(done: tuple[Path, batch.Report], data: Path, client: Any) -> None:
    """With processes apart it would be the same: workers reach the bucket by themselves."""
    pytest.importorskip("s3fs")
    server = pytest.importorskip("moto.server")
    import s3fs

    bucket = server.ThreadedMotoServer(port=0, verbose=False)
    bucket.start()
    try:
        host, port = bucket.get_host_and_port()
        options = {"endpoint_url": f"http://{host}:{port}", "key": "k", "secret": "s"}
        system = s3fs.S3FileSystem(**options)
        system.mkdir("pairs")
        run = {"settings": SETTINGS, "client": client, "evaluate": True, "storage_options": options}
        samples = st.datasets.open(data)
        assert batch.run(samples, out="s3://pairs/run", **run).done == 6
        system.rm_file("pairs/run/rows/001.json")
        again = batch.run(samples, out="s3://pairs/run", **run)
        assert (again.done, again.reused) == (6, 5)
        system.invalidate_cache()
        assert system.cat_file("pairs/run/results.csv") == (done[0] / "results.csv").read_bytes()
        assert b"secret" not in system.cat_file("pairs/run/run.toml")
    finally:
        bucket.stop()


def test_storage_options_need_a_url(tmp_path: Path, client: Any) -> None:
    with pytest.raises(ValueError, match="storage_options belong to a URL"):
        batch.run([Made("a")], SETTINGS, tmp_path, client, storage_options={"key": "k"})
    assert store.at("file:///a/b") == store.Folder("/a/b")


# What it is called


@given(some.text(some.characters(exclude_categories=["Cs"]), min_size=1, max_size=40))
@example("..")
@example("../../up")
@example("/etc/passwd")
@example("a//b/")
@example("nul")
@example("COM1.txt")
@example(" a\nb\t")
@example("100 %")
@example("raw\udcff bytes")
def test_names_stay_inside_and_can_be_told_apart(name: str) -> None:
    path = names.escaped(name)
    assert names.unescaped(path) == name
    assert all(part.strip(". ") and part not in (".", "..") for part in path.split("/"))
    assert not any(letter in path for letter in '\\:*?"<>|\n\0')
    path.encode()


def test_plain_names_stay_plain() -> None:
    for name in ("000001_10", "a b", "Straße/übung-1", "clean/alley_1/frame_0001", "v1.0"):
        assert names.escaped(name) == name
    assert names.escaped("../a") == "%2E%2E/a"


# What it refuses


@pytest.mark.parametrize(
    ("given_", "error", "message"),
    [
        ({"samples": "kitti2015"}, TypeError, r"stereopsis.datasets.open\('kitti2015'\) gives, not a path"),
        ({"settings": "fast"}, TypeError, "settings must be Settings or None, not str"),
        ({"format": "jpg"}, ValueError, "format must be one of png, pfm"),
        ({"workers": 0}, ValueError, "workers must be a whole number from 1"),
        ({"workers": 10_000}, ValueError, "workers must be a whole number from 1"),
        ({"workers": 1, "scheduler": "tcp://x:1"}, ValueError, "at most one of"),
    ],
)
def test_refuses_what_is_not_allowed(
    given_: dict[str, Any], error: type[Exception], message: str, tmp_path: Path
) -> None:
    with pytest.raises(error, match=message):
        batch.run(**{"samples": [], "out": tmp_path / "out", **given_})
    assert not (tmp_path / "out").exists()


def test_workers_and_threads_never_exceed_the_cores() -> None:
    for cores in (1, 2, 7, 64):
        for threads in (1, 2, 5):
            assert batch._workers(None, threads, cores) * threads <= max(cores, threads)
    assert [batch._workers(None, 2, 8, room) for room in (None, 9, 3, 0)] == [4, 4, 3, 1]
    with pytest.raises(ValueError, match="from 1 to 4 with 2 threads each, not 5"):
        batch._workers(5, 2, 8)


def test_a_task_takes_no_more_threads_than_its_share(tmp_path: Path, client: Any) -> None:
    """A worker of as many threads as cores leaves one to each pair."""
    asked = SETTINGS.changed(threads=64)
    taken = client.submit(lambda: work._limited(asked).threads).result()
    assert taken == max(1, cluster.cores() // 2)
    assert work._limited(SETTINGS.changed(threads=1)).threads == 1


def test_absent_dask_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], data: Path, tmp_path: Path
) -> None:
    monkeypatch.setattr(_extras, "find_spec", lambda name: None)
    assert main(["batch", str(data), "-o", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "pip install 'stereopsis[cluster]'" in told


def test_no_scheduler_is_one_sentence(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "CONNECT", 1.0)
    for address, message in (("tcp://127.0.0.1:9", "nobody answers"), ("what:ever:1", "invalid address")):
        code = main(["batch", str(data), "-o", str(tmp_path / "out"), *OPTIONS, "--scheduler", address])
        told = capsys.readouterr().err
        assert (code, told.count("\n")) == (2, 1)
        assert message in told


def test_no_worker_is_one_sentence(tmp_path: Path) -> None:
    from distributed import Client, LocalCluster

    with (
        LocalCluster(n_workers=0, processes=False, dashboard_address=":0") as empty,
        Client(empty) as nobody,
        pytest.raises(ConnectionError, match="no worker has joined"),
    ):
        cluster.threads_of(nobody, patience=0.2)


# On the command line


def test_command(data: Path, tmp_path: Path, done: tuple[Path, batch.Report]) -> None:
    """Processes of this machine give the same bytes as threads of this process."""
    told = subprocess.run(
        command(data, tmp_path / "out", "--evaluate", "--json", "--workers", "1"),
        capture_output=True,
        text=True,
        check=True,
    )
    assert told.stderr == ""
    report = json.loads(told.stdout)
    assert (report["pairs"], report["done"], report["failures"]) == (6, 6, [])
    assert (tmp_path / "out/results.csv").read_bytes() == (done[0] / "results.csv").read_bytes()


def test_command_says_what_failed(
    data: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    client: Any,
) -> None:
    """With one pair broken the exit code is 3, and 0 when it is mended."""
    folder = dataset(tmp_path / "data", 2)
    whole = (folder / "001-left.png").read_bytes()
    (folder / "001-left.png").write_bytes(whole[:100])
    asked = ["batch", str(folder), "-o", str(tmp_path / "out"), *OPTIONS]
    asked += ["--scheduler", client.scheduler.address]
    assert main(asked) == 3
    told = capsys.readouterr()
    assert "no result: '001'" in told.err
    assert "failed   1" in told.out
    (folder / "001-left.png").write_bytes(whole)
    assert main(asked) == 0
    assert main([*asked, "--set", "median=3"]) == 2
    assert "median none, not 3" in capsys.readouterr().err
    assert main([*asked, "--set", "median=3", "--overwrite", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["reused"] == 0
