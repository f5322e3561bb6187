"""The tables of accuracy and speed, and OpenCV's matchers in them."""

import csv
import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import stereopsis as st
from stereopsis import _extras, datasets
from stereopsis.bench import accuracy, methods, opencv, speed
from stereopsis.bench.methods import Method
from stereopsis.cli import INCOMPLETE, main
from stereopsis.types import Disparities

N = np.nan
DATA = Path(os.environ.get("STEREOPSIS_DATA") or Path(__file__).parents[2] / "shared" / "data")
RANGE = Disparities(0, 24)
Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two rendered walls, as a flat data set."""
    folder = tmp_path_factory.mktemp("walls")
    for name, disparity in (("a", 6.0), ("b", 9.5)):
        scene = st.scenes.plane(96, 48, seed=3, disparity=disparity, gray=True)
        st.write_image(folder / f"{name}-left.png", scene.left)
        st.write_image(folder / f"{name}-right.png", scene.right)
        st.write_disparity(folder / f"{name}-disparity.png", scene.disparity)
    return folder


@pytest.fixture
def broken(folder, tmp_path):
    """The same, the second pair's truth being no picture."""
    for file in folder.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    (tmp_path / "b-disparity.png").write_bytes(b"no picture")
    return tmp_path


def constant(value):
    def match(pair, _, __):
        disparity = np.full(pair.left.shape[:2], value, np.float32)
        return disparity, disparity

    return Method(f"always {value}", match)


# ---- accuracy ------------------------------------------------------------------------------------


def test_every_pixel_is_answered():
    map = np.array([[N, N], [4, N], [N, N], [N, N], [N, N], [N, 7], [N, N]], np.float32)
    np.testing.assert_array_equal(accuracy.answered(map)[:, 0], [4, 4, 4, 4, 7, 7, 7])
    np.testing.assert_array_equal(map[0], [N, N])
    nothing = np.full((3, 2), N, np.float32)
    np.testing.assert_array_equal(accuracy.answered(nothing), nothing)


def test_scores_by_hand():
    truth = np.array([[10, 10, 10, 10, N]], np.float32)
    row = accuracy.score(np.array([[10.5, 10.8, N, 15, 99]], np.float32), truth)
    # The hole takes the farther neighbour, 10.8: within 1 px, not within 3/4.
    assert row.within_0_75 == 0.25
    columns = {name: value(row) for name, _, value in accuracy.COLUMNS if name != "s/pair"}
    assert columns["< 1 px"] == 0.75
    assert columns["D1"] == columns["bad-2.0"] == 0.25
    assert columns["RMSE"] == pytest.approx(math.sqrt((0.25 + 2 * 0.64 + 25) / 4))
    assert (columns["density"], columns["own D1"], columns["own < 1 px"]) == (0.75, 1 / 3, 2 / 3)
    masked = accuracy.score(np.zeros((1, 5), np.float32), truth, np.zeros((1, 5), bool))
    assert math.isnan(masked.within_0_75)


def test_means_over_pairs(folder):
    found = [datasets.open(folder)]
    report = accuracy.measure(found, [constant(6.0), constant(9.0)], RANGE)
    assert not report.failures
    assert [(row.pair, row.method) for row in report.rows] == [
        (pair, name) for pair in "ab" for name in ("always 6.0", "always 9.0")
    ]
    groups = accuracy.by_method(report.rows)
    assert accuracy.means(groups["DrivingStereo", "always 6.0"])["RMSE"] == pytest.approx(1.75)
    assert accuracy.means(groups["DrivingStereo", "always 9.0"])["< 1 px"] == 0.5
    assert accuracy.means(groups["DrivingStereo", "always 9.0"])["< 3/4 px"] == 0.5
    only = accuracy.measure(found, [constant(6.0)], RANGE, pairs=1)
    assert [row.pair for row in only.rows] == ["a"]


def test_the_table(folder):
    both = [constant(6.0), constant(9.0)]
    lines = accuracy.tables(accuracy.measure([datasets.open(folder)], both, RANGE), both).splitlines()
    assert lines[0].startswith(
        "| DrivingStereo, 2 pairs | D1 | < 1 px | < 3/4 px | bad-2.0 | RMSE | density |"
    )
    assert lines[2].startswith("| always 6.0 | 50.00% | 50.0% | 50.0% | 50.00% | 1.75 | 1.000 | 50.00% |")
    assert len({line.count("|") for line in lines}) == 1


def test_what_a_preset_filled_is_not_its_own():
    scene = st.scenes.street(200, 100, noise=2)
    (method,) = methods.presets(["balanced"])
    disparity, own = method.match(st.Pair(scene.left, scene.right), Disparities(0, 32), 1)
    assert np.isfinite(disparity).all()
    assert 0.5 < np.isfinite(own).mean() < 1
    row = accuracy.score(disparity, scene.disparity, own=own)
    assert row.own.density < 1
    assert row.whole.density == 1


