"""The hash against Python integers, solids worked by hand, and truth against rays cast by other means."""

from __future__ import annotations

import hashlib
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from stereopsis import scenes
from stereopsis.scenes import _render as render
from stereopsis.scenes._noise import Dice, lattice, normal, texture, uniform, words
from stereopsis.scenes._render import Camera, hidden, trace
from stereopsis.scenes._shapes import Rays, Solid, box, cylinder, ellipsoid, ground, prism, wheel
from stereopsis.scenes._street import BASELINE, HEIGHT, Rig, _day
from stereopsis.scenes._surfaces import Item, Plain
from stereopsis.types import Disparities, Pair

SIZE = (220, 100)


@pytest.fixture(scope="module")
def scene() -> scenes.Scene:
    return scenes.street(*SIZE, 0, dtype=np.float32)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig.make(*SIZE, 0)


# --- noise


def python_words(*coordinates: int) -> int:
    """The twin of `words` in Python's own integers."""
    h = 1
    for c in coordinates:
        h = (h * 0x9E3779B1 + c) % 2**32
        h ^= h >> 16
        h = h * 0x7FEB352D % 2**32
        h ^= h >> 15
        h = h * 0x846CA68B % 2**32
        h ^= h >> 16
    return h


@given(some.lists(some.integers(-(2**40), 2**40), min_size=1, max_size=4))
def test_hash_is_that_of_python_integers(coordinates: list[int]) -> None:
    assert int(words(*coordinates)) == python_words(*coordinates)


def test_hash_broadcasts() -> None:
    table = words(np.arange(3)[:, None], np.arange(-2, 2), 7)
    assert table.shape == (3, 4)
    assert table[2, 0] == python_words(2, -2, 7)


def test_uniform_and_normal_have_their_moments() -> None:
    u = uniform(5, np.arange(200_000))
    assert 0 <= u.min() < 1e-4
    assert 1 - 1e-4 < u.max() < 1
    assert abs(u.mean() - 0.5) < 3e-3
    n = normal(5, np.arange(200_000))
    assert abs(n.mean()) < 0.01
    assert abs(n.std() - 1) < 0.01
    assert np.abs(n).max() < 6
    assert abs((np.abs(n) < 1).mean() - 0.6827) < 0.01


def test_lattice_takes_its_nodes_and_stays_between_them() -> None:
    node = lattice(np.array([3.0, 4.0, -1.0]), np.array([-2.0, -2.0, 5.0]), 9)
    mid = lattice(np.array([3.5]), np.array([-2.0]), 9)
    assert mid[0] == pytest.approx((node[0] + node[1]) / 2, abs=1e-6)
    assert len(set(node.tolist())) == 3
    # Smooth across the node: no step and no kink.
    e = 1e-3
    left, at, right = lattice(np.array([4.0 - e, 4.0, 4.0 + e]), np.full(3, -1.7), 9)
    assert abs(left - at) < 1e-4
    assert abs(right - at) < 1e-4


def test_texture_does_not_jump_where_its_octaves_change() -> None:
    u, v = np.linspace(0.0, 90.0, 4000), np.linspace(2.0, 9.0, 4000)
    sizes = (0.015625 * (1 - 1e-9), 0.015625 * (1 + 1e-9))
    below, above = (texture(u, v, s, 1) for s in sizes)
    assert np.abs(below - above).max() < 1e-6
    assert 0.2 < below.std() < 0.6
    assert abs(np.corrcoef(below, texture(u, v, 0.015625, 2))[0, 1]) < 0.1


def test_dice_depend_on_every_part_of_their_key() -> None:
    throws = {Dice(*key).throw() for key in ((0,), (1,), (0, 1), (1, 0), (2**32 - 1, 1))}
    assert len(throws) == 5
    dice = Dice(3)
    assert {dice.integer(2, 4) for _ in range(60)} == {2, 3, 4}


# --- solids


