"""Select: the winner takes all, for the left and for the right view of the same volume."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis import _core
from stereopsis.types import EVERY, Disparities, Halo, Sampling


def halo(disparities: Disparities) -> Halo:
    """What a left pixel's winner depends on: the columns of the right image where its candidates lie."""
    return Halo(left=max(0, disparities.max - 1), right=max(0, -disparities.min))


@dataclass(frozen=True)
class Winners:
    """For each left pixel the winning candidate and the costs around it, (H, W) each.

    Attributes
    ----------
    index : ndarray of int32
        Candidate number, -1 where no candidate is in view. Of equal ones the first.
    cost, before, after : ndarray
        Cost of the winner and of its two neighbours; the volume's worst value where there is no neighbour.
    second : ndarray
        Least cost apart from these three.
    """

    index: npt.NDArray[np.int32]
    cost: npt.NDArray[Any]
    before: npt.NDArray[Any]
    after: npt.NDArray[Any]
    second: npt.NDArray[Any]


def left(
    volume: npt.NDArray[Any],
    first: int,
    threads: int = 0,
    *,
    width: int | None = None,
    sampling: Sampling = EVERY,
) -> Winners:
    """Winners of the left view: for each ``(x, y)`` the candidate of least cost.

    Parameters
    ----------
    volume : ndarray of int64, uint16 or float32, (H, W', D)
        Column k is column ``k * step`` of the left image.
    first : int
        Disparity of candidate 0; the others follow ``disparity_step`` apart.
    threads : int
    width : int, optional
        Columns of the images. None: W'.
    sampling : Sampling
    """
    shape = volume.shape[:2]
    winners = Winners(np.empty(shape, np.int32), *(np.empty(shape, volume.dtype) for _ in range(4)))
    lattice = shape[1] if width is None else width, *sampling
    _core.select_left(
        volume,
        first,
        *lattice,
        winners.index,
        winners.cost,
        winners.before,
        winners.after,
        winners.second,
        threads,
    )
    return winners


def at(volume: npt.NDArray[Any], index: npt.NDArray[np.int32], first: int, threads: int = 0) -> Winners:
    """What `left` tells, of candidates that were chosen otherwise.

    Parameters
    ----------
    volume : ndarray of int64, uint16 or float32, (H, W, D)
    index : ndarray of int32, (H, W)
        Candidate numbers; -1 for none, as for one that is not in view.
    first : int
        Disparity of candidate 0.
    threads : int
    """
    chosen = Winners(index.copy(), *(np.empty(index.shape, volume.dtype) for _ in range(4)))
    _core.select_at(
        volume, first, chosen.index, chosen.cost, chosen.before, chosen.after, chosen.second, threads
    )
    return chosen


def right(
    volume: npt.NDArray[Any],
    first: int,
    threads: int = 0,
    *,
    width: int | None = None,
    sampling: Sampling = EVERY,
) -> npt.NDArray[np.int32]:
    """Winners of the right view: for each ``(x_right, y)`` the candidate of least cost at ``x_right + d``.

    Parameters are those of `left`.

    Returns
    -------
    ndarray of int32, (H, W)
        Candidate number, -1 where no candidate is in view.
    """
    columns = volume.shape[1] if width is None else width
    index = np.empty((volume.shape[0], columns), np.int32)
    _core.select_right(volume, first, columns, *sampling, index, threads)
    return index
