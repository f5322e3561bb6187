"""Files appear whole or not at all."""

from __future__ import annotations

import errno
import os
import stat
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from stereopsis.io import read_disparity, write_disparity, write_output, write_preview
from stereopsis.io.atomic import replacing, write_bytes
from stereopsis.types import Calibration

posix = pytest.mark.skipif(os.name != "posix", reason="permissions, links and devices as POSIX has them")


def test_a_file_appears_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with replacing(path) as file:
        file.write(b"new")
        assert not path.exists()
    assert path.read_bytes() == b"new"
    write_bytes(str(path), b"newer")
    assert path.read_bytes() == b"newer"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [RuntimeError("half way"), KeyboardInterrupt()])
def test_a_failure_half_way_leaves_the_old_file(tmp_path: Path, error: BaseException) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"old")

    def fail() -> None:
        with replacing(path) as file:
            file.write(b"ne")
            file.flush()
            raise error

    with pytest.raises(type(error)):
        fail()
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with pytest.raises(OSError, match="No space left") as caught, replacing(path):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert caught.value.filename == str(path)
    assert not list(tmp_path.iterdir())


def test_a_killed_process_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"old")
    program = (
        "import os, sys\nfrom stereopsis.io.atomic import replacing\n"
        "with replacing(sys.argv[1]) as file:\n    file.write(b'ne')\n    file.flush()\n    os._exit(1)"
    )
    assert subprocess.run([sys.executable, "-c", program, str(path)], check=False).returncode == 1
    assert path.read_bytes() == b"old"


def test_errors_of_the_place_name_the_file(tmp_path: Path) -> None:
    missing = tmp_path / "nowhere" / "a.pfm"
    with pytest.raises(FileNotFoundError) as caught:
        write_disparity(missing, np.ones((2, 2), np.float32))
    assert caught.value.filename == str(missing)
    with pytest.raises(OSError, match=str(tmp_path)):
        write_bytes(tmp_path, b"")
    with pytest.raises(OSError, match="too long"):
        write_bytes(tmp_path / ("a" * 300), b"")
    assert not list(tmp_path.iterdir())


@posix
def test_permissions(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_bytes(tmp_path / "new", b"")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "new").stat().st_mode) == 0o640
    (tmp_path / "new").chmod(0o604)
    write_bytes(tmp_path / "new", b"")
    assert stat.S_IMODE((tmp_path / "new").stat().st_mode) == 0o604


@posix
@pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() == 0, reason="root may write anything")
def test_a_read_only_file_is_not_replaced(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"old")
    path.chmod(0o444)
    with pytest.raises(PermissionError) as caught:
        write_bytes(path, b"new")
    assert caught.value.filename == str(path)
    assert path.read_bytes() == b"old"


@posix
def test_a_link_stays_a_link(tmp_path: Path) -> None:
    target, link, dangling = tmp_path / "deep" / "target", tmp_path / "link", tmp_path / "dangling"
    target.parent.mkdir()
    target.write_bytes(b"old")
    link.symlink_to(target)
    write_bytes(link, b"new")
    assert link.is_symlink()
    assert target.read_bytes() == b"new"
    dangling.symlink_to(tmp_path / "later")
    write_bytes(dangling, b"new")
    assert (tmp_path / "later").read_bytes() == b"new"


@posix
def test_a_pipe_is_written_to(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    received: list[bytes] = []
    reader = threading.Thread(target=lambda: received.append(pipe.read_bytes()))
    reader.start()
    write_bytes(pipe, b"through")
    reader.join(10)
    assert received == [b"through"]
    assert pipe.is_fifo()


@pytest.mark.parametrize("name", ["a.png", "a.pfm", "a.npy", "a.tif", "a.jpg", "a-preview.png", "a.ply"])
def test_every_output_survives_a_failed_run(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = Calibration(focal=100.0, cx=1.0, cy=0.5, baseline=0.5)
    path = tmp_path / name
    path.write_bytes(b"precious")

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(OSError, match="No space left") as caught:
            write_output(path, np.ones((3, 4), np.float32), calibration=camera)
    assert caught.value.filename == str(path)
    assert path.read_bytes() == b"precious"
    assert list(tmp_path.iterdir()) == [path]


def test_what_cannot_be_encoded_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    write_disparity(path, np.ones((2, 2), np.float32))
    with pytest.raises(ValueError, match="lie outside"):
        write_disparity(path, np.full((2, 2), -1, np.float32))
    with pytest.raises(ValueError, match="range"):
        write_preview(path, np.ones((2, 2), np.float32), (2, 1))
    assert read_disparity(path).tolist() == [[1, 1], [1, 1]]
    assert list(tmp_path.iterdir()) == [path]
