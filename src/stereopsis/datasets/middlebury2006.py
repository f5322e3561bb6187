"""Middlebury 2005 and 2006: views 1 and 5 at full, half or third size, in every light and exposure.

D. Scharstein, C. Pal: Learning conditional random fields for stereo. CVPR 2007, doi:10.1109/CVPR.2007.383191;
H. Hirschmüller, D. Scharstein: Evaluation of cost functions for stereo matching. CVPR 2007,
doi:10.1109/CVPR.2007.383248; https://vision.middlebury.edu/stereo/data/scenes2005 and scenes2006. The truth
has 8 bits, 0 where unknown: the disparity at full size, twice it at half size, three times it at third size.
The images were cropped: the disparity at infinity is minus ``dmin.txt``, in pixels of the full size. The
focal length is 3740 pixels of the full size and the baseline 160 mm; the principal point is not given, and
the middle of the image stands for it. Both cameras see the pixels in which the two truths agree.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from stereopsis import io
from stereopsis._files import read
from stereopsis.datasets.folder import Folder, only_one
from stereopsis.datasets.readers import consistent, integers
from stereopsis.datasets.sample import Sample
from stereopsis.io._errors import naming
from stereopsis.io.calibration import MAX_BYTES
from stereopsis.types import Calibration, DisparityMap

NAME = "Middlebury 2005/2006"
LAYOUT = (
    "SCENE/view1.png, view5.png, or SCENE/IllumN/ExpN/view1.png, view5.png, with disp1.png, disp5.png, "
    "dmin.txt in SCENE, here or in FullSize/, HalfSize/ or ThirdSize/"
)

_SIZES = {"fullsize": 1, "halfsize": 2, "thirdsize": 3}
_HEIGHTS = {1110: 1, 555: 2, 370: 3}


def find(folder: Folder) -> list[Sample]:
    """List the pairs of a folder, none if it is laid out otherwise."""
    root = only_one(folder, ["FullSize", "HalfSize", "ThirdSize"]) or folder
    found = [pair for scene in root.folders for pair in _scene(scene)]
    return found or list(_scene(root))


def _scene(scene: Folder) -> Iterator[Sample]:
    exposures = [exposure for light in scene.folders for exposure in light.folders]
    for images in (scene, *exposures):
        if images.file("view1.png", "view5.png") is None:
            continue
        truth, other = scene.file("disp1.png"), scene.file("disp5.png")
        below = images.path.relative_to(scene.path).as_posix()
        yield Sample(
            scene.name if images is scene else f"{scene.name}/{below}",
            images.path / "view1.png",
            images.path / "view5.png",
            truth,
            scene.file("dmin.txt"),
            read_mask=consistent(truth, other, read_truth),
            read_truth=read_truth,
            read_calibration=read_calibration,
        )


def read_truth(file: Path) -> DisparityMap:
    """Read ``disp1.png`` or ``disp5.png``."""
    return io.read_disparity(file, f"middlebury:{_divisor(file, len(integers(file, np.uint8)))}")


def read_calibration(file: Path) -> Calibration:
    """Read ``dmin.txt``, beside which the truth tells the size of the images."""
    data = read(file, MAX_BYTES, "a calibration")
    with naming(file):
        smallest = float(data.decode("ascii"))
    height, width = integers(file.with_name("disp1.png"), np.uint8).shape
    divisor = _divisor(file, height)
    return Calibration(
        focal=3740 / divisor,
        cx=(width - 1) / 2,
        cy=(height - 1) / 2,
        baseline=0.16,
        doffs=smallest / divisor,
    )


def _divisor(file: Path, height: int) -> int:
    """By how much the scene was scaled down, as a folder's name says, or else the images' height."""
    named = [_SIZES[part.lower()] for part in file.parts if part.lower() in _SIZES]
    if not named and height not in _HEIGHTS:
        raise ValueError(
            f"{file} has {height} rows, not those of the full, half or third size, 1110, 555 or 370, and no "
            "folder is named FullSize, HalfSize or ThirdSize"
        )
    return named[-1] if named else _HEIGHTS[height]
