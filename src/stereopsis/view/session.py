"""Behind the page: what is opened, computed and kept, and by which rules."""

from __future__ import annotations

import asyncio
import hashlib
import secrets
import tempfile
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy.typing as npt

from stereopsis.settings import Settings
from stereopsis.types import Calibration, Disparities
from stereopsis.view import choice
from stereopsis.view.limits import Limits
from stereopsis.view.pool import BusyError, Job, Pool, RefusedError
from stereopsis.view.sources import Files, Scene, Source, Street
from stereopsis.view.store import Store
from stereopsis.view.targets import Entry, Target

PATIENCE = 0.2
"""Seconds after which a computation asks whether somebody still waits for it."""
FIELD_OF_VIEW = 0.9
"""Of a camera that nobody calibrated: its focal length, in widths of the image."""
BASELINE = 0.12
"""And the distance to its neighbour, in metres."""


class GoneError(Exception):
    """Nothing of that name is there, or it is not kept any more."""


@dataclass(eq=False)
class Opened:
    """A scene that is kept."""

    key: str
    name: str
    scene: Scene
    files: tuple[str, str]
    first: str = ""
    """What has to be run before `files` are there."""
    settings: Mapping[str, Any] | None = None
    """What it is matched with at first, where that is its own."""
    pictures: dict[str, bytes] = field(default_factory=dict)

    @property
    def calibration(self) -> Calibration:
        """As stated, or a default that any picture can be looked at with."""
        if self.scene.calibration is not None:
            return self.scene.calibration
        height, width = self.scene.shape
        return Calibration(FIELD_OF_VIEW * width, (width - 1) / 2, (height - 1) / 2, BASELINE)


@dataclass(frozen=True, eq=False)
class Kept:
    """A result that is kept; its scene may be gone before it."""

    scene: str
    used: Settings | None
    answer: dict[str, Any]
    arrays: Mapping[str, npt.NDArray[Any]]


