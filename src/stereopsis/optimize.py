r"""Optimize: labels that agree with their neighbours, by least energy.

.. math:: E(f) = \sum_p C(p, f_p) + \lambda \sum_{(p, q)} V(f_p - f_q)

over all pixels :math:`p` and all pairs :math:`(p, q)` of neighbours, of which a pixel has four.
:math:`C` is the cost volume as it is, so the weight :math:`\lambda` is in the unit of the cost: for a
correlation a fraction of 1, for a sum of squares a great number that grows with the window. A label is
a candidate's number in the volume; one whose cost is the volume's worst value (infinity, or the type's
largest) is not possible.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from stereopsis import _core, _cuts
from stereopsis._numbers import is_number
from stereopsis.types import Halo, worst_cost

Data: TypeAlias = Literal["sad", "ssd", "zsad", "zssd", "ncc", "zncc"]
DATA = ("sad", "ssd", "zsad", "zssd", "ncc", "zncc")
NORMS = ("l1", "l2")
FRACTION = 2**16
"""Parts of a penalty that the second pass tells apart, where the truncation makes it no whole number."""


@dataclass(frozen=True)
class Smoothness:
    r"""What a difference between neighbours' labels costs: :math:`\lambda \min(|a|, t)^k`.

    Attributes
    ----------
    norm : {"l1", "l2"}
        :math:`k`, 1 or 2: the absolute difference or its square.
    weight : float
        :math:`\lambda`, at least 0, in the unit of the cost a pixel, or a squared pixel, of disparity.
    truncation : float or None
        :math:`t`, above 0, in pixels of disparity: no difference costs more than this one. None: no limit.

    Raises
    ------
    ValueError
        For a value that is not allowed.
    """

    norm: Literal["l1", "l2"] = "l1"
    weight: float = 0.1
    truncation: float | None = None

    def __post_init__(self) -> None:
        if self.norm not in NORMS:
            raise ValueError(f"smoothness must be one of {', '.join(NORMS)}, not {self.norm!r}")
        if not (is_number(self.weight) and 0 <= self.weight <= 1e20):
            raise ValueError(f"smoothness_weight must be a number from 0 to 1e20, not {self.weight!r}")
        if self.truncation is not None and not (is_number(self.truncation) and 0 < self.truncation <= 2**24):
            raise ValueError(
                f"smoothness_truncation must be a number of pixels above 0, or None, not {self.truncation!r}"
            )
        object.__setattr__(self, "weight", float(self.weight))
        if self.truncation is not None:
            object.__setattr__(self, "truncation", float(self.truncation))

    @property
    def power(self) -> int:
        """1 or 2."""
        return NORMS.index(self.norm) + 1

    @property
    def limit(self) -> float:
        """The truncation, infinite where there is none."""
        return math.inf if self.truncation is None else self.truncation

    @property
    def is_metric(self) -> bool:
        """Whether the triangle inequality holds between any three whole labels."""
        return self.norm == "l1" or self.limit**2 <= 2 + 1e-9

    def __call__(self, difference: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Penalties of differences in pixels, of any shape."""
        steps = np.minimum(np.abs(np.asarray(difference, np.float64)), self.limit)
        return np.asarray(self.weight * steps**self.power)


@dataclass(frozen=True)
class _Solver:
    smoothness: Smoothness = Smoothness()

    def __post_init__(self) -> None:
        if not isinstance(self.smoothness, Smoothness):
            raise TypeError(f"smoothness must be a Smoothness, not {self.smoothness!r}")


@dataclass(frozen=True)
class _Iterative(_Solver):
    iterations: int = 10

    def __post_init__(self) -> None:
        super().__post_init__()
        count: Any = self.iterations
        if not (isinstance(count, int | np.integer) and not isinstance(count, bool) and 1 <= count <= 10**6):
            raise ValueError(f"iterations must be a whole number from 1 to 1000000, not {count!r}")
        object.__setattr__(self, "iterations", int(count))


