"""Quantiles: NumPy's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from stereopsis._numbers import quantile


@given(
    values=some.lists(some.integers(-9, 9), min_size=1, max_size=60),
    scale=some.sampled_from([1, 0.37]),
    share=some.floats(0, 1),
)
def test_quantiles_are_numpy_s(values, scale, share):
    array = np.array(values) * scale
    assert quantile(array, share) == pytest.approx(np.quantile(array, [share])[0], rel=1e-14, abs=1e-14)
    assert quantile(array.reshape(1, -1), share) == quantile(array, share)
