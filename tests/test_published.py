"""The report's experiment: each quirk by hand, and the numbers that were kept of it.

Most of the kept numbers take minutes: STEREOPSIS_FULL=1 asks for all of them.
"""

import dataclasses
import json
import math
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import ndimage

import stereopsis as st
from stereopsis import datasets
from stereopsis.study import published
from stereopsis.study.published import COLUMNS, METHODS, PUBLISHED, WINDOWS, Quirks, disparity
from stereopsis.study.quirks import acts

DATA = Path(os.environ.get("STEREOPSIS_DATA") or Path(__file__).parents[2] / "shared" / "data")
KEPT = next(
    (
        file
        for folder in (DATA.parent, Path(__file__).parents[2] / "shared")
        if (file := folder / "published.json").is_file()
    ),
    None,
)
STREETS = DATA / "drivingstereo"
FULL = os.environ.get("STEREOPSIS_FULL", "0") not in ("", "0")
QUICK = {(method, "30") for method in METHODS} | {
    ("ssd", "15"),
    ("zssd", "5"),
    ("zncc", "5"),
    ("zncc_gaussian", "5"),
}

CLEAN = Quirks()
ROLLED = Quirks(right_frame=True, wraps=True)


def row(*values):
    return np.array([values], np.uint8)


def only(**on):
    return Quirks(**on)


def random_pair(shape=(24, 40), shift=4, seed=0):
    """A left image, and a right one in which everything lies `shift` pixels further left."""
    wide = np.random.default_rng(seed).integers(0, 256, (shape[0], shape[1] + shift), dtype=np.uint8)
    return wide[:, :-shift].copy(), wide[:, shift:].copy()


# Each quirk


def test_grey_is_weighed_in_15_bits():
    # By hand: (255 * 9798 + 2^14) >> 15 = 2514874 >> 15 = 76, and 29 for 0.114, 150 for 0.587.
    primaries = np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]]], np.uint8)
    np.testing.assert_array_equal(published.grey(primaries, swapped=False), [[76, 150, 29, 255]])
    np.testing.assert_array_equal(published.grey(primaries, swapped=True), [[29, 150, 76, 255]])
    # 3 * 9798 + 19235 + 3735 = 52364, and 16384 more makes 68748 = 2 * 32768 + 3212.
    pixel = np.array([[[3, 1, 1]]], np.uint8)
    assert published.grey(pixel, swapped=False) == [[2]]
    # 9798 + 19235 + 3 * 3735 = 40238, and 16384 more makes 56622 = 32768 + 23854.
    assert published.grey(pixel, swapped=True) == [[1]]


def test_swapped_grey_reaches_the_matcher():
    # Blue tells where the match is; red, which is noise here, weighs more in the right grey.
    left, right = random_pair()
    noise = np.random.default_rng(1).integers(0, 256, (2, *left.shape), dtype=np.uint8)
    colours = [np.stack([n, i, i], axis=2) for n, i in zip(noise, (left, right), strict=True)]
    errors = {
        swapped: np.mean(disparity(*colours, "ssd", 3, only(swapped_grey=swapped), disparities=(0, 9)) != 4)
        for swapped in (False, True)
    }
    assert errors[True] < errors[False]


@pytest.mark.parametrize(("largest", "last"), [(3.0, 4), (3.9, 4), (4.0, 5)])
def test_the_truth_sets_the_range(largest, last):
    # The true match is at 6: as far as the range goes, the costs fall.
    left = np.tile(np.arange(0, 240, 4, dtype=np.uint8), (3, 1))
    right = np.roll(left, -6, axis=1)
    truth = np.array([[np.nan, 1.0, largest]])
    found = disparity(left, right, "ssd", 1, only(truth_range=True), truth=truth)
    assert found.max() == last


def test_without_the_leak_the_truth_is_not_looked_at():
    left, right = random_pair()
    for truth in (None, np.array([[2.0]]), "no truth at all"):
        found = disparity(left, right, "ssd", 3, CLEAN, truth=truth, disparities=(0, 9))
        assert (found[2:-2, 6:-2] == 4).all()
    assert (disparity(left, np.roll(left, -30, 1), "ssd", 3, CLEAN)[2:-2, 32:-2] == 30).all()


