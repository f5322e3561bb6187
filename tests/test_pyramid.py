"""Coarse to fine: each tile is matched over its own range, and answers what the whole image would."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

import stereopsis as st
from stereopsis import Flag, Settings, pipeline, pyramid
from stereopsis.pyramid import Tile
from stereopsis.types import Disparities

N = np.nan


def noise(shape, seed=0, dtype=np.uint8, top=256):
    return np.random.default_rng(seed).integers(0, top, shape).astype(dtype)


def bits(result):
    return result.disparity.tobytes(), result.confidence.tobytes(), result.flags.tobytes()


# ---- the plan ------------------------------------------------------------------------------------


def test_a_plan_by_hand(monkeypatch):
    monkeypatch.setattr(pyramid, "SIDE", 16)
    # Pixels of the map are 4 x 4 of the image's, which so has four tiles in a row.
    first = np.full((4, 16), 5, np.float32)
    first[:, 12:] = [[9, N, N, N]] * 4
    found = pyramid.plan(first, 4, (16, 64), Disparities(0, 100))
    assert [tile[:4] for tile in found] == [(0, 16, 16 * k, 16 * k + 16) for k in range(4)]
    # 5 with a margin of 2 on either side, times 4; from the third tile on, 9 is near.
    assert [tile.disparities for tile in found] == [(12, 29), (12, 29), (12, 45), (12, 45)]
    assert pyramid.plan(first, 4, (16, 64), Disparities(20, 28))[0].disparities == (20, 28)
    # A range that the map has nothing of is searched whole.
    assert pyramid.plan(first, 4, (16, 64), Disparities(60, 70))[0].disparities == (60, 70)
    nothing = pyramid.plan(first * N, 4, (16, 64), Disparities(-5, 70))
    assert {tile.disparities for tile in nothing} == {(-5, 70)}


def test_a_tile_that_the_map_hardly_knows_looks_around(monkeypatch):
    monkeypatch.setattr(pyramid, "SIDE", 16)
    first = np.full((4, 16), 5, np.float32)
    first[:, 4:8] = N
    first[:, 0] = 30
    found = pyramid.plan(first, 4, (16, 64), Disparities(0, 200))
    assert found[1].disparities == (12, 129)
    assert found[2].disparities == (12, 29)


@given(shape=some.tuples(some.integers(1, 700), some.integers(1, 700)), levels=some.integers(1, 5))
def test_tiles_cover_every_pixel_once(shape, levels):
    first = np.full(tuple(max(1, side >> levels) for side in shape), 3, np.float32)
    seen = np.zeros(shape, int)
    for tile in pyramid.plan(first, 2**levels, shape, Disparities(-9, 99)):
        seen[tile.top : tile.bottom, tile.left : tile.right] += 1
        assert -9 <= tile.disparities.min < tile.disparities.max <= 99
    assert (seen == 1).all()


# ---- a tile answers what the whole image does ------------------------------------------------------


@given(
    shape=some.tuples(some.integers(1, 24), some.integers(20, 90)),
    corner=some.tuples(some.floats(0, 1), some.floats(0, 1)),
    low=some.integers(-30, 40),
    span=some.integers(1, 20),
    window=some.tuples(some.integers(1, 9), some.integers(1, 7)),
    kind=some.sampled_from([st.SAD, st.ZNCC, st.SSD]),
    left_right=some.sampled_from([None, 1.0]),
    seed=some.integers(0, 2**32 - 1),
)
@settings(max_examples=150, deadline=None)
def test_a_cut_is_matched_as_the_whole(shape, corner, low, span, window, kind, left_right, seed):
    left, right = noise(shape, seed, top=9), noise(shape, seed + 1, top=9)
    top, first = int(corner[0] * (shape[0] - 1)), int(corner[1] * (shape[1] - 1))
    tile = Tile(top, min(shape[0], top + 7), first, min(shape[1], first + 11), Disparities(low, low + span))
    cut = pyramid.cut(tile, shape, (window[0] // 2, window[1] // 2))
    settings = Settings(cost=kind(window), subpixel=None, left_right=left_right, uniqueness=5)
    whole = st.match(left, right, settings=settings, disparities=tile.disparities)
    images = left[cut.rows, cut.left], right[cut.rows, cut.right]
    own = (low - cut.shift, low + span - cut.shift)
    part = st.match(*images, settings=settings, disparities=own)
    into = np.s_[tile.top : tile.bottom, tile.left : tile.right]
    np.testing.assert_array_equal(part.disparity[cut.core] + cut.shift, whole.disparity[into])
    np.testing.assert_array_equal(part.confidence[cut.core], whole.confidence[into])
    np.testing.assert_array_equal(part.flags[cut.core] == 0, whole.flags[into] == 0)
    if left_right is None:
        np.testing.assert_array_equal(part.flags[cut.core], whole.flags[into])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize(
    "changes",
    [
        {"cost": st.ZNCC(7)},
        {"cost": st.SAD(5), "left_right": 1, "median": 3, "speckle": 20, "fill": "background"},
        {"cost": st.ZNCC(st.Cross(5, 30))},
        {"cost": st.ZNCC(9), "subpixel": "lucas-kanade", "vertical": 0.25},
        {"cost": st.ZNCC(9), "extra_windows": (15,)},
    ],
    ids=["plain", "checked", "cross", "from images", "merged"],
)
def test_with_the_whole_range_everywhere_nothing_changes(dtype, changes, monkeypatch):
    scene = st.scenes.plane(150, 70, disparity=9.4, dtype=dtype, gray=True)
    monkeypatch.setattr(pyramid, "SIDE", 40)
    monkeypatch.setattr(pipeline.pyramid, "_range", lambda seen, factor, disparities: disparities)
    plain = st.match(scene.left, scene.right, disparities=(0, 24), **changes)
    tiled = st.match(scene.left, scene.right, disparities=(0, 24), pyramid=1, **changes)
    assert bits(tiled) == bits(plain)
    assert tiled.path == plain.path
    assert "coarse" in tiled.timings


# ---- matching ------------------------------------------------------------------------------------


@pytest.mark.parametrize("levels", [1, 2, 3])
@pytest.mark.parametrize("start", [40.3, -60.7])
def test_a_wall(levels, start, monkeypatch):
    monkeypatch.setattr(pyramid, "SIDE", 64)
    scene = st.scenes.plane(400, 160, disparity=start, slant_y=0.1, gray=True)
    result = st.match(scene.left, scene.right, disparities=(-128, 128), cost=st.ZNCC(9), pyramid=levels)
    errors = np.abs(result.disparity - scene.disparity)[~scene.occluded]
    assert np.mean(errors < 0.5) > 0.97
    assert result.settings.pyramid == levels


def test_a_winner_at_an_end_is_refused(monkeypatch):
    scene = st.scenes.plane(200, 60, disparity=20.0, gray=True)
    monkeypatch.setattr(pipeline.pyramid, "_range", lambda *_: Disparities(8, 21))
    result = st.match(scene.left, scene.right, disparities=(0, 40), cost=st.ZNCC(9), subpixel=None, pyramid=2)
    # 20 is the last that the tile tries, though not the last that was asked for.
    there = ~scene.occluded
    assert np.isnan(result.disparity[there]).mean() > 0.99
    assert (result.flags[there] == Flag.MISMATCHED).mean() > 0.99
    assert (result.confidence[np.isnan(result.disparity)] == 0).all()
    asked = st.match(scene.left, scene.right, disparities=(8, 21), cost=st.ZNCC(9), subpixel=None, pyramid=2)
    assert (asked.disparity[there] == 20).mean() > 0.99


def test_every_invalid_pixel_says_why():
    scene = st.scenes.street(420, 260, seed=4, gray=True)
    result = st.match(scene.left, scene.right, disparities=(0, 64), preset="fast", pyramid=2)
    assert (result.flags[np.isnan(result.disparity)] != 0).all()
    plain = st.match(scene.left, scene.right, disparities=(0, 64), preset="fast")
    truth, seen = scene.disparity, np.isfinite(scene.disparity) & ~scene.occluded
    scores = [st.evaluate(each.disparity, truth, seen) for each in (result, plain)]
    assert scores[0].own.d1 < scores[1].own.d1 + 0.01
    assert scores[0].density > scores[1].density - 0.02


def test_threads(monkeypatch):
    monkeypatch.setattr(pyramid, "SIDE", 50)
    scene = st.scenes.street(200, 120, seed=4)
    same = [
        st.match(scene.left, scene.right, disparities=(0, 40), preset="fast", pyramid=1, threads=n)
        for n in (1, 2, 7)
    ]
    assert bits(same[0]) == bits(same[1]) == bits(same[2])


@pytest.mark.parametrize("shape", [(1, 1), (1, 70), (70, 1), (5, 9), (40, 64)])
@pytest.mark.parametrize("levels", [1, 5])
def test_degenerate_images(shape, levels):
    flat = np.full(shape, 7, np.uint8)
    for left, right in ((flat, flat), (noise(shape), noise(shape, 1))):
        result = st.match(left, right, disparities=(-9, 30), preset="fast", pyramid=levels)
        assert result.disparity.shape == shape
        assert (result.flags[np.isnan(result.disparity)] != 0).all()


# ---- the setting ---------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [0, 6, 1.5, True, "2"])
def test_what_is_refused(value):
    with pytest.raises(ValueError, match="pyramid must be"):
        Settings(pyramid=value)


@pytest.mark.parametrize("others", [{"keep": "costs"}, {"step": 2}, {"keep": "planes", "slant": "road"}])
def test_what_it_does_not_go_with(others):
    with pytest.raises(ValueError, match="pyramid goes without"):
        Settings(pyramid=2, **others)


def test_as_text():
    assert Settings.make(assignments=["pyramid=3"]).pyramid == 3
    assert Settings.make(assignments=["pyramid=none"]).pyramid is None
    assert Settings.from_toml(Settings(pyramid=2).to_toml()).pyramid == 2
