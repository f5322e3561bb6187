"""File names of pairs: safe on every system, inside the output folder, and one a name.

A name becomes the path of a file below a folder; ``/`` parts folders. What a file system could misread is
written as ``%XX``, byte by byte in UTF-8, as in a URL.
"""

from __future__ import annotations

import re
from typing import Final
from urllib.parse import unquote_to_bytes

LONGEST: Final = 240
"""Bytes of one part of a path, with room for the suffix; file systems take 255."""

EMPTY: Final = "%"
"""What stands for a part without any letter: a percent sign of a name's own is always ``%25``."""

# Controls, what Windows refuses, the percent sign; lone surrogates are bytes that are no text.
_UNSAFE = re.compile(r'[\x00-\x1f\x7f-\x9f\\:*?"<>|%\u2028\u2029\ud800-\udfff]')
# A leading dot hides or climbs, Windows drops dots and spaces at the end.
_EDGES = re.compile(r"^[. ]|[. ]$")
_DEVICES = re.compile(r"^(con|prn|aux|nul|com\d|lpt\d)(?=\.|$)", re.IGNORECASE)


def escaped(name: str) -> str:
    """The path, without a suffix, of the pair that is called `name`; `unescaped` undoes it.

    Raises
    ------
    ValueError
        For no text at all, or a part longer than a file system takes.
    """
    if not isinstance(name, str) or not name:
        raise ValueError(f"a pair's name must be a text of at least one letter, not {name!r}")
    path = "/".join(map(_part, name.split("/")))
    longest = max(len(part.encode()) for part in path.split("/"))
    if longest > LONGEST:
        raise ValueError(f"the name is too long for a file: {longest} bytes, {LONGEST} are possible")
    return path


def unescaped(path: str) -> str:
    """The name whose path this is."""
    parts = ("" if part == EMPTY else part for part in path.split("/"))
    return "/".join(unquote_to_bytes(part).decode("utf-8", "surrogateescape") for part in parts)


def _part(part: str) -> str:
    if not part:
        return EMPTY
    safe = _UNSAFE.sub(_percent, part)
    safe = _EDGES.sub(_percent, safe)
    return _DEVICES.sub(lambda found: _percent(found, found[0][0]) + found[0][1:], safe)


def _percent(found: re.Match[str], letters: str | None = None) -> str:
    text = found[0] if letters is None else letters
    return "".join(f"%{byte:02X}" for byte in text.encode("utf-8", "surrogateescape"))
