"""From a pair to a disparity map: the page to read first.

read → cost → aggregate → optimize → select → validate → refine → fill → write
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from stereopsis import (
    _core,
    _fused,
    aggregate,
    blank,
    confidence,
    cost,
    fill,
    information,
    noise,
    optimize,
    pixelwise,
    planes,
    pyramid,
    quantum,
    rectify,
    refine,
    select,
    settings,
    sgm,
    sharpen,
    sky,
    slant,
    smooth,
    upsample,
    validate,
    weigh,
)
from stereopsis._numbers import quantile
from stereopsis.settings import Settings
from stereopsis.supports import Adaptive, Bilateral, Cross, Gaussian, Window, window_size
from stereopsis.types import (
    EVERY,
    Disparities,
    DisparityMap,
    Flag,
    Frame,
    Image,
    Pair,
    Rectangle,
    Result,
    Sampling,
    Vertical,
    worst_cost,
)

Floats = npt.NDArray[np.float32]
Borders: TypeAlias = tuple[blank.Border | None, blank.Border | None]
"""The black borders of both images."""
COMPOSED_ONLY = frozenset({"costs", "right_disparity"})
"""What only the composed path can keep."""
SMOOTHED = 32
"""How far around a tile its neighbours are smoothed with it, in pixels."""
RUN_UP = 16
"""Rows above the ground from which paths go down to it."""
FROM_IMAGES = frozenset({"symmetric", "correlation", "lucas-kanade", "lucas-kanade-affine"})
"""Sub-pixel methods that need the images, not the costs."""


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
    blank: bool = UNSET,
    vertical: str | float | tuple[float, ...] | None = UNSET,
    sharpen: float | str | None = UNSET,
    optimize: optimize.Optimizer | sgm.SGM | str | None = UNSET,
    slant: str | None = UNSET,
    extra_windows: tuple[Window, ...] = UNSET,
    subpixel: str | None = UNSET,
    refine_window: Window | None = UNSET,
    upsample: tuple[int, str] | None = UNSET,
    left_right: float | None = UNSET,
    uniqueness: float | None = UNSET,
    texture: float | str | None = UNSET,
    reflection: float | None = UNSET,
    sky: bool | str = UNSET,
    median: int | None = UNSET,
    speckle: tuple[int, float] | int | None = UNSET,
    planes: str | None = UNSET,
    planar: Window | None = UNSET,
    fill: str | None = UNSET,
    weighted_median: tuple[int, float] | int | None = UNSET,
    edge_aware: tuple[float, float] | float | None = UNSET,
    confidence: str | None = UNSET,
    least_confidence: float | None = UNSET,
    outlines: bool = UNSET,
    photometric: bool = UNSET,
    pyramid: int | None = UNSET,
    step: int = UNSET,
    disparity_step: int = UNSET,
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
    cost, channels, blank, vertical, sharpen, optimize, slant, extra_windows, subpixel, refine_window
        As in `Settings`.
    upsample, left_right, uniqueness, texture, reflection, sky, median, speckle, planes, planar, fill
        As in `Settings`.
    weighted_median, edge_aware, confidence, least_confidence, outlines, photometric
        As in `Settings`.
    pyramid, step, disparity_step
        As in `Settings`.
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
            ("blank", blank),
            ("vertical", vertical),
            ("sharpen", sharpen),
            ("optimize", optimize),
            ("slant", slant),
            ("extra_windows", extra_windows),
            ("subpixel", subpixel),
            ("refine_window", refine_window),
            ("upsample", upsample),
            ("left_right", left_right),
            ("uniqueness", uniqueness),
            ("texture", texture),
            ("reflection", reflection),
            ("sky", sky),
            ("median", median),
            ("speckle", speckle),
            ("planes", planes),
            ("planar", planar),
            ("fill", fill),
            ("weighted_median", weighted_median),
            ("edge_aware", edge_aware),
            ("confidence", confidence),
            ("least_confidence", least_confidence),
            ("outlines", outlines),
            ("photometric", photometric),
            ("pyramid", pyramid),
            ("step", step),
            ("disparity_step", disparity_step),
            ("threads", threads),
            ("keep", keep),
        )
        if value is not UNSET
    }
    chosen = _settings(settings, preset, changes)
    pair = _pair(left, right)
    return _core.with_crew(lambda: _match_whole(pair, chosen, start))


def match_part(
    left: Image,
    right: Image,
    chosen: Settings,
    frame: Frame,
    largest: float | None = None,
    step: float | None = None,
    borders: Borders = (None, None),
) -> Result:
    """Match a part of a larger pair, with what is known of the whole.

    Parameters
    ----------
    left, right : ndarray, (H, W) or (H, W, 3)
        The same rows and columns of both images.
    chosen : Settings
        With `disparities` and `vertical` known.
    frame : Frame
    largest : float, optional
        Largest magnitude of the whole images, where they hold floats.
    step : float, optional
        `quantum.of` the whole images, where they are to be matched as bytes.
    borders : (blank.Border or None, blank.Border or None)
        Of the whole images, over which these are continued already.

    Returns
    -------
    Result
        Of the part; right, as far as its edges are the image's or lie farther off than the settings' halo.
    """
    start = time.perf_counter()
    pair = _in_bytes(_pair(left, right), step)

    def work() -> Result:
        pixels = cost.pixels(pair.left, pair.right, chosen.channels, chosen.threads, largest)
        pixels = pixels._replace(step=step or pixels.step)
        return _match(pair, chosen, start, {}, pixels._replace(limits=frame.levels), frame, borders)

    return _core.with_crew(work)


def _match_whole(pair: Pair, chosen: Settings, start: float) -> Result:
    """Match with what is left to the images estimated from them."""
    timings: dict[str, float] = {}
    borders: Borders = (None, None)
    if chosen.blank:
        with _timed(timings, "read"):
            borders = blank.border(pair.left), blank.border(pair.right)
        if any(borders):
            with _timed(timings, "blank"):
                pair = _continued(pair, borders, chosen.threads)
    step = None
    if pair.left.dtype != np.uint8 and quantum.wanted(chosen):
        with _timed(timings, "read"):
            step = quantum.of((pair.left, pair.right))
            pair = _in_bytes(pair, step)
    if chosen.disparities is None:
        with _timed(timings, "range"):
            chosen = chosen.changed(
                disparities=estimate_disparities(pair.left, pair.right, threads=chosen.threads)
            )
    pixels = None
    if chosen.vertical == "estimate":
        chosen, pixels = _with_vertical(pair, chosen, timings)
    if step is not None:
        pixels = pixels or cost.pixels(pair.left, pair.right, chosen.channels, chosen.threads)
        pixels = pixels._replace(step=step)
    return _match(pair, chosen, start, timings, pixels, None, borders)


def _continued(pair: Pair, borders: Borders, threads: int) -> Pair:
    """The pair with its images continued over their black borders."""
    left, right = (
        image if found is None else found.continued(image, threads=threads)
        for image, found in zip((pair.left, pair.right), borders, strict=True)
    )
    return dataclasses.replace(pair, left=left, right=right)


def _place(frame: Frame | None, shape: tuple[int, ...]) -> Rectangle:
    """Where in the whole image lies what has that shape."""
    top, left = (0, 0) if frame is None else (frame.top, frame.left)
    return Rectangle(top, top + shape[0], left, left + shape[1])


def _in_bytes(pair: Pair, step: float | None) -> Pair:
    """The pair, counted in steps of so many grey levels."""
    if step is None:
        return pair
    left, right = (quantum.in_bytes(image, step) for image in (pair.left, pair.right))
    return dataclasses.replace(pair, left=left, right=right)


def _match(
    pair: Pair,
    chosen: Settings,
    start: float,
    timings: dict[str, float],
    pixels: cost.Pixels | None = None,
    frame: Frame | None = None,
    borders: Borders = (None, None),
) -> Result:
    assert chosen.disparities is not None
    stages: dict[str, npt.NDArray[Any]] = {}
    with _timed(timings, "read"):
        pixels = pixels or cost.pixels(pair.left, pair.right, chosen.channels, chosen.threads)
    seen = _in_view(chosen.disparities, pair.left.shape[1], chosen.disparity_step)
    if isinstance(chosen.vertical, Vertical) and any(chosen.vertical):
        with _timed(timings, "vertical"):
            right = rectify.undone(pixels.right, chosen.vertical, chosen.threads, frame)
            pixels = pixels._replace(right=right)
    sharp, guide = pixels, None
    if chosen.sharpen is not None:
        with _timed(timings, "sharpen"):
            sharp = _sharpened(pixels, chosen.sharpen, chosen.threads)
            guide = _fused.guide_of(pixels)
    merged = chosen.slant is not None or bool(chosen.extra_windows)
    composed = not merged and not _streams(chosen, pixels)

    if seen is None:
        disparity, confidence, flags = _nothing_in_view(pair.left.shape[:2])
        if "costs" in chosen.keep:
            dtype = cost.dtype_of(_kind(chosen)) if chosen.cost.support is None else np.float32
            none = Disparities(chosen.disparities.min, chosen.disparities.min)
            volume = np.empty((*disparity[:: chosen.step, :: chosen.step].shape, 0), dtype)
            stages["costs"] = _presented(volume, chosen, _unit(_kind(chosen), pixels.step), none)
        if "right_disparity" in chosen.keep:
            stages["right_disparity"] = disparity.copy()
    elif chosen.pyramid is not None:
        disparity, confidence, flags = _match_tiles(sharp, chosen, seen, timings)
    elif composed:
        disparity, confidence, flags = _compose(sharp, chosen, seen, timings, stages, guide)
    elif isinstance(chosen.optimize, sgm.SGM):
        disparity, confidence, flags = _semi_global(
            sharp, chosen, seen, chosen.optimize, timings, stages, frame, guide
        )
    elif merged:
        disparity, confidence, flags = _merge(pixels, chosen, seen, timings, stages, frame)
    elif chosen.upsample is not None:
        disparity, confidence, flags = _match_upsampled(pixels, chosen, chosen.upsample, seen, timings)
    else:
        with _timed(timings, "match"):
            disparity, confidence, flags = _stream(pixels, chosen, seen)
    disparity, confidence, flags = map(np.ascontiguousarray, (disparity, confidence, flags))
    place = _place(frame, disparity.shape)
    if any(borders):
        with _timed(timings, "blank"):
            hidden = blank.hidden(disparity, borders, place, False, chosen.threads)
            _refuse(hidden, Flag.OUT_OF_VIEW, disparity, confidence, flags)
            for name in stages.keys() & {"winners", "right_disparity"}:
                of_right = name == "right_disparity"
                hidden = blank.hidden(stages[name], borders, place, of_right, chosen.threads)
                stages[name][hidden] = np.nan

    if isinstance(chosen.vertical, Vertical):
        whole_shape = disparity.shape if frame is None else frame.shape
        for rows, beyond in rectify.out_of_view(chosen.vertical, whole_shape, place):
            _refuse(beyond, Flag.OUT_OF_VIEW, disparity[rows], confidence[rows], flags[rows])
            for name in stages.keys() & {"winners", "right_disparity"}:
                stages[name][rows][beyond] = np.nan

    if "vertical" in chosen.keep:
        lies = chosen.vertical if isinstance(chosen.vertical, Vertical) else Vertical(0.0)
        stages["vertical"] = rectify.field(lies, disparity.shape)
    if "planes" in chosen.keep:
        stages.setdefault("planes", np.empty((0, 3)))
        stages.setdefault("plane", np.zeros(disparity.shape, np.uint8))
    if chosen.texture is not None or "texture" in chosen.keep:
        with _timed(timings, "texture"):
            if chosen.texture is not None:
                least = (
                    validate.texture_of_noise(
                        noise.deviation(pixels.left, chosen.threads) * pixels.level, chosen.cost.size
                    )
                    if chosen.texture == "auto"
                    else chosen.texture
                )
                window, answers = chosen.cost.size, (disparity, confidence, flags)
                validate.refuse_dull(pixels.left, window, least / pixels.level, *answers, chosen.threads)
            if "texture" in chosen.keep:
                gradient = validate.texture(pixels.left, chosen.cost.size, chosen.threads)
                stages["texture"] = gradient * np.float32(pixels.step)
    if chosen.subpixel in FROM_IMAGES:
        with _timed(timings, "subpixel"):
            disparity = _refined(pixels, chosen, disparity)
    if merged or chosen.subpixel in FROM_IMAGES:
        # A slanted window or a refinement may lean out of the range by a fraction of a pixel.
        np.clip(disparity, chosen.disparities.min, chosen.disparities.max - 1, out=disparity)
    if chosen.reflection is not None:
        with _timed(timings, "reflection"):
            apart = validate.brightness(pixels.left, pixels.right, disparity, chosen.cost.size)
            _refuse(apart > chosen.reflection, Flag.MISMATCHED, disparity, confidence, flags)
    if "unfiltered" in chosen.keep:
        stages["unfiltered"] = disparity.copy()
    own = stages.pop("winners", None)
    winners = disparity.copy() if own is None and chosen.confidence is not None else own
    if chosen.median is not None and chosen.planar is None:
        with _timed(timings, "median"):
            refine.median(disparity, chosen.median, chosen.threads, into=disparity)
    if chosen.speckle is not None:
        with _timed(timings, "speckle"):
            validate.refuse_speckle(disparity, *chosen.speckle, confidence, flags, chosen.threads)
    if chosen.sky:
        with _timed(timings, "sky"):
            # Uncalibrated, cameras may be turned to each other where negative disparities are asked for.
            behind = min(0, chosen.disparities.min) if pair.calibration is None else _infinity(pair)
            shown = _sky(pair.left, disparity, chosen, behind)
            rows = np.s_[: len(shown)]
            if borders[0] is not None:
                shown &= ~borders[0].blank()[rows]  # never of a part
            _refuse(shown, Flag.SKY, disparity[rows], confidence[rows], flags[rows])
    beneath = None
    if chosen.planes is not None:
        with _timed(timings, "segments"):
            bounds = chosen.disparities.min, chosen.disparities.max - 1
            ground = slant.road(disparity, slant.FIRST_WINDOW, threads=chosen.threads)
            segments = planes.refine(pair.left, disparity, bounds, threads=chosen.threads, ground=ground)
            beneath = segments.disparity
            disparity = np.where(np.isnan(disparity), np.float32(np.nan), beneath)
            if "segments" in chosen.keep:
                stages["segments"], stages["segment_planes"] = segments.label, segments.planes
                stages["segment_support"] = segments.support
    whole = disparity
    tolerance = refine.planar_tolerance(disparity.shape[1] if frame is None else frame.shape[1])
    if chosen.planar is not None:
        with _timed(timings, "planar"):
            trusted = disparity
            if own is not None:
                # Where they were right after all, the winners are accepted again.
                cut = validate.cut_off(disparity, chosen.disparities.max, 0 if frame is None else frame.left)
                trusted = np.where(cut, np.float32(np.nan), disparity)
            whole = _planar(trusted, pixels, chosen, flags, beneath, tolerance)
            sharpness = stages.pop("sharpness", confidence)
            judged = whole, own, sharpness, flags, chosen.disparities, chosen.threads
            disparity, confidence = validate.judged(*judged)
    elif chosen.fill is not None:
        with _timed(timings, "fill"):
            whole = _filled(chosen.fill, disparity, flags, pixels, beneath, chosen.threads)
    if chosen.fill is not None or chosen.confidence is not None or chosen.least_confidence is not None:
        holes = np.isnan(disparity)
    if chosen.fill is not None:
        flags |= (holes & np.isfinite(whole)) * np.uint8(Flag.FILLED)
        disparity = whole
    if chosen.weighted_median is not None:
        with _timed(timings, "weighted median"):
            size, levels = chosen.weighted_median
            disparity = smooth.weighted_median(
                disparity, _guide(pixels), size, levels, threads=chosen.threads
            )
    if chosen.edge_aware is not None:
        with _timed(timings, "edge-aware"):
            strength, levels = chosen.edge_aware
            disparity = smooth.edge_aware(disparity, _guide(pixels), strength, levels, threads=chosen.threads)
            np.clip(disparity, chosen.disparities.min, chosen.disparities.max - 1, out=disparity)
    if chosen.confidence is not None:
        with _timed(timings, "confidence"):
            confidence = _calibrated(
                disparity, ~holes, confidence, cast(DisparityMap, winners), pixels, chosen
            )
    if chosen.least_confidence is not None:
        doubtful = ~holes & (confidence < chosen.least_confidence)
        if chosen.fill is None:
            _refuse(doubtful, Flag.MISMATCHED, disparity, confidence, flags)
        else:
            with _timed(timings, "refill"):
                flags |= doubtful * np.uint8(Flag.MISMATCHED | Flag.FILLED)
                disparity = _refilled(disparity, flags, pixels, chosen, beneath, tolerance)
    if chosen.outlines:
        with _timed(timings, "outlines"):
            disparity = _outlined(disparity, confidence, flags, pair, pixels, chosen)
    if chosen.photometric:
        with _timed(timings, "photometric"):
            filled = flags & np.uint8(Flag.FILLED)
            views, threads = _fused.guides_of(pixels), chosen.threads
            disparity = refine.photometric(disparity, filled, views, chosen.disparities, threads)

    bowed = frame is not None and frame.bowed
    if isinstance(chosen.vertical, Vertical) and chosen.vertical.keystone and not bowed:
        with _timed(timings, "vertical"):
            disparity = np.ascontiguousarray(disparity)
            known = chosen.vertical, chosen.disparities, chosen.threads, frame
            rectify.unbow(disparity, *known)
            if "unfiltered" in stages:
                rectify.unbow(stages["unfiltered"], *known)
            if "right_disparity" in stages:
                rectify.unbow(stages["right_disparity"], *known, of_right=True)

    if borders[0] is not None:
        confidence[borders[0].blank(place)] = 0  # also where it was filled
    if chosen.sky and chosen.fill is not None:
        # Infinitely far, as far as the range goes; and nothing that was measured.
        shown = flags & np.uint8(Flag.SKY) > 0
        disparity[shown] = np.clip(_infinity(pair), chosen.disparities.min, chosen.disparities.max - 1)
        confidence[shown] = 0

    path = "merged" if merged else "composed" if composed else "streaming"
    return Result(disparity, confidence, flags, chosen, path, time.perf_counter() - start, timings, stages)


def _infinity(pair: Pair) -> float:
    """The disparity of what is infinitely far."""
    return 0.0 if pair.calibration is None else 0.0 - pair.calibration.doffs


def _sky(
    image: Image, disparity: DisparityMap, chosen: Settings, infinity: float = 0.0
) -> npt.NDArray[np.bool_]:
    """Where the sky is, in as many of the first rows as can show it; with "auto", above open ground alone."""
    # Unchecked winners are of no use as witnesses against the sky.
    matched = None if chosen.left_right is None else disparity
    if chosen.sky is True:
        return sky.mask(image, matched, threads=chosen.threads)
    height, width = disparity.shape
    ground = slant.road(disparity, slant.FIRST_WINDOW, threads=chosen.threads)
    farthest = sky.farthest_surface(disparity)
    if ground is None or farthest is None:
        return np.zeros((0, width), bool)
    far = infinity + sky.OPEN * (ground.nearest(disparity.shape) - infinity)
    if farthest > far:
        return np.zeros((0, width), bool)
    horizon = ground.first_row_above(infinity, disparity.shape)
    if horizon == 0:
        return np.zeros((0, width), bool)
    # A strip of the ground tells what is not sky where nothing stands on it.
    upper = np.s_[: horizon + height // 8]
    told = None if matched is None else matched[upper]
    return sky.mask(image[upper], told, far, chosen.threads)[:horizon]


def _sharpened(pixels: cost.Pixels, how: float | str, threads: int) -> cost.Pixels:
    """Both images; by as much as the left one needs, where `how` is "auto"."""
    amount = sharpen.amount_for(sharpen.steps(pixels.left)) if isinstance(how, str) else how
    if amount == 0:
        return pixels
    left, right = (sharpen.sharpened(image, amount, threads) for image in pixels[:2])
    return pixels._replace(left=left, right=right)


def _filled(
    how: str,
    disparity: DisparityMap,
    flags: npt.NDArray[np.uint8],
    pixels: cost.Pixels,
    beneath: DisparityMap | None,
    threads: int,
) -> DisparityMap:
    """The map without holes; `beneath` is what the segments' planes have everywhere."""
    match how:
        case "planes":
            return cast(DisparityMap, beneath)
        case "interpolate":
            return fill.interpolate(disparity, flags)
        case "surfaces":
            return fill.surfaces(disparity, flags, _guide(pixels), threads=threads)
        case _:
            return fill.background(disparity, threads)


