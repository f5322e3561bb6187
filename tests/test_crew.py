"""The threads that work for one match: whose they are, and what becomes of them."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import stereopsis as st
from stereopsis import _core

CHOSEN = {"disparities": (0, 24), "preset": "fast"}


def pair():
    rng = np.random.default_rng(3)
    left = rng.integers(0, 256, (120, 200, 3)).astype(np.uint8)
    return left, np.roll(left, -7, axis=1)


def bits(result):
    return result.disparity.tobytes(), result.confidence.tobytes(), result.flags.tobytes()


def threads_now():
    return len(list(Path("/proc/self/task").iterdir()))


on_linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="threads are counted in /proc")
where_forks = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")


def test_what_is_done_with_a_crew_is_returned():
    told = object()
    assert _core.with_crew(lambda: told) is told


def test_what_is_raised_with_a_crew_is_raised():
    grey = np.empty((40, 50, 1), np.uint8)

    def work():
        _core.grey(np.zeros((40, 50, 3), np.uint8), grey, 4, "")
        raise KeyError("told")

    for _ in range(3):
        with pytest.raises(KeyError, match="told"):
            _core.with_crew(work)
    with pytest.raises(ValueError, match="shape"):
        _core.with_crew(lambda: _core.speckle(np.zeros((9, 9), np.float32), 3, 1.0, grey[..., 0], 3, ""))


@on_linux
def test_a_crew_ends_with_its_work():
    before = threads_now()
    found = np.empty((200, 300), np.uint8)

    def speckle():
        _core.speckle(np.zeros((200, 300), np.float32), 5, 1.0, found, 4, "")
        return threads_now()

    def twice():
        # One crew, also for what asks for another.
        return speckle(), _core.with_crew(speckle)

    assert _core.with_crew(twice) == (before + 3, before + 3)
    assert threads_now() == before
    st.match(*pair(), **CHOSEN, threads=4)
    assert threads_now() == before


def test_every_thread_has_its_own():
    left, right = pair()
    expected = bits(st.match(left, right, **CHOSEN, threads=1))
    with ThreadPoolExecutor(6) as pool:
        for found in pool.map(lambda k: st.match(left, right, **CHOSEN, threads=1 + k % 4), range(60)):
            assert bits(found) == expected


FORKS = """
import os, sys, threading
import numpy as np
import stereopsis as st

rng = np.random.default_rng(3)
left = rng.integers(0, 256, (120, 200, 3)).astype(np.uint8)
right = np.roll(left, -7, axis=1)
match = lambda: st.match(left, right, disparities=(0, 24), preset="fast", threads=3).disparity.tobytes()
expected = match()
stop = threading.Event()
def others():
    while not stop.is_set():
        assert match() == expected
thread = threading.Thread(target=others)
if sys.argv[1] == "beside":
    thread.start()
for _ in range(20):
    child = os.fork()
    if child == 0:
        # The thread that forks, and it alone, goes on here: with threads of its own.
        os._exit(0 if match() == expected and match() == expected else 1)
    assert os.waitpid(child, 0)[1] == 0
    assert match() == expected
stop.set()
if sys.argv[1] == "beside":
    thread.join()
"""


@where_forks
@pytest.mark.parametrize("when", ["after", "beside"])
def test_a_process_forks(when):
    """After matches, and while another thread is matching."""
    subprocess.run([sys.executable, "-c", FORKS, when], check=True, timeout=120)


ENDS = """
import sys, threading, time
import numpy as np
import stereopsis as st

threads, height, width = map(int, sys.argv[1:])
left = np.random.default_rng(3).integers(0, 256, (height, width, 3)).astype(np.uint8)
right = np.roll(left, -7, axis=1)
started = threading.Event()
def others():
    while True:
        st.match(left, right, disparities=(0, 24), preset="balanced", threads=threads)
        started.set()
threading.Thread(target=others, daemon=True).start()
started.wait()
time.sleep(0.03)
"""


@pytest.mark.parametrize("shape", [(500, 700), (30, 40)], ids=["in the core", "in Python"])
@pytest.mark.parametrize("threads", [1, 2])
def test_an_interpreter_ends_beside_a_match(threads, shape):
    """A daemon thread that matches is left behind; the process ends as if it were not there."""
    for _ in range(3):
        ended = subprocess.run(
            [sys.executable, "-c", ENDS, str(threads), *map(str, shape)], capture_output=True, timeout=120
        )
        assert (ended.returncode, ended.stderr) == (0, b"")
