import dataclasses
import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from reference import evaluate as reference
from stereopsis.evaluate import (
    ERROR_COLOURS,
    UNANSWERED_COLOUR,
    UNKNOWN_COLOUR,
    Measures,
    error_map,
    evaluate,
)

N = np.nan
INF = np.inf


def float32(*rows):
    return np.array(rows, np.float32)


# Errors: 0.25, 1, (unanswered), (unknown), 4  /  (unanswered), (unknown), 3.5, 0, 4.
TRUTH = float32([10, 20, 40, N, 100], [4, INF, 64, 0, 30])
DISPARITY = float32([10.25, 19, N, 5, 96], [-INF, 3, 67.5, 0, 26])


class TestByHand:
    def test_counts(self):
        scores = evaluate(DISPARITY, TRUTH)
        assert (scores.known, scores.answered, scores.density) == (8, 6, 0.75)

    def test_own(self):
        # sorted: 0, 0.25, 1, 3.5, 4, 4; D1 spares the 4 px that are 4 % of 100
        assert evaluate(DISPARITY, TRUTH).own == Measures(
            count=6,
            within_0_25=1 / 6,
            within_0_5=2 / 6,
            within_1=2 / 6,
            within_2=3 / 6,
            within_4=4 / 6,
            bad_0_5=4 / 6,
            bad_1=3 / 6,
            bad_2=3 / 6,
            bad_4=0,
            d1=2 / 6,
            epe=12.75 / 6,
            rmse=math.sqrt(45.3125 / 6),
            a50=1,
            a90=4,
            a95=4,
            a99=4,
        )

    def test_all(self):
        # sorted: 0, 0.25, 1, 3.5, 4, 4, inf, inf
        assert evaluate(DISPARITY, TRUTH).all == Measures(
            count=8,
            within_0_25=1 / 8,
            within_0_5=2 / 8,
            within_1=2 / 8,
            within_2=3 / 8,
            within_4=4 / 8,
            bad_0_5=6 / 8,
            bad_1=5 / 8,
            bad_2=5 / 8,
            bad_4=2 / 8,
            d1=4 / 8,
            epe=INF,
            rmse=INF,
            a50=3.5,
            a90=INF,
            a95=INF,
            a99=INF,
        )

    def test_filled(self):
        # 40 is filled with 5, the smaller of 19 and 5; 4 with its only neighbour, 3. Both answers stand where
        # the truth is unknown. Sorted: 0, 0.25, 1, 1, 3.5, 4, 4, 35
        assert evaluate(DISPARITY, TRUTH).filled == Measures(
            count=8,
            within_0_25=1 / 8,
            within_0_5=2 / 8,
            within_1=2 / 8,
            within_2=4 / 8,
            within_4=5 / 8,
            bad_0_5=6 / 8,
            bad_1=4 / 8,
            bad_2=4 / 8,
            bad_4=1 / 8,
            d1=3 / 8,
            epe=48.75 / 8,
            rmse=math.sqrt(1271.3125 / 8),
            a50=1,
            a90=35,
            a95=35,
            a99=35,
        )

    def test_mask_leaves_pixels_out_but_they_still_fill(self):
        mask = np.zeros(TRUTH.shape, bool)
        mask[0, 2] = mask[0, 3] = mask[1, 2] = True
        scores = evaluate(DISPARITY, TRUTH, mask)
        assert (scores.known, scores.answered, scores.density) == (2, 1, 0.5)
        assert (scores.own.epe, scores.all.within_4, scores.filled.epe) == (3.5, 0.5, (35 + 3.5) / 2)

    @pytest.mark.parametrize(
        ("truth", "error", "outlier"),
        [
            (60, 3, False),  # not above 3 px
            (60, 3.25, True),
            (80, 4, False),  # 5 % on the dot
            (79, 4, True),
            (100, 4.5, False),  # 4.5 %
            (140, 7, False),
            (140, 7.25, True),
            (-80, 4, False),
            (-79, 4, True),
            (0, 3, False),
            (0, 3.25, True),
        ],
    )
    @pytest.mark.parametrize("sign", [-1, 1])
    def test_d1_needs_both(self, truth, error, outlier, sign):
        assert evaluate(float32([truth + sign * error]), float32([truth])).own.d1 == outlier

    @pytest.mark.parametrize("bound", [0.5, 1, 2, 4])
    def test_an_error_at_the_bound_is_neither_within_nor_bad(self, bound):
        name = str(bound).replace(".", "_")
        at = evaluate(float32([10 + bound]), float32([10])).own
        below = evaluate(float32([10 + bound - 2**-10]), float32([10])).own
        above = evaluate(float32([10 - bound - 2**-10]), float32([10])).own
        assert [getattr(m, f"within_{name}") for m in (below, at, above)] == [1, 0, 0]
        assert [getattr(m, f"bad_{name}") for m in (below, at, above)] == [0, 0, 1]

    def test_quantiles_are_errors_that_occur(self):
        errors = np.random.default_rng(0).permutation(100) + 1.0
        m = evaluate(errors.reshape(4, 25), np.zeros((4, 25))).own
        assert (m.a50, m.a90, m.a95, m.a99) == (50, 90, 95, 99)
        m = evaluate(np.arange(1.0, 8.0)[None], np.zeros((1, 7))).own
        assert (m.a50, m.a90, m.a95, m.a99) == (4, 7, 7, 7)


