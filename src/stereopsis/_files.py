"""Reading files that may be anything: nothing that never ends, and nothing larger than it can be."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path
from typing import Final

_KINDS: Final = ((stat.S_ISFIFO, "a pipe"), (stat.S_ISSOCK, "a socket"), (stat.S_ISCHR, "a device"))


def as_path(path: str | os.PathLike[str]) -> Path:
    """`path` as a `Path`; raises TypeError for what is none."""
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"path must be a str or path-like, not {type(path).__name__}")
    return Path(path)


@contextmanager
def opened(path: str | os.PathLike[str]) -> Iterator[tuple[BufferedReader, int]]:
    """Open a file for reading, with its size in bytes.

    Raises
    ------
    OSError
        It cannot be opened or read, with `path` as its file name; `IsADirectoryError` for a folder.
    TypeError
        `path` is none.
    ValueError
        It is no file but a pipe or a device, which might never end.
    """
    name = str(as_path(path))
    if "\0" in name:
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL), name)
    try:
        with open(name, "rb", opener=_without_waiting) as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                kind = next((kind for test, kind in _KINDS if test(status.st_mode)), "something else")
                raise ValueError(f"{name}: not a file but {kind}; write it to a file first")
            yield file, status.st_size
    except OSError as error:
        # Reading, unlike opening, does not say which file it was.
        raise OSError(error.errno, error.strerror or str(error), name) from error


def read(path: str | os.PathLike[str], most: int, what: str) -> bytes:
    """Read a whole file of at most `most` bytes; messages call `what` it should be.

    Raises
    ------
    OSError
        As `opened`.
    ValueError
        As `opened`; or the file is larger.
    """
    with opened(path) as (file, size):
        if size > most:
            raise ValueError(f"{os.fspath(path)}: {size} bytes are too many for {what}; the limit is {most}")
        # One byte more: even an empty file is tried, and a disk that fails is told from it.
        return file.read(size + 1)


def _without_waiting(path: str, flags: int) -> int:
    """Open a pipe without waiting for the one who writes."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
