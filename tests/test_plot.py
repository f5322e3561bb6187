"""Plots: what stands on the axes, and that nothing else of matplotlib is touched."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import stereopsis as st
from stereopsis import colormaps, plot
from stereopsis.study import figures

pytest.importorskip("matplotlib")

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

matplotlib.use("agg")

NAN = np.nan
MAP = np.array([[1, 2, NAN], [4, 5, 6]], np.float32)


@pytest.fixture(scope="module")
def scene() -> st.scenes.Scene:
    return st.scenes.plane(48, 24, seed=1, disparity=6.3)


@pytest.fixture(scope="module")
def result(scene: st.scenes.Scene) -> st.Result:
    return st.match(scene.pair, disparities=(2, 12), cost=st.ZSSD(5), keep=("costs",), left_right=1)


@pytest.fixture
def ax() -> Axes:
    return Figure().add_subplot()


@pytest.fixture(autouse=True)
def settings_stay() -> Iterator[None]:
    before = dict(matplotlib.rcParams)
    yield
    assert dict(matplotlib.rcParams) == before


def bar(axes: Axes) -> Any:
    """The axes of the colour bar."""
    (found,) = axes.child_axes
    return found


def drawn(axes: Axes) -> Any:
    """The figure's pixels, (H, W, 4)."""
    figure = axes.get_figure()
    assert isinstance(figure, Figure)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())


def test_a_map_with_its_bar_in_pixels(ax: Axes) -> None:
    assert plot.disparity(MAP, ax) is ax
    (image,) = ax.images
    shown = np.ma.getdata(image.get_array())
    np.testing.assert_array_equal(shown, MAP)
    assert image.get_clim() == pytest.approx(tuple(np.nanpercentile(MAP, (1, 99))))
    assert bar(ax).get_ylabel() == "disparity (px)"
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x (px)", "y (px)")
    colours = image.to_rgba(image.get_array(), bytes=True)[..., :3]
    assert tuple(colours[0, 2]) == colormaps.INVALID
    np.testing.assert_array_equal(colours[0, 0], colormaps.VIRIDIS[0])
    np.testing.assert_array_equal(colours[1, 2], colormaps.VIRIDIS[255])
    drawn(ax)


def test_a_result_is_drawn_like_its_map(ax: Axes, result: st.Result) -> None:
    plot.disparity(result, ax, range=(0, 20))
    np.testing.assert_array_equal(np.ma.getdata(ax.images[0].get_array()), result.disparity)
    assert ax.images[0].get_clim() == (0, 20)


def test_confidence_is_blank_without_an_answer(ax: Axes, result: st.Result) -> None:
    plot.confidence(result, ax)
    shown = np.ma.filled(ax.images[0].get_array(), NAN)
    np.testing.assert_array_equal(np.isfinite(shown), np.isfinite(result.disparity))
    assert ax.images[0].get_clim() == (0, 1)


def test_flags_with_their_shares(ax: Axes, result: st.Result) -> None:
    flags = np.zeros((4, 5), np.uint8)
    flags[0] = st.Flag.OCCLUDED
    flags[1, 0] = st.Flag.OCCLUDED | st.Flag.FILLED
    plot.flags(dataclasses.replace(result, flags=flags), ax)
    np.testing.assert_array_equal(ax.images[0].get_array(), colormaps.flag_colours(flags))
    legend = ax.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["occluded 30.0 %", "filled 5.0 %"]


def test_without_flags_no_legend(ax: Axes, result: st.Result) -> None:
    plot.flags(dataclasses.replace(result, flags=np.zeros((2, 2), np.uint8)), ax)
    assert ax.get_legend() is None


def test_signed_errors(ax: Axes) -> None:
    truth = np.array([[1.5, 2, 3], [NAN, 4, 6]], np.float32)
    plot.error(MAP, truth, ax)
    missing, image = ax.images
    np.testing.assert_array_equal(
        np.ma.filled(image.get_array(), NAN), np.array([[-0.5, 0, NAN], [NAN, 1, 0]])
    )
    low, high = image.get_clim()
    assert low == -high
    assert 0.9 < high <= 1
    assert bar(ax).get_ylabel() == "error (px)"
    opaque = np.asarray(missing.get_array())[..., 3] > 0
    np.testing.assert_array_equal(opaque, [[False, False, True], [False, False, False]])
    colours = image.to_rgba(image.get_array(), bytes=True)
    assert colours[0, 2, 3] == colours[1, 0, 3] == 0
    assert np.abs(colours[0, 1, :3].astype(int) - 243).max() <= 1  # white is right
    # Blue is too far, brown too near.
    assert colours[0, 0, 2] > colours[0, 0, 0]
    assert colours[1, 1, 0] > colours[1, 1, 2]


