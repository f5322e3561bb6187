"""Broken files without end, each from a number: the same number gives the same file.

`inputs` takes a file of the corpus and changes it where such files break: numbers of a header, chunks with
their checksums put right, tags, lines, bytes. `judge` gives it to every reader, which has to answer with a
value, or with one `ValueError` or `OSError` of one line that names the file, soon and without filling memory.
"""

from __future__ import annotations

import random
import re
import resource
import signal
import struct
import sys
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

from stereopsis.io import describe, read_calibration, read_disparity, read_image
from stereopsis.settings import Settings
from stereopsis.study.plan import Study

CORPUS = Path(__file__).parent / "corpus"
SECONDS = 5.0
"""More of the processor's time than this is a hang; so is ten times as much by the clock."""

MEBIBYTES = 768
"""What one input may add to the most that the process has held: a small file may hold 64 megapixels."""


class WrongError(AssertionError):
    """What a reader must not do."""


class Input(NamedTuple):
    """A broken file."""

    number: int
    seed: str
    data: bytes


def inputs(numbers: Iterator[int] | range, corpus: Path = CORPUS) -> Iterator[Input]:
    """The broken files of these numbers; what was found before stays as it is."""
    names = sorted(path.name for path in corpus.iterdir() if not path.name.startswith("found-"))
    seeds = {name: (corpus / name).read_bytes() for name in names}
    for number in numbers:
        rng = random.Random(number)
        name = rng.choice(names)
        data = seeds[name]
        for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 5))):
            change = rng.choice([*_CHANGES, *_OWN.get(name.rpartition(".")[2], ())])
            data = (
                change(rng, data) if change is not _spliced else _spliced(rng, data, seeds[rng.choice(names)])
            )
        yield Input(number, name, data[: 2**17])


# ---- changes ---------------------------------------------------------------------------------------------

_NUMBERS = (
    *("0", "-0", "1", "-1", "2", "3", "255", "256", "65535", "65536", "1000000", "999999999", "4294967295"),
    *("4294967296", "18446744073709551616", "9" * 30, "9" * 5000, "0.5", "-0.5", "1e-320", "1e308", "1e999"),
    *(
        "-1e999",
        "nan",
        "inf",
        "-inf",
        "0x10",
        "0b1",
        "1_000",
        "1:1:1",
        "+3",
        "1.",
        ".5",
        "१२",
        "³",
        "true",
        "",
    ),
)
_WORDS = (
    *(
        b"none",
        b"auto",
        b"estimate",
        b"zncc",
        b"census(9x7,dense,3)",
        b"combined",
        b"sgm",
        b"[",
        b"]",
        b"{",
        b"}",
    ),
    *(
        b"\n",
        b"\r\n",
        b"\r",
        b"\t",
        b" ",
        b"#",
        b"=",
        b":",
        b";",
        b",",
        b'"',
        b"'",
        b"\\",
        b"\0",
        b"\xff",
        b"\xef\xbb\xbf",
    ),
    *(
        b"&a ",
        b"*a",
        b"<<: *a",
        b"!!python/object:os.system",
        b"!!opencv-matrix",
        b"!!binary ",
        b"---\n",
        b"%YAML:1.0\n",
    ),
    *(
        b"P0:",
        b"cam0=",
        b"cam1=",
        b"P1:",
        b"P_rect_02:",
        b"S_rect_02: 0 0\n",
        b"Q:",
        b"disparities = [0, 64]\n",
    ),
    *(
        b"[cost]\n",
        b"[[a]]\n",
        b"a.b.c = 1\n",
        b"window = ",
        b"1979-05-27",
        b"'''",
        b'"""',
        b"\xe2\x80\xa8",
        b"\xc2\x85",
    ),
)
_WHOLES = (
    0,
    1,
    2,
    3,
    7,
    8,
    127,
    128,
    255,
    256,
    1000,
    32767,
    65535,
    10**6,
    2**24,
    2**31 - 1,
    2**31,
    2**32 - 1,
)


