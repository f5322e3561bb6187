"""Black borders: what their definition says, and matching that does not see them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from PIL import Image

import stereopsis as st
from reference import blank as reference
from stereopsis import blank
from stereopsis.types import Rectangle

RULES = blank.LEAST, blank.FEW, blank.DARK, blank.NOISY, blank.MOST, blank.BLENDED


def outline(shape, left, right, top, bottom):
    """The border of an image whose lens has been undone: its sides bow inwards, by 8 pixels."""
    y, x = np.ogrid[: shape[0], : shape[1]]
    across, down = 8 * np.sin(x / shape[1] * np.pi), 8 * np.sin(y / shape[0] * np.pi)
    height, width = shape
    return (
        (x < left + down) | (x >= width - right - down) | (y < top + across) | (y >= height - bottom - across)
    )


def bordered(image, *sides):
    shown = image.copy()
    shown[outline(image.shape[:2], *sides)] = 0
    return shown


@some.composite
def images(draw):
    height, width = draw(some.integers(1, 30)), draw(some.integers(1, 40))
    channels = draw(some.sampled_from([(), (3,)]))
    rng = np.random.default_rng(draw(some.integers(0, 2**32 - 1)))
    image = rng.integers(0, draw(some.sampled_from([2, 12, 256])), (height, width, *channels))
    image = image.astype(draw(some.sampled_from([np.uint8, np.uint16, np.float32])))
    ends = some.integers(0, max(height, width))
    slope = draw(some.sampled_from([0, 0.5, 2]))
    y, x = np.ogrid[:height, :width]
    image[(x < draw(ends) + slope * y) | (y < draw(ends) - slope * x)] = 0
    image[(x >= width - draw(ends) / 3) | (y >= height - draw(ends) / 3)] = 0
    return image


@given(
    image=images(), seed=some.integers(0, 2**32 - 1), band=some.integers(1, 12), threads=some.integers(1, 3)
)
@settings(max_examples=300, deadline=None)
def test_borders_are_their_definition(image, seed, band, threads):
    height, width = image.shape[:2]
    found, wanted = blank.border(image), reference.border(image, *RULES)
    assert (found is None) == (wanted is None)
    in_bands = blank.border_of(
        lambda: ((y, image[y : y + band]) for y in range(0, height, band)), image.shape
    )
    assert (in_bands is None) == (found is None)
    if found is None or in_bands is None:
        return
    for mine, others in zip(found, in_bands, strict=True):
        np.testing.assert_array_equal(mine, others)
    np.testing.assert_array_equal(found.rows, wanted[0])
    np.testing.assert_array_equal(found.columns, wanted[1])
    mask, whole = found.blank(), found.continued(image, threads=threads)
    np.testing.assert_array_equal(mask, reference.blank(*wanted))
    np.testing.assert_array_equal(whole, reference.continued(image, *wanted))
    rng = np.random.default_rng(seed)
    top, left = rng.integers(0, height), rng.integers(0, width)
    part = Rectangle(top, rng.integers(top, height) + 1, left, rng.integers(left, width) + 1)
    np.testing.assert_array_equal(found.blank(part), mask[part.slices])
    np.testing.assert_array_equal(found.continued(image[part.slices], part, threads), whole[part.slices])
    disparity = rng.integers(-20, 160, (height, width)).astype(np.float32) / 4
    disparity[rng.random(disparity.shape) < 0.2] = np.nan
    for borders in ((found, None), (None, found), (found, found)):
        for of_right in (False, True):
            here, there = (None if one is None else mask for one in (borders[::-1] if of_right else borders))
            answer = reference.hidden(disparity, here, there, -1 if of_right else 1)
            mine = blank.hidden(disparity, borders, None, of_right, threads)
            np.testing.assert_array_equal(mine, answer)
            mine = blank.hidden(disparity[part.slices], borders, part, of_right, threads)
            np.testing.assert_array_equal(mine, answer[part.slices])


def test_a_dark_image_has_no_border():
    rng = np.random.default_rng(1)
    dark = rng.integers(0, 9, (60, 80)).astype(np.uint8)
    assert blank.border(dark) is None
    assert blank.border(np.zeros((60, 80), np.uint8)) is None
    dark[20:40, 20:60] = 0  # nothing that reaches a side
    assert blank.border(dark) is None


@pytest.mark.parametrize("quality", [75, 90])
def test_the_noise_of_a_lossy_file_belongs_to_the_border(quality, tmp_path):
    street = st.scenes.street(320, 160, 4)
    sides = 20, 5, 4, 12
    Image.fromarray(bordered(street.left, *sides)).save(tmp_path / "left.jpg", quality=quality)
    image = st.read_image(tmp_path / "left.jpg")
    mask = outline(image.shape[:2], *sides)
    assert (image[mask] > 0).any()
    found = blank.border(image)
    assert found is not None
    assert found.blank()[mask].mean() > 0.99
    assert found.blank()[~mask].mean() < 0.05


@pytest.fixture(scope="module")
def street():
    return st.scenes.street(480, 240, 4, noise=1)


def wrong(result, street, mask):
    off = np.abs(result.disparity - street.disparity)
    known = np.isfinite(street.disparity) & ~street.occluded & ~street.sky & ~mask
    return np.mean(~(off[known] <= 3))


@pytest.mark.parametrize("preset", ["fast", "balanced", "accurate", "local"])
def test_a_border_is_not_matched(street, preset):
    left, right = bordered(street.left, 18, 5, 3, 16), bordered(street.right, 4, 20, 12, 5)
    here, there = (outline(left.shape[:2], *sides) for sides in ((18, 5, 3, 16), (4, 20, 12, 5)))
    chosen = st.PRESETS[preset].changed(disparities=(0, 64), fill="background")
    plain = st.match(street.left, street.right, settings=chosen)
    found = st.match(left, right, settings=chosen)
    # Of what both images show.
    y, x = np.indices(here.shape)
    match = np.clip(np.rint(x - np.nan_to_num(street.disparity)), 0, here.shape[1] - 1).astype(int)
    gone = here | there[y, match]
    assert wrong(found, street, gone) < wrong(plain, street, gone) + 0.01
    seen = st.match(left, right, settings=chosen.changed(blank=False))
    assert wrong(found, street, gone) < wrong(seen, street, gone)
    flagged = (found.flags & st.Flag.OUT_OF_VIEW) != 0
    assert flagged[here].all()
    assert not found.confidence[here].any()
    assert not (found.flags[here] & st.Flag.SKY).any()
    assert np.isfinite(found.disparity).all()
    unfilled = st.match(left, right, settings=chosen.changed(fill=None, outlines=False))
    assert np.isnan(unfilled.disparity[here]).all()


def test_nothing_of_the_right_view_s_map_is_told_of_its_border(street):
    right = bordered(street.right, 4, 20, 12, 5)
    chosen = st.Settings(disparities=(0, 48), cost=st.ZNCC(9), left_right=1.0, blank=True)
    stage = st.match(street.left, right, settings=chosen, keep=("right_disparity",)).stages["right_disparity"]
    assert np.isnan(stage[outline(right.shape[:2], 4, 20, 12, 5)]).all()
    assert np.isfinite(stage).mean() > 0.5


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_a_border_in_another_type_is_the_same_border(street, dtype):
    left, right = bordered(street.left, 18, 5, 3, 16), bordered(street.right, 4, 20, 12, 5)
    wanted = st.match(left, right, preset="balanced", disparities=(0, 48))
    found = st.match(left.astype(dtype), right.astype(dtype), preset="balanced", disparities=(0, 48))
    assert found.disparity.tobytes() == wanted.disparity.tobytes()
    assert found.flags.tobytes() == wanted.flags.tobytes()


def test_images_are_not_changed(street):
    left = bordered(street.left, 18, 5, 3, 16)
    kept = left.copy()
    st.match(left, street.right, preset="fast", disparities=(0, 48))
    np.testing.assert_array_equal(left, kept)
