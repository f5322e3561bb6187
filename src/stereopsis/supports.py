"""Support windows: which neighbours speak for a pixel, and with what weight.

A window is a box, given by its size alone, or one of the supports here. Their weights are never negative, sum
to 1, and come from the position (`Gaussian`) or from the left image alone (`Bilateral`, `Cross`, `Adaptive`):
the right image's window is the same set of offsets with the same weights, at every candidate.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, TypeAlias

from stereopsis._numbers import is_number, is_whole

MAX_WINDOW = 255
MAX_RADIUS = 1023
"""Of a `Gaussian`, in pixels."""


def _is_positive(value: Any) -> bool:
    return is_number(value) and value > 0


class _Support:
    """What the supports share: their text, and checked numbers."""

    def __str__(self) -> str:
        """As `window` takes it, such as ``gaussian:5,4``."""
        values = (getattr(self, field.name) for field in dataclasses.fields(self))  # type: ignore[arg-type]
        texts = ("x".join(map(str, value)) if isinstance(value, tuple) else str(value) for value in values)
        return f"{type(self).__name__.lower()}:{','.join(texts)}"

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)

    def _positive(self, *names: str) -> None:
        for name in names:
            value = getattr(self, name)
            if not _is_positive(value):
                raise ValueError(f"{name} must be a positive number, not {value!r}")
            # A whole number stays as it is written.
            self._set(name, int(value) if float(value).is_integer() else float(value))

    def _sides(self, name: str) -> tuple[int, int]:
        sides = window_size(getattr(self, name), name)
        self._set(name, sides[0] if sides[0] == sides[1] else sides)
        return sides


@dataclass(frozen=True)
class Gaussian(_Support):
    r"""Weights :math:`\exp(-(i^2 + j^2) / 2 \sigma^2)`, cut off and made to sum to 1.

    Attributes
    ----------
    sigma : float
        Pixels.
    truncate : float
        The window reaches ``round(sigma * truncate)`` pixels to every side, at most 1023.
    """

    sigma: float
    truncate: float = 4.0

    def __post_init__(self) -> None:
        self._positive("sigma", "truncate")
        if self.radius > MAX_RADIUS:
            raise ValueError(
                f"sigma * truncate must be at most {MAX_RADIUS} pixels, not {self.sigma * self.truncate:g}"
            )

    @property
    def radius(self) -> int:
        """How far the window reaches to every side, in pixels."""
        return math.floor(self.sigma * self.truncate + 0.5)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the box with the same variance, at most 255."""
        side = min(MAX_WINDOW, 2 * round(self.sigma * math.sqrt(3)) + 1)
        return side, side


@dataclass(frozen=True)
class Bilateral(_Support):
    r"""Adaptive support weights [1]_: neighbours that are near, and like the pixel in colour.

    :math:`w = \exp(-\Delta c / \sigma_c - \Delta g / \sigma_g)` with :math:`\Delta g` the distance in pixels
    and :math:`\Delta c` the distance of colour from the window's middle, the root of the channels' mean
    squared difference. Only the left window weighs: so the weights are the same for all candidates.

    Attributes
    ----------
    size : int or (int, int)
        The window's full size in pixels, or width and height; from 1 to 255.
    sigma_space : float
        Pixels.
    sigma_colour : float
        Grey levels.

    Notes
    -----
    Time grows with the window's area.

    References
    ----------
    .. [1] K.-J. Yoon, I. S. Kweon, Adaptive support-weight approach for correspondence search,
       IEEE TPAMI 28(4), 2006, doi:10.1109/TPAMI.2006.70.
    """

    size: int | tuple[int, int]
    sigma_space: float = 14.0
    sigma_colour: float = 20.0

    def __post_init__(self) -> None:
        self._sides("size")
        self._positive("sigma_space", "sigma_colour")


