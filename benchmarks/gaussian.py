"""Gaussian windows: how long they take beside a box, and how far they are from their definition.

python benchmarks/gaussian.py [LEFT RIGHT] [--repeats N] [--sigmas S,S] [--no-times] [--no-errors]

Without images the synthetic street of 881 x 400 is matched; 8-bit grey, 128 candidates. Times are taken in
turns with those of box ZNCC 31 in one process; --clock cpu counts the processor's time instead of the
wall's, for a machine that others use (one thread only). Errors are against the definition's truncated
weights: those of the kernels along one axis; and, at each pixel, what the definition's cost of the candidate
that the streaming path chooses is above the definition's least cost.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import time
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

import stereopsis as st
from stereopsis import _fused, _gaussian, cost, io
from stereopsis.types import Disparities

Task = Callable[[], object]
_F64 = npt.NDArray[np.float64]

CANDIDATES = Disparities(0, 128)
TRUNCATE = 4.0
KINDS = ("sad", "ssd", "zssd", "ncc", "zncc")
FLAT = 1e-6
"""A window of no more variance than this, in squared grey levels, correlates with nothing."""


# ---- times ---------------------------------------------------------------------------------------


def paired(task: Task, beside: Task, repeats: int, clock: Callable[[], float]) -> str:
    """The quotient's median and quartiles, and both medians."""

    def seconds(run: Task) -> float:
        start = clock()
        run()
        return clock() - start

    task(), beside()
    times = [(seconds(task), seconds(beside)) for _ in range(repeats)]
    low, middle, high = statistics.quantiles([a / b for a, b in times], n=4)
    first, second = (1e3 * statistics.median(side) for side in zip(*times, strict=True))
    return f"{middle:.2f} | {low:.2f} to {high:.2f} | {first:.1f} ÷ {second:.1f} ms"


def times(
    pair: cost.Pixels, sigmas: list[float], repeats: int, clock: Callable[[], float], threads: list[int]
) -> None:
    print("\n| what | threads | median ratio to box ZNCC 31 | quartiles | medians |")
    print("| --- | ---: | ---: | ---: | ---: |")
    lines = [("zncc", sigma, None, None) for sigma in sigmas]
    lines += [(kind, 15.0, None, None) for kind in KINDS[:-1]] + [("zncc", 15.0, 1.0, 10.0)]
    for count in threads:
        for kind, sigma, left_right, uniqueness in lines:

            def box(count: int = count) -> object:
                return _fused.match("zncc", pair, CANDIDATES, (31, 31), "parabola", None, None, count)

            def gaussian(
                kind: str = kind,
                sigma: float = sigma,
                checks: tuple[float | None, float | None] = (left_right, uniqueness),
                count: int = count,
            ) -> object:
                return _fused.match_gaussian(
                    kind, pair, CANDIDATES, sigma, TRUNCATE, "parabola", *checks, count
                )

            what = f"{kind} sigma {sigma:g}" + (", left-right check and uniqueness" if left_right else "")
            print(f"| {what} | {count} | {paired(gaussian, box, repeats, clock)} |", flush=True)


# ---- errors --------------------------------------------------------------------------------------


def kernel_errors(sigmas: list[float]) -> None:
    print("\n| sigma | stride | taps | largest ÷ peak | mean ÷ peak | sum of absolute differences |")
    print("| ---: | ---: | ---: | ---: | ---: | ---: |")
    for sigma in sigmas:
        chosen, side = _gaussian.filter_of(sigma, TRUNCATE), _gaussian.gaussian(sigma, TRUNCATE)
        off = abs(_gaussian.errors(chosen, side))
        print(
            f"| {sigma:g} | {chosen.stride} | {2 * len(chosen.taps) - 1} | {off.max() / side[0]:.1e} | "
            f"{off.mean() / side[0]:.1e} | {off.sum(axis=1).max():.1e} |"
        )


def band(count: int, side: _F64) -> _F64:
    """The matrix that filters ``count + 2 reach`` values."""
    weights = np.concatenate([side[:0:-1], side])
    matrix = np.zeros((count, count + len(weights) - 1))
    for i in range(count):
        matrix[i, i : i + len(weights)] = weights
    return matrix


