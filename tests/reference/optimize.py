"""The definition of smoothing: the energy as written, its minimum by trying all, solvers pixel by pixel."""

import itertools

import numpy as np


def penalty(difference, norm, weight, truncation):
    step = abs(difference) if truncation is None else min(abs(difference), truncation)
    return weight * (step if norm == "l1" else step**2)


def penalties(count, model):
    """All differences' penalties, (D, D)."""
    labels = range(count)
    return np.array(
        [[penalty(k - other, model.norm, model.weight, model.truncation) for other in labels] for k in labels]
    )


def edges(height, width):
    """Pairs of neighbours, the earlier one first."""
    for y in range(height):
        for x in range(width):
            if x + 1 < width:
                yield (y, x), (y, x + 1)
            if y + 1 < height:
                yield (y, x), (y + 1, x)


def energy(index, volume, model):
    worst = np.iinfo(volume.dtype).max if volume.dtype.kind == "i" else np.inf
    height, width, count = volume.shape
    between = penalties(count, model)
    total = 0.0
    for p in np.ndindex(height, width):
        if index[p] >= 0:
            total += np.inf if volume[p][index[p]] == worst else float(volume[p][index[p]])
    for p, q in edges(height, width):
        if index[p] >= 0 and index[q] >= 0:
            total += between[index[p], index[q]]
    return total


def least_energy(volume, model):
    """The least energy of all labels that there are."""
    height, width, count = volume.shape
    between = penalties(count, model)
    worst = np.iinfo(volume.dtype).max if volume.dtype.kind == "i" else np.inf
    costs = np.where(volume == worst, np.inf, volume.astype(np.float64)).reshape(-1, count)
    choices = np.array(list(itertools.product(range(count), repeat=height * width)))
    total = np.zeros(len(choices))
    here = np.isfinite(costs).any(axis=1)
    for p in np.flatnonzero(here):
        total += costs[p, choices[:, p]]
    for (y, x), (v, u) in edges(height, width):
        p, q = y * width + x, v * width + u
        if here[p] and here[q]:
            total += between[choices[:, p], choices[:, q]]
    return total.min()


def distance_transform(h, model):
    between = penalties(h.shape[-1], model)
    return (h[..., :, None] + between).min(axis=-2)


def winners(costs):
    return np.where(np.isfinite(costs).any(axis=2), costs.argmin(axis=2), -1)


def beside(p, index):
    y, x = p
    for q in ((y, x - 1), (y, x + 1), (y - 1, x), (y + 1, x)):
        if 0 <= q[0] < index.shape[0] and 0 <= q[1] < index.shape[1] and index[q] >= 0:
            yield q


def icm(costs, model, iterations):
    height, width, count = costs.shape
    between = penalties(count, model)
    index = winners(costs)
    for _ in range(iterations):
        for colour in (0, 1):
            for p in np.ndindex(height, width):
                if sum(p) % 2 != colour or index[p] < 0:
                    continue
                sums = costs[p] + sum((between[index[q]] for q in beside(p, index)), np.zeros(count))
                if sums.min() < sums[index[p]]:
                    index[p] = sums.argmin()
    return index


def trws(costs, model, iterations):
    """Labels of the least energy that was met, and the bound."""
    height, width, count = costs.shape
    between = penalties(count, model)
    start = winners(costs)
    pixels = [p for p in np.ndindex(height, width) if start[p] >= 0]
    message = {(p, q): np.zeros(count) for p in pixels for q in beside(p, start)}
    best, least, bound = start, np.inf, -np.inf

    def gathered(p):
        return costs[p] + sum((message[q, p] for q in beside(p, start)), np.zeros(count))

    def send(p, later):
        """Normalised messages to one side; what was taken off."""
        ends = list(beside(p, start))
        onwards = [q for q in ends if (q > p) == later]
        share = 1 / max(1, len(onwards), len(ends) - len(onwards))
        sums = gathered(p)
        taken = sums.min()
        for q in onwards:
            sent = (share * (sums - sums.min()) - message[q, p])[:, None] + between
            sent = sent.min(axis=0)
            taken += sent.min()
            message[p, q] = sent - sent.min()
        return taken

    for iteration in range(iterations + 1):
        index = np.full((height, width), -1)
        for p in pixels:
            sums = costs[p].copy()
            for q in beside(p, start):
                sums += between[index[q]] if q < p else message[q, p]
            index[p] = sums.argmin()
            if iteration < iterations:
                send(p, later=True)
        if iteration > 0 and energy(index, costs, model) < least:
            best, least = index, energy(index, costs, model)
        if iteration < iterations:
            bound = max(bound, sum(send(p, later=False) for p in reversed(pixels)))
    return best, bound