def _bytes(rng: random.Random, data: bytes) -> bytes:
    made = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4, 16))):
        if made:
            reach = min(len(made), 256) if rng.random() < 0.6 else len(made)
            at = rng.randrange(reach)
            made[at] = rng.choice(
                (0, 1, 10, 32, 48, 57, 127, 128, 255, rng.randrange(256), made[at] ^ 1 << rng.randrange(8))
            )
    return bytes(made)


def _whole(rng: random.Random, data: bytes) -> bytes:
    made = bytearray(data)
    kind = rng.choice(("<H", ">H", "<I", ">I", "<Q"))
    size = struct.calcsize(kind)
    if len(made) >= size:
        at = rng.randrange(min(len(made) - size, 300) + 1)
        struct.pack_into(kind, made, at, rng.choice(_WHOLES) % 2 ** (8 * size))
    return bytes(made)


def _cut(rng: random.Random, data: bytes) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _removed(rng: random.Random, data: bytes) -> bytes:
    at, length = rng.randrange(len(data) + 1), rng.choice((1, 1, 2, 4, 13, 100))
    return data[:at] + data[at + length :]


def _inserted(rng: random.Random, data: bytes) -> bytes:
    at = rng.randrange(len(data) + 1)
    piece = rng.choice((rng.randbytes(rng.choice((1, 4, 64))), rng.choice(_WORDS), data[at : at + 40]))
    return data[:at] + piece * rng.choice((1, 1, 1, 2, 50, 3000)) + data[at:]


def _spliced(rng: random.Random, data: bytes, other: bytes = b"") -> bytes:
    return data[: rng.randrange(len(data) + 1)] + other[rng.randrange(len(other) + 1) :]


def _number(rng: random.Random, data: bytes) -> bytes:
    """Another number in the text, of a header or of the whole file."""
    found = list(re.finditer(rb"[-+]?\d[\d.eE+-]*", data[:4096]))
    if not found:
        return data
    hit = rng.choice(found)
    return data[: hit.start()] + rng.choice(_NUMBERS).encode() + data[hit.end() :]


def _rearrange(parts: list[Any], at: int, to: int, how: int) -> None:
    """One of them gone, twice, or in another's place."""
    match how:
        case 0:
            del parts[at]
        case 1:
            parts.insert(to, parts[at])
        case _:
            parts[at], parts[to] = parts[to], parts[at]


def _lines(rng: random.Random, data: bytes) -> bytes:
    """A line twice, gone, elsewhere, or of another file's words."""
    lines = data.split(b"\n")
    at, to = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(4):
        case 0 | 1 | 2 as how:
            _rearrange(lines, at, to, (1, 0, 2)[how])
        case _:
            lines[at] = rng.choice(_WORDS) + lines[at] + rng.choice(_WORDS)
    return b"\n".join(lines)


def _nested(rng: random.Random, data: bytes) -> bytes:
    """Brackets in brackets, and aliases of aliases."""
    depth = rng.choice((10, 100, 3000))
    if rng.random() < 0.5:
        opening, closing = rng.choice((("[", "]"), ("{a: ", "}"), ("{a = ", "}"), ("(", ")")))
        piece = opening * depth + closing * rng.choice((0, depth))
    else:
        shape = rng.choice(("&{new} [{old}]", "&{new} {{<<: [{old}]}}", "&{new} {{a: [{old}]}}"))
        lines = ["k0: &a0 {x: 1}"]
        lines += [
            f"k{n}: " + shape.format(new=f"a{n}", old=", ".join([f"*a{n - 1}"] * 9))
            for n in range(1, min(depth, 25))
        ]
        piece = "\n" + "\n".join(lines) + f"\nP1: *a{len(lines) - 1}\n"
    found = list(re.finditer(rb"[-+]?\d[\d.eE+-]*|\n", data[:4096]))
    at = rng.choice(found) if found else None
    return data + piece.encode() if at is None else data[: at.start()] + piece.encode() + data[at.end() :]


