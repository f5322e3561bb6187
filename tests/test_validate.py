import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from reference import select as winners
from reference import validate as reference
from stereopsis import Flag, _core, _instructions, select, validate
from stereopsis.types import Disparities

N = np.nan
SEEDS = some.integers(0, 2**32)


# ---- uniqueness ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cost", "second", "perfect", "margin", "ambiguous"),
    [
        (100, 105, 0, 5, True),
        (100, 106, 0, 5, False),
        (100, 100, 0, 0, True),
        (100, 101, 0, 0, False),
        (0, 0, 0, 0, True),
        (0, 1, 0, 50, False),
        # 1 - correlation: 0.5 against 0.75 is 50 % more
        (-0.5, -0.25, -1, 50, True),
        (-0.5, -0.25, -1, 49, False),
        (-1, -1, -1, 0, True),
    ],
)
def test_uniqueness_by_hand(cost, second, perfect, margin, ambiguous):
    dtype = np.int64 if perfect == 0 else np.float32
    got = validate.uniqueness(np.array([[cost]], dtype), np.array([[second]], dtype), perfect, margin)
    assert got.item() is ambiguous


@pytest.mark.parametrize(("dtype", "none"), [(np.int64, np.iinfo(np.int64).max), (np.float32, np.inf)])
def test_without_a_second_candidate_the_winner_is_unique(dtype, none):
    second = np.array([[none]], dtype)
    for cost in (0, 10**9, none):
        assert not validate.uniqueness(np.array([[cost]], dtype), second, 0, 10).any()


@given(
    shape=some.tuples(some.integers(1, 3), some.integers(1, 9), some.integers(1, 9)),
    first=some.integers(-9, 9),
    margin=some.sampled_from([0, 5, 33.3, 100, 1e6]),
    seed=SEEDS,
)
@settings(max_examples=80, deadline=None)
def test_uniqueness_of_any_volume(shape, first, margin, seed):
    volume = np.random.default_rng(seed).integers(0, 30, shape)
    there = np.arange(shape[1])[:, None] - first - np.arange(shape[2])
    volume[:, (there < 0) | (there >= shape[1])] = np.iinfo(np.int64).max
    won = select.left(volume, first)
    np.testing.assert_array_equal(
        validate.uniqueness(won.cost, won.second, 0.0, margin),
        reference.uniqueness(volume, first, 0.0, margin),
    )


# ---- left-right ----------------------------------------------------------------------------------


def test_left_right_by_hand():
    # Pixel 3 says 2, its match 1 says 2: fine. Pixel 2 says 1, its match 1 says 2: off by one.
    index, right = np.array([[0, 1, 1, 2]], np.int32), np.array([[0, 2, 0, 3]], np.int32)
    np.testing.assert_array_equal(validate.left_right(index, right, 0, 1)[0], [0, 0, 0, 0])
    # At tolerance 0 pixel 1 and its match 0 (which says 0) differ, nor does its other match (1 says 2) agree.
    # Pixel 2: candidate 0 matches 2, which says 0: a wrong match. Pixel 3 agrees.
    np.testing.assert_array_equal(
        validate.left_right(index, right, 0, 0)[0], [0, Flag.OCCLUDED, Flag.MISMATCHED, 0]
    )


def test_left_right_leaves_alone_what_has_no_winner():
    index = np.full((1, 3), -1, np.int32)
    assert not validate.left_right(index, index, 5, 0).any()


@given(
    height=some.integers(1, 4),
    width=some.integers(1, 12),
    first=some.integers(-8, 8),
    count=some.integers(1, 10),
    tolerance=some.sampled_from([0, 0.5, 1, 1.5, 2, 100]),
    seed=SEEDS,
)
@settings(max_examples=120, deadline=None)
def test_left_right_of_any_volume(height, width, first, count, tolerance, seed):
    volume = np.random.default_rng(seed).integers(0, 9, (height, width, count)).astype(np.float32)
    index, right = (
        winners.left(volume, first)[0].astype(np.int32),
        winners.right(volume, first).astype(np.int32),
    )
    np.testing.assert_array_equal(
        validate.left_right(index, right, first, tolerance),
        reference.left_right(index, right, first, tolerance),
    )


