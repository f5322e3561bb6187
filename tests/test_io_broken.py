"""Whatever is done to a file, its reader answers with a value or with one ValueError that names it, soon."""

from __future__ import annotations

import io
import struct
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from stereopsis.io import (
    describe,
    read_calibration,
    read_disparity,
    read_image,
    write_calibration,
    write_disparity,
    write_image,
    write_ply,
)
from stereopsis.types import Calibration

Reader = Callable[[Path], object]


def tiff(pixels: npt.NDArray[Any], **options: Any) -> bytes:
    file = io.BytesIO()
    tifffile.imwrite(file, pixels, metadata=None, **options)
    return file.getvalue()


def jpeg(pixels: npt.NDArray[Any], **options: Any) -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "JPEG", **options)
    return file.getvalue()


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Valid files of every kind."""
    folder = tmp_path_factory.mktemp("valid")
    rng = np.random.default_rng(5)
    grey = rng.integers(1, 256, (6, 7), np.uint8)
    colour = rng.integers(1, 256, (6, 7, 3), np.uint8)
    floats = grey.astype(np.float32) / np.float32(4)
    for name, image in {
        "grey.png": grey, "colour.png": colour, "deep.png": colour.astype(np.uint16) * 200, "grey.pgm": grey,
        "deep.ppm": colour.astype(np.uint16) * 200, "grey.tif": grey, "colour.pfm": colour.astype(np.float32),
    }.items():  # fmt: skip
        write_image(folder / name, image)
    for name in ("kitti.png", "disparity.pfm", "disparity.npy", "disparity.tif"):
        write_disparity(folder / name, floats)
    write_calibration(folder / "middlebury.txt", Calibration(700.5, 3.5, 3.0, 0.25, 1.5, 7, 6, 64))
    write_ply(folder / "points.ply", floats[:, :3], colour[:, 0])
    row = "7e2 0 6e2 {} 0 7e2 2e2 0 0 0 1 0\n"
    matrix = "!!opencv-matrix\n   rows: 3\n   cols: 4\n   dt: d\n   data: [ {} ]\n"
    numbers = "7., 0., 6., {}., 0., 7., 2., 0., 0., 0., 1., 0."
    exif = Image.Exif()
    exif[0x0112] = 6
    made = {
        "kitti.txt": f"P0: {row.format(0)}P1: {row.format(-300)}".encode(),
        "opencv.yml": b"%YAML:1.0\n---\n"
        + f"P1: {matrix.format(numbers.format(0))}P2: {matrix.format(numbers.format(-3))}".encode(),
        "text.pgm": b"P2 3 2 255 1 2 3 4 5 6\n",
        "grey.jpg": jpeg(grey),
        "exif.jpg": jpeg(np.kron(colour, np.ones((5, 5, 1), np.uint8)), exif=exif),
        "progressive.jpg": jpeg(np.kron(colour, np.ones((5, 5, 1), np.uint8)), progressive=True),
        "strips.tif": tiff(colour, photometric="rgb", compression="zlib", predictor=True, rowsperstrip=2),
        "lzw.tif": tiff(grey, compression="lzw"),
        "tiles.tif": tiff(np.kron(floats, np.ones((4, 4), np.float32)), tile=(16, 16)),
        "jpeg.tif": tiff(
            np.kron(colour, np.ones((5, 5, 1), np.uint8)), photometric="rgb", compression="jpeg"
        ),
    }
    return made | {path.name: path.read_bytes() for path in folder.iterdir()}


NAMES = [
    *("grey.png", "colour.png", "deep.png", "kitti.png", "grey.pgm", "text.pgm", "deep.ppm", "grey.tif"),
    *("disparity.tif", "strips.tif", "lzw.tif", "tiles.tif", "jpeg.tif", "colour.pfm", "disparity.pfm"),
    *("disparity.npy", "grey.jpg", "exif.jpg", "progressive.jpg", "middlebury.txt", "kitti.txt"),
    *("opencv.yml", "points.ply"),
]
WHOLE = [name for name in NAMES if not name.endswith((".txt", ".yml", "text.pgm"))]
READERS: list[Reader] = [describe, read_image, read_disparity, read_calibration]


def reads(path: Path, data: bytes) -> bool:
    """Whether `describe` reads the data; any exception but the one allowed, a warning too, fails the test."""
    path.write_bytes(data)
    began = time.perf_counter()
    answers: list[bool] = []
    messages: list[str] = []
    for reader in READERS:
        try:
            reader(path)
            answers.append(True)
        except ValueError as error:
            messages.append(str(error))
            answers.append(False)
    assert all(message.startswith(f"{path}: ") and "\n" not in message for message in messages), messages
    assert time.perf_counter() - began < 10
    return answers[0]


def with_checksums(data: bytes) -> bytes:
    """A PNG whose chunks' checksums are right again, so that what they hold is looked at."""
    made, at = bytearray(data), 8
    while at + 12 <= len(made):
        (length,) = struct.unpack_from(">I", made, at)
        if at + 12 + length > len(made):
            break
        struct.pack_into(">I", made, at + 8 + length, zlib.crc32(made[at + 4 : at + 8 + length]))
        at += 12 + length
    return bytes(made)


