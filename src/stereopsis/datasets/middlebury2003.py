"""Middlebury v2: the scenes of 2001 and 2003.

D. Scharstein, R. Szeliski: A taxonomy and evaluation of dense two-frame stereo correspondence algorithms.
IJCV 47, 2002, doi:10.1023/A:1014573219977; High-accuracy stereo depth maps using structured light. CVPR
2003, doi:10.1109/CVPR.2003.1211354; https://vision.middlebury.edu/stereo/data/scenes2001 and scenes2003.
The truth has 8 bits, 0 where unknown: 8 times the disparity in 2001, but 16 times in Tsukuba; 4 times it
in 2003 at quarter size, 2 times at half size, as it is at full size. Both cameras see the pixels in which
the two truths agree.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from stereopsis import io
from stereopsis.datasets.folder import Folder
from stereopsis.datasets.readers import consistent, integers
from stereopsis.datasets.sample import Sample
from stereopsis.types import DisparityMap

NAME = "Middlebury 2001/2003"
LAYOUT = (
    "SCENE/im2.ppm, im6.ppm, disp2.pgm, disp6.pgm, or .png; map/im0.pgm, im1.pgm, disp0.pgm, disp1.pgm; "
    "tsukuba/scene1.row3.col3.ppm, scene1.row3.col4.ppm, truedisp.row3.col3.pgm"
)

# Left and right view, left and right truth.
_FILES = (
    ("im2", "im6", "disp2", "disp6"),
    ("im0", "im1", "disp0", "disp1"),
    ("scene1.row3.col3", "scene1.row3.col4", "truedisp.row3.col3", None),
)
# Factor of the truth by the rows of the image: 2003's three sizes, Tsukuba; the rest are of 2001.
_FACTORS = {375: 4, 750: 2, 1500: 1, 288: 16}


def find(folder: Folder) -> list[Sample]:
    """List the scenes of a folder, none if it is laid out otherwise."""
    found = [pair for scene in folder.folders for pair in _scene(scene)]
    return found or list(_scene(folder))


def _scene(scene: Folder) -> Iterator[Sample]:
    for left_name, right_name, truth_name, other_name in _FILES:
        view = _file(scene, left_name) or _file(scene, right_name)
        truth = _file(scene, truth_name)
        if view and truth:
            other = _file(scene, other_name) if other_name else None
            yield Sample(
                scene.name,
                view.with_name(f"{left_name}{view.suffix}"),
                view.with_name(f"{right_name}{view.suffix}"),
                truth,
                read_mask=consistent(truth, other, read_truth),
                read_truth=read_truth,
            )
            return


def _file(scene: Folder, stem: str) -> Path | None:
    return scene.file(f"{stem}.png", f"{stem}.ppm", f"{stem}.pgm")


def read_truth(file: Path) -> DisparityMap:
    """Read a truth, whose factor its size tells."""
    factor = _FACTORS.get(len(integers(file, np.uint8)), 8)
    return io.read_disparity(file, f"middlebury:{factor}")
