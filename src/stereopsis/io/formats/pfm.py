"""PFM, portable float map: http://www.pauldebevec.com/Research/HDR/PFM/."""

from __future__ import annotations

import re
from math import prod
from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis.io.formats._limits import check_length, check_shape

_HEADER = re.compile(rb"P([Ff])\s+(\d{1,9})\s+(\d{1,9})\s+([-+]?[\d.]+(?:[eE][-+]?\d+)?)[ \t]*(?:\r\n|\s)")


def decode(data: bytes) -> npt.NDArray[Any]:
    """Decode a PFM of either byte order to float32, top row first.

    The sign of the header's scale is the byte order. Its magnitude is not applied: the files of Middlebury
    say 0.003922 there and mean their values as they stand.
    """
    start, shape, kind = _header(data)
    check_length(len(data) - start, 4 * prod(shape))
    return np.frombuffer(data, kind, offset=start).reshape(shape)[::-1]


def most_bytes(start: bytes) -> int:
    """The bytes of a file that begins so."""
    begin, shape, _ = _header(start)
    return begin + 4 * prod(shape)


def _header(data: bytes) -> tuple[int, tuple[int, ...], str]:
    """Where the pixels begin, their shape, and their type."""
    header = _HEADER.match(data, 0, 4096)
    if header is None:
        raise ValueError("damaged: the PFM header is not 'Pf or PF, width, height, scale'")
    width, height, scale = int(header[2]), int(header[3]), float(header[4])
    if scale == 0 or not np.isfinite(scale):
        raise ValueError(
            f"damaged: the scale in the PFM header is {scale}; its sign should give the byte order"
        )
    shape = (height, width, 3) if header[1] == b"F" else (height, width)
    check_shape(shape, 4)
    return header.end(), shape, "<f4" if scale < 0 else ">f4"


def encode(pixels: npt.NDArray[Any]) -> bytes:
    """Encode ``(H, W)`` or ``(H, W, 3)`` as little-endian float32, bottom row first."""
    return header(pixels.shape) + pixels[::-1].astype("<f4").tobytes()


def header(shape: tuple[int, ...]) -> bytes:
    """What stands before the pixels of a little-endian ``(H, W)`` or ``(H, W, 3)``."""
    magic = "PF" if len(shape) == 3 else "Pf"
    return f"{magic}\n{shape[1]} {shape[0]}\n-1\n".encode()
