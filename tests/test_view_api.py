"""What the page asks and what it is answered, compared with the library itself."""

from __future__ import annotations

import asyncio
import base64
import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

import stereopsis as st
from stereopsis.colormaps import FLAG_COLOURS, VIRIDIS
from stereopsis.view import Target, street
from stereopsis.view.limits import Limits
from stereopsis.view.sources import Street
from stereopsis.view.targets import Entry
from view_help import Server, problem, serving

WIDTH, HEIGHT = 160, 80


@pytest.fixture(scope="module")
def scene() -> st.scenes.Scene:
    return st.scenes.street(WIDTH, HEIGHT, 0)


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with serving(street(WIDTH, HEIGHT, 0)) as running:
        yield running


@pytest.fixture(scope="module")
def opened(server: Server) -> dict[str, Any]:
    return server.open()


@pytest.fixture(scope="module")
def result(server: Server, opened: dict[str, Any]) -> dict[str, Any]:
    return server.match(opened, preset="fast", disparities=[0, 24])


def test_what_is_looked_at_and_what_can_be_chosen(server: Server) -> None:
    info = server.good(server.get("/api/info"))
    assert info["kind"] == "scene"
    assert info["presets"] == list(st.PRESETS)
    assert info["defaults"] == {"preset": "fast"}
    assert {flag["name"]: flag["bit"] for flag in info["flags"]} == {
        str(flag.name).lower().replace("_", " "): int(flag) for flag in st.Flag
    }
    assert [tuple(flag["colour"]) for flag in info["flags"]] == [FLAG_COLOURS[flag] for flag in st.Flag]
    assert base64.b64decode(info["colormaps"]["viridis"]) == VIRIDIS.tobytes()
    solvers = {solver["name"]: solver["fields"] for solver in info["optimizers"]}
    assert solvers["sgm"]["optimize_paths"] == st.SGM().paths
    assert solvers["icm"]["smoothness_weight"] == st.ICM().smoothness.weight
    costs = {cost["name"]: cost["fields"] for cost in info["costs"]}
    assert costs["zncc"] == {"window": [21, 21]}
    assert costs["census"]["window"] == [9, 7]
    assert costs["combined"]["a"]["name"] == "census"
    samples = server.good(server.get("/api/samples"))
    assert samples == {"samples": [{"name": "street", "has_truth": True, "values": {}}], "columns": []}


def test_a_scene_is_described_as_it_is(opened: dict[str, Any], scene: st.scenes.Scene) -> None:
    camera = scene.calibration
    assert opened["calibration"] == {
        "focal_length": camera.focal,
        "baseline": camera.baseline,
        "doffs": 0.0,
        "cx": camera.cx,
        "cy": camera.cy,
        "stated": True,
    }
    expected = {"width": WIDTH, "height": HEIGHT, "channels": 3, "bits": 8, "dtype": "uint8"}
    assert {name: opened[name] for name in expected} == expected
    assert (opened["has_left"], opened["has_right"], opened["has_truth"]) == (True, True, True)
    assert opened["disparities"] == list(st.estimate_disparities(scene.left, scene.right))


def test_a_scene_opened_twice_is_the_same(server: Server, opened: dict[str, Any]) -> None:
    assert server.open() == opened


@pytest.mark.parametrize("side", ["left", "right"])
def test_images_arrive_as_they_are(
    server: Server, opened: dict[str, Any], scene: st.scenes.Scene, side: str, tmp_path: Path
) -> None:
    image = getattr(scene, side)
    raw = server.get(f"/api/scenes/{opened['scene']}/{side}.bin")
    assert np.array_equal(np.frombuffer(raw.content, np.uint8).reshape(image.shape), image)
    assert "immutable" in raw.headers["cache-control"]
    shown = server.get(f"/api/scenes/{opened['scene']}/{side}.png")
    (tmp_path / "shown.png").write_bytes(shown.content)
    assert np.array_equal(st.read_image(tmp_path / "shown.png"), image)
    assert shown.headers["content-type"] == "image/png"


def test_truth_arrives_as_it_is(server: Server, opened: dict[str, Any], scene: st.scenes.Scene) -> None:
    raw = server.get(f"/api/scenes/{opened['scene']}/truth.bin").content
    assert np.array_equal(
        np.frombuffer(raw, np.float32).reshape(HEIGHT, WIDTH), scene.disparity, equal_nan=True
    )


