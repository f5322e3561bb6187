"""OpenCV's matchers with the settings that their users know; its only importer."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stereopsis import _extras, cost
from stereopsis.types import Disparities, DisparityMap, Pair

Bytes = npt.NDArray[np.uint8]
Compute = Callable[[Bytes, Bytes], npt.NDArray[Any]]
LARGEST_DIFFERENCE = 1.0
"""Of the left-right check, in pixels."""


class Peer(NamedTuple):
    """One row of a table.

    Attributes
    ----------
    name : str
    make : callable
        From a module ``cv2``, a smallest disparity, a number of disparities, and whether the map is filtered,
        to what computes a map.
    checked : bool
        Whether an unfiltered map of the right image is computed too, and what disagrees with it left out.
    """

    name: str
    make: Callable[[Any, int, int, bool], Compute]
    checked: bool = False


def _block_matcher(cv2: Any, least: int, count: int, filtered: bool) -> Compute:
    matcher = cv2.StereoBM_create(numDisparities=count, blockSize=21)
    matcher.setMinDisparity(least)
    return _with_filters(matcher, 31, filtered)


def _semi_global(mode: str, p1: int, p2: int, cap: int) -> Callable[[Any, int, int, bool], Compute]:
    def make(cv2: Any, least: int, count: int, filtered: bool) -> Compute:
        area = 5**2
        way = getattr(cv2, f"STEREO_SGBM_MODE_{mode}")
        matcher = cv2.StereoSGBM_create(least, count, 5, P1=p1 * area, P2=p2 * area, mode=way)
        return _with_filters(matcher, cap, filtered)

    return make


def _with_filters(matcher: Any, cap: int, filtered: bool) -> Compute:
    matcher.setPreFilterCap(cap)
    matcher.setUniquenessRatio(10 if filtered else 0)
    matcher.setDisp12MaxDiff(1 if filtered else 1_000_000)
    matcher.setSpeckleWindowSize(100 if filtered else 0)
    matcher.setSpeckleRange(2)
    compute: Compute = matcher.compute
    return compute


BLOCK = Peer("StereoBM 21", _block_matcher)
THREE_WAYS = Peer("StereoSGBM 3WAY 5", _semi_global("SGBM_3WAY", 8, 32, 31))
CHECKED = Peer("StereoSGBM 3WAY 5, checked", _semi_global("SGBM_3WAY", 24, 96, 63), checked=True)
EIGHT_WAYS = Peer("StereoSGBM HH 5", _semi_global("HH", 8, 32, 31))
PEERS = (BLOCK, THREE_WAYS, CHECKED, EIGHT_WAYS)
"""Block 5, P1 = 8 block², P2 = 32 block², pre-filter cap 31, as OpenCV's documentation has them; the checked
one with 24, 96 and 63, as its sample of disparity filtering.
Filters: uniqueness 10 %, disp12MaxDiff 1, speckle 100.
"""


def require() -> None:
    """Raise ModuleNotFoundError, which names the extra, where OpenCV is not installed."""
    instead = ", or leave it out with --no-opencv"
    _extras.require("comparing with OpenCV needs", "bench", "cv2", instead=instead)


def version() -> str:
    """OpenCV's."""
    import cv2

    return str(cv2.__version__)


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Hold OpenCV to so many threads meanwhile; 0: as many as there are cores."""
    import cv2

    before = cv2.getNumThreads()
    cv2.setNumThreads(count or -1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


def match(pair: Pair, peer: Peer, disparities: Disparities) -> DisparityMap:
    """Match a pair as one that knows OpenCV would: no border lost, and NaN where it has no answer.

    Parameters
    ----------
    pair : Pair
        Colour is matched on its grey values; other images than 8-bit ones are scaled to that.
    peer : Peer
    disparities : Disparities
        Rounded up to the multiple of 16 that OpenCV asks for.

    Returns
    -------
    ndarray of float32, (H, W)

    Raises
    ------
    ValueError
        What OpenCV complains of.
    """
    import cv2

    left, right = _bytes(pair)
    least, count = disparities.min, _count(disparities)
    try:
        found = _whole(_maker(peer, disparities, True), left, right, least, count)
        if peer.checked:
            other = _maker(peer, disparities, False)
            mirrored = _whole(other, _mirrored(right), _mirrored(left), least, count)
            found[~_agree(found, mirrored[:, ::-1])] = np.nan
    except cv2.error as error:
        raise ValueError(f"OpenCV: {' '.join(str(error).split())}") from None
    return found


def task(pair: Pair, peer: Peer, disparities: Disparities) -> Callable[[], object]:
    """OpenCV's own call on one thread and nothing else, for timing."""
    left, right = _bytes(pair)
    compute = _maker(peer, disparities, True)

    def call() -> object:
        with threads(1):
            return compute(left, right)

    return call


def _maker(peer: Peer, disparities: Disparities, filtered: bool) -> Compute:
    import cv2

    return peer.make(cv2, disparities.min, _count(disparities), filtered)


def _count(disparities: Disparities) -> int:
    return -(-disparities.span // 16) * 16


def _bytes(pair: Pair) -> tuple[Bytes, Bytes]:
    pixels = cost.pixels(pair.left, pair.right)
    left, right = pixels.left[..., 0], pixels.right[..., 0]
    if left.dtype == np.uint8:
        return left, right
    low, high = float(min(left.min(), right.min())), float(max(left.max(), right.max()))
    scaled = [
        np.rint((image - low) * (255 / max(high - low, 1.0))).astype(np.uint8) for image in (left, right)
    ]
    return scaled[0], scaled[1]


def _whole(compute: Compute, left: Bytes, right: Bytes, least: int, count: int) -> DisparityMap:
    """Both images are widened by the range, which OpenCV would else cut from the map's sides."""
    before, after = max(0, least + count), max(0, -least)
    wide = [np.pad(image, ((0, 0), (before, after)), "edge") for image in (left, right)]
    sixteenths = compute(wide[0], wide[1])[:, before : before + left.shape[1]]
    found: DisparityMap = (sixteenths / 16.0).astype(np.float32)
    found[sixteenths < 16 * least] = np.nan
    return found


def _mirrored(image: Bytes) -> Bytes:
    return np.ascontiguousarray(image[:, ::-1])


def _agree(left: DisparityMap, right: DisparityMap) -> npt.NDArray[np.bool_]:
    columns = np.arange(left.shape[1])
    with np.errstate(invalid="ignore"):
        there = np.rint(columns - np.nan_to_num(left)).astype(np.intp)
        inside = (there >= 0) & (there < left.shape[1])
        other = np.take_along_axis(right, np.clip(there, 0, left.shape[1] - 1), axis=1)
        agree: npt.NDArray[np.bool_] = inside & (np.abs(left - other) <= LARGEST_DIFFERENCE)
    return agree
