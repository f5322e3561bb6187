"""Gaussian windows: the filter against the Gaussian, the streaming path against the definition."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as some
from PIL import Image

from reference import gaussian as reference
from reference import validate
from stereopsis import _fused, _gaussian, _instructions, cost
from stereopsis.types import Disparities, Flag

KINDS = ("sad", "ssd", "zssd", "ncc", "zncc")
SETS = _fused.instruction_sets()
DATA = Path(os.environ.get("STEREOPSIS_DATA") or Path(__file__).parents[2] / "shared" / "data")

# Costs of these many grey levels, or squares of them, are 1.
SCALE = {"sad": 255.0, "ssd": 255.0**2, "zssd": 255.0**2, "ncc": 1.0, "zncc": 1.0}

every_kind = pytest.mark.parametrize("kind", KINDS)


def match(kind, left, right, disparities, sigma, **chosen):
    chosen = {
        "truncate": 4.0,
        "subpixel": None,
        "left_right": None,
        "uniqueness": None,
        "threads": 1,
    } | chosen
    pair = cost.pixels(left, right, "separate", 1)
    return _fused.match_gaussian(kind, pair, Disparities(*disparities), sigma, **chosen)


def images(seed, shape, shift=2, wrong=0.2):
    """A pair with true matches and wrong ones."""
    rng = np.random.default_rng(seed)
    left = rng.integers(0, 256, shape, dtype=np.uint8)
    right = np.roll(left, -shift, axis=1)
    noise = rng.random(shape[:2]) < wrong
    right[noise] = rng.integers(0, 256, shape, dtype=np.uint8)[noise]
    return left, right


def definition(kind, left, right, disparities, sigma, truncate=4.0):
    left, right = (image.reshape(*image.shape[:2], -1) for image in (left, right))
    return reference.volume(kind, left, right, range(*disparities), sigma, truncate)


def seen(volume):
    return np.isfinite(volume).any(axis=2)


def at(volume, index):
    return np.take_along_axis(volume, index[..., None], axis=2)[..., 0]


def excess(volume, disparity, first):
    """How much more than the least cost the chosen candidates cost."""
    valid = seen(volume)
    index = np.where(valid, disparity - first, 0).astype(int)
    return at(volume, index)[valid] - volume.min(axis=2)[valid]


# ---- the filter ----------------------------------------------------------------------------------


def test_gaussian_by_hand():
    a, b = np.exp(-0.5), np.exp(-2.0)
    assert _gaussian.gaussian(1, 2) == pytest.approx(np.array([1, a, b]) / (1 + 2 * a + 2 * b))
    assert _gaussian.gaussian(0.4, 1) == pytest.approx([1.0])


@pytest.mark.parametrize("truncate", [3.0, 4.0, 6.0])
@pytest.mark.parametrize("sigma", [0.1, 0.5, 1, 2, 3.3, 4, 5, 7.7, 15, 40, 130])
def test_kernels_are_the_gaussian_to_within_what_is_stated(sigma, truncate):
    chosen, side = _gaussian.filter_of(sigma, truncate), _gaussian.gaussian(sigma, truncate)
    assert chosen.taps[0] + 2 * chosen.taps[1:].sum() == pytest.approx(1, abs=1e-14)
    off = abs(_gaussian.errors(chosen, side))
    assert off.sum(axis=1).max() <= (1e-12 if chosen.stride == 1 else 1.5e-3)
    if truncate >= 4:
        assert off.max() <= 3.2e-3 * side[0]
        assert off.mean() <= 3.5e-4 * side[0]


def test_stride_follows_sigma():
    strides = [_gaussian.filter_of(sigma, 4.0).stride for sigma in (1, 2, 4, 8, 15, 100)]
    assert strides == [1, 1, 2, 5, 10, 12]


@pytest.mark.parametrize("sigma", [4, 9, 15])
def test_errors_say_what_gathering_filtering_and_spreading_do(sigma):
    """A pulse at each place, against the row of kernels that `errors` speaks of."""
    chosen, side = _gaussian.filter_of(sigma, 4.0), _gaussian.gaussian(sigma, 4.0)
    off = _gaussian.errors(chosen, side)
    wide = len(side) - 1 + 4 * chosen.stride
    middle = off.shape[1] // 2
    for place in range(chosen.stride // 2 + 1):
        x = chosen.stride * (wide // chosen.stride) + place
        for away in (-len(side) + 2, -3, 0, 1, sigma, len(side) - 1):
            pulse = np.zeros(2 * x + 1)
            pulse[x + away] = 1
            weight = reference.knots(pulse, chosen.stride, chosen.taps)[x]
            assert weight - side[abs(away)] == pytest.approx(off[place, middle + away], abs=1e-12)


# ---- the definition ------------------------------------------------------------------------------


@some.composite
def problems(draw):
    height, width = draw(some.integers(1, 14)), draw(some.integers(1, 50))
    shape = (height, width, 3) if draw(some.booleans()) else (height, width)
    first = draw(some.integers(1 - width, width - 1))
    last = draw(some.integers(first, width - 1)) + draw(some.integers(0, 3))
    left, right = images(draw(some.integers(0, 2**32)), shape, draw(some.integers(0, 9)))
    sigma = draw(some.sampled_from([0.3, 0.8, 1.7, 2.9, 4.0, 5.0, 7.5, 15.0, 24.0]))
    truncate = draw(some.sampled_from([3.0, 4.0, 5.0]))
    disparities = first, last + 1
    return (
        left,
        right,
        disparities,
        sigma,
        truncate,
        draw(some.sampled_from(KINDS)),
        draw(some.sampled_from(SETS)),
    )


@given(problems(), some.sampled_from([1, 3]))
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_winners_cost_no_more_than_the_definitions(problem, threads):
    left, right, disparities, sigma, truncate, kind, instructions = problem
    volume = definition(kind, left, right, disparities, sigma, truncate)
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setenv(_instructions.ENVIRONMENT, instructions)
        disparity, confidence, flags = match(
            kind, left, right, disparities, sigma, truncate=truncate, threads=threads
        )
    valid = seen(volume)
    assert ((flags == 0) == valid).all()
    assert ((flags == Flag.OUT_OF_VIEW) == ~valid).all()
    assert (np.isfinite(disparity) == valid).all()
    assert (confidence >= 0).all()
    assert (confidence <= 1).all()
    index = np.where(valid, disparity - disparities[0], 0).astype(int)
    assert np.isfinite(at(volume, index)[valid]).all()
    direct = _gaussian.filter_of(sigma, truncate).stride == 1
    channels = left.size // left[..., 0].size if left.ndim == 3 else 1
    scale = SCALE[kind] * (channels if kind not in ("ncc", "zncc") else 1)
    assert excess(volume, disparity, disparities[0]).max(initial=0) <= (2e-4 if direct else 6e-3) * scale


@every_kind
@pytest.mark.parametrize("sigma", [1.5, 5.0, 15.0])
@pytest.mark.parametrize("shape", [(24, 90), (16, 60, 3)])
def test_costs_around_the_winner(kind, sigma, shape):
    """Confidence and sub-pixel fit see three costs, and are far more sensitive to them than the winner is."""
    left, right = images(5, shape, shift=7)
    first, last = -2, 23
    volume = definition(kind, left, right, (first, last), sigma)
    disparity, confidence, _ = match(kind, left, right, (first, last), sigma, subpixel="parabola")
    index = np.rint(np.nan_to_num(disparity) - first).astype(int)
    # Away from the ends of the range and of the image, where the right image has come round.
    inner = np.isfinite(disparity) & (index > 0) & (index < last - first - 1)
    inner &= (index == volume.argmin(axis=2)) & (np.arange(shape[1]) >= last + 1)[None, :]
    beside = np.where(inner, index, 1)
    inner &= np.isfinite(at(volume, beside - 1)) & np.isfinite(at(volume, beside + 1))
    assert inner.mean() > 0.4
    before, here, after = (at(volume, beside + k)[inner] for k in (-1, 0, 1))
    around = (before + after) / 2
    perfect = -1.0 if kind in ("ncc", "zncc") else 0.0
    offset = (before - after) / 2 / (before + after - 2 * here)
    direct = _gaussian.filter_of(sigma, 4.0).stride == 1
    # Noise of every frequency is the worst that a kernel can meet.
    assert abs(confidence[inner] - (around - here) / (around - perfect)).max() < (5e-4 if direct else 6e-3)
    assert abs((disparity - first - index)[inner] - offset).max() < (5e-4 if direct else 1e-2)


@every_kind
def test_checks(kind):
    left, right = images(11, (20, 70), shift=5, wrong=0.4)
    first, last = 0, 16
    volume = definition(kind, left, right, (first, last), 4.0)
    perfect = -1.0 if kind in ("ncc", "zncc") else 0.0
    winner = np.where(seen(volume), volume.argmin(axis=2), -1)
    width = left.shape[1]
    there = np.full((*left.shape, last), np.inf)
    for i in range(last):
        there[:, : width - i, i] = volume[:, i:, i]
    expected = validate.left_right(winner, there.argmin(axis=2), first, 1.0)
    ambiguous = validate.uniqueness(volume, first, perfect, 5.0)
    expected = expected | np.where(ambiguous, int(Flag.AMBIGUOUS), 0)
    disparity, confidence, flags = match(
        kind, left, right, (first, last), 4.0, left_right=1.0, uniqueness=5.0
    )
    assert (flags == expected).mean() > 0.98
    assert {0, int(Flag.OCCLUDED), int(Flag.MISMATCHED)} <= set(np.unique(flags))
    assert (np.isnan(disparity) == (flags != 0)).all()
    assert (confidence[flags != 0] == 0).all()


@every_kind
def test_equal_candidates_go_to_the_first(kind):
    image = np.full((9, 40), 77, np.uint8)
    disparity, confidence, _ = match(kind, image, image, (-4, 20), 5.0)
    assert (disparity == np.maximum(-4, np.arange(40) - 39)).all()
    assert (confidence <= 1e-6).all()


@pytest.mark.parametrize("sigma", [2.0, 5.0, 15.0])
def test_little_texture_in_bright_sky_beside_darkness(sigma):
    """The product of the means is 10^5 times what is left, and the border is in many a window."""
    rng = np.random.default_rng(3)
    left = rng.integers(249, 252, (30, 120), dtype=np.uint8)
    right = np.roll(left, -6, axis=1)
    left[22:, :] = right[22:, :] = 3
    left[:, 100:], right[:, 94:] = 1, 1
    for kind in ("zncc", "zssd"):
        volume = definition(kind, left, right, (0, 16), sigma)
        disparity, confidence, _ = match(kind, left, right, (0, 16), sigma)
        assert np.isfinite(disparity).all()
        assert (confidence <= 1).all()
        # Where the border is in a window's far rim alone, what the kernel is off there by counts for most.
        found = excess(volume, disparity, 0)
        assert found.max() < 2e-2 * SCALE[kind]
        assert found.mean() < 1e-3 * SCALE[kind]
    inside = np.s_[:15, 40:90]
    if sigma == 2:
        assert (match("zncc", left, right, (0, 16), sigma)[0][inside] == 6).all()


# ---- the same bits -------------------------------------------------------------------------------


def bits(arrays):
    return [array.tobytes() for array in arrays]


@every_kind
@pytest.mark.parametrize("sigma", [2.0, 4.0, 30.0])
@pytest.mark.parametrize("shape", [(23, 61), (17, 40, 3)])
def test_instruction_sets_and_threads_do_not_matter(monkeypatch, kind, sigma, shape):
    left, right = images(7, shape)
    left[: shape[0] // 2, : shape[1] // 2] = right[: shape[0] // 2, : shape[1] // 2] = 200
    chosen = {"subpixel": "equiangular", "left_right": 1.0, "uniqueness": 3.0}
    first = None
    for instructions in SETS:
        monkeypatch.setenv(_instructions.ENVIRONMENT, instructions)
        for threads in (1, 3):
            found = bits(match(kind, left, right, (-5, 33), sigma, threads=threads, **chosen))
            first = first or found
            assert found == first, (instructions, threads)


@every_kind
@pytest.mark.parametrize("count", [1, 8, 17, 65, 129, 200])
def test_numbers_of_candidates_around_those_of_vector_lanes(monkeypatch, kind, count):
    left, right = images(count, (3, 210))
    found = []
    for instructions in SETS:
        monkeypatch.setenv(_instructions.ENVIRONMENT, instructions)
        found.append(bits(match(kind, left, right, (-2, count - 2), 4.0, left_right=0.0, uniqueness=1.0)))
    assert all(each == found[0] for each in found)
    volume = definition(kind, left, right, (-2, count - 2), 4.0)
    disparity = match(kind, left, right, (-2, count - 2), 4.0)[0]
    assert excess(volume, disparity, -2).max() <= 6e-3 * SCALE[kind]


@every_kind
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (1, 30, 3), (30, 1, 3), (13, 12)])
@pytest.mark.parametrize("sigma", [1.0, 15.0])
def test_images_smaller_than_the_window(monkeypatch, kind, shape, sigma):
    left, right = images(2, shape, shift=0)
    width = shape[1]
    for disparities in ((1 - width, width), (-width - 5, width + 4)):
        volume = definition(kind, left, right, disparities, sigma)
        found = []
        for instructions in (SETS[0], SETS[-1]):
            monkeypatch.setenv(_instructions.ENVIRONMENT, instructions)
            found.append(match(kind, left, right, disparities, sigma, left_right=None, threads=2))
        assert bits(found[0]) == bits(found[1])
        scale = SCALE[kind] * (3 if len(shape) == 3 and kind not in ("ncc", "zncc") else 1)
        assert excess(volume, found[0][0], disparities[0]).max() <= 6e-3 * scale


def test_black_and_white_in_three_channels(monkeypatch):
    """The widest sums: products of one sign, at the largest stride and with direct weights."""
    left = np.zeros((40, 64, 3), np.uint8)
    right = np.zeros((40, 64, 3), np.uint8)
    left[20:, :32] = right[:20, 32:] = 255
    for kind in KINDS:
        for sigma in (3.0, 30.0):
            volume = definition(kind, left, right, (0, 20), sigma)
            for instructions in SETS:
                monkeypatch.setenv(_instructions.ENVIRONMENT, instructions)
                disparity = match(kind, left, right, (0, 20), sigma)[0]
                assert excess(volume, disparity, 0).max() <= 6e-3 * SCALE[kind]


# ---- what it does not take -----------------------------------------------------------------------


def test_other_pixels_and_costs_are_refused():
    image = np.zeros((4, 5), np.uint8)
    with pytest.raises(ValueError, match=r"8-bit pixels and no zsad, not zsad"):
        match("zsad", image, image, (0, 2), 2.0)
    with pytest.raises(ValueError, match=r"not ssd of int32"):
        match("ssd", image.astype(np.uint16), image.astype(np.uint16), (0, 2), 2.0)


# ---- real pairs ----------------------------------------------------------------------------------


@pytest.mark.skipif(not (DATA / "drivingstereo").is_dir(), reason="needs the real pairs")
@pytest.mark.parametrize("number", [0, 7])
@pytest.mark.parametrize("kind", ["zncc", "sad"])
def test_real_pairs_have_the_definitions_winners(number, kind):
    name = sorted((DATA / "drivingstereo").glob("*-left.jpg"))[number]
    left, right = (
        np.asarray(Image.open(str(name).replace("-left", side)).convert("L"))[200:240].copy()
        for side in ("-left", "-right")
    )
    volume = definition(kind, left, right, (0, 32), 15.0)
    disparity = match(kind, left, right, (0, 32), 15.0)[0]
    assert (abs(disparity - volume.argmin(axis=2)) <= 1).mean() > 0.999
    assert excess(volume, disparity, 0).mean() < 1e-5 * SCALE[kind]
