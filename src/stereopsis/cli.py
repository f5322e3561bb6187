"""The command line: parse, call, print. Nobody imports it.

Whatever is heavy is imported inside the commands, so that ``--help`` and a mistyped option answer at once.
"""

from __future__ import annotations

import dataclasses
import errno
import functools
import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal, TypeVar, cast

import click

from stereopsis._extras import MissingExtraError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from stereopsis.bench.methods import Method
    from stereopsis.evaluate import Scores
    from stereopsis.settings import Settings
    from stereopsis.types import Calibration, Pair, Result

F = TypeVar("F", bound=Callable[..., Any])

REFUSED = 2
"""Exit code when what was asked for cannot be done."""

INCOMPLETE = 3
"""Exit code when some pairs of a study or a batch have no result."""

INTERRUPTED = 130
"""Exit code after Ctrl-C, as a shell has it."""

PIPE_CLOSED = 141
"""Exit code when nobody reads standard output any more, as a shell has it."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Parameters
    ----------
    arguments : sequence of str, optional
        What follows the program's name; by default what the process was given.

    Returns
    -------
    int
        The exit code: 0; 2 after one line on standard error, ``stereopsis: error: ...``; 130 after Ctrl-C.
    """
    try:
        code = commands.main(arguments, prog_name="stereopsis", standalone_mode=False)
    except click.UsageError as error:
        where = error.ctx.command_path if error.ctx else "stereopsis"
        _complain(f"{error.format_message()} See '{where} --help'.")
    except click.ClickException as error:
        _complain(error.format_message())
    except MemoryError as error:
        _complain(f"not enough memory. {error}")
    except OSError as error:
        _complain(f"{error.filename}: {error.strerror}" if error.filename else str(error))
    except (ValueError, TypeError, MissingExtraError) as error:
        _complain(str(error))
    else:
        return code if isinstance(code, int) else 0
    return REFUSED


def _complain(message: str) -> None:
    print("stereopsis: error:", " ".join(message.split()), file=sys.stderr)


class _Commands(click.Group):
    """Lists the commands in the order in which they stand below, and ends quietly when told to."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

    def invoke(self, ctx: click.Context) -> Any:
        try:
            code = super().invoke(ctx)
            sys.stdout.flush()
            return code
        except KeyboardInterrupt:
            print("stereopsis: interrupted", file=sys.stderr)
            ctx.exit(INTERRUPTED)
        except BrokenPipeError:
            # What is still buffered has to go somewhere when the interpreter ends.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            ctx.exit(PIPE_CLOSED)


def _settings_text(path: Path) -> str:
    """A small file's text."""
    from stereopsis import _files

    try:
        return _files.read(path, 2**18, "settings").decode("utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not a TOML file: {error.reason}") from None


def _range(text: str) -> tuple[int, int]:
    """MIN:MAX, like Python's range."""
    try:
        low, high = (int(end) for end in text.split(":"))
    except ValueError:
        raise click.BadParameter(
            f"{text!r} is not MIN:MAX, two whole numbers such as 0:128 or -16:48."
        ) from None
    if low >= high:
        raise click.BadParameter(f"{text!r} holds no disparity: MAX is excluded and must exceed MIN.")
    return low, high


def _width_height(text: str) -> tuple[int, int]:
    """WIDTHxHEIGHT in pixels."""
    try:
        width, height = (int(side) for side in text.split("x"))
    except ValueError:
        raise click.BadParameter(
            f"{text!r} is not WIDTHxHEIGHT, two whole numbers such as 880x400."
        ) from None
    return width, height


