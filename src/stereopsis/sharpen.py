r"""Sharpen: undo some of the blur that cameras, their colour filters and rectification leave.

.. math:: I' = I + \alpha \, (I - B * I)

with :math:`B` the binomial weights of 5 x 5 pixels, an unsharp mask [1]_.

References
----------
.. [1] W. F. Schreiber, Wirephoto quality improvement by unsharp masking, Pattern Recognition 2(2), 117-121,
   1970.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis import _core
from stereopsis.types import Halo

LARGEST = 4.0
"""Of all amounts."""
MOST, SHARP, RISE = 0.75, 0.405, 30.0
"""What blurred images get; the roughness from which on they are sharp; and the amount's rise below that."""
COLUMNS = 4
"""Every so manyeth column is looked at."""
HALO = Halo.around(2)
"""What `sharpened` depends on."""


def sharpened(image: npt.NDArray[Any], amount: float, threads: int = 0) -> npt.NDArray[Any]:
    r"""The image, each pixel further off the mean around it.

    The amount :math:`\alpha` counts in 64ths, the result is rounded, edge pixels are repeated. Bytes stay
    between 0 and 255.

    Parameters
    ----------
    image : ndarray of uint8 or int32, (H, W, C)
        Of magnitudes up to 2^24.
    amount : float
        From 0 to `LARGEST`.
    threads : int
        0: all cores.

    Returns
    -------
    ndarray of the same dtype and shape
    """
    sharp = np.empty_like(image, order="C")
    _core.sharpen(np.ascontiguousarray(image), round(64 * amount), sharp, threads)
    return sharp


def steps(image: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """Sums of the squared differences of a pixel and the next one below it, and the next but one.

    Where there is a next but one. Whole numbers, exact below 2^53; those of bands of rows that overlap by two
    add up to those of the image.

    Parameters
    ----------
    image : ndarray of uint8 or int32, (H, W, C)

    Returns
    -------
    ndarray of float64, (2,)
    """
    some = image[:, ::COLUMNS].astype(np.float64)
    # Not a product of vectors: a linear algebra library's threads would go on waiting beside what follows.
    return np.array([np.square(below - some[:-2]).sum() for below in (some[1:-1], some[2:])])


def amount_for(sums: npt.NDArray[np.float64]) -> float:
    r"""How much of an image's blur to undo, by what `steps` tells of it.

    The mean square of the differences one row apart, over that of two rows apart, is 1/4 where an image is
    smooth from pixel to pixel, and 1/2 where its pixels know nothing of each other. The amount falls from
    `MOST` to 0 where this roughness reaches `SHARP`.

    Parameters
    ----------
    sums : ndarray of float64, (2,)
        Of the left image, whose rows are as they came.

    Returns
    -------
    float
        0 for rows that are all alike, or less than three.
    """
    near, far = sums.tolist()
    if not far > 0:
        return 0.0
    return float(min(MOST, max(0.0, RISE * (SHARP - near / far))))
