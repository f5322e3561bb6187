"""One pair of a benchmark."""

from __future__ import annotations

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
    """One pair of a benchmark and what is known of it; each method reads from disk anew.

    Attributes
    ----------
    name : str
        The benchmark's name for the pair.
    left_file, right_file : Path
        The two views.
    truth_file : Path or None
        The true disparity of the left view.
    calibration_file : Path or None
        The geometry.
    read_mask : callable or None
        Reads the pixels that both cameras see.
    """

    name: str
    left_file: Path
    right_file: Path
    truth_file: Path | None = None
    calibration_file: Path | None = None
    read_mask: Callable[[], Mask] | None = None

    def pair(self) -> Pair:
        """Read both views, with the calibration where there is one."""
        return io.read_pair(self.left_file, self.right_file, self.calibration_file, self.name)

    def truth(self) -> DisparityMap | None:
        """Read the true disparity, (H, W) float32, NaN where unknown; None where the benchmark keeps it."""
        return io.read_disparity(self.truth_file) if self.truth_file else None

    def mask(self) -> Mask | None:
        """Read where both cameras see the scene, (H, W) bool; None where the benchmark does not say.

        Scores inside the mask are what the benchmarks call non-occluded.
        """
        return self.read_mask() if self.read_mask else None

    def calibration(self) -> Calibration | None:
        """Read the geometry; None where the benchmark gives none."""
        return io.read_calibration(self.calibration_file) if self.calibration_file else None


def present(file: Path) -> Path | None:
    """Return the file if there is one."""
    return file if file.is_file() else None


def views(left: Path, right: Path) -> tuple[Path, Path]:
    """Return both, refusing a left view that stands alone."""
    if not right.is_file():
        raise ValueError(f"{left} has no right view: {right} is missing")
    return left, right
