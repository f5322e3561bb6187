"""Images: every format at every depth, hand-built bytes, OpenCV's pixels, pairs."""

from __future__ import annotations

import io
import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image

from stereopsis.io import read_image, read_pair, write_calibration, write_image
from stereopsis.types import Calibration

DATA = Path(os.environ.get("STEREOPSIS_DATA", Path(__file__).parents[2] / "shared" / "data"))
Pixels = npt.NDArray[Any]


def chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def png(
    width: int, height: int, depth: int, colours: int, rows: bytes, *extra: bytes, interlace: int = 0
) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, depth, colours, 0, 0, interlace)
    pixels = chunk(b"IDAT", zlib.compress(rows))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + b"".join(extra) + pixels + chunk(b"IEND", b"")


def read_bytes(folder: Path, data: bytes) -> Pixels:
    path = folder / "image"
    path.write_bytes(data)
    return read_image(path)


def saved(image: Image.Image, format: str, **options: Any) -> bytes:
    file = io.BytesIO()
    image.save(file, format, **options)
    return file.getvalue()


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"P5\n2 1\n255\n\x00\xfe", np.array([[0, 254]], np.uint8)),
        (b"P5 2 1 # twelve bits\n4095\n\x0f\xff\x00\x01", np.array([[4095, 1]], np.uint16)),
        (b"P6\n1 2\n255\n\x01\x02\x03\x04\x05\x06", np.array([[[1, 2, 3]], [[4, 5, 6]]], np.uint8)),
        (b"P6\n1 1\n65535\n\x01\x02\x03\x04\xff\xff", np.array([[[258, 772, 65535]]], np.uint16)),
        (b"P2\n# text\n3 1\n255\n7 8\n9\n", np.array([[7, 8, 9]], np.uint8)),
        (b"P3 1 1 300 1 2 300", np.array([[[1, 2, 300]]], np.uint16)),
        (b"P4\n3 1\n\x40", np.array([[255, 0, 255]], np.uint8)),
        (b"P1\n3 1\n0 1 0\n", np.array([[255, 0, 255]], np.uint8)),
        (b"PF\n1 2\n-1\n" + struct.pack("<6f", *range(6)), np.array([[[3, 4, 5]], [[0, 1, 2]]], np.float32)),
        (png(2, 1, 8, 0, b"\0\x05\x06"), np.array([[5, 6]], np.uint8)),
        (png(2, 1, 16, 0, b"\0\x01\x02\x03\x04"), np.array([[258, 772]], np.uint16)),
        (png(1, 1, 16, 2, b"\0\x01\x02\x03\x04\x05\x06"), np.array([[[258, 772, 1286]]], np.uint16)),
        (png(4, 1, 1, 0, b"\0\xa0"), np.array([[255, 0, 255, 0]], np.uint8)),
        (png(2, 1, 4, 0, b"\0\x1f"), np.array([[17, 255]], np.uint8)),
        (png(1, 1, 8, 6, b"\0\x01\x02\x03\x00"), np.array([[[1, 2, 3]]], np.uint8)),
        (png(1, 1, 8, 4, b"\0\x07\x00"), np.array([[7]], np.uint8)),
        (png(1, 1, 16, 4, b"\0\x01\x02\x00\x00"), np.array([[258]], np.uint16)),
        (png(1, 1, 16, 6, b"\0\x01\x02\x03\x04\x05\x06\x00\x00"), np.array([[[258, 772, 1286]]], np.uint16)),
        (
            png(2, 1, 8, 3, b"\0\1\0", chunk(b"PLTE", bytes([1, 2, 3, 10, 11, 12])), chunk(b"tRNS", b"\0")),
            np.array([[[10, 11, 12], [1, 2, 3]]], np.uint8),
        ),
        # Adam7: the first pass holds pixel 0, the fourth pixels 2, the sixth pixels 1 and 3.
        (png(4, 1, 8, 0, b"\0\x09" b"\0\x07" b"\0\x08\x06", interlace=1), np.array([[9, 8, 7, 6]], np.uint8)),
    ],
)  # fmt: skip
def test_bytes_built_by_hand(tmp_path: Path, data: bytes, expected: Pixels) -> None:
    image = read_bytes(tmp_path, data)
    assert image.dtype == expected.dtype
    assert image.dtype.isnative
    assert image.flags.c_contiguous
    np.testing.assert_array_equal(image, expected)


