import dataclasses
import json
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

import stereopsis as st
from stereopsis import Disparities, Settings
from stereopsis.settings import COSTS, DEFAULT_PRESET, KEEP, PRESETS, as_disparities, named, window_size

PLAIN = Settings()
sides = some.integers(1, 255)
numbers = some.none() | some.integers(0, 100) | some.floats(0, 1e9, allow_subnormal=True)
positive = some.integers(1, 300) | some.floats(1e-9, 1e9)
supports = (
    some.builds(st.Gaussian, some.floats(1e-3, 100), some.floats(0.1, 10))
    | some.builds(st.Bilateral, sides | some.tuples(sides, sides), positive, positive)
    | some.builds(st.Cross, sides, positive)
    | some.builds(
        lambda a, b, c, d, *rest: st.Adaptive((min(a, b), min(c, d)), (max(a, b), max(c, d)), *rest),
        *(sides, sides, sides, sides),
        *(positive, positive),
    )
)
any_settings = some.builds(
    Settings,
    disparities=some.none() | some.tuples(some.integers(-1000, 0), some.integers(1, 1000)),
    cost=some.builds(
        lambda cost, window: cost(window),
        some.sampled_from(list(COSTS.values())),
        sides | some.tuples(sides, sides) | supports,
    ),
    channels=some.sampled_from(["grey", "separate"]),
    blank=some.booleans(),
    vertical=some.none()
    | some.just("estimate")
    | some.floats(-9, 9)
    | some.tuples(*3 * [some.floats(-9, 9)])
    | some.tuples(*4 * [some.floats(-9, 9)]),
    subpixel=some.sampled_from([None, "parabola", "equiangular"]),
    left_right=numbers,
    uniqueness=numbers,
    texture=numbers | some.just("auto"),
    reflection=numbers,
    sky=some.booleans() | some.just("auto"),
    median=some.none() | some.integers(0, 127).map(lambda half: 2 * half + 1),
    speckle=some.none()
    | some.integers(0, 10**6)
    | some.tuples(some.integers(0, 2**31 - 1), some.floats(0, 1e6)),
    planes=some.just("segments"),
    fill=some.sampled_from([None, "background", "interpolate", "surfaces", "planes"]),
    weighted_median=some.none()
    | some.sampled_from([1, 5, 11])
    | some.tuples(some.just(3), some.floats(0.4, 1e6)),
    edge_aware=some.none() | some.floats(0, 1e5) | some.tuples(some.floats(0, 1e5), some.floats(0.1, 1e6)),
    confidence=some.sampled_from([None, "calibrated"]),
    least_confidence=some.none() | some.floats(0, 1),
    outlines=some.booleans(),
    photometric=some.booleans(),
    step=some.integers(1, 255),
    disparity_step=some.integers(1, 255),
    threads=some.integers(0, 4096),
    keep=some.sets(some.sampled_from(KEEP)).map(lambda kept: tuple(sorted(kept))),
    preset=some.sampled_from([None, *PRESETS]),
)


# ---- windows -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("window", "size"),
    [
        (7, (7, 7)),
        ("7", (7, 7)),
        ("31x15", (31, 15)),
        ("31X15", (31, 15)),
        ((31, 15), (31, 15)),
        ([31, 15], (31, 15)),
        (np.int64(9), (9, 9)),
        ((1, 255), (1, 255)),
    ],
)
def test_windows(window, size):
    assert window_size(window) == size
    assert st.SAD(window).size == size


def test_equal_windows_are_equal_costs():
    assert st.ZNCC(9) == st.ZNCC((9, 9)) == st.ZNCC("9x9")
    assert hash(st.ZNCC(9)) == hash(st.ZNCC("9"))
    assert st.ZNCC(9) != st.ZSSD(9)
    assert st.ZNCC((9, 7)) != st.ZNCC((7, 9))
    assert st.ZNCC(window=9).window == 9


@pytest.mark.parametrize("text", ["0", "256", "-3", "3.5", "x", "3x", "x3", "3x4x5", "three", "", " "])
def test_windows_that_are_none(text):
    with pytest.raises(ValueError, match="window must be"):
        window_size(text)


