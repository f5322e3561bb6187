"""The costs at one pixel, from a crop, compared with the whole volume."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import stereopsis as st
from stereopsis.types import Disparities
from stereopsis.view.curve import curve
from stereopsis.view.sources import Scene

WIDTH, HEIGHT = 70, 40
PIXELS = [(0, 0), (69, 39), (35, 20), (66, 1)]


@cache
def _scene(dtype: type = np.uint8, *, gray: bool = False) -> Scene:
    street = st.scenes.street(WIDTH, HEIGHT, 5, gray=gray, dtype=dtype)
    return Scene(street.left, street.right, None, None, None, None, Disparities(0, 16))


COSTS: dict[str, Any] = {
    "sad": st.SAD(5),
    "ssd": st.SSD((7, 4)),
    "zsad": st.ZSAD(3),
    "zssd": st.ZSSD((6, 3)),
    "ncc": st.NCC(4),
    "zncc": st.ZNCC((9, 5)),
    "wide": st.ZNCC((101, 3)),
    "census": st.Census((9, 7), aggregation=3),
    "rank": st.Rank((5, 3), aggregation=(7, 3)),
    "gradient": st.Gradient(5),
    "birchfield-tomasi": st.BirchfieldTomasi(5),
    "combined": st.Combined(st.Census((5, 5)), 0.5, st.Gradient((9, 3)), 0.5),
    "gaussian": st.ZNCC(st.Gaussian(2)),
    "bilateral": st.SAD(st.Bilateral(7)),
    "cross": st.SSD(st.Cross(9)),
    "adaptive": st.SSD(st.Adaptive(9)),
}


@pytest.mark.parametrize("cost", COSTS.values(), ids=COSTS)
def test_a_crop_gives_the_costs_of_the_whole(cost: Any) -> None:
    _compare(cost, (-7, 9))


@pytest.mark.parametrize("name", ["zncc", "wide", "census"])
@pytest.mark.parametrize("disparities", [(0, 16), (-90, 90), (8, 9)])
def test_a_crop_holds_every_candidate(name: str, disparities: tuple[int, int]) -> None:
    _compare(COSTS[name], disparities)


def _compare(cost: Any, disparities: tuple[int, int]) -> None:
    scene = _scene()
    chosen = st.Settings(cost=cost, disparities=disparities, threads=1)
    volume = st.match(scene.pair(), settings=chosen.changed(keep=("costs",))).stages["costs"]
    none = np.iinfo(volume.dtype).max if volume.dtype.kind in "iu" else np.inf
    for x, y in PIXELS:
        told = curve(scene, chosen, x, y)
        assert told["disparities"] == list(range(*disparities))
        own = [None if value == none else value for value in volume[y, x].tolist()]
        assert told["costs"] == own, (x, y)
        best = disparities[0] + int(np.argmin(volume[y, x]))
        assert told["winner"] == (None if set(own) == {None} else best)
        assert told["note"] is None


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("channels", ["grey", "separate"])
@pytest.mark.parametrize("subpixel", ["parabola", "equiangular"])
def test_the_fit_is_the_results(dtype: type, channels: Any, subpixel: Any) -> None:
    scene = _scene(dtype)
    chosen = st.Settings(
        cost=st.ZSSD(5), disparities=(0, 16), channels=channels, subpixel=subpixel, vertical=(0.5, 0.2, 0.0)
    )
    own = st.match(scene.pair(), settings=chosen).disparity
    fits = 0
    for x, y in [(x, y) for x in range(0, WIDTH, 12) for y in range(0, HEIGHT, 9)]:
        told = curve(scene, chosen, x, y)
        assert np.float32(told["subpixel"]) == own[y, x], (x, y)
        if told["fit"] is None:
            continue
        fits += 1
        points = np.array(told["fit"]["points"])
        assert told["fit"]["kind"] == subpixel
        # It goes through the winner's cost or its neighbours', and is lowest at the answer.
        lowest = points[np.argmin(points[:, 1]), 0]
        assert abs(lowest - told["subpixel"]) <= 1 / 16
        at = told["disparities"].index(told["winner"])
        ends = [told["costs"][at - 1], told["costs"][at + 1]]
        if subpixel == "parabola":
            assert np.allclose(points[[0, -1], 1], ends, rtol=1e-5, atol=1e-3)
        else:
            assert np.isclose(max(points[0, 1], points[-1, 1]), max(ends), rtol=1e-5, atol=1e-3)
    assert fits > 10


def test_what_decides_beyond_the_costs_is_said() -> None:
    scene = _scene()
    plain = st.PRESETS["fast"].changed(disparities=(0, 16), vertical=None)
    assert curve(scene, plain, 30, 20)["note"] is None
    smoothed = curve(scene, st.PRESETS["balanced"].changed(disparities=(0, 16), vertical=None), 30, 20)
    assert "before smoothing" in smoothed["note"]
    local = st.PRESETS["local"].changed(disparities=(0, 16), vertical=None)
    assert "upright window" in curve(scene, local, 30, 20)["note"]
    mutual = st.Settings(cost=st.MutualInformation(), disparities=(0, 16))
    assert "around this pixel" in curve(scene, mutual, 30, 20)["note"]
    widened = st.Settings(cost=st.ZNCC(5), disparities=(0, 16), upsample=(2, "linear"))
    assert "not widened" in curve(scene, widened, 30, 20)["note"]


def test_a_pixel_without_candidates_has_no_winner() -> None:
    told = curve(_scene(), st.Settings(cost=st.SSD(3), disparities=(20, 24)), 5, 5)
    assert told["costs"] == [None] * 4
    assert (told["winner"], told["subpixel"], told["fit"]) == (None, None, None)


def test_candidates_may_lie_apart() -> None:
    scene = _scene()
    chosen = st.Settings(cost=st.SSD(5), disparities=(0, 16), disparity_step=3)
    own = st.match(scene.pair(), settings=chosen).disparity
    told = curve(scene, chosen, 40, 20)
    assert told["disparities"] == [0, 3, 6, 9, 12, 15]
    assert np.float32(told["subpixel"]) == own[20, 40]
