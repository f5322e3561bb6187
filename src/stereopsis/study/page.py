"""The page: one HTML file that holds everything it shows."""

from __future__ import annotations

import base64
import math
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata, resources
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from stereopsis import _fused, colormaps, io
from stereopsis.evaluate import error_map
from stereopsis.io.atomic import write_bytes
from stereopsis.io.formats import jpeg, png
from stereopsis.pipeline import match
from stereopsis.settings import Settings
from stereopsis.study import figures, methods
from stereopsis.study.job import Outcome
from stereopsis.study.pairs import Known, Source
from stereopsis.study.plan import Corrected, Plan, Study
from stereopsis.study.sections import Picture, Report, Section
from stereopsis.types import DisparityMap

WIDEST: Final = 900
"""Pictures of more columns are thinned out to at most so many."""

EXAMPLES: Final = 3

PIECES: Final = ("pieces.css", "swipe.js", "table.js")
"""What this page shares with that of `stereopsis.view`: the very files, written into this one."""


@dataclass(frozen=True)
class Shown:
    """One image of the page, and what it shows."""

    layer: str
    method: str
    label: str
    data: str


@dataclass(frozen=True)
class Example:
    """A pair with its maps."""

    pair: str
    images: tuple[Shown, ...]


def write(
    path: Path,
    study: Study,
    plan: Plan,
    outcome: Outcome,
    report: Report,
    sections: Sequence[Section],
    seconds: float,
) -> None:
    """Write the page.

    Parameters
    ----------
    path : Path
        The HTML file.
    study, plan, outcome, report
        What was asked for, what that was made of, and what came of it.
    sections : sequence of Section
        In order.
    seconds : float
        Wall time of this run.
    """
    from jinja2 import Environment

    template = (resources.files("stereopsis.study") / "page.html").read_text(encoding="utf-8")
    environment = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.globals["inline"] = figures.inline
    static = resources.files("stereopsis") / "view" / "static"
    pieces = {name: (static / name).read_text(encoding="utf-8") for name in PIECES}
    pictures = [picture for section in sections for picture in section.pictures]
    text = environment.from_string(template).render(
        name=report.name,
        pieces=pieces,
        study=study,
        toml=_shown(study),
        sections=sections,
        examples=_examples(plan, outcome, pictures),
        error_legend=_error_legend(),
        failed=outcome.failed,
        settings=_settings(outcome),
        facts=facts(outcome, seconds),
        pairs=len({task.source.name for task in plan.tasks if task.source.group == "data"}),
        rows=len(outcome.done),
    )
    write_bytes(path, text.encode())


def facts(outcome: Outcome, seconds: float) -> Mapping[str, str]:
    """Versions, machine and effort, for people."""
    versions = {}
    for name in ("stereopsis", "numpy", "scipy", "matplotlib", "pillow", "pyarrow"):
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "not installed"
    reused = sum(item.reused for item in outcome.done)
    measured = sum(item.seconds for item in outcome.done)
    return {
        "Rows": f"{len(outcome.done)}, {reused} of them from an earlier run",
        "Time": f"{_time(measured)} for all rows together; this run took {_time(seconds)}",
        "Machine": f"{platform.machine()}, {os.cpu_count()} cores, {_fused.instruction_set()}",
        "System": platform.platform(),
        "Python": sys.version.split()[0],
        **versions,
    }


def _error_legend() -> list[tuple[str, colormaps.Colour]]:
    """What some of the colours of an error map say; a normalised error of 1 is 3 px, or 5 % of the truth."""
    bands = dict(colormaps.ERROR_COLOURS)
    return [
        ("none", bands[0.0625]),
        ("below 1.5 px", bands[0.5]),
        ("from 3 px and 5 %", bands[2.0]),
        ("from 48 px", bands[math.inf]),
        ("not answered", colormaps.UNANSWERED_COLOUR),
        ("truth unknown", colormaps.UNKNOWN_COLOUR),
    ]


