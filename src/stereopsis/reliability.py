"""Reliability: whether a confidence of 0.9 is right nine times in ten."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Reliability:
    """How often answers of like confidence are right.

    Attributes
    ----------
    edges : ndarray of float64, (bins + 1,)
        Of the bins, from 0 to 1; each holds its lower edge, the last one both.
    share : ndarray of float64, (bins,)
        Of all answers; NaN where there are none at all.
    confidence, correct : ndarray of float64, (bins,)
        Mean confidence of the bin's answers, and the fraction of them that is right; NaN where it has none.
    """

    edges: Floats
    share: Floats
    confidence: Floats
    correct: Floats

    @property
    def error(self) -> float:
        """Expected calibration error: mean distance of the two over all answers [1]_.

        .. [1] M. Pakdaman Naeini, G. Cooper, M. Hauskrecht, Obtaining well calibrated probabilities using
           Bayesian binning, AAAI 2015.
        """
        return float(np.nansum(self.share * np.abs(self.confidence - self.correct))) if self.any else np.nan

    @property
    def any(self) -> bool:
        """Whether there are answers."""
        return bool(np.isfinite(self.share).all())


def reliability(confidence: npt.NDArray[Any], correct: npt.NDArray[np.bool_], bins: int = 10) -> Reliability:
    """Sort answers into bins of confidence, and see how many of each are right [1]_.

    Parameters
    ----------
    confidence : ndarray of floats
        In [0, 1]; any shape.
    correct : ndarray of bool, of the same shape
        Which answers are right, such as ``abs(disparity - truth) <= 3``.
    bins : int
        How many of equal width there are.

    Returns
    -------
    Reliability

    Raises
    ------
    TypeError
        If `correct` is not of bool, or `bins` not a whole number.
    ValueError
        If the shapes differ, `bins` is less than 1, or a confidence lies outside [0, 1].

    References
    ----------
    .. [1] A. Niculescu-Mizil, R. Caruana, Predicting good probabilities with supervised learning, ICML 2005,
       doi:10.1145/1102351.1102430.

    Examples
    --------
    >>> import numpy as np
    >>> table = reliability(np.array([0.2, 0.3, 0.9, 0.9]), np.array([False, True, True, True]), bins=2)
    >>> table.confidence.tolist(), table.correct.tolist()
    ([0.25, 0.9], [0.5, 1.0])
    """
    if not isinstance(correct, np.ndarray) or correct.dtype != np.bool_:
        what = getattr(correct, "dtype", type(correct).__name__)
        raise TypeError(f"correct must be an array of bool, not {what}")
    if not isinstance(confidence, np.ndarray) or confidence.dtype.kind != "f":
        what = getattr(confidence, "dtype", type(confidence).__name__)
        raise TypeError(f"confidence must be an array of floats, not {what}")
    if not isinstance(bins, int) or isinstance(bins, bool):
        raise TypeError(f"bins must be a whole number, not {bins!r}")
    if bins < 1:
        raise ValueError(f"bins must be at least 1, not {bins}")
    if confidence.shape != correct.shape:
        raise ValueError(
            f"confidence and correct must have the same shape, not {confidence.shape} and {correct.shape}"
        )
    trust = confidence.ravel().astype(np.float64)
    if not ((trust >= 0) & (trust <= 1)).all():
        raise ValueError("confidence must be from 0 to 1")
    place = np.minimum((trust * bins).astype(np.int64), bins - 1)
    count = np.bincount(place, minlength=bins)
    some = np.where(count > 0, count, np.nan)
    return Reliability(
        np.linspace(0, 1, bins + 1),
        count / trust.size if trust.size else np.full(bins, np.nan),
        np.bincount(place, trust, bins) / some,
        np.bincount(place, correct.ravel(), bins) / some,
    )
