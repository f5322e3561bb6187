"""The study as a job: what it plans, what it keeps, how it goes on, and what it refuses."""

from __future__ import annotations

import csv
import dataclasses
import itertools
import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stereopsis as st
from stereopsis import _extras, study
from stereopsis.cli import main
from stereopsis.settings import ZNCC, Settings
from stereopsis.study import job, measure, methods, pairs, plan, published, tables
from stereopsis.study.pairs import Known

WIDTH, HEIGHT = 96, 48


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two tiny pairs side by side in a folder."""
    folder = tmp_path_factory.mktemp("data")
    for name, seed in (("a", 1), ("b", 2)):
        save(folder, name, st.scenes.street(WIDTH, HEIGHT, seed, samples=1))
    return folder


def save(folder: Path, name: str, scene: st.scenes.Scene) -> None:
    st.write_image(folder / f"{name}-left.png", scene.left)
    st.write_image(folder / f"{name}-right.png", scene.right)
    st.write_disparity(folder / f"{name}-disparity.png", scene.disparity)


def copied(data: Path, to: Path) -> Path:
    to.mkdir()
    for file in data.iterdir():
        (to / file.name).write_bytes(file.read_bytes())
    return to


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "stereopsis", "study", *map(str, arguments)]


def small(data: Path | None, **changes: Any) -> study.Study:
    given: dict[str, Any] = {"windows": (5, 9), "methods": ("ssd", "zncc"), "parts": ("sweep",)}
    return study.Study(data, **(given | changes))


def measured(asked: study.Study, folder: Path, workers: int = 1) -> job.Outcome:
    """The rows alone, without a page."""
    return job.run(plan.make(asked), folder, workers)


def table(outcome: job.Outcome, path: Path) -> bytes:
    tables.write_results(path, outcome.done)
    return path.read_bytes()


# What it plans


def test_default_plan_covers_the_report(data: Path) -> None:
    tasks = plan.make(study.Study(data)).tasks
    settings = {task.setting.setting for task in tasks if task.source.name == "a"}
    for method, window in itertools.product(("ssd", "zssd", "zncc"), range(5, 95, 10)):
        assert f"{method}-{window}" in settings
        assert f"published: {method}-{window}" in settings
    assert {"published: zncc_smoothed-30", "published: zncc_gaussian-15"} <= settings
    assert {task.source.condition for task in tasks} == {"", *(name for name, _ in pairs.WEATHER)}
    assert len({(t.source.group, t.source.name, t.setting.setting) for t in tasks}) == len(tasks)
    second = [task.setting for task in tasks if task.source.name == "b"]
    assert sum(setting.protocol == "published" for setting in second) == len(published.TABLES)


def test_tables_only_is_two_rows_a_pair(data: Path) -> None:
    tasks = plan.make(study.Study(data, protocol="published", tables_only=True)).tasks
    assert [(t.source.name, t.setting.method, t.setting.window) for t in tasks] == [
        (name, *chosen) for name in ("a", "b") for chosen in published.TABLES.values()
    ]


def test_methods_windows_and_pairs_narrow_the_plan(data: Path) -> None:
    tasks = plan.make(small(data, pairs=1, windows=(5, 31))).tasks
    assert [(t.source.name, t.setting.setting) for t in tasks] == [
        ("a", name) for name in ("ssd-5", "ssd-31", "zncc-5", "zncc-31")
    ]


def test_without_data_streets_are_rendered() -> None:
    planned = plan.make(study.Study(scenes=2, size=(WIDTH, HEIGHT), methods=("zncc",), windows=(5,)))
    assert {t.source.name for t in planned.tasks if t.source.group == "data"} == {"street-0", "street-1"}


def test_layout_of_kitti_is_recognised(tmp_path: Path) -> None:
    scene = st.scenes.street(WIDTH, HEIGHT, 1, samples=1)
    for folder in ("image_2", "image_3", "disp_occ_0", "disp_noc_0"):
        (tmp_path / folder).mkdir()
    st.write_image(tmp_path / "image_2" / "000000_10.png", scene.left)
    st.write_image(tmp_path / "image_3" / "000000_10.png", scene.right)
    seen = np.where(scene.occluded, np.float32(np.nan), scene.disparity)
    st.write_disparity(tmp_path / "disp_occ_0" / "000000_10.png", scene.disparity)
    st.write_disparity(tmp_path / "disp_noc_0" / "000000_10.png", seen)
    outcome = measured(small(tmp_path), tmp_path / "report")
    assert outcome.failed == []
    row = outcome.done[0].row
    assert row["occluded_count"] + row["visible_count"] == row["known"]
    assert row["occluded_count"] > 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"protocol": "printed"}, "protocol must be all or published"),
        ({"tables_only": True}, "needs protocol published"),
        ({"windows": (0,)}, "windows must be whole numbers"),
        ({"windows": (5, 5)}, "windows must differ"),
        ({"methods": ("znc",)}, "did you mean 'zncc'"),
        ({"parts": ("sweeps",)}, "parts knows"),
        ({"pairs": 0}, "pairs must be"),
        ({"disparities": (5, 5)}, "disparities must be"),
        ({"scenes": -1}, "scenes must be"),
        ({"size": (10, 10)}, "size must be"),
    ],
)
def test_refuses_what_is_not_allowed(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        study.Study(**changes)


def test_settings_repeat_the_study(data: Path) -> None:
    asked = small(data, pairs=2, size=(64, 48), disparities="estimate")
    again = study.Study.from_toml(asked.to_toml())
    assert again == dataclasses.replace(asked, data=data.resolve())
    assert study.Study.from_toml(study.Study().to_toml()) == study.Study()
    with pytest.raises(ValueError, match="unknown setting 'windos'"):
        study.Study.from_toml("windos = [5]")
    with pytest.raises(ValueError, match="not TOML"):
        study.Study.from_toml("windows = [")


# What it measures


def test_measures_by_hand() -> None:
    """Four known pixels: errors 0, 0.5, 3 and one hole, which is filled from the farther neighbour, 6."""
    truth = np.array([[6, 10, 10, 12, np.nan]], np.float32)
    found = np.array([[6, 10.5, 13, np.nan, 6]], np.float32)
    image = np.zeros((1, 5), np.uint8)
    known = Known(st.Pair(image, image), truth)
    confidence = np.array([[0.9, 0.8, 0.1, 0, 0.5]], np.float32)
    result = st.Result(found, confidence, np.zeros((1, 5), np.uint8), Settings(), "composed", 0.0)
    row = measure.measure(result, known, measure.strata(known))
    assert row["within_0.25"] == 0.25
    assert row["within_0.5"] == 0.25
    assert row["within_1"] == row["within_2"] == 0.5
    assert row["within_4"] == 0.75
    assert row["rmse"] == math.sqrt((0.25 + 9 + 36) / 4)
    assert (row["known"], row["density"], row["own_within_1"]) == (4, 0.75, 2 / 3)
    assert row["own_rmse"] == math.sqrt(9.25 / 3)
    assert (row["distance_0_8_count"], row["distance_8_16_count"]) == (1, 3)
    assert row["distance_8_16_rmse"] == math.sqrt((0.25 + 9 + 36) / 3)
    assert row["texture_0_1_count"] == 4
    assert row["edge_count"] == 4  # 6 … 12 on one row
    # Kept in the order of confidence: 3 of 4 pixels are answered, so the curve does not begin at all of them.
    assert "sparse_0.9" not in row
    assert row["sparse_0.75"] == row["ideal_0.75"] == math.sqrt(9.25 / 3)
    assert row["sparse_0.5"] == math.sqrt(0.25 / 2)
    assert row["sparse_0.25"] == 0
    assert (row["fractional_0"], row["fractional_5"]) == (2 / 3, 1 / 3)
    assert row["phase_bias_0"] == 0.25
    assert set(row) <= set(measure.COLUMNS)


def test_an_empty_row_is_filled_from_beside_it() -> None:
    truth = np.array([[4, 4], [4, 4], [4, 4]], np.float32)
    found = np.array([[4, 4], [np.nan, np.nan], [6, 6]], np.float32)
    image = np.zeros(truth.shape, np.uint8)
    known = Known(st.Pair(image, image), truth)
    zero = np.zeros_like(found)
    result = st.Result(found, zero, np.zeros(truth.shape, np.uint8), Settings(), "composed", 0.0)
    row = measure.measure(result, known, measure.strata(known))
    assert (row["rmse"], row["within_1"]) == (math.sqrt(8 / 6), 4 / 6)
    nothing = st.Result(zero * np.nan, zero, np.zeros(truth.shape, np.uint8), Settings(), "composed", 0.0)
    row = measure.measure(nothing, known, measure.strata(known))
    assert (row["rmse"], row["within_4"], row["density"]) == (math.inf, 0, 0)
    assert tables.Stat.of([1.0, math.inf]).mean == math.inf
    assert tables.number(math.inf, "rmse") == "\N{INFINITY}"


def test_sky_is_measured_as_infinitely_far() -> None:
    scene = st.scenes.street(WIDTH, HEIGHT, 1, samples=1)
    known = pairs.ScenePair(1, (WIDTH, HEIGHT)).load()
    zero = np.zeros_like(scene.disparity)
    flags = np.zeros(zero.shape, np.uint8)
    result = st.Result(zero, zero, flags, Settings(), "composed", 0.0)
    row = measure.measure(result, known, measure.strata(known))
    assert row["sky_count"] == scene.sky.sum() > 0
    assert (row["sky_within_0.25"], row["sky_rmse"], row["sky_answered"]) == (1, 0, 1)
    assert row["visible_count"] + row["occluded_count"] == row["known"]


def test_flags_are_compared_with_what_each_view_sees() -> None:
    """Six pixels: visible, hidden, hidden, sky, sky, unknown."""
    truth = np.array([[5, 5, 5, np.nan, np.nan, np.nan]], np.float32)
    visible = np.array([[True, False, False, False, False, False]])
    sky = np.array([[False, False, False, True, True, False]])
    known = Known(st.Pair(np.zeros((1, 6), np.uint8), np.zeros((1, 6), np.uint8)), truth, visible, sky)
    flags = np.array([[1, 1, 4, 16, 0, 16]], np.uint8)
    found = np.where(flags > 0, np.float32(np.nan), np.float32(5))
    result = st.Result(found, np.zeros_like(found), flags, Settings(), "composed", 0.0)
    row = measure.measure(result, known, measure.strata(known))
    assert (row["found_occluded_precision"], row["found_occluded_recall"]) == (0.5, 0.5)
    assert (row["found_sky_precision"], row["found_sky_recall"]) == (1, 0.5)
    assert (row["found_invalid_precision"], row["found_invalid_recall"]) == (0.75, 0.75)


def test_texture_is_the_mean_gradient() -> None:
    ramp = np.tile(np.arange(0, 60, 3, dtype=np.uint8), (12, 1))
    known = Known(st.Pair(ramp, ramp), np.ones(ramp.shape, np.float32))
    np.testing.assert_allclose(measure.texture(known), 3, rtol=1e-12)


def test_rows_are_those_of_the_library(data: Path, tmp_path: Path) -> None:
    """The corrected study is `match` and `evaluate`, nothing else."""
    outcome = measured(small(data, pairs=1), tmp_path)
    (row,) = (item.row for item in outcome.done if item.task.setting.setting == "zncc-9")
    pair = st.read_pair(data / "a-left.png", data / "a-right.png")
    found = st.match(pair, cost=ZNCC(9), disparities=(0, 128)).disparity
    scores = st.evaluate(found, st.read_disparity(data / "a-disparity.png"))
    assert row["rmse"] == scores.filled.rmse
    assert row["within_0.25"] == scores.filled.within_0_25


def test_every_method_runs(tmp_path: Path) -> None:
    """Also at a window larger than the image is high."""
    asked = study.Study(scenes=1, size=(64, 40), windows=(5,), parts=methods.PARTS)
    outcome = measured(asked, tmp_path)
    assert outcome.failed == []
    assert {item.task.setting.method for item in outcome.done} == {m.name for m in methods.METHODS}


def test_intervals_are_those_of_resampled_pairs() -> None:
    stat = tables.Stat.of([1.0, 2.0, 3.0, math.nan])
    assert (stat.mean, stat.count) == (2.0, 3)
    assert 1 <= stat.low < 2 < stat.high <= 3
    assert stat == tables.Stat.of([1.0, 2.0, 3.0])
    assert tables.Stat.of([]).count == 0


# What it keeps


def test_results_read_back_to_the_same_bits(data: Path, tmp_path: Path) -> None:
    outcome = measured(small(data), tmp_path / "report")
    tables.write_results(tmp_path / "results.csv", outcome.done)
    with (tmp_path / "results.csv").open() as file:
        read = list(csv.DictReader(file))
    assert [(row["pair"], row["setting"]) for row in read] == [
        (name, setting)
        for name in ("a", "b")
        for setting in ("ssd-5", "ssd-9", "zncc-5", "zncc-9", "ssd-31", "zncc-31")
    ]
    for line, item in zip(read, outcome.done, strict=True):
        for column in measure.COLUMNS:
            assert line[column] == "" if column not in item.row else float(line[column]) == item.row[column]
    pytest.importorskip("pyarrow")
    assert tables.write_parquet(tmp_path / "results.parquet", outcome.done)
    from pyarrow import parquet

    whole = parquet.read_table(tmp_path / "results.parquet").to_pylist()
    assert [row["rmse"] for row in whole] == [item.row["rmse"] for item in outcome.done]


def test_second_run_measures_nothing(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = measured(small(data), tmp_path)
    monkeypatch.setattr(job, "match", pytest.fail)
    second = measured(small(data), tmp_path)
    assert all(item.reused for item in second.done)
    assert [item.row for item in second.done] == [item.row for item in first.done]


def test_torn_line_is_dropped(data: Path, tmp_path: Path) -> None:
    first = table(measured(small(data), tmp_path), tmp_path / "first.csv")
    journal = tmp_path / job.JOURNAL
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(lines[:3]) + lines[3][: len(lines[3]) // 2])
    outcome = measured(small(data), tmp_path)
    assert sum(item.reused for item in outcome.done) == 3
    assert table(outcome, tmp_path / "second.csv") == first
    assert all(json.loads(line) for line in journal.read_bytes().splitlines())


def test_damaged_lines_are_measured_again(data: Path, tmp_path: Path) -> None:
    first = table(measured(small(data), tmp_path), tmp_path / "first.csv")
    journal = tmp_path / job.JOURNAL
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b'{"key": 3}\nnonsense\n\xff\n[]\n' + b"".join(lines[1:]))
    outcome = measured(small(data), tmp_path)
    assert sum(not item.reused for item in outcome.done) == 1
    assert table(outcome, tmp_path / "second.csv") == first


def test_changed_file_is_measured_again(data: Path, tmp_path: Path) -> None:
    folder = copied(data, tmp_path / "data")
    before = measured(small(folder), tmp_path)
    for view in ("left", "right", "disparity"):
        file = folder / f"a-{view}.png"
        if view == "disparity":
            st.write_disparity(file, st.read_disparity(file) + 1)
        else:
            image = st.read_image(file)
            image[::7] = 0
            st.write_image(file, image)
        after = measured(small(folder), tmp_path)
        assert {item.task.source.name for item in after.done if not item.reused} == {"a"}
        assert after.done[0].row != before.done[0].row
        assert after.done[-1].row == before.done[-1].row
        before = after


def test_changed_setting_or_program_is_measured_again(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured(small(data, pairs=1), tmp_path)
    changed = tuple(
        dataclasses.replace(method, settings=lambda w: Settings(cost=ZNCC(w), subpixel=None))
        if method.name == "zncc"
        else method
        for method in methods.METHODS
    )
    with monkeypatch.context() as patch:
        patch.setattr(methods, "METHODS", changed)
        again = measured(small(data, pairs=1), tmp_path)
        assert {item.task.setting.method for item in again.done if not item.reused} == {"zncc"}
    monkeypatch.setattr(job, "program", lambda: "another")
    assert not any(item.reused for item in measured(small(data, pairs=1), tmp_path).done)


def test_program_is_its_code_and_versions(monkeypatch: pytest.MonkeyPatch) -> None:
    package = Path(job.__file__).parents[1]
    assert all((package / name).is_file() for name in job.ASIDE)
    job.program.cache_clear()
    before = job.program()
    real = Path.read_bytes
    for changed, same in (("cost.py", False), ("study/measure.py", False), ("study/page.py", True)):
        job.program.cache_clear()
        with monkeypatch.context() as patch:
            edited = package / changed
            patch.setattr(Path, "read_bytes", lambda self, e=edited: real(self) + b"#" * (self == e))
            assert (job.program() == before) is same
    job.program.cache_clear()


def test_equal_settings_are_measured_once(data: Path, tmp_path: Path) -> None:
    """ZNCC 31 stands in several tables."""
    asked = study.Study(data, pairs=1, parts=("subpixel", "supports", "checks"))
    outcome = measured(asked, tmp_path)
    names = ("zncc-parabola-31", "zncc-box-31", "checks-none-31")
    same = [item.row for item in outcome.done if item.task.setting.setting in names]
    assert len(same) == 3
    assert same[0] == same[1] == same[2]
    assert len((tmp_path / job.JOURNAL).read_text().splitlines()) == len(outcome.done) - 2


# What fails


@pytest.mark.parametrize("workers", [1, 2])
def test_unreadable_pairs_do_not_stop_the_rest(data: Path, tmp_path: Path, workers: int) -> None:
    folder = copied(data, tmp_path / "data")
    (folder / "a-right.png").write_bytes(b"no image")
    for missing in ("right", "disparity"):
        scene = st.scenes.plane(32, 32)
        save(folder, f"no-{missing}", scene)
        (folder / f"no-{missing}-{missing}.png").unlink()
    save(folder, "size", st.scenes.plane(32, 32))
    st.write_disparity(folder / "size-disparity.png", np.ones((8, 8), np.float32))
    outcome = measured(small(folder), tmp_path, workers)
    assert {item.task.source.name for item in outcome.done} == {"b"}
    reasons = {failed.pair: failed.reason for failed in outcome.failed}
    assert len(outcome.failed) == len(reasons) == 4
    assert "a-right.png" in reasons["a"]
    assert "no-right-right.png" in reasons["no-right"]
    assert "no-disparity-disparity.png" in reasons["no-disparity"]
    assert "(8, 8)" in reasons["size"]


def test_setting_that_fails_is_reported_alone(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = job.match

    def fails(pair: Any, settings: Settings) -> Any:
        if isinstance(settings.cost, st.SSD):
            raise RuntimeError("it broke")
        return real(pair, settings=settings)

    monkeypatch.setattr(job, "match", fails)
    outcome = measured(small(data, pairs=1), tmp_path)
    assert {item.task.setting.method for item in outcome.done} == {"zncc"}
    assert {(failed.setting, failed.reason) for failed in outcome.failed} >= {("ssd-5", "it broke")}


def test_refuses_a_folder_without_pairs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", str(tmp_path), "-o", str(tmp_path / "report")]) == 2
    assert "no benchmark" in capsys.readouterr().err


def test_missing_extra_is_named(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(_extras, "find_spec", lambda name: None if name == "matplotlib" else True)
    assert main(["study", str(data), "-o", str(tmp_path / "report")]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "matplotlib" in err
    assert "stereopsis[study]" in err
    assert not (tmp_path / "report").exists()


# As a long job, for real: other processes, killed in the middle


def test_killed_and_interrupted_it_goes_on_to_the_same_bytes(data: Path, tmp_path: Path) -> None:
    whole = measured(small(data, windows=tuple(range(3, 83, 2)), methods=("zncc",)), tmp_path / "whole")
    expected = table(whole, tmp_path / "whole.csv")
    folder = tmp_path / "report"
    journal = folder / job.JOURNAL
    windows = ["--windows", "3:83:2", "--methods", "zncc", "--parts", "sweep"]

    def started(*more: str) -> subprocess.Popen[str]:
        # Slowed down, so that there is a middle.
        code = (
            "import sys, time\nfrom stereopsis import cli\nfrom stereopsis.study import job\n"
            "append = job.Journal.append\n"
            "def slow(*a):\n    append(*a)\n    time.sleep(0.05)\njob.Journal.append = slow\n"
            "if __name__ == '__main__':\n    sys.exit(cli.main(sys.argv[1:]))\n"
        )
        (tmp_path / "slow.py").write_text(code)
        arguments = [
            sys.executable,
            str(tmp_path / "slow.py"),
            "study",
            str(data),
            "-o",
            str(folder),
            *windows,
            *more,
        ]
        return subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True)

    def wait_for(lines: int, process: subprocess.Popen[str]) -> None:
        while not journal.exists() or journal.read_bytes().count(b"\n") < lines:
            assert process.poll() is None, process.stderr and process.stderr.read()
            time.sleep(0.01)

    killed = started("--workers", "2")
    wait_for(5, killed)
    killed.kill()
    killed.communicate()
    kept = journal.read_bytes().count(b"\n")
    assert 5 <= kept < len(whole.done)

    interrupted = started()
    wait_for(kept + 5, interrupted)
    interrupted.send_signal(signal.SIGINT)
    _, err = interrupted.communicate(timeout=20)
    assert interrupted.returncode == 130
    assert "the same command goes on" in err
    kept = journal.read_bytes().count(b"\n")
    assert kept < len(whole.done)

    done = subprocess.run(
        command(data, "-o", folder, *windows, "--workers", "2", "--json"), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["reused"] == kept
    assert (folder / "results.csv").read_bytes() == expected


def test_workers_die_with_their_parent(data: Path, tmp_path: Path) -> None:
    folder = tmp_path / "report"
    process = subprocess.Popen(
        command(
            data,
            "-o",
            folder,
            "--windows",
            "3:255:1",
            "--methods",
            "zncc",
            "--parts",
            "sweep",
            "--workers",
            "2",
        )
    )
    while not (folder / job.JOURNAL).exists() or not (folder / job.JOURNAL).stat().st_size:
        assert process.poll() is None
        time.sleep(0.01)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    if not children.exists():
        process.kill()
        process.wait()
        pytest.skip("children are only listed under Linux")
    workers = [int(text) for text in children.read_text().split()]
    assert len(workers) >= 2
    process.kill()
    process.wait()
    end = time.monotonic() + 10
    while alive := [worker for worker in workers if _runs(worker)]:
        assert time.monotonic() < end, alive
        time.sleep(0.05)


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False


def test_dead_worker_costs_its_row_alone(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that ends by itself, as one out of memory does, is replaced."""
    real = job._start

    def start(threads: int) -> Any:
        ours, process = real(threads)
        if not started:
            process.kill()
        started.append(process)
        return ours, process

    started: list[Any] = []
    monkeypatch.setattr(job, "_start", start)
    outcome = measured(small(data), tmp_path, workers=2)
    assert len(outcome.failed) == 1
    assert "ended with code" in outcome.failed[0].reason
    total = len(plan.make(small(data)).tasks)
    assert len(outcome.done) == total - 1


@pytest.mark.parametrize("workers", [0, 1.5, "2"])
def test_refuses_workers(data: Path, tmp_path: Path, workers: Any) -> None:
    with pytest.raises(ValueError, match="workers must be"):
        study.run(small(data), tmp_path, workers=workers)