def _show_version(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    if value:
        import stereopsis as st

        click.echo(f"stereopsis {st.__version__}")
        ctx.exit()


_INPUT = click.Path(exists=True, dir_okay=False, path_type=Path)
_OUTPUT = click.Path(path_type=Path)


class _Image(click.Path):
    """A file, or the folder of a Zarr array."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        self.dir_okay = str(value).rstrip("/").lower().endswith(".zarr")
        return super().convert(value, param, ctx)


_IMAGE = _Image(exists=True, path_type=Path)
_json = click.option("--json", "as_json", is_flag=True, help="Print one JSON object and nothing else.")


def _choices(command: F) -> F:
    """The options that together reach every setting; the command receives them as `_Choices`."""
    disparities = "Disparities to search, MAX excluded. Left away, they are estimated from the images."

    @click.option("--disparities", metavar="MIN:MAX", type=_range, help=disparities)
    @click.option("--preset", metavar="NAME", help="Start from a preset; 'stereopsis info' lists them.")
    @click.option("--settings", "file", type=_INPUT, help="Read settings from this TOML file.")
    @click.option(
        "--set", "assignments", metavar="NAME=VALUE", multiple=True, help="Change one setting; repeatable."
    )
    @click.option("--threads", type=int, help="Number of threads; 0 takes every core.")
    @functools.wraps(command)
    def with_choices(
        *args: Any,
        disparities: tuple[int, int] | None,
        preset: str | None,
        file: Path | None,
        assignments: tuple[str, ...],
        threads: int | None,
        **others: Any,
    ) -> Any:
        from stereopsis.settings import DEFAULT_PRESET, Settings

        named = {assignment.partition("=")[0].strip() for assignment in assignments}
        if preset is None and file is None and not named & {"cost", "preset"}:
            preset = DEFAULT_PRESET
        given = {"disparities": disparities, "threads": threads}
        changes = {name: value for name, value in given.items() if value is not None}
        settings = Settings.make(preset=preset, file=file, assignments=assignments, **changes)
        return command(*args, settings=settings, **others)

    return cast(F, with_choices)


@click.group(
    cls=_Commands,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_show_version,
    help="Show the version.",
)
@click.pass_context
def commands(ctx: click.Context) -> None:
    """Disparity maps that can be trusted, from rectified stereo pairs.

    \b
      stereopsis demo -o demo
      stereopsis match left.png right.png -o disparity.png -o preview.png
      stereopsis evaluate disparity.png truth.png
      stereopsis view
      stereopsis info disparity.png
      stereopsis batch DATASET -o out
      stereopsis bench accuracy DATASET
    """
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())


@commands.command()
@click.argument("left", type=_IMAGE)
@click.argument("right", type=_IMAGE)
@click.option("-o", "--output", "outputs", type=_OUTPUT, multiple=True, help="Write this file; repeatable.")
@click.option(
    "--memory", metavar="SIZE", help="Take no more memory than this, such as 2GiB; in tiles if need be."
)
@_choices
@click.option("--calibration", type=_INPUT, help="The pair's calibration, for .ply and *depth.")
@click.option("--truth", type=_INPUT, help="Score the result against this disparity map.")
@click.option("--show", is_flag=True, help="Then open the page on it; see 'stereopsis view --help'.")
@_json
def match(
    left: Path,
    right: Path,
    outputs: tuple[Path, ...],
    memory: str | None,
    settings: Settings,
    calibration: Path | None,
    truth: Path | None,
    show: bool,
    as_json: bool,
) -> None:
    """Match a rectified pair.

    \b
      stereopsis match left.png right.png -o out.png -o out.pfm -o preview.png
      stereopsis match left.png right.png --disparities 0:128 --set cost=zncc --set window=31
      stereopsis match left.png right.png --preset fast --calibration calib.txt -o points.ply
      stereopsis match big_left.tif big_right.tif -o big.tif --memory 2GiB

    What an output holds follows its name: .png 16-bit disparities as KITTI has them; .pfm, .npy, .tif
    disparities as they are; *preview.png and .jpg a picture; *depth.png millimetres in 16 bits,
    *depth.tif, .npy, .pfm metres; .ply a point cloud in metres.

    With --memory, images of any size are read, matched and written in tiles: from TIFF, NPY and Zarr into
    .tif, .npy, .pfm and .zarr.
    """
    import stereopsis as st

    if show and memory is not None:
        raise click.UsageError("--show needs the whole pair in memory: it goes without --memory")
    if show:
        from stereopsis import view as view_

        view_.require()
    if memory is not None and _in_tiles(left, right, outputs, settings, memory, truth, as_json):
        return
    camera = st.read_calibration(calibration) if calibration else None
    _check_outputs(outputs, camera, inputs=(left, right, calibration, truth))
    pair = st.read_pair(left, right, camera)
    target = st.read_disparity(truth) if truth else None
    if target is not None and target.shape != pair.left.shape[:2]:
        raise ValueError(f"{truth} holds {_size(target)} pixels, but {left} has {_size(pair.left)}")

    result = st.match(pair, settings=settings)
    scores = st.evaluate(result.disparity, target) if target is not None else None
    _write_outputs(outputs, result, pair)

    if as_json:
        scored = {"scores": scores.to_dict()} if scores else {}
        files = {"left": str(left), "right": str(right), "outputs": [str(path) for path in outputs]}
        _print_json({**files, **_facts(result), **scored})
    else:
        _print_result(result)
        if scores:
            click.echo()
            _print_scores(scores)
        _print_written(outputs)
    if show:
        _view((left, right), truth=truth, calibration=camera, settings=settings)


@commands.command()
@click.argument("disparity", type=_INPUT)
@click.argument("truth", type=_INPUT)
@click.option("--mask", type=_INPUT, help="Count only where this picture is white: 255, or 1 among 0 and 1.")
@click.option("--error-map", type=_OUTPUT, help="Draw the errors into this file.")
@click.option("--format", metavar="FORMAT", help="What DISPARITY is, where its content does not say.")
@click.option("--truth-format", metavar="FORMAT", help="What TRUTH is, such as middlebury:4.")
@_json
def evaluate(
    disparity: Path,
    truth: Path,
    mask: Path | None,
    error_map: Path | None,
    format: str | None,
    truth_format: str | None,
    as_json: bool,
) -> None:
    """Score a disparity map against the truth.

    \b
      stereopsis evaluate out.png truth.png
      stereopsis evaluate out.pfm disp0GT.pfm --mask mask0nocc.png --error-map error.png --json

    The scores stand in three columns: over the pixels that the map answers, over all known pixels with the
    unanswered ones counted as wrong, and over all known pixels after holes have been filled as KITTI does.
    """
    import stereopsis as st
    from stereopsis.evaluate import error_map as draw_errors

    pictures = (error_map,) if error_map else ()
    _check_outputs(pictures, inputs=(disparity, truth, mask))
    found, target = st.read_disparity(disparity, format), st.read_disparity(truth, truth_format)
    if found.shape != target.shape:
        raise ValueError(f"{disparity} holds {_size(found)} pixels, but {truth} {_size(target)}")
    counted = _read_mask(mask, target.shape) if mask else None

    scores = st.evaluate(found, target, counted)
    for path in pictures:
        st.write_image(path, draw_errors(found, target, counted))

    if as_json:
        picture = {"error_map": str(error_map)} if error_map else {}
        _print_json({"disparity": str(disparity), "truth": str(truth), **picture, **scores.to_dict()})
        return
    _print_scores(scores)
    _print_written(pictures)


@commands.command()
@click.argument("file", type=click.Path(exists=True, path_type=Path), required=False)
@_json
def info(file: Path | None, as_json: bool) -> None:
    """Say what a file holds, and what this program is made of.

    \b
      stereopsis info
      stereopsis info disparity.png
      stereopsis info calib.txt --json
      stereopsis info kitti2015

    FILE may be a disparity map, an image, a calibration, a .ply point cloud, or a data set: its folder, or a
    .csv or .parquet table of paths.
    """
    described = _contents(file) if file else {}
    program = _program()
    if as_json:
        _print_json({**described, "program": program})
        return
    if described:
        _print_facts(described)
        click.echo()
    _print_facts(program)


@commands.command()
@click.option(
    "-o",
    "--output",
    "folder",
    type=_OUTPUT,
    default="demo",
    show_default=True,
    help="The folder to write to.",
)
@click.option(
    "--size",
    metavar="WIDTHxHEIGHT",
    type=_width_height,
    default="880x400",
    show_default=True,
    help="Size of the images.",
)
@click.option("--seed", type=int, default=0, show_default=True, help="Which street.")
@_choices
@_json
def demo(folder: Path, size: tuple[int, int], seed: int, settings: Settings, as_json: bool) -> None:
    """Render a street scene, match it, score it and write all of it.

    \b
      stereopsis demo -o demo
      stereopsis demo -o demo --seed 7 --set cost=zncc --set window=9
    """
    from stereopsis.demo import demonstrate

    shown = demonstrate(folder, *size, seed, settings)
    if as_json:
        files = {"outputs": [str(path) for path in shown.files]}
        scores = {"scores": shown.scores.to_dict()}
        _print_json({**files, **_facts(shown.result), **scores})
        return
    _print_result(shown.result)
    click.echo()
    _print_scores(shown.scores)
    click.echo()
    _print_written(shown.files)


@commands.command()
@click.argument("dataset", type=click.Path(exists=True, file_okay=False, path_type=Path), required=False)
@click.option("-o", "--output", "folder", type=_OUTPUT, required=True, help="The folder to write to.")
@click.option("--settings", "file", type=_INPUT, help="Repeat the study of this settings.toml.")
@click.option("--protocol", metavar="all|published", help="'published': only what the report computed.")
@click.option("--tables-only", is_flag=True, default=None, help="Of the report, Tables I and II alone.")
@click.option("--windows", metavar="SIZES", help="The sweep: START:STOP:STEP, STOP excluded, or 5,15,31.")
@click.option("--methods", metavar="NAMES", help="Only these methods, such as ssd,zncc.")
@click.option("--parts", metavar="NAMES", help="Only these experiments, such as sweep,ablation.")
@click.option("--pairs", type=int, help="Only so many pairs, the first ones.")
@click.option(
    "--disparities",
    metavar="MIN:MAX",
    help="Candidates for every pair, or 'estimate' from each one's images.",
)
@click.option("--scenes", type=int, help="How many streets are rendered.")
@click.option("--size", metavar="WIDTHxHEIGHT", type=_width_height, help="Size of the streets.")
@click.option("--workers", type=int, default=1, show_default=True, help="Processes.")
@_json
def study(
    dataset: Path | None, folder: Path, file: Path | None, workers: int, as_json: bool, **given: Any
) -> int:
    """Run the report's experiments, as published and put right, and write a page of them.

    \b
      stereopsis study DATASET -o report
      stereopsis study DATASET -o report --protocol published --tables-only
      stereopsis study DATASET -o report --windows 5:95:10 --methods ssd,zncc --pairs 3 --workers 2
      stereopsis study --settings report/settings.toml -o again

    DATASET is a folder of NAME-left.*, NAME-right.* and NAME-disparity.png, or any other that 'stereopsis
    info DATASET' recognises; without it, streets are rendered. Every finished row is kept: an interrupted
    study goes on where it stopped when the same command is given again. The exit code is 3 when something
    could not be measured.
    """
    from stereopsis import study as study_

    study_.require()
    values: dict[str, Any] = {"data": dataset, **given}
    for name in ("windows", "methods", "parts"):
        if values[name] is not None:
            values[name] = _windows(values[name]) if name == "windows" else _names(values[name])
    if values["disparities"] not in (None, "estimate"):
        values["disparities"] = _range(values["disparities"])
    values = {name: value for name, value in values.items() if value is not None}
    if file:
        start = study_.Study.from_toml(_settings_text(file), str(file))
        chosen = dataclasses.replace(start, **values)
    else:
        chosen = study_.Study(**values)

    try:
        with _progress("rows") as advance:
            made = study_.run(chosen, folder, workers=workers, progress=advance)
    except KeyboardInterrupt:
        click.echo(f"stereopsis: what is finished is kept in {folder}; the same command goes on", err=True)
        raise
    for failure in made.outcome.failed:
        what = f"{failure.pair}, {failure.setting}" if failure.setting else failure.pair
        click.echo(f"stereopsis: not measured: {what}: {failure.reason}", err=True)
    if as_json:
        report = {
            "rows": len(made.outcome.done),
            "reused": sum(row.reused for row in made.outcome.done),
            "failed": [dataclasses.asdict(failure) for failure in made.outcome.failed],
            "tables": made.tables,
            "seconds": made.seconds,
            "outputs": [str(path) for path in made.files],
        }
        _print_json(report)
    else:
        if made.tables:
            head = ("as printed", "< 0.25 px", "< 0.5 px", "< 1 px", "< 2 px", "< 4 px", "RMSE")
            lines = (
                (name, *(f"{100 * value:.2f} %" for value in values[:-1]), f"{values[-1]:.2f}")
                for name, values in made.tables.items()
            )
            _print_table(lines, head)
        _print_written(made.files)
    return INCOMPLETE if made.outcome.failed else 0


@commands.command()
@click.argument("target", nargs=-1, type=click.Path(exists=True, path_type=Path))
@click.option("--truth", type=_INPUT, help="The true disparity map of a pair or a map.")
@click.option("--left", type=_INPUT, help="The left image of a disparity map.")
@click.option("--calibration", type=_INPUT, help="The geometry of a pair or a map.")
@click.option("--host", default="127.0.0.1", show_default=True, help="Where to listen.")
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, show_default=True, help="0: any that is free."
)
@click.option("--no-browser", is_flag=True, help="Only print the address.")
def view(target: tuple[Path, ...], no_browser: bool, **options: Any) -> None:
    """Look at a pair, its disparity, its errors and its points on a local page.

    \b
      stereopsis view
      stereopsis view left.png right.png --truth truth.png --calibration calib.txt
      stereopsis view disparity.png --left left.png
      stereopsis view DATASET
      stereopsis view out

    TARGET is a pair, a disparity map, a data set, or a folder with a results.csv; without it, a street is
    rendered. Ctrl-C ends the page. Beyond this machine it is served only to who has the token in the printed
    address.
    """
    from stereopsis import view as view_

    view_.require()
    _view(target, browser=not no_browser, **options)


def _view(
    paths: Sequence[Path],
    *,
    host: str = "127.0.0.1",
    port: int = 0,
    browser: bool = True,
    settings: Settings | None = None,
    **files: Any,
) -> None:
    """Serve the page until Ctrl-C."""
    from stereopsis import view as view_

    def ready(address: str) -> None:
        import threading
        import webbrowser

        click.echo(f"stereopsis: the page is at {address}; Ctrl-C ends it", err=True)
        if browser:  # in a thread, as a browser in the terminal would stop the server
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()

    target = view_.open_target(paths, settings=settings, **files)
    view_.serve(target, host=host, port=port, ready=ready)


@commands.command()
@click.argument("dataset", type=click.Path(exists=True, path_type=Path))
@click.option("-o", "--output", "out", required=True, help="A folder, or a URL such as s3://bucket/run.")
@_choices
@click.option("--evaluate", is_flag=True, help="Score the pairs that have truth.")
@click.option("--format", metavar="SUFFIX", default="png", show_default=True, help="png, pfm, npy or tiff.")
@click.option("--memory", metavar="SIZE", help="What a worker may take; larger pairs go in tiles, over all.")
@click.option("--scheduler", metavar="ADDRESS", help="A Dask scheduler's, such as tcp://host:8786.")
@click.option("--workers", type=int, help="Processes of this machine; by default one for each core.")
@click.option("--resume/--no-resume", default=True, help="Go on with the run in OUT; the default.")
@click.option("--overwrite", is_flag=True, help="Remove the run in OUT, whatever it is.")
@_json
def batch(dataset: Path, out: str, settings: Settings, evaluate: bool, as_json: bool, **given: Any) -> int:
    """Match every pair of a data set, on all cores or on a Dask cluster.

    \b
      stereopsis batch DATASET -o out --preset balanced
      stereopsis batch DATASET -o out --preset balanced --evaluate
      stereopsis batch DATASET -o out --preset balanced --scheduler tcp://host:8786
      stereopsis batch large.csv -o out --format tif --memory 2GiB

    OUT gets disparity/NAME.png, results.csv, timings.csv, failures.csv and run.toml. Each pair is kept as
    soon as it is done: the same command goes on where an earlier one was stopped. The exit code is 3 when
    some pair has no result.
    """
    from stereopsis import batch as batch_
    from stereopsis import datasets

    batch_.require()
    samples = datasets.open(dataset)
    try:
        with _progress("pairs") as advance:
            report = batch_.run(
                samples, settings, out, evaluate=evaluate, progress=cast(Any, advance), **given
            )
    except KeyboardInterrupt:
        click.echo(f"stereopsis: what is finished is kept in {out}; the same command goes on", err=True)
        raise
    for failure in report.failures[:10]:
        click.echo(f"stereopsis: no result: {failure.name!r}: {failure.reason}", err=True)
    if len(report.failures) > 10:
        click.echo(f"stereopsis: and {len(report.failures) - 10} more in failures.csv", err=True)
    if as_json:
        _print_json(dataclasses.asdict(report))
    else:
        shown = {name: value for name, value in report.means.items() if name in _SHOWN}
        facts = {name: getattr(report, name) for name in ("out", "pairs", "done", "reused", "seconds")}
        _print_facts({**facts, "failed": len(report.failures), **shown})
    return INCOMPLETE if report.failures else 0


_SHOWN = ("density", "own_d1", "own_epe", "filled_d1", "filled_bad_2", "filled_epe", "filled_rmse")
"""What the command line tells of a data set's scores; ``--json`` tells all."""


@commands.group(cls=_Commands, invoke_without_command=True)
@click.pass_context
def bench(ctx: click.Context) -> None:
    """Measure accuracy and speed, beside OpenCV.

    \b
      stereopsis bench accuracy DATASET
      stereopsis bench speed
    """
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())


