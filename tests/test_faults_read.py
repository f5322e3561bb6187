"""Files that cannot be read: one sentence that names the file, soon, and exit code 2 on the command line."""

from __future__ import annotations

import functools
import io
import json
import os
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image

import stereopsis as st
from stereopsis.cli import main

CORPUS = Path(__file__).parent / "fuzz" / "corpus"
IMAGES = ["grey.png", "grey.jpg", "grey.tif", "grey.pgm", "deep.ppm", "colour.pfm", "image.npy"]
MAPS = ["kitti.png", "disparity.pfm", "disparity.npy", "disparity.tif"]
GIBIBYTE = 2**30

posix = pytest.mark.skipif(os.name != "posix", reason="POSIX has them")

READERS: list[Callable[[Path], object]] = [
    st.read_image,
    st.read_disparity,
    st.read_calibration,
    st.io.describe,
    lambda path: st.read_pair(path, path),
    lambda path: st.Settings.make(file=path),
]


def refused(
    path: Path, error: type[Exception], *, readers: list[Callable[[Path], object]] | None = None
) -> list[str]:
    """What every reader says of the file: one line that names it, within a second."""
    said = []
    for reader in READERS if readers is None else readers:
        began = time.perf_counter()
        with pytest.raises(error) as caught:
            reader(path)
        assert time.perf_counter() - began < 5
        if isinstance(caught.value, OSError):
            assert caught.value.filename == str(path)
            said.append(str(caught.value.strerror))
        else:
            assert str(caught.value).startswith(str(path))
            said.append(str(caught.value).removeprefix(f"{path}: "))
        assert "\n" not in said[-1]
        assert len(said[-1]) < 400
    return said


def command_refuses(
    capsys: pytest.CaptureFixture[str], path: Path, word: str = "", info: str | None = None
) -> None:
    """Every command that reads it ends with 2 and one line that names it; `info` says another word."""
    good = str(CORPUS / "grey.png")
    for arguments in (
        ["info", str(path)],
        ["match", str(path), good],
        ["match", good, str(path)],
        ["match", good, good, "--calibration", str(path)],
        ["match", good, good, "--truth", str(path)],
        ["match", good, good, "--settings", str(path)],
        ["evaluate", str(path), str(CORPUS / "kitti.png")],
        ["evaluate", str(CORPUS / "kitti.png"), str(path), "--mask", str(path)],
        ["study", "-o", str(path.parent / "report"), "--settings", str(path)],
    ):
        assert main(arguments) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert err.startswith("stereopsis: error: ")
        assert err.count("\n") == 1
        assert path.name in err
        assert (info if info is not None and arguments[0] == "info" else word) in err
    assert not (path.parent / "report").exists()


