"""Score a disparity map against the truth: arrays in, numbers or a picture out."""

from __future__ import annotations

import itertools
import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis import fill
from stereopsis.colormaps import ERROR_COLOURS, UNANSWERED_COLOUR, UNKNOWN_COLOUR

FloatMap = npt.NDArray[np.float32] | npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Measures:
    """Measures over one set of pixels, with :math:`e = |d - d^*|` the absolute error of each in pixels.

    All fractions are in [0, 1]. Over no pixels at all, every measure is NaN.

    Attributes
    ----------
    count : int
        The number of pixels measured.
    within_0_25, within_0_5, within_1, within_2, within_4 : float
        Fraction with an error strictly below so many pixels.
    bad_0_5, bad_1, bad_2, bad_4 : float
        Fraction with an error strictly above so many pixels [1]_. An error equal to the bound is neither
        within it nor bad.
    d1 : float
        Fraction with an error above 3 px and above 5 % of the true disparity's magnitude [2]_.
    epe : float
        Mean absolute error in pixels, the end-point error of a disparity [3]_.
    rmse : float
        Root of the mean squared error in pixels [1]_.
    a50, a90, a95, a99 : float
        Error quantiles in pixels [4]_: the smallest error that at least 50, 90, 95 or 99 % of the pixels
        do not exceed. It is always the error of some pixel; nothing is interpolated.

    References
    ----------
    .. [1] D. Scharstein, R. Szeliski: A taxonomy and evaluation of dense two-frame stereo correspondence
       algorithms. IJCV 2002, doi:10.1023/A:1014573219977.
    .. [2] M. Menze, A. Geiger: Object scene flow for autonomous vehicles. CVPR 2015,
       doi:10.1109/CVPR.2015.7298925.
    .. [3] S. Baker et al.: A database and evaluation methodology for optical flow. IJCV 2011,
       doi:10.1007/s11263-010-0390-2.
    .. [4] D. Scharstein et al.: High-resolution stereo datasets with subpixel-accurate ground truth.
       GCPR 2014, doi:10.1007/978-3-319-11752-2_3.
    """

    count: int
    within_0_25: float
    within_0_5: float
    within_1: float
    within_2: float
    within_4: float
    bad_0_5: float
    bad_1: float
    bad_2: float
    bad_4: float
    d1: float
    epe: float
    rmse: float
    a50: float
    a90: float
    a95: float
    a99: float

    def to_dict(self) -> dict[str, int | float | None]:
        """Name each measure's value, as plain data for JSON: None where it is undefined or infinite."""
        return {name: value if math.isfinite(value) else None for name, value in asdict(self).items()}


@dataclass(frozen=True)
class Scores:
    """How a disparity map compares with the truth.

    Attributes
    ----------
    known : int
        The number of pixels with known truth, inside the mask: those that count.
    answered : int
        How many of them hold a disparity.
    density : float
        ``answered / known``; NaN where nothing is known.
    own : Measures
        Over the answered pixels: how good the answers are.
    all : Measures
        Over all known pixels, an unanswered one having an infinite error: it is within nothing and bad by
        every bound; `epe` and `rmse`, and the quantiles that reach so far, are infinite.
    filled : Measures
        Over all known pixels, after `stereopsis.fill.background`: what the KITTI benchmark ranks by. A pixel
        that cannot be filled has an infinite error.
    """

    known: int
    answered: int
    density: float
    own: Measures
    all: Measures
    filled: Measures

    def to_dict(self) -> dict[str, Any]:
        """Nest everything as plain data for JSON: None where a measure is undefined or infinite."""
        return {
            "known": self.known,
            "answered": self.answered,
            "density": self.density if math.isfinite(self.density) else None,
            "own": self.own.to_dict(),
            "all": self.all.to_dict(),
            "filled": self.filled.to_dict(),
        }

    def rows(self) -> list[tuple[str, str, str, str]]:
        """List the measures for a person's table.

        Returns
        -------
        list of (str, str, str, str)
            Label, and the value at own density, over all known pixels, and filled. Fractions are in per cent,
            errors in pixels; a hyphen stands where a measure is undefined.
        """
        rows = [("pixels", str(self.own.count), str(self.all.count), str(self.filled.count))]
        for label, name, unit in _ROWS:
            own, all_, filled = (_format(getattr(m, name), unit) for m in (self.own, self.all, self.filled))
            rows.append((label, own, all_, filled))
        return rows

    def __str__(self) -> str:
        """Lay the table out as plain text."""
        head = f"density {_format(self.density, '%')} ({self.answered} of {self.known} known pixels)"
        table = [("", "own", "all", "filled"), *self.rows()]
        return "\n".join(
            [head, *(f"{row[0]:10}" + "".join(f"{cell:>12}" for cell in row[1:]) for row in table)]
        )

    def _repr_html_(self) -> str:
        """Show the scores in a notebook."""
        from stereopsis import notebook

        return notebook.scores(self)