def _compared(command: F) -> F:
    """The options of both tables."""

    @click.option(
        "--presets", metavar="NAMES", help="Only these, such as fast,local; 'none': plain settings."
    )
    @click.option(
        "--set", "assignments", metavar="NAME=VALUE", multiple=True, help="Change one setting of each preset."
    )
    @click.option("--opencv/--no-opencv", default=True, show_default=True, help="OpenCV's matchers too.")
    @click.option("--csv", "csv_file", type=_OUTPUT, help="Write every number into this file.")
    @_json
    @functools.wraps(command)
    def with_methods(
        *args: Any, presets: str | None, assignments: tuple[str, ...], csv_file: Path | None, **others: Any
    ) -> Any:
        from stereopsis.bench import methods, opencv

        ours = methods.presets(_names(presets or ""), assignments)
        if others["opencv"]:
            opencv.require()
        if csv_file:
            _check_writable(csv_file)
        return command(*args, ours=ours, csv_file=csv_file, **others)

    return cast(F, with_methods)


@bench.command()
@click.argument(
    "datasets",
    metavar="DATASET...",
    nargs=-1,
    required=True,
    type=click.Path(exists=True, path_type=Path),
)
@click.option("--pairs", type=click.IntRange(min=1), help="Of each data set only so many, the first ones.")
@click.option(
    "--disparities",
    metavar="MIN:MAX",
    default="0:128",
    show_default=True,
    help="Candidates for every pair, or 'calibration': up to the bound that the data set gives.",
)
@click.option("--threads", type=click.IntRange(min=0), default=1, show_default=True, help="0: every core.")
@_compared
def accuracy(
    datasets: tuple[Path, ...],
    pairs: int | None,
    disparities: str,
    threads: int,
    ours: list[Method],
    opencv: bool,
    csv_file: Path | None,
    as_json: bool,
) -> int:
    """Match and score every pair of some data sets.

    \b
      stereopsis bench accuracy kitti2015 middlebury
      stereopsis bench accuracy kitti2015 --presets local,none --set vertical=estimate --no-opencv
      stereopsis bench accuracy kitti2015 --pairs 5 --csv pairs.csv

    DATASET is a folder, or a .csv or .parquet table of paths, that 'stereopsis info DATASET' recognises. D1
    to RMSE are over all known pixels, holes filled; 'own' over those that the method answers. Where a data
    set tells occluded pixels apart, they do not count. The exit code is 3 when something could not be
    measured.
    """
    from stereopsis import datasets as datasets_
    from stereopsis.bench import accuracy as accuracy_
    from stereopsis.bench import methods as methods_
    from stereopsis.types import Disparities

    methods = [*ours, *(methods_.peers() if opencv else [])]
    candidates: accuracy_.Range = (
        "calibration" if disparities == "calibration" else Disparities(*_range(disparities))
    )
    found = [datasets_.open(folder) for folder in datasets]
    with _progress("matches") as advance:
        report = accuracy_.measure(found, methods, candidates, pairs=pairs, threads=threads, progress=advance)
    for failure in report.failures:
        what = ", ".join(filter(None, (failure.dataset, failure.pair, failure.method)))
        click.echo(f"stereopsis: not measured: {what}: {failure.reason}", err=True)
    if csv_file:
        _write_text(csv_file, accuracy_.as_csv(report))
    if as_json:
        _print_json(accuracy_.as_dict(report, methods))
    else:
        click.echo(accuracy_.tables(report, methods))
    return INCOMPLETE if report.failures else 0


