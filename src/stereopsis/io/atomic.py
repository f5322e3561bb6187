"""Files that appear whole or not at all."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from stereopsis.io._errors import StrPath


@contextmanager
def replacing(path: StrPath) -> Iterator[BinaryIO]:
    """Open a new file that takes the place of `path` when the block ends well.

    The block writes to a temporary file in the same folder, which is then flushed to the disk and renamed.
    When the block raises, the temporary file is removed and `path` stays as it was. A new file gets the
    permissions that the umask gives, an existing one keeps its own. A symbolic link stays a link: the file
    it points to is replaced. A device or a pipe is written to directly.

    Parameters
    ----------
    path : str or path-like
        The file to write.

    Yields
    ------
    binary file
        Open for writing.

    Raises
    ------
    OSError
        A missing folder, no permission, a full disk: with `path` as its file name.
    """
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{os.urandom(6).hex()}.tmp")
    try:
        if target.exists() and not target.is_file():
            with target.open("wb") as file:
                yield file
            return
        if target.exists() and not os.access(target, os.W_OK):
            # The rename alone would replace a read-only file.
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        try:
            with temporary.open("xb") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            if target.exists():
                temporary.chmod(target.stat().st_mode & 0o7777)
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), os.fspath(path)) from error


def write_bytes(path: StrPath, data: bytes) -> None:
    """Write `data` to `path`, whole or not at all; see `replacing`."""
    with replacing(path) as file:
        file.write(data)