# ---- supports ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "support"),
    [
        ("gaussian:5", st.Gaussian(5)),
        ("Gaussian: 2.5, 3", st.Gaussian(sigma=2.5, truncate=3)),
        ("bilateral:31", st.Bilateral(31)),
        ("bilateral:31x15,10,12.5", st.Bilateral((31, 15), 10, 12.5)),
        ("cross:17,20", st.Cross(17, 20)),
        ("adaptive:9", st.Adaptive(9)),
        ("adaptive:9,41", st.Adaptive(9, 41)),
        ("adaptive:25X7,81x21,60,3", st.Adaptive((25, 7), (81, 21), 60, 3)),
    ],
)
def test_supports_as_text(text, support):
    assert st.SAD(text).window == support
    assert st.SAD(text).support is st.SAD(text).window or st.SAD(text).support == support
    assert Settings.make(assignments=[f"window={text}"]).cost == st.ZNCC(window=support)
    assert Settings.from_toml(f'window = "{text}"').cost == st.ZNCC(support)
    assert st.SAD(str(support)) == st.SAD(support)
    assert PLAIN.changed(window=text).changed(cost="sad").cost == st.SAD(support)


def test_supports_say_how_they_are_written():
    assert str(st.Gaussian(5)) == "gaussian:5,4"
    assert str(st.Bilateral((31, 15), 10, 12.5)) == "bilateral:31x15,10,12.5"
    assert Settings(cost=st.SSD(st.Gaussian(1.5))).to_dict()["cost"] == {
        "name": "ssd",
        "window": "gaussian:1.5,4",
    }
    assert 'window = "cross:17,20"\n' in Settings(cost=st.ZNCC(st.Cross(17))).to_toml()


def test_supports_by_their_box():
    assert st.ZNCC(9).support is None
    # The variance of a box of n pixels is (n^2 - 1) / 12, about that of sigma = n / sqrt(12).
    assert st.ZNCC(st.Gaussian(5)).size == (19, 19)
    assert st.ZNCC(st.Gaussian(200, 1)).size == (255, 255)
    assert st.ZNCC(st.Bilateral((31, 15))).size == (31, 15)
    assert st.ZNCC(st.Cross(17)).size == (35, 35)
    assert st.ZNCC(st.Adaptive(9, 41)).size == (41, 41)
    assert st.Gaussian(5).radius == 20
    assert st.Gaussian(0.1).radius == 0


def test_equal_supports_are_equal():
    assert st.Gaussian(5) == st.Gaussian(5.0, 4)
    assert hash(st.ZNCC(st.Cross(17, 20.0))) == hash(st.ZNCC("cross:17"))
    assert st.Adaptive((9, 9), 41) == st.Adaptive(9, (41, 41))
    with pytest.raises(dataclasses.FrozenInstanceError):
        st.Gaussian(5).sigma = 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gauss:5", "window names no support 'gauss'; did you mean 'gaussian'"),
        ("zzz:5", "no support 'zzz'; known are gaussian, bilateral, cross, adaptive"),
        ("gaussian:", r"window must be gaussian:SIGMA\[,TRUNCATE\], not 'gaussian:'"),
        ("gaussian", r"window must be .*gaussian:SIGMA"),
        ("gaussian:a", "window must be gaussian:SIGMA"),
        ("gaussian:5,4,3", "window must be gaussian:SIGMA"),
        ("gaussian:0", "sigma must be a positive number, not 0"),
        ("gaussian:5x5", "sigma must be a positive number"),
        ("gaussian:nan", "sigma must be"),
        ("gaussian:5,-1", "truncate must be"),
        ("gaussian:1e300", "sigma . truncate must be at most 1023 pixels"),
        ("bilateral:0", "size must be a whole number from 1 to 255"),
        ("bilateral:7.5", "size must be"),
        ("bilateral:9,inf", "sigma_space must be"),
        ("cross:0", "arm must be a whole number from 1 to 255, not 0"),
        ("cross:2.5", "arm must be"),
        ("cross:5,0", "threshold must be"),
        ("adaptive:9,7", "smallest must be at most as wide and as high as largest, 7 x 7, not 9 x 9"),
        ("adaptive:9x21,41x9", "smallest must be at most"),
        ("adaptive:9,41,0", "pixels must be"),
        ("adaptive:9,41,80,-2", "gradient must be"),
    ],
)
def test_supports_that_are_refused(text, message):
    with pytest.raises(ValueError, match=message):
        Settings.make(assignments=[f"window={text}"])


