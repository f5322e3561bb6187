import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

import stereopsis as st
from reference import confidence as reference
from stereopsis import confidence
from stereopsis.reliability import reliability

MODELS = [
    confidence.model(semi_global, filtered, (9, 7))
    for semi_global in (False, True)
    for filtered in (False, True)
]


@given(
    shape=some.tuples(some.integers(1, 9), some.integers(1, 25)),
    scale=some.sampled_from([0, 0.5, 4, 300]),
    threads=some.sampled_from([1, 3]),
    model=some.sampled_from(MODELS),
    seed=some.integers(0, 2**32),
)
@settings(max_examples=40, deadline=None)
def test_probability_is_its_definition(shape, scale, threads, model, seed):
    rng = np.random.default_rng(seed)
    surface = (scale * rng.integers(-8, 8, shape) / 3).astype(np.float32)
    answered, sharpness = rng.random(shape) < 0.7, rng.random(shape).astype(np.float32)
    winners = (surface + rng.normal(0, 2, shape)).astype(np.float32)
    winners[rng.random(shape) < 0.1] = np.nan
    texture = (20 * rng.random(shape)).astype(np.float32)
    given = surface, answered, sharpness, winners, texture
    found = confidence.probability(*given, model, threads)
    np.testing.assert_allclose(found, reference.probability(*given, model), atol=5e-4)
    # What the model is fitted on is what it sees.
    seen = confidence.features(*given)
    score = np.where(answered, seen @ np.array(model.answered), seen @ np.array(model.filled))
    np.testing.assert_allclose(found, 1 / (1 + np.exp(-np.clip(score, -8, 8))), atol=5e-4)


def test_features_by_hand():
    surface = np.zeros((40, 40), np.float32)
    surface[:, 20:] = 4
    answered, sharpness = np.ones(surface.shape, bool), np.full(surface.shape, 0.25, np.float32)
    answered[0, 0] = False
    winners, texture = surface + np.float32(0.5), np.full(surface.shape, 8, np.float32)
    winners[0, 2] = np.nan
    found = confidence.features(surface, answered, sharpness, winners, texture)
    seen = dict(zip(confidence.FEATURES, found[0, 0], strict=True))
    assert seen.pop("sharpness") == seen.pop("sharpness, 15 x 15") == 0.25
    # Of 21 columns and rows the first ones stand for the ten before them as well.
    assert seen.pop("answered, 21 x 21") == 1 - 121 / 441
    # Nine times the pixel that was filled, three times the one without a winner: both count 3 pixels.
    far = (12 * 3 + 13 * 0.5) / 25
    assert seen.pop("drawn, 5 x 5") == far / (far + 0.5)
    assert seen.pop("jumps, 31 x 31") == seen.pop("spread, 31 x 31") == 0
    assert seen.pop("off the mean, 5 x 5") == seen.pop("off the mean, 15 x 15") == 0
    assert seen.pop("texture, 9 x 9") == 0.5
    assert seen == {"one": 1}
    edge = found[20, 20]
    assert edge[4] == 2 / 31  # the two columns beside the jump
    near, wide, spread = 2 / 5 * 4, 7 / 15 * 4, 4 * np.sqrt(15 * 16) / 31
    np.testing.assert_allclose(edge[5:8], [near / (near + 1), wide / (wide + 1), spread / (spread + 2)])


@pytest.mark.parametrize("model", [confidence.SEMI_GLOBAL, confidence.LOCAL])
def test_a_smooth_surface_is_trusted_more_than_a_broken_one(model):
    rng = np.random.default_rng(0)
    surface = np.full((40, 80), 12, np.float32)
    surface[:, 40:] += rng.integers(-9, 9, (40, 40)).astype(np.float32)
    everywhere, sharpness = np.ones(surface.shape, bool), np.full(surface.shape, 0.3, np.float32)
    texture = np.full(surface.shape, 5, np.float32)
    trust = confidence.probability(surface, everywhere, sharpness, surface, texture, model)
    assert trust[:, :20].min() > 0.9
    assert trust[:, 60:].mean() < 0.3
    filled = confidence.probability(surface, ~everywhere, 0 * sharpness, surface, texture, model)
    assert filled[:, :20].max() < trust[:, :20].min()
    # An answer that the filters drew far from what was matched is worth less.
    drawn = confidence.probability(surface, everywhere, sharpness, surface + 2, texture, model)
    assert drawn[:, :20].max() < trust[:, :20].min()


