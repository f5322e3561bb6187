"""Sky: where the left image shows no surface at all."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis import _core, noise
from stereopsis.types import DisparityMap

BoolMap = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float32]

STEP = 0.001
"""What one level of the relief is worth, as a fraction of the image's contrast."""

NOISE = 0.67
"""Gradient, as a multiple of the noise's deviation, that the blurred noise of three channels stays under."""

SMOOTH = 4
"""A whole image that is flooded at this level holds nothing but sky: it is as smooth as a ramp."""

WEAK, WEAKEST = 2, 30
"""Sky-coloured neighbours join over edges of so many times the chosen level, or of at least that level."""

REACH = 4
"""How far in pixels the blur keeps the flood off an edge."""

FAR = 2.0
"""Pixels of disparity beyond the farthest surface, up to which a match says nothing against the sky."""


def mask(image: npt.NDArray[Any], disparity: DisparityMap | None = None) -> BoolMap:
    r"""Where the image shows the sky.

    1. The relief is the largest gradient over directions and channels, after a blur, less what noise
       explains, as a fraction of the contrast. It is flooded from above the first row: the level of a pixel
       is the least, over all paths from the first row, of the highest relief on the path [1]_. The regions
       under a level are nested, connected to the top, and parted from the rest by edges [2]_.
    2. That level is chosen whose region differs most in colour from the rest, by the variance between the
       two [3]_, the region being the brighter.
    3. A piece most of which was matched, and nearer than the far distance, is a wall and not sky.
    4. A linear discriminant [4]_ between the two colours takes away what does not look like the rest of the
       sky, and lets the region grow: over weaker edges, and to the edges from which the blur kept it.

    Parameters
    ----------
    image : ndarray of any real dtype, (H, W) or (H, W, C)
        A gain or an offset of all grey levels changes nothing but by rounding.
    disparity : ndarray of float32, (H, W), optional
        Matches most of which are right; NaN where refused. None: step 3 is left out.

    Returns
    -------
    ndarray of bool, (H, W)

    Notes
    -----
    An image without contrast beyond its noise holds no sky; one as smooth as a ramp holds nothing else.
    The sky is taken to reach the first row and to be brighter than the rest.

    References
    ----------
    .. [1] L. Vincent, Morphological grayscale reconstruction in image analysis: applications and efficient
       algorithms, IEEE TIP 2(2), 1993, doi:10.1109/83.217222.
    .. [2] Y. Shen, Q. Wang, Sky region detection in a single image for autonomous ground robot navigation,
       International Journal of Advanced Robotic Systems 10(10), 2013, doi:10.5772/56884.
    .. [3] N. Otsu, A threshold selection method from gray-level histograms, IEEE TSMC 9(1), 1979,
       doi:10.1109/TSMC.1979.4310076.
    .. [4] R. A. Fisher, The use of multiple measurements in taxonomic problems, Annals of Eugenics 7(2),
       1936, doi:10.1111/j.1469-1809.1936.tb02137.x.
    """
    colour = _channels(image)
    sigma = noise.deviation(np.moveaxis(colour, 0, 2))
    low, high = np.quantile(colour, [0.005, 0.995])
    if not high - low > max(6 * sigma, 1e-6):
        return np.zeros(colour.shape[1:], bool)
    level = np.empty(colour.shape[1:], np.uint8)
    _core.flood(_relief(colour, sigma, float(high - low)), level)
    if np.mean(level <= SMOOTH) > 0.99:
        return _without_walls(np.ones(level.shape, bool), disparity)
    chosen = _level(colour, level)
    found = _without_walls(level <= chosen, disparity)
    if not found.any() or found.all():
        return found
    alike = _alike(colour, found)
    found &= alike
    weak = alike & (level <= max(WEAK * chosen, WEAKEST))
    found |= _without_walls(_holding(weak, found) & ~found, disparity)
    for _ in range(REACH):
        found = alike & _wider(found)
    return found


def _channels(image: npt.NDArray[Any]) -> Floats:
    """(C, H, W) in [-1, 1]: no finite image can overflow in what follows."""
    planes = image[None] if image.ndim == 2 else np.moveaxis(image, 2, 0)
    peak = max(abs(float(image.max())), abs(float(image.min())))
    return np.ascontiguousarray(planes / np.float64(peak or 1), np.float32)


