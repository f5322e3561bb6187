"""Graph cuts: of two labels for each pixel the choice of least energy, by a maximum flow.

Capacities are integers: see `quantised`. The maximum flow is OR-Tools', which the extra "graphcut" brings.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stereopsis._extras import MissingExtraError

Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

LARGEST = 2**36
"""The largest cost or penalty becomes at most this."""


class Problem(NamedTuple):
    """An energy in whole numbers.

    Attributes
    ----------
    costs : ndarray of float32, (H W, D)
        Infinite where a label is not possible.
    scale : float
        A power of two; ``rint(scale * costs)`` is what counts.
    penalties : ndarray of int64, (D,)
        Of label differences 0, ..., D - 1.
    width : int
        Columns of the image.
    """

    costs: npt.NDArray[np.float32]
    scale: float
    penalties: Ints
    width: int

    def data(self, pixels: Ints, labels: npt.NDArray[Any]) -> Ints:
        """Costs of these pixels' labels."""
        costs = self.costs[pixels, labels].astype(np.float64)
        return np.rint(np.where(np.isfinite(costs), costs, 0) * self.scale).astype(np.int64)

    def between(self, one: npt.NDArray[Any], other: npt.NDArray[Any]) -> Ints:
        """Penalties of pairs of labels."""
        penalties: Ints = self.penalties[np.abs(one - other)]
        return penalties


def library() -> ModuleType:
    """The maximum flow; raises `MissingExtraError` without the extra."""
    try:
        from ortools.graph.python import max_flow
    except ImportError as error:
        raise MissingExtraError(
            "graph cuts need OR-Tools, which the extra 'graphcut' brings: pip install 'stereopsis[graphcut]'"
        ) from error
    flow: ModuleType = max_flow
    return flow


def quantised(costs: npt.NDArray[np.float32], weight: float, power: int, truncation: float | None) -> Problem:
    """The energy in whole numbers: the largest power of two as scale that keeps all up to `LARGEST`.

    The penalties are whole multiples of one whole weight, so that what is a metric stays one.
    """
    height, width, count = costs.shape
    steps = np.arange(count, dtype=np.int64) ** power
    highest = float(steps[-1]) if truncation is None else min(float(steps[-1]), truncation**power)
    largest = max(float(np.max(costs, where=np.isfinite(costs), initial=0)), weight * highest)
    scale = 2.0 ** np.floor(np.log2(LARGEST / largest)) if largest > 0 else 1.0
    unit = round(weight * scale)
    penalties = steps * unit
    if truncation is not None:
        penalties = np.minimum(penalties, round(unit * truncation**power))
    return Problem(costs.reshape(height * width, count), float(scale), penalties, width)


def _neighbours(pixels: Ints, height: int, width: int) -> list[tuple[Ints, Bools]]:
    """Left, right, upper and lower neighbours, and where they exist; of the others, the pixel itself."""
    column, row = pixels % width, pixels // width
    steps = ((-1, column > 0), (1, column + 1 < width), (-width, row > 0), (width, row + 1 < height))
    return [(np.where(inside, pixels + step, pixels), inside) for step, inside in steps]


def fuse(problem: Problem, labels: Ints, pixels: Ints, zero: Ints, one: Ints) -> Ints:
    """Of two labels for each of some pixels, the best choice for all of them at once.

    Parameters
    ----------
    problem : Problem
    labels : ndarray of int64, (H W,)
        What all others have; -1 takes no part.
    pixels : ndarray of int64, (N,)
    zero, one : ndarray of int64, (N,)
        The two labels, possible both, of each. Between all neighbours, as a flow needs it,
        ``V(zero, zero') + V(one, one') <= V(zero, one') + V(one, zero')``.

    Returns
    -------
    ndarray of int64, (H W,)
        New labels. Of equal choices the one with the fewest `one`.
    """
    labels = labels.copy()
    height = labels.size // problem.width
    place = np.full(labels.size, -1)
    rise = problem.data(pixels, one) - problem.data(pixels, zero)
    open_, first, second = pixels, zero, one
    fresh = True
    while fresh and open_.size:
        # A pixel whose choice is clear, whatever its neighbours choose, needs no flow; they may follow.
        place[open_] = np.arange(open_.size)
        extra = np.zeros(open_.size, np.int64)
        least, most = np.zeros_like(extra), np.zeros_like(extra)
        for beside, inside in _neighbours(open_, height, problem.width):
            at = place[beside]
            undecided = inside & (at >= 0)
            decided = inside & (at < 0) & (labels[beside] >= 0)
            fixed = np.maximum(labels[beside], 0)
            extra += np.where(decided, problem.between(second, fixed) - problem.between(first, fixed), 0)
            choices = [
                problem.between(second, their[at]) - problem.between(first, their[at])
                for their in (first, second)
            ]
            least += np.where(undecided, np.minimum(*choices), 0)
            most += np.where(undecided, np.maximum(*choices), 0)
        keeps, moves = rise + extra + least >= 0, rise + extra + most < 0
        left = ~(keeps | moves)
        # The last few are left to the flow: looking for them takes longer.
        fresh = bool(20 * np.count_nonzero(left) < 19 * open_.size)
        place[open_] = -1
        if fresh:
            labels[open_[keeps]] = first[keeps]
            labels[open_[moves]] = second[moves]
            open_, first, second, rise = open_[left], first[left], second[left], rise[left]
        else:
            rise = rise + extra
    if not open_.size:
        return labels
    place[open_] = np.arange(open_.size)
    chosen = _cut(problem, open_, first, second, rise, place, height)
    labels[open_] = np.where(chosen, second, first)
    return labels


