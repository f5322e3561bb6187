"""Costs of single pixels, summed over a box: whole numbers, in volumes of 16 bits.

Each image alone says something of its pixels, its features; a candidate's cost compares the left pixel's with
the right one's. Features go on past an image's edges by repeating those of the edge pixels. A candidate
outside the right image costs `WORST`.

Census and rank compare pixels as they are. The other costs take 8 bits, the `levels`: of 8-bit images these
are the pixels, of others what is left of ``pixel - least`` of both images once it is halved until it fits.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import numbers
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from stereopsis import _core, _instructions
from stereopsis.supports import window_size
from stereopsis.types import Disparities, Halo

WORST = 65535
"""Of a candidate outside the right image; every other cost is less."""
CENSUS_SIDE = 11
"""Largest side of a census or rank window."""
COMBINED = 4095
"""The largest cost of a `Combined`."""
BOX_SIDE = 127
"""Largest side of the box that costs are summed over."""
DEEPEST = 32
PATTERNS = ("dense", "sparse", "symmetric")

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
    def size(self) -> tuple[int, int]:
        """Width and height of all that a cost sees, in pixels."""
        raise NotImplementedError

    def largest(self, channels: int = 1) -> int:
        """The largest cost of images with so many channels."""
        raise NotImplementedError

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)


class _Single(Pixelwise):
    """A cost that is no combination of others."""

    _box: ClassVar[str] = "window"
    """The field that says over which box costs are summed."""

    @property
    def box(self) -> tuple[int, int]:
        """Width and height of the box that a pixel's costs are summed over."""
        return window_size(getattr(self, self._box))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of all that a cost sees, in pixels."""
        return self.box

    @property
    def most(self) -> int:
        """The largest cost of one pixel, in one channel."""
        raise NotImplementedError

    def largest(self, channels: int = 1) -> int:
        """The largest cost of images with so many channels."""
        return self.most * self.box[0] * self.box[1] * channels

    def _check_box(self) -> None:
        self._set(self._box, odd_box(getattr(self, self._box), self._box, BOX_SIDE))
        if self.largest() >= WORST:
            raise ValueError(
                f"{self._box} must be smaller: {self.box[0]} x {self.box[1]} costs of up to {self.most} "
                f"sum to {self.largest()}, and 16 bits hold up to {WORST - 1}"
            )

    def _check_whole(self, name: str, most: int) -> None:
        value: Any = getattr(self, name)
        whole = isinstance(value, numbers.Real) and not isinstance(value, bool) and value == value // 1
        if not (whole and 1 <= value <= most):
            raise ValueError(f"{name} must be a whole number from 1 to {most}, not {value!r}")
        self._set(name, int(value))


class _Neighbourhood(_Single):
    """A cost that compares a pixel with those in a window around it, and sums over a box besides."""

    window: Box
    _box: ClassVar[str] = "aggregation"

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of all that a cost sees, in pixels."""
        return _widened(self.window, self.box)

    def _check(self) -> None:
        self._set("window", odd_box(self.window, "window", CENSUS_SIDE))
        if not self.most:
            raise ValueError(f"window must hold a neighbour to compare with, which {self!r} does not")
        self._check_box()


@dataclass(frozen=True)
class Census(_Neighbourhood):
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
        if self.pattern not in PATTERNS:
            raise ValueError(f"pattern must be one of {', '.join(PATTERNS)}, not {self.pattern!r}")
        self._check()

    @property
    def most(self) -> int:
        """The number of comparisons."""
        return len(self.comparisons)

    @property
    def comparisons(self) -> npt.NDArray[np.int32]:
        """Where each comparison looks, (N, 2, 2): of its first and second pixel ``dy, dx``."""
        return _comparisons(*window_size(self.window), self.pattern)


@lru_cache(maxsize=64)
def _comparisons(width: int, height: int, pattern: str) -> npt.NDArray[np.int32]:
    right, below = width // 2, height // 2
    apart = 2 if pattern == "sparse" else 1
    around = [
        (dy, dx)
        for dy in range(-below, below + 1, apart)
        for dx in range(-right, right + 1, apart)
        if (dy, dx) != (0, 0)
    ]
    if pattern == "symmetric":
        pairs = [((dy, dx), (-dy, -dx)) for dy, dx in around if (dy, dx) < (0, 0)]
    else:
        pairs = [(neighbour, (0, 0)) for neighbour in around]
    found = np.array(pairs, np.int32).reshape(-1, 2, 2)
    found.setflags(write=False)
    return found


