"""Images of 8 bits that came in a wider type, and the bytes in them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from stereopsis import pixelwise, sgm
from stereopsis.cost import FRACTION
from stereopsis.settings import NCC, ZNCC, Settings
from stereopsis.supports import Gaussian
from stereopsis.types import Image

WHITE = 257
"""What 8 bits are multiplied by to fill 16."""

ROUNDED = 1e-6
"""By which part of it single precision leaves a pixel off its whole multiple of `FRACTION` at most."""

FEW = 61
"""Every so many-th pixel of so many rows is looked at first: most images that are no bytes show it there."""


def wanted(settings: Settings) -> bool:
    """Whether the cost does not depend on gain, and nothing asks for finer images than bytes are."""
    blind = isinstance(settings.cost, NCC | ZNCC | pixelwise.Census | pixelwise.Rank)
    boxes = settings.cost.support is None or isinstance(settings.cost.support, Gaussian)
    plain = settings.optimize is None or isinstance(settings.optimize, sgm.SGM)
    return blind and boxes and plain and settings.upsample is None


def of(images: Iterable[Image]) -> float | None:
    """The step of which all pixels are whole multiples, 0 to 255 times, in the images' own grey levels.

    Parameters
    ----------
    images : iterable of ndarray, uint8, uint16 or float32
        Of one dtype: a pair, or parts of one that hold all its pixels.

    Returns
    -------
    float or None
        Of uint16 images 257 or a power of two, of float32 images 1 / 255 or 1. None: there is none, or they
        are bytes.
    """
    bits, white, steps = 0, True, [FRACTION, 1.0]
    for image in images:
        if image.dtype == np.uint8:
            return None
        for some in (image[::FEW, ::FEW], image):
            if image.dtype == np.uint16:
                bits |= int(np.bitwise_or.reduce(some, axis=None))
                white = white and not np.any(some % np.uint16(WHITE))
                if not white and bits > 255 * _lowest(bits):
                    return None
                steps = [float(WHITE if white else _lowest(bits))]
            else:
                steps = [step for step in steps if _holds(some, step)]
                if not steps:
                    return None
    return steps[0]


def in_bytes(image: Image, step: float) -> npt.NDArray[np.uint8]:
    """The image, counted in such steps."""
    if image.dtype == np.uint16:
        return (image // np.uint16(step)).astype(np.uint8)
    return np.rint(image / np.float32(step)).astype(np.uint8)


def _lowest(bits: int) -> int:
    """The lowest of the bits; 1 of none."""
    return bits & -bits or 1


def _holds(image: npt.NDArray[np.float32], step: float) -> bool:
    steps = image / np.float64(step)
    close = np.abs(steps - np.rint(steps)) <= (ROUNDED * steps if step < 1 else 0)
    return bool(close.all() and steps.min() >= 0 and steps.max() < 255.5)