@pytest.mark.parametrize("value", [True, "5", None, [5], 1j])
def test_numbers_of_supports_are_numbers(value):
    with pytest.raises(ValueError, match="sigma must be"):
        st.Gaussian(value)


# ---- construction --------------------------------------------------------------------------------


def test_plain_settings_switch_nothing_on():
    assert PLAIN.cost == st.ZNCC(21)
    assert PLAIN.subpixel == "parabola"
    assert PLAIN.threads == 0
    assert PLAIN.channels == "grey"
    for name in ("disparities", "left_right", "uniqueness", "texture", "median", "speckle", "fill", "preset"):
        assert getattr(PLAIN, name) is None
    assert PLAIN.keep == ()


def test_values_are_normalised():
    made = Settings(
        disparities=[0, np.int32(9)], cost="SAD", left_right=1, speckle=50, keep="costs", median=np.int8(3)
    )
    assert made == Settings(
        disparities=(0, 9), cost=st.SAD(), left_right=1.0, speckle=(50, 1.0), keep=("costs",), median=3
    )
    assert isinstance(made.disparities, Disparities)
    assert isinstance(made.left_right, float)
    assert type(made.median) is int


def test_settings_do_not_change():
    for name in ("cost", "threads", "preset"):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(PLAIN, name, None)
    with pytest.raises(dataclasses.FrozenInstanceError):
        PLAIN.cost.window = 3
    with pytest.raises(TypeError):
        PRESETS["mine"] = PLAIN
    assert PLAIN.changed(threads=3) is not PLAIN
    assert PLAIN.threads == 0


@given(any_settings)
def test_settings_hash_and_pickle(made):
    again = pickle.loads(pickle.dumps(made))
    assert again == made
    assert hash(again) == hash(made)


# ---- changes -------------------------------------------------------------------------------------


def test_a_cost_by_name_keeps_the_window():
    start = Settings(cost=st.ZNCC((25, 9)))
    assert start.changed(cost="sad").cost == st.SAD((25, 9))
    assert start.changed(cost=st.SAD()).cost == st.SAD(21)
    assert start.changed(window=7).cost == st.ZNCC(7)
    assert start.changed(cost="ssd", window="5x3").cost == st.SSD((5, 3))
    assert start.changed(cost=st.SSD(11), window=(5, 3)).cost == st.SSD((5, 3))


@pytest.mark.parametrize(
    ("name", "nearest"),
    [
        ("left-right", "left_right"),
        ("treads", "threads"),
        ("windows", "window"),
        ("costs", "cost"),
        ("unique", "uniqueness"),
    ],
)
def test_an_unknown_setting_is_named_with_the_nearest(name, nearest):
    for attempt in (lambda: PLAIN.changed(**{name: 1}), lambda: Settings.make(assignments=[f"{name}=1"])):
        with pytest.raises(ValueError, match=f"unknown setting '{name}'; did you mean '{nearest}'"):
            attempt()


def test_a_setting_near_none_is_told_them_all():
    with pytest.raises(ValueError, match=r"unknown setting 'qqq'; known are disparities, .*window"):
        PLAIN.changed(qqq=1)


# ---- presets -------------------------------------------------------------------------------------


def test_presets_name_themselves():
    assert DEFAULT_PRESET in PRESETS
    for name, preset in PRESETS.items():
        assert preset.preset == name
        assert named(name) is preset
        assert Settings.make(name) == preset


def test_an_unknown_preset_is_named_with_the_nearest():
    with pytest.raises(ValueError, match="unknown preset 'fsat'; did you mean 'fast'"):
        named("fsat")
    with pytest.raises(ValueError, match="unknown preset 'zzz'; known are fast"):
        Settings.make("zzz")


