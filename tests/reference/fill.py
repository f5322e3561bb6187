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


def nearer(disparity, doubtful, again):
    found = disparity.astype(np.float32)
    for y, x in np.argwhere(doubtful):
        stand = [u for u in range(found.shape[1]) if not doubtful[y, u] and not np.isnan(disparity[y, u])]
        ends = [disparity[y, u] for u in ([u for u in stand if u < x][-1:] + [u for u in stand if u > x][:1])]
        if not ends or np.isnan(again[y, x]) or np.isnan(disparity[y, x]):
            continue
        found[y, x] = max(disparity[y, x], min(max(again[y, x], min(ends)), max(ends)))
    return found


def outlines(disparity, doubtful, image):
    image = np.atleast_3d(image).astype(int)
    d = disparity.astype(np.float32)
    height, width = d.shape
    moved = d.copy()

    def around(y, x, reach):
        return d[max(0, y - reach) : y + reach + 1, max(0, x - reach) : x + reach + 1]

    def span(values):
        known = values[~np.isnan(values)]
        return known.max() - known.min() if known.size else np.float32(0)

    jumps = {(y, x) for y in range(height) for x in range(width) if span(around(y, x, 1)) > 4}
    for y, x in np.argwhere(doubtful):
        if not any((y + dy, x + dx) in jumps for dy in range(-2, 3) for dx in range(-2, 3)):
            continue
        farther, nearer = np.nanmin(around(y, x, 3)), np.nanmax(around(y, x, 3))
        votes = {farther: 0, nearer: 0}
        for v in range(y - 12, y + 13, 4):
            for u in range(x - 12, x + 13, 4):
                if 0 <= v < height and 0 <= u < width and not doubtful[v, u]:
                    alike = round(4096 * math.exp(-abs(image[v, u] - image[y, x]).max() / 12))
                    for surface in votes:
                        if 3 * abs(d[v, u] - surface) < nearer - farther:
                            votes[surface] += alike
        if votes[nearer] > votes[farther]:
            moved[y, x] = nearer
    return moved


def unfatten(disparity, doubtful, views, image):
    image = np.atleast_3d(image).astype(int)
    d = disparity.astype(np.float32)
    height, width = d.shape

    def gradient(grey):
        padded = np.pad(grey.astype(int), 1, mode="edge")
        return np.stack([padded[1:-1, 2:] - padded[1:-1, :-2], padded[2:, 1:-1] - padded[:-2, 1:-1]], -1)

    left, right = map(gradient, views)

    def apart(y, x, value):
        """Thirty-seconds of grey levels a pixel."""
        place = min(max(16 * x - int(np.rint(16 * value)), 0), 16 * (width - 1))
        one, part = divmod(place, 16)
        meets = (16 - part) * right[y, one] + part * right[y, min(one + 1, width - 1)]
        return min(abs(16 * left[y, x] - meets).sum(), 320)

    def weight(y, x, v, u):
        return round(4096 * math.exp(-abs(image[v, u] - image[y, x]).max() / 12))

    before, d = d, d.copy()

    def around(y, x, reach, values=before):
        found = values[max(0, y - reach) : y + reach + 1, max(0, x - reach) : x + reach + 1]
        return found[~np.isnan(found)]

    jumps = np.zeros(d.shape, bool)
    for y, x in np.ndindex(d.shape):
        jumps[y, x] = around(y, x, 1).size and np.ptp(around(y, x, 1)) > 2
    sides = {
        (y, x): (around(y, x, 3).min(), around(y, x, 3).max())
        for y, x in np.ndindex(d.shape)
        if jumps[max(0, y - 2) : y + 3, max(0, x - 2) : x + 3].any()
    }
    worse = {(y, x): apart(y, x, far) - apart(y, x, near) for (y, x), (far, near) in sides.items()}
    for (y, x), (far, near) in sides.items():
        if not before[y, x] - far > near - before[y, x]:
            continue
        stays = 480 * 4096
        for v in range(y - 2, y + 3):
            for u in range(x - 2, x + 3):
                if (v, u) in worse:
                    stays += weight(y, x, v, u) * worse[v, u]
        for v in range(y - 4, y + 5, 4):
            for u in range(x - 12, x + 13, 4):
                if not (0 <= v < height and 0 <= u < width) or (v, u) in sides or doubtful[v, u]:
                    continue
                for surface, vote in ((near, 480), (far, -480)):
                    if 3 * abs(before[v, u] - surface) < near - far:
                        stays += vote * weight(y, x, v, u)
        if stays < 0:
            d[y, x] = far
    return d
