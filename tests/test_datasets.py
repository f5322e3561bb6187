import os
import pickle
from pathlib import Path

import numpy as np
import pytest

from stereopsis import datasets, io
from stereopsis.evaluate import evaluate

N = np.nan
DATA = Path(os.environ.get("STEREOPSIS_DATA", Path(__file__).parents[2] / "shared" / "data"))


def grey(value, shape=(2, 3)):
    return np.full(shape, value, np.uint8)


def write_image(file, image):
    file.parent.mkdir(parents=True, exist_ok=True)
    io.write_image(file, image)


def write_disparity(file, *rows):
    file.parent.mkdir(parents=True, exist_ok=True)
    io.write_disparity(file, np.array(rows, np.float32))


@pytest.fixture
def drivingstereo(tmp_path):
    # Written out of order: a data set's order is the names'.
    for value, name in [(30, "b_2"), (10, "a_1"), (20, "b_10")]:
        write_image(tmp_path / f"{name}-left.png", grey(value))
        write_image(tmp_path / f"{name}-right.png", grey(value + 1))
        write_disparity(tmp_path / f"{name}-disparity.png", [1.5, N, value], [2, 3, 4])
    (tmp_path / "notes-left.txt").write_text("no image")
    return tmp_path


@pytest.fixture
def kitti2015(tmp_path):
    training = tmp_path / "training"
    for frame in ("000001_10", "000000_10", "000000_11"):
        write_image(training / "image_2" / f"{frame}.png", grey(1))
        write_image(training / "image_3" / f"{frame}.png", grey(2))
    for frame in ("000001_10", "000000_10"):
        write_disparity(training / "disp_occ_0" / f"{frame}.png", [1, 2, N], [4, 5, 6])
        write_disparity(training / "disp_noc_0" / f"{frame}.png", [1, N, N], [4, 5, N])
    return tmp_path


def scene(folder, ndisp=70):
    write_image(folder / "im0.png", grey(1))
    write_image(folder / "im1.png", grey(2))
    write_disparity(folder / "disp0GT.pfm", [1.25, N, 3], [4, 5, 6])
    write_image(folder / "mask0nocc.png", np.array([[255, 0, 128], [255, 255, 128]], np.uint8))
    (folder / "calib.txt").write_text(
        "cam0=[1000 0 1.5; 0 1000 1; 0 0 1]\ncam1=[1000 0 31.5; 0 1000 1; 0 0 1]\ndoffs=30\nbaseline=200\n"
        f"width=3\nheight=2\nndisp={ndisp}\n"
    )


@pytest.fixture
def middlebury(tmp_path):
    scene(tmp_path / "trainingQ" / "Teddy")
    scene(tmp_path / "trainingQ" / "ArtL", ndisp=64)
    return tmp_path


class TestDrivingStereo:
    def test_samples(self, drivingstereo):
        found = datasets.open(drivingstereo)
        assert found.name == "DrivingStereo"
        assert found.folder == drivingstereo
        assert [s.name for s in found] == ["a_1", "b_10", "b_2"]
        pair = found[1].pair()
        assert (pair.name, pair.left[0, 0], pair.right[0, 0], pair.calibration) == ("b_10", 20, 21, None)
        np.testing.assert_array_equal(found[1].truth(), np.array([[1.5, N, 20], [2, 3, 4]], np.float32))
        assert found[1].mask() is None
        assert found[1].calibration() is None

    def test_jpeg(self, tmp_path):
        for side in ("left", "right"):
            write_image(tmp_path / f"x-{side}.jpg", grey(90, (8, 8)))
        (sample,) = datasets.open(tmp_path)
        assert sample.name == "x"
        assert sample.pair().left.shape[:2] == (8, 8)
        assert sample.truth() is None

    def test_a_left_view_alone(self, drivingstereo):
        """It is listed, and fails when it is read; where no pair is complete there is no data set."""
        (drivingstereo / "a_1-right.png").unlink()
        found = datasets.open(drivingstereo)
        assert [s.name for s in found] == ["a_1", "b_10", "b_2"]
        with pytest.raises(FileNotFoundError, match=r"a_1-right\.png"):
            found[0].pair()
        for file in drivingstereo.glob("*-right.png"):
            file.unlink()
        with pytest.raises(ValueError, match=r"a_1-left\.png has no right view: .*a_1-right\.png is missing"):
            datasets.open(drivingstereo)

    def test_a_right_view_alone(self, drivingstereo):
        (drivingstereo / "a_1-left.png").unlink()
        found = datasets.open(drivingstereo)
        assert [s.name for s in found] == ["a_1", "b_10", "b_2"]
        with pytest.raises(FileNotFoundError, match=r"a_1-left\.png"):
            found[0].pair()
        for file in drivingstereo.glob("*-left.png"):
            file.unlink()
        with pytest.raises(ValueError, match=r"a_1-right\.png has no left view: .*a_1-left\.png is missing"):
            datasets.open(drivingstereo)

    def test_links_that_lead_nowhere(self, drivingstereo):
        """They are broken files, not files that are not there."""
        for name in ("a_1-left.png", "b_2-right.png"):
            (drivingstereo / name).unlink()
            try:
                (drivingstereo / name).symlink_to(name)
            except OSError:
                pytest.skip("no links here")
        first, second, third = datasets.open(drivingstereo)
        for sample in (first, third):
            with pytest.raises(OSError, match=sample.name):
                sample.pair()
        assert second.pair().name == "b_10"


