import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

import stereopsis as st
from reference import slant as reference
from stereopsis import Disparities, Flag, Settings, _core, _fused, cost, datasets, slant, validate
from stereopsis.slant import LEVEL, Hypothesis, Plane

N = np.nan
SEEDS = some.integers(0, 2**32)
KINDS = ("sad", "ssd", "zsad", "zssd", "ncc", "zncc")
DATA = Path(os.environ.get("STEREOPSIS_DATA") or Path(__file__).parents[2] / "shared" / "data")
any_plane = some.builds(Plane, some.floats(-0.9, 0.9), some.floats(-2, 2), some.floats(-9, 9))


def noise(shape, seed=0, dtype=np.uint8, top=256):
    return np.random.default_rng(seed).integers(0, top, shape).astype(dtype)


def bits(result):
    return result.disparity.tobytes(), result.confidence.tobytes(), result.flags.tobytes()


def ramp(plane, shape):
    y, x = np.mgrid[: shape[0], : shape[1]]
    return (plane.a * x + plane.b * y + plane.c).astype(np.float32)


def within(result, truth, bound, rows=slice(None)):
    """Fraction of the pixels whose match is in view."""
    there = np.arange(truth.shape[1]) - truth
    seen = (there >= 0) & (there <= truth.shape[1] - 1)
    return (np.abs(result.disparity - truth) < bound)[rows][seen[rows]].mean()


# ---- planes --------------------------------------------------------------------------------------


def test_a_mirrored_plane_by_hand():
    # d = x / 2: pixel 8 meets 4, so from there the disparity is u. In a mirror 10 wide, u = 4 is 5.
    assert Plane(0.5, 0.0, 0.0).mirrored(10) == (-1.0, 0.0, 9.0)
    assert LEVEL.mirrored(7) == LEVEL


@given(plane=any_plane, width=some.integers(1, 500), x=some.floats(0, 500), y=some.floats(0, 500))
def test_mirrored_planes_agree_on_every_match(plane, width, x, y):
    d = plane.a * x + plane.b * y + plane.c
    other = plane.mirrored(width)
    mirrored = width - 1 - (x - d)
    assert other.a * mirrored + other.b * y + other.c == pytest.approx(d, abs=1e-6 * (1 + abs(d)))
    back = other.mirrored(width)
    assert back == pytest.approx(plane, rel=1e-6, abs=1e-6 * width)


@pytest.mark.parametrize("plane", [Plane(0.0, 0.3, -20.0), Plane(-0.05, 0.1, 4.0), Plane(0.1, 1.5, -60.5)])
def test_the_road_is_found_exactly(plane):
    map = ramp(plane, (100, 160))
    map[:60] = 3  # what stands above it
    map[70:90, 20:60] = 55  # and on it
    map[::3] = N
    found = slant.road(map, (15, 15))
    np.testing.assert_allclose(ramp(found, map.shape)[60:], ramp(plane, map.shape)[60:], atol=0.1)


@pytest.mark.parametrize(
    "map",
    [
        np.full((50, 70), N, np.float32),
        np.full((50, 70), 7, np.float32),
        ramp(Plane(0.0, -0.3, 40.0), (50, 70)),  # a ceiling
        ramp(Plane(0.4, 0.0, 0.0), (50, 70)),  # a wall
        noise((50, 70), 1).astype(np.float32),
        np.zeros((1, 1), np.float32),
        np.zeros((1, 90), np.float32),
        np.zeros((90, 1), np.float32),
    ],
)
def test_what_is_no_road(map):
    assert slant.road(map, (15, 15)) is None


def test_walls_follow_the_road():
    walls = [Plane(0.0, 0.4, -30.0), Plane(0.2, 0.0, 1.0), Plane(-0.25, 0.0, 60.0)]
    map = np.full((120, 240), 9, np.float32)
    map[80:] = ramp(walls[0], map.shape)[80:]
    map[:80, :100] = ramp(walls[1], map.shape)[:80, :100]
    map[:80, 160:] = ramp(walls[2], map.shape)[:80, 160:]
    before = map.copy()
    found = slant.planes(map, (15, 15))
    np.testing.assert_array_equal(map, before)
    assert found[0] == pytest.approx(walls[0], abs=0.02, rel=0.05)
    assert len(found) == 3
    for wall in walls[1:]:
        assert any(plane == pytest.approx(wall, abs=0.02, rel=0.05) for plane in found[1:])
    assert slant.planes(map, (15, 15), most=1) == found[:1]
    # A window of one pixel sees no slant.
    assert slant.planes(map, (1, 1)) == []


