"""The definition of winner-take-all, a pixel at a time."""

import numpy as np


def in_view(x, d, width):
    return 0 <= x - d < width


def left(volume, first):
    """Index, cost, cost before, cost after, second best cost; lists of rows."""
    worst = np.iinfo(volume.dtype).max if volume.dtype.kind == "i" else np.inf
    height, width, count = volume.shape
    answers = []
    for y in range(height):
        for x in range(width):
            seen = [i for i in range(count) if in_view(x, first + i, width)]
            costs = {i: volume[y, x, i] for i in seen}
            if not seen:
                answers.append((-1, worst, worst, worst, worst))
                continue
            best = min(seen, key=lambda i: (costs[i], i))
            others = [costs[i] for i in seen if abs(i - best) > 1]
            answers.append(
                (
                    best,
                    costs[best],
                    costs.get(best - 1, worst),
                    costs.get(best + 1, worst),
                    min(others, default=worst),
                )
            )
    return [np.array(column).reshape(height, width) for column in zip(*answers, strict=True)]


def right(volume, first):
    height, width, count = volume.shape
    index = np.full((height, width), -1)
    for y in range(height):
        for x in range(width):
            seen = [i for i in range(count) if 0 <= x + first + i < width]
            if seen:
                index[y, x] = min(seen, key=lambda i: (volume[y, x + first + i, i], i))
    return index
