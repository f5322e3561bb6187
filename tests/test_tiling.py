"""Tiles: of local methods the same bits as the whole image, however it is cut."""

import dataclasses

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as some

import stereopsis as st
from stereopsis import pipeline, rectify
from stereopsis.settings import PRESETS, Settings
from stereopsis.supports import Adaptive, Bilateral, Cross, Gaussian
from stereopsis.tiling import reach, survey
from stereopsis.tiling.grid import tile, tiles
from stereopsis.tiling.mosaic import Canvas, Mosaic
from stereopsis.tiling.parts import Array, match_tile
from stereopsis.types import WHOLE, Disparities, Flag, Halo, Rectangle, Vertical

# ---- halos -----------------------------------------------------------------------------------------


def test_halos_by_hand():
    assert Halo.box((4, 7)) == (3, 3, 2, 1)
    assert Halo(1, 2, 3, 4).then(Halo(10, 20, WHOLE, 40)) == (11, 22, WHOLE, 44)
    assert Halo(1, 2, 3, 4).beside(Halo(4, 3, 2, 1)) == (4, 3, 3, 4)
    plain = Settings(disparities=(-3, 10), cost=st.ZNCC((6, 5)), subpixel=None)
    # 2 above and below; 3 and 2 for the window, 9 and 3 for the range.
    assert reach.halo(plain) == (2, 2, 12, 5)
    # Right pixels up to 9 + 2 to the left, whose candidates span 13.
    assert reach.halo(plain.changed(left_right=1.0)) == (2, 2, 3 + 12 + 2, 2 + 12 + 2)
    assert reach.halo(plain.changed(median=5, speckle=(50, 1.0))) == (53, 53, 63, 56)
    assert reach.halo(plain.changed(fill="background")) == (2, 2, WHOLE, WHOLE)
    assert reach.alignment(plain.changed(step=3)) == 6


def test_settings_that_need_the_whole_image_are_refused_by_name():
    for name, value in (
        ("sky", True), ("reflection", 3.0), ("planes", "segments"), ("pyramid", 2), ("keep", "texture"),
        ("optimize", "trws"), ("optimize", "icm"), ("cost", st.MutualInformation(5)),
        ("cost", st.Combined(st.Census(5), 1, st.MutualInformation(5), 1)),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=f"^{name} must"):
            reach.refuse(Settings().changed(**{name: value}))
    with pytest.raises(ValueError, match=r"^cost must be a cost of pixels, NCC or ZNCC with SGM in tiles"):
        reach.refuse(Settings(cost=st.SSD(5), optimize=st.SGM()))
    with pytest.raises(ValueError, match=r"^sky must be False or 'auto' in tiles, not True"):
        reach.refuse(Settings(sky=True))
    with pytest.raises(ValueError, match="disparities and vertical must be known"):
        reach.halo(Settings(vertical="estimate", disparities=(0, 5)))
    assert [reach.measured(PRESETS[name]) for name in ("fast", "balanced", "accurate", "local")] == [
        (), ("optimize", "slant"), ("optimize", "slant", "fill"), ("slant",),
    ]  # fmt: skip


# ---- where tiles lie -------------------------------------------------------------------------------


@given(
    shape=some.tuples(some.integers(1, 60), some.integers(1, 60)),
    side=some.tuples(some.integers(1, 25), some.integers(1, 25)),
    halo=some.builds(Halo, *(some.integers(0, 30),) * 4),
    aligned=some.integers(1, 6),
)
def test_tiles_cover_every_pixel_once_and_hold_their_halo(shape, side, halo, aligned):
    seen = np.zeros(shape, int)
    number = np.arange(seen.size).reshape(shape)
    for core, part in (found := tiles(shape, side, halo, aligned)):
        seen[core.slices] += 1
        assert part.top % aligned == part.left % aligned == 0
        assert 0 <= part.top <= max(0, core.top - halo.up)
        assert part.bottom == min(shape[0], core.bottom + halo.down)
        assert 0 <= part.left <= max(0, core.left - halo.left)
        assert part.right == min(shape[1], core.right + halo.right)
        within = tile(core, shape, halo, aligned).within
        assert (number[part.slices][within] == number[core.slices]).all()
    assert (seen == 1).all()
    assert [core for core, _ in found] == sorted(core for core, _ in found)