def test_a_match_is_the_librarys(server: Server, result: dict[str, Any], scene: st.scenes.Scene) -> None:
    own = st.match(scene.pair, preset="fast", disparities=(0, 24))
    assert np.array_equal(server.array(result, "disparity"), own.disparity, equal_nan=True)
    assert np.array_equal(server.array(result, "confidence"), own.confidence)
    assert np.array_equal(server.array(result, "flags"), own.flags)
    error = server.array(result, "error")
    assert np.array_equal(error, own.disparity - scene.disparity, equal_nan=True)
    assert result["scores"] == st.evaluate(own.disparity, scene.disparity).to_dict()
    assert result["density"] == own.density
    assert result["path"] == "streaming"
    assert result["disparities"] == [0, 24]
    assert set(result["arrays"]) == {"disparity", "confidence", "flags", "error"}
    assert set(result["stages"]) >= {"match", "median"}
    assert 0 < result["seconds"] < 60


def test_the_range_is_estimated_where_none_is_asked_for(
    server: Server, opened: dict[str, Any], scene: st.scenes.Scene
) -> None:
    found = server.match(opened)
    own = st.match(scene.pair)
    assert found["disparities"] == list(own.settings.disparities or ())
    assert np.array_equal(server.array(found, "disparity"), own.disparity, equal_nan=True)


def test_the_same_question_is_answered_from_memory(
    server: Server, opened: dict[str, Any], result: dict[str, Any]
) -> None:
    again = server.match(opened, preset="fast", disparities=[0, 24], cost={"name": "zncc", "window": [13, 7]})
    assert again == result


def test_files_are_those_of_the_library(
    server: Server, result: dict[str, Any], scene: st.scenes.Scene, tmp_path: Path
) -> None:
    own = st.match(scene.pair, preset="fast", disparities=(0, 24))
    for name in ("disparity.png", "disparity.pfm", "preview.png", "depth.png", "points.ply"):
        answer = server.get(f"/api/results/{result['result']}/download/{name}")
        st.io.write_output(tmp_path / name, own.disparity, image=scene.left, calibration=scene.calibration)
        assert answer.content == (tmp_path / name).read_bytes(), name
        assert answer.headers["content-disposition"] == f'attachment; filename="{name}"'
    toml = server.get(f"/api/results/{result['result']}/download/settings.toml").text
    assert toml == result["toml"]
    assert tomllib.loads(toml)["disparities"] == [0, 24]


def _sent(**files: bytes) -> dict[str, tuple[str, bytes]]:
    return {part: (f"{part}.png", data) for part, data in files.items()}


def _bytes(name: str, array: Any, folder: Path) -> bytes:
    path = folder / name
    (st.write_disparity if array.dtype == np.float32 else st.write_image)(path, array)
    return path.read_bytes()


@pytest.mark.parametrize(("dtype", "suffix"), [(np.uint8, "png"), (np.uint16, "png"), (np.uint16, "tif")])
def test_files_that_are_sent_are_opened(
    server: Server, tmp_path: Path, dtype: type, suffix: str, scene: st.scenes.Scene
) -> None:
    scale = 1 if dtype == np.uint8 else 16
    left, right = ((image[..., 0].astype(dtype) * scale) for image in (scene.left, scene.right))
    files = _sent(
        left=_bytes(f"a.{suffix}", left, tmp_path),
        right=_bytes(f"b.{suffix}", right, tmp_path),
        truth=_bytes("t.pfm", scene.disparity, tmp_path),
    )
    opened = server.good(server.post("/api/open", files=files))
    assert (opened["channels"], opened["dtype"], opened["name"]) == (1, np.dtype(dtype).name, "left")
    assert opened["calibration"]["stated"] is False
    assert opened["calibration"]["cx"] == (WIDTH - 1) / 2
    found = server.match(opened, preset="fast", disparities=[0, 24])
    own = st.match(left, right, preset="fast", disparities=(0, 24))
    assert np.array_equal(server.array(found, "disparity"), own.disparity, equal_nan=True)
    assert found["scores"] == st.evaluate(own.disparity, scene.disparity).to_dict()
    assert "stereopsis match left.png right.png" in found["command"]


def test_a_calibration_that_is_sent_is_the_scenes(
    server: Server, tmp_path: Path, scene: st.scenes.Scene
) -> None:
    st.io.write_calibration(tmp_path / "calib.txt", scene.calibration)
    files = _sent(
        left=_bytes("a.png", scene.left, tmp_path),
        right=_bytes("b.png", scene.right, tmp_path),
        calibration=(tmp_path / "calib.txt").read_bytes(),
    )
    camera = server.good(server.post("/api/open", files=files))["calibration"]
    assert camera["stated"] is True
    assert camera["baseline"] == pytest.approx(scene.calibration.baseline)
    files["left"] = ("left.png", _bytes("c.png", scene.left[:-1], tmp_path))
    files["right"] = ("right.png", _bytes("d.png", scene.right[:-1], tmp_path))
    assert "one size" in problem(server.post("/api/open", files=files), 422)
    files["calibration"] = ("calib.txt", b"f = 3")
    assert problem(server.post("/api/open", files=files), 422).startswith("calibration: ")


