"""The colours of every picture: maps that are even in lightness, and palettes for any colour vision.

A map is a ``(256, 3)`` uint8 table of RGB that cannot be written to. NumPy alone is needed.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from stereopsis._numbers import is_number
from stereopsis.types import Flag

Colour = tuple[int, int, int]
Table = npt.NDArray[np.uint8]

INVALID: Final[Colour] = (205, 205, 205)
"""Of a pixel without a value: a grey that none of the maps holds."""

BLACK: Final[Colour] = (0, 0, 0)
ORANGE: Final[Colour] = (230, 159, 0)
SKY_BLUE: Final[Colour] = (86, 180, 233)
GREEN: Final[Colour] = (0, 158, 115)
YELLOW: Final[Colour] = (240, 228, 66)
BLUE: Final[Colour] = (0, 114, 178)
VERMILLION: Final[Colour] = (213, 94, 0)
PURPLE: Final[Colour] = (204, 121, 167)

OKABE_ITO: Final[tuple[Colour, ...]] = (*(BLACK, ORANGE, SKY_BLUE, GREEN, YELLOW, BLUE, VERMILLION, PURPLE),)
"""Eight colours that stay apart for any colour vision: M. Okabe, K. Ito, Color universal design, 2008,
https://jfly.uni-koeln.de/color/."""

FLAG_COLOURS: Final[Mapping[Flag, Colour]] = MappingProxyType(
    {
        Flag.OCCLUDED: ORANGE,
        Flag.MISMATCHED: VERMILLION,
        Flag.AMBIGUOUS: SKY_BLUE,
        Flag.LOW_TEXTURE: BLUE,
        Flag.SKY: YELLOW,
        Flag.OUT_OF_VIEW: BLACK,
        Flag.SPECKLE: GREEN,
        Flag.FILLED: PURPLE,
    }
)
"""The colour of each `Flag`."""

LINES: Final[tuple[Colour, ...]] = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY_BLUE, (140, 140, 140))
"""Colours of lines, in order: those of `OKABE_ITO` that show on white and on black, and a grey."""

ERROR_COLOURS: Final[tuple[tuple[float, Colour], ...]] = (
    (0.0625, (49, 54, 149)),
    (0.125, (69, 117, 180)),
    (0.25, (116, 173, 209)),
    (0.5, (171, 217, 233)),
    (1.0, (224, 243, 248)),
    (2.0, (254, 224, 144)),
    (4.0, (253, 174, 97)),
    (8.0, (244, 109, 67)),
    (16.0, (215, 48, 39)),
    (math.inf, (165, 0, 38)),
)
"""The bands of `stereopsis.error_map`: the normalised error below which each colour (R, G, B) holds."""

UNKNOWN_COLOUR: Final[Colour] = (0, 0, 0)
"""`stereopsis.error_map` where the truth is unknown or masked out."""

UNANSWERED_COLOUR: Final[Colour] = (128, 128, 128)
"""`stereopsis.error_map` where the truth is known and the map gives no answer."""


def colours(
    values: npt.NDArray[Any], limits: tuple[float, float], table: Table | None = None
) -> npt.NDArray[np.uint8]:
    """Look values up in a map.

    Parameters
    ----------
    values : ndarray of real numbers, any shape
        NaN where there is none.
    limits : (float, float)
        The values of the first and the last colour, in order; what lies outside gets the nearest one.
    table : ndarray of uint8, (256, 3), optional
        The map; by default `VIRIDIS`.

    Returns
    -------
    ndarray of uint8, (..., 3)
        RGB; `INVALID` where a value is NaN.

    Raises
    ------
    TypeError
        `values` is not an array of real numbers.
    """
    if not isinstance(values, np.ndarray) or values.dtype.kind not in "biuf":
        what = getattr(values, "dtype", type(values).__name__)
        raise TypeError(f"values must be an array of real numbers, not {what}")
    low, high = limits
    index = np.clip((values.astype(np.float64) - low) * (255 / (high - low)), 0, 255)
    valid = ~np.isnan(index)
    picture = (VIRIDIS if table is None else table)[np.rint(np.where(valid, index, 0)).astype(np.uint8)]
    picture[~valid] = INVALID
    return picture