CASES = [
    (".png", "uint8", True), (".png", "uint8", False), (".png", "uint16", True), (".png", "uint16", False),
    (".ppm", "uint8", True), (".pgm", "uint8", False), (".ppm", "uint16", True), (".pgm", "uint16", False),
    (".tif", "uint8", True), (".tiff", "uint16", False), (".tif", "uint16", True), (".tif", "float32", False),
    (".tif", "float32", True), (".pfm", "float32", True), (".pfm", "float32", False), (".npy", "uint8", True),
    (".npy", "uint16", False), (".npy", "float32", True),
]  # fmt: skip


@pytest.mark.parametrize(("suffix", "dtype", "colour"), CASES)
@settings(deadline=None, max_examples=15)
@given(data=st.data())
def test_what_is_written_is_read(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, dtype: str, colour: bool, data: st.DataObject
) -> None:
    sizes = st.tuples(st.integers(1, 9), st.integers(1, 9)).map(lambda size: (*size, 3) if colour else size)
    finite: Any = {"allow_nan": False, "allow_infinity": False} if dtype == "float32" else {}
    image = data.draw(hnp.arrays(dtype, sizes, elements=hnp.from_dtype(np.dtype(dtype), **finite)))
    path = tmp_path_factory.getbasetemp() / f"image{suffix}"
    # Any strides: every second row of a larger array, from the right.
    strided = np.repeat(image, 2, axis=0)[::2, ::-1][:, ::-1]
    write_image(path, strided)
    back = read_image(path)
    assert back.dtype == image.dtype
    np.testing.assert_array_equal(back, image)


def test_a_jpeg_is_read_again(tmp_path: Path) -> None:
    image = np.full((16, 24, 3), (200, 100, 50), np.uint8)
    write_image(tmp_path / "flat.JPG", image)
    assert np.abs(read_image(tmp_path / "flat.JPG").astype(int) - image).max() <= 2
    write_image(tmp_path / "grey.jpeg", image[..., 0])
    np.testing.assert_array_equal(read_image(tmp_path / "grey.jpeg"), image[..., 0])


@pytest.mark.parametrize("suffix", [".png", ".pgm", ".tif"])
@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_opencv_reads_and_writes_the_same_pixels(tmp_path: Path, suffix: str, dtype: str) -> None:
    cv2 = pytest.importorskip("cv2")
    for colour in (False, True):
        name = suffix.replace("pgm", "ppm") if colour else suffix
        shape = (37, 21, 3) if colour else (37, 21)
        image = np.random.default_rng(1).integers(0, np.iinfo(dtype).max, shape, dtype=dtype, endpoint=True)
        swapped = np.ascontiguousarray(image[..., ::-1]) if colour else image
        write_image(tmp_path / f"ours{name}", image)
        np.testing.assert_array_equal(
            cv2.imread(str(tmp_path / f"ours{name}"), cv2.IMREAD_UNCHANGED), swapped
        )
        cv2.imwrite(str(tmp_path / f"theirs{name}"), swapped)
        np.testing.assert_array_equal(read_image(tmp_path / f"theirs{name}"), image)


