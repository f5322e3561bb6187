"""Falling Things: household objects that fall in rendered rooms.

J. Tremblay, T. To, S. Birchfield: Falling Things: a synthetic dataset for 3D object detection and pose
estimation. CVPR Workshops 2018, doi:10.1109/CVPRW.2018.00275;
https://research.nvidia.com/publication/2018-06_Falling-Things. The truth is the depth in tenths of a
millimetre, 16 bits; 0 and 65535, what does not fit, are unknown here. The focal length is that of
``_camera_settings.json``, the baseline 6 cm. Both cameras see the pixels in which the two truths agree.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from stereopsis._files import read
from stereopsis.datasets.folder import Folder
from stereopsis.datasets.readers import FromDepth, consistent
from stereopsis.datasets.sample import Sample
from stereopsis.io._errors import naming
from stereopsis.io.calibration import MAX_BYTES, check_calibration
from stereopsis.types import Calibration, DisparityMap

NAME = "Falling Things"
LAYOUT = (
    "mixed/SCENE or single/OBJECT/SCENE/NNNNNN.left.jpg, NNNNNN.right.jpg, NNNNNN.left.depth.png, "
    "NNNNNN.right.depth.png, _camera_settings.json"
)

BASELINE = 0.06
_UNIT = 1e-4  # metres


def find(folder: Folder) -> list[Sample]:
    """List the pairs of a folder, none if it is laid out otherwise."""
    return [pair for name, scene in folder.walk(3) for pair in _scene(name, scene)]


def _scene(name: str, scene: Folder) -> Iterator[Sample]:
    settings = scene.file("_camera_settings.json")
    if settings is None:
        return
    depth = Depth(settings)
    views = (file.partition(".") for file in scene.files)
    for number in sorted({number for number, _, kind in views if kind in ("left.jpg", "right.jpg")}):
        truth, other = (scene.file(f"{number}.{side}.depth.png") for side in ("left", "right"))
        yield Sample(
            f"{name}/{number}".lstrip("/"),
            scene.path / f"{number}.left.jpg",
            scene.path / f"{number}.right.jpg",
            truth,
            settings,
            read_mask=consistent(truth, other, depth),
            read_truth=depth,
            read_calibration=read_calibration,
        )


@dataclass(frozen=True)
class Depth:
    """A depth image of a scene with these camera settings."""

    settings: Path

    def __call__(self, file: Path) -> DisparityMap:
        """Read the disparity."""
        camera = read_calibration(self.settings)
        return FromDepth(camera.focal * camera.baseline / _UNIT)(file)


def read_calibration(file: Path) -> Calibration:
    """Read the left camera of ``_camera_settings.json``."""
    data = read(file, MAX_BYTES, "a calibration")
    with naming(file):
        cameras = json.loads(data)["camera_settings"]
        left = next((camera for camera in cameras if camera.get("name") == "left"), cameras[0])
        inner = left["intrinsic_settings"]
        return check_calibration(
            Calibration(
                focal=float(inner["fx"]), cx=float(inner["cx"]), cy=float(inner["cy"]), baseline=BASELINE
            )
        )