class TestEdges:
    @pytest.mark.parametrize("shape", [(2, 3), (0, 3), (3, 0), (0, 0)])
    def test_nothing_known(self, shape):
        scores = evaluate(np.ones(shape, np.float32), np.full(shape, N, np.float32))
        assert (scores.known, scores.answered) == (0, 0)
        assert math.isnan(scores.density)
        for m in (scores.own, scores.all, scores.filled):
            values = dataclasses.asdict(m)
            assert values.pop("count") == 0
            assert all(math.isnan(value) for value in values.values())
        assert scores.to_dict()["own"]["epe"] is None

    def test_nothing_answered(self):
        scores = evaluate(float32([N, INF]), float32([1, 2]))
        assert (scores.known, scores.answered, scores.density) == (2, 0, 0)
        assert math.isnan(scores.own.d1)
        assert scores.filled == scores.all
        assert (scores.all.d1, scores.all.bad_4, scores.all.within_4, scores.all.a50) == (1, 1, 0, INF)

    def test_full_density_gives_the_same_three_times(self):
        scores = evaluate(float32([1, 2, 7]), float32([1, 3, 2]))
        assert scores.own == scores.all == scores.filled
        assert scores.own.epe == 2

    def test_differences_are_taken_in_float64(self):
        # In float32 this difference would round to zero.
        assert evaluate(float32([2**24]), np.array([[2**24 - 0.5]])).own.epe == 0.5

    def test_differences_too_large_for_float64(self):
        assert evaluate(np.array([[1e308, 1e200]]), np.array([[-1e308, 0]])).own.rmse == INF

    def test_frozen(self):
        with pytest.raises(dataclasses.FrozenInstanceError):
            evaluate(DISPARITY, TRUTH).own.d1 = 0


class TestPresentation:
    def test_dict_is_strict_json(self):
        scores = evaluate(DISPARITY, TRUTH)
        back = json.loads(json.dumps(scores.to_dict(), allow_nan=False))
        assert (back["known"], back["answered"], back["density"]) == (8, 6, 0.75)
        assert back["own"] == dataclasses.asdict(scores.own)
        assert back["all"]["within_4"] == 0.5
        assert back["all"]["epe"] is None

    def test_rows(self):
        rows = {label: values for label, *values in evaluate(DISPARITY, TRUTH).rows()}
        assert rows["pixels"] == ["6", "8", "8"]
        assert rows["< 4 px"] == ["66.67 %", "50.00 %", "62.50 %"]
        assert rows["EPE"] == ["2.125 px", "inf", "6.094 px"]
        # one for each measure: a new one must not be forgotten here
        assert len(rows) == len(dataclasses.fields(Measures))

    def test_text(self):
        lines = str(evaluate(DISPARITY, TRUTH)).splitlines()
        assert lines[0] == "density 75.00 % (6 of 8 known pixels)"
        assert lines[1].split() == ["own", "all", "filled"]
        assert lines[-1].split() == ["A99", "4.000", "px", "inf", "35.000", "px"]
        assert str(evaluate(float32([N]), float32([N]))).splitlines()[0] == "density - (0 of 0 known pixels)"


