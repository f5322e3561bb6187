"""Disparity maps: bytes worked by hand, what is written is read, what a format cannot hold is refused."""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from stereopsis.io import read_disparity, write_disparity, write_image

DATA = Path(os.environ.get("STEREOPSIS_DATA", Path(__file__).parents[2] / "shared" / "data"))
NAN = np.nan


def pfm(header: str, *values: float, order: str = "<") -> bytes:
    return header.encode() + struct.pack(f"{order}{len(values)}f", *values)


def maps(low: float, high: float) -> st.SearchStrategy[npt.NDArray[np.float32]]:
    """Maps with disparities from `low` to `high`, holes, and at least one valid pixel."""
    values = st.floats(low, high, width=32) | st.just(NAN)
    sizes = st.tuples(st.integers(1, 6), st.integers(1, 6))
    arrays = hnp.arrays(np.float32, sizes, elements=values)
    return arrays.filter(lambda disparity: not np.isnan(disparity).all())


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        # The bottom row comes first.
        (pfm("Pf\n2 2\n-1.0\n", 3, 4, 1, 2), [[1, 2], [3, 4]]),
        (pfm("Pf\n2 2\n1.0\n", 3, 4, 1, 2, order=">"), [[1, 2], [3, 4]]),
        (pfm("Pf 2 1 -1\n", np.inf, -2.5), [[NAN, -2.5]]),
        (pfm("Pf\r\n1 2\r\n-1\r\n", NAN, 0.0), [[0.0], [NAN]]),
        (pfm("Pf\n2 1\n-1e0\n", -np.inf, 1), [[NAN, 1]]),
        # The scale's magnitude is no factor: Middlebury's files say 1/255 and mean their values.
        (pfm("Pf\n1 1\n-0.003922\n", 40.25), [[40.25]]),
        # A value whose first bytes are line breaks belongs to the pixels.
        (b"Pf\n1 1\n-1\n" + b"\n\n\r ", [[struct.unpack("<f", b"\n\n\r ")[0]]]),
    ],
)
def test_pfm_by_hand(tmp_path: Path, data: bytes, expected: list[list[float]]) -> None:
    path = tmp_path / "a.pfm"
    path.write_bytes(data)
    disparity = read_disparity(path)
    assert disparity.dtype == np.float32
    assert disparity.dtype.isnative
    assert disparity.flags.c_contiguous
    np.testing.assert_array_equal(disparity, np.array(expected, np.float32))


def test_pfm_is_written_little_endian_bottom_up_with_infinity(tmp_path: Path) -> None:
    write_disparity(tmp_path / "a.pfm", np.array([[1, NAN], [3, -np.inf], [5, 6]], np.float32))
    assert (tmp_path / "a.pfm").read_bytes() == pfm("Pf\n2 3\n-1\n", 5, 6, 3, np.inf, 1, np.inf)


def test_kitti_by_hand(tmp_path: Path) -> None:
    rows = b"\0" + struct.pack(">4H", 0, 1, 256, 65535)

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 4, 1, 16, 0, 0, 0, 0))
    path = tmp_path / "000000_10.png"
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    )
    expected = np.array([[NAN, 1 / 256, 1, 65535 / 256]], np.float32)
    for format in (None, "kitti", "drivingstereo"):
        np.testing.assert_array_equal(read_disparity(path, format), expected)


