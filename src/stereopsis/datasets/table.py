"""A table of paths, CSV or Parquet: a row a pair.

Columns ``left`` and ``right``, and, where there are any, ``name``, ``truth``, ``calibration`` and
``mask``, which may be empty. Paths are relative to the table's folder. A mask is white, 255, where both
cameras see.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from stereopsis.datasets.readers import White
from stereopsis.datasets.sample import Sample, check_name
from stereopsis.io._errors import naming

NAME = "table"
LAYOUT = (
    "a .csv or .parquet file with the columns left, right, and name, truth, calibration, mask where there "
    "are any"
)
SUFFIXES = (".csv", ".parquet")

_PATHS = ("left", "right", "truth", "calibration", "mask")
_COLUMNS = ("left", "right", "name", "truth", "calibration", "mask")


def read(file: Path) -> list[Sample]:
    """Read the pairs of a table, in the order of its rows.

    Raises
    ------
    OSError
        It cannot be read.
    ValueError
        It is no such table, or a row is wrong, which is named: the first one below the header is row 1. Or
        it is Parquet, and pyarrow is not installed.
    """
    data = file.read_bytes()
    with naming(file):
        rows = list(_parquet(data) if file.suffix.lower() == ".parquet" else _csv(data))
    samples: list[Sample] = []
    rows_of: dict[str, int] = {}
    for number, row in enumerate(rows, 1):
        sample = _sample(file, number, row)
        first = rows_of.setdefault(sample.name, number)
        if first != number:
            raise ValueError(
                f"{file}: row {number}, column name: {sample.name!r} is the name of row {first} too; "
                "give each pair a name of its own"
            )
        samples.append(sample)
    if not samples:
        raise ValueError(f"{file} holds no pair: there is no row below its header")
    return samples


def _csv(data: bytes) -> Iterator[Mapping[str, Any]]:
    lines = csv.reader(io.StringIO(data.decode("utf-8-sig"), newline=""), strict=True)
    header = _header([column.strip() for column in next(lines, [])])
    for number, fields in enumerate(filter(None, lines), 1):
        if len(fields) != len(header):
            raise ValueError(f"row {number} has {len(fields)} fields, the header {len(header)}")
        yield dict(zip(header, fields, strict=True))


def _parquet(data: bytes) -> Iterator[Mapping[str, Any]]:
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ModuleNotFoundError:
        raise ValueError(
            "Parquet needs pyarrow: install it with python -m pip install 'stereopsis[study]'"
        ) from None
    content = parquet.ParquetFile(pa.BufferReader(data))
    header = _header(content.schema_arrow.names)
    for batch in content.iter_batches(columns=header):
        yield from batch.to_pylist()


def _header(columns: list[str]) -> list[str]:
    for column in ("left", "right"):
        if column not in columns:
            raise ValueError(f"there is no column {column}; the columns are {', '.join(columns) or 'none'}")
    for column in columns:
        if column not in _COLUMNS:
            raise ValueError(f"there may be no column {column!r}; known are {', '.join(_COLUMNS)}")
        if columns.count(column) > 1:
            raise ValueError(f"there are two columns {column}")
    return columns


def _sample(table: Path, number: int, row: Mapping[str, Any]) -> Sample:
    def wrong(column: str, reason: str) -> ValueError:
        return ValueError(f"{table}: row {number}, column {column}: {reason}")

    text: dict[str, str] = {}
    for column, value in row.items():
        if value is not None and not isinstance(value, str):
            raise wrong(column, f"{value!r} is not text")
        text[column] = (value or "").strip()
    files: dict[str, Path] = {}
    for column in _PATHS:
        if text.get(column):
            files[column] = table.parent / text[column]
    for column in ("left", "right"):
        if column not in files:
            raise wrong(column, "it is empty")
    try:
        name = check_name(text.get("name") or _name(text["left"]))
    except ValueError as error:
        raise wrong("name", str(error)) from None
    return Sample(
        name,
        files["left"],
        files["right"],
        files.get("truth"),
        files.get("calibration"),
        read_mask=White(files["mask"]) if "mask" in files else None,
    )


def _name(left: str) -> str:
    """The left view's path without its suffix, where it leads downwards; else its name alone."""
    path = PurePosixPath(left.replace("\\", "/"))
    inside = not path.is_absolute() and ".." not in path.parts and ":" not in left
    return path.with_suffix("").as_posix() if inside else path.stem