def test_errors_within_a_mask_and_limit(ax: Axes) -> None:
    mask = np.array([[True, False, False], [False, False, True]])
    plot.error(MAP, np.zeros((2, 3)), ax, mask=mask, limit=8)
    shown = np.ma.filled(ax.images[1].get_array(), NAN)
    np.testing.assert_array_equal(shown, [[1, NAN, NAN], [NAN, NAN, 6]])
    assert ax.images[1].get_clim() == (-8, 8)


@pytest.mark.parametrize("estimate", [np.full((3, 4), NAN, np.float32), np.zeros((1, 1), np.float32)])
def test_maps_of_nothing(estimate: Any) -> None:
    for draw in (
        lambda ax: plot.disparity(estimate, ax),
        lambda ax: plot.error(estimate, np.full(estimate.shape, NAN), ax),
        lambda ax: plot.error(estimate, np.zeros(estimate.shape), ax),
    ):
        drawn(draw(Figure().add_subplot()))


def test_the_cost_curve_of_a_pixel(ax: Axes, result: st.Result) -> None:
    x, y = 30, 12
    plot.cost_curve(result, x, y, ax, truth=6.3)
    lines = {str(line.get_label()): line for line in ax.get_lines()}
    costs = result.stages["costs"][y, x]
    np.testing.assert_array_equal(lines["cost"].get_xdata(), np.arange(2, 12))
    np.testing.assert_array_equal(lines["cost"].get_ydata(), costs)
    assert lines["winner 6"].get_xydata()[0].tolist() == [6, costs[4]]
    assert list(lines[f"answer {result.disparity[y, x]:.2f}"].get_xdata()) == [result.disparity[y, x]] * 2
    assert "truth 6.30" in lines
    # The fit passes through the winner and its neighbours, and its lowest point is the answer.
    fit = lines["parabola"]
    found = np.interp([5, 6, 7], fit.get_xdata(), fit.get_ydata())
    np.testing.assert_allclose(found, costs[3:6], rtol=1e-6)
    lowest = fit.get_xdata()[np.argmin(fit.get_ydata())]
    assert abs(lowest - result.disparity[y, x]) <= 0.5 / 40 + 1e-6
    assert ax.get_ylabel() == "cost (ZSSD)"


def test_two_flanks_meet_at_the_answer(ax: Axes, scene: st.scenes.Scene) -> None:
    result = st.match(
        scene.pair, disparities=(2, 12), cost=st.SAD(5), keep=("costs",), subpixel="equiangular"
    )
    plot.cost_curve(result, 30, 12, ax)
    (fit,) = [line for line in ax.get_lines() if line.get_label() == "equiangular"]
    costs = result.stages["costs"][12, 30].astype(float)
    found = np.interp([5, 6, 7], fit.get_xdata(), fit.get_ydata())
    np.testing.assert_allclose(found, costs[3:6], rtol=1e-6)


def test_candidates_that_are_impossible_leave_a_gap(ax: Axes, result: st.Result) -> None:
    plot.cost_curve(result, 4, 12, ax)  # the right image ends at d = 4
    (line,) = [line for line in ax.get_lines() if line.get_label() == "cost"]
    seen = np.isfinite(np.asarray(line.get_ydata(), float))
    assert seen.tolist() == [True] * 3 + [False] * 7


def test_a_pixel_without_candidates_says_why(ax: Axes, result: st.Result) -> None:
    plot.cost_curve(result, 0, 3, ax)
    assert [line.get_label() for line in ax.get_lines()] == ["cost"]
    assert ax.get_title(loc="left") == "x = 0, y = 3: out of view"


def test_costs_of_steps_and_whole_numbers(ax: Axes, scene: st.scenes.Scene) -> None:
    result = st.match(
        scene.pair, disparities=(2, 12), cost=st.Census(5), step=4, disparity_step=2, keep=("costs",)
    )
    plot.cost_curve(result, 30, 13, ax)
    line = ax.get_lines()[0]
    assert list(line.get_xdata()) == [2, 4, 6, 8, 10]
    # Of the columns 28 and 32 the first is nearest, of the rows 12 and 16 the first.
    np.testing.assert_array_equal(line.get_ydata(), result.stages["costs"][3, 7])


