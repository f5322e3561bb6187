"""The definition of the calibrated confidence, a pixel at a time."""

import math

import numpy as np


def window(values, y, x, side):
    """What a window sees, edge pixels repeated."""
    reach = side // 2
    rows = np.clip(np.arange(y - reach, y + reach + 1), 0, values.shape[0] - 1)
    columns = np.clip(np.arange(x - reach, x + reach + 1), 0, values.shape[1] - 1)
    return values[np.ix_(rows, columns)]


def probability(surface, answered, sharpness, winners, texture, models):
    height, width = surface.shape
    level = np.rint(16 * surface.astype(np.float64)) / 16
    jump, drawn = np.zeros(surface.shape), np.full(surface.shape, 3.0)
    for y, x in np.ndindex(surface.shape):
        for v, u in ((y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1)):
            if 0 <= v < height and 0 <= u < width:
                jump[y, x] = max(jump[y, x], float(abs(surface[v, u] - surface[y, x]) > 1.5))
        if answered[y, x] and not math.isnan(winners[y, x]):
            drawn[y, x] = np.rint(16 * min(abs(winners[y, x] - surface[y, x]), 3)) / 16
    found = np.empty(surface.shape)
    for y, x in np.ndindex(surface.shape):
        near, wide = (abs(level[y, x] - window(level, y, x, side).mean()) for side in (5, 15))
        far, spread = window(drawn, y, x, 5).mean(), window(level, y, x, 31).std()
        seen = [
            float(sharpness[y, x]),
            window(sharpness.astype(np.float64), y, x, 15).mean(),
            window(answered, y, x, 21).mean(),
            far / (far + 0.5),
            window(jump, y, x, 31).mean(),
            near / (near + 1),
            wide / (wide + 1),
            spread / (spread + 2),
            float(texture[y, x] / (texture[y, x] + 8)),
            1,
        ]
        score = sum(w * f for w, f in zip(models[0 if answered[y, x] else 1], seen, strict=True))
        found[y, x] = 1 / (1 + math.exp(-min(max(score, -8), 8)))
    return found