def test_a_map_that_is_sent_is_a_result(server: Server, tmp_path: Path, scene: st.scenes.Scene) -> None:
    files = _sent(
        left=_bytes("a.png", scene.left, tmp_path),
        disparity=_bytes("d.pfm", scene.disparity, tmp_path),
        truth=_bytes("t.pfm", scene.disparity, tmp_path),
    )
    opened = server.good(server.post("/api/open", files=files))
    assert opened["has_right"] is False
    given = opened["result"]
    assert np.array_equal(server.array(given, "disparity"), scene.disparity, equal_nan=True)
    assert given["scores"]["own"]["epe"] == 0
    assert given["arrays"] == ["disparity", "error"]
    assert given["command"] == given["python"] == given["toml"] == ""
    problem(server.get(f"/api/results/{given['result']}/confidence.bin"), 404)
    assert "opened, not matched" in problem(server.get(f"/api/results/{given['result']}/cost?x=1&y=1"), 422)
    body = {"scene": opened["scene"], "client": "test"}
    assert "no right image" in problem(server.post("/api/match", json=body), 422)


def test_a_map_alone_is_looked_at(server: Server, tmp_path: Path) -> None:
    disparity = np.full((4, 6), np.nan, np.float32)
    disparity[1, 2], disparity[2, 3] = -2.5, 7.0
    files = _sent(disparity=_bytes("d.pfm", disparity, tmp_path))
    opened = server.good(server.post("/api/open", files=files))
    assert (opened["has_left"], opened["width"], opened["height"]) == (False, 6, 4)
    assert opened["disparities"] == [-3, 8]
    problem(server.get(f"/api/scenes/{opened['scene']}/left.png"), 404)
    problem(server.get(f"/api/scenes/{opened['scene']}/left.bin"), 404)
    # KITTI's PNG holds no negative disparity.
    sentence = problem(server.get(f"/api/results/{opened['result']['result']}/download/disparity.png"), 422)
    assert "-2.5 px" in sentence
    assert "/tmp" not in sentence


BROKEN = {
    "nothing": b"",
    "text": b"hello",
    "half a png": None,
    "too large": b"P5 100000 100000 255\n" + b"\0" * 100,
    "bomb": b"PF 16000 16000 -1.0\n" + b"\0" * 100,
}


@pytest.mark.parametrize("kind", BROKEN)
def test_a_bad_file_is_a_sentence(server: Server, tmp_path: Path, kind: str, scene: st.scenes.Scene) -> None:
    good = _bytes("a.png", scene.left, tmp_path)
    bad = BROKEN[kind]
    sentence = problem(server.post("/api/open", files=_sent(left=good[:5000] if bad is None else bad)), 422)
    assert sentence.startswith("left: ")
    assert "stereopsis-view" not in sentence
    server.open()


def test_images_that_differ_are_a_sentence(server: Server, tmp_path: Path, scene: st.scenes.Scene) -> None:
    files = _sent(
        left=_bytes("a.png", scene.left, tmp_path), right=_bytes("b.png", scene.right[:, :-1], tmp_path)
    )
    assert "160 x 80 uint8, 159 x 80 uint8" in problem(server.post("/api/open", files=files), 422)


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({"middle": ("a.png", b"x")}, "may be called"),
        ({"truth": ("a.png", b"x")}, "neither a left image nor"),
    ],
)
def test_files_without_a_place_are_refused(server: Server, files: Any, words: str) -> None:
    assert words in problem(server.post("/api/open", files=files), 422)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"windows": 3}, "unknown setting 'windows'"),
        ({"preset": "fastest"}, "'fast'"),
        ({"cost": {"name": "znc"}}, "cost must be one of"),
        ({"cost": {"name": "zncc", "size": 3}}, "has no size"),
        ({"cost": {"name": "combined"}}, "missing"),
        (
            {"cost": {"name": "combined", "a": {"name": "zncc"}, "weight_a": 1, "b": 1, "weight_b": 1}},
            "a must",
        ),
        ({"window": 1000}, "window"),
        ({"disparities": [0, 5000]}, "up to 1024"),
        ({"disparities": [3, 3]}, "min < max"),
        ({"disparities": "wide"}, "disparities"),
        ({"threads": 64}, "threads is the server's"),
        ({"keep": ["costs"]}, "keep is the server's"),
        ({"optimize": {"name": "sgm", "power": 3}}, "optimize_power"),
        ({"median": 1e400}, "median"),
        ({"speckle": [[[[1]]]]}, "speckle"),
    ],
)
def test_settings_that_are_not_allowed_are_a_sentence(
    server: Server, opened: dict[str, Any], settings: dict[str, Any], words: str
) -> None:
    body = json.dumps({"scene": opened["scene"], "client": "test", "settings": settings})
    headers = {"content-type": "application/json"}
    assert words in problem(server.post("/api/match", content=body, headers=headers), 422)


