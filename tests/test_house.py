"""What holds for the library as a whole: what an import loads, what is documented, what agrees."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

import stereopsis as st
from stereopsis import settings

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "src" / "stereopsis"
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PUBLIC = sorted(name for name in st.__all__ if not name.startswith("_"))

in_checkout = pytest.mark.skipif(not (ROOT / "docs").is_dir(), reason="needs the checkout")


def test_import_loads_numpy_and_the_core_alone() -> None:
    """Everything else waits until a function needs it."""
    declared = {re.split(r"[<>=!~ ;\[]", line)[0].lower() for line in PYPROJECT["project"]["dependencies"]}
    modules = {"pillow": "PIL", "pyyaml": "yaml"}
    waiting = {modules.get(name, name) for name in declared - {"numpy"}} | {
        "cv2",
        "dask",
        "matplotlib",
        "scipy",
    }
    code = "import sys, stereopsis; print(*sorted({name.partition('.')[0] for name in sys.modules}))"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert "numpy" in loaded
    assert waiting & set(loaded) == set()


def test_help_needs_no_numpy() -> None:
    """A mistyped option is answered before anything heavy is loaded by the command line itself."""
    code = "import sys, stereopsis.cli; print('rich' in sys.modules, 'PIL' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]


@pytest.mark.parametrize("name", PUBLIC)
def test_public_name_exists_and_is_documented(name: str) -> None:
    thing = getattr(st, name)
    if inspect.isclass(thing) or inspect.isroutine(thing) or inspect.ismodule(thing):
        text = inspect.getdoc(thing)
        assert text
        assert not text.startswith(f"{name}("), f"the docstring of {name} is the one that dataclass makes"


@pytest.mark.parametrize("name", PUBLIC)
def test_public_methods_are_documented(name: str) -> None:
    thing = getattr(st, name)
    if inspect.isclass(thing):
        undocumented = [
            member
            for member, value in vars(thing).items()
            if not member.startswith("_") and inspect.isroutine(value) and not inspect.getdoc(value)
        ]
        assert undocumented == []


@in_checkout
@pytest.mark.parametrize("name", PUBLIC)
def test_public_name_stands_in_the_reference(name: str) -> None:
    """On a line of its own, in a list of names or as the module of one."""
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    assert re.search(rf"^(?: +|\.\. currentmodule:: stereopsis\.){name}$", page, re.MULTILINE)


@in_checkout
def test_every_setting_stands_once_on_its_page() -> None:
    page = (ROOT / "docs" / "settings.md").read_text(encoding="utf-8")
    table = page.partition("## The list")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (`[^|]+) \|", table, re.MULTILINE)
    named = [name for row in rows for name in re.findall(r"`(\w+)`", row)]
    fields = [field.name for field in dataclasses.fields(settings.Settings)]
    assert sorted(named) == sorted([*fields, *settings.COST_PARTS, *settings.OPTIMIZER_PARTS])


def test_package_is_typed_and_the_core_has_a_stub() -> None:
    assert (PACKAGE / "py.typed").is_file()
    assert (PACKAGE / "_core.pyi").is_file()


def test_stub_and_core_agree() -> None:
    """Each name of the stub is in the compiled core, and none of the core's is missing from the stub."""
    from stereopsis import _core

    stub = (PACKAGE / "_core.pyi").read_text(encoding="utf-8")
    declared = set(re.findall(r"^(?:def|class) (\w+)|^(\w+):", stub, re.MULTILINE))
    names = {function or constant for function, constant in declared}
    public = {name for name in vars(_core) if not name.startswith("__")}
    assert {name for name in names if not name.startswith("__")} == public


@pytest.mark.parametrize(
    "path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE))
)
def test_nobody_but_the_command_line_imports_the_package_itself(path: Path) -> None:
    """What the import linter cannot tell from an import of the compiled core."""
    if path.name in ("cli.py", "__main__.py"):
        return
    submodules = {"_core", *(found.stem for found in PACKAGE.iterdir())}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            assert "stereopsis" not in [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module == "stereopsis":
            assert {alias.name for alias in node.names} <= submodules


@in_checkout
def test_pages_of_the_tables_of_contents_exist() -> None:
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    pages = [
        line
        for block in re.findall(r"```\{toctree\}\n(.*?)```", index, re.DOTALL)
        for line in block.splitlines()
        if line and not line.startswith(":")
    ]
    assert len(pages) >= 10
    assert [page for page in pages if not (ROOT / "docs" / f"{page}.md").is_file()] == []


@in_checkout
@pytest.mark.parametrize(
    "page", ["README.md", "CONTRIBUTING.md", *(f"docs/{p.name}" for p in ROOT.glob("docs/*.md"))]
)
def test_links_lead_to_files(page: str) -> None:
    text = re.sub(r"```.*?```", "", (ROOT / page).read_text(encoding="utf-8"), flags=re.DOTALL)
    links = [link for link in re.findall(r"\]\(([^)#\s]+)", text) if "://" not in link]
    assert [link for link in links if not ((ROOT / page).parent / link).exists()] == []


@in_checkout
def test_one_version_everywhere() -> None:
    version = PYPROJECT["project"]["version"]
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.search(r"^## \[?(\d[\w.]*)", changelog, re.MULTILINE)
    assert newest is not None
    assert {version, newest[1], st.__version__, metadata.version("stereopsis")} == {version}
