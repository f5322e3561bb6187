"""Every data set, a pair or two, in its official layout: names, truth worked by hand, masks, geometry."""

from __future__ import annotations

import json
import os
import pickle
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from stereopsis import datasets, io
from stereopsis.datasets.folder import Folder
from stereopsis.datasets.readers import Consistent, FromDepth, Scaled
from stereopsis.datasets.sample import check_name

N = np.nan
SHAPE = (2, 4)


def image(file, value=1, shape=SHAPE):
    file.parent.mkdir(parents=True, exist_ok=True)
    io.write_image(file, np.full(shape, value, np.uint8))


def values(file, *rows, dtype=np.uint16):
    """The numbers of an image as the file holds them."""
    file.parent.mkdir(parents=True, exist_ok=True)
    io.write_image(file, np.array(rows, dtype))


def floats(file, *rows):
    file.parent.mkdir(parents=True, exist_ok=True)
    io.write_disparity(file, np.array(rows, np.float32))


def opened(folder):
    """Open a data set and read every pair of it."""
    found = datasets.open(folder)
    for sample in found:
        assert sample.left_file != sample.right_file
        assert sample.pair().name == sample.name
    return found


def names(found):
    return [sample.name for sample in found]


def same(array, *rows):
    np.testing.assert_array_equal(array, np.array(rows))


def calibration(file, baseline=200, doffs=30):
    file.write_text(
        f"cam0=[1000 0 1.5; 0 1000 1; 0 0 1]\ncam1=[1000 0 {1.5 + doffs}; 0 1000 1; 0 0 1]\ndoffs={doffs}\n"
        f"baseline={baseline}\nwidth=4\nheight=2\nndisp=70\n"
    )


PROJECTIONS = "{0}: 700 0 1.5 35 0 700 1 0 0 0 1 0\n{1}: 700 0 1.5 -343 0 700 1 0 0 0 1 0\n"  # 0.54 m


# --- DrivingStereo ----------------------------------------------------------------------------------------

SEQUENCE, FRAME = "2018-07-09-16-11-56", "2018-07-09-16-11-56_2018-07-09-16-11-56-702"


def driving(root, kind, place, size, truth=True):
    """One pair: `kind` is "train-" or "", `place` what lies between."""
    for word, value in (("left-image", 10), ("right-image", 11)):
        image(root / f"{kind}{word}{size}" / place / f"{FRAME}.jpg", value, (8, 8))
    if truth:
        values(root / f"{kind}disparity-map{size}" / place / f"{FRAME}.png", [256, 0, 640, 1], [1, 1, 1, 1])


class TestDrivingStereo:
    @pytest.mark.parametrize("line", ["T_103: 0 0 0", "T_103: 0 0", ""])
    def test_a_broken_calibration_is_named(self, tmp_path, line):
        driving(tmp_path, "train-", SEQUENCE, "")
        file = tmp_path / "half-image-calib" / "half-image-calib" / f"{SEQUENCE}.txt"
        file.parent.mkdir(parents=True)
        file.write_text(
            "R_101: 1 0 0 0 1 0 0 0 1\nT_101: 0 0 0\nR_103: 1 0 0 0 1 0 0 0 1\n"
            "P_rect_101: 9 0 4 0 0 9 2 0 0 0 1 0\nP_rect_103: 9 0 4 0 0 9 2 0 0 0 1 0\n" + line
        )
        with pytest.raises(
            ValueError, match=rf"{SEQUENCE}\.txt: the (baseline is 0|calibration has no T_103)"
        ):
            datasets.open(tmp_path)[0].calibration()

    def test_train(self, tmp_path):
        driving(tmp_path, "train-", SEQUENCE, "")
        (tmp_path / "half-image-calib").mkdir()
        (tmp_path / "half-image-calib" / f"{SEQUENCE}.txt").write_text(
            "calib_time: 09-Jul-2018 16:11:56\nS_rect_101: 999 999\n"
            # Cameras stand at -R'T: the left one at x = -0.1, the right one, turned by 90 degrees, at 0.44.
            "R_101: 1 0 0 0 1 0 0 0 1\nT_101: 0.1 0 0\nR_103: 0 0 1 0 1 0 -1 0 0\nT_103: 0 0 0.44\n"
            "P_rect_101: 1000 0 460 0 0 1000 200 0 0 0 1 0\n"
            "P_rect_103: 1000 0 463 -1080 0 1000 200 0 0 0 1 0\n"
        )
        found = opened(tmp_path)
        assert found.name == "DrivingStereo"
        assert names(found) == [f"train/{SEQUENCE}/{FRAME}"]
        same(found[0].truth(), [1, N, 2.5, 1 / 256], [1 / 256] * 4)
        camera = found[0].calibration()
        assert (camera.focal, camera.cx, camera.cy, camera.doffs) == (1000, 460, 200, 3)
        assert camera.baseline == pytest.approx(0.54)
        pair = found[0].pair()
        assert (int(pair.left[0, 0]), int(pair.right[0, 0])) == (10, 11)
        assert names(datasets.open(tmp_path / "train-left-image")) == [f"{SEQUENCE}/{FRAME}"]

    @pytest.mark.parametrize(("size", "factor"), [("half", 1), ("full", 2)])
    def test_sizes(self, tmp_path, size, factor):
        """The full size has twice the disparity for the same number."""
        driving(tmp_path, "", "", f"-{size}-size")
        found = opened(tmp_path)
        assert names(found) == [FRAME]
        same(found[0].truth()[0], factor, N, 2.5 * factor, factor / 256)

    def test_two_sizes(self, tmp_path):
        driving(tmp_path, "", "", "-half-size")
        driving(tmp_path, "", "", "-full-size")
        with pytest.raises(ValueError, match="left-image-half-size, left-image-full-size: open one of them"):
            datasets.open(tmp_path)
        found = opened(tmp_path / "left-image-full-size")
        assert names(found) == [FRAME]
        same(found[0].truth()[0, 0], 2)

    def test_test(self, tmp_path):
        for word in ("left-image", "right-image", "disparity-map"):
            for size in ("half", "full"):
                folder = tmp_path / f"test-{word}" / f"{word}-{size}-size"
                if word == "disparity-map":
                    values(folder / f"{FRAME}.png", [256, 0], [512, 0])
                else:
                    image(folder / f"{FRAME}.png")
        with pytest.raises(ValueError, match="test-left-image holds left-image-half-size"):
            datasets.open(tmp_path)
        found = opened(tmp_path / "test-left-image" / "left-image-full-size")
        assert names(found) == [FRAME]
        same(found[0].truth(), [2, N], [4, N])
        for word in ("left-image", "right-image", "disparity-map"):
            (tmp_path / f"test-{word}" / f"{word}-full-size").rename(tmp_path / f"full {word}")
        assert names(datasets.open(tmp_path)) == [f"test/{FRAME}"]

    def test_weather(self, tmp_path):
        for weather in ("sunny", "foggy"):
            driving(tmp_path / weather, "", "", "-half-size")
        assert names(datasets.open(tmp_path)) == [f"foggy/{FRAME}", f"sunny/{FRAME}"]
        assert names(datasets.open(tmp_path / "sunny")) == [FRAME]

    def test_folders_unpacked_into_folders_of_their_name(self, tmp_path):
        for word in ("left-image", "right-image"):
            image(tmp_path / f"{word}-half-size" / f"{word}-half-size" / f"{FRAME}.jpg", 1, (8, 8))
        assert names(datasets.open(tmp_path)) == [FRAME]


