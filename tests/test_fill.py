import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from reference import fill as reference
from stereopsis import fill

N = np.nan

maps = hnp.arrays(
    st.sampled_from([np.float32, np.float64]),
    hnp.array_shapes(min_dims=2, max_dims=2, min_side=0, max_side=9),
    elements=st.one_of(st.just(N), st.sampled_from([np.inf, -np.inf]), st.integers(-8, 8).map(float)),
)


def float32(*rows):
    return np.array(rows, np.float32)


@pytest.mark.parametrize(
    ("holes", "expected"),
    [
        # between two answers: the farther one, whichever side it is on
        (float32([5, N, N, 3]), float32([5, 3, 3, 3])),
        (float32([3, N, N, 5]), float32([3, 3, 3, 5])),
        # at the ends: the nearest
        (float32([N, N, 4, N, 7, N]), float32([4, 4, 4, 4, 7, 7])),
        # negative disparities are answers too
        (float32([-2, N, 1]), float32([-2, -2, 1])),
        # infinities are holes of either sign
        (float32([np.inf, 2, -np.inf, 6]), float32([2, 2, 2, 6])),
        # rows above and below copy the nearest answered row, once that has been filled
        (float32([N, N], [N, 3], [4, 5], [N, N], [N, N]), float32([3, 3], [3, 3], [4, 5], [4, 5], [4, 5])),
        # a row without any answer between answered rows stays
        (float32([1, N], [N, N], [N, 2]), float32([1, 1], [N, N], [2, 2])),
        (float32([N, N], [N, N]), float32([N, N], [N, N])),
        (float32([8]), float32([8])),
    ],
)
def test_background_by_hand(holes, expected):
    np.testing.assert_array_equal(fill.background(holes), expected)


@given(maps)
def test_background_is_its_definition(disparity):
    before = disparity.copy()
    filled = fill.background(disparity)
    np.testing.assert_array_equal(filled, reference.background(disparity))
    np.testing.assert_array_equal(disparity, before)
    assert filled.dtype == disparity.dtype
    assert not np.shares_memory(filled, disparity)


@given(maps)
def test_background_keeps_answers_and_is_settled_at_once(disparity):
    filled = fill.background(disparity)
    answered = np.isfinite(disparity)
    np.testing.assert_array_equal(filled[answered], disparity[answered])
    np.testing.assert_array_equal(fill.background(filled), filled)


def test_background_takes_any_stride_and_read_only():
    disparity = np.full((6, 8), N, np.float32)
    disparity[2, 3] = 5
    disparity.setflags(write=False)
    np.testing.assert_array_equal(
        fill.background(disparity[::-2, 1::2]), reference.background(disparity[::-2, 1::2])
    )


@pytest.mark.parametrize(
    ("bad", "error", "says"),
    [
        ([[1.0]], TypeError, "disparity must be an array, not list"),
        (np.zeros((2, 2), np.uint16), TypeError, "disparity must be float32 or float64, not uint16"),
        (
            np.zeros((2, 2, 1), np.float32),
            ValueError,
            r"disparity must be \(H, W\), not of shape \(2, 2, 1\)",
        ),
    ],
)
def test_background_refuses(bad, error, says):
    with pytest.raises(error, match=says):
        fill.background(bad)
