"""Times of methods taken in turns on one pair, and their ratios."""

from __future__ import annotations

import csv
import io
import os
import platform
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from stereopsis import _fused, pipeline
from stereopsis.bench import opencv
from stereopsis.bench.methods import Method
from stereopsis.types import Disparities, Pair

Task = Callable[[], object]
Progress = Callable[[int, int, str], None]
THREADS = (1, 2)
REFERENCES = (opencv.THREE_WAYS, opencv.EIGHT_WAYS)
"""What every time is divided by."""


@dataclass(frozen=True)
class Spread:
    """Median and quartiles."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """Of one value or more."""
        low, high = np.quantile(values, (0.25, 0.75))
        return cls(statistics.median(values), float(low), float(high))


@dataclass(frozen=True)
class Line:
    """One method's times.

    Attributes
    ----------
    name : str
    seconds : Spread
        On one thread.
    ratios : dict of str to Spread
        Its time over a reference's of the same round; and over its own on one thread, ``"2 threads ÷ 1"``.
    stages : dict of str to float
        Median seconds of each stage, on one thread.
    """

    name: str
    seconds: Spread
    ratios: dict[str, Spread] = field(default_factory=dict)
    stages: dict[str, float] = field(default_factory=dict)


def in_turns(tasks: Sequence[Task], repeats: int, progress: Progress | None = None) -> list[list[float]]:
    """Seconds of each task, run one after the other, `repeats` times after a round that is not timed.

    A machine that is shared with others disturbs neighbours alike, so ratios within a round spread less than
    times do.

    Returns
    -------
    list of list of float
        A list a task, a number a round.
    """
    times: list[list[float]] = [[] for _ in tasks]
    for number in range(repeats + 1):
        for task, kept in zip(tasks, times, strict=True):
            start = time.perf_counter()
            task()
            seconds = time.perf_counter() - start
            if number:
                kept.append(seconds)
        if progress:
            progress(number, repeats, "")
    return times


def ratios(first: Sequence[float], second: Sequence[float]) -> Spread:
    """Of times that were taken in turns."""
    return Spread.of([a / b for a, b in zip(first, second, strict=True)])


def measure(
    pair: Pair,
    disparities: Disparities,
    methods: Sequence[Method],
    *,
    repeats: int = 21,
    with_opencv: bool = True,
    progress: Progress | None = None,
) -> list[Line]:
    """Time methods and OpenCV's matchers in turns, on one thread and on two.

    OpenCV gets its images as it wants them, 8-bit and grey, its result as it leaves it, and loses its border:
    all else would be added to its time.

    Parameters
    ----------
    pair : Pair
    disparities : Disparities
    methods : sequence of Method
        This library's.
    repeats : int
        Rounds.
    with_opencv : bool
    progress : callable, optional

    Returns
    -------
    list of Line
        The methods', then OpenCV's.
    """
    stages: dict[str, list[dict[str, float]]] = {method.name: [] for method in methods}
    tasks: dict[tuple[str, int], Task] = {}
    for method in methods:
        for threads in THREADS:
            tasks[method.name, threads] = _ours(pair, disparities, method, threads, stages[method.name])
    peers = (opencv.BLOCK, *REFERENCES) if with_opencv else ()
    for peer in peers:
        tasks[peer.name, 1] = opencv.task(pair, peer, disparities)
    times = dict(zip(tasks, in_turns(list(tasks.values()), repeats, progress), strict=True))
    lines = []
    for name, threads in tasks:
        if threads != 1:
            continue
        own = times[name, 1]
        found = {f"÷ {peer.name}": ratios(own, times[peer.name, 1]) for peer in peers if peer in REFERENCES}
        if (name, 2) in times:
            found["2 threads ÷ 1"] = ratios(times[name, 2], own)
        kept = stages.get(name, [])[1:]  # without the first round's
        medians = {
            stage: statistics.median(each.get(stage, 0.0) for each in kept)
            for stage in (kept[0] if kept else ())
        }
        lines.append(Line(name, Spread.of(own), found, medians))
    return lines


def _ours(
    pair: Pair, disparities: Disparities, method: Method, threads: int, stages: list[dict[str, float]]
) -> Task:
    assert method.settings is not None
    settings = method.settings.changed(disparities=disparities, threads=threads)

    def task() -> None:
        result = pipeline.match(pair, settings=settings)
        if threads == 1:
            stages.append(dict(result.timings))

    return task


def machine(with_opencv: bool = True) -> list[str]:
    """What ran: processor, cores, instruction sets, versions."""
    model = platform.processor() or platform.machine()
    try:
        told = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        model = next((line.split(":", 1)[1].strip() for line in told if line.startswith("model name")), model)
    except OSError:
        pass  # not there on every system
    peer = f"OpenCV {opencv.version()}, " if with_opencv else ""
    return [
        f"{model}, {os.cpu_count()} cores; instruction sets {', '.join(_fused.instruction_sets())}",
        f"stereopsis {_version()}, {peer}NumPy {np.__version__}, Python {platform.python_version()}, "
        f"{platform.system()}",
    ]


def _version() -> str:
    try:
        return metadata.version("stereopsis")
    except metadata.PackageNotFoundError:
        return "(not installed)"


def table(lines: Sequence[Line]) -> str:
    """Milliseconds, ratios and stages as GitHub Markdown; ratios are medians with their quartiles."""
    names = list(dict.fromkeys(name for line in lines for name in line.ratios))
    rows = [["method, 1 thread", "ms", *names]]
    rows.append(["---"] + ["---:"] * (1 + len(names)))
    for line in lines:
        ms = line.seconds
        cells = [f"{1e3 * ms.median:.1f} ({1e3 * ms.low:.1f} to {1e3 * ms.high:.1f})"]
        for name in names:
            ratio = line.ratios.get(name)
            cells.append("" if ratio is None else f"{ratio.median:.2f} ({ratio.low:.2f} to {ratio.high:.2f})")
        rows.append([line.name, *cells])
    parts = ["\n".join("| " + " | ".join(cells) + " |" for cells in rows)]
    for line in lines:
        if line.stages:
            told = ", ".join(f"{stage} {1e3 * seconds:.1f}" for stage, seconds in line.stages.items())
            parts.append(f"{line.name}, ms a stage: {told}")
    return "\n\n".join(parts)


def as_dict(lines: Sequence[Line]) -> list[dict[str, Any]]:
    """As plain data for JSON."""
    return [
        {
            "method": line.name,
            "seconds": vars(line.seconds),
            "ratios": {name: vars(ratio) for name, ratio in line.ratios.items()},
            "stages": line.stages,
        }
        for line in lines
    ]


def as_csv(lines: Sequence[Line]) -> str:
    """A line for each time and each ratio."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["method", "what", "median", "low quartile", "high quartile"])
    for line in lines:
        for what, spread in {"seconds": line.seconds, **line.ratios}.items():
            writer.writerow([line.name, what, spread.median, spread.low, spread.high])
        writer.writerows(
            [line.name, f"stage {name}, seconds", value, "", ""] for name, value in line.stages.items()
        )
    return stream.getvalue()