# --- KITTI ------------------------------------------------------------------------------------------------


@pytest.fixture
def kitti2012(tmp_path):
    for part in ("training", "testing"):
        for folder, value in (("image_0", 1), ("image_1", 2), ("colored_0", 3), ("colored_1", 4)):
            for frame in ("000000_10", "000000_11"):
                image(tmp_path / part / folder / f"{frame}.png", value)
        calib = tmp_path / part / "calib" / "000000.txt"
        calib.parent.mkdir()
        calib.write_text(
            "P0: 700 0 1.5 0 0 700 1 0 0 0 1 0\nP1: 700 0 1.5 -350 0 700 1 0 0 0 1 0\n"
            + PROJECTIONS.format("P2", "P3")
        )
    values(tmp_path / "training/disp_occ/000000_10.png", [256, 512, 0, 1], [0, 0, 0, 65535])
    values(tmp_path / "training/disp_noc/000000_10.png", [256, 0, 0, 1], [0, 0, 0, 0])
    return tmp_path


class TestKitti2012:
    def test_training(self, kitti2012):
        found = opened(kitti2012)
        assert found.name == "KITTI 2012"
        (sample,) = found
        assert sample.name == "000000_10"
        assert sample.left_file.parts[-3:-1] == ("training", "colored_0")
        same(sample.truth(), [1, 2, N, 1 / 256], [N, N, N, 65535 / 256])
        same(sample.mask(), [True, False, False, True], [False] * 4)
        assert sample.calibration().baseline == pytest.approx(0.54)

    def test_testing(self, kitti2012):
        (sample,) = opened(kitti2012 / "testing")
        assert (sample.truth(), sample.mask()) == (None, None)
        assert sample.left_file.parts[-3] == "testing"

    def test_testing_alone(self, kitti2012):
        (kitti2012 / "training").rename(kitti2012 / "elsewhere")
        (sample,) = opened(kitti2012)
        assert sample.truth() is None

    def test_grey(self, kitti2012):
        for view in (0, 1):
            (kitti2012 / "training" / f"colored_{view}").rename(kitti2012 / f"away_{view}")
        (sample,) = opened(kitti2012)
        assert sample.left_file.parts[-2] == "image_0"
        assert sample.calibration().baseline == pytest.approx(0.5)


def test_kitti2015_testing_alone(tmp_path):
    for view in (2, 3):
        image(tmp_path / "testing" / f"image_{view}" / "000000_10.png")
    found = opened(tmp_path)
    assert (found.name, names(found)) == ("KITTI 2015", ["000000_10"])
    assert found[0].truth() is None


# --- Middlebury and ETH3D ---------------------------------------------------------------------------------


def views(folder, names=("im0.png", "im1.png"), shape=SHAPE):
    for name in names:
        image(folder / name, shape=shape)


class TestMiddlebury2003:
    @pytest.mark.parametrize(
        ("height", "factor"), [(381, 8), (216, 8), (288, 16), (375, 4), (750, 2), (1500, 1)]
    )
    def test_factor(self, tmp_path, height, factor):
        scene = tmp_path / "cones"
        views(scene, ("im2.png", "im6.png"), (height, 3))
        truth = np.zeros((height, 3), np.uint8)
        truth[0] = (0, 96, 3)
        io.write_image(scene / "disp2.png", truth)
        found = opened(tmp_path)
        assert (found.name, names(found)) == ("Middlebury 2001/2003", ["cones"])
        same(found[0].truth()[0], N, 96 / factor, 3 / factor)
        assert np.isnan(found[0].truth()[1:]).all()
        assert found[0].mask() is None

    def test_both_truths(self, tmp_path):
        """Of 2001, factor 8: the third pixel, at disparity 1, has its match at 2; the last, at 3, at 1."""
        views(tmp_path / "venus", ("im2.ppm", "im6.ppm"), (*SHAPE, 3))
        values(tmp_path / "venus/disp2.pgm", [0, 8, 8, 24], [0, 0, 0, 0], dtype=np.uint8)
        values(tmp_path / "venus/disp6.pgm", [8, 8, 0, 0], [0, 0, 0, 0], dtype=np.uint8)
        (sample,) = opened(tmp_path)
        same(sample.truth()[0], N, 1, 1, 3)
        # x - d: 0 with 1 there, 1 with 1 there, 0 with 1 there, which is not 3.
        same(sample.mask(), [False, True, True, False], [False] * 4)

    def test_tsukuba_and_map(self, tmp_path):
        views(tmp_path / "tsukuba", ("scene1.row3.col3.ppm", "scene1.row3.col4.ppm"), (288, 3, 3))
        io.write_image(tmp_path / "tsukuba/truedisp.row3.col3.pgm", np.full((288, 3), 80, np.uint8))
        views(tmp_path / "map", ("im0.pgm", "im1.pgm"), (216, 3))
        for side in (0, 1):
            io.write_image(tmp_path / f"map/disp{side}.pgm", np.full((216, 3), 80, np.uint8))
        found = opened(tmp_path)
        assert names(found) == ["map", "tsukuba"]
        assert [sample.truth()[5, 1] for sample in found] == [10, 5]
        assert found[0].right_file.name == "im1.pgm"
        assert found[1].right_file.name == "scene1.row3.col4.ppm"

    def test_one_scene(self, tmp_path):
        views(tmp_path, ("im2.png", "im6.png"))
        values(tmp_path / "disp2.png", [0, 8], [0, 8], dtype=np.uint8)
        assert names(datasets.open(tmp_path)) == [tmp_path.name]


