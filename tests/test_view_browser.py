"""The page in a real browser: what a person does with it, and what they then see."""

from __future__ import annotations

import base64
import csv
import io
import os
import re
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

import stereopsis as st

if os.environ.get("STEREOPSIS_NO_BROWSER"):
    pytest.skip("STEREOPSIS_NO_BROWSER is set", allow_module_level=True)

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, ConsoleMessage, Locator, Page, expect

from view_browser import MissingBrowserError, chromium, served
from view_help import busy

PATIENCE = 60_000  # milliseconds, for a machine that is busy with something else
expect.set_options(timeout=PATIENCE)


@dataclass(frozen=True)
class Served:
    """A page that is served, and the street behind it."""

    address: str
    scene: Any = None
    folder: Path | None = None


def written(folder: Path, name: str, scene: Any, suffix: str = "png") -> list[Path]:
    """A street's files: left, right, truth, calibration."""
    files = [
        folder / f"{name}-{part}" for part in (f"left.{suffix}", f"right.{suffix}", "truth.pfm", "calib.txt")
    ]
    st.write_image(files[0], scene.left)
    st.write_image(files[1], scene.right)
    st.write_disparity(files[2], scene.disparity)
    st.io.write_calibration(files[3], scene.calibration)
    return files


def small(seed: int = 0, **more: Any) -> Any:
    return st.scenes.street(240, 120, seed, samples=1, **more)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    try:
        with chromium() as browser:
            yield browser
    except MissingBrowserError as error:
        pytest.fail(f"{error}, or leave these tests out with STEREOPSIS_NO_BROWSER=1")


@pytest.fixture(scope="module")
def street() -> Iterator[Served]:
    with served() as address:
        yield Served(address, st.scenes.street())


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder, scene = tmp_path_factory.mktemp("pair"), small()
    left, right, truth, calibration = written(folder, "town", scene)
    with served(left, right, "--truth", truth, "--calibration", calibration) as address:
        yield Served(address, scene, folder)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder = tmp_path_factory.mktemp("dataset")
    for seed in range(3):
        scene = small(seed)
        st.write_image(folder / f"town{seed}-left.png", scene.left)
        st.write_image(folder / f"town{seed}-right.png", scene.right)
        st.write_disparity(folder / f"town{seed}-disparity.png", scene.disparity)
    with served(folder) as address:
        yield Served(address, None, folder)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder = tmp_path_factory.mktemp("results")
    (folder / "disparity").mkdir()
    rows = []
    for seed, error in enumerate((0.9, 0.2, 1.5)):
        st.write_disparity(folder / "disparity" / f"town{seed}.pfm", small(seed).disparity)
        rows.append({"name": f"town{seed}", "epe": error, "d1": error / 100})
    with (folder / "results.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, ["name", "epe", "d1"])
        table.writeheader()
        table.writerows(rows)
    with served(folder) as address:
        yield Served(address, None, folder)


@pytest.fixture
def visit(browser: Browser) -> Iterator[Callable[..., Page]]:
    """Opens pages; at the end, none may have complained, nor asked for anything elsewhere."""
    pages, complaints = [], []

    def heard(message: ConsoleMessage) -> None:
        # The browser's own: each answer that refuses something; what WebGL costs without a card.
        own = ("Failed to load resource", "GPU stall due to ReadPixels")
        if message.type in ("error", "warning") and not any(text in message.text for text in own):
            complaints.append(f"{message.text} {message.location}")

    def opened(address: str, hash: str = "", width: int = 1440, height: int = 900, **more: Any) -> Page:
        page = browser.new_page(viewport={"width": width, "height": height}, **more)
        pages.append(page)
        page.set_default_timeout(PATIENCE)
        host = address.partition("#")[0]
        page.on("console", heard)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on(
            "request",
            lambda request: (
                request.url.startswith((host, "blob:", "data:")) or complaints.append(request.url)
            ),
        )
        page.goto(address + hash)
        expect(page.locator("html[data-ready]")).to_be_attached()
        return page

    yield opened
    for page in pages:
        page.close()
    assert complaints == []


def wait_for_result(page: Page, before: str | None = None) -> str:
    """The result that is shown with all that is told of it, once it is another one than before."""
    page.wait_for_function(
        """before => {
          const {result, told} = document.documentElement.dataset;
          return result && result === told && result !== before;
        }""",
        arg=before,
    )
    found = page.locator("html").get_attribute("data-result")
    assert found is not None
    return found


def eventually(holds: Callable[[], bool]) -> None:
    """Wait until something holds."""
    end = time.monotonic() + PATIENCE / 1000
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.1)


