"""The definition of the sub-pixel methods that work from the images, a pixel at a time, in float64."""

import math

import numpy as np


def window(image, x, y, size, shift=0):
    """Pixels of the window at (x + shift, y), edge pixels repeated: (height, width, C), float64."""
    (width, height), (rows, columns) = size, image.shape[:2]
    across = np.arange(-(width // 2), width - width // 2) + x + shift
    down = np.arange(-(height // 2), height - height // 2) + y
    return image[np.clip(down, 0, rows - 1)[:, None], np.clip(across, 0, columns - 1)].astype(np.float64)


def centre(pixels, centred=True):
    return pixels - pixels.mean(axis=(0, 1)) if centred else pixels


def correlate(a, b, centred=True):
    a, b = centre(a, centred), centre(b, centred)
    norm = math.sqrt((a * a).sum() * (b * b).sum())
    return (a * b).sum() / norm if norm > 0 else 0.0


def cubic(image, x, y, size, shift):
    """The window at a fraction of a pixel, from Keys' kernel with a = -1/2 itself."""
    base = math.floor(shift)
    total = 0.0
    for tap in range(-1, 3):
        s = abs(tap - (shift - base))
        weight = 1.5 * s**3 - 2.5 * s**2 + 1 if s <= 1 else -0.5 * s**3 + 2.5 * s**2 - 4 * s + 2
        total = total + weight * window(image, x, y, size, base + tap)
    return total


def correlation_by_search(left, right, x, y, d, size, centred=True, samples=4000):
    """The best of many linear interpolations within a pixel of d."""
    target = window(left, x, y, size)
    best = (correlate(target, window(right, x, y, size, -d), centred), 0.0)
    for to in (-1, 1):
        ends = [window(right, x, y, size, -d), window(right, x, y, size, -d + to)]
        for t in np.linspace(0, 1, samples + 1)[1:]:
            best = max(best, (correlate(target, (1 - t) * ends[0] + t * ends[1], centred), to * t))
    return d - best[1], best[0]


def lucas_kanade(left, right, x, y, start, size, iterations=20, tolerance=1e-3):
    """Gauss-Newton, with the windows themselves."""
    target = centre(window(left, x, y, size))
    slope = centre((window(left, x, y, size, 1) - window(left, x, y, size, -1)) / 2)
    winner = math.floor(start + 0.5)
    shift, first = winner - start, None
    for _ in range(iterations):
        here = centre(cubic(right, x, y, size, shift - winner))
        found = correlate(target, here)
        first = found if first is None else first
        columns = np.stack([here.ravel(), slope.ravel()], axis=1)
        normal = columns.T @ columns
        if (target * here).sum() <= 0 or np.linalg.det(normal) <= 1e-9 * normal[0, 0] * normal[1, 1]:
            return start
        following = min(max(shift + np.linalg.solve(normal, columns.T @ target.ravel())[1], -1.0), 1.0)
        if abs(following - shift) < tolerance:
            return winner - shift if found >= first else start
        shift = following
    return start


def warped(right, x, y, size, plane):
    """The right window under d + a u + b v, a pixel at a time."""
    width, height = size
    out = np.empty((height, width, right.shape[2]))
    for i in range(height):
        for j in range(width):
            u, v = j - width // 2, i - height // 2
            at = x + u - (plane[0] + plane[1] * u + plane[2] * v)
            out[i, j] = cubic(right, math.floor(at), y + v, (1, 1), at - math.floor(at))[0, 0]
    return out


def lucas_kanade_affine(left, right, x, y, start, size, iterations=8, tolerance=0.01):
    width, height = size
    target = window(left, x, y, size)
    slope = (window(left, x, y, size, 1) - window(left, x, y, size, -1)) / 2
    v, u = np.mgrid[:height, :width].astype(np.float64)
    u, v = (u - width // 2)[..., None], (v - height // 2)[..., None]
    basis = [centre(slope), centre(slope * u), centre(slope * v)]
    plane = np.array([start, 0.0, 0.0])
    limits = np.array([[start - 1, start + 1], [-0.33, 0.33], [-1, 1]])
    best, answer = -math.inf, plane
    for k in range(iterations):
        here = warped(right, x, y, size, plane)
        found = correlate(target, here)
        if k > 0 and not found > best:
            break
        best, answer = found, plane
        columns = np.stack([column.ravel() for column in (centre(here), *basis)], axis=1)
        if (centre(target) * centre(here)).sum() <= 0 or np.linalg.cond(columns) > 1e4:
            break
        step = -np.linalg.lstsq(columns, centre(target).ravel(), rcond=None)[0][1:]
        following = np.clip(plane + step, *limits.T)
        moved = np.abs(following - plane) @ [1, width / 2, height / 2]
        if moved < tolerance:
            break
        plane = following
    return answer


def symmetric(left, right, x, y, d, size, steps=4):
    """Intervals of both lines, one sample at a time; the images are taken as they are."""

    def value(image, row, fine):
        last = image.shape[1] - 1
        at = min(max(fine / steps, 0), last)
        base = min(math.floor(at), max(last - 1, 0))
        ahead = min(base + 1, last)
        return (1 - (at - base)) * image[row, base].astype(np.float64) + (at - base) * image[row, ahead]

    def interval(image, row, fine):
        fine = min(max(fine, 0), steps * (image.shape[1] - 1))
        around = [value(image, row, fine + half) for half in (-0.5, 0, 0.5)]
        return np.min(around, axis=0), np.max(around, axis=0)

    width, height = size

    def cost(candidate):
        total = 0.0
        for v in range(-(height // 2), height - height // 2):
            row = min(max(y + v, 0), left.shape[0] - 1)
            for u in range(-(width // 2), width - width // 2):
                for s in range(-(steps // 2), steps // 2 + 1):
                    fine = steps * (x + u) + s
                    low, high = interval(left, row, fine)
                    other_low, other_high = interval(right, row, fine - candidate)
                    total += np.maximum(0, np.maximum(low - other_high, other_low - high)).sum()
        return total

    candidates = [
        k
        for k in range(steps * (d - 1), steps * (d + 1) + 1)
        if 0 <= steps * x - k <= steps * (left.shape[1] - 1)
    ]
    costs = [cost(k) for k in candidates]
    best = int(np.argmin(costs))
    last = best
    while last + 1 < len(costs) and costs[last + 1] == costs[best]:
        last += 1
    offset = (last - best) / 2
    if last == best and 0 < best < len(costs) - 1:
        before, after = costs[best - 1] - costs[best], costs[best + 1] - costs[best]
        offset = 0.5 * (before - after) / (before + after)
    return (candidates[best] + offset) / steps
