"""The page's server under load: rapid slider moves of one tab, and many tabs at once.

    python benchmarks/view.py
    python benchmarks/view.py --moves 100 --clients 50 --rounds 4
    python benchmarks/view.py --stops         # how soon a computation that is replaced ends

Starts the command ``stereopsis view`` on the synthetic street, and asks it over HTTP as the page does: a
match, then the disparity's bytes. Prints latencies, what was answered, and the memory of the server and of
its processes.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import random
import re
import signal
import statistics
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import httpx
import psutil

import stereopsis as st
from stereopsis.view.pool import Job, Pool
from stereopsis.view.sources import Scene

MIB = 2**20


@dataclass
class Tally:
    """What was answered, and how long it took."""

    statuses: Counter[int] = field(default_factory=Counter)
    seconds: list[float] = field(default_factory=list)

    def __str__(self) -> str:
        answered = ", ".join(f"{count} x {status}" for status, count in sorted(self.statuses.items()))
        if not self.seconds:
            return answered
        times = sorted(1000 * second for second in self.seconds)
        most = times[min(len(times) - 1, int(0.95 * len(times)))]
        median = statistics.median(times)
        told = {"least": times[0], "median": median, "95 %": most, "worst": times[-1]}
        return f"{answered}; {', '.join(f'{name} {value:.0f}' for name, value in told.items())} ms"


async def step(
    client: httpx.AsyncClient, scene: str, tab: str, window: int, tally: Tally, **settings: object
) -> None:
    """One move of the slider: the match, then its map."""
    start = time.perf_counter()
    body = {"scene": scene, "client": tab, "settings": {"preset": "fast", "window": [window, 7], **settings}}
    answer = await client.post("/api/match", json=body)
    tally.statuses[answer.status_code] += 1
    if answer.status_code == 200:
        data = await client.get(f"/api/results/{answer.json()['result']}/disparity.bin")
        assert data.status_code == 200
        tally.seconds.append(time.perf_counter() - start)


async def one_by_one(client: httpx.AsyncClient, scene: str, moves: int, low: float) -> Tally:
    """Each move waits for the one before it, and is new to the server."""
    tally = Tally()
    for number in range(moves):
        await step(client, scene, "slow", 5 + 2 * (number % 40), tally, uniqueness=low + number / 1000)
    return tally


async def rapid(client: httpx.AsyncClient, scene: str, moves: int, low: float) -> Tally:
    """A move every 10 ms, whether or not the one before it is answered."""
    tally, waiting = Tally(), []
    for number in range(moves):
        move = step(client, scene, "quick", 5 + 2 * (number % 40), tally, uniqueness=low + number / 1000)
        waiting.append(asyncio.create_task(move))
        await asyncio.sleep(0.01)
    await asyncio.gather(*waiting)
    return tally


async def together(client: httpx.AsyncClient, scene: str, clients: int, low: float) -> Tally:
    """Many tabs ask at the same moment, each for something else."""
    tally = Tally()
    moves = (
        step(client, scene, f"tab {tab}", 13, tally, uniqueness=low + tab / 1000) for tab in range(clients)
    )
    await asyncio.gather(*moves)
    return tally


async def load(address: str, process: psutil.Process, moves: int, clients: int, rounds: int) -> bool:
    """Everything in turn; whether nothing but answers and replaced requests came back."""
    limits = httpx.Limits(max_connections=clients + 10)
    good = True
    async with httpx.AsyncClient(base_url=address, timeout=120, limits=limits) as client:
        opened = (await client.post("/api/open", json={"sample": "street"})).json()
        scene = opened["scene"]
        print(f"street of {opened['width']} x {opened['height']}, disparities {opened['disparities']}, fast")
        await one_by_one(client, scene, 3, 0.0)
        for turn in range(rounds):
            low = 2.0 + turn
            print(f"round {turn + 1}: memory {memory(process)}")
            alone = await one_by_one(client, scene, moves, low)
            print(f"  {moves} moves, one by one:   {alone}")
            hurried = await rapid(client, scene, moves, low + 0.3)
            print(f"  {moves} moves, 10 ms apart:  {hurried}")
            many = await together(client, scene, clients, low + 0.6)
            print(f"  {clients} tabs at once:       {many}")
            good &= set(alone.statuses) == set(many.statuses) == {200}
            good &= set(hurried.statuses) <= {200, 409} and hurried.statuses[200] > 0
        print(f"at the end: memory {memory(process)}")
    return good


LONG: dict[str, dict[str, Any]] = {
    "zsad, window 41": {"cost": st.ZSAD(41), "disparities": (0, 256)},
    "bilateral 31": {"cost": st.SAD(st.Bilateral(31)), "disparities": (0, 128)},
    "trws": {"cost": st.SSD(5), "optimize": "trws", "disparities": (0, 128)},
    "bp": {"cost": st.SSD(5), "optimize": "bp", "disparities": (0, 128)},
    "expansion": {"cost": st.SSD(5), "optimize": "expansion", "disparities": (0, 64)},
}


def stops(turns: int = 5) -> None:
    """Until the process takes the next job, after one that is not wanted any more."""
    street = st.scenes.street(1200, 700, 1)
    scene = Scene(street.left, street.right, None, None, None, None, st.Disparities(0, 128))
    dice = random.Random(0)
    pool = Pool(1, waiting=8, memory=0, held=2**30)
    try:
        for name, settings in LONG.items():
            seconds = []
            for _ in range(turns):
                job = pool.submit(Job("matched", (st.Settings(**settings),), ("street", scene)))
                time.sleep(dice.uniform(0.6, 1.4))
                assert not job.future.done(), "too short to be stopped"
                start = time.perf_counter()
                pool.stop(job, "replaced")
                pool.submit(Job("nothing", ())).future.result()
                seconds.append(time.perf_counter() - start)
            print(f"  {name}: {', '.join(f'{1000 * second:.0f}' for second in seconds)} ms")
    finally:
        pool.close()


def memory(process: psutil.Process) -> str:
    """Resident memory of the server and of the processes that it has started."""
    own = process.memory_info().rss / MIB
    others = [child.memory_info().rss / MIB for child in process.children(recursive=True)]
    return f"{own:.0f} MiB, processes {' + '.join(f'{size:.0f}' for size in others)} MiB"


def _machine() -> str:
    others = f", load average {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    return f"{os.cpu_count()} cores{others}, Python {sys.version.split()[0]}"


def main() -> int:
    """Start the server, load it, end it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moves", type=int, default=100)
    parser.add_argument("--clients", type=int, default=50)
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--stops", action="store_true")
    options = parser.parse_args()
    if options.stops:
        print(_machine())
        stops()
        return 0
    command = [sys.executable, "-m", "stereopsis", "view", "--no-browser"]
    started = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        assert started.stderr is not None
        address = re.search(r"http://\S+/", started.stderr.readline())
        assert address is not None
        print(_machine())
        process = psutil.Process(started.pid)
        good = asyncio.run(load(address[0], process, options.moves, options.clients, options.rounds))
    finally:
        started.send_signal(signal.SIGINT)
        code = started.wait(30)
    print(f"ended with exit code {code}")
    return 0 if good and code == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
