"""Argoverse stereo, version 1.1: rectified pairs at 5 Hz from a car.

M.-F. Chang et al.: Argoverse: 3D tracking and forecasting with rich maps. CVPR 2019,
doi:10.1109/CVPR.2019.00895; https://www.argoverse.org/av1.html. The truth comes from a lidar: sparse, 16
bits, 256 times the disparity, 0 where unknown. The test pairs have none.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from stereopsis._files import read
from stereopsis.datasets.folder import Folder
from stereopsis.datasets.sample import Sample
from stereopsis.io._errors import naming
from stereopsis.io.calibration import MAX_BYTES, check_calibration
from stereopsis.types import Calibration

NAME = "Argoverse stereo"
LAYOUT = (
    "rectified_stereo_images_v1.1/PART/LOG/stereo_front_left_rect/stereo_front_left_rect_TIME.jpg, "
    "stereo_front_right_rect, vehicle_calibration_stereo_info.json, "
    "disparity_maps_v1.1/PART/LOG/stereo_front_left_rect_disparity/stereo_front_left_rect_disparity_TIME.png"
)

_IMAGES, _TRUTHS = "rectified_stereo_images_v1.1", "disparity_maps_v1.1"
_LEFT, _RIGHT = "stereo_front_left_rect", "stereo_front_right_rect"


def find(folder: Folder) -> list[Sample]:
    """List the pairs of a folder, none if it is laid out otherwise."""
    if folder.parent.name == _IMAGES:  # one part
        root = folder.parent.parent
        return [pair for log in folder.folders for pair in _log(root, folder, log, "")]
    root = folder.parent if folder.name == _IMAGES else folder
    return [
        pair
        for part in (root / _IMAGES).folders
        for log in part.folders
        for pair in _log(root, part, log, f"{part.name}/")
    ]


def _log(root: Folder, part: Folder, log: Folder, prefix: str) -> Iterator[Sample]:
    truths = root / _TRUTHS / part.name / log.name / f"{_LEFT}_disparity"
    sides = (_LEFT, _RIGHT)
    views = ((side, Path(file)) for side in sides for file in (log / side).files)
    times = {view.stem.removeprefix(f"{side}_") for side, view in views if view.suffix == ".jpg"}
    for time in sorted(times):
        left, right = (log.path / side / f"{side}_{time}.jpg" for side in sides)
        yield Sample(
            f"{prefix}{log.name}/{time}",
            left,
            right,
            truths.file(f"{_LEFT}_disparity_{time}.png"),
            log.file("vehicle_calibration_stereo_info.json"),
            read_calibration=read_calibration,
        )


def read_calibration(file: Path) -> Calibration:
    """Read the rectified cameras of a log."""
    data = read(file, MAX_BYTES, "a calibration")
    with naming(file):
        cameras = {camera["key"]: camera["value"] for camera in json.loads(data)["camera_data_"]}
        left, right = (cameras[f"image_raw_{side}"] for side in (_LEFT, _RIGHT))
        return check_calibration(
            Calibration(
                focal=float(left["focal_length_x_px_"]),
                cx=float(left["focal_center_x_px_"]),
                cy=float(left["focal_center_y_px_"]),
                baseline=math.dist(_place(left), _place(right)),
                doffs=float(right["focal_center_x_px_"]) - float(left["focal_center_x_px_"]),
            )
        )


def _place(camera: dict[str, Any]) -> list[float]:
    return [float(metres) for metres in camera["vehicle_SE3_camera_"]["translation"]]