def test_a_changed_preset_still_says_where_it_came_from():
    assert named("fast").changed(median=None).preset == "fast"


# ---- text ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("assignment", "changes"),
    [
        ("cost=sad", {"cost": st.SAD(21)}),
        ("cost=ZSSD", {"cost": st.ZSSD(21)}),
        ("window=31x15", {"cost": st.ZNCC((31, 15))}),
        ("window = 5", {"cost": st.ZNCC(5)}),
        ("channels=separate", {"channels": "separate"}),
        ("subpixel=equiangular", {"subpixel": "equiangular"}),
        ("subpixel=none", {"subpixel": None}),
        ("left_right=none", {"left_right": None}),
        ("left_right=off", {"left_right": None}),
        ("left_right=1.5", {"left_right": 1.5}),
        ("left_right=0", {"left_right": 0.0}),
        ("uniqueness=2e1", {"uniqueness": 20.0}),
        ("texture=NONE", {"texture": None}),
        ("median=5", {"median": 5}),
        ("speckle=100", {"speckle": (100, 1.0)}),
        ("speckle=100,0.5", {"speckle": (100, 0.5)}),
        ("weighted_median=7", {"weighted_median": (7, 10.0)}),
        ("weighted_median=7,20", {"weighted_median": (7, 20.0)}),
        ("edge_aware=3", {"edge_aware": (3.0, 5.0)}),
        ("edge_aware=3,2.5", {"edge_aware": (3.0, 2.5)}),
        ("confidence=calibrated", {"confidence": "calibrated"}),
        ("speckle=100, 2", {"speckle": (100, 2.0)}),
        ("disparities=-16:48", {"disparities": (-16, 48)}),
        ("disparities=none", {"disparities": None}),
        ("fill=background", {"fill": "background"}),
        ("planes=segments", {"planes": "segments"}),
        ("threads=2", {"threads": 2}),
        ("step=3", {"step": 3}),
        ("disparity_step=2", {"disparity_step": 2}),
        ("keep=costs,texture", {"keep": ("costs", "texture")}),
        ("keep=costs", {"keep": ("costs",)}),
        ("keep=", {"keep": ()}),
    ],
)
def test_assignments(assignment, changes):
    start = "fast"
    expected = named(start).changed(**changes) if "cost" not in changes else None
    if expected is None:
        assert Settings.make(assignments=[assignment]) == Settings(**changes)
    else:
        assert Settings.make(start, assignments=[assignment]) == expected


def test_the_later_assignment_wins():
    assert Settings.make(assignments=["median=3", "median=5"]).median == 5
    assert Settings.make(assignments=["cost=sad", "window=5"]).cost == st.SAD(5)
    assert Settings.make(assignments=["window=5", "cost=sad"]).cost == st.SAD(5)
    assert Settings.make("fast", assignments=["median=5"], median=7).median == 7
    assert Settings.make(assignments=["preset=fast", "median=5"]) == named("fast").changed(median=5)


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("cost", "NAME=VALUE, not 'cost'"),
        ("cost=zncx", "cost must be one of .*did you mean 'zncc'"),
        ("window=0", "window must be"),
        ("window=none", "window"),
        ("disparities=48", "disparities must be MIN:MAX"),
        ("disparities=a:b", "disparities must be MIN:MAX"),
        ("disparities=9:3", "disparities must be .*min < max"),
        ("median=4", "median must be an odd number"),
        ("median=3.0", "median must be an odd number"),
        ("median=three", "median must be a number"),
        ("left_right=-1", "left_right must be"),
        ("left_right=nan", "left_right must be"),
        ("uniqueness=inf", "uniqueness must be"),
        ("speckle=a,b", "speckle must be a number"),
        ("speckle=1,2,3", "speckle must be"),
        ("weighted_median=4", "weighted_median must be"),
        ("weighted_median=13", "weighted_median must be"),
        ("weighted_median=5,0", "weighted_median must be"),
        ("edge_aware=-1", "edge_aware must be"),
        ("edge_aware=1,0", "edge_aware must be"),
        ("confidence=high", "confidence must be one of calibrated"),
        ("threads=-1", "threads must be"),
        ("threads=none", "threads must be"),
        ("step=0", "step must be a whole number from 1 to 255"),
        ("disparity_step=1.5", "disparity_step must be"),
        ("keep=cost", "keep knows .*did you mean 'costs'"),
        ("fill=sky", "fill must be"),
        ("cost=none", "cost must be"),
        ("channels=none", "channels must be"),
        ("preset=slow", "unknown preset 'slow'"),
    ],
)
def test_assignments_that_are_refused(assignment, message):
    with pytest.raises((ValueError, TypeError), match=message):
        Settings.make(assignments=[assignment])


