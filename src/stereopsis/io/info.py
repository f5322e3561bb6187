"""What a file holds, in words and numbers."""

from __future__ import annotations

import dataclasses
import re
from typing import Any, Literal

import numpy as np

from stereopsis._files import opened
from stereopsis.io import calibration
from stereopsis.io._errors import StrPath, naming
from stereopsis.io.disparity import as_disparity
from stereopsis.io.formats import BEGINNING, Raster, check_size, decode, identify
from stereopsis.io.formats._limits import MAX_BYTES
from stereopsis.io.images import as_image
from stereopsis.io.points import MILLIMETRES, names_depth

_PLY = (b"ply\n", b"ply\r\n")

# The short names of PLY; the long ones, float32 and so on, are NumPy's too.
_PLY_TYPES = {
    "char": "int8",
    "uchar": "uint8",
    "short": "int16",
    "ushort": "uint16",
    "int": "int32",
    "uint": "uint32",
    "float": "float32",
    "double": "float64",
}


def describe(path: StrPath) -> dict[str, Any]:
    """What a file holds.

    A 16-bit grey PNG and a float image of one channel are described as disparity maps; as depth where their
    name ends so, as ``out-depth.png`` does.

    Parameters
    ----------
    path : str or path-like
        A disparity map, an image, a calibration or a PLY point cloud.

    Returns
    -------
    dict
        Ready for JSON. Always ``file``, ``kind`` (``"disparity"``, ``"depth"``, ``"image"``,
        ``"calibration"`` or ``"points"``) and ``format``. Of pixels ``width``, ``height``, ``channels``,
        ``dtype``, ``min`` and ``max``; of a disparity map, in pixels, and of depth, in metres, also
        ``density``, the fraction of valid pixels, and ``median``. Of a
        calibration its fields, in pixels and metres. Of points ``points``, ``properties`` and, of a binary
        file, ``min`` and ``max`` of x, y and z.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is none of these, or damaged.
    """
    with opened(path) as (file, size):
        start = file.read(max(BEGINNING, calibration.MAX_BYTES + 1))
        with naming(path):
            _check_size(start, size)
        data = start + file.read(max(size - len(start), 0))
    with naming(path):
        if data.startswith(_PLY):
            found = _points(data)
        elif _is_calibration(data):
            format, camera = calibration.parse(data)
            found = {"kind": "calibration", "format": format, **dataclasses.asdict(camera)}
        else:
            found = _pixels(decode(data), names_depth(path))
    return {"file": str(path), **found}


def _check_size(start: bytes, size: int) -> None:
    """Refuse, from its beginning, a file that is none of what is described or larger than it can be."""
    if start.startswith(_PLY):
        if size > MAX_BYTES:
            raise ValueError(f"{size} bytes are too many; at most {MAX_BYTES} are read")
    elif not (_is_calibration(start) and size <= len(start)):
        check_size(start, size)


def _is_calibration(data: bytes) -> bool:
    return identify(data) is None and calibration.identify(data) is not None


def _pixels(raster: Raster, depth: bool) -> dict[str, Any]:
    pixels = raster.pixels
    grey = pixels.ndim == 2
    kitti = grey and raster.format == "png" and pixels.dtype == np.uint16
    if kitti or (grey and pixels.dtype.kind == "f"):
        disparity = as_disparity(raster)
        where = ~np.isnan(disparity)
        valid = pixels[where] / np.float32(MILLIMETRES) if depth and kitti else disparity[where]
        kind = "depth" if depth else "disparity"
        values = {"density": valid.size / disparity.size, "median": float(np.median(valid))}
    else:
        valid = as_image(raster)
        kind, values = "image", {}
    return {
        "kind": kind,
        "format": "kitti" if kitti and not depth else raster.format,
        "width": pixels.shape[1],
        "height": pixels.shape[0],
        "channels": 1 if grey else pixels.shape[2],
        "dtype": pixels.dtype.name,
        "min": valid.min().item(),
        "max": valid.max().item(),
        **values,
    }


def _points(data: bytes) -> dict[str, Any]:
    header, end, body = data.partition(b"end_header")
    opening = re.match(rb"ply\s+format (ascii|binary_little_endian|binary_big_endian) 1\.0\s", header)
    element = re.search(rb"\nelement vertex (\d{1,12})\s*\n((?:property \w+ \w+\r?\n)+)", header)
    if not end or opening is None or element is None or element.start() != header.find(b"\nelement"):
        raise ValueError("damaged: the PLY header does not begin with vertices, or it does not end")
    encoding, count = opening[1].decode(), int(element[1])
    properties = [line.split()[1:] for line in element[2].decode().splitlines()]
    described = {
        "kind": "points",
        "format": f"ply {encoding}",
        "points": count,
        "properties": [name for _, name in properties],
    }
    if encoding == "ascii":
        return described
    order: Literal["<", ">"] = "<" if encoding == "binary_little_endian" else ">"
    fields = [(name, np.dtype(_PLY_TYPES.get(kind, kind))) for kind, name in properties]
    record = np.dtype(fields).newbyteorder(order)
    start = 2 if body.startswith(b"\r\n") else 1
    if count * record.itemsize > len(body) - start:
        raise ValueError(f"truncated: the header announces {count} points, {len(body)} bytes follow it")
    vertices = np.frombuffer(body, record, count, start)
    corners = [(vertices[axis].min().item(), vertices[axis].max().item()) for axis in "xyz"]
    low, high = zip(*corners, strict=True)
    return {**described, "min": list(low), "max": list(high)}
