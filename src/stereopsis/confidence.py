"""Calibrated confidence: how probable it is that an answer is right."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from stereopsis import _core
from stereopsis.types import DisparityMap, Halo

Floats = npt.NDArray[np.float64]

FEATURES = (
    "sharpness",
    "sharpness, saturated",
    "answered, 21 x 21",
    "answered, 41 x 41",
    "jumps, 5 x 5",
    "jumps, 15 x 15",
    "jumps, 31 x 31",
    "off the mean, 5 x 5",
    "off the mean, 15 x 15",
    "disparity",
    "one",
)
"""What the model looks at, in the order of its weights."""

# python benchmarks/confidence.py fit DRIVINGSTEREO KITTI2015 MIDDLEBURY --preset accurate
ANSWERED = (3.917, -0.922, 0.152, 1.931, -1.648, 0.347, -10.767, -0.660, -1.223, 1.524, 1.542)
FILLED = (0.000, 0.000, 1.794, -0.676, -1.437, 4.270, -14.014, 0.047, -1.856, 1.330, 1.522)
"""Weights for pixels that were matched, and for those that were filled."""


HALO = Halo.around(21)
"""What `probability` depends on."""


def probability(
    surface: DisparityMap,
    answered: npt.NDArray[np.bool_],
    sharpness: npt.NDArray[np.float32],
    threads: int = 0,
) -> npt.NDArray[np.float32]:
    r"""The probability that an answer is within 3 pixels of the truth, as a logistic model has it.

    .. math:: P = 1 / (1 + \exp(-\textstyle\sum_k w_k f_k))

    with the features of `features` and one set of weights for pixels that were matched, another for those
    that were filled. The weights were fitted once, on half of the pairs of three benchmarks.

    Parameters
    ----------
    surface : ndarray of float32, (H, W)
        Disparities with every hole filled.
    answered : ndarray of bool, (H, W)
        Where they were matched, not filled.
    sharpness : ndarray of float32, (H, W)
        `stereopsis.refine.confidence` of the winner; 0 where filled.
    threads : int

    Returns
    -------
    ndarray of float32, (H, W)
        In [0, 1].

    References
    ----------
    A. Spyropoulos, N. Komodakis, P. Mordohai, Learning to detect ground control points for improving the
    accuracy of stereo matching, CVPR 2014, doi:10.1109/CVPR.2014.210; the features.
    """
    found = np.empty(surface.shape, np.float32)
    _core.probability(
        np.ascontiguousarray(surface),
        np.ascontiguousarray(answered, np.uint8),
        np.ascontiguousarray(sharpness, np.float32),
        np.array([ANSWERED, FILLED], np.float32),
        LOGISTIC,
        found,
        threads,
    )
    return found


def features(
    surface: DisparityMap, answered: npt.NDArray[np.bool_], sharpness: npt.NDArray[np.float32]
) -> Floats:
    """What the model looks at, one after the other as `FEATURES` names them; what it is fitted with.

    - The winner's sharpness s, and ``s / (s + 0.05)``.
    - The share of matched pixels in the window of 21 and in that of 41 pixels around.
    - The share of pixels next to a jump, of more than 1.5 pixels of disparity to one of their four
      neighbours, in the windows of 5, 15 and 31.
    - How far the disparity is off the window's mean, a, as ``a / (a + 1)``, for 5 and for 15 pixels.
    - The disparity d itself, as ``|d| / (|d| + 16)``; and 1.

    Disparities count in sixteenths of a pixel; windows repeat edge pixels.

    Parameters
    ----------
    surface, answered, sharpness
        As for `probability`.

    Returns
    -------
    ndarray of float64, (H, W, 11)
    """
    jump = np.zeros(surface.shape, bool)
    for axis in (0, 1):
        apart = np.moveaxis(~(np.abs(np.diff(surface, axis=axis)) <= np.float32(1.5)), axis, 0)
        along = np.moveaxis(jump, axis, 0)
        along[1:] |= apart
        along[:-1] |= apart
    level = np.rint(16 * np.clip(surface, -8192, 8192)).astype(np.int64)
    near, wide = (np.abs(level - _mean(level, side)) / 16 for side in (5, 15))
    sharp = sharpness.astype(np.float64)
    close = np.abs(level) / 16
    return np.stack(
        [
            sharp,
            sharp / (sharp + 0.05),
            _mean(answered, 21),
            _mean(answered, 41),
            _mean(jump, 5),
            _mean(jump, 15),
            _mean(jump, 31),
            near / (near + 1),
            wide / (wide + 1),
            close / (close + 16),
            np.ones(surface.shape),
        ],
        axis=2,
    )


def _mean(values: npt.NDArray[np.bool_] | npt.NDArray[np.int64], side: int) -> Floats:
    """Over side x side pixels, edge pixels repeated; from exact sums."""
    sums = values.astype(np.int64)
    for _ in range(2):
        run = np.cumsum(np.pad(sums, ((0, 0), (side // 2 + 1, side // 2)), "edge"), axis=1)
        sums = (run[:, side:] - run[:, :-side]).T
    return sums / side**2


LOGISTIC = (1 / (1 + np.exp(-np.arange(-128, 129) / 16))).astype(np.float32)
"""The logistic function from -8 to 8; between these places it is taken to be straight, beyond them flat."""
LOGISTIC.setflags(write=False)
