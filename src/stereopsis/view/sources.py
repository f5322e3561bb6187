"""Where a scene comes from, and its arrays once it is there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from stereopsis.types import Calibration, Disparities, DisparityMap, Image, Pair, Vertical


@dataclass(frozen=True)
class Street:
    """A rendered street; `options` are those of `stereopsis.scenes.street`."""

    width: int
    height: int
    seed: int
    options: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class Files:
    """Files of one scene; what a data set reads in a way of its own it reads itself."""

    left: Path | None = None
    right: Path | None = None
    truth: Path | None = None
    calibration: Path | Calibration | None = None
    disparity: Path | None = None
    read_truth: Callable[[], DisparityMap | None] | None = None
    read_mask: Callable[[], npt.NDArray[np.bool_] | None] | None = None
    read_calibration: Callable[[], Calibration | None] | None = None


Source: TypeAlias = Street | Files


@dataclass(eq=False)
class Scene:
    """A scene's arrays, as a worker holds them.

    Attributes
    ----------
    left, right : Image or None
    truth : DisparityMap or None
    mask : ndarray of bool or None
        The pixels that the scores count.
    disparity : DisparityMap or None
        The map that was opened.
    calibration : Calibration or None
        As stated; None where nobody stated one.
    disparities : Disparities
        A range that holds the scene.
    vertical : dict
        The rows that the right image lies too low, for each range that was asked for.
    """

    left: Image | None
    right: Image | None
    truth: DisparityMap | None
    mask: npt.NDArray[np.bool_] | None
    disparity: DisparityMap | None
    calibration: Calibration | None
    disparities: Disparities
    vertical: dict[Disparities, Vertical] = field(default_factory=dict)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        for array in (self.left, self.disparity, self.truth):
            if array is not None:
                return array.shape[0], array.shape[1]
        raise AssertionError

    @property
    def bytes(self) -> int:
        """What the arrays take."""
        arrays: list[npt.NDArray[Any] | None] = [self.left, self.right, self.truth, self.mask, self.disparity]
        return sum(array.nbytes for array in arrays if array is not None)

    def pair(self) -> Pair:
        """What a matcher may see."""
        assert self.left is not None
        assert self.right is not None
        return Pair(self.left, self.right, self.calibration)