@pytest.mark.parametrize("name", IMAGES)
def test_truncated_image(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    path = tmp_path / name
    data = (CORPUS / name).read_bytes()
    path.write_bytes(data[: len(data) // 2])
    refused(path, ValueError, readers=[st.read_image, st.io.describe])
    assert main(["match", str(path), str(CORPUS / name), "-o", str(tmp_path / "out.png")]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"stereopsis: error: {path}: ")
    assert err.count("\n") == 1
    assert [file.name for file in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("name", MAPS)
def test_truncated_disparity_map(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    path = tmp_path / name
    data = (CORPUS / name).read_bytes()
    path.write_bytes(data[: len(data) // 2])
    refused(path, ValueError, readers=[st.read_disparity, st.io.describe])
    assert main(["evaluate", str(CORPUS / name), str(path)]) == 2
    assert capsys.readouterr().err.startswith(f"stereopsis: error: {path}: ")


@pytest.mark.parametrize("name", ["kitti.txt", "middlebury.txt", "opencv.yml"])
def test_truncated_calibration(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    data = (CORPUS / name).read_bytes()
    path.write_bytes(data[: len(data) // 2])
    refused(path, ValueError, readers=[st.read_calibration, st.io.describe])


def test_pair_of_different_sizes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    left, right = tmp_path / "left.png", tmp_path / "right.png"
    st.write_image(left, np.zeros((6, 9), np.uint8))
    st.write_image(right, np.zeros((6, 8), np.uint8))
    assert main(["match", str(left), str(right), "-o", str(tmp_path / "out.png")]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err == (
        f"stereopsis: error: the images of a pair must be alike: {left} is 9 x 6 grey uint8, "
        f"{right} is 8 x 6 grey uint8\n"
    )
    truth = tmp_path / "truth.pfm"
    st.write_disparity(truth, np.ones((5, 9), np.float32))
    assert main(["match", str(left), str(left), "--truth", str(truth)]) == 2
    assert f"{truth} holds 9 x 5 pixels, but {left} has 9 x 6" in capsys.readouterr().err


@pytest.mark.parametrize("suffix", ["png", "jpg", "tif", "pgm", "pfm", "npy", "txt", "yml", "ply"])
def test_empty_file(tmp_path: Path, capsys: pytest.CaptureFixture[str], suffix: str) -> None:
    path = tmp_path / f"empty.{suffix}"
    path.write_bytes(b"")
    for said in refused(path, ValueError, readers=READERS[:-1]):
        assert said == "the file is empty"
    assert main(["info", str(path)]) == 2
    assert capsys.readouterr().err == f"stereopsis: error: {path}: the file is empty\n"


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="Linux has a file that cannot be read")
def test_unreadable_file(tmp_path: Path) -> None:
    """Opens, but reading its first byte is an error of input and output."""
    path = tmp_path / "broken-disk.png"
    path.symlink_to("/proc/self/mem")
    assert set(refused(path, OSError)) == {"Input/output error"}


@posix
def test_permission_denied() -> None:
    """In a process that is not root's."""
    folder = Path(tempfile.mkdtemp())
    try:
        folder.chmod(0o755)
        path = folder / "secret.png"
        shutil.copy(CORPUS / "grey.png", path)
        path.chmod(0)
        code = f"""
import os, sys
from pathlib import Path
import stereopsis as st
from stereopsis.cli import main
import PIL.PngImagePlugin, imagecodecs, rich.table, stereopsis.study
if os.geteuid() == 0:
    os.seteuid(65534)
path = Path({str(path)!r})
for reader in (st.read_image, st.read_disparity, st.read_calibration, st.io.describe):
    try:
        reader(path)
    except PermissionError as error:
        assert error.filename == str(path)
    else:
        sys.exit("read")
try:
    st.Settings.make(file=path)
except PermissionError as error:
    assert error.filename == str(path)
else:
    sys.exit("read")
sys.exit(main(["info", str(path)]))
"""
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        assert done.returncode == 2, done.stderr
        assert done.stderr.startswith("stereopsis: error: ")
        assert done.stderr.count("\n") == 1
        assert "secret.png" in done.stderr
    finally:
        shutil.rmtree(folder)


def test_missing_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(tmp_path / "nowhere.png", FileNotFoundError)
    command_refuses(capsys, tmp_path / "nowhere.png", "does not exist")


def test_folder_in_place_of_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "left.png"
    folder.mkdir()
    refused(folder, OSError)
    command_refuses(capsys, folder, "is a directory", info="holds no benchmark")


@posix
def test_symlink_loop(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, other = tmp_path / "one.png", tmp_path / "other.png"
    one.symlink_to(other)
    other.symlink_to(one)
    refused(one, OSError)
    command_refuses(capsys, one)


@posix
def test_pipe_as_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nobody writes into it: whoever opens it as a file waits for ever."""
    pipe = tmp_path / "pipe.png"
    os.mkfifo(pipe)
    assert set(refused(pipe, ValueError)) == {"not a file but a pipe; write it to a file first"}
    command_refuses(capsys, pipe, "a pipe")


@posix
def test_device_as_input(capsys: pytest.CaptureFixture[str]) -> None:
    """It never ends."""
    assert set(refused(Path("/dev/zero"), ValueError)) == {
        "not a file but a device; write it to a file first"
    }
    assert main(["info", "/dev/zero"]) == 2
    assert "a device" in capsys.readouterr().err


@posix
def test_socket_as_input() -> None:
    with tempfile.TemporaryDirectory() as folder, socket.socket(socket.AF_UNIX) as listening:
        path = Path(folder) / "s"  # a socket's name must be short
        listening.bind(str(path))
        refused(path, OSError)


@posix
@pytest.mark.parametrize(
    "start",
    [
        b"A letter to a friend.\n",
        b"P2\n10 10\n255\n",
        b"P5\n10 10\n255\n",
        b"Pf\n10 10\n-1\n",
        b"\x93NUMPY\x01\x00v\x00{'descr': '<f4', 'fortran_order': False, 'shape': (9, 9), }".ljust(127)
        + b"\n",
        (CORPUS / "grey.png").read_bytes(),
        b"%YAML:1.0\n---\n",
        b"cam0=[1 0 1; 0 1 1; 0 0 1]\n",
        b'preset = "fast"\n',
    ],
    ids=["text", "plain", "netpbm", "pfm", "npy", "png", "yaml", "calibration", "toml"],
)
def test_two_gigabytes_of_text_named_png(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], start: bytes
) -> None:
    path = tmp_path / "letter.png"
    path.write_bytes(start)
    os.truncate(path, 2 * GIBIBYTE)  # takes no room on the disk
    began = time.perf_counter()
    refused(path, ValueError)
    command_refuses(capsys, path)
    assert time.perf_counter() - began < 5


# ---- decompression bombs ---------------------------------------------------------------------------------


def chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


@functools.cache
def zeros(size: int) -> bytes:
    """So many zeros, packed a thousand to one."""
    packer = zlib.compressobj(6)
    block = bytes(2**20)
    return b"".join(packer.compress(block) for _ in range(size // len(block))) + packer.flush()


def png(width: int, height: int, packed: bytes, *others: bytes) -> bytes:
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + b"".join(others) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")


def tiff(payload: bytes, compression: int, **tags: int) -> bytes:
    """A TIFF of 8 x 8 pixels whose only strip is `payload`, and whose tags lie."""
    file = io.BytesIO()
    tifffile.imwrite(file, np.zeros((8, 8), np.uint8), metadata=None)
    made = bytearray(file.getvalue())
    with tifffile.TiffFile(io.BytesIO(bytes(made))) as read:
        entries: Any = {tag.name: tag.offset for tag in read.pages.first.tags}
    values = {"Compression": compression, "StripOffsets": len(made), "StripByteCounts": len(payload), **tags}
    for name, value in values.items():
        struct.pack_into("<H", made, entries[name] + 2, 4)
        struct.pack_into("<II", made, entries[name] + 4, 1, value)
    return bytes(made) + payload


def jpeg_of_65500() -> bytes:
    file = io.BytesIO()
    Image.fromarray(np.zeros((8, 8), np.uint8)).save(file, "JPEG")
    made = bytearray(file.getvalue())
    at = made.index(b"\xff\xc0")
    struct.pack_into(">HH", made, at + 5, 65500, 65500)
    return bytes(made)


def shared_lists() -> bytes:
    """A matrix whose numbers are lists of lists that share their parts: as a text, 9 to the 19th of them."""
    lists = ", ".join(["&b0 [1]", *(f"&b{n} [{', '.join([f'*b{n - 1}'] * 9)}]" for n in range(1, 20))])
    matrix = f"rows: 1\n   cols: 1\n   more: [{lists}]\n   data: [*b19]\n"
    return f"%YAML:1.0\n---\nP1: !!opencv-matrix\n   {matrix}".encode()


def merged_mappings() -> bytes:
    """Mappings that merge the one before nine times."""
    lines = [f"k{n}: &b{n} {{<<: [{', '.join([f'*b{n - 1}'] * 9)}]}}" for n in range(1, 20)]
    return "\n".join(["%YAML:1.0", "---", "k0: &b0 {x: 1}", *lines, ""]).encode()


def bombs() -> Iterator[tuple[str, bytes]]:
    yield "header.png", png(100_000, 100_000, zlib.compress(bytes(100)))
    yield "allowed.png", png(16_384, 16_384, zlib.compress(bytes(100)))
    yield "idat.png", png(8, 8, zeros(2**28))
    yield "header.jpg", jpeg_of_65500()
    yield "header.tif", tiff(bytes(64), 1, ImageWidth=100_000, ImageLength=100_000)
    yield "strip.tif", tiff(bytes(64), 1, ImageWidth=100_000, ImageLength=2_000, RowsPerStrip=2_000)
    yield "zlib.tif", tiff(zeros(2**28), 8)
    yield "packbits.tif", tiff(b"\x81\0" * 2**20, 32773)
    yield "jpeg.tif", tiff(jpeg_of_65500(), 7)
    yield "png.tif", tiff(png(65_000, 65_000, zeros(2**22)), 34933)
    yield "shared.yml", shared_lists()
    yield "merged.yml", merged_mappings()
    yield "header.pfm", b"Pf\n1000000000 1000000000\n-1\n"
    yield "long.pfm", b"Pf\n" + b"9" * 5000 + b" 1\n-1\n"
    yield "header.pgm", b"P5\n100000 100000\n255\n"
    yield (
        "header.npy",
        (
            b"\x93NUMPY\x01\x00v\x00"
            + b"{'descr': '<f8', 'fortran_order': False, 'shape': (900000, 900000), }".ljust(117)
            + b"\n"
        ),
    )
    yield (
        "points.ply",
        (
            b"ply\nformat binary_little_endian 1.0\nelement vertex 999999999999\n"
            b"property float x\nproperty float y\nproperty float z\nend_header\n"
        ),
    )


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="Linux says what a process held")
def test_decompression_bombs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """In a process of its own, which must not grow."""
    (tmp_path / "0.png").write_bytes((CORPUS / "grey.png").read_bytes())
    (tmp_path / "0.tif").write_bytes((CORPUS / "lzw.tif").read_bytes())
    (tmp_path / "0.yml").write_bytes((CORPUS / "opencv.yml").read_bytes())
    names = ["0.png", "0.tif", "0.yml"]
    for name, data in bombs():
        (tmp_path / name).write_bytes(data)
        names.append(name)
    code = """
import json, re, sys, time
import stereopsis as st
def held():  # ru_maxrss begins with what the parent held
    return int(re.search(r"VmHWM:\\s+(\\d+) kB", open("/proc/self/status").read())[1])
said = {}
for name in sys.argv[1:]:
    before, began = held(), time.perf_counter()
    try:
        (st.read_calibration if name.endswith(".yml") else st.io.describe)(name)
        message = "read"
    except ValueError as error:
        message = str(error)
    said[name] = message, (held() - before) / 2**10, time.perf_counter() - began
print(json.dumps(said))
"""
    paths = [str(tmp_path / name) for name in names]
    done = subprocess.run([sys.executable, "-c", code, *paths], capture_output=True, text=True, check=False)
    assert done.stderr == ""
    said = json.loads(done.stdout)
    assert [said.pop(path)[0] for path in paths[:3]] == ["read"] * 3
    for path, (message, grown, seconds) in said.items():
        name = Path(path).name
        assert message.startswith(f"{path}: "), message
        assert "MemoryError" not in message
        assert grown < 64, (name, grown)
        assert seconds < 5, (name, seconds)
        assert main(["info", path]) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert err.startswith(f"stereopsis: error: {path}: ")
        assert err.count("\n") == 1


def test_bomb_beside_the_pixels_is_never_unpacked(tmp_path: Path) -> None:
    """Texts and profiles are skipped: the picture is whole."""
    packed = zeros(2**28)
    text, profile = chunk(b"zTXt", b"key\0\0" + packed), chunk(b"iCCP", b"name\0\0" + packed)
    path = tmp_path / "a.png"
    path.write_bytes(png(8, 8, zlib.compress(bytes(72)), text, profile))
    began = time.perf_counter()
    assert st.read_image(path).shape == (8, 8)
    assert time.perf_counter() - began < 2


def test_name_that_no_system_takes(tmp_path: Path) -> None:
    for name in ("a\0b.png", "a" * 5000):
        with pytest.raises(OSError, match=r"argument|too long") as caught:
            st.read_image(tmp_path / name)
        assert caught.value.filename == str(tmp_path / name)
