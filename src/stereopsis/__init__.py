"""Disparity maps that can be trusted, from rectified stereo pairs."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from stereopsis import colormaps, io
from stereopsis.evaluate import Scores, error_map, evaluate
from stereopsis.io import (
    depth,
    points,
    read_calibration,
    read_disparity,
    read_image,
    read_pair,
    write_depth,
    write_disparity,
    write_image,
    write_ply,
    write_preview,
)
from stereopsis.locking import PixelLocking, pixel_locking
from stereopsis.optimize import (
    ICM,
    TRWS,
    BeliefPropagation,
    Expansion,
    SecondPass,
    Smoothness,
    Swap,
    energy,
)
from stereopsis.pipeline import estimate_disparities, estimate_vertical, match
from stereopsis.pixelwise import BirchfieldTomasi, Census, Combined, Gradient, MutualInformation, Rank
from stereopsis.reliability import Reliability, reliability
from stereopsis.settings import NCC, PRESETS, SAD, SSD, ZNCC, ZSAD, ZSSD, Settings
from stereopsis.sgm import SGM
from stereopsis.sparsification import Sparsification, sparsification
from stereopsis.supports import Adaptive, Bilateral, Cross, Gaussian
from stereopsis.types import Calibration, Disparities, Flag, Pair, Result, Vertical

if TYPE_CHECKING:
    from stereopsis import batch, datasets, plot, scenes, tiling

__version__ = "0.1.0"

__all__ = [
    "ICM",
    "NCC",
    "PRESETS",
    "SAD",
    "SGM",
    "SSD",
    "TRWS",
    "ZNCC",
    "ZSAD",
    "ZSSD",
    "Adaptive",
    "BeliefPropagation",
    "Bilateral",
    "BirchfieldTomasi",
    "Calibration",
    "Census",
    "Combined",
    "Cross",
    "Disparities",
    "Expansion",
    "Flag",
    "Gaussian",
    "Gradient",
    "MutualInformation",
    "Pair",
    "PixelLocking",
    "Rank",
    "Reliability",
    "Result",
    "Scores",
    "SecondPass",
    "Settings",
    "Smoothness",
    "Sparsification",
    "Swap",
    "Vertical",
    "batch",
    "colormaps",
    "datasets",
    "depth",
    "energy",
    "error_map",
    "estimate_disparities",
    "estimate_vertical",
    "evaluate",
    "io",
    "match",
    "pixel_locking",
    "plot",
    "points",
    "read_calibration",
    "read_disparity",
    "read_image",
    "read_pair",
    "reliability",
    "scenes",
    "sparsification",
    "tiling",
    "write_depth",
    "write_disparity",
    "write_image",
    "write_ply",
    "write_preview",
]


def __getattr__(name: str) -> Any:
    """Load what matching does not need when it is asked for: `import stereopsis` takes half the time."""
    if name in ("batch", "datasets", "plot", "scenes", "tiling"):
        return importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