def test_what_fails_is_told_and_the_rest_goes_on(broken):
    def moody(pair, _, __):
        raise ValueError("not today")

    found = [datasets.open(broken)]
    bad = Method("moody", moody)
    told = []
    report = accuracy.measure(found, [constant(6.0), bad], RANGE, progress=lambda *a: told.append(a[:2]))
    assert [(row.pair, row.method) for row in report.rows] == [("a", "always 6.0")]
    assert [(failure.pair, failure.method) for failure in report.failures] == [("a", "moody"), ("b", None)]
    assert report.failures[0].reason == "not today"
    assert told == [(1, 4), (2, 4)]
    table = accuracy.tables(report, [constant(6.0), bad])
    assert "1 pair |" in table
    assert "| moody (0 pairs) |  |" in table


def test_a_range_from_the_calibration(folder):
    report = accuracy.measure([datasets.open(folder)], [constant(6.0)], "calibration")
    assert [failure.reason for failure in report.failures] == 2 * [
        "there is no calibration that bounds the disparities"
    ]


def test_presets_and_plain_settings():
    every = methods.presets()
    assert [method.name for method in every] == [name for name in st.PRESETS if not name.startswith("paper-")]
    chosen = methods.presets(["none", "fast"], ["window=9", "median=none"])
    assert [method.name for method in chosen] == ["window=9, median=none", "fast, window=9, median=none"]
    assert chosen[0].settings == st.Settings(cost=st.ZNCC(9))
    assert chosen[1].settings.left_right == 1
    with pytest.raises(ValueError, match="did you mean 'fast'"):
        methods.presets(["fats"])


# ---- the commands --------------------------------------------------------------------------------


def test_accuracy_of_a_table_of_paths(broken, capsys: Capture):
    file = broken / "pairs.csv"
    file.write_text("left,right,truth\na-left.png,a-right.png,a-disparity.png\n")
    words = ["bench", "accuracy", str(file), "--presets", "fast", "--no-opencv", "--disparities", "0:24"]
    assert main(words) == 0
    assert capsys.readouterr().out.startswith("| table, 1 pair |")


def test_accuracy_on_the_command_line(folder, tmp_path, capsys: Capture):
    file = tmp_path / "pairs.csv"
    words = [
        "bench",
        "accuracy",
        str(folder),
        "--presets",
        "fast,none",
        "--no-opencv",
        "--disparities",
        "0:24",
    ]
    assert main([*words, "--csv", str(file)]) == 0
    out, err = capsys.readouterr()
    assert [line.split("|")[1].strip() for line in out.splitlines()] == [
        *("DrivingStereo, 2 pairs", "---", "fast", "plain settings")
    ]
    assert err == f"wrote {file}\n"
    with file.open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["pair"], row["method"]) for row in rows] == [
        *(("a", "fast"), ("a", "plain settings"), ("b", "fast"), ("b", "plain settings"))
    ]
    assert all(float(row["< 1 px"]) > 0.8 and float(row["density"]) <= 1 for row in rows)

    assert main([*words, "--json", "--pairs", "1"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [mean["pairs"] for mean in told["means"]] == [1, 1]
    assert told["methods"][0]["settings"]["left_right"] == 1
    assert told["pairs"][0]["scores"]["known"] > 0


def test_a_broken_pair_on_the_command_line(broken, capsys: Capture):
    code = main(
        ["bench", "accuracy", str(broken), "--presets", "fast", "--no-opencv", "--disparities", "0:24"]
    )
    out, err = capsys.readouterr()
    assert code == INCOMPLETE
    assert "| fast |" in out
    assert err.startswith("stereopsis: not measured: DrivingStereo, b: ")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["accuracy", "."], "holds no benchmark"),
        (["accuracy", ".", "--presets", "fats"], "did you mean 'fast'"),
        (["accuracy", ".", "--disparities", "9:3"], "holds no disparity"),
        (["accuracy"], "Missing argument"),
        (["speed", "--repeats", "0"], "not in the range"),
        (["speed", "--csv", "/nowhere/at/all.csv"], "/nowhere/at: No such file or directory"),
        (["speed", "--csv", "/"], "/: Is a directory"),
    ],
)
def test_refusals(words, message, tmp_path, monkeypatch, capsys: Capture):
    monkeypatch.chdir(tmp_path)
    assert main(["bench", *words]) == 2
    assert message in capsys.readouterr().err


def test_help(capsys: Capture):
    assert main(["bench"]) == 0
    listed = capsys.readouterr().out.partition("Commands:\n")[2]
    assert [line.split()[0] for line in listed.splitlines()] == ["accuracy", "speed"]
    for command in ("accuracy", "speed"):
        assert main(["bench", command, "--help"]) == 0
        assert f"    stereopsis bench {command}" in capsys.readouterr().out


