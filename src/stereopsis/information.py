"""What levels of two images tell of each other, learnt from coarse to fine: for `MutualInformation`."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis import pixelwise, select, validate
from stereopsis.pixelwise import Census, MutualInformation
from stereopsis.types import Disparities, DisparityMap, Flag

Levels = npt.NDArray[np.uint8]
COARSEST = 4
"""The first map is of images of a quarter of the size, or of the whole where these are small."""
LEAST_SIDE = 16


def tables(
    left: npt.NDArray[Any], right: npt.NDArray[Any], disparities: Disparities, threads: int = 0
) -> list[npt.NDArray[np.uint8]]:
    """Costs of pairs of levels, for each channel.

    Instead of a random map, as in [1]_, the start is a map by the census of images shrunk to a quarter; from
    it come the first tables. Those match images of half the size, whose map gives the tables that count. Each
    map is of plain winners over 9 x 9 boxes that pass a left-right check.

    Parameters
    ----------
    left, right : ndarray of uint8 or int32, (H, W, C)
    disparities : Disparities
    threads : int

    Returns
    -------
    list of C ndarrays of uint8, (256, 256)
        As `stereopsis.pixelwise.information` gives them.

    References
    ----------
    .. [1] H. Hirschmüller, Stereo processing by semiglobal matching and mutual information,
       IEEE TPAMI 30(2), 2008, doi:10.1109/TPAMI.2007.1166.
    """
    first, second = pixelwise.levels(left, right)
    factor = COARSEST
    while factor > 1 and min(left.shape[:2]) // factor < LEAST_SIDE:
        factor //= 2
    learnt: list[npt.NDArray[np.uint8]] | None = None
    here = _shrunk(first, factor), _shrunk(second, factor)
    while True:
        around = Disparities(disparities.min // factor, -(-(disparities.max - 1) // factor) + 1)
        cost = MutualInformation(9) if learnt else Census((9, 7), aggregation=9)
        found = _matched(pixelwise.volume(cost, *here, around, threads, learnt), around, threads)
        finer = max(1, factor // 2)
        here = _shrunk(first, finer), _shrunk(second, finer)
        found = _widened(found, factor // finer, here[0].shape)
        learnt = [
            pixelwise.information(here[0][..., channel], here[1][..., channel], found)
            for channel in range(left.shape[2])
        ]
        if finer == 1:
            return learnt
        factor = finer


def _widened(found: DisparityMap, scale: int, shape: tuple[int, ...]) -> DisparityMap:
    rows = np.minimum(np.arange(shape[0]) // scale, found.shape[0] - 1)
    columns = np.minimum(np.arange(shape[1]) // scale, found.shape[1] - 1)
    wide: DisparityMap = found[np.ix_(rows, columns)] * np.float32(scale)
    return wide


def _matched(volume: npt.NDArray[np.uint16], disparities: Disparities, threads: int) -> DisparityMap:
    index = select.left(volume, disparities.min, threads).index
    right = select.right(volume, disparities.min, threads)
    failed = validate.left_right(index, right, disparities.min, 1.0)
    found = (index + np.int32(disparities.min)).astype(np.float32)
    found[(index < 0) | (failed != Flag(0))] = np.nan
    return found


def _shrunk(image: Levels, factor: int) -> Levels:
    """The mean of each factor x factor block; what fills no block is left out."""
    if factor == 1:
        return image
    rows, columns = (side // factor for side in image.shape[:2])
    blocks = image[: rows * factor, : columns * factor].reshape(rows, factor, columns, factor, -1)
    means: Levels = np.rint(blocks.mean(axis=(1, 3))).astype(np.uint8)
    return means
