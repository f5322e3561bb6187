"""How much memory matching takes: a model in bytes a pixel, which a test holds against the real peak."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any, cast

import numpy as np

from stereopsis import _fused, optimize, pixelwise, sgm
from stereopsis.cost import KINDS
from stereopsis.settings import Settings
from stereopsis.supports import Gaussian
from stereopsis.types import Disparities, Vertical

UNITS = {
    "": 1,
    "K": 10**3,
    "M": 10**6,
    "G": 10**9,
    "T": 10**12,
    "KI": 2**10,
    "MI": 2**20,
    "GI": 2**30,
    "TI": 2**40,
}
OUT = 9
"""Disparity, confidence and flags."""
SCATTERED = 1.12
"""Of arrays that were given back some memory stays with the process."""
BARE = 150 * 2**20
"""What the program itself takes, where the system does not say."""


def as_bytes(text: int | str) -> int:
    """Bytes from a number of them, or a text such as ``"2GiB"`` or ``"800 MB"``.

    Raises
    ------
    ValueError
        For what is no amount.
    """
    if isinstance(text, int) and not isinstance(text, bool) and text > 0:
        return text
    found = re.fullmatch(r"\s*(\d+(?:\.\d*)?)\s*([KMGT]?I?)B?\s*", str(text).upper())
    if found is None or found[2] not in UNITS or float(found[1]) <= 0:
        raise ValueError(f"memory must be an amount such as 2GiB or 800MB, not {text!r}")
    return int(float(found[1]) * UNITS[found[2]])


def resident() -> int:
    """Bytes of the process that are in memory now."""
    statm = Path("/proc/self/statm")
    if statm.exists():
        import resource

        return int(statm.read_text().split()[1]) * resource.getpagesize()
    if sys.platform == "darwin":
        import resource

        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return BARE


def needed(settings: Settings, dtype: np.dtype[Any], channels: int) -> float:
    """Bytes that matching takes for each pixel of a part, its images and its result included.

    Parameters
    ----------
    settings : Settings
        With a range that is known.
    dtype : dtype
        Of the images.
    channels : int

    Returns
    -------
    float
    """
    kept = channels if settings.channels == "separate" else 1
    wide = 1 if dtype == np.uint8 else 4
    raw = 2 * channels * dtype.itemsize
    pixels = 0 if wide == 1 and kept == channels else 2 * kept * wide
    held = raw + pixels
    if isinstance(settings.vertical, Vertical) and any(settings.vertical):
        held += kept * wide
    if settings.sharpen is not None:
        held += 2 * kept * wide + 1
    after = held + OUT
    return max(
        raw + pixels + SCATTERED * (24 * channels if dtype == np.float32 else 0),
        held + SCATTERED * _matching(settings, kept, wide),
        after + SCATTERED * _after(settings, kept, wide),
    )


def _matching(settings: Settings, channels: int, wide: int) -> float:
    """Beside the images, while the winners are found."""
    span = cast(Disparities, settings.disparities).span
    if isinstance(settings.optimize, sgm.SGM) and _fused.streams_census(settings.cost, settings.optimize):
        return _paths(settings, span)
    if settings.slant is not None or settings.extra_windows:
        return _merged(settings, channels, wide)
    composed = (
        settings.optimize is not None
        or isinstance(settings.cost, pixelwise.Pixelwise)
        or settings.step * settings.disparity_step > 1
        or not isinstance(settings.cost.support, Gaussian | None)
        or (settings.cost.support is not None and (wide > 1 or type(settings.cost).__name__ == "ZSAD"))
    )
    if composed:
        return _volumes(settings, span, channels, wide)
    if settings.upsample is not None:
        factor = settings.upsample[0]
        return max(factor * (2 * channels * wide + OUT) + OUT, 2 * factor * channels * wide + 26 * channels)
    extra = 8 * channels if wide == 1 and type(settings.cost).__name__ == "ZSAD" else 0
    return OUT + extra


def _paths(settings: Settings, span: int) -> float:
    """Of semi-global matching: what is noted of the sums, and bit strings."""
    solver = cast(sgm.SGM, settings.optimize)
    strings = 16 * -(-cast(pixelwise.Census, settings.cost).most // 64)
    notes = 0.18 if solver.paths <= 4 else 0.45 * max(1, solver.paths / 8)
    # Another pass along the ground holds the first one's winners beside its own.
    ground = 8 + OUT + 6 if settings.slant is not None else 0
    return strings + OUT + 5 + ground + notes * span


def _merged(settings: Settings, channels: int, wide: int) -> float:
    return 68 + 2 * channels * wide + (48 if settings.left_right is not None else 0)


def _volumes(settings: Settings, span: int, channels: int, wide: int) -> float:
    """Of the composed stages: their volumes, and what is told of the winners."""
    kind = type(settings.cost).__name__.lower()
    if isinstance(settings.optimize, optimize.SecondPass):
        kind = settings.optimize.data or kind
    fused = settings.optimize is not None and wide == 1 and kind in ("zssd", "ncc", "zncc")
    told = 62.0 if settings.optimize is not None else 92.0
    if isinstance(settings.cost, pixelwise.Pixelwise) and kind not in KINDS:
        entry = 4.0 if isinstance(settings.cost, pixelwise.Combined) else 2.0
    elif settings.cost.support is not None or kind == "zsad" or fused:
        entry = 4.0
    else:
        # Terms and their sums, and the costs of these.
        entry = 24.0 if kind in ("sad", "ssd") else 20.0
    # Sums along paths, of costs in units; a second pass works in place where it can.
    if isinstance(settings.optimize, sgm.SGM) or (settings.optimize is not None and entry != 4.0):
        entry += 4.0
    return entry * span + told + (8 * channels if wide == 1 else 0)


def _after(settings: Settings, channels: int, wide: int) -> float:
    """Beside the images and the result, at the most demanding of the stages after matching."""
    narrow = 4 * channels if wide == 1 else 0
    filled = 5.0
    stages = [1.0 if settings.blank else 0.0]
    if settings.texture == "auto":
        stages.append(5)
    match settings.subpixel:
        case "symmetric":
            stages.append(48.0 * channels)
        case "correlation" | "lucas-kanade":
            stages.append(2 * narrow + 8)
        case "lucas-kanade-affine":
            stages.append(2 * narrow + 38)
    # Texture, a median and speckle change the map in place.
    filling = {"surfaces": 36.0, "interpolate": 8.0}.get(settings.fill or "", filled)
    if settings.fill is not None or settings.planar is not None:
        stages.append(filling)
    if settings.planar is not None:
        stages.append(filled + 12)
    if settings.weighted_median is not None:
        stages.append(12)
    if settings.edge_aware is not None:
        stages.append(30 + narrow)
    if settings.confidence is not None:
        stages.append(33)
    if settings.least_confidence is not None and settings.fill is not None:
        stages.append(filled + filling + (12 if settings.planar is not None else 4))
    if settings.outlines:
        stages.append(26 + narrow)
    if settings.photometric:
        stages.append(10 + narrow)
    return max(stages)