class TestKitti2015:
    @pytest.mark.parametrize("inside", ["", "training"])
    def test_samples(self, kitti2015, inside):
        found = datasets.open(kitti2015 / inside)
        assert found.name == "KITTI 2015"
        assert [s.name for s in found] == ["000000_10", "000001_10"]  # and not the second frames
        pair = found[0].pair()
        assert (pair.left[0, 0], pair.right[0, 0]) == (1, 2)
        np.testing.assert_array_equal(found[0].truth(), np.array([[1, 2, N], [4, 5, 6]], np.float32))
        np.testing.assert_array_equal(found[0].mask(), [[True, False, False], [True, True, False]])

    def test_calibration(self, kitti2015):
        file = kitti2015 / "training" / "calib_cam_to_cam" / "000001.txt"
        file.parent.mkdir()
        file.write_text(
            "P_rect_02: 700 0 1.5 35 0 700 1 0 0 0 1 0\nP_rect_03: 700 0 1.5 -343 0 700 1 0 0 0 1 0\n"
        )
        without, with_one = datasets.open(kitti2015)
        assert without.calibration() is None
        assert with_one.calibration().baseline == pytest.approx(378 / 700)
        assert with_one.pair().calibration == with_one.calibration()

    def test_visible_truth_alone_is_the_truth(self, kitti2015):
        (kitti2015 / "training" / "disp_occ_0" / "000001_10.png").unlink()
        sample = datasets.open(kitti2015)[1]
        np.testing.assert_array_equal(sample.truth(), np.array([[1, N, N], [4, 5, N]], np.float32))
        assert sample.mask() is None

    def test_without_truth(self, kitti2015):
        (kitti2015 / "training").rename(kitti2015 / "testing")
        for file in (kitti2015 / "testing").glob("disp_*/*"):
            file.unlink()
        sample = datasets.open(kitti2015 / "testing")[0]
        assert sample.truth() is None
        assert sample.mask() is None

    def test_a_view_alone(self, kitti2015):
        (kitti2015 / "training" / "image_3" / "000001_10.png").unlink()
        found = datasets.open(kitti2015)
        assert [s.name for s in found] == ["000000_10", "000001_10"]
        with pytest.raises(FileNotFoundError, match=r"image_3.000001_10\.png"):
            found[1].pair()
        (kitti2015 / "training" / "image_2" / "000000_10.png").unlink()
        with pytest.raises(ValueError, match=r"image_3.000000_10\.png has no left view"):
            datasets.open(kitti2015)