class TestMiddlebury2006:
    @pytest.mark.parametrize(("size", "divisor"), [("FullSize", 1), ("HalfSize", 2), ("ThirdSize", 3)])
    @pytest.mark.parametrize("inside", [True, False])
    def test_named_size(self, tmp_path, size, divisor, inside):
        scene = tmp_path / size / "Aloe"
        views(scene, ("view1.png", "view5.png"), (3, 5))
        for side in (1, 5):
            values(scene / f"disp{side}.png", *([[0, 6, 12, 90, 3]] * 3), dtype=np.uint8)
        (scene / "dmin.txt").write_text("270\n")
        found = opened(tmp_path / size if inside else tmp_path)
        assert (found.name, names(found)) == ("Middlebury 2005/2006", ["Aloe"])
        same(found[0].truth()[0], N, 6 / divisor, np.float32(12 / divisor), 90 / divisor, 3 / divisor)
        camera = found[0].pair().calibration
        assert camera.focal == pytest.approx(3740 / divisor)
        assert (camera.baseline, camera.doffs) == (0.16, pytest.approx(270 / divisor))
        assert (camera.cx, camera.cy) == (2, 1)
        # The page's own formula: 3740 px times 160 mm over the value of the image plus dmin.
        assert io.depth(found[0].truth(), camera)[0, 1] == pytest.approx(3740 * 0.160 / (6 + 270))

    @pytest.mark.parametrize(("height", "divisor"), [(1110, 1), (555, 2), (370, 3)])
    def test_size_of_the_image(self, tmp_path, height, divisor):
        scene = tmp_path / "Art"
        views(scene, ("view1.png", "view5.png"), (height, 2))
        io.write_image(scene / "disp1.png", np.full((height, 2), 12, np.uint8))
        assert datasets.open(tmp_path)[0].truth()[7, 1] == 12 / divisor

    def test_no_size(self, tmp_path):
        views(tmp_path / "Art", ("view1.png", "view5.png"))
        values(tmp_path / "Art/disp1.png", [6, 6], [6, 6], dtype=np.uint8)
        with pytest.raises(
            ValueError, match=r"disp1\.png has 2 rows, not those of the full, half or third size"
        ):
            datasets.open(tmp_path)[0].truth()

    def test_lights_and_exposures(self, tmp_path):
        scene = tmp_path / "FullSize" / "Art"
        for light in (1, 2):
            for exposure in (0, 1):
                views(scene / f"Illum{light}/Exp{exposure}", ("view0.png", "view1.png", "view5.png"))
        values(scene / "disp1.png", [6] * 4, [6] * 4, dtype=np.uint8)
        found = opened(tmp_path)
        assert names(found) == [f"Art/Illum{light}/Exp{exposure}" for light in (1, 2) for exposure in (0, 1)]
        assert found[3].left_file == scene / "Illum2/Exp1/view1.png"
        same(found[3].truth(), [6] * 4, [6] * 4)

    def test_both_truths(self, tmp_path):
        """At half size 4 means 2 pixels, 2 in the right truth 1: just agreeing; 6 means 3."""
        scene = tmp_path / "HalfSize" / "Art"
        views(scene, ("view1.png", "view5.png"), (1, 5))
        values(scene / "disp1.png", [4, 4, 4, 4, 4], dtype=np.uint8)
        values(scene / "disp5.png", [2, 8, 6, 4, 4], dtype=np.uint8)
        same(opened(tmp_path)[0].mask(), [False, False, True, False, True])

    def test_two_sizes(self, tmp_path):
        for size in ("HalfSize", "ThirdSize"):
            views(tmp_path / size / "Art", ("view1.png", "view5.png"))
        with pytest.raises(ValueError, match="holds HalfSize, ThirdSize: open one of them"):
            datasets.open(tmp_path)

    def test_dmin_is_no_number(self, tmp_path):
        scene = tmp_path / "FullSize" / "Art"
        views(scene, ("view1.png", "view5.png"))
        (scene / "dmin.txt").write_text("many")
        with pytest.raises(ValueError, match=r"dmin\.txt: could not convert"):
            datasets.open(tmp_path)[0].calibration()


class TestMiddleburyV3:
    @pytest.mark.parametrize("above", ["", "MiddEval3"])
    def test_training_before_test(self, tmp_path, above):
        for part in ("trainingQ", "testQ"):
            views(tmp_path / above / part / f"Scene of {part}")
        assert names(datasets.open(tmp_path)) == ["Scene of trainingQ"]
        found = opened(tmp_path / above / "testQ")
        assert (found.name, names(found)) == ("Middlebury v3", ["Scene of testQ"])
        assert (found[0].truth(), found[0].mask()) == (None, None)

    def test_test_alone(self, tmp_path):
        views(tmp_path / "testH" / "Crusade")
        assert names(datasets.open(tmp_path)) == ["Crusade"]

    def test_one_scene(self, tmp_path):
        views(tmp_path / "Teddy")
        assert names(datasets.open(tmp_path / "Teddy")) == ["Teddy"]


@pytest.mark.parametrize("above", ["", "data"])
def test_middlebury2021(tmp_path, above):
    scene = tmp_path / above / "artroom1"
    views(scene)
    views(scene / "ambient" / "F0")
    floats(scene / "disp0.pfm", [1.25, N, 1, 2.5], [4, 0, 0, 0])
    floats(scene / "disp1.pfm", [1, 1, N, N], [0, 0, 0, 0])
    calibration(scene / "calib.txt", doffs=0)
    found = opened(tmp_path)
    assert (found.name, names(found)) == ("Middlebury 2014/2021", ["artroom1"])
    same(found[0].truth(), [1.25, N, 1, 2.5], [4, 0, 0, 0])
    # Matches of row 0: -1.25 lies outside, 2 - 1 = 1 agrees, 3 - 2.5 = 0.5 rounds to 0 where 1 is 1.5 off.
    same(found[0].mask(), [False, False, True, False], [False, True, True, True])
    assert found[0].pair().calibration.baseline == pytest.approx(0.2)


