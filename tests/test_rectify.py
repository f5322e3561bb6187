"""Misrectification: found to a tenth of a pixel, undone, and left alone where there is none."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

import stereopsis as st
from reference import rectify as reference
from stereopsis import Settings, _core, _instructions, datasets, rectify
from stereopsis.rectify import Sights
from stereopsis.types import Disparities, Frame, Rectangle, Vertical

SEEDS = some.integers(0, 2**32 - 1)
DATA = Path(os.environ.get("STEREOPSIS_DATA") or Path(__file__).parents[2] / "shared" / "data")


def noise(shape, seed=0, dtype=np.uint8, top=256):
    return np.random.default_rng(seed).integers(0, top, shape).astype(dtype)


def texture(x, y, seed):
    """A function of real coordinates, from 0 to 255, with waves of 5 to 60 pixels."""
    rng = np.random.default_rng(seed)
    waves = np.exp(rng.uniform(np.log(5), np.log(60), 40))
    angles, phases = rng.uniform(0, np.pi, 40), rng.uniform(0, 2 * np.pi, 40)
    total = sum(
        np.sin(2 * np.pi / wave * (np.cos(angle) * x + np.sin(angle) * y) + phase)
        for wave, angle, phase in zip(waves, angles, phases, strict=True)
    )
    return np.clip(128 + 16 * total, 0, 255)


def misrectified(vertical, shape=(220, 400), disparity=12.3, seed=0, dtype=np.uint8):
    """A wall whose right image lies too low by exactly `vertical`, bowed by it: nothing is resampled."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    s, columns, rows = x / (shape[1] - 1) - 0.5, shape[1] - 1, shape[0] - 1
    # What the right image shows on row y was on the row r with r + v(x, r) = y.
    steep = vertical.down + vertical.keystone * s
    row = (y - vertical.offset - vertical.across * s + steep / 2) / (1 + steep / rows)
    bow = vertical.keystone * s**2 * columns / rows
    left, right = texture(x, y, seed), texture(x - bow + disparity, row, seed)
    if dtype == np.uint16:
        left, right = 40 * left + 3000, 40 * right + 3000
    whole = np.rint if dtype != np.float32 else np.asarray
    return whole(left).astype(dtype), whole(right).astype(dtype)


def found(left, right, **others):
    result = st.match(left, right, disparities=(0, 32), cost=st.ZNCC(9), vertical="estimate", **others)
    return result.settings.vertical


def bits(result):
    return result.disparity.tobytes(), result.confidence.tobytes(), result.flags.tobytes()


# ---- kernels -------------------------------------------------------------------------------------


