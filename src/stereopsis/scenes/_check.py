"""Checks of arguments, one message each."""

from __future__ import annotations

import operator
from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt

DTYPES = (np.dtype(np.uint8), np.dtype(np.uint16), np.dtype(np.float32))


def number(name: str, value: object, low: float, high: float) -> float:
    """Return a float in [low, high], or raise naming the argument."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise TypeError(f"{name} must be a number, not {value!r}")
    result = float(value)
    if not low <= result <= high:  # NaN too
        raise ValueError(f"{name} must be from {low:g} to {high:g}, not {value!r}")
    return result


def integer(name: str, value: object, low: int, high: int) -> int:
    """Return an int in [low, high], or raise naming the argument."""
    if isinstance(value, bool):
        raise TypeError(f"{name} must be an integer, not {value!r}")
    try:
        result = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        raise TypeError(f"{name} must be an integer, not {value!r}") from None
    if not low <= result <= high:
        raise ValueError(f"{name} must be from {low} to {high}, not {result}")
    return result


def two(name: str, value: object, low: float, high: float) -> tuple[float, float]:
    """Return (left, right) from one number or two, each in [low, high]."""
    if isinstance(value, tuple | list):
        if len(value) != 2:
            raise ValueError(f"{name} must be a number or (left, right), not {value!r}")
        return number(name, value[0], low, high), number(name, value[1], low, high)
    both = number(name, value, low, high)
    return both, both


def image_dtype(dtype: npt.DTypeLike) -> np.dtype[Any]:
    """Return the dtype of the images, or raise."""
    result = np.dtype(dtype)
    if result not in DTYPES:
        raise ValueError(f"dtype must be uint8, uint16 or float32, not {result}")
    return result