class TestETH3D:
    @pytest.mark.parametrize("inside", ["", "two_view_training"])
    def test_training(self, tmp_path, inside):
        scene = tmp_path / "two_view_training" / "delivery_area_1l"
        views(scene)
        views(tmp_path / "two_view_test" / "lakeside_1s")
        floats(scene / "disp0GT.pfm", [1.25, N, 3, 4], [5, 6, 7, 8])
        values(scene / "mask0nocc.png", [255, 0, 128, 255], [255] * 4, dtype=np.uint8)
        calibration(scene / "calib.txt", 59.8896, 0)
        found = opened(tmp_path / inside)
        assert (found.name, names(found)) == ("ETH3D", ["delivery_area_1l"])
        same(found[0].truth(), [1.25, N, 3, 4], [5, 6, 7, 8])
        same(found[0].mask(), [True, False, False, True], [True] * 4)
        assert found[0].calibration().baseline == pytest.approx(0.0598896)

    @pytest.mark.parametrize("inside", ["", "two_view_training"])
    def test_truth_unpacked_beside(self, tmp_path, inside):
        views(tmp_path / "two_view_training" / "facade_1s")
        floats(tmp_path / "two_view_training_gt" / "facade_1s" / "disp0GT.pfm", [1, 2, 3, 4], [5, 6, 7, 8])
        values(tmp_path / "two_view_training_gt/facade_1s/mask0nocc.png", [255] * 4, dtype=np.uint8)
        (sample,) = opened(tmp_path / inside)
        assert sample.truth()[1, 3] == 8
        assert sample.mask().shape == (1, 4)

    def test_test(self, tmp_path):
        views(tmp_path / "two_view_test" / "storage_room_2_1l")
        for folder in (tmp_path, tmp_path / "two_view_test"):
            found = opened(folder)
            assert (found.name, names(found)) == ("ETH3D", ["storage_room_2_1l"])


# --- Argoverse --------------------------------------------------------------------------------------------

CAMERAS = {
    "camera_data_": [
        {
            "key": f"image_raw_stereo_front_{side}_rect",
            "value": {
                "focal_length_x_px_": 3666.5,
                "focal_length_y_px_": 3666.5,
                "focal_center_x_px_": 1235.0,
                "focal_center_y_px_": 1028.0,
                "vehicle_SE3_camera_": {"translation": [1.6, y, 1.4]},
            },
        }
        for side, y in (("left", 0.15), ("right", -0.1486))
    ]
}


@pytest.fixture
def argoverse(tmp_path):
    for part in ("train", "test"):
        log = tmp_path / "rectified_stereo_images_v1.1" / part / "273c1883"
        for side in ("left", "right"):
            image(log / f"stereo_front_{side}_rect" / f"stereo_front_{side}_rect_3159.jpg", 1, (8, 8))
        (log / "vehicle_calibration_stereo_info.json").write_text(json.dumps(CAMERAS))
    truths = tmp_path / "disparity_maps_v1.1" / "train" / "273c1883"
    values(truths / "stereo_front_left_rect_disparity/stereo_front_left_rect_disparity_3159.png", [256, 0])
    values(truths / "stereo_front_left_rect_objects_disparity/stereo_x_3159.png", [1, 1])
    return tmp_path


class TestArgoverse:
    @pytest.mark.parametrize("inside", ["", "rectified_stereo_images_v1.1"])
    def test_samples(self, argoverse, inside):
        found = opened(argoverse / inside)
        assert found.name == "Argoverse stereo"
        assert names(found) == ["test/273c1883/3159", "train/273c1883/3159"]
        assert found[0].truth() is None
        same(found[1].truth(), [1, N])
        camera = found[1].calibration()
        assert camera.baseline == pytest.approx(0.2986)
        assert (camera.focal, camera.cx, camera.cy, camera.doffs) == (3666.5, 1235, 1028, 0)
        assert found[1].pair().calibration == camera

    def test_one_part(self, argoverse):
        (sample,) = opened(argoverse / "rectified_stereo_images_v1.1" / "train")
        assert sample.name == "273c1883/3159"
        same(sample.truth(), [1, N])

    def test_a_broken_calibration_is_named(self, argoverse):
        file = argoverse / "rectified_stereo_images_v1.1/train/273c1883/vehicle_calibration_stereo_info.json"
        for text in ("{", "{}", '{"camera_data_": []}'):
            file.write_text(text)
            with pytest.raises(ValueError, match=r"vehicle_calibration_stereo_info\.json: "):
                datasets.open(argoverse)[1].calibration()


# --- Rendered ---------------------------------------------------------------------------------------------


def scene_flow(root, scene, frame="0006", passes=("cleanpass", "finalpass")):
    for name in passes:
        for side in ("left", "right"):
            image(root / f"frames_{name}" / scene / side / f"{frame}.png")
    floats(root / "disparity" / scene / "left" / f"{frame}.pfm", [1, 1, 2, 1.5], [1, 1, 1, 1])
    floats(root / "disparity" / scene / "right" / f"{frame}.pfm", [1, 1, 1, 1], [9, 9, 9, 9])


