"""Give broken files to every reader: python benchmarks/fuzz.py [--inputs 100000] [--first 0] [--seeds]

Each number is one file, made from the corpus in tests/fuzz/corpus; the same numbers give the same files. They
are read in a process of their own: one that crashes, hangs or fills the memory is found too. What fails is
written beside the corpus's files as found-NUMBER.KIND, where the tests read it from then on. --seeds writes
the corpus's first files again. Printed are the inputs, how many of them were read, and the time; the exit
code is 1 when something failed.
"""

from __future__ import annotations

import argparse
import io
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

import fuzz  # noqa: E402

PATIENCE = 60.0
"""Seconds without a finished input after which the process is ended: a hang that no signal reaches."""


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seeds", action="store_true", help="write the first files of the corpus again")
    parser.add_argument("--worker", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    if given.seeds:
        for name, data in seeds().items():
            (fuzz.CORPUS / name).write_bytes(data)
        return 0
    if given.worker:
        work(given.worker, given.first, given.inputs)
        return 0

    began = time.perf_counter()
    failed, read, at, end = 0, 0, given.first, given.first + given.inputs
    with tempfile.TemporaryDirectory() as folder:
        while at < end:
            finished, found, reason = watched(Path(folder), at, end - at)
            read += found
            at += finished
            if reason is None:
                continue
            failed += 1
            (broken,) = fuzz.inputs(range(at, at + 1))
            kept = fuzz.CORPUS / f"found-{at}.{broken.seed.rpartition('.')[2]}"
            kept.write_bytes(broken.data)
            print(f"{at} ({broken.seed}): {reason}; kept as {kept.name}", flush=True)
            at += 1
    seconds = time.perf_counter() - began
    share = 100 * read / max(given.inputs, 1)
    print(f"{given.inputs} inputs in {seconds:.0f} s, {share:.1f} % of them read, {failed} failed")
    return min(failed, 1)


def watched(folder: Path, first: int, count: int) -> tuple[int, int, str | None]:
    """Read inputs in a process of their own: how many it finished, how many were read, and why it ended."""
    log, errors = folder / "log", folder / "errors"
    log.write_bytes(b"")
    command = [
        sys.executable,
        __file__,
        "--worker",
        str(folder),
        "--first",
        str(first),
        "--inputs",
        str(count),
    ]
    with errors.open("wb") as sink, subprocess.Popen(command, stderr=sink) as process:
        size, since = 0, time.perf_counter()
        while True:
            try:
                process.wait(0.5)
                break
            except subprocess.TimeoutExpired:
                now = log.stat().st_size
                if now > size:
                    size, since = now, time.perf_counter()
                elif time.perf_counter() - since > PATIENCE:
                    process.kill()
    done = log.read_bytes()
    if process.returncode == 0:
        return len(done), done.count(b"r"), None
    said = errors.read_text(errors="replace").strip().splitlines()
    reason = said[-1][:200] if said else f"the process ended with {process.returncode}"
    return len(done), done.count(b"r"), reason


def work(folder: Path, first: int, count: int) -> None:
    """Read inputs one after the other; one byte of the log for each that did no harm."""
    warnings.simplefilter("error")
    with (folder / "log").open("wb", buffering=0) as log:
        for broken in fuzz.inputs(range(first, first + count)):
            path = folder / "input"
            path.write_bytes(broken.data)
            log.write(b"r" if fuzz.judge(path, broken.seed) else b".")


def seeds() -> dict[str, bytes]:
    """Small valid files of every kind, and some that broke readers elsewhere."""
    import tifffile
    from PIL import Image

    import stereopsis as st
    from stereopsis.study import Study

    rng = np.random.default_rng(5)
    grey = rng.integers(1, 256, (6, 7), np.uint8)
    colour = rng.integers(1, 256, (6, 7, 3), np.uint8)
    deep = colour.astype(np.uint16) * 200
    large = np.kron(colour, np.ones((5, 5, 1), np.uint8))
    floats = grey.astype(np.float32) / np.float32(4)
    made: dict[str, bytes] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, image in {
            "grey.png": grey,
            "colour.png": colour,
            "deep.png": deep,
            "grey.pgm": grey,
            "deep.ppm": deep,
            "grey.tif": grey,
            "colour.pfm": colour.astype(np.float32),
            "image.npy": colour,
        }.items():
            st.write_image(folder / file, image)
        for file in ("kitti.png", "disparity.pfm", "disparity.npy", "disparity.tif"):
            st.write_disparity(folder / file, floats)
        st.io.write_calibration(
            folder / "middlebury.txt", st.Calibration(700.5, 3.5, 3.0, 0.25, 1.5, 7, 6, 64)
        )
        st.write_ply(folder / "points.ply", floats[:, :3], colour[:, 0])
        made = {path.name: path.read_bytes() for path in folder.iterdir()}

    def tiff(pixels: npt.NDArray[Any], **options: Any) -> bytes:
        file = io.BytesIO()
        tifffile.imwrite(file, pixels, metadata=None, **options)
        return file.getvalue()

    def pillow(image: Image.Image, kind: str, **options: Any) -> bytes:
        file = io.BytesIO()
        image.save(file, kind, **options)
        return file.getvalue()

    row = "7e2 0 6e2 {} 0 7e2 2e2 0 0 0 1 0\n"
    matrix = "!!opencv-matrix\n   rows: {}\n   cols: 4\n   dt: d\n   data: [ {} ]\n"
    numbers = "7., 0., 6., {}., 0., 7., 2., 0., 0., 0., 1., 0."
    q = "1., 0., 0., -6., 0., 1., 0., -2., 0., 0., 0., 7., 0., 0., 4., 0."
    exif = Image.Exif()
    exif[0x0112] = 6
    picture = Image.fromarray(large)
    balanced = st.PRESETS["balanced"].to_toml()
    windows = ("cost", "zncc"), ("window", "bilateral:31,14,20"), ("subpixel", "none")
    solver = ("optimize", "trws"), ("smoothness", "l1")
    return made | {
        "palette.png": pillow(picture.quantize(7), "PNG"),
        "bits.png": pillow(Image.fromarray(grey > 99), "PNG"),
        "text.pgm": b"P2 3 2 255 1 2 3 4 5 6\n",
        "bits.pgm": b"P4\n# a comment\n7 6\n" + bytes(6),
        "grey.jpg": pillow(Image.fromarray(grey), "JPEG"),
        "exif.jpg": pillow(picture, "JPEG", exif=exif),
        "progressive.jpg": pillow(picture, "JPEG", progressive=True),
        "strips.tif": tiff(colour, photometric="rgb", compression="zlib", predictor=True, rowsperstrip=2),
        "lzw.tif": tiff(grey, compression="lzw"),
        "zstd.tif": tiff(floats, compression="zstd"),
        "tiles.tif": tiff(np.kron(floats, np.ones((4, 4), np.float32)), tile=(16, 16)),
        "planes.tif": tiff(np.moveaxis(colour, 2, 0), photometric="rgb", planarconfig="separate"),
        "jpeg.tif": tiff(large, photometric="rgb", compression="jpeg"),
        "kitti.txt": f"P0: {row.format(0)}P1: {row.format(-300)}".encode(),
        "rectified.txt": f"S_rect_02: 7 6\nP_rect_02: {row.format(0)}P_rect_03: {row.format(-300)}".encode(),
        "opencv.yml": b"%YAML:1.0\n---\n"
        + f"P1: {matrix.format(3, numbers.format(0))}P2: {matrix.format(3, numbers.format(-3))}".encode(),
        "depth.yml": f"%YAML:1.0\n---\nimage_width: 7\nQ: {matrix.format(4, q)}".encode(),
        "balanced.toml": balanced.encode(),
        "pixels.toml": b'preset = "fast"\ncost = "combined(census(5),0.5,gradient(3),0.5)"\nmedian = 5\n',
        "windows.toml": _toml(windows) + b"speckle = [9, 1.5]\n",
        "optimizer.toml": _toml(solver) + b"smoothness_weight = 2.5\ndisparities = [-8, 64]\n",
        "study.toml": Study(scenes=2, windows=(5, 9)).to_toml().encode(),
    }


def _toml(texts: Sequence[tuple[str, str]]) -> bytes:
    return "".join(f'{name} = "{text}"\n' for name, text in texts).encode()


if __name__ == "__main__":
    sys.exit(main())