def test_large_maps_are_thinned():
    plane = Plane(0.01, 0.2, -31.0)
    assert slant.road(ramp(plane, (600, 900)), (9, 9)) == pytest.approx(plane, abs=1e-3)


@given(
    shape=some.tuples(some.integers(1, 20), some.integers(1, 20)),
    top=some.integers(0, 12),
    radius=some.sampled_from([0, 1, 4, 15]),
    slopes=some.sampled_from([(0.5, -1.0, 2.0), (0.2, 0.02, 2.0), (9.0, -9.0, 9.0)]),
    sample=some.sampled_from([1, 7, 50, 1000]),
    threads=some.sampled_from([1, 3]),
    seed=SEEDS,
)
@settings(max_examples=60, deadline=None)
def test_planes_of_any_map(shape, top, radius, slopes, sample, threads, seed):
    rng = np.random.default_rng(seed)
    map = ramp(Plane(*rng.uniform(-1, 1, 3)), shape) + rng.choice([0, 0, 0, 5, 0.4, N], shape)
    map = map.astype(np.float32)
    found = np.zeros(3)
    inliers = _core.find_plane(map, top, radius, *slopes, 0.5, 40, sample, found, threads, "")
    plane, expected = reference.find_plane(map, top, radius, *slopes, 0.5, 40, sample)
    # A residual that rounding moves over the tolerance may be counted by one and not by the other.
    assert inliers == pytest.approx(expected, abs=1)
    if plane is not None:
        np.testing.assert_allclose(found, plane, rtol=1e-6, atol=1e-6)


# ---- warping -------------------------------------------------------------------------------------


def test_a_warp_by_hand():
    image = np.array([[10, 20, 40, 80, 90]], np.uint8)[..., None]
    left = image + np.uint8(1)
    wide, moved = slant.warped(left, image, Plane(0.0, 0.0, 1.0), 2)
    # The right image at x - 1, x from -2 to 6; the left one repeats its edges.
    np.testing.assert_array_equal(moved[0, :, 0], [10, 10, 10, 10, 20, 40, 80, 90, 90])
    np.testing.assert_array_equal(wide[0, :, 0], [11, 11, 11, 21, 41, 81, 91, 91, 91])
    # Half way: (-10 + 9 * 20 + 9 * 40 - 80) / 16 = 28.125 between the second and the third.
    half = slant.warped(left, image, Plane(0.0, 0.0, -0.5), 0)[1]
    assert half[0, 1, 0] == 28
    # Overshoot stays within the image's range: (-10 + 9 * 10 + 9 * 20 - 40) / 16 = 13.75, but from
    # 80 to 90 it is (-40 + 9 * 80 + 9 * 90 - 90) / 16 = 87.5, rounded up.
    assert half[0, 0, 0] == 14
    assert half[0, 3, 0] == 88


@given(
    shape=some.tuples(some.integers(1, 4), some.integers(1, 12), some.sampled_from([1, 3])),
    dtype=some.sampled_from([np.uint8, np.int32]),
    plane=any_plane,
    margin=some.integers(0, 9),
    threads=some.sampled_from([1, 3]),
    seed=SEEDS,
)
@settings(max_examples=80, deadline=None)
def test_warps_of_any_image(shape, dtype, plane, margin, threads, seed):
    rng = np.random.default_rng(seed)
    image = rng.integers(0 if dtype is np.uint8 else -(2**21), 256, shape).astype(dtype)
    wide, moved = slant.warped(image, image, plane, margin, threads)
    expected = reference.warp(image, plane, margin).astype(np.int64)
    # Halves may be rounded either way.
    assert np.abs(moved.astype(np.int64) - expected).max() <= 1
    assert (moved != expected).mean() < 0.1
    assert moved.dtype == dtype
    np.testing.assert_array_equal(wide, np.pad(image, ((0, 0), (margin, margin), (0, 0)), "edge"))


# ---- merging -------------------------------------------------------------------------------------


def random_pass(rng, height, width, reach=4):
    found = (
        rng.uniform(-reach, reach, (height, width)).astype(np.float32),
        rng.uniform(0, 1, (height, width)).astype(np.float32),
        rng.choice([0, 0, 4], (height, width)).astype(np.uint8),
    )
    costs = rng.choice([-1, -0.7, -0.2, 0, 0.4, np.inf], (height, width)).astype(np.float32)
    return found, costs


