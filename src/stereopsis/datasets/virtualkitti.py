"""Virtual KITTI 2: rendered copies of KITTI's sequences, in other weather and from other angles too.

Y. Cabon, N. Murray, M. Humenberger: Virtual KITTI 2. arXiv:2001.10773;
https://europe.naverlabs.com/proxy-virtual-worlds-vkitti-2. The truth is the depth in centimetres, 16
bits, cut off at 655.35 m, which is the sky: unknown here. Every camera has a focal length of 725.0087
pixels and the principal point (620.5, 187); ``Camera_0`` and ``Camera_1`` stand 0.532725 m apart. Both
cameras see the pixels in which the two truths agree.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from stereopsis.datasets.folder import Folder, in_either
from stereopsis.datasets.readers import FromDepth, consistent
from stereopsis.datasets.sample import Sample
from stereopsis.types import Calibration

NAME = "Virtual KITTI 2"
LAYOUT = (
    "SceneNN/VARIATION/frames/rgb/Camera_0/rgb_NNNNN.jpg and Camera_1, "
    "frames/depth/Camera_0/depth_NNNNN.png and Camera_1, here or in vkitti_2.0.3_rgb/ and "
    "vkitti_2.0.3_depth/"
)

_ARCHIVE = "vkitti_2"
GEOMETRY = Calibration(focal=725.0087, cx=620.5, cy=187.0, baseline=0.532725)
_TRUTH = FromDepth(GEOMETRY.focal * GEOMETRY.baseline * 100)


def find(folder: Folder) -> list[Sample]:
    """List the pairs of a folder, none if it is laid out otherwise."""
    above = folder.parent if folder.name.startswith(_ARCHIVE) else folder
    archives = [archive for archive in above.folders if archive.name.startswith(_ARCHIVE)]
    return [
        pair
        for root in ([folder] if above is not folder else [folder, *archives])
        for scene in root.folders
        if scene.name.startswith("Scene")
        for variation in scene.folders
        for pair in _frames([folder, *archives], scene.name, variation)
    ]


def _frames(roots: list[Folder], scene: str, variation: Folder) -> Iterator[Sample]:
    images = variation / "frames" / "rgb"
    depths = [root / scene / variation.name / "frames" / "depth" for root in roots]
    for file in in_either(images / "Camera_0", images / "Camera_1"):
        left = images.path / "Camera_0" / file
        if left.suffix not in (".jpg", ".png"):
            continue
        number = left.stem.removeprefix("rgb_")
        truth, other = (_depth(depths, camera, number) for camera in ("Camera_0", "Camera_1"))
        yield Sample(
            f"{scene}/{variation.name}/{number}",
            left,
            images.path / "Camera_1" / file,
            truth,
            read_mask=consistent(truth, other, _TRUTH),
            read_truth=_TRUTH,
            geometry=GEOMETRY,
        )


def _depth(depths: list[Folder], camera: str, number: str) -> Path | None:
    return next(filter(None, ((depth / camera).file(f"depth_{number}.png") for depth in depths)), None)
