"""Where a run is kept: a folder, or a place that fsspec reaches. Every file appears whole or not at all."""

from __future__ import annotations

import errno
import os
import re
import secrets
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any, Final

from stereopsis.io.atomic import write_bytes

MAPS: Final = "disparity"
ROWS: Final = "rows"
TILES: Final = "tiles"
FOLDERS: Final = (MAPS, ROWS)
TABLES: Final = ("results.csv", "timings.csv", "failures.csv")
LOCK: Final = ".lock"
TEMPORARY: Final = re.compile(r"\.[0-9a-f]{12}\.tmp")

ONE_PUT: Final = frozenset(
    {"memory", "s3", "s3a", "gs", "gcs", "az", "abfs", "abfss", "adl", "oss", "oci", "r2"}
)
"""Protocols that store an object as a whole; elsewhere a file is written beside its place and moved."""


class BusyError(OSError):
    """Another run writes to the same place."""


@dataclass(frozen=True)
class Folder:
    """A folder on a disk that every worker sees.

    Attributes
    ----------
    root : str
        Its absolute path.
    """

    root: str

    def __str__(self) -> str:
        return self.root

    def path(self, name: str) -> Path:
        """The path of a file of the run."""
        return Path(self.root, name)

    def prepare(self) -> None:
        """Make the folders that are not there."""
        for name in FOLDERS:
            self.path(name).mkdir(parents=True, exist_ok=True)

    def write(self, name: str, data: bytes) -> None:
        """Write a file, whole or not at all."""
        path = self.path(name)
        try:
            write_bytes(path, data)
        except FileNotFoundError:
            self._make_folders(name)
            write_bytes(path, data)

    @contextmanager
    def place(self, name: str) -> Iterator[Path]:
        """Where to write a large file, whole or not at all."""
        self._make_folders(name)
        yield self.path(name)

    def _make_folders(self, name: str) -> None:
        # Never those of `prepare`: where they are gone, the whole output is, and must not seem to be there.
        folder = PurePosixPath(name).parent
        for parent in reversed([folder, *folder.parents][:-1]):
            if str(parent) not in FOLDERS:
                self.path(str(parent)).mkdir(exist_ok=True)

    def read(self, name: str) -> bytes | None:
        """What a file holds; None where there is none."""
        try:
            return self.path(name).read_bytes()
        except (FileNotFoundError, NotADirectoryError):
            return None

    def read_all(self, folder: str) -> Iterator[tuple[str, bytes]]:
        """The files below a folder and what they hold, unfinished ones left out."""
        for name in self.sizes(folder):
            data = self.read(name)
            if data is not None:
                yield name, data

    def sizes(self, folder: str) -> dict[str, int]:
        """The files below a folder with their bytes, unfinished ones left out."""
        return {
            name: size for name, size in self._walk(folder) if not TEMPORARY.fullmatch(name.split("/")[-1])
        }

    def _walk(self, folder: str) -> Iterator[tuple[str, int]]:
        try:
            entries = list(os.scandir(self.path(folder)))
        except FileNotFoundError:
            return
        for entry in entries:
            name = f"{folder}/{entry.name}"
            if entry.is_dir(follow_symlinks=False):
                yield from self._walk(name)
            else:
                # A link that leads nowhere has no size.
                with suppress(OSError):
                    yield name, entry.stat().st_size

    def size(self, name: str) -> int | None:
        """How many bytes a file has; None where there is none."""
        try:
            return self.path(name).stat().st_size
        except OSError:
            return None

    def remove(self, names: Iterable[str]) -> None:
        """Remove files."""
        for name in names:
            self.path(name).unlink(missing_ok=True)

    def clear(self, folder: str) -> None:
        """Remove a folder and all that is in it."""
        shutil.rmtree(self.path(folder), ignore_errors=True)

    def sweep(self) -> None:
        """Remove what writers that were killed left behind."""
        with suppress(FileNotFoundError):
            top = [entry.name for entry in os.scandir(self.root)]
            below = [name for folder in (*FOLDERS, TILES) for name, _ in self._walk(folder)]
            self.remove(name for name in (*top, *below) if TEMPORARY.fullmatch(name.split("/")[-1]))

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Keep other runs out; the system takes the lock back from whoever dies."""
        with self.path(LOCK).open("a+b") as file:
            try:
                _lock(file.fileno())
            except OSError as error:
                if error.errno in (errno.EACCES, errno.EAGAIN, errno.EDEADLK):
                    raise BusyError(f"{self.root} is being written by another run") from None
                # Some network file systems have no locks.
                if error.errno not in (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS):
                    raise
            yield


def _lock(descriptor: int) -> None:
    if os.name == "nt":
        import msvcrt

        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
    else:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


@dataclass(frozen=True)
class Remote:
    """A place that fsspec reaches.

    Attributes
    ----------
    root : str
        The URL.
    options : mapping of str to Any
        What fsspec's file system is made with.
    """

    root: str
    options: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def __str__(self) -> str:
        return self.root

    def _reached(self) -> tuple[Any, str]:
        from fsspec.core import url_to_fs

        system, path = url_to_fs(self.root, **self.options)
        return system, path.rstrip("/")

    def prepare(self) -> None:
        """Reach the place; fails where it cannot be."""
        system, root = self._reached()
        system.makedirs(root, exist_ok=True)

    def write(self, name: str, data: bytes) -> None:
        """Write a file, whole or not at all."""
        self._put(name, lambda system, target: system.pipe_file(target, data))

    @contextmanager
    def place(self, name: str) -> Iterator[Path]:
        """Where to write a large file on this machine; it is put into its place when the block ends well."""
        with TemporaryDirectory() as folder:
            local = Path(folder, PurePosixPath(name).name)
            yield local
            self._put(name, lambda system, target: system.put_file(str(local), target))

    def _put(self, name: str, put: Callable[[Any, str], None]) -> None:
        system, root = self._reached()
        target = f"{root}/{name}"
        if not ONE_PUT.isdisjoint([system.protocol] if isinstance(system.protocol, str) else system.protocol):
            put(system, target)
            return
        folder = str(PurePosixPath(target).parent)
        system.makedirs(folder, exist_ok=True)
        temporary = f"{folder}/.{secrets.token_hex(6)}.tmp"
        try:
            put(system, temporary)
            system.mv(temporary, target)
        finally:
            with suppress(FileNotFoundError):
                system.rm_file(temporary)

    def read(self, name: str) -> bytes | None:
        """What a file holds; None where there is none."""
        system, root = self._reached()
        try:
            data: bytes = system.cat_file(f"{root}/{name}")
        except FileNotFoundError:
            return None
        return data

    def read_all(self, folder: str) -> Iterator[tuple[str, bytes]]:
        """The files below a folder and what they hold, many asked for at once."""
        system, root = self._reached()
        names = list(self.sizes(folder))
        for start in range(0, len(names), 1000):
            some = names[start : start + 1000]
            held = system.cat([f"{root}/{name}" for name in some], on_error="omit")
            for path, data in held.items():
                yield path[len(root) + 1 :] if path.startswith(root) else path, data

    def sizes(self, folder: str) -> dict[str, int]:
        """The files below a folder with their bytes, unfinished ones left out."""
        return {
            name: size for name, size in self._found(folder) if not TEMPORARY.fullmatch(name.split("/")[-1])
        }

    def _found(self, folder: str) -> Iterator[tuple[str, int]]:
        system, root = self._reached()
        system.invalidate_cache()
        try:
            found = system.find(f"{root}/{folder}", detail=True)
        except FileNotFoundError:
            return
        for path, facts in found.items():
            yield path[len(root) + 1 :], int(facts["size"])

    def size(self, name: str) -> int | None:
        """How many bytes a file has; None where there is none."""
        system, root = self._reached()
        system.invalidate_cache()
        try:
            return int(system.size(f"{root}/{name}"))
        except FileNotFoundError:
            return None

    def remove(self, names: Iterable[str]) -> None:
        """Remove files."""
        system, root = self._reached()
        for name in names:
            with suppress(FileNotFoundError):
                system.rm_file(f"{root}/{name}")

    def clear(self, folder: str) -> None:
        """Remove all that is in a folder."""
        self.remove(self.sizes(folder))

    def sweep(self) -> None:
        """Remove what writers that were killed left behind."""
        below = [name for folder in (*FOLDERS, TILES) for name, _ in self._found(folder)]
        self.remove(name for name in below if TEMPORARY.fullmatch(name.split("/")[-1]))

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Nothing: object stores have no locks. Two runs at once do some work twice, with the same bytes."""
        yield


Store = Folder | Remote


def at(out: str | os.PathLike[str], options: Mapping[str, Any] | None = None) -> Store:
    """The place that a path or a URL such as ``s3://bucket/run`` names."""
    text = os.fspath(out)
    protocol, separator, path = text.partition("://")
    if separator and len(protocol) > 1 and protocol not in ("file", "local"):
        return Remote(text.rstrip("/"), dict(options or {}))
    if options:
        raise ValueError(f"storage_options belong to a URL such as s3://bucket/run, and out is {text}")
    return Folder(os.path.abspath(path if separator else text))  # noqa: PTH100, links stay as they are