@given(
    shape=some.tuples(some.integers(1, 5), some.integers(1, 14)),
    kind=some.sampled_from(KINDS),
    margin=some.integers(0, 8),
    plane=any_plane,
    low=some.integers(-9, 3),
    threads=some.sampled_from([1, 3]),
    seed=SEEDS,
)
@settings(max_examples=80, deadline=None)
def test_merging_of_any_passes(shape, kind, margin, plane, low, threads, seed):
    rng = np.random.default_rng(seed)
    disparities = Disparities(low, low + 7)
    got, expected = Hypothesis.nothing(shape), Hypothesis.nothing(shape)
    for number, (side, along, factor) in enumerate([(0, LEVEL, 1.0), (margin, plane, 0.8)]):
        found, costs = random_pass(rng, shape[0], shape[1] + 2 * side)
        if kind not in ("ncc", "zncc"):
            costs = np.abs(costs)
        slant.merge_pass(
            got, found, costs, cost.KINDS.index(kind), along, number, factor, disparities, threads
        )
        reference.merge_pass(expected, found, costs, kind, along, number, factor, disparities)
    for ours, theirs in zip(got, expected, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-6)
    # What nobody answered is out of view, and nothing else is.
    np.testing.assert_array_equal(got.flags == Flag.OUT_OF_VIEW, np.isnan(got.disparity))
    there = np.arange(shape[1]) - got.disparity
    assert (np.isnan(there) | ((there > -1e-4) & (there < shape[1] - 1 + 1e-4))).all()


@given(kind=some.sampled_from(KINDS), threads=some.sampled_from([1, 3]), seed=SEEDS)
@settings(max_examples=30, deadline=None)
def test_the_window_of_least_variance_wins(kind, threads, seed):
    rng = np.random.default_rng(seed)
    shape = 4, 11
    best, variance = Hypothesis.nothing(shape), np.full(shape, np.inf, np.float32)
    each, expected = [], []
    for _ in range(3):
        found, costs = random_pass(rng, *shape)
        costs = np.where(np.isinf(costs), 0.5, costs).astype(np.float32)
        other = Hypothesis(*found[:2], costs, np.abs(costs), found[2], found[2] % 3)
        slant.merge_window(best, variance, other, cost.KINDS.index(kind), threads)
        each.append(other)
        pairs = zip(costs.flat, found[1].flat, strict=True)
        expected.append([reference.variance(kind, c, g) for c, g in pairs])
    winner = np.argmin(np.float32(expected), axis=0).reshape(shape)
    for got, choices in zip(best, zip(*each, strict=True), strict=True):
        np.testing.assert_array_equal(got, np.choose(winner, choices))
    np.testing.assert_allclose(variance, np.min(expected, axis=0).reshape(shape), rtol=1e-6)


def test_handicaps():
    assert slant.handicap(16, 16, (31, 31)) == 1
    # 256 pixels are 16 samples, so 16 candidates against 128 count (1 / 8)^(1 / 8).
    assert slant.handicap(16, 128, (16, 16)) == pytest.approx(0.125**0.125)
    assert 0 < slant.handicap(16, 128, (1, 1)) < slant.handicap(16, 128, (9, 9)) < 1
    assert slant.handicap(16, 4, (9, 9)) > 1


def test_left_right_of_maps_by_hand():
    left = np.array([[0.2, 0.4, 1.0, 2.0, N]], np.float32)
    right = np.array([[1.4, 0.0, 2.0, 9.0, 0.0]], np.float32)
    # 0 meets 0, which says 1.4: 1.2 apart, and no pixel claims column 0 within 1 except that of 1 (1 + 0).
    # 1 meets 1 (0.6), which says 0. 2 meets 1, one apart. 3 meets 1, which says 0; 2 + 2 claims column 3.
    flags = validate.left_right_maps(left, right, Disparities(0, 4), 1.0)
    np.testing.assert_array_equal(flags[0], [Flag.OCCLUDED, 0, 0, Flag.MISMATCHED, 0])
    # From -1 on, column 0 could have met pixel 1.
    flags = validate.left_right_maps(left, right, Disparities(-1, 4), 1.0)
    np.testing.assert_array_equal(flags[0], [Flag.MISMATCHED, 0, 0, Flag.MISMATCHED, 0])