def span(
    solid: Solid, origin: tuple[float, float, float], direction: tuple[float, float, float]
) -> tuple[float, float]:
    enter, leave = solid.span(Rays(*origin, *direction))
    return float(enter), float(leave)


def test_spans_worked_by_hand() -> None:
    assert span(box(-1, 1, 0, 2, 4, 6), (0, 1, 0), (0, 0, 1)) == (4, 6)
    assert span(box(1, 3, 0, 2, 4, 6), (0, 1, 0), (0.5, 0, 1)) == (4, 6)
    enter, leave = span(box(-1, 1, 0, 2, 4, 6), (0, 3, 0), (0, 0, 1))
    assert enter > leave
    assert span(ellipsoid(0, 0, 10, 1, 1, 3), (0, 0, 0), (0, 0, 1)) == pytest.approx((7, 13))
    assert span(cylinder(0, 5, 2, 0, 9), (0, 1, 0), (0, 0, 1)) == pytest.approx((3, 7))
    # The ray climbs out through the top, y = 1 + 0.5 t = 3 at t = 4.
    assert span(cylinder(0, 5, 2, 0, 3), (0, 1, 0), (0, 0.5, 1)) == pytest.approx((3, 4))
    assert span(wheel(1, 2, 0.3, 5, 0.3), (0, 0.3, 0), (0.3, 0, 1)) == pytest.approx((4.7, 5.3))
    assert span(ground(), (0, 1.6, 0), (0, -0.1, 1))[0] == pytest.approx(16)
    # A gable roof: y + |x| <= 3 over y >= 1.
    roof = prism(((-2, 1), (2, 1), (0, 3)), "z", 4, 8)
    assert span(roof, (0, 2, 0), (0, 0, 1)) == pytest.approx((4, 8))
    assert span(roof, (-5, 2, 5), (1, 0, 0)) == pytest.approx((4, 6))
    # Ends that lean inwards by half a metre a metre: at y = 2, one metre up, x is within 1 - 0.5.
    leaning = prism(((4, 1), (6, 1), (6, 3), (4, 3)), "x", -1, 1, lean=0.5)
    assert span(leaning, (-5, 2, 5), (1, 0, 0)) == pytest.approx((4.5, 5.5))


def test_faces_and_normals() -> None:
    solid = box(-1, 1, 0, 2, 4, 6)
    x, y, z = np.array([-1.0, 1.0, 0.0, 0.0]), np.array([1.0, 1.0, 2.0, 1.0]), np.array([5.0, 5.0, 5.0, 4.0])
    face = solid.face(x, y, z)
    assert face.tolist() == [0, 1, 3, 4]
    normals = np.stack(solid.normal(face, x, y, z), axis=1)
    assert normals.tolist() == [[-1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, -1]]
    ball = ellipsoid(0, 0, 5, 2, 2, 2)
    at = np.array([2.0]), np.array([0.0]), np.array([5.0])
    assert np.stack(ball.normal(ball.face(*at), *at)).ravel() == pytest.approx([1, 0, 0])


