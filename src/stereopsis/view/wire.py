"""Messages between the server and its workers: arrays apart and uncopied, lengths first."""

from __future__ import annotations

import pickle
import struct
from io import RawIOBase
from typing import Any

_LENGTH = struct.Struct("<Q")


def send(pipe: RawIOBase, message: Any) -> None:
    """Write one message."""
    buffers: list[pickle.PickleBuffer] = []
    body = pickle.dumps(message, protocol=5, buffer_callback=buffers.append)
    parts = [body, *(buffer.raw() for buffer in buffers)]
    _write(pipe, _LENGTH.pack(len(parts)))
    for part in parts:
        _write(pipe, _LENGTH.pack(len(part)))
        _write(pipe, part)


def receive(pipe: RawIOBase) -> Any:
    """Read one message; raises EOFError where there is none any more."""
    count = _LENGTH.unpack(_read(pipe, _LENGTH.size))[0]
    body, *buffers = [_read(pipe, _LENGTH.unpack(_read(pipe, _LENGTH.size))[0]) for _ in range(count)]
    return pickle.loads(body, buffers=buffers)


def _write(pipe: RawIOBase, data: Any) -> None:
    view = memoryview(data).cast("B")
    while view:
        view = view[pipe.write(view) or 0 :]


def _read(pipe: RawIOBase, size: int) -> bytearray:
    data = bytearray(size)
    view = memoryview(data)
    while view:
        got = pipe.readinto(view)
        if not got:
            raise EOFError
        view = view[got:]
    return data