@dataclass(frozen=True)
class Cross(_Support):
    """A region of the pixel's own colour, grown as crosses [1]_.

    From every pixel four arms go on as long as each channel differs from the pixel's by at most `threshold`,
    and at least to the neighbour. The region is the pixel's vertical arm, and the horizontal arms of each of
    that arm's pixels. It ends at the image's edge, and its pixels weigh the same. Only the left image
    decides, which keeps the region the same for all candidates; the paper meets it with the right image's.

    Attributes
    ----------
    arm : int
        The longest that an arm may be, in pixels; from 1 to 255.
    threshold : float
        Grey levels.

    References
    ----------
    .. [1] K. Zhang, J. Lu, G. Lafruit, Cross-based local stereo matching using orthogonal integral images,
       IEEE TCSVT 19(7), 2009, doi:10.1109/TCSVT.2009.2020478.
    """

    arm: int
    threshold: float = 20.0

    def __post_init__(self) -> None:
        if not (is_whole(self.arm) and 1 <= self.arm <= MAX_WINDOW):
            raise ValueError(f"arm must be a whole number from 1 to {MAX_WINDOW}, not {self.arm!r}")
        self._set("arm", int(self.arm))
        self._positive("threshold")

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the box that the longest arms span, at most 255."""
        side = min(MAX_WINDOW, 2 * self.arm + 1)
        return side, side


@dataclass(frozen=True)
class Adaptive(_Support):
    r"""A box whose size follows the texture: small where there is much of it, large where there is little.

    At each pixel the smallest box that holds enough textured pixels: that :math:`\sum g^2 / (g^2 + \nu^2)`
    over the box reaches `pixels`, with :math:`g` the left image's horizontal gradient and :math:`\nu` the
    `gradient` that stands out of the noise. Each pixel of the sum counts at most 1, so that a single strong
    edge, which is no texture, never is enough.

    Attributes
    ----------
    smallest, largest : int or (int, int)
        Full size in pixels, or width and height; from 1 to 255. The boxes between them grow evenly from one
        to the other, by two pixels at a time.
    pixels : float
        Pixels.
    gradient : float
        Grey levels a pixel.

    Notes
    -----
    Windows that follow the image go back to [1]_, which needs a first disparity map to choose them. Low and
    wide boxes suit roads, where disparity changes from row to row.

    References
    ----------
    .. [1] T. Kanade, M. Okutomi, A stereo matching algorithm with an adaptive window: theory and experiment,
       IEEE TPAMI 16(9), 1994, doi:10.1109/34.310690.
    """

    smallest: int | tuple[int, int]
    largest: int | tuple[int, int] = (161, 15)
    pixels: float = 60
    gradient: float = 2

    def __post_init__(self) -> None:
        small, large = self._sides("smallest"), self._sides("largest")
        if small[0] > large[0] or small[1] > large[1]:
            raise ValueError(
                f"smallest must be at most as wide and as high as largest, {large[0]} x {large[1]}, "
                f"not {small[0]} x {small[1]}"
            )
        self._positive("pixels", "gradient")

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the largest box."""
        return window_size(self.largest)

    @property
    def sizes(self) -> list[tuple[int, int]]:
        """Widths and heights of the boxes to choose from, smallest first."""
        (width, height), (widest, highest) = window_size(self.smallest), window_size(self.largest)
        wider, higher = (widest - width) // 2, (highest - height) // 2
        last = max(wider, higher)
        return [
            (
                width + 2 * ((wider * k + last // 2) // max(last, 1)),
                height + 2 * ((higher * k + last // 2) // max(last, 1)),
            )
            for k in range(last + 1)
        ]


Support: TypeAlias = Gaussian | Bilateral | Cross | Adaptive
SUPPORTS: Mapping[str, type[Support]] = MappingProxyType(
    {"gaussian": Gaussian, "bilateral": Bilateral, "cross": Cross, "adaptive": Adaptive}
)
Window: TypeAlias = int | tuple[int, int] | str | Support
"""Full size in pixels: ``31``, ``(width, height)``, or as text ``"31x15"``; or a support, also as text, such
as ``"gaussian:5"``. An even window reaches one pixel further to the left and up than to right and down."""


def window_size(window: Any, name: str = "window") -> tuple[int, int]:
    """Width and height of a box.

    Raises
    ------
    ValueError
        If a side is not a whole number from 1 to 255.
    """
    sides: Any = window
    if isinstance(window, str):
        sides = [int(side) if side.strip().isdigit() else side for side in window.lower().split("x")]
    elif not isinstance(window, tuple | list):
        sides = [window]
    sides = [sides[0], sides[0]] if len(sides) == 1 else list(sides)
    if len(sides) != 2 or not all(is_whole(side) and 1 <= side <= MAX_WINDOW for side in sides):
        also = f", or one of {', '.join(_form(kind) for kind in SUPPORTS)}" if name == "window" else ""
        raise ValueError(
            f"{name} must be a whole number from 1 to {MAX_WINDOW}, or two as WIDTHxHEIGHT{also}, "
            f"not {window!r}"
        )
    return int(sides[0]), int(sides[1])


def as_window(window: Any) -> int | tuple[int, int] | Support:
    """A box's size, as one number where it is square, or a support, from any form that `Window` has.

    Raises
    ------
    ValueError
        For what is none, with the nearest name where one was misspelled.
    """
    if isinstance(window, Gaussian | Bilateral | Cross | Adaptive):
        return window
    if isinstance(window, str) and ":" in window:
        return _support_of(window)
    width, height = window_size(window)
    return width if width == height else (width, height)


def _form(kind: str) -> str:
    names = [field.name.upper() for field in dataclasses.fields(SUPPORTS[kind])]
    return f"{kind}:{names[0]}" + "".join(f"[,{name}]" for name in names[1:])


def _support_of(text: str) -> Support:
    kind, _, rest = text.partition(":")
    kind = kind.strip().lower()
    if kind not in SUPPORTS:
        near = difflib.get_close_matches(kind, SUPPORTS, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(SUPPORTS)}"
        raise ValueError(f"window names no support {kind!r}; {hint}")
    given = [part.strip() for part in rest.split(",")]
    if not 1 <= len(given) <= len(dataclasses.fields(SUPPORTS[kind])):
        raise ValueError(f"window must be {_form(kind)}, not {text!r}")

    def value(part: str) -> Any:
        if "x" in part.lower():
            return window_size(part)
        try:
            return int(part)
        except ValueError:
            try:
                return float(part)
            except ValueError:
                raise ValueError(f"window must be {_form(kind)}, not {text!r}") from None

    return SUPPORTS[kind](*(value(part) for part in given))