@given(
    shape=some.tuples(some.integers(1, 3), some.integers(1, 12)),
    low=some.integers(-6, 4),
    span=some.integers(1, 9),
    tolerance=some.sampled_from([0.0, 0.5, 1.0, 2.25, 50.0, float("inf")]),
    threads=some.sampled_from([1, 3]),
    seed=SEEDS,
)
@settings(max_examples=80, deadline=None)
def test_left_right_of_any_maps(shape, low, span, tolerance, threads, seed):
    rng = np.random.default_rng(seed)
    left, right = (
        np.where(rng.random(shape) < 0.2, N, rng.integers(-24, 24, shape) / 4).astype(np.float32)
        for _ in range(2)
    )
    disparities = Disparities(low, low + span)
    np.testing.assert_array_equal(
        validate.left_right_maps(left, right, disparities, tolerance, threads),
        reference.left_right_maps(left, right, disparities, tolerance),
    )


@given(
    shape=some.tuples(some.integers(1, 5), some.integers(1, 30)),
    kind=some.sampled_from(KINDS),
    low=some.integers(-40, 9),
    span=some.integers(1, 40),
    dtype=some.sampled_from([np.uint8, np.uint16]),
    seed=SEEDS,
)
@settings(max_examples=60, deadline=None)
def test_streaming_hands_out_its_winners_and_their_costs(shape, kind, low, span, dtype, seed):
    left, right = noise(shape, seed, dtype), noise(shape, seed + 1, dtype)
    if dtype != np.uint8:
        left[0, 0] = 1001  # no byte times anything
    low = max(low, 1 - shape[1])
    disparities = Disparities(low, max(low + 1, min(low + span, shape[1])))
    if disparities.min >= shape[1]:
        return
    pixels = cost.pixels(left, right)
    costs = np.empty(shape, np.float32)
    given = (kind, pixels, disparities, (5, 3), "parabola")
    disparity, _, flags = _fused.match(*given, 1.0, 5.0, 1, costs)
    volume = st.match(
        left, right, disparities=disparities, cost=getattr(st, kind.upper())((5, 3)), keep="costs"
    )
    least = volume.stages["costs"].min(axis=2).astype(np.float32)
    seen = np.isfinite(volume.disparity)
    np.testing.assert_array_equal(np.isfinite(costs), seen)
    np.testing.assert_array_equal(costs[seen], least[seen])
    np.testing.assert_array_equal(disparity, volume.disparity)
    # The flags are those that the checks set, though nothing was refused.
    np.testing.assert_array_equal(flags, _fused.match(*given, 1.0, 5.0, 1)[2])


# ---- the whole -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("plane", "disparities"),
    [
        (Plane(0.0, 0.25, -8.0), (-12, 32)),
        (Plane(0.02, 0.1, 3.5), (0, 32)),
        (Plane(-0.03, 0.2, -30.0), (-40, 0)),
    ],
)
@pytest.mark.parametrize("kind", ["road", "planes"])
def test_a_slanted_plane_is_matched_as_exactly_as_a_level_one(plane, disparities, kind):
    scene = st.scenes.plane(
        200, 120, 3, gray=True, noise=1, disparity=plane.c, slant_x=plane.a, slant_y=plane.b
    )
    result = st.match(
        scene.left, scene.right, disparities=disparities, cost=st.ZNCC(21), slant=kind, keep="planes"
    )
    level = st.match(scene.left, scene.right, disparities=disparities, cost=st.ZNCC(21))
    assert result.path == "merged"
    assert result.stages["planes"][0] == pytest.approx(plane, abs=0.4)
    assert within(result, scene.disparity, 0.15) > 0.93 > within(level, scene.disparity, 0.15) + 0.1
    assert np.isfinite(result.disparity[:, 40:-40]).all()


@pytest.mark.parametrize("kind", KINDS)
def test_every_cost_follows_a_slant(kind):
    scene = st.scenes.plane(160, 100, 1, gray=True, disparity=-4.0, slant_y=0.25)
    given = {"disparities": (-8, 30), "cost": kind, "subpixel": "equiangular" if "ad" in kind else "parabola"}
    sloped = st.match(scene.left, scene.right, slant="road", **given)
    level = st.match(scene.left, scene.right, **given)
    assert within(sloped, scene.disparity, 0.5) > max(0.95, within(level, scene.disparity, 0.5))


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_other_pixels_follow_it_too(dtype):
    scene = st.scenes.plane(160, 100, 1, dtype=dtype, disparity=-4.0, slant_y=0.25)
    result = st.match(scene.left, scene.right, disparities=(-8, 30), cost="zncc", slant="road")
    apart = st.match(
        scene.left, scene.right, disparities=(-8, 30), cost="zncc", slant="road", channels="separate"
    )
    assert within(result, scene.disparity, 0.2) > 0.94
    assert within(apart, scene.disparity, 0.2) > 0.94


