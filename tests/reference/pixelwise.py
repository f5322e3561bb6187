"""The definition of the costs of single pixels: features, pairs and boxes looked up one by one, in int64."""

import numpy as np

WORST = 65535


def at(image, y, x):
    """A pixel; beyond the edges the edge pixel."""
    return image[np.clip(y, 0, image.shape[0] - 1), np.clip(x, 0, image.shape[1] - 1)]


def census(image, window, pattern):
    """(H, W, N) bits: is the first pixel of each comparison darker than the second?"""
    (width, height), apart = window, 2 if pattern == "sparse" else 1
    y, x = np.indices(image.shape)
    bits = []
    for dy in range(-(height // 2), height // 2 + 1, apart):
        for dx in range(-(width // 2), width // 2 + 1, apart):
            if (dy, dx) == (0, 0):
                if pattern == "symmetric":
                    return np.stack(bits, axis=-1)
                continue
            other = at(image, y - dy, x - dx) if pattern == "symmetric" else image
            bits.append(at(image, y + dy, x + dx) < other)
    return np.stack(bits, axis=-1)


def volume(features, between, disparities, box):
    """Sums over the box of ``between(left, right)``, for features (H, W, ...) that repeat at the edges."""
    left, right = features
    height, width = left.shape[:2]
    costs = np.full((height, width, len(disparities)), WORST, np.int64)
    for i, d in enumerate(disparities):
        for y in range(height):
            for x in range(width):
                if 0 <= x - d < width:
                    costs[y, x, i] = sum(
                        between(at(left, y + dy, x + dx), at(right, y + dy, x + dx - d))
                        for dy in range(-(box[1] // 2), box[1] // 2 + 1)
                        for dx in range(-(box[0] // 2), box[0] // 2 + 1)
                    )
    return costs


def hamming(left, right):
    return int(np.sum(left != right))
