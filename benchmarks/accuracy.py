"""Match and score every pair of one or several benchmarks; print a table that can be pasted into a page.

python benchmarks/accuracy.py FOLDER... [--set NAME=VALUE]... [--preset NAME] [--disparities MIN:MAX]

Without --preset the settings are those of plain local matching: zncc on a window of 31, a parabola through
the best cost, no check, no filter, 0:128. The range never comes from the truth: it is the same for every pair
or, with --disparities calibration, goes up to the bound that the benchmark gives every participant
(Middlebury's ndisp). Pixels that only the left camera sees do not count where the benchmark tells them apart.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from statistics import fmean
from typing import Any

import stereopsis as st
from stereopsis import datasets
from stereopsis.evaluate import Scores
from stereopsis.settings import COSTS, Settings
from stereopsis.types import Disparities

PLAIN = {"cost": "zncc", "window": "31", "subpixel": "parabola"}


@dataclass(frozen=True)
class Row:
    """One pair's scores and time."""

    name: str
    scores: Scores
    seconds: float


COLUMNS: tuple[tuple[str, str, Callable[[Row], float]], ...] = (
    ("density", "{:.3f}", lambda row: row.scores.density),
    ("< 0.25 px", "{:.1%}", lambda row: row.scores.all.within_0_25),
    ("< 0.5 px", "{:.1%}", lambda row: row.scores.all.within_0_5),
    ("< 1 px", "{:.1%}", lambda row: row.scores.all.within_1),
    ("< 2 px", "{:.1%}", lambda row: row.scores.all.within_2),
    ("< 4 px", "{:.1%}", lambda row: row.scores.all.within_4),
    ("RMSE own", "{:.2f}", lambda row: row.scores.own.rmse),
    ("RMSE filled", "{:.2f}", lambda row: row.scores.filled.rmse),
    ("D1 own", "{:.1%}", lambda row: row.scores.own.d1),
    ("D1 filled", "{:.1%}", lambda row: row.scores.filled.d1),
    ("s/pair", "{:.3f}", lambda row: row.seconds),
)


def main(arguments: Sequence[str] | None = None) -> None:
    options = parse(arguments)
    settings = choose(options.preset, options.assignments, options.disparities)
    found = [datasets.open(folder) for folder in options.folders]
    results = [(dataset.name, score(dataset, settings, options.disparities)) for dataset in found]
    if options.csv:
        write_csv(options.csv, results)
    if options.json:
        json.dump(
            [as_dict(name, rows, settings) for name, rows in results], sys.stdout, indent=1, allow_nan=False
        )
        print()
    else:
        print("\n\n".join(table(name, rows) for name, rows in results))


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    summary, _, rest = (__doc__ or "").partition("\n")
    parser = argparse.ArgumentParser(description=summary, epilog=rest.rpartition("\n\n")[2])
    parser.add_argument(
        "folders", nargs="+", metavar="FOLDER", type=Path, help="a benchmark in its own layout"
    )
    parser.add_argument("--set", dest="assignments", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--preset", metavar="NAME", help="start from these settings, not from the plain ones")
    parser.add_argument(
        "--disparities",
        default="0:128",
        metavar="MIN:MAX",
        help="MAX excluded, or 'calibration' (default %(default)s); --disparities=-8:120 for a negative MIN",
    )
    parser.add_argument("--csv", type=Path, metavar="FILE", help="also write a line for each pair")
    parser.add_argument(
        "--json", action="store_true", help="print one JSON array with every score of every pair"
    )
    return parser.parse_args(arguments)


def choose(preset: str | None, assignments: Sequence[str], disparities: str) -> Settings:
    plain = {} if preset else PLAIN
    # An assignment of the user's replaces the plain one of the same name, whatever `make` says of two.
    given = {text.partition("=")[0].strip() for text in assignments}
    kept = [f"{name}={value}" for name, value in plain.items() if name not in given]
    # A cost of pixels has a window of its own.
    chosen = Settings.make(
        assignments=[text for text in assignments if text.partition("=")[0].strip() == "cost"]
    )
    if type(chosen.cost) not in COSTS.values():
        kept = [text for text in kept if not text.startswith("window=")]
    settings = Settings.make(preset=preset, assignments=(*kept, *assignments))
    return (
        settings if disparities == "calibration" else replace(settings, disparities=parse_range(disparities))
    )


def parse_range(text: str) -> Disparities:
    low, _, high = text.partition(":")
    try:
        return Disparities(int(low), int(high))
    except ValueError:
        raise ValueError(f"--disparities must be MIN:MAX or 'calibration', not {text!r}") from None


def score(dataset: datasets.Dataset, settings: Settings, disparities: str) -> list[Row]:
    rows = []
    for number, sample in enumerate(dataset, start=1):
        if sys.stderr.isatty():
            print(f"\r{dataset.name} {number}/{len(dataset)}", end="", file=sys.stderr)
        truth = sample.truth()
        if truth is None:
            raise ValueError(f"{dataset.name} {sample.name} has no truth to score against")
        pair = sample.pair()
        if disparities == "calibration":
            if pair.calibration is None or pair.calibration.ndisp is None:
                raise ValueError(
                    f"{dataset.name} {sample.name} has no calibration that bounds the disparities"
                )
            settings = replace(settings, disparities=Disparities(0, pair.calibration.ndisp))
        result = st.match(pair, settings=settings)
        rows.append(Row(sample.name, st.evaluate(result.disparity, truth, sample.mask()), result.seconds))
    if sys.stderr.isatty():
        print("\r\033[K", end="", file=sys.stderr)
    return rows


def table(name: str, rows: list[Row]) -> str:
    """A data set's means over its pairs, as GitHub Markdown."""
    header = [f"{name}, {len(rows)} pairs", *(column for column, _, _ in COLUMNS)]
    means = [form.format(fmean(map(value, rows))) for _, form, value in COLUMNS]
    lines = [header, ["---"] + ["---:"] * len(COLUMNS), ["mean", *means]]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def as_dict(name: str, rows: list[Row], settings: Settings) -> dict[str, Any]:
    pairs = [{"name": row.name, "seconds": row.seconds, **row.scores.to_dict()} for row in rows]
    means = {column: fmean(map(value, rows)) for column, _, value in COLUMNS}
    # JSON has no infinity, which is what an error is where even the filling gives no answer.
    mean = {column: value if isfinite(value) else None for column, value in means.items()}
    return {"dataset": name, "settings": settings.to_toml(), "mean": mean, "pairs": pairs}


def write_csv(file: Path, results: list[tuple[str, list[Row]]]) -> None:
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(["dataset", "pair", *(column for column, _, _ in COLUMNS)])
        for name, rows in results:
            writer.writerows([name, row.name, *(value(row) for _, _, value in COLUMNS)] for row in rows)


if __name__ == "__main__":
    try:
        main()
    except (ValueError, TypeError, OSError) as error:
        sys.exit(f"error: {error}")
