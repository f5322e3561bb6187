"""What no tile can tell alone, found once of the whole pair, a band of rows at a time."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np
import numpy.typing as npt

from stereopsis import (
    blank,
    cost,
    noise,
    pipeline,
    pixelwise,
    quantum,
    rectify,
    sgm,
    sharpen,
    slant,
    validate,
)
from stereopsis.io.parts import Source
from stereopsis.settings import Settings, WindowCost
from stereopsis.tiling import reach
from stereopsis.tiling.grid import Tile, tile
from stereopsis.tiling.parts import Changed, Known, match_tile, without_borders
from stereopsis.types import Disparities, Frame, Halo, Image, Pair, Rectangle, Vertical

BAND = 2**25
"""Pixels of a band of rows, about, where nobody says."""
SMALL = 2**23
"""Levels of the pyramid with at most so many pixels are held whole."""
SAMPLE = 2**22
"""Pixels from which the ends of an image's range are taken, at most."""
FOLLOWED = 20
"""How far about a point it may be followed at one level, its window included."""


def survey(
    left: Source,
    right: Source,
    settings: Settings,
    *,
    band: int = BAND,
    progress: Callable[[str], None] | None = None,
) -> Known:
    """Everything that is estimated from the images, and what else a tile has to know of the whole.

    Parameters
    ----------
    left, right : Source
        A rectified pair, of one shape and dtype.
    settings : Settings
    band : int
        How many pixels are held at once, about.
    progress : callable, optional
        Told what begins.

    Returns
    -------
    Known

    Raises
    ------
    ValueError
        For settings that tiles cannot serve.
    """
    reach.refuse(settings)
    whole = _Pair(left, right, settings, band)
    told = progress or (lambda what: None)
    chosen = settings
    borders: pipeline.Borders = (None, None)
    if settings.blank:
        told("borders")
        borders = _borders(whole)
        left, right = without_borders((left, right), borders)
        whole = _Pair(left, right, settings, band)
    if left.dtype != np.uint8 and quantum.wanted(settings):
        told("levels")
        step = quantum.of(image.read(part) for _, part in whole.bands() for image in (left, right))
        if step is not None:
            whole = _Pair(_in_bytes(left, step), _in_bytes(right, step), settings, band, step=step)
    if whole.left.dtype == np.float32:
        told("brightness")
        whole.largest = _largest(whole)
    if chosen.disparities is None:
        told("range")
        chosen = chosen.changed(disparities=_range(whole))
    if chosen.vertical == "estimate":
        told("rows")
        chosen = chosen.changed(vertical=_vertical(whole, cast(Disparities, chosen.disparities)))
    if chosen.sharpen == "auto":
        told("blur")
        chosen = chosen.changed(sharpen=_sharpen(whole))
    if chosen.texture == "auto":
        told("noise")
        chosen = chosen.changed(texture=_texture(whole))
    if chosen.sky == "auto":
        # No tile knows where the image's horizon is.
        chosen = chosen.changed(sky=False)
    frame = Frame((left.shape[0], left.shape[1]))
    moves = isinstance(chosen.vertical, Vertical) and any(chosen.vertical)
    if moves:
        told("brightness")
        frame = dataclasses.replace(frame, limits=_limits(whole, None, frame))
    if _takes_levels(chosen) and whole.left.dtype != np.uint8:
        told("levels")
        vertical = cast(Vertical, chosen.vertical) if moves else None
        ends = _limits(whole, vertical, frame)
        frame = dataclasses.replace(frame, levels=(min(ends[::2]), max(ends[1::2])))
    return Known(chosen, frame, whole.largest, whole.step, borders)


def _in_bytes(source: Source, step: float) -> Source:
    """The image, counted in steps of so many grey levels."""
    return Changed(source, np.dtype(np.uint8), lambda image, part: quantum.in_bytes(image, step))


