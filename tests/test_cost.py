from math import sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from reference import cost as reference
from stereopsis import _core, aggregate, cost
from stereopsis.types import Disparities

KINDS = ("sad", "ssd", "zsad", "zssd", "ncc", "zncc")
every_kind = pytest.mark.parametrize("kind", KINDS)
WORST = np.iinfo(np.int64).max


def volume(kind, pair, disparities, window, threads=1):
    disparities = Disparities(*disparities)
    if kind == "zsad":
        return cost.zsad(pair, disparities, window, threads)
    sums = aggregate.box(cost.terms(kind, pair, disparities, window, threads), window, threads)
    return cost.score(kind, sums, pair, disparities, window, threads)


def images(seed, shape, dtype, levels=None):
    top = {np.uint8: 256, np.uint16: 65536, np.float32: 1000}[dtype]
    rng = np.random.default_rng(seed)
    left, right = (rng.integers(0, min(levels or top, top), shape) for _ in range(2))
    if dtype == np.float32:
        return (left / 7 - 50).astype(dtype), (right / 7 - 50).astype(dtype)
    return left.astype(dtype), right.astype(dtype)


def assert_is_definition(kind, pair, disparities, window):
    got = volume(kind, pair, disparities, window)
    expected = reference.volume(kind, pair.left, pair.right, range(*disparities), window)
    if kind in ("sad", "ssd"):
        np.testing.assert_array_equal(got, expected)
        return
    seen = np.isfinite(expected)
    np.testing.assert_array_equal(np.isfinite(got), seen)
    scale = 1.0 if kind in ("ncc", "zncc") else max(1.0, expected[seen].max(initial=0))
    own = [
        reference.between("zssd", cut, 0 * cut) for cut in (reference.windows(i, window) for i in pair[:2])
    ]
    if kind == "zssd":  # its rounding is that of the window's own squared deviations
        scale = max(scale, *(each.max() for each in own))
    if kind == "zncc" and pair.left.dtype == np.uint8:
        # 32-bit arithmetic rounds the covariance while it is still as large as the area times a pixel.
        least = [each[each > 1e-6].min(initial=np.inf) for each in own]
        scale += 2 * window[0] * window[1] * pair.left.shape[2] / np.sqrt(least[0] * least[1])
    np.testing.assert_allclose(got[seen], expected[seen], rtol=0, atol=2e-5 * scale)


# ---- by hand -------------------------------------------------------------------------------------

LEFT, RIGHT = np.array([[1, 2, 4, 8]], np.uint8), np.array([[2, 4, 8, 8]], np.uint8)
INF = np.inf