def _relief(colour: Floats, sigma: float, contrast: float) -> npt.NDArray[np.uint8]:
    steepest = np.zeros(colour.shape[1:], np.float32)
    for channel in colour:
        padded = np.pad(_blur(_blur(channel)), 1, "edge")
        for ahead, behind in ((np.s_[1:-1, 2:], np.s_[1:-1, :-2]), (np.s_[2:, 1:-1], np.s_[:-2, 1:-1])):
            np.maximum(steepest, np.abs(padded[ahead] - padded[behind]) / 2, out=steepest)
    levels = np.rint((steepest - np.float32(NOISE * sigma)) / np.float32(contrast * STEP))
    relief: npt.NDArray[np.uint8] = np.clip(levels, 0, 255).astype(np.uint8)
    return relief


def _blur(channel: Floats) -> Floats:
    """Binomial weights 1 2 1 along both axes."""
    padded = np.pad(channel, 1, "edge")
    rows = (padded[:-2] + 2 * padded[1:-1] + padded[2:]) / np.float32(4)
    blurred: Floats = (rows[:, :-2] + 2 * rows[:, 1:-1] + rows[:, 2:]) / np.float32(4)
    return blurred


def _level(colour: Floats, level: npt.NDArray[np.uint8]) -> int:
    """The level whose region differs most from the rest, and is brighter; -1 where none is."""
    inside = np.cumsum(np.bincount(level.ravel(), minlength=256)).astype(np.float64)
    outside = level.size - inside
    sums = np.cumsum([np.bincount(level.ravel(), channel.ravel(), 256) for channel in colour], axis=1)
    step = sums / np.maximum(inside, 1) - (sums[:, -1:] - sums) / np.maximum(outside, 1)
    between = np.where(step.sum(axis=0) > 0, inside * outside * (step * step).sum(axis=0), 0)
    return int(between.argmax()) if between.max() > 0 else -1


def _alike(colour: Floats, inside: BoolMap) -> BoolMap:
    """Where the colour is nearer to that inside than to that outside, by Fisher's linear discriminant."""
    parts = [colour[:, where].astype(np.float64) for where in (inside, ~inside)]
    means = [part.mean(axis=1) for part in parts]
    centred = np.concatenate([part - mean[:, None] for part, mean in zip(parts, means, strict=True)], axis=1)
    scatter = centred @ centred.T / centred.shape[1]
    # Grey images saved in colour have a scatter of rank 1.
    scatter += np.eye(len(colour)) * (1e-4 * np.trace(scatter) + 1e-12)
    weights = np.linalg.solve(scatter, means[0] - means[1])
    score: Floats = np.tensordot(weights.astype(np.float32), colour, axes=1)
    return score > np.float32(weights @ (means[0] + means[1]) / 2)


def _regions(inside: BoolMap) -> tuple[npt.NDArray[np.int32], int]:
    region = np.empty(inside.shape, np.int32)
    return region, _core.label(inside.view(np.uint8), region) + 1


def _without_walls(found: BoolMap, disparity: DisparityMap | None) -> BoolMap:
    """Without the regions most of whose pixels were matched nearer than the far distance."""
    matched = np.isfinite(disparity) if disparity is not None else np.zeros(found.shape, bool)
    if disparity is None or not matched.any():
        return found
    near = matched & (np.where(matched, disparity, 0) > np.quantile(disparity[matched], 0.02) + FAR)
    region, count = _regions(found)
    votes = np.bincount(region[near], minlength=count)
    return found & (2 * votes <= np.bincount(region.ravel(), minlength=count))[region]


def _holding(wide: BoolMap, found: BoolMap) -> BoolMap:
    """The regions of `wide` most of which is found already."""
    region, count = _regions(wide)
    held = np.bincount(region[found], minlength=count)
    return wide & (2 * held > np.bincount(region.ravel(), minlength=count))[region]


def _wider(found: BoolMap) -> BoolMap:
    """With the four neighbours of each pixel."""
    wide = found.copy()
    wide[1:] |= found[:-1]
    wide[:-1] |= found[1:]
    wide[:, 1:] |= found[:, :-1]
    wide[:, :-1] |= found[:, 1:]
    return wide
