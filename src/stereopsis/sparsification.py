"""Sparsification: how well a confidence tells good answers from bad ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from stereopsis.evaluate import FloatMap, Mask, known_pixels

Floats = npt.NDArray[np.float64]

POINTS = 100
"""How many points a curve has."""


@dataclass(frozen=True, eq=False)
class Sparsification:
    """Error against density, as pixels are removed in the order of falling trust.

    Attributes
    ----------
    density : ndarray of float64, (100,)
        Fractions 0.01, 0.02, ... 1 of the answered pixels that are kept; rounded up to whole pixels.
    error : ndarray of float64, (100,)
        Mean error of those of highest confidence.
    ideal : ndarray of float64, (100,)
        Mean error of those of least error: no confidence can stay below.
    auc, ideal_auc : float
        Areas under both curves, the mean over every count of kept pixels from 1 to all.
    """

    density: Floats
    error: Floats
    ideal: Floats
    auc: float
    ideal_auc: float

    @property
    def ause(self) -> float:
        """Area between the curve and the ideal one: 0 is a perfect confidence."""
        return self.auc - self.ideal_auc

    @property
    def random_auc(self) -> float:
        """Area that a confidence without any knowledge gives: the error at full density."""
        return float(self.error[-1])


def sparsification(
    disparity: FloatMap,
    confidence: FloatMap,
    truth: FloatMap,
    measure: str = "bad-1",
    mask: Mask | None = None,
) -> Sparsification:
    r"""Remove pixels in the order of rising confidence, and measure what remains.

    Of pixels of equal confidence each stands for their mean, so that no order among them matters. For the
    fraction :math:`\epsilon` of bad pixels the ideal area tends to
    :math:`\epsilon + (1 - \epsilon) \ln(1 - \epsilon)` as the pixels grow many [1]_.

    Parameters
    ----------
    disparity, truth : ndarray of float32 or float64, (H, W)
        As for `stereopsis.evaluate`. Only pixels of known truth that hold a disparity count.
    confidence : ndarray of float32 or float64, (H, W)
        Any scale; higher is better. May be infinite, but not NaN where it counts.
    measure : str
        "epe", the absolute error in pixels; or "bad-T", such as "bad-1" or "bad-0.5": 1 where the error is
        above T pixels, else 0.
    mask : ndarray of bool, (H, W), optional
        Count only the pixels where it is True.

    Returns
    -------
    Sparsification
        Of no pixels at all, every number is NaN.

    Raises
    ------
    TypeError, ValueError
        As for `stereopsis.evaluate`; for another measure, or a confidence that is NaN.

    References
    ----------
    .. [1] X. Hu, P. Mordohai, A quantitative evaluation of confidence measures for stereo vision, IEEE TPAMI
       34(11), 2012, doi:10.1109/TPAMI.2012.46.

    Examples
    --------
    >>> import numpy as np
    >>> truth = np.array([[10.0, 10, 10, 10]])
    >>> found = np.array([[10.0, 10, 10, 14]])
    >>> curve = sparsification(found, np.array([[0.9, 0.8, 0.7, 0.1]]), truth)
    >>> curve.auc, curve.ideal_auc
    (0.0625, 0.0625)
    """
    bound = _bound(measure)
    known = known_pixels(disparity, truth, mask)
    known_pixels(confidence, truth, None, name="confidence")
    known &= np.isfinite(disparity)
    trust = confidence[known].astype(np.float64)
    if np.isnan(trust).any():
        raise ValueError(f"confidence must not be NaN; it is at {int(np.isnan(trust).sum())} answered pixels")
    errors = np.abs(disparity[known].astype(np.float64) - truth[known].astype(np.float64))
    if bound is not None:
        errors = (errors > bound).astype(np.float64)
    density = np.arange(1, POINTS + 1) / POINTS
    if not errors.size:
        nothing = np.full(POINTS, np.nan)
        return Sparsification(density, nothing, nothing.copy(), np.nan, np.nan)
    _, group, size = np.unique(trust, return_inverse=True, return_counts=True)
    shared = (np.bincount(group, errors) / size)[group]
    order = np.argsort(group, kind="stable")[::-1]
    kept = np.arange(1, errors.size + 1)
    at = -(-kept.size * np.arange(1, POINTS + 1) // POINTS) - 1
    curve, ideal = np.cumsum(shared[order]) / kept, np.cumsum(np.sort(errors)) / kept
    return Sparsification(density, curve[at], ideal[at], float(curve.mean()), float(ideal.mean()))


def _bound(measure: str) -> float | None:
    """Pixels above which an answer is bad; None for the end-point error."""
    if measure == "epe":
        return None
    kind, _, bound = measure.partition("-") if isinstance(measure, str) else ("", "", "")
    try:
        value = float(bound)
    except ValueError:
        value = -1.0
    if kind != "bad" or not 0 <= value < np.inf:
        raise ValueError(f'measure must be "epe" or "bad-T" with T pixels, such as "bad-1", not {measure!r}')
    return value
