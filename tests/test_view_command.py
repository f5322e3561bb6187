"""The command itself: it listens, says where, answers, and leaves nothing behind when it ends."""

from __future__ import annotations

import os
import queue
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import httpx
import numpy as np
import psutil
import pytest

import stereopsis as st
from stereopsis import _extras, cli

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals are sent in another way there")

SECONDS = 30.0
# -c leaves SIGINT as the interpreter has it, even under a runner that ignores it.
PREPARE = (
    "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    "from stereopsis.cli import main; sys.exit(main(sys.argv[1:]))"
)

PLACES = [str(Path(place).resolve()) for place in sys.path if place]


class Command:
    """A program that runs, with its folder for temporary files."""

    def __init__(self, process: subprocess.Popen[str], temporary: Path) -> None:
        self.process, self.temporary = process, temporary
        self._lines: queue.Queue[str] = queue.Queue()
        self._told = ""
        assert process.stderr is not None
        self.reader = threading.Thread(target=self._read, args=(process.stderr,), daemon=True)
        self.reader.start()

    def _read(self, stream: IO[str]) -> None:
        with stream:
            for line in stream:
                self._lines.put(line)
        self._lines.put("")

    def address(self) -> str:
        while line := self._lines.get(timeout=SECONDS):
            found = re.search(r"http://\S+?/(\?token=[\w-]+)?(?=;)", line)
            if found:
                return found[0]
            self._told += line
        raise AssertionError(f"no address: {self._told}")

    def end(self) -> int:
        """Ctrl-C; the exit code, once it and everything that it started is gone and has left nothing."""
        started = psutil.Process(self.process.pid).children(recursive=True)
        self.process.send_signal(signal.SIGINT)
        code = self.process.wait(SECONDS)
        _, alive = psutil.wait_procs(started, timeout=5)
        assert alive == []
        assert list(self.temporary.iterdir()) == []
        return code

    def rest(self) -> str:
        """What it told besides, once it has ended."""
        while line := self._lines.get(timeout=SECONDS):
            self._told += line
        return self._told


