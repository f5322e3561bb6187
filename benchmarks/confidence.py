"""Fit the calibrated confidence on half of the pairs, and see on the other half what it is worth.

python benchmarks/confidence.py fit FOLDER... [--set NAME=VALUE]... [--preset NAME]...
python benchmarks/confidence.py check FOLDER... [--set NAME=VALUE]... [--preset NAME]...
python benchmarks/confidence.py fit FOLDER... --unfiltered sgm|local
python benchmarks/confidence.py check FOLDER... --unfiltered sgm|local

`fit` prints weights such as stand in src/stereopsis/confidence.py, from every second pair of each benchmark,
each of which counts alike, matched by each of the presets. `check` takes the other pairs: areas under the
sparsification curve over the ideal ones, and the reliability table. With `--unfiltered` it is maps that no
filter has seen, of several costs, and others to check: their calibration errors, and in brackets what the
weights of filtered maps would have. The range is 0:128, or up to Middlebury's ndisp. Pixels that only the
left camera sees do not count where they are known.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
import numpy.typing as npt

import stereopsis as st
from stereopsis import confidence, datasets, rectify
from stereopsis.reliability import reliability
from stereopsis.settings import Settings
from stereopsis.sparsification import sparsification

Floats = npt.NDArray[np.float64]
RIGHT = 3.0
"""An answer is right where it is at most so many pixels off."""
RANKED = (1.0, 2.0, 3.0)
"""Errors that the score is to rank."""
SAMPLE = 4000
"""Pixels of a pair that the fit looks at, at most."""
LEAST = 0.85
"""What the preset "accurate" stands for."""
MEASURES = ("bad-1", "bad-2", "bad-3", "epe")
UNFILTERED = {
    "sgm": (
        "cost=census",
        "cost=census left_right=1",
        "cost=census left_right=1 fill=background",
        "cost=census(9x7,aggregation=3)",
        "cost=census(9x7,aggregation=3) left_right=1 uniqueness=5",
        "cost=census median=5",
        "cost=birchfield-tomasi left_right=1",
    ),
    "local": (
        "cost=zncc window=7",
        "cost=zncc window=9 left_right=1",
        "cost=zncc window=9 median=5",
        "cost=zncc window=21",
        "cost=zncc window=21 left_right=1 uniqueness=5 fill=background",
        "cost=zncc window=31",
        "cost=sad window=9",
        "cost=sad window=9 left_right=1",
        "cost=ssd window=21",
        "cost=census(9x7,aggregation=9)",
        "cost=census(9x7,aggregation=9) left_right=1 fill=background",
    ),
}
"""What is fitted, with SGM and without..."""
CHECKED = {
    "sgm": (
        *UNFILTERED["sgm"],
        "cost=census left_right=1 uniqueness=5 median=3",
        "cost=combined(census,0.7,gradient,0.3)",
        "cost=zncc window=5 left_right=1",
    ),
    "local": (
        *UNFILTERED["local"],
        "cost=zncc window=13 left_right=1 median=3",
        "cost=ncc window=25",
        "cost=zsad window=15 left_right=1 fill=interpolate",
        "cost=zncc window=41x15",
    ),
}
"""...and checked: others as well."""


def main(arguments: Sequence[str] | None = None) -> None:
    options = parse(arguments)
    found = [datasets.open(folder) for folder in options.folders]
    if options.unfiltered is not None:
        unfiltered(found, options.unfiltered, options.task)
        return
    presets = options.presets or [None]
    settings = [Settings.make(preset, assignments=options.assignments) for preset in presets]
    if options.task == "fit":
        for weights in fit(found, settings):
            print(f"({', '.join(f'{weight:.3f}' for weight in weights)}),")
    else:
        for chosen in settings:
            print(f"# {chosen.preset}\n")
            check(found, chosen)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    summary, _, rest = (__doc__ or "").partition("\n")
    parser = argparse.ArgumentParser(description=summary, epilog=rest)
    parser.add_argument("task", choices=("fit", "check"))
    parser.add_argument("folders", nargs="+", metavar="FOLDER", type=Path)
    parser.add_argument("--set", dest="assignments", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--preset", dest="presets", action="append", default=[], metavar="NAME")
    parser.add_argument("--unfiltered", choices=tuple(UNFILTERED))
    return parser.parse_args(arguments)


class Maps(NamedTuple):
    """What the model is given of a pair, its answer, and how far off the map is where that is known."""

    given: tuple[Any, ...]
    probability: npt.NDArray[np.float32]
    errors: npt.NDArray[np.float32]
    known: npt.NDArray[np.bool_]

    @property
    def answered(self) -> npt.NDArray[np.bool_]:
        """Where it was matched, not filled."""
        return np.asarray(self.given[1])

    @property
    def sharpness(self) -> npt.NDArray[np.float32]:
        """The confidence without the model."""
        return np.asarray(self.given[2])


def maps(sample: datasets.Sample, settings: Settings) -> Maps:
    """Match a pair, and listen to what the pipeline asks the model."""
    pair = sample.pair()
    ndisp = pair.calibration.ndisp if pair.calibration else None
    disparities = 0, ndisp or 128
    chosen = settings.changed(confidence="calibrated", least_confidence=None, disparities=disparities)
    with mock.patch.object(confidence, "probability", wraps=confidence.probability) as asked:
        used = st.match(pair, settings=chosen).settings
    *given, model, _ = asked.call_args.args
    truth, mask = sample.truth(), sample.mask()
    assert truth is not None
    surface = np.array(given[0])
    if isinstance(used.vertical, st.Vertical):
        rectify.unbow(surface, used.vertical, st.Disparities(*disparities))
    known = np.isfinite(truth) if mask is None else np.isfinite(truth) & mask
    return Maps(tuple(given), confidence.probability(*given, model), np.abs(surface - truth), known)


def unfiltered(found: Sequence[datasets.Dataset], which: str, task: str) -> None:
    """Weights, or calibration errors, of maps that no filter has seen."""
    sgm = ["optimize=sgm"] if which == "sgm" else []
    chains = UNFILTERED if task == "fit" else CHECKED
    settings = [Settings.make(None, assignments=[*chain.split(), *sgm]) for chain in chains[which]]
    if task == "fit":
        for weights in fit(found, settings, by_window=which == "local"):
            print(f"({', '.join(f'{weight:.3f}' for weight in weights)}),")
        return
    print(f"| settings | {' | '.join(dataset.name for dataset in found)} |")
    print("| --- " + "| ---: " * len(found) + "|")
    for chain, chosen in zip(chains[which], settings, strict=True):
        errors = (calibration(dataset, chosen) for dataset in found)
        row = " | ".join(f"{own:.3f} ({filtered:.3f})" for own, filtered in errors)
        print(f"| `{chain}` | {row} |", flush=True)


def calibration(dataset: datasets.Dataset, settings: Settings) -> tuple[float, float]:
    """The expected calibration error of what maps answer; and with the weights of filtered maps."""
    model = confidence.model(isinstance(settings.optimize, st.SGM), True, settings.cost.size)
    own, filtered, rights = [], [], []
    for sample in dataset[1::2]:
        seen = maps(sample, settings)
        counts = seen.known if settings.fill is not None else seen.known & seen.answered
        rights.append(seen.errors[counts] <= RIGHT)
        own.append(seen.probability[counts])
        filtered.append(confidence.probability(*seen.given, model)[counts])
    right = np.concatenate(rights)
    return reliability(np.concatenate(own), right).error, reliability(np.concatenate(filtered), right).error


def fit(
    found: Sequence[datasets.Dataset], settings: Sequence[Settings], by_window: bool = False
) -> Iterator[Floats]:
    """Weights for matched, then for filled pixels; before the last one, that of the window's doublings."""
    rng = np.random.default_rng(0)
    rows: dict[bool, list[tuple[Floats, Floats, Floats]]] = {True: [], False: []}
    for dataset in found:
        for sample, chosen_settings in itertools.product(dataset[::2], settings):
            seen = maps(sample, chosen_settings)
            table = confidence.features(*seen.given)
            if by_window:
                doublings = confidence.doublings(chosen_settings.cost.size)
                table = np.insert(table, -1, doublings, axis=2)
            for which, chosen in rows.items():
                at = np.flatnonzero(seen.known & (seen.answered == which))
                share = at.size / max(1, np.count_nonzero(seen.known)) / len(dataset[::2])
                at = rng.permutation(at)[:SAMPLE]
                if at.size:
                    counts = np.full(at.size, share / at.size)
                    chosen.append((table.reshape(-1, table.shape[2])[at], seen.errors.ravel()[at], counts))
    for which in (True, False):
        yield ordinal(*(np.concatenate(part) for part in zip(*rows[which], strict=True)))


