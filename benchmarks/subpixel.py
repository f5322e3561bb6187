"""Every sub-pixel method on real pairs and on synthetic streets; print tables that can be pasted into a page.

python benchmarks/subpixel.py [FOLDER...] [--window WINDOW] [--pairs N] [--scenes N] [--methods NAME;...]

The matching is the same for all: zncc on one window, 0:128, no check, no filter; one thread. A method that
works from the images comes after it. Each FOLDER is a benchmark in its own layout.
The streets are 880 x 400 with Gaussian noise of 2 grey levels in each view and channel; there, those pixels
count that both cameras see, that are not sky, and whose mean horizontal gradient (the texture that `match`
keeps) is at least --texture grey levels a pixel over 9 x 9. Times are seconds of processor time, matching
included.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np

import stereopsis as st
from stereopsis import datasets
from stereopsis.evaluate import Scores

METHODS: dict[str, dict[str, Any]] = {
    "whole disparities": {"subpixel": None},
    "parabola": {"subpixel": "parabola"},
    "equiangular": {"subpixel": "equiangular"},
    **{
        f"4 x columns, {how}": {"subpixel": None, "upsample": (4, how)}
        for how in ("nearest", "linear", "cubic", "lanczos", "area")
    },
    "4 x columns, cubic, parabola": {"subpixel": "parabola", "upsample": (4, "cubic")},
    "correlation": {"subpixel": "correlation"},
    "correlation, 15x5": {"subpixel": "correlation", "refine_window": "15x5"},
    "symmetric": {"subpixel": "symmetric"},
    "symmetric, 25x9": {"subpixel": "symmetric", "refine_window": "25x9"},
    "lucas-kanade": {"subpixel": "lucas-kanade"},
    "lucas-kanade-affine": {"subpixel": "lucas-kanade-affine"},
}


@dataclass(frozen=True)
class Example:
    """A pair with its truth, and which pixels count."""

    pair: st.Pair
    truth: np.ndarray
    mask: np.ndarray | None


@dataclass(frozen=True)
class Row:
    """One pair's scores, time and locking."""

    scores: Scores
    seconds: float
    locking: st.PixelLocking


COLUMNS: tuple[tuple[str, str, Callable[[Row], float]], ...] = (
    ("< 0.25 px", "{:.1%}", lambda row: row.scores.all.within_0_25),
    ("< 0.5 px", "{:.1%}", lambda row: row.scores.all.within_0_5),
    ("< 1 px", "{:.1%}", lambda row: row.scores.all.within_1),
    ("RMSE", "{:.2f}", lambda row: row.scores.own.rmse),
    ("locking", "{:.3f}", lambda row: row.locking.strength),
    ("swing, px", "{:.3f}", lambda row: row.locking.swing),
    ("s/pair", "{:.2f}", lambda row: row.seconds),
)


def main(arguments: Sequence[str] | None = None) -> None:
    options = parse(arguments)
    named = options.methods.split(";") if options.methods else list(METHODS)
    sources: list[tuple[str, Callable[[], Iterator[Example]]]] = [
        (folder.name, lambda folder=folder: real(folder, options.pairs)) for folder in options.folders
    ]
    if options.scenes:
        sources.append(("streets", lambda: streets(options.scenes, options.texture)))
    for name, examples in sources:
        rows: dict[str, list[Row]] = {method: [] for method in named}
        for example in examples():
            for method in named:
                rows[method].append(score(example, options.window, METHODS[method]))
        print(table(f"{name}, {len(rows[named[0]])} pairs, zncc {options.window}", rows), flush=True)
        if options.locking:
            print(histogram(rows), flush=True)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    summary, _, rest = (__doc__ or "").partition("\n")
    parser = argparse.ArgumentParser(description=summary, epilog=rest.rpartition("\n\n")[2])
    parser.add_argument("folders", nargs="*", metavar="FOLDER", type=Path)
    parser.add_argument("--window", default="31", help="the matching window (default %(default)s)")
    parser.add_argument("--pairs", type=int, metavar="N", help="the first N pairs of each folder")
    parser.add_argument("--scenes", type=int, default=2, metavar="N", help="streets (default %(default)s)")
    parser.add_argument("--texture", type=float, default=1.0, metavar="LEVELS")
    parser.add_argument("--methods", metavar="NAME;...", help="only these, separated by semicolons")
    parser.add_argument("--locking", action="store_true", help="also print the histograms of the phase")
    return parser.parse_args(arguments)


def real(folder: Path, count: int | None) -> Iterator[Example]:
    for number, sample in enumerate(datasets.open(folder)):
        if count is not None and number == count:
            return
        truth = sample.truth()
        if truth is None:
            raise ValueError(f"{sample.name} has no truth to score against")
        yield Example(sample.pair(), truth, sample.mask())


def streets(count: int, texture: float) -> Iterator[Example]:
    for seed in range(count):
        scene = st.scenes.street(880, 400, seed=seed, noise=2.0)
        probe = st.match(scene.pair, disparities=(0, 1), cost=st.ZNCC(9), keep=("texture",))
        seen = ~scene.occluded & ~scene.sky
        yield Example(scene.pair, scene.disparity, seen & (probe.stages["texture"] >= texture))


def score(example: Example, window: str, changes: dict[str, Any]) -> Row:
    start = time.process_time()
    found = st.match(example.pair, disparities=(0, 128), cost=st.ZNCC(window), threads=1, **changes)
    seconds = time.process_time() - start
    scores = st.evaluate(found.disparity, example.truth, example.mask)
    return Row(scores, seconds, st.pixel_locking(found.disparity, example.truth, example.mask))


def table(name: str, rows: dict[str, list[Row]]) -> str:
    """Means over the pairs, as GitHub Markdown."""
    lines = [[name, *(column for column, _, _ in COLUMNS)], ["---"] + ["---:"] * len(COLUMNS)]
    lines += [
        [method, *(form.format(fmean(map(value, found))) for _, form, value in COLUMNS)]
        for method, found in rows.items()
    ]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines) + "\n"


def histogram(rows: dict[str, list[Row]]) -> str:
    """A line a method: the share of each phase, from -0.5 to 0.5; half height is none locked."""
    lines = []
    for method, found in rows.items():
        share = np.mean([row.locking.share for row in found], axis=0)
        bars = "".join(" ▁▂▃▄▅▆▇█"[min(8, round(8 * part * share.size / 2))] for part in share)
        lines.append(f"{method:30}|{bars}|")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
