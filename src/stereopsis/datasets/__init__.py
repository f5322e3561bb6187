"""Data sets on disk: recognise a folder by its layout and go through its pairs.

::

    for sample in datasets.open("kitti2015"):
        print(sample.name, evaluate(match(sample.pair()).disparity, sample.truth(), sample.mask()))
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, overload

from stereopsis._files import as_path
from stereopsis.datasets.sample import Sample, check_name

__all__ = ["Dataset", "Sample", "open"]


@dataclass(frozen=True)
class Dataset(Sequence[Sample]):
    """The pairs of a data set. Nothing is read before a sample is asked for it.

    Attributes
    ----------
    name : str
        What the data set is called.
    folder : Path
        Where it was opened: a folder, or the file of a table.
    samples : tuple of Sample
        Sorted by name, in the order of code points, whatever the file system's order; of a table, in the
        order of its rows.
    """

    name: str
    folder: Path
    samples: tuple[Sample, ...]

    def __len__(self) -> int:
        return len(self.samples)

    @overload
    def __getitem__(self, index: int) -> Sample: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Sample, ...]: ...
    def __getitem__(self, index: int | slice) -> Sample | tuple[Sample, ...]:
        return self.samples[index]

    def describe(self) -> dict[str, Any]:
        """What the data set holds, ready for JSON: names, and numbers of pairs. Nothing is read."""
        return {
            "folder": str(self.folder),
            "kind": "data set",
            "name": self.name,
            "pairs": len(self),
            "with_truth": sum(sample.truth_file is not None for sample in self),
            "with_mask": sum(sample.read_mask is not None for sample in self),
            "with_calibration": sum(bool(sample.calibration_file or sample.geometry) for sample in self),
            "first": self[0].name,
            "last": self[-1].name,
        }


def open(path: str | os.PathLike[str]) -> Dataset:
    """Recognise a data set by its layout.

    Folders are listed, each once, and no file is read but a table of paths: a pair of which a file is missing
    or broken fails by itself when it is read, as long as another pair has both views. Where a folder holds
    training and test pairs of the same names, those with truth are taken; the others' folder can be opened
    itself.

    Parameters
    ----------
    path : str or path-like
        The folder in which the data set was unpacked, or one of its parts: DrivingStereo, KITTI 2012 and
        2015, Middlebury 2001 to 2006, 2014, 2021 and v3, ETH3D, Argoverse, Scene Flow, Virtual KITTI 2, MPI
        Sintel, Falling Things, InStereo2K; or two folders ``left`` and ``right``; or a table of paths,
        ``.csv`` or ``.parquet``. The page on data sets has the layouts.

    Returns
    -------
    Dataset
        A sequence of `Sample`, sorted by name, or in the order of the table's rows.

    Raises
    ------
    TypeError
        `path` is none.
    OSError
        A folder cannot be listed, or the table cannot be read.
    ValueError
        There is no such folder or table; it holds no layout known here, several resolutions of one, no pair
        with both views, or two pairs of the same name; a row of the table is wrong.
    """
    # Imported here, so that `import stereopsis` stays quick.
    from stereopsis.datasets import (
        argoverse,
        drivingstereo,
        eth3d,
        fallingthings,
        folders,
        instereo2k,
        kitti2012,
        kitti2015,
        middlebury,
        middlebury2003,
        middlebury2006,
        middlebury2021,
        sceneflow,
        sintel,
        table,
        virtualkitti,
    )
    from stereopsis.datasets.folder import Folder

    place = as_path(path)
    if place.is_file() and place.suffix.lower() in table.SUFFIXES:
        return Dataset(table.NAME, place, _checked(place, table.read(place)))
    if not place.is_dir():
        raise ValueError(f"path must be a folder, or a .csv or .parquet file, and {place} is not one")
    folder = Folder(place)
    # Those that a folder's own entries show come before those that look into every folder below.
    layouts = (
        drivingstereo,
        kitti2015,
        kitti2012,
        argoverse,
        sceneflow,
        virtualkitti,
        sintel,
        eth3d,
        middlebury2021,
        middlebury,
        middlebury2006,
        middlebury2003,
        folders,
        fallingthings,
        instereo2k,
    )
    for layout in layouts:
        found = layout.find(folder)
        if found:
            ordered = sorted(found, key=lambda sample: sample.name)
            return Dataset(layout.NAME, place, _checked(place, ordered))
    sought = "".join(f"\n  {layout.NAME}: {layout.LAYOUT}" for layout in (*layouts, table))
    raise ValueError(f"{place} holds no benchmark in a layout known here; looked for{sought}")


def _checked(place: Path, samples: Sequence[Sample]) -> tuple[Sample, ...]:
    """Refuse names that could not be those of files in an output folder, each of its own, and views alone."""
    seen: dict[str, Sample] = {}
    for sample in samples:
        try:
            check_name(sample.name)
        except ValueError as error:
            raise ValueError(f"{sample.left_file}: {error}") from None
        first = seen.setdefault(sample.name, sample)
        if first is not sample:
            raise ValueError(
                f"{place} holds two pairs named {sample.name!r}: {first.left_file} and {sample.left_file}"
            )
    # Not Path.exists: it raises for a name that is too long, and for a folder that may not be entered.
    there = os.path.exists
    if not any(there(sample.left_file) and there(sample.right_file) for sample in samples):
        left, right = samples[0].left_file, samples[0].right_file
        view, side, missing = (left, "right", right) if there(left) else (right, "left", left)
        raise ValueError(f"{view} has no {side} view: {missing} is missing; no pair of {place} has both")
    return tuple(seen.values())
