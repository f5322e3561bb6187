"""The Exif/TIFF orientation tag, which OpenCV obeys too."""

from __future__ import annotations

import struct
from typing import Any

import numpy.typing as npt

TAG = 0x0112


def orientation(exif: bytes) -> int:
    """The orientation, 1 … 8, in a block of Exif data (a TIFF header and a directory); 1 if there is none."""
    order = {b"II": "<", b"MM": ">"}.get(exif[:2])
    if order is None:
        return 1
    try:
        (start,) = struct.unpack_from(f"{order}I", exif, 4)
        (count,) = struct.unpack_from(f"{order}H", exif, start)
        for entry in range(start + 2, start + 2 + 12 * count, 12):
            tag, _, _, value = struct.unpack_from(f"{order}HHIH", exif, entry)
            if tag == TAG:
                return int(value)
    except struct.error:  # cut short: nothing that would turn the picture
        pass
    return 1


def upright(pixels: npt.NDArray[Any], orientation: int) -> npt.NDArray[Any]:
    """Turn and mirror `pixels` so that row 0 is the top and column 0 the left."""
    if 5 <= orientation <= 8:
        pixels = pixels.swapaxes(0, 1)
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    return pixels
