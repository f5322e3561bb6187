"""Floods, regions, noise and brightness by their definitions, in float64 and plain loops."""

import numpy as np


def _around(shape, y, x):
    steps = ((-1, 0), (1, 0), (0, -1), (0, 1))
    return [(y + v, x + u) for v, u in steps if 0 <= y + v < shape[0] and 0 <= x + u < shape[1]]


def relief(planes, calm, unit):
    """Two blurs of 3 x 3, the largest central difference, in units above what is calm."""
    steepest = np.zeros(planes.shape[1:])
    for plane in planes:
        blurred = plane.astype(np.float64)
        for _ in range(2):
            padded = np.pad(blurred, 1, "edge")
            weights = np.outer([1, 2, 1], [1, 2, 1]) / 16
            blurred = np.array(
                [
                    [(padded[y : y + 3, x : x + 3] * weights).sum() for x in range(plane.shape[1])]
                    for y in range(plane.shape[0])
                ]
            )
        padded = np.pad(blurred, 1, "edge")
        for y, x in np.ndindex(*plane.shape):
            across, down = padded[y + 1, x + 2] - padded[y + 1, x], padded[y + 2, x + 1] - padded[y, x + 1]
            steepest[y, x] = max(steepest[y, x], abs(across) / 2, abs(down) / 2)
    return (steepest - calm) / unit


def flood(relief):
    """Levels fall until none falls any more."""
    level = np.full(relief.shape, 999)
    level[0] = relief[0]
    changed = True
    while changed:
        changed = False
        for y, x in np.ndindex(relief.shape):
            lowest = min([level[at] for at in _around(relief.shape, y, x)], default=999)
            if max(lowest, relief[y, x]) < level[y, x]:
                level[y, x] = max(lowest, relief[y, x])
                changed = True
    return level


def label(inside):
    region, count = np.zeros(inside.shape, int), 0
    for start in np.ndindex(inside.shape):
        if not inside[start] or region[start]:
            continue
        count += 1
        todo = [start]
        while todo:
            at = todo.pop()
            if inside[at] and not region[at]:
                region[at] = count
                todo += _around(inside.shape, *at)
    return region, count


def deviation(image):
    pixels = image.reshape(*image.shape[:2], -1).astype(np.float64)
    mask = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]])
    height, width = image.shape[0] - 2, image.shape[1] - 2
    if height < 1 or width < 1:
        return 0.0
    response = np.zeros((height, width, pixels.shape[2]))
    for y, x in np.ndindex(height, width):
        response[y, x] = np.abs(np.tensordot(mask, pixels[y : y + 3, x : x + 3]))
    high, wide = min(16, height), min(16, width)
    means = [
        response[y : y + high, x : x + wide].mean(axis=(0, 1))
        for y in range(0, height - high + 1, high)
        for x in range(0, width - wide + 1, wide)
    ]
    means = np.concatenate(means)
    means = means[means > 0]
    return np.sqrt(np.pi / 2) / 6 * np.quantile(means, 0.2) if means.size else 0.0


def window_mean(image, window):
    height, width = image.shape[:2]
    mean = np.empty((height, width))
    for y, x in np.ndindex(height, width):
        rows = np.clip(np.arange(window[1]) + y - window[1] // 2, 0, height - 1)
        columns = np.clip(np.arange(window[0]) + x - window[0] // 2, 0, width - 1)
        mean[y, x] = image[np.ix_(rows, columns)].astype(np.float64).mean()
    return mean


def brightness(left, right, disparity, window):
    ours, theirs = window_mean(left, window), window_mean(right, window)
    at = [(y, x) for y, x in np.ndindex(disparity.shape) if np.isfinite(disparity[y, x])]
    there = [(y, int(np.clip(np.rint(x - np.float64(disparity[y, x])), 0, left.shape[1] - 1))) for y, x in at]
    a, b = np.array([ours[p] for p in at]), np.array([theirs[p] for p in there])
    kept = np.ones(len(a), bool)
    apart = np.zeros(disparity.shape)
    for _ in range(2):
        design = np.stack([b[kept], np.ones(kept.sum())], axis=1)
        varied = np.ptp(b[kept]) > 0
        gain, offset = (
            np.linalg.lstsq(design, a[kept], rcond=None)[0] if varied else (1, np.mean((a - b)[kept]))
        )
        residual = np.abs(a - gain * b - offset)
        spread = max(1.4826 * np.median(residual), np.abs(a).max() / 255)
        if spread == 0:
            return apart
        kept = residual <= 3 * spread
    for p, value in zip(at, residual, strict=True):
        apart[p] = value / spread
    return apart
