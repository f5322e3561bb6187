"""Fill invalid pixels from their neighbours."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

Float = TypeVar("Float", bound=np.floating[Any])


def background(disparity: npt.NDArray[Float]) -> npt.NDArray[Float]:
    """Fill every hole with the farther of its two neighbours on the row, as the KITTI development kit does.

    A hole is a run of invalid pixels on a row. Between two answered pixels it takes the smaller of their
    disparities, because what only one camera sees belongs to the background. At either end of a row it takes
    the nearest answer. Then the rows without any answer above the first answered row, or below the last,
    repeat that row. A row without any answer between answered rows stays invalid, as does a map without any.

    Parameters
    ----------
    disparity : ndarray of float32 or float64, (H, W)
        Disparity in pixels; NaN or infinite where invalid. Not changed.

    Returns
    -------
    ndarray, (H, W)
        A filled copy of the same dtype; NaN where nothing could be filled.

    Raises
    ------
    TypeError
        If `disparity` is not an array of float32 or float64.
    ValueError
        If `disparity` does not have two dimensions.

    References
    ----------
    A. Geiger, P. Lenz, R. Urtasun: Are we ready for autonomous driving? The KITTI vision benchmark suite.
    CVPR 2012, doi:10.1109/CVPR.2012.6248074; the background interpolation of its development kit.
    """
    if not isinstance(disparity, np.ndarray):
        raise TypeError(f"disparity must be an array, not {type(disparity).__name__}")
    if disparity.dtype not in (np.float32, np.float64):
        raise TypeError(f"disparity must be float32 or float64, not {disparity.dtype}")
    if disparity.ndim != 2:
        raise ValueError(f"disparity must be (H, W), not of shape {disparity.shape}")
    if not disparity.size:
        return disparity.copy()

    filled: npt.NDArray[Float] = np.fmin(_from_left(disparity), _from_left(disparity[:, ::-1])[:, ::-1])
    # Each row is now answered throughout or not at all, so its first column tells.
    answered = np.flatnonzero(np.isfinite(filled[:, 0]))
    if answered.size:
        first, last = answered[0], answered[-1]
        filled[:first] = filled[first]
        filled[last + 1 :] = filled[last]
    return filled


def _from_left(disparity: npt.NDArray[Float]) -> npt.NDArray[Float]:
    """Give each pixel the last answer at or before it on its row; NaN where there is none."""
    valid = np.isfinite(disparity)
    source = np.where(valid, np.arange(disparity.shape[1]), -1)
    np.maximum.accumulate(source, axis=1, out=source)
    carried = np.take_along_axis(disparity, np.maximum(source, 0), axis=1)
    carried[source < 0] = np.nan
    return carried
