"""ETH3D, low-resolution two-view: grey pairs of a camera rig, indoors and outdoors.

T. Schöps et al.: A multi-view stereo benchmark with high-resolution images and multi-camera videos. CVPR
2017, doi:10.1109/CVPR.2017.272; https://www.eth3d.net/documentation. Files as those of Middlebury v3: the
truth is PFM, infinite where unknown; the mask is 255 where both cameras see; the baseline is in
millimetres. The test pairs have neither truth nor mask.
"""

from __future__ import annotations

import re

from stereopsis.datasets import middlebury
from stereopsis.datasets.folder import Folder, scenes
from stereopsis.datasets.sample import Sample

NAME = "ETH3D"
LAYOUT = (
    "SCENE_1l/im0.png, im1.png, disp0GT.pfm, mask0nocc.png, calib.txt, here or in two_view_training/ or "
    "two_view_test/, the truth also in two_view_training_gt/"
)

_PARTS = ("two_view_training", "two_view_test", "two_view_testing")


def find(folder: Folder) -> list[Sample]:
    """List the pairs of a folder, none if it is laid out otherwise."""
    if folder.name in _PARTS:
        return _part(folder, folder.parent)
    for part in _PARTS:
        if scenes(folder / part, "im0.png", "im1.png"):
            return _part(folder / part, folder)
    # The scenes' names end in a number and s or l: that alone tells the folder from Middlebury's.
    found = scenes(folder, "im0.png", "im1.png")
    mine = found and all(re.search(r"_\d[ls]$", name) for name, _ in found)
    return middlebury.listed(folder) if mine else []


def _part(pairs: Folder, above: Folder) -> list[Sample]:
    """The truth's archive is unpacked over the images', or beside them."""
    return middlebury.listed(pairs, above / f"{pairs.name}_gt")
