"""MPI Sintel, stereo: frames of an animated film, in a clean and a final rendering.

D. Butler et al.: A naturalistic open source movie for optical flow evaluation. ECCV 2012,
doi:10.1007/978-3-642-33783-3_44; http://sintel.is.tue.mpg.de/stereo. The truth is known everywhere: colour of
8 bits, disparity = 4 R + G / 64 + B / 16384. Where a mask of ``occlusions`` or ``outofframe`` is not 0, the
right camera does not see.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stereopsis import io
from stereopsis.datasets.folder import Folder, in_either
from stereopsis.datasets.readers import grey
from stereopsis.datasets.sample import Mask, Sample
from stereopsis.types import DisparityMap

NAME = "MPI Sintel"
LAYOUT = (
    "clean_left/SCENE/FRAME.png and clean_right, final_left and final_right likewise, disparities, "
    "occlusions, outofframe, here or in training/"
)

_PASSES = ("clean", "final")


def find(folder: Folder) -> list[Sample]:
    """List the pairs of a folder, none if it is laid out otherwise."""
    for name in _PASSES:
        if folder.name == f"{name}_left":
            return list(_pass(folder.parent, name, ""))
    root = folder if any(folder / f"{name}_left" for name in _PASSES) else folder / "training"
    return [pair for name in _PASSES for pair in _pass(root, name, f"{name}/")]


def _pass(root: Folder, name: str, prefix: str) -> Iterator[Sample]:
    for scene in (root / f"{name}_left").folders:
        rights = root / f"{name}_right" / scene.name
        for file in in_either(scene, rights):
            left = scene.path / file
            if left.suffix != ".png":
                continue
            masks = [(root / kind / scene.name).file(file) for kind in ("occlusions", "outofframe")]
            there = tuple(mask for mask in masks if mask)
            yield Sample(
                f"{prefix}{scene.name}/{left.stem}",
                left,
                rights.path / file,
                (root / "disparities" / scene.name).file(file),
                read_mask=Black(there) if len(there) == 2 else None,
                read_truth=read_truth,
            )


@dataclass(frozen=True)
class Black:
    """The pixels that are 0 in every one of these pictures."""

    files: tuple[Path, ...]

    def __call__(self) -> Mask:
        """Read the mask."""
        pictures = [grey(file) for file in self.files]
        if len({picture.shape for picture in pictures}) > 1:
            raise ValueError(f"{self.files[0]} and {self.files[1]} differ in size")
        seen: Mask = ~np.any(pictures, axis=0)
        return seen


def read_truth(file: Path) -> DisparityMap:
    """Read a disparity map of the set."""
    image = io.read_image(file)
    if image.ndim != 3 or image.dtype != np.uint8:
        raise ValueError(f"{file} must be 8-bit colour, not {image.dtype} of shape {image.shape}")
    weights = np.array([4, 1 / 64, 1 / 16384])
    disparity: DisparityMap = (image @ weights).astype(np.float32)
    return disparity
