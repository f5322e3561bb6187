import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

import stereopsis as st
from reference import pixelwise as reference
from stereopsis import cost, information, optimize, pixelwise, refine, select, validate
from stereopsis._fused import instruction_sets
from stereopsis._instructions import ENVIRONMENT
from stereopsis.types import Disparities

odd = some.sampled_from([1, 3, 5, 7, 9, 11])
boxes = some.tuples(some.sampled_from([1, 3, 5]), some.sampled_from([1, 3, 7]))
SEEDS = some.integers(0, 2**32)
patterns = some.sampled_from(["dense", "sparse", "symmetric"])
windows = some.tuples(odd, odd).filter(lambda window: window != (1, 1))
censuses = some.builds(st.Census, windows, patterns, boxes)
singles = (
    censuses
    | some.builds(st.Rank, windows, boxes)
    | some.builds(st.Gradient, boxes, some.sampled_from([1, 9, 255]))
    | some.builds(st.BirchfieldTomasi, boxes, some.sampled_from([1, 20, 127]))
    | some.builds(st.MutualInformation, boxes)
)
weights = some.floats(0.1, 3)
combinations = some.builds(st.Combined, singles, weights, singles, weights)
costs = singles | combinations | some.builds(st.Combined, combinations, weights, singles, weights)


def strided(array):
    """The same array, read-only and not contiguous."""
    wide = np.repeat(np.repeat(array, 2, axis=0), 3, axis=1)
    view = wide[::2, ::-3][:, ::-1]
    view.flags.writeable = False
    np.testing.assert_array_equal(view, array)
    return view


def bytes_of(seed, shape):
    return np.random.default_rng(seed).integers(0, 256, shape, np.uint8)


@some.composite
def pairs(draw):
    height, width = draw(some.integers(1, 6)), draw(some.integers(1, 9))
    dtype = draw(some.sampled_from([np.uint8, np.uint16, np.float32]))
    rng = np.random.default_rng(draw(some.integers(0, 2**32)))
    top = min(draw(some.sampled_from([2, 5, 256, 65536])), 256 if dtype == np.uint8 else 65536)
    shape = (height, width, 3) if draw(some.booleans()) else (height, width)
    left, right = (rng.integers(0, top, shape).astype(dtype) for _ in range(2))
    return (left / 8 - 3, right / 8 - 3) if dtype == np.float32 else (left, right)


@some.composite
def ranges(draw, width=9):
    first = draw(some.integers(-width - 1, width + 1))
    return Disparities(first, first + draw(some.integers(1, 2 * width + 2)))


TABLES = [np.random.default_rng(9).integers(0, 256, (256, 256), np.uint8) for _ in range(3)]


def defined(cost, pixels, disparities):
    """The cost's volume by its definition."""
    channels = pixels[0].shape[2]
    if isinstance(cost, st.Combined):
        parts = ((cost.a, cost.weight_a), (cost.b, cost.weight_b))
        volumes = [defined(part, pixels, disparities) for part, _ in parts]
        shares = [
            weight / (cost.weight_a + cost.weight_b) * one / part.largest(channels)
            for one, (part, weight) in zip(volumes, parts, strict=True)
        ]
        return np.where(volumes[0] < reference.WORST, 4095 * sum(shares), reference.WORST)
    total = 0
    whole = [image.astype(np.int64) for image in pixels[:2]]
    eight_bits = reference.levels(*pixels[:2])
    for channel in range(channels):
        planes = [
            image[..., channel] for image in (whole if isinstance(cost, st.Census | st.Rank) else eight_bits)
        ]
        match cost:
            case st.Census():
                features = [
                    reference.census(plane, st.settings.window_size(cost.window), cost.pattern)
                    for plane in planes
                ]
                between = reference.hamming
            case st.Rank():
                features = [reference.rank(plane, st.settings.window_size(cost.window)) for plane in planes]
                between = reference.apart
            case st.Gradient():
                features = [reference.gradient(plane) for plane in planes]
                between = reference.gradients_apart(cost.truncation)
            case st.BirchfieldTomasi():
                features = [reference.half_samples(plane) for plane in planes]
                between = reference.birchfield_tomasi(cost.truncation)
            case st.MutualInformation():
                features, between = planes, reference.looked_up(TABLES[channel])
        total = total + reference.volume(features, between, range(*disparities), cost.box)
    return np.minimum(total, reference.WORST)


