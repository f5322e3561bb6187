"""Tables as CSV: a float is written so that reading it gives the same bits."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from typing import Any


def cell(value: Any) -> str:
    """A value as text: nothing for None, every digit that counts of a float."""
    return "" if value is None else repr(value) if isinstance(value, float) else str(value)


def as_csv(head: Sequence[str], lines: Iterable[Iterable[Any]]) -> bytes:
    """A line of names and lines of values, in UTF-8; bytes of a name that are no text as ``\\udcXX``."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows([cell(value) for value in line] for line in lines)
    return text.getvalue().encode("utf-8", "backslashreplace")
