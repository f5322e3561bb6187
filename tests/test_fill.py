import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import stereopsis
from reference import fill as reference
from stereopsis import fill
from stereopsis.types import Flag

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


# ---- Hirschmueller's rules -----------------------------------------------------------------------


def test_interpolate_by_hand():
    disparity = float32([1, 2, 3], [4, N, 6], [7, 8, 9])
    clear, hidden = np.zeros((3, 3), np.uint8), np.full((3, 3), Flag.OCCLUDED, np.uint8)
    # of 1 2 3 4 6 7 8 9: the mean of 4 and 6; the second lowest
    assert fill.interpolate(disparity, clear)[1, 1] == 5
    assert fill.interpolate(disparity, hidden)[1, 1] == 2
    assert fill.interpolate(disparity, np.full((3, 3), Flag.OUT_OF_VIEW, np.uint8))[1, 1] == 2
    assert fill.interpolate(disparity, np.full((3, 3), Flag.MISMATCHED, np.uint8))[1, 1] == 5
    # one answer is both; none leaves a hole
    assert fill.interpolate(float32([N, N, 4]), np.full((1, 3), Flag.OCCLUDED, np.uint8)).tolist() == [
        [4, 4, 4]
    ]
    assert np.isnan(fill.interpolate(float32([N, N], [N, N]), clear[:2, :2])).all()
    # a knight's move away is no direction
    assert np.isnan(fill.interpolate(float32([N, N, 4], [N, N, N]), clear[:2])[1, 0])


@given(disparity=maps, seed=st.integers(0, 2**32))
@settings(deadline=None)
def test_interpolate_is_its_definition(disparity, seed):
    disparity = np.where(np.isfinite(disparity), disparity, N).astype(np.float32)
    flags = np.random.default_rng(seed).choice(np.array([0, 1, 2, 8, 32, 64], np.uint8), disparity.shape)
    filled = fill.interpolate(disparity, flags)
    np.testing.assert_array_equal(filled, reference.interpolate(disparity, flags & 33))


# ---- surfaces ------------------------------------------------------------------------------------


def test_a_slanted_plane_is_continued_through_its_holes():
    y, x = np.mgrid[:40, :60]
    plane = (10 + 0.25 * y + 0.125 * x).astype(np.float32)
    disparity = plane.copy()
    disparity[10:22, 15:35] = N
    image = np.zeros((40, 60, 1), np.uint8)
    flags = np.zeros(plane.shape, np.uint8)
    np.testing.assert_allclose(fill.surfaces(disparity, flags, image), plane, atol=0.02)
    # a row's neighbours alone would be off by what the plane rises
    assert np.abs(fill.background(disparity) - plane).max() > 1


def test_what_is_hidden_continues_the_surface_behind():
    disparity = np.full((20, 60), 10, np.float32)
    disparity[:, 30:] = 40
    disparity[:, 20:30] = N
    image = np.zeros((20, 60, 1), np.uint8)
    filled = fill.surfaces(disparity, np.full(disparity.shape, Flag.OCCLUDED, np.uint8), image)
    np.testing.assert_allclose(filled[:, 20:30], 10, atol=0.05)


@given(
    shape=st.tuples(st.integers(1, 14), st.integers(1, 20)),
    channels=st.sampled_from([1, 3]),
    invalid=st.sampled_from([0.1, 0.5, 0.9, 1]),
    scale=st.sampled_from([0.1, 1, 8]),
    threads=st.sampled_from([1, 3]),
    seed=st.integers(0, 2**32),
)
@settings(max_examples=60, deadline=None)
def test_surfaces_is_its_definition(shape, channels, invalid, scale, threads, seed):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]]
    # No whole numbers: four ends that agree within just the bound would be answered either way.
    disparity = (0.3 * y + 0.1 * x + scale * rng.normal(0, 2, shape) - 3).astype(np.float32)
    disparity[rng.random(shape) < invalid] = N
    flags = rng.choice(np.array([0, 1, 2, 32], np.uint8), shape)
    image = rng.integers(0, 40, (*shape, channels)).astype(np.uint8)
    before = disparity.copy()
    filled = fill.surfaces(disparity, flags, image, threads=threads)
    expected = reference.surfaces(disparity, flags & 33, image)
    np.testing.assert_allclose(filled, expected, atol=2e-3)
    np.testing.assert_array_equal(disparity, before)


