"""Whole data sets: a worker killed midway, memory over many pairs, what two workers gain, what many would.

    python benchmarks/batch.py                          # all of it, some minutes
    python benchmarks/batch.py killed --pairs 2000      # two workers, one killed midway; bytes compared
    python benchmarks/batch.py memory --pairs 10000     # resident memory of client, scheduler and workers
    python benchmarks/batch.py overhead                 # scheduling, a pair a task
    python benchmarks/batch.py workers                  # two workers against one, 881 x 400, preset balanced
    python benchmarks/batch.py model                    # pairs a second up to 10 000 cores
    python benchmarks/batch.py data --data ../shared/data

``killed`` and ``memory`` start a scheduler and two workers as processes of their own on loopback, so that the
memory of each can be told apart. ``workers`` lets both clusters take turns, A B A B ..., and prints the
median of the ratios: a machine shared with others disturbs it less. ``model`` measures its pieces first, or
takes them from the command line, as for a cluster whose storage and network are others.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import json
import math
import os
import pickle
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil

import stereopsis as st
from stereopsis import batch
from stereopsis.batch import cluster, work
from stereopsis.io.formats import png

SMALL = (96, 40)
"""Width and height of the generated pairs."""

CHEAP = ("--disparities", "0:16", "--set", "cost=sad", "--set", "window=5")
CORES = (1, 2, 8, 32, 128, 512, 2048, 10_000)


def generated(folder: Path, count: int) -> Path:
    """A folder of random textures, each moved by 3 to 9 pixels, with truth."""
    folder.mkdir(parents=True)
    width, height = SMALL
    for number in range(count):
        shift = 3 + number % 7
        texture = np.random.default_rng(number).integers(0, 256, (height, width + shift), np.uint8)
        truth = np.full((height, width), 256 * shift, np.uint16)
        views = {"left": texture[:, :width], "right": texture[:, shift:], "disparity": truth}
        for view, pixels in views.items():
            # Not by way of the disk, as st.write_image does: there are many.
            (folder / f"{number:06}-{view}.png").write_bytes(png.encode(np.ascontiguousarray(pixels)))
    return folder


# Processes


@contextmanager
def processes(folder: Path, workers: int) -> Iterator[tuple[str, dict[str, Any]]]:
    """A scheduler and workers with their nannies: the address, and each process under its name."""
    told = folder / "scheduler.json"
    told.unlink(missing_ok=True)
    common = ["--host", "127.0.0.1", "--dashboard-address", "127.0.0.1:0"]
    common += ["--preload", "stereopsis.batch.preload"]
    module = [sys.executable, "-m"]
    # As docs/batch.md starts them: an hour of Dask's profile would be kept, and grow so long.
    environment = os.environ | {"DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False"}
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": environment}
    scheduler = [*module, "distributed.cli.dask_scheduler", *common, "--port", "0", "--no-show"]
    running = [subprocess.Popen([*scheduler, "--scheduler-file", told], **quiet)]
    try:
        while not (told.exists() and told.read_text().rstrip().endswith("}")):
            time.sleep(0.05)
        address = json.loads(told.read_text())["address"]
        for _ in range(workers):
            worker = [*module, "distributed.cli.dask_worker", address, *common, "--nthreads", "1"]
            running.append(subprocess.Popen([*worker, "--local-directory", folder], **quiet))
        named = {"scheduler": psutil.Process(running[0].pid)}
        named |= {f"worker {n}": psutil.Process(process.pid) for n, process in enumerate(running[1:], 1)}
        yield address, named
    finally:
        for process in running:
            with suppress(psutil.NoSuchProcess):
                for child in psutil.Process(process.pid).children(recursive=True):
                    child.kill()
            process.kill()
            process.wait()


def child(nanny: Any) -> Any:
    """The worker that a nanny looks after; itself while there is none."""
    with suppress(psutil.Error):
        for process in nanny.children():
            if any("spawn_main" in part for part in process.cmdline()):
                return process
    return nanny


def mebibytes(process: Any) -> float:
    try:
        return float(process.memory_info().rss) / 2**20
    except psutil.NoSuchProcess:
        return 0.0


class Watch(threading.Thread):
    """Resident memory of each process against the pairs that are done."""

    def __init__(self, out: Path, named: dict[str, Any], every: float) -> None:
        super().__init__(daemon=True)
        self.out, self.named, self.every = out, named, every
        self.curve: list[tuple[float, int, dict[str, float]]] = []
        self.over = threading.Event()

    def run(self) -> None:
        start = time.monotonic()
        while not self.over.wait(self.every):
            held = {
                name: mebibytes(child(process) if name.startswith("worker") else process)
                for name, process in self.named.items()
            }
            self.curve.append((time.monotonic() - start, rows(self.out), held))


def rows(out: Path) -> int:
    """Pairs whose row is there."""
    try:
        return sum(1 for entry in os.scandir(out / "rows") if entry.name.endswith(".json"))
    except FileNotFoundError:
        return 0


def undergo(data: Path, out: Path, folder: Path, *, kill: bool, pairs: int) -> tuple[dict[str, Any], Watch]:
    """One run of the command on two workers, of which one may be killed when half of the pairs are done."""
    with processes(folder, 2) as (address, named):
        asked = [sys.executable, "-m", "stereopsis", "batch", data, "-o", out, *CHEAP, "--evaluate"]
        client = subprocess.Popen(
            [str(part) for part in (*asked, "--scheduler", address, "--json")],
            stdout=subprocess.PIPE,
            text=True,
        )
        watch = Watch(out, {"client": psutil.Process(client.pid), **named}, max(0.2, pairs / 20_000))
        watch.start()
        if kill:
            while rows(out) < pairs // 2 and client.poll() is None:
                time.sleep(0.01)
            victim = child(named["worker 1"])
            print(f"killed worker 1 (kill -9) with {rows(out)} pairs done")
            victim.kill()
        told, _ = client.communicate()
        watch.over.set()
        watch.join()
        if client.returncode:
            raise SystemExit(f"the run ended with {client.returncode}")
    return json.loads(told), watch


def print_curve(watch: Watch, lines: int = 12) -> None:
    """Some points of the curve, MiB; the last five beside the middle five say whether it grows."""
    names = list(watch.named)
    print("| pairs done | seconds | " + " | ".join(f"{name}, MiB" for name in names) + " |")
    print("| ---: " * (len(names) + 2) + "|")
    points = [point for point in watch.curve if point[1]]
    step = max(1, len(points) // lines)
    for seconds, done, held in points[::step]:
        print(f"| {done} | {seconds:.1f} | " + " | ".join(f"{held[name]:.1f}" for name in names) + " |")
    for name in names:
        values = [held[name] for _, _, held in points if held[name]]
        some = max(1, len(values) // 5)
        early, late = (
            statistics.median(part) for part in (values[some : 2 * some] or values, values[-some:])
        )
        grown = 1e3 * (late - early) / max(1, 0.7 * points[-1][1]) if points else 0.0
        print(
            f"{name}: median of the second fifth {early:.1f}, of the last {late:.1f} MiB: "
            f"{grown:.1f} KiB a pair"
        )


def killed(folder: Path, pairs: int) -> None:
    """A worker killed midway, and the same data without."""
    data = generated(folder / "pairs", pairs)
    print(f"\n## {pairs} pairs of {SMALL[0]} x {SMALL[1]}, two workers, one killed midway\n")
    report, watch = undergo(data, folder / "killed", folder, kill=True, pairs=pairs)
    print(f"{report['done']} rows, {len(report['failures'])} failures, {report['seconds']:.1f} s\n")
    print_curve(watch)
    calm, _ = undergo(data, folder / "calm", folder, kill=False, pairs=pairs)
    print(f"\nundisturbed: {calm['done']} rows, {calm['seconds']:.1f} s")
    ours, theirs = ((folder / name) for name in ("killed", "calm"))
    same = (ours / "results.csv").read_bytes() == (theirs / "results.csv").read_bytes()
    maps = sorted(path.name for path in (theirs / "disparity").iterdir())
    equal = sum(
        (ours / "disparity" / n).read_bytes() == (theirs / "disparity" / n).read_bytes() for n in maps
    )
    left = len(list(ours.rglob("*.tmp")))
    print("results.csv has " + ("the same bytes" if same else "OTHER BYTES"), end="; ")
    print(f"maps of the same bytes: {equal} of {len(maps)}")
    print(f"unfinished files: {left}")
    if not same or equal != pairs or report["done"] != pairs or left:
        raise SystemExit("the runs are not the same")


def memory(folder: Path, pairs: int) -> None:
    """Memory over many pairs."""
    data = generated(folder / "many", pairs)
    print(f"\n## Memory over {pairs} pairs of {SMALL[0]} x {SMALL[1]}\n")
    report, watch = undergo(data, folder / "memory", folder, kill=False, pairs=pairs)
    print(f"{report['done']} rows in {report['seconds']:.1f} s\n")
    print_curve(watch)


# Times


@dataclass(frozen=True)
class Street:
    """A pair of its own files, as a data set has them."""

    name: str
    left_file: Path
    right_file: Path

    def pair(self) -> st.Pair:
        return st.read_pair(self.left_file, self.right_file)

    def truth(self) -> None:
        return None

    def mask(self) -> None:
        return None


@dataclass(frozen=True)
class Waiting(Street):
    """A pair that takes a time and leaves the processor alone."""

    seconds: float = 0.0

    def pair(self) -> st.Pair:
        time.sleep(self.seconds)
        raise ValueError("nothing")


def streets(folder: Path, count: int) -> list[Street]:
    """Rendered streets of 881 x 400, read anew for each of `count` pairs."""
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for seed in range(min(count, 4)):
        scene = st.scenes.street(881, 400, seed)
        files.append((folder / f"{seed}-left.png", folder / f"{seed}-right.png"))
        st.write_image(files[-1][0], scene.left)
        st.write_image(files[-1][1], scene.right)
    return [Street(f"{n:05}", *pair) for n, pair in zip(range(count), itertools.cycle(files), strict=False)]


def seconds_of(samples: Sequence[Any], client: Any, preset: str = "balanced") -> tuple[float, Path]:
    """Wall seconds of a run, and where it is."""
    out = Path(tempfile.mkdtemp()) / "out"
    settings = st.PRESETS[preset].changed(disparities=(0, 128))
    return batch.run(samples, settings, out, client).seconds, out


def overhead(folder: Path, pairs: int) -> float:
    """Processor seconds of client and scheduler that a task takes, whatever is in it."""
    print("\n## Scheduling: pairs that only wait, on two workers\n")
    with cluster.local(min(2, cluster.cores())) as client:
        threads = cluster.threads_of(client)
        found = {}
        for wait, count in ((0.0, pairs), (0.1, max(60, pairs // 4))):
            files = folder / "left.png", folder / "right.png"
            samples = [Waiting(f"{n:06}", *files, wait) for n in range(count)]
            seconds_of(samples[:20], client)
            largest, cluster.LARGEST = cluster.LARGEST, cluster.LARGEST if wait else 1
            spent, lost = [], []
            for _ in range(3):
                used = time.process_time()
                wall, _ = seconds_of(samples, client)
                spent.append((time.process_time() - used) / count)
                lost.append(threads * wall / count - wait)
            cluster.LARGEST = largest
            found[wait] = min(spent)
            how = "tasks as a run makes them" if wait else "one a task"
            print(
                f"{count} pairs of {wait} s, {how}: {1e3 * min(spent):.2f} ms a pair of client and "
                f"scheduler, {1e3 * min(lost):.2f} ms a pair that a worker does not work"
            )
    return found[0.0]


def workers(folder: Path, pairs: int, rounds: int) -> list[dict[str, str]]:
    """Two workers against one."""
    print(f"\n## {pairs} pairs of 881 x 400, preset balanced, reading and writing included\n")
    samples = streets(folder / "streets", pairs)
    with cluster.local(1) as one, cluster.local(2) as two:
        for client in (one, two):
            seconds_of(samples[:4], client)
        ratios, alone = [], []
        for _ in range(rounds):
            (a, out), (b, _) = seconds_of(samples, one), seconds_of(samples, two)
            ratios.append(a / b)
            alone.append(a)
            print(
                f"one worker {pairs / a:.2f}, two {pairs / b:.2f} pairs a second: {a / b:.3f} x", flush=True
            )
    print(f"median {statistics.median(ratios):.3f} x (1.85 asked for)")
    with (out / "timings.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@dataclass(frozen=True)
class Pieces:
    """What the model is made of: seconds and bytes a pair, and what storage and network carry a second."""

    read: float
    match: float
    write: float
    task: float
    message: float
    files: float
    storage: float
    network: float


def bounds(pieces: Pieces, cores: int) -> dict[str, float]:
    """Pairs a second that each part could do with so many cores."""
    pair = pieces.read + pieces.match + pieces.write
    held = max(1, min(cluster.LARGEST, math.ceil(max(cluster.TASK, 2 * cores * cluster.ROUND) / pair)))
    return {
        "cores": cores / pair,
        "scheduler": held / pieces.task,
        "network at the scheduler": pieces.network / pieces.message,
        "storage": pieces.storage / pieces.files,
    }


def model(folder: Path, options: argparse.Namespace) -> None:
    """Measure the pieces and print the model."""
    samples = streets(folder / "model", 12)
    task = options.task or overhead(folder, 500)
    with cluster.local(1) as client:
        _, out = seconds_of(samples, client)
        with (out / "timings.csv").open(newline="") as file:
            times = list(csv.DictReader(file))
    row = max(len(path.read_bytes()) for path in (out / "rows").glob("*.json"))
    map_ = statistics.mean(path.stat().st_size for path in (out / "disparity").iterdir())
    images = sum(file.stat().st_size for file in (samples[0].left_file, samples[0].right_file))
    sent = len(pickle.dumps(work.Item(0, samples[0], samples[0].name)))
    pieces = Pieces(
        # The least: what other programs on the machine take away is not the model's.
        *(options_or(options, stage, min(float(t[stage]) for t in times)) for stage in MODEL),
        task=task,
        message=sent + row,
        files=images + map_ + row,
        storage=options.storage * 1e6,
        network=options.network * 1e6 / 8,
    )
    print("\n## Model\n")
    print(
        f"read {1e3 * pieces.read:.1f}, match {1e3 * pieces.match:.1f}, write {1e3 * pieces.write:.1f} ms "
        f"a pair; scheduling {1e3 * pieces.task:.2f} ms a task; {pieces.message:.0f} bytes a pair at the "
        f"scheduler, {pieces.files / 1e6:.2f} MB a pair to and from storage of {options.storage:.0f} MB/s; "
        f"network {options.network:.0f} Mbit/s\n"
    )
    print("| cores | pairs a task | pairs/s | bound by | " + " | ".join(list(bounds(pieces, 1))[1:]) + " |")
    print("| ---: | ---: | ---: | --- | ---: | ---: | ---: |")
    pair = pieces.read + pieces.match + pieces.write
    for cores in CORES:
        found = bounds(pieces, cores)
        least = min(found, key=lambda name: found[name])
        held = round(found["scheduler"] * pieces.task)
        others = " | ".join(f"{value:,.0f}" for name, value in found.items() if name != "cores")
        print(f"| {cores:,} | {held} | {found[least]:,.1f} | {least} | {others} |")
    for name in list(bounds(pieces, 1))[1:]:
        over = next((n for n in range(1, 1_000_000) if bounds(pieces, n)[name] < n / pair), None)
        print(f"{name}: the bound from {f'{over:,} cores' if over else 'no number of cores'} on")


MODEL = ("read", "match", "write")


def options_or(options: argparse.Namespace, name: str, measured: float) -> float:
    given: float | None = getattr(options, name)
    return measured if given is None else given


def data(folder: Path, root: Path) -> None:
    """The commands on real pairs: a run, and the same again."""
    for name in ("drivingstereo", "kitti2015", "middlebury-v3"):
        out = folder / name
        asked = [sys.executable, "-m", "stereopsis", "batch", root / name, "-o", out, "--preset", "balanced"]
        # Middlebury's ranges are wider, and each pair's own: estimated.
        asked += ["--evaluate"] if name == "middlebury-v3" else ["--disparities", "0:128", "--evaluate"]
        for _ in range(2):
            print(f"\n$ stereopsis batch {name} -o out/{name} {' '.join(map(str, asked[7:]))}", flush=True)
            subprocess.run(asked, check=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parts = ("all", "killed", "memory", "overhead", "workers", "model", "data")
    parser.add_argument("part", nargs="?", default="all", choices=parts)
    parser.add_argument("--pairs", type=int, help="how many; by default what each part is about")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument(
        "--data", type=Path, default=Path(os.environ.get("STEREOPSIS_DATA", "../shared/data"))
    )
    for name in (*MODEL, "task"):
        parser.add_argument(f"--{name}", type=float, help="seconds, instead of what is measured")
    parser.add_argument("--storage", type=float, default=2000, help="MB/s that all workers share")
    parser.add_argument("--network", type=float, default=10_000, help="Mbit/s of the scheduler's machine")
    options = parser.parse_args()

    def asked(part: str) -> bool:
        return options.part in ("all", part)

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if asked("killed"):
            killed(folder, options.pairs or 2000)
        if asked("memory"):
            memory(folder, options.pairs or 10_000)
        if options.part == "overhead":
            overhead(folder, options.pairs or 1000)
        if asked("workers"):
            workers(folder, options.pairs or 160, options.rounds)
        if asked("model"):
            model(folder, options)
        if asked("data") and options.data.is_dir():
            data(folder, options.data)


if __name__ == "__main__":
    main()