def seen(of: Locator) -> npt.NDArray[np.uint8]:
    """What an element looks like on the screen."""
    with Image.open(io.BytesIO(of.screenshot())) as picture:
        return np.asarray(picture.convert("RGB"))


def drop(page: Page, files: dict[str, bytes]) -> None:
    """Drop files on the page."""
    listed = [[name, base64.b64encode(data).decode()] for name, data in files.items()]
    page.evaluate(
        """(files) => {
          const carried = new DataTransfer();
          for (const [name, data] of files)
            carried.items.add(new File([Uint8Array.from(atob(data), (c) => c.charCodeAt(0))], name));
          const event = {dataTransfer: carried, bubbles: true, cancelable: true};
          for (const type of ["dragenter", "dragover", "drop"])
            document.body.dispatchEvent(new DragEvent(type, event));
        }""",
        listed,
    )


def value(page: Page, name: str) -> str:
    return page.locator(f'#readout dd[data-name="{name}"]').inner_text()


def number(page: Page, name: str) -> float:
    text = value(page, name).split()[0].replace("\N{MINUS SIGN}", "-")
    return float("nan") if text == "\N{EN DASH}" else float(text)


def point(page: Page, x: int, y: int, width: int, height: int) -> tuple[float, float]:
    """Where a pixel of the picture lies on the screen while the picture fits."""
    box = page.locator(".pane.first").bounding_box()
    assert box is not None
    scale = min(box["width"] / width, box["height"] / height)
    return (
        box["x"] + box["width"] / 2 + (x + 0.5 - width / 2) * scale,
        box["y"] + box["height"] / 2 + (y + 0.5 - height / 2) * scale,
    )


def hover(page: Page, x: int, y: int, width: int, height: int) -> None:
    """Read a pixel, wherever it lies by now."""

    def reads() -> bool:
        page.mouse.move(*point(page, x, y, width, height))
        return value(page, "xy") == f"{x}, {y}"

    eventually(reads)


def test_the_street_opens(visit: Callable[..., Page], street: Served) -> None:
    page = visit(street.address)
    wait_for_result(page)
    expect(page.locator("#scene")).to_contain_text(re.compile("880 . 400"))
    expect(page.locator("#summary")).to_contain_text("disparities")
    expect(page.locator("#scores table")).to_be_visible()
    expect(page.locator(".times")).to_contain_text("match")
    expect(page.locator("#downloads a")).to_have_count(6)
    picture = seen(page.locator("#stage"))
    assert np.unique(picture.reshape(-1, 3), axis=0).shape[0] > 1000


def test_depth_is_offered_of_cameras_that_were_stated(visit: Callable[..., Page], tmp_path: Path) -> None:
    left, right, _, calibration = written(tmp_path, "town", small(5))
    for stated, links in (((), 5), (("--calibration", calibration), 6)):
        with served(left, right, *stated) as address:
            page = visit(address)
            wait_for_result(page)
            expect(page.locator("#downloads a")).to_have_count(links)
            expect(page.locator("#downloads").get_by_role("link", name="Depth")).to_have_count(links - 5)


def test_a_pair_opens(visit: Callable[..., Page], pair: Served) -> None:
    page = visit(pair.address)
    wait_for_result(page)
    expect(page.locator("#scene")).to_contain_text(re.compile("240 . 120"))
    expect(page.locator("#scores")).to_contain_text("EPE")


def test_a_map_opens(visit: Callable[..., Page], pair: Served, tmp_path: Path) -> None:
    scene = pair.scene
    left, _, _, calibration = written(tmp_path, "town", scene)
    st.write_disparity(tmp_path / "out.pfm", scene.disparity)
    with served(tmp_path / "out.pfm", "--left", left, "--calibration", calibration) as address:
        page = visit(address)
        wait_for_result(page)
        expect(page.locator("#controls")).to_be_hidden()
        hover(page, 100, 80, 240, 120)
        assert number(page, "d") == pytest.approx(scene.disparity[80, 100], abs=6e-4)
        assert number(page, "depth") == pytest.approx(
            st.depth(scene.disparity, scene.calibration)[80, 100], abs=6e-3
        )