def definition(
    kind: str, pair: cost.Pixels, candidates: Disparities, sigma: float
) -> npt.NDArray[np.float32]:
    """Costs (H, W, D) of a grey pair from the truncated weights; infinite out of view."""
    side = _gaussian.gaussian(sigma, TRUNCATE)
    height, width = pair.left.shape[:2]
    reach = len(side) - 1
    down, across = band(height, side), band(width, side).T.copy()
    rows = np.arange(-reach, height + reach).clip(0, height - 1)
    columns = np.arange(-reach, width + reach)

    def mean(image: _F64) -> _F64:
        return down @ image @ across

    left = pair.left[..., 0].astype(np.float64)[rows][:, columns.clip(0, width - 1)]
    left_mean, left_square = mean(left), mean(left * left)
    costs = np.full((height, width, candidates.span), np.inf, np.float32)
    for i in range(candidates.span):
        d = candidates.min + i
        right = pair.right[..., 0].astype(np.float64)[rows][:, (columns - d).clip(0, width - 1)]
        if kind == "sad":
            found = mean(abs(left - right))
        elif kind in ("ssd", "zssd"):
            found = mean((left - right) ** 2) - (mean(left - right) ** 2 if kind == "zssd" else 0)
        else:
            centre = 1.0 if kind == "zncc" else 0.0
            right_mean = mean(right)
            norms = (left_square - centre * left_mean**2) * (mean(right * right) - centre * right_mean**2)
            product = mean(left * right) - centre * left_mean * right_mean
            found = np.where(norms > FLAT**2, -product / np.sqrt(np.maximum(norms, FLAT**2)), 0)
        seen = slice(max(d, 0), min(width + d, width))
        costs[:, seen, i] = found[:, seen]
    return costs


def cost_errors(pair: cost.Pixels, sigmas: list[float], candidates: Disparities) -> None:
    print("\n| cost | sigma | same winner | within 1 | mean excess | 99.99 % | largest | sub-pixel |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |")
    for kind, sigma in [("zncc", sigma) for sigma in sigmas] + [(kind, 15.0) for kind in KINDS[:-1]]:
        volume = definition(kind, pair, candidates, sigma)
        winner = volume.argmin(axis=2)
        disparity, fine = (
            _fused.match_gaussian(kind, pair, candidates, sigma, TRUNCATE, fit, None, None, 0)[0]
            for fit in (None, "parabola")
        )
        valid = np.isfinite(disparity)
        index = np.where(valid, disparity - candidates.min, 0).astype(int)

        def at(i: npt.NDArray[np.int_], volume: npt.NDArray[np.float32] = volume) -> _F64:
            return np.take_along_axis(volume, i[..., None], axis=2)[..., 0].astype(np.float64)

        excess = (at(index) - volume.min(axis=2))[valid]
        apart = abs(index - winner)[valid]
        inner = valid & (index > 0) & (index < candidates.span - 1)
        before, here, after = (at(np.where(inner, index, 1) + k) for k in (-1, 0, 1))
        inner &= np.isfinite(before) & np.isfinite(after) & (before + after > 2 * here)
        before, here, after = before[inner], here[inner], after[inner]
        offset = (before - after) / 2 / (before + after - 2 * here)
        off = abs(fine[inner] - candidates.min - index[inner] - offset)
        print(
            f"| {kind} | {sigma:g} | {(apart == 0).mean():.3%} | {(apart <= 1).mean():.3%} | "
            f"{excess.mean():.1e} | "
            f"{np.quantile(excess, 0.9999):.1e} | {excess.max():.1e} | {off.mean():.4f} px |",
            flush=True,
        )


# ---- all of it -----------------------------------------------------------------------------------


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("pair", nargs="*", help="LEFT RIGHT; the synthetic street without")
    parser.add_argument("--repeats", type=int, default=21)
    parser.add_argument("--sigmas", default="2,5,15,40")
    parser.add_argument("--threads", default="1,2")
    parser.add_argument("--clock", choices=("wall", "cpu"), default="wall")
    parser.add_argument("--no-times", action="store_true")
    parser.add_argument("--no-errors", action="store_true")
    arguments = parser.parse_args()
    if len(arguments.pair) not in (0, 2):
        parser.error("give LEFT and RIGHT, or neither")
    sigmas = [float(sigma) for sigma in arguments.sigmas.split(",")]
    if arguments.pair:
        pair = io.read_pair(*arguments.pair)
        left, right = pair.left, pair.right
    else:
        scene = st.scenes.street(881, 400, gray=True, noise=2)
        left, right = scene.left, scene.right
    pixels = cost.pixels(left, right, "grey", 1)
    rows, columns = left.shape[:2]
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores; {_fused.instruction_set()}")
    print(f"stereopsis {st.__version__}, NumPy {np.__version__}, Python {platform.python_version()}")
    print(f"{columns} x {rows}, {CANDIDATES.span} candidates, 8-bit grey, {arguments.repeats} pairs of runs")
    if not arguments.no_times:
        clock = time.process_time if arguments.clock == "cpu" else time.perf_counter
        threads = [1] if arguments.clock == "cpu" else [int(count) for count in arguments.threads.split(",")]
        times(pixels, sigmas, arguments.repeats, clock, threads)
    kernel_errors(sigmas)
    if not arguments.no_errors:
        cost_errors(pixels, sigmas, CANDIDATES)


if __name__ == "__main__":
    main()
