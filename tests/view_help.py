"""Talks to the page's server within the process, and shuts it down."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar
from urllib.parse import unquote

import httpx
import numpy as np
import numpy.typing as npt

from stereopsis.view.app import create_app
from stereopsis.view.limits import Limits
from stereopsis.view.targets import Target

T = TypeVar("T")
BASE = "http://127.0.0.1"


def busy() -> float:
    """How many times as long something takes here as it would on a machine that does nothing else."""
    start, work = time.perf_counter(), time.process_time()
    while time.process_time() - work < 0.3:
        pass
    return max(1.0, (time.perf_counter() - start) / 0.3)


class Server:
    """One application; every call is a request of its own, whatever loop it runs in."""

    def __init__(self, target: Target, limits: Limits | None = None, **options: Any) -> None:
        self.app = create_app(target, limits=limits, **options)
        self.session = self.app.state.session

    def client(self, **options: Any) -> httpx.AsyncClient:
        transport = httpx.ASGITransport(self.app, raise_app_exceptions=False)
        return httpx.AsyncClient(transport=transport, base_url=BASE, timeout=60, **options)

    def run(self, scenario: Callable[[httpx.AsyncClient], Awaitable[T]]) -> T:
        async def whole() -> T:
            async with self.client() as client:
                return await scenario(client)

        return asyncio.run(whole())

    def ask(self, method: str, url: str, **options: Any) -> httpx.Response:
        return self.run(lambda client: client.request(method, url, **options))

    def get(self, url: str, **options: Any) -> httpx.Response:
        return self.ask("GET", url, **options)

    def post(self, url: str, **options: Any) -> httpx.Response:
        return self.ask("POST", url, **options)

    def open(self, name: str | None = None) -> dict[str, Any]:
        """Open a sample, by default the first."""
        name = name or self.get("/api/samples").json()["samples"][0]["name"]
        return self.good(self.post("/api/open", json={"sample": name}))

    def match(self, scene: dict[str, Any], **settings: Any) -> dict[str, Any]:
        body = {"scene": scene["scene"], "client": "test", "settings": settings}
        return self.good(self.post("/api/match", json=body))

    def array(self, result: dict[str, Any], name: str) -> npt.NDArray[Any]:
        data = self.get(f"/api/results/{result['result']}/{name}.bin").content
        kind = np.uint8 if name == "flags" else np.float32
        return np.frombuffer(data, kind).reshape(result["height"], result["width"])

    def raw(self, path: str) -> tuple[int, bytes]:
        """Status and body of a path as it stands on the wire, which a client would tidy up."""
        scope = {
            "type": "http",
            "asgi": {"version": "3.0"},
            "http_version": "1.1",
            "method": "GET",
            "scheme": "http",
            "path": unquote(path),
            "raw_path": path.encode(),
            "query_string": b"",
            "headers": [(b"host", b"127.0.0.1")],
        }
        sent: list[Any] = []

        async def receive() -> Any:
            return {"type": "http.request", "body": b"", "more_body": False}

        async def send(message: Any) -> None:
            sent.append(message)

        asyncio.run(self.app(scope, receive, send))
        return sent[0]["status"], b"".join(message.get("body", b"") for message in sent)

    @staticmethod
    def good(answer: httpx.Response) -> dict[str, Any]:
        assert answer.status_code == 200, answer.text
        found: dict[str, Any] = answer.json()
        return found


@contextmanager
def serving(target: Target, limits: Limits | None = None, **options: Any) -> Iterator[Server]:
    server = Server(target, limits, **options)
    try:
        yield server
    finally:
        server.session.close()


def problem(answer: httpx.Response, status: int) -> str:
    """The sentence of an answer that has to be a problem."""
    assert answer.status_code == status, answer.text
    assert set(answer.json()) == {"error"}
    sentence: str = answer.json()["error"]
    assert sentence
    assert "\n" not in sentence
    return sentence
