"""What goes in and what comes out: pairs, calibrations, ranges, flags, results."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from stereopsis.settings import Settings

Image = npt.NDArray[Any]
"""``(H, W)`` or ``(H, W, 3)``; uint8, uint16 or float32."""

DisparityMap = npt.NDArray[np.float32]
"""``(H, W)`` float32, ``d = x_left - x_right`` in pixels, referenced to the left image, NaN where invalid."""


class Flag(enum.IntFlag):
    """Why a pixel is invalid, or how it was answered; one bit each in a ``uint8`` map.

    Every pixel whose disparity is NaN carries at least one of these bits. A pixel that was filled keeps the
    bit that says why it had been invalid and gains `FILLED`.
    """

    OCCLUDED = 1
    """The left-right check failed, and no pixel of the right view answers on this line: seen by the left
    camera alone."""
    MISMATCHED = 2
    """The left-right check failed, though the right view has an answer that would agree: a wrong match. Or
    the matched windows differ in brightness: a reflection."""
    AMBIGUOUS = 4
    """A second candidate, not next to the winner, matches almost as well (uniqueness)."""
    LOW_TEXTURE = 8
    """The support window holds too little horizontal texture to be matched."""
    SKY = 16
    """Recognised as sky."""
    OUT_OF_VIEW = 32
    """No candidate of the range lies inside the right image; or one of the images is blank there."""
    SPECKLE = 64
    """Part of a blob too small to be believed."""
    FILLED = 128
    """Was invalid and has been filled from its neighbours."""

    @property
    def words(self) -> str:
        """Its name as a text has it, such as "out of view"."""
        return str(self.name).lower().replace("_", " ")


class Disparities(NamedTuple):
    """A half-open range of integer disparities, like Python's ``range``: `max` is excluded."""

    min: int
    max: int

    @property
    def span(self) -> int:
        """How many candidates there are."""
        return self.max - self.min


class Vertical(NamedTuple):
    """Rows that the right image lies too low, as a field over its pixels.

    Attributes
    ----------
    offset : float
        In the image's middle, in pixels: positive where a point lies on a larger row of the right image.
    across : float
        What it gains from the first column to the last.
    down : float
        What it gains from the first row to the last.
    keystone : float
        What `across` gains from the first row to the last: a camera that is turned sideways. Disparities are
        bowed then, which is undone along with it (`rectify.unbow`).
    """

    offset: float
    across: float = 0.0
    down: float = 0.0
    keystone: float = 0.0


class Sampling(NamedTuple):
    """Every how many pixels of rows and columns, and every how many candidates, something is computed."""

    step: int = 1
    disparity_step: int = 1


EVERY = Sampling()

WHOLE = 2**24
"""A halo of so many pixels reaches to the image's edge, whatever its size."""


