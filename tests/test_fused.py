"""The streaming path gives the composed path's bits, on any instruction set and number of threads."""

import itertools

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as some

import stereopsis as st
from stereopsis import Disparities, _core, _fused, _instructions, aggregate, cost

COSTS = (st.SAD, st.SSD, st.ZSAD, st.ZSSD, st.NCC, st.ZNCC)
SLIDING = (st.SAD, st.SSD, st.ZSSD, st.NCC, st.ZNCC)
DTYPES = (np.uint8, np.uint16, np.float32)
SETS = _fused.instruction_sets()

every_cost = pytest.mark.parametrize("cost", COSTS, ids=lambda cost: cost.__name__)
every_sliding_cost = pytest.mark.parametrize("cost", SLIDING, ids=lambda cost: cost.__name__)


def images(seed, shape, dtype=np.uint8, shift=2, levels=None):
    """A pair with true matches, wrong ones and repeated texture; of `levels` grey values only."""
    rng = np.random.default_rng(seed)
    top = {np.uint8: 256, np.uint16: 65536, np.float32: 1000}[dtype]
    left = rng.integers(0, min(levels or top, top), shape)
    right = np.roll(left, -shift, axis=1)
    wrong = rng.random(shape[:2]) < 0.2
    right[wrong] = rng.integers(0, min(levels or top, top), shape)[wrong]
    if dtype == np.float32:
        return (left / 7 - 50).astype(dtype), (right / 7 - 50).astype(dtype)
    return left.astype(dtype), right.astype(dtype)


def bits(result):
    return result.disparity.tobytes(), result.confidence.tobytes(), result.flags.tobytes()


def composed(left, right, **chosen):
    result = st.match(left, right, keep=("costs",), **chosen)
    assert result.path == "composed"
    return result


def assert_same(streaming, definition, told):
    assert streaming.path == "streaming"
    for name in ("flags", "disparity", "confidence"):
        here, there = getattr(streaming, name), getattr(definition, name)
        word = np.uint32 if here.dtype == np.float32 else np.uint8
        wrong = np.argwhere(here.view(word) != there.view(word))
        if len(wrong):
            y, x = wrong[0]
            pytest.fail(f"{name} at {(y, x)}: {here[y, x]!r} != {there[y, x]!r}; {len(wrong)} in all; {told}")


def on_every_set(monkeypatch, left, right, threads=(1,), **chosen):
    """Compares each instruction set with the composed path, which it returns."""
    definition = composed(left, right, **chosen)
    for instructions, count in itertools.product(SETS, threads):
        monkeypatch.setenv(_instructions.ENVIRONMENT, instructions)
        streaming = st.match(left, right, threads=count, **chosen)
        assert_same(streaming, definition, f"{instructions}, {count} threads, {left.shape}, {chosen}")
    return definition


# ---- everything with everything ------------------------------------------------------------------


@every_cost
@pytest.mark.parametrize("dtype", DTYPES, ids=lambda dtype: dtype.__name__)
@pytest.mark.parametrize("channels", ["one", "grey", "separate"])
def test_every_combination_of_settings(monkeypatch, cost, dtype, channels):
    left, right = images(3, (7, 41) if channels == "one" else (7, 41, 3), dtype, levels=9)
    seen, threads = set(), itertools.cycle((1, 3, 7, 2, 5))
    for subpixel, left_right, uniqueness in itertools.product(
        (None, "parabola", "equiangular"), (None, 0, 1, 2.5), (None, 0, 5)
    ):
        definition = on_every_set(
            monkeypatch,
            left,
            right,
            threads=(next(threads),),
            disparities=(-3, 17),
            cost=cost((5, 4)),
            channels="separate" if channels == "separate" else "grey",
            subpixel=subpixel,
            left_right=left_right,
            uniqueness=uniqueness,
        )
        seen |= set(np.unique(definition.flags))
    # The checks did find something, or this would compare nothing but winners.
    assert {0, st.Flag.OCCLUDED, st.Flag.MISMATCHED} <= seen


# ---- shapes --------------------------------------------------------------------------------------


