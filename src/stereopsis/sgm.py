r"""Semi-global matching: smoothness along straight paths that end in each pixel, summed over the paths.

.. math::
   L_r(p, i) = C(p, i) + \min\bigl(L_r(q, i),\; L_r(q, i \pm 1) + P_1,\; m + P_2\bigr) - m,
   \qquad m = \min_k L_r(q, k), \qquad S(p, i) = \sum_r L_r(p, i)

with :math:`q` the pixel before :math:`p` on the path :math:`r`; at its first pixel :math:`L_r = C`. All are
whole numbers: costs and penalties are counted in units and rounded, so that nothing that follows is. With
:math:`C \le C_{max}` there is :math:`m \le C_{max}`, hence :math:`L_r \le C_{max} + P_2`, and :math:`S` is at
most so many times that as there are paths: it has to fit 16 bits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis import _core, _instructions
from stereopsis._numbers import is_number
from stereopsis.types import Halo, worst_cost

PATHS = (2, 4, 5, 8, 16)
LARGEST_SUM = 65534
"""Sums are 16-bit; 65535 says that a candidate is out of view."""


@dataclass(frozen=True)
class SGM:
    r"""Semi-global matching [1]_, or more-global matching [2]_, over any cost.

    Attributes
    ----------
    paths : {2, 4, 5, 8, 16}
        2: along the rows, both ways. 4: and along the columns. 5: along the rows both ways, and from above
        straight and along both diagonals. 8: all of these both ways. 16: and eight that go two pixels one way
        and one the other.
    p1 : float
        What a step by one candidate costs from a pixel to the next, in the unit of the cost volume.
    p2 : float
        What any larger step costs, at least `p1`.
    p2_min, contrast : float or None
        P2 adapted to the left image: ``max(p2_min, p2 / (1 + |I(p) - I(q)| / contrast))``, I in 256 grey
        levels, as a step of the surface is likely where the image has one. `p2_min` is at least `p1`, and
        `p1` where it is None. No contrast: the same P2 everywhere.
    unit : float or None
        A power of two. Costs and penalties are rounded to whole numbers of it: ``floor(value / unit + 1/2)``.
        Where the largest cost and P2 sum to at most 255 of them, half the memory moves and it takes half
        the time. None: the smallest, but for integer costs at least 1, whose sums fit.
    more_global : bool
        Each path takes the mean, rounded down, of what two pixels tell, the one before it and the one to its
        side that was met before: along the rows, columns and diagonals, whose paths then see a quarter of
        the image each. With 4 or 8 paths.

    Raises
    ------
    ValueError
        For a value that is not allowed.

    Notes
    -----
    A candidate out of view costs what one does by chance, half of the largest cost, so that paths go on
    through it. Where one has the least sum, the pixel is out of view: what it shows lies beside the right
    image. The largest cost is what the costs of pixels and the correlations (2, counted from a perfect match)
    state, and for others the largest in view.

    References
    ----------
    .. [1] H. Hirschmueller, Stereo processing by semiglobal matching and mutual information,
       IEEE TPAMI 30(2), 2008, doi:10.1109/TPAMI.2007.1166.
    .. [2] G. Facciolo, C. de Franchis, E. Meinhardt, MGM: a significantly more global matching for
       stereovision, BMVC 2015, doi:10.5244/C.29.90.
    """

    paths: int = 8
    p1: float = 7
    p2: float = 86
    p2_min: float | None = None
    contrast: float | None = None
    unit: float | None = None
    more_global: bool = False

    def __post_init__(self) -> None:
        if self.paths not in PATHS or isinstance(self.paths, bool):
            raise ValueError(f"paths must be one of {', '.join(map(str, PATHS))}, not {self.paths!r}")
        if self.more_global is None:
            object.__setattr__(self, "more_global", False)
        if not isinstance(self.more_global, bool):
            raise ValueError(f"more_global must be True or False, not {self.more_global!r}")
        if self.more_global and self.paths not in (4, 8):
            raise ValueError(f"paths must be 4 or 8 where more_global is on, not {self.paths}")
        for name, least in (("p1", 0), ("p2", self.p1), ("p2_min", self.p1)):
            value = getattr(self, name)
            if name == "p2_min" and value is None:
                continue
            if not (is_number(value) and is_number(least) and least <= value <= 1e9):
                at_least = "0" if name == "p1" else f"p1, {self.p1!r},"
                raise ValueError(f"{name} must be a number from {at_least} to 1e9, not {value!r}")
        if self.p2_min is not None and self.p2_min > self.p2:
            raise ValueError(f"p2_min must be at most p2, {self.p2!r}, not {self.p2_min!r}")
        if self.contrast is not None and not (is_number(self.contrast) and 0 < self.contrast <= 1e9):
            raise ValueError(
                f"contrast must be a number of grey levels above 0, or None, not {self.contrast!r}"
            )
        if self.unit is not None and not (
            is_number(self.unit) and 2.0**-24 <= self.unit <= 2**24 and math.frexp(self.unit)[0] == 0.5
        ):
            raise ValueError(f"unit must be a power of two from 2^-24 to 2^24, or None, not {self.unit!r}")
        object.__setattr__(self, "paths", int(self.paths))
        for name in ("p1", "p2", "p2_min", "contrast", "unit"):
            value = getattr(self, name)
            object.__setattr__(self, name, None if value is None else float(value))

    def largest_sum(self, most: float, unit: float) -> int:
        """What the sums can reach with costs of up to `most`."""
        return self.paths * (_units(most, unit) + _units(self.p2, unit))

    def unit_for(self, most: float, whole: bool) -> float:
        """The unit: what was asked for, or the smallest that fits costs of up to `most`.

        Raises
        ------
        ValueError
            Where the sums over the paths could be more than 16 bits hold.
        """
        fitting = 1.0 if whole else 2.0**-24
        while self.largest_sum(most, fitting) > LARGEST_SUM:
            fitting *= 2
        if self.unit is None:
            return fitting
        if self.largest_sum(most, self.unit) > LARGEST_SUM:
            raise ValueError(
                f"unit must be at least {fitting:g}, not {self.unit:g}: {self.paths} paths of costs of up to "
                f"{most:g} and p2 = {self.p2:g} sum to up to {self.largest_sum(most, self.unit)} units, and "
                f"16 bits hold up to {LARGEST_SUM}; or take fewer paths, or a p2 that is smaller"
            )
        return self.unit

    def second_penalties(self, unit: float) -> npt.NDArray[np.int32]:
        """P2 in units by the absolute difference of two pixels in grey levels, (256,)."""
        least = self.p1 if self.p2_min is None else self.p2_min
        adapted = np.full(256, self.p2)
        if self.contrast is not None:
            with np.errstate(over="ignore"):  # next to no contrast
                adapted = np.maximum(least, self.p2 / (1 + np.arange(256) / self.contrast))
        return np.floor(adapted / unit + 0.5).astype(np.int32)

    def first_penalty(self, unit: float) -> int:
        """P1 in units."""
        return _units(self.p1, unit)


OVERLAP = 128
"""How far from a part's edges its paths have forgotten them, in pixels: benchmarks/tiles.py measures it."""


