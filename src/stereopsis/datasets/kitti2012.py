"""KITTI 2012 (stereo and flow): the first frames, in colour where they are there, else in grey.

A. Geiger, P. Lenz, R. Urtasun: Are we ready for autonomous driving? The KITTI vision benchmark suite. CVPR
2012, doi:10.1109/CVPR.2012.6248074; https://www.cvlibs.net/datasets/kitti/eval_stereo_flow.php. The truth is
``disp_occ``, of which ``disp_noc`` leaves out what the right camera does not see; 16 bits, 256 times the
disparity, 0 where unknown. The testing pairs have none.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from stereopsis import io
from stereopsis.datasets.folder import Folder, in_either
from stereopsis.datasets.kitti2015 import parts
from stereopsis.datasets.readers import Known
from stereopsis.datasets.sample import Sample
from stereopsis.types import Calibration

NAME = "KITTI 2012"
LAYOUT = (
    "colored_0/NAME_10.png and colored_1, or image_0 and image_1, disp_occ, disp_noc, calib/NAME.txt, "
    "here or in training/ or testing/"
)


def find(folder: Folder) -> list[Sample]:
    """List the pairs of a folder, none if it is laid out otherwise."""
    return next(filter(None, (list(_pairs(root)) for root in parts(folder))), [])


def _pairs(root: Folder) -> Iterator[Sample]:
    colour = bool(root / "colored_0")
    lefts, rights = ("colored_0", "colored_1") if colour else ("image_0", "image_1")
    for file in in_either(root / lefts, root / rights):
        if not file.endswith("_10.png"):
            continue
        left = root.path / lefts / file
        every = (root / "disp_occ").file(file)
        visible = (root / "disp_noc").file(file)
        yield Sample(
            left.stem,
            left,
            root.path / rights / file,
            every or visible,
            (root / "calib").file(f"{left.stem.removesuffix('_10')}.txt"),
            read_mask=Known(visible) if every and visible else None,
            read_calibration=_of_colour if colour else _of_grey,
        )


def _of_colour(file: Path) -> Calibration:
    return io.read_calibration(file, cameras=(2, 3))


def _of_grey(file: Path) -> Calibration:
    return io.read_calibration(file, cameras=(0, 1))
