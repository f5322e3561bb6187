"""The definition of Gaussian windows: truncated weights, edge pixels repeated, moments in float64."""

import numpy as np

FLAT = 1e-6
"""A window whose norm, in squared grey levels, is not above this has none."""


def weights(sigma, truncate):
    reach = round(truncate * sigma)
    i = np.arange(-reach, reach + 1)
    weight = np.exp(-(i**2) / (2.0 * sigma**2))
    return weight / weight.sum()


def blur(padded, weight):
    """Weighted means over the rows and columns of (H + 2 reach, W + 2 reach), (H, W)."""
    rows, columns = (band(length - len(weight) + 1, weight) for length in padded.shape)
    return rows @ padded @ columns.T


def band(count, weight):
    """The matrix whose row i holds the weights from column i on."""
    matrix = np.zeros((count, count + len(weight) - 1))
    for i in range(count):
        matrix[i, i : i + len(weight)] = weight
    return matrix


def volume(kind, left, right, disparities, sigma, truncate=4.0):
    """Costs (H, W, D) of (H, W, C) images, infinite where the match is out of view."""
    weight = weights(sigma, truncate)
    reach = len(weight) // 2
    height, width, channels = left.shape
    rows = np.arange(-reach, height + reach).clip(0, height - 1)
    columns = np.arange(-reach, width + reach)
    lefts = left.astype(np.float64)[rows][:, columns.clip(0, width - 1)]
    costs = np.full((height, width, len(disparities)), np.inf)
    for i, d in enumerate(disparities):
        rights = right.astype(np.float64)[rows][:, (columns - d).clip(0, width - 1)]
        cost = between(kind, lefts, rights, lambda image: blur(image, weight), channels)
        seen = (np.arange(width) - d >= 0) & (np.arange(width) - d < width)
        costs[:, seen, i] = cost[:, seen]
    return costs


def between(kind, left, right, mean, channels):
    """The cost from weighted means of two padded images, over the channels."""
    total, left_norm, right_norm = 0.0, 0.0, 0.0
    for c in range(channels):
        a, b = left[..., c], right[..., c]
        if kind == "sad":
            total = total + mean(abs(a - b))
        elif kind == "ssd":
            total = total + mean((a - b) ** 2)
        elif kind == "zssd":
            total = total + mean((a - b) ** 2) - mean(a - b) ** 2
        else:
            centre = kind == "zncc"
            total = total + mean(a * b) - centre * mean(a) * mean(b)
            left_norm = left_norm + mean(a * a) - centre * mean(a) ** 2
            right_norm = right_norm + mean(b * b) - centre * mean(b) ** 2
    if kind in ("ncc", "zncc"):
        has_norm = (left_norm > FLAT) & (right_norm > FLAT)
        return np.where(has_norm, -total / np.sqrt(np.where(has_norm, left_norm * right_norm, 1)), 0.0)
    return total


def knots(values, stride, taps):
    """What the streaming path computes along one axis: gather, filter, spread. The ends are repeated."""
    box = np.ones(stride) / stride
    spline = np.convolve(np.convolve(box, box), np.convolve(box, box))
    spread, reach = 2 * (stride - 1), len(taps) - 1
    at = np.arange(-reach - 1, (len(values) - 1) // stride + 3 + reach)
    pixels = (stride * at[:, None] + np.arange(-spread, spread + 1)).clip(0, len(values) - 1)
    gathered = values[pixels] @ spline
    filtered = np.convolve(gathered, np.concatenate([taps[:0:-1], taps]), mode="valid")
    result = np.zeros(len(values))
    for x in range(len(values)):
        for k in range(len(filtered)):
            away = x - stride * (k - 1) + spread
            if 0 <= away < len(spline):
                result[x] += stride * spline[away] * filtered[k]
    return result
