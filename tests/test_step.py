"""Matching only some of the pixels, and only some of the candidates."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

import stereopsis as st
from reference import select as reference
from stereopsis import Flag, select
from stereopsis.types import Sampling

WINDOWS = (3, (5, 3), st.Gaussian(1), st.Bilateral(3), st.Cross(3, 50), st.Adaptive(3, 7, 9, 30))
every_window = pytest.mark.parametrize("window", WINDOWS, ids=str)
KEEP = ("costs", "right_disparity")


def noise(shape, seed=0):
    return np.random.default_rng(seed).integers(0, 256, shape).astype(np.uint8)


def shifted(disparity=4, shape=(9, 30)):
    wide = noise((shape[0], shape[1] + disparity))
    return wide[:, : shape[1]], wide[:, disparity:]


def test_by_hand():
    # Costs |l - r|; matched are columns 0, 2, 4 and candidates 0, 2.
    left = np.array([[10, 0, 20, 0, 30, 0]], np.uint8)
    right = np.array([[19, 0, 29, 0, 5, 0]], np.uint8)
    # At disparity 0 they cost 9, 9, 25; at 2 there is nothing, then |20 - 19|, |30 - 29|.
    result = st.match(
        *(left, right), disparities=(0, 4), cost=st.SAD(1), subpixel=None, step=2, disparity_step=2, keep=KEEP
    )
    none = np.iinfo(np.int64).max
    np.testing.assert_array_equal(result.stages["costs"], [[[9, none], [9, 1], [25, 1]]])
    # Column 1 is as far from 0 as from 2: the first answers.
    np.testing.assert_array_equal(result.disparity, [[0, 0, 2, 2, 2, 2]])
    # The right column 0 is met by left 0 at 0 and by left 2 at 2, which costs less; odd ones by nobody.
    np.testing.assert_array_equal(result.stages["right_disparity"], [[2, np.nan, 2, np.nan, 0, np.nan]])
    assert result.path == "composed"


def test_the_nearest_of_three():
    image = noise((7, 8))
    costs = st.match(image, image, disparities=(0, 3), cost=st.SAD(3), step=3, keep="costs").stages["costs"]
    assert costs.shape == (3, 3, 3)
    left = np.tile(np.arange(8, dtype=np.uint8) * 20, (7, 1))
    right = left.copy()
    # Only column 3 has its match elsewhere, which columns 2 and 4 then share.
    right[:, 3], right[:, 1] = 255, left[:, 3]
    found = st.match(left, right, disparities=(0, 3), cost=st.SAD(1), subpixel=None, step=3).disparity
    np.testing.assert_array_equal(found, np.tile([0, 0, 2, 2, 2, 0, 0, 0], (7, 1)))


@every_window
@pytest.mark.parametrize("kind", ["sad", "zsad", "zncc"])
@pytest.mark.parametrize("step", [2, 3, 50])
def test_what_is_matched_costs_what_it_always_does(window, kind, step):
    left, right = shifted()
    cost = st.settings.COSTS[kind](window)
    every = st.match(left, right, disparities=(-3, 9), cost=cost, keep=KEEP)
    some_ = st.match(left, right, disparities=(-3, 9), cost=cost, keep=KEEP, step=step)
    np.testing.assert_array_equal(some_.stages["costs"], every.stages["costs"][::step, ::step])
    for name in ("disparity", "confidence", "flags"):
        one, other = getattr(some_, name), getattr(every, name)
        assert one.shape == left.shape
        np.testing.assert_array_equal(one[::step, ::step], other[::step, ::step], err_msg=name)
    fewer = st.match(left, right, disparities=(-3, 9), cost=cost, keep=KEEP, disparity_step=step)
    np.testing.assert_array_equal(fewer.stages["costs"], every.stages["costs"][..., ::step])


@every_window
def test_candidates_keep_their_places_where_the_range_leaves_the_image(window):
    """-40, -37, ... has -28 and 8 in it, whatever part of it the 30 columns can see."""
    left, right = shifted(8)
    result = st.match(
        left, right, disparities=(-40, 40), cost=st.SAD(window), disparity_step=3, subpixel=None
    )
    assert (result.disparity[:, 10:] == 8).mean() > 0.9
    assert set(np.unique(result.disparity)) <= set(range(-40, 40, 3))


@every_window
def test_the_fit_spans_the_candidates_tried(window):
    """A ramp moved by 5 matches nowhere else: its squared differences at 4 and 6 are equal."""
    ramp = np.tile(np.arange(40) * 6, (9, 1)).astype(np.uint8)
    left, right = ramp[:, :35], ramp[:, 5:]
    result = st.match(left, right, disparities=(0, 12), cost=st.SSD(window), disparity_step=2)
    np.testing.assert_allclose(result.disparity[:, 15:25], 5, atol=1e-3)


@every_window
def test_the_checks_work_on_what_was_matched(window):
    left, right = shifted(6, (24, 60))
    checked = {"left_right": 0, "uniqueness": 5, "subpixel": None}
    result = st.match(
        left, right, disparities=(0, 16), cost=st.SAD(window), step=2, disparity_step=2, **checked
    )
    inside = result.disparity[:, 20:]
    assert np.isfinite(inside).mean() > 0.8
    assert (inside[np.isfinite(inside)] == 6).all()
    reasons = Flag.OCCLUDED | Flag.MISMATCHED | Flag.AMBIGUOUS
    assert (result.flags[np.isnan(result.disparity)] & reasons).all()
    assert result.confidence[np.isnan(result.disparity)].max(initial=0) == 0
    odd = st.match(left, right, disparities=(1, 16), cost=st.SAD(window), disparity_step=2, **checked)
    # 6 is not among the candidates: what noise matches instead, the right view does not confirm.
    assert np.isfinite(odd.disparity).mean() < 0.6


@every_window
def test_threads_do_not_matter(window):
    left, right = shifted(6, (41, 50))
    results = [
        st.match(
            left, right, disparities=(0, 16), cost=st.ZNCC(window), step=2, left_right=1, threads=threads
        )
        for threads in (1, 3)
    ]
    for name in ("disparity", "confidence", "flags"):
        np.testing.assert_array_equal(*(getattr(result, name) for result in results))


@given(
    height=some.integers(1, 3),
    width=some.integers(1, 12),
    count=some.integers(1, 6),
    first=some.integers(-12, 12),
    sampling=some.builds(Sampling, some.integers(1, 4), some.integers(1, 4)),
    dtype=some.sampled_from([np.int64, np.float32]),
    seed=some.integers(0, 2**32),
)
@settings(max_examples=150, deadline=None)
def test_winners_are_those_of_the_whole_volume(height, width, count, first, sampling, dtype, seed):
    """What is not matched, or not tried, costs more than everything else."""
    step, apart = sampling
    worst = np.iinfo(np.int64).max if dtype == np.int64 else np.inf
    span = (count - 1) * apart + 1
    there = np.arange(width)[:, None] - first - np.arange(span)
    volume = np.random.default_rng(seed).integers(0, 9, (height, width, span)).astype(dtype)
    volume[:, (there < 0) | (there >= width)] = worst
    few = np.ascontiguousarray(volume[::step, ::step, ::apart])
    whole = np.full_like(volume, 1000)
    whole[::step, ::step, ::apart] = few
    whole[:, (there < 0) | (there >= width)] = worst

    left = select.left(few, first, width=width, sampling=sampling)
    index, cost, *_ = (each[::step, ::step] for each in reference.left(whole, first))
    tried = cost < 1000
    np.testing.assert_array_equal(left.index[tried] * apart, index[tried])
    np.testing.assert_array_equal(left.index < 0, ~tried)
    np.testing.assert_array_equal(left.cost[tried], cost[tried])

    right = select.right(few, first, width=width, sampling=sampling)
    expected = reference.right(whole, first)[::step]
    rows, columns = np.nonzero(right >= 0)
    np.testing.assert_array_equal(right[rows, columns] * apart, expected[rows, columns])
    for y, x in zip(*np.nonzero(right < 0), strict=True):
        assert expected[y, x] < 0 or whole[y * step, x + first + expected[y, x], expected[y, x]] == 1000
