"""NPY: https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html."""

from __future__ import annotations

import io
import re
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
    shape, dtype, order, start = layout(data)
    check_shape(shape, dtype.itemsize)
    check_length(len(data) - start, dtype.itemsize * int(np.prod(shape)))
    return np.frombuffer(data, dtype, offset=start).reshape(shape, order=order)


def layout(data: bytes) -> tuple[tuple[int, ...], np.dtype[Any], Literal["C", "F"], int]:
    """Shape, type and order that the file's first 4096 bytes announce, and where its values begin."""
    begin = 10 if data[6] == 1 else 12
    start = begin + int.from_bytes(data[8:begin], "little")
    header = _HEADER.fullmatch(data[begin : min(start, 4096)])
    if header is None:
        raise ValueError("not an NPY file of real numbers with shape (H, W) or (H, W, 3)")
    shape = tuple(int(size) for size in header.groups()[2:] if size is not None)
    return shape, np.dtype(header[1].decode()), "F" if header[2] == b"True" else "C", start


def encode(pixels: npt.NDArray[Any]) -> bytes:
    """Encode an array as it is."""
    file = io.BytesIO()
    np.save(file, np.ascontiguousarray(pixels), allow_pickle=False)
    return file.getvalue()


def header(shape: tuple[int, ...], dtype: np.dtype[Any]) -> bytes:
    """What stands before the values of an array in rows."""
    file = io.BytesIO()
    said = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, said)
    return file.getvalue()
