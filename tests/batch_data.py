"""Tiny data sets for the tests of batch, and looks at what a run leaves."""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import stereopsis as st

SETTINGS = st.Settings(disparities=(0, 16), cost=st.SAD(5))
OPTIONS = ("--disparities", "0:16", "--set", "cost=sad", "--set", "window=5")
"""The same on the command line."""

# Of Dask's own making, when its loops and sockets end.
QUIET = (
    "ignore::ResourceWarning",
    "ignore::DeprecationWarning:distributed",
    "ignore::DeprecationWarning:tornado",
    "ignore::pytest.PytestUnraisableExceptionWarning",
)


def images(seed: int, width: int = 64, height: int = 24) -> tuple[Any, Any, Any]:
    """A random texture that lies 3 to 9 pixels farther left in the right view, and the truth."""
    shift = 3 + seed % 7
    texture = np.random.default_rng(seed).integers(0, 256, (height, width + shift), np.uint8)
    truth = np.full((height, width), shift, np.float32)
    return texture[:, :width], texture[:, shift:], truth


def dataset(folder: Path, count: int, width: int = 64, height: int = 24) -> Path:
    """A folder of `count` pairs with truth, side by side."""
    folder.mkdir(parents=True)
    for number in range(count):
        left, right, truth = images(number, width, height)
        st.write_image(folder / f"{number:03}-left.png", left)
        st.write_image(folder / f"{number:03}-right.png", right)
        st.write_disparity(folder / f"{number:03}-disparity.png", truth)
    return folder


@dataclass(frozen=True)
class Made:
    """A sample without files."""

    name: str
    seed: int = 0
    fault: str = ""

    def pair(self) -> st.Pair:
        if self.fault:
            raise ValueError(self.fault)
        left, right, _ = images(self.seed)
        return st.Pair(left, right, name=self.name)

    def truth(self) -> Any:
        return images(self.seed)[2]

    def mask(self) -> None:
        return None


@contextmanager
def in_this_process(threads: int = 2) -> Iterator[Any]:
    """A Dask client whose scheduler and worker are threads."""
    from distributed import Client

    with Client(processes=False, n_workers=1, threads_per_worker=threads, dashboard_address=":0") as client:
        yield client


def command(data: Path, out: object, *options: object) -> list[str]:
    """The command line that puts a data set into a folder."""
    return [sys.executable, "-m", "stereopsis", "batch", *map(str, (data, "-o", out, *OPTIONS, *options))]


def table(out: Path, name: str = "results.csv") -> list[dict[str, str]]:
    """The lines of a table."""
    with (out / name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def files(out: Path) -> dict[str, tuple[int, int]]:
    """Inode and time of every finished pair's two files, by path."""
    found = {}
    for row in out.glob("rows/**/*.json"):
        path = row.relative_to(out / "rows").with_suffix("")
        for file in (row, *out.glob(f"disparity/{path}.*")):
            facts = file.stat()
            found[str(file.relative_to(out))] = facts.st_ino, facts.st_mtime_ns
    return found


def leftovers(out: Path) -> list[Path]:
    """Files that a writer left unfinished."""
    return sorted(out.rglob("*.tmp"))
