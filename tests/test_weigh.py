from math import exp, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

import stereopsis as st
from reference import weigh as reference
from stereopsis import Adaptive, Bilateral, Cross, Gaussian, cost, weigh
from stereopsis.types import EVERY, Disparities, Sampling

KINDS = weigh.KINDS
every_kind = pytest.mark.parametrize("kind", KINDS)
SUPPORTS = (
    Gaussian(1.2),
    Gaussian(0.6, 2),
    Bilateral(5, 3, 40),
    Bilateral((4, 2), 1.5, 100),
    Cross(2, 60),
    Cross(9, 30),
    Adaptive(3, (7, 5), 4, 20),
    Adaptive((2, 4), 9, 10, 100),
)
INF = np.inf


def images(seed, shape, dtype, levels=256):
    top = {np.uint8: 256, np.uint16: 65536, np.float32: 1000}[dtype]
    rng = np.random.default_rng(seed)
    left, right = (rng.integers(0, min(levels, top), shape) for _ in range(2))
    if dtype == np.float32:
        return (left / 7 - 50).astype(dtype), (right / 7 - 50).astype(dtype)
    return left.astype(dtype), right.astype(dtype)


def volume(support, kind, pair, disparities, sampling=EVERY, threads=1):
    return weigh.volume(support, kind, *pair[:3], Disparities(*disparities), sampling, threads)


def assert_is_definition(support, kind, pair, disparities, sampling=EVERY, threads=1):
    got = volume(support, kind, pair, disparities, sampling, threads)
    candidates = range(*disparities)[:: sampling.disparity_step]
    expected = reference.volume(support, kind, pair.left, pair.right, candidates, pair.step, sampling.step)
    assert got.dtype == np.float32
    assert got.shape == expected.shape
    seen = np.isfinite(expected)
    np.testing.assert_array_equal(np.isfinite(got), seen)
    # Of differences, what is under a millionth of the pixels' squares may be lost.
    largest = float(max(abs(pair.left.astype(np.int64)).max(), abs(pair.right.astype(np.int64)).max()))
    scale = {"sad": largest, "zsad": largest, "ssd": largest**2, "zssd": largest**2}.get(kind, 1.0)
    np.testing.assert_allclose(got[seen], expected[seen], rtol=2e-6, atol=2e-6 * max(1.0, scale * 1e-3))


# ---- by hand -------------------------------------------------------------------------------------

LEFT, RIGHT = np.array([[1, 2, 4, 8]], np.uint8), np.array([[2, 4, 8, 8]], np.uint8)


def test_gaussian_taps_by_hand():
    # radius round(0.5 * 4) = 2; weights exp(-2 i^2)
    total = 1 + 2 * exp(-2) + 2 * exp(-8)
    np.testing.assert_allclose(
        weigh.gaussian_taps(Gaussian(0.5)), np.array([exp(-8), exp(-2), 1, exp(-2), exp(-8)]) / total
    )


def test_gaussian_by_hand():
    # sigma 0.5 cut off at 1 pixel: weights (a, b, a) over the row; over the column all rows are the same
    a = exp(-2) / (1 + 2 * exp(-2))
    b = 1 - 2 * a
    support = Gaussian(0.5, 2)
    assert support.radius == 1
    # |L - R| at disparity 0 is 1, 2, 4, 0; at 1, from x = 1, it is 0 each, but for R's going on to the left
    expected = [[b + a * (1 + 2), INF], [b * 2 + a * (1 + 4), a], [b * 4 + a * 2, 0], [a * 4, 0]]
    np.testing.assert_allclose(
        volume(support, "sad", cost.pixels(LEFT, RIGHT), (0, 2)), [expected], rtol=1e-6
    )
    # differences (1, 1, 2) about their mean, the first pixel being repeated
    mean = b + a * 3
    zssd = a * (1 - mean) ** 2 + b * (1 - mean) ** 2 + a * (2 - mean) ** 2
    got = volume(support, "zssd", cost.pixels(LEFT, RIGHT), (0, 1))
    np.testing.assert_allclose(got[0, 0, 0], zssd, rtol=1e-5)


def test_bilateral_by_hand():
    # At x = 1 the neighbours 1 and 4 differ from 2 by 1 and 2: weights exp(-1/2 - 1/4), 1, exp(-1/2 - 2/4)
    w = np.array([exp(-0.75), 1, exp(-1)])
    w /= w.sum()
    got = volume(Bilateral((3, 1), 2, 4), "ssd", cost.pixels(LEFT, RIGHT), (0, 1))
    np.testing.assert_allclose(got[0, 1, 0], (w * [1, 4, 16]).sum(), rtol=1e-6)