@bench.command()
@click.argument("left", type=_INPUT, required=False)
@click.argument("right", type=_INPUT, required=False)
@click.option(
    "--disparities", metavar="MIN:MAX", type=_range, default="0:128", show_default=True, help="Candidates."
)
@click.option("--repeats", type=click.IntRange(min=1), default=21, show_default=True, help="Rounds.")
@_compared
def speed(
    left: Path | None,
    right: Path | None,
    disparities: tuple[int, int],
    repeats: int,
    ours: list[Method],
    opencv: bool,
    csv_file: Path | None,
    as_json: bool,
) -> None:
    """Time presets and OpenCV's matchers in turns, on one pair.

    \b
      stereopsis bench speed
      stereopsis bench speed left.png right.png --presets fast,local --repeats 41

    Without a pair, a street of 881 x 400 pixels is rendered. Every round runs each method once on one thread,
    and once on two; ratios are of times of the same round, as medians with their quartiles.
    """
    import stereopsis as st
    from stereopsis.bench import speed as speed_
    from stereopsis.types import Disparities

    if (left is None) is not (right is None):
        raise ValueError("RIGHT is missing: give both images, or neither")
    if left is not None and right is not None:
        pair, what = st.read_pair(left, right), str(left)
    else:
        pair, what = st.scenes.street(881, 400, seed=0).pair, "rendered street"
    with _progress("rounds") as advance:
        lines = speed_.measure(
            pair, Disparities(*disparities), ours, repeats=repeats, with_opencv=opencv, progress=advance
        )
    if csv_file:
        _write_text(csv_file, speed_.as_csv(lines))
    machine = speed_.machine(opencv)
    told = f"{what}, {_size(pair.left)}, disparities {disparities[0]}:{disparities[1]}, {repeats} rounds"
    if as_json:
        _print_json({"machine": machine, "pair": told, "methods": speed_.as_dict(lines)})
        return
    click.echo("\n".join([*machine, told, "", speed_.table(lines)]))