# ---- texture -------------------------------------------------------------------------------------


def test_texture_by_hand():
    image = np.array([[0, 2, 10, 10]], np.uint8)[..., None]
    # |2 - 0| / 2 at the left edge, |10 - 0| / 2, |10 - 2| / 2, |10 - 10| / 2
    np.testing.assert_array_equal(validate.texture(image, (1, 1)), [[1, 5, 4, 0]])
    np.testing.assert_allclose(validate.texture(image, (3, 1)), [[7 / 3, 10 / 3, 3, 4 / 3]], rtol=1e-6)
    np.testing.assert_allclose(validate.texture(image, (2, 5)), [[1, 3, 4.5, 2]], rtol=1e-6)


@given(
    shape=some.tuples(some.integers(1, 7), some.integers(1, 9), some.sampled_from([1, 3])),
    window=some.tuples(some.integers(1, 15), some.integers(1, 15)),
    top=some.sampled_from([2, 256, 65536, 2**21]),
    threads=some.integers(0, 9),
    seed=SEEDS,
)
@settings(max_examples=100, deadline=None)
def test_texture_of_any_image(shape, window, top, threads, seed):
    image = np.random.default_rng(seed).integers(-top if top > 65536 else 0, top, shape).astype(np.int32)
    got = validate.texture(image, window, threads)
    np.testing.assert_allclose(got, reference.texture(image, window), rtol=1e-6, atol=1e-9)


def test_texture_of_the_largest_gradient():
    image = np.tile(np.array([0, 0, 2**21, 2**21], np.int32), (4, 8))[..., None]
    image = image * 2 - 2**21
    expected = reference.texture(image, (255, 255))
    np.testing.assert_allclose(validate.texture(image.astype(np.int32), (255, 255)), expected, rtol=1e-6)


def answers(shape, seed):
    """A map with holes, its confidence and flags."""
    rng = np.random.default_rng(seed)
    disparity = (rng.integers(-4, 4, shape) / 2).astype(np.float32)
    disparity[rng.random(shape) < 0.2] = N
    return disparity, rng.random(shape, np.float32), rng.integers(0, 4, shape, np.uint8)


def refused(where, flag, disparity, confidence, flags):
    """What becomes of these: the definition."""
    return (
        np.where(where, np.float32(N), disparity),
        np.where(where, np.float32(0), confidence),
        flags | where * np.uint8(flag),
    )


def test_refuse_dull_by_hand():
    image = np.array([[0, 2, 10, 10]], np.uint8)[..., None]  # textures 1, 5, 4, 0
    found = np.arange(4, dtype=np.float32)[None], np.ones((1, 4), np.float32), np.ones((1, 4), np.uint8)
    validate.refuse_dull(image, (1, 1), 4.0, *found)
    np.testing.assert_array_equal(found[0], [[N, 1, 2, N]])
    np.testing.assert_array_equal(found[1], [[0, 1, 1, 0]])
    np.testing.assert_array_equal(found[2], [[9, 1, 1, 9]])


def test_refusals_change_the_arrays_themselves():
    disparity, confidence, flags = answers((4, 6), 0)
    with pytest.raises(ValueError, match="confidence must be contiguous"):
        validate.refuse_speckle(disparity[:, :3].copy(), 9, 1.0, confidence[:, :3], flags[:, :3])


