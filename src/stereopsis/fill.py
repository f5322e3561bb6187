"""Fill invalid pixels from their neighbours."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from stereopsis import _core
from stereopsis.smooth import FILL_STRENGTH, edge_tables, guide_of
from stereopsis.types import WHOLE, DisparityMap, Flag, Halo

Float = TypeVar("Float", bound=np.floating[Any])


ALONG_ROWS = Halo(left=WHOLE, right=WHOLE)
"""What `background` depends on: the row, but where a row holds no answer at all."""
ALL_AROUND = Halo.around(WHOLE, 128)
"""What the other ways to fill depend on, but where no answer lies so near above or below."""


def background(disparity: npt.NDArray[Float], threads: int = 1) -> npt.NDArray[Float]:
    """Fill every hole with the farther of its two neighbours on the row, as the KITTI development kit does.

    A hole is a run of invalid pixels on a row. Between two answered pixels it takes the smaller of their
    disparities, because what only one camera sees belongs to the background. At either end of a row it takes
    the nearest answer. Then the rows without any answer above the first answered row, or below the last,
    repeat that row. A row without any answer between answered rows stays invalid, as does a map without any.

    Parameters
    ----------
    disparity : ndarray of float32 or float64, (H, W)
        Disparity in pixels; NaN or infinite where invalid. Not changed.
    threads : int
        0: all cores.

    Returns
    -------
    ndarray, (H, W)
        A filled copy of the same dtype; NaN where nothing could be filled.

    Raises
    ------
    TypeError
        If `disparity` is not an array of float32 or float64.
    ValueError
        If `disparity` does not have two dimensions.

    References
    ----------
    A. Geiger, P. Lenz, R. Urtasun: Are we ready for autonomous driving? The KITTI vision benchmark suite.
    CVPR 2012, doi:10.1109/CVPR.2012.6248074; the background interpolation of its development kit.
    """
    if not isinstance(disparity, np.ndarray):
        raise TypeError(f"disparity must be an array, not {type(disparity).__name__}")
    if disparity.dtype not in (np.float32, np.float64):
        raise TypeError(f"disparity must be float32 or float64, not {disparity.dtype}")
    if disparity.ndim != 2:
        raise ValueError(f"disparity must be (H, W), not of shape {disparity.shape}")
    filled = np.empty(disparity.shape, disparity.dtype)
    if disparity.size:
        _core.background(np.ascontiguousarray(disparity), filled, threads)
    return filled


OCCLUDED = Flag.OCCLUDED | Flag.OUT_OF_VIEW
"""What only the left camera sees: it continues what lies behind."""


def interpolate(disparity: DisparityMap, flags: npt.NDArray[np.uint8]) -> DisparityMap:
    """Fill every hole from the nearest answers in eight directions, by Hirschmueller's rules [1]_.

    A pixel that only the left camera sees (`Flag.OCCLUDED`, `Flag.OUT_OF_VIEW`) takes the second lowest of
    them: what hides it must not be continued. Any other takes their median, of an even number the mean of
    the middle two. A pixel that no direction leads to an answer from stays NaN.

    Parameters
    ----------
    disparity : ndarray of float32, (H, W)
        Disparity in pixels; NaN where invalid. Not changed.
    flags : ndarray of uint8, (H, W)
        Bits of `Flag` that say why.

    Returns
    -------
    ndarray of float32, (H, W)

    References
    ----------
    .. [1] H. Hirschmueller, Stereo processing by semiglobal matching and mutual information, IEEE TPAMI
       30(2), 2008, section 2.6, doi:10.1109/TPAMI.2007.1166.
    """
    filled = np.empty(disparity.shape, np.float32)
    _core.interpolate(np.ascontiguousarray(disparity), _occluded(flags), filled)
    return filled


def surfaces(
    disparity: DisparityMap,
    flags: npt.NDArray[np.uint8],
    image: npt.NDArray[Any],
    threads: int = 0,
) -> DisparityMap:
    r"""Fill every hole by continuing the surfaces around it, slanted as they are.

    How much the disparity rises from a pixel to the next is measured where neighbours, or both ends of a hole
    of k pixels, differ by at most ``1.5 + k / 2`` pixels, and smoothed along the image's edges. With these
    slopes the nearest answers to the left, to the right, above and below are continued to each missing pixel.

    - Where they agree, within 12 pixels or, for what only the left camera sees, within 8, one surface
      surrounds the hole: the pixel takes the weighted least-squares surface through all answers around
      (`stereopsis.smooth.edge_aware` with `stereopsis.smooth.FILL_STRENGTH`).
    - Else it takes the lower one of left and right, as in `background`; on a row without answers, of above
      and below.

    Nothing is answered beyond the least and the greatest disparity of the map. A map without any answer stays
    as it is.

    Parameters
    ----------
    disparity : ndarray of float32, (H, W)
        Disparity in pixels; NaN where invalid. Not changed.
    flags : ndarray of uint8, (H, W)
        Bits of `Flag` that say why.
    image : ndarray of uint8 or int32, (H, W, C)
        The left image.
    threads : int

    Returns
    -------
    ndarray of float32, (H, W)

    References
    ----------
    D. Min, S. Choi, J. Lu, B. Ham, K. Sohn, M. N. Do, Fast global image smoothing based on weighted least
    squares, IEEE TIP 23(12), 2014, doi:10.1109/TIP.2014.2366600.
    """
    filled = np.empty(disparity.shape, np.float32)
    # Without a selection, of a map without infinity: NaN where there is no answer at all.
    least, most = (ends.reduce(disparity, axis=None, initial=np.nan) for ends in (np.fmin, np.fmax))
    if not (np.isfinite(least) and np.isfinite(most)):
        answers = disparity[np.isfinite(disparity)]
        least, most = (answers.min(), answers.max()) if answers.size else (0, 0)
    _core.fill_surfaces(
        np.ascontiguousarray(disparity),
        _occluded(flags),
        guide_of(image),
        edge_tables(image),
        FILL_STRENGTH,
        float(least),
        float(most),
        filled,
        threads,
    )
    return filled


def nearer(
    disparity: DisparityMap,
    doubtful: npt.NDArray[np.bool_] | npt.NDArray[np.uint8],
    again: DisparityMap,
    threads: int = 0,
) -> DisparityMap:
    """Of two fillings the nearer, though the second only as far as the ends of the hole on its row allow.

    Holes are mostly filled too far: what is behind is what their rules continue, and what passed a check by
    accident. On each run of doubtful pixels on a row the second filling is kept between the disparities of
    its two ends, or to that of its one; where it is nearer than the first one then, it stands. A row without
    any other pixel stays as it is.

    Parameters
    ----------
    disparity : ndarray of float32, (H, W)
        As it was filled first, in pixels; NaN where there is none. Not changed.
    doubtful : ndarray of bool or uint8, (H, W)
        What was filled; not 0 where so.
    again : ndarray of float32, (H, W)
        As it is filled from what is not doubtful; NaN where that was of no avail.
    threads : int
        0: all cores.

    Returns
    -------
    ndarray of float32, (H, W)
    """
    found = np.empty(disparity.shape, np.float32)
    doubted = np.ascontiguousarray(doubtful, np.uint8)
    _core.nearer(np.ascontiguousarray(disparity), doubted, np.ascontiguousarray(again), found, threads)
    return found


ALIKE = np.rint(4096 * np.exp(np.arange(256) / -12)).astype(np.int32)
"""Weight of a vote by the difference of grey levels."""
OUTLINES_HALO = Halo.around(12)
"""What `outlines` depends on."""
UNFATTEN_HALO = Halo.around(15)
"""What `unfatten` depends on, but for what the pixels therein meet in the right image."""


def outlines(
    disparity: DisparityMap,
    doubtful: npt.NDArray[np.bool_] | npt.NDArray[np.uint8],
    image: npt.NDArray[np.uint8],
    threads: int = 0,
) -> DisparityMap:
    r"""Give what was filled beside an outline back to the nearer surface, where it looks like it.

    A check of left against right refuses a seam along every outline, and what fills it is the background. It
    is decided anew for doubtful pixels within 2 pixels of a jump, which is where 3 x 3 pixels span more than
    4 pixels of disparity. Let :math:`n` and :math:`f` be the greatest and the least disparity within 3
    pixels. Of the pixels that are not doubtful, every fourth of every fourth row up to 12 pixels off, those
    within :math:`(n - f) / 3` of :math:`n` vote for :math:`n`, and those as near to :math:`f` for :math:`f`,
    with weights :math:`\exp(-\max |\Delta I| / 12)`, in 4096ths, the largest difference of the channels, akin
    to [1]_. Where more weight is for :math:`n` the pixel becomes :math:`n`; else it stays.

    Parameters
    ----------
    disparity : ndarray of float32, (H, W)
        Disparity in pixels; NaN where there is none. Not changed.
    doubtful : ndarray of bool or uint8, (H, W)
        What may change, and has no vote; not 0 where so.
    image : ndarray of uint8, (H, W) or (H, W, C)
        The left image :math:`I`.
    threads : int
        0: all cores.

    Returns
    -------
    ndarray of float32, (H, W)

    References
    ----------
    .. [1] X. Mei, X. Sun, M. Zhou, S. Jiao, H. Wang, X. Zhang, On building an accurate stereo matching system
       on graphics hardware, ICCV Workshops 2011, doi:10.1109/ICCVW.2011.6130280; votes of a region.
    """
    moved = np.empty(disparity.shape, np.float32)
    _core.outlines(
        np.ascontiguousarray(disparity),
        np.ascontiguousarray(doubtful, np.uint8),
        np.ascontiguousarray(image if image.ndim == 3 else image[..., np.newaxis]),
        ALIKE,
        moved,
        threads,
    )
    return moved


def unfatten(
    disparity: DisparityMap,
    doubtful: npt.NDArray[np.bool_] | npt.NDArray[np.uint8],
    views: tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]],
    image: npt.NDArray[np.uint8],
    threads: int = 0,
) -> DisparityMap:
    r"""Give what a window has added to a near surface back to what lies behind.

    Windows that see an outline match as it does, on either side: near things grow by up to half a window.
    What matches better behind is moved there, akin to [1]_. It is decided for pixels within 2 pixels of a
    jump, which is where 3 x 3 pixels span more than 2 pixels of disparity. Let :math:`n` and :math:`f` be the
    greatest and the least disparity within 3 pixels, and :math:`e(d)` how far the gradients of both views,
    :math:`(\partial_x, \partial_y)` in grey levels a pixel, are apart with disparity :math:`d` in sixteenths
    of a pixel, the sum of both components, at most 10. A pixel nearer to :math:`n` becomes :math:`f` where

    .. math:: \sum_q w_q (e_q(n_q) - e_q(f_q)) + 15 \sum_v w_v s_v > 15,

    :math:`q` the pixels beside jumps of the 5 x 5 around; :math:`v` every fourth pixel of three rows, 4 rows
    apart, up to 12 pixels off, that is neither doubtful nor beside a jump; :math:`s_v` 1 where its disparity
    is within :math:`(n - f) / 3` of :math:`f`, -1 where as near to :math:`n`; and
    :math:`w = \exp(-\max |\Delta I| / 12)`, in 4096ths, the largest difference of the channels.

    Parameters
    ----------
    disparity : ndarray of float32, (H, W)
        Disparity in pixels; NaN where there is none. Not changed.
    doubtful : ndarray of bool or uint8, (H, W)
        What has no vote; not 0 where so.
    views : two ndarrays of uint8, (H, W)
        Grey levels of the left and the right view.
    image : ndarray of uint8, (H, W) or (H, W, C)
        The left image :math:`I`.
    threads : int
        0: all cores.

    Returns
    -------
    ndarray of float32, (H, W)

    References
    ----------
    .. [1] H. Hirschmueller, P. R. Innocent, J. Garibaldi, Real-time correlation-based stereo vision with
       reduced border errors, International Journal of Computer Vision 47, 2002,
       doi:10.1023/A:1014554110407; the correction of borders.
    """
    moved = np.empty(disparity.shape, np.float32)
    _core.unfatten(
        np.ascontiguousarray(disparity),
        np.ascontiguousarray(doubtful, np.uint8),
        np.ascontiguousarray(views[0]),
        np.ascontiguousarray(views[1]),
        np.ascontiguousarray(image if image.ndim == 3 else image[..., np.newaxis]),
        ALIKE,
        moved,
        threads,
    )
    return moved


def _occluded(flags: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    return np.ascontiguousarray(flags & np.uint8(OCCLUDED))