def _write_text(path: Path, text: str) -> None:
    from stereopsis.io.atomic import write_bytes

    write_bytes(path, text.encode())
    click.echo(f"wrote {path}", err=True)


def _windows(text: str) -> tuple[int, ...]:
    """START:STOP:STEP like Python's range, or sizes with commas between."""
    try:
        if ":" in text:
            return tuple(range(*(int(part) for part in text.split(":"))))
        return tuple(int(part) for part in text.split(","))
    except (ValueError, TypeError):
        raise click.BadParameter(
            f"windows: {text!r} is neither START:STOP:STEP nor sizes such as 5,15."
        ) from None


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


@contextmanager
def _progress(unit: str) -> Iterator[Callable[[int, int, str], None] | None]:
    """A bar with the time left on standard error, where that is a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(unit),
        TimeRemainingColumn(compact=True),
        TextColumn("{task.description}", markup=False),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)
        yield lambda finished, total, what: bar.update(
            task, completed=finished, total=total, description=what
        )


def _in_tiles(
    left: Path,
    right: Path,
    outputs: tuple[Path, ...],
    settings: Settings,
    memory: str,
    truth: Path | None,
    as_json: bool,
) -> bool:
    """Match from files into files; False where the whole has to be in memory, and fits."""
    from stereopsis import tiling
    from stereopsis.io.parts import PART_SUFFIXES
    from stereopsis.io.points import names_depth

    others = [path for path in outputs if path.suffix.lower() not in PART_SUFFIXES or names_depth(path)]
    if others or truth or not outputs:
        fits, needed = tiling.whole_fits(left, right, settings, memory)
        if not fits:
            whole = f"writing {others[0]}" if others else "a score" if truth else "printing without writing"
            raise ValueError(
                f"{whole} needs the whole map in memory, about {needed / 2**20:.0f} MiB, and --memory is "
                f"{memory}; disparities in {', '.join(PART_SUFFIXES)} are written in tiles"
            )
        return False
    with _progress("tiles") as advance:
        found = tiling.match(left, right, outputs, settings=settings, memory=memory, progress=advance)
    facts: dict[str, Any] = {
        "width": found.shape[1],
        "height": found.shape[0],
        "settings": found.settings.to_dict(),
        "path": "tiles",
        "tiles": found.tiles,
        "tile": f"{found.side[1]} x {found.side[0]}",
        "measured": list(found.measured),
        "seconds": found.seconds,
        "density": found.density,
        "flags": {str(flag.name).lower(): count for flag, count in found.flagged.items()},
    }
    if as_json:
        files = {"left": str(left), "right": str(right), "outputs": [str(path) for path in outputs]}
        _print_json({**files, **facts})
        return True
    settings_ = {name: value for name, value in facts.pop("settings").items() if value not in (None, ())}
    flags, pixels = facts.pop("flags"), found.shape[0] * found.shape[1]
    facts = {"size": f"{found.shape[1]} x {found.shape[0]}", **settings_, **facts}
    facts["flags"] = [f"{name} {count / pixels:.1%}" for name, count in flags.items() if count]
    facts["nearly as the whole"] = facts.pop("measured") or None
    facts["density"] = f"{found.density:.1%}"
    _print_facts({name: value for name, value in facts.items() if name not in ("width", "height")})
    _print_written(outputs)
    return True


def _check_outputs(
    paths: Sequence[Path], camera: Calibration | None = None, *, inputs: Sequence[Path | None]
) -> None:
    """Refuse what could not be written, before any work is done."""
    from stereopsis import io

    seen = {path.resolve() for path in inputs if path}
    for path in paths:
        io.check_output(path, calibration=camera)
        _check_writable(path)
        if path.resolve() in seen:
            raise ValueError(f"{path} is also read, or written twice")
        seen.add(path.resolve())


def _check_writable(path: Path) -> None:
    """Refuse a file that is a folder, or whose own folder is not there or not to be written to."""
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not path.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path.parent))
    if not os.access(path.parent, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path.parent))


def _write_outputs(paths: Sequence[Path], result: Result, pair: Pair) -> None:
    """Write every output, or none if one of them cannot hold the result."""
    from stereopsis import io
    from stereopsis.io.atomic import write_bytes

    with TemporaryDirectory(prefix="stereopsis-") as folder:
        drafts = {path: Path(folder, f"{number}-{path.name}") for number, path in enumerate(paths)}
        for path, draft in drafts.items():
            try:
                io.write_output(draft, result.disparity, image=pair.left, calibration=pair.calibration)
            except ValueError as error:
                raise ValueError(str(error).replace(str(draft), str(path))) from error
        for path, draft in drafts.items():
            write_bytes(path, draft.read_bytes())


def _read_mask(path: Path, shape: tuple[int, ...]) -> npt.NDArray[np.bool_]:
    """Where a picture is white; Middlebury draws what one camera alone sees at 128."""
    import numpy as np

    import stereopsis as st

    picture = st.read_image(path)
    if picture.shape != shape:
        raise ValueError(
            f"{path} must be grey and {shape[1]} x {shape[0]} as the truth, not of shape {picture.shape}"
        )
    values = set(np.unique(picture).tolist())
    if not (values <= {0, 1} or values <= {0, 128, 255}):
        raise ValueError(f"{path} is no mask: it holds other values than 0, 128 and 255, or 0 and 1")
    white: npt.NDArray[np.bool_] = picture == (255 if values - {0, 1} else 1)
    return white


def _contents(path: Path) -> dict[str, Any]:
    """What a file or a data set holds."""
    from stereopsis import datasets, io

    is_data_set = path.is_dir() or path.suffix.lower() in (".csv", ".parquet")
    return datasets.open(path).describe() if is_data_set else io.describe(path)


def _size(pixels: npt.NDArray[Any]) -> str:
    return f"{pixels.shape[1]} x {pixels.shape[0]}"


def _facts(result: Result) -> dict[str, Any]:
    """A result as plain data, without its arrays."""
    import numpy as np

    from stereopsis.types import Flag

    return {
        "width": result.disparity.shape[1],
        "height": result.disparity.shape[0],
        "settings": result.settings.to_dict(),
        "path": result.path,
        "seconds": result.seconds,
        "timings": dict(result.timings),
        "density": result.density,
        "flags": {str(flag.name).lower(): int(np.count_nonzero(result.flags & flag)) for flag in Flag},
    }


def _program() -> dict[str, Any]:
    """Versions, instruction sets and presets."""
    import platform
    from importlib import metadata

    from stereopsis import _fused, settings

    return {
        "stereopsis": metadata.version("stereopsis"),
        "instruction_set": _fused.instruction_set(),
        "instruction_sets": _fused.instruction_sets(),
        "cores": os.cpu_count() or 1,
        "presets": list(settings.PRESETS),
        "python": platform.python_version(),
        "platform": platform.platform(),
        **{
            name: metadata.version(name) for name in ("numpy", "pillow", "imagecodecs", "tifffile", "trimesh")
        },
    }


def _print_json(report: Mapping[str, Any]) -> None:
    click.echo(json.dumps(report, indent=2, allow_nan=False))


def _print_table(rows: Iterable[Sequence[str]], head: Sequence[str] = ()) -> None:
    """Print rows of a label and values; below a line of column names, the values stand at the right."""
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, pad_edge=False, show_header=bool(head), header_style="bold")
    for number, name in enumerate(head or ("", "")):
        justify: Literal["left", "right"] = "right" if head and number else "left"
        table.add_column(name, justify=justify, style=None if number else "cyan", overflow="fold")
    for row in rows:
        table.add_row(*row)
    # Echoed, not printed: of a closed pipe rich would make an exit of its own.
    console = Console(markup=False, highlight=False)
    with console.capture() as printed:
        console.print(table)
    click.echo("\n".join(line.rstrip() for line in printed.get().splitlines()))


def _print_facts(facts: Mapping[str, Any]) -> None:
    _print_table((name.replace("_", " "), _text(value)) for name, value in facts.items() if value is not None)


def _text(value: Any) -> str:
    match value:
        case float():
            return f"{value:.6g}"
        case list() | tuple():
            return ", ".join(map(_text, value))
        case dict():
            return ", ".join(f"{name} {_text(part)}" for name, part in value.items() if part is not None)
        case _:
            return str(value)


def _window(window: list[int] | str) -> str:
    return window if isinstance(window, str) else " x ".join(map(str, window))


def _print_result(result: Result) -> None:
    facts = _facts(result)
    settings = {name: value for name, value in facts["settings"].items() if value not in (None, ())}
    low, high = settings.pop("disparities")
    cost = settings.pop("cost")
    flags = [f"{name} {count / result.flags.size:.1%}" for name, count in facts["flags"].items() if count]
    stages = [f"{name} {1000 * seconds:.1f}" for name, seconds in facts["timings"].items()]
    rows = {
        "size": _size(result.disparity),
        "disparities": f"{low}:{high}",
        "cost": f"{cost['name']}, window {_window(cost['window'])}" if "window" in cost else _text(cost),
        **settings,
        "path": result.path,
        "time": f"{1000 * result.seconds:.1f} ms ({', '.join(stages)})",
        "density": f"{result.density:.1%}",
        "flags": flags,
    }
    _print_facts(rows)


def _print_scores(scores: Scores) -> None:
    density = f"{100 * scores.density:.2f} %" if scores.known else "-"
    _print_table([("density", density, "", ""), *scores.rows()], head=("", "own", "all", "filled"))


def _print_written(paths: Sequence[Path]) -> None:
    for path in paths:
        click.echo(f"wrote {path}")
