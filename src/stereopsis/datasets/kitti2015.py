"""KITTI 2015 (scene flow): the first frames of its colour pairs.

M. Menze, A. Geiger: Object scene flow for autonomous vehicles. CVPR 2015, doi:10.1109/CVPR.2015.7298925;
https://www.cvlibs.net/datasets/kitti/eval_scene_flow.php?benchmark=stereo. The truth is ``disp_occ_0``, of
which ``disp_noc_0`` leaves out what the right camera does not see; where only the latter is there, it is the
truth. 16 bits, 256 times the disparity, 0 where unknown. The testing pairs have none.
"""

from __future__ import annotations

from collections.abc import Iterator

from stereopsis.datasets.folder import Folder, in_either
from stereopsis.datasets.readers import Known
from stereopsis.datasets.sample import Sample

NAME = "KITTI 2015"
LAYOUT = (
    "image_2/NAME_10.png, image_3/NAME_10.png, disp_occ_0 and disp_noc_0 likewise, here or in training/ "
    "or testing/"
)


def find(folder: Folder) -> list[Sample]:
    """List the pairs of a folder, none if it is laid out otherwise."""
    return next(filter(None, (list(_pairs(root)) for root in parts(folder))), [])


def parts(folder: Folder) -> Iterator[Folder]:
    """Where KITTI's folders may be: training before testing, which has the same names and no truth."""
    yield from (folder, folder / "training", folder / "testing")


def _pairs(root: Folder) -> Iterator[Sample]:
    for file in in_either(root / "image_2", root / "image_3"):
        # The second frames, NAME_11, have no truth of their own.
        if not file.endswith("_10.png"):
            continue
        left = root.path / "image_2" / file
        every = (root / "disp_occ_0").file(file)
        visible = (root / "disp_noc_0").file(file)
        yield Sample(
            left.stem,
            left,
            root.path / "image_3" / file,
            every or visible,
            (root / "calib_cam_to_cam").file(f"{left.stem.removesuffix('_10')}.txt"),
            read_mask=Known(visible) if every and visible else None,
        )
