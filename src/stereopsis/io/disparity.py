"""Disparity maps: float32 with NaN where invalid in memory, five conventions on disk."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis.io._errors import StrPath, naming
from stereopsis.io.atomic import write_bytes
from stereopsis.io.formats import Raster, load, npy, pfm, png, tiff
from stereopsis.types import DisparityMap

_FORMATS = "'kitti', 'drivingstereo', 'middlebury:SCALE', 'pfm', 'npy' and 'tiff'"


def read_disparity(path: StrPath, format: str | None = None) -> DisparityMap:
    """Read a disparity map.

    Parameters
    ----------
    path : str or path-like
        The file.
    format : str, optional
        ``"kitti"`` or ``"drivingstereo"``: 16-bit grey, ``value / 256``, 0 invalid. ``"middlebury:SCALE"``:
        8-bit grey, ``value / SCALE``, 0 unknown, as in Middlebury's sets of 2001 to 2006. ``"pfm"``,
        ``"npy"``, ``"tiff"``: floating point, NaN and infinity invalid. By default the file's content
        decides, a 16-bit PNG being KITTI's; an 8-bit one is refused, because nothing in it says its scale.

    Returns
    -------
    ndarray of float32, (H, W)
        ``x_left - x_right`` in pixels, NaN where invalid.

    Raises
    ------
    OSError
        The file cannot be read; `FileNotFoundError` when it is not there.
    ValueError
        Its content is not a disparity map of that format, is truncated or damaged, is larger than 2²⁸
        pixels, or holds no valid pixel at all.
    """
    raster = load(path)
    with naming(path):
        return as_disparity(raster, format)


def as_disparity(raster: Raster, format: str | None = None) -> DisparityMap:
    """The disparities that a raster means; see `read_disparity`."""
    pixels = raster.pixels
    if pixels.ndim != 2:
        raise ValueError(f"a disparity map has one channel, this {raster.format} has {pixels.shape[2]}")
    if format is None:
        format = _format_of(raster)
    divisor = _divisor(format)
    if divisor is None:
        if raster.format != format or pixels.dtype.kind != "f":
            raise ValueError(
                f"format {format!r} is floating point, but this is a {raster.format} of {pixels.dtype}"
            )
        disparity = _finite(pixels)
    else:
        depth = np.uint8 if format.startswith("middlebury") else np.uint16
        if pixels.dtype != depth:
            bits = np.iinfo(depth).bits
            raise ValueError(
                f"format {format!r} is {bits}-bit grey, but this is a {raster.format} of {pixels.dtype}"
            )
        disparity = _from_fixed_point(pixels, divisor)
    if np.isnan(disparity).all():
        raise ValueError("holds no disparity: every pixel is invalid")
    return disparity


def write_disparity(path: StrPath, disparity: DisparityMap, format: str | None = None) -> None:
    """Write a disparity map, whole or not at all.

    Floating-point formats hold every disparity as it is. The integer formats round to ``1 / 256`` and ``1 /
    SCALE``; there 0 means invalid, so that a disparity that would round to 0 becomes the smallest that they
    hold, as KITTI's development kit does.

    Parameters
    ----------
    path : str or path-like
        The file; an existing one is replaced.
    disparity : ndarray of floats, (H, W)
        In pixels; NaN or infinite where invalid.
    format : str, optional
        See `read_disparity`. By default the suffix decides: ``.png`` is KITTI's, ``.pfm``, ``.npy``, and
        ``.tif`` or
        ``.tiff``.

    Raises
    ------
    TypeError
        `disparity` is not an array of floats.
    ValueError
        Its shape is not ``(H, W)``; the suffix or format is unknown; or it holds negative disparities, or
        too large ones, which an integer format cannot hold.
    OSError
        The file cannot be written.
    """
    disparity = check_disparity(disparity)
    with naming(path):
        data, _ = encode_disparity(disparity, _format_for(path) if format is None else format)
    write_bytes(path, data)


def encode_disparity(disparity: DisparityMap, format: str) -> tuple[bytes, DisparityMap]:
    """The bytes that `write_disparity` writes, and the map that `read_disparity` makes of them."""
    disparity = check_disparity(disparity)
    divisor = _divisor(format)
    if divisor is None:
        return _encode(disparity, format), disparity
    depth = np.uint8 if format.startswith("middlebury") else np.uint16
    fixed = _fixed_point(disparity, divisor, np.dtype(depth))
    return png.encode_map(fixed), _from_fixed_point(fixed, divisor)


def check_disparity(disparity: DisparityMap, name: str = "disparity") -> DisparityMap:
    """A float32 copy of a disparity map, or of another map of that name, NaN where it is not finite.

    Raises
    ------
    TypeError, ValueError
        It is not an array of floats, or not of shape ``(H, W)``.
    """
    if not isinstance(disparity, np.ndarray) or disparity.dtype.kind != "f":
        what = disparity.dtype if isinstance(disparity, np.ndarray) else type(disparity).__name__
        raise TypeError(f"{name} must be an array of floats, NaN where invalid, not {what}")
    if disparity.ndim != 2 or disparity.size == 0:
        raise ValueError(f"{name} must have the shape (H, W), not {disparity.shape}")
    return _finite(disparity)


def _finite(values: npt.NDArray[Any]) -> DisparityMap:
    with np.errstate(over="ignore", invalid="ignore"):  # doubles beyond float32, signalling NaN
        single = values.astype(np.float32)
    single[~np.isfinite(single)] = np.nan
    return single


def _format_of(raster: Raster) -> str:
    match raster.format, raster.pixels.dtype.name:
        case "png", "uint16":
            return "kitti"
        case (("pfm" | "npy" | "tiff"), ("float16" | "float32" | "float64")):
            return raster.format
        case _, "uint8":
            raise ValueError(
                f"8-bit values in a {raster.format} do not say their scale; pass format='middlebury:4' "
                "when the disparity is the value / 4"
            )
        case _, "uint16":
            raise ValueError(
                f"16-bit values in a {raster.format} do not say their scale; pass format='kitti' "
                "when the disparity is the value / 256"
            )
        case _, dtype:
            raise ValueError(f"{raster.format} values of {dtype} are no disparities; floating point is read")


def _format_for(path: StrPath) -> str:
    match Path(path).suffix.lower():
        case ".png":
            return "kitti"
        case ".pfm":
            return "pfm"
        case ".npy":
            return "npy"
        case ".tif" | ".tiff":
            return "tiff"
        case suffix:
            raise ValueError(
                f"unknown suffix {suffix!r} for a disparity map; .png, .pfm, .npy and .tif are written"
            )


def _divisor(format: str) -> float | None:
    """What the integers of `format` are divided by; None where it holds floats."""
    name, _, scale = format.partition(":")
    match name, scale:
        case (("kitti" | "drivingstereo"), ""):
            return 256.0
        case (("pfm" | "npy" | "tiff"), ""):
            return None
        case "middlebury", _:
            try:
                divisor = float(scale)
            except ValueError:
                divisor = np.nan
            if not 0 < divisor < np.inf:
                raise ValueError(
                    f"format {format!r} needs its scale: 'middlebury:4' when disparity = value / 4"
                )
            return divisor
        case _:
            raise ValueError(f"unknown format {format!r}; {_FORMATS} are known")


def _encode(disparity: DisparityMap, format: str) -> bytes:
    match format:
        case "pfm":
            return pfm.encode(np.where(np.isnan(disparity), np.float32(np.inf), disparity))
        case "npy":
            return npy.encode(disparity)
        case _:
            return tiff.encode(disparity)


def _from_fixed_point(pixels: npt.NDArray[Any], divisor: float) -> DisparityMap:
    return np.where(pixels == 0, np.float32(np.nan), (pixels / divisor).astype(np.float32))


def _fixed_point(disparity: DisparityMap, scale: float, dtype: np.dtype[Any]) -> npt.NDArray[Any]:
    valid = np.isfinite(disparity)
    scaled = np.rint(np.where(valid, disparity, 0).astype(np.float64) * scale)
    largest = np.iinfo(dtype).max
    outside = (disparity < 0) | (scaled > largest)
    if outside.any():
        low, high = disparity[outside].min(), disparity[outside].max()
        raise ValueError(
            f"{outside.sum()} of {valid.sum()} disparities, {low:g} to {high:g} px, lie outside the 0 to "
            f"{largest / scale:g} px that this format holds; write .pfm, .npy or .tif"
        )
    return np.where(valid, np.maximum(scaled, 1), 0).astype(dtype)
