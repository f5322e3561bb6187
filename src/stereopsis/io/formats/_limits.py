"""What a header may claim, checked before anything is allocated."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from math import prod

MAX_BYTES = 2**33
"""The largest file that is read: `MAX_PIXELS` of three doubles each, and some room."""

MAX_PIXELS = 2**28
"""The largest image that is read: 16384 by 16384."""

MAX_SIDE = 10**6
"""The longest side that is read, which is libpng's limit too."""

_most: ContextVar[int] = ContextVar("most", default=MAX_PIXELS)

_HARMLESS = 2**26
_DEFLATE_LIMIT = 1032  # https://zlib.net/zlib_tech.html; JPEG packs no more than 1024 : 1


@contextmanager
def at_most(pixels: int) -> Iterator[None]:
    """Read no larger image than this within the block."""
    token = _most.set(min(pixels, MAX_PIXELS))
    try:
        yield
    finally:
        _most.reset(token)


def check_shape(shape: Sequence[int], itemsize: int, stored: int | None = None) -> None:
    """Refuse an empty image, one that is too large, and one that `stored` compressed bytes cannot hold."""
    if prod(shape) < 1:
        raise ValueError(f"the header claims an empty image, {_text(shape)}")
    if shape[0] * shape[1] > _most.get() or max(shape) > MAX_SIDE:
        raise ValueError(
            f"the header claims {_text(shape)} pixels; the limit is {_most.get()} pixels, {MAX_SIDE} a side"
        )
    size = prod(shape) * itemsize
    if stored is not None and size > max(_HARMLESS, _DEFLATE_LIMIT * stored):
        raise ValueError(f"truncated: {stored} bytes cannot hold the {_text(shape)} pixels of the header")


def check_length(actual: int, expected: int) -> None:
    """Refuse pixel data that is longer or shorter than the header says."""
    if actual != expected:
        verdict = "truncated" if actual < expected else "wrong size"
        raise ValueError(
            f"{verdict}: the header announces {expected} bytes of pixels, the file holds {actual}"
        )


def _text(shape: Sequence[int]) -> str:
    return f"{shape[1]} x {shape[0]}"
