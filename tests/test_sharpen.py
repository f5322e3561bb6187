"""Sharpening: to the bit what its definition says, and by as much as an image is blurred."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

import stereopsis as st
from reference import sharpen as reference
from stereopsis import _fused, sgm, sharpen

ACCURATE = {"disparities": (0, 24), "preset": "accurate"}


def bits(result):
    return result.disparity.tobytes(), result.confidence.tobytes(), result.flags.tobytes()


def noise(shape, seed=0, dtype=np.uint8, top=256):
    return np.random.default_rng(seed).integers(0, top, shape).astype(dtype)


def blurred(image, times):
    """Bytes after so many passes of 1, 2, 1 along rows and columns."""
    values = image.astype(np.float64)
    for axis in (0, 1) * times:
        before, after = (np.roll(values, shift, axis) for shift in (1, -1))
        values = (before + 2 * values + after) / 4
    return np.rint(values).astype(np.uint8)


# ---- the kernel ----------------------------------------------------------------------------------


def test_a_point_by_hand():
    image = np.zeros((5, 5, 1), np.uint8)
    image[2, 2] = 64
    sharp = sharpen.sharpened(image, 1.0)
    # 64 + (64 - 36 / 256 * 64) = 119; all around is pushed below black.
    assert sharp[2, 2, 0] == 119
    assert np.count_nonzero(sharp) == 1
    wide = sharpen.sharpened(image.astype(np.int32), 1.0)
    # -24 / 256 * 64 = -6 beside it, -1 / 256 * 64 = -1/4 in the corners: rounded to 0.
    assert wide[2].ravel().tolist() == [-1, -6, 119, -6, -1]
    assert wide[0].ravel().tolist() == [0, -1, -1, -1, 0]


def test_what_is_straight_stays():
    ramp = np.arange(40, dtype=np.uint8)[:, None, None] * np.ones((1, 9, 3), np.uint8)
    inner = sharpen.sharpened(ramp, 0.75)[2:-2]
    np.testing.assert_array_equal(inner, ramp[2:-2])


@given(
    shape=some.tuples(some.integers(1, 9), some.integers(1, 12), some.sampled_from([1, 3])),
    dtype=some.sampled_from([np.uint8, np.int32]),
    sixtyfourths=some.integers(0, 256),
    threads=some.sampled_from([1, 3]),
    strided=some.booleans(),
    seed=some.integers(0, 2**32 - 1),
)
@settings(max_examples=80, deadline=None)
def test_as_the_definition_has_it(shape, dtype, sixtyfourths, threads, strided, seed):
    image = noise((shape[0], 2 * shape[1], shape[2]), seed, dtype, 256 if dtype == np.uint8 else 2**24)
    image = image[::-1, ::2] if strided else image[:, : shape[1]]
    before = image.copy()
    sharp = sharpen.sharpened(image, sixtyfourths / 64, threads)
    assert sharp.dtype == dtype
    np.testing.assert_array_equal(sharp, reference.sharpened(image, sixtyfourths))
    np.testing.assert_array_equal(image, before)


# ---- how much ------------------------------------------------------------------------------------


@given(
    shape=some.tuples(some.integers(1, 9), some.integers(1, 12), some.sampled_from([1, 3])),
    dtype=some.sampled_from([np.uint8, np.int32]),
    seed=some.integers(0, 2**32 - 1),
)
@settings(max_examples=40, deadline=None)
def test_steps(shape, dtype, seed):
    image = noise(shape, seed, dtype, 256 if dtype == np.uint8 else 2**16)
    assert sharpen.steps(image).tolist() == list(reference.steps(image, sharpen.COLUMNS))


def test_bands_add_up_to_the_whole():
    image = noise((50, 31, 1))
    parts = [sharpen.steps(image[top : top + 12]) for top in range(0, 50, 10)]
    assert sum(parts).tolist() == sharpen.steps(image).tolist()


@pytest.mark.parametrize(
    ("near", "far", "amount"),
    [(1, 4, 0.75), (0.38, 1, 0.75), (0.39, 1, 0.45), (0.405, 1, 0), (1, 2, 0), (0, 0, 0)],
)
def test_amounts(near, far, amount):
    assert sharpen.amount_for(np.array([near, far], float)) == pytest.approx(amount, abs=1e-9)


def test_what_is_blurred_gets_more():
    image = noise((200, 120))
    amounts = [sharpen.amount_for(sharpen.steps(blurred(image, times)[..., None])) for times in (0, 2)]
    assert amounts == [0, 0.75]
    assert sharpen.amount_for(sharpen.steps(image[:2, :, None])) == 0


# ---- in the pipeline -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def pair():
    scene = st.scenes.street(180, 120, seed=3)
    return st.Pair(scene.left, scene.right)


def test_amount_nothing_changes_nothing(pair):
    bare = st.match(pair, **ACCURATE, sharpen=None)
    assert bits(st.match(pair, **ACCURATE, sharpen=0)) == bits(bare)
    assert bits(st.match(pair, **ACCURATE, sharpen=0.75)) != bits(bare)


def test_auto_is_the_amount_that_the_left_image_needs(pair):
    soft = st.Pair(*(np.stack([blurred(image.mean(2), 2)] * 3, axis=2) for image in (pair.left, pair.right)))
    bits_of = {how: bits(st.match(soft, **ACCURATE, sharpen=how)) for how in (None, 0.75, "auto")}
    assert bits_of["auto"] == bits_of[0.75] != bits_of[None]


def test_threads_do_not_matter(pair):
    one, three = (bits(st.match(pair, **ACCURATE, sharpen=0.6, threads=threads)) for threads in (1, 3))
    assert one == three


@pytest.mark.parametrize("image", ["grey", "16 bits"])
def test_composed_and_streaming_agree(pair, image):
    left, right = (picture.mean(2).astype(np.uint8) for picture in (pair.left, pair.right))
    if image == "16 bits":
        left, right = (picture.astype(np.uint16) * 7 for picture in (left, right))
    chosen = {
        "disparities": (0, 24),
        "cost": st.Census((9, 7), aggregation=3),
        "optimize": st.SGM(paths=4, p1=140, p2=1100, p2_min=400, contrast=20, unit=8),
        "left_right": 1.0,
        "sharpen": 0.6,
    }
    streaming = st.match(left, right, **chosen)
    composed = st.match(left, right, **chosen, keep=("right_disparity",))
    assert (streaming.path, composed.path) == ("streaming", "composed")
    assert bits(streaming) == bits(composed)


def test_p2_follows_the_image_as_it_is(pair):
    """What is matched is sharper; edges are those of the image."""
    left, right = (picture.mean(2).astype(np.uint8)[..., None] for picture in (pair.left, pair.right))
    census, solver = st.Census((9, 7)), st.SGM(paths=4, p1=16, p2=120, p2_min=40, contrast=20)
    sharper = [sharpen.sharpened(picture, 0.6) for picture in (left, right)]
    pixels = st.cost.Pixels(*sharper, 1.0)
    found = _fused.match_sgm(
        census, pixels, st.Disparities(0, 24), solver, "parabola", 1.0, None, 1, guide=left[..., 0]
    )
    options = {"disparities": (0, 24), "cost": census, "optimize": solver, "left_right": 1.0}
    result = st.match(left[..., 0], right[..., 0], **options, sharpen=0.6)
    assert isinstance(result.settings.optimize, sgm.SGM)
    np.testing.assert_array_equal(result.disparity, found[0])
    np.testing.assert_array_equal(result.flags, found[2])


@pytest.mark.parametrize("how", [None, "auto", 0.5, 4])
def test_settings_through_text(how):
    chosen = st.Settings(cost=st.Census((9, 7)), sharpen=how)
    assert st.Settings.from_toml(chosen.to_toml()) == chosen
    assert chosen == st.Settings.make(assignments=["cost=census(9x7)", f"sharpen={how}"])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sharpen": -0.1}, "sharpen must be a number from 0 to 4"),
        ({"sharpen": 4.1}, "sharpen must be a number from 0 to 4"),
        ({"sharpen": "more"}, 'sharpen must be a number from 0 to 4, "auto", or None'),
        ({"sharpen": True}, "sharpen must be"),
        ({"sharpen": 0.5, "cost": st.ZNCC(9)}, "sharpen goes with cost=Census or Rank, not ZNCC"),
    ],
)
def test_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        st.Settings(**{"cost": st.Census((9, 7)), **changes})
