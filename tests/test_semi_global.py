"""Semi-global matching in the pipeline: along the ground, judged by planes; the presets made of it."""

import numpy as np
import pytest

import stereopsis as st
from stereopsis import SGM, Census, Flag, cost, fill, slant

CENSUS = Census((9, 7), aggregation=3)
SMOOTH = SGM(p1=120, p2=950, p2_min=216, contrast=20, unit=8)


@pytest.fixture(scope="module")
def street():
    return st.scenes.street(320, 160, noise=2)


def matched(scene, **chosen):
    given = {"disparities": (0, 64), "cost": CENSUS, "optimize": SMOOTH, "left_right": 1.0, **chosen}
    return st.match(scene.left, scene.right, **given)


def same(one, other):
    return all(
        getattr(one, what).tobytes() == getattr(other, what).tobytes()
        for what in ("disparity", "confidence", "flags")
    )


def off(result, scene):
    known = np.isfinite(scene.disparity)
    return np.abs(result.disparity - scene.disparity)[known]


def test_along_the_ground_the_road_is_answered_better(street):
    plain = matched(street, fill="background")
    along = matched(street, fill="background", slant="road", keep=("planes",))
    assert plain.path == "streaming"
    assert along.path == "merged"
    assert along.stages["planes"].shape == (1, 3)
    assert (along.stages["plane"] == 1).mean() > 0.2
    assert (off(along, street) > 1).mean() < 0.9 * (off(plain, street) > 1).mean()


def test_without_a_road_nothing_changes():
    scene = st.scenes.plane(160, 80, disparity=9.25)
    assert same(matched(scene, slant="road"), matched(scene))


def test_the_planar_filter_judges_again(street):
    raw = matched(street, slant="road")
    refused = matched(street, slant="road", planar=(25, 13))
    filled = matched(street, slant="road", planar=(25, 13), fill="background")
    answered = np.isfinite(refused.disparity)
    assert ((refused.flags == 0) == answered).all()
    # Some that a check had refused come back, with their confidence.
    back = answered & np.isnan(raw.disparity)
    assert back.any()
    assert (refused.confidence[back] > 0).any()
    assert (refused.confidence[~answered] == 0).all()
    assert np.isfinite(filled.disparity).all()
    np.testing.assert_array_equal(filled.disparity[answered], refused.disparity[answered])
    assert ((filled.flags & Flag.FILLED != 0) == ~answered).all()


def test_composed_and_streaming_winners_are_judged_alike():
    scene = st.scenes.street(160, 80, noise=2)
    chosen = {"disparities": (0, 32), "planar": (25, 13), "speckle": (50, 1.0), "fill": "background"}
    one = matched(scene, **chosen)
    other = matched(scene, keep=("costs",), **chosen)
    assert (one.path, other.path) == ("streaming", "composed")
    assert same(one, other)


def test_doubtful_answers_are_refused(street):
    chosen = {"slant": "road", "planar": (25, 13), "confidence": "calibrated"}
    every, sure = matched(street, **chosen), matched(street, **chosen, least_confidence=0.9)
    doubted = (every.flags == 0) & (every.confidence < 0.9)
    assert doubted.any()
    np.testing.assert_array_equal(np.isnan(sure.disparity), np.isnan(every.disparity) | doubted)
    assert (sure.flags[doubted] == Flag.MISMATCHED).all()
    filled = matched(street, **chosen, least_confidence=0.9, fill="background")
    assert np.isfinite(filled.disparity).all()
    assert (filled.flags & Flag.FILLED != 0)[filled.confidence < 0.9].all()