class Halo(NamedTuple):
    """How far around a pixel what it is answered can depend on, in pixels of either image.

    Halos of stages that follow each other are summed, of stages beside each other the larger counts.
    """

    up: int = 0
    down: int = 0
    left: int = 0
    right: int = 0

    def then(self, following: Halo) -> Halo:
        """Of this stage and one that works on its results."""
        return Halo(*(min(WHOLE, mine + its) for mine, its in zip(self, following, strict=True)))

    def beside(self, other: Halo) -> Halo:
        """Of two stages that a third one takes results of."""
        return Halo(*map(max, self, other))

    @classmethod
    def box(cls, size: tuple[int, int]) -> Halo:
        """Of a window of so many columns and rows; an even one reaches one further to the left and up."""
        (width, height) = size
        return cls(height // 2, (height - 1) // 2, width // 2, (width - 1) // 2)

    @classmethod
    def around(cls, columns: int, rows: int | None = None) -> Halo:
        """As far to all sides, or to the left and right and up and down."""
        rows = columns if rows is None else rows
        return cls(rows, rows, columns, columns)


class Rectangle(NamedTuple):
    """Rows ``top, ..., bottom - 1`` and columns ``left, ..., right - 1`` of an image."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.bottom - self.top, self.right - self.left

    @property
    def size(self) -> int:
        """Number of pixels."""
        return (self.bottom - self.top) * (self.right - self.left)

    @property
    def slices(self) -> tuple[slice, slice]:
        """As an index of the image."""
        return slice(self.top, self.bottom), slice(self.left, self.right)


@dataclass(frozen=True)
class Frame:
    """What a part of a pair has to know of the whole that it was cut from.

    Attributes
    ----------
    shape : (H, W)
        Of the whole images.
    top, left : int
        Where in them the part begins.
    limits : (int, int, int, int) or None
        Least and greatest pixel of the whole left image, and of the right one, as `cost.pixels` has them.
    levels : (int, int) or None
        Least and greatest pixel of both, once the right one's rows have been moved.
    planes : tuple of (float, float, float) or None
        Along which windows are matched, as ``a, b, c`` of ``d = a x + b y + c`` over the whole image; None:
        to be found in the part.
    bowed : bool
        Whether disparities stay as a camera that is turned sideways bows them (`rectify.unbow`).
    """

    shape: tuple[int, int]
    top: int = 0
    left: int = 0
    limits: tuple[int, int, int, int] | None = None
    levels: tuple[int, int] | None = None
    planes: tuple[tuple[float, float, float], ...] | None = None
    bowed: bool = False


@dataclass(frozen=True)
class Calibration:
    """A rectified pair's geometry.

    Attributes
    ----------
    focal : float
        Focal length in pixels.
    cx, cy : float
        Principal point of the left image in pixels.
    baseline : float
        Distance between the cameras in metres.
    doffs : float
        ``cx_right - cx_left`` in pixels: the disparity of a point at infinity is ``-doffs``, and
        ``depth = focal * baseline / (disparity + doffs)``.
    width, height : int or None
        Image size in pixels, where the file gives it.
    ndisp : int or None
        A conservative bound on the number of disparities, where the file gives it.
    """

    focal: float
    cx: float
    cy: float
    baseline: float
    doffs: float = 0.0
    width: int | None = None
    height: int | None = None
    ndisp: int | None = None


@dataclass(frozen=True)
class Pair:
    """A rectified stereo pair.

    Attributes
    ----------
    left, right : ndarray
        ``(H, W)`` or ``(H, W, 3)``, the same shape and dtype: uint8, uint16 or float32.
    calibration : Calibration or None
        The pair's geometry, where known.
    name : str
        What messages and tables call it.
    """

    left: Image
    right: Image
    calibration: Calibration | None = None
    name: str = ""


@dataclass(frozen=True)
class Result:
    """A matched pair.

    Attributes
    ----------
    disparity : ndarray of float32, (H, W)
        ``x_left - x_right`` in pixels, referenced to the left image; NaN where invalid.
    confidence : ndarray of float32, (H, W)
        In [0, 1]; 0 where invalid.
    flags : ndarray of uint8, (H, W)
        Bits of `Flag`; 0 where the winner stands as it was found.
    settings : Settings
        Everything that was used, the estimated range included: enough to repeat the result.
    path : str
        ``"streaming"``, ``"composed"``, or ``"merged"``: several streaming passes, along planes or with
        several windows, of which each pixel keeps the best.
    seconds : float
        Wall time of the whole call.
    timings : mapping of str to float
        Wall seconds of each stage that ran, in order.
    stages : mapping of str to ndarray
        The arrays asked for with ``keep``.
    """

    disparity: DisparityMap
    confidence: npt.NDArray[np.float32]
    flags: npt.NDArray[np.uint8]
    settings: Settings
    path: str
    seconds: float
    timings: Mapping[str, float] = field(default_factory=dict)
    stages: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)

    @property
    def density(self) -> float:
        """The fraction of pixels that hold a disparity."""
        return float(np.mean(np.isfinite(self.disparity))) if self.disparity.size else 0.0

    def _repr_html_(self) -> str:
        """Show the result in a notebook."""
        from stereopsis import notebook

        return notebook.result(self)


def worst_cost(dtype: npt.DTypeLike) -> Any:
    """What a candidate that is not possible costs: infinity, or the largest of a type of whole numbers."""
    kind = np.dtype(dtype)
    return np.iinfo(kind).max if kind.kind in "iu" else np.inf