def _refilled(
    disparity: DisparityMap,
    flags: npt.NDArray[np.uint8],
    pixels: cost.Pixels,
    chosen: Settings,
    beneath: DisparityMap | None,
    tolerance: float,
) -> DisparityMap:
    """What counts as filled, filled once more from the rest; the nearer answer stands."""
    filled, bounds = flags & np.uint8(Flag.FILLED) > 0, cast(Disparities, chosen.disparities)
    trusted = np.where(filled, np.float32(np.nan), disparity)
    again = _filled(cast(str, chosen.fill), trusted, flags, pixels, beneath, chosen.threads)
    found = fill.nearer(disparity, filled, again, chosen.threads)
    if chosen.planar is not None:
        smooth = refine.planar(found, window_size(chosen.planar), chosen.threads, tolerance=tolerance)
        np.copyto(found, smooth, where=filled)
        np.clip(found, bounds.min, bounds.max - 1, out=found)
    return found


def _outlined(
    disparity: DisparityMap,
    confidence: npt.NDArray[np.float32],
    flags: npt.NDArray[np.uint8],
    pair: Pair,
    pixels: cost.Pixels,
    chosen: Settings,
) -> DisparityMap:
    """The map with outlines that were decided anew; what leaves its match is flagged, or refused."""
    seen = _seen(pair, pixels)

    def even(found: DisparityMap) -> DisparityMap:
        return found if chosen.median is None else refine.median(found, chosen.median, chosen.threads)

    filled = flags & np.uint8(Flag.FILLED)
    before = even(fill.outlines(disparity, filled, seen, chosen.threads))
    found = fill.unfatten(before, filled, _fused.guides_of(pixels), seen, chosen.threads)
    left = (found < before) & (filled == 0)
    if chosen.fill is None:
        _refuse(left, Flag.MISMATCHED, found, confidence, flags)
    else:
        flags |= left * np.uint8(Flag.MISMATCHED | Flag.FILLED)
    return even(found)


