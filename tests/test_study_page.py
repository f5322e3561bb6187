"""The page and the command: one file that holds everything, well-formed, and every section in it."""

from __future__ import annotations

import json
import re
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import pytest

import stereopsis as st
from stereopsis import study
from stereopsis.cli import main
from stereopsis.study import figures, methods, published

pytest.importorskip("matplotlib")
pytest.importorskip("jinja2")
pytest.importorskip("scipy")

VOID = {"meta", "img", "input", "link", "br", "hr", "path", "use"}


class Page(HTMLParser):
    """Checks that every element is closed in order; collects what the tests ask about."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: Counter[str] = Counter()
        self.links: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.headings: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.elements.append((tag, given))
        if given.get("id"):
            self.ids[str(given["id"])] += 1
        self.links += [str(given[name]) for name in ("href", "src", "data") if given.get(name)]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        if tag in VOID:
            return
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "h2":
            self.headings.append(data)


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Everything, on tiny streets."""
    folder = tmp_path_factory.mktemp("report")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(published, "METHODS", ("ssd", "zncc", "zncc_smoothed", "zncc_gaussian"))
        asked = study.Study(scenes=2, size=(64, 40), windows=(5, 9))
        made = study.run(asked, folder)
    assert made.outcome.failed == []
    assert all(file.is_file() for file in made.files)
    return folder


