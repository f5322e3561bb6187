"""The definition of an image's black border, a pixel at a time."""

import math

import numpy as np


def border(image, least, few, dark, noisy, most, blended):
    """First place and end of what every row, and every column, shows; None where there is no border."""
    pixels = image.reshape(*image.shape[:2], -1)
    black = [[not pixels[y, x].any() for x in range(pixels.shape[1])] for y in range(pixels.shape[0])]
    dim = [
        [all(value <= dark * float(image.max()) for value in pixels[y, x]) for x in range(pixels.shape[1])]
        for y in range(pixels.shape[0])
    ]
    across = lines(black, dim, few, noisy, most, blended)
    down = lines(list(zip(*black, strict=True)), list(zip(*dim, strict=True)), 1, noisy, most, blended)
    if all(all(line) for line in black) or max(across[0] + down[0]) < least:
        return None
    found = across[1], down[1]
    return None if any(all(end == 0 for _, end in ends) for ends in found) else found


def lines(black, dim, few, noisy, most, blended):
    """Which share of both sides is black, in every few-th line; and the ends of every line."""
    length = len(black[0])
    both = [(line, row) for line, row in zip(black, dim, strict=True)]
    turned = [(line[::-1], row[::-1]) for line, row in both]
    shares, firsts = [], []
    for one in both, turned:
        shares.append(sum(line[0] for line, _ in one[::few]) / len(one[::few]))
        bordered = sum(line[0] or row[0] for line, row in one) / len(one) >= most
        found = []
        for line, row in one:
            first = next((x for x in range(length) if not line[x]), length)
            if bordered or first > 0:
                more = 0
                while more < noisy and row[min(first + more, length - 1)]:
                    more += 1
                first += more
            found.append(first + blended if first > 0 else 0)
        firsts.append(found)
    ends = [(a, length - b) if a < length - b else (0, 0) for a, b in zip(*firsts, strict=True)]
    return shares, ends


def blank(rows, columns):
    found = np.zeros((len(rows), len(columns)), bool)
    for y, x in np.ndindex(found.shape):
        found[y, x] = not (rows[y][0] <= x < rows[y][1] and columns[x][0] <= y < columns[x][1])
    return found


def continued(image, rows, columns):
    whole, hidden = image.copy(), blank(rows, columns)
    shown = [y for y, (_, end) in enumerate(rows) if end]
    for y, x in zip(*np.nonzero(hidden), strict=True):
        row = y
        if rows[y][1] == 0 and columns[x][1] == 0 and shown:
            row = min(max(y, shown[0]), shown[-1])
        across, column = nearest(x, *rows[row])
        down, above = nearest(row, *columns[x])
        if min(across, down) < math.inf:
            whole[y, x] = image[row, column] if across < down else image[above, x]
    return whole


def nearest(at, first, end):
    """How far off the nearest place between the ends is, and which; infinitely, if `at` lies between them."""
    if first == end or first <= at < end:
        return math.inf, at
    return (first - at, first) if at < first else (at - end + 1, end - 1)


def hidden(disparity, here, there, sign):
    found = np.zeros(disparity.shape, bool)
    for (y, x), d in np.ndenumerate(disparity):
        match = 0 if math.isnan(d) else math.floor(np.float32(x) - np.float32(sign) * d + np.float32(0.5))
        match = min(max(match, 0), disparity.shape[1] - 1)
        points = there is not None and not math.isnan(d) and there[y, match]
        found[y, x] = points or (here is not None and here[y, x])
    return found