@dataclass(frozen=True)
class Rank(_Neighbourhood):
    """Rank transform [1]_: how many neighbours are darker than the pixel; the difference of both counts.

    Attributes
    ----------
    window : int or (int, int)
        Odd sides of up to 11 pixels.
    aggregation : int or (int, int)
        Odd sides of the box over which costs are summed.

    References
    ----------
    .. [1] R. Zabih, J. Woodfill, Non-parametric local transforms for computing visual correspondence,
       ECCV 1994, doi:10.1007/BFb0028345.
    """

    window: Box = (9, 7)
    aggregation: Box = 9

    def __post_init__(self) -> None:
        self._check()

    @property
    def most(self) -> int:
        """The number of neighbours."""
        width, height = window_size(self.window)
        return width * height - 1


@dataclass(frozen=True)
class Gradient(_Single):
    r"""Difference of gradients: :math:`\min(|\Delta g_x| + |\Delta g_y|, \tau)`, blind to an offset [1]_.

    :math:`g_x = I(x + 1, y) - I(x - 1, y)`, and :math:`g_y` likewise, in `levels`.

    Attributes
    ----------
    window : int or (int, int)
        Odd sides of the box over which costs are summed.
    truncation : int
        The largest cost of a pixel, from 1 to 255.

    References
    ----------
    .. [1] A. Hosni, C. Rhemann, M. Bleyer, C. Rother, M. Gelautz, Fast cost-volume filtering for visual
       correspondence and beyond, IEEE TPAMI 35(2), 2013, doi:10.1109/TPAMI.2012.156.
    """

    window: Box = 9
    truncation: int = 60

    def __post_init__(self) -> None:
        self._check_whole("truncation", 255)
        self._check_box()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of all that a cost sees, in pixels."""
        return _widened(3, self.box)

    @property
    def most(self) -> int:
        """The truncation."""
        return self.truncation


@dataclass(frozen=True)
class BirchfieldTomasi(_Single):
    r"""Birchfield and Tomasi's sampling-insensitive difference, truncated [1]_, in half `levels`.

    How far a pixel lies outside the values that the other image takes within half a pixel of its match, with
    straight lines between pixels; of both ways round the smaller.

    Attributes
    ----------
    window : int or (int, int)
        Odd sides of the box over which costs are summed.
    truncation : int
        The largest difference, from 1 to 127 levels.

    References
    ----------
    .. [1] S. Birchfield, C. Tomasi, A pixel dissimilarity measure that is insensitive to image sampling,
       IEEE TPAMI 20(4), 1998, doi:10.1109/34.677269.
    """

    window: Box = 9
    truncation: int = 31

    def __post_init__(self) -> None:
        self._check_whole("truncation", 127)
        self._check_box()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of all that a cost sees, in pixels."""
        return _widened((3, 1), self.box)

    @property
    def most(self) -> int:
        """Twice the truncation."""
        return 2 * self.truncation


@dataclass(frozen=True)
class MutualInformation(_Single):
    r"""How little a pair of grey levels tells of each other, learnt from the pair of images itself [1]_.

    With :math:`P` the share of matched pixels that have these levels, in a first map, and :math:`g` a 7 x 7
    Gaussian of one level, the information is :math:`mi(i, k) = h_{12}(i, k) - h_1(i) - h_2(k)`,
    :math:`h = g * \log(g * P)`. See `information`.

    Attributes
    ----------
    window : int or (int, int)
        Odd sides of the box over which costs are summed.

    References
    ----------
    .. [1] H. Hirschmüller, Stereo processing by semiglobal matching and mutual information,
       IEEE TPAMI 30(2), 2008, doi:10.1109/TPAMI.2007.1166.
    """

    window: Box = 9

    def __post_init__(self) -> None:
        self._check_box()

    @property
    def most(self) -> int:
        """The largest entry that a table has."""
        return 255


