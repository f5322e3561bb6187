"""Curves of error against density, by hand and against their definition."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

import stereopsis as st

N = np.nan
TRUTH = np.zeros((1, 4))
ERRORS = np.array([[0.0, 0.5, 2.0, 4.0]])


def naive(errors, confidence):
    """Mean error of the k most trusted pixels, for every k; equals stand for their mean."""
    shared = [np.mean(errors[confidence == c]) for c in confidence]
    order = sorted(range(len(errors)), key=lambda k: -confidence[k])
    return [np.mean([shared[i] for i in order[: k + 1]]) for k in range(len(order))]


def test_the_end_point_error_by_hand():
    # Most trusted first: 0.5, 0, 4, 2. Means 0.5, 0.25, 1.5, 1.625.
    curve = st.sparsification(ERRORS, np.array([[3.0, 4, 1, 2]]), TRUTH, "epe")
    assert curve.auc == (0.5 + 0.25 + 1.5 + 1.625) / 4
    # Ideal: 0, 0.25, 2.5 / 3, 6.5 / 4.
    assert curve.ideal_auc == pytest.approx((0 + 0.25 + 2.5 / 3 + 1.625) / 4)
    assert curve.ause == curve.auc - curve.ideal_auc
    assert curve.random_auc == 1.625
    np.testing.assert_array_equal(curve.density, np.arange(1, 101) / 100)
    np.testing.assert_array_equal(curve.error, np.repeat([0.5, 0.25, 1.5, 1.625], 25))
    np.testing.assert_allclose(curve.ideal, np.repeat([0, 0.25, 2.5 / 3, 1.625], 25))


@pytest.mark.parametrize(
    ("measure", "bad"), [("bad-1", [0, 0, 1, 1]), ("bad-0.25", [0, 1, 1, 1]), ("bad-2", [0, 0, 0, 1])]
)
def test_bad_pixels_by_hand(measure, bad):
    curve = st.sparsification(ERRORS, -ERRORS, TRUTH, measure)
    assert curve.auc == curve.ideal_auc == np.mean(np.cumsum(bad) / np.arange(1, 5))
    assert curve.ause == 0


def test_equal_confidences_stand_for_their_mean():
    curve = st.sparsification(ERRORS, np.ones((1, 4), np.float32), TRUTH, "epe")
    assert curve.auc == curve.random_auc == 1.625
    assert (curve.error == 1.625).all()


def test_the_worst_confidence_lies_above_none():
    worst = st.sparsification(ERRORS, ERRORS, TRUTH, "epe")
    assert worst.auc > worst.random_auc > worst.ideal_auc


def test_the_ideal_area_of_many_pixels():
    bad = np.zeros((100, 200), np.float32)
    bad.ravel()[:5000] = 9
    curve = st.sparsification(bad, np.zeros_like(bad), np.zeros_like(bad), "bad-3")
    share = 0.25
    assert curve.random_auc == share
    assert curve.ideal_auc == pytest.approx(share + (1 - share) * math.log(1 - share), abs=1e-4)


def test_the_area_of_noise():
    """Errors of one normal distribution, in whatever order: the ideal one's mean is far below theirs."""
    errors = np.abs(np.random.default_rng(0).normal(size=(400, 500)))
    trust = np.random.default_rng(1).random(errors.shape)
    curve = st.sparsification(errors, trust, np.zeros_like(errors), "epe")
    assert curve.auc / curve.ideal_auc == pytest.approx(2.32, abs=0.03)


def test_only_answered_pixels_of_known_truth_inside_the_mask_count():
    disparity = np.array([[1, N, 3, 4, 5]], np.float32)
    truth = np.array([[1, 1, N, 1, 1]], np.float32)
    confidence = np.array([[0.5, N, N, 0.9, 0.1]], np.float32)
    curve = st.sparsification(disparity, confidence, truth, "epe")
    assert curve.auc == (3 + 1.5 + 7 / 3) / 3
    masked = st.sparsification(disparity, confidence, truth, "epe", np.array([[1, 1, 1, 0, 1]], bool))
    assert masked.auc == (0 + 2) / 2


