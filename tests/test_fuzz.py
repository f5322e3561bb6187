"""A slice of benchmarks/fuzz.py: the same broken files every time, and all that were found before."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

fuzz = pytest.importorskip("fuzz", reason="needs POSIX signals")

SLICE = range(10_000_000, 10_002_500)  # numbers that the long runs do not reach


def test_broken_files_are_read_or_refused(tmp_path: Path) -> None:
    path = tmp_path / "input"
    read = 0
    for broken in fuzz.inputs(SLICE):
        path.write_bytes(broken.data)
        try:
            read += fuzz.judge(path, broken.seed)
        except fuzz.WrongError as error:
            pytest.fail(f"number {broken.number}, from {broken.seed}: {error}")
    assert len(SLICE) // 20 < read < len(SLICE) // 2  # neither all harmless nor all hopeless


@pytest.mark.parametrize("name", sorted(path.name for path in fuzz.CORPUS.iterdir()))
def test_the_corpus(name: str) -> None:
    """Its first files are read; what broke a reader once is read or refused."""
    read = fuzz.judge(fuzz.CORPUS / name, name)
    assert read or name.startswith("found-")


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz") / "input"


@given(
    seed=some.sampled_from(sorted(path.name for path in fuzz.CORPUS.iterdir())),
    edits=some.lists(
        some.tuples(some.floats(0, 1), some.integers(0, 9), some.binary(max_size=9)), max_size=9
    ),
)
@settings(max_examples=int(os.environ.get("STEREOPSIS_FUZZ", "500")), deadline=None)
def test_edited_files_are_read_or_refused(
    file: Path, seed: str, edits: list[tuple[float, int, bytes]]
) -> None:
    """Bytes taken out and put in anywhere; what fails is made small. STEREOPSIS_FUZZ=100000: a long run."""
    data = (fuzz.CORPUS / seed).read_bytes()
    for place, out, into in edits:
        at = int(place * len(data))
        data = data[:at] + into + data[at + out :]
    file.write_bytes(data)
    fuzz.judge(file, seed)


def test_the_same_number_gives_the_same_file() -> None:
    first = list(fuzz.inputs(range(7, 12)))
    assert [made.number for made in first] == [7, 8, 9, 10, 11]
    assert list(fuzz.inputs(range(11, 12))) == first[-1:]


def test_a_reader_that_misbehaves_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The judge itself can fail."""
    path = tmp_path / "input"
    path.write_bytes(b"")

    def hang(_: Path) -> None:
        try:
            while True:
                pass
        except Exception:
            pass

    def raises(error: Exception) -> None:
        raise error

    monkeypatch.setattr(fuzz, "SECONDS", 0.05)
    for reader, message in (
        (hang, "more than 0.05 s"),
        (lambda _: raises(ValueError("no name")), "names the file: 'no name'"),
        (lambda path: raises(ValueError(f"{path}: two\nlines")), "one line"),
        (lambda path: raises(ValueError(f"{path}: (MemoryError: )")), "more memory than there is"),
        (lambda _: raises(OSError(2, "gone", "elsewhere")), "does not name the file"),
        (lambda _: raises(KeyError("key")), "KeyError"),
        (lambda _: warnings.warn("strange", stacklevel=1), "UserWarning"),
    ):
        monkeypatch.setattr(fuzz, "_PIXELS", (reader,))
        with pytest.raises(fuzz.WrongError, match=message):
            fuzz.judge(path, "a.png")
    monkeypatch.setattr(fuzz, "_PIXELS", (lambda _: None,))
    held = iter((100.0, 1000.0, 1000.0))
    monkeypatch.setattr(fuzz, "peak", lambda: next(held))
    with pytest.raises(fuzz.WrongError, match="900 MiB of memory"):
        fuzz.judge(path, "a.png")
