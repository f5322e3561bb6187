"""The definition of sharpening, a pixel at a time, in whole numbers."""

import numpy as np

WEIGHTS = np.outer((1, 4, 6, 4, 1), (1, 4, 6, 4, 1))


def sharpened(image, sixtyfourths):
    padded = np.pad(image.astype(np.int64), ((2, 2), (2, 2), (0, 0)), "edge")
    sharp = np.empty_like(image)
    for y, x, channel in np.ndindex(image.shape):
        around = int((WEIGHTS * padded[y : y + 5, x : x + 5, channel]).sum())
        own = 256 * int(image[y, x, channel])
        value = (64 * own + sixtyfourths * (own - around) + 2**13) // 2**14
        sharp[y, x, channel] = min(255, max(0, value)) if image.dtype == np.uint8 else value
    return sharp


def steps(image, apart_columns):
    near = far = 0
    for y in range(image.shape[0] - 2):
        for x in range(0, image.shape[1], apart_columns):
            for channel in range(image.shape[2]):
                own, below, next_but_one = (int(image[y + dy, x, channel]) for dy in range(3))
                near += (below - own) ** 2
                far += (next_but_one - own) ** 2
    return near, far