def _png(rng: random.Random, data: bytes) -> bytes:
    """Chunks lost, twice, elsewhere, of other content; checksums mostly right."""
    chunks = []
    at = 8
    while at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    if not chunks:
        return data
    at, to = rng.randrange(len(chunks)), rng.randrange(len(chunks))
    match rng.randrange(7):
        case 0 | 1 | 2 as how:
            _rearrange(chunks, at, to, how)
        case 3:
            kind = rng.choice(
                (
                    b"tRNS",
                    b"PLTE",
                    b"eXIf",
                    b"acTL",
                    b"fcTL",
                    b"zTXt",
                    b"iCCP",
                    b"gAMA",
                    b"IDAT",
                    b"IEND",
                    b"IHDR",
                )
            )
            chunks.insert(to, (kind, rng.randbytes(rng.choice((0, 1, 3, 6, 13, 26, 300)))))
        case 4:
            size = rng.choice((0, 1, 100, 10**5, 10**7))
            chunks[at] = (b"IDAT", zlib.compress(bytes(size), rng.choice((0, 1, 9)))[: 2**16])
        case 5:
            chunks[at] = (chunks[at][0], _bytes(rng, chunks[at][1]))
        case _:
            sides = struct.pack(">II", rng.choice(_WHOLES), rng.choice(_WHOLES))
            kinds = (
                bytes(rng.choice((0, 1, 2, 3, 4, 6, 8, 16)) for _ in range(2))
                + b"\0\0"
                + rng.choice((b"\0", b"\1"))
            )
            chunks[0] = (
                b"IHDR",
                rng.choice((sides, chunks[0][1][:8])) + rng.choice((kinds, chunks[0][1][8:])),
            )
    made = b"\x89PNG\r\n\x1a\n"
    for kind, body in chunks:
        checksum = zlib.crc32(kind + body) if rng.random() < 0.97 else 0
        made += struct.pack(">I", len(body)) + kind + body + struct.pack(">I", checksum)
    return made


def _tiff(rng: random.Random, data: bytes) -> bytes:
    """An entry of the first directory with another tag, type, count or value; directories in a circle."""
    made = bytearray(data)
    order = "<" if data[:2] == b"II" else ">"
    try:
        (start,) = struct.unpack_from(f"{order}I", made, 4)
        (count,) = struct.unpack_from(f"{order}H", made, start)
        at = start + 2 + 12 * rng.randrange(max(count, 1))
        match rng.randrange(6):
            case 0:
                tags = (
                    254,
                    256,
                    257,
                    258,
                    259,
                    262,
                    266,
                    273,
                    274,
                    277,
                    278,
                    279,
                    284,
                    317,
                    320,
                    322,
                    323,
                    324,
                    325,
                )
                tags += (330, 338, 339, 347, 530, 32997, 32998, 34665, 50839, 65000)
                struct.pack_into(f"{order}H", made, at, rng.choice(tags))
            case 1:
                struct.pack_into(
                    f"{order}H", made, at + 2, rng.choice((0, 1, 2, 3, 4, 5, 7, 11, 12, 13, 16, 99))
                )
            case 2:
                struct.pack_into(f"{order}I", made, at + 4, rng.choice(_WHOLES))
            case 3:
                struct.pack_into(
                    f"{order}I", made, at + 8, rng.choice((*_WHOLES, len(data), start, len(data) - 1))
                )
            case 4:
                value = rng.choice(
                    (1, 2, 3, 4, 5, 6, 7, 8, 32773, 32946, 34712, 34887, 34925, 50000, 50001, 50002)
                )
                struct.pack_into(f"{order}H", made, at + 8, value)
            case _:
                struct.pack_into(
                    f"{order}I", made, start + 2 + 12 * count, rng.choice((start, 8, 0, len(data)))
                )
    except struct.error:
        pass
    return bytes(made)