@given(
    some.lists(
        some.tuples(
            some.sampled_from(["box", "ball", "post", "roof"]),
            some.floats(-4, 4),
            some.floats(-1, 3),
            some.floats(-2, 12),
            some.floats(0.2, 3),
        ),
        min_size=1,
        max_size=5,
    )
)
@settings(max_examples=40, deadline=None)
def test_windows_lose_no_hit(specs: list[tuple[str, float, float, float, float]]) -> None:
    def build(kind: str, x: float, y: float, z: float, r: float) -> Solid:
        match kind:
            case "box":
                return box(x - r, x + r, y - r, y + r, z - r, z + r)
            case "ball":
                return ellipsoid(x, y, z, r, 0.5 * r, r)
            case "post":
                return cylinder(x, z, r, y, y + 2)
            case _:
                return prism(((x - r, y), (x + r, y), (x, y + r)), "z", z, z + r)

    items = [Item(build(*spec), Plain((0.5, 0.5, 0.5))) for spec in specs]
    dx, dy = np.linspace(-1.2, 1.2, 13), np.linspace(0.9, -0.9, 11)
    depth, _ = trace(items, 0.3, 1.0, dx, dy)
    expected = np.full(depth.shape, np.inf)
    for item in items:
        enter, leave = item.solid.span(Rays(0.3, 1.0, 0.0, dx[None, :], dy[:, None]))
        hit = (enter < leave) & (enter > 1e-6)
        expected = np.where(hit, np.minimum(expected, enter), expected)
    np.testing.assert_array_equal(depth, expected)
    # What the other camera cannot see: some solid lies on its ray before the point.
    toward = dx[None, :] - 0.5 / depth
    behind = np.zeros(depth.shape, np.bool_)
    for item in items:
        enter, leave = item.solid.span(Rays(0.8, 1.0, 0.0, toward, dy[:, None]))
        behind |= (enter < leave) & (enter > 1e-6) & (enter < depth * (1 - 1e-6))
    np.testing.assert_array_equal(hidden(items, 0.3, 0.8, 1.0, dx, dy, depth), behind)


# --- the truth of a street


def test_default_scene_is_a_fair_one() -> None:
    scene = scenes.street(440, 200, samples=1)
    assert 60 < 2 * np.nanmax(scene.disparity) < 110
    assert 0 < 2 * np.nanmin(scene.disparity) < 2
    assert 0.10 < scene.sky.mean() < 0.25
    assert 0.6 < scene.textured.mean() < 0.85
    assert 0.02 < (scene.occluded & ~scene.out_of_view).mean() < 0.08


def test_shapes_dtypes_and_pair(scene: scenes.Scene) -> None:
    width, height = SIZE
    assert scene.left.shape == scene.right.shape == (height, width, 3)
    for truth in (scene.disparity, scene.right_disparity):
        assert truth.shape == (height, width)
        assert truth.dtype == np.float32
    for mask in (scene.occluded, scene.out_of_view, scene.sky, scene.textured):
        assert mask.shape == (height, width)
        assert mask.dtype == np.bool_
    assert scene.pair == Pair(scene.left, scene.right, scene.calibration, "street-220x100-0")
    assert scene.calibration.focal == pytest.approx(198)
    assert (scene.calibration.cx, scene.calibration.cy) == pytest.approx((109.5, 45.54))
    assert scene.calibration.ndisp is None  # that would be knowledge of the truth
    known = scene.disparity[~scene.sky]
    low, high = scene.disparities
    assert low <= known.min() < low + 1
    assert high - 2 < known.max() <= high - 1
    with pytest.raises(FrozenInstanceError):
        scene.name = "x"  # type: ignore[misc]


def test_sky_has_no_truth(scene: scenes.Scene) -> None:
    np.testing.assert_array_equal(np.isnan(scene.disparity), scene.sky)
    assert scene.sky[0].any()
    assert not scene.sky[50:].any()  # the horizon is at row 45.54
    assert not scene.textured[scene.sky].any()
    assert np.isnan(scene.right_disparity).mean() == pytest.approx(scene.sky.mean(), abs=0.02)


def test_road_follows_the_closed_formula(scene: scenes.Scene, rig: Rig) -> None:
    _, index = rig.depth(rig.left, rig.rows)
    y, _ = np.nonzero(index == 0)
    # Z = focal * height / (y - cy) and d = focal * baseline / Z: the focal length drops out.
    np.testing.assert_allclose(scene.disparity[index == 0], BASELINE * (y - 0.46 * 99) / HEIGHT, rtol=1e-6)
    assert y.size > 4000


