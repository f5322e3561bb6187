"""Images and maps in parts: files larger than memory, read and written a rectangle at a time."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from math import prod
from pathlib import Path
from typing import Any, BinaryIO, Protocol

import numpy as np
import numpy.typing as npt

from stereopsis._files import as_path, opened
from stereopsis.io._errors import StrPath, naming
from stereopsis.io.atomic import replacing
from stereopsis.io.formats import BEGINNING, Raster, identify, npy, pfm, png, tiff
from stereopsis.io.formats._orientation import TAG
from stereopsis.io.images import as_image, read_image
from stereopsis.types import Image, Rectangle

PART_SUFFIXES = (".tif", ".tiff", ".npy", ".pfm", ".zarr")
"""What `create_map` can write."""
TILE = 256
"""Side of the tiles of a written TIFF, in pixels."""
CHUNK = 512
"""Side of the chunks of a written Zarr array."""
CLASSIC = 2**32 - 2**25
"""A TIFF of more bytes is a BigTIFF."""


class Source(Protocol):
    """An image that is read in parts."""

    @property
    def shape(self) -> tuple[int, ...]:
        """``(H, W)`` or ``(H, W, 3)``."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """uint8, uint16 or float32."""

    def read(self, part: Rectangle) -> Image:
        """The pixels of a rectangle."""


class Parts(Source, Protocol):
    """An image in a file that is read in parts."""

    @property
    def passing(self) -> int:
        """Bytes in memory while it is read, beside the pixels as the file has them."""


class Map(Protocol):
    """A map that is written in parts."""

    def read(self, part: Rectangle) -> npt.NDArray[Any]:
        """What was written there."""

    def write(self, part: Rectangle, values: npt.NDArray[Any]) -> None:
        """The values of a rectangle."""


# ---- reading -----------------------------------------------------------------------------------------


@contextmanager
def open_parts(path: StrPath) -> Iterator[Parts]:
    """Open an image to read it in parts; what it holds is as `read_image` says.

    A TIFF is read by its strips or tiles, an NPY file by its rows, a Zarr array by its chunks (extra
    ``large``). Anything else is decoded whole, and stays in memory.

    Parameters
    ----------
    path : str or path-like
        The file, or a Zarr array's folder.

    Yields
    ------
    Parts

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        Its content is not an image, or damaged, also when that is found only as a part is read.
    """
    if as_path(path).is_dir():
        yield _Zarr(path)
        return
    with opened(path) as (file, _):
        format = identify(file.read(16))
    with ExitStack() as stack:
        found: Parts | None = None
        if format in ("tiff", "npy"):
            stored = stack.enter_context(Path(path).open("rb"))
            with naming(path):
                found = _tiff(path, stored, stack) if format == "tiff" else _npy(path, stored)
        if found is None:
            stack.close()
            found = _Decoded(read_image(path))
        yield found


class _Decoded:
    """An image that had to be decoded whole."""

    def __init__(self, image: Image) -> None:
        self._image = image
        self.shape, self.dtype, self.passing = image.shape, image.dtype, 0

    def read(self, part: Rectangle) -> Image:
        return self._image[part.slices]


class _Rows:
    """Pixels one after the other in a file, row by row."""

    passing = 0

    def __init__(
        self, path: StrPath, file: BinaryIO, shape: tuple[int, ...], dtype: np.dtype[Any], offset: int
    ) -> None:
        self._path, self._file, self._raw, self._offset = path, file, dtype, offset
        self.shape = shape
        self.dtype = _image_dtype(dtype, shape)
        self._pixel = dtype.itemsize * prod(shape[2:])

    def read(self, part: Rectangle) -> Image:
        with naming(self._path):
            return as_image(Raster(self.raw(part).astype(self._raw.newbyteorder("="), copy=False), "rows"))

    def raw(self, part: Rectangle) -> npt.NDArray[Any]:
        """Values as the file has them."""
        rows, columns = part.shape
        out = np.empty((rows, columns, *self.shape[2:]), self._raw)
        stored = out.reshape(rows, -1).view(np.uint8)
        wide = columns == self.shape[1]
        for row in range(1 if wide else rows):
            self._file.seek(self._offset + ((part.top + row) * self.shape[1] + part.left) * self._pixel)
            target = stored if wide else stored[row]
            if self._file.readinto(target.data) != target.size:  # type: ignore[attr-defined]
                raise ValueError("truncated: rows are missing")
        return out


def _npy(path: StrPath, file: BinaryIO) -> Parts | None:
    shape, dtype, order, start = npy.layout(file.read(BEGINNING))
    if order == "F":
        return None
    return _Rows(path, file, shape, dtype, start)


def _image_dtype(dtype: np.dtype[Any], shape: tuple[int, ...]) -> np.dtype[Any]:
    """Of the image that values of this type are; raises ValueError where they are none."""
    return as_image(Raster(np.zeros((1, 1, *shape[2:]), dtype.newbyteorder("=")), "rows")).dtype


def _tiff(path: StrPath, file: BinaryIO, stack: ExitStack) -> Parts | None:
    """By rows where they are stored so, else by strips or tiles; None where it has to be decoded whole."""
    import tifffile

    tiff.silence()
    opened = stack.enter_context(tifffile.TiffFile(file))
    page = opened.pages.first
    sides = page.shape[:2]
    whole = page.axes not in ("YX", "YXS") or page.dtype is None or page.tags.valueof(TAG, 1) != 1
    if whole or not all(isinstance(side, int) and side > 0 for side in sides):
        return None
    end = os.fstat(file.fileno()).st_size
    segments = list(zip(page.dataoffsets, page.databytecounts, strict=False))
    complete = sum(length > 0 and start + length <= end for start, length in segments)
    if complete < max(prod(page.chunked), len(segments)):
        raise ValueError("truncated: some of the TIFF's strips or tiles are missing or not complete")
    return _Tiff(path, file, page, opened.byteorder)


class _Tiff:
    """The first page of a TIFF."""

    def __init__(self, path: StrPath, file: BinaryIO, page: Any, byteorder: str) -> None:
        self._path, self._file, self._page = path, file, page
        colours = self._plain(np.zeros((1, 1, *page.shape[2:]), page.dtype))
        self.shape: tuple[int, ...] = (*page.shape[:2], *colours.shape[2:])
        self.dtype = as_image(Raster(colours, "tiff")).dtype
        self._side = page.chunks[0], page.chunks[1]
        self._rows = None
        contiguous = page.is_contiguous and page.compression == 1 and page.predictor == 1
        if contiguous and page.bitspersample == 8 * page.dtype.itemsize and page.fillorder == 1:
            dtype = page.dtype.newbyteorder(byteorder)
            self._rows = _Rows(path, file, page.shape, dtype, page.dataoffsets[0])
        segment = 3 * prod(self._side) * page.dtype.itemsize * prod(page.shape[2:])
        self.passing = 0 if self._rows is not None else int(segment)

    def _plain(self, pixels: npt.NDArray[Any]) -> npt.NDArray[Any]:
        page = self._page
        return tiff.in_plain_colours(
            pixels, getattr(page.photometric, "name", str(page.photometric)), page.colormap
        )

    def read(self, part: Rectangle) -> Image:
        with naming(self._path):
            if self._rows is not None:
                pixels = self._rows.raw(part)
            else:
                pixels = np.empty((*part.shape, *self._page.shape[2:]), self._page.dtype)
                for number, segment in self._segments(part):
                    self._copy(number, segment, part, pixels)
            return as_image(
                Raster(self._plain(pixels.astype(pixels.dtype.newbyteorder("="), copy=False)), "tiff")
            )

    def _segments(self, part: Rectangle) -> Iterator[tuple[int, Rectangle]]:
        """Numbers and places of those that a rectangle needs."""
        (height, width), across = self._side, -(-self._page.shape[1] // self._side[1])
        for row in range(part.top // height, -(-part.bottom // height)):
            for column in range(part.left // width, -(-part.right // width)):
                top, left = row * height, column * width
                yield row * across + column, Rectangle(top, top + height, left, left + width)

    def _copy(self, number: int, segment: Rectangle, part: Rectangle, pixels: npt.NDArray[Any]) -> None:
        page = self._page
        self._file.seek(page.dataoffsets[number])
        data = self._file.read(page.databytecounts[number])
        tables = {"jpegtables": page.jpegtables, "jpegheader": page.jpegheader} if page.jpegtables else {}
        decoded = page.decode(data, number, **tables)[0]
        if decoded is None:
            raise ValueError("truncated: a strip or tile is empty")
        tile = decoded.reshape(-1, *decoded.shape[-2:]) if page.axes == "YXS" else decoded[0, ..., 0]
        common = Rectangle(
            max(part.top, segment.top), min(part.bottom, segment.bottom),
            max(part.left, segment.left), min(part.right, segment.right),
        )  # fmt: skip
        there = _relative(common, segment)
        if tile.shape[0] < there[0].stop or tile.shape[1] < there[1].stop:
            raise ValueError("damaged: a strip or tile has too few pixels")
        pixels[_relative(common, part)] = tile[there]


def _relative(inner: Rectangle, outer: Rectangle) -> tuple[slice, slice]:
    """As an index of what the outer rectangle holds."""
    return (
        slice(inner.top - outer.top, inner.bottom - outer.top),
        slice(inner.left - outer.left, inner.right - outer.left),
    )


class _Zarr:
    """A Zarr array."""

    def __init__(self, path: StrPath) -> None:
        zarr = _require_zarr()
        if not any((Path(path) / name).exists() for name in ("zarr.json", ".zarray")):
            raise ValueError(f"{path} is a folder that holds no Zarr array: neither zarr.json nor .zarray")
        with naming(path):
            self._array = zarr.open_array(os.fspath(path), mode="r")
            self.shape: tuple[int, ...] = tuple(self._array.shape)
            self.dtype = _image_dtype(np.dtype(self._array.dtype), self.shape)
        self._path = path
        # It reads about ten chunks at once, in threads of its own.
        self.passing = 2**25 + 12 * prod(self._array.chunks) * self._array.dtype.itemsize

    def read(self, part: Rectangle) -> Image:
        with naming(self._path):
            values = np.asarray(self._array[part.slices])
            return as_image(Raster(values.astype(values.dtype.newbyteorder("="), copy=False), "zarr"))


def _require_zarr() -> Any:
    try:
        import zarr
    except ModuleNotFoundError:
        raise ValueError("Zarr arrays need the extra 'large': pip install 'stereopsis[large]'") from None
    return zarr


# ---- writing -----------------------------------------------------------------------------------------


@contextmanager
def create_map(path: StrPath, shape: tuple[int, int], dtype: npt.DTypeLike = np.float32) -> Iterator[Map]:
    """Create a map that is written in parts, and is there whole or not at all.

    It lies beside `path` under another name until the block ends well. What is not written is 0.

    ====================  =================================================================================
    suffix                file
    ====================  =================================================================================
    ``.tif``, ``.tiff``   tiles of 256 x 256, without compression; a BigTIFF from 4 GB on
    ``.npy``              rows
    ``.pfm``              rows, float32 alone; infinite where NaN is written
    ``.zarr``             a Zarr array of chunks of 512 x 512 (extra ``large``)
    ====================  =================================================================================

    Parameters
    ----------
    path : str or path-like
        An existing file, or Zarr array, is replaced.
    shape : (H, W)
    dtype : dtype
        Of float32 or uint8.

    Yields
    ------
    Map

    Raises
    ------
    OSError
        It cannot be written.
    ValueError
        The suffix is another, the extra is missing, or `path` is no plain file.
    """
    check_map(path, dtype)
    kind, suffix = np.dtype(dtype), Path(path).suffix.lower()
    if suffix == ".zarr":
        with _replacing_folder(path) as folder:
            yield _ZarrMap(folder, shape, kind)
        return
    if Path(path).exists() and not Path(path).is_file():
        raise ValueError(f"{path}: only a plain file can be written in parts")
    with replacing(path) as begun:
        match suffix:
            case ".tif" | ".tiff":
                offsets = _begin_tiff(begun.name, shape, kind)
                with Path(begun.name).open("r+b") as file:
                    yield _TiffMap(file, shape, kind, offsets)
            case _:
                head = npy.header(shape, kind) if suffix == ".npy" else pfm.header(shape)
                begun.write(head)
                begun.truncate(len(head) + prod(shape) * kind.itemsize)
                begun.flush()
                with Path(begun.name).open("r+b") as file:
                    yield _RowMap(file, shape, kind, len(head), upward=suffix == ".pfm")


class _RowMap:
    """Values row by row, from the top, or from the bottom up."""

    def __init__(
        self, file: BinaryIO, shape: tuple[int, int], dtype: np.dtype[Any], offset: int, *, upward: bool
    ) -> None:
        self._file, self._shape, self._dtype, self._offset = file, shape, dtype, offset
        self._upward = upward

    def _at(self, row: int, column: int) -> int:
        stored = self._shape[0] - 1 - row if self._upward else row
        return self._offset + (stored * self._shape[1] + column) * self._dtype.itemsize

    def read(self, part: Rectangle) -> npt.NDArray[Any]:
        out = np.empty(part.shape, self._dtype)
        for row in range(part.top, part.bottom):
            self._file.seek(self._at(row, part.left))
            out[row - part.top] = np.frombuffer(
                self._file.read(part.shape[1] * self._dtype.itemsize), self._dtype
            )
        return out

    def write(self, part: Rectangle, values: npt.NDArray[Any]) -> None:
        values = values.astype(self._dtype, copy=False)
        for row, line in enumerate(values, part.top):
            if self._upward:
                line = np.where(np.isnan(line), np.float32(np.inf), line)
            self._file.seek(self._at(row, part.left))
            self._file.write(np.ascontiguousarray(line).data)


def _begin_tiff(name: str, shape: tuple[int, int], dtype: np.dtype[Any]) -> list[int]:
    """A TIFF of tiles that are still empty; where each begins."""
    import tifffile

    stored = prod(-(-side // TILE) * TILE for side in shape) * dtype.itemsize
    with tifffile.TiffWriter(name, bigtiff=stored > CLASSIC, byteorder="<") as writer:
        writer.write(
            data=None, shape=shape, dtype=dtype, tile=(TILE, TILE), photometric="minisblack", metadata=None
        )
    with tifffile.TiffFile(name) as written:
        offsets: list[int] = list(written.pages.first.dataoffsets)
    return offsets


class _TiffMap:
    """Tiles without compression, each where it was laid out."""

    def __init__(
        self, file: BinaryIO, shape: tuple[int, int], dtype: np.dtype[Any], offsets: list[int]
    ) -> None:
        self._file, self._dtype, self._offsets = file, dtype.newbyteorder("<"), offsets
        self._across = -(-shape[1] // TILE)
        self._shape = shape

    def _tiles(self, part: Rectangle) -> Iterator[tuple[int, Rectangle, Rectangle]]:
        """Where each tile's data begin, the tile as far as the image goes, and what of it the part has."""
        for row in range(part.top // TILE, -(-part.bottom // TILE)):
            for column in range(part.left // TILE, -(-part.right // TILE)):
                top, left = row * TILE, column * TILE
                tile = Rectangle(top, min(top + TILE, self._shape[0]), left, min(left + TILE, self._shape[1]))
                common = Rectangle(
                    max(tile.top, part.top), min(tile.bottom, part.bottom),
                    max(tile.left, part.left), min(tile.right, part.right),
                )  # fmt: skip
                yield self._offsets[row * self._across + column], tile, common

    def read(self, part: Rectangle) -> npt.NDArray[Any]:
        out = np.empty(part.shape, self._dtype)
        for offset, tile, common in self._tiles(part):
            out[_relative(common, part)] = self._load(offset)[_relative(common, tile)]
        return out

    def _load(self, offset: int) -> npt.NDArray[Any]:
        self._file.seek(offset)
        data = self._file.read(TILE * TILE * self._dtype.itemsize)
        return np.frombuffer(data, self._dtype).reshape(TILE, TILE)

    def write(self, part: Rectangle, values: npt.NDArray[Any]) -> None:
        for offset, tile, common in self._tiles(part):
            stored = np.zeros((TILE, TILE), self._dtype) if common == tile else self._load(offset).copy()
            stored[_relative(common, tile)] = values[_relative(common, part)]
            self._file.seek(offset)
            self._file.write(stored.data)


class _ZarrMap:
    """A Zarr array of float32 or uint8."""

    def __init__(self, folder: Path, shape: tuple[int, int], dtype: np.dtype[Any]) -> None:
        chunks = tuple(min(CHUNK, side) for side in shape)
        self._array = _require_zarr().create_array(
            store=os.fspath(folder), shape=shape, chunks=chunks, dtype=dtype, fill_value=0
        )

    def read(self, part: Rectangle) -> npt.NDArray[Any]:
        return np.asarray(self._array[part.slices])

    def write(self, part: Rectangle, values: npt.NDArray[Any]) -> None:
        self._array[part.slices] = values


@contextmanager
def _replacing_folder(path: StrPath) -> Iterator[Path]:
    """A new folder that takes the place of a Zarr array when the block ends well."""
    _require_zarr()
    target = Path(os.path.realpath(path))
    if target.exists() and not any((target / name).exists() for name in ("zarr.json", ".zarray")):
        raise ValueError(f"{path} is there already, and is no Zarr array: it is not replaced")
    name = os.urandom(6).hex()
    draft, old = target.with_name(f".{name}.tmp"), target.with_name(f".{name}.old")
    try:
        draft.mkdir()
        yield draft
        if target.exists():
            target.rename(old)
        draft.rename(target)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
        if old.exists() and not target.exists():
            old.rename(target)
        shutil.rmtree(old, ignore_errors=True)


# ---- before anything is done -------------------------------------------------------------------------


def check_map(path: StrPath, dtype: npt.DTypeLike = np.float32) -> None:
    """Refuse a name that `create_map` would refuse.

    Raises
    ------
    TypeError
        `path` is none.
    ValueError
        The suffix is another, or holds no such values, or the extra for it is missing.
    FileNotFoundError
        The folder does not exist.
    """
    target, kind = as_path(path), np.dtype(dtype)
    suffix = target.suffix.lower()
    if suffix not in PART_SUFFIXES:
        raise ValueError(f"{path}: in tiles {', '.join(PART_SUFFIXES)} are written, not {suffix!r}")
    if suffix == ".pfm" and kind != np.float32:
        raise ValueError(f"{path}: .pfm holds float32, not {kind}")
    if suffix == ".zarr":
        _require_zarr()
    if not target.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(target.parent))


def opening(path: StrPath) -> int:
    """Bytes in memory, at the most, while a file is opened with `open_parts`.

    Raises
    ------
    OSError
        The file cannot be read.
    """
    if as_path(path).is_dir():
        return 0
    with opened(path) as (file, stored):
        head = file.read(BEGINNING)
    format = identify(head)
    if format in ("tiff", "npy"):
        return 0
    if format in ("png", "jpeg"):
        decoded = _decoded_bytes(path, head)
        if decoded is None:
            return 8 * stored
        # A PNG's chunks are checked, joined and inflated once before they are decoded.
        return 4 * stored + 3 * decoded if format == "png" else stored + 4 * decoded
    return 4 * stored


def _decoded_bytes(path: StrPath, head: bytes) -> int | None:
    from PIL import Image as Pictures

    try:
        with Pictures.open(path) as picture:
            width, height = picture.size
    except (OSError, ValueError, Pictures.DecompressionBombError):
        return None
    deep = 2 if head.startswith(png.SIGNATURE) and head[24] == 16 else 1
    return width * height * deep * 3
