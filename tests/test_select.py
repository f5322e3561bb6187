import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from reference import select as reference
from stereopsis import select

FIELDS = ("index", "cost", "before", "after", "second")
WORST = np.iinfo(np.int64).max


def test_by_hand():
    # disparities -1, 0, 1 over three columns: the first and the last pixel each lose a candidate
    volume = np.array([[[7, 4, WORST], [5, 3, 3], [WORST, 2, 9]]], np.int64)
    left = select.left(volume, -1)
    np.testing.assert_array_equal(left.index, [[1, 1, 1]])
    np.testing.assert_array_equal(left.cost, [[4, 3, 2]])
    np.testing.assert_array_equal(left.before, [[7, 5, WORST]])
    np.testing.assert_array_equal(left.after, [[WORST, 3, 9]])
    np.testing.assert_array_equal(left.second, [[WORST, WORST, WORST]])
    # The right view sees, as (x, d): at 0 (0, 0) 4 and (1, 1) 3; at 1 (0, -1) 7, (1, 0) 3 and (2, 1) 9;
    # at 2 (1, -1) 5 and (2, 0) 2.
    np.testing.assert_array_equal(select.right(volume, -1), [[2, 1, 1]])


def test_the_second_is_not_next_to_the_winner():
    volume = np.array([[[5.0, 1.0, 2.0, 4.0, 3.0]] * 5], np.float32)
    np.testing.assert_array_equal(select.left(volume, 0).second[0, 4], 3)
    np.testing.assert_array_equal(select.left(volume, 0).index[0], [0, 1, 1, 1, 1])


def test_of_equal_costs_the_first_wins():
    volume = np.zeros((1, 6, 4), np.float32)
    assert (select.left(volume, 0).index == 0).all()
    np.testing.assert_array_equal(select.right(volume, 0), [[0] * 6])


def test_nothing_in_view():
    volume = np.full((2, 3, 2), np.inf, np.float32)
    assert (select.left(volume, 3).index == -1).all()
    assert np.isinf(select.left(volume, 3).cost).all()
    assert (select.right(volume, 3) == -1).all()


@given(
    shape=some.tuples(some.integers(1, 4), some.integers(1, 9), some.integers(1, 9)),
    first=some.integers(-12, 12),
    levels=some.sampled_from([1, 3, 1000]),
    dtype=some.sampled_from([np.int64, np.float32]),
    threads=some.integers(0, 5),
    seed=some.integers(0, 2**32),
)
@settings(max_examples=150, deadline=None)
def test_any_volume(shape, first, levels, dtype, threads, seed):
    volume = np.random.default_rng(seed).integers(-levels, levels, shape).astype(dtype)
    _, width, count = shape
    there = np.arange(width)[:, None] - first - np.arange(count)
    outside = (there < 0) | (there >= width)
    volume[:, outside] = np.inf if dtype == np.float32 else WORST
    got = select.left(volume, first, threads)
    for name, expected in zip(FIELDS, reference.left(volume, first), strict=True):
        np.testing.assert_array_equal(getattr(got, name), expected, err_msg=name)
        assert getattr(got, name).dtype == (np.int32 if name == "index" else dtype)
    np.testing.assert_array_equal(select.right(volume, first, threads), reference.right(volume, first))


@pytest.mark.parametrize("dtype", [np.int64, np.float32])
def test_winners_are_frozen(dtype):
    winners = select.left(np.zeros((1, 1, 1), dtype), 0)
    with pytest.raises(AttributeError):
        winners.index = None
