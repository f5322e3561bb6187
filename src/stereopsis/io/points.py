"""From disparity to depth and to points in space."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from stereopsis.io._errors import StrPath
from stereopsis.io.atomic import write_bytes
from stereopsis.io.calibration import check_calibration
from stereopsis.io.disparity import check_disparity, write_disparity
from stereopsis.io.formats import png
from stereopsis.io.images import check_image
from stereopsis.types import Calibration, DisparityMap, Image

MILLIMETRES = 1000
"""A metre in a depth image of whole numbers."""
DEPTH_SUFFIXES = (".png", ".pfm", ".npy", ".tif", ".tiff")
"""What `write_depth` can write."""


def depth(disparity: DisparityMap, calibration: Calibration) -> npt.NDArray[np.float32]:
    """The distance along the optical axis, ``focal * baseline / (disparity + doffs)``.

    Parameters
    ----------
    disparity : ndarray of floats, (H, W)
        In pixels; NaN where invalid.
    calibration : Calibration
        Of the images that it was computed from, at their size.

    Returns
    -------
    ndarray of float32, (H, W)
        In metres; NaN where the disparity is invalid, and where ``disparity + doffs`` is not positive: at
        and beyond infinity.

    Raises
    ------
    TypeError, ValueError
        `disparity` is not a map of floats, or has another size than the calibration.
    """
    disparity = check_disparity(disparity)
    c = check_calibration(calibration)
    height, width = disparity.shape
    if (c.width or width, c.height or height) != (width, height):
        raise ValueError(
            f"the calibration is for {c.width} x {c.height} pixels, but disparity has {width} x {height}"
        )
    shifted = disparity + np.float32(c.doffs)
    with np.errstate(divide="ignore", over="ignore"):
        z = np.float32(c.focal * c.baseline) / shifted
    return np.where((shifted > 0) & np.isfinite(z), z, np.float32(np.nan))


def write_depth(path: StrPath, depth: npt.NDArray[np.floating[Any]]) -> None:
    """Write a depth image, whole or not at all.

    A ``.png`` holds millimetres in 16 bits, 0 where there is no depth, as ROS (REP 118, "16UC1"), Open3D and
    depth cameras have them; what is farther than 65.535 m is 0 too. ``.pfm``, ``.npy``, ``.tif`` and
    ``.tiff`` hold metres as they are.

    Parameters
    ----------
    path : str or path-like
        The file; an existing one is replaced.
    depth : ndarray of floats, (H, W)
        In metres; NaN, infinite, 0 or negative where there is none.

    Raises
    ------
    TypeError
        `depth` is not an array of floats.
    ValueError
        Its shape is not ``(H, W)``, or the suffix is another.
    OSError
        The file cannot be written.
    """
    metres = check_disparity(depth, "depth")
    metres[~(metres > 0)] = np.nan
    suffix = Path(path).suffix.lower()
    if suffix not in DEPTH_SUFFIXES:
        raise ValueError(f"{path}: unknown suffix {suffix!r}; {', '.join(DEPTH_SUFFIXES)} hold depth")
    if suffix != ".png":
        write_disparity(path, metres)
        return
    counts = np.rint(np.nan_to_num(metres).astype(np.float64) * MILLIMETRES)
    counts[counts > np.iinfo(np.uint16).max] = 0
    write_bytes(path, png.encode_map(counts.astype(np.uint16)))


def names_depth(path: StrPath) -> bool:
    """Whether a file's name says that it holds depth, as ``depth.png`` and ``out-depth.tif`` do."""
    name = Path(path)
    return name.stem.lower().endswith("depth") and name.suffix.lower() in DEPTH_SUFFIXES


def points(
    disparity: DisparityMap,
    calibration: Calibration,
    image: Image | None = None,
    *,
    max_depth: float | None = None,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint8] | None]:
    """The points in space that a disparity map shows, in the frame of the left camera.

    Parameters
    ----------
    disparity : ndarray of floats, (H, W)
        In pixels; NaN where invalid.
    calibration : Calibration
        Of the images that it was computed from, at their size.
    image : ndarray, (H, W) or (H, W, 3), optional
        The left image, for the colours. uint16 and float32 are scaled so that their largest value is 255.
    max_depth : float, optional
        Leave out what is farther, in metres.

    Returns
    -------
    xyz : ndarray of float32, (N, 3)
        In metres, row by row of the image: x to the right, y down, z forward.
    rgb : ndarray of uint8, (N, 3), or None
        The points' colours; None without an image.

    Raises
    ------
    TypeError, ValueError
        An argument has the wrong type, or they differ in size.
    """
    z = depth(disparity, calibration)
    keep = np.isfinite(z) if max_depth is None else z <= max_depth
    v, u = np.nonzero(keep)
    z = z[keep]
    x = (u - calibration.cx) * z / calibration.focal
    y = (v - calibration.cy) * z / calibration.focal
    xyz = np.stack([x, y, z], axis=1).astype(np.float32)
    if image is None:
        return xyz, None
    image = check_image("image", image)
    if image.shape[:2] != keep.shape:
        raise ValueError(f"image has {image.shape[:2]} rows and columns, but disparity has {keep.shape}")
    rgb = _as_bytes(image)[keep]
    return xyz, rgb if rgb.ndim == 2 else np.repeat(rgb[:, None], 3, axis=1)


def write_ply(path: StrPath, xyz: npt.NDArray[np.float32], rgb: npt.NDArray[np.uint8] | None = None) -> None:
    """Write a point cloud as binary little-endian PLY, whole or not at all.

    Parameters
    ----------
    path : str or path-like
        The file; an existing one is replaced.
    xyz : ndarray of float32, (N, 3)
        At least one point; finite.
    rgb : ndarray of uint8, (N, 3), optional
        The points' colours.

    Raises
    ------
    TypeError
        `xyz` or `rgb` is no array.
    ValueError
        There is no point, a coordinate is not finite, or a shape or type is another.
    OSError
        The file cannot be written.
    """
    import trimesh

    for name, array in (("xyz", xyz), ("rgb", rgb)):
        if not isinstance(array, np.ndarray) and (name == "xyz" or array is not None):
            raise TypeError(f"{name} must be an array, not {type(array).__name__}")
    if xyz.ndim != 2 or xyz.shape[1] != 3 or len(xyz) == 0:
        raise ValueError(f"xyz must have the shape (N, 3) with at least one point, not {xyz.shape}")
    if not np.isfinite(xyz).all():
        raise ValueError("xyz must be finite")
    if rgb is not None and (rgb.shape != xyz.shape or rgb.dtype != np.uint8):
        raise ValueError(f"rgb must be uint8 with the shape of xyz, {xyz.shape}, not {rgb.dtype} {rgb.shape}")
    cloud = cast(Any, trimesh).PointCloud(xyz, colors=rgb)
    write_bytes(path, cloud.export(file_type="ply"))


def _as_bytes(image: Image) -> npt.NDArray[np.uint8]:
    if image.dtype == np.uint8:
        return image
    largest = float(image.max())
    return np.clip(image * (255 / largest if largest > 0 else 0), 0, 255).astype(np.uint8)
