"""What a black border around the images costs, seen and not seen.

python benchmarks/borders.py FOLDER... [--preset NAME]... [--quality Q]

Each pair is matched as it is; with a border as the undoing of a lens leaves it (sides that bow inwards,
other widths left and right), as the presets have it; and with `blank=off`. Errors are means over the pairs,
over the pixels of known truth that both bordered images show, in per cent: D1, or of Middlebury more than
2 px; holes filled. With --quality all images go through a JPEG of that quality. The range is 0:128, or up to
Middlebury's ndisp. Then the time of one thread on a pair, bordered and not.
"""

from __future__ import annotations

import argparse
import io
import statistics
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

import stereopsis as st
from stereopsis import datasets
from stereopsis.settings import PRESETS

SIDES = (25, 5, 4, 20), (5, 28, 18, 6)
"""Left, right, top, bottom of the border around either image at its corners, in pixels."""
BOW = 12
WAYS = "no border", "border", "border, blank=off"
ROUNDS = 15


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", nargs="+", metavar="FOLDER", type=Path)
    parser.add_argument("--preset", dest="presets", action="append", default=[], metavar="NAME")
    parser.add_argument("--quality", type=int)
    options = parser.parse_args()
    presets = options.presets or ["fast", "balanced", "accurate", "local"]
    found = [datasets.open(folder) for folder in options.folders]
    print(f"| preset | {' | '.join(f'{dataset.name}: {way}' for dataset in found for way in WAYS)} |")
    print(f"| --- |{' ---: |' * len(found) * len(WAYS)}")
    for preset in presets:
        cells = []
        for dataset in found:
            errors = np.array([measure(sample, preset, options.quality) for sample in dataset])
            cells += [f"{100 * error:.2f}" for error in errors.mean(axis=0)]
        print(f"| {preset} | {' | '.join(cells)} |", flush=True)
    pair = found[0][0].pair()
    print("\n| preset | ms, no border | ms, border |\n| --- | ---: | ---: |")
    for preset in presets:
        print(f"| {preset} | {' | '.join(f'{1000 * value:.1f}' for value in times(pair, preset))} |")


def outline(shape: tuple[int, ...], sides: tuple[int, int, int, int]) -> npt.NDArray[np.bool_]:
    """Where the border lies."""
    height, width = shape[:2]
    y, x = np.ogrid[:height, :width]
    left, right, top, bottom = sides
    across, down = BOW * np.sin(x / width * np.pi), BOW * np.sin(y / height * np.pi)
    return (
        (x < left + down) | (x >= width - right - down) | (y < top + across) | (y >= height - bottom - across)
    )


def bordered(pair: st.Pair) -> list[npt.NDArray[np.uint8]]:
    """Both images with their borders."""
    images = []
    for image, sides in zip((pair.left, pair.right), SIDES, strict=True):
        hidden = outline(image.shape, sides)
        images.append(image.copy())
        images[-1][hidden] = 0
    return images


def measure(sample: datasets.Sample, preset: str, quality: int | None) -> list[float]:
    """The share of wrong pixels, for each way."""
    pair, truth, mask = sample.pair(), sample.truth(), sample.mask()
    assert truth is not None
    ndisp = pair.calibration.ndisp if pair.calibration else None
    here, there = (outline(pair.left.shape, sides) for sides in SIDES)
    known = np.isfinite(truth) & ~here if mask is None else np.isfinite(truth) & mask & ~here
    y, x = np.nonzero(known)
    match = np.rint(x - truth[y, x]).astype(int)
    known[y, x] = (match >= 0) & ~there[y, match.clip(0)]
    plain = [read(image, quality) for image in (pair.left, pair.right)]
    with_borders = [read(image, quality) for image in bordered(pair)]
    chosen = PRESETS[preset].changed(disparities=(0, ndisp or 128), fill=PRESETS[preset].fill or "background")
    shares = []
    for (left, right), blank in ((plain, True), (with_borders, True), (with_borders, False)):
        found = st.match(st.Pair(left, right, pair.calibration), settings=chosen.changed(blank=blank))
        off = np.abs(found.disparity - truth)[known]
        wrong = off > 2 if ndisp else (off > 3) & (off > 0.05 * truth[known])
        shares.append(float(np.mean(wrong)))
    return shares


def read(image: npt.NDArray[np.uint8], quality: int | None) -> npt.NDArray[np.uint8]:
    """The image as it comes back from a JPEG."""
    if quality is None:
        return image
    file = io.BytesIO()
    Image.fromarray(image).save(file, "jpeg", quality=quality)
    return np.asarray(Image.open(file))


def times(pair: st.Pair, preset: str) -> tuple[float, float]:
    """Seconds of one thread, without borders and with them."""
    with_borders = bordered(pair)
    chosen = PRESETS[preset].changed(disparities=(0, 128), threads=1)
    rows = []
    for _ in range(ROUNDS):
        rows.append(
            (st.match(pair, settings=chosen).seconds, st.match(*with_borders, settings=chosen).seconds)
        )
    without, within = (statistics.median(column) for column in zip(*rows, strict=True))
    return without, within


if __name__ == "__main__":
    main()