def test_a_jpeg_has_opencvs_bytes(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    rng = np.random.default_rng(2)
    picture = np.kron(rng.integers(0, 256, (9, 12, 3), np.uint8), np.ones((7, 7, 1), np.uint8))
    ways: list[dict[str, Any]] = [{}, {"quality": 30}, {"subsampling": 0}, {"progressive": True}]
    for number, options in enumerate(ways):
        path = tmp_path / f"{number}.jpg"
        path.write_bytes(saved(Image.fromarray(picture), "JPEG", **options))
        np.testing.assert_array_equal(read_image(path), cv2.imread(str(path))[..., ::-1])


@pytest.mark.skipif(not (DATA / "drivingstereo").is_dir(), reason="the real pairs are not there")
def test_real_jpegs_have_opencvs_bytes() -> None:
    cv2 = pytest.importorskip("cv2")
    files = sorted((DATA / "drivingstereo").glob("*-left.jpg"))[:5]
    assert files
    for path in files:
        np.testing.assert_array_equal(read_image(path), cv2.imread(str(path))[..., ::-1])


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("format", ["JPEG", "PNG", "TIFF"])
def test_orientation_is_obeyed_as_opencv_does(tmp_path: Path, format: str, orientation: int) -> None:
    cv2 = pytest.importorskip("cv2")
    picture = np.zeros((16, 32, 3), np.uint8)
    picture[:8, :16] = 255
    picture[8:, :16] = 128
    exif = Image.Exif()
    exif[0x0112] = orientation
    data = saved(Image.fromarray(picture), format, exif=exif)
    theirs = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(read_bytes(tmp_path, data), theirs[..., ::-1])


def test_tiffs_of_other_programs(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    colour = rng.integers(0, 256, (40, 50, 3), np.uint8)
    cases: list[tuple[Pixels, dict[str, Any]]] = [
        (colour, {"compression": "zlib", "predictor": True, "rowsperstrip": 7}),
        (colour, {"compression": "lzw", "tile": (16, 16)}),
        (colour, {"compression": "zstd"}),
        (colour, {"tile": (32, 16)}),
        (colour[..., 0].astype(np.uint16) * 257, {"compression": "packbits"}),
        (colour[..., 1].astype(np.float32) / 7, {"compression": "zlib", "predictor": 3}),
    ]
    for pixels, options in cases:
        photometric = "rgb" if pixels.ndim == 3 else "minisblack"
        orders: tuple[Literal["<"], Literal[">"]] = ("<", ">")
        for order in orders:
            with tifffile.TiffWriter(tmp_path / "a.tif", byteorder=order, bigtiff=order == ">") as writer:
                writer.write(pixels, photometric=photometric, **options)
            np.testing.assert_array_equal(read_image(tmp_path / "a.tif"), pixels)
    tifffile.imwrite(
        tmp_path / "a.tif", np.moveaxis(colour, 2, 0), photometric="rgb", planarconfig="separate"
    )
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif"), colour)
    tifffile.imwrite(tmp_path / "a.tif", colour[..., 0], photometric="miniswhite")
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif"), 255 - colour[..., 0])
    tifffile.imwrite(tmp_path / "a.tif", colour[..., 0].astype(np.float64) / 3)
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif"), (colour[..., 0] / 3).astype(np.float32))
    palette = Image.fromarray(colour).quantize(16)
    assert np.array_equal(read_bytes(tmp_path, saved(palette, "TIFF")), np.asarray(palette.convert("RGB")))
    bits = Image.fromarray(colour[..., 0]).convert("1")
    assert np.array_equal(
        read_bytes(tmp_path, saved(bits, "TIFF", compression="group4")), np.asarray(bits) * 255
    )


def test_the_content_decides_not_the_name(tmp_path: Path) -> None:
    path = tmp_path / "photo.jpg"
    path.write_bytes(png(1, 1, 8, 0, b"\0\x05"))
    assert read_image(path).tolist() == [[5]]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "the file is empty"),
        (b"once upon a time", "not a PNG, JPEG, TIFF, PGM, PPM, PFM or NPY file: it begins with b'once upo'"),
        (b"P5\n3 2\n255\n12345", "truncated: the header announces 6 bytes of pixels, the file holds 5"),
        (b"P5\n3 2\n255\n1234567", "wrong size: the header announces 6 bytes of pixels, the file holds 7"),
        (b"P5\n0 2\n255\n", "empty image, 0 x 2"),
        (b"P6\n999999999 999999999\n255\n", "the limit is 268435456 pixels"),
        (b"P2\n2 1\n255\n1", "truncated"),
        (b"P5\n2 1\n70000\n1234", "no maximum between 1 and 65535"),
        (b"Pf\n1 1\n-1\n" + struct.pack("<f", np.nan), "1 of 1 values are NaN or infinite"),
        (b"Pf\n99999 99999\n-1\n", "the limit is 268435456 pixels"),
        (png(100000, 100000, 8, 0, b""), "the limit is 268435456 pixels"),
        (png(2000000, 1, 8, 0, b""), "1000000 a side"),
        (png(16000, 16000, 8, 2, b""), "truncated: .* bytes cannot hold the 16000 x 16000 pixels"),
        (
            png(2, 2, 8, 0, b"\0\x01\x02"),
            "truncated: the header announces 6 bytes of pixels, the file holds 3",
        ),
        (png(2, 1, 8, 0, b"\0\x01\x02\0\x01\x02"), "wrong size: the header announces 3 bytes of pixels"),
        (png(2, 1, 8, 0, b"\x09\x01\x02"), "damaged"),
        (png(1, 1, 8, 5, b"\0\0"), "colours, depths or methods"),
        (png(1, 1, 8, 0, b"\0\x05")[:-4] + b"oops", "the checksum of the PNG's b'IEND' chunk is wrong"),
        (png(1, 1, 8, 0, b"\0\x05")[:-1], "truncated: the PNG ends before its IEND chunk"),
        (b"\xff\xd8\xff\xc0\x00\x0b\x08\xff\xff\xff\xff\x01\x01\x11\x00", "the limit is 268435456 pixels"),
        (b"\x93NUMPY\x01\x00\x06\x00{'a'}\n", "not an NPY file of real numbers"),
        (saved(Image.new("CMYK", (4, 4)), "JPEG"), "a JPEG in CMYK colours; grey and RGB are read"),
    ],
)
def test_a_file_that_is_no_image_gets_one_clear_error(tmp_path: Path, data: bytes, message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        read_bytes(tmp_path, data)
    assert str(caught.value).startswith(str(tmp_path / "image") + ": ")
    assert "\n" not in str(caught.value)


def test_integers_of_other_sizes_are_no_image(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.zeros((2, 2), np.int32))
    with pytest.raises(ValueError, match="uint8, uint16 or float32, not int32"):
        read_image(tmp_path / "a.npy")
    np.save(tmp_path / "a.npy", np.zeros((2, 2, 2), np.uint8))
    with pytest.raises(ValueError, match="1 or 3 channels, not 2"):
        read_image(tmp_path / "a.npy")


def test_a_missing_file_and_a_folder_keep_their_errors(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        read_image(tmp_path / "nowhere.png")
    with pytest.raises(OSError, match=str(tmp_path)):
        read_image(tmp_path)


@pytest.mark.parametrize(
    ("name", "image", "error", "message"),
    [
        (
            "a.png",
            np.zeros((2, 2), np.float32),
            ValueError,
            "a.png: .png does not hold grey pixels of float32",
        ),
        ("a.jpg", np.zeros((2, 2, 3), np.uint16), ValueError, "does not hold RGB pixels of uint16"),
        ("a.pgm", np.zeros((2, 2, 3), np.uint8), ValueError, "does not hold RGB"),
        ("a.ppm", np.zeros((2, 2), np.uint8), ValueError, "does not hold grey"),
        ("a.pfm", np.zeros((2, 2), np.uint8), ValueError, "does not hold grey pixels of uint8"),
        ("a.gif", np.zeros((2, 2), np.uint8), ValueError, "unknown suffix '.gif'"),
        ("a.png", np.zeros((2, 2), np.int64), TypeError, "uint8, uint16 or float32, not int64"),
        ("a.png", [[1]], TypeError, "not list"),
        ("a.png", np.zeros((0, 2), np.uint8), ValueError, r"not \(0, 2\)"),
        ("a.png", np.zeros((2, 2, 4), np.uint8), ValueError, r"not \(2, 2, 4\)"),
    ],
)
def test_what_cannot_be_written_leaves_no_file(
    tmp_path: Path, name: str, image: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        write_image(tmp_path / name, image)
    assert not list(tmp_path.iterdir())


def test_a_pair(tmp_path: Path) -> None:
    left, right, calibration = tmp_path / "view0.png", tmp_path / "view1.png", tmp_path / "calib.txt"
    write_image(left, np.full((3, 4), 1, np.uint8))
    write_image(right, np.full((3, 4), 2, np.uint8))
    geometry = Calibration(focal=700.0, cx=2.0, cy=1.5, baseline=0.5, width=4, height=3)
    write_calibration(calibration, geometry)
    pair = read_pair(left, right, calibration)
    assert (pair.left[0, 0], pair.right[0, 0], pair.calibration, pair.name) == (1, 2, geometry, "view0")
    named = read_pair(left, str(right), geometry, name="street")
    assert (named.calibration, named.name) == (geometry, "street")
    assert read_pair(left, right).calibration is None


def test_a_pair_must_be_alike(tmp_path: Path) -> None:
    write_image(tmp_path / "a.png", np.zeros((3, 4), np.uint8))
    write_image(tmp_path / "b.png", np.zeros((3, 5), np.uint8))
    write_image(tmp_path / "c.png", np.zeros((3, 4), np.uint16))
    with pytest.raises(ValueError, match=r"a\.png is 4 x 3 grey uint8, .*b\.png is 5 x 3 grey uint8"):
        read_pair(tmp_path / "a.png", tmp_path / "b.png")
    with pytest.raises(ValueError, match="must be alike"):
        read_pair(tmp_path / "a.png", tmp_path / "c.png")
    geometry = Calibration(focal=700.0, cx=2.0, cy=1.5, baseline=0.5, width=8, height=6)
    with pytest.raises(ValueError, match=r"the calibration is for 8 x 6 pixels, but .* has 4 x 3"):
        read_pair(tmp_path / "a.png", tmp_path / "a.png", geometry)


def test_importing_loads_no_file_library() -> None:
    program = (
        "import sys, stereopsis.io; "
        "print(*{'PIL', 'tifffile', 'imagecodecs', 'netpbmfile', 'trimesh', 'yaml'} & sys.modules.keys())"
    )
    output = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert output.stdout.strip() == ""
