"""InStereo2K: indoor scenes measured with structured light.

W. Bao et al.: InStereo2K: a large real dataset for stereo matching in indoor scenes. Science China
Information Sciences 63, 2020, doi:10.1007/s11432-019-2803-x; https://github.com/YuhuaXu/StereoDataset.
The truth has 16 bits, 100 times the disparity, 0 where unknown. Both cameras see the pixels in which the
two truths agree.
"""

from __future__ import annotations

from stereopsis.datasets.folder import Folder
from stereopsis.datasets.readers import Scaled, consistent
from stereopsis.datasets.sample import Sample

NAME = "InStereo2K"
LAYOUT = "NNNNNN/left.png, right.png, left_disp.png, right_disp.png, here or in train/, partN/ or test/"

_TRUTH = Scaled(100)


def find(folder: Folder) -> list[Sample]:
    """List the pairs of a folder, none if it is laid out otherwise."""
    return [
        _sample(name or scene.name, scene) for name, scene in folder.walk(3) if scene.file("left_disp.png")
    ]


def _sample(name: str, scene: Folder) -> Sample:
    truth, other = scene.path / "left_disp.png", scene.file("right_disp.png")
    return Sample(
        name,
        scene.path / "left.png",
        scene.path / "right.png",
        truth,
        read_mask=consistent(truth, other, _TRUTH),
        read_truth=_TRUTH,
    )
