"""From a pair to a disparity map: the page to read first.

read → cost → aggregate → select → validate → refine → fill → write
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final, cast

import numpy as np
import numpy.typing as npt

from stereopsis import _fused, aggregate, cost, fill, noise, refine, select, settings, sky, validate
from stereopsis.settings import Settings
from stereopsis.types import Disparities, DisparityMap, Flag, Image, Pair, Result

COMPOSED_ONLY = frozenset({"costs", "right_disparity"})
"""What only the composed path can keep."""


class _Unset:
    def __repr__(self) -> str:
        return "<as the preset has it>"


UNSET: Final[Any] = _Unset()


def match(
    left: Pair | Image,
    right: Image | None = None,
    *,
    settings: Settings | None = None,
    preset: str | None = None,
    disparities: tuple[int, int] | None = UNSET,
    cost: settings.Cost | str = UNSET,
    channels: str = UNSET,
    subpixel: str | None = UNSET,
    left_right: float | None = UNSET,
    uniqueness: float | None = UNSET,
    texture: float | str | None = UNSET,
    reflection: float | None = UNSET,
    sky: bool = UNSET,
    median: int | None = UNSET,
    speckle: tuple[int, float] | int | None = UNSET,
    fill: str | None = UNSET,
    threads: int = UNSET,
    keep: tuple[str, ...] = UNSET,
) -> Result:
    """Match a rectified pair.

    With neither `settings`, `preset` nor `cost`, the preset "fast" is used. With a `cost` and no preset, no
    check and no filter is on: the plain winner and its sub-pixel fit. Whatever else is given changes that.

    Parameters
    ----------
    left : Pair, or ndarray of shape (H, W) or (H, W, 3)
        A pair, or its left image: uint8, uint16 or float32, of any strides. Never changed.
    right : ndarray, optional
        The right image, of the left one's shape and dtype.
    settings : Settings, optional
        Start from these.
    preset : str, optional
        Start from these: a name in `stereopsis.settings.PRESETS`.
    disparities : (int, int), optional
        Candidates ``min, ..., max - 1`` in pixels; any whole numbers. None: estimated from the images alone.
    cost, channels, subpixel, left_right, uniqueness, texture, reflection, sky, median, speckle, fill,
    threads, keep
        As in `Settings`.

    Returns
    -------
    Result

    Raises
    ------
    ValueError
        For images of different or unsuitable shape, images with NaN or infinity, or a setting that is not
        allowed.
    TypeError
        For images of another dtype.

    Notes
    -----
    A candidate counts for a pixel where its match lies inside the right image; windows that reach over an
    image's edge see the edge pixel repeated. A pixel none of whose candidates lies inside is NaN, with
    `Flag.OUT_OF_VIEW`. Of equal costs the smallest disparity wins. The result does not depend on the number
    of threads or on the instruction set.

    Examples
    --------
    >>> import stereopsis as st
    >>> scene = st.scenes.plane(96, 64, disparity=7.25)
    >>> result = st.match(scene.left, scene.right, disparities=(0, 16), cost=st.ZNCC(window=11))
    >>> result.disparity.shape
    (64, 96)
    """
    start = time.perf_counter()
    changes = {
        name: value
        for name, value in (
            ("disparities", disparities),
            ("cost", cost),
            ("channels", channels),
            ("subpixel", subpixel),
            ("left_right", left_right),
            ("uniqueness", uniqueness),
            ("texture", texture),
            ("reflection", reflection),
            ("sky", sky),
            ("median", median),
            ("speckle", speckle),
            ("fill", fill),
            ("threads", threads),
            ("keep", keep),
        )
        if value is not UNSET
    }
    chosen = _settings(settings, preset, changes)
    timings: dict[str, float] = {}
    pair = _pair(left, right)
    if chosen.disparities is None:
        with _timed(timings, "range"):
            chosen = chosen.changed(
                disparities=estimate_disparities(pair.left, pair.right, threads=chosen.threads)
            )
    return _match(pair, chosen, start, timings)


def _match(pair: Pair, chosen: Settings, start: float, timings: dict[str, float]) -> Result:
    assert chosen.disparities is not None
    stages: dict[str, npt.NDArray[Any]] = {}
    with _timed(timings, "read"):
        pixels = cost.pixels(pair.left, pair.right, chosen.channels, chosen.threads)
    seen = _in_view(chosen.disparities, pair.left.shape[1])
    composed = bool(COMPOSED_ONLY & set(chosen.keep))

    if seen is None:
        disparity, confidence, flags = _nothing_in_view(pair.left.shape[:2])
        if "costs" in chosen.keep:
            dtype = cost.dtype_of(_kind(chosen))
            none = Disparities(chosen.disparities.min, chosen.disparities.min)
            volume = np.empty((*disparity.shape, 0), dtype)
            stages["costs"] = _presented(volume, _kind(chosen), pixels.step, none, chosen.disparities)
        if "right_disparity" in chosen.keep:
            stages["right_disparity"] = disparity.copy()
    elif composed:
        disparity, confidence, flags = _compose(pixels, chosen, seen, timings, stages)
    else:
        with _timed(timings, "match"):
            disparity, confidence, flags = _fused.match(
                _kind(chosen),
                pixels,
                seen,
                chosen.cost.size,
                chosen.subpixel,
                chosen.left_right,
                chosen.uniqueness,
                chosen.threads,
            )

    if chosen.texture is not None or "texture" in chosen.keep:
        with _timed(timings, "texture"):
            gradient = validate.texture(pixels.left, chosen.cost.size, chosen.threads) * np.float32(
                pixels.step
            )
            if chosen.texture is not None:
                least = (
                    validate.texture_of_noise(noise.deviation(pixels.left) * pixels.step, chosen.cost.size)
                    if chosen.texture == "auto"
                    else chosen.texture
                )
                _refuse(gradient < least, Flag.LOW_TEXTURE, disparity, confidence, flags)
            if "texture" in chosen.keep:
                stages["texture"] = gradient
    if chosen.reflection is not None:
        with _timed(timings, "reflection"):
            apart = validate.brightness(pixels.left, pixels.right, disparity, chosen.cost.size)
            _refuse(apart > chosen.reflection, Flag.MISMATCHED, disparity, confidence, flags)
    if "unfiltered" in chosen.keep:
        stages["unfiltered"] = disparity.copy()
    if chosen.median is not None:
        with _timed(timings, "median"):
            disparity = refine.median(disparity, chosen.median, chosen.threads)
    if chosen.speckle is not None:
        with _timed(timings, "speckle"):
            _refuse(validate.speckle(disparity, *chosen.speckle), Flag.SPECKLE, disparity, confidence, flags)
    if chosen.sky:
        with _timed(timings, "sky"):
            # Unchecked winners are of no use as witnesses against the sky.
            matched = None if chosen.left_right is None else disparity
            _refuse(sky.mask(pair.left, matched), Flag.SKY, disparity, confidence, flags)
    if chosen.fill is not None:
        with _timed(timings, "fill"):
            holes = np.isnan(disparity)
            disparity = fill.background(disparity)
            flags[holes & np.isfinite(disparity)] |= np.uint8(Flag.FILLED)

    path = "composed" if composed else "streaming"
    return Result(disparity, confidence, flags, chosen, path, time.perf_counter() - start, timings, stages)


def _compose(
    pixels: cost.Pixels,
    chosen: Settings,
    seen: Disparities,
    timings: dict[str, float],
    stages: dict[str, npt.NDArray[Any]],
) -> tuple[DisparityMap, npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
    """Stage by stage, through a cost volume: what the streaming path is measured against."""
    kind, window, threads = _kind(chosen), chosen.cost.size, chosen.threads
    if kind == "zsad":
        with _timed(timings, "cost"):
            volume: npt.NDArray[Any] = cost.zsad(pixels, seen, window, threads)
    else:
        with _timed(timings, "cost"):
            terms = cost.terms(kind, pixels, seen, window, threads)
        with _timed(timings, "aggregate"):
            sums = aggregate.box(terms, window, threads)
        with _timed(timings, "score"):
            volume = cost.score(kind, sums, pixels, seen, window, threads)

    with _timed(timings, "select"):
        winners = select.left(volume, seen.min, threads)
        right = select.right(volume, seen.min, threads)

    perfect = -1.0 if kind in ("ncc", "zncc") else 0.0
    around = winners.cost, winners.before, winners.after
    flags = np.zeros(winners.index.shape, np.uint8)
    with _timed(timings, "refine"):
        disparity = (winners.index + np.int32(seen.min)).astype(np.float32)
        disparity += refine.subpixel(chosen.subpixel, *around)
        confidence = refine.confidence(perfect, *around)
    with _timed(timings, "validate"):
        _refuse(winners.index < 0, Flag.OUT_OF_VIEW, disparity, confidence, flags)
        if chosen.uniqueness is not None:
            ambiguous = validate.uniqueness(winners.cost, winners.second, perfect, chosen.uniqueness)
            _refuse(ambiguous & (winners.index >= 0), Flag.AMBIGUOUS, disparity, confidence, flags)
        if chosen.left_right is not None:
            failed = validate.left_right(winners.index, right, seen.min, seen.span, chosen.left_right)
            for flag in (Flag.OCCLUDED, Flag.MISMATCHED):
                _refuse(failed == flag, flag, disparity, confidence, flags)

    if "costs" in chosen.keep:
        stages["costs"] = _presented(volume, kind, pixels.step, seen, cast(Disparities, chosen.disparities))
    if "right_disparity" in chosen.keep:
        stages["right_disparity"] = np.where(right < 0, np.nan, right + np.int32(seen.min)).astype(np.float32)
    return disparity, confidence, flags


def _presented(
    volume: npt.NDArray[Any], kind: str, step: float, seen: Disparities, asked: Disparities
) -> npt.NDArray[Any]:
    """The volume over the whole range that was asked for, in the image's own units."""
    worst = np.iinfo(volume.dtype).max if volume.dtype.kind == "i" else np.inf
    whole = np.full((*volume.shape[:2], asked.span), worst, volume.dtype)
    whole[..., seen.min - asked.min : seen.max - asked.min] = volume
    if step == 1:
        return whole
    unit = {"sad": step, "zsad": step, "ssd": step * step, "zssd": step * step}.get(kind, 1.0)
    with np.errstate(over="ignore"):  # what float32 cannot hold is infinite
        return np.where(whole < worst, whole.astype(np.float64) * unit, np.inf).astype(np.float32)


