"""Calibrations: real-looking files of the three kinds, worked by hand, and what is wrong with others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stereopsis.io import read_calibration, write_calibration
from stereopsis.types import Calibration

KITTI = """\
P0: 7.2e+02 0 6.0e+02 0 0 7.2e+02 1.7e+02 0 0 0 1 0
P1: 7.2e+02 0 6.0e+02 -3.6e+02 0 7.2e+02 1.7e+02 0 0 0 1 0
P2: 7.2e+02 0 6.0e+02 4.5e+01 0 7.2e+02 1.7e+02 2.1e-01 0 0 1 2.7e-03
P3: 7.2e+02 0 6.0e+02 -3.33e+02 0 7.2e+02 1.7e+02 2.2e+00 0 0 1 2.7e-03
R0_rect: 1 0 0 0 1 0 0 0 1
Tr: 4.2e-04 -9.9e-01 -8.0e-03 -1.1e-02 -7.2e-03 8.0e-03 -9.9e-01 -5.4e-02 9.9e-01 4.8e-04 -7.2e-03 -2.9e-01
"""
RECTIFIED = """\
calib_time: 09-Jan-2012 13:57:47
corner_dist: 9.950000e-02
S_rect_02: 1.242000e+03 3.750000e+02
P_rect_02: 7.2e+02 0 6.0e+02 4.5e+01 0 7.2e+02 1.7e+02 2.1e-01 0 0 1 2.7e-03
S_rect_03: 1.242000e+03 3.750000e+02
P_rect_03: 7.2e+02 0 6.0e+02 -3.33e+02 0 7.2e+02 1.7e+02 2.2e+00 0 0 1 2.7e-03
"""
MIDDLEBURY = """\
cam0=[3997.684 0 1176.728; 0 3997.684 1011.728; 0 0 1]
cam1=[3997.684 0 1307.839; 0 3997.684 1011.728; 0 0 1]
doffs=131.111
baseline=193.001
width=2964
height=1988
ndisp=280
isint=0
vmin=31
vmax=257
dyavg=0.918
dymax=1.516
"""
OPENCV = """\
%YAML:1.0
---
R1: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]
P1: !!opencv-matrix
   rows: 3
   cols: 4
   dt: d
   data: [ 5.0e+02, 0., 320., 0., 0., 5.0e+02, 2.4e+02, 0., 0., 0.,
       1., 0. ]
P2: !!opencv-matrix
   rows: 3
   cols: 4
   dt: d
   data: [ 5.0e+02, 0., 330., -6.0e+04, 0., 5.0e+02, 2.4e+02, 0., 0., 0.,
       1., 0. ]
Q: !!opencv-matrix
   rows: 4
   cols: 4
   dt: d
   data: [ 1., 0., 0., -320., 0., 1., 0., -2.4e+02, 0., 0., 0., 5.0e+02,
       0., 0., 8.3333333333333333e-03, 8.3333333333333333e-02 ]
