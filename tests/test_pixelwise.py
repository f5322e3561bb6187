import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

import stereopsis as st
from reference import pixelwise as reference
from stereopsis import cost, pixelwise
from stereopsis._fused import ENVIRONMENT, instruction_sets
from stereopsis.types import Disparities

odd = some.sampled_from([1, 3, 5, 7, 9, 11])
boxes = some.tuples(some.sampled_from([1, 3, 5]), some.sampled_from([1, 3, 7]))
patterns = some.sampled_from(["dense", "sparse", "symmetric"])
windows = some.tuples(odd, odd).filter(lambda window: window != (1, 1))
censuses = some.builds(st.Census, windows, patterns, boxes)


def strided(array):
    """The same array, read-only and not contiguous."""
    wide = np.repeat(np.repeat(array, 2, axis=0), 3, axis=1)
    view = wide[::2, ::-3][:, ::-1]
    view.flags.writeable = False
    np.testing.assert_array_equal(view, array)
    return view


@some.composite
def pairs(draw):
    height, width = draw(some.integers(1, 6)), draw(some.integers(1, 9))
    dtype = draw(some.sampled_from([np.uint8, np.uint16, np.float32]))
    rng = np.random.default_rng(draw(some.integers(0, 2**32)))
    top = min(draw(some.sampled_from([2, 5, 256, 65536])), 256 if dtype == np.uint8 else 65536)
    shape = (height, width, 3) if draw(some.booleans()) else (height, width)
    left, right = (rng.integers(0, top, shape).astype(dtype) for _ in range(2))
    return (left / 8 - 3, right / 8 - 3) if dtype == np.float32 else (left, right)


@some.composite
def ranges(draw, width=9):
    first = draw(some.integers(-width - 1, width + 1))
    return Disparities(first, first + draw(some.integers(1, 2 * width + 2)))


def defined(cost, pixels, disparities):
    """The cost's volume by its definition."""
    total = 0
    for channel in range(pixels[0].shape[2]):
        planes = [image[..., channel].astype(np.int64) for image in pixels[:2]]
        match cost:
            case st.Census():
                size = cost.window if isinstance(cost.window, tuple) else (cost.window,) * 2
                features = [reference.census(plane, size, cost.pattern) for plane in planes]
                between = reference.hamming
        total = total + reference.volume(features, between, range(*disparities), cost.box)
    return np.minimum(total, reference.WORST)


# ---- census, by hand -----------------------------------------------------------------------------


def test_census_bits_by_hand():
    image = np.array([[1, 5, 3], [9, 5, 7], [5, 2, 5]], np.uint8)
    # Around the middle, row by row: 1 < 5, 5, 3 < 5, 9, 7, 5, 2 < 5, 5.
    assert pixelwise.census(image, st.Census(3).comparisons)[0, 1, 1] == 0b01000101
    # 1 < 5, 5 < 2 not, 3 < 5, 9 < 7 not.
    symmetric = st.Census(3, "symmetric").comparisons
    assert pixelwise.census(image, symmetric)[0, 1, 1] == 0b0101
    # The corners alone.
    assert pixelwise.census(image, st.Census(3, "sparse").comparisons)[0, 1, 1] == 0b0011
    # At the upper left corner the edge repeats: 1 1 5 / 1 . 5 / 9 9 5 around 1.
    assert pixelwise.census(image, st.Census(3).comparisons)[0, 0, 0] == 0
    # At the lower right one: 5 7 7 / 2 . 5 / 2 5 5 around 5.
    assert pixelwise.census(image, st.Census(3).comparisons)[0, 2, 2] == 0b00101000


def test_bits_beyond_a_word_are_in_the_second_plane():
    image = np.full((11, 11), 1, np.int32)
    image[10, 9] = 0
    strings = pixelwise.census(image, st.Census(11).comparisons)
    assert strings.shape == (2, 11, 11)
    assert strings[0, 5, 5] == 0
    assert strings[1, 5, 5] == 1 << (118 - 64)


@pytest.mark.parametrize(
    ("cost", "bits"),
    [
        (st.Census((9, 7)), 62),
        (st.Census((9, 7), "symmetric"), 31),
        (st.Census((9, 7), "sparse"), 20),
        (st.Census((9, 9), "sparse"), 24),
        (st.Census(11), 120),
        (st.Census(11, "symmetric"), 60),
        (st.Census((1, 3)), 2),
    ],
)
def test_number_of_comparisons(cost, bits):
    assert cost.most == len(cost.comparisons) == bits


def test_volume_by_hand():
    left, right = np.array([[1, 2, 0]], np.uint8), np.array([[1, 0, 2]], np.uint8)
    # Bits (left neighbour darker, right neighbour darker): left 00 11 00, right 01 00 10.
    got = st.match(
        left, right, cost=st.Census((3, 1)), disparities=(-1, 3), subpixel=None, keep=("costs",)
    ).stages["costs"]
    assert got.dtype == np.uint16
    w = pixelwise.WORST
    np.testing.assert_array_equal(got, [[[0, 1, w, w], [1, 2, 1, w], [w, 1, 0, 1]]])
    # Summed over three columns, each image's edges repeated.
    got = st.match(
        left,
        right,
        cost=st.Census((3, 1), aggregation=(3, 1)),
        disparities=(0, 1),
        subpixel=None,
        keep=("costs",),
    ).stages["costs"]
    np.testing.assert_array_equal(got[..., 0], [[1 + 1 + 2, 1 + 2 + 1, 2 + 1 + 1]])


# ---- against the definition ----------------------------------------------------------------------


