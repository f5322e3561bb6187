"""Scene Flow: FlyingThings3D, Driving and Monkaa, one of them or all side by side.

N. Mayer et al.: A large dataset to train convolutional networks for disparity, optical flow, and scene
flow estimation. CVPR 2016, doi:10.1109/CVPR.2016.438;
https://lmb.informatik.uni-freiburg.de/resources/datasets/SceneFlowDatasets.en.html. The truth is PFM,
positive for both views and known everywhere. The virtual camera has a focal length of 1050 pixels, of 450
in the scenes of Driving filmed with 15 mm, the principal point (479.5, 269.5), and a baseline of one unit
of the scene, which stands for a metre here. Both cameras see the pixels in which the two truths agree.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from stereopsis.datasets.folder import Folder, in_either
from stereopsis.datasets.readers import consistent
from stereopsis.datasets.sample import Sample
from stereopsis.types import Calibration

NAME = "Scene Flow"
LAYOUT = (
    "frames_cleanpass/SCENE/left/FRAME.png and right, frames_finalpass likewise, "
    "disparity/SCENE/left/FRAME.pfm and right, here or in FlyingThings3D/, Driving/ and Monkaa/"
)

_PASSES = ("frames_cleanpass", "frames_finalpass")


def find(folder: Folder) -> list[Sample]:
    """List the pairs of a folder, none if it is laid out otherwise."""
    parts = folder.path.absolute().parts
    for name in _PASSES:
        if name in parts:  # the frames of one pass, or some of them
            above = parts[: parts.index(name)]
            truths = Folder(Path(*above, "disparity")).below(parts[len(above) + 1 :])
            return list(_pass(folder, truths, ""))
    roots = [("", folder), *((root.name, root) for root in folder.folders)]
    return [
        pair
        for prefix, root in roots
        for name in _PASSES
        for pair in _pass(root / name, root / "disparity", f"{prefix}/{name.removeprefix('frames_')}")
    ]


def _pass(frames: Folder, truths: Folder, prefix: str) -> Iterator[Sample]:
    for name, scene in frames.walk(4):
        lefts, rights = scene / "left", scene / "right"
        truth_scene = truths.below(filter(None, name.split("/")))
        for file in in_either(lefts, rights):
            left = lefts.path / file
            if left.suffix not in (".png", ".webp"):
                continue
            truth = (truth_scene / "left").file(f"{left.stem}.pfm")
            other = (truth_scene / "right").file(f"{left.stem}.pfm")
            yield Sample(
                "/".join(filter(None, (*prefix.split("/"), name, left.stem))),
                left,
                rights.path / file,
                truth,
                read_mask=consistent(truth, other),
                geometry=Calibration(
                    focal=450.0 if "15mm_focallength" in lefts.path.parts else 1050.0,
                    cx=479.5,
                    cy=269.5,
                    baseline=1.0,
                ),
            )