@pytest.mark.parametrize("instructions", _core.instruction_sets())
@given(
    shape=some.tuples(
        some.integers(1, 7), some.sampled_from([1, 2, 5, 63, 64, 65, 130]), some.sampled_from([1, 3])
    ),
    window=some.tuples(some.integers(1, 17), some.integers(1, 17)),
    # Sums over windows fit 16 bits, 32 bits, or more.
    top=some.sampled_from([256, 2**16, 2**20, 2**28, 2**31 - 1]),
    quantile=some.sampled_from([0.0, 0.3, 1.0, 2.0]),
    threads=some.sampled_from([1, 3]),
    seed=SEEDS,
)
@settings(max_examples=60, deadline=None)
def test_refuse_dull(instructions, shape, window, top, quantile, threads, seed):
    dtype = np.uint8 if top == 256 else np.int32
    image = np.random.default_rng(seed).integers(0, top, shape).astype(dtype)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(_instructions.ENVIRONMENT, instructions)
        gradient = validate.texture(image, window, threads)
        # One that some pixel has exactly, or more than any.
        least = float(np.quantile(gradient, min(quantile, 1), method="nearest")) * max(quantile, 1) + 1e-12
        found = answers(shape[:2], seed)
        expected = refused(gradient < np.float32(least), Flag.LOW_TEXTURE, *found)
        validate.refuse_dull(image, window, least, *found, threads)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)


# ---- speckle -------------------------------------------------------------------------------------


def test_speckle_by_hand():
    disparity = np.array(
        [
            [1, 1, N, 9],
            [1, 2, 9, N],
            [N, N, 5, 5],
        ],
        np.float32,
    )
    four = np.array([[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]], bool)
    np.testing.assert_array_equal(validate.speckle(disparity, 1, 1.0), four)
    # Diagonals do not join, so both nines are alone; the fives are two; the ones and the two are four.
    alone = np.array([[0, 0, 0, 1], [0, 0, 1, 0], [0, 0, 0, 0]], bool)
    np.testing.assert_array_equal(validate.speckle(disparity, 2, 1.0), alone)
    pairs = alone | np.array([[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 1, 1]], bool)
    np.testing.assert_array_equal(validate.speckle(disparity, 3, 1.0), pairs)
    # Less than one pixel apart, the two is alone too.
    two = np.array([[0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0]], bool)
    np.testing.assert_array_equal(validate.speckle(disparity, 2, 0.5), alone | two)
    np.testing.assert_array_equal(validate.speckle(disparity, 5, 1.0), ~np.isnan(disparity))


@pytest.mark.parametrize("instructions", _core.instruction_sets())
@given(
    shape=some.one_of(
        some.tuples(some.integers(1, 8), some.integers(1, 8)),
        some.tuples(some.integers(1, 2), some.sampled_from([63, 64, 65, 66, 128, 129])),
    ),
    area=some.integers(0, 20),
    difference=some.sampled_from([0, 0.5, 1, 3]),
    threads=some.sampled_from([1, 2, 3, 7]),
    seed=SEEDS,
)
@settings(max_examples=60, deadline=None)
def test_speckle_of_any_map(instructions, shape, area, difference, threads, seed):
    found = answers(shape, seed)
    disparity = found[0].copy()
    where = reference.speckle(disparity, area, difference)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(_instructions.ENVIRONMENT, instructions)
        np.testing.assert_array_equal(validate.speckle(disparity, area, difference, threads), where)
        np.testing.assert_array_equal(disparity, found[0])
        expected = refused(where, Flag.SPECKLE, *found)
        disparity, confidence, flags = found
        validate.refuse_speckle(disparity, area, difference, confidence, flags, threads)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)


def test_cut_off_by_hand():
    disparity = np.full((4, 12), 8, np.float32)
    disparity[:, 8:] = 10
    disparity[:3, :8] = N
    disparity[0, 2] = 1  # beside tens, which would be out of view at 2
    disparity[1, 1:3] = (7, 7)  # nearer than the tens by 3, but not by more
    disparity[2, 6:8] = (1, 4)  # the four first, and then it no longer stands between the one and the tens
    expected = np.zeros((4, 12), bool)
    expected[0, 2] = expected[2, 6:8] = True
    np.testing.assert_array_equal(validate.cut_off(disparity, 16), expected)
    np.testing.assert_array_equal(validate.cut_off(disparity[:, 1:], 16, left=1), expected[:, 1:])
    # As part of a larger image its tens are in view; beyond the range nothing is looked at.
    for nothing in (validate.cut_off(disparity, 32, left=3), validate.cut_off(disparity, 8)):
        assert nothing.shape == disparity.shape
        assert not nothing[:, 7].any()


