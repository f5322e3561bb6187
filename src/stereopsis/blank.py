"""Where an image shows nothing: the black border that undistortion and rectification leave around it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from stereopsis import _core
from stereopsis.types import DisparityMap, Image, Rectangle

LEAST = 0.25
"""A border covers at least so much of one of the image's four sides..."""
FEW = 4
"""...of whose rows every so many-th is looked at."""
DARK = 0.1
"""Of the brightest pixel: what a lossy file may leave of black beside an edge..."""
NOISY = 16
"""...and how far from it, in pixels: one of JPEG's blocks."""
MOST = 0.75
"""Of a side that has a border all of which a lossy file has left nearly black."""
BLENDED = 1
"""Pixels beside a border that are half black: interpolation has mixed them with it."""

Places = npt.NDArray[np.int32]


class Border(NamedTuple):
    """What is black up to an image's ends, along its row or its column.

    Attributes
    ----------
    rows : ndarray of int32, (H, 2)
        The first column of each row that shows something, and the one after the last; 0, 0 where none does.
    columns : ndarray of int32, (W, 2)
        The same of the columns.
    row_pixels : ndarray, (H, 2) or (H, 2, 3)
        The pixels at both ends of what each row shows.
    column_pixels : ndarray, (W, 2) or (W, 2, 3)
        The same of the columns.
    """

    rows: Places
    columns: Places
    row_pixels: Image
    column_pixels: Image

    def blank(self, part: Rectangle | None = None) -> npt.NDArray[np.bool_]:
        """Where nothing is shown, (H, W), or in a part of the image."""
        part = part or Rectangle(0, len(self.rows), 0, len(self.columns))
        y, x = np.ogrid[part.slices]
        (left, right), (top, bottom) = self.rows[y[:, 0]].T[..., None], self.columns[x[0]].T
        found: npt.NDArray[np.bool_] = x < left
        for outside in (x >= right, y < top, y >= bottom):
            found |= outside
        return found

    def continued(self, image: Image, part: Rectangle | None = None, threads: int = 0) -> Image:
        """The image with the nearest pixels of their row or column in place of its border.

        So a window at the border sees what it sees at an image's end, and no outline of a border. In corners,
        where neither row nor column shows anything, pixels are those of the nearest row that does.

        Parameters
        ----------
        image : ndarray, (H, W) or (H, W, 3)
            The one that has this border, or a part of it.
        part : Rectangle, optional
            Where the image is cut from the whole one.
        threads : int

        Returns
        -------
        ndarray
            A copy.
        """
        whole = np.array(image, order="C")
        top, left = (0, 0) if part is None else (part.top, part.left)
        of_rows, of_columns = _bytes(self.row_pixels, 2), _bytes(self.column_pixels, 2)
        pixels = _bytes(whole, image.shape[1])
        _core.continue_over(self.rows, self.columns, of_rows, of_columns, top, left, pixels, threads)
        return whole


def border(image: Image) -> Border | None:
    """The black border around an image.

    Black is 0 in every channel; and, beside that, what is nearly so, as lossy files make it. Where less than
    `LEAST` of every side of the image is black, none of it is a border, however dark the image; nor where
    nothing else is shown.

    Parameters
    ----------
    image : ndarray, (H, W) or (H, W, 3)

    Returns
    -------
    Border or None
        None where there is none.
    """
    sides = image[0], image[-1], image[::FEW, 0], image[::FEW, -1]
    lit = (np.count_nonzero(side.any(axis=1) if side.ndim > 1 else side) for side in sides)
    if all(shown > (1 - LEAST) * len(side) for shown, side in zip(lit, sides, strict=True)):
        return None
    return border_of(lambda: [(0, image)], image.shape)