@pytest.mark.parametrize(
    ("kind", "window", "expected"),
    [
        # one pixel: |1-2|, |2-4|, |4-8|, |8-8| at disparity 0; |2-2|, |4-4|, |8-8| at 1
        ("sad", (1, 1), [[1, WORST], [2, 0], [4, 0], [0, 0]]),
        ("ssd", (1, 1), [[1, WORST], [4, 0], [16, 0], [0, 0]]),
        # three: the edges repeated, so at x = 0 |1-2| + |1-2| + |2-4|; at disparity 1 the right window goes
        # on by itself, so at x = 1 |1-2| + |2-2| + |4-4|
        ("sad", (3, 1), [[4, WORST], [7, 1], [6, 0], [4, 0]]),
        ("ssd", (3, 1), [[6, WORST], [21, 1], [20, 0], [16, 0]]),
        # two: the pixel itself and the one to its left
        ("sad", (2, 1), [[2, WORST], [3, 1], [6, 0], [4, 0]]),
        # means removed, equal pixels differ by nothing; at x = 1 (1, 2) - (2, 4) leaves (0.5, -0.5)
        ("zsad", (2, 1), [[0, INF], [1, 1], [2, 0], [4, 0]]),
        ("zssd", (2, 1), [[0, INF], [0.5, 0.5], [2, 0], [8, 0]]),
        # a single pixel is its own mean, and has no norm without it
        ("zsad", (1, 1), [[0, INF], [0, 0], [0, 0], [0, 0]]),
        ("zssd", (1, 1), [[0, INF], [0, 0], [0, 0], [0, 0]]),
        ("zncc", (1, 1), [[0, INF], [0, 0], [0, 0], [0, 0]]),
        ("ncc", (1, 1), [[-1, INF], [-1, -1], [-1, -1], [-1, -1]]),
        # At disparity 0 (1, 1, 2) meets (2, 2, 4), (1, 2, 4) meets (2, 4, 8), (2, 4, 8) meets (4, 8, 8) and
        # (4, 8, 8) meets (8, 8, 8); at 1 (1, 2, 4) meets (2, 2, 4). Three times the deviations of (1, 2, 4)
        # are (-4, -1, 5), of (2, 2, 4) (-2, -2, 4), of (2, 4, 8) (-8, -2, 10), of (4, 8, 8) (-8, 4, 4).
        ("zncc", (3, 1), [[-1, INF], [-1, -30 / sqrt(42 * 24)], [-96 / sqrt(168 * 96), -1], [0, -1]]),
        (
            "ncc",
            (3, 1),
            [[-1, INF], [-1, -22 / sqrt(21 * 24)], [-104 / sqrt(84 * 144), -1], [-160 / sqrt(144 * 192), -1]],
        ),
    ],
)
def test_by_hand(kind, window, expected):
    got = volume(kind, cost.pixels(LEFT, RIGHT), (0, 2), window)
    # The means of (1, 1, 2) and (2, 2, 4) are further apart than their levels: see ZNCC's precision below.
    np.testing.assert_allclose(got, [expected], rtol=0, atol=1.2e-5 if kind == "zncc" else 2e-6)


def test_pixels_keep_integers():
    left, right = images(0, (3, 4), np.uint8)
    pair = cost.pixels(left, right)
    assert pair.left.dtype == np.uint8
    assert pair.left.shape == (3, 4, 1)
    assert pair.step == 1
    wide = cost.pixels(left.astype(np.uint16) * 257, right.astype(np.uint16))
    assert wide.left.dtype == np.int32
    np.testing.assert_array_equal(wide.left[..., 0], left.astype(int) * 257)
    assert wide.step == 1


@pytest.mark.parametrize("scale", [2.0**-149, 1e-30, 1.0, 3.0, 3.4e38])
def test_float_pixels_become_21_bit_integers(scale):
    left = np.array([[0.0, 0.25, -1.0]], np.float32) * np.float32(scale)
    right = np.array([[0.5, -0.125, 0.75]], np.float32) * np.float32(scale)
    pair = cost.pixels(left, right)
    largest = max(abs(pair.left).max(), abs(pair.right).max())
    assert 2**20 <= largest <= 2**21
    for integers, image in ((pair.left, left), (pair.right, right)):
        np.testing.assert_allclose(
            integers[..., 0] * pair.step, image.astype(float), rtol=0, atol=pair.step / 2
        )


def test_float_images_of_zeros():
    zero = np.zeros((2, 3), np.float32)
    pair = cost.pixels(zero, zero)
    assert not pair.left.any()


@pytest.mark.parametrize("dtype", [np.uint8, np.int32])
def test_grey_is_rounded_as_opencv_rounds(dtype):
    rgb = np.array([[[255, 255, 255], [255, 0, 0], [0, 255, 0], [0, 0, 255], [1, 2, 3], [0, 0, 0]]], dtype)
    # 0.299 * 255 = 76.245, 0.587 * 255 = 149.685, 0.114 * 255 = 29.07, 0.299 + 1.174 + 0.342 = 1.815
    np.testing.assert_array_equal(cost.grey(rgb)[0, :, 0], [255, 76, 150, 29, 2, 0])
    assert cost.grey(rgb).dtype == dtype


