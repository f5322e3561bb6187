"""DrivingStereo: the official folders at half or full size, and pairs side by side in one flat folder.

G. Yang et al.: DrivingStereo: a large-scale dataset for stereo matching in autonomous driving scenarios. CVPR
2019, doi:10.1109/CVPR.2019.00099; https://drivingstereo-dataset.github.io. The truth comes from a lidar:
sparse, and not split by occlusion; 16 bits, 256 times the disparity at half size and 128 times at full size,
0 where unknown.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from stereopsis._files import read
from stereopsis.datasets.folder import Folder, in_either, only_one
from stereopsis.datasets.readers import Scaled
from stereopsis.datasets.sample import Sample
from stereopsis.io._errors import naming
from stereopsis.io.calibration import MAX_BYTES, check_calibration
from stereopsis.types import Calibration

NAME = "DrivingStereo"
LAYOUT = (
    "NAME-left.jpg, NAME-right.jpg, NAME-disparity.png; or train-left-image/SEQUENCE/NAME.jpg, "
    "train-right-image, train-disparity-map; or left-image-half-size, right-image-half-size, "
    "disparity-map-half-size, or -full-size, here, in test-left-image and its like, or in a folder for "
    "each weather"
)

_SIZES = ["left-image-half-size", "left-image-full-size"]


def find(folder: Folder) -> list[Sample]:
    """List the pairs of a folder, none if it is laid out otherwise."""
    return list(_flat(folder)) or list(_official(folder))


def _flat(folder: Folder) -> Iterator[Sample]:
    views = (re.fullmatch(r"(.*)-(?:left|right)\.(jpg|png)", file, re.DOTALL) for file in folder.files)
    for name, kind in sorted({view.group(1, 2) for view in views if view}):
        left, right = (folder.path / f"{name}-{side}.{kind}" for side in ("left", "right"))
        yield Sample(name, left, right, folder.file(f"{name}-disparity.png"))


def _official(folder: Folder) -> Iterator[Sample]:
    """Train, test, and the weathers, whose names begin with ``train/``, ``test/`` and the weather."""
    above = folder.parent if folder.name in ("train-left-image", "test-left-image", *_SIZES) else None
    if above and above.name == "test-left-image":
        yield from _images(above.parent, (above.name, folder.name), "")
    elif above:
        yield from _images(above, (folder.name,), "")
    for part in ("train", "test"):
        if folder / f"{part}-left-image":
            yield from _images(folder, (f"{part}-left-image",), f"{part}/")
    for prefix, root in [("", folder), *((f"{weather.name}/", weather) for weather in folder.folders)]:
        if "left-image" not in root.name and (size := only_one(root, _SIZES)):
            yield from _images(root, (size.name,), prefix)


def _images(root: Folder, lefts: tuple[str, ...], prefix: str) -> Iterator[Sample]:
    top = root.below(lefts)
    only_one(top, _SIZES)
    places = [root, root.parent]
    for name, folder in top.walk(4):
        parts = (*lefts, *filter(None, name.split("/")))
        # The three trees differ in one word of their folders' names.
        rights, truths = (
            root.below(part.replace("left-image", word) for part in parts)
            for word in ("right-image", "disparity-map")
        )
        sequence = "".join(f"{part}/" for part in parts[len(lefts) :] if part not in _SIZES)
        full = _SIZES[1] in parts
        for file in in_either(folder, rights):
            left = folder.path / file
            if left.suffix not in (".jpg", ".png"):
                continue
            yield Sample(
                f"{prefix}{sequence}{left.stem}",
                left,
                rights.path / file,
                truths.file(f"{left.stem}.png"),
                _calibration_file(places, f"{left.stem.partition('_')[0]}.txt", full),
                read_truth=Scaled(128 if full else 256),
                read_calibration=read_calibration,
            )


def _calibration_file(places: list[Folder], name: str, full: bool) -> Path | None:
    folder = f"{'full' if full else 'half'}-image-calib"
    within = [inner for place in places for inner in (place / folder, place / folder / folder)]
    return next(filter(None, (inner.file(name) for inner in within)), None)


def read_calibration(file: Path) -> Calibration:
    """Read a file of ``half-image-calib`` or ``full-image-calib``: the left camera is 101, the right 103."""
    data = read(file, MAX_BYTES, "a calibration")
    with naming(file):
        lines = (line.partition(":") for line in data.decode("ascii").splitlines())
        numbers = {key: value.split() for key, _, value in lines}
        left, right = (_numbers(numbers, f"P_rect_{camera}", (3, 4)) for camera in (101, 103))
        # From where the cameras stand: the last column of P_rect_103 is not halved in the files of half size.
        places = [
            _numbers(numbers, f"R_{camera}", (3, 3)).T @ _numbers(numbers, f"T_{camera}", (3,))
            for camera in (101, 103)
        ]
        return check_calibration(
            Calibration(
                focal=float(left[0, 0]),
                cx=float(left[0, 2]),
                cy=float(left[1, 2]),
                baseline=float(np.linalg.norm(places[1] - places[0])),
                doffs=float(right[0, 2] - left[0, 2]),
            )
        )


def _numbers(lines: dict[str, list[str]], key: str, shape: tuple[int, ...]) -> npt.NDArray[np.float64]:
    if len(lines.get(key, ())) != math.prod(shape):
        raise ValueError(f"the calibration has no {key} of {math.prod(shape)} numbers")
    return np.array(lines[key], np.float64).reshape(shape)