def halo(overlap: int = OVERLAP) -> Halo:
    """What hardly less than all of the sums depends on: in truth, paths come from the image's edges."""
    return Halo.around(overlap)


def most_units(largest: float, unit: float) -> int:
    """The largest cost in units."""
    return _units(largest, unit)


def _units(value: float, unit: float) -> int:
    return math.floor(value / unit + 0.5)


def quantised(
    volume: npt.NDArray[Any], perfect: float, scale: float, unit: float, most: float
) -> npt.NDArray[np.uint16]:
    """Costs in units, counted from a perfect match; out of view what a match by chance costs, half of `most`.

    Parameters
    ----------
    volume : ndarray of uint16, int64 or float32, (H, W, D)
    perfect : float
        Cost of a perfect match.
    scale : float
        What one unit of the volume's cost is worth.
    unit, most : float
        In what is so worth.

    Returns
    -------
    ndarray of uint16, (H, W, D)
    """
    top, worst = _units(most, unit), worst_cost(volume.dtype)
    out = np.empty(volume.shape, np.uint16)
    for row, costs in zip(out, volume, strict=True):  # row by row: there is no second volume of doubles
        counted = np.floor((costs.astype(np.float64) - perfect) * (scale / unit) + 0.5)
        row[...] = np.where(costs < worst, np.clip(counted, 0, top), (top + 1) // 2)
    return out


def largest_in_view(volume: npt.NDArray[Any], perfect: float, scale: float) -> float:
    """The largest cost of a volume but the worst, which says that a candidate is out of view."""
    worst = worst_cost(volume.dtype)
    found = [float(row[row < worst].max()) for row in volume if (row < worst).any()]
    return max(0.0, (max(found, default=perfect) - perfect) * scale)


def sums(
    costs: npt.NDArray[np.uint16],
    settings: SGM,
    unit: float,
    most: int,
    guide: npt.NDArray[np.uint8] | None = None,
    threads: int = 0,
) -> npt.NDArray[np.uint16]:
    """Sums of the paths' costs.

    Parameters
    ----------
    costs : ndarray of uint16, (H, W, D)
        In units, at most `most`, out of view as well.
    settings : SGM
    unit : float
        What the penalties are counted in.
    most : int
    guide : ndarray of uint8, (H, W), optional
        The left image; needed where P2 is adapted to it.
    threads : int
        0: all cores. Never changes a result.

    Returns
    -------
    ndarray of uint16, (H, W, D)
    """
    out = np.empty_like(costs)
    kind = _core.mgm_sums if settings.more_global else _core.sgm_sums
    kind(
        np.ascontiguousarray(costs),
        settings.paths,
        most,
        min(settings.first_penalty(unit), LARGEST_SUM),
        settings.second_penalties(unit),
        guide if settings.contrast is not None else None,
        out,
        threads,
        _instructions.forced(),
    )
    return out


def out_of_view(sums: npt.NDArray[np.uint16], first: int, threads: int = 0) -> npt.NDArray[np.int32]:
    """Set the sums of candidates out of view to 65535, in place, and tell where one of them was the least.

    Parameters
    ----------
    sums : ndarray of uint16, (H, W, D)
    first : int
        Disparity of candidate 0.
    threads : int

    Returns
    -------
    ndarray of int32, (H, W)
        The number of that candidate; -1 where the least sum is in view.
    """
    beyond = np.empty(sums.shape[:2], np.int32)
    _core.hide_out_of_view(sums, first, beyond, threads)
    return beyond