"""


def about(value: float, rel: float = 1e-9) -> Any:
    return pytest.approx(value, rel=rel)


def read(folder: Path, text: str, **options: Any) -> Calibration:
    path = folder / "calib.txt"
    path.write_bytes(text.encode())
    return read_calibration(path, **options)


def test_kitti(tmp_path: Path) -> None:
    # The colour cameras: 45 / 720 = 0.0625 m left and 333 / 720 = 0.4625 m right of camera 0.
    expected = Calibration(focal=720.0, cx=600.0, cy=170.0, baseline=about(0.525))
    assert read(tmp_path, KITTI) == expected
    assert read(tmp_path, KITTI.replace("\n", "\r\n")) == expected
    assert read(tmp_path, KITTI, cameras=(0, 1)).baseline == pytest.approx(0.5)
    assert read(tmp_path, "\n".join(KITTI.splitlines()[:2])).baseline == pytest.approx(0.5)
    sized = Calibration(focal=720.0, cx=600.0, cy=170.0, baseline=about(0.525), width=1242, height=375)
    assert read(tmp_path, RECTIFIED) == sized


def test_middlebury(tmp_path: Path) -> None:
    expected = Calibration(
        focal=3997.684,
        cx=1176.728,
        cy=1011.728,
        baseline=about(0.193001, rel=1e-15),
        doffs=131.111,
        width=2964,
        height=1988,
        ndisp=280,
    )
    assert read(tmp_path, MIDDLEBURY) == expected
    # As the quarter-size files have them, with blanks anywhere.
    assert (
        read(tmp_path, MIDDLEBURY.replace("=", "= ").replace("[", "[ ").replace("\ndoffs", " \n doffs"))
        == expected
    )
    without = read(tmp_path, MIDDLEBURY.replace("doffs=131.111\n", ""))
    assert without.doffs == pytest.approx(131.111)
    assert read(tmp_path, MIDDLEBURY, baseline_unit=1.0).baseline == 193.001


def test_opencv(tmp_path: Path) -> None:
    # P2[0, 3] = -f T: T = 120, in the unit of the chessboard, here millimetres.
    expected = Calibration(focal=500.0, cx=320.0, cy=240.0, baseline=about(0.12), doffs=10.0)
    assert read(tmp_path, OPENCV, baseline_unit=0.001) == expected
    assert read(tmp_path, OPENCV).baseline == pytest.approx(120)
    only_q = OPENCV.replace("P1:", "A1:").replace("P2:", "A2:") + "image_width: 640\nimage_height: 480\n"
    found = read(tmp_path, only_q, baseline_unit=0.001)
    assert (found.focal, found.cx, found.cy, found.width, found.height) == (500, 320, 240, 640, 480)
    assert found.baseline == pytest.approx(0.12)
    assert found.doffs == pytest.approx(10)


def test_what_opencv_writes_is_read(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    camera = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    turned, _ = cv2.Rodrigues(np.array([0.01, -0.02, 0.005]))
    shift = np.array([[-0.12], [0.001], [0.002]])
    flat = np.zeros(5)
    for flags in (0, cv2.CALIB_ZERO_DISPARITY):
        _, _, p1, p2, q, _, _ = cv2.stereoRectify(
            camera, flat, camera, flat, (640, 480), turned, shift, flags=flags
        )
        found = []
        for names in (("P1", "P2"), ("Q",)):
            storage = cv2.FileStorage(str(tmp_path / "stereo.yml"), cv2.FILE_STORAGE_WRITE)
            for name in names:
                storage.write(name, {"P1": p1, "P2": p2, "Q": q}[name])
            storage.release()
            found.append(read_calibration(tmp_path / "stereo.yml"))
        for calibration in found:
            assert calibration.focal == pytest.approx(p1[0, 0])
            assert calibration.baseline == pytest.approx(np.linalg.norm(shift))
            assert calibration.doffs == pytest.approx(p2[0, 2] - p1[0, 2], abs=1e-6)
            # The depth of reprojectImageTo3D is the depth by our formula.
            point = q @ np.array([100, 50, 30.0, 1])
            depth = calibration.focal * calibration.baseline / (30 + calibration.doffs)
            assert depth == pytest.approx(point[2] / point[3])


@settings(deadline=None, max_examples=50)
@given(
    focal=st.floats(1, 1e5),
    centre=st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)),
    baseline=st.floats(1e-4, 1e3),
    doffs=st.floats(-1e3, 1e3),
    sizes=st.tuples(*[st.none() | st.integers(1, 10**6)] * 3),
)
def test_what_is_written_is_read(
    tmp_path_factory: pytest.TempPathFactory,
    focal: float,
    centre: tuple[float, float],
    baseline: float,
    doffs: float,
    sizes: tuple[int | None, int | None, int | None],
) -> None:
    path = tmp_path_factory.getbasetemp() / "calib.txt"
    calibration = Calibration(focal, *centre, baseline, doffs, *sizes)
    write_calibration(path, calibration)
    back = read_calibration(path)
    assert back.baseline == pytest.approx(baseline, rel=1e-15)
    assert Calibration(back.focal, back.cx, back.cy, baseline, back.doffs, *sizes) == calibration
    assert (back.width, back.height, back.ndisp) == sizes


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ("hello", "not a calibration of KITTI, Middlebury or OpenCV"),
        (KITTI.replace("P3:", "Q3:").replace("P1:", "Q1:"), "the calibration has no P1"),
        (KITTI.replace(" 2.7e-03", ""), "P2 holds 11 numbers, not 3 x 4"),
        (KITTI.replace("-3.33e+02", "wide"), "P3 holds 'wide', which is not a number"),
        (KITTI.replace("-3.33e+02", "nan"), "baseline is nan; it must be finite"),
        (KITTI.replace("4.5e+01", "-3.8e+02"), "baseline is -0.0652778 m; it must be positive"),
        (KITTI.replace("7.2e+02 1.7e+02 2.1e-01", "9.2e+02 1.7e+02 2.1e-01"), "pixels must be square"),
        (KITTI.replace("7.2e+02 1.7e+02 2.2e+00", "7.2e+02 1.9e+02 2.2e+00"), "rows, 170 and 190, differ"),
        (RECTIFIED.replace("S_rect_02: 1.242000e+03", "S_rect_02:"), "S_rect holds 1 numbers, not 1 x 2"),
        (MIDDLEBURY.replace("baseline=193.001", ""), "the calibration has no baseline"),
        (MIDDLEBURY.replace("baseline=193.001", "baseline=0"), "the baseline is 0 m; it must be positive"),
        (MIDDLEBURY.replace("3997.684", "-1"), "the focal length is -1 px; it must be positive"),
        (MIDDLEBURY.replace("doffs=131.111", "doffs=inf"), "doffs is inf; it must be finite"),
        (MIDDLEBURY.replace("; 0 0 1]", "]"), "cam0 holds 6 numbers, not 3 x 3"),
        (MIDDLEBURY.replace("width=2964", "width=0"), "width is 0; it must be positive"),
        (MIDDLEBURY.replace("width=2964", "width=wide"), "width holds 'wide'"),
        ("%YAML:1.0\n---\nA: 1\n", "holds neither P1 and P2 nor Q"),
        ("%YAML:1.0\n---\n- 1\n", "holds no mapping"),
        ("%YAML:1.0\n", "holds no mapping"),
        (OPENCV.replace("cols: 4", "cols: 5"), "holds 12 numbers, not 3 x 5"),
        (OPENCV.replace("   cols: 4\n", ""), "lacks rows, cols or data"),
        (OPENCV.replace("-6.0e+04", ".Nan"), "not a number"),
        (OPENCV.replace("-6.0e+04", "0."), "the baseline is 0 m"),
        (OPENCV.replace("data: [ 5.0e+02", "data: [ [ 5.0e+02"), "damaged or not supported"),
        ("%YAML:1.0\n---\n" + "[" * 5000, "damaged or not supported"),
        ("%YAML:1.0\n---\na: &a [1]\n" + "b: *c\n", "damaged or not supported"),
        ("P0: " + "1 " * 600000, "too many for a calibration"),
    ],
)  # fmt: skip
def test_a_broken_calibration_gets_one_clear_error(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        read(tmp_path, text)
    assert str(caught.value).startswith(f"{tmp_path / 'calib.txt'}: ")
    assert "\n" not in str(caught.value)


def test_binary_is_no_calibration(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"P0: \xff\xfe")
    with pytest.raises(ValueError, match="it is not text"):
        read_calibration(tmp_path / "a")
    with pytest.raises(FileNotFoundError):
        read_calibration(tmp_path / "nowhere")


def test_numpys_numbers_are_written_as_numbers(tmp_path: Path) -> None:
    numbers: tuple[Any, ...] = (np.float64(700), np.float32(3), 2, 0.25, 0, np.int64(8))
    write_calibration(tmp_path / "calib.txt", Calibration(*numbers))
    assert read_calibration(tmp_path / "calib.txt") == Calibration(700.0, 3.0, 2.0, 0.25, width=8)


def test_an_impossible_calibration_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="baseline is nan"):
        write_calibration(tmp_path / "calib.txt", Calibration(700, 1, 1, np.nan))
    assert not list(tmp_path.iterdir())