# ---- census, by hand -----------------------------------------------------------------------------


def test_census_bits_by_hand():
    image = np.array([[1, 5, 3], [9, 5, 7], [5, 2, 5]], np.uint8)
    # Around the middle, row by row: 1 < 5, 5, 3 < 5, 9, 7, 5, 2 < 5, 5.
    assert pixelwise.census(image, st.Census(3).comparisons)[0, 1, 1] == 0b01000101
    # 1 < 5, 5 < 2 not, 3 < 5, 9 < 7 not.
    symmetric = st.Census(3, "symmetric").comparisons
    assert pixelwise.census(image, symmetric)[0, 1, 1] == 0b0101
    # The corners alone.
    assert pixelwise.census(image, st.Census(3, "sparse").comparisons)[0, 1, 1] == 0b0011
    # At the upper left corner the edge repeats: 1 1 5 / 1 . 5 / 9 9 5 around 1.
    assert pixelwise.census(image, st.Census(3).comparisons)[0, 0, 0] == 0
    # At the lower right one: 5 7 7 / 2 . 5 / 2 5 5 around 5.
    assert pixelwise.census(image, st.Census(3).comparisons)[0, 2, 2] == 0b00101000


def test_bits_beyond_a_word_are_in_the_second_plane():
    image = np.full((11, 11), 1, np.int32)
    image[10, 9] = 0
    strings = pixelwise.census(image, st.Census(11).comparisons)
    assert strings.shape == (2, 11, 11)
    assert strings[0, 5, 5] == 0
    assert strings[1, 5, 5] == 1 << (118 - 64)


@pytest.mark.parametrize(
    ("cost", "bits"),
    [
        (st.Census((9, 7)), 62),
        (st.Census((9, 7), "symmetric"), 31),
        (st.Census((9, 7), "sparse"), 20),
        (st.Census((9, 9), "sparse"), 24),
        (st.Census(11), 120),
        (st.Census(11, "symmetric"), 60),
        (st.Census((1, 3)), 2),
    ],
)
def test_number_of_comparisons(cost, bits):
    assert cost.most == len(cost.comparisons) == bits


def test_volume_by_hand():
    left, right = np.array([[1, 2, 0]], np.uint8), np.array([[1, 0, 2]], np.uint8)
    # Bits (left neighbour darker, right neighbour darker): left 00 11 00, right 01 00 10.
    got = st.match(
        left, right, cost=st.Census((3, 1)), disparities=(-1, 3), subpixel=None, keep=("costs",)
    ).stages["costs"]
    assert got.dtype == np.uint16
    w = pixelwise.WORST
    np.testing.assert_array_equal(got, [[[0, 1, w, w], [1, 2, 1, w], [w, 1, 0, 1]]])
    # Summed over three columns, each image's edges repeated.
    got = st.match(
        left,
        right,
        cost=st.Census((3, 1), aggregation=(3, 1)),
        disparities=(0, 1),
        subpixel=None,
        keep=("costs",),
    ).stages["costs"]
    np.testing.assert_array_equal(got[..., 0], [[1 + 1 + 2, 1 + 2 + 1, 2 + 1 + 1]])


# ---- against the definition ----------------------------------------------------------------------


