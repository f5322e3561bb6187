import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as some

import stereopsis as st
from reference import planes as reference
from reference.sky import label as regions_of
from stereopsis import Flag, Settings, _core, datasets, planes
from stereopsis.planes import Meeting, Model

N = np.nan
SEEDS = some.integers(0, 2**32)
DATA = Path(os.environ.get("STEREOPSIS_DATA") or Path(__file__).parents[2] / "shared" / "data")
SMALL = Model(side=5.0)


def grid(shape, rows, columns):
    height, width = shape
    y, x = np.arange(height) * rows // height, np.arange(width) * columns // width
    return (y[:, None] * columns + x).astype(np.int32)


def on(plane, shape):
    y, x = np.mgrid[: shape[0], : shape[1]]
    return plane[0] * x + plane[1] * y + plane[2]


def whole(seen):
    return tuple(np.ascontiguousarray(part, np.float32) for part in seen)


def believed(disparity, image=None):
    """Of one grey level, unless an image is given, and believed everywhere."""
    if image is None:
        image = np.zeros(disparity.shape)
    return whole((image.reshape(*disparity.shape, -1), disparity, np.ones(disparity.shape)))


@some.composite
def scenes(draw):
    """An image, disparities on a few planes with noise and outliers, weights with zeros; and segments."""
    random = np.random.default_rng(draw(SEEDS))
    shape = draw(some.integers(1, 19)), draw(some.integers(1, 19))
    channels = draw(some.sampled_from((1, 3)))
    rows, columns = draw(some.integers(1, min(shape[0], 4))), draw(some.integers(1, min(shape[1], 4)))
    surface = random.integers(0, 3, size=(-(-shape[0] // 6), -(-shape[1] // 6)))
    surface = np.kron(surface, np.ones((6, 6), int))[: shape[0], : shape[1]]
    slopes = random.uniform((-0.7, -1.6, -9), (0.7, 1.6, 9), (3, 3))
    disparity = np.choose(surface, [on(plane, shape) for plane in slopes])
    disparity += random.normal(0, 0.4, shape) + 20 * (random.random(shape) < 0.1)
    image = 60.0 * surface[..., None] + random.normal(0, 12, (*shape, channels))
    weight = random.random(shape) * (random.random(shape) < draw(some.sampled_from((0.2, 0.9, 1.0))))
    disparity[weight == 0] = draw(some.sampled_from((0.0, np.nan)))
    seen, label = whole((image, disparity, weight)), grid(shape, rows, columns)
    start = random.normal(slopes[random.integers(0, 3, rows * columns)], 0.05)
    start[random.random(rows * columns) < 0.2] = N
    return seen, label, start, columns


def same_planes(found, expected, label):
    """To be told apart by what they mean: a plane of few points is hardly determined by itself."""
    np.testing.assert_array_equal(np.isnan(found[:, 2]), np.isnan(expected[:, 2]))
    y, x = np.indices(label.shape)
    one, other = (
        (p[label] * np.stack((x, y, np.ones_like(x)), axis=-1)).sum(axis=-1) for p in (found, expected)
    )
    np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6)


# ---- fit -----------------------------------------------------------------------------------------


def test_a_plane_among_outliers_is_found_exactly():
    plane = (0.25, -0.5, 40.0)
    disparity = on(plane, (12, 12))
    disparity[::3] += 30
    found = np.full((1, 3), N)
    _core.fit_planes(believed(disparity), tuple(Model()), np.zeros((12, 12), np.int32), 8, found, 1)
    np.testing.assert_allclose(found[0], plane, atol=1e-9)


def test_a_plane_weighs_its_points():
    # Two levels, which no plane within the largest slope fits: the heavier of them wins.
    disparity = np.repeat([[3.0] * 4 + [90.0] * 4], 8, axis=0)
    for heavy, level in ((0, 3), (1, 90)):
        weight = np.where(disparity > 50, 0.1 + heavy, 1.1 - heavy)
        seen = whole((np.zeros((8, 8, 1)), disparity, weight))
        found = np.full((1, 3), N)
        _core.fit_planes(seen, tuple(Model()), np.zeros((8, 8), np.int32), 16, found, 1)
        np.testing.assert_allclose(found[0], (0, 0, level), atol=1e-12)


@settings(max_examples=150, deadline=None)
@given(scene=scenes(), trials=some.integers(1, 9))
def test_fit_is_its_definition(scene, trials):
    seen, label, start, _ = scene
    expected = reference.fit(seen, SMALL, label, start, trials)
    for threads in (1, 3):
        found = start.copy()
        _core.fit_planes(seen, tuple(SMALL), label, trials, found, threads)
        same_planes(found, expected, label)


# ---- boundaries ----------------------------------------------------------------------------------


def test_a_boundary_moves_to_the_edge():
    image = np.repeat([[0.0] * 7 + [99.0] * 5], 10, axis=0)
    label = grid((10, 12), 1, 2)
    flat = np.array([[0.0, 0, 4], [0, 0, 4]])
    _core.move_boundaries(believed(np.full((10, 12), 4.0), image), tuple(SMALL), flat, 3, label, 1)
    np.testing.assert_array_equal(label, image > 50)


def test_a_boundary_moves_to_the_step():
    # Of one colour: the disparities alone tell the segments apart.
    disparity = np.repeat([[4.0] * 4 + [9.0] * 8], 10, axis=0)
    label = grid((10, 12), 1, 2)
    flat = np.array([[0.0, 0, 4], [0, 0, 9]])
    _core.move_boundaries(believed(disparity), tuple(SMALL), flat, 3, label, 1)
    np.testing.assert_array_equal(label, disparity > 5)


@settings(max_examples=120, deadline=None)
@given(scene=scenes(), sweeps=some.integers(0, 3))
def test_moves_are_their_definition(scene, sweeps):
    seen, label, start, _ = scene
    expected = reference.move(seen, SMALL, start, label, sweeps)
    for threads in (1, 3):
        found = label.copy()
        _core.move_boundaries(seen, tuple(SMALL), start, sweeps, found, threads)
        np.testing.assert_array_equal(found, expected)


@settings(max_examples=60, deadline=None)
@given(scene=scenes(), boundary=some.sampled_from((0.0, 300.0)))
def test_segments_stay_in_one_piece(scene, boundary):
    seen, label, start, _ = scene
    count = label.max() + 1
    _core.move_boundaries(seen, tuple(SMALL._replace(boundary=boundary)), start, 6, label, 1)
    for i in range(count):
        assert regions_of(label == i)[1] == 1


# ---- smoothing -----------------------------------------------------------------------------------


def test_a_segment_without_pixels_to_believe_takes_its_neighbours_plane():
    plane = (0.2, 0.1, 5.0)
    disparity = on(plane, (6, 18))
    weight = np.ones((6, 18))
    weight[:, 6:12] = 0
    found = np.array([plane, (N, N, N), plane])
    seen = whole((np.zeros((6, 18, 1)), disparity, weight))
    _core.smooth_planes(seen, tuple(SMALL), grid((6, 18), 1, 3), 3, 1, found, 1)
    np.testing.assert_allclose(found, [plane] * 3, atol=1e-6)


def test_a_step_in_depth_is_kept():
    disparity = np.repeat([[5.0] * 6 + [50.0] * 6], 6, axis=0)
    start = np.array([[0.0, 0, 5], [0, 0, 50]])
    found = start.copy()
    _core.smooth_planes(believed(disparity), tuple(SMALL), grid((6, 12), 1, 2), 2, 5, found, 1)
    np.testing.assert_allclose(found, start, atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(scene=scenes(), rounds=some.integers(0, 2))
def test_smoothing_is_its_definition(scene, rounds):
    seen, label, start, columns = scene
    _core.move_boundaries(seen, tuple(SMALL), start, 2, label, 1)
    try:
        expected = reference.smooth(seen, SMALL, label, start, columns, rounds)
    except reference.TieError:
        assume(False)
    for threads in (1, 3):
        found = start.copy()
        _core.smooth_planes(seen, tuple(SMALL), label, columns, rounds, found, threads)
        same_planes(found, expected, label)


@given(scene=scenes(), least=some.floats(-9, 9), span=some.floats(0, 9))
def test_rendering_is_its_definition(scene, least, span):
    _, label, start, _ = scene
    out = np.empty(label.shape, np.float32)
    _core.render_planes(label, start, least, least + span, out, 3)
    np.testing.assert_allclose(out, reference.render(label, start, least, least + span), rtol=1e-6, atol=1e-6)


# ---- how segments meet ---------------------------------------------------------------------------


def test_meetings_by_hand():
    # Four columns wide each: level at 5, rising by 1 a column, level at 20.
    label = grid((4, 12), 1, 3)
    found = planes.boundaries(label, np.array([[0, 0, 5], [1.0, 0, 1.5], [0, 0, 20]]))
    np.testing.assert_array_equal(np.stack((found.first, found.second), 1), [(0, 1), (1, 2)])
    np.testing.assert_array_equal(found.length, [4, 4])
    # Halfway between columns 3 and 4 the first two are level; over both, the mean of the squares is 5.25.
    assert list(found.meeting) == [Meeting.HINGE, Meeting.OCCLUSION]
    np.testing.assert_allclose(found.step, [0, 7.5 + 1.5 - 20])
    same = planes.boundaries(label, np.array([[0.1, 0, 5.0]] * 2 + [[N, N, N]]))
    assert list(same.meeting) == [Meeting.COPLANAR]
    assert all(len(part) == 0 for part in planes.boundaries(np.zeros((3, 4), np.int32), np.zeros((1, 3))))


@given(scene=scenes())
def test_meetings_are_their_definition(scene):
    seen, label, start, _ = scene
    _core.move_boundaries(seen, tuple(SMALL), start, 2, label, 1)
    found = planes.boundaries(label, start, SMALL)
    expected = {}
    for (i, j), places in reference.meetings(label).items():
        if reference.exists(start[i]) and reference.exists(start[j]):
            both = [(x, y) for y, x in zip(*np.nonzero((label == i) | (label == j)), strict=True)]
            _, how = reference.meeting(SMALL, both, places, start[i], start[j])
            step = np.mean([reference.at(start[i], *p) - reference.at(start[j], *p) for p in places])
            expected[i, j] = len(places), how, pytest.approx(step, abs=1e-4)
    got = zip(found.length.tolist(), found.meeting.tolist(), found.step.tolist(), strict=True)
    assert (
        dict(zip(zip(found.first.tolist(), found.second.tolist(), strict=True), got, strict=True)) == expected
    )


# ---- the whole stage -----------------------------------------------------------------------------


def two_surfaces(shape=(60, 90)):
    """A road with a wall before it, each of its own texture."""
    random = np.random.default_rng(5)
    wall = np.zeros(shape, bool)
    wall[10:40, 30:60] = True
    truth = np.where(wall, 45.0, on((0.0, 0.5, 2.0), shape))
    image = np.where(wall, 200, 60) + random.integers(-30, 30, shape)
    return image.astype(np.uint8), truth.astype(np.float32), wall


def test_holes_and_noise_on_two_surfaces():
    image, truth, wall = two_surfaces()
    random = np.random.default_rng(6)
    disparity = truth + random.normal(0, 0.4, truth.shape).astype(np.float32)
    disparity[random.random(truth.shape) < 0.3] = N
    disparity[45:55, :14] = N
    before = disparity.copy()
    found = planes.refine(image, disparity, (0, 63), threads=1)
    np.testing.assert_array_equal(disparity, before)
    error = np.abs(found.disparity - truth)
    assert np.isfinite(error).all()
    assert (error > 1).mean() < 0.02
    assert np.median(error) < 0.1 < 0.25 < np.nanmedian(np.abs(disparity - truth))
    agreed = np.abs(found.disparity - disparity) <= planes.AGREES
    every = [agreed[found.label == i].mean() for i in range(len(found.planes))]
    np.testing.assert_allclose(found.support, every, rtol=1e-6)
    # No segment lies on both.
    share = np.bincount(found.label.ravel(), wall.ravel()) / np.bincount(found.label.ravel())
    assert np.mean((share > 0.1) & (share < 0.9)) < 0.03
    meeting = planes.boundaries(found.label, found.planes).meeting
    assert set(meeting.tolist()) >= {Meeting.COPLANAR, Meeting.OCCLUSION}
    for threads in (2, 7, 0):
        again = planes.refine(image, disparity, (0, 63), threads=threads)
        assert all(a.tobytes() == b.tobytes() for a, b in zip(again, found, strict=True))


def test_nothing_is_guessed_to_lie_below_the_ground():
    # A road of which only the left edge is matched, and that far too far away.
    plane = (0.0, 0.5, 2.0)
    truth = on(plane, (40, 80)).astype(np.float32)
    disparity = np.full_like(truth, N)
    disparity[:, :2] = 1
    image = np.zeros(truth.shape, np.uint8)
    far = planes.refine(image, disparity, (0, 63)).disparity
    assert (far < 2).all()
    near = planes.refine(image, disparity, (0, 63), ground=plane).disparity
    assert np.abs(near - truth)[5:, 30:].max() <= planes.SUNK + 0.5


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_grey_levels_may_be_of_any_range(dtype):
    image, truth, _ = two_surfaces()
    stretched = np.concatenate([image[:, :-1], np.full((60, 1), 255, np.uint8)], axis=1)
    stretched[0, 0] = 0
    one = planes.refine(stretched, truth, (0, 63))
    other = planes.refine((stretched.astype(dtype) * 4 + 100).astype(dtype), truth, (0, 63))
    np.testing.assert_array_equal(one.label, other.label)


def test_a_view_gives_what_its_copy_gives():
    image, truth, _ = two_surfaces()
    colour = np.stack((image, image, image), axis=-1)
    one = planes.refine(colour, truth, (0, 63))
    wide = np.zeros((60, 180, 3), np.uint8)
    wide[:, ::2] = colour
    other = planes.refine(wide[:, ::2], np.asfortranarray(truth), (0, 63))
    assert all(a.tobytes() == b.tobytes() for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (3, 2), (13, 14)])
def test_degenerate_maps(shape):
    image = np.zeros(shape, np.uint8)
    nothing = planes.refine(image, np.full(shape, N, np.float32), (0, 9))
    assert np.isnan(nothing.disparity).all()
    level = planes.refine(image, np.full(shape, 7, np.float32), (0, 9))
    np.testing.assert_allclose(level.disparity, 7, atol=1e-5)
    beyond = planes.refine(image, np.full(shape, 7, np.float32), (0, 5))
    np.testing.assert_allclose(beyond.disparity, 5)


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"image": [[1]]}, TypeError, "image must be an array of uint8, uint16, float32, not list"),
        ({"image": np.zeros((4, 6))}, TypeError, "not float64"),
        ({"image": np.zeros((6, 4), np.uint8)}, ValueError, r"\(H, W\) = \(4, 6\), not of shape \(6, 4\)"),
        ({"image": np.zeros((4, 6, 2), np.uint8)}, ValueError, "image must be"),
        ({"disparity": np.zeros((4, 6))}, TypeError, "disparity must be an array of float32, not float64"),
        ({"disparity": np.zeros((0, 6), np.float32)}, ValueError, "disparity must be"),
        ({"model": Model(side=0.5)}, ValueError, "side must be a finite number of at least 1, not 0.5"),
        ({"model": Model(hinge=-1.0)}, ValueError, "hinge must be a finite number of at least 0"),
        ({"model": Model(depth=N)}, ValueError, "depth must be"),
        ({"model": Model(occlusion=np.inf)}, ValueError, "occlusion must be"),
    ],
)
def test_arguments_that_are_refused(changes, error, message):
    given = {"image": np.zeros((4, 6), np.uint8), "disparity": np.zeros((4, 6), np.float32)} | changes
    with pytest.raises(error, match=message):
        planes.refine(bounds=(0, 9), **given)