_ROWS = (
    ("< 0.25 px", "within_0_25", "%"),
    ("< 0.5 px", "within_0_5", "%"),
    ("< 1 px", "within_1", "%"),
    ("< 2 px", "within_2", "%"),
    ("< 4 px", "within_4", "%"),
    ("bad-0.5", "bad_0_5", "%"),
    ("bad-1", "bad_1", "%"),
    ("bad-2", "bad_2", "%"),
    ("bad-4", "bad_4", "%"),
    ("D1", "d1", "%"),
    ("EPE", "epe", "px"),
    ("RMSE", "rmse", "px"),
    ("A50", "a50", "px"),
    ("A90", "a90", "px"),
    ("A95", "a95", "px"),
    ("A99", "a99", "px"),
)


def evaluate(disparity: FloatMap, truth: FloatMap, mask: Mask | None = None) -> Scores:
    """Score a disparity map at its own density, over all known pixels, and filled.

    Parameters
    ----------
    disparity : ndarray of float32 or float64, (H, W)
        The map to score, in pixels; NaN or infinite where it gives no answer.
    truth : ndarray of float32 or float64, (H, W)
        The true disparity in pixels; NaN or infinite where unknown. Zero and negative values are disparities
        like any other: a file format's mark for "unknown" is the reader's to translate.
    mask : ndarray of bool, (H, W), optional
        Count only the pixels where it is True.

    Returns
    -------
    Scores
        Sums are taken in float64. Pixels with unknown truth, or outside the mask, never count; an answer that
        stands there still fills the holes beside it.

    Raises
    ------
    TypeError
        If an argument is not an array, or has another dtype.
    ValueError
        If an array does not have two dimensions, or the shapes differ.

    Examples
    --------
    >>> import numpy as np
    >>> truth = np.array([[10, 20, np.nan, 40]], np.float32)
    >>> scores = evaluate(np.array([[10.5, np.nan, 7, 44]], np.float32), truth)
    >>> scores.known, scores.answered, scores.own.epe, scores.all.within_1 == 1 / 3
    (3, 2, 2.25, True)
    """
    known = known_pixels(disparity, truth, mask)
    total = int(np.count_nonzero(known))
    own = _Errors.at(known & np.isfinite(disparity), disparity, truth)
    missing = total - own.count
    return Scores(
        known=total,
        answered=own.count,
        density=own.count / total if total else math.nan,
        own=own.measures(),
        all=own.measures(missing),
        filled=_Errors.at(known, fill.background(disparity), truth).measures() if missing else own.measures(),
    )


def error_map(
    disparity: FloatMap, truth: FloatMap, mask: Mask | None = None, *, grow: int = 0
) -> npt.NDArray[np.uint8]:
    """Draw the errors in the logarithmic colours of KITTI.

    The error of a pixel is normalised so that D1 draws its line at 1: the smaller of ``error / 3`` and
    ``error / (0.05 * |truth|)``. Below 1 the colours are blues; from 1 on they run from yellow to dark red.
    Each band spans a factor of two (`ERROR_COLOURS`). Unknown pixels are black, known but unanswered ones
    grey. The colours are ColorBrewer's RdYlBu, chosen to stay apart for people who see colours differently.

    Parameters
    ----------
    disparity, truth : ndarray of float32 or float64, (H, W)
        As for `evaluate`.
    mask : ndarray of bool, (H, W), optional
        Draw as unknown the pixels where it is False.
    grow : int, default 0
        Paint unknown pixels like the nearest known one, up to so many rows and columns away. Sparse truth is
        hard to see without; 1 gives the 3 × 3 of the development kit. A known pixel keeps its own colour.

    Returns
    -------
    ndarray of uint8, (H, W, 3)
        The picture, RGB.

    Raises
    ------
    TypeError, ValueError
        As for `evaluate`; also if `grow` is not a whole number of pixels, 0 or more.

    References
    ----------
    M. Menze, A. Geiger: Object scene flow for autonomous vehicles. CVPR 2015,
    doi:10.1109/CVPR.2015.7298925; the error images of its development kit.
    M. Harrower, C. A. Brewer: ColorBrewer.org. The Cartographic Journal 2003,
    doi:10.1179/000870403235002042.
    """
    known = known_pixels(disparity, truth, mask)
    if not isinstance(grow, int):
        raise TypeError(f"grow must be an int, not {type(grow).__name__}")
    if grow < 0:
        raise ValueError(f"grow must be 0 or more pixels, not {grow}")
    target = truth[known].astype(np.float64)
    errors = _errors(disparity[known], target)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # fmin skips the 0 / 0 of a true disparity of zero met exactly.
        normalised = np.fmin(errors / 3, 20 * errors / np.abs(target))
    bounds = np.array([bound for bound, _ in ERROR_COLOURS[:-1]])
    colours = np.array([colour for _, colour in ERROR_COLOURS], np.uint8)
    picture = np.full((*truth.shape, 3), UNKNOWN_COLOUR, np.uint8)
    picture[known] = colours[np.searchsorted(bounds, normalised, side="right")]
    picture[known & ~np.isfinite(disparity)] = UNANSWERED_COLOUR
    _grow(picture, known, grow)
    return picture