class Session:
    """One target and what the page asks of it.

    Parameters
    ----------
    target : Target
    limits : Limits
    """

    def __init__(self, target: Target, limits: Limits) -> None:
        self.target, self.limits = target, limits
        self._entries = {entry.name: entry for entry in target.entries}
        # Keys of one run mean nothing to the next: browsers keep what they were told never changes.
        self._salt = secrets.token_hex(8)
        self._scenes: Store[Opened] = Store(limits.scene_bytes)
        self._results: Store[Kept] = Store(limits.result_bytes)
        held = limits.scene_bytes // 2
        shared = {"waiting": limits.waiting, "memory": limits.memory, "held": held}
        self._matchers = Pool(limits.computations, **shared)
        self._readers = Pool(1, **shared)
        self._matching: dict[str, Job] = {}
        self._opening: dict[str, Job] = {}
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def close(self) -> None:
        """End every computation and delete what was written."""
        self._matchers.close()
        self._readers.close()
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None

    def scratch(self) -> tempfile.TemporaryDirectory[str]:
        """A folder for one upload, to be cleaned up by who asked."""
        if self._folder is None:
            self._folder = tempfile.TemporaryDirectory(prefix="stereopsis-view-")
        return tempfile.TemporaryDirectory(dir=self._folder.name)

    def prepare(self) -> None:
        """Start the processes, and open what the page will ask for first."""
        self._matchers.submit(Job("nothing", ()))
        if len(self.target.entries) == 1:
            entry = self.target.entries[0]
            self._load(self._sample_key(entry), entry)

    # Scenes

    async def open_sample(self, name: str) -> Opened:
        """Open what the target lists under a name."""
        entry = self._entries.get(name)
        if entry is None:
            raise GoneError(f"there is no sample {name[:80]!r} here")
        key = self._sample_key(entry)
        return self._scenes.get(key) or await self._open(key, entry)

    def _sample_key(self, entry: Entry) -> str:
        return self._key("sample", entry.name, *_stamps(entry.source))

    async def open_files(self, files: Files, names: Mapping[str, str]) -> Opened:
        """Open files that were sent."""
        main = names.get("left") or names.get("disparity") or "image"
        entry = Entry(Path(main).stem[:80] or "image", files)
        sent = names.get("left", "left.png"), names.get("right", "right.png")
        return await self._open(self._key("sent", secrets.token_hex(8)), entry, sent)

    async def _open(self, key: str, entry: Entry, sent: tuple[str, str] | None = None) -> Opened:
        scene: Scene = await _answer(self._load(key, entry))
        kept = self._scenes.get(key)  # two may have waited for the same scene
        if kept is not None:
            return kept
        files, first = _files(entry.source)
        opened = Opened(key, entry.name, scene, sent or files, first, entry.settings)
        self._scenes.put(key, opened, scene.bytes)
        if scene.right is not None:
            with suppress(BusyError):  # so that the first match need not wait for its images
                self._matchers.submit(Job("nothing", (), (key, scene)))
        return opened

    def _load(self, key: str, entry: Entry) -> Job:
        """The job that loads a scene: one, however many ask for it."""
        job = self._opening.get(key)
        if job is None:
            job = Job("load", (entry.source, self.limits.pixels), seconds=self.limits.open_seconds)
            self._opening[key] = job
            job.future.add_done_callback(lambda _: self._opening.pop(key, None))
            self._readers.submit(job)
        return job

    def scene(self, key: str) -> Opened:
        """A scene that is kept; raises `GoneError`."""
        found = self._scenes.get(key)
        if found is None:
            raise GoneError("this scene is not kept any more: open it again")
        return found

    async def picture(self, key: str, side: str) -> bytes:
        """An image of a scene as PNG."""
        opened = self.scene(key)
        if getattr(opened.scene, side) is None:
            raise GoneError(f"this scene has no {side} image")
        if side not in opened.pictures:
            job = Job("picture", (side,), (key, opened.scene), self.limits.open_seconds)
            opened.pictures[side] = await _answer(self._readers.submit(job))
            self._scenes.put(key, opened, opened.scene.bytes + sum(map(len, opened.pictures.values())))
        return opened.pictures[side]

    # Results

    async def match(
        self, key: str, client: str, given: Mapping[str, Any], gone: Callable[[], Awaitable[bool]]
    ) -> dict[str, Any]:
        """Match a scene; what the same client asked for before is not computed any further.

        Nor is this, once `gone` says that nobody waits for it any more.
        """
        opened = self.scene(key)
        if opened.scene.right is None or opened.scene.left is None:
            raise RefusedError("this scene has no right image: there is nothing to match")
        chosen = choice.read(given)
        ranges = chosen.disparities or opened.scene.disparities
        if ranges.span > self.limits.disparities:
            raise RefusedError(
                f"disparities may hold up to {self.limits.disparities} candidates here, not {ranges.span}"
            )
        self.cancel(client)
        chosen = replace(chosen, disparities=Disparities(*ranges))
        result = self._key(key, chosen.to_toml())
        found = self._results.get(result)
        if found is not None:
            return found.answer
        job = Job("matched", (chosen,), (key, opened.scene), self.limits.match_seconds)
        self._matching[client] = job
        try:
            answer = asyncio.wrap_future(self._matchers.submit(job).future)
            while not (await asyncio.wait({answer}, timeout=PATIENCE))[0]:
                if await gone():
                    self._matchers.stop(job, "nobody waits for this any more")
            facts, arrays = await answer
        finally:
            if not job.future.done():
                self._matchers.stop(job, "nobody waits for this any more")
            if self._matching.get(client) is job:
                del self._matching[client]
        return self._keep(result, opened, chosen, facts, arrays)

    def cancel(self, client: str) -> None:
        """Stop what is computed for a client."""
        job = self._matching.pop(client, None)
        if job is not None:
            self._matchers.stop(job, "replaced by a newer request")

    async def opened_map(self, opened: Opened) -> dict[str, Any] | None:
        """The map that was opened, as a result; None where there is none."""
        if opened.scene.disparity is None:
            return None
        result = self._key(opened.key, "given")
        found = self._results.get(result)
        if found is not None:
            return found.answer
        job = Job("given", (), (opened.key, opened.scene), self.limits.open_seconds)
        facts, arrays = await _answer(self._readers.submit(job))
        return self._keep(result, opened, None, facts, arrays)

    def _keep(
        self,
        key: str,
        opened: Opened,
        asked: Settings | None,
        facts: dict[str, Any],
        arrays: Mapping[str, npt.NDArray[Any]],
    ) -> dict[str, Any]:
        used: Settings | None = facts.pop("used")
        height, width = opened.scene.shape
        ranges = opened.scene.disparities if used is None else cast(Disparities, used.disparities)
        answer = {
            "result": key,
            "scene": opened.key,
            "width": width,
            "height": height,
            "disparities": list(ranges),
            "settings": {} if used is None else used.to_dict(),
            "arrays": [*arrays, *(["error"] if opened.scene.truth is not None else [])],
            "command": "" if asked is None else opened.first + choice.command(asked, *opened.files),
            "python": "" if asked is None else choice.python(asked, *opened.files),
            "toml": "" if asked is None else asked.to_toml(),
            **facts,
        }
        size = sum(array.nbytes for array in arrays.values())
        self._results.put(key, Kept(opened.key, used, answer, arrays), size)
        return answer

    def result(self, key: str) -> Kept:
        """A result that is kept; raises `GoneError`."""
        found = self._results.get(key)
        if found is None:
            raise GoneError("this result is not kept any more: compute it again")
        return found

    def array(self, key: str, name: str) -> npt.NDArray[Any]:
        """An array of a result, or its error; raises `GoneError`."""
        kept = self.result(key)
        if name == "error":
            truth = self.scene(kept.scene).scene.truth
            found = None if truth is None else kept.arrays["disparity"] - truth
        else:
            found = kept.arrays.get(name)
        if found is None:
            raise GoneError(f"this result has no {name}")
        return found

    async def curve(self, key: str, x: int, y: int) -> dict[str, Any]:
        """What every candidate costs at a pixel of a result."""
        kept = self.result(key)
        scene = self.scene(kept.scene).scene
        height, width = scene.shape
        if not (0 <= x < width and 0 <= y < height):
            raise RefusedError(f"x and y must lie in the image of {width} x {height} pixels, not at {x}, {y}")
        if kept.used is None:
            raise RefusedError("this map was opened, not matched: there are no costs to show")
        job = Job("curve", (kept.used, x, y), (kept.scene, scene), self.limits.open_seconds)
        told: dict[str, Any] = await _answer(self._readers.submit(job))
        return told

    async def download(self, key: str, name: str) -> bytes:
        """A result as a file."""
        kept = self.result(key)
        if name == "settings.toml":
            return str(kept.answer["toml"]).encode()
        opened = self.scene(kept.scene)
        arguments = kept.arrays["disparity"], opened.calibration, name
        job = Job("download", arguments, (opened.key, opened.scene), self.limits.open_seconds)
        data: bytes = await _answer(self._readers.submit(job))
        return data

    def _key(self, *parts: str) -> str:
        return hashlib.sha256("\0".join((self._salt, *parts)).encode()).hexdigest()[:24]


async def _answer(job: Job) -> Any:
    return await asyncio.wrap_future(job.future)


def _stamps(source: Source) -> list[str]:
    """What changes when a file does."""
    if isinstance(source, Street):
        return []
    files = (source.left, source.right, source.truth, source.disparity)
    return [_stamp(path) for path in files if path is not None]


def _stamp(path: Path) -> str:
    try:
        stat = path.stat()
    except OSError:  # who reads it will say so
        return "missing"
    return f"{stat.st_mtime_ns} {stat.st_size}"


def _files(source: Source) -> tuple[tuple[str, str], str]:
    """What a command calls the images, and what it has to run before they are there."""
    match source:
        case Street(width, height, seed):  # a command renders none but the clear one
            made = f"stereopsis demo -o demo --size {width}x{height} --seed {seed} && "
            return ("demo/left.png", "demo/right.png"), made
        case Files():
            return (str(source.left or "left.png"), str(source.right or "right.png")), ""
