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


def planar(disparity, window, tolerance, iterations):
    """In the kernel's order and float32: where a pixel is all but on the limit, either is right."""
    one = np.float32
    height, width = disparity.shape
    samples = []
    for size, most in zip(window, (9, 7), strict=True):
        reach = (size - 1) // 2
        step = max(1, math.ceil(2 * reach / (most - 1)))
        samples.append(range(-(reach // step) * step, reach + 1, step))
    at, a, b = disparity.copy(), np.zeros_like(disparity), np.zeros_like(disparity)
    for _ in range(iterations):
        sums = np.zeros((9, height, width), one)
        for v in samples[1]:
            row = np.zeros((5, height, width), one)
            for u in samples[0]:
                moved = np.full_like(disparity, np.nan)
                ys, xs = (slice(max(0, -k), max(0, n - max(0, k))) for k, n in ((v, height), (u, width)))
                yt, xt = (slice(max(0, k), max(0, n + min(0, k))) for k, n in ((v, height), (u, width)))
                moved[ys, xs] = disparity[yt, xt]
                z = moved - at
                off = z - (a * one(u) + b * one(v))
                on = off * off < one(tolerance) * one(tolerance)
                z = np.where(on, z, one(0))
                for total, term in zip(row, (on, on * one(u), on * one(u * u), z, z * one(u)), strict=True):
                    total += term
            count, x, xx, z, zx = row
            y, yy = one(v), one(v * v)
            for total, term in zip(
                sums, (count, x, count * y, xx, x * y, count * yy, z, zx, z * y), strict=True
            ):
                total += term
        n = np.maximum(sums[0], one(1))
        x, y, xx, xy, yy, z, zx, zy = sums[1:] / n
        xx, yy, xy = xx - x * x + one(0.25), yy - y * y + one(0.25), xy - x * y
        zx, zy = zx - x * z, zy - y * z
        det = xx * yy - xy * xy
        enough = (sums[0] >= 6) & (det > 0)
        scale = np.where(enough, one(1) / np.where(enough, det, one(1)), one(0))
        slope, slant = (zx * yy - zy * xy) * scale, (zy * xx - zx * xy) * scale
        at = at + np.where(enough, z - (slope * x + slant * y), one(0))
        a, b = np.where(enough, slope, a), np.where(enough, slant, b)
    return at


def photometric(disparity, doubtful, views, least, most):
    left, right = (view.astype(int) for view in views)
    width = disparity.shape[1]
    moved = disparity.copy()
    seen = {}
    for y, x in np.argwhere(~np.isnan(disparity) & (doubtful == 0)):
        one, part = divmod(128 * x - int(np.rint(128 * disparity[y, x])), 128)
        if 0 < x < width - 1 and 0 <= one < width - 1:
            meets = (128 - part) * right[y, one] + part * right[y, one + 1]
            seen[y, x] = 128 * left[y, x] - meets, left[y, x + 1] - left[y, x - 1], left[y, x]

    def around(y, x, those):
        window = ((v, u) for v in range(y - 4, y + 5) for u in range(x - 7, x + 8))
        return np.array([seen[q] for q in window if q in those], float).reshape(-1, 3).T

    def moment(a, b):
        return (a * b).sum() * a.size - a.sum() * b.sum()

    counted = set()
    for q in seen:
        brighter, _, _ = around(*q, seen)
        if abs(seen[q][0] * brighter.size - brighter.sum()) < 20 * 128 * brighter.size:
            counted.add(q)
    for y, x in np.argwhere(~np.isnan(disparity) & (doubtful == 0)):
        e, g, level = around(y, x, counted)
        if e.size >= 45:
            slopes, levels = moment(g, g) + 4 * 675 * e.size, moment(level, level) + 675 * e.size
            gain = min(max(moment(e, level) / levels, -128), 64)
            both = gain * moment(g, level) - moment(e, g)
            by = 2 * both / ((128 - gain) * (slopes - moment(g, level) ** 2 / levels))
            by = np.float32(min(max(by, -0.5), 0.5))
            moved[y, x] = min(max(disparity[y, x] + by, np.float32(least)), np.float32(most))
    return moved
