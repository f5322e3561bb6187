"""Calibrations of KITTI, Middlebury and OpenCV."""

from __future__ import annotations

import math
import re
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from stereopsis._files import read
from stereopsis.io._errors import StrPath, naming
from stereopsis.io.atomic import write_bytes
from stereopsis.types import Calibration

Format = Literal["kitti", "middlebury", "opencv"]

MAX_BYTES = 2**18
"""The largest calibration that is read."""

_MAX_YAML = 2**16  # PyYAML takes seconds for more
_MAX_ROW_DIFFERENCE = 0.5  # px between the principal points' rows; more is no rectified pair


def read_calibration(
    path: StrPath, *, cameras: tuple[int, int] | None = None, baseline_unit: float | None = None
) -> Calibration:
    """Read the geometry of a rectified pair; the file's content says which of the three it is.

    KITTI
        ``P0`` … ``P3`` of ``calib.txt``, or ``P_rect_00`` … ``P_rect_03`` of ``calib_cam_to_cam.txt``, in
        metres.
    Middlebury
        ``calib.txt`` with ``cam0``, ``cam1``, ``doffs`` and ``baseline``, in millimetres.
    OpenCV
        A YAML file of ``FileStorage`` with ``P1`` and ``P2``, or ``Q``, of ``cv2.stereoRectify``, in the
        unit of the calibration target.

    Parameters
    ----------
    path : str or path-like
        The file.
    cameras : (int, int), optional
        Which of KITTI's cameras are left and right: by default 2 and 3, the colour pair, where the file has
        them, else 0 and 1.
    baseline_unit : float, optional
        Metres in one unit of the file's baseline: by default 1 for KITTI and OpenCV, 0.001 for Middlebury.
        An OpenCV calibration whose chessboard was measured in millimetres needs 0.001.

    Returns
    -------
    Calibration
        With the baseline in metres.

    Raises
    ------
    OSError
        The file cannot be read; `FileNotFoundError` when it is not there.
    ValueError
        It is none of the three, lacks a value, or holds a geometry that no rectified pair has.
    """
    data = read(path, MAX_BYTES, "a calibration")
    with naming(path):
        return parse(data, cameras, baseline_unit)[1]


def parse(
    data: bytes, cameras: tuple[int, int] | None = None, baseline_unit: float | None = None
) -> tuple[Format, Calibration]:
    """Which format the bytes of a calibration file are in, and what they say; see `read_calibration`."""
    if not data:
        raise ValueError("the file is empty")
    if len(data) > MAX_BYTES:
        raise ValueError(f"{len(data)} bytes are too many for a calibration")
    format = identify(data)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError("not a calibration: it is not text") from None
    match format:
        case "kitti":
            found = _kitti(text, cameras, 1.0 if baseline_unit is None else baseline_unit)
        case "middlebury":
            found = _middlebury(text, 1e-3 if baseline_unit is None else baseline_unit)
        case "opencv":
            found = _opencv(text, 1.0 if baseline_unit is None else baseline_unit)
        case None:
            raise ValueError("not a calibration of KITTI, Middlebury or OpenCV")
    return format, check_calibration(found)


def identify(data: bytes) -> Format | None:
    """The kind of calibration that a file holds, or None."""
    if re.match(rb"(\xef\xbb\xbf)?%YAML", data):
        return "opencv"
    if re.search(rb"^[ \t]*cam0[ \t]*=", data, re.MULTILINE):
        return "middlebury"
    if re.search(rb"^P(_rect_0)?[0-3]:", data, re.MULTILINE):
        return "kitti"
    return None


def check_calibration(calibration: Calibration) -> Calibration:
    """`calibration` itself, when its numbers can be a rectified pair's; an error otherwise."""
    if not isinstance(calibration, Calibration):
        raise TypeError(f"calibration must be a Calibration, not {type(calibration).__name__}")
    for name in ("focal", "cx", "cy", "baseline", "doffs"):
        if not math.isfinite(getattr(calibration, name)):
            raise ValueError(f"{name} is {getattr(calibration, name)}; it must be finite")
    if calibration.focal <= 0:
        raise ValueError(f"the focal length is {calibration.focal:g} px; it must be positive")
    if calibration.baseline <= 0:
        raise ValueError(
            f"the baseline is {calibration.baseline:g} m; it must be positive: is the first camera the left "
            "one, and do they stand side by side?"
        )
    for name in ("width", "height", "ndisp"):
        value = getattr(calibration, name)
        if value is not None and value <= 0:
            raise ValueError(f"{name} is {value}; it must be positive")
    return calibration