def flag_colours(flags: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Colour a map of flags; of several flags at a pixel, the one of the lowest bit shows.

    Parameters
    ----------
    flags : ndarray of uint8, any shape
        Bits of `Flag`.

    Returns
    -------
    ndarray of uint8, (..., 3)
        RGB; `INVALID`, a light grey, where there is no flag.

    Raises
    ------
    TypeError
        `flags` is not an array of uint8.
    """
    if not isinstance(flags, np.ndarray) or flags.dtype != np.uint8:
        raise TypeError(
            f"flags must be an array of uint8, not {getattr(flags, 'dtype', type(flags).__name__)}"
        )
    table = np.full((256, 3), INVALID, np.uint8)
    for flag, colour in reversed(list(FLAG_COLOURS.items())):
        table[(np.arange(256) & flag) != 0] = colour
    return table[flags]


def limits(values: npt.NDArray[Any], range: tuple[float, float] | None = None) -> tuple[float, float]:
    """Choose the values of a map's first and last colour.

    Parameters
    ----------
    values : ndarray of real numbers, any shape
        NaN where there is none.
    range : (float, float), optional
        What was asked for; by default the 1st and the 99th percentile of the values.

    Returns
    -------
    (float, float)
        In order, and far enough apart for float32 to tell them apart.

    Raises
    ------
    ValueError
        `range` is not two finite numbers in order.
    """
    if range is not None:
        ends = tuple(range) if isinstance(range, Iterable) else ()
        if len(ends) != 2 or not all(map(is_number, ends)) or not ends[0] < ends[1]:
            raise ValueError(f"range must be two finite numbers in order, not {range!r}")
        return float(ends[0]), float(ends[1])
    valid = values[~np.isnan(values)].astype(np.float64)
    low, high = (float(limit) for limit in np.percentile(valid, (1, 99))) if valid.size else (0.0, 1.0)
    # Below this float32 cannot tell the limits apart.
    least = 1e-6 * max(abs(low), abs(high), 1.0)
    return (low, high) if high - low > least else (low - max(least, 0.5), low + max(least, 0.5))


def ticks(low: float, high: float) -> list[tuple[float, str]]:
    """Choose four to eleven round numbers from `low` to `high`, with their text: what a colour bar says."""
    rough = (high - low) / 4
    power = 10.0 ** math.floor(math.log10(rough))
    step = power * max(factor for factor in (1, 2, 5) if factor * power <= rough)
    decimals = max(0, -math.floor(math.log10(step)))
    numbers = np.arange(math.ceil(low / step), math.floor(high / step) + 1) * step + 0.0  # no "-0"
    return [(float(number), f"{number:.{decimals}f}") for number in numbers]


def hex_code(colour: Colour) -> str:
    """Write a colour as HTML and matplotlib have it, ``#rrggbb``."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def _unpacked(text: str) -> Table:
    table: Table = np.frombuffer(base64.b64decode(text), np.uint8).reshape(256, 3)
    return table


def _straight(*ends: tuple[float, float, float]) -> Table:
    """Straight lines of even steps through colours of CIELAB (D65), as sRGB."""
    place = np.linspace(0, len(ends) - 1, 256)
    lightness, a, b = (np.interp(place, range(len(ends)), part) for part in zip(*ends, strict=True))
    y = (lightness + 16) / 116
    f = np.stack([y + a / 500, y, y - b / 200], axis=1)
    xyz = np.where(f > 6 / 29, f**3, (116 * f - 16) * 27 / 24389) * (0.95047, 1.0, 1.08883)
    linear = xyz @ np.array(
        [
            [3.2404542, -0.9692660, 0.0556434],
            [-1.5371385, 1.8760108, -0.2040259],
            [-0.4985314, 0.0415560, 1.0572252],
        ]
    )
    linear = np.clip(linear, 0, 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    table: Table = np.rint(255 * encoded).astype(np.uint8)
    table.flags.writeable = False
    return table


VIRIDIS: Final = _unpacked(
    "RAFURAJWRQRXRQVZRgdaRghcRgpdRgteRw1gRw5hRxBjRxFkRxNlSBRnSBZoSBdpSBhqSBpsSBttSBxuSB1vSB9wSCBxSCFzSCN0"
    "SCR1SCV2SCZ3SCh4SCl5Ryp6Ryx6Ry17Ry58Ry99RjB+RjJ+RjN/RjSARTWBRTeBRTiCRDmDRDqDRDuEQz2EQz6FQj+FQkCGQkGG"
    "QUKHQUSHQEWIQEaIP0eIP0iJPkmJPkqJPkyKPU2KPU6KPE+KPFCLO1GLO1KLOlOLOlSMOVWMOVaMOFiMOFmMN1qMN1uNNlyNNl2N"
    "NV6NNV+NNGCNNGGNM2KNM2ONMmSOMmWOMWaOMWeOMWiOMGmOMGqOL2uOL2yOLm2OLm6OLm+OLXCOLXGOLHGOLHKOLHOOK3SOK3WO"
    "KnaOKneOKniOKXmOKXqOKXuOKHyOKH2OJ36OJ3+OJ4COJoGOJoKOJoKOJYOOJYSOJYWOJIaOJIeOI4iOI4mOI4qNIouNIoyNIo2N"
    "IY6NIY+NIZCNIZGMIJKMIJKMIJOMH5SMH5WLH5aLH5eLH5iLH5mKH5qKHpuKHpyJHp2JH56JH5+IH6CIH6GIH6GHH6KHIKOGIKSG"
    "IaWFIaaFIqeFIqiEI6mDJKqDJauCJayCJq2BJ62BKK6AKa9/KrB/LLF+LbJ9LrN8L7R8MbV7MrZ6NLZ5Nbd5N7h4OLl3Orp2O7t1"
    "Pbx0P7xzQL1yQr5xRL9wRsBvSMFuSsFtTMJsTsNrUMRqUsVpVMVoVsZnWMdlWshkXMhjXsliYMpgY8tfZcteZ8xcac1bbM1abs5Y"
    "cM9Xc9BWddBUd9FTetFRfNJQf9NOgdNNhNRLhtVJidVIi9ZGjtZFkNdDk9dBldhAmNg+m9k8ndk7oNo5oto3pds2qNs0qtwyrdww"
    "sN0vst0ttd4ruN4put4ovd8mwN8lwt8jxeAhyOAgyuEfzeEd0OEc0uIb1eIa2OIZ2uMZ3eMY3+MY4uQY5eQZ5+QZ6uUa7OUb7+Uc"
    "8eUd9OYe9uYg+OYh++cj/ecl"
)
"""Dark blue over green to yellow, for disparities and depth: S. van der Walt, N. Smith, 2015, CC0,
https://bids.github.io/colormap/."""

CIVIDIS: Final = _unpacked(
    "ACJOACNPACRRACVTACVUACZWACdYAChZAChbACldACpfACphACtiACxkACxmAC1oAC5qAC5sAC9tADBvADBwADFwADFxATJxBTNx"
    "CDNwDDRwDzVwEjVwFDZwFjdwGDdvGjhvHDlvHjpvIDpvITtuIzxuJDxuJj1uJz5uKT9uKj9tK0BtLUFtLkFtL0JtMUNtMkNtM0Rt"
    "NEVsNUVsNkZsOEdsOUhsOkhsO0lsPEpsPUpsPktsP0xsQExsQU1sQk5sQ05sRE9sRVBsRlFsR1FsSFJsSVNsSlNsS1RsTFVsTVVs"
    "TlZsT1dsUFdsUVhtUlltU1ptVFptVVttVVxtVlxtV11tWF5tWV5uWl9uW2BuXGFuXWFuXmJuXmNvX2NvYGRvYWVvYmVvY2ZwZGdw"
    "ZWhwZWhwZmlwZ2pxaGpxaWtxamxxa21ybG1ybG5ybW9ybm9zb3BzcHFzcXJ0cnJ0cnN0c3R1dHR1dXV1dnZ2d3d2d3d3eHh3eXl3"
    "enp4e3p4fHt4fXx4fnx4fn14f354gH94gX94goB5g4F5hIJ5hYJ5hoN5h4R4iIV4iYV4ioZ4i4d4jIh4jYh4jol4j4p4kIt4kYt4"
    "kox4ko14k454lI53lY93lpB3l5F3mJJ3mZJ3mpN2m5R2nJV2nZV2npZ2n5d1oJh1oZl1opl1o5p0pJt0pZx0ppx0p51zqJ5zqZ9z"
    "qqBzq6ByrKFyraJyrqNxr6RxsKVxsaVws6ZwtKdvtahvtqlvt6luuKpuuattuqxtu61tvK5sva5svq9rv7BrwLFqwbJqwrNpw7Np"
    "xLRoxbVoxrZnx7dnyLhmyblly7llzLpkzbtjzrxjz71i0L5i0b9h0sBg08Bf1MFf1cJe1sNd18Rc2cVc2sZb28da3MhZ3chY3slY"
    "38pX4MtW4cxV4s1U5M5T5c9S5tBR59FQ6NJP6dNO6tNM69RL7dVK7tZJ79dI8NhG8dlF8tpE89tC9dxB9t0/994++N88+eA6++E4"
    "/OI2/eM0/uQ0/uU1/uY2/ug4"
)
"""Dark blue over grey to yellow, nearly alike for every colour vision, for what stands beside disparities:
confidence. J. R. Nuñez, C. R. Anderton, R. S. Renslow, Optimizing colormaps with consideration for color
vision deficiency, PLOS ONE 2018, CC0, doi:10.1371/journal.pone.0199239."""

DIVERGING: Final = _straight((36, 10, -47), (96, 0, 0), (36, 32, 45))
"""Blue over white to brown, for signed errors: straight lines in CIELAB, so that equal steps look equal and
both ends weigh alike."""
