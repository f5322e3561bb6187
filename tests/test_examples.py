"""The examples run, and say what they promise."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stereopsis as st

EXAMPLES = Path(__file__).parents[1] / "examples"
SMALL = {"width": 320, "height": 144}


def run(name: str, *args: Any, **kwargs: Any) -> Any:
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))["main"](*args, **kwargs)


def test_every_example_is_tested() -> None:
    here = Path(__file__).read_text(encoding="utf-8")
    untested = [path.name for path in EXAMPLES.glob("*.py") if f'run("{path.stem}"' not in here]
    assert not untested


def test_first_pair(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scores = run("first_pair", tmp_path / "out", **SMALL)
    assert scores.own.within_1 > 0.8
    assert "of the pixels answered" in capsys.readouterr().out
    assert st.read_image(tmp_path / "out" / "left.png").shape == (144, 320, 3)
    assert st.read_image(tmp_path / "out" / "preview.png").ndim == 3
    assert st.read_disparity(tmp_path / "out" / "disparity.pfm").shape == (144, 320)


def test_depth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    error = run("depth", tmp_path, **SMALL)
    assert 0 < error < 0.05
    assert "points" in capsys.readouterr().out
    metres = np.load(tmp_path / "depth.npy")
    assert metres.shape == (144, 320)
    assert 0 < np.nanmin(metres) <= np.nanmax(metres) <= 65
    assert (tmp_path / "points.ply").read_bytes().startswith(b"ply")


def test_frames(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    nearest = run("frames", tmp_path, count=2, **SMALL)
    assert len(nearest) == 2
    assert min(nearest) > 0
    assert "frame 1" in capsys.readouterr().out
    stored = st.read_image(tmp_path / "0001-depth.png")
    assert stored.dtype == np.uint16
    assert stored[stored > 0].min() == pytest.approx(1000 * nearest[1], abs=0.51)


def test_compare_costs(capsys: pytest.CaptureFixture[str]) -> None:
    within = run("compare_costs", windows=(7, 15), **SMALL)
    assert set(within) == {(cost, size) for cost in ("SAD", "SSD", "ZSSD", "NCC", "ZNCC") for size in (7, 15)}
    # The right image is brighter: what is blind to that must win.
    assert within["ZNCC", 15] > within["SSD", 15] + 0.1
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["within", "SAD", "SSD", "ZSSD", "NCC", "ZNCC"]
