"""One disparity map into whatever kind of file its name asks for."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from stereopsis.io._errors import StrPath
from stereopsis.io.disparity import write_disparity
from stereopsis.io.points import depth, names_depth, points, write_depth, write_ply
from stereopsis.io.preview import write_preview
from stereopsis.types import Calibration, DisparityMap, Image

OUTPUT_SUFFIXES = (".png", ".pfm", ".npy", ".tif", ".tiff", ".jpg", ".jpeg", ".ply")
"""What `write_output` can write."""


def check_output(path: StrPath, *, calibration: Calibration | None = None) -> None:
    """Refuse, before anything is computed, a name that `write_output` would refuse.

    Raises
    ------
    ValueError
        The suffix is unknown, or it is a point cloud or a depth image and there is no calibration.
    FileNotFoundError
        The folder does not exist.
    IsADirectoryError
        `path` is a folder.
    """
    target = Path(path)
    suffix = target.suffix.lower()
    if suffix not in OUTPUT_SUFFIXES:
        raise ValueError(f"{target}: unknown suffix {suffix!r}; {', '.join(OUTPUT_SUFFIXES)} are written")
    if calibration is None and (suffix == ".ply" or names_depth(target)):
        what = "point cloud" if suffix == ".ply" else "depth image"
        raise ValueError(f"{target}: a {what} needs a calibration")
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(target))
    if not target.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(target.parent))


def write_output(
    path: StrPath,
    disparity: DisparityMap,
    *,
    image: Image | None = None,
    calibration: Calibration | None = None,
    range: tuple[float, float] | None = None,
    max_depth: float | None = None,
) -> None:
    """Write a disparity map as what the file's name says, whole or not at all.

    ===============================================  =====================================================
    name                                             content
    ===============================================  =====================================================
    ``*preview.png``, ``.jpg``, ``.jpeg``            colour picture with a colour bar; see `write_preview`
    ``*depth.png``                                   16-bit depth in millimetres; see `write_depth`
    ``*depth.pfm``, ``.npy``, ``.tif``, ``.tiff``    float32 depth in metres
    ``.png``                                         KITTI's 16-bit disparities; see `write_disparity`
    ``.pfm``, ``.npy``, ``.tif``, ``.tiff``          float32 disparities
    ``.ply``                                         point cloud in metres; see `points`
    ===============================================  =====================================================

    Parameters
    ----------
    path : str or path-like
        The file; an existing one is replaced.
    disparity : ndarray of floats, (H, W)
        In pixels; NaN where invalid.
    image : ndarray, (H, W) or (H, W, 3), optional
        The left image, which colours the points.
    calibration : Calibration, optional
        A point cloud or a depth image needs it.
    range : (float, float), optional
        The disparities of the preview's first and last colour.
    max_depth : float, optional
        Leave what is farther out of the point cloud, in metres.

    Raises
    ------
    TypeError, ValueError, OSError
        As `check_output` and the writers named above.
    """
    check_output(path, calibration=calibration)
    match Path(path).suffix.lower():
        case ".ply" if calibration is not None:
            write_ply(path, *points(disparity, calibration, image, max_depth=max_depth))
        case ".jpg" | ".jpeg":
            write_preview(path, disparity, range)
        case ".png" if Path(path).stem.lower().endswith("preview"):
            write_preview(path, disparity, range)
        case _ if calibration is not None and names_depth(path):
            write_depth(path, depth(disparity, calibration))
        case _:
            write_disparity(path, disparity)
