"""JPEG at 8 bits, grey and colour, with the bytes that OpenCV decodes."""

from __future__ import annotations

import io
import struct
from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis.io.formats._limits import check_shape
from stereopsis.io.formats._orientation import orientation, upright

_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # SOFn; the three are tables


def decode(data: bytes) -> npt.NDArray[Any]:
    """Decode a JPEG, turned as its Exif orientation says."""
    from PIL.JpegImagePlugin import JpegImageFile

    try:
        plain, turn = _without_metadata(data)
    except struct.error:
        raise ValueError("truncated: the JPEG ends before its pixels") from None
    image = JpegImageFile(io.BytesIO(plain))
    if image.mode not in ("L", "RGB"):
        raise ValueError(f"a JPEG in {image.mode} colours; grey and RGB are read")
    return upright(np.asarray(image), turn)


def encode(pixels: npt.NDArray[Any]) -> bytes:
    """Encode uint8 pixels, ``(H, W)`` or ``(H, W, 3)``, at quality 95 without chroma subsampling."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(file, "JPEG", quality=95, subsampling=0)
    return file.getvalue()


def frame(data: bytes) -> tuple[int, int, int]:
    """Rows, columns and channels of a JPEG stream, which may be one without its tables."""
    at = 2
    try:
        while True:
            mark, marker = struct.unpack_from(">BB", data, at)
            if mark == 0xFF and marker in _FRAMES:
                _, height, width, channels = struct.unpack_from(">BHHB", data, at + 4)
                return height, width, channels
            if mark != 0xFF or marker == 0xDA:
                raise ValueError("damaged: a JPEG without its size")
            at += 1 if marker == 0xFF else 2 + struct.unpack_from(">H", data, at + 2)[0]
    except struct.error:
        raise ValueError("truncated: the JPEG ends before its pixels") from None


def _without_metadata(data: bytes) -> tuple[bytes, int]:
    """The stream without comments and metadata, which Pillow would parse and warn about, and its orientation.

    The frame's size is checked on the way. APP0 and APP14 stay: they say what the colours are.
    """
    kept = [data[:2]]
    turn = 1
    at = 2
    while True:
        mark, marker = struct.unpack_from(">BB", data, at)
        if mark != 0xFF:
            raise ValueError("damaged: a JPEG marker is missing")
        if marker == 0xFF:  # padding
            at += 1
            continue
        (length,) = struct.unpack_from(">H", data, at + 2)
        segment = data[at : at + 2 + length]
        if marker in _FRAMES:
            _, height, width, channels = struct.unpack_from(">BHHB", segment, 4)
            check_shape((height, width, channels), 1, len(data))
        if marker == 0xE1 and segment[4:10] == b"Exif\0\0":
            turn = orientation(segment[10:])
        if marker == 0xDA:
            return b"".join([*kept, data[at:]]), turn
        if marker in (0xE0, 0xEE) or not (0xE0 <= marker <= 0xEF or marker == 0xFE):
            kept.append(segment)
        at += 2 + length
