"""The definition of segments with planes: fit, boundaries, smoothing; a pixel and a segment at a time."""

import math
from functools import partial

import numpy as np

AROUND = ((-1, -1), (0, -1), (1, -1), (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0))
"""A pixel's neighbours (x, y), from the upper left on; the odd ones share a side with it."""


def at(plane, x, y):
    a, b, c = plane
    return a * x + (b * y + c)


def exists(plane):
    return not math.isnan(plane[2])


def allowed(model, plane):
    return abs(plane[0]) <= model.most_a and abs(plane[1]) <= model.most_b


def members(seen, label, count):
    """Each segment's believed pixels ``(x, y, d, weight)``, row by row."""
    _, disparity, weight = seen
    points = [[] for _ in range(count)]
    for y, x in np.ndindex(label.shape):
        if weight[y, x] > 0:
            points[label[y, x]].append((x, y, float(disparity[y, x]), float(weight[y, x])))
    return points


def misfit(model, points, plane):
    return sum(w * min((at(plane, x, y) - d) ** 2, model.truncation) for x, y, d, w in points)


def least_squares(points):
    """The plane nearest to ``(x, y, d, weight)``; None where the points lie nearly on a line."""
    x, y, d, w = np.array(points).reshape(-1, 4).T
    if not w.sum() > 0:
        return None
    x0, y0, d0 = ((w * v).sum() / w.sum() for v in (x, y, d))
    u, v, e = x - x0, y - y0, d - d0
    xx, xy, yy = (w * u * u).sum(), (w * u * v).sum(), (w * v * v).sum()
    determinant = xx * yy - xy * xy
    if not (xx > 1e-9 * (w * x * x).sum() and yy > 1e-9 * (w * y * y).sum() and determinant > 1e-6 * xx * yy):
        return None
    a = ((w * u * e).sum() * yy - (w * v * e).sum() * xy) / determinant
    b = ((w * v * e).sum() * xx - (w * u * e).sum() * xy) / determinant
    return a, b, d0 - a * x0 - b * y0


class Draws:
    def __init__(self, number):
        self.state = number * 2654435761 + 1

    def below(self, n):
        self.state = (self.state * 6364136223846793005 + 1442695040888963407) % 2**64
        return (self.state >> 33) % n


def fit(seen, model, label, planes, trials):
    planes = planes.copy()
    for i, points in enumerate(members(seen, label, len(planes))):
        if points:
            planes[i] = fitted(model, points, i, trials, tuple(planes[i]))
    return planes


