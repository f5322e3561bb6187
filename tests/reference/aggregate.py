"""The definition of aggregation: one sum a window."""

import numpy as np


def box(terms, size):
    width, height = size
    rows, columns = terms.shape[0] - height + 1, terms.shape[1] - width + 1
    return np.array(
        [[terms[y : y + height, x : x + width].sum(axis=(0, 1)) for x in range(columns)] for y in range(rows)]
    )