def test_without_a_plane_the_answer_is_that_of_level_windows():
    left, right = noise((150, 250), 1), noise((150, 250), 2)
    for slanted in ("road", "planes"):
        result = st.match(left, right, disparities=(-5, 20), cost=st.ZNCC(9), slant=slanted, keep="planes")
        assert result.stages["planes"].shape == (0, 3)
        assert not result.stages["plane"].any()
        assert bits(result) == bits(st.match(left, right, disparities=(-5, 20), cost=st.ZNCC(9)))
    level = st.match(left, right, disparities=(-5, 20), cost=st.ZNCC(9), keep="planes")
    assert level.path == "streaming"
    assert level.stages["planes"].shape == (0, 3)


def test_a_level_plane_needs_no_slant():
    scene = st.scenes.plane(160, 100, 2, gray=True, noise=2, disparity=7.25)
    given = {"disparities": (0, 24), "cost": st.ZNCC(15)}
    level = st.match(scene.left, scene.right, **given)
    assert bits(st.match(scene.left, scene.right, slant="planes", **given)) == bits(level)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_street(seed):
    scene = st.scenes.street(320, 160, seed, gray=True, samples=1)
    given = {"disparities": (0, 48), "cost": st.ZNCC(15)}
    level, road, planes = (
        st.evaluate(st.match(scene.left, scene.right, slant=kind, **given).disparity, scene.disparity)
        for kind in (None, "road", "planes")
    )
    local = st.match(scene.left, scene.right, preset="local", disparities=(0, 48))
    assert road.all.within_0_5 > level.all.within_0_5 + 0.05
    assert planes.all.within_0_5 > road.all.within_0_5 - 0.01
    assert st.evaluate(local.disparity, scene.disparity).all.within_0_5 > road.all.within_0_5


def test_what_is_out_of_view_has_no_answer():
    scene = st.scenes.plane(120, 80, 1, gray=True, disparity=6.0, slant_y=0.25)
    result = st.match(scene.left, scene.right, disparities=(5, 30), cost=st.ZNCC(9), slant="road")
    x = np.arange(120)
    out = np.broadcast_to(x < 5, result.disparity.shape)
    np.testing.assert_array_equal(np.isnan(result.disparity), out)
    np.testing.assert_array_equal(result.flags, np.where(out, Flag.OUT_OF_VIEW, 0))
    np.testing.assert_array_equal(result.confidence[out], 0)
    assert (x - result.disparity)[~out].min() >= -1e-4
    assert result.disparity[~out].min() >= 4.5
    assert result.disparity[~out].max() <= 29.5
    nowhere = st.match(scene.left, scene.right, disparities=(200, 300), cost=st.ZNCC(9), slant="road")
    assert (nowhere.flags == Flag.OUT_OF_VIEW).all()


def test_checks_say_why():
    scene = st.scenes.street(320, 160, 0, gray=True, samples=1)
    result = st.match(
        scene.left,
        scene.right,
        disparities=(0, 48),
        cost=st.ZNCC(11),
        slant="planes",
        left_right=1,
        uniqueness=2,
        texture=0.3,
        median=3,
        speckle=(30, 1.0),
        keep=("right_disparity", "planes", "unfiltered", "texture"),
    )
    invalid = np.isnan(result.disparity)
    np.testing.assert_array_equal(invalid, result.flags != 0)
    assert not result.confidence[invalid].any()
    for flag in (Flag.OCCLUDED, Flag.MISMATCHED, Flag.AMBIGUOUS, Flag.LOW_TEXTURE, Flag.SPECKLE):
        assert (result.flags & flag).any()
    assert list(result.timings) == [
        "read",
        "planes",
        "match",
        "right",
        "validate",
        "texture",
        "median",
        "speckle",
    ]
    assert set(result.stages) == {"right_disparity", "planes", "plane", "unfiltered", "texture"}
    assert result.stages["plane"].max() <= len(result.stages["planes"]) <= slant.MOST_PLANES
    hidden = scene.occluded & np.isfinite(scene.disparity)
    assert ((result.flags & Flag.OCCLUDED) != 0)[hidden].mean() > 0.4
    # What passed agrees with the right view.
    y, x = np.nonzero(~invalid)
    before = result.stages["unfiltered"][y, x]
    there = np.rint(x - before).astype(int)
    assert (np.abs(result.stages["right_disparity"][y, there] - before) <= 1).all()


