"""Draw the pictures of the README and of these pages: python docs/pictures.py [FOLDER]."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

import stereopsis as st
from stereopsis import colormaps

Picture = npt.NDArray[np.uint8]

# Those that a street has: sky is matched there, and nothing filled.
FLAG_COLOURS = {
    flag: colour
    for flag, colour in colormaps.FLAG_COLOURS.items()
    if flag not in (st.Flag.SKY, st.Flag.FILLED)
}
LINE_COLOURS = [
    colormaps.hex_code(colour)
    for colour in (colormaps.BLUE, colormaps.ORANGE, colormaps.GREEN, colormaps.VERMILLION)
]
RANGE = (0, 96)
SHOWN = (0.0, 75.0)  # the disparities of the first and the last colour


def main(arguments: Sequence[str]) -> None:
    folder = Path(arguments[0]) if arguments else Path(__file__).parent / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    scene = st.scenes.street(880, 400, seed=3, noise=1.5)
    result = st.match(scene.pair, preset="fast", disparities=RANGE)
    save(folder / "street.png", street(scene, result))
    save(folder / "flags.png", legend(flag_colours(scene.left, result.flags)))
    save(folder / "windows.png", windows(scene))
    save(folder / "slice.png", volume_slice(scene))
    save(folder / "fill.png", filled(result))
    save(folder / "presets.png", presets())
    Image.fromarray(plots(scene)).save(folder / "plots.png", optimize=True)
    for name, drawing in {
        "costs.svg": cost_curves(),
        "anchor.svg": anchors(),
        "subpixel.svg": subpixel_fits(),
        "sliding.svg": sliding_window(),
    }.items():
        (folder / name).write_text(drawing, encoding="utf-8")


# ---- pictures of maps ------------------------------------------------------------------------------------


def street(scene: st.scenes.Scene, result: st.Result) -> Picture:
    """Left image, disparity, confidence and flags, at half the size."""
    confidence = np.repeat((255 * result.confidence).astype(np.uint8)[..., None], 3, axis=2)
    panels = {
        "left image": halved(scene.left),
        "disparity": halved(st.io.colorize(result.disparity, SHOWN)),
        "confidence": halved(confidence),
        "why a pixel has no answer": halved(flag_colours(scene.left, result.flags)),
    }
    labelled = [label(panel, text) for text, panel in panels.items()]
    return grid(labelled)


def windows(scene: st.scenes.Scene) -> Picture:
    """One part of the street, matched with small and large windows."""
    part = np.s_[90:290, 300:580]
    shown = [label(scene.left[part], "left image")]
    for size in (5, 15, 41):
        disparity = st.match(scene.pair, disparities=RANGE, cost=st.ZNCC(window=size)).disparity
        shown.append(label(st.io.colorize(disparity[part], SHOWN), f"window {size} x {size}"))
    return grid(shown)


def volume_slice(scene: st.scenes.Scene) -> Picture:
    """The cost volume of one row, ZNCC, with the left view's winners."""
    row, count = 250, 64
    cost = st.ZNCC(window=(25, 9))
    result = st.match(scene.pair, disparities=(0, count), cost=cost, subpixel=None, keep=("costs",))
    costs = result.stages["costs"][row].T  # candidates upwards, x to the right
    seen = np.isfinite(costs)
    grey = np.where(seen, np.clip(127 * (1 + np.where(seen, costs, 0)), 0, 255), 205).astype(np.uint8)
    picture = np.repeat(grey[..., None], 3, axis=2)
    found = np.isfinite(result.disparity[row])
    picture[result.disparity[row][found].astype(int), np.flatnonzero(found)] = (230, 159, 0)
    return np.repeat(picture[::-1], 3, axis=0)


def filled(result: st.Result) -> Picture:
    """The map before and after filling."""
    whole = st.fill.background(result.disparity)
    shown = {"as matched": result.disparity, "filled from the background": whole}
    return beside([label(halved(st.io.colorize(map_, SHOWN)), text) for text, map_ in shown.items()])