@dataclasses.dataclass
class _Pair:
    """The whole pair, read in bands of rows."""

    left: Source
    right: Source
    settings: Settings
    band: int
    largest: float | None = None
    step: float | None = None

    @property
    def shape(self) -> tuple[int, int]:
        return self.left.shape[0], self.left.shape[1]

    def rows(self, multiple: int) -> int:
        """How many rows a band has: a multiple of so many."""
        return max(1, self.band // self.shape[1] // multiple) * multiple

    def bands(self, multiple: int = 1, beyond: int = 0) -> Iterator[tuple[int, Rectangle]]:
        """Each band's first row, and the band with so many rows more below it."""
        height, width = self.shape
        for top in range(0, height, self.rows(multiple)):
            yield top, Rectangle(top, min(height, top + self.rows(multiple) + beyond), 0, width)

    def pixels(self, part: Rectangle, channels: str | None = None) -> cost.Pixels:
        """As matching takes them."""
        chosen = self.settings
        images = self.left.read(part), self.right.read(part)
        found = cost.pixels(*images, channels or chosen.channels, chosen.threads, self.largest)
        return found._replace(step=self.step or found.step)


def _borders(whole: _Pair) -> pipeline.Borders:
    """Of both images."""
    left, right = (
        blank.border_of(partial(_read_bands, whole, source), source.shape)
        for source in (whole.left, whole.right)
    )
    return left, right


def _read_bands(whole: _Pair, source: Source) -> Iterator[tuple[int, Image]]:
    return ((top, source.read(part)) for top, part in whole.bands())


def _largest(whole: _Pair) -> float:
    return max(
        float(np.abs(image.read(part)).max())
        for _, part in whole.bands()
        for image in (whole.left, whole.right)
    )


def _range(whole: _Pair) -> Disparities:
    """What `pipeline.estimate_disparities` gives, from means that are taken a band at a time."""
    return pipeline.disparities_of_shrunk(
        _shrunk(whole, pipeline.shrinking(whole.shape[1])), whole.shape[1], whole.settings.threads
    )


def _shrunk(whole: _Pair, factor: int) -> Pair:
    if min(whole.shape) < factor:
        everything = Rectangle(0, whole.shape[0], 0, whole.shape[1])
        left, right = (pipeline.shrunk(image.read(everything), factor) for image in (whole.left, whole.right))
        return Pair(left, right)
    parts: tuple[list[npt.NDArray[Any]], list[npt.NDArray[Any]]] = [], []
    for _, part in whole.bands(factor):
        if part.shape[0] < factor:
            continue  # rows that fill no block are left out
        for into, image in zip(parts, (whole.left, whole.right), strict=True):
            into.append(pipeline.shrunk(image.read(part), factor))
    left, right = (np.concatenate(rows) for rows in parts)
    return Pair(left, right)


def _sharpen(whole: _Pair) -> float:
    """The amount of sharpen="auto"."""
    sums = np.zeros(2)
    for _, part in whole.bands(beyond=2):
        sums += sharpen.steps(whole.pixels(part).left)
    return sharpen.amount_for(sums)


def _texture(whole: _Pair) -> float:
    """The threshold of texture="auto"."""
    level = 1.0
    means = []
    for top, part in whole.bands(noise.BLOCK, beyond=2):
        pixels = whole.pixels(part)
        level = pixels.level
        # What is left at the image's end is no block, unless it is the whole image.
        if top == 0 or part.shape[0] >= noise.BLOCK + 2:
            means.append(noise.block_means(pixels.left, threads=whole.settings.threads))
    deviation = noise.deviation_of(np.concatenate(means)) if means else 0.0
    return validate.texture_of_noise(deviation * level, whole.settings.cost.size)


def _takes_levels(chosen: Settings) -> bool:
    contrast = isinstance(chosen.optimize, sgm.SGM) and chosen.optimize.contrast is not None
    smoothed = chosen.weighted_median is not None or chosen.edge_aware is not None
    guided = smoothed or chosen.fill == "surfaces" or chosen.confidence is not None
    compared = chosen.outlines or chosen.photometric
    return isinstance(chosen.cost, pixelwise.Pixelwise) or contrast or guided or compared


def _limits(whole: _Pair, vertical: Vertical | None, frame: Frame) -> tuple[int, int, int, int]:
    """Least and greatest pixel of the left image and of the right one, the rows of which may be moved."""
    around = Halo() if vertical is None else rectify.halo(vertical)
    ends = []
    for _, band in whole.bands():
        core, part = tile(band, whole.shape, around)
        left, right, *_ = whole.pixels(part)
        if vertical is not None:
            at = dataclasses.replace(frame, top=part.top)
            right = rectify.undone(right, vertical, whole.settings.threads, at)
        rows = slice(core.top - part.top, core.bottom - part.top)
        ends.append((left[rows].min(), left[rows].max(), right[rows].min(), right[rows].max()))
    found = np.array(ends, np.int64)
    least, most = found.min(axis=0), found.max(axis=0)
    return int(least[0]), int(most[1]), int(least[2]), int(most[3])


def with_planes(
    left: Source,
    right: Source,
    known: Known,
    tiles: Sequence[Tile],
    progress: Callable[[int], None] | None = None,
) -> Known:
    """The planes along which windows are matched, from a first map of the whole pair, made in tiles.

    Parameters
    ----------
    left, right : Source
    known : Known
    tiles : sequence of Tile
        They cover the image, with the halo of the settings.
    progress : callable, optional
        Told how many tiles are finished.

    Returns
    -------
    Known
        The same without `slant`.
    """
    chosen = known.settings
    if chosen.slant is None:
        return known
    # What is matched along them is bowed too, until the end.
    frame = dataclasses.replace(known.frame, bowed=True)
    first = dataclasses.replace(known, settings=_level(chosen), frame=frame)
    step = slant.thinning(math.prod(known.frame.shape))
    rows, columns = (-(-side // step) for side in known.frame.shape)
    thinned = np.full((rows, columns), np.nan, np.float32)
    for number, one in enumerate(tiles):
        core = one.core
        found = match_tile(left, right, first, one).disparity[
            -core.top % step :: step, -core.left % step :: step
        ]
        top, left_ = -(-core.top // step), -(-core.left // step)
        thinned[top : top + found.shape[0], left_ : left_ + found.shape[1]] = found
        if progress is not None:
            progress(number + 1)
    if chosen.slant == "planes":
        planes = slant.planes(thinned, chosen.cost.size, step=step)
    else:
        ground = slant.road(thinned, chosen.cost.size, step)
        planes = [] if ground is None else [ground]
    told = tuple((plane.a, plane.b, plane.c) for plane in planes)
    return dataclasses.replace(known, frame=dataclasses.replace(known.frame, planes=told))


def _level(chosen: Settings) -> Settings:
    """Of the map that `pipeline` fits planes to: nothing but fronto-parallel winners that pass its checks."""
    off = dict.fromkeys(("texture", "median", "speckle", "planar", "fill", "weighted_median", "edge_aware"))
    subpixel = chosen.subpixel
    if subpixel not in (None, "parabola", "equiangular"):
        subpixel = "parabola" if subpixel.startswith("lucas-kanade") else None
    level = chosen.changed(
        slant=None,
        extra_windows=(),
        subpixel=subpixel,
        confidence=None,
        least_confidence=None,
        outlines=False,
        photometric=False,
        **off,
    )
    if isinstance(chosen.optimize, sgm.SGM):
        return level
    cost = dataclasses.replace(cast(WindowCost, level.cost), window=slant.FIRST_WINDOW)
    return level.changed(cost=cost, left_right=1.0, uniqueness=5.0)


# ---- rows that the right image lies too low ------------------------------------------


class _Levels(NamedTuple):
    """Both images, halved so often that they are small, and then on."""

    left: list[rectify.Bytes]
    right: list[rectify.Bytes]


def _vertical(whole: _Pair, disparities: Disparities) -> Vertical:
    """What `pipeline.estimate_vertical` gives; of the finest levels only what is around points is read."""
    height, width = whole.shape
    last = rectify.levels(width)
    held = 0
    while held < last and (height >> held) * (width >> held) > SMALL:
        held += 1
    ends = _ends(whole)
    levels = _levels(whole, held, last, ends)
    threads = whole.settings.threads
    corners = _corners(whole, ends[0])

    def follow(first: rectify.FirstMap) -> rectify.Sights:
        points, start = rectify.known(corners, first, last, whole.shape)
        motion, correlation = start.copy(), np.empty(len(points))
        if held < last:
            rectify.follow(levels.left[:-1], levels.right[:-1], points >> held, motion, correlation, threads)
            motion *= 2 if held else 1
        if held:
            _follow_finer(whole, held, ends, points, motion, correlation)
        return rectify.believed(points, motion, correlation, start, last)

    return pipeline.vertical_of(levels.left[-1], levels.right[-1], disparities, whole.shape, follow, threads)


def _ends(whole: _Pair) -> list[tuple[float, float] | None]:
    """The ends of both images' ranges, for pixels that are no bytes."""
    if whole.left.dtype == np.uint8:
        return [None, None]
    height, width = whole.shape
    step = max(3, math.ceil(math.sqrt(height * width / SAMPLE)))
    samples: tuple[list[npt.NDArray[Any]], list[npt.NDArray[Any]]] = [], []
    for _, part in whole.bands(step):
        for into, image in zip(samples, whole.pixels(part, "grey")[:2], strict=True):
            into.append(image[::step, ::step, 0].ravel())
    return [rectify.ends_of(np.concatenate(sample)) for sample in samples]


def _levels(whole: _Pair, held: int, last: int, ends: list[tuple[float, float] | None]) -> _Levels:
    bands: tuple[list[rectify.Bytes], list[rectify.Bytes]] = [], []
    for _, part in whole.bands(2**held):
        for into, image, range in zip(bands, whole.pixels(part, "grey")[:2], ends, strict=True):
            into.append(rectify.pyramid(rectify.eight_bit(image[..., 0], range), held)[-1])
    left, right = (rectify.pyramid(np.concatenate(rows), last - held) for rows in bands)
    return _Levels(left, right)


def _corners(whole: _Pair, ends: tuple[float, float] | None) -> npt.NDArray[np.int32]:
    """Corners of the left image: of a band with a row of squares more above and below, those of the band."""
    height, width = whole.shape
    tile = rectify.tile_of(height * width)
    found = []
    for top, part in whole.bands(tile):
        first = max(0, top - tile)
        around = Rectangle(first, min(height, part.bottom + tile), 0, width)
        image = cost.pixels(
            *(whole.left.read(around),) * 2, "grey", whole.settings.threads, whole.largest
        ).left
        points = rectify.corners(rectify.eight_bit(image[..., 0], ends), tile, whole.settings.threads)
        points[:, 1] += first
        last = min(part.bottom, height // tile * tile)
        found.append(points[(points[:, 1] >= top) & (points[:, 1] < last)])
    return np.concatenate(found)


def _follow_finer(
    whole: _Pair,
    held: int,
    ends: list[tuple[float, float] | None],
    points: npt.NDArray[np.int32],
    motion: npt.NDArray[np.float64],
    correlation: npt.NDArray[np.float64],
) -> None:
    """Follow each point through the levels that are not held, in what lies around it."""
    (height, width), unit = whole.shape, 2 ** (held - 1)
    margin = FOLLOWED * unit
    for k, (x, y) in enumerate(points.tolist()):
        if not np.isfinite(motion[k]).all():
            continue
        u, v = (float(part) * unit for part in motion[k])
        top, left = (max(0, int(min(at, at + by)) - margin) // unit * unit for at, by in ((y, v), (x, u)))
        bottom, right = (
            min(end, int(max(at, at + by)) + margin) for at, by, end in ((y, v, height), (x, u, width))
        )
        if bottom - top < 2 * unit or right - left < 2 * unit:
            continue
        pixels = whole.pixels(Rectangle(top, bottom, left, right), "grey")
        mine, other = (
            rectify.pyramid(rectify.eight_bit(image[..., 0], range), held - 1)
            for image, range in zip(pixels[:2], ends, strict=True)
        )
        at = np.array([[x - left, y - top]], np.int32)
        rectify.follow(mine, other, at, motion[k : k + 1], correlation[k : k + 1])
