"""The definition of the costs: both windows cut out, and their formula, in int64 and float64."""

import numpy as np


def windows(image, size):
    """Cut out the support window of every pixel, edge pixels repeated: (H, W, height, width, C)."""
    width, height = size
    rows = np.arange(image.shape[0])[:, None] + np.arange(height) - height // 2
    columns = np.arange(image.shape[1])[:, None] + np.arange(width) - width // 2
    rows = rows.clip(0, image.shape[0] - 1)
    columns = columns.clip(0, image.shape[1] - 1)
    return image[rows[:, None, :, None], columns[None, :, None, :]].reshape(
        *image.shape[:2], height, width, -1
    )


def between(kind, left, right):
    """The cost of two stacks of windows, (..., height, width, C)."""
    within, all_of_it = (-3, -2), (-3, -2, -1)
    if kind in ("sad", "ssd"):
        difference = left.astype(np.int64) - right.astype(np.int64)
        return (abs(difference) if kind == "sad" else difference**2).sum(axis=all_of_it)

    left, right = left.astype(np.float64), right.astype(np.float64)
    if kind != "ncc":
        left = left - left.mean(axis=within, keepdims=True)
        right = right - right.mean(axis=within, keepdims=True)
    if kind == "zsad":
        return abs(left - right).sum(axis=all_of_it)
    if kind == "zssd":
        return ((left - right) ** 2).sum(axis=all_of_it)
    norm = np.sqrt((left**2).sum(axis=all_of_it) * (right**2).sum(axis=all_of_it))
    # A window whose norm is rounding alone has none.
    has_norm = norm > 1e-6
    return np.where(has_norm, -(left * right).sum(axis=all_of_it) / np.where(has_norm, norm, 1), 0.0)


def volume(kind, left, right, disparities, size):
    """Costs (H, W, D); the dtype's largest value, or infinity, where the match is out of view."""
    lefts, rights = windows(left, size), windows(right, size)
    height, width = left.shape[:2]
    whole = kind in ("sad", "ssd")
    worst = np.iinfo(np.int64).max if whole else np.inf
    costs = np.full((height, width, len(disparities)), worst, np.int64 if whole else np.float64)
    for i, d in enumerate(disparities):
        for x in range(width):
            if 0 <= x - d < width:
                costs[:, x, i] = between(kind, lefts[:, x], rights[:, x - d])
    return costs