@given(
    shape=some.tuples(some.integers(1, 40), some.integers(1, 60)),
    tile=some.integers(1, 20),
    stride=some.integers(1, 7),
    reach=some.integers(1, 7),
    least=some.sampled_from([0.0, 1e5, 1e6]),
    threads=some.sampled_from([1, 3]),
    instructions=some.sampled_from(_core.instruction_sets()),
    seed=SEEDS,
)
@settings(max_examples=60, deadline=None)
def test_corners(shape, tile, stride, reach, least, threads, instructions, seed):
    image = noise(shape, seed)
    points = np.empty((shape[0] // tile, shape[1] // tile, 2), np.int32)
    _core.corners(image, tile, stride, reach, least, points, threads, instructions)
    np.testing.assert_array_equal(points, reference.corners(image, tile, stride, (6, reach), least))


def test_corners_by_hand():
    # An edge has no texture along it; its end is a corner.
    image = np.zeros((24, 24), np.uint8)
    image[:, 12:] = 200
    points = np.empty((1, 1, 2), np.int32)
    _core.corners(image, 24, 1, 1, 0.0, points, 1, "")
    np.testing.assert_array_equal(points, [[[-1, -1]]])
    image[:12] = 0
    _core.corners(image, 24, 1, 1, 0.0, points, 1, "")
    # Gradients are 200 in x at columns 11 and 12 from row 12 on, in y at rows 11 and 12 from column 12 on.
    # About row 13 a window of 13 x 3 sees six of the former, and of the latter the more, the farther right.
    np.testing.assert_array_equal(points, [[[16, 13]]])


@given(
    reach=some.integers(1, 5),
    shift=some.tuples(some.floats(-1, 1), some.floats(-1, 1)),
    start=some.tuples(some.floats(-1, 1), some.floats(-1, 1)),
    iterations=some.integers(0, 4),
    threads=some.sampled_from([1, 3]),
    instructions=some.sampled_from(_core.instruction_sets()),
    seed=SEEDS,
)
@settings(max_examples=60, deadline=None)
def test_tracks(reach, shift, start, iterations, threads, instructions, seed):
    y, x = np.mgrid[:24, :40].astype(np.float64)
    left = np.rint(texture(x, y, seed)).astype(np.uint8)
    right = np.rint(texture(x - shift[0], y - shift[1], seed)).astype(np.uint8)
    points = np.array([(20, 12), (9, 7), (0, 0), (39, 23), (31, 15)], np.int32)
    motion = np.tile(start, (len(points), 1))
    correlation = np.empty(len(points))
    _core.track(left, right, points, reach, iterations, motion, correlation, threads, instructions)
    for point, moved, rho in zip(points, motion, correlation, strict=True):
        expected, value = reference.track(left, right, point, (6, reach), iterations, start)
        assert np.isnan(rho) == np.isnan(value)
        if not np.isnan(value):
            # Single precision, and a point that stops a step sooner.
            np.testing.assert_allclose(moved, expected, atol=0.012)
            assert rho == pytest.approx(value, abs=2e-2)


def test_a_track_arrives():
    y, x = np.mgrid[:40, :60].astype(np.float64)
    left, right = (np.rint(texture(x - dx, y - dy, 5)).astype(np.uint8) for dx, dy in ((0, 0), (-2.3, 0.6)))
    motion, correlation = np.array([[-1.5, 0.0]]), np.empty(1)
    _core.track(left, right, np.array([[30, 20]], np.int32), 4, 10, motion, correlation, 1, "")
    np.testing.assert_allclose(motion, [[-2.3, 0.6]], atol=0.03)
    assert correlation[0] > 0.99


@given(
    shape=some.tuples(some.integers(1, 12), some.integers(1, 40), some.sampled_from([1, 3])),
    plane=some.tuples(
        some.floats(-0.2, 0.2), some.floats(-0.2, 0.2), some.floats(-20, 20), some.floats(-0.01, 0.01)
    ),
    dtype=some.sampled_from([np.uint8, np.int32]),
    threads=some.sampled_from([1, 3]),
    instructions=some.sampled_from(_core.instruction_sets()),
    seed=SEEDS,
)
@settings(max_examples=100, deadline=None)
def test_rows_move(shape, plane, dtype, threads, instructions, seed):
    image = noise(shape, seed, dtype, 256 if dtype == np.uint8 else 60000)
    lowest, highest = int(image.min()), int(image.max())
    moved = np.empty_like(image)
    _core.move_rows(image, plane, lowest, highest, moved, threads, instructions)
    np.testing.assert_allclose(moved, reference.move_rows(image, plane, lowest, highest), atol=0.52)


def test_rows_move_by_hand():
    image = np.arange(0, 60, 10, dtype=np.uint8).reshape(6, 1, 1)

    def moved(c):
        out = np.empty_like(image)
        _core.move_rows(image, (0.0, 0.0, c, 0.0), 0, 50, out, 1, "")
        return out.ravel().tolist()

    assert moved(0.0) == [0, 10, 20, 30, 40, 50]
    assert moved(2.0) == [20, 30, 40, 50, 50, 50]
    assert moved(-1.0) == [0, 0, 10, 20, 30, 40]
    # Half-way weights are -1, 9, 9, -1 sixteenths: 70 / 16 and 740 / 16 at the ends.
    assert moved(0.5) == [4, 15, 25, 35, 46, 50]
    assert moved(-99.0) == [0] * 6


# ---- the field -----------------------------------------------------------------------------------


def test_a_field_among_wrong_points():
    rng = np.random.default_rng(3)
    x, y = rng.uniform(0, 800, 400), rng.uniform(0, 300, 400)
    rows = 0.3 + 0.4 * (x / 800 - 0.5) - 0.2 * (y / 300 - 0.5) + rng.normal(0, 0.1, 400)
    rows[:100] = rng.uniform(-4, 4, 100)
    rows += 0.8 * (x / 800 - 0.5) * (y / 300 - 0.5)
    found = rectify.fit(Sights(x, y, rows), (301, 801))
    assert found == pytest.approx((0.3, 0.4, -0.2, 0.8), abs=0.15)
    assert found[:3] == pytest.approx((0.3, 0.4, -0.2), abs=0.05)
    assert rectify.fit(Sights(x[:39], y[:39], rows[:39]), (301, 801)) == Vertical(0.0)


@given(
    count=some.integers(10, 60),
    slope=some.floats(0.05, 5),
    keystone=some.floats(0.05, 5),
    outliers=some.integers(0, 20),
    seed=SEEDS,
)
@settings(max_examples=60, deadline=None)
def test_fits(count, slope, keystone, outliers, seed):
    rng = np.random.default_rng(seed)
    across, down = rng.uniform(-0.5, 0.5, (2, count))
    rows = 0.4 - 0.3 * across + 0.2 * down + 0.5 * across * down + rng.normal(0, 0.1, count)
    rows[:outliers] = rng.uniform(-4, 4, min(count, outliers))
    found = np.empty(4)
    deviations = slope, keystone
    variance = _core.fit_rows(across, down, rows, *deviations, 0.0, found)
    expected, expected_variance = reference.fit(across, down, rows, *deviations, 0.0)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)
    assert variance == pytest.approx(expected_variance, rel=1e-5)


@pytest.mark.parametrize("deviation", [0.05, 0.5, 2.0])
def test_points_that_agree_on_nothing(deviation):
    rng = np.random.default_rng(4)
    x, y = rng.uniform(0, 800, 200), rng.uniform(0, 300, 200)
    assert rectify.fit(Sights(x, y, rng.normal(0, deviation, 200)), (301, 801)) == Vertical(0.0)


def test_noise_is_hardly_ever_a_field():
    rng = np.random.default_rng(6)
    found = 0
    for number in range(1800):
        count, deviation = (40, 100, 250)[number % 3], (0.3, 1.0, 3.0)[number // 3 % 3]
        x, y = rng.uniform(0, 800, count), rng.uniform(0, 300, count)
        rows = rng.normal(0, deviation, count) if number % 2 else deviation * rng.standard_t(2, count)
        found += any(rectify.fit(Sights(x, y, np.clip(rows, -4, 4)), (301, 801)))
    assert found <= 3


def test_a_wide_image_is_bowed_no_more_than_others():
    rng = np.random.default_rng(8)
    for shape in ((300, 400), (300, 1200), (100, 4000)):
        x, y = rng.uniform(0, shape[1], 60), rng.uniform(0, shape[0], 60)
        field = rectify.fit(Sights(x, y, 0.5 + rng.normal(0, 0.3, 60)), shape)
        assert abs(field.keystone * shape[1] / shape[0] / 4) < 0.5


def test_one_corner_says_little_about_the_rest():
    rng = np.random.default_rng(5)
    x, y = rng.uniform(0, 100, 60), rng.uniform(0, 60, 60)
    field = rectify.fit(Sights(x, y, 0.5 + rng.normal(0, 0.2, 60)), (600, 1000))
    assert np.abs(rectify.field(field, (600, 1000))).max() < 1.5


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize(
    "vertical",
    [
        Vertical(0.5, 0.0, 0.0),
        Vertical(-0.5, 0.0, 0.0),
        Vertical(0.3, 0.0, -0.6),
        Vertical(0.0, 400 * np.tan(np.radians(0.2)), 0.0),  # a roll of 0.2 degrees
        Vertical(1.8, 0.4, 0.0),
        Vertical(0.2, 0.0, 0.3, 0.9),
        Vertical(4.6, 0.3, 0.0),
        Vertical(-9.7, -0.4, 0.3, 0.5),
        Vertical(0.4, 400 * np.tan(np.radians(-0.8)), 0.0),
        Vertical(0.0, 0.0, 4.5),
    ],
)
def test_a_known_field_is_found_to_a_tenth_of_a_pixel(vertical, dtype):
    left, right = misrectified(vertical, dtype=dtype)
    seen = found(left, right)
    shape = left.shape
    np.testing.assert_allclose(rectify.field(seen, shape), rectify.field(vertical, shape), atol=0.1)


@pytest.mark.parametrize("rows", [-14, -5, 3, 9, 17])
def test_rows_that_lie_far_off(rows):
    """As well as those that hardly do; and what they leave nothing to match with says so."""
    scene = st.scenes.street(880, 300, seed=2)
    chosen = st.PRESETS["balanced"].changed(disparities=(0, 96))
    near = st.match(scene.left, scene.right, settings=chosen)
    away = scene.right[np.clip(np.arange(300) - rows, 0, 299)]
    far = st.match(scene.left, away, settings=chosen)
    assert far.settings.vertical.offset == pytest.approx(near.settings.vertical.offset + rows, abs=0.1)
    gone = np.zeros(scene.disparity.shape, bool)
    gone[-(rows - 2) :] = rows > 2
    gone[: -(rows + 2)] |= rows < -2
    unseen = (far.flags & st.Flag.OUT_OF_VIEW) != 0
    assert unseen[gone].all()
    assert not unseen[60:-60, 100:].any()
    seen = np.s_[20:-20]
    own, others = (st.evaluate(found.disparity[seen], scene.disparity[seen]).all.d1 for found in (far, near))
    assert own < others + 0.01


def test_what_lies_beyond_the_right_image():
    def mask(vertical, shape, part):
        found = np.zeros((part.bottom - part.top, part.right - part.left), bool)
        for rows, beyond in rectify.out_of_view(vertical, shape, part):
            found[rows] = beyond
        return found

    rows = mask(Vertical(2.5, 0.0, 0.0), (9, 4), Rectangle(0, 9, 0, 4))
    np.testing.assert_array_equal(rows.all(axis=1), [False] * 8 + [True])
    assert not list(rectify.out_of_view(Vertical(2.0, 0.0, 0.0), (9, 4), Rectangle(0, 9, 0, 4)))
    assert mask(Vertical(-99.0), (9, 4), Rectangle(0, 9, 0, 4)).all()
    for steep in (Vertical(-4.0, 3.0, 2.0, -1.0), Vertical(6.0, 3.0, -2.0, 9.0)):
        whole = mask(steep, (40, 30), Rectangle(0, 40, 0, 30))
        y = np.arange(40)[:, None] + rectify.field(steep, (40, 30))
        np.testing.assert_array_equal(whole, (y < -2) | (y > 41))
        for part in (Rectangle(1, 7, 2, 29), Rectangle(12, 40, 0, 5), Rectangle(15, 16, 3, 4)):
            np.testing.assert_array_equal(mask(steep, (40, 30), part), whole[part.slices])


def test_a_turned_camera():
    """`Vertical` and `unbow` against the projection itself, but for a constant of columns."""
    shape, focal, turn = (375, 1242), 720.0, 0.0018
    y, x = np.mgrid[: shape[0] : 22, : shape[1] : 17].astype(np.float64)
    u, v = x - (shape[1] - 1) / 2, y - (shape[0] - 1) / 2
    angle = np.arctan(u / focal) + turn
    seen = focal * np.tan(angle)  # columns from the middle
    lower = v * np.cos(np.arctan(u / focal)) / np.cos(angle) - v
    keystone = turn / focal * (shape[0] - 1) * (shape[1] - 1)
    field = rectify.field(Vertical(0.0, keystone=keystone), shape)
    np.testing.assert_allclose(field[::22, ::17], lower, atol=0.005)
    # The right view's own map of a wall at 40 pixels, as far as the constant lets it.
    measured = (40 - (seen - u) + turn * focal).astype(np.float32)
    full = np.zeros(shape, np.float32)
    full[::22, ::17] = measured
    rectify.unbow(full, Vertical(0.0, keystone=keystone), Disparities(0, 128), of_right=True)
    assert np.abs(measured - 40).max() > 0.9
    np.testing.assert_allclose(full[::22, ::17], 40, atol=0.005)


def test_disparities_of_a_turned_camera():
    vertical = Vertical(0.2, 0.1, 0.0, 1.2)
    left, right = misrectified(vertical, shape=(200, 600))
    chosen = Settings(disparities=(0, 32), cost=st.ZNCC(9), keep=("unfiltered", "right_disparity"), median=3)

    def matched(given):
        return st.match(left, right, settings=chosen.changed(vertical=given))

    def errors(result):
        return [
            float(np.median(np.abs(each[:, -40:] - 12.3)))
            for each in (result.disparity, result.stages["unfiltered"])
        ]

    assert min(errors(matched(vertical[:3]))) > 0.4
    assert max(errors(matched(vertical))) < 0.1
    assert max(errors(matched("estimate"))) < 0.2
    # The right view's winners are whole before.
    bow = 1.2 * np.linspace(-0.5, 0.5, 600) ** 2 * 599 / 199
    winners = matched(vertical).stages["right_disparity"] - bow
    np.testing.assert_allclose(winners[:, 60:-60], np.rint(winners[:, 60:-60]), atol=1e-4)


@given(
    shape=some.tuples(some.integers(1, 9), some.integers(1, 70)),
    bow=some.floats(-0.0078125, 0.0078125, width=32),
    middle=some.integers(-300, 300),
    of_right=some.booleans(),
    threads=some.sampled_from([1, 3]),
    seed=SEEDS,
)
@settings(max_examples=60, deadline=None)
def test_unbows(shape, bow, middle, of_right, threads, seed):
    rng = np.random.default_rng(seed)
    disparity = rng.uniform(-20, 80, shape).astype(np.float32)
    disparity[rng.random(shape) < 0.2] = np.nan
    expected = reference.unbowed(disparity, bow, middle / 2, -3, 60, of_right)
    _core.unbow(disparity, bow, middle / 2, -3, 60, of_right, threads)
    np.testing.assert_allclose(disparity, expected, rtol=1e-5, atol=1e-4)


def test_parts_are_unbowed_like_the_whole():
    whole = np.random.default_rng(2).uniform(0, 30, (40, 90)).astype(np.float32)
    part, vertical = whole[7:30, 21:66].copy(), Vertical(0.1, 0.2, 0.3, -4.0)
    before = part.copy()
    rectify.unbow(whole, vertical, Disparities(0, 40))
    rectify.unbow(part, vertical, Disparities(0, 40), frame=Frame((40, 90), 7, 21))
    np.testing.assert_array_equal(part, whole[7:30, 21:66])
    assert (part != before).any()
    image = noise((40, 90, 1), 3)
    np.testing.assert_allclose(
        rectify.undone(image[7:30, 21:66], vertical, frame=Frame((40, 90), 7, 21))[3:-3].astype(int),
        rectify.undone(image, vertical)[10:27, 21:66].astype(int),
        atol=1,
    )


@pytest.mark.parametrize("seed", range(4))
def test_where_there_is_none_nothing_changes(seed):
    left, right = misrectified(Vertical(0.0), seed=seed)
    assert found(left, right) == Vertical(0.0)
    settings = Settings(disparities=(0, 32), cost=st.ZNCC(9), left_right=1, fill="background")
    plain = st.match(left, right, settings=settings)
    assert bits(st.match(left, right, settings=settings, vertical="estimate")) == bits(plain)


@pytest.mark.parametrize("shift", [0.0, 0.5, -0.4])
def test_streets(shift):
    scene = st.scenes.street(440, 240, seed=2)
    right = rectify.undone(scene.right, Vertical(-shift)) if shift else scene.right
    result = st.match(
        scene.left, right, disparities=(0, 64), preset="fast", vertical="estimate", keep="vertical"
    )
    np.testing.assert_allclose(result.stages["vertical"], shift, atol=0.1)
    if shift:
        assert result.settings.vertical.offset == pytest.approx(shift, abs=0.1)
    else:
        assert result.settings.vertical == Vertical(0.0)


def test_matching_gains():
    left, right = misrectified(Vertical(0.7, 0.4, 0.0))

    def error(**vertical):
        result = st.match(left, right, disparities=(0, 32), cost=st.ZNCC(7), **vertical)
        return np.sqrt(np.nanmean((result.disparity[:, 20:] - 12.3) ** 2))

    assert error(vertical="estimate") < 0.5 * error()
    assert error(vertical=(0.7, 0.4, 0.0)) == pytest.approx(error(vertical="estimate"), rel=0.2)


@pytest.mark.parametrize("shape", [(1, 1), (1, 90), (90, 1), (7, 9), (40, 40)])
@pytest.mark.parametrize("value", [0, 255])
def test_degenerate_images(shape, value):
    flat = np.full(shape, value, np.uint8)
    for left, right in ((flat, flat), (noise(shape), noise(shape, 1))):
        result = st.match(left, right, disparities=(-3, 9), cost=st.ZNCC(5), vertical="estimate")
        assert result.settings.vertical == Vertical(0.0)
        assert result.disparity.shape == shape


def test_threads_and_colour():
    left, right = misrectified(Vertical(0.5, 0.3, 0.1))
    colour = [np.stack([image, 255 - image, image // 2], axis=2) for image in (left, right)]
    for images in ((left, right), colour):
        results = [
            st.match(
                *images,
                disparities=(0, 32),
                cost=st.SAD(5),
                channels="separate",
                vertical="estimate",
                threads=n,
            )
            for n in (1, 2, 7)
        ]
        assert bits(results[0]) == bits(results[1]) == bits(results[2])
        assert results[0].settings.vertical == results[2].settings.vertical != Vertical(0.0)


# ---- the setting ---------------------------------------------------------------------------------


def test_the_result_repeats_from_its_settings():
    left, right = misrectified(Vertical(0.5, 0.3, 0.0))
    first = st.match(left, right, disparities=(0, 32), preset="fast", vertical="estimate")
    assert "vertical" in first.timings
    again = Settings.from_toml(first.settings.to_toml())
    assert again.vertical == first.settings.vertical
    assert bits(st.match(left, right, settings=again)) == bits(first)


def test_a_known_offset_moves_the_right_image():
    left, right = noise((20, 60)), noise((20, 60), 1)
    lower = np.vstack([right[:1], right[:1], right[:-2]])
    settings = Settings(disparities=(0, 9), cost=st.ZNCC(5))
    moved = st.match(left, lower, settings=settings, vertical=2, keep="vertical")
    np.testing.assert_array_equal(moved.stages["vertical"], 2)
    assert moved.settings.vertical == Vertical(2.0)
    plain = st.match(left, right, settings=settings)
    # But for the last two rows, which the image lost, and the windows that see them.
    np.testing.assert_array_equal(moved.disparity[:16], plain.disparity[:16])


def test_kept_where_nothing_was_asked():
    result = st.match(noise((9, 30)), noise((9, 30)), disparities=(0, 5), cost="sad", keep="vertical")
    np.testing.assert_array_equal(result.stages["vertical"], np.zeros((9, 30), np.float32))


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("vertical=estimate", "estimate"),
        ("vertical=0.5", Vertical(0.5)),
        ("vertical=-0.5,0.2,0", Vertical(-0.5, 0.2, 0.0)),
        ("vertical=-0.5,0.2,0,1.5", Vertical(-0.5, 0.2, 0.0, 1.5)),
        ("vertical=none", None),
    ],
)
def test_as_text(text, value):
    assert Settings.make(assignments=[text]).vertical == value
    assert Settings.from_toml(Settings(vertical=value).to_toml()).vertical == value


@pytest.mark.parametrize("value", ["auto", (1, 2), (1, 2, "3"), float("nan"), True, 2000, [1, 2, 3, 4, 5]])
def test_what_is_refused(value):
    with pytest.raises(ValueError, match="vertical must be"):
        Settings(vertical=value)


def test_levels_and_halves():
    assert [rectify.levels(width) for width in (1, 640, 881, 1242, 2964)] == [1, 1, 2, 2, 3]
    image = np.array([[1, 2, 9], [3, 5, 9], [9, 9, 9]], np.uint8)
    np.testing.assert_array_equal(rectify.halved(image), [[3]])  # 11 / 4
    image = noise((7, 300))
    sums = image[:6].astype(int).reshape(3, 2, 150, 2).sum(axis=(1, 3))
    np.testing.assert_array_equal(rectify.halved(image), (sums + 2) // 4)
    words = np.arange(3000, dtype=np.int32).reshape(30, 100) + 70000
    stretched = rectify.eight_bit(words)
    assert (stretched.min(), stretched.max()) == (0, 255)


@pytest.mark.parametrize("instructions", _core.instruction_sets())
def test_stretching_to_bytes(monkeypatch, instructions):
    monkeypatch.setenv(_instructions.ENVIRONMENT, instructions)
    by_hand = np.array([[-9, 0, 1, 2, 3, 5, 509, 511, 2000]], np.int32)  # halves go to the even one
    np.testing.assert_array_equal(rectify.eight_bit(by_hand, (0, 510)), [[0, 0, 0, 1, 2, 2, 254, 255, 255]])
    rng = np.random.default_rng(4)
    for columns in (1, 7, 64, 131):
        words = rng.integers(-(2**21), 2**21, (3, columns)).astype(np.int32)[:, ::-1]
        for low, high in ((-(2.0**21), 2.0**21), (-1000.25, 7000.5), (5.0, 5.0)):
            scaled = (words.astype(np.float64) - low) * (255 / max(high - low, 1.0))
            np.testing.assert_array_equal(
                rectify.eight_bit(words, (low, high)), np.clip(np.rint(scaled), 0, 255).astype(np.uint8)
            )


@pytest.mark.skipif(not (DATA / "kitti2015").is_dir(), reason="the data are not here")
def test_kitti_lies_too_low():
    """Every pair of a drive lies the same way; matching without is measured in docs/rectify.md."""
    pairs = [sample.pair() for sample in datasets.open(DATA / "kitti2015")[:3]]
    fields = [
        st.match(pair, disparities=(0, 128), cost=st.SAD(5), vertical="estimate").settings.vertical
        for pair in pairs
    ]
    assert all(0.2 < field.offset < 0.5 and 0.3 < field.across < 0.9 for field in fields)
    assert all(0.5 < field.keystone < 2 for field in fields)