class TestMiddlebury:
    @pytest.mark.parametrize("inside", ["", "trainingQ"])
    def test_samples(self, middlebury, inside):
        found = datasets.open(middlebury / inside)
        assert found.name == "Middlebury v3"
        assert [s.name for s in found] == ["ArtL", "Teddy"]
        sample = found[0]
        np.testing.assert_array_equal(sample.truth(), np.array([[1.25, N, 3], [4, 5, 6]], np.float32))
        mask = sample.mask()
        assert mask.dtype == bool
        np.testing.assert_array_equal(mask, [[True, False, False], [True, True, False]])
        assert (sample.calibration().ndisp, sample.calibration().doffs) == (64, 30)
        pair = sample.pair()
        assert (pair.name, pair.calibration) == ("ArtL", sample.calibration())

    def test_scores_non_occluded(self, middlebury):
        sample = datasets.open(middlebury)[0]
        disparity = np.array([[1.25, 2, N], [4, 6, N]], np.float32)
        scores = evaluate(disparity, sample.truth(), sample.mask())
        assert (scores.known, scores.answered, scores.own.bad_0_5) == (3, 3, 1 / 3)

    def test_views_alone(self, tmp_path):
        for side in (0, 1):
            write_image(tmp_path / "Scene" / f"im{side}.png", grey(1))
        (sample,) = datasets.open(tmp_path)
        assert (sample.truth(), sample.mask(), sample.calibration()) == (None, None, None)

    def test_two_sizes(self, middlebury):
        scene(middlebury / "trainingH" / "Teddy")
        with pytest.raises(ValueError, match="holds trainingH, trainingQ: open one of them"):
            datasets.open(middlebury)
        assert len(datasets.open(middlebury / "trainingH")) == 1

    def test_a_colour_mask(self, middlebury):
        write_image(middlebury / "trainingQ" / "ArtL" / "mask0nocc.png", grey(255, (2, 3, 3)))
        with pytest.raises(ValueError, match=r"mask0nocc\.png must be a grey mask"):
            datasets.open(middlebury)[0].mask()


class TestOpen:
    def test_says_what_it_looked_for(self, tmp_path):
        (tmp_path / "readme.txt").write_text("nothing")
        with pytest.raises(ValueError, match="holds no benchmark") as refusal:
            datasets.open(tmp_path)
        text = str(refusal.value)
        assert text.startswith(str(tmp_path))
        named = [line.partition(":")[0].strip() for line in text.splitlines()[1:]]
        assert named == [
            "DrivingStereo",
            "KITTI 2015",
            "KITTI 2012",
            "Argoverse stereo",
            "Scene Flow",
            "Virtual KITTI 2",
            "MPI Sintel",
            "ETH3D",
            "Middlebury 2014/2021",
            "Middlebury v3",
            "Middlebury 2005/2006",
            "Middlebury 2001/2003",
            "left and right",
            "Falling Things",
            "InStereo2K",
            "table",
        ]
        for word in ("-left.jpg", "image_2", "im0.png", "left.png", ".parquet"):
            assert word in text

    @pytest.mark.parametrize("name", ["missing", "file.txt"])
    def test_no_folder(self, tmp_path, name):
        (tmp_path / "file.txt").write_text("")
        with pytest.raises(
            ValueError, match=rf"must be a folder, or a \.csv or \.parquet file, and .*{name} is not one"
        ):
            datasets.open(tmp_path / name)

    def test_reads_nothing_before_it_is_asked(self, drivingstereo):
        (drivingstereo / "a_1-left.png").write_bytes(b"no image")
        found = datasets.open(str(drivingstereo))
        assert len(found) == 3
        with pytest.raises(ValueError, match=r"a_1-left\.png"):
            found[0].pair()

    def test_is_a_sequence(self, drivingstereo):
        found = datasets.open(drivingstereo)
        assert found[-1].name == "b_2"
        assert found[:2] == (found[0], found[1])
        assert next(reversed(found)) in found

    def test_samples_travel_to_other_processes(self, kitti2015):
        found = datasets.open(kitti2015)
        back = pickle.loads(pickle.dumps(found))
        assert [s.name for s in back] == [s.name for s in found]
        np.testing.assert_array_equal(back[0].mask(), found[0].mask())


@pytest.mark.parametrize(
    ("folder", "name", "least"),
    [
        ("drivingstereo", "DrivingStereo", 0.1),
        ("kitti2015", "KITTI 2015", 0.1),
        ("middlebury-v3", "Middlebury v3", 0.5),
    ],
)
def test_real_data(folder, name, least):
    if not (DATA / folder).is_dir():
        pytest.skip(f"{DATA / folder} is not here")
    found = datasets.open(DATA / folder)
    assert found.name == name
    assert [s.name for s in found] == sorted(s.name for s in found)
    sample = found[0]
    pair, truth = sample.pair(), sample.truth()
    assert pair.left.shape[:2] == truth.shape
    assert truth.dtype == np.float32
    scores = evaluate(truth, truth, sample.mask())
    assert least < scores.known / truth.size < 1
    assert (scores.density, scores.own.epe, scores.filled.rmse) == (1, 0, 0)
