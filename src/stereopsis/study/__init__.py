"""The experiments of the report, as published and put right, as one job that can be stopped and go on.

::

    from stereopsis import study
    study.run(study.Study(data="drivingstereo"), "report", workers=2)
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

from stereopsis import _extras
from stereopsis.io.atomic import write_bytes
from stereopsis.study.job import Done, Failed, Outcome, Progress
from stereopsis.study.plan import Study

__all__ = ["Done", "Failed", "Made", "Outcome", "Study", "require", "run"]


@dataclass(frozen=True)
class Made:
    """What `run` made.

    Attributes
    ----------
    outcome : Outcome
        Every row, and what failed.
    tables : dict of str to list of float
        Tables I and II as printed, where the study has them: the six columns of the report.
    files : tuple of Path
        Everything that was written.
    seconds : float
        Wall time.
    """

    outcome: Outcome
    tables: dict[str, list[float]]
    files: tuple[Path, ...]
    seconds: float


def require() -> None:
    """Check that what the extra ``study`` brings is installed.

    Raises
    ------
    ModuleNotFoundError
        Something is missing; names it and the extra.
    """
    _extras.require("the study needs", "study", "jinja2", "matplotlib", "scipy")


def run(
    study: Study, folder: str | os.PathLike[str], *, workers: int = 1, progress: Progress | None = None
) -> Made:
    """Run a study and write its report.

    The folder gets ``index.html`` (the page, one self-contained file), ``results.csv`` (one line a pair and
    setting; ``results.parquet`` too where pyarrow is installed), ``timings.csv``, ``tables.json`` (the
    report's two tables, where the study has them), ``settings.toml`` (repeats the run) and
    ``journal.jsonl``: the rows as they came, from which an interrupted run goes on. A row is used again only
    for the same images, truth, setting and program.

    Parameters
    ----------
    study : Study
        What to run.
    folder : str or path-like
        Where the report goes; made if it is not there.
    workers : int, default 1
        Processes, each with its share of the cores. Never changes a result. With more than one, a script
        needs ``if __name__ == "__main__":``.
    progress : callable, optional
        Called after each row with the rows finished, the rows there are, and what has been finished.

    Returns
    -------
    Made

    Raises
    ------
    ModuleNotFoundError
        Without the extra ``study``.
    ValueError
        The data set holds no pair, or a setting is not allowed.
    OSError
        The folder cannot be written.
    KeyboardInterrupt
        After Ctrl-C; the rows so far are kept.
    """
    require()
    if not isinstance(workers, int) or not 1 <= workers <= 1024:
        raise ValueError(f"workers must be a whole number from 1 to 1024, not {workers!r}")
    from stereopsis.study import job, page, plan, sections, tables

    start = time.perf_counter()
    where = Path(folder)
    planned = plan.make(study)
    where.mkdir(parents=True, exist_ok=True)
    write_bytes(where / "settings.toml", study.to_toml().encode())
    outcome = job.run(planned, where, workers, progress)

    if progress:
        progress(len(outcome.done), len(outcome.done), "writing the report")
    rows = tables.Rows(outcome.done)
    files = [where / name for name in ("index.html", "results.csv", "timings.csv", "settings.toml")]
    tables.write_results(files[1], outcome.done)
    tables.write_timings(files[2], outcome.done)
    for stale in ("results.parquet", "tables.json"):
        (where / stale).unlink(missing_ok=True)
    if tables.write_parquet(where / "results.parquet", outcome.done):
        files.append(where / "results.parquet")
    printed = tables.printed(rows, as_printed=True)
    if printed:
        tables.write_tables(where / "tables.json", rows)
        files.append(where / "tables.json")
    report = sections.Report(study, planned.name, rows)
    seconds = time.perf_counter() - start
    page.write(files[0], study, planned, outcome, report, sections.make(report), seconds)
    return Made(outcome, printed, tuple(files), time.perf_counter() - start)