def border_of(bands: Callable[[], Iterable[tuple[int, Image]]], shape: tuple[int, ...]) -> Border | None:
    """The black border around an image that is read in bands of rows, twice if it has one.

    Parameters
    ----------
    bands : callable
        Gives the first row and the pixels of each.
    shape : (H, W) or (H, W, 3)
        Of the image.

    Returns
    -------
    Border or None
        As `border` has it.
    """
    height, width, *channels = shape
    rows = np.zeros((height, 2), np.int32)
    columns = np.tile(np.array([height, 0], np.int32), (width, 1))
    brightest = 0.0
    dtype = np.dtype(np.uint8)
    for top, band in bands():
        shown, dtype = ~_black(band), band.dtype
        rows[top : top + len(band)] = _ends(shown)
        first, end = _ends(shown.T).T
        some = end > 0
        columns[:, 0] = np.where(some, np.minimum(columns[:, 0], top + first), columns[:, 0])
        columns[:, 1] = np.where(some, top + end, columns[:, 1])
        brightest = max(brightest, float(band.max()))
    few = rows[::FEW]
    lit = few[:, 0] == 0, few[:, 1] == width, columns[:, 0] == 0, columns[:, 1] == height
    if not rows[:, 1].any() or all(np.count_nonzero(side) > (1 - LEAST) * len(side) for side in lit):
        return None
    # From each end as many pixels inwards as may turn out to belong to the border, and the next.
    inwards = np.arange(NOISY + BLENDED + 1)
    rows_at, columns_at = (
        np.stack([ends[:, :1] + inwards, ends[:, 1:] - 1 - inwards], axis=1).clip(0, length - 1)
        for ends, length in ((rows, width), (columns, height))
    )
    of_rows = np.zeros((height, 2, inwards.size, *channels), dtype)
    of_columns = np.zeros((width, 2, inwards.size, *channels), dtype)
    for top, band in bands():
        y = np.arange(top, top + len(band))
        of_rows[y] = band[y[:, None, None] - top, rows_at[y]]
        within = (columns_at >= top) & (columns_at < top + len(band))
        x = np.nonzero(within)[0]
        of_columns[within] = band[columns_at[within] - top, x]
    dark = DARK * brightest
    rows, row_pixels = _settled(rows, of_rows, width, dark)
    columns, column_pixels = _settled(columns, of_columns, height, dark)
    if not (rows.any() and columns.any()):
        return None
    return Border(rows, columns, row_pixels, column_pixels)


def _black(image: Image) -> npt.NDArray[np.bool_]:
    first, *others = [image] if image.ndim == 2 else np.moveaxis(image, 2, 0)
    found: npt.NDArray[np.bool_] = first == 0
    for channel in others:
        found &= channel == 0
    return found


def _ends(shown: npt.NDArray[np.bool_]) -> Places:
    """The first place of each line that shows something, and the one after its last; length, 0 for none."""
    length = shown.shape[1]
    first, last = shown.argmax(axis=1), length - shown[:, ::-1].argmax(axis=1)
    return np.where(shown.any(axis=1), [first, last], [[length], [0]]).T.astype(np.int32)


def _settled(ends: Places, pixels: Image, length: int, dark: float) -> tuple[Places, Image]:
    """The ends without what is nearly black or mixed with the border, and the pixels there."""
    black = np.all(pixels.reshape(*pixels.shape[:3], -1) <= dark, axis=3)
    off = np.stack([ends[:, 0], length - ends[:, 1]], axis=1)
    bordered = np.mean((off > 0) | black[..., 0], axis=0) >= MOST
    more = np.cumprod(black[..., :NOISY], axis=2).sum(axis=2) * (bordered | (off > 0))
    more += BLENDED * (off + more > 0)
    line, end = np.indices(more.shape)
    found = pixels[line, end, np.minimum(more, NOISY + BLENDED)]
    moved = ends + more * [1, -1]
    return np.where(moved[:, :1] < moved[:, 1:], moved, 0).astype(np.int32), found


def _bytes(pixels: Image, width: int) -> npt.NDArray[np.uint8]:
    """A view, (H, W, bytes of a pixel)."""
    return pixels.reshape(len(pixels), -1).view(np.uint8).reshape(len(pixels), width, -1)


def hidden(
    disparity: DisparityMap,
    borders: tuple[Border | None, Border | None],
    part: Rectangle | None = None,
    of_right: bool = False,
    threads: int = 0,
) -> npt.NDArray[np.bool_]:
    """Where one view shows nothing, or the other one where an answer points.

    Parameters
    ----------
    disparity : ndarray of float32, (H, W)
        NaN points nowhere.
    borders : (Border or None, Border or None)
        Around the left image and around the right one.
    part : Rectangle, optional
        Where the map lies in the whole image's.
    of_right : bool
        Whether the disparities are the right view's.
    threads : int

    Returns
    -------
    ndarray of bool, (H, W)
    """
    found = np.empty(disparity.shape, np.uint8)
    here, there = borders[::-1] if of_right else borders
    _core.find_hidden(
        np.ascontiguousarray(disparity),
        -1.0 if of_right else 1.0,
        None if here is None else here.rows,
        None if here is None else here.columns,
        None if there is None else there.rows,
        None if there is None else there.columns,
        0 if part is None else part.top,
        0 if part is None else part.left,
        found,
        threads,
    )
    return found.view(bool)