def test_arms_by_hand():
    image = np.array([[10, 12, 14, 40, 41], [10, 10, 50, 40, 40]], np.int32)[..., None]
    arms = weigh.cross_arms(image, Cross(3, 4))
    # left, right, up, down: from 14 to the left two pixels are within 4; to the right 40 is not, but is next
    np.testing.assert_array_equal(arms[0, 2], [2, 1, 0, 1])
    np.testing.assert_array_equal(arms[0, 0], [0, 2, 0, 1])
    np.testing.assert_array_equal(arms[1, 4], [1, 0, 1, 0])


def test_cross_by_hand():
    image = np.array([[10, 12, 90], [10, 90, 90], [10, 90, 90]], np.uint8)
    other = np.zeros((3, 3), np.uint8)
    # Pixel (0, 0): down to (2, 0); the rows' arms to the right are 1 (12, within 4), 1 and 1 (never less)
    costs = volume(Cross(2, 4), "sad", cost.pixels(image, other), (0, 1))
    np.testing.assert_allclose(costs[0, 0, 0], (10 + 12 + 10 + 90 + 10 + 90) / 6, rtol=1e-6)


def test_adaptive_by_hand():
    # Gradients 0 0 50 50 0 0 0, each 50 counting 2500 / (2500 + 2500): a box of 3 has enough at the step.
    image = np.array([[0, 0, 0, 100, 100, 100, 100]], np.int32)[..., None]
    reach = weigh.adaptive_reach(image, Adaptive((3, 1), (5, 1), 1, 50))
    assert Adaptive((3, 1), (5, 1)).sizes == [(3, 1), (5, 1)]
    np.testing.assert_array_equal(reach[0, :, 0], [2, 2, 1, 1, 2, 2, 2])
    np.testing.assert_array_equal(reach[0, :, 1], [2, 2, 1, 1, 2, 2, 2])
    assert not reach[0, :, 2:].any()


def test_boxes_grow_evenly():
    assert Adaptive(3, 9).sizes == [(3, 3), (5, 5), (7, 7), (9, 9)]
    assert Adaptive((25, 7), (33, 11)).sizes == [(25, 7), (27, 9), (29, 9), (31, 11), (33, 11)]
    assert Adaptive((4, 5), (9, 5)).sizes == [(4, 5), (6, 5), (8, 5)]
    assert Adaptive(7, 7).sizes == [(7, 7)]


# ---- against the definition ----------------------------------------------------------------------


@pytest.mark.parametrize("support", SUPPORTS, ids=str)
@every_kind
def test_every_support_and_cost(support, kind):
    assert_is_definition(support, kind, cost.pixels(*images(1, (6, 9), np.uint8)), (-2, 5))


@some.composite
def problems(draw):
    height, width = draw(some.integers(1, 6)), draw(some.integers(1, 8))
    shape = (height, width, 3) if draw(some.booleans()) else (height, width)
    dtype = draw(some.sampled_from([np.uint8, np.uint16, np.float32]))
    left, right = images(
        draw(some.integers(0, 2**32)), shape, dtype, draw(some.sampled_from([1, 3, 256, 65536]))
    )
    pair = cost.pixels(left[::-1, ::-1], right[::-1, ::-1], draw(some.sampled_from(["grey", "separate"])))
    first = draw(some.integers(-width - 1, width + 1))
    # More candidates than the kernels take at a time, now and then.
    disparities = first, first + draw(some.integers(1, 2 * width + 20))
    sampling = Sampling(draw(some.integers(1, 3)), draw(some.integers(1, 3)))
    side = some.integers(1, 7)
    support = draw(
        some.builds(Gaussian, some.floats(0.2, 2), some.sampled_from([1, 2, 4]))
        | some.builds(Bilateral, some.tuples(side, side), some.floats(0.5, 9), some.floats(1, 1e4))
        | some.builds(Cross, some.integers(1, 12), some.sampled_from([1, 7.5, 100, 1e4]))
        | some.builds(
            lambda a, b, c, d, n, g: Adaptive((a, b), (a + c, b + d), n, g),
            side,
            side,
            some.integers(0, 9),
            some.integers(0, 9),
            # No whole number, which sums might meet by rounding
            some.sampled_from([0.123, 2.345, 17.89]),
            some.sampled_from([1, 50, 3e3]),
        )
    )
    return support, pair, disparities, sampling


@every_kind
@given(problem=problems(), threads=some.sampled_from([1, 3]))
@settings(max_examples=25, deadline=None)
def test_any_problem(kind, problem, threads):
    support, pair, disparities, sampling = problem
    assert_is_definition(support, kind, pair, disparities, sampling, threads)


@pytest.mark.parametrize("support", SUPPORTS, ids=str)
@every_kind
def test_threads_do_not_matter(support, kind):
    pair = cost.pixels(*images(9, (70, 12), np.float32))
    alone = volume(support, kind, pair, (-2, 5), threads=1)
    for threads in (3, 7):
        np.testing.assert_array_equal(volume(support, kind, pair, (-2, 5), threads=threads), alone)