@every_cost
@pytest.mark.parametrize("count", [1, 7, 8, 9, 15, 16, 17, 31, 33, 63, 64, 65, 127, 128, 129, 200, 300])
def test_numbers_of_candidates_around_those_of_vector_lanes(monkeypatch, cost, count):
    for width, first in ((130, 0), (40, -7), (310, 3)):
        left, right = images(count, (3, width), shift=4)
        on_every_set(
            monkeypatch,
            left,
            right,
            disparities=(first, first + count),
            cost=cost(3),
            left_right=1,
            uniqueness=5,
        )


@every_cost
@pytest.mark.parametrize("width", [1, 2, 7, 8, 9, 15, 16, 17, 31, 32, 33, 127, 128, 129, 255, 257])
def test_widths_around_those_of_vectors_and_chunks(monkeypatch, cost, width):
    for shape in ((2, width), (2, width, 3)):
        left, right = images(width, shape, shift=3)
        on_every_set(
            monkeypatch,
            left,
            right,
            disparities=(-2, 19),
            cost=cost((4, 3)),
            channels="separate",
            left_right=1,
            uniqueness=5,
        )


@every_cost
@pytest.mark.parametrize(
    "window", [(1, 1), (2, 1), (1, 2), (15, 2), (2, 15), (14, 14), (255, 1), (1, 255), (255, 2)]
)
def test_windows_of_any_shape(monkeypatch, cost, window):
    left, right = images(7, (6, 21), shift=1)
    on_every_set(monkeypatch, left, right, disparities=(-4, 9), cost=cost(window), left_right=1, uniqueness=5)


@every_cost
@pytest.mark.parametrize(
    "disparities",
    [(-60, 60), (-23, 24), (-60, -20), (22, 60), (23, 24), (-23, -22), (-5, 0), (0, 1), (23, 500)],
)
def test_ranges_that_reach_out_of_view(monkeypatch, cost, disparities):
    left, right = images(11, (4, 24))
    definition = on_every_set(
        monkeypatch, left, right, disparities=disparities, cost=cost(3), left_right=1, uniqueness=5
    )
    x = np.arange(24)
    some_candidate = (x - disparities[0] >= 0) & (x - (disparities[1] - 1) <= 23)
    np.testing.assert_array_equal(
        (definition.flags & st.Flag.OUT_OF_VIEW) == 0, np.tile(some_candidate, (4, 1))
    )


@every_cost
@pytest.mark.parametrize("disparities", [(-150, -6), (-150, -7), (-72, 73), (6, 150), (-159, 130)])
def test_right_pixels_that_meet_few_of_many_candidates(monkeypatch, cost, disparities):
    left, right = images(13, (5, 160), levels=6)
    on_every_set(monkeypatch, left, right, disparities=disparities, cost=cost(3), left_right=1, uniqueness=5)


@every_cost
@pytest.mark.parametrize("shape", [(1, 1), (1, 30), (30, 1), (1, 2), (2, 1), (1, 17, 3), (17, 1, 3)])
def test_single_rows_and_columns(monkeypatch, cost, shape):
    left, right = images(13, shape)
    on_every_set(
        monkeypatch,
        left,
        right,
        threads=(1, 5),
        disparities=(-2, 6),
        cost=cost((6, 5)),
        channels="separate",
        left_right=0,
        uniqueness=0,
    )


# ---- ties ----------------------------------------------------------------------------------------


@every_cost
@pytest.mark.parametrize("value", [0, 1, 128, 255])
def test_constant_images_go_to_the_smallest_disparity_in_view(monkeypatch, cost, value):
    image = np.full((5, 50), value, np.uint8)
    result = on_every_set(monkeypatch, image, image, disparities=(-6, 30), cost=cost(5), subpixel=None)
    # The match of candidate -6 is in view up to column 43; from there on the smallest is x - 49 itself.
    expected = np.maximum(np.arange(50) - 49, -6)
    np.testing.assert_array_equal(result.disparity, np.tile(expected, (5, 1)))


