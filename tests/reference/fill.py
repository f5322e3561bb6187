"""The definition of the fillings, a pixel at a time."""

import math

import numpy as np


def background(disparity):
    height, width = disparity.shape
    filled = disparity.copy()
    for y in range(height):
        row = [float(value) for value in disparity[y]]
        for x in range(width):
            left = next((row[i] for i in range(x, -1, -1) if math.isfinite(row[i])), math.inf)
            right = next((row[i] for i in range(x, width) if math.isfinite(row[i])), math.inf)
            nearer_the_horizon = min(left, right)
            filled[y, x] = nearer_the_horizon if math.isfinite(nearer_the_horizon) else np.nan
    rows = [y for y in range(height) if any(math.isfinite(value) for value in disparity[y])]
    for y in range(height):
        if rows and y < rows[0]:
            filled[y] = filled[rows[0]]
        if rows and y > rows[-1]:
            filled[y] = filled[rows[-1]]
    return filled
