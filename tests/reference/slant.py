"""The definition of planes, warps and merging, a pixel at a time."""

import math

import numpy as np

NAN = float("nan")


def at(plane, x, y):
    a, b, c = plane
    return a * x + (b * y + c)


class Draws:
    """The generator that the samples are drawn with."""

    state = 1

    def below(self, n):
        self.state = (self.state * 6364136223846793005 + 1442695040888963407) % 2**64
        return (self.state >> 33) % n


def through(p, q, r):
    """The plane through three points ``(x, y, d)``; None where they are nearly on a line."""
    ux, uy, ud = (q[k] - p[k] for k in range(3))
    vx, vy, vd = (r[k] - p[k] for k in range(3))
    twice_area = ux * vy - uy * vx
    if abs(twice_area) < 64:
        return None
    a, b = (ud * vy - uy * vd) / twice_area, (ux * vd - ud * vx) / twice_area
    return a, b, p[2] - a * p[0] - b * p[1]


def find_plane(disparity, top, radius, most_a, least_b, most_b, tolerance, trials, sample):
    """The plane and how many pixels lie on it; None and 0 where there is none."""
    height, width = disparity.shape
    points = [
        (float(x), float(y), float(disparity[y, x]))
        for y in range(top, height)
        for x in range(width)
        if not math.isnan(disparity[y, x])
    ]
    if len(points) < 3:
        return None, 0
    places = [(float(x), float(y), float(disparity[y, x])) for y in range(top, height) for x in range(width)]
    sparse = 0
    while sparse < 6 and len(points) << (sparse + 1) <= len(places):
        sparse += 1
    step = max(1, -(-len(places) // sample) >> sparse)
    choices = places[::step]
    some = [point for point in choices if not math.isnan(point[2])]
    draws, best, least = Draws(), None, math.inf

    def any_point():
        for _ in range(16 << sparse):
            drawn = choices[draws.below(len(choices))]
            if not math.isnan(drawn[2]):
                break
        return drawn

    for _ in range(trials):
        first = any_point()
        others = []
        for _ in range(2):
            if radius == 0:
                others.append(any_point())
                continue
            x = int(first[0]) + draws.below(2 * radius + 1) - radius
            y = int(first[1]) + draws.below(2 * radius + 1) - radius
            inside = 0 <= x < width and top <= y < height
            others.append((x, y, float(disparity[y, x]) if inside else NAN))
        plane = through(first, *others)
        if plane is None or not (abs(plane[0]) <= most_a and least_b <= plane[1] <= most_b):
            continue
        score = sum(min(abs(at(plane, x, y) - d), tolerance) for x, y, d in some)
        if score < least:
            best, least = plane, score
    if best is None:
        return None, 0

    def on(reach, points):
        return [p for p in points if abs(at(best, p[0], p[1]) - p[2]) <= reach]

    polished = [p for p in places[:: max(1, len(places) // 2**16 >> sparse)] if not math.isnan(p[2])]
    for reach in (2 * tolerance, tolerance, tolerance):
        near = np.array(on(reach, polished)).reshape(-1, 3)
        if len(near) >= 3:
            middle = near.mean(axis=0)
            u, v, w = (near - middle).T
            determinant = (u @ u) * (v @ v) - (u @ v) ** 2
            if determinant > 1e-9 * (u @ u) * (v @ v):
                a = ((u @ w) * (v @ v) - (v @ w) * (u @ v)) / determinant
                b = ((v @ w) * (u @ u) - (u @ w) * (u @ v)) / determinant
                best = a, b, middle[2] - a * middle[0] - b * middle[1]
    return best, len(on(tolerance, points))


def warp(image, plane, margin):
    """``image(x - plane(x, y), y)`` by Keys' cubic convolution, rounded, within the image's own values."""
    height, width, channels = image.shape
    low, high = int(image.min()), int(image.max())
    out = np.zeros((height, width + 2 * margin, channels), image.dtype)
    for y in range(height):
        for x in range(-margin, width + margin):
            there = x - at(plane, x, y)
            for c in range(channels):
                value = sum(
                    keys(there - k) * float(image[y, min(max(k, 0), width - 1), c])
                    for k in range(math.floor(there) - 1, math.floor(there) + 3)
                )
                out[y, x + margin, c] = math.floor(min(max(value, low), high) + 0.5)
    return out


def keys(t):
    t = abs(t)
    if t <= 1:
        return 1.5 * t**3 - 2.5 * t**2 + 1
    return -0.5 * t**3 + 2.5 * t**2 - 4 * t + 2 if t < 2 else 0.0


def misfit(kind, cost):
    if kind in ("ncc", "zncc"):
        return 1 + cost * abs(cost)
    return cost * cost if kind in ("sad", "zsad") else cost


def merge_pass(best, found, cost, kind, plane, number, factor, disparities):
    disparity, confidence, flags = found
    height, width = best.disparity.shape
    margin = (disparity.shape[1] - width) // 2
    for y in range(height):
        for x in range(width):
            u = x + margin
            left_over = np.float32(misfit(kind, float(cost[y, u])) * factor)
            rest = float(disparity[y, u])
            d = rest + at(plane, x - rest, y)
            inside = 0 <= x - d <= width - 1 and disparities[0] - 0.5 <= d <= disparities[1] - 0.5
            if left_over < best.misfit[y, x] and inside:
                best.disparity[y, x], best.confidence[y, x] = d, confidence[y, u]
                best.misfit[y, x], best.cost[y, x] = left_over, cost[y, u]
                best.flags[y, x], best.plane[y, x] = flags[y, u], number


def variance(kind, cost, confidence):
    depth = max(float(confidence), 1e-4)
    rho = max(-float(cost), 0.01) if kind in ("ncc", "zncc") else 1.0
    return (1 + rho) / (2 * rho) * (1 - depth) / depth


def left_right_maps(left, right, disparities, tolerance):
    height, width = left.shape
    flags = np.zeros(left.shape, np.uint8)
    for y in range(height):
        for x in range(width):
            if math.isnan(left[y, x]):
                continue
            there = round(x - float(left[y, x]))
            if 0 <= there < width and abs(right[y, there] - left[y, x]) <= tolerance:
                continue
            claimed = any(
                abs(u + float(right[y, u]) - x) <= tolerance and disparities[0] <= x - u <= disparities[1] - 1
                for u in range(width)
            )
            flags[y, x] = 2 if claimed else 1
    return flags
