import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as some

import stereopsis as st
from stereopsis import quantum
from stereopsis.settings import PRESETS, Settings

OTHER_TYPES = {
    "as they are": lambda image: image.astype(np.uint16),
    "times 16": lambda image: image.astype(np.uint16) * 16,
    "of 16 bits": lambda image: image.astype(np.uint16) * 257,
    "whole floats": lambda image: image.astype(np.float32),
    "fractions": lambda image: image.astype(np.float32) / np.float32(255),
    "fractions of doubles": lambda image: (image / 255).astype(np.float32),
}


@pytest.mark.parametrize(
    ("image", "step"),
    [
        (np.uint8([[0, 255]]), None),
        (np.uint16([[0, 255]]), 1),
        (np.uint16([[0, 256]]), 256),
        (np.uint16([[16, 255 * 16]]), 16),
        (np.uint16([[1, 256]]), None),
        (np.uint16([[257, 65535]]), 257),
        (np.uint16([[257, 65534]]), None),
        (np.float32([[0, 255]]), 1),
        (np.float32([[0, 256]]), None),
        (np.float32([[-1, 20]]), None),
        (np.float32([[0.5, 20]]), None),
        (np.float32([[0, 1]]), 1 / 255),
        (np.float32([[2 / 255, 0.8]]), 1 / 255),
        (np.float32([[0.001, 0.8]]), None),
        (np.float32([[-1 / 255, 0.8]]), None),
    ],
    ids=str,
)
def test_steps_by_hand(image, step):
    assert quantum.of((image, image)) == step
    assert quantum.of((image[:, :1], image[:, 1:])) == step
    if step is not None:
        np.testing.assert_allclose(quantum.in_bytes(image, step) * np.float64(step), image, rtol=1e-6)


@given(
    shape=some.tuples(some.integers(1, 90), some.integers(1, 90)),
    kind=some.sampled_from(sorted(OTHER_TYPES)),
    off=some.booleans(),
    seed=some.integers(0, 999),
)
@example(shape=(90, 90), kind="whole floats", off=True, seed=1)
@settings(max_examples=60, deadline=None)
def test_a_single_pixel_off_is_seen(shape, kind, off, seed):
    draw = np.random.default_rng(seed)
    pixels = draw.integers(0, 256, shape, dtype=np.uint8)
    pixels[0, 0] = 251
    image = OTHER_TYPES[kind](pixels)
    if not off:
        np.testing.assert_array_equal(quantum.in_bytes(image, quantum.of((image, image))), pixels)
    else:
        y, x = (draw.integers(0, side) for side in shape)
        image[y, x] = (
            1003 if image.dtype == np.uint16 else image[y, x] + np.float32(0.3 * quantum.of((image,)))
        )
        assert quantum.of((image, OTHER_TYPES[kind](pixels))) is None


@pytest.mark.parametrize("kind", OTHER_TYPES)
@pytest.mark.parametrize("preset", ["fast", "balanced", "accurate", "local"])
def test_the_type_of_8_bit_images_does_not_matter(preset, kind):
    scene = st.scenes.street(320, 140, seed=4, noise=1)
    # Texture counts in the image's own grey levels.
    chosen = PRESETS[preset].changed(disparities=(0, 40), texture=None)
    expected = st.match(scene.left, scene.right, settings=chosen)
    left, right = (OTHER_TYPES[kind](image) for image in (scene.left, scene.right))
    found = st.match(left, right, settings=chosen)
    for name in ("disparity", "confidence", "flags"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert found.settings == expected.settings


@pytest.mark.parametrize("kind", OTHER_TYPES)
def test_texture_counts_in_the_image_s_own_levels(kind):
    scene = st.scenes.street(160, 80, seed=4, noise=1, gray=True)
    left, right = (OTHER_TYPES[kind](image) for image in (scene.left, scene.right))
    factor = {"times 16": 16, "of 16 bits": 257}.get(kind, 1)
    chosen = {"disparities": (0, 40), "cost": st.ZNCC(9), "keep": ("texture",)}
    expected = st.match(scene.left, scene.right, texture=3.0, **chosen)
    found = st.match(left, right, texture=3.0 * factor, **chosen)
    np.testing.assert_array_equal(found.disparity, expected.disparity)
    assert 0.1 < np.mean(found.flags & st.Flag.LOW_TEXTURE > 0) < 0.9
    own = factor if np.ptp(left) > 1 else 1 / 255
    np.testing.assert_allclose(found.stages["texture"], expected.stages["texture"] * own, rtol=1e-5)


@pytest.mark.parametrize(
    ("changes", "wanted"),
    [
        ({}, True),
        ({"cost": st.Census(5), "optimize": st.SGM()}, True),
        ({"cost": st.ZNCC(window=st.Gaussian(3))}, True),
        ({"cost": st.ZNCC(window=st.Bilateral(9, 4, 5))}, False),
        ({"cost": st.SAD(5)}, False),
        ({"cost": st.Gradient(3)}, False),
        ({"upsample": (2, "cubic")}, False),
        ({"optimize": st.SecondPass(st.Smoothness("l1", 0.5), data="zssd")}, False),
    ],
    ids=str,
)
def test_costs_in_grey_levels_take_the_image_as_it_is(changes, wanted):
    assert quantum.wanted(Settings(cost=st.ZNCC(5)).changed(**changes)) is wanted