@dataclass(frozen=True)
class Combined(Pixelwise):
    """A weighted mean of two costs, each as a fraction of its largest value, in units of 1 / 4095.

    Attributes
    ----------
    a, b : Census, Rank, Gradient, BirchfieldTomasi, MutualInformation or Combined
    weight_a, weight_b : float
        Not negative; only their ratio counts.

    Examples
    --------
    >>> import stereopsis as st
    >>> cost = st.Combined(st.Census((9, 7)), 0.6, st.Gradient(3), 0.4)
    """

    a: PixelCost
    weight_a: float
    b: PixelCost
    weight_b: float

    def __post_init__(self) -> None:
        for name in ("a", "b"):
            part = getattr(self, name)
            if not isinstance(part, Pixelwise):
                known = ", ".join(kind.__name__ for kind in PIXEL_COSTS.values())
                raise TypeError(f"{name} must be one of {known}, not {part!r}")
        for name in ("weight_a", "weight_b"):
            weight: Any = getattr(self, name)
            number = isinstance(weight, numbers.Real) and not isinstance(weight, bool)
            if not (number and 0 <= float(weight) < math.inf):
                raise ValueError(f"{name} must be a number of at least 0, not {weight!r}")
            self._set(name, float(weight))
        if not 0 < self.weight_a + self.weight_b < math.inf:
            raise ValueError("weight_a and weight_b must not both be 0, and have a sum")

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of all that a cost sees, in pixels."""
        (width, height), (other_width, other_height) = self.a.size, self.b.size
        return max(width, other_width), max(height, other_height)

    def largest(self, channels: int = 1) -> int:
        """The largest cost of images with so many channels."""
        if max(self.a.largest(channels), self.b.largest(channels)) >= WORST:
            return WORST
        return COMBINED

    def factors(self, channels: int = 1) -> tuple[int, int]:
        """What units of 2^-16 the parts' costs are multiplied by."""
        total = self.weight_a + self.weight_b
        return tuple(  # type: ignore[return-value]
            int(2**16 * COMBINED * (weight / total) / part.largest(channels))
            for part, weight in ((self.a, self.weight_a), (self.b, self.weight_b))
        )


PixelCost: TypeAlias = Census | Rank | Gradient | BirchfieldTomasi | MutualInformation | Combined
PIXEL_COSTS: Mapping[str, type[PixelCost]] = MappingProxyType(
    {
        "census": Census,
        "rank": Rank,
        "gradient": Gradient,
        "birchfield-tomasi": BirchfieldTomasi,
        "mutual-information": MutualInformation,
        "combined": Combined,
    }
)


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
    if inside.count("(") > DEEPEST:
        raise ValueError(f"cost must be made of at most {DEEPEST} parts in parentheses, not {text[:60]!r}...")
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
    missing = [
        field.name
        for field in dataclasses.fields(kind)
        if field.default is dataclasses.MISSING and field.name not in given
    ]
    if missing:
        raise ValueError(f"cost {name}({', '.join(parts)}) needs its {', '.join(missing)}, not {text!r}")
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
        case "a" | "b":
            return cost_of(text)
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
    _core.census(np.ascontiguousarray(image), comparisons, strings, threads, _instructions.forced())
    return strings


def levels(
    left: npt.NDArray[Any], right: npt.NDArray[Any], limits: tuple[int, int] | None = None
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]:
    """8 bits of both images, (H, W, C) uint8 or int32: less their least pixel, and halved until all fit.

    Parts of larger images are told these images' least and greatest pixel, `limits`.
    """
    if left.dtype == np.uint8:
        return left, right
    least, most = limits or (
        min(int(left.min()), int(right.min())),
        max(int(left.max()), int(right.max())),
    )
    halvings = max(0, (most - least).bit_length() - 8)
    first, second = ((image - np.int32(least) >> halvings).astype(np.uint8) for image in (left, right))
    return first, second


def needs_information(cost: Pixelwise) -> bool:
    """Whether `volume` needs tables of information for this cost."""
    if isinstance(cost, Combined):
        return needs_information(cost.a) or needs_information(cost.b)
    return isinstance(cost, MutualInformation)


def volume(
    cost: PixelCost,
    left: npt.NDArray[Any],
    right: npt.NDArray[Any],
    disparities: Disparities,
    threads: int = 0,
    tables: Sequence[npt.NDArray[np.uint8]] | None = None,
    limits: tuple[int, int] | None = None,
) -> Volume:
    """Costs of all candidates.

    Parameters
    ----------
    cost : Census, Rank, Gradient, BirchfieldTomasi, MutualInformation or Combined
    left, right : ndarray of uint8 or int32, (H, W, C)
        The channels' costs are summed.
    disparities : Disparities
        D candidates.
    threads : int
    tables : sequence of ndarray of uint8, (256, 256) each, optional
        For `MutualInformation`: a channel's cost of each pair of a left and a right level.
    limits : (int, int), optional
        As for `levels`.

    Returns
    -------
    ndarray of uint16, (H, W, D)

    Raises
    ------
    ValueError
        For a box whose costs, summed over the channels, 16 bits do not hold; or tables that are missing.
    """
    channels = left.shape[2]
    if cost.largest(channels) >= WORST:
        raise ValueError(f"cost must sum to at most {WORST - 1} over {channels} channels, not {cost!r}")
    if tables is None and needs_information(cost):
        raise ValueError(f"tables must be given for {name_of(cost)}, one for each channel")
    if isinstance(cost, Combined):
        costs, other = (
            volume(part, left, right, disparities, threads, tables, limits) for part in (cost.a, cost.b)
        )
        _core.combine(costs, other, *cost.factors(channels), threads)
        return costs
    if not isinstance(cost, Census | Rank):
        left, right = levels(left, right, limits)
    costs = np.empty((*left.shape[:2], disparities.span), np.uint16)
    for channel in range(channels):
        table = None if tables is None else tables[channel]
        features = [_features(cost, image[..., channel], threads) for image in (left, right)]
        _core.pixel_costs(
            _KINDS[type(cost)],
            features[0],
            features[1],
            cost.most if isinstance(cost, Census) else 0,
            disparities.min,
            cost.most,
            table if isinstance(cost, MutualInformation) else None,
            *cost.box,
            channel > 0,
            costs,
            threads,
            _instructions.forced(),
        )
    return costs


