"""Requests that replace each other, that nobody waits for, and many at once."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Iterator
from typing import Any

import httpx
import numpy as np
import psutil
import pytest

import stereopsis as st
from stereopsis.view import Target, street
from stereopsis.view.limits import Limits
from stereopsis.view.pool import BusyError, Job
from stereopsis.view.sources import Files
from stereopsis.view.targets import Entry
from view_help import Server, problem, serving

LONG = {"cost": {"name": "zsad", "window": 41}, "disparities": [0, 500]}
MIB = 2**20


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    limits = Limits(computations=1, result_bytes=4 * MIB)
    with serving(street(160, 80), limits) as running:
        yield running


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("large")
    noise = np.random.default_rng(0).integers(0, 255, (2, 900, 1200), np.uint8)
    for name, image in zip(("left.png", "right.png"), noise, strict=True):
        st.write_image(folder / name, image)
    files = Files(left=folder / "left.png", right=folder / "right.png")
    limits = Limits(computations=1, waiting=2)
    with serving(Target("pair", "noise", (Entry("noise", files),)), limits) as running:
        yield running


def _body(scene: dict[str, Any], client: str, **settings: Any) -> dict[str, Any]:
    return {"scene": scene["scene"], "client": client, "settings": settings}


def test_a_newer_request_replaces_an_older_one(large: Server) -> None:
    scene = large.open()

    async def scenario(client: httpx.AsyncClient) -> None:
        older = asyncio.create_task(client.post("/api/match", json=_body(scene, "tab", **LONG)))
        await asyncio.sleep(0.7)
        assert not older.done()
        start = time.monotonic()
        quick = {"preset": "fast", "vertical": None, "disparities": [0, 8]}
        newer = asyncio.create_task(client.post("/api/match", json=_body(scene, "tab", **quick)))
        assert "replaced" in problem(await older, 409)
        assert not newer.done()  # it is answered before it has stopped
        assert (await newer).status_code == 200
        assert time.monotonic() - start < 5

    large.run(scenario)


def test_other_clients_are_not_replaced(server: Server) -> None:
    scene = server.open()

    async def scenario(client: httpx.AsyncClient) -> list[httpx.Response]:
        bodies = (_body(scene, f"tab {tab}", window=5 + 2 * tab) for tab in range(4))
        return list(await asyncio.gather(*(client.post("/api/match", json=body) for body in bodies)))

    answers = server.run(scenario)
    assert [answer.status_code for answer in answers] == [200] * 4
    assert len({answer.json()["result"] for answer in answers}) == 4


def test_what_nobody_waits_for_is_stopped(large: Server) -> None:
    """As when a tab is closed: the connection ends, and with it the computation."""
    scene = large.open()

    class Leaves:
        """An application's receive that says from some moment on that the other side has gone."""

        def __init__(self, body: bytes) -> None:
            self.body: bytes | None = body
            self.left = False

        async def __call__(self) -> Any:
            if self.body is not None:
                body, self.body = self.body, None
                return {"type": "http.request", "body": body, "more_body": False}
            if not self.left:
                await asyncio.sleep(3600)
            return {"type": "http.disconnect"}

    async def scenario(client: httpx.AsyncClient) -> float:
        request = client.build_request("POST", "/api/match", json=_body(scene, "closed", **LONG))
        scope = {
            "type": "http",
            "asgi": {"version": "3.0"},
            "http_version": "1.1",
            "method": "POST",
            "scheme": "http",
            "path": "/api/match",
            "raw_path": b"/api/match",
            "query_string": b"",
            "headers": [(name.lower(), value) for name, value in request.headers.raw],
        }

        async def send(message: Any) -> None:
            pass

        receive = Leaves(request.content)
        asked = asyncio.create_task(large.app(scope, receive, send))
        await asyncio.sleep(0.3)
        receive.left = True
        start = time.monotonic()
        await asyncio.wait_for(asked, 10)
        quick = {"preset": "fast", "vertical": None, "disparities": [0, 9]}
        assert (await client.post("/api/match", json=_body(scene, "next", **quick))).status_code == 200
        return time.monotonic() - start

    assert large.run(scenario) < 5


