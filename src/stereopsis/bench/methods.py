"""What a table compares: settings of this library, and OpenCV's matchers, behind one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stereopsis import pipeline
from stereopsis.bench import opencv
from stereopsis.settings import PRESETS, Settings
from stereopsis.types import Disparities, DisparityMap, Flag, Pair

PLAIN = "none"
"""The name of settings that start from no preset."""


@dataclass(frozen=True)
class Method:
    """One row of a table.

    Attributes
    ----------
    name : str
    match : callable
        From a pair, its range and a number of threads to a disparity map, and to what of it the method stands
        for: without what it has filled.
    settings : Settings or None
        This library's; None: another one's.
    """

    name: str
    match: Callable[[Pair, Disparities, int], tuple[DisparityMap, DisparityMap]]
    settings: Settings | None = None


def presets(names: Sequence[str] = (), assignments: Sequence[str] = ()) -> list[Method]:
    """Presets as methods, each with the same changes.

    Parameters
    ----------
    names : sequence of str
        In `PRESETS`, or `PLAIN`; none: all of them but those that repeat a paper.
    assignments : sequence of str
        ``NAME=VALUE``, as for `Settings.make`.

    Raises
    ------
    ValueError
        For an unknown preset or setting, or a value that is not allowed.
    """
    chosen = tuple(names) or tuple(name for name in PRESETS if not name.startswith("paper-"))
    made = []
    for name in dict.fromkeys(chosen):
        settings = Settings.make(preset=None if name == PLAIN else name, assignments=assignments)
        changed = [] if name == PLAIN else [name]
        made.append(_ours(", ".join([*changed, *assignments]) or "plain settings", settings))
    return made


def _ours(name: str, settings: Settings) -> Method:
    def match(pair: Pair, disparities: Disparities, threads: int) -> tuple[DisparityMap, DisparityMap]:
        result = pipeline.match(pair, settings=replace(settings, disparities=disparities, threads=threads))
        filled = result.flags & np.uint8(Flag.FILLED) != 0
        return result.disparity, np.where(filled, np.float32(np.nan), result.disparity)

    return Method(name, match, settings)


def peers() -> list[Method]:
    """OpenCV's matchers; raises ModuleNotFoundError where it is not installed."""
    opencv.require()

    def method(peer: opencv.Peer) -> Method:
        def match(pair: Pair, disparities: Disparities, threads: int) -> tuple[DisparityMap, DisparityMap]:
            with opencv.threads(threads):
                disparity = opencv.match(pair, peer, disparities)
            return disparity, disparity

        return Method(peer.name, match)

    return [method(peer) for peer in opencv.PEERS]