@pytest.mark.parametrize("instructions", _core.instruction_sets())
@pytest.mark.parametrize("dtype", [np.uint8, np.int32])
def test_grey_of_any_width(dtype, instructions):
    for width in (*range(1, 70), 881):
        rgb = np.random.default_rng(width).integers(0, 256, (2, width, 3)).astype(dtype)
        found = np.empty((2, width, 1), dtype)
        _core.grey(rgb, found, 1, instructions)
        np.testing.assert_array_equal(found[..., 0], (rgb @ [9798, 19235, 3735] + 2**14) >> 15)


def test_grey_of_16_bits_and_of_fixed_point():
    rgb = np.array([[[65535] * 3, [2**21] * 3, [-(2**21)] * 3, [-1, -2, -3]]], np.int32)
    np.testing.assert_array_equal(cost.grey(rgb)[0, :, 0], [65535, 2**21, -(2**21), -2])


# ---- against the definition ----------------------------------------------------------------------


@some.composite
def problems(draw):
    height, width = draw(some.integers(1, 6)), draw(some.integers(1, 9))
    shape = (height, width, 3) if draw(some.booleans()) else (height, width)
    dtype = draw(some.sampled_from([np.uint8, np.uint16, np.float32]))
    left, right = images(
        draw(some.integers(0, 2**32)), shape, dtype, draw(some.sampled_from([1, 3, 256, 65536]))
    )
    first = draw(some.integers(-width - 1, width + 1))
    last = first + draw(some.integers(1, 2 * width + 2))
    window = draw(some.tuples(some.integers(1, 15), some.integers(1, 15)))
    return cost.pixels(left, right, draw(some.sampled_from(["grey", "separate"]))), (first, last), window


@every_kind
@given(problem=problems())
@settings(max_examples=40, deadline=None)
def test_any_problem(kind, problem):
    assert_is_definition(kind, *problem)


@every_kind
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("window", [(127, 127), (127, 2), (255, 1), (254, 3), (1, 255), (255, 255)])
def test_large_windows(kind, dtype, window):
    left, right = images(5, (2, 4, 3), dtype)
    assert_is_definition(kind, cost.pixels(left, right, "separate"), (-1, 2), window)


@every_kind
def test_windows_on_both_sides_of_the_32_bit_limit(kind):
    rng = np.random.default_rng(6)
    left, right = (rng.choice(np.array([0, 254, 255], np.uint8), (2, 5), p=[0.1, 0.3, 0.6]) for _ in range(2))
    for window in ((255, 129), (181, 182), (182, 182), (192, 172), (255, 130)):
        assert_is_definition(kind, cost.pixels(left, right), (-1, 2), window)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 3])
def test_the_largest_sums_do_not_overflow(dtype, channels):
    top = int(np.iinfo(dtype).max)
    black, white = (np.full((3, 4, channels), value, dtype) for value in (0, top))
    pair = cost.Pixels(*(image.astype(np.uint8 if top == 255 else np.int32) for image in (black, white)), 1.0)
    area = 255 * 255 * channels
    for one in (pair, cost.Pixels(pair.right, pair.left, 1.0)):
        for kind, expected in (("sad", area * top), ("ssd", area * top**2), ("zsad", 0), ("zncc", 0)):
            got = volume(kind, one, (0, 1), (255, 255))
            assert (got == expected).all(), kind
        without_means = volume("zssd", one, (0, 1), (255, 255))
        assert (without_means >= 0).all()
        assert (without_means <= 1e-12 * area * top**2).all()
    both_white = volume("ncc", cost.Pixels(pair.right, pair.right, 1.0), (0, 1), (255, 255))
    np.testing.assert_allclose(both_white, -1, rtol=1e-6)