def ordinal(seen: Floats, errors: Floats, counts: Floats) -> Floats:
    """One score for errors of all `RANKED` sizes, scaled to what makes answers `RIGHT`.

    McCullagh's proportional odds, fitted as so many logistic regressions that share all weights but the last.
    """
    bounds = len(RANKED)
    last = np.repeat(np.eye(bounds), len(seen), axis=0)
    within = np.concatenate([errors <= bound for bound in RANKED])
    shared = logistic(np.hstack([np.tile(seen[:, :-1], (bounds, 1)), last]), within, np.tile(counts, bounds))[
        :-bounds
    ]
    score = seen[:, :-1] @ shared
    scale, offset = logistic(np.stack([score, np.ones(len(seen))], axis=1), errors <= RIGHT, counts)
    return np.append(scale * shared, offset)


def logistic(seen: Floats, right: npt.NDArray[np.bool_], counts: Floats) -> Floats:
    """Weighted logistic regression by Newton's method."""
    counts = counts * (right.size / counts.sum())
    weights = np.zeros(seen.shape[1])
    for _ in range(30):
        p = 1 / (1 + np.exp(-seen @ weights))
        slope = seen.T @ (counts * (right - p)) - 1e-6 * right.size * weights
        bend = (seen * (counts * p * (1 - p))[:, None]).T @ seen + 1e-6 * right.size * np.eye(weights.size)
        weights += np.linalg.solve(bend, slope)
    return weights


