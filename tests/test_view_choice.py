"""Settings to and from the page, and the command, the Python and the TOML that repeat a result."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stereopsis as st
from stereopsis import cli
from stereopsis.view import choice

WINDOWED = ("sad", "ssd", "zsad", "zssd", "ncc", "zncc")

GIVEN: dict[str, dict[str, Any]] = {
    "nothing": {},
    "range": {"disparities": [-3, 12]},
    "plain": {"preset": None},
    "cost alone": {"cost": {"name": "ssd", "window": 7}},
    "cost by name": {"preset": "fast", "cost": "ssd", "window": [9, 5]},
    "even window": {"cost": {"name": "ncc", "window": [8, 6]}, "subpixel": None},
    "census": {"cost": {"name": "census", "window": [7, 5], "pattern": "sparse", "aggregation": [5, 3]}},
    "rank": {"preset": None, "cost": {"name": "rank"}},
    "combined": {
        "cost": {
            "name": "combined",
            "a": {"name": "census", "window": 5},
            "weight_a": 0.25,
            "b": {"name": "gradient", "window": [3, 5], "truncation": 30},
            "weight_b": 1,
        }
    },
    "gaussian": {"cost": {"name": "zncc", "window": "gaussian:2"}},
    "bilateral": {"cost": {"name": "sad", "window": "bilateral:5,3,20"}},
    "checks": {
        "preset": "fast",
        "left_right": None,
        "uniqueness": 7.5,
        "texture": "auto",
        "sky": True,
        "median": 5,
        "speckle": [30, 0.5],
        "reflection": 3,
    },
    "no checks": {"preset": "fast", "median": None, "speckle": None, "texture": None, "vertical": None},
    "vertical": {"preset": "fast", "vertical": [0.5, 0, -0.25]},
    "filled": {"preset": "fast", "fill": "background", "weighted_median": [5, 8], "edge_aware": [50, 4]},
    "balanced": {"preset": "balanced"},
    "accurate": {"preset": "accurate", "least_confidence": None, "planar": 31},
    "less smoothed": {"preset": "balanced", "optimize": {"name": "sgm", "paths": 8, "p1": 60}},
    "not smoothed": {"preset": "balanced", "optimize": None, "slant": None},
    "smoothed": {"cost": "ssd", "window": 5, "optimize": "icm", "smoothness_weight": 2},
    "second pass": {"preset": "paper-smoothed", "window": 9},
    "slanted": {"preset": "local", "extra_windows": [[21, 21], [31, 9]]},
    "refined": {"cost": "zncc", "window": 9, "subpixel": "lucas-kanade", "refine_window": [11, 5]},
    "upsampled": {"cost": "zncc", "window": 9, "upsample": [2, "cubic"]},
    "pyramid": {"preset": "fast", "pyramid": 1},
    "every other": {"cost": "ssd", "window": 5, "step": 2, "disparity_step": 2},
}


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, st.Pair]:
    folder = tmp_path_factory.mktemp("pair")
    scene = st.scenes.street(96, 48, 3)
    st.write_image(folder / "left.png", scene.left)
    st.write_image(folder / "it's right.png", scene.right)
    return folder, scene.pair


@pytest.mark.parametrize("given", GIVEN.values(), ids=GIVEN)
def test_what_is_written_reads_back(given: dict[str, Any]) -> None:
    chosen = choice.read(given)
    again = choice.read(json.loads(json.dumps(choice.written(chosen))))
    assert again == chosen
    whole = json.loads(json.dumps(chosen.to_dict()))
    del whole["threads"], whole["keep"]
    assert choice.read(whole) == chosen


@pytest.mark.parametrize("given", GIVEN.values(), ids=GIVEN)
def test_what_repeats_a_result_repeats_it(
    given: dict[str, Any],
    pair: tuple[Path, st.Pair],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder, images = pair
    monkeypatch.chdir(folder)
    chosen = choice.read({"disparities": [0, 12], **given})
    own = st.match(images, settings=chosen).disparity

    # The PNG of the command rounds; the map is compared as it is.
    words = shlex.split(choice.command(chosen, "left.png", "it's right.png").replace(".png -o", ".npy -o"))
    assert words[-2:] == ["-o", "disparity.png"]
    assert cli.main([*words[1:-1], "disparity.npy"]) == 0, capsys.readouterr().err
    assert np.array_equal(np.load("disparity.npy"), own, equal_nan=True)

    lines = choice.python(chosen, "left.png", "it's right.png").replace("disparity.png", "python.npy")
    exec(compile(lines, "python", "exec"), {})
    assert np.array_equal(np.load("python.npy"), own, equal_nan=True)

    assert st.Settings.from_toml(chosen.to_toml()) == chosen


def test_the_command_is_short() -> None:
    fast = choice.read({"disparities": [0, 64]})
    assert choice.command(fast, "left.png", "right.png") == (
        "stereopsis match left.png right.png --preset fast --disparities=0:64 -o disparity.png"
    )
    wide = choice.read({"disparities": [-8, 64], "window": [31, 15], "median": None})
    assert choice.command(wide, "my left.png", "$(x).png") == (
        "stereopsis match 'my left.png' '$(x).png' --preset fast --disparities=-8:64 --set cost=zncc "
        "--set window=31x15 --set median=none -o disparity.png"
    )


def test_the_python_is_what_one_would_write() -> None:
    chosen = choice.read(
        {"preset": "balanced", "disparities": [0, 64], "cost": {"name": "census", "window": 5}}
    )
    assert choice.python(chosen, "left.png", "right.png") == (
        "import stereopsis as st\n"
        "\n"
        "pair = st.read_pair('left.png', 'right.png')\n"
        "result = st.match(\n"
        "    pair,\n"
        "    preset='balanced',\n"
        "    disparities=(0, 64),\n"
        "    cost=st.Census(window=5, pattern='dense', aggregation=1),\n"
        ")\n"
        "st.write_disparity('disparity.png', result.disparity)\n"
    )


@pytest.mark.parametrize("name", WINDOWED)
def test_every_cost_of_windows_is_offered_with_its_window(name: str) -> None:
    offered = {cost["name"]: cost["fields"] for cost in choice.defaults()}
    assert offered[name] == {"window": [21, 21]}
    assert choice.read({"cost": {"name": name, **offered[name]}}).cost == choice.read({"cost": name}).cost


def test_every_cost_that_is_offered_is_taken() -> None:
    for cost in choice.defaults():
        kind = choice.read({"cost": {"name": cost["name"], **cost["fields"]}}).cost
        assert choice.written(st.Settings(cost=kind))["cost"] == {"name": cost["name"], **cost["fields"]}
