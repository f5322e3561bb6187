"""TIFF: 8 and 16 bits and floats, grey and colour, any common compression."""

from __future__ import annotations

import io
import logging
from math import prod
from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis.io.formats._limits import check_length, check_shape
from stereopsis.io.formats._orientation import TAG, upright

_SILENT = logging.NullHandler()


def decode(data: bytes) -> npt.NDArray[Any]:
    """Decode the first page of a TIFF; alpha is dropped, palettes become colour, 1 bit becomes 0 and 255."""
    import tifffile

    silence()
    with tifffile.TiffFile(io.BytesIO(data)) as file:
        page = file.pages.first
        if not all(isinstance(size, int) for size in page.shape):
            raise ValueError("damaged: the TIFF's width or height is not a number")
        if page.axes not in ("YX", "YXS", "SYX") or page.dtype is None:
            raise ValueError(f"a TIFF with axes {page.axes} of {page.dtype}; one plane or three is read")
        shape = page.shape if page.axes != "SYX" else page.shape[1:] + page.shape[:1]
        check_shape(shape, page.dtype.itemsize, len(data))
        segments = list(zip(page.dataoffsets, page.databytecounts, strict=False))
        whole = sum(length > 0 and start + length <= len(data) for start, length in segments)
        if whole < max(prod(page.chunked), len(segments)):
            # tifffile would leave the missing ones black.
            raise ValueError("truncated: some of the TIFF's strips or tiles are missing or not complete")
        stored = sum(page.databytecounts)
        if page.compression == 1 and page.bitspersample % 8 == 0 and stored < page.nbytes:
            check_length(stored, page.nbytes)
        pixels = np.asarray(page.asarray(maxworkers=1)).reshape(page.shape)
        if page.axes == "SYX":
            pixels = np.moveaxis(pixels, 0, 2)
        pixels = in_plain_colours(
            pixels, getattr(page.photometric, "name", str(page.photometric)), page.colormap
        )
        return upright(pixels, page.tags.valueof(TAG, 1))


def encode(pixels: npt.NDArray[Any]) -> bytes:
    """Encode uint8, uint16 or float32 pixels, ``(H, W)`` or ``(H, W, 3)``, without compression."""
    import tifffile

    file = io.BytesIO()
    photometric = "rgb" if pixels.ndim == 3 else "minisblack"
    tifffile.imwrite(file, np.ascontiguousarray(pixels), photometric=photometric, metadata=None)
    return file.getvalue()


def silence() -> None:
    """Keep Python from printing what tifffile logs of a broken file, which it does without a handler."""
    logging.getLogger("tifffile").addHandler(_SILENT)


def in_plain_colours(
    pixels: npt.NDArray[Any], photometric: str, colormap: npt.NDArray[Any] | None
) -> npt.NDArray[Any]:
    """Pixels as grey or RGB, whatever the file's colours."""
    if pixels.dtype == bool:
        pixels = pixels.astype(np.uint8) * np.uint8(255)
    match photometric:
        case "MINISBLACK" | "CFA":
            return pixels if pixels.ndim == 2 else pixels[..., 0]
        case "MINISWHITE":
            plane = pixels if pixels.ndim == 2 else pixels[..., 0]
            return np.iinfo(plane.dtype).max - plane if plane.dtype.kind == "u" else plane
        case "RGB" | "YCBCR" if pixels.ndim == 3 and pixels.shape[2] >= 3:
            return pixels[..., :3]
        case "PALETTE" if colormap is not None and pixels.ndim == 2:
            return np.moveaxis((colormap >> 8).astype(np.uint8)[:, pixels], 0, 2)
        case _:
            raise ValueError(
                f"a TIFF in {photometric} colours with shape {pixels.shape}; grey and RGB are read"
            )
