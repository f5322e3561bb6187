"""``run.toml``: what a run is, and whether a second one is the same."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from typing import Any, Final

from stereopsis import _fused
from stereopsis.batch.work import version
from stereopsis.settings import Settings

NAME: Final = "run.toml"


@dataclass(frozen=True)
class Identity:
    """Everything that decides a run's results.

    Attributes
    ----------
    settings : Settings
        Without threads and arrays to keep, which decide none.
    format : str
        The maps' suffix.
    evaluate : bool
        Whether pairs are scored.
    dataset, folder : str
        What the data set is called and where it lies; empty where it does not say.
    version : str
        Of this package.
    memory : int or None
        Bytes that a worker may take, which decides the tiles.
    """

    settings: Settings
    format: str
    evaluate: bool
    dataset: str
    folder: str
    version: str
    memory: int | None = None

    @classmethod
    def of(
        cls, samples: Any, settings: Settings, format: str, evaluate: bool, memory: int | None = None
    ) -> Identity:
        """The identity of a run over `samples`."""
        folder = getattr(samples, "folder", None)
        return cls(
            settings.changed(threads=0, keep=()),
            format,
            evaluate,
            str(getattr(samples, "name", "")),
            "" if folder is None else os.path.abspath(folder),  # noqa: PTH100, links stay as they are
            version(),
            memory,
        )

    @property
    def run(self) -> str:
        """A short text that no other run has; its rows carry it."""
        told = json.dumps(self._told(), sort_keys=True)
        return hashlib.sha256(told.encode("utf-8", "surrogateescape")).hexdigest()[:16]

    def _told(self) -> dict[str, Any]:
        return {
            "version": self.version,
            "dataset": self.dataset,
            "folder": self.folder,
            "format": self.format,
            "evaluate": self.evaluate,
            "memory": self.memory or 0,
            "settings": tomllib.loads(self.settings.to_toml()),
        }

    def to_toml(self) -> str:
        """The text of ``run.toml``: this, and what machine and programs began the run."""
        own = {
            name: value
            for name, value in {**self._told(), "run": self.run}.items()
            if name not in ("settings", "dataset", "folder")
        }
        tables = {"run": own, "data": {"name": self.dataset, "folder": self.folder}, "machine": _machine()}
        lines = []
        for table, values in tables.items():
            lines.append(f"[{table}]")
            lines += [f"{name} = {_toml(value)}" for name, value in values.items()]
            lines.append("")
        return "\n".join([*lines, "[settings]", self.settings.to_toml()])

    def differences(self, text: str) -> list[str]:
        """What is not the same in the run that wrote this text.

        Raises
        ------
        ValueError
            It is no ``run.toml``.
        """
        try:
            there = tomllib.loads(text)
            if there["run"]["run"] == self.run:
                return []
            was = {**there["run"], **{f"data {name}": value for name, value in there["data"].items()}}
            was |= {f"setting {name}": value for name, value in there["settings"].items()}
        except (tomllib.TOMLDecodeError, KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"it is no record of a run: {' '.join(str(error).split())}") from None
        told = self._told()
        now = {name: told[name] for name in ("version", "format", "evaluate", "memory")}
        now |= {"data name": self.dataset, "data folder": self.folder}
        now |= {f"setting {name}": value for name, value in told["settings"].items()}
        different = [
            f"{name.removeprefix('setting ')} {_shown(was.get(name))}, not {_shown(value)}"
            for name, value in now.items()
            if was.get(name) != value
        ]
        gone = (
            name.removeprefix("setting ") for name in was if name.startswith("setting ") and name not in now
        )
        return [*different, *(f"{name}, which is no longer set" for name in gone)] or ["another run"]


def _machine() -> Mapping[str, Any]:
    return {
        "system": platform.platform(),
        "processor": platform.processor() or platform.machine(),
        "instruction_set": _fused.instruction_set(),
        "cores": os.cpu_count() or 1,
        "python": platform.python_version(),
        **{name: _installed(name) for name in ("numpy", "pillow", "imagecodecs", "tifffile", "dask")},
    }


def _installed(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ""


def _toml(value: Any) -> str:
    # JSON's escapes are TOML's, but for DEL, and for lone surrogates, which neither has.
    text = json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return text.encode("utf-8", "backslashreplace").decode().replace("\\udc", "\\\\udc")


def _shown(value: Any) -> str:
    text = "none" if value is None else str(value).lower() if isinstance(value, bool) else str(value)
    return text or "none"