@dataclass(frozen=True)
class SecondPass(_Solver):
    r"""Match again, drawn towards a first map :math:`D`: no energy of the neighbours, but a window's.

    .. math:: \frac{1}{n} \sum_{q \in W_p} \left( C(q, d) + \lambda V(D_q - d) \right) \to \min_d

    With the squared difference this is the data's mean plus :math:`\lambda (\bar D - d)^2` and a constant: it
    draws towards the mean of the first map over the window. With the absolute difference it draws towards the
    median.

    Attributes
    ----------
    smoothness : Smoothness
        Weight a pixel of the window; by default ``0.5 (D - d)^2``.
    data : {"sad", "ssd", "zsad", "zssd", "ncc", "zncc"} or None
        Cost of the second pass, over the first one's window; its mean over the window's pixels, but for the
        correlations, which have none. None: the first pass's cost.
    """

    smoothness: Smoothness = Smoothness("l2", 0.5)
    data: Data | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.data is not None and self.data not in DATA:
            raise ValueError(f"data must be one of {', '.join(DATA)}, or None, not {self.data!r}")


@dataclass(frozen=True)
class ICM(_Iterative):
    """Iterated conditional modes: from the winners on, each pixel takes what suits its neighbours best.

    The two colours of a chessboard take turns, so the energy never rises; it ends where none changes [1]_.

    Attributes
    ----------
    smoothness : Smoothness
    iterations : int
        At most.

    References
    ----------
    .. [1] J. Besag, On the statistical analysis of dirty pictures, JRSS B 48(3), 1986,
       doi:10.1111/j.2517-6161.1986.tb01412.x.
    """


@dataclass(frozen=True)
class BeliefPropagation(_Iterative):
    """Loopy min-sum belief propagation, from coarse to fine, in time linear in the labels [1]_.

    Attributes
    ----------
    smoothness : Smoothness
    iterations : int
        On each level; one updates both colours of the chessboard.
    levels : int
        Of the pyramid; 1: the image alone.

    References
    ----------
    .. [1] P. Felzenszwalb, D. Huttenlocher, Efficient belief propagation for early vision, IJCV 70(1), 2006,
       doi:10.1007/s11263-006-7899-4.
    """

    iterations: int = 5
    levels: int = 5

    def __post_init__(self) -> None:
        super().__post_init__()
        levels: Any = self.levels
        if not (isinstance(levels, int | np.integer) and not isinstance(levels, bool) and 1 <= levels <= 30):
            raise ValueError(f"levels must be a whole number from 1 to 30, not {levels!r}")
        object.__setattr__(self, "levels", int(levels))


@dataclass(frozen=True)
class TRWS(_Iterative):
    """Sequential tree-reweighted message passing, which also bounds the least energy from below [1]_.

    Attributes
    ----------
    smoothness : Smoothness
    iterations : int
        Each forth and back over the image; the best labels of all are kept.

    References
    ----------
    .. [1] V. Kolmogorov, Convergent tree-reweighted message passing for energy minimization,
       IEEE TPAMI 28(10), 2006, doi:10.1109/TPAMI.2006.200.
    """


