"""Costs of single pixels, summed over a box: whole numbers, in volumes of 16 bits.

Each image alone says something of its pixels, its features; a candidate's cost compares the left pixel's with
the right one's. Features go on past the image's edges by repeating those of the edge pixels, in both images. A
candidate outside the right image costs `WORST`.
"""

from __future__ import annotations

import dataclasses
import difflib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from stereopsis import _core
from stereopsis.supports import window_size
from stereopsis.types import Disparities

WORST = 65535
"""Of a candidate outside the right image; every other cost is less."""
CENSUS_SIDE = 11
"""Largest side of a census or rank window."""
BOX_SIDE = 127
"""Largest side of the box that costs are summed over."""
PATTERNS = ("dense", "sparse", "symmetric")
ENVIRONMENT = "STEREOPSIS_INSTRUCTIONS"

Box: TypeAlias = int | tuple[int, int] | str
"""Full size in pixels, odd, as one number, as width and height, or as ``"WIDTHxHEIGHT"``."""
Volume: TypeAlias = npt.NDArray[np.uint16]


def odd_box(value: Any, name: str, largest: int) -> int | tuple[int, int]:
    """A box's odd size, as one number where it is square; raises ValueError for another."""
    width, height = window_size(value, name)
    if not (width % 2 and height % 2 and max(width, height) <= largest):
        raise ValueError(f"{name} must have odd sides from 1 to {largest}, not {width} x {height}")
    return width if width == height else (width, height)