def _jpeg(rng: random.Random, data: bytes) -> bytes:
    """Segments lost, twice, elsewhere, of other lengths and sizes."""
    segments = []
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != 0xDA:
        (length,) = struct.unpack_from(">H", data, at + 2)
        segments.append(bytearray(data[at : at + 2 + length]))
        at += 2 + length
    if not segments:
        return data
    one, to = rng.randrange(len(segments)), rng.randrange(len(segments))
    match rng.randrange(5):
        case 0 | 1 | 2 as how:
            _rearrange(segments, one, to, how)
        case 3:
            segments[one][1] = rng.choice((*range(0xC0, 0xD0), 0xD9, 0xDA, 0xDB, 0xDD, 0xE1, 0xFE, 0xFF))
        case _:
            for segment in segments:
                if 0xC0 <= segment[1] <= 0xC2 and len(segment) >= 9:
                    struct.pack_into(
                        ">HH", segment, 5, rng.choice(_WHOLES) % 65536, rng.choice(_WHOLES) % 65536
                    )
    return data[:2] + b"".join(segments) + data[at:]


_CHANGES: Sequence[Callable[..., bytes]] = (_bytes, _whole, _cut, _removed, _inserted, _spliced)
_TEXT = (_number, _number, _lines, _nested)
_OWN: dict[str, Sequence[Callable[..., bytes]]] = {
    "png": (_png,) * 6,
    "tif": (_tiff,) * 6,
    "jpg": (_jpeg,) * 4,
    "pfm": (_number,) * 3,
    "pgm": (_number,) * 3,
    "ppm": (_number,) * 3,
    "npy": (_number,) * 3,
    "ply": (_number, _lines),
    "txt": _TEXT,
    "yml": _TEXT,
    "toml": _TEXT,
}

# ---- judging ---------------------------------------------------------------------------------------------


def _study(path: Path) -> object:
    return Study.from_toml(path.read_bytes().decode("utf-8", "replace"), str(path))


_PIXELS: tuple[Callable[[Path], object], ...] = (
    describe,
    read_image,
    read_disparity,
    lambda path: read_disparity(path, "kitti"),
    lambda path: read_disparity(path, "middlebury:4"),
)
_TEXTS: tuple[Callable[[Path], object], ...] = (describe, read_calibration)
_SETTINGS: tuple[Callable[[Path], object], ...] = (lambda path: Settings.make(file=path), _study)
_READERS = {"txt": _TEXTS, "yml": _TEXTS, "toml": _SETTINGS}


def judge(path: Path, seed: str) -> bool:
    """Whether the readers of that seed's kind read `path`; raises `WrongError` for what must not be."""
    read, before = False, peak()
    for reader in _READERS.get(seed.rpartition(".")[2], _PIXELS):
        try:
            with _soon():
                reader(path)
            read = True
        except ValueError as error:
            said = str(error)
            if not said.startswith(str(path)) or "\n" in said:
                raise WrongError(f"the error is not one line that names the file: {said!r}") from error
            if "MemoryError" in said:
                raise WrongError(f"more memory than there is: {said}") from error
        except OSError as error:
            if error.filename != str(path):
                raise WrongError(f"the error does not name the file: {error!r}") from error
        except WrongError:
            raise
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                raise
            raise WrongError(f"{type(error).__name__}: {error}") from error
    if peak() - before > MEBIBYTES:
        raise WrongError(f"{peak() - before:.0f} MiB of memory")
    return read


def peak() -> float:
    """The most memory that this process has held, in MiB."""
    unit = 2**20 if sys.platform == "darwin" else 2**10
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


class _soon:  # noqa: N801
    """Ends what takes longer than `SECONDS`, even where every `Exception` is caught."""

    _TIMERS = ((signal.ITIMER_PROF, signal.SIGPROF, 1), (signal.ITIMER_REAL, signal.SIGALRM, 10))

    def __enter__(self) -> None:
        for timer, number, limit in self._TIMERS:
            signal.signal(number, self._stop)
            signal.setitimer(timer, limit * SECONDS)

    def __exit__(self, *error: object) -> None:
        for timer, *_ in self._TIMERS:
            signal.setitimer(timer, 0)

    @staticmethod
    def _stop(number: int, frame: FrameType | None) -> Any:
        raise _Hang(f"more than {SECONDS:g} s")


class _Hang(BaseException):
    """Not an `Exception`, which the readers turn into a `ValueError`."""