class TestSceneFlow:
    def test_flyingthings(self, tmp_path):
        scene_flow(tmp_path, "TRAIN/A/0000")
        scene_flow(tmp_path, "TEST/C/0149", passes=("cleanpass",))
        found = opened(tmp_path)
        assert found.name == "Scene Flow"
        assert names(found) == [
            "cleanpass/TEST/C/0149/0006",
            "cleanpass/TRAIN/A/0000/0006",
            "finalpass/TRAIN/A/0000/0006",
        ]
        same(found[1].truth(), [1, 1, 2, 1.5], [1, 1, 1, 1])
        same(found[1].mask(), [False, True, True, True], [False] * 4)
        assert found[1].truth_file == found[2].truth_file
        told = found.describe()
        assert (told["name"], told["pairs"], told["first"]) == ("Scene Flow", 3, found[0].name)
        assert [told[f"with_{what}"] for what in ("truth", "mask", "calibration")] == [3, 3, 3]
        camera = found[1].pair().calibration
        assert (camera.focal, camera.cx, camera.cy, camera.baseline) == (1050, 479.5, 269.5, 1)

    def test_one_pass(self, tmp_path):
        scene_flow(tmp_path, "a_rain_of_stones_x2")
        found = opened(tmp_path / "frames_finalpass")
        assert names(found) == ["a_rain_of_stones_x2/0006"]
        assert found[0].truth() is not None

    def test_a_part_of_a_pass(self, tmp_path):
        scene_flow(tmp_path, "35mm_focallength/scene_forwards/fast")
        scene_flow(tmp_path, "15mm_focallength/scene_forwards/fast")
        found = opened(tmp_path / "frames_finalpass" / "15mm_focallength")
        assert names(found) == ["scene_forwards/fast/0006"]
        same(found[0].truth(), [1, 1, 2, 1.5], [1, 1, 1, 1])
        assert "finalpass" in str(found[0].left_file)
        assert found[0].calibration().focal == 450

    def test_all_three(self, tmp_path):
        scene_flow(tmp_path / "Monkaa", "family_x2", passes=("cleanpass",))
        scene_flow(tmp_path / "Driving", "15mm_focallength/scene_forwards/fast", passes=("cleanpass",))
        found = opened(tmp_path)
        assert names(found) == [
            "Driving/cleanpass/15mm_focallength/scene_forwards/fast/0006",
            "Monkaa/cleanpass/family_x2/0006",
        ]
        assert [sample.calibration().focal for sample in found] == [450, 1050]


class TestVirtualKitti:
    @pytest.mark.parametrize(("rgb", "depth"), [("", ""), ("vkitti_2.0.3_rgb", "vkitti_2.0.3_depth")])
    def test_samples(self, tmp_path, rgb, depth):
        for variation in ("clone", "fog"):
            frames = tmp_path / rgb / "Scene01" / variation / "frames/rgb"
            for camera in (0, 1):
                image(frames / f"Camera_{camera}" / "rgb_00001.jpg", 1, (8, 8))
        frames = tmp_path / depth / "Scene01/clone/frames/depth"
        # 725.0087 px * 0.532725 m = 386.2303 px m: 386.23 px at a metre, 1 px at 386.23 m.
        values(frames / "Camera_0/depth_00001.png", [65535, 0, 38623, 19311], [100, 38623, 38623, 38623])
        values(frames / "Camera_1/depth_00001.png", [65535, 38623, 38623, 0], [38623, 38623, 65535, 100])
        found = opened(tmp_path)
        assert found.name == "Virtual KITTI 2"
        assert names(found) == ["Scene01/clone/00001", "Scene01/fog/00001"]
        product = 725.0087 * 0.532725 * 100
        same(
            found[0].truth(),
            np.array([N, N, product / 38623, product / 19311], np.float32),
            np.array([product / 100, *[product / 38623] * 3], np.float32),
        )
        assert found[0].truth()[1, 0] == pytest.approx(386.2303, abs=1e-4)
        assert found[0].truth()[0, 2] == pytest.approx(1, abs=1e-4)
        # Row 0: 2 - 1 = 1 agrees; 3 - 2 = 1 has 1 there, off by a hair more than 1. Row 1: 386 is outside.
        same(found[0].mask(), [False, False, True, False], [False, True, True, False])
        assert found[1].truth() is None
        assert found[0].calibration() == found[1].calibration()
        assert found[0].calibration().baseline == 0.532725
        alone = opened(tmp_path / rgb)
        assert names(alone) == names(found)
        same(alone[0].truth(), *found[0].truth())


@pytest.fixture
def sintel(tmp_path):
    training = tmp_path / "training"
    for name in ("clean", "final"):
        for side in ("left", "right"):
            image(training / f"{name}_{side}" / "alley_1" / "frame_0001.png")
    disparity = np.array([[[0, 64, 0], [0, 0, 128]], [[10, 32, 128], [255, 255, 255]]], np.uint8)
    values(training / "disparities/alley_1/frame_0001.png", *disparity, dtype=np.uint8)
    values(training / "occlusions/alley_1/frame_0001.png", [0, 255], [0, 0], dtype=np.uint8)
    values(training / "outofframe/alley_1/frame_0001.png", [1, 0], [0, 0], dtype=np.uint8)
    return tmp_path


class TestSintel:
    @pytest.mark.parametrize("inside", ["", "training"])
    def test_samples(self, sintel, inside):
        found = opened(sintel / inside)
        assert found.name == "MPI Sintel"
        assert names(found) == ["clean/alley_1/frame_0001", "final/alley_1/frame_0001"]
        # 4 R + G / 64 + B / 16384.
        same(
            found[1].truth(),
            [1, 1 / 128],
            [40 + 0.5 + 1 / 128, np.float32(1020 + 255 / 64 + 255 / 16384)],
        )
        same(found[0].mask(), [False, False], [True, True])

    def test_without_a_calibration(self, sintel):
        found = datasets.open(sintel)
        assert found[0].calibration() is None
        assert found.describe()["with_calibration"] == 0

    def test_one_pass(self, sintel):
        assert names(datasets.open(sintel / "training" / "final_left")) == ["alley_1/frame_0001"]

    def test_masks_of_two_sizes(self, sintel):
        values(sintel / "training/outofframe/alley_1/frame_0001.png", [0, 0], dtype=np.uint8)
        with pytest.raises(ValueError, match=r"occlusions.*png and .*outofframe.*png differ in size"):
            datasets.open(sintel)[0].mask()

    def test_one_mask(self, sintel):
        (sintel / "training/outofframe/alley_1/frame_0001.png").unlink()
        assert datasets.open(sintel)[0].mask() is None

    def test_grey_truth(self, sintel):
        values(sintel / "training/disparities/alley_1/frame_0001.png", [1, 1], dtype=np.uint8)
        with pytest.raises(ValueError, match=r"disparities.*frame_0001\.png must be 8-bit colour, not uint8"):
            datasets.open(sintel)[0].truth()


