"""Loaded into the workers of this machine: Ctrl-C is the client's to handle."""

from __future__ import annotations

import signal
from typing import Any


def dask_setup(worker: Any) -> None:
    """Ignore the interrupt that a terminal sends to the whole group of processes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