# ---- TOML ----------------------------------------------------------------------------------------


@given(any_settings)
@settings(deadline=None)
def test_toml_gives_the_same_settings_back(made):
    assert Settings.from_toml(made.to_toml()) == made


@given(any_settings)
def test_a_dict_survives_json(made):
    as_json = json.loads(json.dumps(made.to_dict(), allow_nan=False))
    window = list(made.cost.size) if made.cost.support is None else str(made.cost.window)
    assert as_json["cost"] == {"name": type(made.cost).__name__.lower(), "window": window}
    assert set(as_json) == {field.name for field in dataclasses.fields(Settings)}


def test_toml_by_hand():
    text = """
        cost = "sad"
        window = [31, 15]
        left_right = 1
        speckle = [50, 0.5]
        disparities = [-3, 9]
        median = "none"
    """
    assert Settings.from_toml(text) == Settings(
        cost=st.SAD((31, 15)), left_right=1, speckle=(50, 0.5), disparities=(-3, 9)
    )
    assert Settings.from_toml("") == PLAIN
    assert Settings.from_toml('preset = "fast"\nmedian = 5') == named("fast").changed(median=5)
    assert Settings.from_toml("window = 7").cost == st.ZNCC(7)
    assert Settings.from_toml('window = "7x9"').cost == st.ZNCC((7, 9))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("cost = ", "is not TOML"),
        ("cost = 5", "cost must be"),
        ("[match]\ncost = 5", "unknown setting 'match'"),
        ("leftright = 1", "did you mean 'left_right'"),
        ("window = [1, 2, 3]", "window must be"),
        ("disparities = [0.5, 3]", "disparities must be"),
        ("threads = true", "threads must be"),
        ('preset = "slow"', "unknown preset"),
        ("preset = 5", "preset"),
        ("left_right = nan", "left_right must be"),
        ("keep = [[]]", "keep knows"),
        ("median = 1979-05-27", "median must be"),
        ("a" * 100 + " = " + "[" * 5000, "is not TOML"),
    ],
)
def test_toml_that_is_refused(text, message):
    with pytest.raises((ValueError, TypeError), match=message):
        Settings.from_toml(text)


def test_a_file_then_assignments_then_keywords(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('preset = "fast"\ncost = "sad"\nmedian = 5\ntexture = 1\n', encoding="utf-8")
    made = Settings.make(file=path, assignments=["median=7"], texture=2)
    assert made == named("fast").changed(cost="sad", median=7, texture=2)
    assert Settings.make(file=str(path)).median == 5


def test_files_that_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError):
        Settings.make(file=tmp_path / "none.toml")
    path = tmp_path / "bad.toml"
    path.write_bytes(b"cost = \xff")
    with pytest.raises(ValueError, match=r"bad\.toml"):
        Settings.make(file=path)
    path.write_bytes(b"cost = = 3")
    with pytest.raises(ValueError, match=r"bad\.toml is not TOML"):
        Settings.make(file=path)


# ---- ranges --------------------------------------------------------------------------------------


def test_ranges():
    assert as_disparities((0, 64)) == Disparities(0, 64)
    assert as_disparities(range(-3, 9)) == (-3, 9)
    assert as_disparities([np.int16(1), 2]).span == 1
    assert as_disparities(Disparities(2, 5)) == (2, 5)
    assert as_disparities((-(2**24), 2**24)).span == 2**25