@pytest.fixture
def falling_things(tmp_path):
    for place in ("mixed/kitchen_0", "single/002_master_chef_can_16k/temple_1"):
        scene = tmp_path / place
        for side in ("left", "right"):
            image(scene / f"000000.{side}.jpg", 1, (8, 8))
            values(scene / f"000000.{side}.seg.png", [1])
        inner = {"resX": 960, "resY": 540, "fx": 768.0, "fy": 768.0, "cx": 480, "cy": 270, "s": 0}
        cameras = [{"name": side, "intrinsic_settings": inner} for side in ("left", "right")]
        (scene / "_camera_settings.json").write_text(json.dumps({"camera_settings": cameras}))
        (scene / "_object_settings.json").write_text("{}")
    values(tmp_path / "mixed/kitchen_0/000000.left.depth.png", [0, 65535, 10000, 46080])
    values(tmp_path / "mixed/kitchen_0/000000.right.depth.png", [1, 1, 46080, 1])
    return tmp_path


class TestFallingThings:
    def test_samples(self, falling_things):
        found = opened(falling_things)
        assert found.name == "Falling Things"
        assert names(found) == ["mixed/kitchen_0/000000", "single/002_master_chef_can_16k/temple_1/000000"]
        # 768 px * 0.06 m = 46.08 px m: 46.08 px at 1 m, 10 px at 4.608 m.
        same(found[0].truth(), np.array([N, N, 46.08, 10], np.float32))
        same(found[0].mask(), [False] * 4)
        camera = found[0].calibration()
        assert (camera.focal, camera.cx, camera.cy, camera.baseline) == (768, 480, 270, 0.06)
        assert found[1].truth() is None
        assert found[1].pair().calibration == camera
        assert names(datasets.open(falling_things / "mixed")) == ["kitchen_0/000000"]
        assert names(datasets.open(falling_things / "mixed/kitchen_0")) == ["000000"]

    def test_a_truth_of_another_kind(self, falling_things):
        file = falling_things / "mixed/kitchen_0/000000.left.depth.png"
        values(file, [1, 2], dtype=np.uint8)
        with pytest.raises(ValueError, match=r"000000\.left\.depth\.png must be 16-bit grey, not uint8"):
            datasets.open(falling_things)[0].truth()


class TestInStereo2K:
    def test_samples(self, tmp_path):
        for place in ("train/part1/000001", "test/000040"):
            views(tmp_path / place, ("left.png", "right.png"))
            values(tmp_path / place / "left_disp.png", [0, 100, 150, 12345], [1, 0, 0, 0])
            values(tmp_path / place / "right_disp.png", [100, 100, 0, 0], [0, 0, 0, 0])
        found = opened(tmp_path)
        assert (found.name, names(found)) == ("InStereo2K", ["test/000040", "train/part1/000001"])
        same(
            found[0].truth(),
            np.array([N, 1, 1.5, 123.45], np.float32),
            np.array([0.01, N, N, N], np.float32),
        )
        # The third pixel's match, 2 - 1.5, rounds to column 0: the even one.
        same(found[0].mask(), [False, True, True, False], [False] * 4)
        assert names(datasets.open(tmp_path / "train" / "part1")) == ["000001"]
        assert names(datasets.open(tmp_path / "test" / "000040")) == ["000040"]


# --- Two folders ------------------------------------------------------------------------------------------


class TestFolders:
    def test_samples(self, tmp_path):
        for name in ("b", "drive 1/ä", "drive 1/a10", "drive 1/a9"):
            image(tmp_path / "left" / f"{name}.png", 1)
            image(tmp_path / "right" / f"{name}.tif", 2)
        floats(tmp_path / "truth/drive 1/a9.pfm", [1, N, 3, 4], [5, 6, 7, 8])
        (tmp_path / "left" / "notes.txt").write_text("no image")
        calibration(tmp_path / "calib.txt")
        found = opened(tmp_path)
        assert found.name == "left and right"
        assert names(found) == ["b", "drive 1/a10", "drive 1/a9", "drive 1/ä"]
        pair = found[2].pair()
        assert (pair.left[0, 0], pair.right[0, 0], pair.calibration.doffs) == (1, 2, 30)
        same(found[2].truth(), [1, N, 3, 4], [5, 6, 7, 8])
        assert (found[1].truth(), found[1].mask()) == (None, None)

    def test_what_is_an_image(self, tmp_path):
        kinds = ["png", "jpg", "jpeg", "tif", "tiff", "pgm", "ppm", "pfm", "npy", "PNG"]
        for side in ("left", "right"):
            (tmp_path / side).mkdir()
            for kind in (*kinds, "txt", "xml"):
                (tmp_path / side / f"of {kind}.{kind}").touch()
        assert names(datasets.open(tmp_path)) == sorted(f"of {kind}" for kind in kinds)

    def test_unpaired(self, tmp_path):
        for number in range(7):
            image(tmp_path / "left" / f"{number}.png")
        image(tmp_path / "right" / "0.png")
        image(tmp_path / "right" / "7.pgm")
        floats(tmp_path / "truth" / "8.pfm", [1])
        found = datasets.open(tmp_path)
        assert names(found) == [str(number) for number in range(9)]
        assert found[0].pair().name == "0"
        for sample, missing in zip(found[1:], ["right"] * 6 + ["left"] * 2, strict=True):
            with pytest.raises(FileNotFoundError, match=rf"{missing}.{sample.name}\.(png|pgm|pfm)"):
                sample.pair()
        (tmp_path / "right" / "0.png").unlink()
        with pytest.raises(ValueError, match=r"0\.png has no right view: .*0\.png is missing; no pair of"):
            datasets.open(tmp_path)

    def test_two_files_of_a_name(self, tmp_path):
        for name in ("left/a.png", "left/a.ppm", "right/a.png"):
            image(tmp_path / name, shape=(*SHAPE, 3))
        with pytest.raises(ValueError, match=r"a\.png and .*a\.ppm have the same name"):
            datasets.open(tmp_path)

    def test_two_truths(self, tmp_path):
        for folder in ("left", "right", "disparity", "truth"):
            image(tmp_path / folder / "a.png")
        with pytest.raises(ValueError, match="holds disparity, truth: keep one of them"):
            datasets.open(tmp_path)


# --- What holds for all -----------------------------------------------------------------------------------


