"""Semi-global matching from its formula, pixel by pixel, in int64."""

import itertools

import numpy as np

ALONG = ((1, 0), (-1, 0))
DOWN = ((0, 1),)
AROUND = ((1, 1), (-1, 1))
KNIGHTS = ((1, 2), (-1, 2), (2, 1), (-2, 1))


def directions(paths):
    """Steps (dx, dy) from a pixel to the next one of its path."""

    def opposite(steps):
        return tuple((-dx, -dy) for dx, dy in steps)

    match paths:
        case 2:
            return ALONG
        case 4:
            return ALONG + DOWN + opposite(DOWN)
        case 5:
            return ALONG + DOWN + AROUND
        case 8:
            return ALONG + DOWN + AROUND + opposite(DOWN + AROUND)
        case 16:
            return directions(8) + KNIGHTS + opposite(KNIGHTS)
    raise ValueError(paths)


def message(before, p1, p2):
    """What the costs at the pixel before add to a pixel's: min(L(i), L(i +- 1) + P1, m + P2) - m."""
    padded = np.pad(before, 1, constant_values=np.iinfo(np.int64).max // 2)
    least = before.min()
    return np.minimum(np.minimum(before, np.minimum(padded[:-2], padded[2:]) + p1), least + p2) - least


def path_costs(costs, direction, p1, p2, guide=None):
    """Costs of one path, (H, W, D) int64; `p2` by the absolute difference of the guide along the path."""
    rows, columns, _ = costs.shape
    dx, dy = direction
    guide = np.zeros((rows, columns), np.int64) if guide is None else guide.astype(np.int64)
    out = costs.astype(np.int64)
    forth_y, forth_x = range(rows), range(columns)
    for y in forth_y if dy > 0 or dy == 0 else reversed(forth_y):
        for x in forth_x if dx >= 0 else reversed(forth_x):
            v, u = y - dy, x - dx
            if 0 <= v < rows and 0 <= u < columns:
                out[y, x] += message(out[v, u], p1, p2[abs(guide[y, x] - guide[v, u])])
    return out


def sums(costs, paths, p1, p2, guide=None):
    """Sums over all paths, (H, W, D) int64."""
    return sum(path_costs(costs, direction, p1, p2, guide) for direction in directions(paths))


def more_global(costs, paths, p1, p2, guide=None):
    """Sums of more-global matching: each pixel takes the mean, rounded down, of what two others tell."""
    rows, columns, _ = costs.shape
    guide = np.zeros((rows, columns), np.int64) if guide is None else guide.astype(np.int64)
    steps = [(1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)][:paths]
    total = np.zeros(costs.shape, np.int64)
    for dx, dy in steps:
        befores = (-dx, -dy), (dy, -dx)
        out = costs.astype(np.int64)
        # A pixel comes after both: further along the sum of both steps.
        along = dx - dy, dy + dx
        order = sorted(
            itertools.product(range(rows), range(columns)), key=lambda at: along[1] * at[0] + along[0] * at[1]
        )
        for y, x in order:
            told = [
                message(out[v, u], p1, p2[abs(guide[y, x] - guide[v, u])])
                for u, v in ((x + u, y + v) for u, v in befores)
                if 0 <= v < rows and 0 <= u < columns
            ]
            if told:
                out[y, x] += sum(told) // len(told)
        total += out
    return total


def second_penalties(p2, p2_min, contrast):
    """P2 by the absolute difference of 8-bit pixels: P2 / (1 + difference / contrast), at least the least."""
    return [int(np.floor(max(p2_min, p2 / (1 + k / contrast)) + 0.5)) for k in range(256)]