@pytest.mark.parametrize("support", SUPPORTS, ids=str)
def test_instruction_sets_do_not_matter(support, monkeypatch):
    pair = cost.pixels(*images(10, (5, 30, 3), np.uint8), "separate")
    for kind in KINDS:
        costs = []
        for name in st._fused.instruction_sets():
            monkeypatch.setenv("STEREOPSIS_INSTRUCTIONS", name)
            costs.append(volume(support, kind, pair, (-3, 22)))
        for other in costs[1:]:
            np.testing.assert_array_equal(other, costs[0])


def test_a_box_that_does_not_adapt_is_a_box():
    pair = cost.pixels(*images(2, (9, 14), np.uint8))
    for size in ((5, 3), (4, 4)):
        for kind in ("sad", "ssd", "zssd", "zncc"):
            box = st.match(
                pair.left[..., 0],
                pair.right[..., 0],
                disparities=(0, 6),
                cost=st.settings.COSTS[kind](size),
                keep="costs",
            ).stages["costs"]
            mean = 1 if kind == "zncc" else size[0] * size[1]
            got = volume(Adaptive(size, size), kind, pair, (0, 6))
            expected = np.where(np.isfinite(got), box / mean, INF)
            np.testing.assert_allclose(got, expected, rtol=1e-6, atol=2e-5)


@pytest.mark.parametrize("support", SUPPORTS, ids=str)
def test_a_window_without_contrast_has_no_correlation(support):
    """Whatever rounding leaves of it."""
    for level in (1, 3, 77, 255):
        flat = np.full((7, 9), level, np.uint8)
        pair = cost.pixels(flat, images(3, (7, 9), np.uint8)[0])
        assert not volume(support, "zncc", pair, (0, 1)).any()
        assert not volume(support, "zssd", cost.pixels(flat, flat), (0, 1)).any()


def test_correlations_do_not_leave_their_range():
    left = images(4, (12, 20), np.uint8)[0]
    for support in SUPPORTS:
        for kind in ("ncc", "zncc"):
            costs = volume(support, kind, cost.pixels(left, left), (-1, 2))
            assert np.nanmin(costs) >= -1
            np.testing.assert_allclose(costs[..., 1], -1, atol=1e-6)


def test_zncc_is_blind_to_gain_and_offset():
    left = images(5, (9, 16), np.uint16)[0] // 4
    for support in SUPPORTS:
        one = volume(support, "zncc", cost.pixels(left, left), (0, 3))
        two = volume(support, "zncc", cost.pixels(left, 2 * left + np.uint16(999)), (0, 3))
        np.testing.assert_allclose(one, two, atol=1e-6)


def test_grey_levels_of_float_images_are_their_own():
    """Thresholds and sigmas mean the image's grey levels, whatever fixed point it becomes."""
    left, right = images(6, (8, 12), np.uint8)
    for support in SUPPORTS:
        one = volume(support, "zncc", cost.pixels(left, right), (0, 4))
        two = volume(support, "zncc", cost.pixels(left.astype(np.float32), right.astype(np.float32)), (0, 4))
        np.testing.assert_allclose(one, two, atol=1e-6)


def test_a_foreground_of_another_colour_is_told_apart():
    """A bright square before a dark wall, each with its own texture and disparity: boxes mix them there."""
    rng = np.random.default_rng(7)
    wall, square = rng.integers(0, 60, (48, 100)), rng.integers(180, 240, (24, 30))
    left, right = wall[:, 8:88].astype(np.uint8), wall[:, 10:90].astype(np.uint8)
    left[12:36, 30:60], right[12:36, 20:50] = square, square
    truth = np.full(left.shape, 2)
    truth[12:36, 30:60] = 10
    rim = np.zeros(left.shape, bool)
    rim[8:40, 62:66] = rim[14:34, 55:59] = True

    def wrong(window):
        found = st.match(left, right, disparities=(0, 16), cost=st.SAD(window), subpixel=None).disparity
        return np.mean(found[rim] != truth[rim])

    box = wrong(13)
    assert box > 0.1
    for support in (Bilateral(13, 7, 20), Cross(6, 70)):
        assert wrong(support) < 0.5 * box


def test_the_norm_is_that_of_the_definition():
    # Two pixels of a row, weighing the same: (1, 3) and (2, 0) correlate by -1.
    left, right = np.array([[1, 3]], np.uint8), np.array([[2, 0]], np.uint8)
    got = volume(Cross(1, 9), "zncc", cost.pixels(left, right), (0, 1))
    np.testing.assert_allclose(got[0, :, 0], [1, 1])
    ncc = volume(Cross(1, 9), "ncc", cost.pixels(left, right), (0, 1))
    np.testing.assert_allclose(ncc[0, :, 0], -2 / sqrt(10 * 4), rtol=1e-6)
