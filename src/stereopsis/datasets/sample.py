"""One pair of a data set."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from stereopsis import io
from stereopsis.types import Calibration, DisparityMap, Pair

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Sample:
    """One pair of a data set and what is known of it; each method reads from disk anew.

    Samples can be pickled and compared: they go to other processes as file names.

    Attributes
    ----------
    name : str
        The data set's name for the pair, unique in it. It may have folders, ``"scene/frame_0001"``, and
        leads nowhere else: no part of it is empty, ``"."`` or ``".."``.
    left_file, right_file : Path
        The two views.
    truth_file : Path or None
        What the true disparity of the left view is read from.
    calibration_file : Path or None
        What the geometry is read from.
    read_mask : callable or None
        Reads the pixels that both cameras see.
    read_truth : callable
        Reads `truth_file`.
    read_calibration : callable
        Reads `calibration_file`.
    geometry : Calibration or None
        The geometry, where the data set's description states it and no file does.
    """

    name: str
    left_file: Path
    right_file: Path
    truth_file: Path | None = None
    calibration_file: Path | None = None
    read_mask: Callable[[], Mask] | None = None
    read_truth: Callable[[Path], DisparityMap] = io.read_disparity
    read_calibration: Callable[[Path], Calibration] = io.read_calibration
    geometry: Calibration | None = None

    def pair(self) -> Pair:
        """Read both views, with the calibration where there is one."""
        return io.read_pair(self.left_file, self.right_file, self.calibration(), self.name)

    def truth(self) -> DisparityMap | None:
        """Read the true disparity, (H, W) float32, NaN where unknown; None where the data set keeps it."""
        return self.read_truth(self.truth_file) if self.truth_file else None

    def mask(self) -> Mask | None:
        """Read where both cameras see the scene, (H, W) bool; None where the data set does not say.

        Scores inside the mask are what the benchmarks call non-occluded.
        """
        return self.read_mask() if self.read_mask else None

    def calibration(self) -> Calibration | None:
        """Read the geometry; None where the data set gives none."""
        return self.read_calibration(self.calibration_file) if self.calibration_file else self.geometry


def check_name(name: str) -> str:
    """`name` itself, when it can name a file below a folder; ``ValueError`` otherwise."""
    if "\0" in name or any(part in ("", ".", "..") for part in re.split(r"[/\\]", name)):
        raise ValueError(
            f"{name!r} cannot name a pair: no part of it may be empty, '.' or '..', nor a zero byte"
        )
    return name