def test_each_map_has_its_model():
    assert confidence.model(True, True, (9, 7)) is confidence.SEMI_GLOBAL
    assert confidence.model(False, True, (9, 7)) is confidence.LOCAL
    assert confidence.model(True, False, (9, 7)) is confidence.SEMI_GLOBAL_UNFILTERED
    assert confidence.model(False, False, (1, 1)) == confidence.LOCAL_UNFILTERED
    wide = confidence.model(False, False, (16, 4))
    for mine, others, gain in zip(wide, confidence.LOCAL_UNFILTERED, confidence.PER_DOUBLING, strict=True):
        assert mine[:-1] == others[:-1]
        assert mine[-1] == pytest.approx(others[-1] + 3 * gain)


@pytest.mark.parametrize(
    "chain",
    [
        {"cost": st.Census(), "optimize": st.SGM()},
        {"cost": st.Census(), "optimize": st.SGM(), "left_right": 1, "fill": "background"},
        {"cost": st.ZNCC(31)},
        {"cost": st.ZNCC(9), "left_right": 1, "uniqueness": 5},
    ],
)
def test_calibrated_without_filters(chain):
    scene = st.scenes.street(320, 200, seed=5)
    result = st.match(scene.left, scene.right, disparities=(0, 64), confidence="calibrated", **chain)
    known = np.isfinite(scene.disparity) & np.isfinite(result.disparity)
    right = np.abs(result.disparity - scene.disparity)[known] <= 3
    assert reliability(result.confidence[known], right).error < 0.1


def test_calibrated_on_a_scene():
    scene = st.scenes.street(320, 200, seed=5)
    checks = {"disparities": (0, 64), "left_right": 1, "median": 3, "speckle": (60, 1.0), "fill": "surfaces"}
    result = st.match(scene.left, scene.right, cost=st.ZNCC(9), confidence="calibrated", **checks)
    plain = st.match(scene.left, scene.right, cost=st.ZNCC(9), **checks)
    assert ((result.confidence >= 0) & (result.confidence <= 1)).all()
    np.testing.assert_array_equal(result.disparity, plain.disparity)
    truth = scene.disparity
    ours, theirs = (
        st.sparsification(found.disparity, found.confidence, truth, "bad-3") for found in (result, plain)
    )
    assert ours.auc < theirs.auc
    known = np.isfinite(truth) & np.isfinite(result.disparity)
    right = np.abs(result.disparity - truth)[known] <= 3
    assert reliability(result.confidence[known], right).error < 0.1


def test_reliability_by_hand():
    trust = np.array([[0.0, 0.05, 0.5], [0.59, 1.0, 1.0]])
    right = np.array([[False, False, True], [False, True, True]])
    table = reliability(trust, right, bins=2)
    np.testing.assert_array_equal(table.edges, [0, 0.5, 1])
    np.testing.assert_allclose(table.share, [2 / 6, 4 / 6])
    np.testing.assert_allclose(table.confidence, [0.025, 3.09 / 4])
    np.testing.assert_allclose(table.correct, [0, 0.75])
    assert table.error == pytest.approx((2 * 0.025 + 4 * (3.09 / 4 - 0.75)) / 6)
    empty = reliability(trust, right, bins=100)
    assert np.isnan(empty.correct[50:59]).sum() == 8
    assert np.isnan(reliability(np.zeros(0), np.zeros(0, bool)).error)


@pytest.mark.parametrize(
    ("trust", "right", "bins", "error", "says"),
    [
        (np.zeros(2), np.zeros(2), 2, TypeError, "correct must be an array of bool"),
        (np.zeros(2), np.zeros(3, bool), 2, ValueError, "same shape"),
        (np.full(2, 1.5), np.zeros(2, bool), 2, ValueError, "confidence must be from 0 to 1"),
        (np.full(2, np.nan), np.zeros(2, bool), 2, ValueError, "confidence must be from 0 to 1"),
        (np.zeros(2), np.zeros(2, bool), 0, ValueError, "bins must be at least 1"),
        (np.zeros(2), np.zeros(2, bool), 2.0, TypeError, "bins must be a whole number"),
    ],
)
def test_reliability_refuses(trust, right, bins, error, says):
    with pytest.raises(error, match=says):
        reliability(trust, right, bins)
