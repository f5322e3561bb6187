"""The streaming path: cost, aggregation, selection, checks and sub-pixel fit in one pass.

It holds no cost volume, and gives the same bits as the composed stages.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis import _core, _gaussian
from stereopsis.cost import KINDS, Pixels, fits_narrow
from stereopsis.types import Disparities

ENVIRONMENT = "STEREOPSIS_INSTRUCTIONS"
"""Environment variable that forces an instruction set, for tests: one of `instruction_sets`."""

SUBPIXEL = (None, "parabola", "equiangular")
"""In the core's order."""


def instruction_sets() -> list[str]:
    """Instruction sets that this build has and this machine can run, best first."""
    return list(_core.instruction_sets())


def instruction_set() -> str:
    """The instruction set in use."""
    return os.environ.get(ENVIRONMENT) or instruction_sets()[0]


def match(
    kind: str,
    pair: Pixels,
    disparities: Disparities,
    window: tuple[int, int],
    subpixel: str | None,
    left_right: float | None,
    uniqueness: float | None,
    threads: int,
    cost: npt.NDArray[np.float32] | None = None,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
    """Disparity, confidence and flags, (H, W) each. Some candidate of the range has to be in view.

    Where an array is given for it, `cost` receives the winner's; infinity where no candidate is in view.
    """
    shape: tuple[int, ...] = pair.left.shape[:2]
    disparity, confidence = np.empty(shape, np.float32), np.empty(shape, np.float32)
    flags = np.empty(shape, np.uint8)
    left: npt.NDArray[Any] = pair.left
    right: npt.NDArray[Any] = pair.right
    if kind == "zsad" or (left.dtype == np.uint8 and not fits_narrow(window, left.shape[2])):
        left, right = left.astype(np.int32), right.astype(np.int32)
    ratio = None if uniqueness is None else 1 + uniqueness / 100
    run = _core.match_narrow if left.dtype == np.uint8 else _core.match_wide
    run(
        left,
        right,
        disparities.min,
        disparities.span,
        KINDS.index(kind),
        *window,
        SUBPIXEL.index(subpixel),
        left_right,
        ratio,
        disparity,
        confidence,
        flags,
        cost,
        threads,
        os.environ.get(ENVIRONMENT, ""),
    )
    return disparity, confidence, flags


def serves_volume(kind: str, pair: Pixels, window: tuple[int, int]) -> bool:
    """Whether `volume` takes this cost, these pixels and this window."""
    narrow = pair.left.dtype == np.uint8 and fits_narrow(window, pair.left.shape[2])
    return bool(narrow and kind in ("zssd", "ncc", "zncc"))


def volume(
    kind: str, pair: Pixels, disparities: Disparities, window: tuple[int, int], threads: int
) -> npt.NDArray[np.float32]:
    """Every candidate's cost, (H, W, D): what the composed stages give, many times as fast.

    For those costs, pixels and windows alone that `serves_volume` names.
    """
    costs = np.empty((*pair.left.shape[:2], disparities.span), np.float32)
    instructions = os.environ.get(ENVIRONMENT, "")
    _core.narrow_costs(
        pair.left, pair.right, disparities.min, KINDS.index(kind), *window, costs, threads, instructions
    )
    return costs


def match_gaussian(
    kind: str,
    pair: Pixels,
    disparities: Disparities,
    sigma: float,
    truncate: float,
    subpixel: str | None,
    left_right: float | None,
    uniqueness: float | None,
    threads: int,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
    """Disparity, confidence and flags, (H, W) each, with windows weighted by a Gaussian.

    The time hardly grows with sigma. Some candidate of the range has to be in view.

    Raises
    ------
    ValueError
        For what `serves_gaussian` refuses.
    """
    if not serves_gaussian(kind, pair):
        raise ValueError(
            f"streaming Gaussian windows take 8-bit pixels and no zsad, not {kind} of {pair.left.dtype}"
        )
    shape: tuple[int, ...] = pair.left.shape[:2]
    disparity, confidence = np.empty(shape, np.float32), np.empty(shape, np.float32)
    flags = np.empty(shape, np.uint8)
    chosen = _gaussian.filter_of(sigma, truncate)
    _core.match_gaussian(
        pair.left,
        pair.right,
        disparities.min,
        disparities.span,
        KINDS.index(kind),
        chosen.stride,
        chosen.taps,
        SUBPIXEL.index(subpixel),
        left_right,
        None if uniqueness is None else 1 + uniqueness / 100,
        disparity,
        confidence,
        flags,
        threads,
        os.environ.get(ENVIRONMENT, ""),
    )
    return disparity, confidence, flags


def serves_gaussian(kind: str, pair: Pixels) -> bool:
    """Whether `match_gaussian` takes this cost and these pixels."""
    return bool(kind != "zsad" and pair.left.dtype == np.uint8)