def plots(scene: st.scenes.Scene) -> Picture:
    """What `stereopsis.plot` draws."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    truth = scene.disparity
    result = st.match(scene.pair, preset="fast", disparities=RANGE, confidence="calibrated", keep=("costs",))
    answered = np.isfinite(result.disparity) & np.isfinite(truth)
    right = np.abs(result.disparity[answered] - truth[answered]) <= 3
    x, y = 640, 300
    figure = Figure(figsize=(13, 13.6), dpi=75, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    axes = figure.subplots(4, 2, height_ratios=(4, 4, 5, 5))
    st.plot.disparity(result, axes[0, 0])
    st.plot.error(result, truth, axes[0, 1], limit=3)
    st.plot.confidence(result, axes[1, 0])
    st.plot.flags(result, axes[1, 1])
    st.plot.cost_curve(result, x, y, axes[2, 0], truth=float(truth[y, x]))
    st.plot.sparsification(st.sparsification(result.disparity, result.confidence, truth), axes[2, 1])
    st.plot.reliability(st.reliability(result.confidence[answered], right), axes[3, 0])
    windows = {f"window {n} x {n}": st.SSD(n) for n in (5, 15, 31)}
    found = {name: st.match(scene.pair, disparities=RANGE, cost=cost) for name, cost in windows.items()}
    curves = {name: st.sparsification(r.disparity, r.confidence, truth, "epe") for name, r in found.items()}
    st.plot.sparsification(curves, axes[3, 1], measure="epe")
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3]


def presets() -> Picture:
    """Three streets by every preset, at a third of the size: what was filled is pale."""
    scenes = [
        st.scenes.street(900, 390, seed=seed, noise=noise) for seed, noise in ((3, 1.5), (7, 4), (11, 8))
    ]
    rows = [beside([label(thirds(scene.left), "left image") for scene in scenes])]
    for name in ("fast", "local", "balanced", "accurate"):
        panels = []
        for scene in scenes:
            result = st.match(scene.pair, preset=name, disparities=RANGE)
            shown = st.io.colorize(result.disparity, SHOWN)
            pale = (result.flags & np.uint8(st.Flag.FILLED)) != 0
            shown[pale] = (160 + 0.37 * shown[pale]).astype(np.uint8)
            panels.append(label(thirds(shown), name))
        rows.append(beside(panels))
    return np.vstack(rows)


def thirds(picture: Picture) -> Picture:
    return np.asarray(Image.fromarray(picture).reduce(3))


def flag_colours(left: Picture, flags: npt.NDArray[np.uint8]) -> Picture:
    """The left image, pale, under the colours of the flags; of several flags the first."""
    picture: Picture = (160 + 0.35 * left.mean(axis=2, keepdims=True).repeat(3, axis=2)).astype(np.uint8)
    for flag, colour in reversed(FLAG_COLOURS.items()):
        picture[(flags & np.uint8(flag)) != 0] = colour
    return picture


def legend(picture: Picture) -> Picture:
    bar = Image.new("RGB", (picture.shape[1], 26), "white")
    draw, font, x = ImageDraw.Draw(bar), ImageFont.load_default(15), 4
    for flag, colour in FLAG_COLOURS.items():
        text = flag.words
        draw.rectangle((x, 7, x + 14, 21), fill=colour)
        draw.text((x + 20, 4), text, fill="black", font=font)
        x += 44 + int(draw.textlength(text, font=font))
    return np.vstack([picture, np.asarray(bar)])


def label(picture: Picture, text: str) -> Picture:
    bar = Image.new("RGB", (picture.shape[1], 22), "white")
    ImageDraw.Draw(bar).text((2, 2), text, fill="black", font=ImageFont.load_default(14))
    return np.vstack([np.asarray(bar), picture])


def beside(pictures: Sequence[Picture]) -> Picture:
    space = np.full((pictures[0].shape[0], 6, 3), 255, np.uint8)
    return np.hstack([part for picture in pictures for part in (picture, space)][:-1])


def grid(pictures: Sequence[Picture]) -> Picture:
    """Four pictures of one size, two by two."""
    upper, lower = beside(pictures[:2]), beside(pictures[2:])
    return np.vstack([upper, np.full_like(upper[:6], 255), lower])


def halved(picture: Picture) -> Picture:
    return np.asarray(Image.fromarray(picture).reduce(2))


def save(path: Path, picture: Picture) -> None:
    """With a palette: a third of the bytes, and no difference that matters here."""
    Image.fromarray(picture).quantize(256, method=Image.Quantize.MEDIANCUT).save(path, optimize=True)


# ---- drawings --------------------------------------------------------------------------------------------


def svg(width: int, height: int, parts: Iterable[str]) -> str:
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}"'
    style = ' font-family="sans-serif" font-size="13">'
    return "\n".join([head + style, '<rect width="100%" height="100%" fill="white"/>', *parts, "</svg>\n"])


def text(x: float, y: float, words: str, colour: str = "#222", anchor: str = "start") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" fill="{colour}" text-anchor="{anchor}">{words}</text>'


def line(x: Any, y: Any, colour: str = "#888", width: float = 1) -> str:
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    return f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="{width}"/>'


def box(x: float, y: float, width: float, height: float, fill: str, stroke: str = "#888") -> str:
    size = f'width="{width:.1f}" height="{height:.1f}"'
    return f'<rect x="{x:.1f}" y="{y:.1f}" {size} fill="{fill}" stroke="{stroke}"/>'


def dot(x: float, y: float, colour: str) -> str:
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{colour}"/>'


def cost_curves() -> str:
    """Four costs of one pixel over its candidates, each scaled to 0 … 1; the right image is brighter."""
    truth, count, row, column = 12, 40, 40, 120
    scene = st.scenes.plane(200, 80, seed=4, disparity=truth, gray=True, exposure=1.25, offset=15.0)
    left, bottom, wide, high = 40, 220, 420, 190
    parts = [line((left, left, left + wide), (bottom - high, bottom, bottom))]
    parts += [text(left + wide / 2, bottom + 34, "candidate disparity (pixels)", anchor="middle")]
    for tick in range(0, count, 8):
        parts.append(text(left + tick * wide / (count - 1), bottom + 16, str(tick), anchor="middle"))
    x = left + np.arange(count) * wide / (count - 1)
    true_x = left + truth * wide / (count - 1)
    parts += [line((true_x, true_x), (bottom, bottom - high), "#bbb")]
    parts += [text(true_x + 4, bottom - high + 10, "truth", "#888")]
    costs = {"SSD": st.SSD(9), "ZSSD": st.ZSSD(9), "NCC": st.NCC(9), "ZNCC": st.ZNCC(9)}
    for number, ((name, cost), colour) in enumerate(zip(costs.items(), LINE_COLOURS, strict=True)):
        kept = st.match(scene.pair, disparities=(0, count), cost=cost, keep=("costs",)).stages["costs"]
        values = kept[row, column].astype(np.float64)
        scaled = (values - values.min()) / np.ptp(values)
        parts.append(line(x, bottom - high * scaled, colour, 1.8))
        parts.append(dot(x[scaled.argmin()], bottom, colour))
        y = bottom - high + 20 + 22 * number
        parts += [line((480, 505), (y, y), colour, 2.5), text(512, y + 4, name)]
    return svg(580, 265, parts)


def anchors() -> str:
    """Where a window's anchor lies: sizes 5 and 4."""
    parts = []
    for x0, size in ((20, 5), (220, 4)):
        parts.append(text(x0, 20, f"window {size} x {size}"))
        for row in range(size):
            for column in range(size):
                anchor = row == column == size // 2
                fill = "#0072b2" if anchor else "#e8eef4"
                parts.append(box(x0 + 26 * column, 32 + 26 * row, 26, 26, fill))
    parts += [box(380, 32, 18, 18, "#0072b2"), text(406, 46, "the pixel (x, y)")]
    return svg(540, 178, parts)