def fitted(model, points, number, trials, held):
    sample = points[:: max(1, len(points) // 64)]
    draws = Draws(number)
    tried = [held] if exists(held) else []
    for _ in range(trials):
        p, q, r = (points[draws.below(len(points))] for _ in range(3))
        tried.append((0.0, 0.0, p[2]))
        ux, uy, ud = (q[k] - p[k] for k in range(3))
        vx, vy, vd = (r[k] - p[k] for k in range(3))
        twice_area = ux * vy - uy * vx
        if abs(twice_area) >= 16:
            a, b = (ud * vy - uy * vd) / twice_area, (ux * vd - ud * vx) / twice_area
            tried.append((a, b, p[2] - a * p[0] - b * p[1]))
    # What a segment has stays a candidate, however steep.
    best = min(
        (plane for plane in tried if plane is held or allowed(model, plane)),
        key=lambda plane: misfit(model, sample, plane),
    )
    for _ in range(2):
        near = [p for p in points if (at(best, p[0], p[1]) - p[2]) ** 2 < model.truncation]
        polished = least_squares(near)
        if polished is not None and allowed(model, polished):
            best = polished
    if exists(held) and not misfit(model, points, best) < misfit(model, points, held):
        return held
    return best


def move(seen, model, planes, label, sweeps):
    image, disparity, weight = seen
    height, width = label.shape
    means = {}
    for i in np.unique(label):
        y, x = np.nonzero(label == i)
        means[i] = image[y, x].astype(np.float64).mean(axis=0), x.mean(), y.mean()
    label = label.copy()

    def energy(x, y, i, around):
        colour, mx, my = means[i]
        total = 3 * ((image[y, x] - colour) ** 2).mean()
        total += model.position * ((x - mx) ** 2 + (y - my) ** 2) / model.side**2
        if weight[y, x] > 0:
            rest = (at(planes[i], x, y) - disparity[y, x]) ** 2 if exists(planes[i]) else math.inf
            total += model.depth * min(rest, model.truncation)
        return total + model.boundary * sum(other not in (-1, i) for other in around)

    for _ in range(sweeps):
        for phase in range(4):
            for y in range(phase // 2, height, 2):
                for x in range(phase % 2, width, 2):
                    around = [
                        label[y + v, x + u] if 0 <= x + u < width and 0 <= y + v < height else -1
                        for u, v in AROUND
                    ]
                    if holds_together(around, label[y, x]):
                        candidates = [label[y, x], *(i for i in around[1::2] if i >= 0)]
                        label[y, x] = min(candidates, key=lambda i: energy(x, y, i, around))
    return label


def holds_together(around, own):
    """Whether the pixel's own segment touches it, and is in one piece around it without it."""
    left = {k for k in range(8) if around[k] == own}
    sides = [k for k in left if k % 2]
    if not sides:
        return False
    reached, todo = set(), [sides[0]]
    while todo:
        k = todo.pop()
        if k in left and k not in reached:
            reached.add(k)
            todo += [(k + 1) % 8, (k - 1) % 8]
    return set(sides) <= reached


def meetings(label):
    """The places halfway between the pixels that meet, by pairs of segments, in the order of their first."""
    height, width = label.shape
    places = {}
    for y, x in np.ndindex(height, width):
        for u, v in ((x + 1, y), (x, y + 1)):
            if u < width and v < height and label[v, u] != label[y, x]:
                pair = tuple(sorted((int(label[y, x]), int(label[v, u]))))
                places.setdefault(pair, []).append(((x + u) / 2, (y + v) / 2))
    return places


def meeting(model, both, boundary, p, q):
    """What it costs that two planes meet, and how they do: 0 as one, 1 in a fold, 2 with a step."""

    def mean_square(points):
        return float(np.mean([(at(p, x, y) - at(q, x, y)) ** 2 for x, y in points]))

    costs = mean_square(both), model.hinge + mean_square(boundary), model.occlusion
    how = costs.index(min(costs))
    return costs[how], how


class TieError(Exception):
    """Two planes serve as well, up to rounding: either is right."""


def best_of(offered, energy):
    best = min(offered, key=energy)
    least = energy(best)
    others = [plane for plane in offered if not np.allclose(plane, best, atol=1e-7)]
    if any(energy(plane) - least <= 1e-9 * (1 + abs(least)) for plane in others):
        raise TieError
    return best


def smooth(seen, model, label, planes, columns, rounds):
    count = len(planes)
    points = members(seen, label, count)
    pixels = [[(x, y) for y, x in zip(*np.nonzero(label == i), strict=True)] for i in range(count)]
    places = meetings(label)
    neighbours = [
        [(i + j - k, pair) for pair in places for i, j in [pair] if k in pair] for k in range(count)
    ]
    planes = planes.copy()
    for turn in range(4 * rounds):
        before = [tuple(plane) for plane in planes]

        def meets(i, plane, before=before):
            for j, pair in neighbours[i]:
                if exists(before[j]):
                    both = pixels[i] + pixels[j]
                    yield j, pair, *meeting(model, both, places[pair], plane, before[j])

        def energy(i, plane, meets=meets):
            around = sum(len(places[pair]) * cost for _, pair, cost, _ in meets(i, plane))
            return model.smoothness * around + misfit(model, points[i], plane)

        for i in range(count):
            if (i // columns % 2, i % columns % 2) != (turn % 4 // 2, turn % 2):
                continue
            offered = [p for p in (before[i], *(before[j] for j, _ in neighbours[i])) if exists(p)]
            if not offered:
                continue
            best = best_of(offered, partial(energy, i))
            near = [p for p in points[i] if (at(best, p[0], p[1]) - p[2]) ** 2 < model.truncation]
            for j, pair, _, how in meets(i, best):
                length, both = len(places[pair]), pixels[i] + pixels[j]
                if how == 0:
                    weight = model.smoothness * length / len(both)
                    near += [(x, y, at(before[j], x, y), weight) for x, y in both]
                elif how == 1:
                    near += [(x, y, at(before[j], x, y), model.smoothness) for x, y in places[pair]]
            compromise = least_squares(near)
            if compromise is not None and allowed(model, compromise):
                best = best_of((best, compromise), partial(energy, i))
            planes[i] = best
    return planes


def render(label, planes, least, most):
    out = np.full(label.shape, np.nan)
    for y, x in np.ndindex(label.shape):
        if exists(planes[label[y, x]]):
            out[y, x] = min(max(at(planes[label[y, x]], x, y), least), most)
    return out
