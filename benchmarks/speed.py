"""Time and memory beside OpenCV's block matcher, in one run, in pairs.

    python benchmarks/speed.py                        # the synthetic street, 881 x 400
    python benchmarks/speed.py LEFT RIGHT             # a pair of your own
    python benchmarks/speed.py --repeats 41

``stereopsis bench speed`` times presets; this looks at the core beneath them, its memory and its floors. Each
line times two things in turn, A B A B ..., and prints the median of the ratios A / B with their quartiles.
OpenCV is held to one thread. A machine shared with others disturbs single times more than ratios of
neighbours.
"""

from __future__ import annotations

import os

# Before NumPy: the matrix product below measures one core.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import argparse
import statistics
import subprocess
import sys
import time

import cv2
import numpy as np
import numpy.typing as npt

import stereopsis as st
from stereopsis import _fused, _instructions, pixelwise
from stereopsis.bench.speed import Task, in_turns, machine, ratios

DISPARITIES = (0, 128)
LARGE = (3072, 4096, 512)
"""Rows, columns and disparities of the memory measurement."""

CENSUS = st.Census((9, 7))
SEMI_GLOBAL = {
    "SGM 8": (CENSUS, st.SGM()),
    "SGM 8, census over 3 x 3": (st.Census((9, 7), aggregation=3), st.SGM(p1=63, p2=774, unit=8)),
}
"""Census, eight paths, parabola and left-right check."""

SEMI_GLOBAL_LARGE = (1536, 2048, 256)
"""Rows, columns and disparities of its memory measurement."""

OPERATIONS = {"ZNCC 31": 8, "SSD 21": 8, "SAD 21": 10}
"""Vector operations a candidate in the innermost loop of fused_narrow.hpp, with four-byte multiply-adds."""


def paired(first: Task, second: Task, repeats: int) -> str:
    """Median and quartiles of the ratio, and the medians of both times."""
    times = in_turns([first, second], repeats)
    ratio, (a, b) = ratios(*times), (1e3 * statistics.median(side) for side in times)
    return f"{ratio.median:.2f} | {ratio.low:.2f} to {ratio.high:.2f} | {a:.1f} ÷ {b:.1f} ms"


def _seconds(task: Task) -> float:
    start = time.perf_counter()
    task()
    return time.perf_counter() - start


def with_instructions(name: str, task: Task) -> Task:
    def forced() -> None:
        os.environ[_instructions.ENVIRONMENT] = name
        try:
            task()
        finally:
            del os.environ[_instructions.ENVIRONMENT]

    return forced


def peak_memory() -> float:
    """MiB that a match at `LARGE` takes beyond its inputs and outputs, in a process of its own."""
    rows, columns, count = LARGE
    script = f"""
import re, numpy as np, stereopsis as st
from pathlib import Path
def peak():  # of this program: the system's own count goes on from the one that started it
    return int(re.search(r'VmHWM:\\s+(\\d+)', Path('/proc/self/status').read_text())[1])
rng = np.random.default_rng(0)
left = rng.integers(0, 256, ({rows}, {columns}), dtype=np.uint8)
right = np.roll(left, -7, axis=1)
st.match(left[:40, :600], right[:40, :600], disparities=(0, 8), cost=st.ZNCC(window=31), threads=1)
before = peak()
result = st.match(left, right, disparities=(0, {count}), cost=st.ZNCC(window=31), threads=1)
after = peak()
outputs = result.disparity.nbytes + result.confidence.nbytes + result.flags.nbytes
print((after - before) / 1024 - outputs / 2**20)
"""
    return float(
        subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True).stdout
    )


def semi_globally(
    left: npt.NDArray[np.uint8],
    right: npt.NDArray[np.uint8],
    cost: st.Census,
    optimize: st.SGM,
    threads: int = 1,
    left_right: float | None = 1.0,
) -> Task:
    return lambda: st.match(
        left,
        right,
        disparities=DISPARITIES,
        cost=cost,
        optimize=optimize,
        left_right=left_right,
        threads=threads,
    )