@pytest.fixture(scope="module")
def text(report: Path) -> str:
    return (report / "index.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(text: str) -> Page:
    return Page(text)


def test_every_section_is_there(page: Page) -> None:
    titles = {
        "At a glance",
        "The report, reproduced",
        "Ablation: what each mistake costs",
        "Window size",
        "Disparity maps",
        "RMSE against fractions",
        "The report's tables, corrected",
        "Sub-pixel refinement",
        "Support windows",
        "Where the error lies",
        "Weather",
        "Recognising what cannot be matched",
        "The run",
    }
    assert titles <= set(page.headings)


def test_nothing_comes_from_elsewhere(text: str, page: Page) -> None:
    assert "http" not in text
    assert all(link.startswith(("#", "data:image/")) for link in page.links)
    assert "@import" not in text
    assert not [tag for tag, given in page.elements if tag in ("link", "iframe", "object")]


def test_every_link_within_leads_somewhere(text: str, page: Page) -> None:
    assert {link[1:] for link in page.links if link.startswith("#")} <= set(page.ids)
    assert set(re.findall(r"url\(#([^)]*)\)", text)) <= set(page.ids)
    assert [name for name, count in page.ids.items() if count > 1] == []


def test_pictures_and_drawings_say_what_they_show(page: Page) -> None:
    for tag, given in page.elements:
        if tag == "svg":
            assert given["role"] == "img"
            assert given["aria-label"]
        if tag == "img" and given.get("src"):
            assert given["alt"]
    layers = {given["data-layer"] for tag, given in page.elements if tag == "img" and "data-layer" in given}
    assert layers == {"left", "truth", "result", "error"}


def test_drawings_take_the_page_s_ink(text: str) -> None:
    assert figures.INK not in text
    assert "currentColor" in text
    assert "<style type" not in text


def test_results_and_settings_stand_beside_it(report: Path) -> None:
    names = {"index.html", "results.csv", "timings.csv", "settings.toml", "tables.json"}
    assert names <= {file.name for file in report.iterdir()}
    tables = json.loads((report / "tables.json").read_text())
    assert list(tables) == list(published.TABLES)
    assert [len(values) for values in tables.values()] == [6, 6]
    assert "seconds" not in (report / "results.csv").read_text().splitlines()[0]
    again = study.Study.from_toml((report / "settings.toml").read_text())
    assert again == study.Study(scenes=2, size=(64, 40), windows=(5, 9))


def test_tables_are_the_sum_without_the_last_pair(report: Path) -> None:
    """Two pairs: the first one's measures, halved."""
    lines = [line.split(",") for line in (report / "results.csv").read_text().splitlines()]
    head = lines[0]
    (first,) = (
        line
        for line in lines
        if line[head.index("setting")] == "published: zncc_smoothed-30"
        and line[head.index("pair")] == "street-0"
    )
    expected = [float(first[head.index(column)]) / 2 for column in published.COLUMNS]
    tables = json.loads((report / "tables.json").read_text())
    assert tables["I_smoothed_zncc_30"] == expected


def test_names_are_escaped(tmp_path: Path) -> None:
    scene = st.scenes.plane(48, 32, disparity=3.0)
    folder = tmp_path / "<b>data & more"
    folder.mkdir()
    st.write_image(folder / "<i>-left.png", scene.left)
    st.write_image(folder / "<i>-right.png", scene.right)
    st.write_disparity(folder / "<i>-disparity.png", scene.disparity)
    asked = study.Study(folder, methods=("zncc",), parts=("sweep",), windows=(5, 31))
    study.run(asked, tmp_path / "report")
    text = (tmp_path / "report" / "index.html").read_text(encoding="utf-8")
    Page(text)
    assert "<i>" not in re.sub(r'<i style="[^"]*">', "", text)
    assert "<b>data" not in text


def test_a_study_of_nothing_readable_still_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "data"
    folder.mkdir()
    for name in ("x-left.png", "x-right.png", "x-disparity.png"):
        (folder / name).write_bytes(b"")
    code = main(["study", str(folder), "-o", str(tmp_path / "report"), "--parts", "sweep", "--json"])
    out, err = capsys.readouterr()
    assert code == 3
    assert "not measured: x: " in err
    assert [failure["pair"] for failure in json.loads(out)["failed"]] == ["x"]
    assert "Not measured" in Page((tmp_path / "report" / "index.html").read_text(encoding="utf-8")).headings


def test_command_repeats_from_its_settings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    options = [
        "--scenes",
        "1",
        "--size",
        "64x40",
        "--windows",
        "5:12:6",
        "--methods",
        "zncc",
        "--parts",
        "sweep",
    ]
    assert main(["study", "-o", str(first), *options]) == 0
    assert main(["study", "-o", str(second), "--settings", str(first / "settings.toml")]) == 0
    assert (first / "results.csv").read_bytes() == (second / "results.csv").read_bytes()
    out, err = capsys.readouterr()
    assert f"wrote {first / 'index.html'}" in out
    assert err == ""


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--windows", "5:9", "whole numbers"),
        ("--windows", "a,b", "neither START:STOP:STEP"),
        ("--windows", "1:2:3:4", "neither START:STOP:STEP"),
        ("--methods", "zncc-gausian", "unknown method"),
        ("--protocol", "printed", "protocol must be"),
    ],
)
def test_command_refuses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str, value: str, message: str
) -> None:
    if value == "5:9":
        value = "0:9"
    assert main(["study", "-o", str(tmp_path / "report"), option, value]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert message in err
    assert not (tmp_path / "report").exists()


def test_drawing_is_well_formed_and_inline() -> None:
    series = figures.Series("a < b", (1.0, 2.0), (0.25, 0.5), (0.2, 0.4), (0.3, 0.6))
    for panel in (
        figures.lines([series], "x", "y", percent=True),
        figures.bars(["one", "two"], [series], "x"),
        figures.scatter([("a", [(1.0, 2.0, "5")])], [(1.0, 2.0)], "x", "y"),
    ):
        drawn = figures.inline(panel, "here")
        root = ElementTree.fromstring(drawn)
        assert root.tag == "svg"
        assert all(one.get("id", "here-").startswith("here-") for one in root.iter())
        assert "width" not in root.attrib


def test_labels_and_names_differ() -> None:
    """Also with a window behind a name: two rows of a pair never share a setting."""
    assert len({method.name for method in methods.METHODS}) == len(methods.METHODS)
    windowed = {m.setting(w) for m in methods.METHODS if m.windowed for w in range(1, 256)}
    assert len(windowed) == 255 * sum(method.windowed for method in methods.METHODS)
    assert not windowed & {method.name for method in methods.METHODS}
    assert {method.part for method in methods.METHODS} == set(methods.PARTS)


def test_swipe_and_tables_are_the_very_files_of_the_page_to_look_at(text: str, page: Page) -> None:
    static = Path(st.__file__).parent / "view" / "static"
    for name in ("pieces.css", "swipe.js", "table.js"):
        assert (static / name).read_text(encoding="utf-8") in text
    tags = Counter(tag for tag, _ in page.elements)
    assert tags["sortable-table"] == tags["table"] > 3
    assert tags["swipe-view"] == 1