def belief_propagation(costs, model, iterations, levels):
    count = costs.shape[2]
    between = penalties(count, model)
    pyramid = [np.where(np.isfinite(costs).any(axis=2)[..., None], costs, np.nan)]
    while len(pyramid) < levels and max(pyramid[-1].shape[:2]) > 1:
        fine = pyramid[-1]
        coarse = np.full(((fine.shape[0] + 1) // 2, (fine.shape[1] + 1) // 2, count), np.nan)
        for y, x in np.ndindex(coarse.shape[:2]):
            block = fine[2 * y : 2 * y + 2, 2 * x : 2 * x + 2].reshape(-1, count)
            block = block[~np.isnan(block).any(axis=1)]
            if len(block) and np.isfinite(block.sum(axis=0)).any():
                coarse[y, x] = block.sum(axis=0)
        pyramid.append(coarse)
    coarser = None
    steps = {"left": (0, -1), "right": (0, 1), "up": (-1, 0), "down": (1, 0)}
    back = {"left": "right", "right": "left", "up": "down", "down": "up"}
    for level in reversed(pyramid):
        shape = level.shape[:2]
        takes_part = ~np.isnan(level).any(axis=2)
        sent = {
            (p, way): np.zeros(count) if coarser is None else coarser[(p[0] // 2, p[1] // 2), way]
            for p in np.ndindex(shape)
            for way in steps
        }

        def there(p, way, shape=shape, takes_part=takes_part):
            q = p[0] + steps[way][0], p[1] + steps[way][1]
            return q if 0 <= q[0] < shape[0] and 0 <= q[1] < shape[1] else None

        def belief(p, level=level, sent=sent, takes_part=takes_part, there=there, but=None):
            total = level[p].copy()
            for way in steps:
                q = there(p, way)
                if way != but and q is not None and takes_part[q]:
                    total += sent[q, back[way]]
            return total

        for half in range(2 * iterations):
            for p in np.ndindex(shape):
                if sum(p) % 2 == half % 2 and takes_part[p]:
                    for way in steps:
                        if there(p, way) is not None:
                            new = (belief(p, but=way)[:, None] + between).min(axis=0)
                            sent[p, way] = new - new.min()
        coarser = sent
    index = np.full(shape, -1)
    for p in np.ndindex(shape):
        if takes_part[p]:
            index[p] = belief(p).argmin()
    return index


def second_pass(volume, guide, model, window, scale):
    worst = np.iinfo(volume.dtype).max if volume.dtype.kind == "i" else np.inf
    height, width, _ = volume.shape
    out = np.full(volume.shape, np.inf)
    rows = np.arange(window[1]) - window[1] // 2
    columns = np.arange(window[0]) - window[0] // 2
    for y, x, d in np.ndindex(volume.shape):
        if volume[y, x, d] == worst:
            continue
        around = guide[np.clip(y + rows, 0, height - 1)][:, np.clip(x + columns, 0, width - 1)]
        drawn = [
            penalty(label - d, model.norm, model.weight, model.truncation) for label in around[around >= 0]
        ]
        out[y, x, d] = scale * float(volume[y, x, d]) + (np.mean(drawn) if drawn else 0)
    return out
