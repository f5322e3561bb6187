"""Images larger than memory: files in parts, `match --memory`, and what it takes."""

import json
import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as some

import stereopsis as st
from stereopsis import cli, tiling
from stereopsis.io import parts
from stereopsis.settings import Settings
from stereopsis.tiling import large, memory
from stereopsis.tiling.grid import tiles
from stereopsis.tiling.plan import plan
from stereopsis.types import Halo, Rectangle

FAST = st.PRESETS["fast"].changed(disparities=(0, 16), vertical=None)


def texture(height, width, seed=0, dtype=np.uint8, top=256):
    return np.random.default_rng(seed).integers(0, top, (height, width)).astype(dtype)


@pytest.fixture
def pair(tmp_path):
    """Files of a pair with a step in depth, and its arrays."""
    left = texture(300, 420)
    right = np.vstack([np.roll(left[:150], -3, axis=1), np.roll(left[150:], -9, axis=1)])
    files = tmp_path / "left.tif", tmp_path / "right.tif"
    for file, image in zip(files, (left, right), strict=True):
        tifffile.imwrite(file, image, tile=(64, 64))
    return files, (left, right)


def small_tiles(monkeypatch, side=(64, 96)):
    """Whatever the memory, tiles of one size."""
    real = large.plan

    def laid(shape, chosen, room, needs):
        found = real(shape, chosen, room, needs)
        cut = tuple(tiles(shape, side, found.halo, tiling.reach.alignment(chosen)))
        return type(found)(cut, side, found.halo, found.bytes)

    monkeypatch.setattr(large, "plan", laid)


# ---- reading ---------------------------------------------------------------------------------------

PLAIN = {"photometric": "minisblack", "metadata": None}


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("one-strip", {}),
        ("strips", {"rowsperstrip": 7}),
        ("deflated", {"rowsperstrip": 7, "compression": "zlib", "predictor": True}),
        ("lzw-tiles", {"tile": (32, 16), "compression": "lzw"}),
        ("tiles", {"tile": (16, 32)}),
        ("big-endian", {"byteorder": ">", "bigtiff": True}),
        ("white-is-zero", {"photometric": "miniswhite", "rowsperstrip": 9}),
    ],
)
@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
@pytest.mark.parametrize("colours", [False, True])
def test_a_tiff_in_parts_is_the_tiff(tmp_path, name, options, dtype, colours):
    if colours and "photometric" in options:
        return
    image = texture(61, 83 * (3 if colours else 1), dtype=dtype).reshape((61, 83, 3) if colours else (61, 83))
    writing = {**PLAIN, **({"photometric": "rgb"} if colours else {}), **options}
    byteorder, big = writing.pop("byteorder", "<"), writing.pop("bigtiff", False)
    with tifffile.TiffWriter(tmp_path / "a.tif", byteorder=byteorder, bigtiff=big) as file:
        file.write(image, **writing)
    whole = st.read_image(tmp_path / "a.tif")
    with parts.open_parts(tmp_path / "a.tif") as opened:
        assert (opened.shape, opened.dtype) == (whole.shape, whole.dtype)
        for part in (Rectangle(0, 61, 0, 83), Rectangle(5, 6, 80, 83), Rectangle(13, 50, 15, 49)):
            found = opened.read(part)
            assert found.dtype == whole.dtype
            assert found.flags.c_contiguous
            assert (found == whole[part.slices]).all()