def test_nothing_to_measure():
    curve = st.sparsification(np.full((2, 3), N), np.zeros((2, 3)), np.zeros((2, 3)))
    assert math.isnan(curve.auc)
    assert math.isnan(curve.ideal_auc)
    assert np.isnan(curve.error).all()
    assert curve.error.shape == curve.ideal.shape == curve.density.shape


def test_an_infinite_confidence_is_the_highest():
    high = np.array([[-np.inf, 0, 1, np.inf]])
    assert st.sparsification(ERRORS, high, TRUTH, "epe").error[0] == 4


@given(
    rows=some.integers(1, 4),
    columns=some.integers(1, 60),
    levels=some.sampled_from([1, 3, 1000]),
    measure=some.sampled_from(["epe", "bad-1", "bad-3"]),
    dtype=some.sampled_from([np.float32, np.float64]),
    seed=some.integers(0, 2**32 - 1),
)
@settings(max_examples=60, deadline=None)
def test_any_curve(rows, columns, levels, measure, dtype, seed):
    random = np.random.default_rng(seed)
    disparity = random.normal(0, 2, (rows, columns)).astype(dtype)
    truth = np.zeros_like(disparity)
    confidence = random.integers(0, levels, disparity.shape).astype(dtype)
    curve = st.sparsification(disparity, confidence, truth, measure)
    error = np.abs(disparity.astype(np.float64)).ravel()
    if measure != "epe":
        error = (error > float(measure[4:])).astype(float)
    expected = naive(error, confidence.ravel())
    at = [math.ceil(k * error.size / 100 - 1e-12) - 1 for k in range(1, 101)]
    assert curve.auc == pytest.approx(np.mean(expected), rel=1e-9, abs=1e-12)
    np.testing.assert_allclose(curve.error, np.array(expected)[at], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(curve.ideal, np.array(naive(error, -error))[at], rtol=1e-9, atol=1e-12)
    assert curve.ideal_auc <= curve.auc + 1e-12
    turned = np.s_[::-1, ::-1]  # no order among equals matters
    other = st.sparsification(disparity[turned], confidence[turned], truth, measure)
    assert other.auc == pytest.approx(curve.auc, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("measure", ["rmse", "bad", "bad-", "bad--1", "bad-x", "bad-inf", "bad-nan", 1, None])
def test_unknown_measures(measure):
    with pytest.raises(ValueError, match="measure must be"):
        st.sparsification(ERRORS, ERRORS, TRUTH, measure)


def test_wrong_arguments():
    with pytest.raises(ValueError, match="confidence must not be NaN; it is at 1 answered"):
        st.sparsification(ERRORS, np.array([[0, 1, N, 2]]), TRUTH)
    with pytest.raises(ValueError, match="confidence and truth must have one shape"):
        st.sparsification(ERRORS, ERRORS.T, TRUTH)
    with pytest.raises(ValueError, match="disparity and truth must have one shape"):
        st.sparsification(ERRORS.T, ERRORS, TRUTH)
    with pytest.raises(TypeError, match="confidence must be float32 or float64"):
        st.sparsification(ERRORS, ERRORS.astype(int), TRUTH)
    with pytest.raises(TypeError, match="confidence must be an array"):
        st.sparsification(ERRORS, [[1, 2, 3, 4]], TRUTH)


def test_a_match_is_trusted_where_it_is_right():
    scene = st.scenes.street(220, 100, samples=1, noise=3.0)
    result = st.match(scene.pair, disparities=(0, 32), cost=st.ZNCC(9))
    for measure in ("bad-1", "epe"):
        curve = st.sparsification(
            result.disparity, result.confidence, scene.disparity, measure, ~scene.occluded
        )
        assert curve.ideal_auc < curve.auc < 0.8 * curve.random_auc