def test_in_a_match():
    scene = st.scenes.street(240, 120, 3, samples=1)
    given = {"disparities": (0, 40), "cost": "zncc", "left_right": 1, "speckle": 60, "median": 3}
    plain = st.match(scene.left, scene.right, **given)
    holes = np.isnan(plain.disparity)
    flat = st.match(scene.left, scene.right, planes="segments", keep="segments", **given)
    np.testing.assert_array_equal(np.isnan(flat.disparity), holes)
    assert (flat.disparity != plain.disparity)[~holes].mean() > 0.9
    dense = st.match(scene.left, scene.right, planes="segments", fill="planes", **given)
    assert np.isfinite(dense.disparity).all()
    np.testing.assert_array_equal(dense.disparity[~holes], flat.disparity[~holes])
    np.testing.assert_array_equal((dense.flags & Flag.FILLED) != 0, holes)
    label, found = flat.stages["segments"], flat.stages["segment_planes"]
    np.testing.assert_allclose(
        reference.render(label, found, 0, 39)[~holes], flat.disparity[~holes], rtol=1e-6, atol=1e-6
    )
    assert {"segments", "fill"} <= set(dense.timings)
    rest = st.match(scene.left, scene.right, planes="segments", fill="background", **given)
    np.testing.assert_array_equal(rest.disparity, st.fill.background(flat.disparity))