def _grow(picture: npt.NDArray[np.uint8], known: Mask, reach: int) -> None:
    """Paint unknown pixels like the nearest known one within reach, in place."""
    height, width = known.shape
    wide, wide_known = np.pad(picture, ((reach, reach), (reach, reach), (0, 0))), np.pad(known, reach)
    steps = itertools.product(range(-reach, reach + 1), repeat=2)
    for dy, dx in sorted(steps, key=lambda step: math.hypot(*step)):
        shifted = np.s_[reach + dy : reach + dy + height, reach + dx : reach + dx + width]
        new = wide_known[shifted] & ~known
        picture[new] = wide[shifted][new]
        known = known | new


def known_pixels(disparity: FloatMap, truth: FloatMap, mask: Mask | None, name: str = "disparity") -> Mask:
    """Check the arguments, the first of which messages call `name`, and find the pixels that count."""
    for argument, value in ((name, disparity), ("truth", truth)):
        if not isinstance(value, np.ndarray):
            raise TypeError(f"{argument} must be an array, not {type(value).__name__}")
        if value.dtype not in (np.float32, np.float64):
            raise TypeError(f"{argument} must be float32 or float64, in pixels, not {value.dtype}")
        if value.ndim != 2:
            raise ValueError(f"{argument} must be (H, W), not of shape {value.shape}")
    if disparity.shape != truth.shape:
        raise ValueError(f"{name} and truth must have one shape, not {disparity.shape} and {truth.shape}")
    if mask is None:
        return np.isfinite(truth)
    if not isinstance(mask, np.ndarray):
        raise TypeError(f"mask must be an array of bool or None, not {type(mask).__name__}")
    if mask.dtype != np.bool_:
        raise TypeError(f"mask must be bool, True where a pixel counts, not {mask.dtype}")
    if mask.shape != truth.shape:
        raise ValueError(f"mask must have the shape of truth, {truth.shape}, not {mask.shape}")
    return mask & np.isfinite(truth)


def _errors(answers: FloatMap, target: FloatMap) -> npt.NDArray[np.float64]:
    """Absolute errors; infinite where there is no answer."""
    with np.errstate(over="ignore"):
        errors = np.subtract(answers, target, dtype=np.float64)
    np.abs(errors, out=errors)
    errors[np.isnan(errors)] = np.inf
    return errors


@dataclass(frozen=True)
class _Errors:
    """Absolute errors in order, and what needs their pixels: how many are outliers, and their means."""

    ordered: npt.NDArray[np.float64]
    outliers: int
    mean: float
    mean_square: float

    @classmethod
    def at(cls, pixels: Mask, disparity: FloatMap, truth: FloatMap) -> _Errors:
        # By their numbers pixels are taken several times as fast as by a mask.
        places = np.flatnonzero(pixels)
        target = truth.take(places)
        errors = _errors(disparity.take(places), target)
        if not errors.size:
            return cls(errors, 0, math.nan, math.nan)
        far = np.flatnonzero(errors > 3)
        bounds = 0.05 * np.abs(target.take(far).astype(np.float64))
        outliers = int(np.count_nonzero(errors.take(far) > bounds))
        with np.errstate(over="ignore"):
            mean, mean_square = float(np.mean(errors)), float(np.mean(errors * errors))
        errors.sort()
        return cls(errors, outliers, mean, mean_square)

    @property
    def count(self) -> int:
        return self.ordered.size

    def measures(self, missing: int = 0) -> Measures:
        """Measures over these errors and so many infinite ones."""
        n = self.count + missing
        if n == 0:
            return Measures(0, *[math.nan] * 16)

        def within(bound: float) -> float:
            return int(np.searchsorted(self.ordered, bound, side="left")) / n

        def bad(bound: float) -> float:
            return (n - int(np.searchsorted(self.ordered, bound, side="right"))) / n

        def quantile(percent: int) -> float:
            place = -(-n * percent // 100) - 1
            return float(self.ordered[place]) if place < self.count else math.inf

        return Measures(
            count=n,
            within_0_25=within(0.25),
            within_0_5=within(0.5),
            within_1=within(1),
            within_2=within(2),
            within_4=within(4),
            bad_0_5=bad(0.5),
            bad_1=bad(1),
            bad_2=bad(2),
            bad_4=bad(4),
            d1=(self.outliers + missing) / n,
            epe=math.inf if missing else self.mean,
            rmse=math.inf if missing else math.sqrt(self.mean_square),
            a50=quantile(50),
            a90=quantile(90),
            a95=quantile(95),
            a99=quantile(99),
        )


def _format(value: float, unit: str) -> str:
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "inf"
    return f"{100 * value:.2f} %" if unit == "%" else f"{value:.3f} px"