def test_truth_is_needed_where_it_sets_the_range():
    left, right = random_pair()
    for truth in (None, np.zeros((2, 2)), np.full((2, 2), np.nan)):
        with pytest.raises(ValueError, match="truth must hold"):
            disparity(left, right, "ssd", 3, PUBLISHED, truth=truth)


def test_frame():
    # One bright pixel, at 4 in the left image and at 2 in the right: disparity 2, seen at 4 from the left.
    left, right = row(0, 0, 0, 0, 9, 0, 0), row(0, 0, 9, 0, 0, 0, 0)
    # From the left, pixel 2 also looks for a dark match: everything before the bright one has 0 first, but
    # pixel 2 itself is dark on the left and bright on the right at d = 0, so it takes d = 1.
    np.testing.assert_array_equal(
        disparity(left, right, "ssd", 1, CLEAN, disparities=(0, 4)), [[0, 0, 1, 0, 2, 0, 0]]
    )
    # From the right, the bright pixel is 2, and pixel 4 is dark where the left one is bright.
    np.testing.assert_array_equal(
        disparity(left, right, "ssd", 1, only(right_frame=True), disparities=(0, 4)), [[0, 0, 2, 0, 1, 0, 0]]
    )


def test_wraps():
    # The bright pixel is the left image's first and the right image's last: one pixel apart on a ring.
    left, right = row(9, 0, 0, 0, 0), row(0, 0, 0, 0, 9)
    rolled = disparity(left, right, "ssd", 1, ROLLED, disparities=(0, 3))
    np.testing.assert_array_equal(rolled, [[1, 0, 0, 0, 1]])
    # Without the ring it has no match: all candidates cost 81, and the first stays.
    np.testing.assert_array_equal(
        disparity(left, right, "ssd", 1, only(right_frame=True), disparities=(0, 3)), [[1, 0, 0, 0, 0]]
    )
    np.testing.assert_array_equal(
        disparity(left, right, "ssd", 1, only(wraps=True), disparities=(0, 3)), [[1, 0, 0, 0, 1]]
    )
    np.testing.assert_array_equal(
        disparity(left, right, "ssd", 1, CLEAN, disparities=(0, 3)), [[0, 0, 0, 0, 1]]
    )


def test_out_of_view_is_nan():
    left, right = random_pair((3, 6), 2)
    found = disparity(left, right, "zncc", 3, CLEAN, disparities=(2, 4))
    assert np.isnan(found[:, :2]).all()
    assert np.isfinite(found[:, 2:]).all()
    found = disparity(left, right, "zncc", 3, only(right_frame=True), disparities=(2, 4))
    assert np.isnan(found[:, -2:]).all()
    found = disparity(left, right, "zncc", 3, CLEAN, disparities=(-3, -1))
    assert np.isnan(found[:, -2:]).any(axis=1).all()


def test_squares_in_eight_bits():
    # 16^2 = 256, which is 0 in eight bits: a difference of 16 beats one of 1.
    left, right = row(50, 50, 50), row(51, 66, 51)
    np.testing.assert_array_equal(disparity(left, right, "ssd", 1, CLEAN, disparities=(0, 2)), [[0, 1, 0]])
    np.testing.assert_array_equal(
        disparity(left, right, "ssd", 1, only(uint8_squares=True), disparities=(0, 2)), [[0, 0, 1]]
    )
    # They are averaged without wrapping once more: means of 200 and 100 over two pixels, not of 300 - 256.
    view = published._View(row(10, 20), row(0, 0), -1, only(uint8_squares=True))
    mean = published._smoother("ssd", 3, view.quirks)
    (cost,) = published._differences(view, mean, range(1))
    # 100 and 400 - 256 = 144; reflected, the window of the first pixel holds 100, 100, 144.
    np.testing.assert_allclose(cost, [[344 / 3, 388 / 3]], rtol=1e-15)


