"""Middlebury v3: the training scenes at full, half or quarter size.

D. Scharstein et al.: High-resolution stereo datasets with subpixel-accurate ground truth. GCPR 2014,
doi:10.1007/978-3-319-11752-2_3.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from stereopsis import io
from stereopsis.datasets.sample import Mask, Sample, present, views

NAME = "Middlebury v3"
LAYOUT = "SCENE/im0.png, im1.png, disp0GT.pfm, mask0nocc.png, calib.txt, here or in trainingF/, H/ or Q/"


def find(folder: Path) -> tuple[Sample, ...]:
    """List the scenes of a folder, none if it is laid out otherwise."""
    samples = _scenes(folder)
    if samples:
        return samples
    sizes = {
        name: found for name in ("trainingF", "trainingH", "trainingQ") if (found := _scenes(folder / name))
    }
    if len(sizes) > 1:
        raise ValueError(f"{folder} holds {', '.join(sizes)}: open one of them")
    return next(iter(sizes.values()), ())


def _scenes(root: Path) -> tuple[Sample, ...]:
    return tuple(_sample(left.parent) for left in sorted(root.glob("*/im0.png")))


def _sample(scene: Path) -> Sample:
    mask = present(scene / "mask0nocc.png")
    return Sample(
        scene.name,
        *views(scene / "im0.png", scene / "im1.png"),
        truth_file=present(scene / "disp0GT.pfm"),
        calibration_file=present(scene / "calib.txt"),
        read_mask=partial(_visible, mask) if mask else None,
    )


def _visible(file: Path) -> Mask:
    """Read a mask: 255 where both cameras see, 128 where only the left one does, 0 where that is unknown."""
    mask = io.read_image(file)
    if mask.ndim != 2:
        raise ValueError(f"{file} must be a grey mask, not an image of shape {mask.shape}")
    seen: Mask = mask == 255
    return seen