def test_every_visible_point_is_met_by_the_right_ray(rig: Rig) -> None:
    truth = rig.truth()
    depth, _ = rig.depth(rig.left, rig.rows)
    disparity = rig.left.focal * BASELINE / depth
    np.testing.assert_array_equal(truth.out_of_view, rig.columns - disparity < -0.5)
    for y in range(0, rig.height, 3):
        seen = ~truth.sky[y]
        # Some camera in the same place that looks at x - d of each column, in ascending order.
        match = (rig.columns - disparity[y])[seen]
        order = np.argsort(match)
        met, _ = trace(rig.items, BASELINE, HEIGHT, *rig.right.directions(match[order], rig.rows[y : y + 1]))
        ratio = met[0] / depth[y][seen][order]
        hidden_here = truth.hidden[y][seen][order]
        np.testing.assert_allclose(ratio[~hidden_here], 1, rtol=1e-9)
        assert (ratio[hidden_here] < 1 - 1e-6).all()


def test_occlusion_against_points_marched_along_the_ray(rig: Rig) -> None:
    """No ray is intersected here: points on the way to the right camera are asked which solid they are in."""
    truth = rig.truth()
    depth, _ = rig.depth(rig.left, rig.rows)
    dx, dy = rig.left.directions(rig.columns, rig.rows)
    candidates = [np.argwhere(truth.hidden & ~truth.sky), np.argwhere(~truth.hidden & ~truth.sky)]
    picked = np.concatenate([c[words(1, np.arange(len(c))).argsort()[:25]] for c in candidates])
    y, x = picked.T
    z = depth[y, x]
    point = np.stack([dx[x] * z, HEIGHT + dy[y] * z, z])
    eye = np.array([BASELINE, HEIGHT, 0.0])
    along = np.linspace(0.0, 1.0 - 1e-3, 4000)
    px, py, pz = eye[:, None, None] + (point - eye[:, None])[:, :, None] * along
    inside = np.zeros(px.shape, np.bool_)
    for item in rig.items:
        solid = item.solid
        (x0, y0, z0), (x1, y1, z1) = solid.low, solid.high
        near = np.nonzero((px > x0) & (px < x1) & (py > y0) & (py < y1) & (pz > z0) & (pz < z1))
        q = (px[near], py[near], pz[near])
        within = np.ones(q[0].shape, np.bool_)
        for plane in solid.planes:
            within &= plane.x * q[0] + plane.y * q[1] + plane.z * q[2] < plane.offset
        if solid.round is not None:
            parts = zip(q, solid.round.centre, solid.round.radii, strict=True)
            within &= sum(((p - c) / r) ** 2 for p, c, r in parts) < 1
        inside[near] |= within
    blocked = inside.any(axis=1)
    expected = truth.hidden[y, x]
    assert not (blocked & ~expected).any()
    # A step may miss what it only grazes.
    assert (blocked == expected).mean() >= 0.94


def test_colour_belongs_to_the_surface_point(rig: Rig) -> None:
    """One ray a pixel: the right camera, looking at exactly x - d, sees the colour of the left pixel."""
    day = _day(0, rig.left.focal, fog=0.01, rain=0.0, low_light=0.0, low_texture=0.0)
    truth = rig.truth()
    left = render.light(rig.items, day, rig.left, rig.columns, rig.rows)
    depth, _ = rig.depth(rig.left, rig.rows)
    compared = 0
    for y in range(1, rig.height, 7):
        seen = ~truth.hidden[y] & ~truth.sky[y]
        match = (rig.columns - rig.left.focal * BASELINE / depth[y])[seen]
        order = np.argsort(match)
        right = render.light(rig.items, day, rig.right, match[order], rig.rows[y : y + 1])[:, 0]
        difference = np.abs(right - left[:, y, seen][:, order]).max(axis=0)
        # Rounding may put a point on the other side of a brick's edge.
        assert (difference < 1e-4).mean() > 0.995
        compared += difference.size
    assert compared > 2000