# ---- a tile answers what the whole image does ------------------------------------------------------


def a_pair(shape, dtype, seed):
    """Of steps in depth from row to row and grey levels few enough for costs to tie."""
    draw = np.random.default_rng(seed)
    height, width, *channels = shape
    levels = int(draw.choice([4, 30, 200]))
    scene = draw.integers(0, levels, (height, width + 40, *channels))
    columns = 10 + np.arange(width) + draw.integers(-9, 18, height // 5 + 1).repeat(5)[:height, None]
    right = np.take_along_axis(scene, columns[..., None] if channels else columns, axis=1)
    left = scene[:, 10 : 10 + width] + draw.integers(0, 1 + levels // 9, (height, width, *channels))
    if draw.random() < 0.3:  # rows that nothing is known of
        left[: draw.integers(0, height)] = 0
    scale, offset = {
        "uint8": (1, 0),
        "uint16": (int(draw.choice([1, 13, 200])), 100),
        "float32": (1 / 37, -2),
    }[np.dtype(dtype).name]
    return tuple((image * scale + offset).astype(dtype) for image in (left, right))


def in_tiles(left, right, chosen, side, band=900):
    known = survey.survey(Array(left), Array(right), chosen, band=band)
    maps = [np.full(left.shape[:2], 77, dtype) for dtype in (np.float32, np.float32, np.uint8)]
    halo = reach.halo(known.settings)
    if reach.reaches_across(halo):
        side = side[0], left.shape[1]
    mosaic = Mosaic(known, *map(Canvas, maps))
    for part in tiles(left.shape[:2], side, halo, reach.alignment(known.settings)):
        mosaic.add(match_tile(Array(left), Array(right), known, part))
    mosaic.finish()
    assert mosaic.density == np.isfinite(maps[0]).mean()
    assert mosaic.flagged == {flag: np.count_nonzero(maps[2] & flag) for flag in Flag}
    return known, maps


def assert_same_bits(left, right, chosen, side, band=900):
    known, maps = in_tiles(left, right, chosen, side, band)
    whole = st.match(left, right, settings=chosen)
    assert known.settings.changed(texture=chosen.texture, sharpen=chosen.sharpen) == whole.settings
    for name, found in zip(("flags", "disparity", "confidence"), (maps[2], *maps[:2]), strict=True):
        wanted = getattr(whole, name)
        same = found.view(np.uint8) == wanted.view(np.uint8)
        assert same.all(), (name, np.argwhere(~same)[:5])


WINDOWS = some.tuples(some.integers(1, 9), some.integers(1, 9))
RANGES = some.builds(lambda low, span: (low, low + span), some.integers(-20, 30), some.integers(1, 20))
COSTS = some.one_of(
    some.builds(
        lambda kind, window: kind(window),
        some.sampled_from([st.SAD, st.SSD, st.ZSAD, st.ZSSD, st.NCC, st.ZNCC]),
        some.one_of(
            WINDOWS, WINDOWS,
            some.builds(Gaussian, some.sampled_from([1.2, 3.0, 5.0])),
            some.builds(Bilateral, WINDOWS),
            some.builds(Cross, some.integers(1, 9), some.sampled_from([1.0, 20.0])),
            some.just(Adaptive((3, 2), (15, 7), 20, 2)),
        ),
    ),
    some.sampled_from([
        st.Census((9, 7)), st.Census(5, aggregation=3), st.Rank((3, 5), 3), st.Gradient((5, 3), 30),
        st.BirchfieldTomasi(3), st.Combined(st.Census(3), 0.5, st.Gradient(3), 0.5),
    ]),
)  # fmt: skip


@given(
    shape=some.tuples(some.integers(1, 40), some.integers(1, 70)),
    channels=some.sampled_from([(), (), (3,)]),
    dtype=some.sampled_from(["uint8", "uint8", "uint16", "float32"]),
    side=some.tuples(some.integers(3, 30), some.integers(3, 40)),
    disparities=RANGES,
    cost=COSTS,
    others=some.fixed_dictionaries({}, optional={
        "channels": some.just("separate"),
        "left_right": some.sampled_from([0.0, 1.0, 3.0]),
        "uniqueness": some.sampled_from([0.0, 5.0]),
        "texture": some.sampled_from([0.5, "auto"]),
        "subpixel": some.sampled_from(["equiangular", "symmetric", "lucas-kanade", "lucas-kanade-affine"]),
        "refine_window": some.sampled_from([(9, 5), 4]),
        "median": some.sampled_from([1, 3, 5]),
        "speckle": some.sampled_from([(1, 1.0), (6, 0.5), (25, 1.0)]),
        "fill": some.just("background"),
        "vertical": some.sampled_from([0.5, (-1.25, 0.0, 0.0)]),
        "sharpen": some.sampled_from(["auto", 0.5]),
        "threads": some.sampled_from([1, 3]),
    }),
    seed=some.integers(0, 2**32 - 1),
)  # fmt: skip
@settings(max_examples=120, deadline=None)
def test_the_same_bits(shape, channels, dtype, side, disparities, cost, others, seed):
    try:
        chosen = Settings(disparities=disparities, cost=cost, subpixel=None).changed(**others)
    except ValueError:
        return  # settings that exclude each other
    assert_same_bits(*a_pair((*shape, *channels), dtype, seed), chosen, side)


@pytest.mark.parametrize(
    "others",
    [
        {"extra_windows": ((9, 8), (15, 4)), "left_right": 1.0, "uniqueness": 2.0},
        {"subpixel": "correlation", "left_right": 1.0},
        {"upsample": (3, "lanczos"), "left_right": 1.0, "cost": st.SSD((5, 4))},
        {"step": 3, "disparity_step": 2, "left_right": 1.0, "median": 3},
        {"optimize": st.SecondPass(st.Smoothness("l1", 0.5), data="zssd"), "subpixel": None, "left_right": 1},
        {"planar": (9, 7), "median": 3, "left_right": 1.0},
        {"confidence": "calibrated", "left_right": 1.0, "least_confidence": 0.4, "texture": "auto"},
        {"confidence": "calibrated", "left_right": 1.0, "fill": "background"},
        {"outlines": True, "left_right": 1.0, "fill": "background", "median": 3},
        {"photometric": True, "left_right": 1.0},
        {
            "least_confidence": 0.4,
            "confidence": "calibrated",
            "left_right": 1.0,
            "fill": "background",
            "planar": (9, 7),
        },
    ],
    ids=lambda others: next(iter(others)),
)
@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
def test_the_same_bits_the_other_ways_through_the_stages(others, dtype):
    chosen = Settings(disparities=(-4, 14), cost=st.ZNCC((6, 5)), threads=1).changed(**others)
    assert_same_bits(*a_pair((90, 131), dtype, 4), chosen, (31, 37))


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
@pytest.mark.parametrize("colours", [(), (3,)])
def test_borders_are_the_whole_image_s(colours, dtype):
    """Also where a tile shows nothing, or all that is nearest lies in another tile."""
    left, right = a_pair((90, 131, *colours), dtype, 4)
    y, x = np.ogrid[:90, :131]
    for image, (a, b, c, d) in ((left, (20, 9, 30, 0)), (right, (5, 30, 3, 17))):
        bowed = 8 * np.sin(x / 131 * np.pi)
        image[(x < a + y // 8) | (x >= 131 - b) | (y < c + bowed) | (y >= 90 - d - bowed)] = 0
    chosen = Settings(disparities=(-4, 14), cost=st.ZNCC((6, 5)), left_right=1.0, blank=True, median=3)
    assert_same_bits(left, right, chosen, (31, 37))
    known, _ = in_tiles(left, right, chosen, (31, 37))
    assert all(known.borders)


@pytest.mark.parametrize("dtype", ["uint16", "float32"])
def test_bytes_in_another_type_are_the_same_bytes(dtype):
    """Also where a tile by itself would be told apart more coarsely, or not at all."""
    scene = st.scenes.street(240, 100, seed=3, gray=True, noise=1)
    pair = [image.copy() for image in (scene.left, scene.right)]
    for image in pair:
        image[:40] &= 0xF0
    chosen = PRESETS["balanced"].changed(disparities=(0, 30))
    wanted, maps = in_tiles(*pair, chosen, (64, 96))
    factor = {"uint16": 16, "float32": np.float32(1 / 255)}[dtype]
    known, found = in_tiles(*(image.astype(dtype) * factor for image in pair), chosen, (64, 96))
    assert known.settings == wanted.settings
    for mine, others in zip(found, maps, strict=True):
        np.testing.assert_array_equal(mine, others)


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
def test_values_that_the_map_bounds_are_near(dtype):
    """The weighted median's steps depend on the greatest disparity, so they are finer in some tiles."""
    left, right = (np.clip(image, 0, None) for image in a_pair((60, 90), dtype, 5))
    for image in (left, right):
        image[:30] = image[:30] / 16  # tiles that would see other grey levels by themselves
    chosen = Settings(disparities=(0, 14), cost=st.ZNCC(5), weighted_median=(5, 10.0))
    _, (disparity, _, _) = in_tiles(left, right, chosen, (20, 30))
    np.testing.assert_allclose(disparity, st.match(left, right, settings=chosen).disparity, atol=1 / 64)


# ---- what is found once ----------------------------------------------------------------------------


def test_a_preset_in_tiles_is_the_preset():
    """Range, rows and all are estimated from the images first, as the whole image has them."""
    scene = st.scenes.street(480, 200, seed=3, gray=True)
    right = np.roll(scene.right, 1, axis=0)  # one row too low
    known, (disparity, _, _) = in_tiles(scene.left, right, PRESETS["fast"], (64, 128), band=480 * 70)
    assert known.settings.vertical.offset == pytest.approx(1, abs=0.1)
    whole = st.match(scene.left, right, settings=PRESETS["fast"])
    assert known.settings == whole.settings
    assert (disparity.view(np.uint32) == whole.disparity.view(np.uint32)).all()


def test_rows_beyond_the_right_image_are_the_whole_image_s():
    left, right = a_pair((90, 131), "uint8", 4)
    for offset in (9.0, -9.0):
        chosen = Settings(disparities=(-4, 14), cost=st.ZNCC((6, 5)), left_right=1.0, vertical=offset)
        assert_same_bits(left, right, chosen, (31, 37))
        flags = st.match(left, right, settings=chosen).flags
        assert (flags[-7:] if offset > 0 else flags[:7]).all()


@pytest.mark.parametrize("offset", [0.7, 7.3])
@pytest.mark.parametrize(
    ("dtype", "small"), [("uint8", 2**23), ("uint8", 30000), ("uint16", 4000), ("float32", 30000)]
)
def test_rows_are_found_as_in_the_whole_image(monkeypatch, dtype, small, offset):
    """However few of the pyramid's levels are held."""
    scene = st.scenes.street(860, 200, seed=1, gray=True)
    moved = rectify.undone(scene.right[..., None], Vertical(-offset, 0.2, -0.3))[..., 0]
    left, right = ((image * np.float64(17)).astype(dtype) if dtype != "uint8" else image
                   for image in (scene.left, moved))  # fmt: skip
    monkeypatch.setattr(survey, "SMALL", small)
    wanted = st.estimate_vertical(left, right, (0, 100))
    known = survey.survey(
        Array(left), Array(right), Settings(disparities=(0, 100), vertical="estimate"), band=860 * 40
    )
    assert known.settings.vertical == pytest.approx(wanted, abs=2e-4)
    assert wanted.offset == pytest.approx(offset, abs=0.1)


@given(
    shape=some.tuples(some.integers(1, 90), some.integers(1, 600)),
    channels=some.sampled_from([(), (3,)]),
    band=some.integers(1, 20000),
    seed=some.integers(0, 999),
)
@example(shape=(2, 600), channels=(), band=1, seed=0)
@settings(max_examples=25, deadline=None)
def test_the_range_and_the_noise_are_the_whole_image_s(shape, channels, band, seed):
    left, right = a_pair((*shape, *channels), "uint16", seed)
    known = survey.survey(Array(left), Array(right), Settings(cost=st.SSD(5), texture="auto"), band=band)
    assert known.settings.disparities == st.estimate_disparities(left, right)
    pixels = st.pipeline.cost.pixels(left, right)
    deviation = pipeline.noise.deviation(pixels.left)
    assert known.settings.texture == pipeline.validate.texture_of_noise(deviation, (5, 5))


@pytest.mark.parametrize("preset", ["balanced", "accurate"])
def test_tiles_know_of_no_horizon(preset):
    scene = st.scenes.street(300, 130, seed=5, gray=True)
    chosen = PRESETS[preset].changed(disparities=(0, 32), vertical=None)
    assert chosen.sky == "auto"
    reach.refuse(chosen)
    known = survey.survey(Array(scene.left), Array(scene.right), chosen)
    assert known.settings.sky is False


@pytest.mark.parametrize("vertical", [None, (0.2, 0.1, -0.1, 4.0)])
@pytest.mark.parametrize("preset", ["balanced", "local"])
def test_planes_are_found_in_tiles(preset, vertical):
    scene = st.scenes.street(600, 260, seed=5, gray=True)
    chosen = PRESETS[preset].changed(disparities=(0, 64), vertical=vertical, speckle=None)
    whole = st.match(scene.left, scene.right, settings=chosen, keep=("planes",)).stages["planes"]
    left, right = Array(scene.left), Array(scene.right)
    known = survey.survey(left, right, chosen)
    assert known.frame.planes is None
    side = (130, 600) if preset == "local" else (130, 200)
    laid = tiles((260, 600), side, reach.halo(chosen), reach.alignment(chosen))
    assert len(laid) > 1
    found = survey.with_planes(left, right, known, laid).frame.planes
    assert len(found) == len(whole) >= 1
    tolerance = 1e-9 if preset == "local" else 1e-3
    assert np.allclose(found, whole, rtol=0, atol=[tolerance / 100, tolerance / 100, tolerance])
    plain = dataclasses.replace(known, settings=chosen.changed(slant=None))
    assert survey.with_planes(left, right, plain, laid) is plain


def test_limits_and_brightness_of_the_whole_are_told():
    left, right = a_pair((50, 60), "float32", 2)
    left[3, 4], right[40, 50] = 90.0, -120.0
    chosen = Settings(disparities=(0, 5), cost=st.Gradient(3))
    known = survey.survey(Array(left), Array(right), chosen, band=300)
    pixels = pipeline.cost.pixels(left, right)
    assert known.largest == 120
    ends = pixels.left.min(), pixels.left.max(), pixels.right.min(), pixels.right.max()
    assert known.frame.levels == (min(ends[::2]), max(ends[1::2]))
    moved = survey.survey(Array(left), Array(right), chosen.changed(vertical=0.5), band=300).frame
    assert moved.limits == ends
    right = rectify.undone(pixels.right, Vertical(0.5))
    assert moved.levels == (min(pixels.left.min(), right.min()), max(pixels.left.max(), right.max()))
    assert known.frame.shape == (50, 60)
    assert Rectangle(1, 3, 2, 7).size == 10
    assert isinstance(known.settings.disparities, Disparities)