def _guide(pixels: cost.Pixels) -> npt.NDArray[np.uint8]:
    """The left image in bytes: its edges are the same, however many bits its pixels have."""
    return pixels.left if pixels.left.dtype == np.uint8 else _fused.guide_of(pixels)[..., None]


def _seen(pair: Pair, pixels: cost.Pixels) -> npt.NDArray[np.uint8]:
    """The left image in bytes: in colour, if it is one of them."""
    return pair.left if pair.left.dtype == np.uint8 and pair.left.ndim == 3 else _fused.guide_of(pixels)


def _calibrated(
    disparity: DisparityMap,
    matched: npt.NDArray[np.bool_],
    sharpness: npt.NDArray[np.float32],
    winners: DisparityMap,
    pixels: cost.Pixels,
    chosen: Settings,
) -> npt.NDArray[np.float32]:
    """The probability that an answer is right; 0 where there is none."""
    # The model looks at windows: what holds no answer is seen as its background, but a row without any as 0:
    # its background lies farther off than a part of the image reaches.
    holes, surface = np.isnan(disparity), disparity
    if holes.any():
        surface = np.nan_to_num(fill.background(disparity, chosen.threads))
        surface[holes.all(axis=1)] = 0
    guide = _fused.guide_of(pixels)[..., None]
    texture = validate.texture(guide, confidence.TEXTURE_WINDOW, chosen.threads)
    filtered = any(step is not None for step in (chosen.speckle, chosen.planar, chosen.planes))
    model = confidence.model(isinstance(chosen.optimize, sgm.SGM), filtered, chosen.cost.size)
    given = surface, matched, sharpness, winners, texture
    found = confidence.probability(*given, model, chosen.threads)
    found[holes] = 0
    return found