def test_images_agree_where_the_truth_says_so() -> None:
    scene = scenes.street(440, 200, gray=True, dtype=np.float32)
    known = ~scene.occluded & scene.textured
    y, x = np.nonzero(known)
    match = x - scene.disparity[known]
    inside = match > 1
    y, x, match = y[inside], x[inside], match[inside]
    left_of = np.floor(match).astype(np.intp)
    part = match - left_of
    after = np.minimum(left_of + 1, 439)
    value = (1 - part) * scene.right[y, left_of] + part * scene.right[y, after]
    off = np.abs(value - scene.left[y, x])
    assert np.median(off) < 2.5  # of 255, interpolation included
    # The same truth half a pixel away is much worse: the images pin it to a fraction of a pixel.
    part = match - 1.0 - np.floor(match - 1.0)
    value = (1 - part) * scene.right[y, left_of - 1] + part * scene.right[y, left_of]
    assert np.median(np.abs(value - scene.left[y, x])) > 1.6 * np.median(off)


# --- determinism and sizes


def digest(scene: scenes.Scene) -> str:
    h = hashlib.sha256()
    for array in (
        scene.left,
        scene.right,
        scene.disparity,
        scene.right_disparity,
        scene.occluded,
        scene.textured,
    ):
        h.update(np.ascontiguousarray(array).tobytes())
    return h.hexdigest()


def test_same_arguments_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    options = {"noise": 3.0, "rain": 0.5, "low_light": 0.3, "blur": 0.7, "fog": 0.01}
    one = scenes.street(41, 23, 5, **options)
    assert digest(one) == digest(scenes.street(41, 23, 5, **options))
    assert digest(one) != digest(scenes.street(41, 23, 6, **options))
    # However the picture is cut into bands.
    monkeypatch.setattr(render, "BAND", 200)
    assert digest(one) == digest(scenes.street(41, 23, 5, **options))


def test_bytes_are_pinned() -> None:
    """A change of this number is a change of every street: say so in the changelog."""
    scene = scenes.street(64, 32, 1)
    assert hashlib.sha256(scene.left.tobytes() + scene.right.tobytes()).hexdigest()[:16] == "4914ad62f7ae8224"


@pytest.mark.parametrize(("width", "height"), [(1, 1), (1, 9), (9, 1), (3, 2), (17, 5), (8, 90)])
def test_any_size(width: int, height: int) -> None:
    scene = scenes.street(
        width,
        height,
        2,
        noise=1,
        rain=0.5,
        blur=2.0,
        vignetting=0.5,
        fog=0.02,
        low_light=0.5,
        vertical_misalignment=0.3,
    )
    assert scene.left.shape == (height, width, 3)
    assert scene.disparity.shape == scene.right_disparity.shape == (height, width)
    np.testing.assert_array_equal(np.isnan(scene.disparity), scene.sky)
    assert not scene.sky[-1].any() or height == 1  # the ground reaches the bottom, however steep the view


def test_seed_is_another_street() -> None:
    one, other = (scenes.street(44, 20, seed, samples=1) for seed in (1, 2))
    assert (one.left != other.left).mean() > 0.5
    assert not np.array_equal(one.disparity, other.disparity, equal_nan=True)


# --- options


@pytest.mark.parametrize(
    "options",
    [
        {"noise": 4.0},
        {"exposure": 1.2},
        {"offset": 10.0},
        {"gamma": 1.3},
        {"vignetting": 0.5},
        {"blur": 1.0},
        {"blur": (0.0, 1.5)},
        {"fog": 0.02},
        {"rain": 0.5},
        {"low_light": 0.7},
        {"vertical_misalignment": 0.5},
        {"low_texture": 0.8},
        {"samples": 1},
    ],
    ids=lambda o: "-".join(o),
)
def test_options_change_the_pictures_and_not_the_truth(
    scene: scenes.Scene, options: dict[str, float]
) -> None:
    changed = scenes.street(*SIZE, 0, dtype=np.float32, **options)
    right_only = set(options) & {"exposure", "offset", "gamma", "vertical_misalignment"} or options.get(
        "blur"
    ) == (0.0, 1.5)
    assert (changed.right != scene.right).mean() > 0.2
    assert ((changed.left != scene.left).mean() > 0.2) is not bool(right_only)
    if right_only:
        np.testing.assert_array_equal(changed.left, scene.left)
    for name in ("disparity", "occluded", "out_of_view", "sky", "textured"):
        np.testing.assert_array_equal(getattr(changed, name), getattr(scene, name))
    same = np.array_equal(changed.right_disparity, scene.right_disparity, equal_nan=True)
    assert same is ("vertical_misalignment" not in options)