@pytest.mark.parametrize("suffix", [".npy", ".png", ".pgm", ".jpg"])
def test_other_images_in_parts(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    st.write_image(path, texture(40, 50))
    whole = st.read_image(path)
    with parts.open_parts(path) as opened:
        assert (opened.read(Rectangle(3, 17, 20, 50)) == whole[3:17, 20:]).all()
    assert (parts.opening(path) >= 2000) == (suffix != ".npy")


def test_zarr_in_parts(tmp_path):
    zarr = pytest.importorskip("zarr")
    image = texture(70, 90, dtype=np.uint16)
    zarr.create_array(store=str(tmp_path / "a.zarr"), data=image, chunks=(32, 16))
    with parts.open_parts(tmp_path / "a.zarr") as opened:
        assert (opened.shape, opened.dtype) == ((70, 90), np.uint16)
        assert (opened.read(Rectangle(3, 47, 20, 85)) == image[3:47, 20:85]).all()
    (tmp_path / "none").mkdir()
    with pytest.raises(ValueError, match="holds no Zarr array"), parts.open_parts(tmp_path / "none"):
        pass


def test_damage_is_told_by_the_file_s_name(tmp_path):
    path = tmp_path / "a.tif"
    image = texture(60, 60)
    tifffile.imwrite(path, image, rowsperstrip=10, compression="zlib", **PLAIN)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(ValueError, match=r"a\.tif: "), parts.open_parts(path) as opened:
        opened.read(Rectangle(0, 60, 0, 60))
    path.write_bytes(data.replace(data[200:400], bytes(200)))
    with pytest.raises(ValueError, match=r"a\.tif: "), parts.open_parts(path) as opened:
        opened.read(Rectangle(0, 60, 0, 60))
    broken = np.ones((9, 9), np.float32)
    broken[4, 4] = np.nan
    np.save(tmp_path / "a.npy", broken)
    with parts.open_parts(tmp_path / "a.npy") as opened:
        assert opened.read(Rectangle(0, 4, 0, 9)).sum() == 36
        with pytest.raises(ValueError, match=r"a\.npy: .* NaN or infinite"):
            opened.read(Rectangle(0, 9, 0, 9))
    (tmp_path / "a.npy").write_bytes((tmp_path / "a.npy").read_bytes()[:-8])
    with pytest.raises(ValueError, match=r"truncated"), parts.open_parts(tmp_path / "a.npy") as opened:
        opened.read(Rectangle(8, 9, 0, 9))


# ---- writing ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", parts.PART_SUFFIXES)
@given(
    shape=some.tuples(some.integers(1, 600), some.integers(1, 600)),
    side=some.tuples(some.integers(50, 700), some.integers(50, 700)),
)
@settings(max_examples=6, deadline=None)
def test_a_map_in_parts(tmp_path_factory, suffix, shape, side):
    if suffix == ".zarr":
        pytest.importorskip("zarr")
    path = tmp_path_factory.mktemp("map") / f"a{suffix}"
    values = texture(*shape, dtype=np.float32)
    values[values < 20] = np.nan
    with parts.create_map(path, shape) as map:
        for core, _ in reversed(tiles(shape, side, Halo())):
            map.write(core, values[core.slices])
        assert not path.exists()
        below = Rectangle(shape[0] // 2, shape[0], shape[1] // 3, shape[1])
        written = map.read(below)
        assert np.array_equal(
            np.where(np.isfinite(written), written, np.nan), values[below.slices], equal_nan=True
        )
    if suffix == ".zarr":
        import zarr

        found = zarr.open_array(str(path), mode="r")[:]
    elif np.isfinite(values).any():
        found = st.read_disparity(path)
    else:
        return
    assert np.array_equal(found, values, equal_nan=True)
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_a_large_tiff_is_a_bigtiff(tmp_path, monkeypatch):
    monkeypatch.setattr(parts, "CLASSIC", 1000)
    with parts.create_map(tmp_path / "a.tif", (300, 300), np.uint8) as map:
        map.write(Rectangle(0, 300, 0, 300), np.full((300, 300), 7, np.uint8))
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        assert file.is_bigtiff
        assert file.pages.first.is_tiled
        assert (file.asarray() == 7).all()


def write_and_stop(path):
    with parts.create_map(path, (30, 40)) as map:
        map.write(Rectangle(0, 30, 0, 40), np.ones((30, 40), np.float32))
        raise KeyboardInterrupt


@pytest.mark.parametrize("suffix", parts.PART_SUFFIXES)
def test_nothing_half_written_stays(tmp_path, suffix):
    if suffix == ".zarr":
        pytest.importorskip("zarr")
    path = tmp_path / f"a{suffix}"
    for first in (True, False):
        with pytest.raises(KeyboardInterrupt):
            write_and_stop(path)
        assert path.exists() is not first
        if first:
            with parts.create_map(path, (30, 40)) as map:
                map.write(Rectangle(0, 30, 0, 40), np.zeros((30, 40), np.float32))
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_names_that_are_refused(tmp_path):
    for name in ("a.png", "a.jpg", "a.ply", "a"):
        with pytest.raises(ValueError, match=r"in tiles .tif, .tiff, .npy, .pfm, .zarr are written"):
            parts.check_map(tmp_path / name)
    with pytest.raises(FileNotFoundError):
        parts.check_map(tmp_path / "none" / "a.tif")
    (tmp_path / "data.zarr").mkdir()
    if pytest.importorskip("zarr"):
        with (
            pytest.raises(ValueError, match="is no Zarr array: it is not replaced"),
            parts.create_map(tmp_path / "data.zarr", (3, 3)),
        ):
            pass


# ---- from files into files -------------------------------------------------------------------------


@pytest.mark.parametrize("fill", [None, "background"])
def test_tiles_of_files_are_the_whole(pair, tmp_path, monkeypatch, fill):
    files, images = pair
    side = (64, 96) if fill is None else (64, 420)
    small_tiles(monkeypatch, side)
    chosen = FAST.changed(fill=fill)
    outputs = [tmp_path / "out.tif", tmp_path / "out.pfm", tmp_path / "out.npy"]
    seen = []
    found = tiling.match(
        *files, outputs, settings=chosen, flags=tmp_path / "flags.tif", confidence=tmp_path / "sure.npy",
        progress=lambda *told: seen.append(told),
    )  # fmt: skip
    whole = st.match(*images, settings=chosen)
    for path in outputs:
        assert np.array_equal(st.read_disparity(path), whole.disparity, equal_nan=True)
    assert (tifffile.imread(tmp_path / "flags.tif") == whole.flags).all()
    assert (np.load(tmp_path / "sure.npy") == whole.confidence).all()
    assert found.tiles == (25 if fill is None else 5)
    assert (found.shape, found.settings, found.measured) == ((300, 420), chosen, ())
    assert found.density == whole.density
    assert all(found.flagged[flag] == np.count_nonzero(whole.flags & flag) for flag in st.Flag)
    assert seen[-1] == (found.tiles, found.tiles, "")
    assert [told[0] for told in seen if told[1]] == list(range(found.tiles + 1))


def test_tiles_can_be_spread_over_workers(pair, tmp_path, monkeypatch):
    files, images = pair
    small_tiles(monkeypatch)
    job = pickle.loads(pickle.dumps(tiling.prepare(*files, FAST)))
    pieces = [pickle.loads(pickle.dumps(job.match(number))) for number in range(len(job))]
    tiling.assemble(job, reversed(pieces), tmp_path / "out.tif")
    whole = st.match(*images, settings=FAST).disparity
    assert np.array_equal(st.read_disparity(tmp_path / "out.tif"), whole, equal_nan=True)
    for wrong, message in ((pieces[1:], "1 of 25 tiles are missing"), ([*pieces, pieces[3]], "came twice")):
        with pytest.raises(ValueError, match=message):
            tiling.assemble(job, wrong, tmp_path / "again.tif")
    assert not (tmp_path / "again.tif").exists()


def test_an_interruption_leaves_nothing(pair, tmp_path):
    def stop(finished, total, what):
        if total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tiling.match(*pair[0], tmp_path / "out.tif", settings=FAST, progress=stop)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["left.tif", "right.tif"]


def test_pairs_and_settings_that_are_refused(pair, tmp_path):
    (left, right), _ = pair
    tifffile.imwrite(tmp_path / "other.tif", texture(300, 421))
    with pytest.raises(ValueError, match=r"must be alike: .*left\.tif is 420 x 300 grey uint8, .*421 x 300"):
        tiling.match(left, tmp_path / "other.tif", tmp_path / "out.tif")
    with pytest.raises(ValueError, match=r"^sky must be False or 'auto' in tiles"):
        tiling.match(left, right, tmp_path / "out.tif", settings=FAST.changed(sky=True))
    with pytest.raises(ValueError, match=r"^memory must leave at least .* MiB for a tile and its halo of"):
        tiling.match(left, right, tmp_path / "out.tif", settings=FAST, memory=1000)
    st.write_image(tmp_path / "left.png", texture(300, 420))
    with pytest.raises(ValueError, match=r"^memory must be at least .* to decode .*left\.png whole"):
        tiling.match(tmp_path / "left.png", right, tmp_path / "out.tif", settings=FAST, memory=1000)


# ---- the memory ------------------------------------------------------------------------------------


def test_amounts():
    assert [memory.as_bytes(text) for text in ("2GiB", "800 MB", "1.5g", "64kib", "4096", 7)] == [
        2**31, 800_000_000, 1_500_000_000, 2**16, 4096, 7,
    ]  # fmt: skip
    for wrong in ("", "GiB", "-1GiB", "1XB", "0", 0, -5, True):
        with pytest.raises(ValueError, match="memory must be an amount such as 2GiB"):
            memory.as_bytes(wrong)


def test_a_plan_takes_the_largest_tiles_that_fit():
    chosen = Settings(disparities=(0, 33), cost=st.ZNCC(9))

    def needs(tile):
        return tile.part.size

    whole = plan((1000, 2000), chosen, 2_000_000, needs)
    assert [tile.core for tile in whole.tiles] == [Rectangle(0, 1000, 0, 2000)]
    half = plan((1000, 2000), chosen, 1_999_999, needs)
    assert 2 <= len(half.tiles) <= 3
    assert half.bytes <= 1_999_999
    small = plan((1000, 2000), chosen, 20_000, needs)
    assert small.bytes <= 20_000
    rows = plan((1000, 2000), chosen.changed(fill="background"), 200_000, needs)
    assert {tile.core.shape[1] for tile in rows.tiles} == {2000}
    with pytest.raises(ValueError, match="a tile and its halo of 8 rows and 2000 columns"):
        plan((1000, 2000), chosen.changed(fill="background"), 2000, needs)


CHILD = """
import sys, numpy as np
sys.path.insert(0, sys.argv[3])
import stereopsis as st
from stereopsis.pipeline import match_part
from stereopsis.tiling import memory
from stereopsis.types import Frame
shape, chosen = (1800, 2600), st.Settings.make(sys.argv[1], disparities=(0, 32), vertical=0.25, threads=2,
                                               assignments=sys.argv[4:])
draw = np.random.default_rng(0)
image = draw.integers(0, 256, (90, 99), dtype=np.uint8).astype(sys.argv[2])
match_part(image, image, chosen, Frame((90, 99)))
# Nothing that is given back: it would stay with the process, for the match to take.
left = draw.integers(0, 256, shape, dtype=sys.argv[2])
right = np.roll(left, -9, axis=1)
before = memory.resident() - left.nbytes - right.nbytes
match_part(left, right, chosen, Frame(shape))
peak = [line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")]
print((int(peak[0]) * 1024 - before) / left.size, memory.needed(chosen, left.dtype, 1))
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs the peak that Linux tells")
@pytest.mark.parametrize(
    "chosen",
    [("fast", "uint8"), ("fast", "uint16"), ("fast", "uint8", "fill=background"), ("balanced", "uint8")],
    ids=" ".join,
)
def test_the_model_is_what_the_process_takes(chosen):
    """Within 15 %, above and below."""
    package = str(Path(st.__file__).parents[1])
    preset, dtype, *assignments = chosen
    if preset == "balanced":
        assignments.append("slant=none")
    done = subprocess.run(
        [sys.executable, "-c", CHILD, preset, dtype, package, *assignments],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    taken, told = map(float, done.stdout.split())
    assert taken / 1.15 <= told <= 1.15 * taken


COMMAND = """
import sys
sys.path.insert(0, sys.argv[1])
import stereopsis.cli
code = stereopsis.cli.main(sys.argv[2:])
peak = [line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")]
print(int(peak[0]) * 1024, file=sys.stderr)
sys.exit(code)
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs the peak that Linux tells")
def test_the_process_keeps_to_its_memory(tmp_path):
    left = texture(2500, 3000)
    for name, image in (("left", left), ("right", np.roll(left, -5, axis=1))):
        tifffile.imwrite(tmp_path / f"{name}.tif", image, rowsperstrip=64, **PLAIN)
    package = str(Path(st.__file__).parents[1])
    allowed = 160 * 2**20
    done = subprocess.run(
        [
            sys.executable, "-c", COMMAND, package, "match", tmp_path / "left.tif", tmp_path / "right.tif",
            "-o", tmp_path / "out.tif", "--memory", "160MiB", "--disparities", "0:16", "--json",
        ],
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert int(done.stderr.split()[-1]) <= 1.15 * allowed
    found = json.loads(done.stdout)
    assert found["tiles"] > 1
    assert found["measured"] == []
    whole = st.match(left, np.roll(left, -5, axis=1), preset="fast", disparities=(0, 16)).disparity
    assert np.array_equal(st.read_disparity(tmp_path / "out.tif"), whole, equal_nan=True)


@pytest.mark.skipif(os.name == "nt", reason="needs signals")
def test_control_c_ends_the_command_and_leaves_nothing(tmp_path):
    left = texture(2000, 2000)
    for name in ("left.npy", "right.npy"):
        np.save(tmp_path / name, left)
    package = str(Path(st.__file__).parents[1])
    begun = subprocess.Popen(
        [
            sys.executable, "-c", COMMAND, package, "match", tmp_path / "left.npy", tmp_path / "right.npy",
            "-o", tmp_path / "out.tif", "--memory", "1GiB", "--disparities", "0:1500", "--threads", "1",
        ],
        stderr=subprocess.PIPE,
    )  # fmt: skip
    end = time.monotonic() + 60
    while not list(tmp_path.glob(".*.tmp")):
        assert begun.poll() is None
        assert time.monotonic() < end
        time.sleep(0.02)
    time.sleep(0.3)
    begun.send_signal(signal.SIGINT)
    _, err = begun.communicate(timeout=60)
    assert begun.returncode == 130
    assert b"interrupted" in err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["left.npy", "right.npy"]


# ---- the command -----------------------------------------------------------------------------------


def run(capsys, *arguments):
    code = cli.main([str(argument) for argument in arguments])
    told = capsys.readouterr()
    return code, told.out, told.err


def test_the_command_in_tiles(pair, tmp_path, capsys):
    files, images = pair
    code, out, _ = run(
        capsys, "match", *files, "-o", tmp_path / "a.tif", "--disparities", "0:16", "--memory", "1GiB"
    )
    assert code == 0
    assert f"wrote {tmp_path / 'a.tif'}" in out
    whole = st.match(*images, preset="fast", disparities=(0, 16)).disparity
    assert np.array_equal(st.read_disparity(tmp_path / "a.tif"), whole, equal_nan=True)


def test_the_command_writes_anything_where_the_whole_fits(pair, tmp_path, capsys):
    files, _ = pair
    common = ("match", *files, "-o", tmp_path / "a.png", "--disparities", "0:16")
    assert run(capsys, *common, "--memory", "64GiB")[0] == 0
    with_memory = (tmp_path / "a.png").read_bytes()
    assert run(capsys, *common)[0] == 0
    assert (tmp_path / "a.png").read_bytes() == with_memory
    code, _, err = run(capsys, *common, "--memory", "1MiB")
    assert code == 2
    assert "needs the whole map in memory" in err
    assert ".zarr are written in tiles" in err
    code, _, err = run(capsys, "match", *files, "-o", tmp_path / "depth.tif", "--memory", "1MiB")
    assert code == 2
    assert "depth.tif needs the whole map in memory" in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--memory", "much"), "memory must be an amount such as 2GiB"),
        (("--memory", "1GiB", "--set", "sky=on"), "sky must be False or 'auto' in tiles"),
        (("--memory", "1MiB"), "memory must leave at least"),
    ],
)
def test_the_command_says_what_is_wrong(pair, tmp_path, capsys, arguments, message):
    code, _, err = run(
        capsys, "match", *pair[0], "-o", tmp_path / "a.tif", "--disparities", "0:16", *arguments
    )
    assert code == 2
    assert err.startswith("stereopsis: error: ")
    assert message in err
    assert not (tmp_path / "a.tif").exists()
    code, _, err = run(capsys, "match", *pair[0], "-o", pair[0][0], "--memory", "1GiB")
    assert code == 2
    assert "is also read" in err


def test_the_extra_that_is_missing_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(ValueError, match=r"pip install 'stereopsis\[large\]'"):
        parts.check_map(tmp_path / "a.zarr")
    assert list(tmp_path.iterdir()) == []
