"""One row: every number that the page shows of a disparity map, as a flat mapping."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from stereopsis import fill
from stereopsis.evaluate import evaluate
from stereopsis.study.pairs import Known
from stereopsis.types import DisparityMap, Flag, Result

Mask = npt.NDArray[np.bool_]
Row = dict[str, float]

BOUNDS: Final = (0.25, 0.5, 1, 2, 4)
MEASURES: Final = (*(f"within_{bound:g}" for bound in BOUNDS), "rmse")
"""The six columns of the report's tables."""

DISTANCES: Final = (0, 8, 16, 32, 64, math.inf)
"""Bands of true disparity, in pixels."""

TEXTURES: Final = (0, 1, 2, 4, 8, math.inf)
"""Bands of texture: the mean horizontal gradient over `TEXTURE_WINDOW`, in grey levels a pixel."""

TEXTURE_WINDOW: Final = 9
EDGE_REACH: Final = 7
"""A pixel is at an edge where the truth on its row, so many pixels to both sides, spans over `EDGE_STEP`."""

EDGE_STEP: Final = 3.0
BINS: Final = 10
"""Of the histogram of fractional parts, and of the error against the phase."""

KEPT: Final = tuple(round(1 - 0.05 * step, 2) for step in range(20))
"""The fractions of pixels, most confident first, at which the sparsification curve is taken."""


def _bands(name: str, bounds: tuple[float, ...]) -> tuple[str, ...]:
    return tuple(f"{name}_{low:g}_{high:g}" for low, high in itertools.pairwise(bounds))


STRATA: Final = (
    *_bands("distance", DISTANCES),
    *_bands("texture", TEXTURES),
    "edge",
    "interior",
    "visible",
    "occluded",
    "sky",
    "textured",
)
"""Where the error lies. "textured" are the visible pixels of surfaces with texture of their own."""

RECOGNISED: Final = ("occluded", "sky", "invalid")
"""What flags are to recognise: what one view alone sees, the sky, and either of them."""

IN_STRATUM: Final = ("count", "within_0.25", "within_1", "within_4", "rmse", "answered")
COLUMNS: Final = (
    *MEASURES,
    "epe",
    "d1",
    "density",
    "known",
    "own_within_1",
    "own_within_4",
    "own_rmse",
    *(f"{stratum}_{measure}" for stratum in STRATA for measure in IN_STRATUM),
    *(f"found_{kind}_{measure}" for kind in RECOGNISED for measure in ("precision", "recall")),
    *(f"fractional_{number}" for number in range(BINS)),
    *(f"phase_bias_{number}" for number in range(BINS)),
    *(f"sparse_{kept:g}" for kept in KEPT),
    *(f"ideal_{kept:g}" for kept in KEPT),
    "sparse_auc",
    "ideal_auc",
)
"""Every measured column, in the order of the table."""


def measure(result: Result, known: Known, masks: Mapping[str, Mask]) -> Row:
    """Measure a result against what is known of its pair.

    Fractions and errors count every pixel with known truth, after holes have been filled from the background
    as KITTI does, and empty rows from those beside them. Columns that begin with ``own`` count the answered
    pixels alone. A column that the pair does not allow is missing.

    Parameters
    ----------
    result : Result
        With its confidence.
    known : Known
        The pair and its truth.
    masks : mapping of str to ndarray of bool, (H, W)
        Its `strata`.

    Returns
    -------
    dict of str to float
        Some of `COLUMNS`.
    """
    scores = evaluate(result.disparity, known.truth)
    answered = np.isfinite(result.disparity)
    disparity = result.disparity if answered.all() else _filled(result.disparity)
    whole, own = evaluate(disparity, known.truth).all, scores.own
    row: Row = {f"within_{b:g}": getattr(whole, f"within_{b:g}".replace(".", "_")) for b in BOUNDS}
    row |= {"rmse": whole.rmse, "epe": whole.epe, "d1": whole.d1}
    row |= {"density": scores.density, "known": scores.known}
    row |= {"own_within_1": own.within_1, "own_within_4": own.within_4, "own_rmse": own.rmse}
    row |= _strata(disparity, answered, known, masks)
    row |= _recognised(result, known)
    row |= _fractional(result.disparity, known.truth)
    row |= _sparsification(result.disparity, result.confidence, known.truth)
    return row


def _filled(disparity: DisparityMap) -> DisparityMap:
    """From the farther neighbour on the row; where a row is empty, from the farther one above or below."""
    filled = fill.background(disparity)
    if np.isfinite(filled).all():
        return filled
    return fill.background(np.ascontiguousarray(filled.T)).T


def strata(known: Known) -> Mapping[str, Mask]:
    """The pixels of each of `STRATA` that the pair has, (H, W) each; only sky pixels have no truth."""
    truth = known.truth
    certain = np.isfinite(truth)
    gradient = texture(known)
    edge = edges(truth)
    masks = {
        name: certain & (truth >= low) & (truth < high)
        for name, low, high in zip(_bands("distance", DISTANCES), DISTANCES, DISTANCES[1:], strict=False)
    }
    masks |= {
        name: certain & (gradient >= low) & (gradient < high)
        for name, low, high in zip(_bands("texture", TEXTURES), TEXTURES, TEXTURES[1:], strict=False)
    }
    masks |= {"edge": certain & edge, "interior": certain & ~edge}
    if known.visible is not None:
        masks |= {"visible": certain & known.visible, "occluded": certain & ~known.visible}
        if known.textured is not None:
            masks["textured"] = certain & known.visible & known.textured
    if known.sky is not None:
        masks["sky"] = known.sky
    return masks


