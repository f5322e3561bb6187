"""Tables of paths: what they hold, and an error for each way of getting one wrong."""

from __future__ import annotations

import pickle
import re
import sys

import numpy as np
import pytest

from stereopsis import datasets, io


@pytest.fixture
def images(tmp_path):
    for name, value in (("l0", 1), ("r0", 2), ("l1", 3), ("r1", 4)):
        (tmp_path / "images").mkdir(exist_ok=True)
        io.write_image(tmp_path / "images" / f"{name}.png", np.full((2, 3), value, np.uint8))
    io.write_disparity(tmp_path / "truth.pfm", np.array([[1, np.nan, 3], [4, 5, 6]], np.float32))
    io.write_image(tmp_path / "mask.png", np.array([[255, 0, 128], [255, 255, 254]], np.uint8))
    (tmp_path / "calib.txt").write_text("cam0=[9 0 1; 0 9 1; 0 0 1]\ndoffs=0\nbaseline=200\n")
    return tmp_path


def table(folder, *lines, name="pairs.csv"):
    (folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder / name


class TestCsv:
    def test_every_column(self, images):
        file = table(
            images,
            "name,left,right,truth,mask,calibration",
            "z/second,images/l1.png,images/r1.png,,,",
            '"a, first",images/l0.png,images/r0.png,truth.pfm,mask.png,calib.txt',
        )
        found = datasets.open(file)
        assert (found.name, found.folder) == ("table", file)
        assert [sample.name for sample in found] == ["z/second", "a, first"]  # the rows' order
        plain, full = found
        pair = full.pair()
        assert (pair.left[0, 0], pair.right[0, 0], pair.name) == (1, 2, "a, first")
        assert pair.calibration.baseline == pytest.approx(0.2)
        np.testing.assert_array_equal(full.truth(), np.array([[1, np.nan, 3], [4, 5, 6]], np.float32))
        np.testing.assert_array_equal(full.mask(), [[True, False, False], [True, True, False]])
        assert (plain.truth(), plain.mask(), plain.calibration()) == (None, None, None)
        assert pickle.loads(pickle.dumps(found)) == found

    def test_names_from_the_left_views(self, images):
        """Below the table's folder the path, elsewhere the file's name: a name never climbs."""
        away = images / "tables"
        away.mkdir()
        inside = table(images, "left,right", "images/l0.png,images/r0.png", "./images/l1.png,images/r1.png")
        assert [sample.name for sample in datasets.open(inside)] == ["images/l0", "images/l1"]
        outside = table(
            away,
            "left,right",
            "../images/l0.png,../images/r0.png",
            f"{images}/images/l1.png,../images/r1.png",
        )
        found = datasets.open(outside)
        assert [sample.name for sample in found] == ["l0", "l1"]
        assert found[1].pair().left[0, 0] == 3

    def test_a_byte_order_mark_blank_lines_and_spaces(self, images):
        file = images / "pairs.csv"
        file.write_bytes("\ufeffleft , right\r\n\r\n images/l0.png ,images/r0.png\r\n\r\n".encode())
        assert [sample.name for sample in datasets.open(file)] == ["images/l0"]

    @pytest.mark.parametrize(
        ("lines", "message"),
        [
            ([""], "there is no column left; the columns are none"),
            (["left,wright"], "there is no column right; the columns are left, wright"),
            (["left,right,thruth"], "there may be no column 'thruth'; known are left, right, name, truth"),
            (["left,right,left"], "there are two columns left"),
            (["left,right"], "holds no pair: there is no row below its header"),
            (["left,right", "a"], "row 1 has 1 fields, the header 2"),
            (["left,right", "images/l0.png,images/r0.png", "a,b,c"], "row 2 has 3 fields, the header 2"),
            (["left,right", "images/l0.png,"], "row 1, column right: it is empty"),
            (
                ["left,right,name", "images/l0.png,images/r0.png,../../etc/x"],
                r"row 1, column name: '\.\./\.\./etc/x' cannot name a pair",
            ),
            (["left,right,name", "images/l0.png,images/r0.png,/x"], "row 1, column name: '/x' cannot name"),
            (
                ["left,right,name", r"images/l0.png,images/r0.png,..\x"],
                r"row 1, column name: '\.\.\\\\x' cannot name a pair",
            ),
            (
                ["left,right,name", "images/l0.png,images/r0.png,a", "images/l1.png,images/r1.png,a"],
                "row 2, column name: 'a' is the name of row 1 too",
            ),
            (["left,right", '"images/l0.png,images/r0.png'], "unexpected end of data"),
        ],
    )
    def test_errors(self, images, lines, message):
        file = table(images, *lines)
        with pytest.raises(ValueError, match=rf"^{re.escape(str(file))}.*{message}"):
            datasets.open(file)

    def test_files_that_are_missing(self, images):
        """They cost their pair alone; a table of which no pair has both views is refused."""
        head = "name,left,right,truth"
        broken = ["a,no.png,images/r1.png,", f"b,images/l1.png,{'x' * 300}.png,"]
        others = ["c,images/l0.png,images/r0.png,truth.pfm", "d,images/l1.png,images/r1.png,no.pfm"]
        found = datasets.open(table(images, head, *broken, *others))
        for sample in found[:2]:
            with pytest.raises(OSError, match=r"no\.png|xxx\.png"):
                sample.pair()
        assert found[2].truth()[1, 2] == 6
        assert found[3].pair().left[0, 0] == 3
        with pytest.raises(FileNotFoundError, match=r"no\.pfm"):
            found[3].truth()
        with pytest.raises(ValueError, match=r"r1\.png has no left view: .*no\.png is missing; no pair of"):
            datasets.open(table(images, head, *broken))

    def test_not_text(self, images):
        (images / "pairs.csv").write_bytes(b"left,right\n\xff\xfe,b\n")
        with pytest.raises(ValueError, match=r"pairs\.csv: .*UnicodeDecodeError"):
            datasets.open(images / "pairs.csv")


class TestParquet:
    @pytest.fixture
    def parquet(self, images):
        pa = pytest.importorskip("pyarrow")
        from pyarrow import parquet as pq

        def write(**columns):
            pq.write_table(pa.table(columns), images / "pairs.parquet")
            return images / "pairs.parquet"

        return write

    def test_samples(self, parquet):
        found = datasets.open(
            parquet(
                right=["images/r1.png", "images/r0.png"],
                left=["images/l1.png", "images/l0.png"],
                truth=[None, "truth.pfm"],
            )
        )
        assert [sample.name for sample in found] == ["images/l1", "images/l0"]
        assert found[0].truth() is None
        assert found[1].truth()[0, 2] == 3

    def test_errors(self, parquet):
        with pytest.raises(ValueError, match=r"pairs\.parquet: there is no column right"):
            datasets.open(parquet(left=["a"]))
        with pytest.raises(ValueError, match=r"pairs\.parquet: row 1, column left: 3 is not text"):
            datasets.open(parquet(left=[3], right=["b"]))

    def test_damaged(self, images):
        pytest.importorskip("pyarrow")
        (images / "pairs.parquet").write_bytes(b"PAR1 and nothing else")
        with pytest.raises(ValueError, match=r"^.*pairs\.parquet: "):
            datasets.open(images / "pairs.parquet")

    def test_without_pyarrow(self, images, monkeypatch):
        (images / "pairs.parquet").write_bytes(b"PAR1")
        monkeypatch.setitem(sys.modules, "pyarrow", None)
        with pytest.raises(
            ValueError, match=r"Parquet needs pyarrow: install it with .*'stereopsis\[study\]'"
        ):
            datasets.open(images / "pairs.parquet")
