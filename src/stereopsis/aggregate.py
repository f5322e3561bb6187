"""Aggregate: sums of the terms over the support window."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from stereopsis import _core


def box(terms: npt.NDArray[np.int64], window: tuple[int, int], threads: int = 0) -> npt.NDArray[np.int64]:
    """Sum over a box window, in time that does not depend on its size.

    Parameters
    ----------
    terms : ndarray of int64, (H + height - 1, W + width - 1, D)
        What `stereopsis.cost.terms` gives.
    window : (width, height)
        Full size in pixels. An even window reaches one pixel further to the left and up.
    threads : int
        0: all cores.

    Returns
    -------
    ndarray of int64, (H, W, D)
        Exact: 16-bit products over 255 x 255 pixels in three channels stay below 2^50.
    """
    rows, columns, count = terms.shape
    sums = np.empty((rows - window[1] + 1, columns - window[0] + 1, count), np.int64)
    _core.box(terms, *window, sums, threads)
    return sums