def write_calibration(path: StrPath, calibration: Calibration) -> None:
    """Write a calibration as Middlebury's ``calib.txt``, the baseline in millimetres, whole or not at all.

    Raises
    ------
    ValueError
        The calibration cannot be a rectified pair's.
    OSError
        The file cannot be written.
    """
    c = check_calibration(calibration)
    # As Python's floats: NumPy's have another repr.
    focal, cx, cy, baseline, doffs = (float(value) for value in (c.focal, c.cx, c.cy, c.baseline, c.doffs))
    lines = [
        f"cam0=[{focal!r} 0 {cx!r}; 0 {focal!r} {cy!r}; 0 0 1]",
        f"cam1=[{focal!r} 0 {cx + doffs!r}; 0 {focal!r} {cy!r}; 0 0 1]",
        f"doffs={doffs!r}",
        f"baseline={baseline * 1000!r}",
    ]
    sizes = (("width", c.width), ("height", c.height), ("ndisp", c.ndisp))
    lines += [f"{name}={value}" for name, value in sizes if value is not None]
    write_bytes(path, "".join(f"{line}\n" for line in lines).encode())


def _kitti(text: str, cameras: tuple[int, int] | None, unit: float) -> Calibration:
    lines = {key.strip(): value for key, _, value in (line.partition(":") for line in text.splitlines())}
    style = "P_rect_0{}" if "P_rect_00" in lines or "P_rect_02" in lines else "P{}"
    if cameras is None:
        cameras = (2, 3) if {style.format(2), style.format(3)} <= lines.keys() else (0, 1)
    first, second = (
        _matrix(key, _value(lines, key).split(), (3, 4))
        for key in (style.format(camera) for camera in cameras)
    )
    width = height = None
    if f"S_rect_0{cameras[0]}" in lines:
        size = _matrix("S_rect", lines[f"S_rect_0{cameras[0]}"].split(), (1, 2))
        width, height = int(size[0, 0]), int(size[0, 1])
    return _from_projections(first, second, unit, width, height)


def _middlebury(text: str, unit: float) -> Calibration:
    lines = {
        key.strip(): value.strip() for key, _, value in (line.partition("=") for line in text.splitlines())
    }

    def camera(key: str) -> npt.NDArray[np.float64]:
        return _matrix(key, re.split(r"[\s;]+", _value(lines, key).strip("[]; \t")), (3, 3))

    def whole(key: str) -> int | None:
        return int(_number(key, lines[key])) if key in lines else None

    left = camera("cam0")
    focal = _focal(left)
    doffs = _number("doffs", lines["doffs"]) if "doffs" in lines else camera("cam1")[0, 2] - left[0, 2]
    return Calibration(
        focal=focal,
        cx=float(left[0, 2]),
        cy=float(left[1, 2]),
        baseline=_number("baseline", _value(lines, "baseline")) * unit,
        doffs=float(doffs),
        width=whole("width"),
        height=whole("height"),
        ndisp=whole("ndisp"),
    )


