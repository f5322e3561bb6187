"""What counts as a number among the values of a setting, and quantiles."""

from __future__ import annotations

import math
import numbers
from typing import Any

import numpy as np
import numpy.typing as npt


def is_whole(value: Any) -> bool:
    """Whether it is a whole number by type; bools are none."""
    # Most are plain, and an abstract class takes ten times as long to ask.
    return type(value) is int or (isinstance(value, numbers.Integral) and not isinstance(value, bool))


def is_number(value: Any) -> bool:
    """Whether it is a finite real number; bools are none."""
    try:
        return isinstance(value, numbers.Real) and not isinstance(value, bool) and math.isfinite(value)
    except OverflowError:  # a whole number larger than any float
        return False


def quantile(values: npt.NDArray[Any], share: float) -> float:
    """As `numpy.quantile` has it, in a fraction of the time.

    And without `numpy.unique` on the way: a daemon thread in there, while the interpreter ends, would end the
    process (NumPy 2.3).
    """
    place = share * (values.size - 1)
    first = min(int(place), max(0, values.size - 2))
    split = np.partition(values, first, axis=None)
    before = float(split[first])
    after = float(split[first + 1 :].min()) if values.size > 1 else before
    part = place - first
    return before + (after - before) * part if part < 0.5 else after - (after - before) * (1 - part)
