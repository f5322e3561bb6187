"""The definition of what finds and undoes a misrectification, a window at a time, in float64."""

import numpy as np


def corners(image, tile, stride, reach, least):
    """Columns and rows, (rows, columns, 2); -1 where there is none."""
    height, width = image.shape
    pixels = image.astype(np.int64)
    gx, gy = np.zeros_like(pixels), np.zeros_like(pixels)
    gx[:, 1:-1] = pixels[:, 2:] - pixels[:, :-2]
    gy[1:-1] = pixels[2:] - pixels[:-2]
    found = np.full((height // tile, width // tile, 2), -1, np.int32)
    for row, column in np.ndindex(found.shape[:2]):
        most = least
        for y in range(row * tile, (row + 1) * tile, stride):
            for x in range(column * tile, (column + 1) * tile, stride):
                if not (reach[0] < x < width - 1 - reach[0] and reach[1] < y < height - 1 - reach[1]):
                    continue
                window = np.s_[y - reach[1] : y + reach[1] + 1, x - reach[0] : x + reach[0] + 1]
                xx, xy, yy = ((a[window] * b[window]).sum() for a, b in ((gx, gx), (gx, gy), (gy, gy)))
                score = 0.5 * (xx + yy) - np.sqrt((0.5 * (xx - yy)) ** 2 + float(xy) ** 2)
                if score > most:
                    most, found[row, column] = score, (x, y)
    return found


def bilinear(image, x, y):
    left, top = np.minimum(np.floor(x).astype(int), image.shape[1] - 2), np.floor(y).astype(int)
    top = np.minimum(top, image.shape[0] - 2)
    s, t = x - left, y - top
    upper = (1 - s) * image[top, left] + s * image[top, left + 1]
    lower = (1 - s) * image[top + 1, left] + s * image[top + 1, left + 1]
    return (1 - t) * upper + t * lower


def track(left, right, point, reach, iterations, motion):
    """Motion (columns, rows) and correlation of one point; the latter NaN where a window leaves its image."""
    left, right = left.astype(np.float64), right.astype(np.float64)
    (height, width), (x, y) = left.shape, point
    motion = np.array(motion, np.float64)
    if not (reach[0] < x < width - 1 - reach[0] and reach[1] < y < height - 1 - reach[1]):
        return motion, np.nan
    v, u = np.mgrid[y - reach[1] : y + reach[1] + 1, x - reach[0] : x + reach[0] + 1]

    def centred(values):
        return (values - values.mean()).ravel()

    mine = centred(left[v, u])
    slopes = np.stack(
        [centred(left[v, u + 1] - left[v, u - 1]) / 2, centred(left[v + 1, u] - left[v - 1, u]) / 2]
    )
    normal = slopes @ slopes.T
    if not np.linalg.det(normal) > 1e-9 * normal[0, 0] * normal[1, 1]:
        return motion, np.nan
    moved = 1.0
    for step in range(iterations + 1):
        at = u + motion[0], v + motion[1]
        if not (
            at[0].min() >= 0 and at[0].max() <= width - 1 and at[1].min() >= 0 and at[1].max() <= height - 1
        ):
            return motion, np.nan
        other = centred(bilinear(right, *at))
        if not other @ other > 0:
            return motion, np.nan
        if step == iterations or moved < 0.01:
            return motion, (mine @ other) / np.sqrt((other @ other) * (mine @ mine))
        gain = (mine @ other) / (other @ other)
        by = np.clip(np.linalg.solve(normal, slopes @ (mine - gain * other)), -1, 1)
        moved, motion = np.abs(by).max(), motion + by
    raise AssertionError


def fit(across, down, rows, slope, keystone, settled):
    """The field that most rows agree on, and its variance over the image."""
    terms = np.stack((np.ones_like(across), across, down, across * down))
    found = np.array([np.median(rows), 0.0, 0.0, 0.0])
    prior = np.diag([0.0, slope**-2, slope**-2, keystone**-2])
    for _ in range(20):
        rest = rows - found @ terms
        scale = max(1.4826 * np.median(np.abs(rest)), 0.01)
        weights = 1 / (1 + (rest / (2 * scale)) ** 2) ** 2
        normal = (weights * terms) @ terms.T + scale**2 * prior
        before, found = found, np.linalg.solve(normal, (weights * terms) @ rows)
        if np.abs(found - before).max() < settled:
            break
    spread = 4 * scale**2 * np.linalg.inv(normal)
    return found, spread[0, 0] + (spread[1, 1] + spread[2, 2]) / 12 + spread[3, 3] / 144


def unbowed(disparity, bow, middle, least, most, of_right):
    """Disparities with the bow of their right columns undone, in float64."""
    x = np.arange(disparity.shape[1]) - middle - (0 if of_right else disparity.astype(np.float64))
    low, high = np.fmin(disparity, least), np.fmax(disparity, most)
    return np.where(np.isnan(disparity), np.nan, np.clip(disparity + bow * x**2, low, high))


def move_rows(image, plane, lowest, highest):
    """The image at ``(x, y + a x + b y + c + e x y)``, by cubic convolution, before rounding."""
    height, width = image.shape[:2]
    y, x = np.mgrid[:height, :width]
    there = np.clip(y + plane[0] * x + plane[1] * y + plane[2] + plane[3] * x * y, -2, height + 1)
    whole = np.floor(there).astype(int)
    t = (there - whole)[..., None]
    weights = (
        (-(t**3) + 2 * t**2 - t) / 2,
        (3 * t**3 - 5 * t**2 + 2) / 2,
        (-3 * t**3 + 4 * t**2 + t) / 2,
        (t**3 - t**2) / 2,
    )
    rows = [image[np.clip(whole + k, 0, height - 1), x].astype(np.float64) for k in (-1, 0, 1, 2)]
    return np.clip(sum(w * row for w, row in zip(weights, rows, strict=True)), lowest, highest)