def test_a_data_set_is_walked_through(visit: Callable[..., Page], dataset: Served) -> None:
    page = visit(dataset.address)
    first = wait_for_result(page)
    names = [f"town{seed}" for seed in range(3)]
    shown = page.locator("#scene strong")
    expect(shown).to_have_text(names[0])
    page.keyboard.press("n")
    expect(shown).to_have_text(names[1])
    second = wait_for_result(page, first)
    page.keyboard.press("p")
    expect(shown).to_have_text(names[0])
    wait_for_result(page, second)
    page.get_by_role("tab", name="Samples").click()
    page.get_by_role("button", name=names[2]).click()
    expect(shown).to_have_text(names[2])
    expect(page.get_by_role("tab", name="Maps")).to_have_attribute("aria-selected", "true")


def test_results_are_sorted_and_opened(visit: Callable[..., Page], results: Served) -> None:
    page = visit(results.address)
    rows = page.locator("#samples tbody tr")
    expect(rows).to_have_count(3)
    heading = page.locator("#samples").get_by_role("button", name="epe")
    heading.click()
    expect(page.locator("#samples thead [aria-sort]")).to_have_attribute("aria-sort", "ascending")
    assert [row.get_attribute("data-name") for row in rows.all()] == ["town1", "town0", "town2"]
    heading.click()
    assert [row.get_attribute("data-name") for row in rows.all()] == ["town2", "town0", "town1"]
    before = wait_for_result(page)
    rows.first.click()
    expect(page.locator("#scene strong")).to_have_text("town2")
    wait_for_result(page, before)


def test_the_swipe_is_dragged_and_moved_by_keys(visit: Callable[..., Page], street: Served) -> None:
    page = visit(street.address, "#first=left&second=truth")
    wait_for_result(page)
    handle = page.get_by_role("slider", name="Where one view ends")
    expect(handle).to_have_attribute("aria-valuenow", "50")
    stage = page.locator("#stage")
    before = seen(stage)
    box, knob = stage.bounding_box(), handle.bounding_box()
    assert box is not None
    assert knob is not None
    page.mouse.move(knob["x"] + knob["width"] / 2, knob["y"] + 60)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.8 * box["width"], knob["y"] + 60, steps=6)
    page.mouse.up()
    expect(handle).to_have_attribute("aria-valuenow", "80")
    after = seen(stage)
    width = after.shape[1]
    # Between the old and the new place of the handle the left image has taken the truth's place.
    assert np.any(
        before[:, int(0.6 * width) : int(0.7 * width)] != after[:, int(0.6 * width) : int(0.7 * width)]
    )
    same = slice(int(0.1 * width), int(0.4 * width))
    # Where the left image was before it still is; the browser may mix its tiles with another rounding.
    assert np.abs(before[:, same].astype(int) - after[:, same]).max() <= 2
    page.mouse.move(5, 5)
    handle.focus()
    for key, says in (
        ("ArrowRight", "82"),
        ("ArrowLeft", "80"),
        ("Home", "0"),
        ("End", "100"),
        ("PageDown", "90"),
    ):
        page.keyboard.press(key)
        expect(handle).to_have_attribute("aria-valuenow", says)


def test_modes_zoom_and_views(visit: Callable[..., Page], pair: Served) -> None:
    page = visit(pair.address)
    wait_for_result(page)
    first, second = page.locator("#first"), page.locator("#second")
    for name in ("right", "confidence", "flags", "truth", "error", "disparity"):
        second.select_option(name)
        expect(page.locator(".pane.second canvas.picture")).to_have_attribute(
            "aria-label", re.compile(name, re.I)
        )
    pictures = {}
    for name in ("left", "right", "disparity", "confidence", "flags", "truth", "error"):
        first.select_option(name)
        expect(page.locator(".pane.first canvas.picture")).to_have_attribute("aria-label", name.capitalize())
        pictures[name] = seen(page.locator("#stage"))[:, :200].tobytes()
    assert len(set(pictures.values())) == len(pictures)
    page.get_by_role("radio", name="Side by side").check()
    boxes = [page.locator(f".pane.{side}").bounding_box() for side in ("first", "second")]
    assert boxes[0] is not None
    assert boxes[1] is not None
    assert (boxes[0]["x"], boxes[0]["y"]) != (boxes[1]["x"], boxes[1]["y"])
    page.mouse.move(boxes[0]["x"] + 50, boxes[0]["y"] + 50)
    page.mouse.wheel(0, -400)
    expect(page.locator("#zoom")).not_to_have_text("100 %")
    page.get_by_role("button", name="Fit").first.click()
    expect(page.locator("#zoom")).to_have_text("100 %")
    page.get_by_role("radio", name="Flicker").check()
    expect(page.locator(".pane.second.away")).to_be_attached()
    expect(page.locator(".pane.first.away")).to_be_attached()


