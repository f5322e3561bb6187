"""The window sweep of the report's Figures 3 to 5 and 7: the library against plain NumPy and SciPy.

    python benchmarks/sweep.py                        # the synthetic street, 881 x 400
    python benchmarks/sweep.py FOLDER                 # the first pair of a benchmark
    python benchmarks/sweep.py --methods ssd,zssd,zncc

SSD, ZSSD, ZNCC, smoothed ZNCC and Gaussian ZNCC at nine windows, 5 to 85, on one pair, in one thread.

The report's protocol runs as `stereopsis.study.published` has it, over the truth's range, at a few windows.
Its box filters take the same time at any window, so the mean of two windows stands for each of the nine. Its
Gaussian's time grows with sigma, and is interpolated linearly between three. The library runs all nine
windows in the corrected protocol, over 0:128, with Gaussians of the same sigmas. Needs the extra ``study``.
"""

from __future__ import annotations

import os

# Before NumPy: one thread for either side.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import argparse
import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy

import stereopsis as st
from stereopsis import datasets
from stereopsis.study.published import PUBLISHED, WINDOWS, disparity

METHODS = ("ssd", "zssd", "zncc", "zncc_smoothed", "zncc_gaussian")
SAMPLED = {"zncc_gaussian": (5, 45, 85)}
BOX_SAMPLED = (5, 85)
DISPARITIES = (0, 128)
WANTED = 40


def ours(pair: st.Pair, method: str, window: int) -> st.Result:
    """Ask the library for what the sweep does at one window: the one place that says how."""
    asked = {"disparities": DISPARITIES, "threads": 1}
    match method:
        case "ssd":
            return st.match(pair, cost=st.SSD(window=window), subpixel=None, **asked)
        case "zssd":
            return st.match(pair, cost=st.ZSSD(window=window), subpixel=None, **asked)
        case "zncc":
            return st.match(pair, cost=st.ZNCC(window=window), subpixel=None, **asked)
        case "zncc_smoothed":
            return st.match(pair, preset="paper-smoothed", cost=st.ZNCC(window=window), **asked)
        case _:
            support = st.Gaussian(sigma=window)
            return st.match(pair, cost=st.ZNCC(window=support), subpixel=None, **asked)


def seconds(task: Callable[[], object], repeats: int) -> float:
    """The least of a few wall times."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        task()
        times.append(time.perf_counter() - start)
    return min(times)


def published_sweep(pair: st.Pair, truth: np.ndarray, method: str, repeats: int) -> tuple[float, list[str]]:
    """Seconds for the nine windows, and the times that they were made from."""
    windows = SAMPLED.get(method, BOX_SAMPLED)
    times = [
        seconds(lambda w=w: disparity(pair.left, pair.right, method, w, PUBLISHED, truth=truth), repeats)
        for w in windows
    ]
    measured = [f"{w}: {t:.2f}" for w, t in zip(windows, times, strict=True)]
    if method in SAMPLED:
        return float(np.interp(WINDOWS, windows, times).sum()), measured
    return len(WINDOWS) * statistics.fmean(times), measured


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--repeats", type=int, default=3, help="the least of so many times counts")
    arguments = parser.parse_args()
    methods = arguments.methods.split(",")
    if unknown := set(methods) - {*METHODS}:
        parser.error(f"--methods must be of {', '.join(METHODS)}, not {', '.join(sorted(unknown))}")
    pair, truth, what = load(arguments.folder)

    rows, columns = pair.left.shape[:2]
    print(
        f"{machine()}; NumPy {np.__version__}, SciPy {scipy.__version__}, Python {platform.python_version()}"
    )
    print(f"{what}, {columns} x {rows}, windows {', '.join(map(str, WINDOWS))}, one thread\n")
    print("| method | NumPy and SciPy, s | measured at, s | library, s | ratio |")
    print("| --- | ---: | --- | ---: | ---: |")
    totals = [0.0, 0.0]
    for method in methods:
        theirs, measured = published_sweep(pair, truth, method, arguments.repeats)
        ours(pair, method, WINDOWS[0])
        mine = sum(seconds(lambda m=method, w=w: ours(pair, m, w), arguments.repeats) for w in WINDOWS)
        totals = [totals[0] + theirs, totals[1] + mine]
        print(
            f"| {method} | {theirs:.1f} | {'; '.join(measured)} | {mine:.3f} | {theirs / mine:.0f} |",
            flush=True,
        )
    print(f"| all | {totals[0]:.1f} | | {totals[1]:.3f} | {totals[0] / totals[1]:.0f} (wanted: {WANTED}) |")


def machine() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:  # not there on every system
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def load(folder: Path | None) -> tuple[st.Pair, np.ndarray, str]:
    if folder is None:
        scene = st.scenes.street(881, 400, noise=2)
        return st.Pair(scene.left, scene.right), scene.disparity, "the synthetic street"
    sample = datasets.open(folder)[0]
    truth = sample.truth()
    if truth is None:
        raise SystemExit(f"error: {sample.name} has no truth, which sets the published range")
    return sample.pair(), truth, sample.name


if __name__ == "__main__":
    main()