def test_gray_and_dtypes(scene: scenes.Scene) -> None:
    gray = scenes.street(*SIZE, 0, dtype=np.float32, gray=True)
    np.testing.assert_allclose(gray.left, scene.left @ np.array([0.299, 0.587, 0.114], np.float32), atol=1e-3)
    bytes_ = scenes.street(*SIZE, 0)
    np.testing.assert_array_equal(bytes_.left, np.floor(scene.left + np.float32(0.5)).astype(np.uint8))
    twelve = scenes.street(*SIZE, 0, dtype=np.uint16)
    assert twelve.left.dtype == np.uint16
    assert 255 < twelve.left.max() <= 4095
    assert np.abs(twelve.left * (255 / 4095) - scene.left).max() <= 0.5 * 255 / 4095 + 1e-3


def test_exposure_offset_and_gamma_are_what_they_say(scene: scenes.Scene) -> None:
    changed = scenes.street(*SIZE, 0, dtype=np.float32, exposure=1.2, offset=-7.0, gamma=0.8)
    expected = np.clip(1.2 * 255 * (scene.right.astype(np.float64) / 255) ** 0.8 - 7, 0, 255)
    np.testing.assert_allclose(changed.right, expected, atol=1e-3)


def test_noise_has_its_deviation_and_differs_between_the_views(scene: scenes.Scene) -> None:
    noisy = scenes.street(*SIZE, 0, dtype=np.float32, noise=5.0)
    inside = (scene.left > 30) & (scene.left < 225) & (scene.right > 30) & (scene.right < 225)
    left, right = (noisy.left - scene.left)[inside], (noisy.right - scene.right)[inside]
    assert left.std() == pytest.approx(5, rel=0.03)
    assert right.std() == pytest.approx(5, rel=0.03)
    assert abs(left.mean()) < 0.15
    assert abs(np.corrcoef(left, right)[0, 1]) < 0.02


def test_vignetting_darkens_the_corners(scene: scenes.Scene) -> None:
    dark = scenes.street(*SIZE, 0, dtype=np.float32, vignetting=0.75)
    # Three quarters of the light lost is half of the displayed value.
    np.testing.assert_allclose(dark.left[0, 0], scene.left[0, 0] / 2, rtol=1e-4)
    np.testing.assert_allclose(dark.left[50, 110], scene.left[50, 110], rtol=1e-3)


def test_blur_smooths_and_keeps_the_light() -> None:
    plain, soft = (scenes.street(*SIZE, 0, dtype=np.float32, gray=True, blur=b) for b in (0.0, 1.5))
    assert np.abs(np.diff(soft.left)).mean() < 0.5 * np.abs(np.diff(plain.left)).mean()
    assert (soft.left**2).mean() == pytest.approx((plain.left**2).mean(), rel=0.02)


def test_fog_follows_its_law() -> None:
    """Koschmieder: with the same air light, two pixels of one depth keep exp(-fog Z) of their difference."""
    clear, foggy = (
        replace(_day(0, 198.0, fog=f, rain=0.0, low_light=0.0, low_texture=0.0), overcast=0.0)
        for f in (0.0, 0.05)
    )
    rig = Rig.make(*SIZE, 0)
    row = np.array([80.0])
    depth, index = rig.depth(rig.left, row)
    road = np.flatnonzero(index[0] == 0)
    one = render.light(rig.items, clear, rig.left, rig.columns, row)[0, 0, road]
    two = render.light(rig.items, foggy, rig.left, rig.columns, row)[0, 0, road]
    assert np.ptp(depth[0, road]) < 1e-9
    assert np.ptp(two) / np.ptp(one) == pytest.approx(np.exp(-0.05 * depth[0, road[0]]), rel=1e-3)


