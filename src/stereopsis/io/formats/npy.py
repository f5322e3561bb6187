"""NPY: https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html."""

from __future__ import annotations

import io
import re
from math import prod
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from stereopsis.io.formats._limits import check_length, check_shape

SIGNATURE = b"\x93NUMPY"

# NumPy evaluates the header as Python, and warns about some broken ones; numbers need no more than this.
_HEADER = re.compile(
    rb"\s*\{\s*'descr':\s*'([<>|=]?[fiu][1248])',\s*'fortran_order':\s*(True|False),"
    rb"\s*'shape':\s*\((\d{1,9}),\s*(\d{1,9})(?:,\s*([1-4]))?,?\s*\),?\s*\}\s*"
)


def decode(data: bytes) -> npt.NDArray[Any]:
    """Decode an array of real numbers, ``(H, W)`` or ``(H, W, C)``."""
    start, shape, dtype, order = _header(data)
    check_length(len(data) - start, dtype.itemsize * prod(shape))
    return np.frombuffer(data, dtype, offset=start).reshape(shape, order=order)


def most_bytes(start: bytes) -> int:
    """The bytes of a file that begins so."""
    begin, shape, dtype, _ = _header(start)
    return begin + dtype.itemsize * prod(shape)


def _header(data: bytes) -> tuple[int, tuple[int, ...], np.dtype[Any], Literal["C", "F"]]:
    """Where the numbers begin, their shape, type and order."""
    begin = 10 if data[6:7] == b"\1" else 12
    start = begin + int.from_bytes(data[8:begin], "little")
    header = _HEADER.fullmatch(data[begin : min(start, 4096)])
    if header is None:
        raise ValueError("not an NPY file of real numbers with shape (H, W) or (H, W, 3)")
    dtype = np.dtype(header[1].decode())
    shape = tuple(int(size) for size in header.groups()[2:] if size is not None)
    check_shape(shape, dtype.itemsize)
    return start, shape, dtype, "F" if header[2] == b"True" else "C"


def encode(pixels: npt.NDArray[Any]) -> bytes:
    """Encode an array as it is."""
    file = io.BytesIO()
    np.save(file, np.ascontiguousarray(pixels), allow_pickle=False)
    return file.getvalue()