@pytest.mark.parametrize(("first", "second"), [((60, 80), (100, 80)), ((50, 50), (50, 70))])
def test_two_fingers_zoom_about_what_lies_between_them(
    visit: Callable[..., Page], pair: Served, first: tuple[int, int], second: tuple[int, int]
) -> None:
    page = visit(pair.address, has_touch=True)
    wait_for_result(page)
    page.locator("#stage").scroll_into_view_if_needed()
    touch = page.context.new_cdp_session(page)

    def put(kind: str, *fingers: tuple[float, float]) -> None:
        points = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(fingers)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    ends = [point(page, *pixel, 240, 120) for pixel in (first, second)]
    middle = [(a + b) / 2 for a, b in zip(*ends, strict=True)]
    # Twice as far from each other, and all of it 12 to the right and 8 down.
    goals = [tuple(2 * p - m + by for p, m, by in zip(end, middle, (12, 8), strict=True)) for end in ends]
    put("touchStart", ends[0])
    put("touchStart", *ends)
    for part in np.linspace(0, 1, 11)[1:]:
        put(
            "touchMove",
            *[tuple(np.add(a, part * np.subtract(b, a))) for a, b in zip(ends, goals, strict=True)],
        )
    put("touchEnd", goals[0])
    put("touchEnd")
    expect(page.locator("#zoom")).to_have_text("200 %")
    # What lay under each finger still does, and nothing was picked.
    expect(page.locator(".costcurve")).to_have_count(0)
    for goal, pixel in zip(goals, (first, second), strict=True):
        page.mouse.move(*goal)
        expect(page.locator('#readout dd[data-name="xy"]')).to_have_text(f"{pixel[0]}, {pixel[1]}")


def test_the_window_slider_matches_anew(visit: Callable[..., Page], pair: Served) -> None:
    page = visit(pair.address)
    before = wait_for_result(page)
    slider = page.get_by_label("Window, width in pixels")
    expect(slider).to_have_value("13")
    page.get_by_label("Keep the proportion").first.uncheck()
    slider.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    wait_for_result(page, before)
    expect(slider).to_have_value("15")
    expect(page.locator("#repeat")).to_contain_text("window=15x7")
    scene = pair.scene
    disparities = st.estimate_disparities(scene.left, scene.right)
    settings = st.Settings.make("fast", window=(15, 7), disparities=disparities)
    expected = st.match(scene.pair, settings=settings).disparity
    for x, y in ((60, 90), (140, 100), (200, 70)):
        hover(page, x, y, 240, 120)
        assert number(page, "d") == pytest.approx(expected[y, x], abs=6e-4, nan_ok=True)


def test_every_check_can_be_switched(visit: Callable[..., Page], pair: Served) -> None:
    page = visit(pair.address)
    shown = wait_for_result(page)
    for name in (re.compile("Left.right"), "Uniqueness", "Texture", "Speckle"):
        switch = page.get_by_role("switch", name=name)
        for _ in range(2):
            switch.set_checked(not switch.is_checked())
            shown = wait_for_result(page, shown)
    for name in (re.compile("Left.right"), "Speckle"):
        page.get_by_role("switch", name=name).uncheck()
        shown = wait_for_result(page, shown)
    settings = page.locator("#repeat details", has_text="left_right").last.text_content() or ""
    assert 'left_right = "none"' in settings
    assert 'speckle = "none"' in settings
    page.locator("#preset").select_option("balanced")
    wait_for_result(page, shown)
    expect(page.locator("#optimize")).to_have_value("sgm")
    expect(page.locator("#optimize_p2")).to_be_visible()
    expect(page.locator("#alert")).to_be_hidden()