def _cut(
    problem: Problem, pixels: Ints, zero: Ints, one: Ints, rise: Ints, place: Ints, height: int
) -> Bools:
    """Which pixels take `one`; `rise` holds all of it but what lies between these pixels."""
    tails, heads, capacities = [], [], []
    for beside, inside in _neighbours(pixels, height, problem.width)[1::2]:
        p = np.flatnonzero(inside & (place[beside] >= 0))
        q = place[beside[p]]
        same, ahead = problem.between(zero[p], zero[q]), problem.between(zero[p], one[q])
        behind, both = problem.between(one[p], zero[q]), problem.between(one[p], one[q])
        np.add.at(rise, p, behind - same)
        np.add.at(rise, q, both - behind)
        tails.append(p)
        heads.append(q)
        capacities.append(ahead + behind - same - both)
    source, sink = pixels.size, pixels.size + 1
    up, down = np.flatnonzero(rise > 0), np.flatnonzero(rise < 0)
    flow = library().SimpleMaxFlow()
    flow.add_arcs_with_capacity(
        np.concatenate([*tails, np.full(up.size, source), down]),
        np.concatenate([*heads, up, np.full(down.size, sink)]),
        np.concatenate([*capacities, rise[up], -rise[down]]),
    )
    chosen = np.zeros(pixels.size + 2, bool)
    if down.size:
        if up.size:
            status = flow.solve(source, sink)
            if status != flow.OPTIMAL:
                raise ArithmeticError(f"the maximum flow ended with {status}")
            chosen[flow.get_sink_side_min_cut()] = True
        else:
            chosen[:] = True
    return chosen[:-2]


def _energy(problem: Problem, labels: Ints) -> int:
    here = np.flatnonzero(labels >= 0)
    total = int(problem.data(here, labels[here]).sum())
    grid = labels.reshape(-1, problem.width)
    for one, other in ((grid[:, :-1], grid[:, 1:]), (grid[:-1], grid[1:])):
        both = (one >= 0) & (other >= 0)
        total += int(problem.between(one[both], other[both]).sum())
    return total


def expand(problem: Problem, labels: npt.NDArray[np.int32], sweeps: int) -> npt.NDArray[np.int32]:
    """Sweeps of expansion moves, until a whole one gains nothing."""
    now = labels.astype(np.int64).ravel()
    energy = _energy(problem, now)
    for _ in range(sweeps):
        before = energy
        for label in range(problem.penalties.size):
            pixels = np.flatnonzero((now >= 0) & (now != label) & np.isfinite(problem.costs[:, label]))
            tried = fuse(problem, now, pixels, now[pixels], np.full(pixels.size, label))
            gained = _energy(problem, tried)
            if gained < energy:
                now, energy = tried, gained
        if energy == before:
            break
    return now.astype(np.int32).reshape(labels.shape)


def swap(problem: Problem, labels: npt.NDArray[np.int32], sweeps: int) -> npt.NDArray[np.int32]:
    """Sweeps of swap moves over all pairs of labels, until a whole one gains nothing."""
    now = labels.astype(np.int64).ravel()
    energy = _energy(problem, now)
    possible = np.isfinite(problem.costs)
    for _ in range(sweeps):
        before = energy
        for one in range(problem.penalties.size):
            for zero in range(one):
                pixels = np.flatnonzero((now == zero) | (now == one))
                pixels = pixels[possible[pixels, zero] & possible[pixels, one]]
                if not pixels.size:
                    continue
                tried = fuse(problem, now, pixels, np.full(pixels.size, zero), np.full(pixels.size, one))
                gained = _energy(problem, tried)
                if gained < energy:
                    now, energy = tried, gained
        if energy == before:
            break
    return now.astype(np.int32).reshape(labels.shape)