def _shown(study: Study) -> str:
    """The settings without where on this machine the data set lies."""
    lines = study.to_toml().splitlines(keepends=True)
    return "".join(line for line in lines if not line.startswith("data = "))


def _time(seconds: float) -> str:
    return f"{seconds:.1f} s" if seconds < 100 else f"{seconds / 60:.1f} min"


def _settings(outcome: Outcome) -> list[tuple[str, str, str]]:
    """Label, window and TOML of each corrected method, at the first window that was run."""
    labels = {method.name: method.label for method in methods.METHODS}
    first: dict[str, tuple[str, str, str]] = {}
    for item in outcome.done:
        setting = item.task.setting
        if isinstance(setting, Corrected) and setting.method not in first:
            window = "" if setting.window is None else f"window {setting.window} px"
            label = f"{labels.get(setting.method, setting.method)} ({setting.method})"
            first[setting.method] = label, window, setting.settings.to_toml()
    return list(first.values())


def _examples(plan: Plan, outcome: Outcome, pictures: Sequence[Picture]) -> list[Example]:
    """The first pair, and those on which the methods do worst and best."""
    if not pictures:
        return []
    scores: dict[Source, list[float]] = {}
    for item in outcome.done:
        if item.task.source.group == "data" and item.task.setting.protocol == "corrected":
            scores.setdefault(item.task.source, []).append(item.row["within_1"])
    if not scores:
        return []
    means = {source: float(np.mean(values)) for source, values in scores.items()}
    ordered = sorted(means, key=lambda source: means[source])
    chosen = list(dict.fromkeys([next(iter(scores)), ordered[0], ordered[-1]]))[:EXAMPLES]
    found = {
        (task.setting.method, task.setting.window): task.setting.settings
        for task in plan.tasks
        if isinstance(task.setting, Corrected)
    }
    examples = []
    for number, source in enumerate(chosen):
        known = source.load()
        few = pictures if number == 0 else [pictures[-1]]
        examples.append(Example(source.name, tuple(_images(known, few, found))))
    return examples


def _images(
    known: Known, pictures: Sequence[Picture], found: Mapping[tuple[str, int | None], Settings]
) -> list[Shown]:
    truth = known.truth
    inside = truth[np.isfinite(truth)]
    span = (0.0, float(np.quantile(inside, 0.99)) if inside.size else 1.0)
    span = (0.0, max(span[1], 1.0))
    images = [
        Shown("left", "", "Left image", _image(known.pair.left, photo=True)),
        Shown("truth", "", "Truth", _image(io.colorize(_grown(truth), span))),
    ]
    for picture in pictures:
        result = match(known.pair, settings=found[picture.method, picture.window])
        label = picture.label if picture.window is None else f"{picture.label}, window {picture.window}"
        error = error_map(result.disparity, truth, grow=1)
        images += [
            Shown("result", picture.method, label, _image(io.colorize(result.disparity, span))),
            Shown("error", picture.method, f"Error of {label}", _image(error)),
        ]
    return images


def _image(image: npt.NDArray[Any], *, photo: bool = False) -> str:
    step = -(-image.shape[1] // WIDEST)
    small = image[::step, ::step]
    if photo and small.dtype != np.uint8:
        scale = 255 / max(float(small.max()), 1e-9)
        small = np.clip(small.astype(np.float32) * scale, 0, 255).astype(np.uint8)
    data = jpeg.encode(small) if photo else png.encode(small)
    return f"data:image/{'jpeg' if photo else 'png'};base64,{base64.b64encode(data).decode()}"


def _grown(truth: DisparityMap) -> DisparityMap:
    """Sparse truth, made fit to be seen: unknown pixels beside a known one take its value."""
    grown = truth.copy()
    for axis in (0, 1):
        for shift in (1, -1):
            beside = np.roll(grown, shift, axis)
            edge = 0 if shift == 1 else -1
            beside[(edge, slice(None)) if axis == 0 else (slice(None), edge)] = np.nan
            grown = np.where(np.isnan(grown), beside, grown)
    return grown