@contextmanager
def running(folder: Path, *arguments: str) -> Iterator[Command]:
    temporary = folder / "temporary"
    temporary.mkdir()
    process = subprocess.Popen(
        [sys.executable, "-c", PREPARE, *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
        env={
            **os.environ,
            "TMPDIR": str(temporary),
            "BROWSER": "true",
            "PYTHONPATH": os.pathsep.join(PLACES),
        },
    )
    command = Command(process, temporary)
    try:
        yield command
    finally:
        process.kill()
        process.wait()
        command.reader.join(SECONDS)


@pytest.fixture
def pair(tmp_path: Path) -> Path:
    scene = st.scenes.street(160, 80, 2)
    st.write_image(tmp_path / "left.png", scene.left)
    st.write_image(tmp_path / "right.png", scene.right)
    st.write_disparity(tmp_path / "truth.pfm", scene.disparity)
    st.io.write_calibration(tmp_path / "calib.txt", scene.calibration)
    return tmp_path


def test_a_pair_is_served_until_ctrl_c(pair: Path) -> None:
    files = ("left.png", "right.png", "--truth", "truth.pfm", "--calibration", "calib.txt", "--no-browser")
    with running(pair, "view", *files) as command:
        address = command.address()
        assert address.startswith("http://127.0.0.1:")
        with httpx.Client(base_url=address, timeout=SECONDS) as client:
            assert client.get("/").status_code == 200
            scene = client.post("/api/open", json={"sample": "left"}).json()
            assert (scene["has_truth"], scene["calibration"]["stated"]) == (True, True)
            body = {"scene": scene["scene"], "client": "test", "settings": {"preset": "fast"}}
            result = client.post("/api/match", json=body).json()
            data = client.get(f"/api/results/{result['result']}/disparity.bin").content
            own = st.match(st.read_pair(pair / "left.png", pair / "right.png"), preset="fast").disparity
            assert np.array_equal(np.frombuffer(data, np.float32).reshape(own.shape), own, equal_nan=True)
            sent = {"left": (pair / "left.png").read_bytes(), "right": (pair / "right.png").read_bytes()}
            assert client.post("/api/open", files=sent).status_code == 200
            refused = client.get("/api/info", headers={"host": "evil.example"})
            assert refused.status_code == 403
            # Held open: a browser does so too.
            assert command.end() == 0
        assert "Traceback" not in command.rest()


def test_ctrl_c_ends_a_long_computation_too(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (2, 900, 1200), np.uint8)
    for name, image in zip(("left.png", "right.png"), noise, strict=True):
        st.write_image(tmp_path / name, image)
    answers: list[int] = []
    with running(tmp_path, "view", "left.png", "right.png", "--no-browser") as command:
        address = command.address()
        scene = httpx.post(f"{address}api/open", json={"sample": "left"}, timeout=SECONDS).json()["scene"]
        settings = {"cost": {"name": "zsad", "window": 41}, "disparities": [0, 500]}
        body = {"scene": scene, "client": "test", "settings": settings}

        def ask() -> None:
            answers.append(httpx.post(f"{address}api/match", json=body, timeout=SECONDS).status_code)

        asking = threading.Thread(target=ask)
        asking.start()
        time.sleep(1.0)
        start = time.monotonic()
        assert command.end() == 0
        assert time.monotonic() - start < 5
        asking.join()
        assert "Traceback" not in command.rest()
    assert answers == [409]


def test_ctrl_c_at_once_leaves_nothing(tmp_path: Path) -> None:
    with running(tmp_path, "view", "--no-browser") as command:
        command.address()
        assert command.end() == 0


def test_processes_end_with_a_server_that_is_killed(pair: Path) -> None:
    with running(pair, "view", "left.png", "right.png", "--no-browser") as command:
        with httpx.Client(base_url=command.address(), timeout=SECONDS) as client:
            client.post("/api/open", json={"sample": "left"})
        started = psutil.Process(command.process.pid).children(recursive=True)
        assert started
        command.process.kill()
        assert psutil.wait_procs(started, timeout=10)[1] == []


def test_beyond_this_machine_a_token_is_asked_for(pair: Path) -> None:
    with running(pair, "view", "left.png", "right.png", "--host", "0.0.0.0", "--no-browser") as command:
        address = httpx.URL(command.address())
        token = address.params["token"]
        assert len(token) >= 32
        with httpx.Client(base_url=f"http://127.0.0.1:{address.port}", timeout=SECONDS) as client:
            assert client.get("/api/info").status_code == 401
            assert client.get(f"/?token={token[:-1]}").status_code == 401
            assert client.get(f"/?token={token}").status_code == 303
            assert client.get("/api/info").status_code == 200
        assert command.end() == 0


def test_show_opens_the_page_on_the_settings_of_the_match(pair: Path) -> None:
    files = ("left.png", "right.png", "--truth", "truth.pfm")
    options = ("--set", "window=9", "--disparities", "0:24", "--show")
    with running(pair, "match", *files, *options) as command:
        with httpx.Client(base_url=command.address(), timeout=SECONDS) as client:
            start = client.get("/api/info").json()["defaults"]
            assert start == {
                "preset": "fast",
                "disparities": [0, 24],
                "cost": {"name": "zncc", "window": [9, 9]},
            }
            scene = client.post("/api/open", json={"sample": "left"}).json()["scene"]
            body = {"scene": scene, "client": "test", "settings": start}
            result = client.post("/api/match", json=body).json()
        own = st.match(
            st.read_pair(pair / "left.png", pair / "right.png"),
            preset="fast",
            disparities=(0, 24),
            cost=st.ZNCC(9),
        )
        assert result["density"] == own.density
        assert command.end() == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["left.png", "right.png", "truth.pfm"], "3 paths are too many"),
        (["left.png", "right.png", "--left", "left.png"], "--left does not go with"),
        (["--truth", "truth.pfm"], "--truth does not go with"),
        (["missing.png"], "missing.png"),
        (["."], "holds no benchmark"),
        (["--host", "no such host"], "no such host"),
    ],
)
def test_what_cannot_be_opened_is_one_line(
    pair: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    words: str,
) -> None:
    monkeypatch.chdir(pair)
    assert cli.main(["view", "--no-browser", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("stereopsis: error: ")
    assert err.count("\n") == 1
    assert words in err


def test_a_port_that_is_taken_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert cli.main(["view", "--no-browser", "--port", str(port)]) == 2
    assert f"cannot listen on 127.0.0.1, port {port}" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [["view"], ["match", "left.png", "right.png", "--show"]])
def test_without_the_extra_it_says_which(
    pair: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
) -> None:
    monkeypatch.chdir(pair)
    monkeypatch.setattr(_extras, "find_spec", lambda name: None)
    assert cli.main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err == (
        "stereopsis: error: the page needs fastapi, uvicorn, python-multipart: install it with "
        "python -m pip install 'stereopsis[view]'\n"
    )