@pytest.mark.parametrize("name", NAMES)
def test_a_valid_file_is_read(tmp_path: Path, files: dict[str, bytes], name: str) -> None:
    assert reads(tmp_path / "whole", files[name])


@pytest.mark.parametrize("name", WHOLE)
def test_a_file_cut_anywhere_is_refused(tmp_path: Path, files: dict[str, bytes], name: str) -> None:
    data = files[name]
    cuts = range(len(data)) if len(data) < 300 else {*range(0, len(data), len(data) // 200), *range(-20, 0)}
    kept = [cut for cut in cuts if reads(tmp_path / "cut", data[:cut])]
    assert not kept


@pytest.mark.parametrize("name", [name for name in NAMES if name not in WHOLE])
def test_a_text_cut_anywhere_is_read_or_refused(tmp_path: Path, files: dict[str, bytes], name: str) -> None:
    data = files[name]
    assert not reads(tmp_path / "cut", data[: len(data) // 2])
    for cut in range(len(data)):
        reads(tmp_path / "cut", data[:cut])


@pytest.mark.parametrize("name", NAMES)
@settings(deadline=None, max_examples=60)
@given(data=st.data())
def test_a_file_with_other_bytes_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, files: dict[str, bytes], name: str, data: st.DataObject
) -> None:
    made = bytearray(files[name])
    # Most of what can go wrong is in the first bytes.
    places = st.integers(0, min(len(made), 200) - 1) | st.integers(0, len(made) - 1)
    values = st.sampled_from([0, 1, 10, 32, 45, 57, 127, 128, 255]) | st.integers(0, 255)
    for place, value in data.draw(st.lists(st.tuples(places, values), min_size=1, max_size=6)):
        made[place] = value
    changed = bytes(made)
    if name.endswith(".png") and data.draw(st.booleans()):
        changed = with_checksums(changed)
    reads(tmp_path_factory.getbasetemp() / "changed", changed)


STARTS = [
    *(b"", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"II*\0", b"MM\0*", b"II+\0\x08\0\0\0", b"P5\n", b"P2\n"),
    *(b"Pf\n", b"\x93NUMPY\x01\0", b"ply\n", b"%YAML:1.0\n", b"cam0=", b"P0:"),
]


@settings(deadline=None, max_examples=100)
@given(start=st.sampled_from(STARTS), rest=st.binary(max_size=200))
def test_noise_is_refused(tmp_path_factory: pytest.TempPathFactory, start: bytes, rest: bytes) -> None:
    reads(tmp_path_factory.getbasetemp() / "noise", start + rest)


@pytest.mark.parametrize("filler", [b"\n", b" ", b"\n ", b"[", b"# \n", b"P0:\n", b"1 "])
@pytest.mark.parametrize("start", STARTS)
def test_a_long_file_of_nothing_is_refused_soon(tmp_path: Path, start: bytes, filler: bytes) -> None:
    assert not reads(tmp_path / "long", start + filler * (200_000 // len(filler)))


@pytest.mark.parametrize("tag", ["ImageWidth", "ImageLength"])
def test_a_tiff_whose_size_lies_is_refused(tmp_path: Path, files: dict[str, bytes], tag: str) -> None:
    for name in ("grey.tif", "disparity.tif", "strips.tif", "lzw.tif", "tiles.tif"):
        made = bytearray(files[name])
        with tifffile.TiffFile(io.BytesIO(files[name])) as file:
            entry: Any = file.pages.first.tags[tag]
        for size in (0, 3_000, 2**31 - 1):
            struct.pack_into("<HI", made, entry.offset + 2, 4, 1)
            struct.pack_into("<I", made, entry.valueoffset, size)
            assert not reads(tmp_path / "lie.tif", bytes(made)), (name, size)
