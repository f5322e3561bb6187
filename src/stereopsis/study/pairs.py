"""The pairs that a study measures on: files with truth, and rendered streets."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from stereopsis import datasets, scenes
from stereopsis._files import opened
from stereopsis.datasets import Sample
from stereopsis.types import DisparityMap, Pair

Mask = npt.NDArray[np.bool_]

WEATHER: tuple[tuple[str, dict[str, float]], ...] = (
    ("clear", {}),
    ("low light", {"low_light": 0.8}),
    ("noise", {"noise": 10.0}),
    ("fog", {"fog": 0.03}),
    ("rain", {"rain": 0.7}),
    ("exposure", {"exposure": 1.4, "offset": -10.0}),
)
"""Conditions, and what `scenes.street` is given for each."""


@dataclass(frozen=True)
class Known:
    """A pair with everything that is known of it.

    Attributes
    ----------
    pair : Pair
        What a matcher sees.
    truth : ndarray of float32, (H, W)
        True disparity of the left view in pixels, NaN where unknown.
    visible : ndarray of bool, (H, W), or None
        Pixels that both views see, where known.
    sky, textured : ndarray of bool, (H, W), or None
        Sky, and surfaces with texture of their own, where known.
    """

    pair: Pair
    truth: DisparityMap
    visible: Mask | None = None
    sky: Mask | None = None
    textured: Mask | None = None


@dataclass(frozen=True)
class FilePair:
    """A pair on disk."""

    sample: Sample
    group: str = "data"
    condition: str = ""

    @property
    def name(self) -> str:
        """What tables call the pair."""
        return self.sample.name

    def digest(self) -> str:
        """Hash of everything that is read: images, truth, calibration, mask.

        Raises
        ------
        OSError, ValueError
            A file is missing or cannot be read.
        """
        digest = hashlib.sha256()
        for file in (
            self.sample.left_file,
            self.sample.right_file,
            self.sample.truth_file,
            self.sample.calibration_file,
        ):
            digest.update(_digest(file) if file else b"none")
        mask = self.sample.mask()
        if mask is not None:
            digest.update(np.packbits(mask).tobytes())
        return digest.hexdigest()

    def load(self) -> Known:
        """Read the pair and its truth.

        Raises
        ------
        OSError, ValueError
            A file is missing, is damaged, or fits the others not.
        """
        pair, truth = self.sample.pair(), self.sample.truth()
        if truth is None:
            raise ValueError(f"{self.name} has no true disparity to measure against")
        if truth.shape != pair.left.shape[:2]:
            raise ValueError(f"{self.name}: the truth is {truth.shape}, the images {pair.left.shape[:2]}")
        return Known(pair, truth, self.sample.mask())


@dataclass(frozen=True)
class ScenePair:
    """A rendered street; `options` are those of `scenes.street`."""

    seed: int
    size: tuple[int, int]
    group: str = "synthetic"
    condition: str = "clear"
    options: tuple[tuple[str, float], ...] = ()

    @property
    def name(self) -> str:
        """What tables call the pair."""
        return f"street-{self.seed}" + (f"-{self.condition.replace(' ', '-')}" if self.options else "")

    def digest(self) -> str:
        """Hash of what decides the picture; the renderer itself is part of the program's version."""
        return hashlib.sha256(json.dumps([self.seed, self.size, self.options]).encode()).hexdigest()

    def load(self) -> Known:
        """Render the scene."""
        scene = scenes.street(*self.size, self.seed, **dict(self.options))  # type: ignore[arg-type]
        return Known(scene.pair, scene.disparity, ~scene.occluded & ~scene.sky, scene.sky, scene.textured)


Source: TypeAlias = FilePair | ScenePair


def data(folder: Path | None, seeds: int, size: tuple[int, int]) -> tuple[str, tuple[Source, ...]]:
    """The pairs of a folder and the data set's name; streets where there is no folder.

    Parameters
    ----------
    folder : Path or None
        Flat, ``NAME-left.*``, ``NAME-right.*``, ``NAME-disparity.*``, or any layout that
        `stereopsis.datasets` knows.
    seeds : int
        How many streets, without a folder.
    size : (int, int)
        Width and height of a street in pixels.

    Raises
    ------
    ValueError
        The folder holds no pair.
    """
    if folder is None:
        return "Synthetic streets", tuple(ScenePair(seed, size, "data") for seed in range(seeds))
    flat = _flat(folder)
    if flat:
        return folder.resolve().name, flat
    opened = datasets.open(folder)
    return opened.name, tuple(FilePair(sample) for sample in opened)


def weather(seeds: int, size: tuple[int, int]) -> tuple[Source, ...]:
    """Every street under every condition."""
    return tuple(
        ScenePair(seed, size, "synthetic", condition, tuple(options.items()))
        for condition, options in WEATHER
        for seed in range(seeds)
    )


def _flat(folder: Path) -> tuple[Source, ...]:
    """Pairs side by side in one folder. One whose files are not all there is reported when it is read."""

    def file(name: str, view: str, otherwise: str) -> Path:
        found = sorted(folder.glob(f"{_literal(name)}-{view}.*"))
        return found[0] if found else folder / f"{name}-{view}{otherwise}"

    lefts = {left.name.rpartition("-left.")[0]: left for left in sorted(folder.glob("*-left.*"))}
    return tuple(
        FilePair(
            Sample(name, left, file(name, "right", left.suffix), truth_file=file(name, "disparity", ".png"))
        )
        for name, left in sorted(lefts.items())
    )


def _digest(file: Path) -> bytes:
    with opened(file) as (stream, _):
        return hashlib.file_digest(stream, "sha256").digest()


def _literal(name: str) -> str:
    """A name in which a glob pattern finds nothing special."""
    return "".join(f"[{letter}]" if letter in "*?[" else letter for letter in name)
