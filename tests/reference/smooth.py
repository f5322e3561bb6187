"""The definition of smoothing along edges, by whole matrices, and of the weighted median."""

from itertools import pairwise

import numpy as np


def edge_weights(image, sigma):
    """Of each pixel with the next to the right, (H, W - 1), and with the one below, (H - 1, W)."""
    return [
        np.maximum(np.exp(-np.abs(np.diff(image.astype(np.float64), axis=axis)).max(axis=2) / sigma), 1e-6)
        for axis in (1, 0)
    ]


def smooth(value, weight, edges, rises, strength, iterations):
    """Value and weight after smoothing from a surface that rises by `rises` from pixel to pixel."""
    value, weight = value.astype(np.float64), weight.astype(np.float64)
    for t in range(1, iterations + 1):
        share = 1.5 * 4 ** (iterations - t) / (4**iterations - 1) * strength
        for axis in (1, 0):
            lines = [np.moveaxis(a, axis, 1) for a in (value, weight, edges[1 - axis], rises[1 - axis])]
            for d, c, w, s in zip(*lines, strict=True):
                surface = np.concatenate([[0], np.cumsum(s)])[: d.size]
                apart = np.diff(np.eye(d.size), axis=0)
                matrix = np.eye(d.size) + share * apart.T @ np.diag(w) @ apart
                smoothed = np.linalg.solve(matrix, np.stack([c * (d - surface), c], 1))
                d[:], c[:] = smoothed[:, 0] / smoothed[:, 1] + surface, smoothed[:, 1]
    return value, weight


def slopes(disparity, image, sigma):
    """Rise of the surface to the right and downwards, (H, W) each."""
    height, width = disparity.shape
    cells = (-(-height // 4), -(-width // 4))
    mean = np.zeros((*cells, image.shape[2]))
    for y, x in np.ndindex(cells):
        block = image[4 * y : 4 * y + 4, 4 * x : 4 * x + 4].astype(np.int64)
        mean[y, x] = block.sum(axis=(0, 1)) // (block.shape[0] * block.shape[1])
    edges = edge_weights(mean, sigma)
    found = []
    for axis in (1, 0):
        sums, counts = np.zeros(cells), np.zeros(cells)
        lines = disparity if axis == 1 else disparity.T
        for k, line in enumerate(lines):
            at = np.flatnonzero(~np.isnan(line))
            for first, last in pairwise(at):
                rise = line[last] - line[first]
                if abs(rise) <= 1.5 + 0.5 * (last - first):
                    for j in range(first, last):
                        cell = (k // 4, j // 4) if axis == 1 else (j // 4, k // 4)
                        sums[cell] += rise / (last - first)
                        counts[cell] += 1
        value = np.where(counts > 0, sums / np.maximum(counts, 1), 0)
        still = [np.zeros(cells), np.zeros(cells)]
        value, _ = smooth(value, np.maximum(counts, 1e-6), edges, still, 300.0, 2)
        whole = np.repeat(np.repeat(np.clip(value, -1.5, 1.5), 4, axis=0), 4, axis=1)
        found.append(whole[:height, :width])
    return found


def edge_aware(disparity, image, strength, sigma, iterations):
    holes = np.isnan(disparity)
    d = disparity.astype(np.float64)
    value, weight = np.where(holes, 0, d), np.where(holes, 1e-6, 1)
    smoothed, _ = smooth(
        value, weight, edge_weights(image, sigma), slopes(d, image, 20.0), strength, iterations
    )
    return np.where(holes, np.nan, smoothed)


def weighted_median(disparity, image, size, sigma):
    reach, slope = size // 2, min(round(16 * 255 / (2.5 * sigma)), 4080)
    largest = np.nanmax(np.abs(disparity), initial=0.0)
    step = 2.0 ** (np.floor(np.log2(largest)) - 13) if largest > 0 else 1.0
    filtered = disparity.copy()
    for y, x in np.argwhere(~np.isnan(disparity)):
        found = []
        for v in range(max(0, y - reach), min(disparity.shape[0], y + reach + 1)):
            for u in range(max(0, x - reach), min(disparity.shape[1], x + reach + 1)):
                if not np.isnan(disparity[v, u]):
                    apart = np.abs(image[v, u].astype(int) - image[y, x].astype(int)).max()
                    left = 255 - min(255, apart * slope // 16)
                    found.append((np.rint(disparity[v, u] / step), max(1, left * left // 256), v, u))
        half = sum(weight for _, weight, _, _ in found) / 2
        values = sorted({value for value, _, _, _ in found})
        middle = next(v for v in values if sum(weight for value, weight, _, _ in found if value <= v) >= half)
        if np.rint(disparity[y, x] / step) != middle:
            filtered[y, x] = next(disparity[v, u] for value, _, v, u in found if value == middle)
    return filtered