def estimate_disparities(left: Image, right: Image, *, threads: int = 0) -> Disparities:
    """The range of disparities of a pair, from its images alone.

    Both images are shrunk to at most 256 columns by averaging, and matched (ZNCC 9 x 9) over every
    disparity from minus an eighth to five eighths of the width. What survives a left-right check, a
    uniqueness check and a speckle filter spans the range, from its 0.1 % to its 99.9 % quantile; a
    margin of three shrunken pixels plus a tenth of the span is added on both sides. Negative
    disparities are searched where a twentieth of what survives is negative. Where less than 1 % of
    the pixels survive, the range is a quarter of the width.

    Parameters
    ----------
    left, right : ndarray, (H, W) or (H, W, 3)
        A rectified pair.
    threads : int
        0: all cores.

    Returns
    -------
    Disparities
    """
    width = left.shape[1]
    factor = max(1, -(-width // 256))
    small = Pair(_shrunk(left, factor), _shrunk(right, factor))
    columns = small.left.shape[1]
    search = Disparities(-(columns // 8) - 1, columns * 5 // 8 + 2)
    probe = Settings(
        disparities=search,
        cost=settings.ZNCC(9),
        left_right=1,
        uniqueness=10,
        speckle=(12, 1.0),
        threads=threads,
    )
    found = _match(small, probe, time.perf_counter(), {})
    reliable = found.disparity[np.isfinite(found.disparity)]
    if reliable.size < 0.01 * found.disparity.size or not reliable.size:
        return Disparities(0, max(1, width // 4))
    low, high = np.quantile(reliable, [0.001, 0.999])
    margin = 3 + 0.1 * (high - low)
    lowest = int(np.floor((low - margin) * factor))
    # Parallel cameras see no negative disparity: a few wrong matches are no reason to search for one.
    if np.mean(reliable < -1) < 0.05:
        lowest = max(lowest, 0)
    return Disparities(lowest, max(lowest + 1, int(np.ceil((high + margin) * factor)) + 1))


def _shrunk(image: Image, factor: int) -> Image:
    """The mean of each factor x factor block, as float32 grey."""
    grey = image.astype(np.float32) if image.ndim == 2 else image.astype(np.float32).mean(axis=2)
    if min(grey.shape) < factor:
        return np.ascontiguousarray(grey)
    rows, columns = (side // factor for side in grey.shape)
    blocks = grey[: rows * factor, : columns * factor].reshape(rows, factor, columns, factor)
    means: Image = blocks.mean(axis=(1, 3), dtype=np.float64).astype(np.float32)
    return means


def _settings(given: Settings | None, preset: str | None, changes: dict[str, Any]) -> Settings:
    if given is not None and not isinstance(given, Settings):
        raise TypeError(f"settings must be a Settings, not {type(given).__name__}")
    if given is not None and preset is not None:
        raise ValueError("settings and preset exclude each other: both say what to start from")
    if preset is not None:
        start = settings.named(preset)
    elif given is not None:
        start = given
    else:
        start = Settings() if "cost" in changes else settings.named(settings.DEFAULT_PRESET)
    return start.changed(**changes)


def _pair(left: Pair | Image, right: Image | None) -> Pair:
    if isinstance(left, Pair):
        if right is not None:
            raise TypeError("right must be left out where left is a Pair")
        pair = left
    else:
        if right is None:
            raise TypeError("right is missing: match takes a Pair, or a left and a right image")
        pair = Pair(left, right)
    for name, image in (("left", pair.left), ("right", pair.right)):
        _check_image(name, image)
    if pair.left.shape != pair.right.shape:
        raise ValueError(
            f"left and right must have the same shape, not {pair.left.shape} and {pair.right.shape}"
        )
    if pair.left.dtype != pair.right.dtype:
        raise TypeError(
            f"left and right must have the same dtype, not {pair.left.dtype} and {pair.right.dtype}"
        )
    return pair


def _check_image(name: str, image: Any) -> None:
    if not isinstance(image, np.ndarray):
        raise TypeError(f"{name} must be a NumPy array, not {type(image).__name__}")
    if image.dtype not in (np.uint8, np.uint16, np.float32):
        raise TypeError(f"{name} must be uint8, uint16 or float32, not {image.dtype}")
    if not (image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)):
        raise ValueError(f"{name} must be (H, W) or (H, W, 3), not of shape {image.shape}")
    if image.size == 0 or max(image.shape) >= 2**24:
        raise ValueError(f"{name} must have from 1 to 2^24 - 1 rows and columns, not the shape {image.shape}")
    if image.dtype == np.float32 and not np.isfinite(image).all():
        bad = int(np.count_nonzero(~np.isfinite(image)))
        raise ValueError(f"{name} must be finite; it holds {bad} NaN or infinite values")


def _kind(chosen: Settings) -> str:
    return type(chosen.cost).__name__.lower()


def _in_view(asked: Disparities, width: int) -> Disparities | None:
    """The candidates that some pixel can see."""
    low, high = max(asked.min, 1 - width), min(asked.max, width)
    return Disparities(low, high) if low < high else None


def _nothing_in_view(
    shape: tuple[int, ...],
) -> tuple[DisparityMap, npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
    return (
        np.full(shape, np.nan, np.float32),
        np.zeros(shape, np.float32),
        np.full(shape, Flag.OUT_OF_VIEW, np.uint8),
    )


def _refuse(
    where: npt.NDArray[np.bool_],
    flag: Flag,
    disparity: DisparityMap,
    confidence: npt.NDArray[np.float32],
    flags: npt.NDArray[np.uint8],
) -> None:
    disparity[where] = np.nan
    confidence[where] = 0
    flags[where] |= np.uint8(flag)


@contextmanager
def _timed(timings: dict[str, float], stage: str) -> Iterator[None]:
    start = time.perf_counter()
    yield
    timings[stage] = timings.get(stage, 0.0) + time.perf_counter() - start
