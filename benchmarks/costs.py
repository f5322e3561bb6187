"""Score every cost with plain winner-take-all, on a few pairs of one or several benchmarks.

python benchmarks/costs.py [FOLDER...] [--pairs N] [--cost TEXT]... [--disparities MIN:MAX] [--threads N]

No smoothing, no check, no filter; a parabola through the best cost. A cost is written as --set takes it, such
as "census(9x7,aggregation=9)", or "zncc 9" with the window of a cost of windows. Printed is Markdown: of all
known pixels the share that is wrong (D1: by more than 3 pixels and 5 %), that within a pixel, the RMSE, and
the mean seconds of a pair. The pairs are spread evenly over the benchmark; pixels that only the left camera
sees do not count where it tells them apart.

Without a FOLDER, the processor's milliseconds of each cost of pixels' volume alone are printed, of 881 x 400
random pixels and 128 candidates, the least of nine.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean

import numpy as np

import stereopsis as st
from stereopsis import datasets, information, pixelwise
from stereopsis.pixelwise import Pixelwise
from stereopsis.settings import Settings
from stereopsis.types import Disparities

COSTS = (
    "census(9x7,dense,1)",
    "sad 9",
    "zncc 9",
    "zncc 15",
    "rank(9x7,9)",
    "gradient(9)",
    "birchfield-tomasi(9)",
    "mutual-information(9)",
    "census(5,dense,9)",
    "census(9x7,dense,9)",
    "census(11,dense,9)",
    "census(9x7,symmetric,9)",
    "census(9x7,sparse,9)",
    "combined(census(9x7,dense,9),0.6,gradient(9),0.4)",
)


def main(arguments: Sequence[str] | None = None) -> None:
    options = parse(arguments)
    if not options.folders:
        time_volumes(options.cost or COSTS, int(options.threads))
        return
    found = [datasets.open(folder) for folder in options.folders]
    header = ["cost"]
    for dataset in found:
        header += [f"{dataset.name}: D1 %", "< 1 px %", "RMSE", "s"]
    print("| " + " | ".join(header) + " |")
    print("| --- |" + " ---: |" * (len(header) - 1))
    for text in options.cost or COSTS:
        cells = [f"`{text}`"]
        for dataset in found:
            cells += score(dataset, settings_of(text, options), options.pairs, options.offset)
        print("| " + " | ".join(cells) + " |", flush=True)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folders", nargs="*", metavar="FOLDER", type=Path)
    parser.add_argument(
        "--pairs", type=int, default=5, metavar="N", help="of each benchmark (default %(default)s)"
    )
    parser.add_argument("--offset", type=int, default=0, metavar="N", help="start so many pairs later")
    parser.add_argument("--cost", action="append", metavar="TEXT", help="instead of the costs of the table")
    parser.add_argument("--disparities", default="0:128", metavar="MIN:MAX")
    parser.add_argument("--threads", default="1", metavar="N")
    return parser.parse_args(arguments)


def settings_of(text: str, options: argparse.Namespace) -> Settings:
    cost, _, window = text.partition(" ") if "(" not in text else (text, "", "")
    assignments = [f"cost={cost}", f"disparities={options.disparities}", f"threads={options.threads}"]
    return Settings.make(assignments=assignments + ([f"window={window}"] if window else []))


def score(dataset: datasets.Dataset, settings: Settings, pairs: int, offset: int) -> list[str]:
    samples = list(dataset)
    step = max(1, len(samples) // pairs)
    rows = []
    for sample in samples[offset::step][:pairs]:
        truth = sample.truth()
        if truth is None:
            raise ValueError(f"{dataset.name} {sample.name} has no truth to score against")
        result = st.match(sample.pair(), settings=settings)
        rows.append((st.evaluate(result.disparity, truth, sample.mask()).filled, result.seconds))
    return [
        f"{100 * fmean(scores.d1 for scores, _ in rows):.1f}",
        f"{100 * fmean(scores.within_1 for scores, _ in rows):.1f}",
        f"{fmean(scores.rmse for scores, _ in rows):.2f}",
        f"{fmean(seconds for _, seconds in rows):.2f}",
    ]


def time_volumes(costs: Sequence[str], threads: int) -> None:
    left, right = np.random.default_rng(0).integers(0, 256, (2, 400, 881, 1), np.uint8)
    disparities = Disparities(0, 128)
    print("| cost | ms |\n| --- | ---: |")
    for text in costs:
        cost = st.Settings.make(assignments=[f"cost={text}"]).cost if " " not in text else None
        if not isinstance(cost, Pixelwise):
            continue
        tables = information.tables(left, right, disparities, threads)
        times = []
        for _ in range(9):
            start = time.process_time()
            pixelwise.volume(cost, left, right, disparities, threads, tables)
            times.append(time.process_time() - start)
        print(f"| `{text}` | {1000 * min(times):.0f} |", flush=True)


if __name__ == "__main__":
    try:
        main()
    except (ValueError, TypeError, OSError) as error:
        sys.exit(f"error: {error}")
