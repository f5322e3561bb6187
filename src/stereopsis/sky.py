"""Sky: where the left image shows no surface at all."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis import _core, _instructions, noise
from stereopsis._numbers import quantile
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

FARTHEST = 0.02
"""Quantile of the disparities that counts as the farthest surface's."""

FAR = 2.0
"""Pixels of disparity up to which a match nearer than the farthest surface says nothing against the sky."""

OPEN = 0.15
"""What is far in an open view, as a fraction of the nearest ground's disparity, both from infinity's."""

WALL = 0.35
"""Share of a piece that is nearer than far, above which it is no sky."""

ROUGH, STRUCTURE = 6, 0.22
"""No sky is that of which more than this share is relief above this level, matched nearer than `FAR`."""

FEW = 10_000
"""About so many pixels tell the colours of sky and rest."""


def mask(
    image: npt.NDArray[Any],
    disparity: DisparityMap | None = None,
    far: float | None = None,
    threads: int = 0,
) -> BoolMap:
    r"""Where the image shows the sky.

    1. The relief is the largest gradient over directions and channels, after a blur, less what noise
       explains, as a fraction of the contrast. It is flooded from above the first row: the level of a pixel
       is the least, over all paths from the first row, of the highest relief on the path [1]_. The regions
       under a level are nested, connected to the top, and parted from the rest by edges [2]_.
    2. That level is chosen whose region differs most in colour from the rest, by the variance between the
       two [3]_, the region being the brighter.
    3. A piece of which more than `WALL` was matched, and nearer than the far distance, is no sky.
    4. A linear discriminant [4]_ between the two colours takes away what does not look like the rest of the
       sky, and lets the region grow: over weaker edges, and to the edges from which the blur kept it.
    5. None of it is sky where more than `STRUCTURE` of it has edges that were matched near: those of what is
       brightest at night, or in an infrared image.

    Parameters
    ----------
    image : ndarray of any real dtype, (H, W) or (H, W, C)
        A gain or an offset of all grey levels changes nothing but by rounding.
    disparity : ndarray of float32, (H, W), optional
        Matches most of which are right; NaN where refused. None: steps 3 and 5 are left out.
    far : float, optional
        The far distance, in pixels of disparity. None: `FAR` pixels nearer than the `farthest_surface`.
    threads : int
        0: all cores. Never changes the answer.

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
    scaled = _scaled(image)
    colour = np.ascontiguousarray(scaled[None] if image.ndim == 2 else np.moveaxis(scaled, 2, 0))
    sigma = noise.deviation(scaled, threads)
    few = _few(image)
    sample = colour[:, *few]
    low, high = quantile(sample, 0.005), quantile(sample, 0.995)
    if not high - low > max(6 * sigma, 1e-6):
        return np.zeros(colour.shape[1:], bool)
    farthest = None if disparity is None else farthest_surface(disparity)
    if far is None and farthest is not None:
        far = farthest + FAR
    near = None if disparity is None or far is None else disparity > np.float32(far)
    relief, level = np.empty((2, *colour.shape[1:]), np.uint8)
    _core.relief(colour, NOISE * sigma, float(high - low) * STEP, relief, threads, _instructions.forced())
    _core.flood(relief, level)
    if np.mean(level <= SMOOTH) > 0.99:
        return _without_walls(np.ones(level.shape, bool), near)
    chosen = _level(colour[:, *few], level[few])
    found = _without_walls(level <= chosen, near)
    if not found[few].any() or found[few].all():
        return found
    alike = _alike(colour, found, few)
    found &= alike
    weak = alike & (level <= max(WEAK * chosen, WEAKEST))
    found |= _without_walls(_holding(weak, found) & ~found, near)
    if disparity is not None and farthest is not None:
        structure = (relief > ROUGH) & (disparity > np.float32(farthest + FAR))
        if np.count_nonzero(structure & found) > STRUCTURE * np.count_nonzero(found):
            return np.zeros_like(found)
    for _ in range(REACH):
        found = alike & _wider(found)
    return found


def farthest_surface(disparity: DisparityMap) -> float | None:
    """The disparity of the farthest surface that was matched; None where nothing was."""
    matched = disparity[_few(disparity)]
    matched = matched[np.isfinite(matched)]
    return quantile(matched, FARTHEST) if matched.size else None


def _few(image: npt.NDArray[Any]) -> tuple[slice, slice]:
    """The rows and columns that are looked at."""
    each = slice(None, None, max(1, int(np.sqrt(image.shape[0] * image.shape[1] / FEW))))
    return each, each


def _scaled(image: npt.NDArray[Any]) -> Floats:
    """In [-1, 1]: no finite image can overflow in what follows."""
    peak = max(abs(float(image.max())), abs(float(image.min()))) or 1.0
    scaled: Floats = np.divide(image, peak, dtype=np.result_type(image, np.float32)).astype(np.float32)
    return scaled


def _level(colour: Floats, level: npt.NDArray[np.uint8]) -> int:
    """The level whose region differs most from the rest, and is brighter; -1 where none is."""
    inside = np.cumsum(np.bincount(level.ravel(), minlength=256)).astype(np.float64)
    outside = level.size - inside
    sums = np.cumsum([np.bincount(level.ravel(), channel.ravel(), 256) for channel in colour], axis=1)
    step = sums / np.maximum(inside, 1) - (sums[:, -1:] - sums) / np.maximum(outside, 1)
    between = np.where(step.sum(axis=0) > 0, inside * outside * (step * step).sum(axis=0), 0)
    return int(between.argmax()) if between.max() > 0 else -1


def _alike(colour: Floats, inside: BoolMap, few: tuple[slice, slice]) -> BoolMap:
    """Where the colour is nearer to that inside than to that outside, by Fisher's linear discriminant."""
    some = colour[:, *few].reshape(len(colour), -1).astype(np.float64)
    within = inside[few].ravel()
    parts = [part.astype(np.float64) for part in (within, ~within)]
    # Not products of matrices: a linear algebra library's threads would go on waiting beside what follows.
    means = [np.einsum("cn,n->c", some, part) / part.sum() for part in parts]
    scatter = np.einsum("cn,dn->cd", some, some)
    scatter -= sum(part.sum() * np.outer(mean, mean) for part, mean in zip(parts, means, strict=True))
    scatter /= some.shape[1]
    # Grey images saved in colour have a scatter of rank 1.
    scatter += np.eye(len(colour)) * (1e-4 * np.trace(scatter) + 1e-12)
    weights = np.linalg.solve(scatter, means[0] - means[1])
    score: Floats = sum(
        weight * channel for weight, channel in zip(weights.astype(np.float32), colour, strict=True)
    )
    return score > np.float32(weights @ (means[0] + means[1]) / 2)


def _without_walls(found: BoolMap, near: BoolMap | None) -> BoolMap:
    """Without the regions of which more than `WALL` was matched nearer than the far distance."""
    return found if near is None else _regions(found, near, WALL, others=True)


def _holding(wide: BoolMap, found: BoolMap) -> BoolMap:
    """The regions of `wide` most of which is found already."""
    return _regions(wide, found, 0.5)


def _regions(inside: BoolMap, marked: BoolMap, share: float, others: bool = False) -> BoolMap:
    """The regions of `inside` of which more than this share is marked, or the others."""
    kept = np.empty(inside.shape, bool)
    _core.keep_regions(inside.view(np.uint8), marked.view(np.uint8), share, others, kept.view(np.uint8))
    return kept


def _wider(found: BoolMap) -> BoolMap:
    """With the four neighbours of each pixel."""
    wide = found.copy()
    wide[1:] |= found[:-1]
    wide[:-1] |= found[1:]
    wide[:, 1:] |= found[:, :-1]
    wide[:, :-1] |= found[:, 1:]
    return wide
