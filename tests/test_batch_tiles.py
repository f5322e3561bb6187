"""Pairs larger than a worker's memory: tiles go over the workers, and the maps are those of one process."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stereopsis as st
from batch_data import QUIET, SETTINGS, command, dataset, images, in_this_process, leftovers, table
from stereopsis import batch, tiling
from stereopsis.batch import tiled
from stereopsis.tiling import large

pytest.importorskip("distributed")
pytestmark = [pytest.mark.filterwarnings(text) for text in QUIET]

WIDTH, HEIGHT = 400, 300
MEMORY = tiled.RESIDENT + large.SPARE + 2**20
"""Room for a third of such a pair, about; small ones fit."""


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    with in_this_process() as client:
        yield client


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A large pair between two small ones."""
    folder = dataset(tmp_path_factory.mktemp("tiles") / "data", 3)
    for side, image in zip(("left", "right"), images(5, WIDTH, HEIGHT), strict=False):
        (folder / f"001-{side}.png").unlink()
        st.write_image(folder / f"001-{side}.tif", image)
    (folder / "001-disparity.png").unlink()
    lines = [f"{n},{n}-left.{s},{n}-right.{s}" for n, s in (("000", "png"), ("001", "tif"), ("002", "png"))]
    (folder / "pairs.csv").write_text("\n".join(["name,left,right", *lines]) + "\n")
    return folder


@pytest.fixture(scope="module")
def done(data: Path, tmp_path_factory: pytest.TempPathFactory, client: Any) -> Path:
    """A run that nothing disturbed."""
    out = tmp_path_factory.mktemp("tiles") / "out"
    run(data, out, client)
    return out


def run(data: Path, out: Any, client: Any = None, **options: Any) -> batch.Report:
    options = {"format": "tif", "memory": MEMORY} | options
    return batch.run(st.datasets.open(data / "pairs.csv"), SETTINGS, out, client, **options)


def whole_tiles(out: Path) -> dict[str, int]:
    """When each was written; what is being written beside them comes and goes."""
    found = {}
    for path in (out / "tiles").glob("[!.]*"):
        with suppress(FileNotFoundError):
            found[path.name] = path.stat().st_mtime_ns
    return found


def cut(data: Path) -> tiling.Job:
    files = data / "001-left.tif", data / "001-right.tif"
    return tiling.prepare(*files, SETTINGS, memory=MEMORY, resident=tiled.RESIDENT)


def test_the_bits_are_those_of_one_process(data: Path, done: Path, tmp_path: Path) -> None:
    """And of the whole image, as the settings are local ones; the row tells what is in the map."""
    assert len(cut(data)) > 2
    pair = st.read_pair(data / "001-left.tif", data / "001-right.tif")
    whole = st.match(pair, settings=SETTINGS)
    found = st.read_disparity(done / "disparity/001.tif")
    np.testing.assert_array_equal(found, whole.disparity)
    tiling.assemble(cut(data), map(cut(data).match, range(len(cut(data)))), tmp_path / "one.tif")
    assert (done / "disparity/001.tif").read_bytes() == (tmp_path / "one.tif").read_bytes()
    row = table(done)[1]
    assert (row["name"], row["width"], row["height"]) == ("001", str(WIDTH), str(HEIGHT))
    assert float(row["density"]) == whole.density
    for flag in st.Flag:
        assert int(row[str(flag.name).lower()]) == np.count_nonzero(whole.flags & flag)
    assert float(table(done, "timings.csv")[1]["match"]) > 0
    assert sorted(path.name for path in done.iterdir() if path.name[0] != ".") == [
        "disparity", "failures.csv", "results.csv", "rows", "run.toml", "timings.csv"
    ]  # fmt: skip


def test_progress_is_told_by_tile(data: Path, tmp_path: Path, client: Any) -> None:
    told: list[str] = []
    run(data, tmp_path / "out", client, progress=lambda finished, total, what: told.append(what))
    count = len(cut(data))
    assert [what for what in told if what] == [f"001: tile {n} of {count}" for n in range(count + 1)]


