"""The command line: what it prints, what it writes, and how it refuses."""

from __future__ import annotations

import dataclasses
import json
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

import stereopsis as st
from stereopsis.cli import main
from stereopsis.settings import DEFAULT_PRESET, Settings

Capture = pytest.CaptureFixture[str]

WIDTH, HEIGHT = 96, 48


@pytest.fixture(scope="module")
def scene() -> st.scenes.Scene:
    return st.scenes.street(WIDTH, HEIGHT, 3)


@pytest.fixture
def folder(scene: st.scenes.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder, made the current one, with a rendered pair and all that belongs to it."""
    st.write_image(tmp_path / "left.png", scene.left)
    st.write_image(tmp_path / "right.png", scene.right)
    st.write_disparity(tmp_path / "truth.pfm", scene.disparity)
    st.io.write_calibration(tmp_path / "calib.txt", scene.calibration)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(capsys: Capture, *arguments: str) -> str:
    """Run a command that has to work; give its standard output."""
    code = main(arguments)
    out, err = capsys.readouterr()
    assert (code, err) == (0, "")
    return out


def report(capsys: Capture, *arguments: str) -> Any:
    """Run with --json: standard output has to be one JSON object and nothing else."""
    return json.loads(run(capsys, *arguments, "--json"), parse_constant=pytest.fail)


def refuse(capsys: Capture, *arguments: str) -> str:
    """Run a command that has to fail in one line; give what it says."""
    code = main(arguments)
    out, err = capsys.readouterr()
    assert (code, out) == (2, "")
    assert err.startswith("stereopsis: error: ")
    assert err.count("\n") == 1
    assert err.endswith("\n")
    return err


class TestHelp:
    def test_everything_is_listed(self, capsys: Capture) -> None:
        out = run(capsys, "--help")
        names = ["match", "evaluate", "info", "demo", "study", "view", "batch", "bench"]
        assert [line.split()[0] for line in out.partition("Commands:\n")[2].splitlines()] == names

    def test_no_command_is_a_question(self, capsys: Capture) -> None:
        assert run(capsys) == run(capsys, "--help")

    @pytest.mark.parametrize("command", ["match", "evaluate", "info", "demo", "study"])
    def test_each_command_has_examples_and_help_for_each_option(self, command: str, capsys: Capture) -> None:
        out = run(capsys, command, "--help")
        assert f"    stereopsis {command}" in out
        options = out.partition("Options:\n")[2].splitlines()
        assert all(len(line.split("  ")) > 1 for line in options)

    def test_version(self, capsys: Capture) -> None:
        assert run(capsys, "--version") == f"stereopsis {st.__version__}\n"

    def test_runs_as_a_module(self) -> None:
        command = [sys.executable, "-m", "stereopsis", "--version"]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        assert done.stdout == f"stereopsis {st.__version__}\n"


class TestMatch:
    def test_json_says_all_and_settings_repeat_the_result(self, folder: Path, capsys: Capture) -> None:
        arguments = ["--disparities", "0:24", "--set", "cost=zncc", "--set", "window=5", "--threads", "2"]
        said = report(capsys, "match", "left.png", "right.png", "-o", "out.pfm", *arguments)
        assert (said["width"], said["height"]) == (WIDTH, HEIGHT)
        assert (said["left"], said["right"], said["outputs"]) == ("left.png", "right.png", ["out.pfm"])
        assert said["settings"]["disparities"] == [0, 24]
        assert said["settings"]["threads"] == 2
        assert said["path"] in ("streaming", "composed")
        assert said["seconds"] >= 0
        assert all(seconds >= 0 for seconds in said["timings"].values())

        settings = Settings.make(assignments=("cost=zncc", "window=5"), disparities=st.Disparities(0, 24))
        expected = st.match(st.read_pair("left.png", "right.png"), settings=settings)
        np.testing.assert_array_equal(st.read_disparity("out.pfm"), expected.disparity)
        assert said["density"] == expected.density
        counts = {flag.name.lower(): int(np.sum((expected.flags & flag) != 0)) for flag in st.Flag}
        assert said["flags"] == counts

    def test_a_support_is_told_as_it_is_written(self, folder: Path, capsys: Capture) -> None:
        words = ["match", "left.png", "right.png", "--disparities", "0:9"]
        words += ["--set", "cost=sad", "--set", "window=gaussian:1.5"]
        assert report(capsys, *words)["settings"]["cost"] == {"name": "sad", "window": "gaussian:1.5,4"}
        assert "sad, window gaussian:1.5,4" in run(capsys, *words)

    def test_each_output_in_the_format_of_its_name(self, folder: Path, capsys: Capture) -> None:
        names = ["a.png", "b.pfm", "c.npy", "d.tif", "preview.png", "f.jpg", "g.ply", "depth.png"]
        outputs = [word for name in names for word in ("-o", name)]
        arguments = ["--calibration", "calib.txt", "--disparities", "0:24", "--set", "cost=sad"]
        said = report(capsys, "match", "left.png", "right.png", *outputs, *arguments)
        assert said["outputs"] == names
        exact = st.read_disparity("b.pfm")
        np.testing.assert_array_equal(st.read_disparity("c.npy"), exact)
        np.testing.assert_array_equal(st.read_disparity("d.tif"), exact)
        np.testing.assert_allclose(st.read_disparity("a.png"), exact, atol=1 / 256)
        kinds = [report(capsys, "info", name)["kind"] for name in names]
        assert kinds == ["disparity"] * 4 + ["image"] * 2 + ["points", "depth"]

    @pytest.mark.parametrize("text", ["-16:8", "-16:-3", "5:6"])
    def test_range_is_half_open_and_may_be_negative(self, text: str, folder: Path, capsys: Capture) -> None:
        said = report(capsys, "match", "left.png", "right.png", "--disparities", text, "--set", "cost=sad")
        assert said["settings"]["disparities"] == [int(end) for end in text.split(":")]

    def test_range_is_estimated_when_none_is_given(self, folder: Path, capsys: Capture) -> None:
        low, high = report(capsys, "match", "left.png", "right.png")["settings"]["disparities"]
        assert low < high

    @pytest.mark.parametrize(
        ("assignments", "preset"),
        [
            ((), DEFAULT_PRESET),
            (("window=9",), DEFAULT_PRESET),
            (("cost=zncc",), None),
            (("cost=sad", "median=3"), None),
        ],
    )
    def test_a_cost_alone_turns_checks_off(
        self, assignments: tuple[str, ...], preset: str | None, folder: Path, capsys: Capture
    ) -> None:
        """The command line starts from what `match` starts from."""
        sets = [word for assignment in assignments for word in ("--set", assignment)]
        said = report(capsys, "match", "left.png", "right.png", "--disparities", "0:24", *sets)
        assert said["settings"]["preset"] == preset

    SETTINGS: ClassVar = {
        "disparities": ("-2:9", [-2, 9]),
        "cost": ("ncc", {"name": "ncc", "window": [21, 21]}),
        "optimize": (
            "icm",
            {"name": "icm", "norm": "l1", "weight": 0.1, "truncation": None, "iterations": 10},
        ),
        "channels": ("separate", "separate"),
        "vertical": ("0.5,0.25,0,1", [0.5, 0.25, 0.0, 1.0]),
        "blank": ("on", True),
        "sharpen": ("0.5", 0.5),
        "slant": ("road", "road"),
        "extra_windows": ("31,41x15", [[31, 31], [41, 15]]),
        "pyramid": ("2", 2),
        "step": ("2", 2),
        "disparity_step": ("3", 3),
        "subpixel": ("equiangular", "equiangular"),
        "refine_window": ("15x5", [15, 5]),
        "upsample": ("2,linear", [2, "linear"]),
        "left_right": ("2", 2.0),
        "uniqueness": ("off", None),
        "texture": ("1.5", 1.5),
        "reflection": ("6", 6.0),
        "sky": ("on", True),
        "median": ("5", 5),
        "speckle": ("50,2", [50, 2.0]),
        "planes": ("segments", "segments"),
        "planar": ("25x13", [25, 13]),
        "fill": ("surfaces", "surfaces"),
        "weighted_median": ("5,12", [5, 12.0]),
        "edge_aware": ("3", [3.0, 5.0]),
        "confidence": ("calibrated", "calibrated"),
        "least_confidence": ("0.5", 0.5),
        "outlines": ("on", True),
        "photometric": ("on", True),
        "threads": ("2", 2),
        "keep": ("texture", ["texture"]),
        "preset": ("fast", "fast"),
    }

    @pytest.mark.parametrize("field", dataclasses.fields(Settings), ids=lambda field: field.name)
    def test_set_reaches_every_setting(
        self, field: dataclasses.Field[Any], folder: Path, capsys: Capture
    ) -> None:
        text, value = self.SETTINGS[field.name]
        # The default preset checks uniqueness, which more columns exclude.
        also = ("--set", "uniqueness=none") if field.name == "upsample" else ()
        also = ("--set", "cost=census") if field.name == "sharpen" else also
        said = report(capsys, "match", "left.png", "right.png", "--set", f"{field.name}={text}", *also)
        assert said["settings"][field.name] == value

    def test_settings_file_then_set(self, folder: Path, capsys: Capture) -> None:
        first = Settings.make(assignments=("cost=ssd", "window=5"), disparities=st.Disparities(0, 20))
        Path("mine.toml").write_text(first.to_toml(), encoding="utf-8")
        same = report(capsys, "match", "left.png", "right.png", "--settings", "mine.toml")["settings"]
        other = report(
            capsys, "match", "left.png", "right.png", "--settings", "mine.toml", "--set", "window=7"
        )
        assert same["disparities"] == [0, 20]
        assert "5" in json.dumps(same["cost"])
        assert other["settings"] != same
        assert "7" in json.dumps(other["settings"]["cost"])

    def test_every_preset_runs(self, folder: Path, capsys: Capture) -> None:
        for preset in report(capsys, "info")["program"]["presets"]:
            said = report(
                capsys, "match", "left.png", "right.png", "--preset", preset, "--disparities", "0:24"
            )
            assert said["density"] > 0

    def test_truth_scores_at_once(self, folder: Path, capsys: Capture) -> None:
        arguments = ["--truth", "truth.pfm", "-o", "out.pfm", "--disparities", "0:24", "--set", "cost=zncc"]
        said = report(capsys, "match", "left.png", "right.png", *arguments)
        alone = report(capsys, "evaluate", "out.pfm", "truth.pfm")
        assert said["scores"] == {name: alone[name] for name in said["scores"]}

    def test_tables_for_people(self, folder: Path, capsys: Capture) -> None:
        arguments = ["--truth", "truth.pfm", "-o", "out.pfm", "--disparities", "0:24"]
        out = run(capsys, "match", "left.png", "right.png", *arguments)
        for word in (f"{WIDTH} x {HEIGHT}", "density", "time", "D1", "EPE", "wrote out.pfm"):
            assert word in out

    def test_without_outputs_nothing_is_written(self, folder: Path, capsys: Capture) -> None:
        before = sorted(folder.iterdir())
        assert "density" in run(capsys, "match", "left.png", "right.png", "--disparities", "0:24")
        assert sorted(folder.iterdir()) == before


class TestRefusals:
    """One line on standard error, exit code 2, and the folder is as it was."""

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            ("-o out.png", ["RIGHT", "match --help"]),
            ("right.png --dispartiies 0:8", ["--dispartiies", "--disparities"]),
            ("right.png --disparities 0-8", ["'0-8'", "MIN:MAX"]),
            ("right.png --disparities 0:8:2", ["'0:8:2'", "MIN:MAX"]),
            ("right.png --disparities 8:8", ["'8:8'", "MAX"]),
            ("right.png --threads many", ["--threads", "many"]),
            ("right.png --threads -1", ["threads", "-1"]),
            ("right.png --set windwo=7", ["windwo", "window"]),
            ("right.png --set cost=zmcc", ["zmcc", "zncc"]),
            ("right.png --set cost=zncc --set window=wide", ["window", "wide"]),
            ("right.png --set cost=zncc --set window=256", ["window", "256"]),
            ("right.png --set cost=zncc --set window=gaus:5", ["window", "gaussian"]),
            ("right.png --set window", ["window"]),
            ("right.png --preset fasst", ["fasst", "fast"]),
            ("right.png --settings nowhere.toml", ["nowhere.toml"]),
            ("right.png --settings right.png", ["right.png"]),
            ("right.png -o out.pgn", ["out.pgn", ".png"]),
            ("right.png -o out", ["out", ".png"]),
            ("right.png -o nowhere/out.png", ["nowhere", "No such"]),
            ("right.png -o left.png", ["left.png"]),
            ("right.png -o out.png -o ./out.png", ["out.png"]),
            ("right.png -o out.ply", ["out.ply", "calibration"]),
            ("right.png --calibration truth.pfm", ["truth.pfm"]),
            ("right.png --truth calib.txt", ["calib.txt"]),
            ("right.png --truth small.pfm", ["small.pfm", "2 x 2", f"{WIDTH} x {HEIGHT}"]),
            ("rihgt.png", ["rihgt.png"]),
            (".", ["'.'"]),
            ("calib.txt", ["calib.txt"]),
            ("small.pfm", ["left.png", "small.pfm", "2 x 2"]),
        ],
    )
    def test_match(self, arguments: str, words: list[str], folder: Path, capsys: Capture) -> None:
        st.write_disparity("small.pfm", np.ones((2, 2), np.float32))
        before = {path: path.read_bytes() for path in folder.iterdir()}
        said = refuse(capsys, "match", "left.png", *arguments.split())
        assert [word for word in words if word not in said] == []
        assert {path: path.read_bytes() for path in folder.iterdir()} == before

    def test_outputs_are_checked_before_matching(
        self, folder: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(st, "match", lambda *_, **__: pytest.fail("matched in vain"))
        refuse(capsys, "match", "left.png", "right.png", "-o", "out.png", "-o", "out.bmp")
        refuse(capsys, "match", "left.png", "right.png", "-o", "nowhere/out.png")
        refuse(capsys, "match", "left.png", "right.png", "--truth", "left.png")

    def test_all_outputs_or_none(self, folder: Path, capsys: Capture) -> None:
        """Right before left: the disparities are negative, which a float file holds and KITTI's does not."""
        Path("good.pfm").write_bytes(b"mine")
        outputs = ["-o", "good.pfm", "-o", "bad.png"]
        said = refuse(capsys, "match", "right.png", "left.png", "--disparities", "-24:-1", *outputs)
        assert "stereopsis: error: bad.png: " in said
        assert Path("good.pfm").read_bytes() == b"mine"
        assert not Path("bad.png").exists()

    def test_an_extra_that_is_missing(
        self, folder: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setitem(sys.modules, "ortools.graph.python", None)
        cuts = ("--set", "cost=zncc", "--set", "optimize=expansion", "--disparities", "0:24")
        assert "'stereopsis[graphcut]'" in refuse(capsys, "match", "left.png", "right.png", *cuts)

    def test_memory(self, folder: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
        def exhausted(*_: object, **__: object) -> None:
            raise MemoryError("could not allocate\n9 EiB")

        monkeypatch.setattr(st, "match", exhausted)
        assert "could not allocate 9 EiB" in refuse(capsys, "match", "left.png", "right.png")

    def test_a_fault_of_the_program_is_not_hidden(
        self, folder: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def broken(*_: object, **__: object) -> None:
            raise RuntimeError("a bug")

        monkeypatch.setattr(st, "match", broken)
        with pytest.raises(RuntimeError, match="a bug"):
            main(["match", "left.png", "right.png"])

    def test_interrupt(self, folder: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
        def interrupted(*_: object, **__: object) -> None:
            raise KeyboardInterrupt

        monkeypatch.setattr(st, "match", interrupted)
        assert main(["match", "left.png", "right.png", "-o", "out.png"]) == 130
        assert capsys.readouterr() == ("", "stereopsis: interrupted\n")
        assert not Path("out.png").exists()

    @pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
    def test_interrupt_ends_a_long_match(self, tmp_path: Path, capsys: Capture) -> None:
        """A match of several minutes, stopped in the middle of its kernel."""
        image, output = str(tmp_path / "noise.png"), tmp_path / "out.pfm"
        st.write_image(image, np.random.default_rng(0).integers(0, 256, (1500, 1500), np.uint8))
        output.write_bytes(b"mine")
        arguments = ["--disparities", "0:1000", "--set", "cost=zsad", "--set", "window=99", "-o", str(output)]
        timer = threading.Timer(0.5, signal.raise_signal, [signal.SIGINT])
        timer.start()
        start = time.perf_counter()
        assert main(["match", image, image, *arguments]) == 130
        assert time.perf_counter() - start < 3
        assert capsys.readouterr() == ("", "stereopsis: interrupted\n")
        assert output.read_bytes() == b"mine"

    @pytest.mark.parametrize("command", [["frobnicate"], ["mtach"], ["--nonsense"], ["demo", "odd"]])
    def test_usage(self, command: list[str], capsys: Capture) -> None:
        assert command[-1] in refuse(capsys, *command)

    @pytest.mark.skipif(sys.platform == "win32", reason="pipes of POSIX")
    @pytest.mark.parametrize("arguments", [["info"], ["info", "--json"], ["--help"]])
    def test_closed_pipe_is_quiet(self, arguments: list[str]) -> None:
        command = [sys.executable, "-m", "stereopsis", *arguments]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            assert process.stdout is not None
            assert process.stderr is not None
            process.stdout.close()
            said = process.stderr.read()
        assert said == b""
        assert process.returncode in (1, 141)


class TestEvaluate:
    @pytest.fixture(autouse=True)
    def maps(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """Errors of 0, 0.5, none (unanswered), 4, and one where nothing is known."""
        monkeypatch.chdir(tmp_path)
        nan = np.nan
        st.write_disparity("truth.pfm", np.array([[10, 20, 30, 40, nan]], np.float32))
        st.write_disparity("found.pfm", np.array([[10, 20.5, nan, 44, 7]], np.float32))

    def test_numbers(self, capsys: Capture) -> None:
        said = report(capsys, "evaluate", "found.pfm", "truth.pfm")
        assert (said["known"], said["answered"], said["density"]) == (4, 3, 0.75)
        assert said["own"]["epe"] == 1.5
        assert said["own"]["within_1"] == 2 / 3
        assert said["all"]["within_1"] == 0.5
        assert said["all"]["epe"] is None
        assert said["filled"]["count"] == 4

    def test_table(self, capsys: Capture) -> None:
        out = run(capsys, "evaluate", "found.pfm", "truth.pfm")
        rows = {line.split()[0]: line.split() for line in out.splitlines()}
        assert rows["own"] == ["own", "all", "filled"]
        assert rows["density"] == ["density", "75.00", "%"]
        assert rows["EPE"][:3] == ["EPE", "1.500", "px"]

    @pytest.mark.parametrize(("white", "values"), [(255, [255, 128, 0, 255, 255]), (1, [1, 0, 0, 1, 1])])
    def test_mask(self, white: int, values: list[int], capsys: Capture) -> None:
        st.write_image("mask.png", np.array([values], np.uint8))
        said = report(capsys, "evaluate", "found.pfm", "truth.pfm", "--mask", "mask.png")
        assert (said["known"], said["answered"], said["own"]["epe"]) == (2, 2, 2.0)

    @pytest.mark.parametrize(
        "mask",
        [np.zeros((1, 4), np.uint8), np.arange(5, dtype=np.uint8)[None], np.zeros((1, 5, 3), np.uint8)],
    )
    def test_mask_refused(self, mask: np.ndarray[Any, Any], capsys: Capture) -> None:
        st.write_image("mask.png", mask)
        assert "mask.png" in refuse(capsys, "evaluate", "found.pfm", "truth.pfm", "--mask", "mask.png")

    def test_error_map(self, capsys: Capture) -> None:
        said = report(capsys, "evaluate", "found.pfm", "truth.pfm", "--error-map", "error.png")
        assert said["error_map"] == "error.png"
        picture = st.read_image("error.png")
        assert picture.shape == (1, 5, 3)
        assert picture[0, 4].tolist() == [0, 0, 0]

    def test_error_map_refused_before_anything_is_read(self, capsys: Capture) -> None:
        Path("found.pfm").write_bytes(b"broken")
        said = refuse(capsys, "evaluate", "found.pfm", "truth.pfm", "--error-map", "nowhere/error.png")
        assert "nowhere" in said
        refuse(capsys, "evaluate", "found.pfm", "truth.pfm", "--error-map", "truth.pfm")

    def test_formats(self, capsys: Capture) -> None:
        st.write_image("truth.png", np.array([[40, 80, 120, 160, 0]], np.uint8))
        assert "8-bit" in refuse(capsys, "evaluate", "found.pfm", "truth.png")
        said = report(capsys, "evaluate", "found.pfm", "truth.png", "--truth-format", "middlebury:4")
        assert (said["known"], said["own"]["epe"]) == (4, 1.5)

    def test_sizes_differ(self, capsys: Capture) -> None:
        st.write_disparity("other.pfm", np.ones((2, 3), np.float32))
        said = refuse(capsys, "evaluate", "found.pfm", "other.pfm")
        assert "5 x 1" in said
        assert "3 x 2" in said


class TestInfo:
    def test_program(self, capsys: Capture) -> None:
        program = report(capsys, "info")["program"]
        assert program["stereopsis"] == st.__version__
        assert program["numpy"] == np.__version__
        assert program["instruction_set"] in program["instruction_sets"]
        assert "fast" in program["presets"]

    def test_disparity(self, tmp_path: Path, capsys: Capture) -> None:
        path = tmp_path / "map.pfm"
        st.write_disparity(path, np.array([[1, 2, 4, np.nan]], np.float32))
        said = report(capsys, "info", str(path))
        assert (said["kind"], said["format"], said["width"], said["height"]) == ("disparity", "pfm", 4, 1)
        assert (said["min"], said["median"], said["max"], said["density"]) == (1, 2, 4, 0.75)
        assert said["program"]["stereopsis"] == st.__version__

    def test_calibration(self, folder: Path, scene: st.scenes.Scene, capsys: Capture) -> None:
        said = report(capsys, "info", "calib.txt")
        assert said["kind"] == "calibration"
        assert said["focal"] == scene.calibration.focal
        assert "baseline" in run(capsys, "info", "calib.txt")

    def test_data_set(self, tmp_path: Path, capsys: Capture) -> None:
        for name in ("left/b.png", "right/b.png", "left/a.png", "right/a.png", "truth/b.png"):
            (tmp_path / name).parent.mkdir(exist_ok=True)
            (tmp_path / name).touch()
        said = report(capsys, "info", str(tmp_path))
        del said["program"]
        assert said == {
            "folder": str(tmp_path),
            "kind": "data set",
            "name": "left and right",
            "pairs": 2,
            "with_truth": 1,
            "with_mask": 0,
            "with_calibration": 0,
            "first": "a",
            "last": "b",
        }
        (tmp_path / "pairs.csv").write_text("left,right\nleft/a.png,right/a.png\n")
        assert report(capsys, "info", str(tmp_path / "pairs.csv"))["pairs"] == 1

    def test_refused(self, tmp_path: Path, capsys: Capture) -> None:
        (tmp_path / "empty.png").touch()
        assert "empty.png" in refuse(capsys, "info", str(tmp_path / "empty.png"))
        assert "KITTI 2012" in refuse(capsys, "info", str(tmp_path))


class TestDemo:
    FILES = (
        "calib.txt",
        "disparity.pfm",
        "disparity.png",
        "error.png",
        "left.png",
        "points.ply",
        "preview.png",
        "right.png",
        "truth.pfm",
    )

    def test_everything_is_written_and_agrees(self, tmp_path: Path, capsys: Capture) -> None:
        folder = tmp_path / "new" / "demo"
        said = report(capsys, "demo", "-o", str(folder), "--size", "160x72", "--seed", "5")
        assert sorted(path.name for path in folder.iterdir()) == sorted(self.FILES)
        assert sorted(said["outputs"]) == sorted(str(path) for path in folder.iterdir())

        found, truth = st.read_disparity(folder / "disparity.pfm"), st.read_disparity(folder / "truth.pfm")
        np.testing.assert_array_equal(truth, st.scenes.street(160, 72, 5).disparity)
        assert said["scores"] == st.evaluate(found, truth).to_dict()
        assert said["scores"]["own"]["within_1"] > 0.5
        np.testing.assert_allclose(st.read_disparity(folder / "disparity.png"), found, atol=1 / 256)
        assert st.read_image(folder / "error.png").shape == (72, 160, 3)

        again = report(
            capsys,
            "match",
            *(str(folder / name) for name in ("left.png", "right.png")),
            "--truth",
            str(folder / "truth.pfm"),
        )
        assert again["scores"] == said["scores"]

    def test_table(self, tmp_path: Path, capsys: Capture) -> None:
        out = run(capsys, "demo", "-o", str(tmp_path), "--size", "96x48", "--set", "cost=sad")
        assert all(word in out for word in ("96 x 48", "density", "EPE", "points.ply"))

    @pytest.mark.parametrize("size", ["96", "96x", "0x48", "96x48x2", "-1x5", "5x5", "1x1"])
    def test_size_refused(self, size: str, tmp_path: Path, capsys: Capture) -> None:
        refuse(capsys, "demo", "-o", str(tmp_path / "demo"), "--size", size)
        assert not (tmp_path / "demo").exists()

    def test_folder_refused(self, tmp_path: Path, capsys: Capture) -> None:
        (tmp_path / "file").touch()
        assert "file" in refuse(capsys, "demo", "-o", str(tmp_path / "file"), "--size", "32x16")
