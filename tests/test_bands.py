"""Kernels that split images among threads only where they are large: large ones, and the same bits."""

import numpy as np
import pytest

from stereopsis import cost, rectify, refine, validate
from stereopsis.types import Vertical

SHAPE = 1037, 1111
RNG = np.random.default_rng(0)
COLOUR = RNG.integers(0, 256, (*SHAPE, 3), np.uint8)
GREY = np.ascontiguousarray(COLOUR[..., :1])
MAP = np.where(RNG.random(SHAPE) < 0.2, np.nan, RNG.integers(0, 40, SHAPE) / 4).astype(np.float32)


def grey(threads):
    return cost.grey(COLOUR, threads)


def move(threads):
    return rectify.undone(GREY, Vertical(0.4, 3.0, -2.0), threads)


def corners(threads):
    return rectify.corners(GREY[..., 0], 20, threads)


def track(threads):
    points = corners(1)
    motion, correlation = np.zeros((len(points), 2)), np.empty(len(points))
    right = rectify.undone(GREY, Vertical(0.5), 1)
    rectify.follow([GREY[..., 0]], [right[..., 0]], points, motion, correlation, threads)
    assert len(points) > 1024
    assert np.isfinite(correlation).any()
    return np.column_stack((motion, correlation))


def dull(threads):
    answers = MAP.copy(), np.ones(SHAPE, np.float32), np.zeros(SHAPE, np.uint8)
    validate.refuse_dull(GREY, (13, 7), 42.0, *answers, threads)
    assert 0.1 < np.mean(answers[2] > 0) < 0.9
    return np.stack(answers)


@pytest.mark.parametrize("size", [3, 5])
def test_median_in_place(size):
    expected = refine.median(MAP, size, 1)
    for threads in (1, 3, 7):
        disparity = MAP.copy()
        np.testing.assert_array_equal(refine.median(disparity, size, threads, into=disparity), expected)
        np.testing.assert_array_equal(refine.median(MAP, size, threads), expected)


@pytest.mark.parametrize("kernel", [grey, move, corners, track, dull])
def test_the_same_bits(kernel):
    alone = kernel(1)
    for threads in (2, 7):
        assert kernel(threads).tobytes() == alone.tobytes()