class TestReaders:
    def test_scaled(self, tmp_path):
        values(tmp_path / "a.png", [0, 7], [65535, 100])
        same(
            Scaled(100)(tmp_path / "a.png"),
            np.array([N, 0.07], np.float32),
            np.array([655.35, 1], np.float32),
        )

    @pytest.mark.parametrize("read", [Scaled(100), FromDepth(1)])
    def test_nothing_known(self, tmp_path, read):
        values(tmp_path / "a.png", [0, 0])
        with pytest.raises(ValueError, match=r"a\.png: holds no disparity: every pixel is invalid"):
            read(tmp_path / "a.png")

    def test_consistent(self, tmp_path):
        """Every column's match by hand: x - d, and what the right truth says there."""
        floats(tmp_path / "left.pfm", [0, 2, 1, N, 2, -2, -1, 3.4])
        floats(tmp_path / "right.pfm", [0, 1, 4, N, 3.9, N, N, -1.5])
        # 0: 0 there; -1: outside; 1: 1; unknown; 2: 4, 2 off; 7: -1.5, 0.5 off; 7: 0.5 off; 3.6 is 4: 3.9
        seen = Consistent(tmp_path / "left.pfm", tmp_path / "right.pfm")()
        same(seen, [True, False, True, False, False, True, True, True])
        assert seen.dtype == bool

    @given(
        maps=st.integers(1, 9).flatmap(
            lambda width: arrays(
                np.float32,
                st.tuples(st.just(2), st.integers(1, 3), st.just(width)),
                elements=st.one_of(st.just(N), st.integers(-44, 44).map(lambda quarters: quarters / 4)),
            )
        )
    )
    @settings(max_examples=100, deadline=None)
    def test_consistent_as_defined(self, maps):
        """Pixel by pixel: the match's column to the nearest whole, of two the even one."""
        left, right = maps
        expected = np.zeros(left.shape, bool)
        for row, column in np.ndindex(left.shape):
            disparity = float(left[row, column])
            if np.isfinite(disparity) and -0.5 < column - disparity < left.shape[1] - 0.5:
                match = round(column - disparity)
                expected[row, column] = abs(right[row, match] - disparity) <= 1
        by_side = {Path("left"): left, Path("right"): right}
        np.testing.assert_array_equal(
            Consistent(Path("left"), Path("right"), by_side.__getitem__)(), expected
        )

    def test_consistent_sizes(self, tmp_path):
        floats(tmp_path / "left.pfm", [1, 2])
        floats(tmp_path / "right.pfm", [1, 2, 3])
        with pytest.raises(ValueError, match=r"left\.pfm has the shape \(1, 2\), .*right\.pfm \(1, 3\)"):
            Consistent(tmp_path / "left.pfm", tmp_path / "right.pfm")()


@pytest.mark.parametrize(
    "layout", ["kitti2012", "argoverse", "sintel", "falling_things", "middlebury", "scene flow", "driving"]
)
def test_samples_travel_and_compare(layout, tmp_path, request):
    """A sample that comes back from another process is the same, and reads the same."""
    if layout == "middlebury":
        views(tmp_path / "ArtL")
        floats(tmp_path / "ArtL/disp0.pfm", [1, 1, 1, 1], [1, 1, 1, 1])
        floats(tmp_path / "ArtL/disp1.pfm", [1, 1, 1, 1], [1, 1, 1, 1])
    elif layout == "scene flow":
        scene_flow(tmp_path, "TRAIN/A/0000")
    elif layout == "driving":
        driving(tmp_path, "train-", SEQUENCE, "")
    else:
        request.getfixturevalue(layout)
    found = opened(tmp_path)
    back = pickle.loads(pickle.dumps(found))
    assert back == found
    for one, other in zip(found, back, strict=True):
        np.testing.assert_array_equal(one.truth(), other.truth())
        np.testing.assert_array_equal(one.mask(), other.mask())
        assert one.calibration() == other.calibration()


VIEWS = {
    "driving": ("train-left-image/{0}/f{1}.jpg", "train-right-image/{0}/f{1}.jpg"),
    "full size": ("left-image-full-size/f{1}.jpg", "right-image-full-size/f{1}.jpg"),
    "kitti2012": ("training/colored_0/{1}_10.png", "training/colored_1/{1}_10.png"),
    "kitti2015": ("testing/image_2/{1}_10.png", "testing/image_3/{1}_10.png"),
    "middlebury v2": ("s{1}/im2.ppm", "s{1}/im6.ppm"),
    "middlebury 2006": ("HalfSize/s{1}/view1.png", "HalfSize/s{1}/view5.png"),
    "middlebury v3": ("trainingH/s{1}/im0.png", "trainingH/s{1}/im1.png"),
    "middlebury 2021": ("data/s{1}/im0.png", "data/s{1}/im1.png"),
    "eth3d": ("two_view_training/s_{1}l/im0.png", "two_view_training/s_{1}l/im1.png"),
    "argoverse": tuple(
        f"rectified_stereo_images_v1.1/train/log/stereo_front_{side}_rect/stereo_front_{side}_rect_{{1}}.jpg"
        for side in ("left", "right")
    ),
    "scene flow": ("frames_cleanpass/A/left/{1}.png", "frames_cleanpass/A/right/{1}.png"),
    "virtual kitti": tuple(f"Scene01/rain/frames/rgb/Camera_{camera}/rgb_{{1}}.jpg" for camera in (0, 1)),
    "sintel": ("training/clean_left/A/{1}.png", "training/clean_right/A/{1}.png"),
    "falling things": ("mixed/A/{1}.left.jpg", "mixed/A/{1}.right.jpg"),
    "instereo2k": ("train/{1}/left.png", "train/{1}/right.png"),
}
BESIDE = {
    "middlebury v2": "s{1}/disp2.pgm",
    "middlebury 2021": "data/s{1}/disp0.pfm",
    "falling things": "mixed/A/_camera_settings.json",
    "instereo2k": "train/{1}/left_disp.png",
}
"""What a pair is recognised by besides."""


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("layout", VIEWS)
def test_one_view_is_missing(layout, side, tmp_path):
    """The pair stays in its place and fails by itself; with no whole pair there is no data set."""
    of = [[tmp_path / view.format(SEQUENCE, number) for view in VIEWS[layout]] for number in range(3)]
    for number, pair in enumerate(of):
        for file in pair:
            image(file, shape=(8, 8) if layout != "middlebury v2" else (8, 8, 3))
        if layout in BESIDE:
            beside = tmp_path / BESIDE[layout].format(SEQUENCE, number)
            beside.write_text('{"camera_settings": [{"intrinsic_settings": {"fx": 9, "cx": 1, "cy": 1}}]}')
    whole = datasets.open(tmp_path)
    of[1][side].unlink()
    found = datasets.open(tmp_path)
    assert found == whole
    assert [found[0].pair().name, found[2].pair().name] == [names(whole)[0], names(whole)[2]]
    with pytest.raises(FileNotFoundError) as missing:
        found[1].pair()
    assert missing.value.filename == str(of[1][side])
    for pair in of:
        pair[side].unlink(missing_ok=True)
    with pytest.raises(ValueError, match=rf"has no {('left', 'right')[side]} view: .* is missing"):
        datasets.open(tmp_path)