def test_speed_on_the_command_line(folder, tmp_path, capsys: Capture):
    left, right = str(folder / "a-left.png"), str(folder / "a-right.png")
    file = tmp_path / "speed.csv"
    words = ["bench", "speed", left, right, "--presets", "fast", "--no-opencv", "--disparities", "0:24"]
    assert main([*words, "--repeats", "2", "--csv", str(file)]) == 0
    out = capsys.readouterr().out
    assert "96 x 48, disparities 0:24, 2 rounds" in out
    assert "| method, 1 thread | ms | 2 threads ÷ 1 |" in out
    assert "fast, ms a stage: read " in out
    assert file.read_text(encoding="utf-8").startswith(
        "method,what,median,low quartile,high quartile\nfast,seconds,"
    )
    assert main([*words, "--repeats", "1", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["methods"][0]["seconds"]["median"] > 0
    assert main(["bench", "speed", left]) == 2
    assert "RIGHT is missing" in capsys.readouterr().err


def test_turns_and_ratios():
    order = []
    times = speed.in_turns([lambda: order.append("a"), lambda: order.append("b")], 2)
    assert order == list("ababab")
    assert [len(each) for each in times] == [2, 2]
    assert speed.ratios([2, 3, 8], [1, 1, 2]) == speed.Spread(3, 2.5, 3.5)


# ---- OpenCV --------------------------------------------------------------------------------------


def test_without_opencv_the_extra_is_named(folder, monkeypatch, capsys: Capture):
    monkeypatch.setattr(_extras, "find_spec", lambda name: None)
    assert main(["bench", "accuracy", str(folder)]) == 2
    assert "'stereopsis[bench]'" in capsys.readouterr().err


def test_only_comparing_loads_opencv():
    code = (
        "import sys, stereopsis.bench.accuracy, stereopsis.bench.speed, stereopsis.cli;"
        "sys.exit('cv2' in sys.modules or 'scipy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("peer", opencv.PEERS, ids=lambda peer: peer.name)
@pytest.mark.parametrize("least", [0, -24])
def test_a_known_wall(peer, least):
    pytest.importorskip("cv2")
    scene = st.scenes.plane(160, 64, seed=1, disparity=8.0 if least == 0 else -8.0, gray=True)
    found = opencv.match(scene.pair, peer, Disparities(least, least + 30))
    assert found.dtype == np.float32
    errors = np.abs(found - scene.disparity)
    assert np.nanmedian(errors) < 0.1
    # No border is lost: what is in view is answered from the first column to the last.
    seen = ~scene.out_of_view
    answered = np.isfinite(found)[20:-20]
    first, last = np.flatnonzero(seen[30])[[0, -1]]
    assert answered[:, first + 12 : first + 20].mean() > 0.7
    assert answered[:, last - 19 : last - 11].mean() > 0.7


def test_wide_pixels_and_colour():
    pytest.importorskip("cv2")
    peer = opencv.THREE_WAYS
    colour = st.scenes.plane(120, 40, seed=1)
    words = st.scenes.plane(120, 40, seed=1, dtype=np.uint16, gray=True)
    for scene in (colour, words):
        assert np.nanmedian(np.abs(opencv.match(scene.pair, peer, RANGE) - scene.disparity)) < 0.2


def test_what_opencv_complains_of():
    pytest.importorskip("cv2")
    small = st.Pair(np.zeros((4, 4), np.uint8), np.zeros((4, 4), np.uint8))
    with pytest.raises(ValueError, match="OpenCV"):
        opencv.match(small, opencv.BLOCK, Disparities(0, 16))


def test_the_check_needs_both_to_agree():
    left = np.array([[2, 1, 1, 5]], np.float32)
    right = np.array([[1, 2.5, 0, N]], np.float32)
    # Column 0 leads out of the image, 1 and 2 to what agrees or not, 3 to column -2.
    np.testing.assert_array_equal(opencv._agree(left, right), [[False, True, False, False]])


def test_threads_are_given_back():
    cv2 = pytest.importorskip("cv2")
    before = cv2.getNumThreads()
    with opencv.threads(1):
        assert cv2.getNumThreads() == 1
    assert cv2.getNumThreads() == before


@pytest.mark.skipif(not (DATA / "kitti2015").is_dir(), reason="the data are not here")
def test_a_known_figure():
    """StereoSGBM 3WAY block 5 with these settings has D1 7.68 % on all 20 pairs."""
    pytest.importorskip("cv2")
    peer = [method for method in methods.peers() if method.name == opencv.THREE_WAYS.name]
    report = accuracy.measure([datasets.open(DATA / "kitti2015")], peer, Disparities(0, 128), pairs=2)
    assert accuracy.means(report.rows)["D1"] == pytest.approx(0.0821, abs=0.003)
