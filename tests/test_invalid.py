"""Sky, want of texture and reflections: found where they are, and nowhere else."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from hypothesis.extra import numpy as arrays

import stereopsis as st
from reference import sky as reference
from stereopsis import _core, noise, pipeline, sky, validate
from stereopsis.settings import PRESETS

SEEDS = some.integers(0, 2**32 - 1)
N = np.nan


def flood(relief):
    level = np.empty(relief.shape, np.uint8)
    _core.flood(np.ascontiguousarray(relief), level)
    return level


def rates(found, truth):
    both = (found & truth).sum()
    return both / found.sum(), both / truth.sum()


@pytest.fixture(scope="module")
def street():
    return st.scenes.street()


# ---- the flood -----------------------------------------------------------------------------------


def test_flood_by_hand():
    relief = np.array(
        [
            [1, 9, 2, 2],
            [0, 9, 7, 3],
            [5, 0, 0, 9],
            [9, 9, 9, 0],
        ],
        np.uint8,
    )
    # Down the first column the water passes over 5, not over the 7; the last corner lies behind a 9.
    expected = [[1, 9, 2, 2], [1, 9, 7, 3], [5, 5, 5, 9], [9, 9, 9, 9]]
    np.testing.assert_array_equal(flood(relief), expected)


@given(shape=some.tuples(some.integers(1, 8), some.integers(1, 8)), seed=SEEDS)
@settings(max_examples=80, deadline=None)
def test_flood_of_any_relief(shape, seed):
    relief = np.random.default_rng(seed).choice([0, 1, 2, 3, 200, 255], shape).astype(np.uint8)
    np.testing.assert_array_equal(flood(relief), reference.flood(relief))


@given(
    shape=some.tuples(some.integers(1, 9), some.integers(1, 9)),
    share=some.floats(0, 1),
    least=some.sampled_from([0.0, 0.4, 0.5, 1.0]),
    others=some.booleans(),
    seed=SEEDS,
)
@settings(max_examples=120, deadline=None)
def test_regions_of_any_mask(shape, share, least, others, seed):
    rng = np.random.default_rng(seed)
    inside, marked = rng.random(shape) < share, rng.random(shape) < 0.5
    kept = np.empty(shape, bool)
    _core.keep_regions(inside.view(np.uint8), marked.view(np.uint8), least, others, kept.view(np.uint8))
    region, count = reference.label(inside)
    more = [marked[region == k].sum() > least * (region == k).sum() for k in range(count + 1)]
    np.testing.assert_array_equal(kept, inside & (np.array(more)[region] != others))


def test_the_core_refuses_another_shape():
    with pytest.raises(ValueError, match="shape"):
        _core.flood(np.zeros((2, 3), np.uint8), np.empty((3, 2), np.uint8))
    with pytest.raises(ValueError, match="shape"):
        _core.keep_regions(
            np.zeros((2, 3), np.uint8), np.zeros((2, 3), np.uint8), 0.5, True, np.empty((3, 2), np.uint8)
        )
    with pytest.raises(ValueError, match="inside the image"):
        _core.noise_means(np.zeros((9, 9, 1), np.float32), 4, 4, np.empty((2, 1, 1)), 1)


# ---- noise ---------------------------------------------------------------------------------------


def test_noise_by_hand():
    image = np.zeros((3, 3), np.uint8)
    image[1, 1] = 3
    assert noise.deviation(image) == pytest.approx(np.sqrt(np.pi / 2) / 6 * 12)


def test_ramps_are_no_noise():
    y, x = np.mgrid[:40, :50]
    assert noise.deviation(3 * x + 2 * y) == 0


@pytest.mark.parametrize("sigma", [1, 5, 20])
@pytest.mark.parametrize("channels", [(), (3,)])
def test_noise_is_measured(sigma, channels):
    image = 128 + np.random.default_rng(1).normal(0, sigma, (200, 300, *channels))
    # The quiet fifth of the blocks lies a little under the mean.
    assert 0.9 * sigma < noise.deviation(image.astype(np.float32)) < sigma


def test_saturated_blocks_tell_nothing_of_noise():
    image = 128 + np.random.default_rng(1).normal(0, 5, (200, 300))
    image[:100] = 255
    assert 4.4 < noise.deviation(image) < 5


@given(
    shape=some.tuples(some.integers(1, 40), some.integers(1, 40), some.sampled_from([1, 3])),
    dtype=some.sampled_from([np.uint8, np.uint16, np.float32]),
    seed=SEEDS,
)
@settings(max_examples=30, deadline=None)
def test_noise_of_any_image(shape, dtype, seed):
    image = np.random.default_rng(seed).integers(0, 256, shape).astype(dtype)
    assert noise.deviation(image) == pytest.approx(reference.deviation(image), rel=1e-5, abs=1e-9)
    assert noise.deviation(image, threads=3) == noise.deviation(image, threads=1)


# ---- sky -----------------------------------------------------------------------------------------


@given(
    shape=some.tuples(some.sampled_from([1, 3]), some.integers(1, 40), some.integers(1, 9)),
    calm=some.sampled_from([0.0, 0.5, 20.0]),
    unit=some.sampled_from([0.1, 0.7, 40.0]),
    threads=some.integers(1, 5),
    instructions=some.sampled_from(_core.instruction_sets()),
    seed=SEEDS,
)
@settings(max_examples=60, deadline=None)
def test_relief_of_any_image(shape, calm, unit, threads, instructions, seed):
    planes = np.random.default_rng(seed).uniform(-30, 30, shape).astype(np.float32)
    relief = np.empty(shape[1:], np.uint8)
    _core.relief(planes, calm, unit, relief, threads, instructions)
    exact = np.clip(reference.relief(planes, calm, unit), 0, 255)
    assert np.abs(relief - exact).max() <= 0.5 + 1e-3
    alone = np.empty_like(relief)
    _core.relief(planes, calm, unit, alone, 1, "generic")
    np.testing.assert_array_equal(relief, alone)


def test_relief_is_as_many_threads_found_it():
    planes = np.random.default_rng(8).uniform(0, 1, (3, 300, 400)).astype(np.float32)
    found = [np.empty((300, 400), np.uint8) for _ in range(3)]
    for relief, threads in zip(found, (1, 2, 7), strict=True):
        _core.relief(planes, 0.01, 0.002, relief, threads, "")
    assert np.ptp(found[0]) > 80
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])


def test_relief_refuses_what_does_not_fit():
    with pytest.raises(ValueError, match="shape"):
        _core.relief(np.zeros((1, 2, 3), np.float32), 0.0, 1.0, np.empty((3, 2), np.uint8), 1, "")
    with pytest.raises(ValueError, match="unit"):
        _core.relief(np.zeros((1, 2, 3), np.float32), 0.0, 0.0, np.empty((2, 3), np.uint8), 1, "")


def test_the_sky_of_a_clear_street(street):
    result = st.match(street.pair, preset="fast", disparities=(0, 128), sky=True)
    found = (result.flags & st.Flag.SKY) != 0
    precision, recall = rates(found, street.sky)
    assert precision > 0.97
    assert recall > 0.97
    assert np.isnan(result.disparity[found]).all()
    assert not result.confidence[found].any()
    assert list(result.timings)[-1] == "sky"


def test_the_sky_by_the_left_image_alone(street):
    precision, recall = rates(sky.mask(street.left), street.sky)
    assert precision > 0.9
    assert recall > 0.9


@pytest.mark.parametrize("option", [{"noise": 6.0}, {"low_light": 0.7}, {"rain": 0.5}, {"seed": 3}])
def test_the_sky_in_bad_conditions(option):
    scene = st.scenes.street(440, 200, samples=1, **option)
    result = st.match(scene.pair, preset="fast", disparities=(0, 64), sky=True)
    precision, recall = rates((result.flags & st.Flag.SKY) != 0, scene.sky)
    assert precision > 0.85
    assert recall > 0.9


def test_walls_are_told_from_the_sky_by_their_matches():
    image = np.random.default_rng(4).integers(0, 120, (60, 90)).astype(np.uint8)
    image[:40, :40] = 200
    image[:40, 50:] = 200
    near = np.full(image.shape, 2, np.float32)
    near[:40, :40] = N
    near[:40, 50:] = 30
    alone, told = sky.mask(image), sky.mask(image, near)
    assert alone[5:35, 5:35].all()
    assert alone[5:35, 55:85].all()
    assert told[5:35, 5:35].all()
    assert not told[:, 45:].any()
    assert not alone[44:].any()
    np.testing.assert_array_equal(sky.mask(image, np.full_like(near, N)), alone)


def test_the_sky_over_open_ground(street):
    result = st.match(street.pair, preset="accurate", disparities=(0, 128))
    assert result.settings.sky == "auto"
    found = (result.flags & st.Flag.SKY) != 0
    precision, recall = rates(found, street.sky)
    assert precision > 0.97
    assert recall > 0.9
    # Answered as everything is: infinitely far, and not by a measurement.
    assert not result.disparity[found].any()
    assert not result.confidence[found].any()
    assert ((result.flags[found] & st.Flag.FILLED) != 0).all()
    assert np.isfinite(result.disparity).all()
    plain = st.match(street.pair, preset="accurate", disparities=(0, 128), sky=False)
    assert not (plain.flags & st.Flag.SKY).any()
    assert plain.disparity[found].any()


def test_the_sky_is_as_far_as_the_range_goes(street):
    result = st.match(street.pair, preset="accurate", disparities=(3, 128))
    found = (result.flags & st.Flag.SKY) != 0
    assert found.any()
    assert (result.disparity[found] == 3).all()
    below = st.match(street.pair, preset="fast", disparities=(-8, 128), sky="auto", fill="background")
    found = (below.flags & st.Flag.SKY) != 0
    assert found.any()
    assert not below.disparity[found].any()


def test_infinity_is_where_the_calibration_has_it(street):
    """Of cameras whose principal points lie 30 columns apart."""
    plain = st.match(street.pair, preset="balanced", disparities=(0, 100))
    columns = np.s_[:, 30:], np.s_[:, :-30]
    left, right = (
        np.ascontiguousarray(image[at])
        for image, at in zip((street.left, street.right), columns, strict=True)
    )
    calibration = dataclasses.replace(street.pair.calibration, doffs=30.0)
    found = st.match(st.Pair(left, right, calibration), preset="balanced", disparities=(-30, 70))
    sky = (found.flags & st.Flag.SKY) != 0
    assert (found.disparity[sky] == -30).all()
    precision, recall = rates(sky, (plain.flags[:, 30:] & st.Flag.SKY) != 0)
    assert precision > 0.97
    assert recall > 0.97
    away = street.disparity[:, 30:] < 60
    assert np.median(np.abs(found.disparity + 30 - plain.disparity[:, 30:])[away]) < 0.1


def test_unfilled_the_sky_stays_without_answer(street):
    result = st.match(street.pair, preset="fast", disparities=(0, 128), sky="auto")
    found = (result.flags & st.Flag.SKY) != 0
    precision, recall = rates(found, street.sky)
    assert precision > 0.97
    assert recall > 0.9
    assert np.isnan(result.disparity[found]).all()


@pytest.mark.parametrize("farthest", [2.0, 30.0])
def test_a_bright_wall_behind_a_floor_is_no_sky(farthest):
    height, width = 120, 160
    rng = np.random.default_rng(9)
    image = rng.integers(0, 120, (height, width)).astype(np.uint8)
    image[:50] = 220
    ground = np.maximum(0.8 * (np.arange(height, dtype=np.float32) - 50), 0) + 0.5
    disparity = np.repeat(np.maximum(ground, farthest)[:, None], width, axis=1)
    disparity[:50] = np.nan
    chosen = PRESETS["accurate"]
    shown = pipeline._sky(image, disparity, chosen)
    if farthest < 8:
        assert len(shown) >= 45
        assert shown[:45].all()
        assert not shown[56:].any()
    else:
        assert not shown.any()
    assert pipeline._sky(image, disparity, chosen.changed(sky=True))[:45].all()


@pytest.mark.parametrize("rough", [0, 20])
def test_bright_trees_before_a_dark_sky_are_no_sky(rough):
    """Far enough to be taken for it; but they have structure, which was matched."""
    height, width = 160, 240
    rng = np.random.default_rng(9)
    image = rng.integers(20, 60, (height, width)).astype(np.uint8)
    image[:60] = 200 + np.kron(rng.integers(-rough, rough + 1, (10, 40)), np.ones((6, 6), int))
    disparity = np.full((height, width), 9, np.float32)
    disparity[70:90] = 1
    disparity[:, ::3] = np.nan
    shown = sky.mask(image, disparity, far=12.0)
    assert shown[:55].all() == (rough == 0)
    assert shown.any() == (rough == 0)


@pytest.mark.parametrize("least", [0, -20])
def test_a_bright_wall_near_0_is_no_sky_where_cameras_may_be_turned_to_each_other(least):
    """A wall at 5: the sky of a view that begins at 0; 25 from infinity where the range begins at -20."""
    height, width = 160, 240
    rng = np.random.default_rng(9)
    left = rng.integers(0, 120, (height, width)).astype(np.uint8)
    left[:60] = rng.integers(215, 225, (60, width))
    disparity = 5 + np.maximum(np.arange(height) - 60, 0) * 2 // 5
    right = np.stack([np.roll(row, -shift) for row, shift in zip(left, disparity, strict=True)])
    found = st.match(left, right, preset="balanced", disparities=(least, 64), slant="road", vertical=None)
    assert (found.flags[:55] & st.Flag.SKY).any() == (least == 0)
    assert not (found.flags[70:] & st.Flag.SKY).any()


@pytest.mark.parametrize("preset", ["balanced", "accurate"])
@pytest.mark.parametrize("first", [0, 330])
def test_a_white_lorry_before_the_sky_is_no_sky(street, preset, first):
    near, rows, columns = 40, 150, 260
    rng = np.random.default_rng(3)
    left, right = street.left.copy(), street.right.copy()
    body = 250 + rng.normal(0, 1, (rows, columns, 3))
    seen = slice(max(0, near - first), columns)
    left[:rows, first : first + columns] = np.clip(body, 0, 255)
    there = np.clip(body + rng.normal(0, 1.4, body.shape), 0, 255)[:, seen]
    right[:rows, first + seen.start - near : first + columns - near] = there
    result = st.match(left, right, preset=preset, disparities=(0, 128))
    inside = np.s_[5 : rows - 5, first + 5 : first + columns - 5]
    assert not (result.flags[inside] & st.Flag.SKY).any()
    assert (np.abs(result.disparity[inside] - near) < 3).mean() > 0.99
    assert (result.flags[:100] & st.Flag.SKY).any()


def test_without_ground_there_is_no_open_view():
    image = np.random.default_rng(4).integers(0, 120, (60, 90)).astype(np.uint8)
    image[:30] = 200
    for disparity in (np.full(image.shape, N, np.float32), np.full(image.shape, 2, np.float32)):
        assert not pipeline._sky(image, disparity, PRESETS["accurate"]).any()
        assert pipeline._sky(image, disparity, PRESETS["accurate"].changed(sky=True)).any()


def test_far_matches_say_nothing_against_the_sky():
    image = np.full((60, 90), 60, np.uint8)
    image[:40] = 200
    far = np.full(image.shape, 12, np.float32)
    far[:40] = 13
    assert sky.mask(image, far)[:38].all()


@pytest.mark.parametrize("value", [0, 7, 255])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_a_constant_image_has_no_sky(value, dtype):
    image = np.full((20, 30, 3), value, dtype)
    assert not sky.mask(image).any()
    result = st.match(image, image, disparities=(0, 4), cost=st.SAD(3), sky=True)
    assert not (result.flags & st.Flag.SKY).any()


def test_noise_alone_is_no_sky():
    image = np.random.default_rng(0).normal(100, 4, (80, 120)).astype(np.float32)
    assert not sky.mask(image).any()


def test_a_street_from_the_horizon_down_has_hardly_any_sky(street):
    below = st.Pair(street.left[220:], street.right[220:])
    result = st.match(below, preset="fast", disparities=(0, 128), sky=True)
    assert ((result.flags & st.Flag.SKY) != 0).mean() < 0.03


def test_nothing_but_sky():
    y = np.mgrid[:300, :200][0]
    image = np.stack([90 + y // 8, 140 + y // 12, 250 - y // 20], axis=2).astype(np.uint8)
    assert sky.mask(image).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 2), (3, 3), (1, 1, 3), (2, 5, 3)])
def test_tiny_images(shape):
    image = np.random.default_rng(3).integers(0, 256, shape, dtype=np.uint8)
    found = sky.mask(image, np.zeros(shape[:2], np.float32))
    assert found.shape == shape[:2]
    assert found.dtype == bool


def test_grey_levels_may_have_any_unit(street):
    left = np.ascontiguousarray(street.left[::2, ::2])
    found = sky.mask(left)
    np.testing.assert_array_equal(sky.mask(left.astype(np.uint16) * 16), found)
    np.testing.assert_array_equal(sky.mask(left.astype(np.float32) * np.float32(2.0**-30)), found)
    assert np.mean(sky.mask(left.astype(np.uint16) + 1000) != found) < 0.001
    grey = sky.mask(left[..., 1])
    assert np.mean(sky.mask(np.repeat(left[..., 1:2], 3, axis=2)) != grey) < 0.01
    assert rates(grey, street.sky[::2, ::2])[1] > 0.9


def test_any_strides_and_read_only(street):
    left = street.left[::2, ::2]
    found = sky.mask(np.ascontiguousarray(left))
    turned = np.asfortranarray(left)
    turned.flags.writeable = False
    np.testing.assert_array_equal(sky.mask(turned), found)
    np.testing.assert_array_equal(sky.mask(left[:, ::-1]), sky.mask(left[:, ::-1].copy()))
    assert np.mean(sky.mask(left[:, ::-1])[:, ::-1] != found) < 0.001


@given(
    image=arrays.arrays(
        np.float32,
        some.sampled_from([(4, 7), (6, 5, 3), (1, 3)]),
        elements=some.floats(width=32, allow_nan=False, allow_infinity=False),
    )
)
@settings(max_examples=100, deadline=None)
def test_any_finite_image(image):
    found = sky.mask(image)
    assert found.shape == image.shape[:2]
    assert noise.deviation(image[:1]) == 0


def test_the_result_does_not_depend_on_threads_or_path(street):
    left, right = street.left[::2, ::2], street.right[::2, ::2]
    chosen = {"preset": "fast", "disparities": (0, 64), "sky": True, "reflection": 8, "texture": "auto"}
    one = st.match(left, right, threads=1, **chosen)
    for other in (st.match(left, right, threads=3, **chosen), st.match(left, right, keep="costs", **chosen)):
        np.testing.assert_array_equal(one.flags, other.flags)
        np.testing.assert_array_equal(one.disparity, other.disparity)


def test_filled_sky_keeps_its_flag(street):
    left, right = street.left[::2, ::2], street.right[::2, ::2]
    result = st.match(left, right, preset="fast", disparities=(0, 64), sky=True, fill="background")
    found = (result.flags & st.Flag.SKY) != 0
    assert found.any()
    assert (result.flags[found & np.isfinite(result.disparity)] & st.Flag.FILLED).all()


# ---- texture against noise -----------------------------------------------------------------------


def test_the_texture_of_noise_by_hand():
    # 1 / sqrt(pi), and 3 sqrt(pi - 2) standard errors of one pixel.
    assert validate.texture_of_noise(2, (1, 1)) == pytest.approx(
        2 * 0.5641896 * (1 + 3 * 1.0684527), rel=1e-6
    )
    assert validate.texture_of_noise(1, (255, 255)) == pytest.approx(0.5641896 * 1.0125701, rel=1e-6)
    assert validate.texture_of_noise(0, (9, 9)) == 0


@pytest.mark.parametrize("sigma", [2, 6, 15])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_automatic_texture_refuses_noise_and_keeps_what_stands_above_it(sigma, dtype):
    random = np.random.default_rng(5)
    image = np.full((80, 120), 120.0)
    image[:, 60:] += random.choice([-12, 12], (80, 60)) * sigma / 2
    noisy = np.clip(image + random.normal(0, sigma, image.shape), 0, 255).astype(dtype)
    result = st.match(noisy, noisy, disparities=(0, 4), cost=st.SAD(11), texture="auto")
    flat = (result.flags & st.Flag.LOW_TEXTURE) != 0
    assert flat[:, :50].mean() > 0.9
    assert not flat[:, 66:].any()


# ---- reflections ---------------------------------------------------------------------------------


def test_a_glare_in_one_view_is_found():
    left = np.random.default_rng(2).integers(40, 160, (60, 120)).astype(np.uint8)
    right = np.roll(left, -4, axis=1) // 2 + 30  # another gain, another offset: no reflection
    left[20:40, 50:80] += 60
    chosen = {"disparities": (0, 9), "cost": st.ZNCC(9)}
    result = st.match(left, right, reflection=10, **chosen)
    found = (result.flags & st.Flag.MISMATCHED) != 0
    assert found[23:37, 53:77].all()
    found[15:45, 45:85] = False
    assert not found[:, 10:].any()
    assert not st.match(left, right, **chosen).flags.any()


def test_brightness_without_a_match_and_without_light():
    image = np.zeros((3, 4, 1), np.uint8)
    assert not validate.brightness(image, image, np.full((3, 4), N, np.float32), (3, 3)).any()
    assert not validate.brightness(image, image, np.zeros((3, 4), np.float32), (3, 3)).any()


@given(
    shape=some.tuples(some.integers(1, 6), some.integers(2, 9), some.sampled_from([1, 3])),
    window=some.tuples(some.integers(1, 8), some.integers(1, 8)),
    top=some.sampled_from([2, 256, 2**21]),
    seed=SEEDS,
)
@settings(max_examples=60, deadline=None)
def test_brightness_of_any_pair(shape, window, top, seed):
    random = np.random.default_rng(seed)
    left, right = random.integers(0, top, (2, *shape)).astype(np.int32)
    disparity = random.choice([N, 0, 0.5, 1.4, 30, -3], shape[:2]).astype(np.float32)
    disparity[0, 0] = 0
    np.testing.assert_allclose(
        validate.brightness(left, right, disparity, window),
        reference.brightness(left, right, disparity, window),
        rtol=1e-4,
        atol=1e-4,
    )


# ---- settings ------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [1, "yes", 0.0])
def test_sky_is_on_off_or_auto(value):
    with pytest.raises(ValueError, match="sky must be"):
        st.Settings(sky=value)
    with pytest.raises(ValueError, match="sky must be on, off or auto"):
        st.Settings.make(assignments=["sky=perhaps"])


def test_texture_is_a_number_or_automatic():
    assert st.Settings.make(assignments=["texture=auto"]).texture == "auto"
    with pytest.raises(ValueError, match='texture must be a number of at least 0, "auto", or None'):
        st.Settings(texture="automatic")


def test_all_is_off_unless_asked_for():
    assert st.Settings().sky is False
    assert st.Settings().reflection is None
    assert st.Settings.make(assignments=["sky=off", "reflection=off"]) == st.Settings()
    chosen = st.Settings(sky=True, reflection=6, texture="auto")
    assert st.Settings.from_toml(chosen.to_toml()) == chosen
