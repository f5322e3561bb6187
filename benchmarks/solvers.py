"""Compare solvers, and kinds of smoothness, on one energy; print tables that can be pasted into a page.

python benchmarks/solvers.py FOLDER --tune      weights and truncations, on odd pairs
python benchmarks/solvers.py FOLDER --solvers   energy, accuracy and time of each solver, on even pairs
python benchmarks/solvers.py FOLDER --norms     squared against absolute differences, on all pairs

Pairs are shrunk by --shrink, to the mean of square blocks; candidates, truth and errors are in pixels of what
is matched. The data cost of the energy is ZNCC on a small window. The second pass is the report's: ZNCC on
30 x 30 pixels of the full image, then ZSSD on the same window.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import stereopsis as st
from stereopsis import (
    ICM,
    TRWS,
    BeliefPropagation,
    Expansion,
    Smoothness,
    Swap,
    datasets,
    optimize,
)

# What --tune found best, by method and kind of smoothness; and the second pass at the report's weight.
TUNED: dict[str, dict[str, Smoothness]] = {
    "second pass, 0.5": {
        "L1": Smoothness("l1", 0.5),
        "truncated L1": Smoothness("l1", 0.5, 16),
        "L2": Smoothness("l2", 0.5),
        "truncated L2": Smoothness("l2", 0.5, 8),
    },
    "second pass": {
        "L1": Smoothness("l1", 512),
        "truncated L1": Smoothness("l1", 512, 16),
        "L2": Smoothness("l2", 512),
        "truncated L2": Smoothness("l2", 512, 8),
    },
    "ICM": {
        "L1": Smoothness("l1", 0.1),
        "truncated L1": Smoothness("l1", 0.4, 8),
        "L2": Smoothness("l2", 0.002),
        "truncated L2": Smoothness("l2", 0.1, 8),
    },
    "TRW-S": {
        "L1": Smoothness("l1", 0.2),
        "truncated L1": Smoothness("l1", 0.2, 16),
        "L2": Smoothness("l2", 0.1),
        "truncated L2": Smoothness("l2", 0.1, 8),
    },
}
KINDS = ("L1", "truncated L1", "L2", "truncated L2")
METHODS = ("second pass", "ICM", "TRW-S")
WEIGHTS = {
    "second pass": (0.5, 2.0, 8.0, 32.0, 128.0, 512.0),
    "ICM": (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.4),
}
WEIGHTS["TRW-S"] = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8)
TRUNCATIONS = {"L1": (2, 4, 8, 16), "L2": (1.5, 2, 3, 5, 8)}
RESAMPLES = 10_000
MEASURES = (("< 1 px", "within_1", 100), ("D1", "d1", 100), ("RMSE", "rmse", 1))


@dataclass(frozen=True)
class Problem:
    """A pair, ready to be smoothed."""

    name: str
    left: np.ndarray
    right: np.ndarray
    truth: np.ndarray
    disparities: tuple[int, int]
    volume: np.ndarray
    window: int
    first: np.ndarray
    data: np.ndarray

    def scores(self, index: np.ndarray) -> Any:
        disparity = np.where(index < 0, np.nan, index + self.disparities[0])
        return st.evaluate(disparity.astype(np.float32), self.truth).own


def shrunk(image: np.ndarray, factor: int) -> np.ndarray:
    rows, columns = (side // factor for side in image.shape[:2])
    blocks = image[: rows * factor, : columns * factor].reshape(rows, factor, columns, factor, -1)
    means = np.rint(blocks.mean(axis=(1, 3))).astype(image.dtype)
    return means if image.ndim == 3 else means[..., 0]


def problems(options: argparse.Namespace, pick: slice) -> Iterator[Problem]:
    factor = options.shrink
    disparities = (0, -(-options.disparities // factor))
    for sample in list(datasets.open(options.folder))[pick]:
        pair, truth = sample.pair(), sample.truth()
        left, right = shrunk(pair.left, factor), shrunk(pair.right, factor)
        known = truth[::factor, ::factor][: left.shape[0], : left.shape[1]] / np.float32(factor)
        wide = round(30 / factor)
        plain = {"disparities": disparities, "subpixel": None}
        costs = st.match(left, right, cost=st.ZNCC(options.window), keep=("costs",), **plain)
        first = st.match(left, right, cost=st.ZNCC(wide), **plain).disparity.astype(np.int32)
        data = st.match(left, right, cost=st.ZSSD(wide), keep=("costs",), **plain).stages["costs"]
        yield Problem(sample.name, left, right, known, disparities, costs.stages["costs"], wide, first, data)


def solved(problem: Problem, method: str, smoothness: Smoothness, iterations: int) -> np.ndarray:
    """Labels, by a method of TUNED."""
    if method.startswith("second pass"):
        window = (problem.window, problem.window)
        drawn = optimize.second_pass(problem.data, problem.first, smoothness, window, 1 / problem.window**2)
        return drawn.argmin(axis=2)
    solver = ICM(smoothness) if method == "ICM" else TRWS(smoothness, iterations)
    return optimize.solve(problem.volume, solver).index


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    start = time.process_time()
    result = work()
    return result, time.process_time() - start


def kind_of(smoothness: Smoothness) -> str:
    return ("" if smoothness.truncation is None else "truncated ") + smoothness.norm.upper()


def candidates(method: str) -> list[Smoothness]:
    plain = [Smoothness(norm, weight) for norm in ("l1", "l2") for weight in WEIGHTS[method]]
    return plain + [
        replace(one, truncation=limit) for one in plain for limit in TRUNCATIONS[one.norm.upper()]
    ]


def tune(options: argparse.Namespace) -> None:
    """The best of each kind of smoothness, by the mean fraction within 1 px."""
    chosen = list(problems(options, slice(0, 2 * options.tuning, 2)))
    print(f"{len(chosen)} pairs: {', '.join(problem.name for problem in chosen)}")
    for method in options.method or METHODS:
        scores: dict[Smoothness, tuple[float, float]] = {}
        for smoothness in candidates(method):
            found = [problem.scores(solved(problem, method, smoothness, 4)) for problem in chosen]
            scores[smoothness] = (
                float(np.mean([one.within_1 for one in found])),
                float(np.mean([one.rmse for one in found])),
            )
        for kind in KINDS:
            ranked = sorted((one for one in scores if kind_of(one) == kind), key=lambda one: -scores[one][0])
            for one in ranked[:3]:
                print(f"{method:12} {one!s:60} {scores[one][0]:.4f} {scores[one][1]:.2f}", flush=True)


def table(header: list[str], rows: list[list[str]]) -> None:
    lines = [header, ["---"] + ["---:"] * (len(header) - 1), *rows]
    print("\n".join("| " + " | ".join(line) + " |" for line in lines), end="\n\n", flush=True)


def solvers(options: argparse.Namespace) -> None:
    """Each solver on each kind of smoothness, with what was tuned for TRW-S."""
    chosen = list(problems(options, slice(1, 2 * options.checking, 2)))
    print(f"{len(chosen)} pairs: {', '.join(problem.name for problem in chosen)}\n")
    for kind in KINDS:
        model = TUNED["TRW-S"][kind]
        long = TRWS(model, options.bound)
        best = [timed(lambda one=one, long=long: optimize.solve(one.volume, long)) for one in chosen]
        contenders: list[tuple[str, Any]] = [
            ("winner-take-all", None),
            ("second pass", "second pass"),
            ("ICM, 10", ICM(model, 10)),
            ("belief propagation, 1 level, 20", BeliefPropagation(model, 20, 1)),
            ("belief propagation, 5 levels, 5", BeliefPropagation(model, 5, 5)),
            ("TRW-S, 5", TRWS(model, 5)),
            (f"TRW-S, {options.bound}", long),
        ]
        if model.is_metric:
            contenders.append(("expansion, 5", Expansion(model, 5)))
        if options.swap:
            contenders.append(("swap, 3", Swap(model, 3)))
        rows = []
        for name, solver in contenders:
            found = []
            for problem, (bounded, took) in zip(chosen, best, strict=True):
                seconds, bound = took, bounded.bound
                if solver is None:
                    index, seconds = timed(lambda problem=problem: problem.volume.argmin(axis=2))
                elif solver == "second pass":
                    smoothness = TUNED["second pass"][kind]
                    index, seconds = timed(
                        lambda problem=problem, one=smoothness: solved(problem, "second pass", one, 0)
                    )
                elif solver is long:
                    index = bounded.index
                else:
                    solution, seconds = timed(
                        lambda problem=problem, one=solver: optimize.solve(problem.volume, one)
                    )
                    index = solution.index
                # From a floor that no labels can fall below: each pixel's least cost.
                floor = float(problem.volume.min(axis=2).sum(dtype=np.float64))
                total = st.energy(index, problem.volume, model)
                scores = problem.scores(index)
                found.append(
                    [
                        100 * (total - floor) / (bound - floor),
                        *(scale * getattr(scores, field) for _, field, scale in MEASURES),
                        seconds,
                    ]
                )
            energy, *accuracy, seconds = np.mean(found, axis=0)
            within, d1, rmse = accuracy
            rows.append(
                [name, f"{energy:.1f}", f"{within:.1f} %", f"{d1:.1f} %", f"{rmse:.2f}", f"{seconds:.2f}"]
            )
        limit = "" if model.truncation is None else f", truncated at {model.truncation:g} px"
        print(f"{model.norm.upper()}, weight {model.weight:g}{limit}\n")
        table(["solver", "E, % of bound", "< 1 px", "D1", "RMSE", "CPU s"], rows)


def norms(options: argparse.Namespace) -> None:
    """Squared against absolute differences, each with what was tuned for it."""
    scores: dict[tuple[str, str], list[list[float]]] = {}
    count = 0
    for problem in problems(options, slice(None)):
        count += 1
        for method, index in (
            (f"winners, ZNCC {options.window}", problem.volume.argmin(axis=2)),
            ("first map", problem.first),
        ):
            found = problem.scores(index)
            scores.setdefault((method, ""), []).append(
                [scale * getattr(found, field) for _, field, scale in MEASURES]
            )
        for method in TUNED:
            for kind in KINDS:
                index = solved(problem, method, TUNED[method][kind], options.iterations)
                found = problem.scores(index)
                scores.setdefault((method, kind), []).append(
                    [scale * getattr(found, field) for _, field, scale in MEASURES]
                )
        print(f"{count} {problem.name}", file=sys.stderr, flush=True)
    rows = []
    for (method, kind), found in scores.items():
        mean, spread = np.mean(found, axis=0), np.std(found, axis=0, ddof=1)
        model = TUNED[method][kind] if kind else None
        rows.append(
            [
                method,
                kind,
                "" if model is None else f"{model.weight:g}",
                "" if model is None or model.truncation is None else f"{model.truncation:g}",
                *(f"{m:.2f} ± {s:.2f}" for m, s in zip(mean, spread, strict=True)),
            ]
        )
    print(f"{count} pairs: mean ± standard deviation over the pairs\n")
    names = [name for name, _, _ in MEASURES]
    table(["method", "smoothness", "weight", "truncation", *names], rows)

    resampled = np.random.default_rng(0).integers(0, count, (RESAMPLES, count))
    rows = []
    for method in TUNED:
        for one, other in (("L2", "L1"), ("truncated L2", "truncated L1")):
            gain = np.array(scores[method, one]) - np.array(scores[method, other])
            low, high = np.percentile(gain[resampled].mean(axis=1), [2.5, 97.5], axis=0)
            middle = gain.mean(axis=0)
            rows.append(
                [
                    method,
                    f"{one} - {other}",
                    *(f"{m:+.2f} [{a:+.2f}, {b:+.2f}]" for m, a, b in zip(middle, low, high, strict=True)),
                ]
            )
    print("difference of the means, with its 95 % bootstrap interval over the pairs\n")
    table(["method", "difference", *names], rows)


def main() -> None:
    summary, _, rest = (__doc__ or "").partition("\n")
    parser = argparse.ArgumentParser(
        description=summary, epilog=rest, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", metavar="FOLDER", type=Path)
    part = parser.add_mutually_exclusive_group(required=True)
    for chosen in (tune, solvers, norms):
        part.add_argument(f"--{chosen.__name__}", dest="part", action="store_const", const=chosen)
    parser.add_argument("--shrink", type=int, default=2, metavar="N")
    parser.add_argument(
        "--window", type=int, default=5, metavar="N", help="of the data cost, in matched pixels"
    )
    parser.add_argument("--disparities", type=int, default=128, metavar="MAX", help="of the full image")
    parser.add_argument("--tuning", type=int, default=3, metavar="N", help="pairs of --tune")
    parser.add_argument("--checking", type=int, default=2, metavar="N", help="pairs of --solvers")
    parser.add_argument("--iterations", type=int, default=5, metavar="N", help="of TRW-S in --norms")
    parser.add_argument(
        "--bound", type=int, default=50, metavar="N", help="iterations of TRW-S for the bound"
    )
    parser.add_argument(
        "--swap", action="store_true", help="--solvers: the swap cuts too, which take minutes"
    )
    parser.add_argument("--method", action="append", choices=METHODS, help="--tune: these alone")
    options = parser.parse_args()
    options.part(options)


if __name__ == "__main__":
    main()
