"""PNG at 8 and 16 bits, grey and colour."""

from __future__ import annotations

import io
import struct
import zlib
from math import ceil
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stereopsis.io.formats._limits import MAX_BYTES, check_length, check_shape
from stereopsis.io.formats._orientation import orientation, upright

SIGNATURE = b"\x89PNG\r\n\x1a\n"

_PLAIN = {"1": "L", "P": "RGB"}  # Pillow's modes that do not hold the values themselves

# Of each kind of colours: the bits that a sample may have, and the samples of a pixel.
_KINDS = {0: ((1, 2, 4, 8, 16), 1), 2: ((8, 16), 3), 3: ((1, 2, 4, 8), 1), 4: ((8, 16), 2), 6: ((8, 16), 4)}

# Adam7: first column, first row, and the steps between columns and rows of each pass.
_PASSES = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))


class _Header(NamedTuple):
    width: int
    height: int
    bits: int
    colours: int
    compression: int
    filters: int
    interlace: int

    @property
    def length(self) -> int:
        """The bytes of all rows, each with the one that names its filter, before compression."""
        pixel = self.bits * _KINDS[self.colours][1]
        passes = _PASSES if self.interlace else ((0, 0, 1, 1),)
        sizes = [(ceil((self.width - x) / dx), ceil((self.height - y) / dy)) for x, y, dx, dy in passes]
        return sum(rows * (1 + (columns * pixel + 7) // 8) for columns, rows in sizes if columns > 0)


LEVEL = 4
"""Of compression: takes a third of the time of the usual 6, and a hundredth more room."""

# libpng's names of filters.
_NONE, _PAETH = 0x08, 0x80


def decode(data: bytes) -> npt.NDArray[Any]:
    """Decode a PNG: palettes become colour, 1, 2 and 4 bits become 8, alpha is dropped, eXIf is obeyed."""
    import imagecodecs
    from PIL.PngImagePlugin import PngImageFile

    chunks = _chunks(data)
    header = _header(chunks[0], len(data))
    _check_pixels(b"".join(body for kind, body, _ in chunks if kind == b"IDAT"), header.length)
    # tRNS would turn a palette into alpha; the other optional chunks change no pixel.
    needed = [whole for kind, _, whole in chunks[1:] if kind in (b"PLTE", b"IDAT", b"IEND")]
    plain = b"".join([SIGNATURE, chunks[0][2], *needed])
    if header.bits == 16 and header.colours != 0:
        # Pillow would give 8 bits.
        pixels: npt.NDArray[Any] = imagecodecs.png_decode(plain)
    else:
        with PngImageFile(io.BytesIO(plain)) as image:
            pixels = np.asarray(image.convert(_PLAIN.get(image.mode, image.mode)))
    if pixels.ndim == 3:
        pixels = pixels[..., 0] if pixels.shape[2] == 2 else pixels[..., :3]
    return upright(pixels, next((orientation(bytes(body)) for kind, body, _ in chunks if kind == b"eXIf"), 1))


def most_bytes(start: bytes) -> int:
    """The most bytes of a file that begins so: its rows as they are, and room for what is not pixels."""
    if len(start) < 33:
        raise ValueError("truncated: the PNG ends before its IEND chunk")
    body = memoryview(start)[16:29]
    return _header((start[12:16], body, body), MAX_BYTES).length * 5 // 4 + 2**26


def encode(pixels: npt.NDArray[Any]) -> bytes:
    """Encode uint8 or uint16 pixels, ``(H, W)`` or ``(H, W, 3)``."""
    import imagecodecs

    return bytes(imagecodecs.png_encode(np.ascontiguousarray(pixels), level=LEVEL))


def encode_map(values: npt.NDArray[Any]) -> bytes:
    """Encode the uint8 or uint16 values of a map, ``(H, W)``: smooth parts, and runs of what is unknown.

    What repeats in such a map are runs. Looking for more takes twice the time, and finds less than Paeth's
    filter does.
    """
    import imagecodecs

    rows = np.ascontiguousarray(values)
    return bytes(imagecodecs.png_encode(rows, strategy=zlib.Z_RLE, filter=_NONE | _PAETH))


def _header(chunk: tuple[bytes, memoryview, memoryview], stored: int) -> _Header:
    kind, body, _ = chunk
    if kind != b"IHDR" or len(body) != 13:
        raise ValueError("damaged: the PNG does not begin with its header")
    header = _Header(*struct.unpack(">IIBBBBB", body))
    bits, _ = _KINDS.get(header.colours, ((), 0))
    if header.bits not in bits or header.compression or header.filters or header.interlace > 1:
        raise ValueError("damaged: the PNG's header names colours, depths or methods that there are not")
    check_shape((header.height, header.width), max(header.bits // 8, 1), stored)
    return header


def _check_pixels(packed: bytes, expected: int) -> None:
    """Refuse compressed rows that are damaged or of the wrong length: Pillow would fill up, libpng print."""
    inflate = zlib.decompressobj()
    check_length(len(inflate.decompress(packed, expected + 1)), expected)
    if not inflate.eof:
        raise ValueError("truncated: the PNG's compressed pixels do not end")


def _chunks(data: bytes) -> list[tuple[bytes, memoryview, memoryview]]:
    """Kind, body and whole bytes of every chunk up to IEND, lengths and checksums verified."""
    view = memoryview(data)
    chunks = []
    at = len(SIGNATURE)
    while True:
        if at + 12 > len(data):
            raise ValueError("truncated: the PNG ends before its IEND chunk")
        length, kind = struct.unpack_from(">I4s", data, at)
        end = at + 12 + length
        if end > len(data):
            raise ValueError(f"truncated: the PNG ends inside its {kind!r} chunk")
        if zlib.crc32(view[at + 4 : end - 4]) != int.from_bytes(view[end - 4 : end]):
            raise ValueError(f"damaged: the checksum of the PNG's {kind!r} chunk is wrong")
        chunks.append((kind, view[at + 8 : end - 4], view[at:end]))
        if kind == b"IEND":
            return chunks
        at = end