@pytest.mark.parametrize("rule", ["background", "interpolate", "surfaces"])
def test_what_is_doubtful_is_filled_once_more(street, rule):
    chosen = {"confidence": "calibrated", "fill": rule}
    once, again = matched(street, **chosen), matched(street, **chosen, least_confidence=0.9)
    doubtful = (once.flags & Flag.FILLED != 0) | (once.confidence < 0.9)
    np.testing.assert_array_equal(again.flags & Flag.FILLED != 0, doubtful)
    trusted = np.where(doubtful, np.float32(np.nan), once.disparity)
    grey = cost.pixels(street.left, street.right, "grey", 1).left
    refilled = {
        "background": lambda: fill.background(trusted),
        "interpolate": lambda: fill.interpolate(trusted, again.flags),
        "surfaces": lambda: fill.surfaces(trusted, again.flags, grey),
    }[rule]()
    expected = fill.nearer(once.disparity, doubtful, refilled)
    assert (expected > once.disparity).any()
    np.testing.assert_array_equal(again.disparity, expected)


def test_what_lies_beside_the_right_image_is_out_of_view():
    # A wall at disparity 12 fills both images: the left one's first 12 columns are not in the right one.
    scene = st.scenes.plane(120, 60, disparity=12)
    result = matched(scene, disparities=(0, 32), subpixel=None, optimize=SGM(p1=500, p2=4000))
    np.testing.assert_array_equal(result.flags[10:-10, :8], Flag.OUT_OF_VIEW)
    assert (result.disparity[10:-10, 14:] == 12).mean() > 0.99


@pytest.mark.parametrize("threads", [2, 7])
@pytest.mark.parametrize("preset", ["balanced", "accurate"])
def test_presets_answer_every_pixel_and_not_by_the_threads(preset, threads, street):
    one = st.match(street.left, street.right, disparities=(0, 64), preset=preset, threads=1)
    other = st.match(street.left, street.right, disparities=(0, 64), preset=preset, threads=threads)
    assert same(one, other)
    assert np.isfinite(one.disparity).all()
    assert (off(one, street) > 3).mean() < 0.06


@pytest.mark.parametrize("shape", [(1, 1), (1, 70), (70, 1), (9, 9)])
@pytest.mark.parametrize("preset", ["fast", "balanced", "accurate"])
def test_presets_on_degenerate_images(preset, shape):
    y, x = np.indices(shape)
    for values in (np.zeros(shape), x % 2 * 255, (x + y) * 3):
        image = values.astype(np.uint8)
        result = st.match(image, image, disparities=(0, 16), preset=preset)
        assert result.disparity.shape == shape
        assert (np.isfinite(result.disparity) | (result.flags != 0)).all()


def test_planes_do_not_lean_out_of_the_range(street):
    result = matched(street, slant="road", planar=(25, 13), fill="background", disparities=(3, 20))
    assert result.disparity.min() >= 3
    assert result.disparity.max() <= 19


def test_a_floor_lets_the_ground_go_on_level():
    right = np.arange(40, dtype=np.uint8).reshape(1, 40, 1).repeat(6, axis=0)
    plane = slant.Plane(0.0, 1.0, -3.0)  # disparities -3, -2, ..., 2 by rows
    _, moved = slant.warped(right, right, plane, 0, floor=0.0)
    for row, disparity in enumerate((0, 0, 0, 0, 1, 2)):
        np.testing.assert_array_equal(moved[row, 5:, 0], np.arange(5, 40) - disparity)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"slant": "planes"}, "slant must be 'road' or None"),
        ({"slant": "road", "extra_windows": (9,)}, "extra_windows empty"),
        ({"slant": "road", "cost": st.ZNCC(9)}, "slant goes with what streams alone"),
        ({"slant": "road", "cost": Census(11, aggregation=3)}, "3 with up to"),
        ({"slant": "road", "optimize": SGM(unit=0.5)}, "a unit of at least 1"),
        ({"slant": "road", "channels": "separate"}, "channels grey"),
        ({"slant": "road", "keep": ("right_disparity",)}, "right_disparity"),
        ({"planar": 0}, "planar|window|side"),
        ({"least_confidence": 2}, "a number from 0 to 1"),
    ],
)
def test_what_does_not_go_together_is_refused(given, message):
    with pytest.raises(ValueError, match=message):
        st.Settings(**{"cost": CENSUS, "optimize": SMOOTH, **given})
