"""PGM and PPM at 8 and 16 bits, and PBM."""

from __future__ import annotations

import io
import re
from math import prod
from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis.io.formats._limits import check_length, check_shape

_GAP = rb"(?:\s|#[^\r\n]*[\r\n])+"
_HEADER = re.compile(rb"P([1-6])" + _GAP + rb"(\d{1,9})" + _GAP + rb"(\d{1,9})")
_MAXIMUM = re.compile(_GAP + rb"(\d{1,5})\s")
_LONGEST = 16  # bytes of a number in a text, with the space around it


def decode(data: bytes) -> npt.NDArray[Any]:
    """Decode a PGM or PPM, binary or text, values as they are; a PBM's white becomes 255."""
    import netpbmfile

    kind, start, (height, width, channels), length = _header(data)
    if kind >= 4:
        check_length(len(data) - start, length)
    elif kind != 1:
        check_length(len(data[start:].split()), height * width * channels)
    pixels = np.asarray(netpbmfile.imread(io.BytesIO(data)))
    pixels = pixels.reshape((height, width, channels)[: 3 if channels == 3 else 2])
    return np.where(pixels, np.uint8(0), np.uint8(255)) if kind in (1, 4) else pixels


def most_bytes(start: bytes) -> int:
    """The most bytes of a file that begins so."""
    kind, begin, shape, length = _header(start)
    return begin + length if kind >= 4 else begin + _LONGEST * prod(shape) + 2**16


def _header(data: bytes) -> tuple[int, int, tuple[int, int, int], int]:
    """The kind's digit, where the pixels begin, their rows, columns and channels, their bytes if binary."""
    header = _HEADER.match(data, 0, 4096)
    if header is None:
        raise ValueError("damaged: no width and height in the PGM or PPM header")
    kind, width, height = (int(group) for group in header.groups())
    channels = 3 if kind in (3, 6) else 1
    if kind in (1, 4):
        start, itemsize, row = header.end() + 1, 1, (width + 7) // 8
    else:
        maximum = _MAXIMUM.match(data, header.end(), 4096)
        if maximum is None or not 1 <= int(maximum[1]) <= 65535:
            raise ValueError("damaged: no maximum between 1 and 65535 in the PGM or PPM header")
        start, itemsize = maximum.end(), 1 if int(maximum[1]) < 256 else 2
        row = width * channels
    check_shape((height, width, channels), itemsize)
    return kind, start, (height, width, channels), height * row * itemsize


def encode(pixels: npt.NDArray[Any]) -> bytes:
    """Encode uint8 or uint16 pixels as binary PGM, ``(H, W)``, or PPM, ``(H, W, 3)``."""
    import netpbmfile

    file = io.BytesIO()
    largest = np.iinfo(pixels.dtype).max
    netpbmfile.imwrite(file, pixels, magicnumber="P5" if pixels.ndim == 2 else "P6", maxval=largest)
    return file.getvalue()
