"""The compiled kernels. Private: shapes, dtypes and ranges are checked, but in few words."""

from typing import Any, overload

import numpy as np
import numpy.typing as npt

_U8 = npt.NDArray[np.uint8]
_I32 = npt.NDArray[np.int32]
_I64 = npt.NDArray[np.int64]
_F32 = npt.NDArray[np.float32]

narrow_limit: int
largest_stride: int

def instruction_sets() -> list[str]: ...
@overload
def grey(rgb: _U8, out: _U8, threads: int, /) -> None: ...
@overload
def grey(rgb: _I32, out: _I32, threads: int, /) -> None: ...
def match_narrow(
    left: _U8,
    right: _U8,
    first: int,
    count: int,
    cost: int,
    window_width: int,
    window_height: int,
    subpixel: int,
    left_right: float | None,
    uniqueness: float | None,
    disparity: _F32,
    confidence: _F32,
    flags: _U8,
    threads: int,
    instructions: str,
    /,
) -> None: ...
def match_wide(
    left: _I32,
    right: _I32,
    first: int,
    count: int,
    cost: int,
    window_width: int,
    window_height: int,
    subpixel: int,
    left_right: float | None,
    uniqueness: float | None,
    disparity: _F32,
    confidence: _F32,
    flags: _U8,
    threads: int,
    instructions: str,
    /,
) -> None: ...
def match_gaussian(
    left: _U8,
    right: _U8,
    first: int,
    count: int,
    cost: int,
    stride: int,
    taps: npt.NDArray[np.float64],
    subpixel: int,
    left_right: float | None,
    uniqueness: float | None,
    disparity: _F32,
    confidence: _F32,
    flags: _U8,
    threads: int,
    instructions: str,
    /,
) -> None: ...
def terms(
    left: _I32,
    right: _I32,
    first: int,
    window_width: int,
    window_height: int,
    term: int,
    out: _I64,
    threads: int,
    /,
) -> None: ...
def box(terms: _I64, window_width: int, window_height: int, sums: _I64, threads: int, /) -> None: ...
def score(
    left: _I32,
    right: _I32,
    first: int,
    window_width: int,
    window_height: int,
    cost: int,
    narrow: bool,
    sums: _I64,
    costs: npt.NDArray[Any],
    threads: int,
    /,
) -> None: ...
def score_zsad(
    left: _I32, right: _I32, first: int, window_width: int, window_height: int, costs: _F32, threads: int, /
) -> None: ...
def select_left(
    volume: npt.NDArray[Any],
    first: int,
    index: _I32,
    cost: npt.NDArray[Any],
    before: npt.NDArray[Any],
    after: npt.NDArray[Any],
    second: npt.NDArray[Any],
    threads: int,
    /,
) -> None: ...
def select_right(volume: npt.NDArray[Any], first: int, index: _I32, threads: int, /) -> None: ...
def texture(image: _I32, window_width: int, window_height: int, mean: _F32, threads: int, /) -> None: ...
def speckle(disparity: _F32, area: int, difference: float, out: _U8, /) -> None: ...
def median(disparity: _F32, size: int, out: _F32, threads: int, /) -> None: ...