def texture(known: Known) -> npt.NDArray[np.float64]:
    """Mean absolute horizontal gradient of the left image over a square window, (H, W), in grey levels."""
    left = known.pair.left
    grey = left.astype(np.float64) if left.ndim == 2 else left.astype(np.float64).mean(axis=2)
    if left.dtype == np.uint16:
        grey /= 16  # a 12-bit camera
    gradient = np.abs(np.gradient(grey, axis=1)) if grey.shape[1] > 1 else np.zeros_like(grey)
    return _mean(_mean(gradient, TEXTURE_WINDOW).T, TEXTURE_WINDOW).T


def _mean(values: npt.NDArray[np.float64], window: int) -> npt.NDArray[np.float64]:
    """Mean over an odd window of rows, the edge repeated."""
    sums = np.cumsum(np.pad(values, ((window // 2 + 1, window // 2), (0, 0)), mode="edge"), axis=0)
    return (sums[window:] - sums[:-window]) / window


def edges(truth: DisparityMap) -> Mask:
    """Where the known truth on a pixel's row steps; along a row, a road is as good as flat."""
    low = np.pad(np.where(np.isfinite(truth), truth, np.inf), ((0, 0), (EDGE_REACH, EDGE_REACH)), mode="edge")
    high = np.pad(
        np.where(np.isfinite(truth), truth, -np.inf), ((0, 0), (EDGE_REACH, EDGE_REACH)), mode="edge"
    )
    width = truth.shape[1]
    lowest = np.full(truth.shape, np.inf, truth.dtype)
    highest = np.full(truth.shape, -np.inf, truth.dtype)
    for shift in range(2 * EDGE_REACH + 1):
        np.minimum(lowest, low[:, shift : shift + width], out=lowest)
        np.maximum(highest, high[:, shift : shift + width], out=highest)
    return highest - lowest > EDGE_STEP


def _strata(disparity: DisparityMap, answered: Mask, known: Known, masks: Mapping[str, Mask]) -> Row:
    row: Row = {}
    # The sky is infinitely far away.
    target = known.truth if known.sky is None else np.where(known.sky, np.float32(0), known.truth)
    error = np.abs(disparity.astype(np.float64) - target)
    error[np.isnan(error)] = np.inf
    for name, mask in masks.items():
        errors = error[mask]
        row[f"{name}_count"] = errors.size
        if errors.size:
            row |= {f"{name}_within_{bound:g}": float(np.mean(errors < bound)) for bound in (0.25, 1, 4)}
            row[f"{name}_rmse"] = math.sqrt(np.mean(errors * errors))
            row[f"{name}_answered"] = float(np.mean(answered[mask]))
    return row


def _recognised(result: Result, known: Known) -> Row:
    """Precision and recall of the flags, where it is known what each view sees."""
    if known.visible is None:
        return {}
    sky = np.zeros(known.visible.shape, bool) if known.sky is None else known.sky
    hidden = np.isfinite(known.truth) & ~known.visible
    counted = np.isfinite(known.truth) | sky
    flags = result.flags
    pairs = {
        "occluded": ((flags & (Flag.OCCLUDED | Flag.OUT_OF_VIEW)) != 0, hidden),
        "sky": ((flags & Flag.SKY) != 0, sky),
        "invalid": ((flags & ~np.uint8(Flag.FILLED)) != 0, hidden | sky),
    }
    row: Row = {}
    for name, (found, true) in pairs.items():
        both = int(np.count_nonzero(found & true & counted))
        for measure, total in (("precision", found & counted), ("recall", true & counted)):
            if total.any():
                row[f"found_{name}_{measure}"] = both / int(np.count_nonzero(total))
    return row


def _fractional(disparity: DisparityMap, truth: DisparityMap) -> Row:
    """Pixel-locking: where the fractional parts lie, and the error against the true one's."""
    found = disparity[np.isfinite(disparity) & np.isfinite(truth)].astype(np.float64)
    true = truth[np.isfinite(disparity) & np.isfinite(truth)].astype(np.float64)
    if not found.size:
        return {}
    bins = np.minimum((np.mod(found, 1) * BINS).astype(int), BINS - 1)
    row: Row = {f"fractional_{n}": float(np.mean(bins == n)) for n in range(BINS)}
    # Outliers would hide what the fit does.
    near = np.abs(found - true) < 1
    phase = np.minimum((np.mod(true[near], 1) * BINS).astype(int), BINS - 1)
    error = (found - true)[near]
    for number in range(BINS):
        if np.any(phase == number):
            row[f"phase_bias_{number}"] = float(np.mean(error[phase == number]))
    return row


def _sparsification(disparity: DisparityMap, confidence: npt.NDArray[np.float32], truth: DisparityMap) -> Row:
    """RMSE of the most confident pixels as fewer of them are kept, and of the best order there is.

    Of equal confidence the upper left pixel comes first. A curve ends where no more pixels are answered; its
    area is the mean over the fractions that it reaches, and the ideal one's over the same.
    """
    known = np.isfinite(truth)
    answered = known & np.isfinite(disparity)
    errors = (disparity[answered].astype(np.float64) - truth[answered]) ** 2
    if not errors.size:
        return {}
    row: Row = {}
    orders = {
        "sparse": np.argsort(-confidence[answered], kind="stable"),
        "ideal": np.argsort(errors, kind="stable"),
    }
    total = int(known.sum())
    for name, order in orders.items():
        sums = np.cumsum(errors[order])
        curve = []
        for kept in KEPT:
            count = max(1, round(kept * total))
            if count <= errors.size:
                row[f"{name}_{kept:g}"] = math.sqrt(sums[count - 1] / count)
                curve.append(row[f"{name}_{kept:g}"])
        row[f"{name}_auc"] = math.fsum(curve) / len(curve) if curve else math.nan
    return row
