"""Depth and points worked by hand, and the PLY that others read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from stereopsis.io import (
    depth,
    describe,
    points,
    read_disparity,
    read_image,
    write_depth,
    write_output,
    write_ply,
)
from stereopsis.types import Calibration

NAN = np.nan
# f B = 100 px · 0.5 m = 50 px m; a disparity of -10 is at infinity.
CAMERA = Calibration(focal=100.0, cx=1.0, cy=0.5, baseline=0.5, doffs=10.0)


def test_depth_by_hand() -> None:
    disparity = np.array([[0, 15, 40], [NAN, -10, -11], [-9.5, np.inf, -9]], np.float32)
    z = depth(disparity, CAMERA)
    assert z.dtype == np.float32
    np.testing.assert_array_equal(z, np.array([[5, 2, 1], [NAN, NAN, NAN], [100, NAN, 50]], np.float32))


def test_depth_is_finite_or_nan() -> None:
    tiny = np.array([[1e-45, 1e-38, 3e38, 0]], np.float32)
    z = depth(tiny, Calibration(focal=1000.0, cx=0, cy=0, baseline=1.0))
    assert not np.isinf(z).any()
    np.testing.assert_array_equal(np.isnan(z), [[True, True, False, True]])


def test_a_depth_image_holds_millimetres(tmp_path: Path) -> None:
    metres = np.array([[0.0004, 0.0006, 1.2344, 65.535], [65.536, NAN, np.inf, -1]], np.float32)
    write_depth(tmp_path / "depth.png", metres)
    stored = read_image(tmp_path / "depth.png")
    assert stored.dtype == np.uint16
    np.testing.assert_array_equal(stored, [[0, 1, 1234, 65535], [0, 0, 0, 0]])
    described = describe(tmp_path / "depth.png")
    assert (described["min"], described["max"]) == (pytest.approx(0.001), pytest.approx(65.535))
    assert (described["median"], described["density"]) == (pytest.approx(1.234), 3 / 8)


@pytest.mark.parametrize("suffix", [".pfm", ".npy", ".tif"])
def test_a_depth_image_of_floats_holds_metres(tmp_path: Path, suffix: str) -> None:
    disparity = np.array([[0, 15, 40], [NAN, -10, -11]], np.float32)
    write_output(tmp_path / f"a-depth{suffix}", disparity, calibration=CAMERA)
    # Only names tell depth from disparity: read as one, the values are what is stored.
    stored = read_disparity(tmp_path / f"a-depth{suffix}")
    np.testing.assert_array_equal(stored, np.array([[5, 2, 1], [NAN, NAN, NAN]], np.float32))
    assert describe(tmp_path / f"a-depth{suffix}")["max"] == 5


@pytest.mark.parametrize(
    ("depth", "name", "error", "message"),
    [
        (np.ones((2, 3), int), "a.png", TypeError, "depth must be an array of floats"),
        (np.ones(3), "a.png", ValueError, r"depth must have the shape \(H, W\)"),
        (np.ones((2, 3)), "a.jpg", ValueError, "unknown suffix '.jpg'"),
    ],
)
def test_what_is_no_depth_is_not_written(
    tmp_path: Path, depth: Any, name: str, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        write_depth(tmp_path / name, depth)
    assert list(tmp_path.iterdir()) == []


def test_points_by_hand() -> None:
    disparity = np.array([[0, NAN, 40], [15, -10, 90]], np.float32)
    image = np.arange(18, dtype=np.uint8).reshape(2, 3, 3)
    xyz, rgb = points(disparity, CAMERA, image)
    # x = (u - cx) Z / f to the right, y = (v - cy) Z / f down, Z forward; row by row.
    expected = [[-0.05, -0.025, 5], [0.01, -0.005, 1], [-0.02, 0.01, 2], [0.005, 0.0025, 0.5]]
    assert xyz.dtype == np.float32
    np.testing.assert_allclose(xyz, expected, rtol=1e-6)
    assert rgb is not None
    assert rgb.dtype == np.uint8
    assert rgb.tolist() == [[0, 1, 2], [6, 7, 8], [9, 10, 11], [15, 16, 17]]


def test_points_without_colour_or_too_far() -> None:
    disparity = np.array([[0, 15, 40]], np.float32)
    xyz, rgb = points(disparity, CAMERA, max_depth=2.0)
    assert xyz[:, 2].tolist() == [2, 1]
    assert rgb is None


@pytest.mark.parametrize(
    ("image", "expected"),
    [
        (np.array([[0, 100, 200]], np.uint8), [0, 100, 200]),
        (np.array([[0, 1000, 4000]], np.uint16), [0, 63, 255]),
        (np.array([[-1, 0.25, 0.5]], np.float32), [0, 127, 255]),
        (np.zeros((1, 3), np.uint16), [0, 0, 0]),
    ],
)
def test_grey_images_colour_points(image: Any, expected: list[int]) -> None:
    _, rgb = points(np.full((1, 3), 15, np.float32), CAMERA, image)
    assert rgb is not None
    assert rgb.tolist() == [[value] * 3 for value in expected]


def test_a_ply_is_read_again(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    xyz = rng.normal(size=(7, 3)).astype(np.float32)
    rgb = rng.integers(0, 256, (7, 3), np.uint8)
    path = tmp_path / "points.ply"
    write_ply(path, xyz, rgb)
    header, body = path.read_bytes().split(b"end_header\n", 1)
    assert header.startswith(b"ply\nformat binary_little_endian 1.0\n")
    assert (
        b"element vertex 7\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n"
        in header
    )
    # 3 floats and RGBA a point, in this order and with nothing after them.
    rows = np.frombuffer(body, np.dtype([("xyz", "<f4", 3), ("rgba", "u1", 4)]))
    np.testing.assert_array_equal(rows["xyz"], xyz)
    np.testing.assert_array_equal(rows["rgba"], np.column_stack([rgb, np.full(7, 255)]))
    cloud: Any = trimesh.load(path)
    np.testing.assert_array_equal(np.asarray(cloud.vertices, np.float32), xyz)
    np.testing.assert_array_equal(cloud.colors[:, :3], rgb)


def test_a_ply_without_colours(tmp_path: Path) -> None:
    write_ply(tmp_path / "points.ply", np.array([[1, 2, 3]], np.float32))
    described = describe(tmp_path / "points.ply")
    assert (described["points"], described["min"]) == (1, [1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("xyz", "rgb", "message"),
    [
        (np.zeros((0, 3), np.float32), None, "at least one point"),
        (np.zeros((2, 2), np.float32), None, r"shape \(N, 3\)"),
        (np.full((1, 3), NAN, np.float32), None, "finite"),
        (np.zeros((2, 3), np.float32), np.zeros((1, 3), np.uint8), "rgb must be uint8 with the shape of xyz"),
        (np.zeros((2, 3), np.float32), np.zeros((2, 3), np.float32), "not float32"),
    ],
)
def test_what_is_no_cloud_is_not_written(tmp_path: Path, xyz: Any, rgb: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        write_ply(tmp_path / "points.ply", xyz, rgb)
    assert not list(tmp_path.iterdir())


def test_sizes_must_agree() -> None:
    disparity = np.ones((2, 3), np.float32)
    with pytest.raises(ValueError, match="the calibration is for 6 x 4 pixels, but disparity has 3 x 2"):
        depth(disparity, Calibration(100.0, 1, 1, 0.5, width=6, height=4))
    with pytest.raises(ValueError, match=r"image has \(2, 2\) rows and columns, but disparity has \(2, 3\)"):
        points(disparity, CAMERA, np.zeros((2, 2), np.uint8))
    with pytest.raises(ValueError, match="baseline is -1 m"):
        depth(disparity, Calibration(100.0, 1, 1, -1.0))
    with pytest.raises(TypeError, match="array of floats"):
        depth(np.ones((2, 3), np.int16), CAMERA)
