"""The definition of weighted supports: every pixel's weights written out, and the costs over them."""

import numpy as np

from stereopsis import Adaptive, Bilateral, Cross, Gaussian
from stereopsis.supports import window_size


def box(size):
    width, height = size
    return [(j - height // 2, i - width // 2) for j in range(height) for i in range(width)]


def arms(image, cross, unit=1.0):
    """Arms to the left, to the right, up and down, (H, W, 4)."""
    height, width = image.shape[:2]
    found = np.zeros((height, width, 4), int)
    for y in range(height):
        for x in range(width):
            for k, (dy, dx) in enumerate([(0, -1), (0, 1), (-1, 0), (1, 0)]):
                for length in range(1, cross.arm + 1):
                    row, column = y + length * dy, x + length * dx
                    if not (0 <= row < height and 0 <= column < width):
                        break
                    alike = (
                        abs(image[y, x].astype(int) - image[row, column]) * unit <= cross.threshold
                    ).all()
                    if length > 1 and not alike:
                        break
                    found[y, x, k] = length
                    if not alike:
                        break
    return found


def boxes(image, adaptive, unit=1.0):
    """Width and height chosen at each pixel, (H, W, 2)."""
    height, width = image.shape[:2]
    columns = np.arange(width)
    after, before = (image[:, (columns + k).clip(0, width - 1)].astype(float) for k in (1, -1))
    square = ((after - before) * unit / 2) ** 2
    counted = (square / (square + adaptive.gradient**2)).mean(axis=2)
    chosen = np.empty((height, width, 2), int)
    for y in range(height):
        for x in range(width):
            for size in adaptive.sizes:
                chosen[y, x] = size
                rows, around = np.array([(y + j, x + i) for j, i in box(size)]).T
                count = counted[rows.clip(0, height - 1), around.clip(0, width - 1)].sum()
                if count >= adaptive.pixels:
                    break
    return chosen


def weights(support, image, unit=1.0):
    """For each pixel its support's offsets (dy, dx), and their weights."""
    height, width = image.shape[:2]

    def at(y, x):
        return image[min(max(y, 0), height - 1), min(max(x, 0), width - 1)].astype(float)

    match support:
        case Gaussian(sigma):
            offsets = box((2 * support.radius + 1,) * 2)
            weight = np.array([np.exp(-(j * j + i * i) / (2 * sigma**2)) for j, i in offsets])
            return {(y, x): (offsets, weight) for y in range(height) for x in range(width)}
        case Bilateral(size, sigma_space, sigma_colour):
            offsets = box(window_size(size))
            return {
                (y, x): (
                    offsets,
                    np.array(
                        [
                            np.exp(
                                -np.hypot(j, i) / sigma_space
                                - np.sqrt(((at(y + j, x + i) - at(y, x)) ** 2).mean()) * unit / sigma_colour
                            )
                            for j, i in offsets
                        ]
                    ),
                )
                for y in range(height)
                for x in range(width)
            }
        case Cross():
            reach = arms(image, support, unit)
            regions = {}
            for y in range(height):
                for x in range(width):
                    _, _, up, down = reach[y, x]
                    regions[y, x] = [
                        (j, i)
                        for j in range(-up, down + 1)
                        for i in range(-reach[y + j, x, 0], reach[y + j, x, 1] + 1)
                    ]
            return {pixel: (offsets, np.ones(len(offsets))) for pixel, offsets in regions.items()}
        case Adaptive():
            chosen = boxes(image, support, unit)
            return {
                (y, x): (box(chosen[y, x]), np.ones(chosen[y, x].prod()))
                for y in range(height)
                for x in range(width)
            }


def between(kind, weight, left, right):
    """The cost of two windows, (n, C), whose pixels weigh (n,)."""
    weight = weight[:, None] / weight.sum()
    wholes = [(weight * window**2).sum() for window in (left, right)]
    if kind == "sad":
        return (weight * abs(left - right)).sum()
    if kind == "ssd":
        return (weight * (left - right) ** 2).sum()
    if kind != "ncc":
        left = left - (weight * left).sum(axis=0)
        right = right - (weight * right).sum(axis=0)
    if kind == "zsad":
        return (weight * abs(left - right)).sum()
    if kind == "zssd":
        return (weight * (left - right) ** 2).sum()
    squares = [(weight * centred**2).sum() for centred in (left, right)]
    norm = np.sqrt(squares[0] * squares[1])
    # Under a billionth of the mean square it is not known to a millionth.
    has_norm = all(square > 1e-9 * whole for square, whole in zip(squares, wholes, strict=True))
    return -(weight * left * right).sum() / norm if has_norm else 0.0


def volume(support, kind, left, right, disparities, unit=1.0, step=1):
    """Costs (H', W', D); infinity where the match is out of view."""
    height, width = left.shape[:2]
    supports = weights(support, left, unit)
    costs = np.full((height, width, len(disparities)), np.inf)
    for (y, x), (offsets, weight) in supports.items():
        rows, columns = np.array(offsets).T
        rows = (y + rows).clip(0, height - 1)
        lefts = left[rows, (x + columns).clip(0, width - 1)].astype(float)
        for i, d in enumerate(disparities):
            if 0 <= x - d < width:
                rights = right[rows, (x - d + columns).clip(0, width - 1)].astype(float)
                costs[y, x, i] = between(kind, weight, lefts, rights)
    return costs[::step, ::step]