def assert_is_definition(cost_of_pixels, images, disparities, channels="separate"):
    pixels = cost.pixels(*images, channels)
    expected = defined(cost_of_pixels, pixels, disparities)
    for threads in (1, 3):
        got = pixelwise.volume(cost_of_pixels, *pixels[:2], disparities, threads)
        assert got.dtype == np.uint16
        np.testing.assert_array_equal(got, expected)


@given(census=censuses, images=pairs(), disparities=ranges())
@settings(max_examples=60, deadline=None)
def test_any_census(census, images, disparities):
    assert_is_definition(census, images, disparities)


@given(images=pairs(), window=windows, pattern=patterns)
@settings(max_examples=40, deadline=None)
def test_strings_of_any_image(images, window, pattern):
    image = cost.pixels(*images).left[..., 0]
    strings = pixelwise.census(image, st.Census(window, pattern).comparisons, 3)
    expected = reference.census(image.astype(np.int64), window, pattern)
    k = np.arange(expected.shape[2])
    bits = strings[k // 64].transpose(1, 2, 0) >> (k % 64).astype(np.uint64) & np.uint64(1)
    np.testing.assert_array_equal(bits, expected)


@pytest.mark.parametrize("instructions", instruction_sets())
@pytest.mark.parametrize(
    "cost", [st.Census(5), st.Census((9, 7), aggregation=3), st.Census(11, aggregation=(5, 1))]
)
def test_every_instruction_set(monkeypatch, instructions, cost):
    rng = np.random.default_rng(4)
    left, right = (rng.integers(0, 256, (7, 333, 1), np.uint8) for _ in range(2))
    expected = pixelwise.volume(cost, left, right, Disparities(-3, 134))
    monkeypatch.setenv(ENVIRONMENT, instructions)
    np.testing.assert_array_equal(pixelwise.volume(cost, left, right, Disparities(-3, 134)), expected)


# ---- invariances ---------------------------------------------------------------------------------


@given(census=censuses, seed=some.integers(0, 2**32))
@settings(max_examples=30, deadline=None)
def test_census_is_blind_to_an_increasing_change_of_brightness(census, seed):
    rng = np.random.default_rng(seed)
    right = rng.integers(0, 256, (6, 11)).astype(np.uint8)
    curve = np.cumsum(rng.integers(1, 200, 256)).astype(np.uint16)
    volumes = [
        pixelwise.census(image, census.comparisons) for image in (right, curve[right].astype(np.int32))
    ]
    np.testing.assert_array_equal(*volumes)


def test_a_shifted_image_is_found():
    scene = st.scenes.plane(96, 48, disparity=7)
    for census in (st.Census(), st.Census((7, 5), "symmetric"), st.Census(9, "sparse", 3)):
        found = st.match(scene.left, scene.right, disparities=(0, 16), cost=census)
        inside = found.disparity[8:-8, 24:-8]
        assert np.mean(abs(inside - 7) < 0.5) > 0.97
        assert found.path == "composed"


# ---- settings ------------------------------------------------------------------------------------


@given(census=censuses)
def test_round_trip(census):
    chosen = st.Settings(cost=census)
    assert st.Settings.from_toml(chosen.to_toml()) == chosen
    assert pixelwise.cost_of(str(census)) == census


def test_texts():
    make = st.Settings.make
    assert make(assignments=["cost=census"]).cost == st.Census()
    assert make(assignments=["cost=census", "window=5", "aggregation=3x1"]).cost == st.Census(
        5, aggregation=(3, 1)
    )
    assert make(assignments=["cost=Census(7x5, pattern=sparse, aggregation=3)"]).cost == st.Census(
        (7, 5), "sparse", 3
    )
    assert make(assignments=["cost=census"]).changed(cost="zncc").cost == st.ZNCC()
    assert make(assignments=["cost=census"]).to_dict()["cost"] == {
        "name": "census",
        "window": [9, 7],
        "pattern": "dense",
        "aggregation": [1, 1],
    }


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("cost=cencus", "did you mean 'census'"),
        ("cost=census(9x8)", "window must have odd sides from 1 to 11, not 9 x 8"),
        ("cost=census(13)", "window must have odd sides from 1 to 11"),
        ("cost=census(1)", "must hold a neighbour"),
        ("cost=census(9, thick)", "pattern must be one of dense, sparse, symmetric"),
        ("cost=census(9, patern=dense)", "did you mean 'pattern'"),
        ("cost=census(9, window=7)", "window twice"),
        ("cost=census(9,dense,1,1)", "up to 3 parts"),
        ("cost=census(9", "close its parentheses"),
        ("cost=census(11,dense,25)", "sum to 75000, and 16 bits hold up to 65534"),
        ("aggregation=3", "cost=ZNCC has no aggregation"),
        ("cost=zncc(9)", "window apart"),
    ],
)
def test_errors(text, message):
    with pytest.raises(ValueError, match=message.replace("(", r"\(")):
        st.Settings.make(assignments=[text])


@pytest.mark.parametrize("other", [{"slant": "road"}, {"extra_windows": (31,)}, {"upsample": (2, "linear")}])
def test_what_census_does_not_go_with(other):
    with pytest.raises(ValueError, match=r"cost must be one of sad.* not census"):
        st.Settings(cost=st.Census(), **other)


def test_three_channels_need_room():
    cost = st.Census(11, aggregation=21)
    assert st.Settings(cost=cost).cost == cost
    with pytest.raises(ValueError, match="52920 in each of three channels"):
        st.Settings(cost=cost, channels="separate")
