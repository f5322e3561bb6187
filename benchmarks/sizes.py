"""What the presets make of smaller images, and what the planar filter's tolerance has to do with it.

python benchmarks/sizes.py FOLDER... [--preset NAME]... [--factor 0.25]...

Both images of each pair are reduced by so much (mean of the pixels), matched over the range reduced alike,
and the map is brought back to full size, by the nearest pixel. Errors are means over the pairs, over all
known pixels in per cent, holes filled: D1 at full size, or of Middlebury more than 2 px. The range is 0:128,
or up to Middlebury's ndisp. Beside each preset the same with the tolerance of large images whatever the size.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from unittest import mock

import numpy as np
import numpy.typing as npt
from PIL import Image

import stereopsis as st
from stereopsis import datasets, refine
from stereopsis.settings import PRESETS


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", nargs="+", metavar="FOLDER", type=Path)
    parser.add_argument("--preset", dest="presets", action="append", default=[], metavar="NAME")
    parser.add_argument("--factor", dest="factors", action="append", default=[], type=float)
    options = parser.parse_args()
    presets = options.presets or ["balanced", "accurate"]
    factors = options.factors or [0.25, 0.35, 0.5, 1.0]
    found = [datasets.open(folder) for folder in options.folders]
    sizes = [f"{dataset.name} x {factor:g}" for dataset in found for factor in factors]
    print(f"| preset | {' | '.join(sizes)} |")
    print(f"| --- |{' ---: |' * len(sizes)}")
    for preset in presets:
        for name, columns in ((preset, refine.PLANAR_COLUMNS), (f"{preset}, always 1.5 px", 1)):
            with mock.patch.object(refine, "PLANAR_COLUMNS", columns):
                errors = [
                    np.mean([measure(sample, preset, factor) for sample in dataset])
                    for dataset in found
                    for factor in factors
                ]
            print(f"| {name} | {' | '.join(f'{100 * error:.2f}' for error in errors)} |", flush=True)


def measure(sample: datasets.Sample, preset: str, factor: float) -> float:
    """The share of wrong pixels."""
    pair, truth, mask = sample.pair(), sample.truth(), sample.mask()
    assert truth is not None
    known = np.isfinite(truth) if mask is None else np.isfinite(truth) & mask
    ndisp = pair.calibration.ndisp if pair.calibration else None
    small = [reduced(image, factor) for image in (pair.left, pair.right)]
    disparities = 0, math.ceil((ndisp or 128) * factor)
    chosen = PRESETS[preset].changed(disparities=disparities, fill=PRESETS[preset].fill or "background")
    found = st.match(*small, settings=chosen).disparity
    rows, columns = (
        np.minimum(((np.arange(full) + 0.5) * few / full).astype(int), few - 1)
        for full, few in zip(truth.shape, found.shape, strict=True)
    )
    across = truth.shape[1] / found.shape[1]
    off = np.abs(found[np.ix_(rows, columns)] * across - truth)[known]
    return float(np.mean(off > 2 if ndisp else (off > 3) & (off > 0.05 * truth[known])))


def reduced(image: npt.NDArray[np.uint8], factor: float) -> npt.NDArray[np.uint8]:
    height, width = (round(side * factor) for side in image.shape[:2])
    return np.asarray(Image.fromarray(image).resize((width, height), Image.Resampling.BOX))


if __name__ == "__main__":
    main()
