"""Pixel files: recognised by their content, decoded to arrays, encoded to bytes; a module a format."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stereopsis._files import opened
from stereopsis.io._errors import StrPath, naming
from stereopsis.io.formats import jpeg, netpbm, npy, pfm, png, tiff
from stereopsis.io.formats._limits import MAX_BYTES

BEGINNING = 4096
"""Of every header, what is looked at lies within so many bytes."""

_ROOM = 2**20


class Raster(NamedTuple):
    """What a pixel file holds, before anything is read into it.

    `pixels` is ``(H, W)`` or ``(H, W, C)``, C-contiguous, in native byte order, of the dtype that the file
    has; `format` is one of ``"png"``, ``"jpeg"``, ``"tiff"``, ``"netpbm"``, ``"pfm"``, ``"npy"``.
    """

    pixels: npt.NDArray[Any]
    format: str


def _unknown(data: bytes) -> ValueError:
    if not data:
        return ValueError("the file is empty")
    return ValueError(f"not a PNG, JPEG, TIFF, PGM, PPM, PFM or NPY file: it begins with {data[:8]!r}")


def identify(data: bytes) -> str | None:
    """The format that the first bytes of a file announce, or None."""
    if data.startswith(png.SIGNATURE):
        return "png"
    if data.startswith(b"\xff\xd8\xff"):
        return "jpeg"
    if data.startswith((b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")):
        return "tiff"
    if re.match(rb"P[1-6]\s", data):
        return "netpbm"
    if re.match(rb"P[Ff]\s", data):
        return "pfm"
    if data.startswith(npy.SIGNATURE):
        return "npy"
    return None


class _Codec(NamedTuple):
    """A format: how its files are decoded, and how many bytes one may have that begins so."""

    format: str
    decode: Callable[[bytes], npt.NDArray[Any]]
    most_bytes: Callable[[bytes], int] = lambda start: MAX_BYTES


def _codec(data: bytes) -> _Codec:
    match identify(data):
        case "png":
            return _Codec("png", png.decode, png.most_bytes)
        case "jpeg":
            return _Codec("jpeg", jpeg.decode)
        case "tiff":
            return _Codec("tiff", tiff.decode)
        case "netpbm":
            return _Codec("netpbm", netpbm.decode, netpbm.most_bytes)
        case "pfm":
            return _Codec("pfm", pfm.decode, pfm.most_bytes)
        case "npy":
            return _Codec("npy", npy.decode, npy.most_bytes)
        case _:
            raise _unknown(data)


def decode(data: bytes) -> Raster:
    """Decode the bytes of a pixel file; whatever they are, an exception is the worst that happens."""
    codec = _codec(data)
    pixels = codec.decode(data)
    if pixels.ndim == 3 and pixels.shape[2] == 1:
        pixels = pixels[..., 0]
    return Raster(np.ascontiguousarray(pixels, dtype=pixels.dtype.newbyteorder("=")), codec.format)


def load(path: StrPath) -> Raster:
    """Read and decode one pixel file; of one that is no pixel file, or too large for one, only the beginning.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        Its content cannot be decoded.
    """
    with opened(path) as (file, size):
        start = file.read(BEGINNING)
        with naming(path):
            check_size(start, size)
        data = start + file.read(max(size - len(start), 0))
    with naming(path):
        return decode(data)


def check_size(start: bytes, size: int) -> None:
    """Refuse what is no pixel file, and one of more bytes than its beginning, up to `BEGINNING`, allows."""
    most = _codec(start).most_bytes(start)
    if size > most + _ROOM:  # of less, the decoders say more
        raise ValueError(f"wrong size: the header announces {most} bytes at most, the file holds {size}")
