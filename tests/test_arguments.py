"""What is given and cannot be meant: an error that names the argument, what came, and what may come."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stereopsis as st
from stereopsis import colormaps, datasets, io, tiling
from stereopsis.settings import Settings

GREY = np.zeros((8, 9), np.uint8)
MAP = np.zeros((8, 9), np.float32)
ESTIMATES: tuple[Callable[..., Any], ...] = (
    st.match,
    st.estimate_disparities,
    lambda left, right: st.estimate_vertical(left, right, (0, 4)),
)


@pytest.mark.parametrize("estimate", ESTIMATES)
@pytest.mark.parametrize(
    ("image", "error", "message"),
    [
        ("left.png", TypeError, "left must be a NumPy array, not str"),
        (GREY.astype(float), TypeError, r"not float64: left\.astype\(np\.float32\) is$"),
        (GREY.astype(np.int8), TypeError, "left must be uint8, uint16 or float32, not int8$"),
        (np.zeros((3, 8, 9), np.uint8), ValueError, r"\(3, 8, 9\): np\.moveaxis\(left, 0, 2\) is$"),
        (np.zeros((8, 9, 4), np.uint8), ValueError, r"\(8, 9, 4\): left\[\.\.\., :3\] is$"),
        (np.zeros((8, 9, 1), np.uint8), ValueError, r"\(8, 9, 1\): left\[\.\.\., 0\] is$"),
        (np.zeros((2, 8, 9), np.uint8), ValueError, r"not of shape \(2, 8, 9\)$"),
        (MAP * np.nan, ValueError, "left must be finite; it holds 72 NaN"),
        (GREY[:0], ValueError, "left must have from 1"),
    ],
)
def test_images(estimate: Callable[..., Any], image: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        estimate(image, image)


def test_advice_on_layouts_is_right() -> None:
    for image, mended in (
        (np.zeros((3, 8, 9), np.uint8), lambda left: np.moveaxis(left, 0, 2)),
        (np.zeros((8, 9, 4), np.uint8), lambda left: left[..., :3]),
        (np.zeros((8, 9, 1), np.uint8), lambda left: left[..., 0]),
        (np.zeros((8, 9)), lambda left: left.astype(np.float32)),
    ):
        assert st.match(mended(image), mended(image), disparities=(0, 2)).disparity.shape == (8, 9)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: st.estimate_vertical(GREY, GREY, (0, 4), threads=-1), ValueError, "threads must be"),
        (lambda: st.estimate_vertical(GREY, GREY, "0:4"), TypeError, "disparities must be"),
        (lambda: st.estimate_disparities(GREY, GREY[1:]), ValueError, "must have the same shape"),
        (lambda: Settings.from_toml(5), TypeError, "text must be a str, not int"),
        (lambda: st.depth(MAP, "calib.txt"), TypeError, "calibration must be a Calibration, not str"),
        (lambda: st.write_ply("a.ply", [[0, 0, 0]]), TypeError, "xyz must be an array, not list"),
        (lambda: st.write_ply("a.ply", MAP[:, :3], [1]), TypeError, "rgb must be an array, not list"),
        (lambda: st.pixel_locking([[1.0]]), TypeError, "disparity must be an array of floats, not list"),
        (lambda: st.pixel_locking(GREY), TypeError, "disparity must be an array of floats, not uint8"),
        (lambda: st.pixel_locking(MAP, mask=GREY), TypeError, "mask must be an array of bool, not uint8"),
        (lambda: st.pixel_locking(MAP, bins=2.5), ValueError, "bins must be a whole number"),
        (lambda: st.reliability(MAP, "yes"), TypeError, "correct must be an array of bool, not str"),
        (
            lambda: st.reliability("high", MAP > 0),
            TypeError,
            "confidence must be .* floats, not str",
        ),
        (lambda: io.colorize(MAP, (0, 1, 2)), ValueError, r"range must be .*not \(0, 1, 2\)"),
        (lambda: io.colorize(MAP, ("a", "b")), ValueError, "range must be two finite numbers"),
        (lambda: io.colorize(MAP, 5), ValueError, "range must be two finite numbers in order, not 5"),
        (lambda: colormaps.colours([1.0], (0, 1)), TypeError, "values must be an array .*not list"),
        (lambda: colormaps.flag_colours(MAP), TypeError, "flags must be an array of uint8, not float32"),
        (lambda: st.read_image(5), TypeError, "path must be a str or path-like, not int"),
        (lambda: datasets.open(None), TypeError, "path must be a str or path-like, not NoneType"),
        (lambda: tiling.halo("fast"), TypeError, "settings must be a Settings, not str"),
        (lambda: tiling.measured("fast"), TypeError, "settings must be a Settings, not str"),
        (lambda: tiling.match("l", "r", 5), TypeError, "output must be a path, or a sequence of paths"),
        (lambda: tiling.match("l", "r", ["o.tif", 5]), TypeError, "path must be a str or path-like, not int"),
        (lambda: tiling.match(5, "r", "o.tif"), TypeError, "path must be a str or path-like, not int"),
        (lambda: tiling.match("l", "r", "o.tif", settings="fast"), TypeError, "must be a Settings, not str"),
    ],
)
def test_others(call: Callable[[], Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        call()


@pytest.mark.parametrize(
    ("output", "others", "message"),
    [
        ("left.tif", {}, "left.tif is also read, or written twice"),
        (["a.tif", "./a.tif"], {}, "a.tif is also read, or written twice"),
        ("a.tif", {"confidence": "a.tif"}, "a.tif is also read, or written twice"),
        ("a.tif", {"flags": "flags.pfm"}, "flags.pfm: .pfm holds float32, not uint8"),
    ],
)
def test_maps_of_tiles_do_not_take_each_others_place(
    output: Any, others: dict[str, str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor that of an image; and this is said before anything is read."""
    monkeypatch.chdir(tmp_path)
    st.write_image("left.tif", GREY)
    kept = Path("left.tif").read_bytes()
    with pytest.raises(ValueError, match=message):
        tiling.match("left.tif", "right.tif", output, **others)
    assert [path.name for path in tmp_path.iterdir()] == ["left.tif"]
    assert Path("left.tif").read_bytes() == kept


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes")
def test_a_pipe_is_no_image_in_parts(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "left.tif")
    with pytest.raises(ValueError, match=r"left\.tif: not a file but a pipe"):
        tiling.match(tmp_path / "left.tif", tmp_path / "left.tif", tmp_path / "out.tif")


@pytest.mark.parametrize(("text", "size"), [("1TB", 10**12), ("1 TiB", 2**40), ("0.5kB", 500), ("7", 7)])
def test_amounts_of_memory(text: str, size: int) -> None:
    from stereopsis.tiling.memory import as_bytes

    assert as_bytes(text) == size


def test_one_assignment_is_one_text() -> None:
    assert Settings.make(assignments="cost=ssd") == Settings.make(assignments=["cost=ssd"])
