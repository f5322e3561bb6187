"""Measure what finds the pixels that cannot be matched; print tables that can be pasted into a page.

python benchmarks/invalid.py flags [--seeds N]
python benchmarks/invalid.py refusals FOLDER... [--pairs N]
python benchmarks/invalid.py confidence FOLDER... [--pairs N]

"flags": precision (P) and recall (R) of each flag on rendered streets, whose truth is exact.
"refusals": of the pixels of a pair whose truth is known (the sky's is not), the share that each check alone
refuses, and the share of those that plain matching gets wrong by more than 1 and 3 px.
"confidence": the plain winners of a pair (zncc 25 x 9, 0:128, no check) are removed in the order of
each confidence; the area under the curve of what remains. Every number is a mean, over the seeds or over the
pairs, and its standard deviation.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import stereopsis as st
from stereopsis import cost, datasets, select, validate

Bools = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]
Table = dict[str, list[tuple[float, ...]]]

WINDOW = (25, 9)
OPTIONS: Mapping[str, dict[str, float | bool]] = {
    "clear": {},
    "grey": {"gray": True},
    "noise 4": {"noise": 4.0},
    "noise 10": {"noise": 10.0},
    "fog 0.02": {"fog": 0.02},
    "rain 0.6": {"rain": 0.6},
    "low light 0.7": {"low_light": 0.7},
    "low texture 0.8": {"low_texture": 0.8},
    "exposure 0.7": {"exposure": 0.7},
}
GLOSS = (0.0, 0.3, 0.6)
CHECKS: Mapping[str, tuple[st.Flag, dict[str, Any]]] = {
    "left_right 1, occluded": (st.Flag.OCCLUDED, {"left_right": 1}),
    "left_right 1, mismatched": (st.Flag.MISMATCHED, {"left_right": 1}),
    "uniqueness 2": (st.Flag.AMBIGUOUS, {"uniqueness": 2}),
    "texture 0.3": (st.Flag.LOW_TEXTURE, {"texture": 0.3}),
    "texture auto": (st.Flag.LOW_TEXTURE, {"texture": "auto"}),
    "reflection 4": (st.Flag.MISMATCHED, {"reflection": 4}),
    "reflection 8": (st.Flag.MISMATCHED, {"reflection": 8}),
    "sky": (st.Flag.SKY, {"preset": "fast", "sky": True}),
}
MEASURES = ("bad-1", "bad-3", "epe")


def main(arguments: Sequence[str] | None = None) -> None:
    options = parse(arguments)
    if options.what == "flags":
        print(flags(options.seeds))
    else:
        tables = {"refusals": refusals, "confidence": confidences}[options.what]
        print("\n\n".join(tables(folder, options.pairs) for folder in options.folders))


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    summary, _, rest = (__doc__ or "").partition("\n")
    parser = argparse.ArgumentParser(description=summary, epilog=rest.rpartition("\n\n")[2])
    what = parser.add_subparsers(dest="what", required=True)
    of_flags = what.add_parser("flags")
    of_flags.add_argument("--seeds", type=int, default=4, metavar="N", help="streets 0 ... N - 1")
    for name in ("refusals", "confidence"):
        of_pairs = what.add_parser(name)
        of_pairs.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
        of_pairs.add_argument("--pairs", type=int, metavar="N", help="the first N of each; default all")
    return parser.parse_args(arguments)


# ---- flags on rendered streets -------------------------------------------------------------------


def flags(seeds: int) -> str:
    scenes: Table = {}
    glossy: Table = {}
    for name, option in OPTIONS.items():
        for seed in range(seeds):
            report(f"{name}, seed {seed}")
            scenes.setdefault(name, []).append(scene_row(seed, option))
    for share in GLOSS:
        for seed in range(seeds):
            report(f"gloss {share}, seed {seed}")
            glossy.setdefault(f"gloss {share}", []).append(gloss_row(seed, share))
    report("")
    heads = "sky P", "sky R", "auto P", "R", "image alone P", "R", "occluded P", "R", "refused R"
    more = "to refuse, share", "texture 0.3 P", "R", "texture auto P", "R"
    return "\n\n".join(
        [table(f"{seeds} streets", [*heads, *more], scenes), table(f"{seeds} streets", GLOSS_HEADS, glossy)]
    )


def scene_row(seed: int, option: dict[str, Any]) -> tuple[float, ...]:
    scene = st.scenes.street(880, 400, seed, samples=1, **option)
    fast = st.match(scene.pair, preset="fast", disparities=(0, 128), texture=None, sky=True)
    accurate = st.match(scene.pair, preset="accurate", disparities=(0, 128))
    alone = st.match(scene.pair, disparities=(0, 128), cost=st.ZNCC(WINDOW), sky=True)
    plain = st.match(scene.pair, disparities=(0, 128), cost=st.ZNCC(WINDOW))
    solid = ~scene.sky
    numbers = [
        *rates(flagged(fast, st.Flag.SKY), scene.sky),
        *rates(flagged(accurate, st.Flag.SKY), scene.sky),
        *rates(flagged(alone, st.Flag.SKY), scene.sky),
        *rates(flagged(fast, st.Flag.OCCLUDED)[solid], scene.occluded[solid]),
        # Whatever the reason that was given: a hidden pixel must not keep an answer.
        rates(np.isnan(fast.disparity)[solid], scene.occluded[solid])[1],
    ]
    # Right to refuse for want of texture is what has no surface, or what plain matching gets wrong.
    with np.errstate(invalid="ignore"):
        wrong = scene.sky | (~scene.occluded & ~(np.abs(plain.disparity - scene.disparity) <= 1))
    judged = ~scene.occluded
    numbers.append(float(wrong[judged].mean()))
    for texture in (0.3, "auto"):
        found = st.match(scene.pair, disparities=(0, 128), cost=st.ZNCC(WINDOW), texture=texture)
        numbers += rates(flagged(found, st.Flag.LOW_TEXTURE)[judged], wrong[judged])
    return tuple(numbers)


GLOSS_HEADS = (
    "glossy, share",
    "bad-1 there",
    *(f"reflection {bound} {rate}" for bound in (4, 8, 16) for rate in "PR"),
    "bad-1 of those at 8",
)


def gloss_row(seed: int, share: float) -> tuple[float, ...]:
    scene = st.scenes.street(880, 400, seed, samples=1, noise=1.5)
    left, right, glossy = gloss(scene, share)
    found = st.match(left, right, preset="fast", disparities=(0, 128), keep="unfiltered")
    disparity = found.stages["unfiltered"]
    judged = np.isfinite(disparity) & ~scene.sky
    with np.errstate(invalid="ignore"):
        wrong = np.abs(disparity - scene.disparity) > 1
    pixels = cost.pixels(left, right)
    apart = validate.brightness(pixels.left, pixels.right, disparity, WINDOW)
    numbers = [float(glossy[judged].mean()), float(wrong[judged & glossy].mean())]
    for bound in (4, 8, 16):
        numbers += rates((apart > bound)[judged], glossy[judged])
    numbers.append(rates((apart > 8)[judged], wrong[judged])[0])
    return tuple(numbers)


def gloss(scene: st.scenes.Scene, share: float) -> tuple[st.types.Image, st.types.Image, Bools]:
    """Lay a mirror image over bodywork, glass and signs: it lies farther than they do, and so moves less."""
    glossy = ~scene.textured & ~scene.sky
    height, width = glossy.shape
    # Blotches of some ten pixels.
    mirrored = np.random.default_rng(7).random((height, 2 * width))
    for axis in (0, 1) * 6:
        mirrored = (np.roll(mirrored, 2, axis) + mirrored + np.roll(mirrored, -2, axis)) / 3
    mirrored = 255 * np.clip(0.5 + (mirrored - mirrored.mean()) / (4 * mirrored.std()), 0, 1)
    x = np.arange(width, dtype=np.float64)
    behind = np.nan_to_num(scene.right_disparity).astype(np.float64)
    source = np.rint(x + behind).astype(np.int64)
    seen = np.clip(source, 0, width - 1)
    same = np.abs(np.take_along_axis(np.nan_to_num(scene.disparity), seen, axis=1) - behind) < 1
    glossy_right = np.take_along_axis(glossy, seen, axis=1) & same & (source < width)

    def laid(image: st.types.Image, where: Bools, at: Floats) -> st.types.Image:
        first = np.clip(at.astype(np.int64), 0, 2 * width - 2)
        part = at - first
        layer = np.take_along_axis(mirrored, first, 1) * (1 - part)
        layer += np.take_along_axis(mirrored, first + 1, 1) * part
        mixed = image.astype(np.float64)
        mixed[where] = (1 - share) * mixed[where] + share * layer[where][:, None]
        return np.rint(mixed).astype(np.uint8)

    left = laid(scene.left, glossy, np.broadcast_to(x, glossy.shape))
    return left, laid(scene.right, glossy_right, x + 0.3 * behind), glossy


def flagged(result: st.Result, flag: st.Flag) -> Bools:
    return (result.flags & flag) != 0


def rates(found: Bools, truth: Bools) -> tuple[float, float]:
    """Precision and recall; NaN where there is nothing to find, or nothing found."""
    both = float((found & truth).sum())
    return tuple(both / n if n else np.nan for n in (int(found.sum()), int(truth.sum())))  # type: ignore[return-value]


# ---- checks on real pairs -------------------------------------------------------------------------


def refusals(folder: Path, pairs: int | None) -> str:
    dataset = datasets.open(folder)
    rows: Table = {}
    for number, sample in enumerate(dataset[:pairs] if pairs else dataset, start=1):
        report(f"{dataset.name} {number}")
        pair, truth, mask = sample.pair(), sample.truth(), sample.mask()
        assert truth is not None
        known = np.isfinite(truth) if mask is None else np.isfinite(truth) & mask
        plain = st.match(pair, cost=st.ZNCC(WINDOW), disparities=(0, 128))
        error = np.abs(plain.disparity - truth)[known]
        rows.setdefault("none", []).append((1.0, float(np.mean(error > 1)), float(np.mean(error > 3))))
        for name, (flag, check) in CHECKS.items():
            result = st.match(pair, **{"cost": st.ZNCC(WINDOW), "disparities": (0, 128), **check})
            found = flagged(result, flag)[known]
            wrong = (float(np.mean(error[found] > bound)) if found.any() else np.nan for bound in (1, 3))
            rows.setdefault(name, []).append((float(found.mean()), *wrong))
    report("")
    return table(f"{dataset.name}, {len(rows['none'])} pairs", ["refused", "bad-1", "bad-3"], rows)


# ---- confidence on real pairs --------------------------------------------------------------------


def confidences(folder: Path, pairs: int | None) -> str:
    dataset = datasets.open(folder)
    areas: Table = {}
    for number, sample in enumerate(dataset[:pairs] if pairs else dataset, start=1):
        report(f"{dataset.name} {number}")
        pair, truth, mask = sample.pair(), sample.truth(), sample.mask()
        assert truth is not None
        result = st.match(
            pair, cost=st.ZNCC(WINDOW), disparities=(0, 128), keep=("costs", "right_disparity", "texture")
        )

        def curve(confidence: Any, measure: str) -> st.Sparsification:
            trust = np.asarray(confidence, np.float64)
            return st.sparsification(result.disparity, trust, truth, measure, mask)  # noqa: B023

        for name, confidence in measures(result).items():
            areas.setdefault(name, []).append(tuple(curve(confidence, m).auc for m in MEASURES))
        ideal = [curve(result.confidence, m) for m in MEASURES]
        areas.setdefault("*ideal*", []).append(tuple(c.ideal_auc for c in ideal))
        areas.setdefault("*none: error at full density*", []).append(tuple(c.random_auc for c in ideal))
    report("")
    return table(f"{dataset.name}, {len(areas['today'])} pairs", [f"AUC {m}" for m in MEASURES], areas)


def measures(result: st.Result) -> dict[str, Floats | npt.NDArray[np.float32]]:
    """Confidences of Hu and Mordohai's list that need no second pass; higher is better."""
    assert result.settings.disparities is not None
    volume, first = result.stages["costs"], result.settings.disparities.min
    winners = select.left(volume, first)
    best, before, after, second = (
        part.astype(np.float64) for part in (winners.cost, winners.before, winners.after, winners.second)
    )
    sides = (before, after), (after, before)
    before, after = (np.where(np.isfinite(side), side, other) for side, other in sides)
    before, after = (np.where(np.isfinite(side), side, best) for side in (before, after))  # a lone candidate
    second = np.where(np.isfinite(second), second, np.maximum(before, after))
    index = winners.index.astype(np.int64) + first
    there = np.clip(np.arange(index.shape[1]) - index, 0, index.shape[1] - 1)
    apart = 1 + np.abs(np.take_along_axis(result.stages["right_disparity"], there, 1) - index)
    margin = second - best
    ratio = margin / np.maximum(second + 1, 1e-9)
    return {
        "today": result.confidence,
        "score": -best,
        "curvature": before + after - 2 * best,
        "margin": margin,
        "ratio": ratio,
        "left-right": 1 / apart,
        "texture": result.stages["texture"],
        "today / left-right": result.confidence / apart,
        "ratio / left-right": ratio / apart,
        "margin / left-right": margin / apart,
        "score margin / left-right": np.clip(-best, 0, 1) * margin / apart,
    }


# ---- tables --------------------------------------------------------------------------------------


def table(corner: str, heads: Sequence[str], rows: Table) -> str:
    lines = [[corner, *heads], ["---"] + ["---:"] * len(heads)]
    for name, found in rows.items():
        values = np.array(found, np.float64)
        cells = []
        for column in values.T:
            known = column[np.isfinite(column)]
            cells.append(f"{known.mean():.3f} ± {known.std():.3f}" if known.size else "-")
        lines.append([name, *cells])
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def report(text: str) -> None:
    if sys.stderr.isatty():
        print(f"\r\033[K{text}", end="", file=sys.stderr)


if __name__ == "__main__":
    try:
        main()
    except (ValueError, TypeError, OSError) as error:
        sys.exit(f"error: {error}")
