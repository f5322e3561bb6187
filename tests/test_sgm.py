"""Semi-global matching: the formula, the sums' bound, and the streaming path against the composed one."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as some

import stereopsis as st
from reference import sgm as reference
from stereopsis import SGM, Census, Disparities, Settings, _fused, _instructions, cost, sgm

SETS = _fused.instruction_sets()
WORST = 65535


def images(seed, shape, shift=2, levels=9):
    """A pair with true matches, wrong ones and repeated texture."""
    rng = np.random.default_rng(seed)
    left = rng.integers(0, levels, shape)
    right = np.roll(left, -shift, axis=1)
    wrong = rng.random(shape) < 0.2
    right[wrong] = rng.integers(0, levels, shape)[wrong]
    return left.astype(np.uint8), right.astype(np.uint8)


# ---- the sums ------------------------------------------------------------------------------------


def test_a_path_by_hand():
    costs = np.array([[[3, 0, 5], [1, 4, 2], [6, 6, 0]]], np.uint16)
    # From the left, P1 = 1, P2 = 2: messages from (3, 0, 5), least 0, are (1, 0, 1); so (2, 4, 3).
    # From these, least 2, they are (2, 3, 3) - 2 = (0, 1, 1): (6, 7, 1). From the right, likewise,
    # (6, 6, 0) tells (2, 1, 0), and (1, 4, 2) + (2, 1, 0) = (3, 5, 2), less 2, tells (1, 1, 0).
    forth, back = [[3, 0, 5], [2, 4, 3], [6, 7, 1]], [[4, 1, 5], [3, 5, 2], [6, 6, 0]]
    given = SGM(paths=2, p1=1, p2=2)
    found = sgm.sums(costs, given, 1.0, 6)
    np.testing.assert_array_equal(found[0], np.add(forth, back))
    np.testing.assert_array_equal(reference.sums(costs, 2, 1, [2] * 256)[0], np.add(forth, back))


def test_winners_out_of_view_by_hand():
    # Columns 0, 1, 2 of a row, disparities 0, 1, 2: column x sees those up to x.
    sums = np.array([[[3, 2, 2], [5, 5, 4], [1, 0, 0]]], np.uint16)
    beyond = sgm.out_of_view(sums, 0)
    np.testing.assert_array_equal(beyond, [[1, 2, -1]])
    np.testing.assert_array_equal(sums, [[[3, WORST, WORST], [5, 5, WORST], [1, 0, 0]]])
    # A sum out of view has to be less than all in view; where none is in view it is the least.
    sums = np.array([[[4, 4, 4], [9, 1, 2], [7, 6, 6]]], np.uint16)
    np.testing.assert_array_equal(sgm.out_of_view(sums, 1), [[0, 1, -1]])
    np.testing.assert_array_equal(sums, [[[WORST] * 3, [9, WORST, WORST], [7, 6, WORST]]])


@pytest.mark.parametrize("instructions", SETS)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=some.data())
def test_the_sums_are_those_of_the_formula(monkeypatch, instructions, data):
    monkeypatch.setenv(_instructions.ENVIRONMENT, instructions)
    rows, columns = data.draw(some.integers(1, 19)), data.draw(some.integers(1, 12))
    count = data.draw(some.sampled_from([1, 2, 3, 31, 32, 33, 64, 65, 127, 128, 129, 200]))
    most, p1 = data.draw(some.sampled_from([0, 5, 62, 140, 400])), data.draw(some.integers(0, 40))
    p2 = p1 + data.draw(some.sampled_from([0, 1, 80, 160, 900]))
    paths = data.draw(some.sampled_from([2, 4, 5, 8, 16]))
    contrast = data.draw(some.sampled_from([None, 0.5, 8, 100]))
    rng = np.random.default_rng(data.draw(some.integers(0, 2**32)))
    costs = rng.integers(0, most + 1, (rows, columns, count)).astype(np.uint16)
    guide = rng.integers(0, 256, (rows, columns)).astype(np.uint8)
    chosen = SGM(paths, p1, p2, contrast=contrast)
    threads = data.draw(some.sampled_from([1, 2, 7]))
    found = sgm.sums(costs, chosen, 1.0, most, guide, threads)
    second = [p2] * 256 if contrast is None else reference.second_penalties(p2, p1, contrast)
    wanted = reference.sums(costs, paths, p1, second, None if contrast is None else guide)
    assert wanted.max() <= chosen.largest_sum(most, 1.0)
    np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize("rows", [1, 2, 15, 16, 17, 31, 33, 50])
@pytest.mark.parametrize("paths", [4, 8, 16])
def test_rows_around_the_stretches_that_are_followed_again(rows, paths):
    rng = np.random.default_rng(rows)
    costs = rng.integers(0, 20, (rows, 4, 5)).astype(np.uint16)
    wanted = reference.sums(costs, paths, 2, [9] * 256)
    np.testing.assert_array_equal(sgm.sums(costs, SGM(paths, 2, 9), 1.0, 19, threads=2), wanted)


@settings(max_examples=30, deadline=None)
@given(
    seed=some.integers(0, 2**32),
    shape=some.tuples(some.integers(1, 9), some.integers(1, 9), some.integers(1, 12)),
    paths=some.sampled_from([4, 8]),
    contrast=some.sampled_from([None, 20.0]),
)
def test_more_global_sums_are_those_of_the_formula(seed, shape, paths, contrast):
    rng = np.random.default_rng(seed)
    costs = rng.integers(0, 40, shape).astype(np.uint16)
    guide = rng.integers(0, 256, shape[:2]).astype(np.uint8)
    chosen = SGM(paths, 3, 25, contrast=contrast, more_global=True)
    second = [25] * 256 if contrast is None else reference.second_penalties(25, 3, contrast)
    wanted = reference.more_global(costs, paths, 3, second, None if contrast is None else guide)
    assert wanted.max() <= chosen.largest_sum(39, 1.0)
    np.testing.assert_array_equal(sgm.sums(costs, chosen, 1.0, 39, guide), wanted)


# ---- settings ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"paths": 3}, "paths must be one of 2, 4, 5, 8, 16, not 3"),
        ({"p1": -1}, "p1 must be a number from 0"),
        ({"p1": 90}, "p2 must be a number from p1, 90"),
        ({"p2": float("nan")}, "p2 must be"),
        ({"p2_min": 3}, "p2_min must be a number from p1"),
        ({"p2_min": 87}, "p2_min must be at most p2"),
        ({"contrast": 0}, "contrast must be"),
        ({"unit": 3}, "unit must be a power of two"),
        ({"more_global": 1}, "more_global must be True or False"),
        ({"more_global": True, "paths": 5}, "paths must be 4 or 8"),
    ],
)
def test_settings_that_are_refused(given, message):
    with pytest.raises(ValueError, match=message):
        SGM(**given)


def test_sums_that_16_bits_do_not_hold_are_refused_with_what_would_fit():
    # 8 (62 + 8130) = 65536; in units of 2 it is half that.
    fits, too_large = SGM(p2=8129, unit=1), SGM(p2=8130, unit=1)
    assert fits.largest_sum(62, 1) == 65528
    assert Settings(cost=Census(), optimize=fits).optimize == fits
    with pytest.raises(
        ValueError, match=r"unit must be at least 2, not 1: 8 paths .* sum to up to 65536 units"
    ):
        Settings(cost=Census(), optimize=too_large)
    Settings(cost=Census(), optimize=dataclasses.replace(too_large, unit=None))
    with pytest.raises(ValueError, match="unit must be at least"):
        Settings(cost=st.ZNCC(9), optimize=SGM(8, 0.1, 1, unit=2**-20))


@settings(max_examples=300, deadline=None)
@given(
    paths=some.sampled_from(sgm.PATHS),
    p1=some.floats(0, 1e9),
    more=some.floats(0, 1e9),
    contrast=some.none() | some.floats(1e-3, 1e6),
    unit=some.none() | some.integers(-24, 24).map(lambda k: 2.0**k),
    most=some.integers(0, 65534) | some.floats(0, 1e9),
    whole=some.booleans(),
)
def test_no_setting_can_overflow(paths, p1, more, contrast, unit, most, whole):
    chosen = SGM(paths, p1, min(p1 + more, 1e9), contrast=contrast, unit=unit)
    try:
        step = chosen.unit_for(most, whole)
    except ValueError:
        assert chosen.largest_sum(most, unit) > sgm.LARGEST_SUM
        return
    second = chosen.second_penalties(step)
    assert (second >= 0).all()
    assert paths * (sgm.most_units(most, step) + int(second.max())) <= sgm.LARGEST_SUM


def test_texts_and_back():
    texts = "optimize=sgm optimize_p1=63 optimize_p2=774 optimize_unit=8 optimize_contrast=20"
    chosen = Settings.make(assignments=["cost=census(9x7,aggregation=3)", *texts.split()])
    assert chosen.optimize == SGM(8, 63, 774, contrast=20, unit=8)
    assert Settings.from_toml(chosen.to_toml()) == chosen
    assert chosen.changed(optimize_paths=4).optimize == SGM(4, 63, 774, contrast=20, unit=8)
    assert chosen.changed(optimize="bp").changed(optimize="sgm").optimize == SGM()
    assert chosen.to_dict()["optimize"]["paths"] == 8
    with pytest.raises(ValueError, match="optimize=sgm has no optimize_iterations"):
        chosen.changed(optimize_iterations=3)


def test_penalties_adapted_to_the_gradient():
    assert SGM(p2=100).second_penalties(1.0).tolist() == [100] * 256
    adapted = SGM(p1=10, p2=100, contrast=10).second_penalties(1.0)
    # 100 / (1 + k / 10): 100, 90.9, 83.3 ... 50 at 10, and never less than P1.
    assert adapted[[0, 1, 2, 10, 90, 200]].tolist() == [100, 91, 83, 50, 10, 10]
    assert SGM(p1=10, p2=100, p2_min=40, contrast=10).second_penalties(4.0)[[0, 255]].tolist() == [25, 10]


# ---- streaming = composed ------------------------------------------------------------------------


@pytest.mark.parametrize("instructions", SETS)
def test_of_equal_sums_both_views_take_the_first(monkeypatch, instructions):
    monkeypatch.setenv(_instructions.ENVIRONMENT, instructions)
    # Every eighth candidate matches, all along. The first one is disparity 0, in both views.
    line = np.random.default_rng(3).integers(0, 256, 8).astype(np.uint8)
    image = np.tile(line, (9, 40))
    result = st.match(image, image, disparities=(0, 128), cost=Census(), optimize=SGM(), left_right=0)
    inside = np.s_[:, 132:-8]
    assert (result.disparity[inside] == 0).all()
    assert (result.flags[inside] == 0).all()


@pytest.mark.parametrize("instructions", SETS)
@pytest.mark.parametrize(("width", "count"), [(150, 128), (203, 128), (97, 64), (170, 130)])
@pytest.mark.parametrize("p2", [86, 127, 128])
def test_rows_of_many_vectors(monkeypatch, instructions, width, count, p2):
    # Two paths' costs are summed in bytes where P2 <= 127; whole vectors of pixels are matched together.
    both(
        monkeypatch, *images(width + p2, (19, width), shift=9), (instructions,), (1, 2),
        disparities=(-2, count - 2), cost=Census((9, 7)), optimize=SGM(p1=7, p2=p2), left_right=1,
    )  # fmt: skip


def both(monkeypatch, left, right, instructions=SETS, threads=(1, 2, 7), **chosen):
    definition = st.match(left, right, keep=("costs",), **chosen)
    assert definition.path == "composed"
    for name, count in itertools.product(instructions, threads):
        monkeypatch.setenv(_instructions.ENVIRONMENT, name)
        streaming = st.match(left, right, threads=count, **chosen)
        assert streaming.path == "streaming"
        for what in ("flags", "disparity", "confidence"):
            here, there = getattr(streaming, what), getattr(definition, what)
            assert here.tobytes() == there.tobytes(), (what, name, count, np.argwhere(here != there)[:5])
    return definition


@pytest.mark.parametrize("aggregation", [1, 3])
@pytest.mark.parametrize("paths", [2, 4, 5, 8, 16])
def test_streaming_is_composed_with_every_check(monkeypatch, aggregation, paths):
    left, right = images(paths, (37, 50))
    seen, area = set(), aggregation**2
    for subpixel, left_right, uniqueness, contrast, unit in [
        (None, None, None, None, None),
        ("parabola", 1, 5, None, 8),
        ("equiangular", 0, None, 10, None),
        ("parabola", 2.5, 0, 10, 2),
    ]:
        definition = both(
            monkeypatch, left, right, threads=(1, 3), disparities=(-3, 30),
            cost=Census((9, 7), aggregation=aggregation),
            optimize=SGM(paths, 7 * area, 86 * area, contrast=contrast, unit=unit),
            subpixel=subpixel, left_right=left_right, uniqueness=uniqueness,
        )  # fmt: skip
        seen |= set(np.unique(definition.flags))
    assert {0, st.Flag.OCCLUDED, st.Flag.MISMATCHED} <= seen


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    seed=some.integers(0, 2**32),
    shape=some.tuples(some.integers(1, 20), some.integers(1, 40)),
    first=some.integers(-30, 30),
    count=some.integers(1, 150),
    window=some.sampled_from([(3, 3), (5, 5), (9, 7), (9, 9), (11, 11), (1, 3)]),
    pattern=some.sampled_from(["dense", "sparse", "symmetric"]),
    aggregation=some.sampled_from([1, 3]),
    paths=some.sampled_from([2, 4, 5, 8, 16]),
    unit=some.sampled_from([None, 1, 2, 8]),
    contrast=some.none() | some.sampled_from([4.0, 30.0]),
    left_right=some.none() | some.sampled_from([0.0, 1.0, 90.0]),
    uniqueness=some.none() | some.sampled_from([0.0, 8.0]),
    instructions=some.sampled_from(SETS),
    threads=some.sampled_from([1, 2, 7]),
)
def test_streaming_is_composed_on_any_shape(
    monkeypatch, seed, shape, first, count, window, pattern, aggregation, paths, unit, contrast, left_right,
    uniqueness, instructions, threads
):  # fmt: skip
    left, right = images(seed, shape)
    chosen = {
        "disparities": (first, first + count),
        "cost": Census(window, "dense" if window == (1, 3) else pattern, aggregation),
        "optimize": SGM(paths, 5 * aggregation**2, 30 * aggregation**2, contrast=contrast, unit=unit),
        "left_right": left_right,
        "uniqueness": uniqueness,
    }
    x = np.arange(shape[1])[:, None] - first - np.arange(count)
    if not ((x >= 0) & (x < shape[1])).any():
        assert (st.match(left, right, **chosen).flags == st.Flag.OUT_OF_VIEW).all()
        return
    if aggregation == 3 and chosen["cost"].most > 85:
        assert st.match(left, right, **chosen).path == "composed"
        return
    both(monkeypatch, left, right, (instructions,), (threads,), **chosen)


def sheared(left, right, census, first, count, shift):
    """Costs of a sheared volume from the census strings, (H, W, D) int64, summed over equal labels."""
    strings = [cost_strings(image, census) for image in (left, right)]
    rows, columns = left.shape
    y, x = np.indices(left.shape)
    radius = census.box[0] // 2
    costs = np.zeros((rows, columns, count), np.int64)
    for i, dy, dx in itertools.product(range(count), *(range(-radius, radius + 1),) * 2):
        v, u = np.clip(y + dy, 0, rows - 1), np.clip(x + dx, 0, columns - 1)
        there = np.clip(x + dx - first - shift[v, u] - i, 0, columns - 1)
        costs[..., i] += (strings[0][v, u] != strings[1][v, there]).sum(axis=-1)
    return costs


def cost_strings(image, census):
    points = census.comparisons
    reach = 5
    wide = np.pad(image, reach, "edge")
    rows, columns = image.shape
    return np.stack(
        [
            wide[reach + a[0] : reach + a[0] + rows, reach + a[1] : reach + a[1] + columns]
            < wide[reach + b[0] : reach + b[0] + rows, reach + b[1] : reach + b[1] + columns]
            for a, b in points
        ],
        axis=-1,
    )


@pytest.mark.parametrize("instructions", SETS)
@pytest.mark.parametrize("aggregation", [1, 3])
def test_a_sheared_volume(monkeypatch, instructions, aggregation):
    monkeypatch.setenv(_instructions.ENVIRONMENT, instructions)
    rng = np.random.default_rng(5)
    left, right = images(5, (21, 45), shift=4)
    census, chosen = Census((5, 5), aggregation=aggregation), SGM(8, 4 * aggregation**2, 20 * aggregation**2)
    first, count = -2, 9
    for shift in (
        np.broadcast_to(np.arange(21)[:, None] // 4, (21, 45)),
        rng.integers(-60, 60, (21, 45)),
        np.full((21, 45), 3),
    ):
        shift = np.ascontiguousarray(shift, np.int16)
        costs = sheared(left, right, census, first, count, shift)
        disparity = first + np.arange(count) + shift[..., None].astype(np.int64)
        match = np.arange(45)[None, :, None] - disparity
        seen = (match >= 0) & (match < 45)
        costs[~seen] = (census.largest() + 1) // 2  # as by chance
        sums = reference.sums(costs, 8, int(chosen.p1), [int(chosen.p2)] * 256).astype(np.float64)
        beyond = np.where(seen, np.inf, sums).min(axis=2)
        sums[~seen] = np.inf
        index = sums.argmin(axis=2)
        answered = sums.min(axis=2) <= beyond
        wanted = np.where(answered, np.take_along_axis(disparity, index[..., None], 2)[..., 0], np.nan)
        found, _, flags = _fused.match_sgm(
            census,
            cost.pixels(left, right),
            Disparities(first, first + count),
            chosen,
            None,
            None,
            None,
            2,
            shift,
        )
        np.testing.assert_array_equal(found, wanted.astype(np.float32))
        np.testing.assert_array_equal(flags == st.Flag.OUT_OF_VIEW, ~answered)
        # The right view: of the left pixels that mean a right one, the one of the least sum and disparity.
        checked, _, flags = _fused.match_sgm(
            census,
            cost.pixels(left, right),
            Disparities(first, first + count),
            chosen,
            None,
            1.0,
            None,
            2,
            shift,
        )
        for y, x in zip(*np.nonzero(answered), strict=True):
            there = x - int(wanted[y, x])
            rival = min(
                (sums[y, u, i], disparity[y, u, i]) for u, i in np.argwhere((match[y] == there) & seen[y])
            )
            assert (flags[y, x] == 0) == (abs(rival[1] - wanted[y, x]) <= 1)
            assert np.isnan(checked[y, x]) == (flags[y, x] != 0)


# ---- over other costs ----------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_over_any_cost(dtype):
    left, right = (image.astype(dtype) * 3 for image in images(9, (18, 40)))
    for matching in (st.SAD(3), st.SSD(3), st.ZSAD(3), st.ZSSD(3), st.NCC(3), st.ZNCC(3), st.Gradient(3),
                     st.Combined(st.Census(5), 0.6, st.Gradient(3), 0.4),
                     st.ZNCC(st.Gaussian(1))):  # fmt: skip
        # A few per cent of what a wrong match costs.
        volume = st.match(left, right, disparities=(-2, 9), cost=matching, keep=("costs",)).stages["costs"]
        perfect = -1.0 if type(matching).__name__ in ("NCC", "ZNCC") else 0.0
        worst = np.iinfo(volume.dtype).max if volume.dtype.kind in "iu" else np.inf
        typical = float(np.median(volume[volume < worst])) - perfect
        chosen = SGM(8, 0.05 * typical, 0.3 * typical)
        result = st.match(left, right, disparities=(-2, 9), cost=matching, optimize=chosen, left_right=1,
                          subpixel=None, keep=("costs",))  # fmt: skip
        assert result.path == "composed"
        # The definition, from the volume in the image's own units.
        known = volume < worst
        largest = (
            matching.largest() if hasattr(matching, "largest") else 2.0 if perfect
            else float((volume[known].astype(np.float64) - perfect).max())
        )  # fmt: skip
        step = chosen.unit_for(largest, volume.dtype.kind in "iu")
        units = np.floor((np.where(known, volume, 0) - np.float64(perfect)) / step + 0.5)
        top = np.floor(largest / step + 0.5)
        units = np.where(known, np.clip(units, 0, top), (top + 1) // 2)  # out of view as by chance
        wanted = reference.sums(units.astype(np.int64), 8, chosen.first_penalty(step),
                                chosen.second_penalties(step).tolist())  # fmt: skip
        np.testing.assert_array_equal(result.stages["costs"][known], wanted[known])
        assert (result.stages["costs"][~known] == WORST).all()
        assert np.nanmean(result.disparity == 2) > 0.6


def test_a_textureless_stripe_is_bridged():
    scene = st.scenes.plane(96, 40, disparity=7)
    left, right = scene.left.copy(), scene.right.copy()
    left[:, 50:60] = right[:, 43:53] = 90
    plain = st.match(left, right, disparities=(0, 16), cost=Census(), subpixel=None)
    smooth = st.match(left, right, disparities=(0, 16), cost=Census(), optimize=SGM(), subpixel=None)
    inside = np.s_[4:-4, 40:90]
    assert (plain.disparity[inside] == 7).mean() < 0.97
    assert (smooth.disparity[inside] == 7).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 60), (60, 1)])
def test_degenerate_images(shape):
    for values in (np.zeros(shape), np.indices(shape).sum(axis=0) % 2 * 255):
        image = values.astype(np.uint8)
        result = st.match(image, image, disparities=(0, 8), cost=Census(), optimize=SGM(), left_right=1)
        assert result.disparity.shape == shape
        assert (np.isfinite(result.disparity) | (result.flags != 0)).all()
