"""The definition of the fillings, a pixel at a time."""

import math

import numpy as np

from reference.smooth import edge_weights, slopes, smooth


def background(disparity):
    height, width = disparity.shape
    filled = disparity.copy()
    for y in range(height):
        row = [float(value) for value in disparity[y]]
        for x in range(width):
            left = next((row[i] for i in range(x, -1, -1) if math.isfinite(row[i])), math.inf)
            right = next((row[i] for i in range(x, width) if math.isfinite(row[i])), math.inf)
            nearer_the_horizon = min(left, right)
            filled[y, x] = nearer_the_horizon if math.isfinite(nearer_the_horizon) else np.nan
    rows = [y for y in range(height) if any(math.isfinite(value) for value in disparity[y])]
    for y in range(height):
        if rows and y < rows[0]:
            filled[y] = filled[rows[0]]
        if rows and y > rows[-1]:
            filled[y] = filled[rows[-1]]
    return filled


def interpolate(disparity, occluded):
    height, width = disparity.shape
    filled = disparity.copy()
    for y, x in np.argwhere(np.isnan(disparity)):
        found = []
        for down in (-1, 0, 1):
            for right in (-1, 0, 1):
                v, u = y + down, x + right
                while (down or right) and 0 <= v < height and 0 <= u < width:
                    if not np.isnan(disparity[v, u]):
                        found.append(disparity[v, u])
                        break
                    v, u = v + down, u + right
        if found:
            second = sorted(found)[min(1, len(found) - 1)]
            filled[y, x] = second if occluded[y, x] else np.median(np.array(found, np.float64))
    return filled


def surfaces(disparity, occluded, image, sigma=5.0, slope_sigma=20.0, strength=500.0):
    height, width = disparity.shape
    d = disparity.astype(np.float64)
    if np.isnan(d).all():
        return d
    answers = np.sort(d[~np.isnan(d)])
    rises = slopes(d, image, slope_sigma)
    base, spread = d.copy(), np.zeros(d.shape)
    for y, x in np.argwhere(np.isnan(d)):
        ends = []
        for down, right in ((0, -1), (0, 1), (-1, 0), (1, 0)):
            v, u, rise = y, x, 0.0
            while np.isnan(d[v, u]):
                if not (0 <= v + down < height and 0 <= u + right < width):
                    rise = np.nan
                    break
                before = (min(v, v + down), min(u, u + right))
                rise += rises[0 if right else 1][before] * -(down + right)
                v, u = v + down, u + right
            ends.append(d[v, u] + rise)
        known = [end for end in ends if not math.isnan(end)]
        beside = [end for end in ends[:2] if not math.isnan(end)] or known
        base[y, x] = min(beside) if beside else np.nan
        spread[y, x] = max(known) - min(known) if known else np.inf
    holes, nothing = np.isnan(d), np.isnan(base)
    value = np.where(nothing, answers[answers.size // 2], base)
    whole = smooth(value, np.where(holes, 1e-6, 1), edge_weights(image, sigma), rises, strength, 2)[0]
    one = nothing | (spread <= np.where(occluded, 8, 12))
    return np.where(holes, np.clip(np.where(one, whole, base), answers[0], answers[-1]), d)