def _stream(
    pixels: cost.Pixels, chosen: Settings, seen: Disparities
) -> tuple[DisparityMap, npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
    """Cost, aggregation, selection, checks and fit at once, without a cost volume."""
    kind, support = _kind(chosen), chosen.cost.support
    others = _fit(chosen.subpixel), chosen.left_right, chosen.uniqueness, chosen.threads
    if isinstance(support, Gaussian):
        return _fused.match_gaussian(kind, pixels, seen, support.sigma, support.truncate, *others)
    return _fused.match(kind, pixels, seen, chosen.cost.size, *others)


def _semi_global(
    pixels: cost.Pixels,
    chosen: Settings,
    seen: Disparities,
    solver: sgm.SGM,
    timings: dict[str, float],
    stages: dict[str, npt.NDArray[Any]],
    frame: Frame | None,
    guide: npt.NDArray[np.uint8] | None = None,
) -> tuple[DisparityMap, npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
    """Census to winner in one go; with slant once more along the ground, where smooth means on the ground.

    Each pixel takes the answer of the smaller sum of path costs. Where P2 is adapted to an image it is to
    `guide`; None: to the left one of the pixels.
    """
    height, width = pixels.left.shape[:2]
    census = cast(pixelwise.Census, chosen.cost)
    checks = _fit(chosen.subpixel), chosen.left_right, chosen.uniqueness, chosen.threads
    with _timed(timings, "cost"):
        strings = pixelwise.census(pixels.left[..., 0], census.comparisons, chosen.threads)

    def winners(view: cost.Pixels, candidates: Disparities, begin: int = 0) -> tuple[_fused.Found, Floats]:
        """Match the rows from `begin`, which are what `view` holds; the winners, and their sums."""
        sums = np.empty(view.left.shape[:2], np.float32)
        own = np.ascontiguousarray(strings[:, begin:])
        found = _fused.match_sgm(
            census,
            view,
            candidates,
            solver,
            *checks,
            winning_cost=sums,
            left_strings=own,
            guide=None if guide is None else guide[begin:],
        )
        return found, sums

    with _timed(timings, "match"):
        (disparity, confidence, flags), sums = winners(pixels, seen)
    ground, plane = next(iter(_told(frame)), None), np.zeros((height, width), np.uint8)
    if chosen.slant is not None and (frame is None or frame.planes is None):
        with _timed(timings, "planes"):
            step = slant.thinning(disparity.size)
            few = np.s_[::step, ::step]
            reliable = np.where(flags[few] == 0, disparity[few], np.float32(np.nan))
            ground = slant.road(reliable, census.size, step, chosen.threads)
    if ground is not None:
        with _timed(timings, "match along the ground"):
            # Above the horizon this pass would be the first one again.
            top = ground.first_row_above(seen.min, (height, width))
            begin = max(0, top - RUN_UP)
            views = slant.warped(
                pixels.left[begin:],
                pixels.right[begin:],
                ground.from_row(begin),
                0,
                chosen.threads,
                floor=seen.min,
            )
            candidates = Disparities(-slant.MARGIN, max(slant.MARGIN, seen.span - slant.MARGIN))
            found, other_sums = winners(cost.Pixels(*views, pixels.step, pixels.limits), candidates, begin)
            best = slant.Hypothesis(disparity, confidence, sums, sums, flags, plane)
            skip = top - begin
            slant.merge_pass(
                best.from_row(top),
                (found[0][skip:], found[1][skip:], found[2][skip:]),
                other_sums[skip:],
                slant.AS_IT_IS,
                ground.from_row(top),
                1,
                1.0,
                seen,
                chosen.threads,
                floor=seen.min,
                beyond=True,
            )
    if "planes" in chosen.keep:
        stages["planes"] = np.array([] if ground is None else [ground], np.float64).reshape(-1, 3)
        stages["plane"] = plane
    if chosen.planar is not None:
        stages["winners"], stages["sharpness"] = disparity, confidence
    return *validate.accepted(disparity, confidence, flags, chosen.threads), flags


def _planar(
    disparity: DisparityMap,
    pixels: cost.Pixels,
    chosen: Settings,
    flags: npt.NDArray[np.uint8],
    beneath: DisparityMap | None,
    tolerance: float,
) -> DisparityMap:
    """Fill the holes, and draw all to the planes that they lie on.

    A pixel then keeps its answer where its own winner lies near the plane, and only there: so one that failed
    a check of left against right gets it back where its surroundings agree.
    """
    how = "background" if chosen.fill is None else chosen.fill
    whole = _filled(how, disparity, flags, pixels, beneath, chosen.threads)
    if chosen.median is not None:
        whole = refine.median(whole, chosen.median, chosen.threads)
    window = window_size(cast(Window, chosen.planar))
    return refine.planar(whole, window, chosen.threads, tolerance=tolerance)


def _fit(subpixel: str | None) -> str | None:
    """The fit through the winner's costs: for Lucas and Kanade, what to start from."""
    match subpixel:
        case "lucas-kanade" | "lucas-kanade-affine":
            return "parabola"
        case "symmetric" | "correlation":
            return None
        case _:
            return subpixel


def _refined(pixels: cost.Pixels, chosen: Settings, start: DisparityMap) -> DisparityMap:
    """Sub-pixel disparities from the images, around those that were found."""
    images, threads = pixels[:2], chosen.threads
    asked = None if chosen.refine_window is None else window_size(chosen.refine_window)
    flat = asked or (15, 5)
    match chosen.subpixel:
        case "symmetric":
            # A cost that bears an offset of brightness needs a refinement that does.
            bears = settings.ZSAD | settings.ZSSD | settings.ZNCC | pixelwise.Pixelwise
            centred = isinstance(chosen.cost, bears)
            return refine.symmetric(*images, np.rint(start), flat, centred, threads)
        case "correlation":
            centred = isinstance(chosen.cost, settings.ZNCC)
            return refine.correlation(*images, np.rint(start), asked or chosen.cost.size, centred, threads)
        case "lucas-kanade":
            return refine.lucas_kanade(*images, start, flat, threads)
        case _:
            return refine.lucas_kanade_affine(*images, start, asked or (21, 11), threads)[0]


def _match_tiles(
    pixels: cost.Pixels, chosen: Settings, seen: Disparities, timings: dict[str, float]
) -> tuple[DisparityMap, npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
    """Each tile over the range that a map of small images has there; no filter yet."""
    shape, levels = pixels.left.shape[:2], cast(int, chosen.pyramid)
    with _timed(timings, "coarse"):
        plan = pyramid.plan(_coarse(pixels, seen, levels, chosen.threads), 2**levels, shape, seen)
    windows = [chosen.cost.size, *chosen.extra_windows]
    windows += [slant.FIRST_WINDOW] if chosen.slant else []
    beyond = SMOOTHED if chosen.optimize is not None else 2
    halo = max(w for w, _ in windows) // 2 + beyond, max(h for _, h in windows) // 2 + beyond
    plain = chosen.changed(
        **dict.fromkeys(
            ("pyramid", "vertical", "sharpen", "texture", "reflection", "median", "speckle", "planar", "fill")
        ),
        **dict.fromkeys(("weighted_median", "edge_aware", "confidence", "least_confidence")),
        sky=False,
        outlines=False,
        photometric=False,
        keep=(),
        subpixel=_fit(chosen.subpixel),
    )
    disparity, confidence, flags = _nothing_in_view(shape)
    for tile in plan:
        part = pyramid.cut(tile, shape, halo)
        images = pixels.left[part.rows, part.left], pixels.right[part.rows, part.right]
        low, high = tile.disparities
        own = plain.changed(disparities=(low - part.shift, high - part.shift))
        left, right = (np.ascontiguousarray(image) for image in images)
        found = _match(Pair(left, right), own, 0.0, timings, cost.Pixels(left, right, pixels.step))
        answer = found.disparity[part.core] + np.float32(part.shift)
        into = np.s_[tile.top : tile.bottom, tile.left : tile.right]
        confidence[into], flags[into] = found.confidence[part.core], found.flags[part.core]
        # A winner at an end that is not the whole range's may have a better one beyond it.
        ends = (answer == low) & (low > seen.min) | (answer == high - 1) & (high < seen.max)
        _refuse(ends, Flag.MISMATCHED, answer, confidence[into], flags[into])
        disparity[into] = answer
    return disparity, confidence, flags


def _coarse(pixels: cost.Pixels, seen: Disparities, levels: int, threads: int) -> DisparityMap:
    """A reliable map of images that were halved so often, in their own pixels."""
    left, right = (
        rectify.pyramid(rectify.eight_bit(image[..., 0]), levels, threads)[-1] for image in pixels[:2]
    )
    found = _halved_map(left, right, seen, levels, 2.0, threads)
    if found is None:
        return np.full((max(1, left.shape[0]), max(1, left.shape[1])), np.nan, np.float32)
    found[validate.speckle(found, 20, 1.0, threads)] = np.nan
    return found


def _halved_map(
    left: rectify.Bytes,
    right: rectify.Bytes,
    seen: Disparities,
    levels: int,
    uniqueness: float | None,
    threads: int,
) -> DisparityMap | None:
    """A checked map of images that were halved so often; None where they hold no candidate."""
    if not left.size:
        return None
    candidates = _in_view(Disparities(seen.min >> levels, ((seen.max - 1) >> levels) + 2), left.shape[1], 1)
    if candidates is None:
        return None
    small = cost.Pixels(left[..., None], right[..., None], 1.0)
    found, _, _ = _fused.match("zncc", small, candidates, (15, 7), "parabola", 1.0, uniqueness, threads)
    return found


def _match_upsampled(
    pixels: cost.Pixels,
    chosen: Settings,
    how: tuple[int, str],
    seen: Disparities,
    timings: dict[str, float],
) -> tuple[DisparityMap, npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
    """Match images with more columns; what their own columns are answered, in pixels."""
    factor, interpolation = how
    with _timed(timings, "upsample"):
        left, right = (upsample.columns(image, factor, interpolation) for image in pixels[:2])
    width, height = chosen.cost.size
    with _timed(timings, "match"):
        disparity, confidence, flags = _fused.match(
            _kind(chosen),
            cost.Pixels(left, right, pixels.step),
            Disparities(factor * seen.min, factor * (seen.max - 1) + 1),
            (factor * width, height),
            _fit(chosen.subpixel),
            None if chosen.left_right is None else factor * chosen.left_right,
            None,
            chosen.threads,
        )
    own = np.s_[:, ::factor]
    return disparity[own] / np.float32(factor), confidence[own].copy(), flags[own].copy()


def _compose(
    pixels: cost.Pixels,
    chosen: Settings,
    seen: Disparities,
    timings: dict[str, float],
    stages: dict[str, npt.NDArray[Any]],
    edges: npt.NDArray[np.uint8] | None = None,
) -> tuple[DisparityMap, npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
    """Stage by stage, through a cost volume: what the streaming path is measured against.

    Where P2 is adapted to an image it is to `edges`; None: to the left one of the pixels.
    """
    kind, window, threads, solver = _kind(chosen), chosen.cost.size, chosen.threads, chosen.optimize
    sampling, (height, width) = _sampling(chosen), pixels.left.shape[:2]
    if isinstance(solver, optimize.SecondPass):
        guide = _first_labels(pixels, chosen, seen, timings)
        kind = solver.data or kind
    volume = _volume(kind, pixels, chosen, seen, timings)
    unit = _unit(kind, pixels.step)
    if isinstance(solver, optimize.SecondPass):
        weighed = kind in ("ncc", "zncc") or kind not in cost.KINDS or chosen.cost.support is not None
        mean = 1 if weighed else window[0] * window[1] * pixels.left.shape[2]
        with _timed(timings, "optimize"):
            into = volume if volume.dtype == np.float32 else None
            volume = optimize.second_pass(
                volume, guide, solver.smoothness, window, unit / mean, threads, into
            )
        solver, unit = None, 1.0
    perfect = -1.0 if kind in ("ncc", "zncc") else 0.0
    beyond = None
    if isinstance(solver, sgm.SGM):
        with _timed(timings, "optimize"):
            if edges is None and solver.contrast is not None:
                edges = _fused.guide_of(pixels)
            volume = _path_sums(volume, pixels, chosen, solver, perfect, unit, edges)
            beyond = sgm.out_of_view(volume, seen.min, threads)
        solver, unit, perfect = None, 1.0, 0.0

    if solver is None:
        with _timed(timings, "select"):
            winners = select.left(volume, seen.min, threads, width=width, sampling=sampling)
            if chosen.left_right is not None or "right_disparity" in chosen.keep:
                right = select.right(volume, seen.min, threads, width=width, sampling=sampling)
    else:
        with _timed(timings, "optimize"):
            labels = optimize.solve(volume, solver, threads).index
            winners = select.at(volume, labels, seen.min, threads)
            # Plain winners would disagree with what the neighbours have talked each other into.
            if chosen.left_right is not None or "right_disparity" in chosen.keep:
                right = optimize.solve(optimize.right_view(volume, seen.min, threads), solver, threads).index

    around = winners.cost, winners.before, winners.after
    flags = np.zeros(winners.index.shape, np.uint8)
    with _timed(timings, "refine"):
        offset = refine.subpixel(_fit(chosen.subpixel), *around)
        # A label that its neighbours hold against its own costs has no extremum to fit.
        held = (winners.before < winners.cost) | (winners.after < winners.cost)
        disparity = (winners.index * sampling.disparity_step + np.int32(seen.min)).astype(np.float32)
        disparity += np.where(held, np.float32(0), offset) * np.float32(sampling.disparity_step)
        confidence = refine.confidence(perfect, *around)
    if beyond is not None:
        disparity = np.where(beyond < 0, disparity, np.float32(seen.min) + beyond.astype(np.float32))
    if chosen.planar is not None and isinstance(chosen.optimize, sgm.SGM):
        stages["winners"], stages["sharpness"] = disparity.copy(), confidence.copy()
    with _timed(timings, "validate"):
        _refuse(winners.index < 0, Flag.OUT_OF_VIEW, disparity, confidence, flags)
        if chosen.uniqueness is not None:
            ambiguous = validate.uniqueness(winners.cost, winners.second, perfect, chosen.uniqueness)
            _refuse(ambiguous & (winners.index >= 0), Flag.AMBIGUOUS, disparity, confidence, flags)
        if chosen.left_right is not None:
            failed = validate.left_right(winners.index, right, seen.min, chosen.left_right, sampling)
            for flag in (Flag.OCCLUDED, Flag.MISMATCHED):
                _refuse(failed == flag, flag, disparity, confidence, flags)
        if beyond is not None:
            flags[beyond >= 0] = 0
            _refuse(beyond >= 0, Flag.OUT_OF_VIEW, disparity, confidence, flags)

    if "costs" in chosen.keep:
        stages["costs"] = _presented(volume, chosen, unit, seen)
    if "right_disparity" in chosen.keep:
        found = right * sampling.disparity_step + np.int32(seen.min)
        there = np.where(right < 0, np.nan, found).astype(np.float32)
        stages["right_disparity"] = there[_nearest(height, sampling.step)]
    if sampling.step > 1:
        nearest = np.ix_(_nearest(height, sampling.step), _nearest(width, sampling.step))
        return disparity[nearest], confidence[nearest], flags[nearest]
    return disparity, confidence, flags


def _path_sums(
    volume: npt.NDArray[Any],
    pixels: cost.Pixels,
    chosen: Settings,
    solver: sgm.SGM,
    perfect: float,
    unit: float,
    guide: npt.NDArray[np.uint8] | None,
) -> npt.NDArray[np.uint16]:
    """The volume of semi-global matching."""
    largest = 2.0 if perfect else sgm.largest_in_view(volume, perfect, unit)
    if isinstance(chosen.cost, pixelwise.Pixelwise):
        largest = chosen.cost.largest(pixels.left.shape[2])
    step = solver.unit_for(largest, whole=volume.dtype.kind in "iu" and unit == 1)
    costs = sgm.quantised(volume, perfect, unit, step, largest)
    most = sgm.most_units(largest, step)
    return sgm.sums(costs, solver, step, most, guide, chosen.threads)


def _volume(
    kind: str, pixels: cost.Pixels, chosen: Settings, seen: Disparities, timings: dict[str, float]
) -> npt.NDArray[Any]:
    """Costs of the window, or of the support, for every candidate: (H, W, D)."""
    window, threads, sampling = chosen.cost.size, chosen.threads, _sampling(chosen)
    if isinstance(chosen.cost, pixelwise.Pixelwise) and kind == _kind(chosen):
        tables = None
        if pixelwise.needs_information(chosen.cost):
            with _timed(timings, "information"):
                tables = information.tables(*pixels[:2], seen, threads)
        with _timed(timings, "cost"):
            costs = pixelwise.volume(chosen.cost, *pixels[:2], seen, threads, tables, pixels.limits)
            return _sampled(costs, sampling)
    if chosen.cost.support is not None:
        with _timed(timings, "weigh"):
            weighed: npt.NDArray[Any] = weigh.volume(
                chosen.cost.support, kind, *pixels[:3], seen, sampling, threads
            )
            return weighed
    if chosen.optimize is not None and _fused.serves_volume(kind, pixels, window):
        with _timed(timings, "cost"):
            return _fused.volume(kind, pixels, seen, window, threads)
    if kind == "zsad":
        with _timed(timings, "cost"):
            return _sampled(cost.zsad(pixels, seen, window, threads), sampling)
    with _timed(timings, "cost"):
        terms = cost.terms(kind, pixels, seen, window, threads)
    with _timed(timings, "aggregate"):
        sums = aggregate.box(terms, window, threads)
    with _timed(timings, "score"):
        return _sampled(cost.score(kind, sums, pixels, seen, window, threads), sampling)


def _first_labels(
    pixels: cost.Pixels, chosen: Settings, seen: Disparities, timings: dict[str, float]
) -> npt.NDArray[np.int32]:
    """The plain winners that a second pass starts from, as candidate numbers; -1 for none."""
    kind, threads = _kind(chosen), chosen.threads
    if chosen.cost.support is not None or isinstance(chosen.cost, pixelwise.Pixelwise):
        return select.left(_volume(kind, pixels, chosen, seen, timings), seen.min, threads).index
    with _timed(timings, "first"):
        first, _, _ = _fused.match(kind, pixels, seen, chosen.cost.size, None, None, None, threads)
        return np.where(np.isnan(first), -1, first - np.float32(seen.min)).astype(np.int32)


def _streams(chosen: Settings, pixels: cost.Pixels) -> bool:
    """Whether the streaming path serves these settings."""
    if COMPOSED_ONLY & set(chosen.keep) or _sampling(chosen) != EVERY:
        return False
    if isinstance(chosen.optimize, sgm.SGM):
        return _fused.serves_sgm(chosen.cost, pixels, chosen.optimize, cast(Disparities, chosen.disparities))
    if chosen.optimize is not None:
        return False
    if isinstance(chosen.cost, pixelwise.Pixelwise):
        return False
    match chosen.cost.support:
        case None:
            return True
        case Gaussian():
            return _fused.serves_gaussian(_kind(chosen), pixels)
        case Bilateral() | Cross() | Adaptive():
            return False


def _sampling(chosen: Settings) -> Sampling:
    return Sampling(chosen.step, chosen.disparity_step)


def _sampled(volume: npt.NDArray[Any], sampling: Sampling) -> npt.NDArray[Any]:
    step, disparity_step = sampling
    return np.ascontiguousarray(volume[::step, ::step, ::disparity_step])


def _nearest(side: int, step: int) -> npt.NDArray[np.int64]:
    """For each of `side` pixels the number of the nearest that was matched; of two the first."""
    matched = -(-side // step)
    return np.minimum((np.arange(side) + (step - 1) // 2) // step, matched - 1)


def _unit(kind: str, step: float) -> float:
    """What one unit of a cost is worth in the image's own grey levels, or their squares."""
    return {"sad": step, "zsad": step, "ssd": step * step, "zssd": step * step}.get(kind, 1.0)


def _merge(
    pixels: cost.Pixels,
    chosen: Settings,
    seen: Disparities,
    timings: dict[str, float],
    stages: dict[str, npt.NDArray[Any]],
    frame: Frame | None,
) -> tuple[DisparityMap, npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
    """Along several planes and with several windows: for each pixel the best of what streaming gave."""
    width = pixels.left.shape[1]
    with _timed(timings, "planes"):
        told = frame is not None and frame.planes is not None
        planes = _told(frame) if told else _planes(pixels, chosen, seen)
    with _timed(timings, "match"):
        windows = (chosen.cost.size, *chosen.extra_windows)
        best = _along(pixels, planes, windows, chosen, seen)
    if chosen.left_right is not None or "right_disparity" in chosen.keep:
        with _timed(timings, "right"):
            # Mirrored, the right image is a left one, and all disparities keep their sign.
            left, right = (np.ascontiguousarray(image[:, ::-1]) for image in pixels[:2])
            swapped = cost.Pixels(right, left, pixels.step)
            mirrored = [plane.mirrored(width) for plane in planes]
            other = _along(swapped, mirrored, windows[:1], chosen.changed(uniqueness=None), seen)
            right_disparity = np.ascontiguousarray(other.disparity[:, ::-1])
    disparity, confidence, flags = best.disparity, best.confidence, best.flags
    _refuse(flags != 0, Flag(0), disparity, confidence, flags)
    if chosen.left_right is not None:
        with _timed(timings, "validate"):
            failed = validate.left_right_maps(
                disparity, right_disparity, seen, chosen.left_right, chosen.threads
            )
            for flag in (Flag.OCCLUDED, Flag.MISMATCHED):
                _refuse(failed == flag, flag, disparity, confidence, flags)
    if "right_disparity" in chosen.keep:
        stages["right_disparity"] = right_disparity
    if "planes" in chosen.keep:
        stages["planes"] = np.array(planes, np.float64).reshape(-1, 3)
        stages["plane"] = best.plane
    return disparity, confidence, flags


def _told(frame: Frame | None) -> list[slant.Plane]:
    """The whole image's planes, as they lie in the part."""
    if frame is None or frame.planes is None:
        return []
    return [slant.Plane(a, b, c + a * frame.left + b * frame.top) for a, b, c in frame.planes]


def _planes(pixels: cost.Pixels, chosen: Settings, seen: Disparities) -> list[slant.Plane]:
    """Planes of a first, fronto-parallel map, of which only what passes two checks counts."""
    if chosen.slant is None:
        return []
    first, _, _ = _fused.match(
        _kind(chosen), pixels, seen, slant.FIRST_WINDOW, _fit(chosen.subpixel), 1.0, 5.0, chosen.threads
    )
    if chosen.slant == "planes":
        return slant.planes(first, chosen.cost.size, threads=chosen.threads)
    ground = slant.road(first, chosen.cost.size, threads=chosen.threads)
    return [] if ground is None else [ground]


def _along(
    pixels: cost.Pixels,
    planes: list[slant.Plane],
    windows: tuple[tuple[int, int], ...],
    chosen: Settings,
    seen: Disparities,
) -> slant.Hypothesis:
    """The best of all planes and windows; fronto-parallel windows are one of the planes."""
    kind, threads = _kind(chosen), chosen.threads
    number = cost.KINDS.index(kind)
    shape: tuple[int, int] = pixels.left.shape[:2]
    passes = [(slant.LEVEL, pixels, seen)]
    for plane in planes:
        views = slant.warped(pixels.left, pixels.right, plane, slant.MARGIN, threads)
        passes.append((plane, cost.Pixels(*views, pixels.step), slant.NEAR))
    best, variance = slant.Hypothesis.nothing(shape), np.full(shape, np.inf, np.float32)
    for window in windows:
        found = slant.Hypothesis.nothing(shape)
        for which, (plane, view, candidates) in enumerate(passes):
            costs = np.empty(view.left.shape[:2], np.float32)
            winners = _fused.match(
                kind, view, candidates, window, _fit(chosen.subpixel), None, chosen.uniqueness, threads, costs
            )
            factor = slant.handicap(candidates.span, seen.span, window)
            slant.merge_pass(found, winners, costs, number, plane, which, factor, seen, threads)
        slant.merge_window(best, variance, found, number, threads)
    return best


def _presented(
    volume: npt.NDArray[Any], chosen: Settings, unit: float, seen: Disparities
) -> npt.NDArray[Any]:
    """The volume over the whole range that was asked for, in the image's own units."""
    asked, apart = cast(Disparities, chosen.disparities), chosen.disparity_step
    worst = worst_cost(volume.dtype)
    whole = np.full((*volume.shape[:2], -(-asked.span // apart)), worst, volume.dtype)
    first = (seen.min - asked.min) // apart
    whole[..., first : first + volume.shape[2]] = volume
    if unit == 1:
        return whole
    with np.errstate(over="ignore"):  # what float32 cannot hold is infinite
        return np.where(whole < worst, whole.astype(np.float64) * unit, np.inf).astype(np.float32)


def volume(pixels: cost.Pixels, chosen: Settings) -> npt.NDArray[Any]:
    """Every candidate's cost, (H, W, D) as ``keep="costs"`` has it, of pixels that are at hand already."""
    chosen = chosen.changed(keep=("costs",), vertical=None)
    kept = _match(Pair(pixels.left, pixels.right), chosen, time.perf_counter(), {}, pixels)
    return kept.stages["costs"]


def estimate_disparities(left: Image, right: Image, *, threads: int = 0) -> Disparities:
    """The range of disparities of a pair, from its images alone.

    Both images are shrunk to at most 256 columns by averaging, and matched (ZNCC 9 x 9) over every
    disparity from minus an eighth to five eighths of the width. What survives a left-right check, a
    uniqueness check and a speckle filter (of a 500th of the pixels) spans the range, from its 0.1 % to
    its 99.9 % quantile; a margin of three shrunken pixels plus a tenth of the span is added on both
    sides. Negative disparities are searched where a twentieth of what survives is negative. Where less
    than 1 % of the pixels survive, the range is a quarter of the width.

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
    pair = _pair(left, right)
    factor = shrinking(pair.left.shape[1])
    small = Pair(shrunk(pair.left, factor), shrunk(pair.right, factor))
    return disparities_of_shrunk(small, pair.left.shape[1], threads)


def shrinking(width: int) -> int:
    """By how much images of so many columns are shrunk for an estimate of their range."""
    return max(1, -(-width // 256))


def disparities_of_shrunk(small: Pair, width: int, threads: int = 0) -> Disparities:
    """The range of images of so many columns, from these images shrunken; see `estimate_disparities`."""
    factor = shrinking(width)
    columns = small.left.shape[1]
    search = Disparities(-(columns // 8) - 1, columns * 5 // 8 + 2)
    probe = Settings(
        disparities=search,
        cost=settings.ZNCC(9),
        left_right=1,
        uniqueness=10,
        speckle=(max(12, small.left.size // 500), 1.0),
        threads=threads,
    )
    found = _match(small, probe, time.perf_counter(), {})
    reliable = found.disparity[np.isfinite(found.disparity)]
    if reliable.size < 0.01 * found.disparity.size or not reliable.size:
        return Disparities(0, max(1, width // 4))
    low, high = quantile(reliable, 0.001), quantile(reliable, 0.999)
    margin = 3 + 0.1 * (high - low)
    lowest = int(np.floor((low - margin) * factor))
    # Parallel cameras see no negative disparity: a few wrong matches are no reason to search for one.
    if np.mean(reliable < -1) < 0.05:
        lowest = max(lowest, 0)
    return Disparities(lowest, max(lowest + 1, int(np.ceil((high + margin) * factor)) + 1))


def estimate_vertical(
    left: Image, right: Image, disparities: tuple[int, int], *, threads: int = 0
) -> Vertical:
    """Rows that the right image lies too low, from the pair's images alone.

    Points with texture in both directions are followed from the left image into the right one, in columns and
    rows, from where a map of shrunken images (ZNCC 15 x 7, with its checks) has them; a field of four terms
    is fitted to the rows that they moved. Where most are lost on the way, or the field leads far, they are
    followed once more from other rows.

    Parameters
    ----------
    left, right : ndarray, (H, W) or (H, W, 3)
        A pair that is rectified but for some 16 rows; more in images of more than 3200 columns.
    disparities : (int, int)
        Candidates ``min, ..., max - 1`` in pixels.
    threads : int
        0: all cores.

    Returns
    -------
    Vertical
        Zero where the field is not significant, or too small to be worth undoing.
    """
    pair, candidates = _pair(left, right), settings.as_disparities(disparities)
    threads = Settings(threads=threads).threads
    return _vertical(cost.pixels(pair.left, pair.right, "grey", threads), candidates, threads)


def _with_vertical(
    pair: Pair, chosen: Settings, timings: dict[str, float]
) -> tuple[Settings, cost.Pixels | None]:
    """The settings with what was found, and the pixels that were read where these are those to match."""
    with _timed(timings, "read"):
        pixels = cost.pixels(pair.left, pair.right, "grey", chosen.threads)
    with _timed(timings, "vertical"):
        lies = _vertical(pixels, cast(Disparities, chosen.disparities), chosen.threads)
    return chosen.changed(vertical=lies), pixels if chosen.channels == "grey" else None


def _vertical(pixels: cost.Pixels, disparities: Disparities, threads: int) -> Vertical:
    width = pixels.left.shape[1]
    count = rectify.levels(width)
    mine, other = (rectify.pyramid(rectify.eight_bit(image[..., 0]), count, threads) for image in pixels[:2])
    points = rectify.corners(mine[0], rectify.tile_of(mine[0].size), threads)

    def follow(first: rectify.FirstMap) -> rectify.Sights:
        return rectify.sights(mine, other, points, first, threads)

    return vertical_of(mine[-1], other[-1], disparities, pixels.left.shape, follow, threads)


def vertical_of(
    left: rectify.Bytes,
    right: rectify.Bytes,
    disparities: Disparities,
    shape: tuple[int, ...],
    follow: Callable[[rectify.FirstMap], rectify.Sights],
    threads: int = 0,
) -> Vertical:
    """The field of images of that shape.

    Parameters
    ----------
    left, right : ndarray of uint8
        Both, halved `rectify.levels` times.
    disparities : Disparities
        Of the whole images.
    shape : (H, W, ...)
    follow : callable
        Follows points from a map of the halved images to the whole ones.
    threads : int
    """
    levels = rectify.levels(shape[1])
    seen = _in_view(disparities, shape[1], 1)
    if seen is None or min(left.shape) < 8:
        return Vertical(0.0)
    # A field needs no points at the very end of the range, and a candidate more may take another vector.
    nearly = Disparities(seen.min, max(seen.min + 1, seen.max - 2**levels))

    def coarse(field: Vertical) -> DisparityMap | None:
        small = Vertical(*(term / 2**levels for term in field))
        moved = rectify.undone(right[..., None], small, threads)[..., 0] if any(field) else right
        return _halved_map(left, moved, nearly, levels, None, threads)

    start = Vertical(0.0)
    beside = coarse(start)
    if beside is None:
        return start
    found = follow(rectify.FirstMap(beside))
    field = aim = rectify.fit(found, shape)
    if found.lost:
        most = max(rectify.FAR >> levels, rectify.FAR_SMALL)
        rows = _other_rows(beside, lambda rows: coarse(Vertical(float(rows * 2**levels))), most)
        aim = Vertical(float(rows * 2**levels)) if rows else field
    for _ in range(rectify.ROUNDS):
        if not rectify.far_from(aim, start):
            break
        nearer = coarse(aim)
        assert nearer is not None
        again = follow(rectify.FirstMap(nearer, aim))
        if len(again.rows) <= len(found.rows):
            break
        start, found = aim, again
        field = aim = rectify.fit(found, shape)
    return field


def _other_rows(beside: DisparityMap, coarse: Callable[[int], DisparityMap | None], most: int) -> int:
    """By how many rows, at most, the right image has to be moved for most pixels to be answered."""
    answers = {0: np.count_nonzero(np.isfinite(beside))}
    for far in range(1, most + 1):
        for rows in (-far, far):
            found = coarse(rows)
            assert found is not None
            answers[rows] = np.count_nonzero(np.isfinite(found))
        if far == 1 and max(answers[-1], answers[1]) < rectify.PEAK * answers[0]:
            break
    best = max(answers, key=answers.__getitem__)  # of equals the nearest
    return best if answers[best] > rectify.MORE * answers[0] else 0


def shrunk(image: Image, factor: int) -> Image:
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
        start = settings.PLAIN if "cost" in changes else settings.named(settings.DEFAULT_PRESET)
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
        advice = f": {name}.astype(np.float32) is" if image.dtype == np.float64 else ""
        raise TypeError(f"{name} must be uint8, uint16 or float32, not {image.dtype}{advice}")
    if not (image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)):
        raise ValueError(
            f"{name} must be (H, W) or (H, W, 3), not of shape {image.shape}{_as_hw3(name, image.shape)}"
        )
    if image.size == 0 or max(image.shape) >= 2**24:
        raise ValueError(f"{name} must have from 1 to 2^24 - 1 rows and columns, not the shape {image.shape}")
    if image.dtype == np.float32 and not np.isfinite(image).all():
        bad = int(np.count_nonzero(~np.isfinite(image)))
        raise ValueError(f"{name} must be finite; it holds {bad} NaN or infinite values")


def _as_hw3(name: str, shape: tuple[int, ...]) -> str:
    """How other layouts of images are made one that is taken."""
    match shape:
        case (_, _, 1):
            return f": {name}[..., 0] is"
        case (_, _, 4):
            return f": {name}[..., :3] is"
        case (3, _, _):
            return f": np.moveaxis({name}, 0, 2) is"
        case _:
            return ""


def _kind(chosen: Settings) -> str:
    return type(chosen.cost).__name__.lower()


def _in_view(asked: Disparities, width: int, apart: int) -> Disparities | None:
    """The candidates that some pixel can see, of those `apart` apart."""
    low, high = max(asked.min, 1 - width), min(asked.max, width)
    low += (asked.min - low) % apart
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
    np.putmask(disparity, where, np.float32(np.nan))  # several times as fast as copyto
    np.putmask(confidence, where, np.float32(0))
    if flag:
        flags |= where.view(np.uint8) * np.uint8(flag)


@contextmanager
def _timed(timings: dict[str, float], stage: str) -> Iterator[None]:
    start = time.perf_counter()
    yield
    timings[stage] = timings.get(stage, 0.0) + time.perf_counter() - start
