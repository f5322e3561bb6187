"""Listens, says where, and ends cleanly."""

from __future__ import annotations

import asyncio
import os
import secrets
import socket
from collections.abc import Callable
from contextlib import suppress

import uvicorn

from stereopsis.view.app import create_app
from stereopsis.view.guard import is_loopback
from stereopsis.view.session import Session
from stereopsis.view.targets import Target


def run(target: Target, host: str, port: int, ready: Callable[[str], object] | None) -> None:
    """Serve a target until Ctrl-C; see `stereopsis.view.serve`."""
    token = None if is_loopback(host) else secrets.token_urlsafe(24)
    listening = _listen(host, port)
    bound = listening.getsockname()[1]
    app = create_app(target, hosts=_names(host), token=token)
    config = uvicorn.Config(
        app,
        log_level="warning",
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=1,
        limit_concurrency=256,
    )
    session: Session = app.state.session
    address = _address(host, bound, token)
    server = _Server(config, lambda: ready(address) if ready else None, session.close)
    try:
        with suppress(KeyboardInterrupt):
            server.run(sockets=[listening])
    finally:
        session.close()
        listening.close()


class _Server(uvicorn.Server):
    """Calls back once it listens, and before it ends."""

    def __init__(
        self, config: uvicorn.Config, started: Callable[[], object], ended: Callable[[], object]
    ) -> None:
        super().__init__(config)
        self._tell, self._end = started, ended

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End what is computed first, so that who waits for it is answered."""
        await asyncio.to_thread(self._end)
        await super().shutdown(sockets)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started:
            self._tell()


def _listen(host: str, port: int) -> socket.socket:
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        listening = socket.socket(family, kind, protocol)
        try:
            if os.name == "posix":  # elsewhere it would let two programs listen at once
                listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listening.bind(address)
            listening.listen(128)
        except OSError:
            listening.close()
            raise
    except OSError as error:
        raise OSError(f"cannot listen on {host}, port {port}: {error.strerror}") from None
    return listening


def _names(host: str) -> frozenset[str]:
    """What a browser may call this server."""
    names = {host.lower(), "localhost", "127.0.0.1", "::1"}
    if not is_loopback(host):
        names |= {socket.gethostname().lower(), socket.getfqdn().lower()}
    return frozenset(names)


def _address(host: str, port: int, token: str | None) -> str:
    name = socket.gethostname() if host in ("0.0.0.0", "::", "") else f"[{host}]" if ":" in host else host
    return f"http://{name}:{port}/" + (f"?token={token}" if token else "")