def test_rain_is_independent_in_the_views() -> None:
    scene = scenes.street(*SIZE, 0, dtype=np.float32, gray=True, rain=0.6)
    top = np.isnan(scene.right_disparity) & scene.sky
    left, right = (np.diff(image, axis=1)[top[:, 1:] & top[:, :-1]] for image in (scene.left, scene.right))
    assert left.std() > 2
    assert abs(np.corrcoef(left, right)[0, 1]) < 0.2


def test_low_light_is_darker_and_noisier(scene: scenes.Scene) -> None:
    night = scenes.street(*SIZE, 0, dtype=np.float32, low_light=1.0)
    assert night.left.mean() < 0.5 * scene.left.mean()
    assert np.ptp(night.left) > 200  # lamps and windows shine
    sky = np.s_[:3, 80:120]
    assert np.diff(night.left[sky], axis=1).std() > 3 * np.diff(scene.left[sky], axis=1).std()


def test_vertical_misalignment_moves_the_right_image_down(scene: scenes.Scene) -> None:
    moved = scenes.street(*SIZE, 0, dtype=np.float32, vertical_misalignment=2.0)
    off = np.abs(moved.right[2:] - scene.right[:-2])
    assert (off < 1e-2).mean() > 0.999
    np.testing.assert_allclose(moved.right_disparity[2:], scene.right_disparity[:-2], rtol=1e-5)


def test_low_texture_takes_the_texture_away(scene: scenes.Scene) -> None:
    flat = scenes.street(*SIZE, 0, dtype=np.float32, low_texture=1.0)
    half = scenes.street(*SIZE, 0, dtype=np.float32, low_texture=0.5)
    road = np.s_[90:, 95:125]
    deviations = [image[road][..., 0].std() for image in (flat.left, half.left, scene.left)]
    assert deviations[0] < 0.5
    assert deviations[1] == pytest.approx(deviations[2] / 2, rel=0.2)


@pytest.mark.parametrize(
    ("arguments", "error", "words_"),
    [
        ({"width": 0}, ValueError, "width must be from 1 to 16384, not 0"),
        ({"height": -3}, ValueError, "height"),
        ({"width": 8.0}, TypeError, "width must be an integer, not 8.0"),
        ({"height": True}, TypeError, "height"),
        ({"seed": -1}, ValueError, "seed"),
        ({"seed": 2**32}, ValueError, "seed"),
        ({"samples": 0}, ValueError, "samples"),
        ({"noise": -1}, ValueError, "noise must be from 0 to 255, not -1"),
        ({"noise": "3"}, TypeError, "noise must be a number, not '3'"),
        ({"noise": float("nan")}, ValueError, "noise"),
        ({"exposure": 0}, ValueError, "exposure"),
        ({"offset": 300}, ValueError, "offset"),
        ({"gamma": 0.0}, ValueError, "gamma"),
        ({"vignetting": 1.1}, ValueError, "vignetting"),
        ({"blur": -0.5}, ValueError, "blur"),
        ({"blur": (1, 2, 3)}, ValueError, "blur"),
        ({"blur": (1, "x")}, TypeError, "blur"),
        ({"fog": float("inf")}, ValueError, "fog"),
        ({"rain": 2}, ValueError, "rain"),
        ({"low_light": -0.1}, ValueError, "low_light"),
        ({"vertical_misalignment": 1e6}, ValueError, "vertical_misalignment"),
        ({"low_texture": 1.5}, ValueError, "low_texture"),
        ({"dtype": np.int16}, ValueError, "dtype must be uint8, uint16 or float32, not int16"),
    ],
)
def test_wrong_arguments_are_named(arguments: dict[str, object], error: type[Exception], words_: str) -> None:
    with pytest.raises(error, match=words_.replace(".", r"\.")):
        scenes.street(**{"width": 8, "height": 4, **arguments})  # type: ignore[arg-type]


