"""Sub-pixel methods that work from the images, and what becomes of the phase."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

import stereopsis as st
from reference import subpixel as reference
from stereopsis import refine, upsample

N = np.nan
METHODS = ("symmetric", "correlation", "lucas-kanade", "lucas-kanade-affine")


def row(*values, dtype=np.uint8):
    return np.array([values], dtype)[..., None]


def only(shape, at, value):
    start = np.full(shape, N, np.float32)
    start[at] = value
    return start


def run(method, left, right, start, window, **options):
    match method:
        case "symmetric":
            return refine.symmetric(left, right, start, window, **options)
        case "correlation":
            return refine.correlation(left, right, start, window, **options)
        case "lucas-kanade":
            return refine.lucas_kanade(left, right, start, window, **options)
        case _:
            return refine.lucas_kanade_affine(left, right, start, window, **options)[0]


# ---- numbers worked by hand ----------------------------------------------------------------------


def test_correlation_by_hand():
    # Right windows of three: (4 0 8) at the match, (0 8 0) one to the right. The left one is three quarters
    # of the first and a quarter of the second: a = 60, 16; g = 80, 0, 64; t = 16 * 80 / (60 * 64 + 16 * 80).
    right = row(0, 5, 4, 0, 8, 0, 0)
    left = row(0, 0, 3, 2, 6, 0, 0)
    start = only((1, 7), (0, 3), 0)
    found = refine.correlation(left, right, start, (3, 1), centred=False)
    assert found[0, 3] == -0.25
    assert np.isnan(found[0, [0, 1, 2, 4, 5, 6]]).all()
    # An offset of 10 turns NCC away, and not ZNCC, for which the mixture is still the best.
    assert refine.correlation(left + np.uint8(10), right, start, (3, 1))[0, 3] == -0.25
    assert refine.correlation(left + np.uint8(10), right, start, (3, 1), centred=False)[0, 3] != -0.25


def test_symmetric_by_hand():
    # In half steps about 1.5, 2 and 2.5 the left line spans [1 3] [3 5] [5 7]; the right one, from 0.5 on,
    # [0 0] [0 2] [2 6] [6 8] [8 8]. Gaps sum to 7, 2, 0, 2 for candidates -1/2, 0, 1/2, 1.
    left, right = row(0, 0, 4, 8, 8), row(0, 0, 8, 8, 8)
    start = only((1, 5), (0, 2), 0)
    assert refine.symmetric(left, right, start, (1, 1), steps=2)[0, 2] == 0.5
    # From 1 on the same candidate is within reach.
    assert refine.symmetric(left, right, only((1, 5), (0, 2), 1), (1, 1), steps=2)[0, 2] == 0.5


def test_symmetric_wants_both_lines_alike():
    left, right = row(0, 0, 4, 8, 8, 3, 1), row(0, 0, 8, 8, 8, 2, 6)
    forth = refine.symmetric(left, right, only((1, 7), (0, 3), 0), (1, 1))
    back = refine.symmetric(right, left, only((1, 7), (0, 3), 0), (1, 1))
    # The same intervals meet in both directions; about one pixel of either image.
    assert np.isfinite(forth[0, 3])
    assert np.isfinite(back[0, 3])
    mirrored = refine.symmetric(left[:, ::-1], right[:, ::-1], only((1, 7), (0, 3), 0), (1, 1))
    assert abs(mirrored[0, 3]) <= 1


def test_lucas_kanade_by_hand():
    # A right parabola 16 x^2, which cubics reproduce; the left one lies a quarter further: 16 (x - 1/4)^2.
    x = np.arange(12)
    right = (16 * x**2).astype(np.int32)[None, :, None]
    left = ((4 * x - 1) ** 2).astype(np.int32)[None, :, None]
    found = refine.lucas_kanade(left, right, only((1, 12), (0, 6), 0), (5, 1))
    assert found[0, 6] == pytest.approx(0.25, abs=1e-5)


# ---- against the definitions ---------------------------------------------------------------------


@some.composite
def problems(draw, largest=255, around=2):
    rows, columns = draw(some.integers(1, 6)), draw(some.integers(1, 12))
    channels = draw(some.sampled_from([1, 3]))
    random = np.random.default_rng(draw(some.integers(0, 2**32 - 1)))
    dtype = np.uint8 if largest < 256 else np.int32
    left, right = (random.integers(0, largest + 1, (rows, columns, channels)).astype(dtype) for _ in range(2))
    start = np.full((rows, columns), N, np.float32)
    for y, x in np.ndindex(rows, columns):
        d = x - random.integers(0, columns)
        if random.random() < 0.8 and abs(d) < 2**20:
            start[y, x] = d
    window = draw(some.integers(1, 7)), draw(some.integers(1, 5))
    return left, right, start, window, draw(some.sampled_from([1, 3]))


@given(problems(), some.booleans())
@settings(deadline=None, max_examples=12)
def test_correlation_is_the_best_linear_interpolation(problem, centred):
    left, right, start, window, threads = problem
    found = refine.correlation(left, right, start, window, centred, threads)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(start))
    assert np.nanmax(np.abs(found - start), initial=0) <= 1
    known = np.argwhere(np.isfinite(start))
    for y, x in known[:4]:
        d = int(start[y, x])
        expected, best = reference.correlation_by_search(left, right, x, y, d, window, centred, 60)
        shift = d - float(found[y, x])
        t, to = abs(shift), -1 if shift < 0 else 1
        ends = [reference.window(right, x, y, window, -d + by) for by in (0, to)]
        target = reference.window(left, x, y, window)
        reached = reference.correlate(target, (1 - t) * ends[0] + t * ends[1], centred)
        assert reached >= best - 1e-6, (x, y, expected, found[y, x])


@pytest.mark.parametrize("largest", [255, 2**20])
@given(data=some.data())
@settings(deadline=None, max_examples=12)
def test_lucas_kanade_is_what_it_says(largest, data):
    left, right, start, window, threads = data.draw(problems(largest))
    offsets = np.random.default_rng(1).uniform(-0.49, 0.49, start.shape).astype(np.float32)
    start = start + offsets
    found = refine.lucas_kanade(left, right, start, window, threads)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(start))
    far = 0
    for y, x in np.argwhere(np.isfinite(start))[:6]:
        winner = np.floor(start[y, x] + 0.5)
        assert abs(found[y, x] - winner) <= 1
        if not 0 <= x - winner < left.shape[1]:
            continue
        # Where an iteration hangs by a hair's breadth, the two may part.
        expected = reference.lucas_kanade(left, right, x, y, float(start[y, x]), window)
        far += abs(found[y, x] - expected) > 1e-3
        target = reference.window(left, x, y, window)
        reached = [
            reference.correlate(target, reference.cubic(right, x, y, window, -float(d)))
            for d in (start[y, x], found[y, x])
        ]
        assert reached[1] >= reached[0] - 1e-6
    assert far <= 1


def smooth(rows, columns, seed, channels=1):
    """A right image, its left one under a plane, in float64: a few long waves."""
    random = np.random.default_rng(seed)
    waves = [
        (random.uniform(0.1, 0.7), random.uniform(-0.5, 0.5), random.uniform(0, 6, channels))
        for _ in range(6)
    ]

    def image(x, y):
        return sum(100 * np.sin(fx * x[..., None] + fy * y[..., None] + phase) for fx, fy, phase in waves)

    y, x = np.mgrid[:rows, :columns].astype(np.float64)
    return image, x, y


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("size", [(9, 7), (8, 6), (3, 9), (1, 1), (23, 3)])
def test_the_slanted_window_is_what_it_says(size, channels):
    image, x, y = smooth(11, 31, 3, channels)
    right = np.rint(1000 * image(x, y)).astype(np.int32)
    left = np.rint(1000 * image(x - 2.3 - 0.05 * (x - 15) + 0.1 * (y - 5), y)).astype(np.int32)
    start = np.full(x.shape, N, np.float32)
    places = [(5, 15), (0, 0), (10, 30), (4, 20), (6, 2)]
    for at in places:
        start[at] = np.float32(2.1)
    found, slopes = refine.lucas_kanade_affine(left, right, start, size)
    assert np.isnan(found).sum() == found.size - len(places)
    for at in places:
        expected = reference.lucas_kanade_affine(left, right, at[1], at[0], float(start[at]), size)
        np.testing.assert_allclose([found[at], *slopes[at]], expected, atol=2e-3)


@given(problems(), some.sampled_from([1, 2, 3, 4]))
@settings(deadline=None, max_examples=12)
def test_symmetric_is_what_it_says(problem, steps):
    left, right, start, window, threads = problem
    found = refine.symmetric(left, right, start, window, threads=threads, steps=steps)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(start))
    for y, x in np.argwhere(np.isfinite(start))[:3]:
        expected = reference.symmetric(left, right, x, y, int(start[y, x]), window, steps)
        assert found[y, x] == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("window", [(1, 1), (4, 3), (9, 5)])
def test_pixels_less_their_means(window):
    image = np.random.default_rng(0).integers(0, 256, (5, 7, 3)).astype(np.uint8)
    found = refine._centred(image, window)
    for y, x in np.ndindex(5, 7):
        mean = reference.window(image, x, y, window).mean(axis=(0, 1))
        np.testing.assert_allclose(found[y, x] / 16, image[y, x] - mean, atol=1 / 32)


@pytest.mark.parametrize("method", METHODS)
def test_bits_do_not_depend_on_threads(method):
    scene = st.scenes.plane(61, 23, 3, disparity=4.4, slant_x=0.04, slant_y=0.1, noise=3)
    start = np.rint(scene.disparity)
    start[::3, ::7] = N
    one, three, seven = (run(method, scene.left, scene.right, start, (9, 5), threads=n) for n in (1, 3, 7))
    assert one.tobytes() == three.tobytes() == seven.tobytes()


@pytest.mark.parametrize("method", METHODS)
def test_nothing_to_start_from(method):
    image = np.zeros((3, 5, 1), np.uint8)
    assert np.isnan(run(method, image, image, np.full((3, 5), N, np.float32), (3, 3))).all()


@pytest.mark.parametrize("method", METHODS)
def test_flat_images_leave_the_start(method):
    image = np.full((6, 9, 1), 77, np.uint8)
    start = np.zeros((6, 9), np.float32)
    found = run(method, image, image, start, (5, 3))
    # Of what costs the same, the middle of what is in view.
    ends = np.array([-0.5, 0, 0, 0, 0, 0, 0, 0, 0.5], np.float32)
    np.testing.assert_array_equal(found, start + (ends if method == "symmetric" else 0))


# ---- signals whose shift is known ----------------------------------------------------------------


@pytest.mark.parametrize("shift", [0.0, 0.1, 0.25, 0.4, 0.5, -0.3, -0.45])
@pytest.mark.parametrize("method", METHODS)
def test_a_band_limited_signal_is_found(method, shift):
    image, x, y = smooth(20, 60, 5)
    right, left = (np.rint(1000 * image(at, y)).astype(np.int32) for at in (x, x - 3 - shift))
    if method != "symmetric":  # which knows no gain
        left = 2 * left + 5000
    found = run(method, left, right, np.full(x.shape, 3, np.float32), (11, 7))[6:-6, 12:-12]
    np.testing.assert_allclose(found, 3 + shift, atol=0.02 if "lucas" in method else 0.08)


def test_a_straight_line_between_pixels_is_found_exactly():
    random = np.random.default_rng(2)
    right = 8 * random.integers(0, 32, (12, 40, 1))
    left = ((3 * np.roll(right, -1, axis=1) + 5 * right) // 8).astype(np.uint8)
    found = refine.correlation(left, right.astype(np.uint8), np.zeros((12, 40), np.float32), (5, 3))
    np.testing.assert_allclose(found[:, 5:-5], -3 / 8, atol=1e-6)


def test_slopes_are_found():
    scene = st.scenes.plane(120, 60, 1, disparity=6, slant_x=0.06, slant_y=-0.08, gray=True, dtype=np.float32)
    pair = [np.rint(1000 * image).astype(np.int32)[..., None] for image in (scene.left, scene.right)]
    inner = np.s_[12:-12, 20:-20]
    found, slopes = refine.lucas_kanade_affine(*pair, np.rint(scene.disparity), (21, 11))
    error = np.abs(found - scene.disparity)[inner]
    assert np.quantile(error, 0.98) < 0.03
    np.testing.assert_allclose(np.median(slopes[inner], axis=(0, 1)), [0.06, -0.08], atol=2e-3)
    level = refine.lucas_kanade(*pair, np.rint(scene.disparity), (21, 11))
    assert np.mean(error) < 0.3 * np.mean(np.abs(level - scene.disparity)[inner])


# ---- upsampling ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("how", "factor", "expected"),
    [
        ("nearest", 2, [0, 8, 8, 16, 16, 24, 24]),
        ("nearest", 4, [0, 0, 8, 8, 8, 8, 16, 16, 16, 16, 24, 24, 24]),
        ("area", 2, [0, 4, 8, 12, 16, 20, 24]),
        ("area", 4, [0, 0, 4, 8, 8, 8, 12, 16, 16, 16, 20, 24, 24]),
        ("linear", 4, [0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24]),
        # -1/16, 9/16, 9/16, -1/16
        ("cubic", 2, [0, 4, 8, 12, 16, 20, 24]),
    ],
)
def test_columns_between(how, factor, expected):
    fine = upsample.columns(row(0, 8, 16, 24), factor, how)
    if how == "cubic":  # (9 * (0 + 8) - (0 + 16)) / 16 = 3.5: rounds to even
        assert fine[0, :, 0].tolist() == [0, 4, 8, 12, 16, 20, 24]
    assert fine.dtype == np.uint8
    assert fine[0, :, 0].tolist() == expected


@pytest.mark.parametrize("how", upsample.INTERPOLATIONS)
def test_own_columns_stay_and_constants_too(how):
    image = np.random.default_rng(0).integers(0, 256, (3, 9, 3)).astype(np.uint8)
    fine = upsample.columns(image, 5, how)
    assert fine.shape == (3, 41, 3)
    np.testing.assert_array_equal(fine[:, ::5], image)
    flat = np.full((2, 6, 1), 201, np.int32)
    np.testing.assert_array_equal(upsample.columns(flat, 3, how), np.full((2, 16, 1), 201))
    assert upsample.columns(image[:, :1], 4, how).shape == (3, 1, 3)


def test_lanczos_follows_a_wave_best():
    x = np.arange(60)
    at = np.arange(4 * 59 + 1) / 4
    errors = {}
    for how in upsample.INTERPOLATIONS:
        fine = upsample.columns(np.rint(1e6 * np.sin(1.2 * x)).astype(np.int32)[None, :, None], 4, how)
        errors[how] = np.abs(fine[0, 40:-40, 0] - 1e6 * np.sin(1.2 * at)[40:-40]).mean()
    assert errors["lanczos"] < errors["cubic"] < errors["linear"] < errors["nearest"]


def test_clipped_where_bytes_end():
    fine = upsample.columns(row(0, 0, 255, 255, 0), 2, "cubic")
    assert fine[0, 5, 0] == 255
    assert fine[0, 1, 0] == 0
    assert upsample.columns(row(0, 0, 255, 255, 0, dtype=np.int32), 2, "cubic")[0, 1, 0] < 0


@pytest.mark.parametrize("how", upsample.INTERPOLATIONS)
def test_quarters_of_a_pixel_come_back(how):
    scene = st.scenes.plane(120, 30, 4, disparity=5.25)
    found = st.match(
        scene.left, scene.right, disparities=(0, 12), cost=st.ZNCC(9), subpixel=None, upsample=(4, how)
    )
    assert found.disparity.shape == (30, 120)
    assert not (found.disparity * 4 % 1).any()
    inner = found.disparity[6:-6, 16:-16]
    expected = 5.25 if how not in ("nearest", "area") else inner
    assert np.mean(inner == expected) > 0.9
    assert (np.abs(inner - 5.25) <= 0.51).mean() > 0.95


# ---- in the whole --------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_match_refines(method, dtype):
    scene = st.scenes.plane(120, 40, 2, disparity=6.3, slant_y=0.02, dtype=dtype)
    cost = st.ZNCC(11)
    whole = st.match(scene.left, scene.right, disparities=(0, 16), cost=cost, subpixel=None)
    found = st.match(scene.left, scene.right, disparities=(0, 16), cost=cost, subpixel=method, left_right=1)
    assert found.path == "streaming"
    assert "subpixel" in found.timings
    inner = np.s_[8:-8, 20:-20]
    error, before = (np.abs(map_ - scene.disparity)[inner] for map_ in (found.disparity, whole.disparity))
    assert np.nanmean(error) < 0.08 < np.mean(before)
    assert np.nanmax(np.abs(found.disparity - whole.disparity)) <= 1.5
    valid = np.isfinite(found.disparity)
    assert (found.flags[~valid] != 0).all()
    composed = st.match(
        scene.left,
        scene.right,
        disparities=(0, 16),
        cost=cost,
        subpixel=method,
        left_right=1,
        keep=("right_disparity",),
    )
    assert composed.path == "composed"
    np.testing.assert_array_equal(composed.disparity, found.disparity)


def test_a_window_of_its_own():
    scene = st.scenes.plane(90, 30, 2, disparity=6.3, slant_x=0.05)
    chosen = {"disparities": (0, 16), "cost": st.ZNCC(15), "subpixel": "lucas-kanade"}
    default = st.match(scene.left, scene.right, **chosen)
    same = st.match(scene.left, scene.right, **chosen, refine_window=(15, 5))
    other = st.match(scene.left, scene.right, **chosen, refine_window=7)
    np.testing.assert_array_equal(default.disparity, same.disparity)
    assert not np.array_equal(default.disparity, other.disparity)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"subpixel": "correlation", "cost": st.SSD(9)}, "subpixel must not be .*SSD.*ZNCC or NCC"),
        ({"subpixel": "lucas"}, "subpixel must be one of .*lucas-kanade-affine"),
        ({"refine_window": 300}, "window must be a whole number from 1 to 255"),
        ({"refine_window": "axb"}, "window must be"),
        ({"upsample": 4}, "upsample must be .*factor from 2 to 16"),
        ({"upsample": (1, "cubic")}, "upsample must be"),
        ({"upsample": (4, "cubik")}, "upsample must be .*lanczos"),
        ({"upsample": (4, "cubic"), "uniqueness": 5}, "uniqueness must be None with upsample"),
        ({"upsample": (4, "cubic"), "keep": ("costs",)}, "keep must not hold costs with upsample"),
        ({"upsample": (16, "cubic"), "cost": st.SAD(21)}, "upsample widens the window to 16 x 21"),
    ],
)
def test_settings_that_exclude_each_other(changes, message):
    with pytest.raises(ValueError, match=message):
        st.Settings().changed(**changes)


def test_settings_come_back():
    given = ("subpixel=lucas-kanade-affine", "refine_window=21x11", "upsample=4,cubic", "cost=zncc")
    made = st.Settings.make(assignments=given)
    assert (made.subpixel, made.refine_window, made.upsample) == (
        "lucas-kanade-affine",
        (21, 11),
        (4, "cubic"),
    )
    assert st.Settings.from_toml(made.to_toml()) == made
    assert made.changed(refine_window=None, upsample=None).upsample is None


# ---- the phase -----------------------------------------------------------------------------------


def test_locking_by_hand():
    disparity = np.array([[1.0, 2.0, 3.1, N], [4.25, 5.5, 6.75, 7.0]], np.float32)
    truth = np.array([[1.25, 2.25, 3.0, 4.0], [4.25, 9.0, N, 7.25]], np.float32)
    found = st.pixel_locking(disparity, truth, bins=4)
    np.testing.assert_array_equal(found.phase, [-0.375, -0.125, 0.125, 0.375])
    # phases 0, 0, 0.1 and 0 in the third; 0.25 in the last; -0.5 and -0.25 in the first two
    np.testing.assert_allclose(found.share, [1 / 7, 1 / 7, 4 / 7, 1 / 7])
    # true phases 0.25 (three with -0.25, one with 0) and 0 (0.1); 5.5 is too wrong to count
    np.testing.assert_allclose(found.bias, [N, N, 0.1, -0.1875], atol=1e-6)
    np.testing.assert_allclose(found.spread[3], np.sqrt(3 * 0.0625 / 4))
    assert found.strength == pytest.approx(0.5 * (3 * (1 / 4 - 1 / 7) + 4 / 7 - 1 / 4))
    assert found.swing == pytest.approx(0.2875, abs=1e-6)


def test_locking_of_whole_numbers_and_of_none():
    whole = st.pixel_locking(np.arange(12, dtype=np.float32).reshape(3, 4))
    assert whole.share[10] == 1
    assert whole.strength == pytest.approx(20 / 21)
    assert np.isnan(whole.swing)
    none = st.pixel_locking(np.full((2, 2), N, np.float32), np.ones((2, 2), np.float32))
    assert np.isnan(none.share).all()
    assert np.isnan(none.bias).all()


def test_locking_refuses():
    disparity = np.zeros((2, 3), np.float32)
    with pytest.raises(ValueError, match="bins"):
        st.pixel_locking(disparity, bins=1)
    with pytest.raises(ValueError, match="truth must have the shape"):
        st.pixel_locking(disparity, disparity.T)
    with pytest.raises(ValueError, match="mask must have the shape"):
        st.pixel_locking(disparity, mask=np.ones((1, 3), bool))


def test_refinement_takes_the_locking_away():
    scene = st.scenes.plane(240, 60, 2, disparity=3.0, slant_x=0.03, dtype=np.float32)
    chosen = {"disparities": (0, 14), "cost": st.ZNCC(9)}
    inner = np.zeros((60, 240), bool)
    inner[8:-8, 24:-24] = True
    swing, strength = {}, {}
    for method in (None, "parabola", "equiangular", "lucas-kanade-affine"):
        found = st.match(scene.left, scene.right, **chosen, subpixel=method)
        locking = st.pixel_locking(found.disparity, scene.disparity, inner)
        swing[method], strength[method] = locking.swing, locking.strength
    assert swing[None] > 0.7
    assert swing["lucas-kanade-affine"] < 0.02 < swing["parabola"] < swing["equiangular"] < 0.3
    assert strength["lucas-kanade-affine"] < strength[None]


# ---- how good it is ------------------------------------------------------------------------------


def test_four_fifths_of_a_street_within_a_quarter_pixel():
    """Of what both cameras see, without the sky, where the gradient stands out from the noise (0.76)."""
    scene = st.scenes.street(640, 290, seed=0, noise=2.0)
    chosen = {"disparities": (0, 64), "cost": st.ZNCC((25, 7)), "refine_window": (21, 9), "median": 5}
    within = {}
    for method in (None, "parabola", "lucas-kanade-affine"):
        found = st.match(scene.pair, **chosen, subpixel=method, keep=("texture",))
        textured = found.stages["texture"] >= 1
        judged = textured & ~scene.occluded & ~scene.sky
        assert judged.mean() > 0.5
        within[method] = np.mean(np.abs(found.disparity - scene.disparity)[judged] < 0.25)
    assert within[None] < within["parabola"] < 0.65
    assert within["lucas-kanade-affine"] >= 0.8


DATA = Path(os.environ.get("STEREOPSIS_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))


@pytest.mark.skipif(not (DATA / "drivingstereo").is_dir(), reason="needs the DrivingStereo pairs")
def test_a_fifth_more_within_a_quarter_pixel():
    """Over whole disparities at the same settings; the parabola gains less than a fifth."""
    within = {None: [], "parabola": [], "lucas-kanade": []}
    for sample in st.datasets.open(DATA / "drivingstereo"):
        for method, scores in within.items():
            found = st.match(sample.pair(), disparities=(0, 128), cost=st.ZNCC(31), subpixel=method)
            scores.append(st.evaluate(found.disparity, sample.truth(), sample.mask()).all.within_0_25)
    whole, parabola, iterated = (np.mean(scores) for scores in within.values())
    assert parabola < 1.2 * whole
    assert iterated > 1.35 * whole