def test_the_read_out_says_what_numpy_says(visit: Callable[..., Page], street: Served) -> None:
    page = visit(street.address)
    wait_for_result(page)
    scene = street.scene
    disparities = st.estimate_disparities(scene.left, scene.right)
    result = st.match(scene.pair, preset="fast", disparities=disparities)
    metres = st.depth(result.disparity, scene.calibration)
    hover(page, 300, 250, 880, 400)
    expect(page.locator('#readout dd[data-name="confidence"]')).to_have_text(re.compile(r"\d"))  # comes last
    invalid = next(
        (x, y) for y, x in np.argwhere(result.flags == st.Flag.MISMATCHED) if 60 < x < 300 and y > 120
    )
    for x, y in ((300, 250), (150, 330), (800, 380), invalid):
        hover(page, x, y, 880, 400)
        assert value(page, "grey").split() == [str(v) for v in scene.left[y, x]]
        assert number(page, "d") == pytest.approx(result.disparity[y, x], abs=6e-4, nan_ok=True)
        assert number(page, "depth") == pytest.approx(metres[y, x], abs=6e-3, nan_ok=True)
        assert number(page, "truth") == pytest.approx(scene.disparity[y, x], abs=6e-4, nan_ok=True)
        error = result.disparity[y, x] - scene.disparity[y, x]
        assert number(page, "error") == pytest.approx(error, abs=6e-4, nan_ok=True)
        if np.isfinite(result.disparity[y, x]):
            assert number(page, "confidence") == pytest.approx(result.confidence[y, x], abs=6e-3)
    assert value(page, "flags") == "mismatched"


def test_a_click_draws_the_cost_curve(visit: Callable[..., Page], street: Served) -> None:
    page = visit(street.address, "#second=right")
    wait_for_result(page)
    before = seen(page.locator("#stage"))
    page.mouse.click(*point(page, 300, 250, 880, 400))
    curves = page.locator(".costcurve")
    expect(curves).to_have_count(2)
    for part in (".costs", ".winner", ".best", ".fit", ".truth"):
        expect(curves.first.locator(part)).to_be_attached()
    said = curves.first.get_attribute("aria-label") or ""
    found = re.search(r"at (\d+) px, refined ([\d.]+) px, truth ([\d.]+) px", said)
    assert found is not None, said
    result = st.match(street.scene.pair, preset="fast")
    assert abs(int(found[1]) - result.disparity[250, 300]) <= 0.5 + 1e-3
    assert float(found[2]) == pytest.approx(result.disparity[250, 300], abs=0.02)
    assert float(found[3]) == pytest.approx(street.scene.disparity[250, 300], abs=6e-4)
    # The epipolar line crosses the right image's half on that pixel's row, and nothing else does.
    box = page.locator(".pane.first").bounding_box()
    assert box is not None
    row = round(point(page, 300, 250, 880, 400)[1] - box["y"])
    changed = (np.abs(seen(page.locator("#stage")).astype(int) - before) > 20).any(axis=2)[:, -200:]
    assert changed[row - 3 : row + 4].any(axis=0).mean() > 0.95
    assert not changed[: row - 6].any()
    assert not changed[row + 7 :].any()