def assert_is_definition(cost_of_pixels, images, disparities, channels="separate"):
    pixels = cost.pixels(*images, channels)
    expected = defined(cost_of_pixels, pixels, disparities)
    for threads in (1, 3):
        got = pixelwise.volume(cost_of_pixels, *pixels[:2], disparities, threads, TABLES)
        assert got.dtype == np.uint16
        if isinstance(cost_of_pixels, st.Combined):  # fixed point, rounded; a part's own is rounded before
            np.testing.assert_allclose(got, expected, rtol=0, atol=2.1)
            np.testing.assert_array_equal(got == pixelwise.WORST, expected == pixelwise.WORST)
        else:
            np.testing.assert_array_equal(got, expected)


@given(cost=costs, images=pairs(), disparities=ranges())
@settings(max_examples=150, deadline=None)
def test_any_cost(cost, images, disparities):
    assert_is_definition(cost, images, disparities)


@given(cost=costs, images=pairs(), disparities=ranges())
@settings(max_examples=20, deadline=None)
def test_strides_do_not_matter(cost, images, disparities):
    plain, other = (
        st.match(*pair, cost=cost, disparities=disparities, keep=("costs",), threads=2)
        for pair in (images, [strided(image) for image in images])
    )
    np.testing.assert_array_equal(plain.stages["costs"], other.stages["costs"])
    np.testing.assert_array_equal(plain.disparity, other.disparity)


