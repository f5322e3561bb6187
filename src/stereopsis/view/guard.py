"""What stands before every request: who may ask, from where, how much, and what every answer says."""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import json
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qsl, urlencode, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

MOST_JSON = 2**20
HEADERS = {
    "content-security-policy": (
        "default-src 'self'; img-src 'self' blob: data:; style-src 'self'; script-src 'self'; "
        "worker-src 'self' blob:; connect-src 'self'; object-src 'none'; base-uri 'none'; "
        "form-action 'self'; frame-ancestors 'none'"
    ),
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach an address."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True)
class Guard:
    """An ASGI middleware.

    Attributes
    ----------
    app : ASGIApp
    hosts : frozenset of str
        Names that a Host header may hold. IP addresses are taken too where there is a token: another site's
        name cannot be made to lead here by them.
    token : str or None
        What a request has to carry.
    upload : int
        The longest body in bytes.
    """

    app: ASGIApp
    hosts: frozenset[str]
    token: str | None
    upload: int

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        if scope["type"] != "http":
            return
        headers = Headers(scope=scope)

        async def sealed(message: Message) -> None:
            if message["type"] == "http.response.start":
                answer = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    answer[name] = value
                answer.setdefault("cache-control", "no-store")
            await send(message)

        refused = self._refusal(scope, headers)
        if refused is not None:
            await _answer(sealed, *refused)
            return
        if self.token is not None:
            came = self._came_with(scope)
            if came is not None:
                await _answer(sealed, 303, "", {"location": came, "set-cookie": self._cookie()})
                return
            if not self._knows(headers):
                await _answer(sealed, 401, "open the address that the program printed: it carries the token")
                return
        await self.app(scope, _bounded(receive, self._most(headers)), sealed)

    def _refusal(self, scope: Scope, headers: Headers) -> tuple[int, str] | None:
        hosts = headers.getlist("host")
        if len(hosts) != 1 or not self._is_ours(hosts[0]):
            return 403, "this address is not the one that the server listens on"
        for origin in headers.getlist("origin"):
            if origin.lower() not in (f"http://{hosts[0].lower()}", f"https://{hosts[0].lower()}"):
                return 403, "requests from other sites are refused"
        if headers.get("sec-fetch-site") in ("cross-site", "same-site"):
            # A link that leads here may be followed; nothing else may be asked for from elsewhere.
            followed = scope["method"] == "GET" and headers.get("sec-fetch-mode") == "navigate"
            if not (followed and scope["path"] == "/"):
                return 403, "requests from other sites are refused"
        length = headers.get("content-length", "0")
        if not (length.isascii() and length.isdigit()):
            return 400, "the length of the request is not a number"
        most = self._most(headers)
        if int(length[:20]) > most:
            return 413, f"a request may have up to {most} bytes"
        return None

    def _is_ours(self, host: str) -> bool:
        try:
            name = urlsplit(f"//{host}").hostname
        except ValueError:
            return False
        if not name or "@" in host or "/" in host:
            return False
        if name in self.hosts:
            return True
        if self.token is None:
            return False
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return True

    def _came_with(self, scope: Scope) -> str | None:
        """Where to go on without the token, where the address carries the right one."""
        pairs = parse_qsl(scope["query_string"].decode("latin-1"), keep_blank_values=True)
        if scope["method"] != "GET" or not any(name == "token" and self._is_token(of) for name, of in pairs):
            return None
        rest = urlencode([(name, of) for name, of in pairs if name != "token"])
        # A path that begins with two slashes would lead to another site.
        path = "/" + scope["raw_path"].decode("latin-1").partition("?")[0].lstrip("/\\")
        return f"{path}?{rest}" if rest else path

    def _knows(self, headers: Headers) -> bool:
        for line in headers.getlist("cookie"):
            try:
                jar = SimpleCookie(line)
            except CookieError:
                continue
            if self._name in jar and self._is_token(jar[self._name].value):
                return True
        return False

    def _is_token(self, text: str) -> bool:
        return self.token is not None and hmac.compare_digest(text.encode(), self.token.encode())

    @property
    def _name(self) -> str:
        """The cookie's: browsers keep one jar for all ports of a host."""
        return "stereopsis-" + hashlib.sha256((self.token or "").encode()).hexdigest()[:8]

    def _cookie(self) -> str:
        return f"{self._name}={self.token}; HttpOnly; SameSite=Strict; Path=/"

    def _most(self, headers: Headers) -> int:
        """Only files may be long: what is not in parts is read into memory at once."""
        return self.upload if headers.get("content-type", "").startswith("multipart/") else MOST_JSON


def _bounded(receive: Receive, most: int) -> Receive:
    """Counts what comes, whatever its header said."""
    seen = 0

    async def counted() -> Message:
        nonlocal seen
        message = await receive()
        if message["type"] == "http.request":
            seen += len(message.get("body", b""))
            if seen > most:
                raise HTTPException(413, f"a request may have up to {most} bytes")
        return message

    return counted


async def _answer(send: Send, status: int, error: str, headers: dict[str, Any] | None = None) -> None:
    body = json.dumps({"error": error}).encode()
    fields = {"content-type": "application/json", "content-length": str(len(body)), **(headers or {})}
    raw = [(name.encode("latin-1"), value.encode("latin-1")) for name, value in fields.items()]
    await send({"type": "http.response.start", "status": status, "headers": raw})
    await send({"type": "http.response.body", "body": body})
