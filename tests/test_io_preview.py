"""Colour pictures, and one name for every kind of output."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stereopsis.io import (
    OUTPUT_SUFFIXES,
    check_output,
    colorize,
    describe,
    read_disparity,
    read_image,
    write_output,
    write_preview,
)
from stereopsis.types import Calibration

NAN = np.nan
CAMERA = Calibration(focal=100.0, cx=1.0, cy=0.5, baseline=0.5)
RAMP = np.tile(np.linspace(1, 60, 50, dtype=np.float32), (40, 1))


def test_the_colours_are_viridis() -> None:
    disparity = np.array([[0, 64, 128, 192, 255, NAN, -9, 999]], np.float32)
    picture = colorize(disparity, (0, 255))
    assert picture.dtype == np.uint8
    # Entries 0, 64, 128, 192 and 255 of the published table.
    table = [(68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37)]
    assert np.abs(picture[0, :5].astype(int) - table).max() <= 5
    assert tuple(picture[0, 5]) == (205, 205, 205)
    np.testing.assert_array_equal(picture[0, 6], picture[0, 0])
    np.testing.assert_array_equal(picture[0, 7], picture[0, 4])


def test_nearer_is_brighter_throughout() -> None:
    picture = colorize(np.arange(256, dtype=np.float32)[None], (0, 255)).astype(float)[0]
    luminance = (picture / 255) ** 2.2 @ (0.2126, 0.7152, 0.0722)
    # In steps of 8, because a colour has only 256 levels.
    assert (np.diff(luminance[::8]) > 0).all()


@pytest.mark.parametrize("values", [[[5, 5]], [[NAN, NAN]], [[0, -0.0]], [[1e30, 1e30]], [[-3e38, 3e38]]])
def test_maps_without_a_range_have_a_picture(tmp_path: Path, values: list[list[float]]) -> None:
    write_preview(tmp_path / "a.png", np.array(values, np.float32))
    assert read_image(tmp_path / "a.png").ndim == 3


def test_outliers_do_not_set_the_range() -> None:
    disparity = np.linspace(10, 20, 1000, dtype=np.float32).reshape(10, 100)
    disparity[0, 0] = 1e6
    assert len(np.unique(colorize(disparity).reshape(-1, 3), axis=0)) > 200


@pytest.mark.parametrize("limits", [(5, 5), (6, 5), (0, NAN), (-np.inf, 1)])
def test_a_range_that_is_none_is_refused(limits: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="range must be two finite numbers in order"):
        colorize(RAMP, limits)


def test_the_preview_shows_the_map_beside_a_bar_with_numbers(tmp_path: Path) -> None:
    disparity = np.tile(np.linspace(0, 100, 300, dtype=np.float32), (200, 1))
    write_preview(tmp_path / "a.png", disparity, (0, 100))
    picture = read_image(tmp_path / "a.png")
    np.testing.assert_array_equal(picture[:, :300], colorize(disparity, (0, 100)))
    assert picture.shape[0] == 200
    margin = picture[:, 300:]
    # Outside the map: white, a bar whose ends are the first and the last colour, black ticks and letters.
    assert (margin[:, 0] == 255).all()
    bar = margin[:, 14]
    first, last = colorize(np.array([[0, 100]], np.float32), (0, 100))[0]
    inside = np.flatnonzero((bar != 255).any(axis=1))
    np.testing.assert_array_equal(bar[inside[-1]], first)
    np.testing.assert_array_equal(bar[bar.tolist().index(last.tolist())], last)
    assert (margin[:, 30:].max(axis=2) < 60).sum() > 50


@pytest.mark.parametrize("shape", [(1, 1), (1, 400), (400, 1), (7, 5)])
@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".ppm"])
def test_every_size_has_a_preview(tmp_path: Path, shape: tuple[int, int], suffix: str) -> None:
    write_preview(tmp_path / f"a{suffix}", np.ones(shape, np.float32))
    height, width, _ = read_image(tmp_path / f"a{suffix}").shape
    assert height >= max(shape[0], 100)
    assert width > shape[1]


@pytest.mark.parametrize(
    ("name", "kind", "format"),
    [
        ("out.png", "disparity", "kitti"),
        ("preview.png", "image", "png"),
        ("out-preview.png", "image", "png"),
        ("out.preview.PNG", "image", "png"),
        ("previews.png", "disparity", "kitti"),
        ("out.jpg", "image", "jpeg"),
        ("out.jpeg", "image", "jpeg"),
        ("out.pfm", "disparity", "pfm"),
        ("out.npy", "disparity", "npy"),
        ("out.tif", "disparity", "tiff"),
        ("out.tiff", "disparity", "tiff"),
        ("out.ply", "points", "ply binary_little_endian"),
        ("depth.png", "depth", "png"),
        ("out-Depth.PNG", "depth", "png"),
        ("out-depth.pfm", "depth", "pfm"),
        ("depth.npy", "depth", "npy"),
        ("depth.tif", "depth", "tiff"),
        ("depths.png", "disparity", "kitti"),
        ("depth.jpg", "image", "jpeg"),
        ("depth.ply", "points", "ply binary_little_endian"),
    ],
)
def test_the_name_says_what_is_written(tmp_path: Path, name: str, kind: str, format: str) -> None:
    assert Path(name).suffix.lower() in OUTPUT_SUFFIXES
    path = tmp_path / name
    check_output(path, calibration=CAMERA)
    write_output(path, RAMP, image=np.zeros((40, 50), np.uint8), calibration=CAMERA)
    described = describe(path)
    assert (described["kind"], described["format"]) == (kind, format)
    assert [file.name for file in tmp_path.iterdir()] == [name]


def test_a_limit_of_the_cloud_is_passed_on(tmp_path: Path) -> None:
    write_output(tmp_path / "a.ply", RAMP, calibration=CAMERA, max_depth=2.0)
    # 50 px m / 2 m: disparities from 25 px.
    assert describe(tmp_path / "a.ply")["points"] == (RAMP >= 25).sum()


@pytest.mark.parametrize(
    ("name", "error", "message"),
    [
        ("out.exr", ValueError, r"out\.exr: unknown suffix '\.exr'; \.png, \.pfm"),
        ("out", ValueError, "unknown suffix ''"),
        ("out.ply", ValueError, r"out\.ply: a point cloud needs a calibration"),
        ("out-depth.png", ValueError, r"out-depth\.png: a depth image needs a calibration"),
        ("depth.tif", ValueError, r"depth\.tif: a depth image needs a calibration"),
        ("nowhere/out.png", FileNotFoundError, "nowhere"),
        ("folder.png", IsADirectoryError, "folder.png"),
    ],
)
def test_a_name_that_cannot_be_written_is_refused(
    tmp_path: Path, name: str, error: type[Exception], message: str
) -> None:
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(error, match=message):
        check_output(tmp_path / name)
    with pytest.raises(error, match=message):
        write_output(tmp_path / name, RAMP)
    assert [file.name for file in tmp_path.iterdir()] == ["folder.png"]


def test_what_a_file_holds(tmp_path: Path) -> None:
    disparity = np.array([[NAN, 1.5, 4], [2, NAN, 7]], np.float32)
    expected: dict[str, Any] = {
        "file": str(tmp_path / "a.pfm"),
        "kind": "disparity",
        "format": "pfm",
        "width": 3,
        "height": 2,
        "channels": 1,
        "dtype": "float32",
        "min": 1.5,
        "max": 7.0,
        "density": 4 / 6,
        "median": 3.0,
    }
    write_output(tmp_path / "a.pfm", disparity)
    assert describe(tmp_path / "a.pfm") == expected
    write_output(tmp_path / "a.png", disparity)
    kitti = {**expected, "file": str(tmp_path / "a.png"), "format": "kitti", "dtype": "uint16"}
    assert describe(tmp_path / "a.png") == kitti
    assert read_disparity(tmp_path / "a.png")[1, 2] == 7
    write_output(tmp_path / "preview.png", disparity)
    described = describe(tmp_path / "preview.png")
    assert (described["kind"], described["channels"], described["max"]) == ("image", 3, 255)
    assert "density" not in described
    for path in sorted(tmp_path.iterdir()):
        assert json.loads(json.dumps(describe(path), allow_nan=False)) == describe(path)


def test_what_a_calibration_holds(tmp_path: Path) -> None:
    (tmp_path / "calib.txt").write_text("cam0=[9 0 3; 0 9 2; 0 0 1]\nbaseline=250\ndoffs=1\n")
    assert describe(str(tmp_path / "calib.txt")) == {
        "file": str(tmp_path / "calib.txt"),
        "kind": "calibration",
        "format": "middlebury",
        "focal": 9.0,
        "cx": 3.0,
        "cy": 2.0,
        "baseline": 0.25,
        "doffs": 1.0,
        "width": None,
        "height": None,
        "ndisp": None,
    }


def test_what_an_ascii_cloud_holds(tmp_path: Path) -> None:
    fields = "property float x\nproperty float y\nproperty float z\n"
    text = f"ply\nformat ascii 1.0\nelement vertex 2\n{fields}end_header\n1 2 3\n4 5 6\n"
    (tmp_path / "a.ply").write_text(text)
    described = describe(tmp_path / "a.ply")
    assert (described["points"], described["properties"]) == (2, ["x", "y", "z"])


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "the file is empty"),
        (b"some text", "not a PNG, JPEG"),
        (b"ply\nformat ascii 1.0\n", "the PLY header does not begin with vertices, or it does not end"),
        (
            b"ply\nformat ascii 1.0\nelement face 3\nelement vertex 2\nproperty int x\nend_header\n",
            "begin with vert",
        ),
        (
            b"ply\nformat binary_big_endian 1.0\nelement vertex 9999999999\nproperty float x\nend_header\n12",
            "truncated: the header announces 9999999999 points",
        ),
    ],
)
def test_what_cannot_be_described(tmp_path: Path, data: bytes, message: str) -> None:
    (tmp_path / "a").write_bytes(data)
    with pytest.raises(ValueError, match=message) as caught:
        describe(tmp_path / "a")
    assert str(caught.value).startswith(f"{tmp_path / 'a'}: ")
