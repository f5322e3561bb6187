"""Settings as the page sends them, and the command and the lines of Python that repeat them."""

from __future__ import annotations

import dataclasses
import re
import shlex
from collections.abc import Mapping
from typing import Any, cast

from stereopsis import settings
from stereopsis.pixelwise import PIXEL_COSTS, Census, Combined, Gradient, Pixelwise
from stereopsis.settings import COSTS, DEFAULT_PRESET, OPTIMIZER_PARTS, OPTIMIZERS, Settings

SERVERS = ("threads", "keep")
"""What the page does not set."""


def read(given: Mapping[str, Any]) -> Settings:
    """Settings from a request's ``settings``.

    Raises
    ------
    ValueError, TypeError
        A name is unknown, or a value not allowed.
    """
    changes = dict(given)
    for name in SERVERS:
        if name in changes:
            raise ValueError(f"{name} is the server's to set")
    # Without a cost of its own a request starts where the command line does.
    preset = changes.pop("preset", None if "cost" in changes else DEFAULT_PRESET)
    start = Settings() if preset is None else settings.named(preset)
    if isinstance(changes.get("cost"), Mapping):
        changes["cost"] = _cost(changes["cost"])
    if isinstance(changes.get("optimize"), Mapping):
        parts = dict(changes.pop("optimize"))
        flat = {part: name for name, part in OPTIMIZER_PARTS.items()}
        changes["optimize"] = parts.pop("name", None)
        changes |= {flat.get(name, f"optimize_{name}"): value for name, value in parts.items()}
    return start.changed(**{name: _fixed(value) for name, value in changes.items()})


def _cost(given: Mapping[str, Any]) -> Any:
    fields = dict(given)
    name = fields.pop("name", None)
    kinds = {**COSTS, **PIXEL_COSTS}
    if not isinstance(name, str) or name not in kinds:
        raise ValueError(f"cost must be one of {', '.join(kinds)}, not {name!r}")
    known = {field.name for field in dataclasses.fields(kinds[name])}
    for field in fields:
        if field not in known:
            raise ValueError(f"cost {name} has no {field}; it has {', '.join(sorted(known))}")
    values = {
        field: _cost(value) if isinstance(value, Mapping) else _fixed(value)
        for field, value in fields.items()
    }
    return kinds[name](**values)


def _fixed(value: Any) -> Any:
    """A list of JSON as the tuple that a setting is."""
    return tuple(map(_fixed, value)) if isinstance(value, list) else value


def _start(chosen: Settings) -> Settings:
    return Settings() if chosen.preset is None else settings.named(chosen.preset)


def _changed(chosen: Settings) -> list[str]:
    """The fields that differ from where the settings started, but for the range."""
    start = _start(chosen)
    return [
        field.name
        for field in dataclasses.fields(chosen)
        if field.name not in ("disparities", "preset")
        and getattr(chosen, field.name) != getattr(start, field.name)
    ]


def written(chosen: Settings) -> dict[str, Any]:
    """Settings as a request's ``settings``: `read` gives them back, but for what is the server's."""
    facts = chosen.to_dict()
    names = {"preset", *_changed(chosen)} - set(SERVERS)
    if chosen.preset is None:
        names.add("cost")
    if chosen.disparities is not None:
        names.add("disparities")
    return {name: value for name, value in facts.items() if name in names}


def command(chosen: Settings, left: str, right: str) -> str:
    """The command that gives the same map, for a POSIX shell."""
    words = ["stereopsis", "match", left, right]
    if chosen.preset is not None:
        words += ["--preset", chosen.preset]
    if chosen.disparities is not None:
        words.append("--disparities={}:{}".format(*chosen.disparities))
    changed = _changed(chosen)
    if chosen.preset is None and "cost" not in changed:
        changed.append("cost")  # else the command would start from its default preset
    for name in changed:
        for assignment in _assignments(name, getattr(chosen, name), chosen):
            words += ["--set", assignment]
    return shlex.join([*words, "-o", "disparity.png"])


def _assignments(name: str, value: Any, chosen: Settings) -> list[str]:
    """What ``--set`` takes."""
    if name == "cost" and isinstance(value, Pixelwise):
        return [f"cost={value}"]
    if name == "cost":
        window = "x".join(map(str, value.size)) if value.support is None else str(value.support)
        return [f"cost={type(value).__name__.lower()}", f"window={window}"]
    if name == "optimize" and value is not None:
        facts = chosen.to_dict()["optimize"]
        flat = {part: name for name, part in OPTIMIZER_PARTS.items()}
        return [
            f"optimize={facts['name']}",
            *(f"{flat[part]}={_text(of)}" for part, of in facts.items() if part != "name"),
        ]
    if name == "extra_windows":
        return [f"extra_windows={','.join('x'.join(map(str, window)) for window in value) or 'none'}"]
    if name in ("refine_window", "planar") and value is not None:
        width, height = value if isinstance(value, tuple) else (value, value)
        return [f"{name}={width}x{height}"]
    return [f"{name}={_text(value)}"]


def _text(value: Any) -> str:
    match value:
        case None:
            return "none"
        case bool():
            return "on" if value else "none"
        case tuple():
            return ",".join(map(_text, value))
        case _:
            return str(value)


def python(chosen: Settings, left: str, right: str) -> str:
    """The lines of Python that give the same map."""
    given = [] if chosen.preset is None else [f"preset={chosen.preset!r}"]
    if chosen.disparities is not None:
        given.append(f"disparities={tuple(chosen.disparities)}")
    changed = _changed(chosen)
    if chosen.preset is None and "cost" not in changed:
        changed.append("cost")
    for name in changed:
        value = getattr(chosen, name)
        plain = tuple(value) if isinstance(value, tuple) else value
        given.append(f"{name}={_public(repr(plain))}")
    lines = "".join(f"    {line},\n" for line in given)
    return (
        f"import stereopsis as st\n\npair = st.read_pair({left!r}, {right!r})\n"
        f"result = st.match(\n    pair,\n{lines})\nst.write_disparity('disparity.png', result.disparity)\n"
    )


def _public(text: str) -> str:
    """A repr whose classes are named as a user imports them."""
    return re.sub(r"(?<![\w.'\"])([A-Z]\w*)\(", r"st.\1(", text)


def defaults() -> list[dict[str, Any]]:
    """Every cost with its fields and their defaults."""
    mixed = Combined(Census((9, 7)), 0.6, Gradient(3), 0.4)
    kinds = {**COSTS, **PIXEL_COSTS}
    plain: list[Any] = [mixed if kind is Combined else cast(Any, kind)() for kind in kinds.values()]
    fields = [dict(Settings(cost=cost).to_dict()["cost"]) for cost in plain]
    return [{"name": of.pop("name"), "fields": of} for of in fields]


def solvers() -> list[dict[str, Any]]:
    """Every optimizer with the settings that it has, and their defaults."""
    flat = {part: name for name, part in OPTIMIZER_PARTS.items()}
    made = [dict(Settings(optimize=kind()).to_dict()["optimize"]) for kind in OPTIMIZERS.values()]
    return [
        {"name": of.pop("name"), "fields": {flat[part]: value for part, value in of.items()}} for of in made
    ]