def test_a_seam_goes_to_the_surface_that_looks_like_it():
    """A near square, 30, before a far wall, 5; two columns of either look are doubtful and filled as wall."""
    image = np.full((30, 40), 50, np.uint8)
    image[:, 15:] = 200
    disparity = np.where(image == 200, np.float32(30), np.float32(5))
    doubtful = np.zeros(image.shape, bool)
    doubtful[:, 13:17] = True
    disparity[doubtful] = 5
    expected = disparity.copy()
    expected[:, 15:17] = 30
    np.testing.assert_array_equal(fill.outlines(disparity, doubtful, image), expected)


def test_a_slanted_surface_has_no_outline():
    disparity = np.tile(np.arange(40, dtype=np.float32)[:, np.newaxis], (1, 30))
    doubtful = np.ones(disparity.shape, bool)
    np.testing.assert_array_equal(fill.outlines(disparity, doubtful, np.zeros((40, 30), np.uint8)), disparity)


def test_outlines_see_colours():
    """The surfaces are told apart by one channel alone, which hardly changes the grey level."""
    image = np.full((30, 40, 3), 100, np.uint8)
    image[:, 15:, 2] = 200
    disparity = np.where(image[..., 2] == 200, np.float32(30), np.float32(5))
    doubtful = np.zeros(disparity.shape, bool)
    doubtful[:, 13:17] = True
    disparity[doubtful] = 5
    expected = disparity.copy()
    expected[:, 15:17] = 30
    np.testing.assert_array_equal(fill.outlines(disparity, doubtful, image), expected)


def test_the_nearer_filling_stands_between_the_ends_of_its_hole():
    disparity = np.array([[9, 2, 2, 2, 2, 5, 3, 1], [1, 2, 3, 4, 5, 6, 7, 8]], np.float32)
    doubtful = np.array([[0, 1, 1, 1, 1, 0, 1, 1], [1, 1, 1, 1, 1, 1, 1, 1]], bool)
    again = np.array([[0, 12, 7, 4, N, 0, 9, 4], [9, 9, 9, 9, 9, 9, 9, 9]], np.float32)
    expected = np.array([[9, 9, 7, 5, 2, 5, 5, 5], [1, 2, 3, 4, 5, 6, 7, 8]], np.float32)
    np.testing.assert_array_equal(fill.nearer(disparity, doubtful, again), expected)


@given(
    shape=st.tuples(st.integers(1, 4), st.integers(1, 12)),
    share=st.sampled_from([0.3, 0.8, 1]),
    threads=st.sampled_from([1, 3]),
    seed=st.integers(0, 2**32),
)
@settings(max_examples=60, deadline=None)
def test_nearer_is_its_definition(shape, share, threads, seed):
    random = np.random.default_rng(seed)
    disparity, again = (random.integers(-9, 9, shape).astype(np.float32) / 2 for _ in range(2))
    for values in (disparity, again):
        values[random.random(shape) < 0.2] = N
    doubtful = random.random(shape) < share
    found = fill.nearer(disparity, doubtful, again, threads)
    np.testing.assert_array_equal(found, reference.nearer(disparity, doubtful, again))


@given(
    shape=st.tuples(st.integers(1, 20), st.integers(1, 30)),
    channels=st.sampled_from([(), (1,), (3,)]),
    far=st.sampled_from([3, 30]),
    share=st.sampled_from([0.1, 0.5, 0.9]),
    threads=st.sampled_from([1, 3]),
    seed=st.integers(0, 2**32),
)
@settings(max_examples=60, deadline=None)
def test_outlines_is_its_definition(shape, channels, far, share, threads, seed):
    random = np.random.default_rng(seed)
    blocks = random.integers(0, far, (5, 8)).repeat(4, axis=0).repeat(4, axis=1)[: shape[0], : shape[1]]
    disparity = (blocks + random.integers(0, 4, shape) / 4).astype(np.float32)
    disparity[random.random(shape) < 0.1] = np.nan
    doubtful = random.random(shape) < share
    image = random.integers(0, 60, (*shape, *channels), np.uint8)
    found = fill.outlines(disparity, doubtful, image, threads)
    np.testing.assert_array_equal(found, reference.outlines(disparity, doubtful, image))


