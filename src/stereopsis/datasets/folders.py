"""Pairs of one's own in two folders, ``left`` and ``right``, under the same names.

The truth, in ``disparity`` or ``truth``, is in any format whose content says what it is: see
`stereopsis.io.read_disparity`. One ``calib.txt`` beside the folders holds for every pair.
"""

from __future__ import annotations

from pathlib import Path

from stereopsis.datasets.folder import Folder, only_one
from stereopsis.datasets.sample import Sample

NAME = "left and right"
LAYOUT = (
    "left/NAME.*, right/NAME.*, disparity/NAME.* or truth/NAME.*, with any folders in NAME, and calib.txt"
)

_IMAGES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".pgm", ".ppm", ".pfm", ".npy")
_DEPTH = 8


def find(folder: Folder) -> list[Sample]:
    """List the pairs of a folder, none if it is laid out otherwise."""
    if not (folder / "left" and folder / "right"):
        return []
    lefts, rights = _images(folder / "left"), _images(folder / "right")
    truths = _images(only_one(folder, ["disparity", "truth"], "keep one of them"))
    calibration = folder.file("calib.txt")

    def view(side: str, there: dict[str, Path], name: str) -> Path:
        # One that is missing is looked for beside the others, under the name of what is there.
        other = lefts.get(name) or rights.get(name) or truths[name]
        return there.get(name, folder.path / side / f"{name}{other.suffix}")

    return [
        Sample(name, view("left", lefts, name), view("right", rights, name), truths.get(name), calibration)
        for name in sorted({*lefts, *rights, *truths})
    ]


def _images(root: Folder) -> dict[str, Path]:
    """Files by their path below `root` without the suffix."""
    found: dict[str, Path] = {}
    for place, folder in root.walk(_DEPTH):
        for file in folder.files:
            stem, dot, suffix = file.rpartition(".")
            if f"{dot}{suffix}".lower() not in _IMAGES:
                continue
            name = f"{place}/{stem}".lstrip("/")
            if name in found:
                raise ValueError(f"{found[name]} and {folder.path / file} have the same name")
            found[name] = folder.path / file
    return found
