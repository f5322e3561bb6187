import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from scipy import ndimage

import stereopsis
from reference import refine as reference
from stereopsis import _core, _instructions, refine
from stereopsis.types import Disparities

N, NONE = np.nan, np.iinfo(np.int64).max


def costs(*values, dtype=np.int64):
    return tuple(np.array([[value]], dtype) for value in values)


# ---- sub-pixel -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "cost", "before", "after", "expected"),
    [
        # (d - 0.25)^2 at -1, 0, 1: 1.5625, 0.0625, 0.5625
        ("parabola", 1, 25, 9, 0.25),
        ("parabola", 0, 4, 4, 0),
        ("parabola", 0, 4, 0, 0.5),
        ("parabola", 0, 0, 4, -0.5),
        ("parabola", 7, 7, 7, 0),
        # |d - 0.25|: 1.25, 0.25, 0.75
        ("equiangular", 1, 5, 3, 0.25),
        ("equiangular", 1, 3, 5, -0.25),
        ("equiangular", 0, 4, 0, 0.5),
        ("equiangular", 7, 7, 7, 0),
        # at an end of the range, or out of view
        ("parabola", 1, NONE, 9, 0),
        ("equiangular", 1, 25, NONE, 0),
        ("parabola", NONE, NONE, NONE, 0),
        (None, 1, 25, 9, 0),
    ],
)
def test_subpixel_by_hand(kind, cost, before, after, expected):
    offset = refine.subpixel(kind, *costs(cost, before, after))
    assert offset.dtype == np.float32
    assert offset.item() == expected
    floats = [np.inf if value == NONE else value for value in (cost, before, after)]
    assert refine.subpixel(kind, *costs(*floats, dtype=np.float32)).item() == expected


@given(minimum=some.floats(-0.499, 0.499), scale=some.floats(0.001, 1e6))
def test_the_parabola_is_exact_on_parabolas(minimum, scale):
    d = np.array([0, -1, 1])
    offset = refine.subpixel("parabola", *costs(*(scale * (d - minimum) ** 2), dtype=np.float32))
    assert offset.item() == pytest.approx(minimum, abs=1e-5)


@given(minimum=some.floats(-0.499, 0.499), scale=some.floats(0.001, 1e6))
def test_the_equiangular_fit_is_exact_on_flanks_of_equal_slope(minimum, scale):
    d = np.array([0, -1, 1])
    offset = refine.subpixel("equiangular", *costs(*(scale * abs(d - minimum)), dtype=np.float32))
    assert offset.item() == pytest.approx(minimum, abs=1e-5)


# ---- confidence ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("perfect", "cost", "before", "after", "expected"),
    [
        (0, 0, 4, 6, 1),
        (0, 5, 5, 5, 0),
        (0, 1, 3, 5, 0.75),
        (0, 0, 0, 0, 0),
        # one neighbour stands for both
        (0, 1, NONE, 4, 0.75),
        (0, 1, 4, NONE, 0.75),
        (0, 1, NONE, NONE, 0),
        (0, NONE, NONE, NONE, 0),
    ],
)
def test_confidence_by_hand(perfect, cost, before, after, expected):
    got = refine.confidence(perfect, *costs(cost, before, after))
    assert got.dtype == np.float32
    assert got.item() == expected


def test_confidence_of_correlations():
    # neighbours at 0.5, the winner at 0.75: half of the way to 1
    assert refine.confidence(-1.0, *costs(-0.75, -0.5, -0.5, dtype=np.float32)).item() == 0.5
    # anticorrelated neighbours do not take it above 1
    assert refine.confidence(-1.0, *costs(-1.0000001, 0.5, 0.5, dtype=np.float32)).item() == 1
    assert refine.confidence(-1.0, *costs(-1, -1, -1, dtype=np.float32)).item() == 0


TRIPLES = some.lists(
    some.tuples(
        some.integers(0, 100),
        some.one_of(some.integers(0, 200), some.just(np.inf)),
        some.one_of(some.integers(0, 200), some.just(np.inf)),
    ),
    min_size=1,
    max_size=8,
)


