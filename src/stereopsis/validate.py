"""Validate: which winners are not to be believed, and why."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis import _core, _instructions
from stereopsis.types import EVERY, WHOLE, Disparities, DisparityMap, Flag, Halo, Sampling, worst_cost

BoolMap = npt.NDArray[np.bool_]


def uniqueness(cost: npt.NDArray[Any], second: npt.NDArray[Any], perfect: float, margin: float) -> BoolMap:
    """Where another candidate, not next to the winner, costs at most `margin` percent more.

    Parameters
    ----------
    cost, second : ndarray, (H, W)
        The winner's cost and the least one apart from it and its neighbours; the type's largest value, or
        infinity, where there is none.
    perfect : float
        Cost of a perfect match, from which both are counted: -1 for correlations, 0 for differences.
    margin : float
        Percent.
    """
    none = worst_cost(second.dtype)
    excess = second.astype(np.float64) - perfect
    depth = cost.astype(np.float64) - perfect
    ambiguous: npt.NDArray[np.bool_] = (second < none) & (excess <= depth * (1 + margin / 100))
    return ambiguous


def left_right_halo(disparities: Disparities, tolerance: float) -> Halo:
    """What the check of left against right depends on.

    The right pixels that may answer within the tolerance of the pixel, and all left pixels that are their
    candidates.
    """
    about, across = int(min(tolerance, WHOLE)) + 1, disparities.span - 1
    return Halo(
        left=about + max(across, disparities.max - 1, 0), right=about + max(across, -disparities.min, 0)
    )


def texture_halo(window: tuple[int, int]) -> Halo:
    """What `texture` depends on: the window, and the neighbours of its pixels."""
    return Halo.box(window).then(Halo.around(1, 0))


def speckle_halo(area: int) -> Halo:
    """What `speckle` depends on, exactly: a region that reaches further is no speckle."""
    return Halo.around(max(0, area - 1))


def left_right(
    index: npt.NDArray[np.int32],
    right: npt.NDArray[np.int32],
    first: int,
    tolerance: float,
    sampling: Sampling = EVERY,
) -> npt.NDArray[np.uint8]:
    """Where the right view's winner at the match differs by more than `tolerance` pixels.

    A pixel that fails is `Flag.MISMATCHED` where some right pixel's winner lies within the tolerance of it,
    else `Flag.OCCLUDED` [1]_: nothing in the right image is its match.

    Parameters
    ----------
    index, right : ndarray of int32, (H, W') and (H, W)
        Winners of both views, as candidate numbers. Column k of the first is column ``k * step``.
    first : int
        Disparity of candidate 0; candidates lie ``disparity_step`` apart.
    tolerance : float
        Pixels.
    sampling : Sampling

    Returns
    -------
    ndarray of uint8, (H, W')
        Bits of `Flag`.

    References
    ----------
    .. [1] H. Hirschmueller, Stereo processing by semiglobal matching and mutual information,
       IEEE TPAMI 30(2), 2008, doi:10.1109/TPAMI.2007.1166.
    """
    width, apart = right.shape[1], sampling.disparity_step
    columns = np.arange(index.shape[1]) * sampling.step
    match = np.clip(columns - first - index * apart, 0, width - 1)
    failed = (index >= 0) & (np.abs(np.take_along_axis(right, match, axis=1) - index) * apart > tolerance)
    # Left columns that some right pixel's winner points to, counted from the left.
    claimed_columns = np.arange(width) + first + right * apart
    rows, there = np.nonzero((right >= 0) & (claimed_columns >= 0) & (claimed_columns < width))
    claims = np.zeros((index.shape[0], width + 1), np.int32)
    claims[rows, claimed_columns[rows, there] + 1] = 1
    claims = np.cumsum(claims, axis=1, dtype=np.int32)
    reach = int(min(tolerance, width))
    claimed = claims[:, np.minimum(columns + reach + 1, width)] > claims[:, np.maximum(columns - reach, 0)]
    flags = np.zeros(index.shape, np.uint8)
    flags[failed & claimed] = Flag.MISMATCHED
    flags[failed & ~claimed] = Flag.OCCLUDED
    return flags


def left_right_maps(
    left: DisparityMap, right: DisparityMap, disparities: Disparities, tolerance: float, threads: int = 0
) -> npt.NDArray[np.uint8]:
    """The same check of two maps with disparities between the candidates.

    A pixel is compared with the one of the right view that lies nearest to its match.

    Parameters
    ----------
    left, right : ndarray of float32, (H, W)
        Disparities of both views; NaN where there is none.
    disparities : Disparities
        The range, of which a candidate must be to have been agreed with.
    tolerance : float
        Pixels.
    threads : int
        0: all cores.

    Returns
    -------
    ndarray of uint8, (H, W)
        Bits of `Flag`; 0 where the left view has no answer.
    """
    flags = np.empty(left.shape, np.uint8)
    one, other = np.ascontiguousarray(left), np.ascontiguousarray(right)
    _core.left_right_maps(one, other, disparities.min, disparities.max - 1, tolerance, flags, threads)
    return flags


def texture(image: npt.NDArray[Any], window: tuple[int, int], threads: int = 0) -> npt.NDArray[np.float32]:
    """Mean over the window and the channels of ``|I(x + 1) - I(x - 1)| / 2``, edge pixels repeated.

    Parameters
    ----------
    image : ndarray of uint8 or int32, (H, W, C)
    window : (width, height)
    threads : int

    Returns
    -------
    ndarray of float32, (H, W)
        Grey levels a pixel.
    """
    mean = np.empty(image.shape[:2], np.float32)
    _core.texture(np.ascontiguousarray(image), *window, mean, threads)
    return mean


def texture_of_noise(deviation: float, window: tuple[int, int]) -> float:
    r"""The mean gradient that noise alone stays under: its expectation and three standard errors.

    For independent Gaussian noise of deviation :math:`\sigma`, ``|I(x + 1) - I(x - 1)| / 2`` has the mean
    :math:`\sigma / \sqrt{\pi}`, and its mean over n pixels the relative standard error
    :math:`\sqrt{(\pi - 2) / n}`, if every second pixel of the window is counted as a repetition.

    Parameters
    ----------
    deviation : float
        Grey levels.
    window : (width, height)
    """
    error = np.sqrt((np.pi - 2) / (window[0] * window[1]))
    return float(deviation / np.sqrt(np.pi) * (1 + 3 * error))


def brightness(
    left: npt.NDArray[Any], right: npt.NDArray[Any], disparity: DisparityMap, window: tuple[int, int]
) -> npt.NDArray[np.float32]:
    r"""How far the windows of a match differ in mean brightness, beyond what the whole image's do.

    A line :math:`\bar L = a \bar R + b` is fitted to the window means of all matches by least squares, twice:
    the second time without those more than three deviations off. Dull surfaces lie on it, whatever the gains
    of the cameras; what a camera sees mirrored or glaring at one place, the other sees elsewhere [1]_.

    Parameters
    ----------
    left, right : ndarray of uint8 or int32, (H, W, C)
    disparity : ndarray of float32, (H, W)
        NaN where refused.
    window : (width, height)

    Returns
    -------
    ndarray of float32, (H, W)
        :math:`|\bar L - a \bar R - b|` in robust standard deviations, 1.4826 times its median over the
        matches, which is at least one grey level in 255 of the brightest window; 0 where there is no match.

    References
    ----------
    .. [1] D. N. Bhat, S. K. Nayar, Stereo in the presence of specular reflection, ICCV 1995,
       doi:10.1109/ICCV.1995.466813.
    """
    apart = np.zeros(disparity.shape, np.float32)
    y, x = np.nonzero(np.isfinite(disparity))
    if not x.size:
        return apart
    there = np.clip(
        np.rint(x - disparity[y, x].astype(np.float64)).astype(np.int64), 0, disparity.shape[1] - 1
    )
    ours, theirs = _mean(left, window)[y, x], _mean(right, window)[y, there]
    kept = np.ones(x.size, bool)
    for _ in range(2):
        a, b = ours[kept], theirs[kept]
        spread = np.mean((b - b.mean()) ** 2)
        gain = np.mean((a - a.mean()) * (b - b.mean())) / spread if spread > 0 else 1.0
        residual = np.abs(ours - a.mean() - gain * (theirs - b.mean()))
        deviation = max(1.4826 * float(np.median(residual)), float(np.abs(ours).max()) / 255)
        if deviation == 0:
            return apart
        kept = residual <= 3 * deviation
    apart[y, x] = residual / deviation
    return apart


def _mean(image: npt.NDArray[Any], window: tuple[int, int]) -> npt.NDArray[np.float64]:
    """Over the window and the channels, edge pixels repeated; from exact sums."""
    sums: npt.NDArray[Any] = image.sum(axis=2, dtype=np.int64)
    for size in window:
        # Along the columns, then, turned over, along the rows.
        reach = ((0, 0), (size // 2 + 1, size - 1 - size // 2))
        run = np.cumsum(np.pad(sums, reach, "edge"), axis=1)
        sums = (run[:, size:] - run[:, :-size]).T
    return sums / np.float64(window[0] * window[1] * image.shape[2])


def speckle(disparity: DisparityMap, area: int, difference: float, threads: int = 0) -> BoolMap:
    """Regions too small to be believed.

    Parameters
    ----------
    disparity : ndarray of float32, (H, W)
    area : int
        Regions of fewer pixels than this are speckle.
    difference : float
        Neighbours, of which a pixel has four, belong to one region where they differ by at most this (pixels
        of disparity).
    threads : int
        0: all cores.
    """
    found = np.empty(disparity.shape, np.uint8)
    map_ = np.ascontiguousarray(disparity)
    _core.speckle(map_, area, difference, found, threads, _instructions.forced())
    return found.view(bool)


CUT_OFF = 1000
"""Pixels of a region that is believed whatever is beside it."""


def cut_off(disparity: DisparityMap, end: int, left: int = 0) -> BoolMap:
    """Small regions at the left of the view, beside a nearer surface that would be out of view there.

    What such a surface covers has no match in the right image, and is easily taken for something far. A
    region, whose neighbours differ by at most a pixel, is told so where it has fewer than `CUT_OFF` pixels
    and where, at half at least of its ends within a row, the next answer to the right is nearer by more than
    `AGREEMENT` pixels and larger than the column of the end. What is told so is no answer to the others.

    Parameters
    ----------
    disparity : ndarray of float32, (H, W)
    end : int
        Disparities lie below this: only columns below it are looked at.
    left : int
        The map's first column in the whole image, if it is a part.

    Returns
    -------
    ndarray of bool, (H, W)
    """
    found = np.zeros(disparity.shape, np.uint8)
    columns = np.s_[:, : max(0, end - left)]
    strip = np.ascontiguousarray(disparity[columns])
    told = np.empty(strip.shape, np.uint8)
    _core.cut_off(strip, left, CUT_OFF, 1.0, AGREEMENT, told, _instructions.forced())
    found[columns] = told
    return found.view(bool)


AGREEMENT = 3.0
"""How near the plane of its surroundings a winner has to lie to agree with them, in pixels."""
REVOCABLE = Flag.OCCLUDED | Flag.MISMATCHED | Flag.AMBIGUOUS | Flag.SPECKLE
"""What is said of winners that their surroundings may speak for."""

Answers = tuple[DisparityMap, npt.NDArray[np.float32]]
"""Disparity, NaN where there is none, and confidence, 0 there; (H, W) each."""


def accepted(
    disparity: DisparityMap,
    confidence: npt.NDArray[np.float32],
    flags: npt.NDArray[np.uint8],
    threads: int = 0,
) -> Answers:
    """What has no flag.

    Parameters
    ----------
    disparity, confidence : ndarray of float32, (H, W)
        Not changed.
    flags : ndarray of uint8, (H, W)
    threads : int
    """
    answers = np.empty_like(disparity), np.empty_like(confidence)
    _core.accept(disparity, confidence, flags, *answers, threads)
    return answers


def judged(
    smooth: DisparityMap,
    winners: DisparityMap | None,
    confidence: npt.NDArray[np.float32],
    flags: npt.NDArray[np.uint8],
    disparities: Disparities,
    threads: int = 0,
) -> Answers:
    """Accept what was matched where its surroundings, drawn to their planes, agree, and only there.

    Parameters
    ----------
    smooth : ndarray of float32, (H, W)
        These planes; kept within the range, in place.
    winners : ndarray of float32, (H, W), or None
        Before any check. One within `AGREEMENT` of the plane loses its flags, in place, where all of these
        are `REVOCABLE`; one farther off that had no flag gets `Flag.MISMATCHED`. None: flags stay.
    confidence : ndarray of float32, (H, W)
        The winners'.
    flags : ndarray of uint8, (H, W)
    disparities : Disparities
    threads : int

    Returns
    -------
    disparity, confidence : ndarray of float32, (H, W)
        Of `smooth`, where there is no flag.
    """
    answers = np.empty(smooth.shape, np.float32), np.empty(smooth.shape, np.float32)
    verdict = disparities.min, disparities.max - 1, AGREEMENT, REVOCABLE, Flag.MISMATCHED
    told = None if winners is None else np.ascontiguousarray(winners)
    _core.judge(told, np.ascontiguousarray(confidence), *verdict, smooth, flags, *answers, threads)
    return answers


def refuse_dull(
    image: npt.NDArray[Any],
    window: tuple[int, int],
    least: float,
    disparity: DisparityMap,
    confidence: npt.NDArray[np.float32],
    flags: npt.NDArray[np.uint8],
    threads: int = 0,
) -> None:
    """Refuse, in place and as `Flag.LOW_TEXTURE`, where `texture` is below `least`.

    Parameters
    ----------
    image : ndarray of uint8 or int32, (H, W, C)
    window : (width, height)
    least : float
        Grey levels a pixel.
    disparity, confidence : ndarray of float32, (H, W)
        Contiguous; become NaN and 0.
    flags : ndarray of uint8, (H, W)
        Contiguous; get one more bit.
    threads : int
    """
    _require_contiguous(disparity, confidence, flags)
    _core.refuse_dull(
        np.ascontiguousarray(image),
        *window,
        least,
        Flag.LOW_TEXTURE.value,
        disparity,
        confidence,
        flags,
        threads,
        _instructions.forced(),
    )


def refuse_speckle(
    disparity: DisparityMap,
    area: int,
    difference: float,
    confidence: npt.NDArray[np.float32],
    flags: npt.NDArray[np.uint8],
    threads: int = 0,
) -> None:
    """Refuse, in place and as `Flag.SPECKLE`, what `speckle` finds; the arrays are as in `refuse_dull`."""
    _require_contiguous(disparity, confidence, flags)
    answers, instructions = (disparity, confidence, flags), _instructions.forced()
    _core.refuse_speckle(area, difference, Flag.SPECKLE.value, *answers, threads, instructions)


def _require_contiguous(
    disparity: DisparityMap, confidence: npt.NDArray[np.float32], flags: npt.NDArray[np.uint8]
) -> None:
    """Of others the core would change copies."""
    for name, array in (("disparity", disparity), ("confidence", confidence), ("flags", flags)):
        if not array.flags.c_contiguous:
            raise ValueError(f"{name} must be contiguous, not of strides {array.strides}")