@every_cost
@pytest.mark.parametrize("period", [2, 3, 5, 8, 16, 17])
def test_periodic_images_go_to_the_smallest_of_the_equal_disparities(monkeypatch, cost, period):
    row = np.random.default_rng(period).permutation(np.linspace(0, 255, period).astype(np.uint8))
    image = np.tile(row, (6, 1 + 90 // period))[:, :90]
    result = on_every_set(
        monkeypatch, image, image, disparities=(1, 60), cost=cost(5), subpixel=None, left_right=None
    )
    np.testing.assert_array_equal(result.disparity[:, 60:-2], period)


@every_cost
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16], ids=lambda dtype: dtype.__name__)
def test_ties_of_many_candidates(monkeypatch, cost, dtype):
    """Of four grey levels: equal costs in several blocks of candidates, for either view."""
    left, right = images(23, (9, 330), dtype, shift=130, levels=4)
    for window, disparities in ((3, (0, 300)), (2, (-20, 200))):
        on_every_set(
            monkeypatch, left, right, disparities=disparities, cost=cost(window), left_right=1, uniqueness=5
        )


# ---- the bounds of the 32-bit sums ---------------------------------------------------------------

LARGEST = [(255, 129), (181, 182), (182, 182), (192, 172), (130, 254), (255, 130), (254, 130)]
LARGEST_COLOUR = [(128, 86), (86, 128), (105, 105), (104, 105)]