@given(triples=TRIPLES, kind=some.sampled_from([None, "parabola", "equiangular"]), whole=some.booleans())
@settings(deadline=None)
def test_any_costs(triples, kind, whole):
    rows = [(cost, cost + before, cost + after) for cost, before, after in triples]
    if whole:
        arrays = [
            np.array([[min(v, NONE) if np.isfinite(v) else NONE for v in row]])
            for row in zip(*rows, strict=True)
        ]
        arrays = [array.astype(np.int64) for array in arrays]
    else:
        arrays = [np.array([row], np.float32) for row in zip(*rows, strict=True)]
    offsets, confidences = refine.subpixel(kind, *arrays), refine.confidence(0.0, *arrays)
    assert (abs(offsets) <= 0.5).all()
    assert ((confidences >= 0) & (confidences <= 1)).all()
    for i, row in enumerate(rows):
        assert offsets[0, i] == pytest.approx(reference.subpixel(kind, *row), abs=1e-6)
        assert confidences[0, i] == pytest.approx(reference.confidence(0.0, *row), abs=1e-6)


# ---- median --------------------------------------------------------------------------------------


def test_median_by_hand():
    disparity = np.array([[1, 9, 3], [N, 5, N], [7, 2, 8]], np.float32)
    expected = np.array(
        [
            [5, 4, 5],  # of 1 9 5; 1 9 3 5 -> (3 + 5) / 2; 9 3 5
            [N, 5, N],  # of 1 9 3 5 7 2 8
            [5, 6, 5],  # of 5 7 2; 5 7 2 8 -> (5 + 7) / 2; 5 2 8
        ],
        np.float32,
    )
    np.testing.assert_array_equal(refine.median(disparity, 3), expected)
    np.testing.assert_array_equal(refine.median(disparity, 1), disparity)


def test_median_of_nothing():
    disparity = np.full((3, 4), N, np.float32)
    assert np.isnan(refine.median(disparity, 5)).all()


@given(
    shape=some.tuples(some.integers(1, 9), some.integers(1, 9)),
    size=some.sampled_from([1, 3, 5, 7, 21, 255]),
    invalid=some.sampled_from([0, 0.2, 0.9]),
    threads=some.integers(0, 9),
    seed=some.integers(0, 2**32),
)
@settings(max_examples=100, deadline=None)
def test_median_of_any_map(shape, size, invalid, threads, seed):
    rng = np.random.default_rng(seed)
    disparity = (rng.integers(-40, 40, shape) / 3).astype(np.float32)
    disparity[rng.random(shape) < invalid] = N
    before = disparity.copy()
    filtered = refine.median(disparity, size, threads)
    np.testing.assert_allclose(filtered, reference.median(disparity, size), rtol=2e-7)
    np.testing.assert_array_equal(disparity, before)
    assert refine.median(disparity, size, threads, into=disparity) is disparity
    np.testing.assert_array_equal(disparity, filtered)


def test_median_into_what_has_gaps():
    disparity = np.zeros((4, 6), np.float32)
    with pytest.raises(ValueError, match="into must be contiguous"):
        refine.median(disparity[:, :3], 3, into=disparity[:, :3])


# ---- planar ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("instructions", _core.instruction_sets())
@given(
    shape=some.tuples(some.integers(1, 23), some.integers(1, 40)),
    window=some.tuples(some.integers(1, 40), some.integers(1, 30)),
    tolerance=some.sampled_from((0.5, 1.5, 4.0)),
    iterations=some.integers(1, 4),
    threads=some.sampled_from((1, 3)),
    seed=some.integers(0, 2**32 - 1),
)
@settings(deadline=None, max_examples=25)
def test_planar_is_its_definition_to_the_bit(
    instructions, shape, window, tolerance, iterations, threads, seed
):
    random = np.random.default_rng(seed)
    disparity = random.choice([0, 3, 40], shape) + random.normal(0, 1, shape)
    disparity[random.random(shape) < random.choice([0, 0.3])] = np.nan
    disparity = disparity.astype(np.float32)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(_instructions.ENVIRONMENT, instructions)
        smooth = refine.planar(disparity, window, threads, tolerance=tolerance, iterations=iterations)
    expected = reference.planar(disparity, window, tolerance, iterations)
    np.testing.assert_array_equal(smooth, expected)