def test_the_largest_fixed_point_sums_do_not_overflow():
    low, high = np.full((2, 3, 3), -(2**21), np.int32), np.full((2, 3, 3), 2**21, np.int32)
    pair = cost.Pixels(low, high, 1.0)
    area = 255 * 255 * 3
    assert (volume("sad", pair, (0, 1), (255, 255)) == area * 2**22).all()
    assert (volume("ssd", pair, (0, 1), (255, 255)) == area * 2**44).all()
    np.testing.assert_allclose(volume("ncc", pair, (0, 1), (255, 255)), 1, rtol=1e-6)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("channels", ["grey", "separate"])
def test_zsad_is_exact_to_float32_rounding(dtype, channels):
    left, right = images(8, (3, 7, 3), dtype)
    pair = cost.pixels(left, right, channels)
    expected = reference.volume("zsad", pair.left, pair.right, range(3), (6, 5))
    np.testing.assert_allclose(volume("zsad", pair, (0, 3), (6, 5)), expected, rtol=3e-7)


@every_kind
def test_a_window_that_differs_in_a_single_pixel(kind):
    """The smallest contrast there is, under the largest means: what cancels must cancel exactly."""
    for level in (3, 128, 254):
        left = np.full((9, 60), level, np.uint8)
        left[4, 30] += 1
        pair = cost.pixels(left, left)
        got = volume(kind, pair, (0, 1), (51, 9))[..., 0]
        expected = reference.volume(kind, left, left, range(1), (51, 9))[..., 0]
        np.testing.assert_allclose(got, expected, rtol=2e-5, atol=1e-6)


@every_kind
@pytest.mark.parametrize("threads", [2, 5, 0])
def test_threads_do_not_matter(kind, threads):
    pair = cost.pixels(*images(9, (13, 11), np.uint8))
    np.testing.assert_array_equal(
        volume(kind, pair, (-2, 5), (4, 5), threads), volume(kind, pair, (-2, 5), (4, 5))
    )


@pytest.mark.parametrize("window", [(13, 7), (22, 23), (31, 31)])
@pytest.mark.parametrize(
    ("left", "right"),
    [
        ((254, 255), (0, 1)),
        ((1, 0), (254, 253)),
        ((0, 2), (250, 255)),
        ((90, 96), (99, 140)),
        ((0, 255), (0, 255)),
    ],
)
def test_zncc_is_as_precise_as_documented(window, left, right):
    rng = np.random.default_rng(9)
    area = window[0] * window[1]
    rare = rng.random((3, 60)) < (0.05 if area > 514 else 0.01)
    pair = cost.pixels(*(np.where(rare, levels[1], levels[0]).astype(np.uint8) for levels in (left, right)))
    got = volume("zncc", pair, (0, 4), window).astype(np.float64)
    expected = reference.volume("zncc", pair.left, pair.right, range(4), window)
    lefts, rights = (reference.windows(image, window)[..., 0].astype(np.float64) for image in pair[:2])
    compared = 0
    for x in range(60):
        for d in range(min(4, x + 1)):
            one, other = lefts[:, x], rights[:, x - d]
            means = [each.mean(axis=(-2, -1)) for each in (one, other)]
            norms = [area * each.var(axis=(-2, -1)) for each in (one, other)]
            enough = (
                (norms[0] > area / 60) & (norms[1] > area / 60) if area > 514 else norms[0] * norms[1] > 0
            )
            share = area / np.sqrt(np.where(enough, norms[0] * norms[1], 1))
            least = 2.0**-18 * abs(means[0] - means[1]) * share + 6e-6
            if area > 514:
                least += 1e-7 * abs(means[0] - 128) * means[1] * share
            error = abs(got[:, x, d] - expected[:, x, d])
            assert (error <= np.where(enough, least, 2)).all(), (x, d, error, least)
            assert (error < 0.5).all() or not enough.all()
            compared += enough.sum()
    assert compared > 100


def test_fits_narrow():
    assert cost.fits_narrow((180, 180), 1)
    assert not cost.fits_narrow((182, 182), 1)
    assert cost.fits_narrow((104, 105), 3)
    assert not cost.fits_narrow((105, 105), 3)
