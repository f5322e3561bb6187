"""The definition of the calibrated confidence, a pixel at a time."""

import math

import numpy as np


def window(values, y, x, side):
    """What a window sees, edge pixels repeated."""
    reach = side // 2
    rows = np.clip(np.arange(y - reach, y + reach + 1), 0, values.shape[0] - 1)
    columns = np.clip(np.arange(x - reach, x + reach + 1), 0, values.shape[1] - 1)
    return values[np.ix_(rows, columns)]


def probability(surface, answered, sharpness, models):
    height, width = surface.shape
    level = np.rint(16 * surface.astype(np.float64)) / 16
    jump = np.zeros(surface.shape)
    for y, x in np.ndindex(surface.shape):
        for v, u in ((y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1)):
            if 0 <= v < height and 0 <= u < width:
                jump[y, x] = max(jump[y, x], float(abs(surface[v, u] - surface[y, x]) > 1.5))
    found = np.empty(surface.shape)
    for y, x in np.ndindex(surface.shape):
        s = float(sharpness[y, x])
        near, wide = (abs(level[y, x] - window(level, y, x, side).mean()) for side in (5, 15))
        seen = [
            s,
            s / (s + 0.05),
            window(answered, y, x, 21).mean(),
            window(answered, y, x, 41).mean(),
            window(jump, y, x, 5).mean(),
            window(jump, y, x, 15).mean(),
            window(jump, y, x, 31).mean(),
            near / (near + 1),
            wide / (wide + 1),
            abs(level[y, x]) / (abs(level[y, x]) + 16),
            1,
        ]
        score = sum(w * f for w, f in zip(models[0 if answered[y, x] else 1], seen, strict=True))
        found[y, x] = 1 / (1 + math.exp(-min(max(score, -8), 8)))
    return found
