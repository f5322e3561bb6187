"""What a fronto-parallel window costs: each window size with and without the road's plane under it.

python benchmarks/slant.py FOLDER [--windows 9,15,21,31,45,61] [--disparities MIN:MAX] [--unrounded]

Prints a table: for each window the fraction of known pixels within 1 px and the RMSE, for fronto-parallel
windows, along the road (`slant="road"`) and along several planes (`slant="planes"`). Plain winners with a
parabola: no check, no filter. Nothing comes from the truth. With --unrounded the images are matched as
floats, so that the warped one is not rounded to 8 bits; it takes several times longer.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean

import numpy as np

import stereopsis as st
from stereopsis import datasets
from stereopsis.settings import Settings

SLANTS = {"fronto-parallel": None, "road": "road", "planes": "planes"}


def main(arguments: Sequence[str] | None = None) -> None:
    options = parse(arguments)
    samples = list(datasets.open(options.folder))
    header = ["window"]
    for name in SLANTS:
        header += [f"{name}: < 1 px", "RMSE"]
    print("| " + " | ".join(header) + " |")
    print("| ---: " * len(header) + "|")
    for window in options.windows.split(","):
        cells = [window]
        for slant in SLANTS.values():
            settings = Settings.make(
                assignments=[
                    f"cost={options.cost}",
                    f"window={window}",
                    f"disparities={options.disparities}",
                ],
                slant=slant,
            )
            scores = [score(sample, settings, options.unrounded) for sample in samples]
            cells += [
                f"{fmean(within for within, _ in scores):.1%}",
                f"{fmean(rmse for _, rmse in scores):.2f}",
            ]
        print("| " + " | ".join(cells) + " |", flush=True)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    summary, _, rest = (__doc__ or "").partition("\n")
    parser = argparse.ArgumentParser(description=summary, epilog=rest.rpartition("\n\n")[2])
    parser.add_argument("folder", metavar="FOLDER", type=Path, help="a benchmark in its own layout")
    parser.add_argument("--windows", default="9,15,21,31,45,61", help="sides in pixels or WIDTHxHEIGHT")
    parser.add_argument("--disparities", default="0:128", metavar="MIN:MAX", help="MAX excluded")
    parser.add_argument("--cost", default="zncc")
    parser.add_argument("--unrounded", action="store_true", help="match the images as floats")
    return parser.parse_args(arguments)


def score(sample: datasets.Sample, settings: Settings, unrounded: bool) -> tuple[float, float]:
    """Fraction within 1 px and RMSE of one pair."""
    truth = sample.truth()
    if truth is None:
        raise ValueError(f"{sample.name} has no truth to score against")
    pair = sample.pair()
    if unrounded:
        pair = st.Pair(pair.left.astype(np.float32), pair.right.astype(np.float32))
        pair.left[0, 0] += np.float32(0.3)  # or they would be matched as bytes
    scores = st.evaluate(st.match(pair, settings=settings).disparity, truth, sample.mask())
    return scores.all.within_1, scores.own.rmse


if __name__ == "__main__":
    try:
        main()
    except (ValueError, TypeError, OSError) as error:
        sys.exit(f"error: {error}")