def test_points_and_surface_are_drawn(visit: Callable[..., Page], pair: Served) -> None:
    page = visit(pair.address)
    wait_for_result(page)
    page.get_by_role("tab", name="3-D").click()
    space = page.locator("#space")
    expect(page.locator("#space[data-points]")).to_be_attached()
    density = float(re.search(r"[\d.]+", page.locator("#summary").inner_text())[0])  # type: ignore[index]
    count = int(space.get_attribute("data-points") or 0)
    assert count == pytest.approx(density / 100 * 240 * 120, rel=0.01)

    def drawn() -> npt.NDArray[np.bool_]:
        picture = seen(space).astype(int)
        return np.abs(picture - picture[4, picture.shape[1] // 2]).max(axis=2) > 12

    eventually(lambda: 0.05 < drawn().mean() < 0.9)
    points = drawn()
    box = space.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 200, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 320, box["y"] + 220, steps=4)
    page.mouse.up()
    eventually(lambda: np.mean(drawn() != points) > 0.02)
    page.locator("#shape").select_option("surface")
    eventually(lambda: drawn().mean() > 0.05)
    surface = drawn()
    page.locator("#way").select_option("fly")
    space.locator("canvas").focus()
    page.keyboard.down("s")
    eventually(lambda: np.mean(drawn() != surface) > 0.02)
    page.keyboard.up("s")
    page.locator("#far").fill("0")
    eventually(lambda: drawn().mean() < 0.02)


FLIGHT = """async (flying) => {
  const {Space} = await import("/static/space.js");
  const box = document.createElement("div");
  box.style.width = box.style.height = "200px";
  document.body.replaceChildren(box);
  const space = window.space = new Space(box);
  const [disparity, tints] = [new Float32Array(64).fill(8), new Uint8Array(192).fill(200)];
  const calibration = {focal_length: 8, baseline: 1, cx: 4, cy: 4};
  space.load({width: 8, height: 8, disparity, tints, calibration});
  space.home();
  space.flying = flying;
  box.querySelector("canvas").focus();
}"""


CAMERA = """() => {
  const ahead = space.camera.getWorldDirection(space.orbit.target.clone());
  return [space.camera.position.toArray(), ahead.toArray()];
}"""


@pytest.mark.parametrize("flying", [True, False])
def test_keys_fly_through_the_scene(visit: Callable[..., Page], pair: Served, flying: bool) -> None:
    page = visit(pair.address)
    wait_for_result(page)
    page.goto(f"{pair.address}static/theme.js")  # an empty page that may load the scene's view
    page.evaluate(FLIGHT, flying)

    def camera() -> npt.NDArray[np.float64]:
        return np.array(page.evaluate(CAMERA))

    def travelled(key: str) -> npt.NDArray[np.float64]:
        start = camera()
        page.keyboard.down(key)
        eventually(lambda: bool(np.linalg.norm(camera()[0] - start[0]) > 0.05))
        page.keyboard.up(key)
        end = camera()
        page.wait_for_timeout(200)
        np.testing.assert_array_equal(camera(), end)  # a key that is let go moves nothing
        np.testing.assert_allclose(end[1], start[1], atol=1e-9)  # nor does flying turn
        way: npt.NDArray[np.float64] = (end[0] - start[0]) / np.linalg.norm(end[0] - start[0])
        return way

    ahead, up = camera()[1], np.array([0.0, 1.0, 0.0])
    right = np.cross(ahead, up) / np.linalg.norm(np.cross(ahead, up))
    for key, way in (("w", ahead), ("s", -ahead), ("d", right), ("a", -right), ("e", up), ("q", -up)):
        np.testing.assert_allclose(travelled(key), way, atol=1e-6)
    # An arrow turns: about the scene, or where one stands.
    start = camera()
    page.keyboard.press("ArrowRight")
    eventually(lambda: not np.allclose(camera()[1], start[1]))
    assert np.allclose(camera()[0], start[0]) == flying
    page.keyboard.press("0")
    eventually(lambda: np.allclose(camera()[1], ahead))


def test_a_bad_file_is_refused_in_a_sentence(visit: Callable[..., Page], pair: Served) -> None:
    page = visit(pair.address)
    before = wait_for_result(page)
    drop(page, {"left.png": b"\x89PNG\r\n\x1a\nno picture at all", "right.png": b"nothing"})
    alert = page.get_by_role("alert")
    expect(alert).to_be_visible()
    assert len(alert.inner_text()) > 20
    # The page goes on with what was open.
    page.get_by_label("Window, width in pixels").focus()
    page.keyboard.press("ArrowRight")
    wait_for_result(page, before)
    expect(alert).to_be_hidden()


def test_settings_that_cannot_be_are_refused_in_a_sentence(visit: Callable[..., Page], pair: Served) -> None:
    page = visit(pair.address)
    wait_for_result(page)
    page.locator("summary", has_text="Refining and filling").click()
    page.locator("#slant").select_option("planes")
    page.locator("#cost").select_option("census")
    expect(page.get_by_role("alert")).to_be_visible()
    page.get_by_role("button", name="Reset", exact=True).click()
    expect(page.get_by_role("alert")).to_be_hidden()
    expect(page.locator("#cost")).to_have_value("zncc")


@pytest.mark.parametrize("suffix", ["tif", "png", "pfm"])
def test_dropped_files_of_many_bits_are_matched(
    visit: Callable[..., Page], pair: Served, tmp_path: Path, suffix: str
) -> None:
    page = visit(pair.address)
    wait_for_result(page)
    scene = small(5, gray=True)
    deep = scene.left.astype(np.float32) if suffix == "pfm" else scene.left.astype(np.uint16) * 200
    other = scene.right.astype(np.float32) if suffix == "pfm" else scene.right.astype(np.uint16) * 200
    if suffix == "pfm":
        st.write_disparity(tmp_path / "view_left.pfm", deep)
        st.write_disparity(tmp_path / "view_right.pfm", other)
    else:
        st.write_image(tmp_path / f"view_left.{suffix}", deep)
        st.write_image(tmp_path / f"view_right.{suffix}", other)
    st.write_disparity(tmp_path / "truth.pfm", scene.disparity)
    drop(page, {file.name: file.read_bytes() for file in tmp_path.iterdir()})
    expect(page.locator("#scene")).to_contain_text("32 bit" if suffix == "pfm" else "16 bit")
    expect(page.locator("#scores table")).to_be_visible()
    hover(page, 100, 80, 240, 120)
    assert float(value(page, "grey")) == deep[80, 100]


def test_a_link_shows_the_same(visit: Callable[..., Page], street: Served) -> None:
    page = visit(street.address)
    before = wait_for_result(page)
    page.locator("#first").select_option("truth")
    page.locator("#second").select_option("error")
    page.locator("#stage").focus()
    for _ in range(3):
        page.keyboard.press("+")
    page.keyboard.press("Enter")
    page.get_by_label("Window, width in pixels").focus()
    page.keyboard.press("ArrowRight")
    wait_for_result(page, before)
    expect(page).to_have_url(re.compile("window"))
    zoom, position = page.locator("#zoom").inner_text(), value(page, "xy")
    link = page.url
    assert "#" in link
    other = visit(link)
    wait_for_result(other)
    expect(other.locator("#first")).to_have_value("truth")
    expect(other.locator("#second")).to_have_value("error")
    expect(other.locator("#zoom")).to_have_text(zoom)
    expect(other.get_by_label("Window, width in pixels")).to_have_value("14")
    expect(other.locator('#readout dd[data-name="xy"]')).to_have_text(position)
    expect(other.locator(".costcurve")).to_have_count(2)


def test_everything_is_reached_by_keys(visit: Callable[..., Page], pair: Served) -> None:
    page = visit(pair.address)
    wait_for_result(page)
    page.locator("#stage").focus()
    place = page.locator('#readout dd[data-name="xy"]')
    page.keyboard.press("ArrowRight")
    expect(place).to_have_text("121, 60")
    page.keyboard.press("Shift+ArrowDown")
    expect(place).to_have_text("121, 70")
    page.keyboard.press("Enter")
    expect(page.locator(".costcurve").first).to_be_visible()
    page.get_by_role("tab", name="Maps").focus()
    page.keyboard.press("ArrowRight")
    expect(page.get_by_role("tab", name="3-D")).to_be_focused()
    expect(page.locator("#panel-space")).to_be_visible()
    page.keyboard.press("Home")
    page.keyboard.press("?")
    expect(page.locator("#keys")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.locator("#keys")).to_be_hidden()
    # Tab alone goes through all of it, and where one stands can be seen.
    page.locator("a.skip").focus()
    reached = set()
    for _ in range(90):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.id || document.activeElement.className"))
        width = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
        assert (
            width != "none"
            or reached & {"swipe-handle"}
            or page.evaluate("document.activeElement.type") in ("radio",)
        )
    assert {
        "open",
        "theme",
        "tab-maps",
        "first",
        "second",
        "stage",
        "swipe-handle",
        "fit",
        "preset",
        "cost",
        "window-width",
        "left_right",
    } <= reached


def test_it_is_accessible(visit: Callable[..., Page], street: Served, dataset: Served) -> None:
    found = []
    for address, scheme, width in ((street.address, "light", 1440), (dataset.address, "dark", 390)):
        page = visit(address, "#second=flags&pixel=100,80", width=width, color_scheme=scheme)
        wait_for_result(page)
        page.wait_for_timeout(500)
        tabs = page.get_by_role("tab").all()
        for tab in tabs:
            if not tab.is_visible():
                continue
            tab.click()
            page.wait_for_timeout(150)
            violations = Axe().run(page).response["violations"]
            found += [f"{scheme}: {v['id']}: {v['nodes'][0]['html'][:200]}" for v in violations]
    assert found == []


@pytest.mark.parametrize("width", [390, 1920])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_is_wider_than_the_window(
    visit: Callable[..., Page], dataset: Served, tmp_path: Path, width: int, scheme: str
) -> None:
    page = visit(dataset.address, "#second=error&pixel=100,80", width=width, height=1000, color_scheme=scheme)
    wait_for_result(page)
    expect(page.locator(".costcurve").first).to_be_visible()
    folder = Path(os.environ.get("STEREOPSIS_SCREENSHOTS", tmp_path))
    for tab in ("Maps", "3-D", "Samples"):
        page.get_by_role("tab", name=tab).click()
        page.wait_for_timeout(200)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        file = folder / f"{tab.lower()}-{width}-{scheme}.png"
        page.screenshot(path=file, full_page=width == 390)
        with Image.open(file) as picture:
            assert picture.width == width


def test_a_step_of_the_slider_is_soon_on_the_screen(
    visit: Callable[..., Page], street: Served, capsys: pytest.CaptureFixture[str]
) -> None:
    page = visit(street.address)
    shown = wait_for_result(page)
    slider = page.get_by_label("Window, width in pixels")
    slider.focus()
    page.wait_for_timeout(1000)
    times: list[float] = []
    slowness = busy()
    for _ in range(12):
        page.keyboard.press("ArrowRight")  # a window that was not matched before
        shown = wait_for_result(page, shown)
        page.wait_for_timeout(250)  # as a person would
        times.append(float(page.locator("html").get_attribute("data-latency") or "nan"))
    with capsys.disabled():
        middle = statistics.median(times)
        print(
            f"\nslider to screen: median {middle:.0f} ms, {min(times):.0f} to {max(times):.0f}, "
            f"on a machine where work takes {slowness:.1f} times as long as alone"
        )
    assert min(times) < 150 * slowness


def test_a_dragged_slider_ends_where_it_was_let_go(visit: Callable[..., Page], street: Served) -> None:
    page = visit(street.address)
    wait_for_result(page)
    slider = page.get_by_label("Window, width in pixels")
    box = slider.bounding_box()
    assert box is not None
    page.get_by_label("Keep the proportion").first.uncheck()
    page.mouse.move(box["x"] + 20, box["y"] + box["height"] / 2)
    slider.evaluate(
        "slider => { window.seen = []; setInterval(() => window.seen.push(Number(slider.value)), 1) }"
    )
    page.mouse.down()
    for step in range(40):
        page.mouse.move(box["x"] + 20 + 3 * step, box["y"] + box["height"] / 2)
        page.wait_for_timeout(10)
    page.mouse.up()
    wanted = slider.input_value()
    expect(page.locator("html.busy")).to_have_count(0)
    time.sleep(0.3)
    expect(page.locator("#repeat")).to_contain_text(re.compile(rf"window={wanted}x\d+"))
    expect(slider).to_have_value(wanted)
    seen = page.evaluate("window.seen")
    # Results of where it was before do not put it back.
    assert seen[seen.index(min(seen)) :] == sorted(seen[seen.index(min(seen)) :])
    expect(page.locator("#alert")).to_be_hidden()


def test_files_are_chosen_and_the_result_is_taken_away(
    visit: Callable[..., Page], pair: Served, tmp_path: Path
) -> None:
    page = visit(pair.address)
    before = wait_for_result(page)
    left, right, _, calibration = written(tmp_path, "other", small(7))
    page.get_by_role("button", name="Open files").click()
    dialog = page.locator("#files")
    for label, file in (("Left image", left), ("Right image", right), ("Calibration", calibration)):
        dialog.get_by_label(label).set_input_files(file)
    dialog.get_by_role("button", name="Open", exact=True).click()
    wait_for_result(page, before)
    expect(page.locator("#scores")).to_contain_text("No truth is known")
    with page.expect_download() as download:
        page.locator("#downloads").get_by_role("link", name="PFM").click()
    download.value.save_as(tmp_path / "map.pfm")
    disparity = st.read_disparity(tmp_path / "map.pfm")
    hover(page, 60, 90, 240, 120)
    assert number(page, "d") == pytest.approx(disparity[90, 60], abs=6e-4, nan_ok=True)
    with page.expect_download() as download:
        page.get_by_role("button", name="This view").click()
    with Image.open(download.value.path()) as picture:
        assert picture.width >= 240
    expect(page.locator("#repeat")).to_contain_text("stereopsis match")