@pytest.mark.parametrize(
    ("x", "y", "error", "message"),
    [
        (48, 0, ValueError, "x must be from 0 to 47, not 48"),
        (0, -1, ValueError, "y must be from 0 to 23, not -1"),
        (1.5, 0, TypeError, "x must be a whole number, not 1.5"),
        (0, True, TypeError, "y must be a whole number"),
    ],
)
def test_a_pixel_elsewhere_is_refused(
    result: st.Result, x: Any, y: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        plot.cost_curve(result, x, y)


def test_without_costs_the_error_says_how(result: st.Result) -> None:
    with pytest.raises(ValueError, match=r'match with keep=\("costs",\)'):
        plot.cost_curve(dataclasses.replace(result, stages={}), 0, 0)


def test_sparsification(ax: Axes) -> None:
    truth = np.zeros((1, 4), np.float32)
    found = np.array([[0, 0, 0, 4]], np.float32)
    curve = st.sparsification(found, np.array([[0.9, 0.8, 0.7, 0.1]], np.float32), truth)
    plot.sparsification(curve, ax)
    ideal, confident = ax.get_lines()
    assert confident.get_label() == "by confidence: area 6.25 %, ideal 6.25 %"
    assert ideal.get_label() == "ideal order"
    np.testing.assert_array_equal(ideal.get_ydata(), 100 * curve.ideal)
    np.testing.assert_allclose(confident.get_xdata(), np.arange(1, 101))
    assert np.asarray(confident.get_ydata())[[74, 99]].tolist() == [0, 25]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("answers kept (%)", "bad-1 (%)")


def test_several_curves_in_pixels(ax: Axes) -> None:
    truth = np.zeros((1, 4), np.float32)
    found = np.array([[0, 0, 0, 4]], np.float32)
    trust = np.array([[0.1, 0.8, 0.7, 0.9]], np.float32)
    curves = {
        name: st.sparsification(found, sign * trust, truth, "epe") for name, sign in (("a", 1), ("b", -1))
    }
    plot.sparsification(curves, ax, measure="epe")
    legend = ax.get_legend()
    assert legend is not None
    labels = [text.get_text().partition(":")[0] for text in legend.get_texts()]
    assert labels == ["ideal order", "a", "b"]
    assert ax.get_ylabel() == "mean error (px)"
    assert max(np.asarray(ax.get_lines()[2].get_ydata())) == 4


def test_reliability(ax: Axes) -> None:
    table = st.reliability(np.array([0.2, 0.3, 0.9, 0.9]), np.array([False, True, True, True]), bins=2)
    plot.reliability(table, ax)
    right = ax.get_lines()[-1]
    np.testing.assert_allclose(right.get_xydata(), [[0.25, 0.5], [0.9, 1.0]])
    assert [bar.get_height() for bar in ax.patches] == [0.5, 0.5]


def test_a_new_figure_without_axes() -> None:
    """As in a notebook: pyplot knows the figure; it is not shown."""
    from matplotlib import pyplot

    before = set(pyplot.get_fignums())
    axes = plot.disparity(MAP)
    (new,) = set(pyplot.get_fignums()) - before
    assert pyplot.figure(new) is axes.get_figure()
    pyplot.close(new)


@pytest.mark.parametrize(
    "draw",
    [
        lambda: plot.disparity(MAP, "here"),  # type: ignore[arg-type]
        lambda: plot.disparity(np.zeros((2, 2), int)),  # type: ignore[arg-type]
        lambda: plot.error(MAP, [1]),  # type: ignore[arg-type]
    ],
)
def test_another_type_is_refused(draw: Callable[[], Axes]) -> None:
    with pytest.raises(TypeError, match="must be"):
        draw()


@pytest.mark.parametrize("limit", [0, -1, NAN, np.inf])
def test_a_limit_that_is_none_is_refused(limit: float) -> None:
    with pytest.raises(ValueError, match="limit must be a positive number"):
        plot.error(MAP, MAP, limit=limit)


def test_the_study_draws_its_lines_with_the_same_function(monkeypatch: pytest.MonkeyPatch) -> None:
    series = [plot.Series("a", (1.0, 2.0), (0.25, 0.5), (0.2, 0.4), (0.3, 0.6))]
    seen = []
    whole = plot.lines
    monkeypatch.setattr(plot, "lines", lambda *a, **k: (seen.append(a[1]), whole(*a, **k))[1])
    figures.lines(series, "x", "y")
    assert seen == [series]
    assert figures.COLOURS is plot.COLOURS


def test_matplotlib_waits_for_the_first_plot_and_its_absence_is_explained() -> None:
    code = """
import sys
sys.modules["matplotlib"] = None
import numpy as np, stereopsis as st
try:
    st.plot.disparity(np.ones((2, 2), np.float32))
except ModuleNotFoundError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == (
        "stereopsis.plot needs matplotlib: install it with python -m pip install 'stereopsis[plot]'"
    )
