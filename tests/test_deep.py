"""16-bit and float images: the same bits by sums of 32 and 64 bits and in doubles, on any machine."""

import itertools

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as some

import stereopsis as st
from reference import cost as reference
from stereopsis import _fused, _instructions, cost
from stereopsis.types import Disparities, worst_cost

SETS = _fused.instruction_sets()
COSTS = (st.SAD, st.SSD, st.ZSSD, st.NCC, st.ZNCC)


def pairs(top, shape, seed=17):
    """Pairs from 0 to `top`, that drive sums over windows to their bounds."""
    rng = np.random.default_rng(seed)
    black, white = np.zeros(shape, np.int64), np.full(shape, top)
    mixed = rng.choice([0, top], shape)
    near = white - (rng.random(shape) < 0.1)
    half = np.where(np.arange(shape[1]) < shape[1] // 2, 0, top) + black
    noise = rng.integers(0, top + 1, shape)
    noise[0, :2] = 0, top
    return {
        "mixed": (mixed, np.roll(mixed, -2, axis=1)),
        "reversed": (mixed, top - np.roll(mixed, -2, axis=1)),
        "near": (np.roll(near, 1, axis=1), near),
        "near, black": (near, black),
        "half": (half, np.roll(half, -2, axis=1)),
        "half, reversed": (half, top - half),
        "noise": (noise, np.roll(noise, -3, axis=1)),
        "white, noise": (white, noise),
    }


def bits(result):
    return result.disparity.tobytes(), result.confidence.tobytes(), result.flags.tobytes()


def assert_on_every_set(left, right, threads=(1,), **chosen):
    definition = st.match(left, right, keep=("costs",), **chosen)
    assert definition.path == "composed"
    for instructions, count in itertools.product(SETS, threads):
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv(_instructions.ENVIRONMENT, instructions)
            streaming = st.match(left, right, threads=count, **chosen)
        assert streaming.path == "streaming"
        assert bits(streaming) == bits(definition), (instructions, count, left.dtype, chosen)
    return definition


# Products fit 32 bits where area * (reach^2 + 1) < 2^31, area * reach < 2^23 and both are below 2^15; reach
# is half of top + 1, downwards. Squared differences fit where area * top^2 < 2^31 - 1, absolute ones where
# area * top is. The first of two fits, the second does not.
BORDERS = [
    *((4095, (73, 7)), (4095, (64, 8))),
    *((4096, (7, 73)), (4097, (7, 73))),
    *((8191, (127, 1)), (8191, (1, 128))),
    *((255, (255, 128)), (255, (255, 129))),
    *((511, (255, 128)), (513, (255, 128))),
    *((65534, (1, 1)), (65535, (1, 1))),
    *((32767, (7, 1)), (32767, (2, 4))),
    *((1, (255, 128)), (65535, (255, 255))),
    *((4095, (64, 2)), (4095, (43, 3))),
    *((46340, (1, 1)), (46341, (1, 1))),
    *((65535, (128, 255)), (65535, (255, 129))),
]


@pytest.mark.parametrize("kind", COSTS)
@pytest.mark.parametrize(("top", "window"), BORDERS, ids=str)
def test_at_the_bounds_of_32_bits(top, window, kind):
    for left, right in pairs(top, (4, 25)).values():
        for least in {0, 65535 - top}:
            images = ((image + least).astype(np.uint16) for image in (left, right))
            assert_on_every_set(*images, disparities=(-3, 6), cost=kind(window), left_right=1, uniqueness=5)


def coloured(image, top):
    """Three channels that are not alike."""
    return np.stack((image, top - image, image[::-1]), axis=-1)


# Of three channels sums are of three times as many.
@pytest.mark.parametrize("kind", COSTS)
@pytest.mark.parametrize(
    ("top", "window"),
    [
        *((4095, (17, 10)), (4095, (19, 9))),
        *((4095, (7, 6)), (4095, (43, 1))),
        *((65535, (127, 86)), (65535, (128, 86))),
    ],
    ids=str,
)
def test_three_channels_at_the_bounds_of_32_bits(top, window, kind):
    for pair in pairs(top, (4, 25)).values():
        images = (coloured(image, top).astype(np.uint16) for image in pair)
        chosen = {"disparities": (-3, 6), "cost": kind(window), "left_right": 1, "uniqueness": 5}
        assert_on_every_set(*images, **chosen, channels="separate")


@pytest.mark.parametrize("kind", COSTS)
@pytest.mark.parametrize("window", [(31, 22), (36, 19)], ids=str)
def test_three_channels_at_the_bounds_of_doubles(window, kind):
    for pair in pairs(2**21 - 1, (4, 25)).values():
        images = ((coloured(image, 2**21 - 1) / 2**21).astype(np.float32) for image in pair)
        chosen = {"disparities": (-3, 6), "cost": kind(window), "left_right": 1, "uniqueness": 5}
        assert_on_every_set(*images, **chosen, channels="separate")


# Floats become 21 bits and a sign: up to 2^20 from the middle where they have one sign, else up to 2^21.
@pytest.mark.parametrize("kind", COSTS)
@pytest.mark.parametrize(
    ("least", "window"), [(0, (89, 23)), (0, (64, 32)), (-1, (73, 7)), (-1, (8, 64))], ids=str
)
def test_at_the_bounds_of_doubles(least, window, kind):
    for left, right in pairs(1, (4, 25)).values():
        rng = np.random.default_rng(3)
        images = [
            image * (1 - least) + least + 0.3 * (image == 0) * rng.random(image.shape)
            for image in (left, right)
        ]
        left, right = (image.astype(np.float32) for image in images)
        left[0, 0], left[0, 1] = least, 1
        assert_on_every_set(left, right, disparities=(-3, 6), cost=kind(window), left_right=1, uniqueness=5)


@pytest.mark.parametrize("window", [(89, 23), (99, 41)], ids=str)
@pytest.mark.parametrize("kind", COSTS)
def test_bright_floats_that_differ_by_little(window, kind):
    """How far they lie from their middle fits 32 bits; how far from 0, with one window, a double."""
    for left, right in pairs(63, (4, 25)).values():
        left, right = (((2**21 - 1 - image) / 2**21).astype(np.float32) for image in (left, right))
        assert_on_every_set(left, right, disparities=(-3, 6), cost=kind(window), left_right=1, uniqueness=5)


@some.composite
def problems(draw):
    height, width = draw(some.integers(1, 9)), draw(some.integers(1, 70))
    colour = draw(some.booleans())
    shape = (height, width, 3) if colour else (height, width)
    top = draw(some.sampled_from([1, 255, 1023, 4095, 4096, 16383, 65535]))
    rng = np.random.default_rng(draw(some.integers(0, 2**32)))
    left = rng.integers(0, top + 1, shape) + draw(some.integers(0, 65535 - top))
    right = np.roll(left, -draw(some.integers(0, 9)), axis=1)
    wrong = rng.random(shape) < 0.2
    right[wrong] = left.min() + rng.integers(0, left.max() - left.min() + 1, shape)[wrong]
    first = draw(some.integers(-width - 3, width + 3))
    chosen = {
        "disparities": (first, first + draw(some.integers(1, 2 * width + 3))),
        "cost": draw(some.sampled_from(COSTS))((draw(some.integers(1, 40)), draw(some.integers(1, 25)))),
        "left_right": draw(some.sampled_from([None, 0, 1, 2.5])),
        "uniqueness": draw(some.sampled_from([None, 0, 5])),
        "subpixel": draw(some.sampled_from([None, "parabola", "equiangular"])),
        "channels": "separate" if colour else "grey",
    }
    return left, right, chosen, draw(some.booleans())


@given(problems(), some.sampled_from(SETS), some.sampled_from([1, 3]))
@settings(max_examples=400, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_any_problem(problem, instructions, threads):
    left, right, chosen, floats = problem
    scale = np.float32(1 / 4096) if floats else np.uint16(1)
    left, right = (image.astype(scale.dtype) * scale for image in (left, right))
    definition = st.match(left, right, keep=("costs",), **chosen)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(_instructions.ENVIRONMENT, instructions)
        assert bits(st.match(left, right, threads=threads, **chosen)) == bits(definition)


@pytest.mark.parametrize("kind", [kind for kind in COSTS if kind is not st.NCC])
@pytest.mark.parametrize("window", [(9, 5), (64, 8)])
def test_an_offset_of_both_images_changes_no_bit(window, kind):
    """Neither the definition nor the kernels depend on where pixels are counted from."""
    left, right = (image.astype(np.uint16) for image in pairs(4095, (6, 80))["noise"])
    chosen = {"disparities": (0, 20), "cost": kind(window), "left_right": 1}
    results = [
        bits(assert_on_every_set(left + offset, right + offset, **chosen))
        for offset in np.uint16([0, 1, 30000, 61440])
    ]
    assert results[1:] == results[:-1]


@pytest.mark.parametrize("kind", COSTS)
@pytest.mark.parametrize(("top", "window"), [(4095, (9, 5)), (4095, (40, 20)), (65535, (7, 6))])
def test_costs_are_the_formulas(top, window, kind):
    left, right = (image.astype(np.uint16) for image in pairs(top, (6, 30))["noise"])
    costs = st.match(left, right, disparities=(-2, 7), cost=kind(window), keep=("costs",)).stages["costs"]
    pixels = cost.pixels(left, right)
    a, b = (reference.windows(image, window) for image in pixels[:2])
    for i in range(9):
        shift = i - 2
        seen = np.arange(30) - shift
        inside = (seen >= 0) & (seen < 30)
        expected = reference.between(kind.__name__.lower(), a[:, inside], b[:, seen[inside]])
        relative = 0 if kind in (st.NCC, st.ZNCC) else 1e-6
        np.testing.assert_allclose(costs[:, inside, i], expected, rtol=relative, atol=2e-6)
        assert (costs[:, ~inside, i] == worst_cost(costs.dtype)).all()


def test_constant_windows_have_no_correlation():
    image = np.full((5, 40), 4000, np.uint16)
    image[:, 30:] = np.arange(10) * 9
    costs = st.match(image, image, disparities=(0, 4), cost=st.ZNCC(5), keep=("costs",)).stages["costs"]
    assert (costs[:, 5:20] == 0).all()
    assert_on_every_set(image, image, disparities=(0, 4), cost=st.ZNCC(5), threads=(1, 2, 7))


@pytest.mark.parametrize("channels", ["grey", "separate"])
@pytest.mark.parametrize("kind", COSTS)
def test_the_winning_cost_is_the_volume_s(kind, channels):
    """Down to the sign of a correlation of 0."""
    left, right = (image.astype(np.uint16) for image in pairs(1023, (6, 80))["noise"])
    left[:, 20:50] = right[:, 10:30] = 0
    if channels == "separate":
        left, right = (np.stack((image, image // 2, image[::-1]), axis=-1) for image in (left, right))
    kept = st.match(left, right, disparities=(-2, 9), cost=kind(5), channels=channels, keep=("costs",))
    volume = kept.stages["costs"]
    pixels, disparities = cost.pixels(left, right, channels), Disparities(-2, 9)
    found = np.empty(left.shape[:2], np.float32)
    for instructions in SETS:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv(_instructions.ENVIRONMENT, instructions)
            _fused.match(kind.__name__.lower(), pixels, disparities, (5, 5), None, None, None, 1, found)
        assert found.tobytes() == volume.min(axis=2).astype(np.float32).tobytes()
