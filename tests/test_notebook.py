"""What a notebook shows of results and scores: well-formed, self-contained, small, escaped, and right."""

from __future__ import annotations

import base64
import dataclasses
import io
import re
import subprocess
import sys
from html.parser import HTMLParser
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

import stereopsis as st
from stereopsis import colormaps, notebook

NAN = np.nan
VOID = {"img", "rect", "path"}


class Shown(HTMLParser):
    """Checks that every element is closed in order; collects pictures, cells and drawings."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.rows: list[list[str]] = []
        self.numbers: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag in VOID
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[-1][-1] += data
        if self.open and self.open[-1] == "text":
            self.numbers.append(data)

    def picture(self) -> npt.NDArray[np.uint8]:
        """The pixels of the one picture."""
        (given,) = [given for tag, given in self.elements if tag == "img"]
        head, _, body = str(given["src"]).partition(",")
        assert head == "data:image/png;base64"
        with Image.open(io.BytesIO(base64.b64decode(body, validate=True))) as image:
            return np.asarray(image)


def made(disparity: Any, **changes: Any) -> st.Result:
    disparity = np.asarray(disparity, np.float32)
    values: dict[str, Any] = {
        "disparity": disparity,
        "confidence": np.ones(disparity.shape, np.float32),
        "flags": np.zeros(disparity.shape, np.uint8),
        "settings": st.PRESETS["fast"].changed(disparities=(0, 64)),
        "path": "streaming",
        "seconds": 0.25,
    }
    return st.Result(**values | changes)


@pytest.fixture(scope="module")
def result() -> st.Result:
    scene = st.scenes.street(160, 90, seed=2)
    return st.match(scene.pair, preset="fast", disparities=(0, 48))


def test_the_picture_is_the_preview_s(result: st.Result) -> None:
    shown = Shown(result._repr_html_())
    np.testing.assert_array_equal(shown.picture(), st.io.colorize(result.disparity))


def test_the_facts(result: st.Result) -> None:
    rows = dict(Shown(result._repr_html_()).rows)  # type: ignore[arg-type]
    assert list(rows) == ["size", "density", "time", "path", "settings", "flags"]
    assert rows["size"] == "160 x 90 px"
    assert rows["density"] == f"{100 * result.density:.2f} %"
    assert rows["time"].startswith(f"{result.seconds:.3f} s (read {1000 * result.timings['read']:.1f} ms, ")
    assert rows["path"] == "streaming"
    assert rows["settings"].startswith('preset = "fast", disparities = [0, 48], window = [13, 7]')
    assert "slant" not in rows["settings"]
    occluded = np.count_nonzero(result.flags & st.Flag.OCCLUDED)
    assert f"occluded {occluded} ({100 * occluded / 14400:.1f} %)" in rows["flags"]


def test_the_bar_has_the_map_s_colours_and_round_numbers() -> None:
    disparity = np.linspace(0, 100, 400, dtype=np.float32).reshape(4, 100)
    shown = Shown(made(disparity)._repr_html_())
    low, high = colormaps.limits(disparity)
    assert shown.numbers == [text for _, text in colormaps.ticks(low, high)] + ["px"]
    fills = [given["fill"] for tag, given in shown.elements if tag == "rect"]
    assert fills[0] == colormaps.hex_code((68, 1, 84))
    assert fills[-1] == colormaps.hex_code((253, 231, 37))
    # The number 50 stands where the bar has the colour of 50.
    rects = [given for tag, given in shown.elements if tag == "rect"]
    texts = [given for tag, given in shown.elements if tag == "text"]
    at = float(str(texts[shown.numbers.index("40")]["x"]))
    under = max((rect for rect in rects if float(str(rect["x"])) <= at), key=lambda r: float(str(r["x"])))
    (expected,) = colormaps.colours(np.array([40.0]), (low, high))
    found = [int(str(under["fill"])[i : i + 2], 16) for i in (1, 3, 5)]
    assert np.abs(np.array(found) - expected).max() <= 8  # 64 rectangles


def test_nothing_comes_from_elsewhere_and_nothing_is_set_for_the_page(result: st.Result) -> None:
    scores = st.evaluate(result.disparity, np.zeros(result.disparity.shape, np.float32))
    for text in (result._repr_html_(), scores._repr_html_()):
        elements = Shown(text).elements
        assert not {tag for tag, _ in elements} & {"script", "style", "link", "iframe"}
        assert not [given for _, given in elements if "id" in given or "href" in given]
        assert "http" not in text
        assert "url(" not in text
        # Dark text on a dark page, or the other way round, would come of a colour of its own.
        assert not re.search(r"(?<!-)\bcolor:|background:(?!none)", text)
        assert all(given.get("alt") for tag, given in elements if tag == "img")
        assert all(given.get("aria-label") for tag, given in elements if tag == "svg")


@pytest.mark.parametrize(
    "disparity",
    [
        np.full((3, 5), NAN),
        np.full((1, 1), 7),
        np.full((1, 700), 3),
        np.full((700, 1), 3),
        [[1e30, -1e30]],
        [[-0.0, NAN]],
    ],
)
def test_maps_of_nothing_and_of_little(disparity: Any) -> None:
    result = made(disparity)
    shown = Shown(result._repr_html_())
    np.testing.assert_array_equal(shown.picture(), st.io.colorize(result.disparity))
    (given,) = [given for tag, given in shown.elements if tag == "img"]
    assert 1 <= int(str(given["width"])) <= 880
    assert 1 <= int(str(given["height"])) <= 440


def test_an_empty_map_has_no_picture() -> None:
    shown = Shown(made(np.empty((0, 4)))._repr_html_())
    assert not [tag for tag, _ in shown.elements if tag in ("img", "svg")]
    assert shown.rows[0] == ["size", "4 x 0 px"]


def test_noise_stays_small_and_says_what_is_left_out() -> None:
    """Nothing is harder to compress."""
    disparity = np.random.default_rng(1).random((400, 881), np.float32)
    text = made(disparity)._repr_html_()
    assert len(text) < 300_000
    shown = Shown(text)
    (given,) = [given for tag, given in shown.elements if tag == "img"]
    says = re.fullmatch(r"disparity of every (\d)th row and column", str(given["alt"]))
    assert says is not None
    step = int(says[1])
    np.testing.assert_array_equal(
        shown.picture(), st.io.colorize(disparity, colormaps.limits(disparity))[::step, ::step]
    )


def test_a_street_of_common_size_is_shown_whole() -> None:
    scene = st.scenes.street(881, 400, seed=3, noise=1.5)
    result = st.match(scene.pair, preset="fast", disparities=(0, 96))
    text = result._repr_html_()
    assert len(text) < 300_000
    assert Shown(text).picture().shape == (400, 881, 3)


def test_texts_are_escaped() -> None:
    result = made([[1.0]], path="<b>&", timings={"<i>": 1.0})
    text = result._repr_html_()
    assert "<b>" not in text
    assert "<i>" not in text
    rows = dict(Shown(text).rows)  # type: ignore[arg-type]
    assert rows["path"] == "<b>&"
    assert rows["time"] == "0.250 s (<i> 1000.0 ms)"


def test_scores_are_the_table_that_people_read() -> None:
    truth = np.array([[10, 20, NAN, 40]], np.float32)
    scores = st.evaluate(np.array([[10.5, NAN, 7, 44]], np.float32), truth)
    shown = Shown(scores._repr_html_())
    assert shown.rows == [["", "own", "all", "filled"], *map(list, scores.rows())]
    assert "density 66.67 % (2 of 3 known pixels)" in scores._repr_html_()


def test_scores_of_nothing() -> None:
    scores = st.evaluate(np.zeros((2, 2), np.float32), np.full((2, 2), NAN, np.float32))
    text = scores._repr_html_()
    assert "density - (0 of 0 known pixels)" in text
    assert Shown(text).rows[1] == ["pixels", "0", "0", "0"]


def test_notebooks_ask_for_it() -> None:
    """IPython's formatter takes it from the object itself."""
    formatters = pytest.importorskip("IPython.core.formatters")
    html = formatters.HTMLFormatter()
    result = made([[1.0, 2.0]])
    assert html(result) == notebook.result(result)
    scores = st.evaluate(result.disparity, result.disparity)
    assert html(scores) == notebook.scores(scores)


def test_matching_and_scores_load_nothing_of_it() -> None:
    code = """
import sys, numpy as np, stereopsis as st
scene = st.scenes.plane(40, 24, disparity=3.0)
result = st.match(scene.pair, disparities=(0, 8))
st.evaluate(result.disparity, scene.disparity)
assert "stereopsis.notebook" not in sys.modules
result._repr_html_()
assert "stereopsis.notebook" in sys.modules
assert "matplotlib" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_settings_of_a_result_repeat_it() -> None:
    """What is shown, read as TOML, is what was set."""
    chosen = st.PRESETS["balanced"].changed(disparities=(0, 64), median=5)
    shown = dict(Shown(made([[1.0]], settings=chosen)._repr_html_()).rows)  # type: ignore[arg-type]
    lines = re.split(r", (?=[a-z_0-9]+ = )", shown["settings"])
    assert dataclasses.replace(st.Settings.from_toml("\n".join(lines))) == chosen
