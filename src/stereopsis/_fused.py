"""The streaming path: cost, aggregation, selection, checks and sub-pixel fit in one pass.

It holds no cost volume, and gives the same bits as the composed stages.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis import _core, _gaussian, _instructions, pixelwise, sgm
from stereopsis.cost import KINDS, Pixels, fits_narrow, grey
from stereopsis.types import Disparities

MOST_AGGREGATED: int = _core.most_aggregated_bits
"""Comparisons of a census that `match_sgm` sums over 3 x 3."""
SUBPIXEL = (None, "parabola", "equiangular")
"""In the core's order."""

Found = tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.uint8]]
"""Disparity, confidence and flags, (H, W) each."""


def instruction_sets() -> list[str]:
    """Instruction sets that this build has and this machine can run, best first."""
    return list(_core.instruction_sets())


def instruction_set() -> str:
    """The instruction set in use."""
    return _instructions.forced() or instruction_sets()[0]


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
) -> Found:
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
        _instructions.forced(),
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
    instructions = _instructions.forced()
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
) -> Found:
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
        _instructions.forced(),
    )
    return disparity, confidence, flags


def serves_gaussian(kind: str, pair: Pixels) -> bool:
    """Whether `match_gaussian` takes this cost and these pixels."""
    return bool(kind != "zsad" and pair.left.dtype == np.uint8)


def guide_of(pair: Pixels) -> npt.NDArray[np.uint8]:
    """The left image in 256 grey levels, (H, W)."""
    return _plane(pixelwise.levels(pair.left, pair.right, pair.limits)[0])


def guides_of(pair: Pixels) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]:
    """Both images in 256 grey levels, (H, W)."""
    left, right = pixelwise.levels(pair.left, pair.right, pair.limits)
    return _plane(left), _plane(right)


def _plane(image: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    return np.ascontiguousarray((grey(image) if image.shape[2] == 3 else image)[..., 0])


def streams_census(cost: Any, settings: sgm.SGM) -> bool:
    """Whether `match_sgm` takes this cost and these settings."""
    if not isinstance(cost, pixelwise.Census) or settings.more_global:
        return False
    fits = cost.box == (1, 1) or (cost.box == (3, 3) and cost.most <= MOST_AGGREGATED)
    return fits and 1 <= settings.unit_for(cost.largest(), whole=True) <= 2**15


def serves_sgm(cost: Any, pair: Pixels, settings: sgm.SGM, disparities: Disparities) -> bool:
    """Whether `match_sgm` takes this cost, these pixels and these settings."""
    return streams_census(cost, settings) and pair.left.shape[2] == 1 and disparities.span < 2**15


def match_sgm(
    cost: pixelwise.Census,
    pair: Pixels,
    disparities: Disparities,
    settings: sgm.SGM,
    subpixel: str | None,
    left_right: float | None,
    uniqueness: float | None,
    threads: int,
    shift: npt.NDArray[np.int16] | None = None,
    winning_cost: npt.NDArray[np.float32] | None = None,
    left_strings: npt.NDArray[np.uint64] | None = None,
    guide: npt.NDArray[np.uint8] | None = None,
) -> Found:
    """Disparity, confidence and flags, (H, W) each, of semi-global matching with census costs.

    No volume is held; what is takes about a quarter of the memory of the 16-bit sums. Some candidate of the
    range has to be in view.

    Parameters
    ----------
    cost : Census
        Of single pixels or of boxes of 3 x 3.
    pair : Pixels
        One channel.
    disparities : Disparities
    settings : SGM
    subpixel, left_right, uniqueness, threads
        As in `Settings`.
    shift : ndarray of int16, (H, W), optional
        A sheared volume: candidate i of pixel p means the disparity ``disparities.min + i + shift[p]``, and
        paths compare neighbours of equal i.
    winning_cost : ndarray of float32, (H, W), optional
        Receives the winner's sum, in units; infinity where there is none. Winners are then told as they were
        found, beside their flags, also those out of view.
    left_strings : ndarray of uint64, (P, H, W), optional
        The left image's census, where it is known.
    guide : ndarray of uint8, (H, W), optional
        What P2 is adapted to, if it is. None: the left image.
    """
    shape: tuple[int, ...] = pair.left.shape[:2]
    disparity, confidence = np.empty(shape, np.float32), np.empty(shape, np.float32)
    flags = np.empty(shape, np.uint8)
    left = left_strings
    if left is None:
        left = pixelwise.census(pair.left[..., 0], cost.comparisons, threads)
    right = pixelwise.census(pair.right[..., 0], cost.comparisons, threads)
    unit = settings.unit_for(cost.largest(), whole=True)
    _core.sgm_census(
        left,
        right,
        cost.most,
        cost.box != (1, 1),
        int(unit).bit_length() - 1,
        disparities.min,
        disparities.span,
        shift,
        settings.paths,
        sgm.most_units(cost.largest(), unit),
        min(settings.first_penalty(unit), sgm.LARGEST_SUM),
        settings.second_penalties(unit),
        None if settings.contrast is None else guide_of(pair) if guide is None else guide,
        SUBPIXEL.index(subpixel),
        left_right,
        None if uniqueness is None else 1 + uniqueness / 100,
        disparity,
        confidence,
        flags,
        winning_cost,
        threads,
        _instructions.forced(),
    )
    return disparity, confidence, flags
