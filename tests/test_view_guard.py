"""Who may ask: hosts, origins, tokens, sizes, and what no name leads to."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest

import stereopsis as st
from stereopsis.view import open_target, street
from stereopsis.view.guard import HEADERS, is_loopback
from stereopsis.view.limits import Limits
from stereopsis.view.server import _address, _names
from view_help import BASE, Server, problem, serving

TOKEN = "a-token-of-some-length"


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with serving(street(160, 80), Limits(upload_bytes=2 * 2**20)) as running:
        yield running


@pytest.fixture(scope="module")
def guarded() -> Iterator[Server]:
    with serving(street(160, 80), hosts=frozenset({"camera.example"}), token=TOKEN) as running:
        yield running


@pytest.mark.parametrize(
    ("host", "loopback"),
    [
        ("127.0.0.1", True),
        ("127.9.9.9", True),
        ("::1", True),
        ("localhost", True),
        ("0.0.0.0", False),
        ("::", False),
        ("192.168.0.7", False),
        ("localhost.example", False),
        ("", False),
    ],
)
def test_which_hosts_only_this_machine_reaches(host: str, loopback: bool) -> None:
    assert is_loopback(host) is loopback


@pytest.mark.parametrize(
    "host", ["127.0.0.1", "127.0.0.1:8000", "localhost", "LOCALHOST:1", "[::1]:8000", "[::1]"]
)
def test_our_own_names_are_answered(server: Server, host: str) -> None:
    assert server.get("/api/info", headers={"host": host}).status_code == 200


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "evil.example:80",
        "127.0.0.1.evil.example",
        "127.0.0.1@evil.example",
        "evil.example/127.0.0.1",
        "10.0.0.1",
        "[",
        "[::1",
        "",
        " ",
        "127.0.0.1:x",
    ],
)
def test_foreign_hosts_are_refused(server: Server, host: str) -> None:
    """A name of another site that is made to lead here says so in its Host header."""
    if host == "127.0.0.1:x":  # a port that is none does not make the name another
        assert server.get("/api/info", headers={"host": host}).status_code == 200
        return
    problem(server.get("/api/info", headers={"host": host}), 403)


def test_two_hosts_are_refused(server: Server) -> None:
    headers = [("host", "127.0.0.1"), ("host", "evil.example")]
    problem(server.get("/api/info", headers=headers), 403)


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:81", "file://", ""])
def test_foreign_origins_are_refused(server: Server, origin: str) -> None:
    for method, url in (("GET", "/api/info"), ("POST", "/api/match"), ("GET", "/")):
        problem(server.ask(method, url, headers={"origin": origin}), 403)


def test_our_own_origin_is_answered(server: Server) -> None:
    headers = {"host": "localhost:8000", "origin": "http://localhost:8000"}
    assert server.get("/api/info", headers=headers).status_code == 200


def test_other_sites_may_link_here_and_nothing_else(server: Server) -> None:
    link = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate"}
    assert server.get("/", headers=link).status_code == 200
    problem(server.get("/api/info", headers=link), 403)
    problem(server.post("/", headers=link), 403)
    picture = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "no-cors"}
    problem(server.get("/", headers=picture), 403)
    own = {"sec-fetch-site": "same-origin", "sec-fetch-mode": "cors"}
    assert server.get("/api/info", headers=own).status_code == 200


@pytest.mark.parametrize("url", ["/", "/api/info", "/nothing", "/api/results/0/disparity.bin"])
def test_every_answer_says_what_browsers_may_do_with_it(server: Server, url: str) -> None:
    answer = server.get(url)
    for name, value in HEADERS.items():
        assert answer.headers[name] == value
    assert "unsafe" not in answer.headers["content-security-policy"]
    assert "frame-ancestors 'none'" in answer.headers["content-security-policy"]
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["referrer-policy"] == "no-referrer"
    assert answer.headers["cache-control"] in ("no-store", "no-cache")
    refused = server.get(url, headers={"host": "evil.example"})
    assert refused.headers["content-security-policy"] == HEADERS["content-security-policy"]


# ---- the token ---------------------------------------------------------------------------------------------


def test_without_the_token_nothing_is_answered(guarded: Server) -> None:
    host = {"host": "camera.example"}
    for url in ("/", "/api/info", "/static/index.html", "/openapi.json", "/nothing", "/?token=", "/?token=x"):
        problem(guarded.get(url, headers=host), 401)
    problem(guarded.post(f"/api/open?token={TOKEN}", json={"sample": "street"}, headers=host), 401)
    for cookie in (
        "",
        "x",
        "stereopsis=x",
        f"other={TOKEN}",
        "stereopsis-00000000=" + TOKEN,
        "=;;=",
        "\x01=a",
    ):
        problem(guarded.get("/api/info", headers={**host, "cookie": cookie}), 401)


def test_the_token_becomes_a_cookie(guarded: Server) -> None:
    async def scenario(client: httpx.AsyncClient) -> None:
        first = await client.get(f"/?token={TOKEN}&x=1%262&view=3d")
        assert first.status_code == 303
        assert first.headers["location"] == "/?x=1%262&view=3d"
        cookie = first.headers["set-cookie"]
        assert {"HttpOnly", "SameSite=Strict", "Path=/"} <= {part.strip() for part in cookie.split(";")}
        assert (await client.get("/api/info")).status_code == 200
        assert (await client.get(first.headers["location"])).status_code == 200

    guarded.run(scenario)


def test_the_token_does_not_lead_elsewhere(guarded: Server) -> None:
    answer = guarded.ask("GET", f"{BASE}//evil.example/?token={TOKEN}")
    assert answer.status_code == 303
    assert answer.headers["location"] == "/evil.example/"


def test_the_token_does_not_make_foreign_hosts_ours(guarded: Server) -> None:
    problem(guarded.get(f"/?token={TOKEN}", headers={"host": "evil.example"}), 403)
    # Which of a machine's addresses is used is not known; another site has none of them as its name.
    assert guarded.get(f"/?token={TOKEN}", headers={"host": "192.168.0.7:8000"}).status_code == 303


def test_the_printed_address_carries_the_token() -> None:
    assert _address("127.0.0.1", 8000, None) == "http://127.0.0.1:8000/"
    assert _address("::1", 8000, None) == "http://[::1]:8000/"
    assert _address("10.0.0.1", 8000, "abc") == "http://10.0.0.1:8000/?token=abc"
    everywhere = _address("0.0.0.0", 8000, "abc")
    name = everywhere.removeprefix("http://").partition(":")[0]
    assert name in _names("0.0.0.0") or name.lower() in _names("0.0.0.0")


# ---- sizes -------------------------------------------------------------------------------------------------


def test_an_upload_that_says_it_is_too_long_is_refused(server: Server) -> None:
    files = {"left": ("a.png", b"\0" * (3 * 2**20))}
    assert "2097152 bytes" in problem(server.post("/api/open", files=files), 413)


def test_an_upload_that_is_too_long_is_refused_as_it_comes(server: Server) -> None:
    """Without a length, or with one that is not true."""
    sent = 0

    async def endless() -> object:
        nonlocal sent
        yield b'--x\r\nContent-Disposition: form-data; name="left"; filename="a.png"\r\n\r\n'
        while sent < 64 * 2**20:
            sent += 2**16
            yield b"\0" * 2**16

    headers = {"content-type": "multipart/form-data; boundary=x"}
    assert "2097152 bytes" in problem(server.post("/api/open", content=endless(), headers=headers), 413)
    assert sent <= 3 * 2**20


def test_a_long_question_is_refused(server: Server) -> None:
    for headers in ({"content-type": "application/json"}, {}):
        problem(server.post("/api/match", content=b" " * (2**20 + 1), headers=headers), 413)


@pytest.mark.parametrize("length", ["-1", "x", "1e3", "\u0661", "9" * 5000])
def test_a_length_that_is_none_is_refused(server: Server, length: str) -> None:
    answer = server.post("/api/match", content=b"{}", headers={"content-length": length.encode()})
    assert answer.status_code in (400, 413)
    problem(answer, answer.status_code)


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"--x",
        b"--x\r\n\r\n",
        b"--x\r\nContent-Disposition: form-data\r\n\r\n\r\n--x--",
        b'--x\r\nContent-Disposition: form-data; name="left"\r\n\r\ntext\r\n--x--\r\n',
        b"--x\r\nContent-Disposition: form-data; name=\"left\"; filename*=utf-8''%ff\r\n\r\na\r\n--x--\r\n",
    ],
)
@pytest.mark.parametrize("kind", ["multipart/form-data; boundary=x", "multipart/form-data"])
def test_broken_forms_are_sentences(server: Server, body: bytes, kind: str) -> None:
    answer = server.post("/api/open", content=body, headers={"content-type": kind})
    assert answer.status_code in (400, 422)
    problem(answer, answer.status_code)


def test_names_of_files_are_never_used(server: Server, tmp_path: Path) -> None:
    st.write_image(tmp_path / "a.png", np.zeros((4, 5), np.uint8))
    data = (tmp_path / "a.png").read_bytes()
    for name in (
        "../../../tmp/evil.png",
        "/etc/passwd",
        "C:\\x\\y.png",
        "a\0b.png",
        "-o.png",
        "$(x).png",
        ".",
    ):
        opened = server.good(server.post("/api/open", files={"left": (name, data), "right": (name, data)}))
        assert not set(opened["name"]) & set("/\\\0$")
        found = server.match(opened, disparities=[0, 2])
        assert "/" not in found["command"].replace("stereopsis match", "")
        assert "-o.png" not in found["command"].split()[2:4]
    assert not Path("/tmp/evil.png").exists()


# ---- files that are not the target's -----------------------------------------------------------------------

OUTSIDE = [
    "../app.py",
    "..%2fapp.py",
    "%2e%2e/app.py",
    "%2e%2e%2fapp.py",
    "..%5capp.py",
    "..\\app.py",
    "%252e%252e%252fapp.py",
    "....//app.py",
    "/etc/passwd",
    "%2fetc%2fpasswd",
    "//etc/passwd",
    "./index.html",
    "index.html/",
    "index.html%00.js",
    "%00",
    "",
    ".",
    "..",
    "~",
    "C:/Windows/win.ini",
    "file:///etc/passwd",
    "\u2025/app.py",
    "a" * 5000,
]


@pytest.mark.parametrize("name", OUTSIDE)
def test_static_names_lead_nowhere_else(server: Server, name: str) -> None:
    status, body = server.raw("/static/" + name)
    assert status == 404
    assert b"create_app" not in body
    assert b"root:" not in body
    assert set(json.loads(body)) == {"error"}


def test_static_files_are_answered_with_their_kind(server: Server) -> None:
    page = server.get("/")
    assert page.headers["content-type"].startswith("text/html")
    same = server.get("/static/index.html")
    assert same.content == page.content
    again = server.get("/", headers={"if-none-match": page.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("outside") / "data"
    folder.mkdir()
    scene = st.scenes.plane(64, 32, disparity=4)
    for side in ("left", "right"):
        st.write_image(folder / f"one-{side}.png", getattr(scene, side))
        st.write_image(folder.parent / f"secret-{side}.png", getattr(scene, side))
    with serving(open_target([folder])) as running:
        yield running


SAMPLES = ("../secret", "..%2fsecret", "one/../../secret", "/etc/passwd", "one-left.png", "One", "one ", "")


@pytest.mark.parametrize("name", [*SAMPLES, "\0"])
def test_samples_are_looked_up_never_joined(dataset: Server, name: str) -> None:
    problem(dataset.post("/api/open", json={"sample": name}), 404)
    assert dataset.open("one")["name"] == "one"


def test_a_table_names_only_maps_of_its_own_folder(tmp_path: Path) -> None:
    inside = tmp_path / "out" / "disparity"
    (inside / "deep").mkdir(parents=True)
    disparity = np.full((4, 5), 2.0, np.float32)
    for place in (inside / "own.png", inside / "deep" / "a b.png", tmp_path / "secret.png"):
        st.write_disparity(place, disparity)
    (inside / "we%3Aird.png").write_bytes((inside / "own.png").read_bytes())
    names = ["own", "../../secret", str(tmp_path / "secret"), "deep/a b", "we:ird", "missing", "own"]
    if hasattr(os, "symlink"):
        (inside / "link.png").symlink_to(tmp_path / "secret.png")
        (inside / "folder").symlink_to(tmp_path)
        names += ["link", "folder/secret"]
    table = "".join(f'"{name}",0.5\n' for name in names)
    (tmp_path / "out" / "results.csv").write_text(f"name,density\n{table}", encoding="utf-8")
    target = open_target([tmp_path / "out"])
    assert [entry.name for entry in target.entries] == ["own", "deep/a b", "we:ird"]
    with serving(target) as server:
        for name in set(names) - {"own", "deep/a b", "we:ird"}:
            problem(server.post("/api/open", json={"sample": name}), 404)
        assert server.open("deep/a b")["result"]["density"] == 1