class TestFolder:
    def test_loops_end(self, tmp_path):
        views(tmp_path / "set" / "train" / "000001", ("left.png", "right.png"))
        values(tmp_path / "set" / "train" / "000001" / "left_disp.png", [1, 1])
        try:
            (tmp_path / "set" / "train" / "again").symlink_to(tmp_path / "set", target_is_directory=True)
            (tmp_path / "set" / "itself").symlink_to("itself")
            (tmp_path / "set" / "nowhere").symlink_to("missing")
            (tmp_path / "set" / "above").symlink_to(tmp_path, target_is_directory=True)
        except OSError:
            pytest.skip("no links here")
        assert names(datasets.open(tmp_path / "set")) == ["train/000001"]
        assert [name for name, _ in Folder(tmp_path / "set").walk(20)] == [
            "",
            "above",
            "train",
            "train/000001",
        ]

    def test_links_are_followed(self, tmp_path):
        image(tmp_path / "elsewhere" / "a.png")
        (tmp_path / "set").mkdir()
        try:
            for side in ("left", "right"):
                (tmp_path / "set" / side).symlink_to(tmp_path / "elsewhere", target_is_directory=True)
        except OSError:
            pytest.skip("no links here")
        (sample,) = opened(tmp_path / "set")
        assert sample.left_file == tmp_path / "set" / "left" / "a.png"

    def test_what_begins_with_a_dot_is_left_out(self, tmp_path):
        for name in ("a", "._a", ".hidden/b"):
            for side in ("left", "right"):
                image(tmp_path / side / f"{name}.png")
        assert names(datasets.open(tmp_path)) == ["a"]

    def test_a_relative_path(self, tmp_path, monkeypatch):
        views(tmp_path / "Teddy")
        monkeypatch.chdir(tmp_path / "Teddy")
        assert names(datasets.open(".")) == ["Teddy"]

    @pytest.mark.skipif(sys.platform == "win32" or os.geteuid() == 0, reason="everything may be read")
    def test_a_folder_that_may_not_be_read(self, tmp_path):
        views(tmp_path / "Teddy")
        (tmp_path / "Teddy").chmod(0)
        try:
            with pytest.raises(PermissionError) as refusal:
                datasets.open(tmp_path)
            assert refusal.value.filename == str(tmp_path / "Teddy")
        finally:
            (tmp_path / "Teddy").chmod(0o700)

    def test_a_hundred_thousand_files(self, tmp_path, monkeypatch):
        """Each folder is listed once, and no file is looked at by itself."""
        for side in ("left", "right"):
            image(tmp_path / side / "000000.png")
        listed = []

        class Entry:
            def __init__(self, folder, name, inner):
                self.name, self.path, self.inner = name, f"{folder}/{name}", inner

            def is_dir(self):
                return self.inner

            def is_file(self):
                return not self.inner

            def is_symlink(self):
                return False

        class Listing(list):
            def __enter__(self):
                return self

            def __exit__(self, *_):
                pass

        def scandir(path):
            listed.append(str(path))
            if str(path) == str(tmp_path):
                return Listing(Entry(path, side, True) for side in ("left", "right"))
            return Listing(Entry(path, f"{number:06}.png", False) for number in range(50_000))

        monkeypatch.setattr(os, "scandir", scandir)
        start = time.process_time()
        found = datasets.open(tmp_path)
        seconds = time.process_time() - start
        assert (len(found), found[49_999].name) == (50_000, "049999")
        assert sorted(listed) == sorted({*listed})
        assert seconds < 20  # a second or so; a file looked up in a list would take hours


@pytest.mark.parametrize(
    "name",
    ["", ".", "..", "/a", "a/", "a//b", "a/./b", "../a", "a/../../b", r"a\..\b", r"..\a", "a\0b"],
)
def test_a_name_that_leads_elsewhere(name):
    with pytest.raises(ValueError, match="cannot name a pair: no part of it may be empty"):
        check_name(name)


@pytest.mark.parametrize("name", ["a", "a/b/c", "...", "a..b", ".a", " ", "ä/ö", "a:b"])
def test_a_name(name):
    assert check_name(name) == name


def test_names_that_are_no_file_names(tmp_path):
    for side in ("left", "right"):
        image(tmp_path / f"-{side}.png")
    with pytest.raises(ValueError, match=r"-left\.png: '' cannot name a pair"):
        datasets.open(tmp_path)


def test_names_of_every_kind(tmp_path):
    """Blanks, letters of any script, line breaks: a name is the file's, letter by letter."""
    wanted = ["Straße 3", "a,b", "左 1"] + (["a\nb"] if sys.platform != "win32" else [])
    for name in wanted:
        for side in ("left", "right"):
            image(tmp_path / side / f"{name}.png")
    found = opened(tmp_path)
    assert names(found) == sorted(wanted)
    assert [sample.pair().name for sample in found] == names(found)


def test_two_pairs_of_a_name(tmp_path):
    for side in ("left", "right"):
        for kind in ("png", "jpg"):
            image(tmp_path / f"a-{side}.{kind}", 1, (8, 8))
    with pytest.raises(ValueError, match=r"holds two pairs named 'a': .*a-left\.\w+ and .*a-left\.\w+"):
        datasets.open(tmp_path)