def test_kitti_as_opencv_sees_it(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    # 0.001 would round to 0, which means invalid; 1.3 · 256 = 332.8; 255.996 · 256 = 65534.98.
    write_disparity(tmp_path / "a.png", np.array([[NAN, 0, 0.001, 1.3, 255.996]], np.float32))
    stored = cv2.imread(str(tmp_path / "a.png"), cv2.IMREAD_UNCHANGED)
    assert stored.dtype == np.uint16
    assert stored.tolist() == [[0, 1, 1, 333, 65535]]


def test_middlebury_by_hand(tmp_path: Path) -> None:
    write_image(tmp_path / "disp2.png", np.array([[0, 1, 10, 255]], np.uint8))
    expected = np.array([[NAN, 0.25, 2.5, 63.75]], np.float32)
    np.testing.assert_array_equal(read_disparity(tmp_path / "disp2.png", "middlebury:4"), expected)
    write_image(tmp_path / "disp2.pgm", np.array([[0, 8]], np.uint8))
    np.testing.assert_array_equal(read_disparity(tmp_path / "disp2.pgm", "middlebury:16"), [[NAN, 0.5]])


@pytest.mark.parametrize("suffix", [".pfm", ".npy", ".tif", ".tiff", ".PFM"])
@settings(deadline=None, max_examples=30)
@given(disparity=maps(-1e6, 1e6))
def test_floats_are_read_as_they_were_written(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, disparity: npt.NDArray[np.float32]
) -> None:
    path = tmp_path_factory.getbasetemp() / f"floats{suffix}"
    before = disparity.copy()
    write_disparity(path, disparity)
    np.testing.assert_array_equal(disparity, before)
    back = read_disparity(path)
    assert back.dtype == np.float32
    np.testing.assert_array_equal(back, disparity)


@settings(deadline=None, max_examples=60)
@given(disparity=maps(0, 255.9375))
def test_kitti_is_read_within_its_step(
    tmp_path_factory: pytest.TempPathFactory, disparity: npt.NDArray[np.float32]
) -> None:
    path = tmp_path_factory.getbasetemp() / "kitti.png"
    write_disparity(path, disparity)
    expected = np.maximum(np.rint(disparity.astype(np.float64) * 256), 1) / 256
    np.testing.assert_array_equal(read_disparity(path), expected.astype(np.float32))
    # What has been rounded once stays.
    write_disparity(path, read_disparity(path))
    np.testing.assert_array_equal(read_disparity(path), expected.astype(np.float32))


@settings(deadline=None, max_examples=30)
@given(disparity=maps(0, 63.75))
def test_middlebury_is_read_within_its_step(
    tmp_path_factory: pytest.TempPathFactory, disparity: npt.NDArray[np.float32]
) -> None:
    path = tmp_path_factory.getbasetemp() / "middlebury.png"
    write_disparity(path, disparity, "middlebury:4")
    expected = np.maximum(np.rint(disparity.astype(np.float64) * 4), 1) / 4
    np.testing.assert_array_equal(read_disparity(path, "middlebury:4"), expected)


def test_other_floats_are_read(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.asfortranarray(np.array([[1.5, NAN, 1e300], [2, 3, -np.inf]], ">f8")))
    np.testing.assert_array_equal(read_disparity(tmp_path / "a.npy"), [[1.5, NAN, NAN], [2, 3, NAN]])
    np.save(tmp_path / "a.npy", np.array([[[0.5], [2]]], np.float16))
    np.testing.assert_array_equal(read_disparity(tmp_path / "a.npy"), [[0.5, 2]])


def test_strides_and_doubles_are_written(tmp_path: Path) -> None:
    disparity: Any = np.arange(24, dtype=np.float64).reshape(4, 6)[::-1, ::2]
    for name in ("a.pfm", "a.npy", "a.tif"):
        write_disparity(tmp_path / name, disparity)
        np.testing.assert_array_equal(read_disparity(tmp_path / name), disparity)


@pytest.mark.parametrize(
    ("disparity", "format", "message"),
    [
        (
            [[-0.5, -2, 7]],
            None,
            "2 of 3 disparities, -2 to -0.5 px, lie outside the 0 to 255.996 px .* write .pfm",
        ),
        ([[300, 1, NAN]], None, "1 of 2 disparities, 300 to 300 px"),
        ([[256]], None, "lie outside"),
        ([[64]], "middlebury:4", "lie outside the 0 to 63.75 px"),
        ([[1]], "middlebury", "'middlebury' needs its scale"),
        ([[1]], "middlebury:0", "'middlebury:0' needs its scale"),
        ([[1]], "middlebury:x", "needs its scale"),
        ([[1]], "kitty", "unknown format 'kitty'; 'kitti', "),
        ([[1]], "kitti:2", "unknown format"),
        ([[]], None, r"shape \(H, W\), not \(1, 0\)"),
        ([1.0], None, r"shape \(H, W\), not \(1,\)"),
    ],
)
def test_what_a_format_does_not_hold_is_refused(
    tmp_path: Path, disparity: list[Any], format: str | None, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        write_disparity(tmp_path / "a.png", np.array(disparity, np.float32), format)
    assert not list(tmp_path.iterdir())


def test_integers_are_no_disparities(tmp_path: Path) -> None:
    # OpenCV's matchers give int16 in sixteenths of a pixel.
    with pytest.raises(TypeError, match="disparity must be an array of floats, NaN where invalid, not int16"):
        write_disparity(tmp_path / "a.npy", np.zeros((2, 2), np.int16))
    with pytest.raises(TypeError, match="not list"):
        write_disparity(tmp_path / "a.npy", [[1.0]])  # type: ignore[arg-type]
    np.save(tmp_path / "a.npy", np.ones((2, 2), np.int16))
    with pytest.raises(ValueError, match="npy values of int16 are no disparities; floating point is read"):
        read_disparity(tmp_path / "a.npy")


def test_an_unknown_suffix_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"a\.exr: unknown suffix '\.exr' for a disparity map"):
        write_disparity(tmp_path / "a.exr", np.ones((2, 2), np.float32))


def test_what_says_no_scale_is_refused(tmp_path: Path) -> None:
    write_image(tmp_path / "grey.png", np.ones((2, 2), np.uint8))
    with pytest.raises(
        ValueError, match="8-bit values in a png do not say their scale; pass format='middlebury:4'"
    ):
        read_disparity(tmp_path / "grey.png")
    with pytest.raises(ValueError, match="'kitti' is 16-bit grey, but this is a png of uint8"):
        read_disparity(tmp_path / "grey.png", "kitti")
    write_image(tmp_path / "deep.tif", np.full((2, 2), 512, np.uint16))
    with pytest.raises(ValueError, match="pass format='kitti'"):
        read_disparity(tmp_path / "deep.tif")
    assert read_disparity(tmp_path / "deep.tif", "kitti").tolist() == [[2, 2], [2, 2]]
    write_image(tmp_path / "colour.png", np.ones((2, 2, 3), np.uint16))
    with pytest.raises(ValueError, match="a disparity map has one channel, this png has 3"):
        read_disparity(tmp_path / "colour.png")


def test_the_format_asked_for_must_be_the_files(tmp_path: Path) -> None:
    write_disparity(tmp_path / "a.pfm", np.ones((2, 2), np.float32))
    for format in ("npy", "tiff", "kitti", "middlebury:4"):
        with pytest.raises(ValueError, match="but this is a pfm of float32"):
            read_disparity(tmp_path / "a.pfm", format)
    with pytest.raises(ValueError, match="unknown format 'exr'"):
        read_disparity(tmp_path / "a.pfm", "exr")
    assert read_disparity(tmp_path / "a.pfm", "pfm").sum() == 4


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (pfm("Pf\n2 2\n-1\n", NAN, NAN, np.inf, NAN), "holds no disparity: every pixel is invalid"),
        (
            pfm("Pf\n2 2\n-1\n", 1, 2, 3),
            "truncated: the header announces 16 bytes of pixels, the file holds 12",
        ),
        (
            pfm("Pf\n2 1\n-1\n", 1, 2, 3),
            "wrong size: the header announces 8 bytes of pixels, the file holds 12",
        ),
        (pfm("Pf\n2 1\n0\n", 1, 2), "the scale in the PFM header is 0.0"),
        (pfm("Pf\n2 1\n-1e999\n", 1, 2), "the scale in the PFM header is -inf"),
        (pfm("Pf\n2 1\nx\n", 1, 2), "the PFM header is not"),
        (pfm("Pf\n-2 1\n-1\n", 1, 2), "the PFM header is not"),
        (pfm("Pf\n99999999999999999999 1\n-1\n", 1), "the PFM header is not"),
        (pfm("Pf\n999999999 999999999\n-1\n", 1), "the limit is 268435456 pixels"),
        (b"Pf\n" + b" " * 10000 + b"1 1\n-1\n1234", "the PFM header is not"),
        (b"Pf", "not a PNG"),
        (b"", "the file is empty"),
    ],
)
def test_a_broken_pfm_gets_one_clear_error(tmp_path: Path, data: bytes, message: str) -> None:
    path = tmp_path / "a.pfm"
    path.write_bytes(data)
    with pytest.raises(ValueError, match=message) as caught:
        read_disparity(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_an_npy_whose_header_lies_is_not_allocated(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, np.ones((2, 3), np.float32))
    whole = path.read_bytes()
    for shape, message in ((b"(9, 3)", "truncated"), (b"(1, 3)", "wrong size"), (b"(0, 3)", "empty image")):
        path.write_bytes(whole.replace(b"(2, 3)", shape))
        with pytest.raises(ValueError, match=message):
            read_disparity(path)
    path.write_bytes(whole.replace(b"(2, 3), }      ", b"(99999, 99999)}"))
    with pytest.raises(ValueError, match="the limit is"):
        read_disparity(path)
    np.save(path, np.array([[{}]], object), allow_pickle=True)
    with pytest.raises(ValueError, match="not an NPY file of real numbers"):
        read_disparity(path)


@pytest.mark.skipif(not (DATA / "middlebury-v3").is_dir(), reason="the real pairs are not there")
def test_real_truth_is_read() -> None:
    motorcycle = read_disparity(DATA / "middlebury-v3" / "trainingQ" / "Motorcycle" / "disp0GT.pfm")
    assert motorcycle.shape == (497, 741)
    assert 0 < np.nanmin(motorcycle) < np.nanmax(motorcycle) < 70  # ndisp of its calibration
    first = min((DATA / "drivingstereo").glob("*-disparity.png"))
    truth = read_disparity(first)
    assert truth.shape == (400, 881)
    assert 0.1 < np.isfinite(truth).mean() < 0.3
