"""Middlebury v3: the training and test scenes at full, half or quarter size.

D. Scharstein et al.: High-resolution stereo datasets with subpixel-accurate ground truth. GCPR 2014,
doi:10.1007/978-3-319-11752-2_3; https://vision.middlebury.edu/stereo/submit3. The truth is PFM, infinite
where unknown. The mask is 255 where both cameras see, 128 where only the left one does, 0 where that is
unknown. The test scenes have neither.
"""

from __future__ import annotations

from stereopsis.datasets.folder import Folder, only_one, scenes
from stereopsis.datasets.readers import White
from stereopsis.datasets.sample import Sample

NAME = "Middlebury v3"
LAYOUT = (
    "SCENE/im0.png, im1.png, disp0GT.pfm, mask0nocc.png, calib.txt, here or in trainingF/, H/ or Q/ or "
    "testF/, H/ or Q/, or in MiddEval3/"
)


def find(folder: Folder) -> list[Sample]:
    """List the scenes of a folder, none if it is laid out otherwise."""
    for root in (folder, folder / "MiddEval3"):
        for part in ("training", "test"):
            size = only_one(root, [f"{part}{letter}" for letter in "FHQ"])
            if size:
                return listed(size)
    return listed(folder)


def listed(root: Folder, truths: Folder | None = None) -> list[Sample]:
    """List the scenes of this layout, which is ETH3D's too; their truths may be in folders of their own."""
    return [
        _sample(name, scene, (truths / name) if truths else scene)
        for name, scene in scenes(root, "im0.png", "im1.png")
    ]


def _sample(name: str, scene: Folder, truth: Folder) -> Sample:
    mask = truth.file("mask0nocc.png")
    return Sample(
        name,
        scene.path / "im0.png",
        scene.path / "im1.png",
        truth.file("disp0GT.pfm"),
        scene.file("calib.txt"),
        read_mask=White(mask) if mask else None,
    )