def _opencv(text: str, unit: float) -> Calibration:
    import yaml

    if len(text) > _MAX_YAML:
        raise ValueError(f"{len(text)} characters are too many for a calibration of OpenCV")

    class Loader(yaml.SafeLoader):
        def flatten_mapping(self, node: yaml.MappingNode) -> None:
            """Leave "<<" alone: merging what was merged before takes more memory than there is."""

    def matrix(loader: yaml.SafeLoader, node: yaml.Node) -> npt.NDArray[np.float64]:
        if not isinstance(node, yaml.MappingNode):
            raise ValueError("an opencv-matrix that is no mapping")
        fields: dict[Any, Any] = loader.construct_mapping(node, deep=True)
        if not {"rows", "cols", "data"} <= fields.keys() or not isinstance(fields["data"], list):
            raise ValueError("an opencv-matrix lacks rows, cols or data")
        return _matrix("an opencv-matrix", fields["data"], (int(fields["rows"]), int(fields["cols"])))

    Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", matrix)
    # FileStorage begins with "%YAML:1.0", which is not YAML.
    document = yaml.load(text.partition("\n")[2], Loader)
    if not isinstance(document, dict):
        raise ValueError("the YAML file holds no mapping")
    width, height = (
        int(document[key]) if key in document else None for key in ("image_width", "image_height")
    )
    first, second, q = (document.get(key) for key in ("P1", "P2", "Q"))
    if isinstance(first, np.ndarray) and isinstance(second, np.ndarray):
        return _from_projections(
            _shaped("P1", first, (3, 4)), _shaped("P2", second, (3, 4)), unit, width, height
        )
    if not isinstance(q, np.ndarray):
        raise ValueError("the YAML file holds neither P1 and P2 nor Q as opencv-matrix")
    # Q of cv2.stereoRectify: Z = Q[2, 3] / (Q[3, 2] d + Q[3, 3]).
    q = _shaped("Q", q, (4, 4))
    if q[3, 2] == 0:
        raise ValueError("Q[3, 2] is 0: the cameras do not stand side by side")
    return Calibration(
        focal=float(q[2, 3]),
        cx=-float(q[0, 3]),
        cy=-float(q[1, 3]),
        baseline=float(1 / q[3, 2]) * unit,
        doffs=float(q[3, 3] / q[3, 2]),
        width=width,
        height=height,
    )


def _from_projections(
    first: npt.NDArray[np.float64],
    second: npt.NDArray[np.float64],
    unit: float,
    width: int | None,
    height: int | None,
) -> Calibration:
    """From two projections ``K [I | t]``: a camera's place on the x axis is ``-P[0, 3] / P[0, 0]``."""
    focal, other = _focal(first), _focal(second)
    if not math.isclose(focal, other, rel_tol=1e-3):
        raise ValueError(f"the focal lengths, {focal:g} and {other:g} px, differ: not a rectified pair")
    if abs(first[1, 2] - second[1, 2]) > _MAX_ROW_DIFFERENCE:
        raise ValueError(
            f"the principal points' rows, {first[1, 2]:g} and {second[1, 2]:g}, differ: not rectified"
        )
    return Calibration(
        focal=focal,
        cx=float(first[0, 2]),
        cy=float(first[1, 2]),
        baseline=float(first[0, 3] / focal - second[0, 3] / other) * unit,
        doffs=float(second[0, 2] - first[0, 2]),
        width=width,
        height=height,
    )


def _focal(camera: npt.NDArray[np.float64]) -> float:
    if not math.isclose(camera[0, 0], camera[1, 1], rel_tol=1e-3):
        raise ValueError(
            f"the focal lengths, {camera[0, 0]:g} and {camera[1, 1]:g} px, differ: pixels must be square"
        )
    if not camera[0, 0] > 0:
        raise ValueError(f"the focal length is {camera[0, 0]:g} px; it must be positive")
    return float(camera[0, 0])


def _value(lines: dict[str, str], key: str) -> str:
    if key not in lines:
        raise ValueError(f"the calibration has no {key}")
    return lines[key]


def _number(name: str, text: Any) -> float:
    try:
        return float(text)
    except (TypeError, ValueError):
        # Of lists within lists that share their parts, the text alone may fill the memory.
        said = repr(text[:40]) if isinstance(text, str) else f"a {type(text).__name__}"
        raise ValueError(f"{name} holds {said}, which is not a number") from None


def _matrix(name: str, values: list[Any], shape: tuple[int, int]) -> npt.NDArray[np.float64]:
    if len(values) != shape[0] * shape[1]:
        raise ValueError(f"{name} holds {len(values)} numbers, not {shape[0]} x {shape[1]}")
    return np.array([_number(name, value) for value in values]).reshape(shape)


def _shaped(name: str, matrix: npt.NDArray[np.float64], shape: tuple[int, int]) -> npt.NDArray[np.float64]:
    if matrix.shape != shape:
        raise ValueError(f"{name} is {matrix.shape[0]} x {matrix.shape[1]}, not {shape[0]} x {shape[1]}")
    return matrix
