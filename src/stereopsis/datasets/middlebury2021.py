"""Middlebury 2014 and 2021 (mobile): scenes with the truth of both views.

D. Scharstein et al.: High-resolution stereo datasets with subpixel-accurate ground truth. GCPR 2014,
doi:10.1007/978-3-319-11752-2_3; G. Pan, T. Sun, T. Weed, D. Scharstein: Mobile stereo datasets, 2021;
https://vision.middlebury.edu/stereo/data/scenes2014 and scenes2021. The
truth is PFM, infinite where unknown. Both cameras see the pixels in which the two truths agree.
"""

from __future__ import annotations

from stereopsis.datasets.folder import Folder, scenes
from stereopsis.datasets.readers import consistent
from stereopsis.datasets.sample import Sample

NAME = "Middlebury 2014/2021"
LAYOUT = "SCENE/im0.png, im1.png, disp0.pfm, disp1.pfm, calib.txt, here or in data/"


def find(folder: Folder) -> list[Sample]:
    """List the scenes of a folder, none if it is laid out otherwise."""
    found = [scenes(root, "im0.png", "im1.png", "disp0.pfm") for root in (folder, folder / "data")]
    return [_sample(name, scene) for name, scene in found[0] or found[1]]


def _sample(name: str, scene: Folder) -> Sample:
    truth, other = scene.path / "disp0.pfm", scene.file("disp1.pfm")
    return Sample(
        name,
        scene.path / "im0.png",
        scene.path / "im1.png",
        truth,
        scene.file("calib.txt"),
        read_mask=consistent(truth, other),
    )