# Eighths, so that sums are exact; many hits on the bounds and on 5 %.
disparities = st.one_of(
    st.sampled_from([N, INF, -INF]), st.integers(-60, 120).map(lambda k: k / 8), st.sampled_from([60.0, 80.0])
)


@st.composite
def comparisons(draw):
    shape = draw(hnp.array_shapes(min_dims=2, max_dims=2, max_side=6))
    dtypes = st.sampled_from([np.float32, np.float64])
    disparity = draw(hnp.arrays(draw(dtypes), shape, elements=disparities))
    truth = draw(hnp.arrays(draw(dtypes), shape, elements=disparities))
    mask = draw(st.none() | hnp.arrays(bool, shape))
    return disparity, truth, mask


class TestProperties:
    @given(comparisons())
    def test_is_its_definition(self, comparison):
        scores = evaluate(*comparison)
        for mine, defined in zip(
            (scores.own, scores.all, scores.filled), reference.evaluate(*comparison), strict=True
        ):
            if defined is None:
                assert mine.count == 0
            else:
                assert dataclasses.asdict(mine) == pytest.approx(defined, rel=1e-14)

    @given(comparisons())
    def test_unknown_pixels_do_not_matter_to_own_and_all(self, comparison):
        disparity, truth, mask = comparison
        changed = np.where(np.isfinite(truth), disparity, 1234)
        one, other = evaluate(disparity, truth, mask), evaluate(changed, truth, mask)
        assert repr((one.density, one.own, one.all)) == repr((other.density, other.own, other.all))

    @given(comparisons())
    def test_arguments_stay_as_they_are(self, comparison):
        before = [None if a is None else a.copy() for a in comparison]
        for array in comparison:
            if array is not None:
                array.setflags(write=False)
        evaluate(*comparison)
        error_map(*comparison)
        for a, b in zip(comparison, before, strict=True):
            np.testing.assert_array_equal(a, b)

    @given(comparisons())
    def test_error_map_paints_outliers_warm(self, comparison):
        disparity, truth, mask = comparison
        picture = error_map(disparity, truth, mask).reshape(-1, 3).tolist()
        cool = [list(colour) for bound, colour in ERROR_COLOURS if bound <= 1]
        warm = [list(colour) for bound, colour in ERROR_COLOURS if bound > 1]
        scores = evaluate(disparity, truth, mask)
        own = scores.own
        assert sum(colour in cool or colour in warm for colour in picture) == own.count
        assert picture.count(list(UNANSWERED_COLOUR)) == scores.known - scores.answered
        if own.count:
            assert sum(colour in warm for colour in picture) >= round(own.d1 * own.count)
            assert sum(colour in cool for colour in picture) >= round(own.within_2 * own.count)


