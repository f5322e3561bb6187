"""What the folders of batches and studies, data sets and lone files are opened as."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

import stereopsis as st
from stereopsis.batch import names
from stereopsis.study.plan import Corrected, Study, make
from stereopsis.study.tables import IDENTITY
from stereopsis.view import choice, open_target
from stereopsis.view.runs import _value
from view_help import problem, serving


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    folder = tmp_path / "data"
    folder.mkdir()
    for name, disparity in (("one", 4), ("two", 6)):
        scene = st.scenes.plane(96, 48, disparity=disparity)
        st.write_image(folder / f"{name}-left.png", scene.left)
        st.write_image(folder / f"{name}-right.png", scene.right)
        st.write_disparity(folder / f"{name}-disparity.png", scene.disparity)
    return folder


def _batch(folder: Path, data: str) -> Path:
    (folder / "disparity").mkdir(parents=True)
    for name, value in (("two", 6.5), ("one", 4.0)):
        st.write_disparity(folder / "disparity" / f"{name}.png", np.full((48, 96), value, np.float32))
    rows = 'name,own_epe,all_epe,note\ntwo,0.5,inf,"a, b"\none,0.0,,\nthree,0.1,0.1,x\n'
    (folder / "results.csv").write_text(rows, encoding="utf-8")
    settings = st.PRESETS["fast"].changed(disparities=(0, 16), median=5)
    record = (
        f'[run]\nversion = "0"\n\n[data]\nname = ""\nfolder = {data!r}\n\n[settings]\n{settings.to_toml()}'
    )
    (folder / "run.toml").write_text(record, encoding="utf-8")
    return folder


def test_a_batch_is_its_table_with_the_pairs_it_was_made_from(tmp_path: Path, dataset: Path) -> None:
    target = open_target([_batch(tmp_path / "out", str(dataset))])
    assert (target.kind, target.title) == ("results", "out")
    assert target.columns == ("own_epe", "all_epe", "note")
    assert target.settings == {"preset": "fast", "disparities": (0, 16), "median": 5}
    with serving(target) as server:
        listed = server.get("/api/samples").json()
        assert listed == {
            "samples": [
                {
                    "name": "two",
                    "has_truth": True,
                    "values": {"own_epe": 0.5, "all_epe": None, "note": "a, b"},
                },
                {"name": "one", "has_truth": True, "values": {"own_epe": 0.0, "all_epe": None, "note": None}},
            ],
            "columns": ["own_epe", "all_epe", "note"],
        }
        opened = server.open("two")
        assert (opened["has_left"], opened["has_right"], opened["has_truth"]) == (True, True, True)
        assert opened["result"]["scores"]["own"]["epe"] == 0.5
        again = server.match(opened, **server.get("/api/info").json()["defaults"])
        assert again["disparities"] == [0, 16]
        assert again["scores"]["own"]["epe"] < 0.1
        problem(server.post("/api/open", json={"sample": "three"}), 404)


@pytest.mark.parametrize("data", ["", "/nowhere/at/all", "."])
def test_a_batch_without_its_pairs_is_its_maps(tmp_path: Path, data: str) -> None:
    with serving(open_target([_batch(tmp_path / "out", data)])) as server:
        opened = server.open("one")
        assert (opened["has_left"], opened["has_right"], opened["has_truth"]) == (False, False, False)
        assert opened["result"]["density"] == 1


def test_maps_are_found_by_the_names_that_theirs_stand_for(tmp_path: Path) -> None:
    called = ["town:1", "100 %", "con", "a//b", "dir/one", "plain"]
    for name in called:
        file = tmp_path / "disparity" / f"{names.escaped(name)}.png"
        file.parent.mkdir(parents=True, exist_ok=True)
        st.write_disparity(file, np.full((4, 5), 2, np.float32))
    (tmp_path / "results.csv").write_text("name\n" + "\n".join(called), encoding="utf-8")
    assert [entry.name for entry in open_target([tmp_path]).entries] == called


def test_a_study_is_its_lines_each_with_its_settings(tmp_path: Path) -> None:
    study = Study(scenes=1, size=(96, 48), windows=(5, 9), methods=("ssd",), parts=("sweep",))
    tasks = make(study).tasks
    with (tmp_path / "results.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow([*IDENTITY, "rmse", "density", "known", "sky_rmse"])
        for number, task in enumerate(tasks):
            columns = ("" if value is None else value for value in task.columns().values())
            table.writerow([*columns, number / 2, 1.0, 99, 3])
    (tmp_path / "settings.toml").write_text(study.to_toml(), encoding="utf-8")
    target = open_target([tmp_path])
    assert target.kind == "results"
    assert len(target.entries) == len(tasks)
    assert target.columns == (*IDENTITY, "rmse", "density")
    assert target.entries[1].values["rmse"] == 0.5
    corrected = [task.setting.settings for task in tasks if isinstance(task.setting, Corrected)]
    assert choice.read(dict(target.entries[0].settings or {})) == corrected[0].changed(threads=0)
    with serving(target) as server:
        opened = server.open()
        assert (opened["width"], opened["height"], opened["has_truth"]) == (96, 48, True)
        found = server.match(opened, **opened["settings"])
        own = st.match(st.scenes.street(96, 48, 0).pair, settings=corrected[0])
        assert np.array_equal(server.array(found, "disparity"), own.disparity, equal_nan=True)


def test_a_data_set_is_its_samples(dataset: Path) -> None:
    with serving(open_target([dataset])) as server:
        samples = server.get("/api/samples").json()["samples"]
        assert [sample["name"] for sample in samples] == ["one", "two"]
        first, second = server.open("one"), server.open("two")
        assert first["scene"] != second["scene"]
        truth = server.get(f"/api/scenes/{second['scene']}/truth.bin").content
        assert set(np.frombuffer(truth, np.float32)) == {np.float32(6)}


def test_a_sample_that_changes_on_disk_is_read_anew(dataset: Path) -> None:
    with serving(open_target([dataset])) as server:
        before = server.open("one")
        scene = st.scenes.plane(96, 60, disparity=4)
        for side in ("left", "right"):
            st.write_image(dataset / f"one-{side}.png", getattr(scene, side))
        st.write_disparity(dataset / "one-disparity.png", scene.disparity)
        after = server.open("one")
        assert (before["height"], after["height"]) == (48, 60)
        (dataset / "one-right.png").unlink()
        problem(server.post("/api/open", json={"sample": "one"}), 422)


def test_a_map_with_its_image(tmp_path: Path) -> None:
    scene = st.scenes.plane(96, 48, disparity=4)
    st.write_image(tmp_path / "left.png", scene.left)
    st.write_disparity(tmp_path / "map.pfm", scene.disparity)
    st.io.write_calibration(tmp_path / "calib.txt", scene.calibration)
    target = open_target(
        [tmp_path / "map.pfm"], left=tmp_path / "left.png", calibration=tmp_path / "calib.txt"
    )
    assert (target.kind, target.title) == ("map", "map.pfm")
    with serving(target) as server:
        opened = server.open()
        assert opened["calibration"]["focal_length"] == pytest.approx(scene.calibration.focal)
        assert opened["result"]["density"] == 1
        points = server.get(f"/api/results/{opened['result']['result']}/download/points.ply")
        assert points.content.startswith(b"ply")


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (b"", "no column 'name'"),
        (b"a,b\n1,2\n", "no column 'name'"),
        (b"name\nmissing\n", "names no map"),
        (b"\xff\xfe\x00", "not text"),
        (b'name\n"' + b"x" * 200_000 + b'"\n', "not a table"),
    ],
)
def test_tables_that_are_none_are_a_sentence(tmp_path: Path, table: bytes, words: str) -> None:
    (tmp_path / "results.csv").write_bytes(table)
    with pytest.raises(ValueError, match=words):
        open_target([tmp_path])


@pytest.mark.parametrize("record", ["[", "data = 3\n", "[data]\nfolder = 3\n"])
def test_records_that_are_none(tmp_path: Path, dataset: Path, record: str) -> None:
    out = _batch(tmp_path / "out", str(dataset))
    (out / "run.toml").write_text(record, encoding="utf-8")
    if record == "[":
        with pytest.raises(ValueError, match="not TOML"):
            open_target([out])
    else:
        assert len(open_target([out]).entries) == 2


@pytest.mark.parametrize(
    ("text", "value"), [("1", 1.0), ("-1e3", -1000.0), ("inf", None), ("nan", None), ("", None), ("x", "x")]
)
def test_values_are_numbers_that_json_has(text: str, value: object) -> None:
    assert _value(text) == value
