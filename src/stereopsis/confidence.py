"""Calibrated confidence: how probable it is that an answer is right."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from stereopsis import _core
from stereopsis.types import DisparityMap, Halo

Floats = npt.NDArray[np.float64]

FEATURES = (
    "sharpness",
    "sharpness, 15 x 15",
    "answered, 21 x 21",
    "drawn, 5 x 5",
    "jumps, 31 x 31",
    "off the mean, 5 x 5",
    "off the mean, 15 x 15",
    "spread, 31 x 31",
    "texture, 9 x 9",
    "one",
)
"""What the model looks at, in the order of its weights."""


class Model(NamedTuple):
    """Weights of the features: for pixels that were matched, and for those that were filled."""

    answered: tuple[float, ...]
    filled: tuple[float, ...]


# python benchmarks/confidence.py fit DRIVINGSTEREO KITTI2015 MIDDLEBURY --preset accurate
SEMI_GLOBAL = Model(
    (2.006, 6.973, -1.599, -2.372, -10.449, -2.265, -0.362, 2.486, -2.821, 3.467),
    (0.000, -1.079, 1.849, -1.916, -16.347, -0.850, -1.163, 2.302, -1.202, 2.323),
)
"""For semi-global matching."""
# The same with --preset fast --preset local --set fill=surfaces
LOCAL = Model(
    (0.872, 0.943, 1.114, -0.357, -4.445, -0.864, -3.298, 1.180, -1.419, 2.915),
    (0.000, -0.598, 2.781, -0.087, -5.918, -0.786, -1.873, 1.118, -1.201, 1.541),
)
"""For everything else."""
# python benchmarks/confidence.py fit DRIVINGSTEREO KITTI2015 MIDDLEBURY --unfiltered sgm
SEMI_GLOBAL_UNFILTERED = Model(
    (1.590, 6.007, -1.485, -0.822, -2.904, -1.655, -2.710, 2.194, -0.476, 3.042),
    (0.000, 5.185, 2.214, -0.692, -0.014, -0.854, -2.585, 1.433, -0.632, -0.082),
)
"""For semi-global matching whose regions and surfaces no filter has looked at."""
# The same with --unfiltered local
LOCAL_UNFILTERED = Model(
    (2.003, 0.983, -1.355, -0.355, -3.110, -1.158, -1.896, 0.156, 1.098, 6.089),
    (0.000, 2.127, 2.139, -0.047, -1.269, -0.867, -2.581, 2.159, -0.268, -1.959),
)
"""For everything else, with a window of 1 x 1..."""
PER_DOUBLING = -0.657, 0.513
"""...and what the last weight gains with each doubling of the window's side."""

TEXTURE_WINDOW = (9, 9)
"""Of `stereopsis.validate.texture`, which the model looks at."""
HALO = Halo.around(16)
"""What `probability` depends on."""


def model(semi_global: bool, filtered: bool, window: tuple[int, int]) -> Model:
    """The weights for a map.

    Maps that no filter has seen hold wrong answers of other looks than those that are left in filtered ones.

    Parameters
    ----------
    semi_global : bool
        Whether it comes from semi-global matching.
    filtered : bool
        Whether small regions were removed from it, or it was drawn to planes.
    window : (int, int)
        Width and height of all that the cost sees: a large window's wrong answers lie beside jumps, in smooth
        places.

    Returns
    -------
    Model
    """
    if filtered:
        return SEMI_GLOBAL if semi_global else LOCAL
    if semi_global:
        return SEMI_GLOBAL_UNFILTERED
    answered, filled = (
        (*weights[:-1], weights[-1] + gain * doublings(window))
        for weights, gain in zip(LOCAL_UNFILTERED, PER_DOUBLING, strict=True)
    )
    return Model(answered, filled)


def doublings(window: tuple[int, int]) -> float:
    """How often the side of a window was doubled."""
    return math.log2(window[0] * window[1]) / 2