def semi_global_stages(
    left: npt.NDArray[np.uint8], right: npt.NDArray[np.uint8], repeats: int
) -> dict[str, float]:
    """Seconds of what can be told apart from outside, and of the memory traffic that a volume would take."""

    def best(task: Task) -> float:
        return min(_seconds(task) for _ in range(repeats))

    whole = best(semi_globally(left, right, CENSUS, st.SGM()))
    volume = np.ones((*left.shape, DISPARITIES[1]), np.uint16)
    other = np.empty_like(volume)
    return {
        "both census": 2 * best(lambda: pixelwise.census(left, CENSUS.comparisons, 1)),
        "left-right check": whole - best(semi_globally(left, right, CENSUS, st.SGM(), left_right=None)),
        "two paths alone": best(semi_globally(left, right, CENSUS, st.SGM(2), left_right=None)),
        "five paths alone": best(semi_globally(left, right, CENSUS, st.SGM(5), left_right=None)),
        "whole": whole,
        "floor: one 16-bit volume of sums written and read": best(lambda: np.copyto(other, volume)),
    }


def semi_global_memory() -> float:
    """Peak memory beyond inputs and outputs of SGM over 8 paths, of one 16-bit volume of sums."""
    rows, columns, count = SEMI_GLOBAL_LARGE
    script = f"""
import resource, numpy as np, stereopsis as st
rng = np.random.default_rng(0)
left = rng.integers(0, 256, ({rows}, {columns}), dtype=np.uint8)
right = np.roll(left, -7, axis=1)
chosen = dict(cost=st.Census((9, 7)), optimize=st.SGM(), left_right=1.0, threads=1)
st.match(left[:20, :40], right[:20, :40], disparities=(0, 8), **chosen)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
result = st.match(left, right, disparities=(0, {count}), **chosen)
after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
outputs = result.disparity.nbytes + result.confidence.nbytes + result.flags.nbytes
print(((after - before) * 1024 - outputs) / ({rows} * {columns} * {count} * 2))
"""
    return float(
        subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True).stdout
    )


def import_time(repeats: int) -> float:
    """Seconds that a fresh process takes for ``import stereopsis`` over ``import numpy``."""

    def fresh(module: str) -> float:
        return _seconds(lambda: subprocess.run([sys.executable, "-c", f"import {module}"], check=True))

    fresh("stereopsis")
    return statistics.median(fresh("stereopsis") - fresh("numpy") for _ in range(repeats))


def operation_rate() -> float:
    """Lane operations a second of one core: the multiply-adds of a matrix product."""
    side = 512
    matrix = np.ones((side, side), np.float32)
    return side**3 / min(_seconds(lambda: matrix @ matrix) for _ in range(20))


def copy_rate(elements: int) -> float:
    """Four-byte elements a second, read and written, in a working set of the window sums' size."""
    source, target = np.ones(elements, np.int32), np.ones(elements, np.int32)
    return elements / min(_seconds(lambda: np.copyto(target, source)) for _ in range(200))


