"""The range of disparities, estimated from the images alone."""

import os
from pathlib import Path

import numpy as np
import pytest

import stereopsis as st
from stereopsis.pipeline import estimate_disparities

DATA = Path(os.environ.get("STEREOPSIS_DATA") or Path(__file__).parents[2] / "shared" / "data")


def covered(found, disparity, seen):
    """The share of the visible pixels whose two nearest candidates are in the range."""
    true = disparity[np.isfinite(disparity) & seen]
    return np.mean((true >= found.min) & (true <= found.max - 1))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("size", [(320, 160), (620, 187)])
def test_a_street_is_covered(seed, size):
    scene = st.scenes.street(*size, seed, gray=True, samples=1)
    found = estimate_disparities(scene.left, scene.right)
    assert covered(found, scene.disparity, ~scene.occluded) > 0.995
    assert found.min >= 0
    assert found.span <= size[0] // 2


@pytest.mark.parametrize(
    "trouble", [{"noise": 6.0}, {"exposure": 1.5, "offset": 10}, {"fog": 0.02}, {"blur": (0.0, 1.5)}]
)
def test_a_street_is_covered_in_bad_conditions(trouble):
    scene = st.scenes.street(440, 200, 7, gray=True, samples=1, **trouble)
    found = estimate_disparities(scene.left, scene.right)
    assert covered(found, scene.disparity, ~scene.occluded) > 0.99
    assert found.span <= 220


@pytest.mark.parametrize("true", [3.0, 20.5, 70.0, -12.0])
@pytest.mark.parametrize("width", [240, 600])
def test_a_plane_is_covered_tightly(width, true):
    scene = st.scenes.plane(width, 90, 2, disparity=true, gray=True)
    found = estimate_disparities(scene.left, scene.right)
    assert found.min <= true <= found.max - 1
    # three shrunken pixels on both sides, and their rounding
    assert found.span <= 12 * -(-width // 256)


def test_colour_and_dtype_hardly_matter():
    scene = st.scenes.street(320, 160, 3, samples=1)
    expected = estimate_disparities(scene.left, scene.right)
    for dtype, scale in ((np.uint16, 16), (np.float32, 1 / 255)):
        images = [(image * scale).astype(dtype) for image in (scene.left, scene.right)]
        found = estimate_disparities(*images)
        assert abs(found.min - expected.min) <= 2
        assert abs(found.max - expected.max) <= 2


def test_the_same_images_give_the_same_range():
    scene = st.scenes.street(320, 160, 4, gray=True, samples=1)
    once = estimate_disparities(scene.left, scene.right, threads=1)
    assert once == estimate_disparities(scene.left.copy(), scene.right.copy(), threads=3)


@pytest.mark.parametrize("value", [0, 255])
def test_nothing_to_match_is_a_quarter_of_the_width(value):
    image = np.full((100, 200), value, np.uint8)
    assert estimate_disparities(image, image) == (0, 50)


@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (2, 1), (1, 500), (500, 1), (3, 600), (1, 300, 3), (7, 5)])
@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_tiny_images_have_a_range_too(shape, dtype):
    image = np.random.default_rng(1).integers(0, 256, shape).astype(dtype)
    found = estimate_disparities(image, image)
    assert found.min < found.max
    assert np.isfinite(st.match(image, image, cost="sad").disparity).any()


def test_match_uses_and_reports_the_estimate():
    scene = st.scenes.street(320, 160, 5, gray=True, samples=1)
    result = st.match(scene.pair, cost="sad")
    assert result.settings.disparities == estimate_disparities(scene.left, scene.right)
    assert next(iter(result.timings)) == "range"
    assert "range" not in st.match(scene.pair, cost="sad", disparities=(0, 9)).timings


def real_pairs():
    if not DATA.is_dir():
        return []
    driving = sorted(DATA.glob("drivingstereo/*-left.jpg"))[::3]
    kitti = sorted(DATA.glob("kitti2015/training/image_2/*_10.png"))[::4]
    pairs = [
        (
            left,
            Path(str(left).replace("-left.jpg", "-right.jpg")),
            Path(str(left).replace("-left.jpg", "-disparity.png")),
        )
        for left in driving
    ]
    return pairs + [
        (left, left.parents[1] / "image_3" / left.name, left.parents[1] / "disp_noc_0" / left.name)
        for left in kitti
    ]


@pytest.mark.skipif(not real_pairs(), reason="the real pairs are not here")
def test_real_pairs_are_covered():
    for left, right, truth in real_pairs():
        pair, disparity = st.read_pair(left, right), st.read_disparity(truth)
        found = estimate_disparities(pair.left, pair.right)
        share = covered(found, disparity, np.ones_like(disparity, bool))
        assert share > 0.97, f"{left.name}: {found} holds {share:.1%}"
        assert found.span <= pair.left.shape[1] // 2, left.name
