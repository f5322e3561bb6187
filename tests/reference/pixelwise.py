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


def rank(image, window):
    """How many of the window's pixels are darker than its centre."""
    return census(image, window, "dense").sum(axis=-1)


def apart(left, right):
    return abs(int(left) - int(right))


def levels(left, right):
    """8 bits of two images that may have more."""
    if left.dtype == np.uint8:
        return left.astype(np.int64), right.astype(np.int64)
    least, unit = min(left.min(), right.min()), 1
    while (max(left.max(), right.max()) - least) // unit > 255:
        unit *= 2
    return tuple((image.astype(np.int64) - least) // unit for image in (left, right))


def gradient(image):
    y, x = np.indices(image.shape)
    return np.stack(
        [at(image, y, x + 1) - at(image, y, x - 1), at(image, y + 1, x) - at(image, y - 1, x)], axis=-1
    )


def gradients_apart(truncation):
    return lambda left, right: min(int(abs(left - right).sum()), truncation)


def half_samples(image):
    """Each pixel with the values half a pixel to its left and right, doubled."""
    y, x = np.indices(image.shape)
    return np.stack([2 * image, image + at(image, y, x - 1), image + at(image, y, x + 1)], axis=-1)


def birchfield_tomasi(truncation):
    def one_way(value, others):
        return max(0, value - max(others), min(others) - value)

    return lambda left, right: int(min(one_way(left[0], right), one_way(right[0], left), 2 * truncation))


def looked_up(table):
    return lambda left, right: int(table[left, right])


def information(left, right, disparity):
    """Mutual information of levels, before rounding; and the costs that it gives."""
    pairs = []
    for y, x in np.ndindex(disparity.shape):
        if np.isfinite(disparity[y, x]) and 0 <= (match := round(x - float(disparity[y, x]))) < left.shape[1]:
            pairs.append((left[y, x], right[y, match]))
    kernel = [np.exp(-0.5 * k * k) for k in range(-3, 4)]
    kernel = [weight / sum(kernel) for weight in kernel]
    both, first, second = np.zeros((256, 256)), np.zeros(256), np.zeros(256)
    for i, k in pairs:
        both[i, k] += 1 / len(pairs)
        first[i] += 1 / len(pairs)
        second[k] += 1 / len(pairs)

    def smoothed(of):
        wide = np.pad(of, 3, mode="edge")
        total = np.zeros_like(of)
        for offset in np.ndindex((7,) * of.ndim):
            window = tuple(slice(o, o + 256) for o in offset)
            total += np.prod([kernel[o] for o in offset]) * wide[window]
        return total

    h = [smoothed(np.log(np.maximum(smoothed(of), 1e-7))) for of in (both, first, second)]
    mutual = h[0] - h[1][:, None] - h[2]
    return mutual, np.minimum(16 * (mutual.max() - mutual), 255)
