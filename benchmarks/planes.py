"""What planes on segments make of a disparity map, and what each part of them gives.

python benchmarks/planes.py FOLDER [--preset fast] [--disparities MIN:MAX] [--every 1]

Matches every pair once, without filling, and starts from that map. Prints a table over all known pixels
(Middlebury: those visible in both views): the map filled from the background, and filled and flattened by
`stereopsis.planes.refine` as it is and with one part changed. Nothing comes from the truth. The times are
processor time of one thread.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np

import stereopsis as st
from stereopsis import datasets, fill, planes, slant
from stereopsis.planes import Model
from stereopsis.settings import Settings
from stereopsis.types import DisparityMap, Pair

Variant = tuple[str, Model, dict[str, Any], bool]
VARIANTS: tuple[Variant, ...] = (
    ("planes", Model(), {}, True),
    ("the ground not looked for", Model(), {}, False),
    ("every match counts alike", Model(), {"FAINT": 1.0}, True),
    ("holes count nothing", Model(), {"GUESSED": 0.0}, True),
    ("holes count as matches", Model(), {"GUESSED": 1.0}, True),
    ("squares: boundaries never move", Model(), {"SWEEPS": (0,)}, True),
    ("9 sweeps in 3 turns", Model(), {"SWEEPS": (3, 3, 3)}, True),
    ("each segment by itself", Model(), {"ROUNDS": 0}, True),
    ("2 rounds", Model(), {"ROUNDS": 2}, True),
    ("12 rounds", Model(), {"ROUNDS": 12}, True),
    ("sides of 9", Model(side=9), {}, True),
    ("sides of 20", Model(side=20), {}, True),
    ("no fold is dearer than a step", Model(hinge=6), {}, True),
    ("folds are nearly free", Model(hinge=0.5), {}, True),
    ("steps twice as dear", Model(occlusion=12), {}, True),
    ("half the smoothness", Model(smoothness=1), {}, True),
    ("twice the smoothness", Model(smoothness=4), {}, True),
    ("boundaries by colour alone", Model(depth=0), {}, True),
)


def main(arguments: Sequence[str] | None = None) -> None:
    options = parse(arguments)
    low, high = (int(end) for end in options.disparities.split(":"))
    settings = Settings.make(options.preset, disparities=(low, high), fill=None, threads=1)
    samples = list(datasets.open(options.folder))[:: options.every]
    pairs = [sample.pair() for sample in samples]
    maps = [st.match(pair, settings=settings).disparity for pair in pairs]

    def row(name: str, flat: Callable[[Pair, DisparityMap], DisparityMap]) -> None:
        scores, seconds = [], []
        for sample, pair, found in zip(samples, pairs, maps, strict=True):
            start = time.process_time()
            dense = flat(pair, found)
            seconds.append(time.process_time() - start)
            scores.append(st.evaluate(dense, sample.truth(), sample.mask()).filled)
        cells = [
            f"{fmean(score.d1 for score in scores):.2%}",
            f"{fmean(score.within_1 for score in scores):.1%}",
            f"{fmean(score.bad_2 for score in scores):.1%}",
            f"{fmean(score.rmse for score in scores):.2f}",
            f"{1e3 * fmean(seconds):.0f}",
        ]
        print("| " + " | ".join([name, *cells]) + " |", flush=True)

    print("| | D1 | < 1 px | bad-2.0 | RMSE | ms |")
    print("| --- | ---: | ---: | ---: | ---: | ---: |")
    row("filled from the background", lambda _, found: fill.background(found))
    for name, model, constants, grounded in VARIANTS:

        def flat(
            pair: Pair, found: DisparityMap, model: Model = model, grounded: bool = grounded
        ) -> DisparityMap:
            ground = slant.road(found, slant.FIRST_WINDOW) if grounded else None
            return planes.refine(pair.left, found, (low, high - 1), model, 1, ground=ground).disparity

        with changed(constants):
            row(name, flat)


@contextlib.contextmanager
def changed(constants: dict[str, Any]) -> Iterator[None]:
    before = {name: getattr(planes, name) for name in constants}
    try:
        for name, value in constants.items():
            setattr(planes, name, value)
        yield
    finally:
        for name, value in before.items():
            setattr(planes, name, value)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    summary, _, rest = (__doc__ or "").partition("\n")
    parser = argparse.ArgumentParser(description=summary, epilog=rest.rpartition("\n\n")[2])
    parser.add_argument("folder", metavar="FOLDER", type=Path, help="a benchmark in its own layout")
    parser.add_argument("--preset", default="fast", help="what the map is matched with")
    parser.add_argument("--disparities", default="0:128", metavar="MIN:MAX", help="MAX excluded")
    parser.add_argument("--every", type=int, default=1, help="take every so many-th pair only")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    np.seterr(all="raise", under="ignore")
    sys.exit(main())
