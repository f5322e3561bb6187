"""What a study is made of, and the rows that it therefore has."""

from __future__ import annotations

import dataclasses
import json
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias

from stereopsis.settings import Settings, as_disparities
from stereopsis.study import ablation, methods, pairs, published
from stereopsis.study.pairs import Source

PARTS: Final = ("published", "ablation", *methods.PARTS, "synthetic")
"""The experiments. "synthetic": those of sweep, presets and checks on rendered streets in all weathers."""


@dataclass(frozen=True)
class Study:
    """Everything that decides a study's numbers; `to_toml` repeats it.

    Attributes
    ----------
    data : Path or None
        The folder of the data set. None: rendered streets.
    protocol : {"all", "published"}
        "published": only what the report computed, as it computed it.
    tables_only : bool
        Of the published protocol, Tables I and II alone.
    windows : tuple of int
        Window sizes of the sweep in pixels.
    methods : tuple of str
        Names in `methods.METHODS`. Empty: all. Where some are named, the published protocol and the ablation
        are left out unless `parts` names them.
    parts : tuple of str
        Some of `PARTS`. Empty: all.
    pairs : int or None
        Only so many pairs, the first ones. None: all.
    disparities : (int, int) or "estimate"
        Candidates of the corrected study, the maximum excluded: one range for all pairs, as a rig has one. Or
        estimated from each pair's images alone. Never from the truth.
    scenes : int
        How many different streets are rendered.
    size : (int, int)
        Their width and height in pixels.
    """

    data: Path | None = None
    protocol: Literal["all", "published"] = "all"
    tables_only: bool = False
    windows: tuple[int, ...] = tuple(range(5, 95, 10))
    methods: tuple[str, ...] = ()
    parts: tuple[str, ...] = ()
    pairs: int | None = None
    disparities: tuple[int, int] | Literal["estimate"] = published.RANGE
    scenes: int = 3
    size: tuple[int, int] = (640, 288)

    def __post_init__(self) -> None:
        for name in ("windows", "methods", "parts", "size"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if self.data is not None:
            object.__setattr__(self, "data", Path(self.data))
        if self.protocol not in ("all", "published"):
            raise ValueError(f"protocol must be all or published, not {self.protocol!r}")
        if self.tables_only and self.protocol != "published":
            raise ValueError("tables_only needs protocol published")
        if not self.windows or not all(isinstance(w, int) and 1 <= w <= 255 for w in self.windows):
            raise ValueError(f"windows must be whole numbers from 1 to 255, not {list(self.windows)}")
        if len(set(self.windows)) != len(self.windows):
            raise ValueError(f"windows must differ from each other, not {list(self.windows)}")
        for part in self.parts:
            if part not in PARTS:
                raise ValueError(f"parts knows {', '.join(PARTS)}, not {part!r}")
        if self.pairs is not None and not (isinstance(self.pairs, int) and self.pairs >= 1):
            raise ValueError(f"pairs must be a whole number of at least 1, not {self.pairs!r}")
        if self.disparities != "estimate":
            low, high = as_disparities(self.disparities)
            object.__setattr__(self, "disparities", (low, high))
        if not (isinstance(self.scenes, int) and 0 <= self.scenes <= 1000):
            raise ValueError(f"scenes must be a whole number from 0 to 1000, not {self.scenes!r}")
        if len(self.size) != 2 or not all(isinstance(side, int) and 32 <= side <= 4096 for side in self.size):
            raise ValueError(f"size must be (width, height), 32 to 4096 pixels each, not {self.size!r}")
        methods.named(self.methods)

    def wants(self, part: str) -> bool:
        """Whether the study has this experiment."""
        if part not in ("published", "ablation"):
            return self.protocol == "all" and (not self.parts or part in self.parts)
        if self.protocol == "published":
            return part == "published"
        return part in self.parts if self.parts or self.methods else True

    def to_toml(self) -> str:
        """As ``stereopsis study --settings`` reads it; the data set's folder as an absolute path."""
        lines = []
        for field in dataclasses.fields(self):
            value: Any = getattr(self, field.name)
            if isinstance(value, Path):
                value = str(value.resolve())
            if value is not None:
                lines.append(f"{field.name} = {json.dumps(value, ensure_ascii=False)}")
        return "\n".join(lines) + "\n"

    @classmethod
    def from_toml(cls, text: str, source: str = "the text") -> Study:
        """The study that wrote this text.

        Raises
        ------
        ValueError
            It is not TOML, or holds what `Study` does not have.
        """
        try:
            values = tomllib.loads(text)
        except (ValueError, RecursionError) as error:  # ValueError: numbers of thousands of digits, too
            raise ValueError(f"{source} is not TOML: {error}") from None
        known = {field.name for field in dataclasses.fields(cls)}
        for name in values:
            if name not in known:
                raise ValueError(f"{source}: unknown setting {name!r}; known are {', '.join(sorted(known))}")
        try:
            return cls(**values)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{source}: {error}") from None


@dataclass(frozen=True)
class Corrected:
    """A pair is matched with the library's settings and measured in the left view."""

    method: str
    window: int | None
    setting: str
    settings: Settings

    protocol = "corrected"

    def identity(self) -> str:
        """Everything that decides the row, as text. Threads never change a result."""
        return repr(dataclasses.replace(self.settings, threads=0))


@dataclass(frozen=True)
class Quirky:
    """A pair is matched and measured with some of the report's quirks."""

    method: str
    window: int
    setting: str
    quirks: published.Quirks
    protocol: str = "published"

    def identity(self) -> str:
        """Everything that decides the row, as text."""
        return repr((self.method, self.window, self.quirks))


Setting: TypeAlias = Corrected | Quirky


@dataclass(frozen=True)
class Task:
    """One row: a pair and a setting."""

    source: Source
    setting: Setting

    def columns(self) -> dict[str, Any]:
        """What identifies the row in the table."""
        return {
            "group": self.source.group,
            "condition": self.source.condition,
            "pair": self.source.name,
            "protocol": self.setting.protocol,
            "setting": self.setting.setting,
            "method": self.setting.method,
            "window": self.setting.window,
        }


@dataclass(frozen=True)
class Plan:
    """The rows of a study in the order of the table, pair by pair."""

    name: str
    tasks: tuple[Task, ...]


def make(study: Study) -> Plan:
    """List the rows of a study. Nothing is read but the names of files."""
    name, found = pairs.data(study.data, max(1, study.scenes), study.size)
    sources = found[: study.pairs]
    rows = [
        Task(source, setting) for n, source in enumerate(sources) for setting in _on_data(study, first=n == 0)
    ]
    if study.wants("synthetic"):
        settings = tuple(_synthetic(study))
        rows += [
            Task(source, setting)
            for source in pairs.weather(study.scenes, study.size)
            for setting in settings
        ]
    return Plan(name, tuple(rows))


def _on_data(study: Study, *, first: bool) -> Iterable[Setting]:
    """What is run on a pair of the data set; the report's own sweep is of its first pair alone."""
    chosen = methods.named(study.methods)
    for method in chosen:
        if study.wants(method.part):
            for window in study.windows if method.part == "sweep" else (methods.WINDOW,):
                yield corrected(method, window, study.disparities)
    if study.wants("sweep"):
        # For the comparisons at one window, whatever the sweep's windows are.
        for method in chosen:
            if method.part == "sweep" and methods.WINDOW not in study.windows:
                yield corrected(method, methods.WINDOW, study.disparities)
    if study.wants("published"):
        chosen_by_report = tuple(published.TABLES.values())
        for name, window in chosen_by_report:
            yield quirky(name, window)
        if first and not study.tables_only:
            for name in published.METHODS:
                for window in study.windows:
                    if (name, window) not in chosen_by_report:
                        yield quirky(name, window)
    if study.wants("ablation"):
        for case in ablation.ablation_cases():
            yield Quirky(case.method, case.window, ablated(case), case.quirks, "ablation")


def _synthetic(study: Study) -> Iterable[Setting]:
    for method in methods.named(study.methods):
        if method.part in ("sweep", "presets", "checks"):
            yield corrected(method, methods.WINDOW, study.disparities)


def corrected(
    method: methods.Method, window: int, disparities: tuple[int, int] | Literal["estimate"]
) -> Corrected:
    """A method of the corrected study at a window, over a range of candidates."""
    settings = method.settings(window)
    if disparities != "estimate":
        settings = settings.changed(disparities=disparities)
    return Corrected(method.name, window if method.windowed else None, method.setting(window), settings)


def ablated(case: ablation.Case) -> str:
    """What the table of results calls a case of the ablation."""
    return f"ablation: {case.method}-{case.window}, {case.name}"


def quirky(method: str, window: int) -> Quirky:
    """A method of the report, as it was published."""
    return Quirky(method, window, f"published: {method}-{window}", published.PUBLISHED)