ORACLES: dict[str, Callable[[Floats], Floats]] = {
    "knows which are over 1 px": lambda errors: -(errors > 1).astype(np.float64),
    "knows which are over 3 px": lambda errors: -(errors > RIGHT).astype(np.float64),
    "knows nothing": np.zeros_like,
}
"""What a confidence could be that knows so much of the truth, and no more."""


def check(found: Sequence[datasets.Dataset], settings: Settings) -> None:
    print("| benchmark | pixels | confidence | " + " | ".join(MEASURES) + " |")
    print("| --- | --- | --- " + "| ---: " * len(MEASURES) + "|")
    answers: dict[str, list[tuple[Any, Any]]] = {}
    kept: dict[str, list[Floats]] = {}
    for dataset in found:
        areas: dict[tuple[str, str], list[Floats]] = {}
        for sample in dataset[1::2]:
            seen = maps(sample, settings)
            for name, mask in (("matched", seen.known & seen.answered), ("all", seen.known)):
                errors = seen.errors[mask].astype(np.float64)[None]
                trusts = {"sharpness": np.where(seen.answered, seen.sharpness, 0)[mask][None]}
                trusts["calibrated"] = seen.probability[mask][None]
                trusts |= {how: knows(errors) for how, knows in ORACLES.items()}
                for how, trust in trusts.items():
                    areas.setdefault((name, how), []).append(area(errors, trust))
            owns = seen.answered, seen.answered & (seen.probability >= np.float32(LEAST))
            kept.setdefault(dataset.name, []).append(np.array([worth(seen, own) for own in owns]))
            right = seen.errors[seen.known] <= RIGHT
            answers.setdefault(dataset.name, []).append((seen.probability[seen.known], right))
        for (name, how), rows in areas.items():
            auc, ideal = np.mean(rows, axis=0).T
            ratios = " | ".join(f"{ratio:.2f}" for ratio in auc / ideal)
            print(f"| {dataset.name} | {name} | {how} | {ratios} |")
    print()
    everything = [pair for pairs in answers.values() for pair in pairs]
    table = reliability(*(np.concatenate(part) for part in zip(*everything, strict=True)))
    print("| confidence | share of pixels | mean confidence | right |")
    print("| --- | ---: | ---: | ---: |")
    for low, high, share, mean, right in zip(
        table.edges[:-1], table.edges[1:], table.share, table.confidence, table.correct, strict=True
    ):
        print(f"| {low:.1f} to {high:.1f} | {share:.1%} | {mean:.3f} | {right:.3f} |")
    print(f"\nexpected calibration error {table.error:.3f}")
    for name, pairs in answers.items():
        print(
            f"{name}: {reliability(*(np.concatenate(part) for part in zip(*pairs, strict=True))).error:.3f}"
        )
    print(f"\n| benchmark | matched | wrong of these | at least {LEAST} | wrong of these |")
    print("| --- | ---: | ---: | ---: | ---: |")
    for name, shares in kept.items():
        print(f"| {name} | {' | '.join(f'{share:.2%}' for share in np.mean(shares, axis=0).ravel())} |")
    print()


def worth(seen: Maps, own: npt.NDArray[np.bool_]) -> tuple[float, float]:
    """How many of the known pixels these are, and how many of them are wrong."""
    own = own[seen.known]
    return float(own.mean()), float((seen.errors[seen.known][own] > RIGHT).mean()) if own.any() else 0.0


def area(errors: Floats, trust: Floats) -> Floats:
    """Under the curve and under the ideal one, for each of `MEASURES`."""
    curves = [sparsification(errors, trust, np.zeros_like(errors), measure) for measure in MEASURES]
    return np.array([(curve.auc, curve.ideal_auc) for curve in curves])


if __name__ == "__main__":
    main()