@dataclass(frozen=True)
class Expansion(_Iterative):
    r"""Graph cuts by :math:`\alpha`-expansion: each move offers one label to all pixels at once [1]_.

    For a metric alone: L1, truncated or not. Where no cost is negative, its energy is at most
    :math:`2 \max_{a \ne 0} V / \min_{a \ne 0} V` times the least. Needs the extra "graphcut".

    Attributes
    ----------
    smoothness : Smoothness
    iterations : int
        Sweeps over all labels, at most; it ends where one gains nothing.

    Raises
    ------
    ValueError
        For a smoothness that is no metric.

    References
    ----------
    .. [1] Y. Boykov, O. Veksler, R. Zabih, Fast approximate energy minimization via graph cuts,
       IEEE TPAMI 23(11), 2001, doi:10.1109/34.969114.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.smoothness.is_metric:
            raise ValueError(
                "smoothness must be a metric for an expansion, as l1 is, truncated or not; l2 breaks the "
                "triangle inequality: take Swap, TRWS or BeliefPropagation for it"
            )


@dataclass(frozen=True)
class Swap(_Iterative):
    r"""Graph cuts by :math:`\alpha\beta`-swap: each move lets the pixels of two labels exchange them [1]_.

    For any smoothness. A sweep takes a cut for every pair of labels. Needs the extra "graphcut".

    Attributes
    ----------
    smoothness : Smoothness
    iterations : int
        Sweeps over all pairs of labels, at most; it ends where one gains nothing.

    References
    ----------
    .. [1] Y. Boykov, O. Veksler, R. Zabih, Fast approximate energy minimization via graph cuts,
       IEEE TPAMI 23(11), 2001, doi:10.1109/34.969114.
    """


Solver: TypeAlias = ICM | BeliefPropagation | TRWS | Expansion | Swap
Optimizer: TypeAlias = SecondPass | Solver


@dataclass(frozen=True)
class Solution:
    """What a solver found.

    Attributes
    ----------
    index : ndarray of int32, (H, W)
        Candidate numbers, -1 where no candidate is possible.
    energy : float
        Of these labels, from the volume as it is.
    bound : float or None
        No labels have less energy, to float32's rounding; from `TRWS` alone.
    """

    index: npt.NDArray[np.int32]
    energy: float
    bound: float | None = None


def energy(
    disparity: npt.NDArray[Any], volume: npt.NDArray[Any], smoothness: Smoothness, first: int = 0
) -> float:
    """Energy of a map of whole disparities, so that all solvers can be compared.

    Parameters
    ----------
    disparity : ndarray, (H, W)
        Whole pixels. NaN takes no part: neither its cost nor its differences from its neighbours count.
    volume : ndarray of int64, uint16 or float32, (H, W, D)
    smoothness : Smoothness
    first : int
        Disparity of candidate 0.

    Returns
    -------
    float
        Summed in float64. Infinite where a disparity is one that its pixel cannot have, being out of view.

    Raises
    ------
    ValueError
        For shapes that do not agree, and disparities that are no whole candidates of the volume.
    """
    volume = _checked_volume(volume)
    disparity = np.asarray(disparity)
    if disparity.shape != volume.shape[:2]:
        raise ValueError(f"disparity must have the volume's shape {volume.shape[:2]}, not {disparity.shape}")
    known = ~np.isnan(disparity) if disparity.dtype.kind == "f" else np.ones(disparity.shape, bool)
    index = np.where(known, disparity, first) - first
    if not ((index == np.rint(index)) & (index >= 0) & (index < volume.shape[2])).all():
        raise ValueError(
            f"disparity must hold whole candidates from {first} to {first + volume.shape[2] - 1}, or NaN; "
            "round it, and clip it, first"
        )
    return _energy(np.where(known, index, -1).astype(np.int32), volume, smoothness)


def _energy(index: npt.NDArray[np.int32], volume: npt.NDArray[Any], smoothness: Smoothness) -> float:
    known = index >= 0
    costs = np.take_along_axis(volume, np.where(known, index, 0)[..., None], axis=2)[..., 0]
    impossible = known & (costs == worst_cost(volume.dtype))
    if impossible.any():
        return math.inf
    total = float(np.sum(costs, where=known, dtype=np.float64))
    for one, other in (((..., slice(-1)), (..., slice(1, None))), (slice(-1), slice(1, None))):
        both = known[one] & known[other]
        total += float(np.sum(smoothness(index[one] - index[other]), where=both))
    return total


def _checked_volume(volume: Any) -> npt.NDArray[Any]:
    if not isinstance(volume, np.ndarray) or volume.dtype not in (np.int64, np.uint16, np.float32):
        given = getattr(volume, "dtype", type(volume).__name__)
        raise TypeError(f"volume must be an array of int64, uint16 or float32, not {given}")
    if volume.ndim != 3 or volume.shape[2] == 0:
        raise ValueError(f"volume must be (H, W, D) with D above 0, not of shape {volume.shape}")
    return np.ascontiguousarray(volume)


def solve(volume: npt.NDArray[Any], solver: Solver, threads: int = 0) -> Solution:
    """Labels of little energy.

    Parameters
    ----------
    volume : ndarray of int64, uint16 or float32, (H, W, D)
        Lower is better; the type's largest value, or infinity, where a candidate is not possible.
    solver : ICM, BeliefPropagation, TRWS, Expansion or Swap
        With its smoothness.
    threads : int
        0: all cores. Never changes a result.

    Returns
    -------
    Solution

    Raises
    ------
    TypeError
        For a volume of another type, or no solver; `SecondPass` needs a first map: `second_pass`.
    ImportError
        For a graph cut without the extra "graphcut".

    Notes
    -----
    A pixel without a possible candidate keeps -1 and takes no part. Costs are counted from each pixel's
    least and held in float32. The graph cuts take whole numbers, of which the largest cost or penalty is
    at most 2^36: a cost is off by at most 2^-36 of that largest one, the weight by half a unit.
    """
    if not isinstance(solver, ICM | BeliefPropagation | TRWS | Expansion | Swap):
        raise TypeError(
            f"solver must be one of ICM, BeliefPropagation, TRWS, Expansion, Swap, not {solver!r}"
        )
    volume = _checked_volume(volume)
    costs = np.empty(volume.shape, np.float32)
    least = np.empty(volume.shape[:2])
    _core.relative_costs(volume, costs, least, threads)
    labels: npt.NDArray[np.int32] = np.argmin(costs, axis=2).astype(np.int32)
    labels[np.isinf(np.take_along_axis(costs, labels[..., None], axis=2)[..., 0])] = -1
    model = solver.smoothness
    bound = None
    match solver:
        case ICM(iterations=iterations):
            _core.iterated_conditional_modes(
                costs, model.power, model.weight, model.limit, iterations, labels, threads
            )
        case BeliefPropagation(iterations=iterations, levels=levels):
            _core.belief_propagation(
                costs, model.power, model.weight, model.limit, iterations, levels, labels, threads
            )
        case TRWS(iterations=iterations):
            above = _core.tree_reweighted(
                costs, model.power, model.weight, model.limit, iterations, labels, threads
            )
            bound = above + float(least.sum())
        case Expansion(iterations=iterations):
            problem = _cuts.quantised(costs, model.weight, model.power, model.truncation)
            labels = _cuts.expand(problem, labels, iterations)
        case Swap(iterations=iterations):
            problem = _cuts.quantised(costs, model.weight, model.power, model.truncation)
            labels = _cuts.swap(problem, labels, iterations)
    return Solution(labels, _energy(labels, volume, model), bound)


def second_pass_halo(window: tuple[int, int]) -> Halo:
    """How far around a pixel the first map counts in `second_pass`."""
    return Halo.box(window)


def second_pass(
    volume: npt.NDArray[Any],
    guide: npt.NDArray[np.int32],
    smoothness: Smoothness,
    window: tuple[int, int],
    scale: float = 1.0,
    threads: int = 0,
    out: npt.NDArray[np.float32] | None = None,
) -> npt.NDArray[np.float32]:
    """Costs that are drawn towards a first map: what `SecondPass` minimises.

    Parameters
    ----------
    volume : ndarray of int64, uint16 or float32, (H, W, D)
        Costs of the window.
    guide : ndarray of int32, (H, W)
        Candidate numbers of the first map; -1, where there is none, does not count.
    smoothness : Smoothness
    window : (width, height)
        Full size in pixels, edge pixels repeated. An even one reaches one pixel further to the left and up.
    scale : float
        What one unit of the volume's cost is worth; 1 over the pixels of the window for the data's mean.
    threads : int
        0: all cores. Never changes a result.
    out : ndarray of float32, (H, W, D), optional
        Where the result goes: the volume itself, or another array.

    Returns
    -------
    ndarray of float32, (H, W, D)
        ``scale * cost`` plus the mean of the penalties over those of the window's pixels that have a first
        disparity; infinity where the candidate is not possible.

    Notes
    -----
    The penalties are summed as whole numbers, in 2^-16 where a truncation is no whole one: there is no drift.
    """
    volume = _checked_volume(volume)
    count = volume.shape[2]
    steps = np.minimum(np.abs(np.arange(1 - count, count)), smoothness.limit) ** smoothness.power
    whole = bool((steps == np.rint(steps)).all())
    unit = 1 if whole else FRACTION
    penalties = np.rint(steps * unit).astype(np.int64)
    total = np.empty(volume.shape, np.float32) if out is None else out
    _core.second_pass(
        volume,
        np.ascontiguousarray(guide, np.int32),
        *window,
        penalties,
        scale,
        smoothness.weight / unit,
        total,
        threads,
    )
    return total


def right_view(volume: npt.NDArray[Any], first: int, threads: int = 0) -> npt.NDArray[Any]:
    """The same costs as the right view has them: at ``(x - d, y)`` what the left one has at ``(x, y)``.

    Parameters
    ----------
    volume : ndarray of int64, uint16 or float32, (H, W, D)
    first : int
        Disparity of candidate 0.
    threads : int

    Returns
    -------
    ndarray of the same shape and dtype
    """
    out = np.empty_like(volume)
    _core.right_volume(np.ascontiguousarray(volume), first, out, threads)
    return out
