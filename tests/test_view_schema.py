"""The description of the interface is true: asked whatever it allows, the server answers as it says."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as any_of

from stereopsis.settings import _NAMES
from stereopsis.view import choice, street
from stereopsis.view.limits import Limits
from view_help import Server, serving

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of the clients that it brings
    import schemathesis
    from schemathesis.checks import CHECKS, load_all_checks

load_all_checks()
NAMES = (
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_schema_conformance",
    "unsupported_method",
)
TRUE = [CHECKS.get_by_names([name])[0] for name in NAMES]
OPERATIONS = (
    ("/api/info", "GET"),
    ("/api/samples", "GET"),
    ("/api/open", "POST"),
    ("/api/scenes/{key}/{side}.png", "GET"),
    ("/api/scenes/{key}/{side}.bin", "GET"),
    ("/api/match", "POST"),
    ("/api/results/{key}/{name}.bin", "GET"),
    ("/api/results/{key}/cost", "GET"),
    ("/api/results/{key}/download/{name}", "GET"),
)
LIMITS = Limits(upload_bytes=2**20, disparities=64, match_seconds=10)


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with serving(street(64, 32), LIMITS) as running:
        yield running


@pytest.fixture(scope="module")
def schema(server: Server) -> Any:
    return schemathesis.openapi.from_dict(server.app.openapi())


@pytest.fixture(scope="module")
def known(server: Server) -> dict[str, str]:
    """What questions about a scene and a result may be about."""
    scene = server.open()
    return {"scene": scene["scene"], "result": server.match(scene, disparities=[0, 8])["result"]}


def test_every_operation_is_described(schema: Any) -> None:
    described = {
        (path, method.upper()) for path, item in schema.raw_schema["paths"].items() for method in item
    }
    assert described == set(OPERATIONS)


@pytest.mark.parametrize(("path", "method"), OPERATIONS)
def test_answers_are_as_described(
    server: Server, schema: Any, known: dict[str, str], path: str, method: str
) -> None:
    operation = schema[path][method]
    seen = set()

    @settings(max_examples=25, deadline=None, database=None, suppress_health_check=list(HealthCheck))
    @given(case=operation.as_strategy(), real=any_of.booleans())
    def ask(case: Any, real: bool) -> None:
        if real and case.path_parameters and "key" in case.path_parameters:
            case.path_parameters["key"] = known["scene" if "scenes" in path else "result"]
        if real and path == "/api/match" and isinstance(case.body, dict):
            case.body["scene"] = known["scene"]
        if real and path == "/api/open" and isinstance(case.body, dict) and "sample" in case.body:
            case.body["sample"] = "street"
        if real and path.endswith("/cost"):
            case.query = {name: value % 32 for name, value in case.query.items()}
        request = case.as_transport_kwargs(base_url="http://127.0.0.1")
        sent = {
            name: request[name]
            for name in ("params", "json", "data", "files", "headers")
            if request.get(name)
        }
        answer = server.ask(request["method"], request["url"], **_for_httpx(sent))
        answer.request._content = b""  # forms are sent in a stream, which cannot be read again
        case.validate_response(answer, checks=TRUE)
        seen.add(answer.status_code)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ask()
    assert 200 in seen


JSON = any_of.recursive(
    any_of.none() | any_of.booleans() | any_of.integers() | any_of.floats() | any_of.text(max_size=12),
    lambda inner: (
        any_of.lists(inner, max_size=3) | any_of.dictionaries(any_of.text(max_size=6), inner, max_size=3)
    ),
    max_leaves=6,
)
SMALL = any_of.integers(-3, 40) | any_of.sampled_from(
    [0.5, "none", "ssd", "census", "linear", "auto", "sgm", True]
)
LIKELY = SMALL | any_of.lists(SMALL, min_size=1, max_size=3)
FIELDS = sorted(name for name in _NAMES if name not in choice.SERVERS)
COSTS = any_of.sampled_from([cost["name"] for cost in choice.defaults()]).flatmap(
    lambda name: any_of.dictionaries(
        any_of.sampled_from(
            ["window", "aggregation", "truncation", "pattern", "a", "weight_a", "b", "weight_b"]
        ),
        LIKELY,
        max_size=3,
    ).map(lambda fields: {"name": name, **fields})
)
SETTINGS = any_of.dictionaries(
    any_of.sampled_from(FIELDS), JSON | LIKELY, max_size=4
) | any_of.fixed_dictionaries(
    {"cost": COSTS}, optional={"disparities": any_of.tuples(any_of.integers(-9, 9), any_of.integers(0, 20))}
)


@settings(max_examples=400, deadline=None, database=None)
@given(SETTINGS)
def test_whatever_is_set_is_taken_or_refused(given: dict[str, Any]) -> None:
    try:
        chosen = choice.read(given)
    except (ValueError, TypeError, OverflowError):
        return
    assert choice.read(json.loads(json.dumps(choice.written(chosen)))) == chosen


def test_whatever_is_asked_is_matched_or_refused(server: Server, known: dict[str, str]) -> None:
    statuses = []

    @settings(max_examples=80, deadline=None, database=None)
    @given(SETTINGS)
    def ask(given: dict[str, Any]) -> None:
        body = {"scene": known["scene"], "client": "fuzz", "settings": given}
        headers = {"content-type": "application/json"}
        answer = server.post("/api/match", content=json.dumps(body), headers=headers)
        assert answer.status_code in (200, 422), answer.text
        statuses.append(answer.status_code)
        if answer.status_code == 200:
            result = answer.json()
            assert server.array(result, "disparity").shape == (32, 64)
            assert server.get(f"/api/results/{result['result']}/cost?x=40&y=20").status_code == 200

    ask()
    assert statuses.count(200) >= 4
    assert statuses.count(422) >= 8


def _for_httpx(sent: dict[str, Any]) -> dict[str, Any]:
    if isinstance(sent.get("data"), bytes):
        sent["content"] = sent.pop("data")
    return sent