@given(images=pairs(), window=windows, pattern=patterns)
@settings(max_examples=40, deadline=None)
def test_strings_of_any_image(images, window, pattern):
    image = cost.pixels(*images).left[..., 0]
    strings = pixelwise.census(image, st.Census(window, pattern).comparisons, 3)
    expected = reference.census(image.astype(np.int64), window, pattern)
    k = np.arange(expected.shape[2])
    bits = strings[k // 64].transpose(1, 2, 0) >> (k % 64).astype(np.uint64) & np.uint64(1)
    np.testing.assert_array_equal(bits, expected)


@pytest.mark.parametrize("instructions", instruction_sets())
@pytest.mark.parametrize("dtype", [np.uint8, np.int32])
@pytest.mark.parametrize("width", [63, 64, 129])
def test_strings_of_many_pixels_at_a_time(monkeypatch, instructions, dtype, width):
    monkeypatch.setenv(ENVIRONMENT, instructions)
    image = np.random.default_rng(width).integers(0, 256, (3, width)).astype(dtype)
    for window in (9, 7), (11, 11):  # one word with bits to spare, and two
        strings = pixelwise.census(image, st.Census(window).comparisons)
        expected = reference.census(image.astype(np.int64), window, "dense")
        k = np.arange(64 * len(strings))
        bits = strings[k // 64].transpose(1, 2, 0) >> (k % 64).astype(np.uint64) & np.uint64(1)
        np.testing.assert_array_equal(bits[..., : expected.shape[2]], expected)
        assert not bits[..., expected.shape[2] :].any()


@pytest.mark.parametrize("instructions", instruction_sets())
def test_every_instruction_set(monkeypatch, instructions):
    left, right = bytes_of(4, (7, 333, 1)), bytes_of(5, (7, 333, 1))
    for each in (st.Census(5), st.Census(11, aggregation=(5, 1)), *EVERY_COST):
        volumes = []
        for forced in (instruction_sets()[0], instructions):
            monkeypatch.setenv(ENVIRONMENT, forced)
            volumes.append(pixelwise.volume(each, left, right, Disparities(-3, 134), 2, TABLES))
        np.testing.assert_array_equal(*volumes)


# ---- volumes of 16 bits in the stages after --------------------------------------------------------


def wider(volume):
    """The same costs as int64."""
    worst = np.iinfo(np.int64).max
    return np.where(volume == pixelwise.WORST, worst, volume.astype(np.int64))


@given(seed=SEEDS, first=some.integers(-8, 8), threads=some.sampled_from([1, 3]))
@settings(max_examples=30, deadline=None)
def test_winners_are_those_of_wider_costs(seed, first, threads):
    left, right = bytes_of(seed, (4, 7, 1)) % 3, bytes_of(seed + 1, (4, 7, 1)) % 3
    volume = pixelwise.volume(st.Census(3), left, right, Disparities(first, first + 6))
    small, wide = (select.left(costs, first, threads) for costs in (volume, wider(volume)))
    np.testing.assert_array_equal(small.index, wide.index)
    for name in ("cost", "before", "after", "second"):
        assert getattr(small, name).dtype == np.uint16
        np.testing.assert_array_equal(wider(getattr(small, name)), getattr(wide, name))
    for fit in ("parabola", "equiangular"):
        offsets = [refine.subpixel(fit, w.cost, w.before, w.after) for w in (small, wide)]
        np.testing.assert_array_equal(*offsets)
    confidences = [refine.confidence(0, w.cost, w.before, w.after) for w in (small, wide)]
    np.testing.assert_array_equal(*confidences)
    ambiguous = [validate.uniqueness(w.cost, w.second, 0, 10) for w in (small, wide)]
    np.testing.assert_array_equal(*ambiguous)
    np.testing.assert_array_equal(select.right(volume, first, threads), select.right(wider(volume), first))
    index = np.random.default_rng(seed).integers(-1, 6, small.index.shape).astype(np.int32)
    at = [select.at(costs, index, first) for costs in (volume, wider(volume))]
    np.testing.assert_array_equal(wider(at[0].before), at[1].before)
    rises = [refine.subpixel("parabola", w.cost, w.before, w.after) for w in at]  # some of them negative
    np.testing.assert_array_equal(*rises)


def test_solvers_take_costs_of_16_bits():
    left, right = bytes_of(7, (6, 12, 1)) % 4, bytes_of(8, (6, 12, 1)) % 4
    volume = pixelwise.volume(st.Census(5), left, right, Disparities(-1, 5))
    for solver in (optimize.ICM(), optimize.TRWS(), optimize.BeliefPropagation()):
        small, wide = (optimize.solve(costs, solver) for costs in (volume, wider(volume)))
        np.testing.assert_array_equal(small.index, wide.index)
        assert small.energy == wide.energy
    np.testing.assert_array_equal(
        wider(optimize.right_view(volume, -1)), optimize.right_view(wider(volume), -1)
    )
    guide = select.left(volume, -1).index
    drawn = [
        optimize.second_pass(costs, guide, optimize.Smoothness("l2", 0.5), (3, 3))
        for costs in (volume, wider(volume))
    ]
    np.testing.assert_array_equal(*drawn)


@pytest.mark.parametrize("solver", ["second-pass", "icm", "trws", "bp"])
def test_costs_of_pixels_go_through_solvers(solver):
    scene = st.scenes.plane(80, 40, disparity=5)
    found = st.match(
        scene.left,
        scene.right,
        disparities=(0, 12),
        cost=st.Census(aggregation=5),
        optimize=solver,
        left_right=1,
        keep=("costs", "right_disparity"),
    )
    assert np.mean(abs(found.disparity[8:-8, 20:-8] - 5) < 0.6) > 0.97


def test_steps_take_the_same_costs():
    left, right = bytes_of(1, (13, 30)), bytes_of(2, (13, 30))
    common = {"cost": st.Census(5, aggregation=3), "disparities": (-3, 9), "keep": ("costs",)}
    every = st.match(left, right, **common).stages["costs"]
    some_of_them = st.match(left, right, step=3, disparity_step=2, **common).stages["costs"]
    np.testing.assert_array_equal(some_of_them, every[::3, ::3, ::2])


def test_candidates_that_nothing_can_see_are_presented():
    left = right = bytes_of(1, (3, 5))
    costs = st.match(left, right, cost="census", disparities=(-9, 9), keep=("costs",)).stages["costs"]
    assert costs.shape == (3, 5, 18)
    assert (costs[..., [0, 3, -1]] == pixelwise.WORST).all()
    nothing = st.match(left, right, cost="census", disparities=(20, 22), keep=("costs",))
    assert nothing.stages["costs"].dtype == np.uint16
    assert (nothing.flags == st.Flag.OUT_OF_VIEW).all()


# ---- invariances ---------------------------------------------------------------------------------


@given(census=censuses, seed=some.integers(0, 2**32))
@settings(max_examples=30, deadline=None)
def test_census_is_blind_to_an_increasing_change_of_brightness(census, seed):
    rng = np.random.default_rng(seed)
    right = rng.integers(0, 256, (6, 11)).astype(np.uint8)
    curve = np.cumsum(rng.integers(1, 200, 256)).astype(np.uint16)
    volumes = [
        pixelwise.census(image, census.comparisons) for image in (right, curve[right].astype(np.int32))
    ]
    np.testing.assert_array_equal(*volumes)


@given(cost=some.builds(st.Gradient, boxes) | some.builds(st.BirchfieldTomasi, boxes), seed=SEEDS)
@settings(max_examples=20, deadline=None)
def test_16_bits_that_are_a_multiple_of_8_cost_the_same(cost, seed):
    left, right = bytes_of(seed, (5, 9)), bytes_of(seed + 1, (5, 9))
    left[0, :2] = 0, 255
    eight = pixelwise.volume(cost, left[..., None], right[..., None], Disparities(0, 4))
    wide = [image[..., None].astype(np.int32) * 64 + 1000 for image in (left, right)]
    np.testing.assert_array_equal(pixelwise.volume(cost, *wide, Disparities(0, 4)), eight)


@given(cost=some.builds(st.Gradient, boxes), seed=SEEDS, offset=some.integers(-100, 100))
@settings(max_examples=20, deadline=None)
def test_gradients_are_blind_to_an_offset(cost, seed, offset):
    left, right = (bytes_of(s, (5, 9)) // 3 + 100 for s in (seed, seed + 1))
    plain, brighter = (
        pixelwise.volume(
            cost, left[..., None], (right + np.int16(o)).astype(np.uint8)[..., None], Disparities(0, 4)
        )
        for o in (0, offset % 70)
    )
    np.testing.assert_array_equal(plain, brighter)


@given(seed=SEEDS, box=boxes)
@settings(max_examples=20, deadline=None)
def test_half_a_pixel_costs_birchfield_and_tomasi_nothing(seed, box):
    line = bytes_of(seed, (4, 12)).astype(int) // 2 * 2
    line[:, -1] = line[:, -2]
    right = (line + np.roll(line, -1, axis=1)) // 2  # half a pixel on, between even values
    images = (image[:, :-1, None].astype(np.uint8) for image in (line, right))
    assert not pixelwise.volume(st.BirchfieldTomasi(box), *images, Disparities(0, 1)).any()


EVERY_COST = (
    st.Census(aggregation=5),
    st.Census((7, 5), "symmetric", 7),
    st.Census(9, "sparse", 5),
    st.Rank(),
    st.Gradient(),
    st.BirchfieldTomasi(),
    st.MutualInformation(),
    st.Combined(st.Census(aggregation=5), 0.6, st.Gradient(5), 0.4),
)


@pytest.mark.parametrize("cost", EVERY_COST, ids=str)
def test_a_plane_is_found(cost):
    scene = st.scenes.plane(128, 64, disparity=7.25)
    found = st.match(scene.left, scene.right, disparities=(-2, 16), cost=cost, left_right=1)
    assert found.path == "composed"
    inside = found.disparity[12:-12, 28:-12]
    assert np.mean(abs(inside - 7.25) < 0.6) > 0.97


@pytest.mark.parametrize("curve", [lambda v: 255 - v, lambda v: abs(v - 100.0) * 1.6])
def test_mutual_information_learns_how_levels_correspond(curve):
    scene = st.scenes.plane(160, 96, disparity=6)
    grey = [
        image.astype(float) if image.ndim == 2 else image.mean(axis=2) for image in (scene.left, scene.right)
    ]
    left, right = np.rint(grey[0]).astype(np.uint8), np.rint(np.clip(curve(grey[1]), 0, 255)).astype(np.uint8)
    truth = np.full(left.shape, 6, np.float32)
    table = pixelwise.information(left, right, truth)
    costs = pixelwise.volume(
        st.MutualInformation(), left[..., None], right[..., None], Disparities(0, 12), 1, [table]
    )
    assert np.mean(costs.argmin(axis=2)[8:-8, 20:-8] == 6) > 0.97


# ---- mutual information --------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_information_is_its_definition(seed):
    rng = np.random.default_rng(seed)
    left = np.clip(rng.normal(100, 30, (20, 30)), 0, 255).astype(np.uint8)
    right = np.clip(left + rng.normal(20, 5, left.shape), 0, 255).astype(np.uint8)
    disparity = rng.uniform(-3, 8, left.shape).astype(np.float32)
    disparity[rng.random(left.shape) < 0.3] = np.nan
    _, expected = reference.information(left, right, disparity)
    np.testing.assert_allclose(
        pixelwise.information(left, right, disparity), expected, rtol=0, atol=0.5 + 1e-6
    )


def test_information_of_nothing_is_the_difference():
    nothing = np.full((2, 3), np.nan, np.float32)
    table = pixelwise.information(np.zeros((2, 3), np.uint8), np.zeros((2, 3), np.uint8), nothing)
    assert table[7, 9] == table[9, 7] == 2
    assert table[0, 255] == 255


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (3, 5), (70, 80)])
@pytest.mark.parametrize("value", [0, 255])
def test_constant_images(shape, value):
    image = np.full(shape, value, np.uint8)
    for each in EVERY_COST:
        found = st.match(image, image, cost=each, disparities=(-1, 3), left_right=1)
        assert found.disparity.shape == shape


def test_pairs_are_taken_apart_channel_by_channel():
    rng = np.random.default_rng(1)
    left = rng.integers(0, 256, (40, 60, 3), np.uint8)
    tables = information.tables(left, left, Disparities(0, 8))
    assert len(tables) == 3
    for table in tables:
        # Alike levels belong together.
        assert np.median(np.diag(table)) < 0.3 * np.median(table)


def test_mutual_information_end_to_end():
    scene = st.scenes.plane(200, 120, disparity=9)
    right = scene.right if scene.right.ndim == 2 else scene.right.mean(axis=2)
    left = scene.left if scene.left.ndim == 2 else scene.left.mean(axis=2)
    # The right camera's response is another one: no sum of differences bears it.
    bent = np.rint(255 * (right / 255) ** 0.4).astype(np.uint8)
    found = [
        st.match(
            np.rint(left).astype(np.uint8),
            bent,
            cost=cost,
            disparities=(0, 24),
            left_right=1,
            threads=threads,
        )
        for cost in (st.MutualInformation(), st.BirchfieldTomasi())
        for threads in (1, 3)
    ]
    good = [np.mean(abs(one.disparity[10:-10, 36:-10] - 9) < 0.6) for one in found]
    assert good[0] > 0.95
    assert good[2] < 0.8
    np.testing.assert_array_equal(found[0].disparity, found[1].disparity)
    assert "information" in found[0].timings


def test_what_a_volume_needs():
    image = np.zeros((4, 5, 3), np.uint8)
    with pytest.raises(ValueError, match="over 3 channels"):
        pixelwise.volume(st.Census(11, aggregation=21), image, image, Disparities(0, 2))
    with pytest.raises(ValueError, match="tables must be given for combined"):
        pixelwise.volume(
            st.Combined(st.Census(), 1, st.MutualInformation(), 1), image, image, Disparities(0, 2)
        )


@pytest.mark.parametrize("subpixel", ["symmetric", "lucas-kanade", "lucas-kanade-affine", "equiangular"])
def test_every_refinement(subpixel):
    scene = st.scenes.plane(96, 48, disparity=7.3)
    cost = st.Census(aggregation=5)
    found = st.match(scene.left, scene.right, disparities=(0, 16), cost=cost, subpixel=subpixel, left_right=1)
    assert np.nanmedian(abs(found.disparity[8:-8, 24:-8] - 7.3)) < 0.15


def test_a_second_pass_may_take_other_data():
    scene = st.scenes.plane(80, 40, disparity=5)
    solver = optimize.SecondPass(optimize.Smoothness("l2", 0.5), data="zssd")
    found = st.match(
        scene.left, scene.right, disparities=(0, 12), cost=st.Census(5, aggregation=5), optimize=solver
    )
    assert np.mean(abs(found.disparity[8:-8, 20:-8] - 5) < 0.6) > 0.95


# ---- combinations --------------------------------------------------------------------------------


def test_combined_by_hand():
    cost = st.Combined(st.Census((3, 1)), 3, st.Gradient(1, truncation=10), 1)
    assert cost.largest() == 4095
    assert cost.size == (3, 3)
    left, right = np.array([[1, 2, 0]], np.uint8), np.array([[1, 0, 2]], np.uint8)
    got = pixelwise.volume(cost, left[..., None], right[..., None], Disparities(0, 1))[0, :, 0]
    # Census 1 2 1 of 2; gradients 1 -1 -2 and -1 1 2: 2 2 4 of 10.
    census, gradient = np.array([1, 2, 1]) / 2, np.array([2, 2, 4]) / 10
    np.testing.assert_array_equal(got, np.rint(4095 * (0.75 * census + 0.25 * gradient)))


def test_the_largest_combination():
    black = np.zeros((3, 3, 1), np.uint8)
    white = np.full((3, 3, 1), 255, np.uint8)
    cost = st.Combined(st.BirchfieldTomasi(1), 0.3, st.BirchfieldTomasi(15, 100), 0.7)
    assert (pixelwise.volume(cost, black, white, Disparities(0, 1)) == 4095).all()


def test_a_weight_of_nothing_leaves_the_other():
    left, right = bytes_of(3, (6, 9, 1)), bytes_of(4, (6, 9, 1))
    one = st.BirchfieldTomasi(3)
    expected = pixelwise.volume(one, left, right, Disparities(-2, 4))
    got = pixelwise.volume(st.Combined(one, 2.5, st.Census(5), 0), left, right, Disparities(-2, 4))
    inside = expected < pixelwise.WORST
    np.testing.assert_allclose(got[inside], expected[inside] * (4095 / one.largest()), rtol=0, atol=0.6)
    np.testing.assert_array_equal(got[~inside], pixelwise.WORST)


# ---- settings ------------------------------------------------------------------------------------


@given(cost=costs)
def test_round_trip(cost):
    chosen = st.Settings(cost=cost)
    assert st.Settings.from_toml(chosen.to_toml()) == chosen
    assert pixelwise.cost_of(str(cost)) == cost
    json.dumps(chosen.to_dict(), allow_nan=False)


@given(cost=costs)
def test_a_cost_fits_16_bits(cost):
    assert cost.largest() < pixelwise.WORST


def test_texts():
    make = st.Settings.make
    assert make(assignments=["cost=census"]).cost == st.Census()
    assert make(assignments=["cost=census", "window=5", "aggregation=3x1"]).cost == st.Census(
        5, aggregation=(3, 1)
    )
    assert make(assignments=["cost=Census(7x5, pattern=sparse, aggregation=3)"]).cost == st.Census(
        (7, 5), "sparse", 3
    )
    text = "cost=combined(census, 0.6, gradient(3x3, truncation=20), 0.4)"
    assert make(assignments=[text]).cost == st.Combined(st.Census(), 0.6, st.Gradient(3, 20), 0.4)
    assert make(assignments=["cost=birchfield-tomasi", "window=5"]).cost == st.BirchfieldTomasi(5)
    assert make(assignments=["cost=census"]).changed(cost="zncc").cost == st.ZNCC()
    assert make(assignments=["cost=census"]).to_dict()["cost"] == {
        "name": "census",
        "window": [9, 7],
        "pattern": "dense",
        "aggregation": [1, 1],
    }


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("cost=cencus", "did you mean 'census'"),
        ("cost=census(9x8)", "window must have odd sides from 1 to 11, not 9 x 8"),
        ("cost=census(13)", "window must have odd sides from 1 to 11"),
        ("cost=census(1)", "must hold a neighbour"),
        ("cost=census(9, thick)", "pattern must be one of dense, sparse, symmetric"),
        ("cost=census(9, patern=dense)", "did you mean 'pattern'"),
        ("cost=census(9, window=7)", "window twice"),
        ("cost=census(9,dense,1,1)", "up to 3 parts"),
        ("cost=census(9", "close its parentheses"),
        ("cost=census(11,dense,25)", "sum to 75000, and 16 bits hold up to 65534"),
        ("cost=rank(1)", "must hold a neighbour"),
        ("cost=gradient(9,0)", "truncation must be a whole number from 1 to 255, not 0"),
        ("cost=birchfield-tomasi(9,128)", "truncation must be a whole number from 1 to 127"),
        ("cost=mutual-information(17)", "17 x 17 costs of up to 255 sum to 73695"),
        ("cost=combined(census,1,gradient,-1)", "weight_b must be a number of at least 0"),
        ("cost=combined(census,0,gradient,0)", "must not both be 0"),
        ("cost=combined(census,1,gradent,1)", "did you mean 'gradient'"),
        ("cost=combined(census,1,gradient(9,1)", "close its parentheses"),
        ("cost=combined(census,1,zncc,1)", "names no cost of pixels 'zncc'"),
        ("cost=combined", "needs its a, weight_a, b, weight_b"),
        ("cost=combined(census, 1, gradient)", "needs its weight_b"),
        ("cost=" + 99 * "combined(", "close its parentheses"),
        ("cost=" + 99 * "combined(" + 99 * ")", "at most 32 parts"),
        ("cost=gradient(9,much)", "truncation must be a number, not 'much'"),
        ("aggregation=3", "cost=ZNCC has no aggregation"),
        ("cost=zncc(9)", "window apart"),
    ],
)
def test_errors(text, message):
    with pytest.raises(ValueError, match=message.replace("(", r"\(")):
        st.Settings.make(assignments=[text])


@given(
    pieces=some.lists(
        some.sampled_from(
            ["census", "combined", "rank", "(", ")", ",", "=", "9", "9x7", "0.5", "window", "nan", " ", "a"]
        )
    )
)
def test_any_text_is_a_cost_or_a_value_error(pieces):
    try:
        cost = pixelwise.cost_of("".join(pieces))
    except ValueError:
        return
    assert pixelwise.cost_of(str(cost)) == cost


@pytest.mark.parametrize("other", [{"slant": "road"}, {"extra_windows": (31,)}, {"upsample": (2, "linear")}])
def test_what_census_does_not_go_with(other):
    with pytest.raises(ValueError, match=r"cost must be one of sad.* not census"):
        st.Settings(cost=st.Census(), **other)


def test_combined_takes_costs_of_pixels_only():
    with pytest.raises(TypeError, match=r"b must be one of Census, Rank.*, not ZNCC"):
        st.Combined(st.Census(), 1, st.ZNCC(), 1)


def test_three_channels_need_room():
    cost = st.Census(11, aggregation=21)
    assert st.Settings(cost=cost).cost == cost
    with pytest.raises(ValueError, match="at most 65534 over three channels"):
        st.Settings(cost=cost, channels="separate")