@pytest.mark.parametrize(("height", "found"), [(333, True), (334, False)])
def test_large_regions_are_not_cut_off(height, found):
    disparity = np.full((height, 12), 30, np.float32)
    disparity[:, :3] = 2
    assert validate.cut_off(disparity, 64)[:, :3].all() == found
    assert not validate.cut_off(disparity, 64)[:, 3:].any()


@pytest.mark.parametrize("instructions", _core.instruction_sets())
@given(
    shape=some.tuples(some.integers(1, 8), some.integers(1, 12)),
    end=some.integers(-3, 20),
    left=some.integers(0, 5),
    seed=SEEDS,
)
@settings(max_examples=60, deadline=None)
def test_cut_off_of_any_map(instructions, shape, end, left, seed):
    random = np.random.default_rng(seed)
    disparity = np.float32(random.integers(0, 5, shape) * random.choice([1, 2.5], shape[1]))
    disparity[random.random(shape) < 0.3] = N
    columns = np.s_[:, : max(0, end - left)]
    expected = np.zeros(shape, bool)
    expected[columns] = reference.cut_off(disparity[columns], left, 6, 1.0, 3.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(_instructions.ENVIRONMENT, instructions)
        patch.setattr(validate, "CUT_OFF", 6)
        found = validate.cut_off(disparity, end, left)
    np.testing.assert_array_equal(found, expected)


# ---- what is accepted ----------------------------------------------------------------------------


def test_accepted_by_hand():
    disparity, confidence = np.array([[1.5, 2, N]], np.float32), np.array([[0.5, 0.25, 0]], np.float32)
    accepted = validate.accepted(disparity, confidence, np.array([[0, 1, 0]], np.uint8))
    np.testing.assert_array_equal(accepted[0], [[1.5, N, N]])
    np.testing.assert_array_equal(accepted[1], [[0.5, 0, 0]])


def test_judged_by_hand():
    smooth = np.array([[-1, 4, 4, 4, 4, 9]], np.float32)
    winners = np.array([[0, 6.5, 7, N, 4, 9]], np.float32)
    flags = np.array([[0, Flag.OCCLUDED | Flag.SPECKLE, 0, 0, Flag.SKY, Flag.AMBIGUOUS]], np.uint8)
    confidence = np.full((1, 6), 0.5, np.float32)
    disparity, trust = validate.judged(smooth, winners, confidence, flags, Disparities(0, 8))
    np.testing.assert_array_equal(smooth, [[0, 4, 4, 4, 4, 7]])
    np.testing.assert_array_equal(flags, [[0, 0, Flag.MISMATCHED, Flag.MISMATCHED, Flag.SKY, 0]])
    np.testing.assert_array_equal(disparity, [[0, 4, N, N, N, 7]])
    np.testing.assert_array_equal(trust, [[0.5, 0.5, 0, 0, 0, 0.5]])


@given(
    shape=some.tuples(some.integers(1, 7), some.integers(1, 40)),
    told=some.booleans(),
    threads=some.sampled_from([1, 3]),
    seed=SEEDS,
)
@settings(max_examples=60, deadline=None)
def test_judged_of_any_map(shape, told, threads, seed):
    rng = np.random.default_rng(seed)
    smooth, winners = (
        np.where(rng.random(shape) < 0.1, N, rng.integers(-8, 12, shape) / 2).astype(np.float32)
        for _ in range(2)
    )
    flags = rng.choice(np.array([0, 0, 1, 2, 5, 8, 16, 33, 64, 72, 255], np.uint8), shape)
    confidence = rng.random(shape[::-1]).astype(np.float32).T
    given = winners if told else None
    expected = reference.judged(smooth, given, confidence, flags, -2, 3)
    answers = validate.judged(smooth, given, confidence, flags, Disparities(-2, 4), threads)
    for found, wanted in zip((smooth, flags, *answers), expected, strict=True):
        np.testing.assert_array_equal(found, wanted)
    again = validate.accepted(smooth, np.ascontiguousarray(confidence), flags, threads)
    for found, wanted in zip(again, answers, strict=True):
        np.testing.assert_array_equal(found, wanted)
