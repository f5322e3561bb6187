"""One kind of error for whatever a broken file makes a decoder raise."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike, fspath

StrPath = str | PathLike[str]


@contextmanager
def naming(path: StrPath) -> Iterator[None]:
    """Turn whatever is raised into one ``ValueError`` of one line that begins with the file's name."""
    try:
        yield
    # Decoders raise whatever a broken file leads them to: struct.error, KeyError, RuntimeError, MemoryError.
    except Exception as error:
        reason = " ".join(str(error).split())[:300]
        if type(error) is not ValueError:
            reason = f"damaged or not supported ({type(error).__name__}: {reason})"
        raise ValueError(f"{fspath(path)}: {reason}") from error


def reason(error: BaseException) -> str:
    """Why something failed, in one line."""
    if isinstance(error, OSError) and error.filename:
        return f"{error.filename}: {error.strerror}"
    return " ".join(str(error).split()) or type(error).__name__