def windows(image, size):
    """Every pixel's window, (H, W, size * size), reflected at borders, an even one further left and up."""
    wide = np.pad(image, (size // 2, size - 1 - size // 2), mode="symmetric")
    return np.lib.stride_tricks.sliding_window_view(wide, (size, size)).reshape(*image.shape, -1)


@pytest.mark.parametrize("size", [3, 4])
@pytest.mark.parametrize("stale", [False, True])
@pytest.mark.parametrize("high_pass", [False, True])
def test_which_mean_zssd_removes(size, stale, high_pass):
    rng = np.random.default_rng(3)
    left, right = rng.integers(0, 256, (2, 7, 11), dtype=np.uint8)
    quirks = dataclasses.replace(ROLLED, stale_mean=stale, high_pass=high_pass)
    view = published._View(right, left, 1, quirks)
    costs = published._centred_differences(view, published._smoother("zssd", size, quirks), range(4))
    for d, cost in enumerate(costs):
        r, l_ = right.astype(float), np.roll(left, -d, 1).astype(float)
        r_mean = windows(r, size).mean(axis=2)
        l_mean = windows(left.astype(float), size).mean(axis=2)
        l_mean = l_mean if stale else np.roll(l_mean, -d, 1)
        if high_pass:
            expected = np.square(windows(r - r_mean - l_ + l_mean, size)).mean(axis=2)
        else:
            removed = (r_mean - l_mean)[:, :, None]
            expected = np.square(windows(r - l_, size) - removed).mean(axis=2)
        # Where a window of the left image hangs over its edge, rolled and reflected differ.
        inside = np.s_[:, size : -size - d]
        np.testing.assert_allclose(cost[inside], expected[inside], rtol=1e-9)


@pytest.mark.parametrize("high_pass", [False, True])
def test_which_mean_zncc_removes(high_pass):
    left, right = np.random.default_rng(4).integers(0, 256, (2, 6, 12), dtype=np.uint8)
    quirks = only(high_pass=high_pass, right_frame=True, wraps=True)
    view = published._View(right, left, 1, quirks)
    mean = published._smoother("zncc", 3, quirks)
    for d, cost in enumerate(published._correlations(view, mean, range(3), centred=True)):
        r, l_ = (
            windows(np.roll(i - windows(i, 3).mean(axis=2) * high_pass, s, 1), 3)
            for i, s in ((right.astype(float), 0), (left.astype(float), -d))
        )
        if not high_pass:
            r, l_ = (w - w.mean(axis=2, keepdims=True) for w in (r, l_))
        expected = -(r * l_).mean(axis=2) / np.sqrt((r * r).mean(axis=2) * (l_ * l_).mean(axis=2))
        np.testing.assert_allclose(cost, expected, rtol=1e-9)


def test_the_window_of_a_gaussian():
    impulse = np.zeros((1, 2001))
    impulse[0, 1000] = 1
    weights = published._smoother("zncc_gaussian", 15, only(sigma_is_window=True))(impulse)[0]
    assert np.count_nonzero(weights) == 121
    # exp(-15^2 / (2 * 15^2)): one sigma from the middle
    assert weights[1015] / weights[1000] == pytest.approx(math.exp(-0.5), rel=1e-12)
    # As wide as a box of 15: 224 / 12 is its variance; a little of a Gaussian is cut off at 4 sigma.
    weights = published._smoother("zncc_gaussian", 15, CLEAN)(impulse)[0]
    box = published._smoother("zncc", 15, CLEAN)(impulse)[0]
    places = np.square(np.arange(2001) - 1000.0)
    assert box @ places == pytest.approx(224 / 12, rel=1e-12)
    assert weights @ places == pytest.approx(224 / 12, rel=5e-3)


def test_a_window_without_contrast():
    # NCC of a black window is 0 / 0, whose NaN wins at once; else it is 0, and loses to any likeness.
    left, right = row(7, 7, 7, 7), row(7, 0, 7, 7)
    np.testing.assert_array_equal(disparity(left, right, "ncc", 1, CLEAN, disparities=(0, 3)), [[0, 1, 0, 0]])
    np.testing.assert_array_equal(
        disparity(left, right, "ncc", 1, only(undefined_wins=True), disparities=(0, 3)), [[0, 0, 1, 2]]
    )


def test_the_first_nan_stays():
    costs = [np.array([[1.0, 1, 1]]), np.array([[np.nan, 0, np.nan]]), np.array([[0.0, np.nan, np.nan]])]
    view = published._View(row(0, 0, 0), row(0, 0, 0), 1, ROLLED)
    np.testing.assert_array_equal(published._winners(costs, range(3), view), [[1, 2, 1]])
    np.testing.assert_array_equal(np.argmin(costs, axis=0), [[1, 2, 1]])


def test_the_slope_is_not_a_refinement():
    # Scores by d: 0, 4, 9, 8, 0. Slope over curvature: 9 / (8 - 9) = -9 at 1, 4 / (18 - 12) = 2/3 at 2,
    # -9 / (16 - 9) at 3: the largest is at the best candidate; with 0, 6, 9, 8, 0 it is 9 / 3 = 3, at 1.
    for scores, where in (((0, 4, 9, 8, 0), 2), ((0, 6, 9, 8, 0), 1)):
        costs = (np.array([[-float(score)]]) for score in scores)
        view = published._View(row(0), row(0), 1, ROLLED)
        found = published._winners(published._slopes(costs), range(5)[1:-1], view)
        np.testing.assert_array_equal(found, [[where]])


def test_off_it_is_a_parabola():
    # Through the costs 5, 1, 3: the minimum lies (4 - 2) / (2 * 6) above the middle.
    costs = [np.array([[cost, cost]]) for cost in (9.0, 5.0, 1.0, 3.0)]
    view = published._View(row(0, 0), row(0, 0), 1, ROLLED)
    np.testing.assert_allclose(published._winners(costs, range(4), view, fit=True), [[2 + 1 / 6] * 2])
    # At the end of the range there is nothing to fit.
    costs = [np.array([[cost, cost]]) for cost in (9.0, 5.0, 1.0)]
    np.testing.assert_array_equal(published._winners(costs, range(3), view, fit=True), [[2, 2]])


def test_subpixel_of_a_pair():
    left, right = random_pair()
    clean = disparity(left, right, "zncc", 5, CLEAN, disparities=(0, 9), subpixel=True)
    assert np.abs(clean[3:-3, 8:-3] - 4).max() < 0.5
    slope = disparity(left, right, "zncc", 5, PUBLISHED, truth=np.array([[8.0]]), subpixel=True)
    assert set(np.unique(slope)) <= set(range(1, 9))
    assert np.mean(slope == 4) < 0.5 < np.mean(np.round(clean) == 4)
    with pytest.raises(ValueError, match="single-pass correlation, not 'zncc_smoothed'"):
        disparity(left, right, "zncc_smoothed", 5, only(slope_subpixel=True), subpixel=True)


def test_fourteen_of_fifteen():
    rows = [dict.fromkeys(COLUMNS, float(k)) for k in range(1, 16)]
    # 1 + ... + 14 = 105, and 15 more makes 120.
    assert published.average(rows, only(last_pair_dropped=True)) == dict.fromkeys(COLUMNS, 105 / 15)
    assert published.average(rows, CLEAN) == dict.fromkeys(COLUMNS, 120 / 15)


def test_what_the_second_pass_of_zncc_weighs():
    left, right = random_pair()
    for zssd_data in (False, True):
        found = disparity(left, right, "zncc_smoothed", 5, only(zssd_data=zssd_data), disparities=(0, 9))
        assert (found[3:-3, 8:-3] == 4).all()
    # A right image of a quarter of the contrast: ZSSD no longer sees the match, ZNCC does.
    dim = (right // 4 + 90).astype(np.uint8)
    view = published._View(published.grey(left, swapped=False), dim, -1, CLEAN)
    mean = published._smoother("zncc_smoothed", 5, CLEAN)
    first = np.full(left.shape, 4.0)
    (at_four,) = published._second_costs("zncc_smoothed", view, mean, range(4, 5), first)
    variance = np.mean(windows(left.astype(float), 5).var(axis=2))
    assert np.abs(at_four[3:-3, 8:-3]).max() < 0.01 * variance
    # Two pixels off the first map: at least 0.5 * 2^2 more.
    (at_six,) = published._second_costs("zncc_smoothed", view, mean, range(6, 7), first)
    correlation = next(published._correlations(view, mean, range(6, 7), centred=True))
    np.testing.assert_allclose(at_six, 2 * variance * (1 + correlation) + 2, rtol=1e-9)


# What does not depend on a quirk


@pytest.mark.parametrize("quirk", Quirks.names())
@pytest.mark.parametrize("method", METHODS)
def test_a_switch_that_does_not_act_changes_nothing(quirk, method):
    if acts(quirk, method):
        return
    rng = np.random.default_rng(5)
    left, right = rng.integers(0, 256, (2, 9, 14, 3), dtype=np.uint8)
    truth = np.full((9, 14), 5.0)
    maps = [
        disparity(left, right, method, 4, dataclasses.replace(PUBLISHED, **{quirk: on}), truth=truth)
        for on in (False, True)
    ]
    np.testing.assert_array_equal(*maps)


@pytest.mark.parametrize(
    ("method", "cost"), [("ssd", st.SSD), ("zssd", st.ZSSD), ("ncc", st.NCC), ("zncc", st.ZNCC)]
)
@pytest.mark.parametrize("window", [7, 8])
def test_all_off_is_what_the_library_finds(method, cost, window):
    """But for what the two do at borders."""
    scene = st.scenes.plane(90, 40, disparity=6.3, gray=True)
    ours = st.match(
        scene.left, scene.right, disparities=(0, 16), cost=cost(window=window), subpixel="parabola"
    ).disparity
    found = disparity(scene.left, scene.right, method, window, CLEAN, disparities=(0, 16), subpixel=True)
    inside = np.s_[5:-5, 24:-5]
    np.testing.assert_allclose(found[inside], ours[inside], atol=2e-3)


def test_smoothed_ssd_by_hand():
    # First pass at window 1: costs are 0 at d = 1 for the middle pixel alone.
    left, right = row(10, 12, 30), row(12, 30, 30)
    first = disparity(left, right, "ssd", 1, CLEAN, disparities=(0, 2))
    np.testing.assert_array_equal(first, [[0, 1, 0]])
    # Second: data plus half the squared distance: the middle pixel pays 0 at 1, and 324 + 0.5 at 0.
    np.testing.assert_array_equal(disparity(left, right, "ssd_smoothed", 1, CLEAN, disparities=(0, 2)), first)
    # Differences of 1 and 0 grey levels: 1 + 0.5 at d = 0 against 0 + 0 at d = 1 ...
    view = published._View(row(5, 5), row(5, 6), -1, CLEAN)
    mean = published._smoother("ssd_smoothed", 1, CLEAN)
    costs = [*published._second_costs("ssd_smoothed", view, mean, range(2), np.array([[0.0, 1.0]]))]
    np.testing.assert_array_equal(costs, [[[0, 1.5]], [[0.5, 0]]])


def test_measures_by_hand():
    truth = np.array([[10, 10, 10, 10, 10, 0, np.nan]])
    found = np.array([[10, 10.25, 10.5, 9, 12, 50, 60]])
    scores = published.measures(found, truth)
    assert list(scores) == [*COLUMNS]
    # A bound itself is outside.
    assert [*scores.values()] == [1 / 5, 2 / 5, 3 / 5, 4 / 5, 1, math.sqrt((0.0625 + 0.25 + 1 + 4) / 5)]
    assert published.measures(np.full((1, 7), np.nan), truth)["within_4"] == 0
    assert math.isinf(published.measures(np.full((1, 7), np.nan), truth)["rmse"])
    assert math.isnan(published.measures(found, np.zeros((1, 7)))["rmse"])


def sample(name, seed):
    left, right = random_pair(seed=seed)
    truth = np.full(left.shape, 4.0, np.float32)
    return SimpleNamespace(name=name, pair=lambda: st.Pair(left, right), truth=lambda: truth)


def test_sweep_and_tables():
    told = []
    found = published.sweep(
        sample("a", 1), ["zncc", "zncc_smoothed"], [3, 5], progress=lambda *done: told.append(done)
    )
    assert told == [("zncc", 3), ("zncc", 5), ("zncc_smoothed", 3), ("zncc_smoothed", 5)]
    gains = [
        (found["zncc"][w]["rmse"] - found["zncc_smoothed"][w]["rmse"]) / found["zncc_smoothed"][w]["rmse"]
        for w in (3, 5)
    ]
    assert published.smoothing_gain(found) == pytest.approx(sum(gains) / 2)

    pairs = [sample("a", 1), sample("b", 2), sample("c", 3)]
    laid_out = published.tables(pairs)
    assert laid_out["columns"] == [*COLUMNS]
    rows = [published.score(pair, "zncc_smoothed", 30, PUBLISHED) for pair in pairs]
    assert laid_out["I_smoothed_zncc_30"][5] == pytest.approx((rows[0]["rmse"] + rows[1]["rmse"]) / 3)
    assert laid_out["true_mean"]["I_smoothed_zncc_30"][5] == pytest.approx(sum(r["rmse"] for r in rows) / 3)
    json.dumps(laid_out, allow_nan=False)
    without = SimpleNamespace(name="no truth", pair=pairs[0].pair, truth=lambda: None)
    with pytest.raises(ValueError, match="no truth has no truth"):
        published.tables([without])


@pytest.mark.parametrize(
    ("changed", "error", "message"),
    [
        ({"method": "znc"}, ValueError, "method must be one of ssd, .* not 'znc'"),
        ({"window": 0}, ValueError, "window must be 1 pixel or more, not 0"),
        ({"left": np.zeros((3, 4))}, TypeError, "left must be uint8, not float64"),
        ({"left": np.zeros((3, 5), np.uint8)}, ValueError, r"same shape, not \(3, 5\) and \(3, 4\)"),
        ({"right": np.zeros((3, 4, 2), np.uint8)}, ValueError, "right must be"),
        ({"disparities": (4, 4)}, ValueError, r"at least one candidate, not \(4, 4\)"),
    ],
)
def test_refused(changed, error, message):
    given = {
        "left": np.zeros((3, 4), np.uint8),
        "right": np.zeros((3, 4), np.uint8),
        "method": "ssd",
        "window": 3,
        "quirks": CLEAN,
    }
    with pytest.raises(error, match=message):
        disparity(**(given | changed))


def test_without_scipy():
    code = (
        "import sys; sys.modules['scipy'] = None\n"
        "import numpy as np\nfrom stereopsis.study import published\n"
        "image = np.zeros((3, 4), np.uint8)\n"
        "try: published.disparity(image, image, 'ssd', 3, published.PUBLISHED, truth=image + 1)\n"
        "except ImportError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "the report's protocol needs SciPy: pip install 'stereopsis[study]'"


# The kept numbers

kept = pytest.mark.skipif(
    KEPT is None or not STREETS.is_dir(), reason="needs published.json and the DrivingStereo pairs"
)
full = pytest.mark.skipif(not FULL, reason="takes minutes: set STEREOPSIS_FULL=1")
NUMBERS = json.loads(KEPT.read_text(encoding="utf-8")) if KEPT else {"first_pair_by_window": {}}


@pytest.fixture(scope="module")
def pairs():
    return [*datasets.open(STREETS)]


@kept
@pytest.mark.parametrize(
    ("method", "window"),
    [
        pytest.param(method, window, marks=() if (method, window) in QUICK else full)
        for method, sizes in NUMBERS["first_pair_by_window"].items()
        for window in sizes
    ],
)
def test_figures(method, window, pairs):
    found = published.score(pairs[0], method, int(window), PUBLISHED)
    expected = NUMBERS["first_pair_by_window"][method][window]
    np.testing.assert_allclose([*found.values()], expected, rtol=1e-6)


@kept
def test_columns():
    assert NUMBERS["columns"] == [*COLUMNS]
    assert all(set(map(str, WINDOWS)) <= set(sizes) for sizes in NUMBERS["first_pair_by_window"].values())
    assert set(NUMBERS["tables_as_printed"]) == set(published.TABLES)


@kept
def test_nine_percent():
    """From the kept figures themselves, by the formula."""
    figures = {
        method: {int(w): dict(zip(COLUMNS, NUMBERS["first_pair_by_window"][method][w], strict=True))
                 for w in map(str, WINDOWS)}
        for method in ("zncc", "zncc_smoothed")
    }  # fmt: skip
    gain = published.smoothing_gain(figures)
    assert gain == pytest.approx(NUMBERS["mean_relative_rmse_drop_by_smoothing"], rel=1e-6)


@kept
@full
def test_tables(pairs):
    found = published.tables(pairs)
    for table, expected in NUMBERS["tables_as_printed"].items():
        np.testing.assert_allclose(found[table], expected, rtol=1e-6)
    for table, expected in NUMBERS["tables_true_mean_of_15"].items():
        # Kept to eight decimal places.
        np.testing.assert_allclose(found["true_mean"][table], expected, rtol=1e-6, atol=6e-9)


def test_scipy_filters_as_described():
    """An even box reaches one further left and up, and borders reflect: what the kept numbers rest on."""
    image = np.random.default_rng(6).integers(0, 256, (5, 6)).astype(float)
    np.testing.assert_allclose(ndimage.uniform_filter(image, 4), windows(image, 4).mean(axis=2))