# ---- settings ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"planes": "segment"}, "planes must be one of segments, or None, not 'segment'"),
        ({"planes": True}, "planes must be one of segments"),
        ({"fill": "planes"}, 'fill must not be "planes" where planes is None'),
        ({"keep": "segments"}, 'keep must not hold "segments" where planes is None'),
    ],
)
def test_values_that_are_refused(given, message):
    with pytest.raises(ValueError, match=message):
        Settings(**given)


def test_settings_as_text():
    made = Settings(planes="segments", fill="planes", keep="segments")
    assert Settings.from_toml(made.to_toml()) == made
    assert Settings.make(assignments=["planes=segments", "fill=planes", "keep=segments"]) == made
    assert Settings.make(assignments=["planes=off"]).planes is None


# ---- real pairs ----------------------------------------------------------------------------------


@pytest.mark.skipif(not (DATA / "drivingstereo").is_dir(), reason="needs DrivingStereo")
def test_planes_beat_the_background():
    sample = datasets.open(DATA / "drivingstereo")[3]
    scores = []
    for changes in ({"fill": "background"}, {"planes": "segments", "fill": "planes"}):
        result = st.match(sample.pair(), preset="fast", disparities=(0, 128), **changes)
        scores.append(st.evaluate(result.disparity, sample.truth(), sample.mask()).filled)
    background, flat = scores
    assert flat.d1 < 0.9 * background.d1
    assert flat.within_1 > background.within_1
