"""What each quirk of the report's protocol costs, and its sub-pixel as tried: tables for a page.

    python benchmarks/ablation.py FOLDER              # 15 pairs take a quarter of an hour
    python benchmarks/ablation.py FOLDER --pairs 3

Needs the extra ``study``.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from statistics import fmean

from stereopsis import datasets
from stereopsis.study import ablation, published
from stereopsis.study.published import COLUMNS, PUBLISHED, Quirks

SUBPIXEL = {
    "published: whole disparities": (PUBLISHED, False),
    "published: sub-pixel as tried": (PUBLISHED, True),
    "all corrected: whole disparities": (Quirks(), False),
    "all corrected: parabola": (Quirks(), True),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--pairs", type=int, help="the first so many pairs only")
    arguments = parser.parse_args()
    samples = [*datasets.open(arguments.folder)][: arguments.pairs]
    print(subpixel(samples), end="\n\n", flush=True)
    print(ablation.markdown(ablation.changes(ablation.ablate(samples, tell))))


def tell(row: ablation.Row) -> None:
    print(f"{row.pair} {row.case.method} {row.case.name}", file=sys.stderr, flush=True)


def subpixel(samples: list[datasets.Sample]) -> str:
    """ZNCC at 30, refined in either way or not: means over all pairs."""
    lines = [
        "| ZNCC, 30 | < 0.25 px | < 0.5 px | < 1 px | < 2 px | < 4 px | RMSE |",
        "| --- |" + " ---: |" * 6,
    ]
    for name, (quirks, refined) in SUBPIXEL.items():
        scores = []
        for sample in samples:
            pair, truth = sample.pair(), sample.truth()
            found = published.disparity(
                pair.left, pair.right, "zncc", 30, quirks, truth=truth, subpixel=refined
            )
            scores.append(published.measures(found, truth))
            print(f"{sample.name} {name}", file=sys.stderr, flush=True)
        means = [fmean(score[column] for score in scores) for column in COLUMNS]
        cells = [*(f"{100 * mean:.2f} %" for mean in means[:-1]), f"{means[-1]:.2f}"]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
