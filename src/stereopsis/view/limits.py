"""What the server takes, computes and keeps at most."""

from __future__ import annotations

import os
from dataclasses import dataclass, field


def _computations() -> int:
    return 1 if (os.cpu_count() or 1) < 4 else 2


def _memory() -> int:
    """Half of the machine's memory, or 0 where it does not say."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2
    except (AttributeError, OSError, ValueError):
        return 0


@dataclass(frozen=True)
class Limits:
    """Bounds of one server.

    Attributes
    ----------
    upload_bytes : int
        Of one request.
    pixels : int
        Of an image, read from its header before it is decoded.
    disparities : int
        Candidates of a range.
    computations : int
        Maps that are matched at once.
    waiting : int
        Computations that wait; one more is refused.
    memory : int
        Bytes that a process which computes may have; 0 for no limit.
    scene_bytes, result_bytes : int
        What is kept; the least recently asked for goes first.
    open_seconds, match_seconds : float
        The longest that opening and looking, and matching may take.
    """

    upload_bytes: int = 128 * 2**20
    pixels: int = 2**24
    disparities: int = 1024
    computations: int = field(default_factory=_computations)
    waiting: int = 64
    memory: int = field(default_factory=_memory)
    scene_bytes: int = 256 * 2**20
    result_bytes: int = 256 * 2**20
    open_seconds: float = 60.0
    match_seconds: float = 600.0
