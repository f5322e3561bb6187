"""What data sets keep on disk, turned into disparities and masks: small values that can be pickled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis import io
from stereopsis.datasets.sample import Mask
from stereopsis.io._errors import naming
from stereopsis.types import DisparityMap

ReadTruth = Callable[[Path], DisparityMap]


@dataclass(frozen=True)
class Scaled:
    """A 16-bit grey image that holds `divisor` times the disparity, 0 where unknown."""

    divisor: float

    def __call__(self, file: Path) -> DisparityMap:
        """Read the disparity."""
        values = integers(file, np.uint16)
        with naming(file):
            return some(np.where(values > 0, values / self.divisor, np.nan))


@dataclass(frozen=True)
class FromDepth:
    """A 16-bit grey image of depths: the disparity is `product` / value; 0 and 65535 mean unknown.

    `product` is focal length times baseline in pixels times the image's unit of length. 65535 is where the
    depth no longer fits.
    """

    product: float

    def __call__(self, file: Path) -> DisparityMap:
        """Read the disparity."""
        values = integers(file, np.uint16)
        known = (values > 0) & (values < 65535)
        with naming(file):
            return some(np.where(known, self.product / np.maximum(values, 1), np.nan))


@dataclass(frozen=True)
class Known:
    """The pixels that a second truth knows, which leaves out what the right camera does not see."""

    file: Path

    def __call__(self) -> Mask:
        """Read the mask."""
        return np.isfinite(io.read_disparity(self.file))


@dataclass(frozen=True)
class White:
    """The pixels that are 255 in a grey picture."""

    file: Path

    def __call__(self) -> Mask:
        """Read the mask."""
        seen: Mask = grey(self.file) == 255
        return seen


@dataclass(frozen=True)
class Consistent:
    """The pixels of the left truth whose match the right one knows, with a disparity within a pixel."""

    left: Path
    right: Path
    read: ReadTruth = io.read_disparity

    def __call__(self) -> Mask:
        """Read both and compare them."""
        left, right = self.read(self.left), self.read(self.right)
        if left.shape != right.shape:
            raise ValueError(f"{self.left} has the shape {left.shape}, {self.right} {right.shape}")
        column = np.arange(left.shape[1]) - np.where(np.isfinite(left), left, np.inf)
        inside = (column > -0.5) & (column < left.shape[1] - 0.5)
        match = np.where(inside, np.rint(np.where(inside, column, 0)), 0).astype(np.intp)
        other = np.take_along_axis(right, np.clip(match, 0, left.shape[1] - 1), axis=1)
        # Comparisons with NaN are false: what the right truth does not know is not seen by both.
        seen: Mask = inside & (np.abs(other - left) <= 1)
        return seen


def consistent(
    left: Path | None, right: Path | None, read: ReadTruth = io.read_disparity
) -> Consistent | None:
    """The mask that two truths give; None where one of them is missing."""
    return Consistent(left, right, read) if left and right else None


def integers(file: Path, dtype: type[np.unsignedinteger[Any]]) -> npt.NDArray[Any]:
    """Read a grey image of this type."""
    image = io.read_image(file)
    if image.ndim != 2 or image.dtype != dtype:
        bits = np.iinfo(dtype).bits
        raise ValueError(f"{file} must be {bits}-bit grey, not {image.dtype} of shape {image.shape}")
    return image


def grey(file: Path) -> npt.NDArray[Any]:
    """Read the grey picture of a mask."""
    mask = io.read_image(file)
    if mask.ndim != 2:
        raise ValueError(f"{file} must be a grey mask, not an image of shape {mask.shape}")
    return mask


def some(disparity: npt.NDArray[np.floating[Any]]) -> DisparityMap:
    """A disparity map in float32, refused when it holds nothing, as `io.read_disparity` does."""
    if not np.isfinite(disparity).any():
        raise ValueError("holds no disparity: every pixel is invalid")
    return disparity.astype(np.float32)