def subpixel_fits() -> str:
    """Both fits through the same three costs."""
    before, winner, after = 1.0, 0.3, 0.55
    rise_before, rise_after = before - winner, after - winner
    parabola = (rise_before - rise_after) / (2 * (rise_before + rise_after))
    equiangular = (rise_before - rise_after) / (2 * max(rise_before, rise_after))
    slope = max(rise_before, rise_after)
    d = np.linspace(-1.15, 1.15, 60)
    curves = {
        "parabola": (
            winner + (after - before) / 2 * d + (before + after - 2 * winner) / 2 * d * d,
            parabola,
        ),
        "equiangular": (winner + slope * (np.abs(d - equiangular) - equiangular), equiangular),
    }
    parts = []
    for x0, (name, (curve, offset)), colour in zip((140, 420), curves.items(), LINE_COLOURS, strict=False):

        def at(value: Any, x0: int = x0) -> Any:
            return x0 + 90 * value

        def up(value: Any) -> Any:
            return 190 - 150 * value

        parts += [line((at(-1.3), at(1.3)), (190, 190)), text(x0, 20, name, anchor="middle")]
        parts.append(line(at(d), up(curve), colour, 1.8))
        parts.append(line((at(offset), at(offset)), (190, up(np.interp(offset, d, curve))), colour))
        for position, cost, words in ((-1, before, "d - 1"), (0, winner, "d"), (1, after, "d + 1")):
            parts += [dot(at(position), up(cost), "#222"), text(at(position), 208, words, anchor="middle")]
        parts.append(text(at(offset) + 4, 180, f"+{offset:.2f}", colour))
    return svg(560, 218, parts)


def sliding_window() -> str:
    """What changes in a window's sum when it moves by a row: a row's stretch enters, one leaves."""
    parts, cell, x0, y0, wide, high = [], 24, 30, 40, 7, 5
    for row in range(-1, high):
        for column in range(-1, wide):
            inside = row >= 0 and column >= 0
            fill = "#e8eef4" if inside else "#fafafa"
            if row == high - 1 and column >= 0:
                fill = "#9fd3bf"
            if row == -1 and column >= 0:
                fill = "#f4c9a8"
            if row in (-1, high - 1) and column in (-1, wide - 1):
                entering = (row == high - 1) == (column == wide - 1)
                fill = "#009e73" if entering else "#d55e00"
            parts.append(box(x0 + cell * (column + 1), y0 + cell * (row + 1), cell, cell, fill))
    outline = f'x="{x0 + cell}" y="{y0 + cell}" width="{cell * wide}" height="{cell * high}"'
    parts.append(f'<rect {outline} fill="none" stroke="#222" stroke-width="2"/>')
    parts.append(text(x0, 24, "the window at (x, y), drawn with the row above and the column to the left"))
    for number, (colour, words) in enumerate(
        (
            ("#9fd3bf", "the row that enters"),
            ("#f4c9a8", "the row that leaves"),
            ("#009e73", "products added as the change slides to x"),
            ("#d55e00", "products taken away"),
        )
    ):
        y = y0 + 12 + 30 * number
        parts += [box(250, y, 18, 18, colour), text(276, y + 14, words)]
    return svg(560, 200, parts)


if __name__ == "__main__":
    main(sys.argv[1:])