def test_planes_stay_as_they_are_and_so_do_their_edges():
    y, x = np.mgrid[:60, :80].astype(np.float32)
    disparity = np.where(x < 40, 10 + 0.25 * y - 0.125 * x, 60 - 0.5 * y).astype(np.float32)
    smooth = refine.planar(disparity, (21, 21), iterations=8)
    np.testing.assert_allclose(smooth[5:-5, 5:-5], disparity[5:-5, 5:-5], atol=0.06)
    assert (abs(np.diff(smooth[:20], axis=1)[:, 39]) > 40).all()


def test_the_tolerance_of_narrow_images_is_less():
    """What stands a pixel before a wall is drawn into it in a large image, and stays in a small one."""
    assert [refine.planar_tolerance(columns) for columns in (160, 640, 4000)] == [0.375, 1.5, 1.5]
    wall = np.full((60, 160), 5, np.float32)
    wall[20:40, 40:60] = 6
    for columns, kept in ((160, True), (640, False)):
        smooth = refine.planar(wall, (49, 25), tolerance=refine.planar_tolerance(columns))
        assert (smooth[30, 50] > 5.9) == kept


def test_planar_takes_noise_off_a_slanted_surface():
    random = np.random.default_rng(1)
    y, _ = np.mgrid[:80, :120].astype(np.float32)
    surface = 20 + 0.3 * y
    disparity = (surface + random.normal(0, 0.5, surface.shape)).astype(np.float32)
    off = refine.planar(disparity, (25, 25)) - surface
    assert np.sqrt(np.mean(off[12:-12, 12:-12] ** 2)) < 0.12
    holes = disparity.copy()
    holes[10, 7:30] = np.nan
    assert (np.isnan(refine.planar(holes, (25, 25))) == np.isnan(holes)).all()


@pytest.mark.parametrize("instructions", _core.instruction_sets())
@given(
    shape=some.tuples(some.integers(1, 12), some.integers(1, 80)),
    span=some.sampled_from([1, 3, 30]),
    share=some.sampled_from([0, 0.3]),
    contrast=some.sampled_from([20, 255]),
    threads=some.sampled_from([1, 3]),
    seed=some.integers(0, 2**32),
)
@settings(max_examples=60, deadline=None)
def test_photometric_is_its_definition(instructions, shape, span, share, contrast, threads, seed):
    random = np.random.default_rng(seed)
    disparity = (random.random(shape) * span).astype(np.float32)
    disparity[random.random(shape) < share / 2] = np.nan
    doubtful = (random.random(shape) < share).astype(np.uint8)
    views = tuple(random.integers(0, contrast, shape).astype(np.uint8) for _ in range(2))
    before = disparity.copy()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(_instructions.ENVIRONMENT, instructions)
        found = refine.photometric(disparity, doubtful, views, Disparities(0, span + 1), threads)
    np.testing.assert_array_equal(found, reference.photometric(disparity, doubtful, views, 0, span))
    np.testing.assert_array_equal(disparity, before)


def test_a_wall_that_faces_the_camera_is_where_it_is():
    """Sums over paths prefer whole disparities; what the images show does not."""
    random = np.random.default_rng(4)
    texture = ndimage.gaussian_filter(random.normal(size=(120, 400)), 1.2)
    texture = 110 + 30 * texture / texture.std()
    shifted = ndimage.shift(texture, (0, 0.4), order=5)

    def off(gain=1.0, **more):
        left, right = (
            np.clip(np.rint(image + random.normal(size=image.shape)), 0, 255).astype(np.uint8)[
                :, lead : lead + 300
            ]
            for image, lead in ((shifted, 30), (gain * texture, 50))
        )
        found = stereopsis.match(left, right, disparities=(0, 40), preset="balanced", **more)
        return np.nanmedian(found.disparity[10:-10, 60:-10]) - 20.4

    assert abs(off()) < 0.08
    assert abs(off(gain=0.6)) < 0.08
    assert abs(off(gain=1.25)) < 0.08
    assert abs(off(photometric=False)) > 0.2
