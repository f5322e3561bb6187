"""What undoing a misrectification is worth, and how disparities are bowed without and with it.

python benchmarks/rows.py FOLDER... [--preset NAME] [--disparities MIN:MAX] [--moved ROWS,...]

For each benchmark: the least, the median and the greatest of each term of the field over its pairs; then,
with rows as they are, with the field but for its keystone, and with all of it, D1 and the fraction within
1 px, every pixel answered, and by how many pixels what is matched lies off the truth: the median of each
eighth of the image from left to right. Of all these the mean over the pairs. The truth is for this alone.
With `--moved`, right images moved down by so many rows in place of all that: D1, the fraction within 1 px,
and how far the offset that is found lies at most off the one that is found without, plus these rows.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

import stereopsis as st
from stereopsis import datasets
from stereopsis.settings import Settings

EIGHTHS = 8
FEWEST = 100
"""Known pixels of an eighth that counts."""


def main(arguments: Sequence[str] | None = None) -> None:
    options = parse(arguments)
    settings = Settings.make(options.preset, assignments=[f"disparities={options.disparities}"])
    for folder in options.folders:
        print(f"\n{folder.name}, {settings.preset}\n")
        samples = list(datasets.open(folder))
        if options.moved is None:
            report(samples, settings)
        else:
            report_moved(samples, settings, [int(rows) for rows in options.moved.split(",")])


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    summary, _, rest = (__doc__ or "").partition("\n")
    parser = argparse.ArgumentParser(description=summary, epilog=rest.rpartition("\n\n")[2])
    parser.add_argument(
        "folders", metavar="FOLDER", type=Path, nargs="+", help="benchmarks in their own layout"
    )
    parser.add_argument("--preset", default="accurate")
    parser.add_argument("--disparities", default="0:128", metavar="MIN:MAX", help="MAX excluded")
    parser.add_argument("--moved", metavar="ROWS,...", help="such as 0,4,-12")
    return parser.parse_args(arguments)


def report(samples: Sequence[datasets.Sample], settings: Settings) -> None:
    fields: list[st.Vertical] = []
    scores: dict[str, list[list[float]]] = {"as they are": [], "without keystone": [], "undone": []}
    for sample in samples:
        pair = sample.pair()
        field = st.estimate_vertical(pair.left, pair.right, settings.disparities)
        fields.append(field)
        for name, vertical in zip(scores, (None, field._replace(keystone=0.0), field), strict=True):
            scores[name].append(score(sample, settings.changed(vertical=vertical)))
    for term, values in zip(st.Vertical._fields, np.transpose(fields), strict=True):
        print(f"{term}: {min(values):.2f}, {np.median(values):.2f}, {max(values):.2f}")
    print("\n| rows | D1 | < 1 px | " + " | ".join(f"{k}/8" for k in range(1, EIGHTHS + 1)) + " |")
    print("| --- " + "| ---: " * (2 + EIGHTHS) + "|")
    for name, rows in scores.items():
        wrong, within, *off = np.nanmean(rows, axis=0)
        print(f"| {name} | {wrong:.2%} | {within:.1%} | " + " | ".join(f"{each:.2f}" for each in off) + " |")


def report_moved(samples: Sequence[datasets.Sample], settings: Settings, moves: Sequence[int]) -> None:
    print("| moved by | D1 | < 1 px | offset off by |")
    print("| ---: | ---: | ---: | ---: |")
    pairs = [sample.pair() for sample in samples]
    own = [st.estimate_vertical(pair.left, pair.right, settings.disparities).offset for pair in pairs]
    for rows in moves:
        scores, off = [], []
        for sample, pair, offset in zip(samples, pairs, own, strict=True):
            truth = sample.truth()
            assert truth is not None
            last = len(pair.right) - 1
            lower = pair.right[np.clip(np.arange(last + 1) - rows, 0, last)]
            result = st.match(pair.left, lower, settings=settings)
            scored = st.evaluate(result.disparity, truth, sample.mask()).filled
            scores.append([scored.d1, scored.within_1])
            assert isinstance(result.settings.vertical, st.Vertical)
            off.append(abs(result.settings.vertical.offset - offset - rows))
        wrong, within = np.mean(scores, axis=0)
        print(f"| {rows} | {wrong:.2%} | {within:.1%} | {max(off):.2f} |", flush=True)


def score(sample: datasets.Sample, settings: Settings) -> list[float]:
    """D1, the fraction within 1 px, and the median error of each eighth; NaN where little is known."""
    truth, mask = sample.truth(), sample.mask()
    if truth is None:
        raise ValueError(f"{sample.name} has no truth to score against")
    result = st.match(sample.pair(), settings=settings)
    scores = st.evaluate(result.disparity, truth, mask)
    known = np.isfinite(truth) & ((result.flags & st.Flag.FILLED) == 0) & np.isfinite(result.disparity)
    if mask is not None:
        known &= mask
    return [scores.filled.d1, scores.filled.within_1, *by_eighths(result.disparity - truth, known)]


def by_eighths(error: npt.NDArray[np.float32], known: npt.NDArray[np.bool_]) -> list[float]:
    parts = zip(np.array_split(error, EIGHTHS, axis=1), np.array_split(known, EIGHTHS, axis=1), strict=True)
    return [float(np.median(e[k])) if np.count_nonzero(k) >= FEWEST else np.nan for e, k in parts]


if __name__ == "__main__":
    try:
        main()
    except (ValueError, TypeError, OSError) as error:
        sys.exit(f"error: {error}")
