"""Colours: even in lightness, apart for any colour vision, and the same everywhere."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import stereopsis as st
from stereopsis import colormaps

NAN = np.nan

# Machado, Oliveira, Fernandes, A physiologically-based model for simulation of color vision deficiency, IEEE
# TVCG 2009, doi:10.1109/TVCG.2009.113, at full severity, for linear RGB.
VISIONS = {
    "normal": np.eye(3),
    "protanope": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranope": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanope": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}


def lab(rgb: Any, vision: str = "normal") -> npt.NDArray[np.float64]:
    """CIELAB (D65) of sRGB bytes, as somebody of that vision sees them."""
    c = np.asarray(rgb, np.float64) / 255
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    linear = np.clip(linear @ VISIONS[vision].T, 0, 1)
    to_xyz = np.array(
        [
            [0.4124564, 0.3575761, 0.1804375],
            [0.2126729, 0.7151522, 0.0721750],
            [0.0193339, 0.1191920, 0.9503041],
        ]
    )
    t = linear @ to_xyz.T / to_xyz.sum(axis=1)
    f = np.where(t > 216 / 24389, np.cbrt(t), (24389 / 27 * t + 16) / 116)
    return np.stack(
        [116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], axis=-1
    )


def test_white_black_and_red_in_cielab() -> None:
    """The measure itself, against published values."""
    np.testing.assert_allclose(lab([255, 255, 255]), [100, 0, 0], atol=1e-3)
    np.testing.assert_allclose(lab([0, 0, 0]), [0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(lab([255, 0, 0]), [53.24, 80.09, 67.20], atol=0.01)


@pytest.mark.parametrize(
    ("table", "entries"),
    [
        (
            colormaps.VIRIDIS,
            {0: (68, 1, 84), 64: (59, 82, 139), 128: (33, 145, 140), 192: (94, 201, 98), 255: (253, 231, 37)},
        ),
        (
            colormaps.CIVIDIS,
            {
                0: (0, 34, 78),
                64: (67, 78, 108),
                128: (125, 124, 120),
                192: (188, 174, 108),
                255: (254, 232, 56),
            },
        ),
    ],
    ids=["viridis", "cividis"],
)
def test_the_published_entries(table: colormaps.Table, entries: dict[int, colormaps.Colour]) -> None:
    assert {place: tuple(table[place]) for place in entries} == entries


@pytest.mark.parametrize("name", ["VIRIDIS", "CIVIDIS", "DIVERGING"])
def test_a_map_is_a_table_that_nobody_changes(name: str) -> None:
    table = getattr(colormaps, name)
    assert table.shape == (256, 3)
    assert table.dtype == np.uint8
    with pytest.raises(ValueError, match="read-only"):
        table[0] = 0


@pytest.mark.parametrize("vision", VISIONS)
@pytest.mark.parametrize("name", ["VIRIDIS", "CIVIDIS"])
def test_lightness_rises_evenly_for_any_vision(name: str, vision: str) -> None:
    lightness = lab(getattr(colormaps, name), vision)[:, 0]
    assert (np.diff(lightness[::4]) > 0).all()  # one step is less than a byte resolves
    line = np.linspace(lightness[0], lightness[-1], 256)
    assert np.abs(lightness - line).max() < (2.5 if vision == "normal" else 8)
    assert lightness[-1] - lightness[0] > 70


def test_the_map_of_errors_is_even_and_weighs_both_signs_alike() -> None:
    colours = lab(colormaps.DIVERGING)
    np.testing.assert_allclose(colours[:, 0], colours[::-1, 0], atol=0.6)
    assert (np.diff(colours[:128:4, 0]) > 0).all()
    steps = np.linalg.norm(np.diff(colours[::8], axis=0), axis=1)
    below, above = steps[:15], steps[17:]  # the step over the middle is a corner
    for side in (below, above):
        np.testing.assert_allclose(side, side.mean(), rtol=0.1)  # a byte is 7 % of a step
    assert np.abs(colormaps.DIVERGING[127:129].astype(int) - 243).max() <= 1


@pytest.mark.parametrize("vision", VISIONS)
def test_the_signs_of_an_error_stay_apart_for_any_vision(vision: str) -> None:
    colours = lab(colormaps.DIVERGING, vision)
    apart = np.linalg.norm(colours - colours[::-1], axis=1)
    assert apart[:64].min() > 15  # half the largest error and more
    assert apart[0] > 40


@pytest.mark.parametrize(
    ("vision", "least"), [("normal", 25), ("deuteranope", 9), ("protanope", 9), ("tritanope", 9)]
)
def test_the_palette_stays_apart_for_any_vision(vision: str, least: float) -> None:
    colours = lab(colormaps.OKABE_ITO, vision)
    apart = {
        (a, b): float(np.linalg.norm(colours[a] - colours[b])) for a, b in itertools.combinations(range(8), 2)
    }
    assert min(apart.values()) > least, min(apart.items(), key=lambda item: item[1])


def test_every_flag_has_a_colour_of_its_own() -> None:
    assert list(colormaps.FLAG_COLOURS) == list(st.Flag)
    assert len({*colormaps.FLAG_COLOURS.values(), colormaps.INVALID}) == len(st.Flag) + 1


def test_the_lowest_of_several_flags_shows() -> None:
    both = st.Flag.MISMATCHED | st.Flag.FILLED
    picture = colormaps.flag_colours(np.array([[0, 1, 128, both]], np.uint8))
    expected = [colormaps.INVALID, colormaps.ORANGE, colormaps.PURPLE, colormaps.VERMILLION]
    assert [tuple(pixel) for pixel in picture[0]] == expected


def test_values_are_looked_up() -> None:
    ramp = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
    values = np.array([[NAN, 0, 10, 5, -3, 99, np.inf, -np.inf]])
    picture = colormaps.colours(values, (0, 10), ramp)
    assert picture.shape == (1, 8, 3)
    assert picture[0, :, 0].tolist() == [205, 0, 255, 128, 0, 255, 255, 0]
    np.testing.assert_array_equal(colormaps.colours(np.array([10]), (0, 10))[0], colormaps.VIRIDIS[255])


def test_limits_are_percentiles_or_what_was_asked_for() -> None:
    values = np.append(np.arange(101.0), NAN)
    assert colormaps.limits(values) == (1, 99)
    assert colormaps.limits(values, (-2, 3)) == (-2, 3)
    assert colormaps.limits(np.array([NAN])) == (0, 1)
    assert colormaps.limits(np.array([7.0])) == (6.5, 7.5)
    with pytest.raises(ValueError, match="two finite numbers in order"):
        colormaps.limits(values, (3, 3))


@pytest.mark.parametrize(
    ("low", "high", "texts"),
    [
        (0, 100, ["0", "20", "40", "60", "80", "100"]),
        (-1, 1, ["-1.0", "-0.5", "0.0", "0.5", "1.0"]),
        (0.1, 0.13, ["0.100", "0.105", "0.110", "0.115", "0.120", "0.125", "0.130"]),
    ],
)
def test_ticks_are_round(low: float, high: float, texts: list[str]) -> None:
    assert [text for _, text in colormaps.ticks(low, high)] == texts


def test_a_colour_in_html() -> None:
    assert colormaps.hex_code(colormaps.BLUE) == "#0072b2"