class TestErrorMap:
    def test_bands(self):
        # At a true disparity of 60, 5 % are 3 px: a band ends where the error reaches its bound times 3.
        errors = [0, 0.125, 0.1875, 0.25, 0.375, 0.75, 1.5, 2.9375, 3, 6, 12, 24, 48, 500]
        bands = [0, 0, 1, 1, 2, 3, 4, 4, 5, 6, 7, 8, 9, 9]
        picture = error_map(float32([60 + e for e in errors]), np.full((1, len(errors)), 60, np.float32))
        assert picture.dtype == np.uint8
        assert [tuple(pixel) for pixel in picture[0]] == [ERROR_COLOURS[band][1] for band in bands]

    def test_five_per_cent_of_a_large_disparity(self):
        # 6 px are 3 % of 200: 0.6 of the line, where 3 px alone would be twice over it
        assert tuple(error_map(float32([206]), float32([200]))[0, 0]) == ERROR_COLOURS[4][1]

    def test_unknown_unanswered_masked_and_zero(self):
        truth = float32([N, 5, 5, 0, 0])
        disparity = float32([5, N, 5, 0, 9])
        picture = error_map(disparity, truth, np.array([[True, True, False, True, True]]))
        assert [tuple(pixel) for pixel in picture[0]] == [
            UNKNOWN_COLOUR,
            UNANSWERED_COLOUR,
            UNKNOWN_COLOUR,
            ERROR_COLOURS[0][1],
            ERROR_COLOURS[6][1],  # 5 % of 0 is no bound: 9 px / 3 = 3 is in [2, 4)
        ]

    def test_grow(self):
        # a right and a wrong pixel three columns apart, the rest unknown
        truth, disparity = np.full((2, 3, 8), N, np.float32)
        truth[1, [1, 4]] = 60
        disparity[1, [1, 4]] = 60, 600
        right, wrong, unknown = ERROR_COLOURS[0][1], ERROR_COLOURS[-1][1], UNKNOWN_COLOUR

        def line(grow, y):
            return [tuple(pixel) for pixel in error_map(disparity, truth, grow=grow)[y]]

        assert line(0, 1) == [unknown, right, unknown, unknown, wrong, unknown, unknown, unknown]
        assert line(0, 0) == [unknown] * 8
        assert line(1, 1) == line(1, 0) == [right, right, right, wrong, wrong, wrong, unknown, unknown]
        assert line(3, 1) == line(3, 2) == [right, right, right, wrong, wrong, wrong, wrong, wrong]

    def test_grow_leaves_known_pixels(self):
        truth, disparity = np.random.default_rng(0).uniform(0, 60, (2, 6, 7))
        np.testing.assert_array_equal(error_map(disparity, truth, grow=2), error_map(disparity, truth))

    @pytest.mark.parametrize(
        ("grow", "error", "says"),
        [
            (-1, ValueError, "grow must be 0 or more pixels, not -1"),
            (1.5, TypeError, "grow must be an int, not float"),
        ],
    )
    def test_grow_refuses(self, grow, error, says):
        with pytest.raises(error, match=says):
            error_map(np.zeros((2, 3)), np.zeros((2, 3)), grow=grow)

    def test_empty(self):
        assert error_map(np.zeros((4, 0), np.float32), np.zeros((4, 0), np.float32), grow=1).shape == (
            4,
            0,
            3,
        )
        assert error_map(np.zeros((0, 4), np.float32), np.zeros((0, 4), np.float32)).shape == (0, 4, 3)


@pytest.mark.parametrize("function", [evaluate, error_map])
class TestRefuses:
    @pytest.mark.parametrize("name", ["disparity", "truth"])
    @pytest.mark.parametrize(
        ("value", "error", "says"),
        [
            ([[1.0]], TypeError, "must be an array, not list"),
            (None, TypeError, "must be an array, not NoneType"),
            (np.zeros((2, 3), np.uint16), TypeError, "must be float32 or float64, in pixels, not uint16"),
            (np.zeros((2, 3, 1), np.float32), ValueError, r"must be \(H, W\), not of shape \(2, 3, 1\)"),
        ],
    )
    def test_a_map(self, function, name, value, error, says):
        arguments = {"disparity": np.zeros((2, 3)), "truth": np.zeros((2, 3)), name: value}
        with pytest.raises(error, match=f"^{name} {says}"):
            function(**arguments)

    def test_two_shapes(self, function):
        with pytest.raises(ValueError, match=r"one shape, not \(2, 3\) and \(3, 2\)"):
            function(np.zeros((2, 3)), np.zeros((3, 2)))

    @pytest.mark.parametrize(
        ("mask", "error", "says"),
        [
            ([[True]], TypeError, "mask must be an array of bool or None, not list"),
            (np.ones((2, 3), np.uint8), TypeError, "mask must be bool.*not uint8"),
            (np.ones((2, 2), bool), ValueError, r"mask must have the shape of truth, \(2, 3\), not \(2, 2\)"),
        ],
    )
    def test_a_mask(self, function, mask, error, says):
        with pytest.raises(error, match=says):
            function(np.zeros((2, 3)), np.zeros((2, 3)), mask)
