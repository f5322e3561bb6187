"""What Dask's schedulers and workers load first; those of this machine do so by themselves.

::

    dask scheduler --preload stereopsis.batch.preload
    dask worker tcp://host:8786 --preload stereopsis.batch.preload
"""

from __future__ import annotations

import ctypes
import multiprocessing
import signal
import time
from contextlib import suppress
from typing import Any, Final

# Of glibc's malloc.h.
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3

_DAY: Final = time.time() - time.monotonic()


def steady_time() -> float:
    """The time of day as it was when this was loaded, and what has passed since: nobody sets it."""
    return _DAY + time.monotonic()


def steady() -> None:
    """Keep Dask's messages going when the clock is set back.

    It waits until the time of day has passed that of its last message by two milliseconds, and so would be
    silent for as long as the clock was set back.
    """
    from distributed import batched
    from tornado.ioloop import IOLoop

    if getattr(batched, "time", None) is time.time:
        batched.time = steady_time
    # The deadline is the first's, the clock that it is held against the second's.
    IOLoop.time = lambda _: steady_time()  # type: ignore[method-assign,assignment]


def keep_memory() -> None:
    """Let the C library keep some freed memory for the next pair.

    Dask has it give all back at once, and asking for every array's pages again takes a fifth of the time.
    """
    with suppress(AttributeError, OSError, TypeError):  # where it is not glibc
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(_TRIM_THRESHOLD, 2**26)
        mallopt(_MMAP_THRESHOLD, 2**25)


def dask_setup(worker: Any) -> None:
    """Called by Dask in a scheduler or worker that starts."""
    steady()
    keep_memory()
    if multiprocessing.parent_process() is not None:
        # A terminal's Ctrl-C reaches all processes of a run; it is the client's to handle.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
