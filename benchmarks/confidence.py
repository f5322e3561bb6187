"""Fit the calibrated confidence on half of the pairs, and see on the other half what it is worth.

python benchmarks/confidence.py fit FOLDER... [--set NAME=VALUE]... [--preset NAME]
python benchmarks/confidence.py check FOLDER... [--set NAME=VALUE]... [--preset NAME]

`fit` prints the weights that stand in src/stereopsis/confidence.py, from every second pair of each benchmark,
each of which counts alike. `check` takes the others: areas under the sparsification curve over the ideal
ones, and the reliability table. The range is 0:128, or up to Middlebury's ndisp. Pixels that only the left
camera sees do not count where they are known.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import stereopsis as st
from stereopsis import confidence, datasets, fill
from stereopsis.reliability import reliability
from stereopsis.settings import Settings
from stereopsis.sparsification import sparsification
from stereopsis.types import Flag

Floats = npt.NDArray[np.float64]
RIGHT = 3.0
"""An answer is right where it is at most so many pixels off."""
SAMPLE = 4000
"""Pixels of a pair that the fit looks at, at most."""
MEASURES = ("bad-1", "bad-2", "bad-3", "epe")


def main(arguments: Sequence[str] | None = None) -> None:
    options = parse(arguments)
    found = [datasets.open(folder) for folder in options.folders]
    settings = Settings.make(options.preset, assignments=options.assignments)
    if options.task == "fit":
        for name, weights in zip(("ANSWERED", "FILLED"), fit(found, settings), strict=True):
            print(f"{name} = ({', '.join(f'{weight:.3f}' for weight in weights)})")
    else:
        check(found, settings)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    summary, _, rest = (__doc__ or "").partition("\n")
    parser = argparse.ArgumentParser(description=summary, epilog=rest)
    parser.add_argument("task", choices=("fit", "check"))
    parser.add_argument("folders", nargs="+", metavar="FOLDER", type=Path)
    parser.add_argument("--set", dest="assignments", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--preset", metavar="NAME")
    return parser.parse_args(arguments)


def maps(sample: datasets.Sample, settings: Settings) -> tuple[Any, Any, Any, Any, Any]:
    """A pair's surface, what of it was matched, its sharpness, its errors and where these are known."""
    pair = sample.pair()
    ndisp = pair.calibration.ndisp if pair.calibration else None
    result = st.match(pair, settings=settings.changed(confidence=None, disparities=(0, ndisp or 128)))
    surface = result.disparity
    if np.isnan(surface).any():
        surface = np.nan_to_num(fill.background(surface))
    answered = np.isfinite(result.disparity) & (result.flags & Flag.FILLED == 0)
    truth, mask = sample.truth(), sample.mask()
    assert truth is not None
    known = np.isfinite(truth) if mask is None else np.isfinite(truth) & mask
    return surface, answered, result.confidence, np.abs(surface - truth), known


def fit(found: Sequence[datasets.Dataset], settings: Settings) -> Iterator[Floats]:
    """Weights for matched, then for filled pixels."""
    rng = np.random.default_rng(0)
    rows: dict[bool, list[tuple[Floats, Floats, Floats]]] = {True: [], False: []}
    for dataset in found:
        for sample in dataset[::2]:
            surface, answered, sharpness, errors, known = maps(sample, settings)
            seen = confidence.features(surface, answered, sharpness)
            for which, chosen in rows.items():
                at = np.flatnonzero(known & (answered == which))
                share = at.size / max(1, np.count_nonzero(known)) / len(dataset[::2])
                at = rng.permutation(at)[:SAMPLE]
                if at.size:
                    right = (errors.ravel()[at] <= RIGHT).astype(np.float64)
                    counts = np.full(at.size, share / at.size)
                    chosen.append((seen.reshape(-1, seen.shape[2])[at], right, counts))
    for which in (True, False):
        yield logistic(*(np.concatenate(part) for part in zip(*rows[which], strict=True)))


def logistic(seen: Floats, right: Floats, counts: Floats, ridge: float = 1e-3) -> Floats:
    """Weighted logistic regression by Newton's method."""
    counts = counts * (right.size / counts.sum())
    weights = np.zeros(seen.shape[1])
    for _ in range(30):
        p = 1 / (1 + np.exp(-seen @ weights))
        slope = seen.T @ (counts * (right - p)) - ridge * right.size * weights * 1e-3
        bend = (seen * (counts * p * (1 - p))[:, None]).T @ seen + 1e-6 * right.size * np.eye(weights.size)
        weights += np.linalg.solve(bend, slope)
    return weights


def check(found: Sequence[datasets.Dataset], settings: Settings) -> None:
    print("| benchmark | pixels | " + " | ".join(f"{m}: before" for m in MEASURES), end=" | ")
    print(" | ".join(f"{m}: calibrated" for m in MEASURES) + " |")
    print("| --- " * (2 + 2 * len(MEASURES)) + "|")
    trust, correct = [], []
    for dataset in found:
        areas: dict[str, list[list[float]]] = {"matched": [], "all": []}
        for sample in dataset[1::2]:
            surface, answered, sharpness, errors, known = maps(sample, settings)
            p = confidence.probability(surface, answered, sharpness)
            trust.append(p[known])
            correct.append(errors[known] <= RIGHT)
            for name, mask in (("matched", known & answered), ("all", known)):
                row = []
                for scored in (np.where(answered, sharpness, 0), p):
                    for measure in MEASURES:
                        curve = sparsification(errors, scored, np.zeros_like(errors), measure, mask)
                        row += [curve.auc, curve.ideal_auc]
                areas[name].append(row)
        for name, rows in areas.items():
            auc = np.mean(rows, axis=0)
            ratios = " | ".join(f"{ratio:.2f}" for ratio in auc[::2] / auc[1::2])
            print(f"| {dataset.name} | {name} | {ratios} |")
    print()
    table = reliability(np.concatenate(trust), np.concatenate(correct))
    print("| confidence | share of pixels | mean confidence | right |")
    print("| --- | ---: | ---: | ---: |")
    for low, high, share, mean, right in zip(
        table.edges[:-1], table.edges[1:], table.share, table.confidence, table.correct, strict=True
    ):
        print(f"| {low:.1f} to {high:.1f} | {share:.1%} | {mean:.3f} | {right:.3f} |")
    print(f"\nexpected calibration error {table.error:.3f}")


if __name__ == "__main__":
    main()