def test_threads_and_strides_make_no_difference():
    scene = st.scenes.street(160, 90, 2, samples=1)
    one = st.match(scene.left, scene.right, preset="local", disparities=(0, 24), threads=1)
    for threads in (2, 3, 7, 0):
        other = st.match(scene.left, scene.right, preset="local", disparities=(0, 24), threads=threads)
        assert bits(other) == bits(one)
    left, right = (np.asfortranarray(image) for image in (scene.left, scene.right))
    left.flags.writeable = right.flags.writeable = False
    assert bits(st.match(left, right, preset="local", disparities=(0, 24))) == bits(one)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 3), (5, 40), (40, 5)])
@pytest.mark.parametrize("disparities", [(0, 4), (-3, 2), (2, 90), (-90, -60)])
def test_tiny_images(shape, disparities):
    left, right = noise(shape, 1), noise(shape, 2)
    result = st.match(left, right, preset="local", fill=None, disparities=disparities)
    assert result.disparity.shape == shape
    np.testing.assert_array_equal(np.isnan(result.disparity), result.flags != 0)


def test_extra_windows_alone():
    scene = st.scenes.street(320, 160, 1, gray=True, samples=1)
    given = {"disparities": (0, 48), "cost": st.ZNCC(9)}
    scores = {
        extra: st.evaluate(
            st.match(scene.left, scene.right, extra_windows=extra, **given).disparity, scene.disparity
        ).all
        for extra in ((), (21,), (21, (41, 15)))
    }
    assert scores[(21,)].rmse < scores[()].rmse
    assert scores[(21, (41, 15))].rmse < scores[()].rmse
    # The same window twice changes nothing.
    twice = st.match(scene.left, scene.right, extra_windows=9, **given)
    assert bits(twice) == bits(st.match(scene.left, scene.right, **given))


# ---- settings ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value", "error", "message"),
    [
        ("slant", "raod", ValueError, "slant must be one of road, planes, or None, not 'raod'"),
        ("slant", 1, ValueError, "slant must be one of road, planes"),
        ("extra_windows", 0, ValueError, "window must be"),
        ("extra_windows", (15, "x"), ValueError, "window must be"),
        ("extra_windows", None, ValueError, "extra_windows must be"),
    ],
)
def test_values_that_are_refused(name, value, error, message):
    with pytest.raises(error, match=message):
        Settings(**{name: value})


@pytest.mark.parametrize("merged", [{"slant": "road"}, {"extra_windows": 5}])
def test_costs_belong_to_one_plane_and_window(merged):
    with pytest.raises(ValueError, match='keep must be without "costs"'):
        Settings(keep="costs", **merged)


@pytest.mark.parametrize("slanted", [None, "road", "planes"])
@pytest.mark.parametrize("extra", [(), (15,), (15, (41, 9))])
def test_settings_as_text(slanted, extra):
    made = Settings(slant=slanted, extra_windows=extra)
    assert Settings.from_toml(made.to_toml()) == made
    text = ",".join(f"{width}x{height}" for width, height in made.extra_windows)
    assert Settings.make(assignments=[f"slant={slanted or 'none'}", f"extra_windows={text}"]) == made
    assert Settings.make("local", assignments=["extra_windows=off"]).extra_windows == ()


# ---- real pairs ----------------------------------------------------------------------------------


@pytest.mark.skipif(not (DATA / "drivingstereo").is_dir(), reason="needs DrivingStereo")
def test_the_preset_on_a_road():
    sample = datasets.open(DATA / "drivingstereo")[4]
    result = st.match(sample.pair(), preset="local", disparities=(0, 128))
    level = st.match(sample.pair(), cost=st.ZNCC(31), disparities=(0, 128))
    ours, plain = (st.evaluate(r.disparity, sample.truth(), sample.mask()) for r in (result, level))
    assert ours.all.within_1 > 0.6 > plain.all.within_1 + 0.1
    assert ours.filled.rmse < 0.5 * plain.filled.rmse