def test_what_a_window_has_added_to_a_near_thing_is_given_back():
    """A near square with texture before a far wall with texture; the map has made it 2 columns wider."""
    random = np.random.default_rng(3)
    wall, thing = (random.integers(dark, dark + 40, (40, 60)).astype(np.uint8) for dark in (20, 180))
    right, left = wall.copy(), np.roll(wall, 2, axis=1)
    right[10:30, 20:40] = thing[10:30, 20:40]
    left[10:30, 30:50] = thing[10:30, 20:40]
    truth = np.full(left.shape, 2, np.float32)
    truth[10:30, 30:50] = 10
    fat = truth.copy()
    fat[10:30, 50:52] = 10
    found = fill.unfatten(fat, np.zeros(fat.shape, bool), (left, right), left)
    np.testing.assert_array_equal(found, truth)


def test_where_nothing_tells_a_thing_keeps_its_width():
    grey = np.full((20, 30), 90, np.uint8)
    disparity = np.full(grey.shape, 2, np.float32)
    disparity[5:15, 10:20] = 10
    doubtful = np.ones(grey.shape, bool)
    np.testing.assert_array_equal(fill.unfatten(disparity, doubtful, (grey, grey), grey), disparity)


@given(
    shape=st.tuples(st.integers(1, 20), st.integers(1, 30)),
    channels=st.sampled_from([(), (1,), (3,)]),
    far=st.sampled_from([2, 6, 30]),
    share=st.sampled_from([0, 0.5]),
    threads=st.sampled_from([1, 3]),
    seed=st.integers(0, 2**32),
)
@settings(max_examples=60, deadline=None)
def test_unfatten_is_its_definition(shape, channels, far, share, threads, seed):
    random = np.random.default_rng(seed)
    blocks = random.integers(0, far, (3, 4)).repeat(8, axis=0).repeat(8, axis=1)[: shape[0], : shape[1]]
    disparity = (blocks + random.integers(0, 4, shape) / 16).astype(np.float32)
    disparity[random.random(shape) < 0.05] = np.nan
    doubtful = random.random(shape) < share
    views = tuple(random.integers(0, 40, shape).astype(np.uint8) for _ in range(2))
    image = random.integers(0, 30, (*shape, *channels)).astype(np.uint8)
    before = disparity.copy()
    found = fill.unfatten(disparity, doubtful, views, image, threads)
    np.testing.assert_array_equal(found, reference.unfatten(disparity, doubtful, views, image))
    np.testing.assert_array_equal(disparity, before)


def test_what_leaves_its_match_is_flagged_or_refused():
    scene = stereopsis.scenes.street(320, 160, seed=4)
    common = {"cost": "census", "optimize": "sgm", "left_right": 1, "median": 3, "disparities": (0, 64)}

    def run(**more):
        return stereopsis.match(scene.left, scene.right, **common, **more)

    filled, decided = (run(fill="background", outlines=on) for on in (False, True))
    unfilled, refused = (run(outlines=on) for on in (False, True))
    moved = (decided.flags & Flag.FILLED > 0) & (filled.flags & Flag.FILLED == 0)
    assert 20 < moved.sum() < 0.02 * moved.size
    assert (decided.flags[moved] & Flag.MISMATCHED > 0).all()
    after, before = (np.abs(found.disparity - scene.disparity)[moved] for found in (decided, filled))
    assert np.nanmedian(after) < 1 < np.nanmedian(before)
    gone = np.isnan(refused.disparity) & np.isfinite(unfilled.disparity)
    assert 20 < gone.sum() < 0.02 * gone.size
    assert (refused.flags[gone] & Flag.MISMATCHED > 0).all()
    assert (refused.confidence[gone] == 0).all()
    assert not (refused.flags & Flag.FILLED).any()