def test_settings_too_deep_are_refused(server: Server, opened: dict[str, Any]) -> None:
    deep = "[" * 900 + "]" * 900
    body = f'{{"scene": "{opened["scene"]}", "client": "test", "settings": {{"speckle": {deep}}}}}'
    answer = server.post("/api/match", content=body, headers={"content-type": "application/json"})
    problem(answer, 422)
    body = body.replace(deep, "[" * 100_000 + "]" * 100_000)
    answer = server.post("/api/match", content=body, headers={"content-type": "application/json"})
    assert answer.status_code in (400, 422)


@pytest.mark.parametrize(
    ("method", "url", "status"),
    [
        ("GET", "/nothing", 404),
        ("GET", "/api/scenes/0/left.png", 404),
        ("GET", "/api/scenes/0/middle.png", 422),
        ("GET", "/api/results/0/disparity.bin", 404),
        ("GET", "/api/results/0/cost?x=0&y=0", 404),
        ("GET", "/api/results/0/cost?x=-1&y=0", 422),
        ("GET", "/api/results/0/cost", 422),
        ("GET", "/api/results/0/download/passwd", 422),
        ("PUT", "/api/info", 405),
        ("DELETE", "/", 405),
        ("POST", "/api/open", 422),
    ],
)
def test_what_is_not_there_is_a_sentence(server: Server, method: str, url: str, status: int) -> None:
    problem(server.ask(method, url), status)


def test_a_pixel_outside_is_refused(server: Server, result: dict[str, Any]) -> None:
    assert "160 x 80" in problem(server.get(f"/api/results/{result['result']}/cost?x={WIDTH}&y=0"), 422)


def test_what_does_not_fit_is_forgotten_oldest_first() -> None:
    entries = tuple(Entry(str(seed), Street(WIDTH, HEIGHT, seed)) for seed in range(3))
    each = WIDTH * HEIGHT * (3 + 3 + 4)
    limits = Limits(scene_bytes=int(2.5 * each), result_bytes=WIDTH * HEIGHT * 13 * 2)
    with serving(Target("dataset", "streets", entries), limits) as server:
        scenes = [server.open(str(seed)) for seed in range(2)]
        old = server.match(scenes[0], disparities=[0, 16])
        server.match(scenes[1], disparities=[0, 16])
        scenes.append(server.open("2"))
        body = {"scene": scenes[0]["scene"], "client": "test"}
        assert "open it again" in problem(server.post("/api/match", json=body), 404)
        # Its result is kept, but not what has to be looked up in its images.
        assert server.array(old, "disparity").shape == (HEIGHT, WIDTH)
        problem(server.get(f"/api/results/{old['result']}/cost?x=1&y=1"), 404)
        new = [server.match(scene, disparities=[0, 18]) for scene in scenes[1:]]
        problem(server.get(f"/api/results/{old['result']}/disparity.bin"), 404)
        assert server.array(new[1], "disparity").shape == (HEIGHT, WIDTH)
        assert server.open("0")["scene"] == scenes[0]["scene"]


def test_many_ask_for_one_scene_and_it_is_loaded_once() -> None:
    async def scenario(client: httpx.AsyncClient) -> list[httpx.Response]:
        asked = (client.post("/api/open", json={"sample": "street"}) for _ in range(8))
        return list(await asyncio.gather(*asked))

    with serving(street(WIDTH, HEIGHT, 0)) as server:
        loaded = []
        submit = server.session._readers.submit
        server.session._readers.submit = lambda job: loaded.append(job.function) or submit(job)
        found = server.run(scenario)
        assert {answer.status_code for answer in found} == {200}
        assert len({answer.text for answer in found}) == 1
        assert loaded == ["load"]