def test_too_many_computations_are_refused(large: Server) -> None:
    scene = large.open()

    async def scenario(client: httpx.AsyncClient) -> None:
        bodies = [_body(scene, f"tab {tab}", **LONG, uniqueness=tab) for tab in range(3)]
        waiting = [asyncio.create_task(client.post("/api/match", json=body)) for body in bodies]
        await asyncio.sleep(0.3)
        full = await client.post("/api/match", json=_body(scene, "one more", **LONG))
        assert "too many" in problem(full, 503)
        # Who waits may change his mind; that makes room.
        quick = {"preset": "fast", "vertical": None, "disparities": [0, 7]}
        changed = [
            asyncio.create_task(client.post("/api/match", json=_body(scene, f"tab {tab}", **quick)))
            for tab in range(3)
        ]
        assert [answer.status_code for answer in await asyncio.gather(*waiting)] == [409] * 3
        assert [answer.status_code for answer in await asyncio.gather(*changed)] == [200] * 3

    large.run(scenario)


def test_what_could_not_be_opened_at_once_can_be_asked_for_again(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(job: Job) -> Job:
        raise BusyError("too many computations wait already: try again in a moment")

    with serving(street(64, 32)) as server:
        with monkeypatch.context() as patch:
            patch.setattr(server.session._readers, "submit", full)
            assert "too many" in problem(server.post("/api/open", json={"sample": "street"}), 503)
        assert server.open()["width"] == 64


def test_the_server_answers_while_it_computes(large: Server) -> None:
    scene = large.open()

    async def scenario(client: httpx.AsyncClient) -> None:
        computing = asyncio.create_task(client.post("/api/match", json=_body(scene, "tab", **LONG)))
        await asyncio.sleep(0.3)
        for url in ("/api/info", "/", f"/api/scenes/{scene['scene']}/left.png"):
            start = time.monotonic()
            assert (await client.get(url)).status_code == 200
            assert time.monotonic() - start < 3
        assert not computing.done()
        body = _body(scene, "tab", preset="fast", vertical=None, disparities=[0, 6])
        await client.post("/api/match", json=body)
        problem(await computing, 409)

    large.run(scenario)


def test_rapid_moves_and_many_clients_leave_memory_as_it_was(server: Server) -> None:
    """Fifty clients at once, a hundred moves in a row, several times: see benchmarks/view.py for more."""
    scene = server.open()

    async def moves(client: httpx.AsyncClient, turn: int) -> Counter[int]:
        def ask(tab: str, number: int) -> Any:
            body = _body(scene, tab, window=5 + 2 * (number % 20), uniqueness=turn + number / 1000)
            return asyncio.create_task(client.post("/api/match", json=body))

        hurried = []
        for number in range(100):
            hurried.append(ask("slider", number))
            await asyncio.sleep(0.002)
        together = [ask(f"tab {tab}", tab) for tab in range(50)]
        answers = await asyncio.gather(*hurried, *together)
        assert {answer.status_code for answer in answers[100:]} == {200}
        assert answers[99].status_code == 200
        return Counter(answer.status_code for answer in answers)

    def memory() -> int:
        own = psutil.Process()
        return own.memory_info().rss + sum(child.memory_info().rss for child in own.children(recursive=True))

    counts = server.run(lambda client: moves(client, 1))
    counts += server.run(lambda client: moves(client, 2))
    before = memory()
    for turn in range(3, 6):
        counts += server.run(lambda client, turn=turn: moves(client, turn))
    assert set(counts) <= {200, 409}
    assert server.session._results.bytes <= 4 * MIB
    assert memory() < before + 30 * MIB
    assert server.session._matching == {}
