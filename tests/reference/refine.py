"""The definition of the sub-pixel fits, the confidence and the median, a pixel at a time."""

import math

import numpy as np


def subpixel(kind, cost, before, after):
    """Offset from the three costs; infinite where there is none."""
    if kind is None or not all(map(math.isfinite, (cost, before, after))):
        return 0.0
    a, b = before - cost, after - cost
    reach = a + b if kind == "parabola" else max(a, b)
    return 0.5 * (a - b) / reach if reach > 0 else 0.0


def confidence(perfect, cost, before, after):
    if not math.isfinite(cost):
        return 0.0
    around = [neighbour for neighbour in (before, after) if math.isfinite(neighbour)] or [cost]
    mean = sum(around) / len(around)
    return min(max((mean - cost) / (mean - perfect), 0.0), 1.0) if mean > perfect else 0.0


def median(disparity, size):
    reach = size // 2
    filtered = disparity.copy()
    for y, x in np.argwhere(~np.isnan(disparity)):
        filtered[y, x] = np.nanmedian(
            disparity[max(0, y - reach) : y + reach + 1, max(0, x - reach) : x + reach + 1].astype(np.float64)
        )
    return filtered