def saturated(shape):
    """Pairs that drive window sums to their bounds."""
    rng = np.random.default_rng(17)
    black, white = np.zeros(shape, np.uint8), np.full(shape, 255, np.uint8)
    near = white - (rng.random(shape) < 0.1).astype(np.uint8)
    mixed = rng.choice(np.array([0, 255], np.uint8), shape)
    mostly = np.where(rng.random(shape) < 0.05, 0, 255).astype(np.uint8)
    half = black.copy()
    half[:, shape[1] // 2 :] = 255
    return {
        "black, white": (black, white),
        "white, black": (white, black),
        "white, white": (white, white),
        "near, near": (near, np.roll(near, -1, axis=1)),
        "near, black": (near, black),
        "black, near": (black, near),
        "mixed, mixed": (mixed, np.roll(mixed, -2, axis=1)),
        "mixed, white": (mixed, white),
        "mostly, mostly": (mostly, np.roll(mostly, -2, axis=1)),
        "half, half": (half, np.roll(half, -2, axis=1)),
        "half, reversed": (half, 255 - half),
    }


@pytest.mark.parametrize("window", LARGEST, ids=str)
@every_sliding_cost
def test_saturated_images_at_the_limit_of_32_bits(monkeypatch, cost, window):
    for left, right in saturated((4, 25)).values():
        on_every_set(
            monkeypatch, left, right, disparities=(-3, 6), cost=cost(window), left_right=1, uniqueness=5
        )


@pytest.mark.parametrize("window", LARGEST_COLOUR, ids=str)
@every_sliding_cost
def test_saturated_colour_images_at_the_limit_of_32_bits(monkeypatch, cost, window):
    for left, right in saturated((4, 25, 3)).values():
        on_every_set(
            monkeypatch,
            left,
            right,
            disparities=(-3, 6),
            cost=cost(window),
            channels="separate",
            left_right=1,
            uniqueness=5,
        )


def test_squared_differences_of_8_bit_pixels_fit_31_bits_up_to_the_limit():
    assert 255**2 * _core.narrow_limit < 2**31


@every_cost
@pytest.mark.parametrize("dtype", DTYPES, ids=lambda dtype: dtype.__name__)
def test_the_largest_window(monkeypatch, cost, dtype):
    left, right = images(19, (3, 9, 3), dtype)
    if dtype != np.float32:
        left[left % 2 == 0], right[right % 3 == 0] = np.iinfo(dtype).max, 0
    on_every_set(
        monkeypatch,
        left,
        right,
        disparities=(-2, 3),
        cost=cost(255),
        channels="separate",
        left_right=1,
        uniqueness=5,
    )


@every_sliding_cost
def test_black_and_white_pixels(monkeypatch, cost):
    rng = np.random.default_rng(23)
    left = rng.choice(np.array([0, 255], np.uint8), (24, 150))
    right = np.roll(left, -9, axis=1)
    on_every_set(monkeypatch, left, right, disparities=(0, 40), cost=cost(9), left_right=1, uniqueness=5)


# ---- anything ------------------------------------------------------------------------------------


@some.composite
def problems(draw):
    height, width = draw(some.integers(1, 12)), draw(some.integers(1, 70))
    colour = draw(some.booleans())
    shape = (height, width, 3) if colour else (height, width)
    dtype = draw(some.sampled_from(DTYPES))
    levels = draw(some.sampled_from([1, 2, 4, 256, 65536]))
    left, right = images(draw(some.integers(0, 2**32)), shape, dtype, draw(some.integers(0, 9)), levels)
    first = draw(some.integers(-width - 3, width + 3))
    chosen = {
        "disparities": (first, first + draw(some.integers(1, 2 * width + 3))),
        "channels": draw(some.sampled_from(["grey", "separate"])),
        "cost": draw(some.sampled_from(COSTS))((draw(some.integers(1, 13)), draw(some.integers(1, 13)))),
        "left_right": draw(some.sampled_from([None, 0, 0.3, 1, 2.5])),
        "uniqueness": draw(some.sampled_from([None, 0, 0.1, 5, 100])),
        "subpixel": draw(some.sampled_from([None, "parabola", "equiangular"])),
    }
    return left, right, chosen, draw(some.sampled_from(SETS)), draw(some.sampled_from([1, 2, 3, 7]))


@given(problems())
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_any_problem(problem):
    left, right, chosen, instructions, threads = problem
    definition = st.match(left, right, keep=("costs",), **chosen)
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setenv(_instructions.ENVIRONMENT, instructions)
        streaming = st.match(left, right, threads=threads, **chosen)
    assert_same(
        streaming, definition, f"{instructions}, {threads} threads, {left.dtype}, {left.shape}, {chosen}"
    )


# ---- the choice of the instruction set -----------------------------------------------------------


def test_an_unknown_instruction_set_is_named(monkeypatch):
    monkeypatch.setenv(_instructions.ENVIRONMENT, "mmx")
    image = np.zeros((4, 4), np.uint8)
    with pytest.raises(ValueError, match=r"instruction set must be one of .*generic.*'mmx'"):
        st.match(image, image, disparities=(0, 2), cost="sad")


def test_the_plain_build_is_always_there():
    assert SETS[-1] == "generic"
    assert _fused.instruction_set() in SETS


def test_many_rows_on_many_threads(monkeypatch):
    left, right = images(29, (61, 90), shift=5)
    on_every_set(
        monkeypatch,
        left,
        right,
        threads=(0, 2, 5, 60, 61, 62, 200),
        disparities=(0, 20),
        cost=st.ZNCC((7, 9)),
    )


@pytest.mark.parametrize("kind", ["zssd", "ncc", "zncc"])
@pytest.mark.parametrize("instructions", _fused.instruction_sets())
@pytest.mark.parametrize("threads", [1, 3])
def test_the_streamed_volume_is_the_composed_one(kind, instructions, threads, monkeypatch):
    monkeypatch.setenv(_instructions.ENVIRONMENT, instructions)
    rng = np.random.default_rng(5)
    for shape, first, count, window in (
        ((5, 43), -3, 17, (7, 3)),
        ((9, 30, 3), 2, 35, (4, 6)),
        ((1, 7), 0, 3, (1, 1)),
    ):
        left, right = (rng.integers(0, 256, shape).astype(np.uint8) for _ in range(2))
        pair = cost.pixels(left, right, "separate")
        candidates = Disparities(first, first + count)
        sums = aggregate.box(cost.terms(kind, pair, candidates, window), window)
        expected = cost.score(kind, sums, pair, candidates, window)
        assert _fused.serves_volume(kind, pair, window)
        np.testing.assert_array_equal(_fused.volume(kind, pair, candidates, window, threads), expected)