def probability(
    surface: DisparityMap,
    answered: npt.NDArray[np.bool_],
    sharpness: npt.NDArray[np.float32],
    winners: DisparityMap,
    texture: npt.NDArray[np.float32],
    model: Model,
    threads: int = 0,
) -> npt.NDArray[np.float32]:
    r"""The probability that an answer is within 3 pixels of the truth, as a logistic model has it.

    .. math:: P = 1 / (1 + \exp(-\textstyle\sum_k w_k f_k))

    with the features of `features` and one set of weights for pixels that were matched, another for those
    that were filled. The weights were fitted once, on half of the pairs of three benchmarks, to rank errors
    of 1, 2 and 3 pixels at once [2]_.

    Parameters
    ----------
    surface : ndarray of float32, (H, W)
        Disparities with every hole filled.
    answered : ndarray of bool, (H, W)
        Where they were matched, not filled.
    sharpness : ndarray of float32, (H, W)
        `stereopsis.refine.confidence` of the winner; 0 where filled.
    winners : ndarray of float32, (H, W)
        The disparities before any filter; NaN for none. Only where `answered`.
    texture : ndarray of float32, (H, W)
        `stereopsis.validate.texture` of the left image, in 256 grey levels, over `TEXTURE_WINDOW`.
    model : Model
        As `model` has it: sharpness means another thing after another cost.
    threads : int

    Returns
    -------
    ndarray of float32, (H, W)
        In [0, 1].

    References
    ----------
    .. [1] A. Spyropoulos, N. Komodakis, P. Mordohai, Learning to detect ground control points for improving
       the accuracy of stereo matching, CVPR 2014, doi:10.1109/CVPR.2014.210; features of this kind.
    .. [2] P. McCullagh, Regression models for ordinal data, Journal of the Royal Statistical Society B 42(2),
       1980, doi:10.1111/j.2517-6161.1980.tb01109.x.
    """
    found = np.empty(surface.shape, np.float32)
    _core.probability(
        np.ascontiguousarray(surface),
        np.ascontiguousarray(answered, np.uint8),
        np.ascontiguousarray(sharpness, np.float32),
        np.ascontiguousarray(winners, np.float32),
        np.ascontiguousarray(texture, np.float32),
        np.array(model, np.float32),
        LOGISTIC,
        found,
        threads,
    )
    return found


def features(
    surface: DisparityMap,
    answered: npt.NDArray[np.bool_],
    sharpness: npt.NDArray[np.float32],
    winners: DisparityMap,
    texture: npt.NDArray[np.float32],
) -> Floats:
    """What the model looks at, one after the other as `FEATURES` names them; what it is fitted with.

    - The winner's sharpness, and its mean over 15 x 15 pixels.
    - The share of matched pixels in the window of 21.
    - How far the filters drew the winners, at most 3 pixels, which also count for what was filled: the mean
      m over 5 x 5, as ``m / (m + 0.5)``.
    - The share of pixels next to a jump, of more than 1.5 pixels of disparity to one of their four
      neighbours, in the window of 31.
    - How far the disparity is off the window's mean, a, as ``a / (a + 1)``, for 5 and for 15 pixels.
    - The standard deviation s of the disparities in the window of 31, as ``s / (s + 2)``.
    - The texture t, as ``t / (t + 8)``; and 1.

    Disparities, and how far they differ, count in sixteenths of a pixel, sharpness in steps of 2^-16; windows
    repeat edge pixels.

    Parameters
    ----------
    surface, answered, sharpness, winners, texture
        As for `probability`.

    Returns
    -------
    ndarray of float64, (H, W, 10)
    """
    jump = np.zeros(surface.shape, bool)
    for axis in (0, 1):
        apart = np.abs(np.moveaxis(np.diff(surface, axis=axis), axis, 0))
        along = np.moveaxis(jump, axis, 0)
        along[1:] |= apart > JUMP
        along[:-1] |= apart > JUMP
    with np.errstate(invalid="ignore"):
        drawn = np.abs(winners - surface)
    drawn = np.where(answered & (drawn < FAR_OFF), drawn, np.float32(FAR_OFF))
    level = _levels(np.clip(surface, -8192, 8192))
    variance = _sums(level**2, 31) * 31**2 - _sums(level, 31) ** 2
    near, wide = (np.abs(level - _sums(level, side) / side**2) / 16 for side in (5, 15))
    far = _sums(_levels(drawn), 5) / 16 / 5**2
    spread = np.sqrt(variance) / 16 / 31**2
    dull = texture.astype(np.float64)
    return np.stack(
        [
            sharpness.astype(np.float64),
            _sums(np.rint(sharpness.astype(np.float64) * 2**16).astype(np.int64), 15) / 2**16 / 15**2,
            _sums(answered, 21) / 21**2,
            far / (far + 0.5),
            _sums(jump, 31) / 31**2,
            near / (near + 1),
            wide / (wide + 1),
            spread / (spread + 2),
            dull / (dull + 8),
            np.ones(surface.shape),
        ],
        axis=2,
    )


JUMP, FAR_OFF = 1.5, 3.0
"""From how many pixels of disparity on neighbours are no surface, and a winner's distance counts no more."""


def _levels(disparity: npt.NDArray[np.float32]) -> npt.NDArray[np.int64]:
    """In sixteenths of a pixel."""
    return np.rint(16 * disparity).astype(np.int64)


def _sums(values: npt.NDArray[np.bool_] | npt.NDArray[np.int64], side: int) -> npt.NDArray[np.int64]:
    """Over side x side pixels, edge pixels repeated."""
    sums = values.astype(np.int64)
    for _ in range(2):
        run = np.cumsum(np.pad(sums, ((0, 0), (side // 2 + 1, side // 2)), "edge"), axis=1)
        sums = (run[:, side:] - run[:, :-side]).T
    return sums


LOGISTIC = (1 / (1 + np.exp(-np.arange(-128, 129) / 16))).astype(np.float32)
"""The logistic function from -8 to 8; between these places it is taken to be straight, beyond them flat."""
LOGISTIC.setflags(write=False)