def test_a_run_goes_on_with_the_tiles_that_are_there(
    data: Path, done: Path, tmp_path: Path, client: Any
) -> None:
    out = tmp_path / "out"

    def stop(finished: int, total: int | None, what: str) -> None:
        if "tile 2 of" in what:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(data, out, client, progress=stop)
    kept = whole_tiles(out)
    assert len(kept) >= 2
    (out / "tiles/.0123456789ab.tmp").write_bytes(b"half")
    name = min(kept)
    (out / "tiles" / name).write_bytes(b"not whole")
    again: dict[str, int] = {}

    def look(finished: int, total: int | None, what: str) -> None:
        again.update(whole_tiles(out))

    run(data, out, client, progress=look)
    assert {n: t for n, t in again.items() if n in kept and n != name} == {
        n: t for n, t in kept.items() if n != name
    }
    assert (out / "results.csv").read_bytes() == (done / "results.csv").read_bytes()
    assert (out / "disparity/001.tif").read_bytes() == (done / "disparity/001.tif").read_bytes()
    assert not (out / "tiles").exists()
    assert leftovers(out) == []
    assert run(data, out, client).reused == 3


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs the signals of POSIX")
@pytest.mark.parametrize("victim", ["worker", "client"])
def test_killed_between_tiles(victim: str, data: Path, done: Path, tmp_path: Path) -> None:
    """Two processes, one of which is killed when some tiles are there: the same bytes in the end."""
    chaos = pytest.importorskip("test_batch_chaos")
    wide = tmp_path / "data"
    wide.mkdir()
    left, right, _ = images(3, 2400, 1600)
    st.write_image(wide / "l.tif", left)
    st.write_image(wide / "r.tif", right)
    (wide / "pairs.csv").write_text("name,left,right\na/b,l.tif,r.tif\n")
    memory = tiled.RESIDENT + large.SPARE + 8 * 2**20
    out = tmp_path / "out"
    asked = command(wide / "pairs.csv", out, "--format", "tif", "--memory", memory, "--workers", 2)
    with chaos.started(*asked) as process:
        chaos.until(lambda: len(list(out.glob("tiles/a/b.*"))) > 1, "two tiles")
        if victim == "worker":
            chaos.workers(process)[0].kill()
            assert process.wait() == 0
        else:
            chaos.killed(process)
    if victim == "client":
        assert list(out.glob("tiles/a/b.*"))
        subprocess.run(asked, check=True, capture_output=True)
    expected = st.match(st.Pair(left, right), settings=SETTINGS).disparity
    np.testing.assert_array_equal(st.read_disparity(out / "disparity/a/b.tif"), expected)
    assert not (out / "tiles").exists()
    assert leftovers(out) == []


@pytest.mark.parametrize("whole", [True, False])
def test_a_place_that_fsspec_knows(
    whole: bool, data: Path, done: Path, client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    import fsspec

    from stereopsis.batch import store

    if not whole:
        monkeypatch.setattr(store, "ONE_PUT", frozenset())
    system = fsspec.filesystem("memory")
    url = f"memory://tiles/{whole}"
    assert run(data, url, client).done == 3
    assert system.cat_file(f"{url}/disparity/001.tif") == (done / "disparity/001.tif").read_bytes()
    assert system.cat_file(f"{url}/results.csv") == (done / "results.csv").read_bytes()
    assert not [path for path in system.find("/tiles") if "/tiles/001" in path or path.endswith(".tmp")]


def test_what_cannot_be_in_tiles_fails_alone(data: Path, tmp_path: Path, client: Any) -> None:
    report = run(data, tmp_path / "png", client, format="png")
    assert [failure.name for failure in report.failures] == ["001"]
    assert "in tiles tif, tiff, npy, pfm are written, not png" in report.failures[0].reason
    scored = tmp_path / "scored.csv"
    truth = tmp_path / "truth.pfm"
    st.write_disparity(truth, np.ones((HEIGHT, WIDTH), np.float32))
    scored.write_text(f"left,right,truth\n{data}/001-left.tif,{data}/001-right.tif,{truth}\n")
    options = {"format": "tif", "memory": MEMORY}
    samples = st.datasets.open(scored)
    (failure,) = batch.run(samples, SETTINGS, tmp_path / "s", client, evaluate=True, **options).failures
    assert "a score needs the whole map" in failure.reason
    assert batch.run(samples, SETTINGS, tmp_path / "t", client, **options).failures == ()
    scarce = run(data, tmp_path / "scarce", client, memory=tiled.RESIDENT + large.SPARE + 2**13)
    assert "memory must leave at least" in next(f.reason for f in scarce.failures if f.name == "001")
    assert sorted(path.name for path in (tmp_path / "png/disparity").iterdir()) == ["000.png", "002.png"]


def test_a_broken_tile_costs_its_pair(data: Path, tmp_path: Path, client: Any) -> None:
    """The file is whole at its beginning, so that it is found out by one of the tiles."""
    broken = tmp_path / "data"
    broken.mkdir()
    for file in data.iterdir():
        (broken / file.name).write_bytes(file.read_bytes())
    calls: list[int] = []
    before = tiling.Job.match

    def match(self: tiling.Job, number: int) -> Any:
        calls.append(number)
        if number == 1:
            raise ValueError("a strip is damaged")
        return before(self, number)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tiling.Job, "match", match)
        report = run(broken, tmp_path / "out", client)
    assert report.failures == (batch.Failure("001", "a strip is damaged"),)
    assert report.done == 2
    assert not (tmp_path / "out/tiles").exists()
    assert run(broken, tmp_path / "out", client).reused == 2


def test_another_memory_is_another_run(data: Path, done: Path, client: Any) -> None:
    with pytest.raises(ValueError, match=rf"memory {MEMORY}, not {2 * MEMORY}"):
        run(data, done, client, memory=2 * MEMORY)
    with pytest.raises(ValueError, match="memory must be an amount such as 2GiB"):
        run(data, done, client, memory="much")
