"""Pixel files: recognised by their content, decoded to arrays, encoded to bytes; a module a format."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stereopsis.io._errors import StrPath, naming
from stereopsis.io.formats import jpeg, netpbm, npy, pfm, png, tiff


class Raster(NamedTuple):
    """What a pixel file holds, before anything is read into it.

    `pixels` is ``(H, W)`` or ``(H, W, C)``, C-contiguous, in native byte order, of the dtype that the file
    has; `format` is one of ``"png"``, ``"jpeg"``, ``"tiff"``, ``"netpbm"``, ``"pfm"``, ``"npy"``.
    """

    pixels: npt.NDArray[Any]
    format: str


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


def decode(data: bytes) -> Raster:
    """Decode the bytes of a pixel file; whatever they are, an exception is the worst that happens."""
    format = identify(data)
    match format:
        case "png":
            pixels = png.decode(data)
        case "jpeg":
            pixels = jpeg.decode(data)
        case "tiff":
            pixels = tiff.decode(data)
        case "netpbm":
            pixels = netpbm.decode(data)
        case "pfm":
            pixels = pfm.decode(data)
        case "npy":
            pixels = npy.decode(data)
        case _ if not data:
            raise ValueError("the file is empty")
        case _:
            raise ValueError(f"not a PNG, JPEG, TIFF, PGM, PPM, PFM or NPY file: it begins with {data[:8]!r}")
    if pixels.ndim == 3 and pixels.shape[2] == 1:
        pixels = pixels[..., 0]
    return Raster(np.ascontiguousarray(pixels, dtype=pixels.dtype.newbyteorder("=")), format)


def load(path: StrPath) -> Raster:
    """Read and decode one pixel file.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        Its content cannot be decoded.
    """
    data = Path(path).read_bytes()
    with naming(path):
        return decode(data)
