"""What tiles cost: disagreement with the whole image, memory against what was allowed, a large image.

python benchmarks/tiles.py disagreement FOLDER... [--preset balanced] [--side 256] [--overlaps 64,96]
python benchmarks/tiles.py memory [--side 6000] [--budgets 256MiB,512MiB,1GiB]
python benchmarks/tiles.py large OUT [--side 30000] [--memory 4GiB]
python benchmarks/tiles.py spread [--side 6000] [--memory 512MiB] [--workers 1,2]

`disagreement`: pairs of data sets are matched whole and in tiles; of the pixels that both answer, how many
differ by more than 1 pixel, and how many only one of them answers; as a mean over pairs, and the worst.
`memory`: an image is matched in a process of its own for each budget, which tells its peak. `large`: TIFFs
are written strip by strip from a texture, matched by `stereopsis match --memory`, and the answers counted.
`spread`: the same through `stereopsis batch --memory`, with the tiles spread over workers.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import tifffile

import stereopsis as st
from stereopsis import sgm
from stereopsis.settings import Settings
from stereopsis.tiling import reach, survey
from stereopsis.tiling.grid import tiles
from stereopsis.tiling.mosaic import Canvas, Mosaic
from stereopsis.tiling.parts import Array, match_tile

CHILD = """
import sys, stereopsis.cli
code = stereopsis.cli.main(sys.argv[1:])
peak = [line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")]
print("peak", int(peak[0]) * 1024, file=sys.stderr)
sys.exit(code)
"""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parts = parser.add_subparsers(required=True)
    part = parts.add_parser("disagreement")
    part.add_argument("folders", nargs="+", type=Path)
    part.add_argument("--pairs", type=int, help="of each folder only so many, the first ones")
    part.add_argument("--skip", type=int, default=0, help="leave out so many, the first ones")
    part.add_argument("--preset", action="append")
    part.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    part.add_argument("--side", type=int, default=256)
    part.add_argument("--same-planes", action="store_true", help="tell the tiles the whole image's planes")
    part.add_argument("--overlaps", default=str(sgm.OVERLAP))
    part.set_defaults(run=disagreement)
    part = parts.add_parser("memory")
    part.add_argument("--side", type=int, default=6000)
    part.add_argument("--budgets", default="256MiB,512MiB,1GiB")
    part.add_argument("--preset", default="fast")
    part.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    part.set_defaults(run=memory)
    part = parts.add_parser("large")
    part.add_argument("folder", type=Path)
    part.add_argument("--side", type=int, default=30000)
    part.add_argument("--memory", default="4GiB")
    part.add_argument("--preset", default="fast")
    part.add_argument("--keep", action="store_true", help="leave the images and the result")
    part.set_defaults(run=large)
    part = parts.add_parser("spread")
    part.add_argument("--side", type=int, default=6000)
    part.add_argument("--memory", default="512MiB")
    part.add_argument("--preset", default="fast")
    part.add_argument("--workers", default="1,2")
    part.set_defaults(run=spread)
    options = parser.parse_args()
    options.run(options)


# ---- disagreement --------------------------------------------------------------------------------


def disagreement(options: argparse.Namespace) -> None:
    print("| settings | data | overlap | pairs | > 1 px, mean | worst | one answers, mean | worst |")
    print("| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    usual = sgm.OVERLAP
    for preset in options.preset or ["balanced"]:
        for folder in options.folders:
            found: dict[int, list[tuple[float, float]]] = {int(o): [] for o in options.overlaps.split(",")}
            samples = list(st.datasets.open(folder))[options.skip :][: options.pairs]
            for sample in samples:
                pair = sample.pair()
                settings = Settings.make(preset, assignments=options.set)
                if settings.disparities is None:
                    settings = settings.changed(disparities=st.estimate_disparities(pair.left, pair.right))
                known = survey.survey(Array(pair.left), Array(pair.right), settings)
                keep = () if settings.slant is None else ("planes",)
                result = st.match(pair, settings=known.settings.changed(keep=keep))
                whole = result.disparity
                if keep and options.same_planes:
                    told = tuple(tuple(plane) for plane in result.stages["planes"].tolist())
                    known = replace(known, frame=replace(known.frame, planes=told))
                for overlap in found:
                    sgm.OVERLAP = overlap
                    sgm.halo.__defaults__ = (overlap,)
                    found[overlap].append(compared(whole, in_tiles(pair, known, options.side)))
                sgm.OVERLAP, sgm.halo.__defaults__ = usual, (usual,)
            for overlap, pairs in found.items():
                (far, lone), (most, most_lone) = np.mean(pairs, axis=0), np.max(pairs, axis=0)
                name = " ".join([preset, *options.set])
                print(
                    f"| {name} | {folder.name} | {overlap} | {len(pairs)} | {far:.3%} | {most:.3%} | "
                    f"{lone:.3%} | {most_lone:.3%} |",
                    flush=True,
                )


def in_tiles(pair: st.Pair, known: survey.Known, side: int) -> np.ndarray:
    left, right = Array(pair.left), Array(pair.right)
    halo = reach.halo(known.settings)
    disparity = np.empty(left.shape[:2], np.float32)
    mosaic = Mosaic(known, Canvas(disparity))
    width = left.shape[1] if reach.reaches_across(halo) else side
    laid = tiles(left.shape[:2], (side, width), halo, reach.alignment(known.settings))
    if known.frame.planes is None:
        known = survey.with_planes(left, right, known, laid)
    for tile in laid:
        mosaic.add(match_tile(left, right, known, tile))
    mosaic.finish()
    return disparity


def compared(whole: np.ndarray, tiled: np.ndarray) -> tuple[float, float]:
    """Shares of all pixels: both answer, and differ by more than 1; one alone answers."""
    both = np.isfinite(whole) & np.isfinite(tiled)
    far = both & (np.abs(np.where(both, whole - tiled, 0)) > 1)
    return float(far.mean()), float((np.isfinite(whole) != np.isfinite(tiled)).mean())


# ---- memory, and a large image -------------------------------------------------------------------


def memory(options: argparse.Namespace) -> None:
    assignments = [part for assignment in options.set for part in ("--set", assignment)]
    print("| settings | pixels | allowed | peak | peak ÷ allowed | tiles | s |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    with tempfile.TemporaryDirectory() as folder:
        write_pair(Path(folder), options.side)
        for budget in options.budgets.split(","):
            found, peak = run(Path(folder), budget, "--preset", options.preset, *assignments)
            share = peak / amount(budget)
            print(
                f"| {' '.join([options.preset, *options.set])} | {options.side}² | {budget} | "
                f"{peak / 2**20:.0f} MiB | {share:.2f} | {found['tiles']} | {found['seconds']:.1f} |",
                flush=True,
            )


def large(options: argparse.Namespace) -> None:
    options.folder.mkdir(parents=True, exist_ok=True)
    start = time.perf_counter()
    write_pair(options.folder, options.side)
    print(f"wrote the images in {time.perf_counter() - start:.0f} s", flush=True)
    found, peak = run(options.folder, options.memory, "--preset", options.preset)
    right, answered = truth_of(options.folder / "out.tif", options.side)
    print(
        f"{options.side} x {options.side}, {options.preset}, {options.memory}: {found['tiles']} tiles of "
        f"{found['tile']}, {found['seconds']:.0f} s, peak {peak / 2**20:.0f} MiB, "
        f"{peak / amount(options.memory):.2f} of what was allowed; density {answered:.2%}, of it within 1 px "
        f"{right:.3%}"
    )
    if not options.keep:
        for name in ("left.tif", "right.tif", "out.tif"):
            (options.folder / name).unlink()


def spread(options: argparse.Namespace) -> None:
    import psutil

    print("| workers | pixels | allowed to each | largest worker | s | within 1 px | same bytes |")
    print("| ---: | ---: | ---: | ---: | ---: | ---: | --- |")
    with tempfile.TemporaryDirectory() as name:
        folder, first = Path(name), b""
        write_pair(folder, options.side)
        (folder / "pairs.csv").write_text("name,left,right\nlarge,left.tif,right.tif\n")
        for workers in options.workers.split(","):
            out = folder / f"out{workers}"
            command = [sys.executable, "-m", "stereopsis", "batch", folder / "pairs.csv", "-o", out, "--json"]
            command += ["--format", "tif", "--memory", options.memory, "--workers", workers]
            command += ["--preset", options.preset, "--disparities", "0:32"]
            client = subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, text=True)
            process, peak = psutil.Process(client.pid), 0
            while client.poll() is None:
                for child in process.children():
                    with suppress(psutil.Error):
                        peak = max(peak, child.memory_info().rss)
                time.sleep(0.02)
            found = json.loads(client.communicate()[0])
            if found["failures"]:
                raise SystemExit(found["failures"][0]["reason"])
            map_ = out / "disparity" / "large.tif"
            right, _ = truth_of(map_, options.side)
            digest = hashlib.sha256(map_.read_bytes()).digest()
            first = first or digest
            print(
                f"| {workers} | {options.side}² | {options.memory} | {peak / 2**20:.0f} MiB | "
                f"{found['seconds']:.1f} | {right:.3%} | {'yes' if digest == first else 'NO'} |",
                flush=True,
            )


def amount(text: str) -> int:
    from stereopsis.tiling.memory import as_bytes

    return as_bytes(text)


def run(folder: Path, budget: str, *others: str) -> tuple[dict, int]:
    command = [sys.executable, "-c", CHILD, "match", folder / "left.tif", folder / "right.tif"]
    command += ["-o", folder / "out.tif", "--memory", budget, "--disparities", "0:32", "--json", *others]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(done.stderr)
    return json.loads(done.stdout), int(done.stderr.split()[-1])


PERIOD = 1024
"""The texture is repeated; the surface's steps are not, within a row of it."""


def steps(rows: np.ndarray) -> np.ndarray:
    """The disparity of each row: stairs of 60 rows."""
    return 4 + rows // 60 * 7 % 24


def write_pair(folder: Path, side: int) -> None:
    """TIFFs of one channel of 8 bits, written strip by strip."""
    draw = np.random.default_rng(0)
    texture = draw.integers(0, 256, (PERIOD, PERIOD + 7), dtype=np.uint8)
    columns = np.arange(side)

    def strips(shifted: bool):
        for top in range(0, side, 64):
            rows = np.arange(top, min(side, top + 64))
            shift = steps(rows) if shifted else np.zeros(len(rows), int)
            yield texture[rows[:, None] % PERIOD, (columns + shift[:, None]) % texture.shape[1]]

    for name, shifted in (("left.tif", False), ("right.tif", True)):
        with tifffile.TiffWriter(folder / name, bigtiff=side * side > 2**31) as writer:
            writer.write(
                strips(shifted),
                shape=(side, side),
                dtype=np.uint8,
                rowsperstrip=64,
                photometric="minisblack",
                metadata=None,
            )


def truth_of(path: Path, side: int) -> tuple[float, float]:
    """Of the answers the share within a pixel of the truth, and the share of answers."""
    from stereopsis.io.parts import _TiffMap  # the library reads images in parts, and maps whole

    with tifffile.TiffFile(path) as file:
        offsets = list(file.pages.first.dataoffsets)
    right = answered = 0
    with path.open("rb") as data:
        map = _TiffMap(data, (side, side), np.dtype(np.float32), offsets)
        for top in range(0, side, 1024):
            rows = np.arange(top, min(side, top + 1024))
            found = map.read(st.types.Rectangle(top, int(rows[-1]) + 1, 0, side))
            finite = np.isfinite(found)
            answered += int(finite.sum())
            right += int((np.abs(np.where(finite, found, np.inf) - steps(rows)[:, None]) <= 1).sum())
    return right / max(1, answered), answered / side**2


if __name__ == "__main__":
    main()