# --- the plane


def test_plane_truth_is_its_equation() -> None:
    scene = scenes.plane(20, 10, disparity=5.25, slant_x=0.125, slant_y=-0.25)
    y, x = np.mgrid[:10, :20]
    truth = 5.25 + 0.125 * x - 0.25 * y
    np.testing.assert_array_equal(scene.disparity, truth)
    np.testing.assert_array_equal(scene.out_of_view, x - truth < -0.5)
    np.testing.assert_array_equal(scene.occluded, scene.out_of_view)
    assert not scene.sky.any()
    assert scene.textured.all()
    # The right truth at the match is the left truth.
    source = x + scene.right_disparity
    np.testing.assert_allclose(5.25 + 0.125 * source - 0.25 * y, scene.right_disparity, rtol=1e-6)


def test_plane_images_are_one_texture() -> None:
    """Slants whose matches fall on whole pixels, so that nothing has to be interpolated."""
    scene = scenes.plane(40, 12, 3, disparity=7.0)
    np.testing.assert_array_equal(scene.left[:, 7:], scene.right[:, :-7])
    scene = scenes.plane(40, 12, 3, disparity=0.0, slant_x=0.5)
    np.testing.assert_array_equal(scene.right[:, :20], scene.left[:, ::2])
    scene = scenes.plane(40, 12, 3, disparity=-3.0, slant_y=1.0)
    for y in range(3, 12):
        np.testing.assert_array_equal(scene.right[y, : 40 - (y - 3)], scene.left[y, y - 3 :])


def test_plane_options() -> None:
    base = scenes.plane(30, 20, 1, disparity=2.5, dtype=np.float32, gray=True)
    assert base.left.shape == (20, 30)
    assert 15 < base.left.std() < 60
    assert base.disparities == Disparities(2, 4)
    assert base.calibration.doffs == 0
    assert scenes.plane(30, 20, disparity=-4.0).calibration.doffs == 5
    changed = scenes.plane(30, 20, 1, disparity=2.5, dtype=np.float32, gray=True, exposure=0.5, offset=3.0)
    np.testing.assert_allclose(changed.right, 0.5 * base.right + 3, rtol=1e-5)
    np.testing.assert_array_equal(changed.left, base.left)
    noisy = scenes.plane(30, 20, 1, disparity=2.5, dtype=np.float32, gray=True, noise=3.0)
    assert (noisy.left - base.left).std() == pytest.approx(3, rel=0.15)
    assert not np.array_equal(scenes.plane(30, 20, 2**32 - 1).left, scenes.plane(30, 20, 2**28 - 1).left)
    assert scenes.plane(1, 1).left.shape == (1, 1, 3)


@pytest.mark.parametrize(
    ("arguments", "words_"),
    [({"slant_x": 1.0}, "slant_x"), ({"slant_y": 99}, "slant_y"), ({"disparity": float("nan")}, "disparity")],
)
def test_plane_rejects(arguments: dict[str, float], words_: str) -> None:
    with pytest.raises(ValueError, match=words_):
        scenes.plane(8, 4, **arguments)


def test_camera_shift_moves_the_picture_down() -> None:
    camera = Camera(focal=10.0, cx=4.0, cy=3.0, x=0.0, height=1.6)
    dx, dy = camera.directions(np.array([4.0, 14.0]), np.array([3.0, 13.0]))
    assert dx.tolist() == [0.0, 1.0]
    assert dy.tolist() == [0.0, -1.0]
    _, moved = replace(camera, shift=2.0).directions(np.array([4.0]), np.array([5.0]))
    assert moved.tolist() == [0.0]
