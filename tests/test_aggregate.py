import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from scipy import ndimage

from reference import aggregate as reference
from stereopsis import aggregate, cost
from stereopsis.types import Disparities


def test_by_hand():
    terms = np.array([[[1], [2], [3]], [[10], [20], [30]]], np.int64)
    np.testing.assert_array_equal(aggregate.box(terms, (2, 1))[..., 0], [[3, 5], [30, 50]])
    np.testing.assert_array_equal(aggregate.box(terms, (1, 2))[..., 0], [[11, 22, 33]])
    np.testing.assert_array_equal(aggregate.box(terms, (3, 2))[..., 0], [[66]])
    np.testing.assert_array_equal(aggregate.box(terms, (1, 1)), terms)


@given(
    rows=some.integers(1, 8),
    columns=some.integers(1, 8),
    count=some.integers(1, 5),
    window=some.tuples(some.integers(1, 15), some.integers(1, 15)),
    threads=some.integers(0, 9),
    seed=some.integers(0, 2**32),
)
@settings(max_examples=100, deadline=None)
def test_any_terms(rows, columns, count, window, threads, seed):
    shape = (rows + window[1] - 1, columns + window[0] - 1, count)
    terms = np.random.default_rng(seed).integers(-(2**44), 2**44, shape)
    np.testing.assert_array_equal(aggregate.box(terms, window, threads), reference.box(terms, window))


@pytest.mark.parametrize("window", [(127, 3), (2, 255), (255, 254)])
def test_large_windows(window):
    terms = np.random.default_rng(0).integers(-(2**44), 2**44, (window[1] + 2, window[0] + 1, 2))
    np.testing.assert_array_equal(aggregate.box(terms, window), reference.box(terms, window))


@pytest.mark.parametrize(
    "window", [(1, 1), (2, 2), (3, 3), (4, 3), (3, 4), (6, 1), (1, 8), (15, 14), (31, 31)]
)
def test_the_anchor_and_the_border_are_those_of_scipy(window):
    """An even window reaches one pixel further to the left and up, and the edge pixels repeat."""
    image = np.random.default_rng(1).integers(0, 256, (9, 12)).astype(np.uint8)
    ones = np.ones_like(image)
    disparities = Disparities(0, 1)
    # Products with ones: what is summed is the left image.
    terms = cost.terms("ncc", cost.pixels(image, ones), disparities, window)
    sums = aggregate.box(terms, window)[..., 0]
    mean = ndimage.uniform_filter(image.astype(np.float64), size=window[::-1], mode="nearest")
    np.testing.assert_allclose(sums / (window[0] * window[1]), mean, rtol=1e-12)


def test_an_even_window_reaches_one_further_left_and_up():
    image = np.zeros((7, 7), np.uint8)
    image[3, 3] = 1
    terms = cost.terms("ncc", cost.pixels(image, np.ones_like(image)), Disparities(0, 1), (4, 2))
    rows, columns = np.nonzero(aggregate.box(terms, (4, 2))[..., 0])
    assert (rows.min(), rows.max()) == (3, 4)
    assert (columns.min(), columns.max()) == (2, 5)
