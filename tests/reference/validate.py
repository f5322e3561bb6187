"""The definition of the checks, a pixel at a time."""

import collections
import itertools

import numpy as np

from reference.cost import windows

OCCLUDED, MISMATCHED = 1, 2


def left_right(index, right, first, tolerance):
    height, width = index.shape
    flags = np.zeros(index.shape, np.uint8)
    for y in range(height):
        claimed = [x + first + right[y, x] for x in range(width) if right[y, x] >= 0]
        for x in range(width):
            i = index[y, x]
            if i >= 0 and abs(right[y, x - first - i] - i) > tolerance:
                near = any(abs(column - x) <= tolerance for column in claimed)
                flags[y, x] = MISMATCHED if near else OCCLUDED
    return flags


def uniqueness(volume, first, perfect, margin):
    """From the whole volume: does any candidate not next to the winner cost at most `margin` percent more?"""
    height, width, count = volume.shape
    ambiguous = np.zeros((height, width), bool)
    for y in range(height):
        for x in range(width):
            seen = [i for i in range(count) if 0 <= x - first - i < width]
            if seen:
                best = min(seen, key=lambda i: (volume[y, x, i], i))
                bound = (float(volume[y, x, best]) - perfect) * (1 + margin / 100)
                ambiguous[y, x] = any(
                    float(volume[y, x, i]) - perfect <= bound for i in seen if abs(i - best) > 1
                )
    return ambiguous


def texture(image, size):
    last = image.shape[1] - 1
    x = np.arange(image.shape[1])
    pixels = image.astype(np.float64)
    gradient = abs(pixels[:, np.minimum(x + 1, last)] - pixels[:, np.maximum(x - 1, 0)]) / 2
    return windows(gradient, size).mean(axis=(2, 3, 4))


def regions(disparity, difference):
    """Label every pixel by its place, and spread the smallest label until nothing changes."""
    width = disparity.shape[1]
    label = {(y, x): y * width + x for y, x in np.argwhere(~np.isnan(disparity)).tolist()}
    changed = True
    while changed:
        changed = False
        for y, x in label:
            for near in ((y, x - 1), (y, x + 1), (y - 1, x), (y + 1, x)):
                joined = near in label and abs(disparity[near] - disparity[y, x]) <= difference
                if joined and label[near] < label[y, x]:
                    label[y, x] = label[near]
                    changed = True
    return label


def speckle(disparity, area, difference):
    label = regions(disparity, difference)
    sizes = list(label.values())
    found = np.zeros(disparity.shape, bool)
    for at, name in label.items():
        found[at] = sizes.count(name) < area
    return found


def cut_off(disparity, left, area, difference, nearer):
    label, found = regions(disparity, difference), np.zeros(disparity.shape, bool)
    sizes = collections.Counter(label.values())
    while True:
        ends = {name: [] for name in sizes}
        for y, row in enumerate(disparity):
            answered = np.flatnonzero(~np.isnan(row) & ~found[y]).tolist()
            for x, other in itertools.pairwise(answered):
                if label[y, x] != label[y, other]:
                    ends[label[y, x]].append(row[other] > row[x] + nearer and row[other] > left + x)
        more = {
            name for name in ends if any(ends[name]) and np.mean(ends[name]) >= 0.5 and sizes[name] < area
        }
        if not more:
            return found
        for at, name in label.items():
            found[at] |= name in more


def judged(smooth, winners, confidence, flags, least, most):
    """Disparity, confidence and flags of what is accepted; the plane's disparities within their bounds."""
    kept, flags = smooth.copy(), flags.copy()
    disparity, trust = np.full(smooth.shape, np.nan, np.float32), np.zeros(smooth.shape, np.float32)
    for at in np.ndindex(smooth.shape):
        if not np.isnan(smooth[at]):
            kept[at] = min(max(smooth[at], least), most)
        if winners is not None:
            near = abs(float(winners[at]) - float(kept[at])) < 3
            if near and all(not flags[at] >> bit & 1 or 1 << bit in (1, 2, 4, 64) for bit in range(8)):
                flags[at] = 0
            elif not near and flags[at] == 0:
                flags[at] = MISMATCHED
        if flags[at] == 0:
            disparity[at], trust[at] = kept[at], confidence[at]
    return kept, flags, disparity, trust
