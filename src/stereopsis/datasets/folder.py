"""Folders on disk, each listed once, and only when it is asked for."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path


class Folder:
    """A folder and what lies below it; one that is not there is empty, and false.

    What begins with a dot is left out. Links are followed, but a folder that a link leads back to is not
    entered again.

    Parameters
    ----------
    path : Path
    real : str, optional
        Where it is, links resolved.
    above : frozenset of str
        Where the folders are through which it was reached.
    there : bool
    """

    def __init__(
        self, path: Path, real: str | None = None, above: frozenset[str] = frozenset(), there: bool = True
    ) -> None:
        self.path = path
        self._real = os.path.realpath(path) if real is None else real
        self._above = above
        self._there = there

    def __bool__(self) -> bool:
        return self._there

    def __truediv__(self, name: str) -> Folder:
        return self._listing[1].get(name) or Folder(self.path / name, "", there=False)

    @property
    def name(self) -> str:
        """The folder's own name, also where it was opened as "."."""
        return self.path.absolute().name

    @property
    def parent(self) -> Folder:
        """The folder above."""
        return Folder(self.path.absolute().parent)

    @property
    def files(self) -> list[str]:
        """Names of its files, sorted."""
        return sorted(self._listing[0])

    @property
    def folders(self) -> list[Folder]:
        """The folders in it, sorted by name."""
        return [folder for _, folder in sorted(self._listing[1].items())]

    def file(self, *names: str) -> Path | None:
        """Return the first of these files that is there."""
        return next((self.path / name for name in names if name in self._listing[0]), None)

    def below(self, parts: Iterable[str]) -> Folder:
        """The folder that these names lead to, one after the other."""
        folder = self
        for part in parts:
            folder /= part
        return folder

    def walk(self, depth: int) -> Iterator[tuple[str, Folder]]:
        """Go through the folder itself, named "", and those at most `depth` below, named "a/b", sorted."""
        yield "", self
        if depth:
            for folder in self.folders:
                for name, found in folder.walk(depth - 1):
                    yield f"{folder.path.name}/{name}".rstrip("/"), found

    @cached_property
    def _listing(self) -> tuple[set[str], dict[str, Folder]]:
        files: set[str] = set()
        folders: dict[str, Folder] = {}
        if not self._there:
            return files, folders
        above = self._above | {self._real}
        with os.scandir(self.path) as entries:
            for entry in entries:
                if entry.name.startswith("."):
                    continue
                if _leads_to(entry, folder=True):
                    real = f"{self._real}{os.sep}{entry.name}"
                    if entry.is_symlink():
                        real = os.path.realpath(entry.path)
                    if real not in above:
                        folders[entry.name] = Folder(self.path / entry.name, real, above)
                elif _leads_to(entry, folder=False) or entry.is_symlink():
                    # A link that leads nowhere is a file that cannot be read.
                    files.add(entry.name)
        return files, folders


def in_either(left: Folder, right: Folder) -> list[str]:
    """Names of the files of two folders that hold the views under the same names, sorted.

    A view that is missing costs its pair when that is read, and no other.
    """
    return sorted({*left.files, *right.files})


def scenes(folder: Folder, left: str, right: str, *more: str) -> list[tuple[str, Folder]]:
    """Return the folders in `folder` that hold a view and all more files, or else `folder` itself."""

    def whole(scene: Folder) -> bool:
        return scene.file(left, right) is not None and all(map(scene.file, more))

    found = [scene for scene in folder.folders if whole(scene)]
    if not found and whole(folder):
        found = [folder]
    return [(scene.name, scene) for scene in found]


def only_one(folder: Folder, parts: list[str], advice: str = "open one of them") -> Folder:
    """Return the one of these folders that is there, an empty one if none is; refuse several."""
    there = [part for part in parts if folder / part]
    if len(there) > 1:
        raise ValueError(f"{folder.path} holds {', '.join(there)}: {advice}")
    return folder / (there or parts)[0]


def _leads_to(entry: os.DirEntry[str], folder: bool) -> bool:
    """Whether an entry is a folder or a file; a link that leads nowhere, or to itself, is neither."""
    try:
        return entry.is_dir() if folder else entry.is_file()
    except OSError:
        return False
