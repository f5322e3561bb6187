"""What every candidate costs at one pixel."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import numpy.typing as npt

from stereopsis import cost, pipeline, pixelwise, rectify, refine
from stereopsis.settings import Settings
from stereopsis.supports import Gaussian
from stereopsis.types import Disparities, Vertical, worst_cost
from stereopsis.view.sources import Scene


def curve(scene: Scene, chosen: Settings, x: int, y: int) -> dict[str, Any]:
    """The costs at one pixel, from no more of the images than they need.

    Parameters
    ----------
    scene : Scene
    chosen : Settings
        What the result was made with: the range and the vertical field are those that were used.
    x, y : int

    Returns
    -------
    dict
        ``disparities``; ``costs``, None where a candidate is not in view; ``winner`` and ``subpixel``, None
        where no candidate is in view; ``fit``, with ``kind`` and ``points``, or None; ``note``, a sentence
        where what decided the result is more than these costs.
    """
    plain, note = _plain(chosen)
    ranges = cast(Disparities, plain.disparities)
    pair = scene.pair()
    width = pair.left.shape[1]
    pixels = cost.pixels(pair.left, pair.right, plain.channels, plain.threads)
    right = pixels.right
    if isinstance(chosen.vertical, Vertical) and any(chosen.vertical):
        right = rectify.undone(right, chosen.vertical, plain.threads)
    across, down = _reach(plain)
    rows = slice(max(0, y - down), y + down + 1)
    first = max(0, min(x, x - ranges.max + 1) - across)
    columns = slice(first, min(width, max(x, x - ranges.min) + across + 1))
    mine, other = (np.ascontiguousarray(image[rows, columns]) for image in (pixels.left, right))
    found = pipeline.volume(cost.Pixels(mine, other, pixels.step), plain)
    line = found[y - rows.start, x - columns.start]
    candidates = np.arange(ranges.min, ranges.max, plain.disparity_step)
    return {**_described(line, candidates, chosen), "note": note}


def _plain(chosen: Settings) -> tuple[Settings, str | None]:
    """The matching costs alone; and what these settings do beyond them."""
    notes = []
    if chosen.optimize is not None:
        notes.append("before smoothing: neighbours decide too")
    if chosen.slant is not None or chosen.extra_windows:
        notes.append("of the upright window alone: others compete with it")
    if chosen.sharpen is not None:
        notes.append("of the images as they are, not sharpened")
    if chosen.upsample is not None:
        notes.append("of the images as they are, not widened")
    if isinstance(chosen.cost, pixelwise.Pixelwise) and pixelwise.needs_information(chosen.cost):
        notes.append("with grey levels related around this pixel alone")
    bare = Settings(
        disparities=chosen.disparities,
        cost=chosen.cost,
        channels=chosen.channels,
        disparity_step=chosen.disparity_step,
        subpixel=None,
        threads=chosen.threads,
    )
    return bare, f"Costs {'; '.join(notes)}." if notes else None


def _reach(chosen: Settings) -> tuple[int, int]:
    """How far a cost looks around its pixel, across and down: rather too far than not."""
    support = chosen.cost.support
    if isinstance(support, Gaussian):
        return support.radius + 1, support.radius + 1
    across, down = chosen.cost.size
    if support is not None or isinstance(chosen.cost, pixelwise.Pixelwise):
        return across + 1, down + 1
    return across // 2 + 1, down // 2 + 1


def _described(line: npt.NDArray[Any], candidates: npt.NDArray[np.int64], chosen: Settings) -> dict[str, Any]:
    seen = line < worst_cost(line.dtype)
    told = {
        "disparities": candidates.tolist(),
        "costs": [value if there else None for value, there in zip(line.tolist(), seen, strict=True)],
        "winner": None,
        "subpixel": None,
        "fit": None,
    }
    if not seen.any():
        return told
    best = int(np.argmin(line))
    told["winner"] = int(candidates[best])
    told["subpixel"] = float(candidates[best])
    fit = refine.fitted(chosen.subpixel, line, best)
    if fit is not None:
        offset, places, values = fit
        fine = candidates[best] + chosen.disparity_step * places
        told["subpixel"] = float(candidates[best]) + offset * chosen.disparity_step
        told["fit"] = {"kind": chosen.subpixel, "points": np.column_stack([fine, values]).tolist()}
    return told
