"""KITTI 2015 (scene flow): the first frames of its colour pairs.

M. Menze, A. Geiger: Object scene flow for autonomous vehicles. CVPR 2015, doi:10.1109/CVPR.2015.7298925.
The truth is ``disp_occ_0``, of which ``disp_noc_0`` leaves out what the right camera does not see; where only
the latter is there, it is the truth.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from stereopsis import io
from stereopsis.datasets.sample import Mask, Sample, present, views

NAME = "KITTI 2015"
LAYOUT = "image_2/NAME_10.png, image_3/NAME_10.png, disp_occ_0 and disp_noc_0 likewise, here or in training/"


def find(folder: Path) -> tuple[Sample, ...]:
    """List the pairs of a folder, none if it is laid out otherwise."""
    root = folder if (folder / "image_2").is_dir() else folder / "training"
    # The second frames, NAME_11, have no truth of their own.
    return tuple(_sample(root, left) for left in sorted((root / "image_2").glob("*_10.png")))


def _sample(root: Path, left: Path) -> Sample:
    every = present(root / "disp_occ_0" / left.name)
    visible = present(root / "disp_noc_0" / left.name)
    return Sample(
        left.stem,
        *views(left, root / "image_3" / left.name),
        truth_file=every or visible,
        calibration_file=present(root / "calib_cam_to_cam" / f"{left.stem.removesuffix('_10')}.txt"),
        read_mask=partial(_known, visible) if every and visible else None,
    )


def _known(file: Path) -> Mask:
    return np.isfinite(io.read_disparity(file))