_KINDS: Mapping[type[PixelCost], int] = MappingProxyType(
    {Census: 0, Rank: 1, Gradient: 2, BirchfieldTomasi: 3, MutualInformation: 4}
)
"""In the core's order."""


def halo(cost: PixelCost) -> Halo:
    """What a cost depends on, in both images."""
    return Halo.box(cost.size)


def _features(cost: PixelCost, image: npt.NDArray[Any], threads: int) -> npt.NDArray[Any]:
    """What an image alone says of its pixels, (P, H, W), as the core compares it."""
    match cost:
        case Census():
            return census(image, cost.comparisons, threads)
        case Rank(window=window):
            strings = census(image, Census(window).comparisons, threads)
            pairs_of_bytes = strings.view(np.uint16).reshape(*strings.shape, 4)
            ranks: npt.NDArray[np.uint8] = _BITS[pairs_of_bytes].sum(axis=(0, 3), dtype=np.uint8)
            return ranks[None]
        case Gradient():
            wide = np.pad(image.astype(np.int16), 1, mode="edge")
            return np.stack([wide[1:-1, 2:] - wide[1:-1, :-2], wide[2:, 1:-1] - wide[:-2, 1:-1]])
        case BirchfieldTomasi():
            wide = np.pad(image.astype(np.int16), ((0, 0), (1, 1)), mode="edge")
            here = wide[:, 1:-1]
            around = 2 * here, here + wide[:, :-2], here + wide[:, 2:]
            return np.stack([around[0], np.minimum.reduce(around), np.maximum.reduce(around)])
        case _:
            return np.ascontiguousarray(image)[None]


_BITS = np.array([word.bit_count() for word in range(2**16)], np.uint8)


def information(
    left: npt.NDArray[np.uint8], right: npt.NDArray[np.uint8], disparity: npt.NDArray[np.float32]
) -> npt.NDArray[np.uint8]:
    r"""What pairs of levels cost, from the pairs that a map matches.

    ``cost = min(255, round(16 (max mi - mi)))`` with the information mi in nats: see `MutualInformation`.
    Shares below 1e-7 count as that. Where nothing is matched, levels cost their difference.

    Parameters
    ----------
    left, right : ndarray of uint8, (H, W)
        One channel's levels.
    disparity : ndarray of float32, (H, W)
        NaN where nothing is known. The match is the nearest column.

    Returns
    -------
    ndarray of uint8, (256, 256)
        By left and right level.
    """
    y, x = np.nonzero(np.isfinite(disparity))
    match = np.rint(x - disparity[y, x]).astype(np.int64)
    inside = (match >= 0) & (match < disparity.shape[1])
    y, x, match = y[inside], x[inside], match[inside]
    if not y.size:
        level = np.arange(256)
        return abs(level[:, None] - level).astype(np.uint8)
    pairs = left[y, x].astype(np.int64) * 256 + right[y, match]
    share = np.bincount(pairs, minlength=256 * 256).reshape(256, 256) / y.size
    alone = (_log_smoothed(share.sum(axis=axis), (0,)) for axis in (1, 0))
    from_left, from_right = alone
    mutual = _log_smoothed(share, (0, 1)) - from_left[:, None] - from_right
    costs: npt.NDArray[np.uint8] = np.minimum(np.rint(16 * (mutual.max() - mutual)), 255).astype(np.uint8)
    return costs


def _log_smoothed(share: npt.NDArray[np.float64], axes: tuple[int, ...]) -> npt.NDArray[np.float64]:
    """``g * log(g * share)``, levels beyond 0 and 255 being like these."""

    def smoothed(of: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        for axis in axes:
            at = np.arange(of.shape[axis])
            of = sum(
                weight * of.take((at + step).clip(0, 255), axis)
                for step, weight in enumerate(_GAUSSIAN, start=-3)
            )
        return of

    return smoothed(np.log(np.maximum(smoothed(share), 1e-7)))


_GAUSSIAN = np.exp(-0.5 * np.arange(-3, 4) ** 2) / np.exp(-0.5 * np.arange(-3, 4) ** 2).sum()