class Pixelwise:
    """What these costs share."""

    support: ClassVar[None] = None

    def __str__(self) -> str:
        """As `cost_of` takes it, such as ``census(9x7,dense,1)``."""
        values = (getattr(self, field.name) for field in dataclasses.fields(self))  # type: ignore[arg-type]
        texts = ("x".join(map(str, value)) if isinstance(value, tuple) else str(value) for value in values)
        return f"{name_of(self)}({','.join(texts)})"

    @property
    def box(self) -> tuple[int, int]:
        """Width and height of the box that a pixel's costs are summed over."""
        raise NotImplementedError

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of all that a cost sees, in pixels."""
        raise NotImplementedError

    @property
    def most(self) -> int:
        """The largest cost of one pixel, in one channel."""
        raise NotImplementedError

    @property
    def largest(self) -> int:
        """The largest cost, in one channel."""
        return self.most * self.box[0] * self.box[1]

    def _check_largest(self, name: str) -> None:
        if self.largest >= WORST:
            raise ValueError(
                f"{name} must be smaller: {self.box[0]} x {self.box[1]} costs of up to {self.most} "
                f"sum to {self.largest}, and 16 bits hold up to {WORST - 1}"
            )


@dataclass(frozen=True)
class Census(Pixelwise):
    r"""Census transform [1]_: in how many comparisons of a pixel with its neighbours the two images disagree.

    A pixel's bit string says of each comparison whether the first pixel is darker than the second. The cost
    is the number of bits in which two strings differ. A strictly increasing change of brightness changes
    nothing.

    Attributes
    ----------
    window : int or (int, int)
        Odd sides of up to 11 pixels.
    pattern : {"dense", "sparse", "symmetric"}
        "dense": all neighbours are compared with the window's centre. "sparse": every other one of every
        other row, from the window's corner on. "symmetric": no centre; each neighbour before it, in the order
        of rows, is compared with the one that lies opposite [2]_.
    aggregation : int or (int, int)
        Odd sides of the box over which costs are summed.

    Notes
    -----
    Bit k belongs to the k-th comparison in the order of rows, from the upper left on.

    References
    ----------
    .. [1] R. Zabih, J. Woodfill, Non-parametric local transforms for computing visual correspondence,
       ECCV 1994, doi:10.1007/BFb0028345.
    .. [2] R. Spangenberg, T. Langner, R. Rojas, Weighted semi-global matching and center-symmetric census
       transform for robust driver assistance, CAIP 2013, doi:10.1007/978-3-642-40246-3_5.
    """

    window: Box = (9, 7)
    pattern: Literal["dense", "sparse", "symmetric"] = "dense"
    aggregation: Box = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "window", odd_box(self.window, "window", CENSUS_SIDE))
        object.__setattr__(self, "aggregation", odd_box(self.aggregation, "aggregation", BOX_SIDE))
        if self.pattern not in PATTERNS:
            raise ValueError(f"pattern must be one of {', '.join(PATTERNS)}, not {self.pattern!r}")
        if not self.most:
            raise ValueError(
                f"window must hold a neighbour to compare with, not {self.window!r} ({self.pattern})"
            )
        self._check_largest("aggregation")

    @property
    def box(self) -> tuple[int, int]:
        """Width and height of the box that a pixel's costs are summed over."""
        return window_size(self.aggregation)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of all that a cost sees, in pixels."""
        return _widened(self.window, self.box)

    @property
    def most(self) -> int:
        """The number of comparisons."""
        return len(self.comparisons)

    @property
    def comparisons(self) -> npt.NDArray[np.int32]:
        """Where each comparison looks, (N, 2, 2): of its first and second pixel ``dy, dx``."""
        width, height = window_size(self.window)
        right, below = width // 2, height // 2
        apart = 2 if self.pattern == "sparse" else 1
        around = [
            (dy, dx)
            for dy in range(-below, below + 1, apart)
            for dx in range(-right, right + 1, apart)
            if (dy, dx) != (0, 0)
        ]
        if self.pattern == "symmetric":
            pairs = [((dy, dx), (-dy, -dx)) for dy, dx in around if (dy, dx) < (0, 0)]
        else:
            pairs = [(neighbour, (0, 0)) for neighbour in around]
        return np.array(pairs, np.int32).reshape(-1, 2, 2)


PixelCost: TypeAlias = Census
PIXEL_COSTS: Mapping[str, type[PixelCost]] = MappingProxyType({"census": Census})


def name_of(cost: Any) -> str:
    """What a cost is called in a text."""
    return next(name for name, kind in PIXEL_COSTS.items() if kind is type(cost))


def cost_of(text: str) -> PixelCost:
    """A cost from its name and parts, in their order or by name, such as ``census(9x7,aggregation=3)``.

    Raises
    ------
    ValueError
        For what is none, with the nearest name where one was misspelled.
    """
    name, opened, inside = text.strip().partition("(")
    name, inside = name.strip().lower(), inside.strip()
    if name not in PIXEL_COSTS:
        raise ValueError(f"cost names no cost of pixels {name!r}{_nearest(name, PIXEL_COSTS)}")
    if opened and not inside.endswith(")"):
        raise ValueError(f"cost must close its parentheses, which {text!r} does not")
    kind = PIXEL_COSTS[name]
    parts = [field.name for field in dataclasses.fields(kind)]
    given: dict[str, Any] = {}
    for number, piece in enumerate(_pieces(inside[:-1])):
        part, equals, value = piece.partition("=") if "(" not in piece.partition("=")[0] else ("", "", piece)
        if not equals:
            if number >= len(parts):
                raise ValueError(
                    f"cost has up to {len(parts)} parts, {name}({', '.join(parts)}), not {text!r}"
                )
            part, value = parts[number], piece
        part = part.strip()
        if part not in parts:
            raise ValueError(f"cost {name} has no part {part!r}{_nearest(part, parts)}")
        if part in given:
            raise ValueError(f"cost {name} is given its {part} twice in {text!r}")
        given[part] = _part(part, value.strip())
    return kind(**given)


def _pieces(text: str) -> list[str]:
    """What commas part, but for those in parentheses."""
    pieces, depth = [""], 0
    for sign in text:
        depth += {"(": 1, ")": -1}.get(sign, 0)
        if sign == "," and depth == 0:
            pieces.append("")
        else:
            pieces[-1] += sign
    return pieces if text.strip() else []


def _part(name: str, text: str) -> Any:
    match name:
        case "window" | "aggregation" | "pattern":
            return text
        case _:
            try:
                return float(text)
            except ValueError:
                raise ValueError(f"{name} must be a number, not {text!r}") from None


def _nearest(name: str, known: Any) -> str:
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f"; did you mean {near[0]!r}?" if near else f"; known are {', '.join(known)}"


def _widened(window: Box, box: tuple[int, int]) -> tuple[int, int]:
    width, height = window_size(window)
    return width + box[0] - 1, height + box[1] - 1


def census(
    image: npt.NDArray[Any], comparisons: npt.NDArray[np.int32], threads: int = 0
) -> npt.NDArray[np.uint64]:
    """Bit strings of a census.

    Parameters
    ----------
    image : ndarray of uint8 or int32, (H, W)
        Edge pixels are repeated.
    comparisons : ndarray of int32, (N, 2, 2)
        As `Census.comparisons`, at most 128.
    threads : int

    Returns
    -------
    ndarray of uint64, (P, H, W)
        Bit ``k % 64`` of plane ``k // 64``, from the least significant on, is comparison k.
    """
    strings = np.empty(((len(comparisons) + 63) // 64, *image.shape), np.uint64)
    _core.census(np.ascontiguousarray(image), comparisons, strings, threads, os.environ.get(ENVIRONMENT, ""))
    return strings


def volume(
    cost: PixelCost,
    left: npt.NDArray[Any],
    right: npt.NDArray[Any],
    disparities: Disparities,
    threads: int = 0,
) -> Volume:
    """Costs of all candidates.

    Parameters
    ----------
    cost : Census
    left, right : ndarray of uint8 or int32, (H, W, C)
        The channels' costs are summed.
    disparities : Disparities
        D candidates.
    threads : int

    Returns
    -------
    ndarray of uint16, (H, W, D)
    """
    costs = np.empty((*left.shape[:2], disparities.span), np.uint16)
    for channel in range(left.shape[2]):
        match cost:
            case Census():
                strings = (census(image[..., channel], cost.comparisons, threads) for image in (left, right))
                _sum(0, cost, tuple(strings), disparities, costs, channel > 0, threads)
    return costs


def _sum(
    kind: int,
    cost: PixelCost,
    features: tuple[npt.NDArray[Any], ...],
    disparities: Disparities,
    costs: Volume,
    add: bool,
    threads: int,
    table: npt.NDArray[np.uint8] | None = None,
) -> None:
    """Costs of one channel's features into `costs`, or added to it; `kind` in the core's order."""
    instructions = os.environ.get(ENVIRONMENT, "")
    left, right = features
    bits = cost.most if kind == 0 else 0
    _core.pixel_costs(
        kind,
        left,
        right,
        bits,
        disparities.min,
        cost.most,
        table,
        *cost.box,
        add,
        costs,
        threads,
        instructions,
    )