def load(paths: list[str]) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8], str]:
    if paths:
        left, right = (cv2.imread(path, cv2.IMREAD_GRAYSCALE) for path in paths)
        if left is None or right is None:
            raise SystemExit(f"cannot read {' or '.join(paths)}")
        return left, right, "a real pair"
    scene = st.scenes.street(881, 400, gray=True, noise=2)
    return scene.left, scene.right, "the synthetic street"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("pair", nargs="*", help="LEFT RIGHT; the synthetic street without")
    parser.add_argument("--repeats", type=int, default=21)
    arguments = parser.parse_args()
    if len(arguments.pair) not in (0, 2):
        parser.error("give LEFT and RIGHT, or neither")
    left, right, what = load(arguments.pair)
    repeats = arguments.repeats

    cv2.setNumThreads(1)
    block_matcher = cv2.StereoBM_create(numDisparities=128, blockSize=21)
    semi_global, full = (
        cv2.StereoSGBM_create(0, 128, 5, P1=200, P2=800, mode=mode)
        for mode in (cv2.STEREO_SGBM_MODE_SGBM_3WAY, cv2.STEREO_SGBM_MODE_HH)
    )

    def opencv() -> object:
        return block_matcher.compute(left, right)

    def ours(cost: st.settings.Cost, threads: int = 1, **checks: float) -> Task:
        return lambda: st.match(left, right, disparities=DISPARITIES, cost=cost, threads=threads, **checks)

    zncc = ours(st.ZNCC(window=31))
    costs = {"ZNCC 31": zncc, "SSD 21": ours(st.SSD(window=21)), "SAD 21": ours(st.SAD(window=21))}
    lines: list[tuple[str, str, Task, Task]] = [
        (f"{name}, winner + parabola, 1 thread ÷ StereoBM", "0.50", task, opencv)
        for name, task in costs.items()
    ]
    lines += [
        ("ZNCC 61 ÷ ZNCC 7", "1.10", ours(st.ZNCC(window=61)), ours(st.ZNCC(window=7))),
        ("ZNCC 31 with left-right check and uniqueness ÷ without", "1.35",
         ours(st.ZNCC(window=31), left_right=1.0, uniqueness=10.0), zncc),
        ("ZNCC 31, 2 threads ÷ 1 thread", "0.56", ours(st.ZNCC(window=31), threads=2), zncc),
    ]  # fmt: skip
    paths = {name: semi_globally(left, right, *chosen) for name, chosen in SEMI_GLOBAL.items()}
    for name, task in paths.items():
        lines += [
            (f"{name}, 1 thread ÷ StereoSGBM HH block 5", "0.25", task, lambda: full.compute(left, right)),
            (f"{name}, 1 thread ÷ StereoSGBM 3WAY block 5", "0.80", task,
             lambda: semi_global.compute(left, right)),
            (f"{name}, 2 threads ÷ 1 thread", "0.60",
             semi_globally(left, right, *SEMI_GLOBAL[name], threads=2), task),
        ]  # fmt: skip
    sets = _fused.instruction_sets()
    if "avx2" in sets and sets[0] != "avx2":
        lines.append((f"ZNCC 31, avx2 ÷ {sets[0]}", "2.0", with_instructions("avx2", zncc), zncc))
    lines.append(("StereoSGBM 3WAY block 5 ÷ ZNCC 31", "", lambda: semi_global.compute(left, right), zncc))

    for line in machine():
        print(line)
    rows, columns = left.shape
    print(f"{what}, {columns} x {rows}, {DISPARITIES[1]} disparities, 8-bit grey, {repeats} pairs of runs\n")
    print(
        "| what | wanted at most | median ratio | quartiles | medians |\n| --- | ---: | ---: | ---: | ---: |"
    )
    for name, bound, first, second in lines:
        print(f"| {name} | {bound} | {paired(first, second, repeats)} |", flush=True)
    print(f"| import stereopsis over import numpy, s | 0.2 | {import_time(5):.3f} | | |")
    if sys.platform == "linux":
        height, width, count = LARGE
        name = (
            f"peak memory beyond inputs and outputs, {width} x {height}, {count} disparities, 1 thread, MiB"
        )
        print(f"| {name} | 64 | {peak_memory():.1f} | | |")

        height, width, count = SEMI_GLOBAL_LARGE
        name = f"the same of SGM 8, {width} x {height}, {count} disparities, ÷ one 16-bit volume of sums"
        print(f"| {name} | 1.2 | {semi_global_memory():.2f} | | |")

    print(f"\nStages of SGM 8, 1 thread, best of {repeats}:\n\n| stage | ms |\n| --- | ---: |")
    for name, seconds in semi_global_stages(left, right, repeats).items():
        print(f"| {name} | {1e3 * seconds:.1f} |")

    candidates = rows * columns * DISPARITIES[1]
    arithmetic, bandwidth = operation_rate(), copy_rate(columns * DISPARITIES[1])
    print(
        "\nFloors of one core: the innermost loop's vector operations at the rate of a matrix product's\n"
        "multiply-adds, which some processors do fewer of than of plain operations: more than 100 % then;\n"
        "reading and writing every window sum once at the rate of a copy within the cache that holds them.\n"
    )
    print(
        "| kernel | arithmetic floor | bandwidth floor | taken | of the larger floor |\n"
        "| --- | ---: | ---: | ---: | ---: |"
    )
    for name, task in costs.items():
        taken = statistics.median(_seconds(task) for _ in range(repeats))
        floors = candidates * OPERATIONS[name] / arithmetic, candidates / bandwidth
        texts = " | ".join(f"{1e3 * value:.1f} ms" for value in (*floors, taken))
        print(f"| {name} | {texts} | {100 * max(floors) / taken:.0f} % |", flush=True)


if __name__ == "__main__":
    main()
