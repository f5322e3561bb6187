import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

import stereopsis as st
from reference import smooth as reference
from stereopsis import smooth

N = np.nan


def case(seed, shape, channels, invalid, dtype=np.uint8):
    rng = np.random.default_rng(seed)
    disparity = (rng.integers(-400, 400, shape) / 16).astype(np.float32)
    disparity[rng.random(shape) < invalid] = N
    return disparity, rng.integers(0, 60, (*shape, channels)).astype(dtype)


# ---- weighted median -----------------------------------------------------------------------------


def test_weighted_median_by_hand():
    disparity = np.array([[1, 2, 8, 9, 9]], np.float32)
    flat = np.zeros((1, 5, 1), np.uint8)
    # equal weights: the lower middle of 1 2; of 1 2 8; of 2 8 9; of 8 9 9; of 9 9 - windows of three
    assert smooth.weighted_median(disparity, flat, 3).tolist() == [[1, 2, 8, 9, 9]]
    # all five count for the middle one
    assert smooth.weighted_median(disparity, flat, 5)[0, 2] == 8
    # what looks different hardly counts: 255 against 1
    image = np.array([[0, 0, 0, 200, 200]], np.uint8)[..., None]
    assert smooth.weighted_median(disparity, image, 5)[0, 2] == 2
    assert smooth.weighted_median(disparity, flat, 1).tolist() == disparity.tolist()


def test_a_lone_wrong_pixel_goes_and_an_edge_stays():
    disparity = np.full((9, 12), 4, np.float32)
    disparity[:, 6:] = 20
    image = np.where(disparity > 10, 200, 20).astype(np.uint8)[..., None]
    noisy = disparity.copy()
    noisy[4, 3], noisy[2, 6] = 33, 1
    np.testing.assert_array_equal(smooth.weighted_median(noisy, image, 5), disparity)


@given(
    shape=some.tuples(some.integers(1, 9), some.integers(1, 40)),
    size=some.sampled_from([1, 3, 5, 11]),
    sigma=some.sampled_from([0.4, 3, 10, 1e6]),
    channels=some.sampled_from([1, 3]),
    invalid=some.sampled_from([0, 0.4, 1]),
    scale=some.sampled_from([0, 1, 1000]),
    threads=some.sampled_from([1, 3]),
    seed=some.integers(0, 2**32),
)
@settings(max_examples=80, deadline=None)
def test_weighted_median_is_its_definition(shape, size, sigma, channels, invalid, scale, threads, seed):
    disparity, image = case(seed, shape, channels, invalid)
    disparity *= np.float32(scale)
    before = disparity.copy()
    filtered = smooth.weighted_median(disparity, image, size, sigma, threads=threads)
    np.testing.assert_array_equal(filtered, reference.weighted_median(disparity, image, size, sigma))
    np.testing.assert_array_equal(disparity, before)


# ---- edge-aware ----------------------------------------------------------------------------------


def test_noise_on_a_slanted_plane_goes_and_its_slant_stays():
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:60, :80]
    plane = 5 + 0.3 * y + 0.1 * x
    noisy = (plane + rng.normal(0, 0.3, plane.shape)).astype(np.float32)
    noisy[20:24, 30:40] = N
    smoothed = smooth.edge_aware(noisy, np.zeros((60, 80, 1), np.uint8), 10)
    error = (smoothed - plane)[~np.isnan(noisy)]
    assert np.isnan(smoothed[20:24, 30:40]).all()
    assert error.std() < 0.15
    assert abs(error[:400].mean()) < 0.1


def test_nothing_flows_over_an_edge():
    disparity = np.full((8, 16), 4, np.float32)
    disparity[:, 8:] = 30
    image = np.where(disparity > 10, 255, 0).astype(np.uint8)[..., None]
    np.testing.assert_allclose(smooth.edge_aware(disparity, image, 100), disparity, atol=0.01)


@given(
    shape=some.tuples(some.integers(1, 12), some.integers(1, 21)),
    channels=some.sampled_from([1, 3]),
    strength=some.sampled_from([0, 0.5, 3, 100]),
    sigma=some.sampled_from([0.5, 5, 100]),
    iterations=some.sampled_from([1, 2, 3]),
    invalid=some.sampled_from([0, 0.4, 1]),
    dtype=some.sampled_from([np.uint8, np.int32]),
    threads=some.sampled_from([1, 3]),
    seed=some.integers(0, 2**32),
)
@settings(max_examples=80, deadline=None)
def test_edge_aware_is_its_definition(
    shape, channels, strength, sigma, iterations, invalid, dtype, threads, seed
):
    disparity, image = case(seed, shape, channels, invalid, dtype)
    smoothed = smooth.edge_aware(disparity, image, strength, sigma, iterations, threads=threads)
    expected = reference.edge_aware(disparity, image, strength, sigma, iterations)
    np.testing.assert_allclose(smoothed, expected, atol=2e-3)


@pytest.mark.parametrize("shape", [(37, 53), (16, 16), (1, 40), (40, 1)])
def test_threads_change_no_bit(shape):
    disparity, image = case(3, shape, 3, 0.3)
    for filtered in (
        lambda threads: smooth.edge_aware(disparity, image, threads=threads),
        lambda threads: smooth.weighted_median(disparity, image, 7, threads=threads),
    ):
        one = filtered(1)
        for threads in (2, 7):
            np.testing.assert_array_equal(filtered(threads), one)


@pytest.mark.parametrize("others", [{"fill": "surfaces"}, {"weighted_median": 7}, {"edge_aware": 3}])
def test_edges_are_the_same_in_pixels_of_more_bits(others):
    scene = st.scenes.street(300, 120, seed=2, gray=True)
    pixels = [image.copy() for image in (scene.left, scene.right)]
    for image in pixels:
        image[0, :2] = 0, 255
    found = {}
    for factor, dtype in ((1, np.uint8), (16, np.uint16), (256, np.uint16), (1, np.float32)):
        left, right = (image.astype(dtype) * dtype(factor) for image in pixels)
        result = st.match(left, right, disparities=(0, 32), cost=st.SAD(5), left_right=1.0, **others)
        found[factor, dtype] = result.disparity
    first, *rest = found.values()
    for other in rest:
        np.testing.assert_array_equal(other, first)
