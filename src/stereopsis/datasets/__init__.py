"""Benchmarks on disk: recognise a folder and go through its pairs.

::

    for sample in datasets.open("kitti2015"):
        print(sample.name, evaluate(match(sample.pair()).disparity, sample.truth(), sample.mask()))
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import overload

from stereopsis.datasets import drivingstereo, kitti2015, middlebury
from stereopsis.datasets.sample import Sample

__all__ = ["Dataset", "Sample", "open"]


@dataclass(frozen=True)
class Dataset(Sequence[Sample]):
    """The pairs of a benchmark, in the order of their names. Nothing is read before a sample is asked for it.

    Attributes
    ----------
    name : str
        What the benchmark is called.
    folder : Path
        Where it was opened.
    samples : tuple of Sample
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


def open(path: str | os.PathLike[str]) -> Dataset:
    """Recognise the benchmark in a folder by its layout.

    Parameters
    ----------
    path : str or path-like
        The folder that holds the layout, or the one above its ``training`` folder:

        - DrivingStereo, flat: ``NAME-left.jpg``, ``NAME-right.jpg``, ``NAME-disparity.png``;
        - KITTI 2015: ``image_2``, ``image_3`` and ``disp_occ_0``, ``disp_noc_0``;
        - Middlebury v3: ``SCENE/im0.png``, ``im1.png``, ``disp0GT.pfm``, ``mask0nocc.png``, ``calib.txt``.

    Returns
    -------
    Dataset
        A sequence of `Sample`, sorted by name.

    Raises
    ------
    ValueError
        If the folder is none, holds no layout known here, several resolutions of one, or a pair with only one
        view.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise ValueError(f"path must be a folder, and {folder} is not one")
    benchmarks = (drivingstereo, kitti2015, middlebury)
    for benchmark in benchmarks:
        samples: tuple[Sample, ...] = benchmark.find(folder)
        if samples:
            return Dataset(benchmark.NAME, folder, samples)
    sought = "".join(f"\n  {benchmark.NAME}: {benchmark.LAYOUT}" for benchmark in benchmarks)
    raise ValueError(f"{folder} holds no benchmark in a layout known here; looked for{sought}")
