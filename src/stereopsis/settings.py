"""What can be set: costs, checks, filters, presets; as Python, as TOML, as ``NAME=VALUE``."""

from __future__ import annotations

import dataclasses
import difflib
import json
import numbers
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Literal, TypeAlias, cast

from stereopsis import _files
from stereopsis._fused import MOST_AGGREGATED, streams_census
from stereopsis._numbers import is_number, is_whole
from stereopsis.optimize import (
    ICM,
    TRWS,
    BeliefPropagation,
    Expansion,
    Optimizer,
    SecondPass,
    Smoothness,
    Swap,
)
from stereopsis.pixelwise import PIXEL_COSTS, WORST, Census, Pixelwise, Rank, cost_of, name_of
from stereopsis.pixelwise import PixelCost as PixelCost
from stereopsis.sgm import SGM
from stereopsis.sharpen import LARGEST
from stereopsis.supports import MAX_WINDOW, Gaussian, Support, Window, as_window, window_size
from stereopsis.types import Disparities, Vertical


@dataclass(frozen=True)
class _WindowCost:
    window: Window = 21

    def __post_init__(self) -> None:
        object.__setattr__(self, "window", as_window(self.window))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the window in pixels; of a support, of the box that stands for it."""
        window = as_window(self.window)
        return window_size(window if isinstance(window, int | tuple) else window.size)

    @property
    def support(self) -> Support | None:
        """What the window is where it is no box."""
        window = as_window(self.window)
        return None if isinstance(window, int | tuple) else window


@dataclass(frozen=True)
class SAD(_WindowCost):
    """Sum of absolute differences over the window."""


@dataclass(frozen=True)
class SSD(_WindowCost):
    """Sum of squared differences over the window."""


@dataclass(frozen=True)
class ZSAD(_WindowCost):
    """Sum of absolute differences, each window's mean removed: blind to an offset of brightness.

    Its sum has to be taken anew for every candidate, so its time grows with the window's area.
    """


@dataclass(frozen=True)
class ZSSD(_WindowCost):
    """Sum of squared differences, each window's mean removed: blind to an offset of brightness."""


@dataclass(frozen=True)
class NCC(_WindowCost):
    """Normalised cross-correlation, negated: blind to a gain."""


@dataclass(frozen=True)
class ZNCC(_WindowCost):
    """Zero-mean normalised cross-correlation, negated: blind to gain and offset."""


WindowCost: TypeAlias = SAD | SSD | ZSAD | ZSSD | NCC | ZNCC
Cost: TypeAlias = WindowCost | PixelCost
COSTS: Mapping[str, type[WindowCost]] = MappingProxyType(
    {"sad": SAD, "ssd": SSD, "zsad": ZSAD, "zssd": ZSSD, "ncc": NCC, "zncc": ZNCC}
)
OPTIMIZERS: Mapping[str, type[Optimizer | SGM]] = MappingProxyType(
    {
        "second-pass": SecondPass,
        "icm": ICM,
        "bp": BeliefPropagation,
        "trws": TRWS,
        "expansion": Expansion,
        "swap": Swap,
        "sgm": SGM,
    }
)
OPTIMIZER_PARTS: Mapping[str, str] = MappingProxyType(
    {
        "smoothness": "norm",
        "smoothness_weight": "weight",
        "smoothness_truncation": "truncation",
        "optimize_iterations": "iterations",
        "optimize_levels": "levels",
        "optimize_data": "data",
        "optimize_paths": "paths",
        "optimize_p1": "p1",
        "optimize_p2": "p2",
        "optimize_p2_min": "p2_min",
        "optimize_contrast": "contrast",
        "optimize_unit": "unit",
        "optimize_more_global": "more_global",
    }
)
"""What an optimizer and its smoothness are made of, by the names that these have in a text."""
Subpixel: TypeAlias = Literal[
    "parabola", "equiangular", "symmetric", "correlation", "lucas-kanade", "lucas-kanade-affine"
]
SUBPIXEL = ("parabola", "equiangular", "symmetric", "correlation", "lucas-kanade", "lucas-kanade-affine")
INTERPOLATIONS = ("nearest", "linear", "cubic", "lanczos", "area")
FILLS = ("background", "interpolate", "surfaces", "planes")
PLANES = ("segments",)
CONFIDENCES = ("calibrated",)
CHANNELS = ("grey", "separate")
MAX_STEP = 255
MAX_VERTICAL = 1000
MAX_PYRAMID = 5
_MAX_BYTES = 2**18  # of a TOML file
SLANTS = ("road", "planes")
KEEP = ("costs", "right_disparity", "texture", "unfiltered", "planes", "segments", "vertical")


@dataclass(frozen=True)
class Settings:
    """Everything that decides a result.

    Attributes
    ----------
    disparities : Disparities or None
        Candidates, like Python's ``range``: the maximum is excluded. None: estimated from the images.
    cost : SAD, SSD, ZSAD, ZSSD, NCC, ZNCC, or a cost of pixels
        Matching cost and its support window. Costs of pixels: Census, Rank, Gradient, BirchfieldTomasi,
        MutualInformation, Combined.
    channels : {"grey", "separate"}
        Colour images are matched on their grey values, or on all three channels: the window's sums run over
        them, each with its own mean.
    blank : bool
        Leave the black border out that undistortion and rectification put around an image: the image is
        continued over it, and what lies there, or is matched there, counts as out of view. False: black is
        matched like anything else.
    vertical : {"estimate"}, float, (float, float, float[, float]) or None
        Undo what the right image lies too low, before anything else: pixels that are known, over the whole
        image or as a `Vertical` (in the middle, gained from left to right, gained from top to bottom, and
        what the second gains from top to bottom), or what is found in the images, "estimate". None: rows
        stay as they are.
    sharpen : float, "auto" or None
        Sharpen both images before they are compared, for a census or ranks: by how much of the difference
        from the mean around, up to 4. "auto": as the left image is blurred. None: as they are.
    optimize : SecondPass, ICM, BeliefPropagation, TRWS, Expansion, Swap, SGM or None
        How neighbours' labels are made to agree, with its smoothness or penalties. None: the plain winners.
    slant : {"road", "planes"} or None
        Windows are also matched along the ground, or along the ground and further planes, which are fitted
        to a first map; for each pixel the better match wins. None: fronto-parallel windows alone.
    extra_windows : tuple of windows
        Further support windows beside the cost's; for each pixel the one with the least expected variance.
    subpixel : str or None
        "parabola", "equiangular": a fit through the winner's cost and its two neighbours'. The parabola is
        right for squared costs and correlations, the equiangular (V) fit for absolute differences.
        "symmetric", "correlation", "lucas-kanade", "lucas-kanade-affine": from the images, around the
        winner; "correlation" needs ZNCC or NCC. None: whole candidates.
    refine_window : int or (int, int) or None
        The window of a sub-pixel method that works from the images. None: 15 x 5 for "symmetric" and
        "lucas-kanade", 21 x 11 for "lucas-kanade-affine", the cost's own for "correlation".
    upsample : tuple of (int, str) or None
        Match images of so many times as many columns: the factor, and how the columns between are
        interpolated: "nearest", "linear", "cubic", "lanczos" or "area". Candidates and window scale with
        them. None: the images as they are.
    left_right : float or None
        Largest difference in pixels between the winner and the right view's winner at its match. None: no
        check.
    uniqueness : float or None
        In percent: the winner is ambiguous where another candidate, not next to it, costs at most this much
        more. Costs are counted from a perfect match, so correlations as ``1 - correlation``. None: no check.
    texture : float, "auto" or None
        Least mean horizontal gradient over the support window, in grey levels a pixel; of 255 where float
        images run from 0 to 1. "auto": what noise alone would show, with the noise estimated from the left
        image. None: no check.
    reflection : float or None
        Largest difference of mean brightness between the windows of a match, in robust standard deviations of
        that difference over the image. None: no check.
    sky : bool or "auto"
        Recognise and refuse the sky of outdoor pairs. Walls that reach the image's top are told from it by
        their matches where `left_right` is on; else by the left image alone. "auto": above the horizon of a
        view over open ground, found in the matches; nowhere else. With `fill` the sky gets disparity 0, or
        the range's nearest to it, and stays without confidence.
    median : int or None
        Side of the median filter's window in pixels, odd.
    speckle : tuple of (int, float) or None
        Regions of fewer pixels than the first, in which neighbours differ by at most the second (pixels of
        disparity), are removed.
    planes : {"segments"} or None
        Every disparity is replaced by that of its segment's plane: small segments of the left image, whose
        planes go on, fold or hide each other. None: disparities stay as they were matched.
    planar : int or (int, int) or None
        Draw every disparity to the plane that a window of this size lies on, after the holes are filled and
        the median. Of semi-global matching those winners are answered that lie near it. None: off.
    fill : {"background", "interpolate", "surfaces", "planes"} or None
        How invalid pixels are answered: from the farther neighbour on the row; from eight directions by
        Hirschmueller's rules; by the slanted surfaces around them; from the plane of
        their segment, which needs `planes`. None: they stay NaN.
    weighted_median : (int, float) or None
        Median over so many pixels square, odd, up to 11, each weighted by how much it looks like the middle
        one: the second says over how many grey levels (of 256). After filling. None: off.
    edge_aware : (float, float) or None
        Weighted least squares along the image's edges, from slanted surfaces: strength, up to 100 000, and
        the grey levels (of 256) that make an edge. After filling and the weighted median. None: off.
    confidence : {"calibrated"} or None
        What the result's confidence is: the probability that an answer is within 3 pixels of the truth, from
        the map around it, for filled pixels too. None: how sharp the winner's minimum is.
    least_confidence : float or None
        Answers of less confidence are refused. Where holes are filled they count as filled, and what does is
        filled once more from the rest: the nearer answer stands. None: off.
    outlines : bool
        What was filled beside a jump of disparity goes to the nearer surface where what looks like it around
        does, and what lies on the nearer one to the farther where it matches better there; each time the
        `median` again. At the end.
    photometric : bool
        What was matched moves by up to half a pixel to where the grey levels around it are most alike. After
        everything else.
    pyramid : int or None
        Coarse to fine: a map of images that were halved so often tells which disparities each tile of the
        image has to search. None: everything everywhere.
    step : int
        Match only every so many-th pixel of rows and columns, from the first on; the others take the answer
        of the nearest that was matched.
    disparity_step : int
        Try only every so many-th candidate, from the smallest on; the sub-pixel fit spans as many.
    threads : int
        0: all cores. Never changes a result.
    keep : tuple of str
        Arrays that the result is to hold: "costs" (H, W, D), "right_disparity", "texture", "unfiltered";
        "planes", (N, 3) float64 ``a, b, c`` of ``d = a x + b y + c``, with "plane", (H, W) uint8, the number
        of each pixel's, 0 being fronto-parallel; "vertical", (H, W) float32, the rows that each pixel of the
        right image lay too low; "segments", (H, W) int32, each pixel's segment, with
        "segment_planes", (N, 3) float64, and "segment_support", (N,) float32, as
        `planes.Segmentation` says. With `slant` or `extra_windows` there are no costs to keep, as they belong
        to one plane and window.
    preset : str or None
        The preset that these settings started from.
    """

    disparities: Disparities | None = None
    cost: Cost = ZNCC()
    channels: Literal["grey", "separate"] = "grey"
    blank: bool = False
    vertical: Vertical | Literal["estimate"] | None = None
    sharpen: float | Literal["auto"] | None = None
    optimize: Optimizer | SGM | None = None
    slant: Literal["road", "planes"] | None = None
    extra_windows: tuple[tuple[int, int], ...] = ()
    subpixel: Subpixel | None = "parabola"
    refine_window: Window | None = None
    upsample: tuple[int, str] | None = None
    left_right: float | None = None
    uniqueness: float | None = None
    texture: float | Literal["auto"] | None = None
    reflection: float | None = None
    sky: bool | Literal["auto"] = False
    median: int | None = None
    speckle: tuple[int, float] | None = None
    planes: Literal["segments"] | None = None
    planar: Window | None = None
    fill: Literal["background", "interpolate", "surfaces", "planes"] | None = None
    weighted_median: tuple[int, float] | None = None
    edge_aware: tuple[float, float] | None = None
    confidence: Literal["calibrated"] | None = None
    least_confidence: float | None = None
    outlines: bool = False
    photometric: bool = False
    pyramid: int | None = None
    step: int = 1
    disparity_step: int = 1
    threads: int = 0
    keep: tuple[str, ...] = ()
    preset: str | None = None

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            object.__setattr__(self, field.name, _checked(field.name, getattr(self, field.name)))
        self._check_together()

    def _check_together(self) -> None:
        """Whether values that are allowed one by one go with each other."""
        _check_subpixel(self)
        _check_planes(self)
        _check_paths(self)

    @classmethod
    def make(
        cls,
        preset: str | None = None,
        file: str | Path | None = None,
        assignments: Iterable[str] = (),
        **changes: Any,
    ) -> Settings:
        """Settings from a preset, a TOML file, ``NAME=VALUE`` texts and keywords; the later ones win.

        Parameters
        ----------
        preset : str, optional
            A name in `PRESETS`. None: plain settings, no check and no filter on.
        file : path, optional
            A TOML file with any of the settings.
        assignments : iterable of str, optional
            Such as ``"cost=zncc"``, ``"window=31x15"``, ``"left_right=none"``.
        **changes
            Any field of `Settings`, `window` and `aggregation`, and the `OPTIMIZER_PARTS`.

        Raises
        ------
        ValueError
            For an unknown name, with the nearest known one, or a value that is not allowed.
        """
        stored = {} if file is None else _read_toml(Path(file))
        given = dict(stored)
        for assignment in (assignments,) if isinstance(assignments, str) else assignments:
            name, equals, value = assignment.partition("=")
            if not equals:
                raise ValueError(f"a setting is given as NAME=VALUE, not {assignment!r}")
            given[name.strip()] = _from_text(name.strip(), value.strip())
        given |= changes
        try:
            return cls._started(preset, given)
        except (ValueError, TypeError) as error:
            if file is not None and _same_refusal(error, lambda: cls._started(preset, stored)):
                raise ValueError(f"{file}: {error}") from None
            raise

    @classmethod
    def _started(cls, preset: str | None, given: Mapping[str, Any]) -> Settings:
        """From a preset, by name or among what is given, with everything else that is given."""
        changes = dict(given)
        among = changes.pop("preset", None)
        start = preset if preset is not None else among
        return (named(start) if start is not None else cls()).changed(**changes)

    def changed(self, **changes: Any) -> Settings:
        """A copy with other values: any field, the cost's `window` or `aggregation`, `OPTIMIZER_PARTS`."""
        known = _NAMES
        for name in changes:
            if name not in known:
                raise ValueError(f"unknown setting {name!r}{_nearest(name, known)}")
        sizes = {name: changes.pop(name) for name in COST_PARTS if name in changes}
        if "cost" in changes and isinstance(changes["cost"], str):
            changes["cost"] = _cost_named(changes["cost"], self.cost)
        if sizes:
            cost = changes.get("cost", self.cost)
            changes["cost"] = _resized(cost, sizes) if _is_cost(cost) else cost
        parts = {name: changes.pop(name) for name in OPTIMIZER_PARTS if name in changes}
        solver = changes.get("optimize", self.optimize)
        if parts or isinstance(solver, str):
            changes["optimize"] = _optimizer(solver, self.optimize, parts)
        # What stays has been checked, which takes a tenth of a millisecond within a match.
        other = object.__new__(Settings)
        other.__dict__.update(self.__dict__)
        for name, value in changes.items():
            object.__setattr__(other, name, _checked(name, value))
        other._check_together()
        return other

    def to_toml(self) -> str:
        """Every setting as TOML; `from_toml` gives the same settings back."""
        lines = []
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if field.name == "cost":
                if isinstance(value, Pixelwise):
                    lines.append(f"cost = {json.dumps(str(value))}")
                    continue
                lines.append(f'cost = "{type(value).__name__.lower()}"')
                lines.append(f"window = {json.dumps(_window_value(value))}")
            elif field.name == "optimize" and value is not None:
                for name, part in {"optimize": _name_of(value), **_parts_of(value)}.items():
                    lines.append(f"{name} = {json.dumps('none' if part is None else part)}")
            elif field.name != "preset" or value is not None:
                lines.append(f"{field.name} = {json.dumps('none' if value is None else value)}")
        return "\n".join(lines) + "\n"

    @classmethod
    def from_toml(cls, text: str) -> Settings:
        """Settings from TOML text; what it leaves out is as in its preset, or plain without one."""
        return cls.make(**_parse_toml(text, "the text"))

    def to_dict(self) -> dict[str, Any]:
        """As JSON can hold it."""
        return {
            field.name: (
                _cost_dict(value)
                if _is_cost(value)
                else {
                    "name": _name_of(value),
                    **{OPTIMIZER_PARTS[name]: part for name, part in _parts_of(value).items()},
                }
                if _is_optimizer(value)
                else value
            )
            for field in dataclasses.fields(self)
            for value in [getattr(self, field.name)]
        }


def _cost_dict(cost: Any) -> dict[str, Any]:
    if not isinstance(cost, Pixelwise):
        return {"name": type(cost).__name__.lower(), "window": _window_value(cost)}
    parts = {field.name: getattr(cost, field.name) for field in dataclasses.fields(cost)}  # type: ignore[arg-type]
    return {"name": name_of(cost)} | {
        name: _cost_dict(part)
        if isinstance(part, Pixelwise)
        else list(window_size(part))
        if name in COST_PARTS
        else part
        for name, part in parts.items()
    }


def _window_value(cost: WindowCost) -> Any:
    """A box as two numbers, a support as text."""
    return list(cost.size) if cost.support is None else str(cost.support)


COST_PARTS = ("window", "aggregation")
"""What a cost is made of, by the names that these have in a text of their own."""
_NAMES = (*(field.name for field in dataclasses.fields(Settings)), *COST_PARTS, *OPTIMIZER_PARTS)


def named(preset: str) -> Settings:
    """The settings of a preset; raises ValueError, with the nearest name, where there is none such."""
    if not isinstance(preset, str) or preset not in PRESETS:
        name = preset if isinstance(preset, str) else ""
        raise ValueError(f"unknown preset {preset!r}{_nearest(name, PRESETS)}")
    return PRESETS[preset]


def _nearest(name: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f"; did you mean {near[0]!r}?" if near else f"; known are {', '.join(known)}"


def _is_cost(value: Any) -> bool:
    return type(value) in (*COSTS.values(), *PIXEL_COSTS.values())


def _cost_named(name: str, before: Cost | None = None) -> Cost:
    """A cost by its name; one of windows keeps the window of the one before."""
    kind = name.partition("(")[0].strip().lower()
    known = (*COSTS, *PIXEL_COSTS)
    if kind not in known:
        raise ValueError(f"cost must be one of {', '.join(known)}, not {name!r}{_nearest(kind, known)}")
    if kind in PIXEL_COSTS:
        return cost_of(name)
    if kind != name.strip().lower():
        raise ValueError(f"cost must be {kind} alone, with its window apart, not {name!r}")
    return COSTS[kind](window=before.window) if isinstance(before, _WindowCost) else COSTS[kind]()


def _resized(cost: Cost, sizes: Mapping[str, Any]) -> Cost:
    parts = [field.name for field in dataclasses.fields(cost)]
    for name in sizes:
        if name not in parts:
            raise ValueError(f"cost={type(cost).__name__} has no {name}; it has {', '.join(parts)}")
    return dataclasses.replace(cost, **sizes)


def _is_optimizer(value: Any) -> bool:
    return type(value) in OPTIMIZERS.values()


def _name_of(solver: Optimizer | SGM) -> str:
    return next(name for name, kind in OPTIMIZERS.items() if kind is type(solver))


def _parts_of(solver: Optimizer | SGM) -> dict[str, Any]:
    """A solver's parts, under the names that they have in a text."""
    values = {field.name: getattr(solver, field.name) for field in dataclasses.fields(solver)}
    if "smoothness" in values:
        values |= dataclasses.asdict(values.pop("smoothness"))
    return {name: values[part] for name, part in OPTIMIZER_PARTS.items() if part in values}


def _optimizer(chosen: Any, before: Optimizer | SGM | None, parts: Mapping[str, Any]) -> Optimizer | SGM:
    """A solver by its name, or as it is, with other parts; by its name it keeps the smoothness set before."""
    if chosen is None:
        raise ValueError(
            f"{next(iter(parts))} needs an optimizer: set optimize to one of {', '.join(OPTIMIZERS)}"
        )
    if isinstance(chosen, str):
        name = chosen.lower()
        if name not in OPTIMIZERS:
            raise ValueError(
                f"optimize must be one of {', '.join(OPTIMIZERS)}, or None, not {chosen!r}"
                f"{_nearest(name, OPTIMIZERS)}"
            )
        kind = OPTIMIZERS[name]
        values = {} if before is None else _parts_of(before)
        if kind is not type(before):
            values = {} if kind is SGM else {k: v for k, v in values.items() if k.startswith("smoothness")}
    elif _is_optimizer(chosen):
        kind, values = type(chosen), _parts_of(chosen)
    else:
        return cast("Optimizer | SGM", chosen)  # which is refused where all settings are
    known = _parts_of(kind())
    for part in parts:
        if part not in known:
            raise ValueError(f"optimize={_name_of(kind())} has no {part}; it has {', '.join(known)}")
    values = {OPTIMIZER_PARTS[part]: value for part, value in {**known, **values, **parts}.items()}
    if kind is SGM:
        return SGM(**values)
    values["smoothness"] = Smoothness(*(values.pop(part) for part in ("norm", "weight", "truncation")))
    return kind(**values)


def _checked(name: str, value: Any) -> Any:
    """The value as `Settings` holds it, or an error that names the setting."""

    def refuse(allowed: str) -> ValueError:
        return ValueError(f"{name} must be {allowed}, not {value!r}")

    match name:
        case "disparities":
            return None if value is None else as_disparities(value)
        case "cost":
            if isinstance(value, str):
                return _cost_named(value)
            if not _is_cost(value):
                costs = ", ".join(cost.__name__ for cost in (*COSTS.values(), *PIXEL_COSTS.values()))
                raise TypeError(f"cost must be one of {costs}, not {value!r}")
        case "optimize":
            if isinstance(value, str):
                return _optimizer(value, None, {})
            if value is not None and not _is_optimizer(value):
                kinds = ", ".join(kind.__name__ for kind in OPTIMIZERS.values())
                raise TypeError(f"optimize must be one of {kinds}, or None, not {value!r}")
        case "channels":
            if value not in CHANNELS:
                raise refuse(f"one of {', '.join(CHANNELS)}")
        case "vertical":
            if value is None or value == "estimate":
                return value
            parts = (value, 0, 0) if is_number(value) else value
            several = isinstance(parts, tuple | list) and len(parts) in (3, 4)
            if not several or not all(map(is_number, parts)):
                raise refuse('"estimate", pixels, 3 or 4 of them (middle, across, down, keystone), or None')
            if not all(abs(part) <= MAX_VERTICAL for part in parts):
                raise refuse(f"at most {MAX_VERTICAL} pixels")
            return Vertical(*map(float, parts))
        case "sharpen":
            if value is None or value == "auto":
                return value
            if not (is_number(value) and 0 <= value <= LARGEST):
                raise refuse(f'a number from 0 to {LARGEST:g}, "auto", or None')
            return float(value)
        case "slant":
            if value is not None and value not in SLANTS:
                raise refuse(f"one of {', '.join(SLANTS)}, or None")
        case "extra_windows":
            if isinstance(value, str | numbers.Integral):
                value = (value,)
            if not isinstance(value, tuple | list):
                raise refuse("windows, each a side in pixels or WIDTHxHEIGHT")
            return tuple(window_size(window) for window in value)
        case "subpixel":
            if value is not None and value not in SUBPIXEL:
                raise refuse(f"one of {', '.join(SUBPIXEL)}, or None")
        case "refine_window" | "planar":
            if value is None:
                return None
            width, height = window_size(value)
            return width if width == height else (width, height)
        case "upsample":
            if value is None:
                return None
            factor, how = value if isinstance(value, tuple | list) and len(value) == 2 else (0, None)
            if not (is_whole(factor) and 2 <= factor <= 16 and how in INTERPOLATIONS):
                raise refuse(f"(factor from 2 to 16, one of {', '.join(INTERPOLATIONS)}), or None")
            return int(factor), str(how)
        case "texture" if isinstance(value, str):
            if value != "auto":
                raise refuse('a number of at least 0, "auto", or None')
        case "left_right" | "uniqueness" | "texture" | "reflection":
            if value is not None and not (is_number(value) and value >= 0):
                raise refuse("a number of at least 0, or None")
            return None if value is None else float(value)
        case "sky" if isinstance(value, str):
            if value != "auto":
                raise refuse('True, False or "auto"')
        case "sky" | "blank" | "outlines" | "photometric":
            if value is not None and not isinstance(value, bool):
                raise refuse('True, False or "auto"' if name == "sky" else "True or False")
            return bool(value)
        case "median":
            if value is not None and not (is_whole(value) and 1 <= value <= MAX_WINDOW and value % 2):
                raise refuse(f"an odd number from 1 to {MAX_WINDOW}, or None")
            return None if value is None else int(value)
        case "speckle":
            if value is None:
                return None
            area, difference = value if isinstance(value, tuple | list) and len(value) == 2 else (value, 1.0)
            if not (is_whole(area) and 0 <= area < 2**31 and is_number(difference) and difference >= 0):
                raise refuse("(area in pixels, largest difference in pixels of disparity), or None")
            return int(area), float(difference)
        case "planes":
            if value is not None and value not in PLANES:
                raise refuse(f"one of {', '.join(PLANES)}, or None")
        case "fill":
            if value is not None and value not in FILLS:
                raise refuse(f"one of {', '.join(FILLS)}, or None")
        case "weighted_median":
            if value is None:
                return None
            side, levels = value if isinstance(value, tuple | list) and len(value) == 2 else (value, 10.0)
            if not (is_whole(side) and 1 <= side <= 11 and side % 2 and is_number(levels) and levels >= 0.4):
                raise refuse("(odd side from 1 to 11, grey levels of at least 0.4), or None")
            return int(side), float(levels)
        case "edge_aware":
            if value is None:
                return None
            strength, levels = value if isinstance(value, tuple | list) and len(value) == 2 else (value, 5.0)
            if not (
                is_number(strength) and 0 <= strength <= 1e5 and is_number(levels) and 0.1 <= levels <= 1e6
            ):
                raise refuse("(strength from 0 to 100000, grey levels of at least 0.1), or None")
            return float(strength), float(levels)
        case "least_confidence":
            if value is not None and not (is_number(value) and 0 <= value <= 1):
                raise refuse("a number from 0 to 1, or None")
            return None if value is None else float(value)
        case "confidence":
            if value is not None and value not in CONFIDENCES:
                raise refuse(f"one of {', '.join(CONFIDENCES)}, or None")
        case "pyramid":
            if value is not None and not (is_whole(value) and 1 <= value <= MAX_PYRAMID):
                raise refuse(f"a whole number from 1 to {MAX_PYRAMID}, or None")
            return None if value is None else int(value)
        case "step" | "disparity_step":
            if not (is_whole(value) and 1 <= value <= MAX_STEP):
                raise refuse(f"a whole number from 1 to {MAX_STEP}")
            return int(value)
        case "threads":
            if not (is_whole(value) and 0 <= value <= 4096):
                raise refuse("a whole number from 0 (all cores) to 4096")
            return int(value)
        case "keep":
            kept = (value,) if isinstance(value, str) else value
            if not isinstance(kept, tuple | list):
                raise refuse(f"some of {', '.join(KEEP)}")
            for stage in kept:
                if stage not in KEEP:
                    raise ValueError(
                        f"keep knows {', '.join(KEEP)}, not {stage!r}{_nearest(str(stage), KEEP)}"
                    )
            return tuple(kept)
        case "preset":
            if value is not None and not isinstance(value, str):
                raise refuse("a name, or None")
    return value


def _check_subpixel(settings: Settings) -> None:
    """Raise ValueError where settings of sub-pixel matching exclude each other."""
    if settings.subpixel == "correlation" and not isinstance(settings.cost, ZNCC | NCC):
        raise ValueError(
            f'subpixel must not be "correlation" with {type(settings.cost).__name__}: it needs ZNCC or NCC'
        )
    if settings.upsample is None:
        return
    factor, (width, _) = settings.upsample[0], settings.cost.size
    if factor * width > MAX_WINDOW:
        raise ValueError(
            f"upsample widens the window to {factor} x {width} columns; it may have up to {MAX_WINDOW}"
        )
    if settings.uniqueness is not None:
        raise ValueError("uniqueness must be None with upsample: the steps next to a winner match as well")
    kept = {"costs", "right_disparity"} & set(settings.keep)
    if kept:
        raise ValueError(f"keep must not hold {', '.join(sorted(kept))} with upsample")


def _check_planes(settings: Settings) -> None:
    """Raise ValueError where what comes from planes is asked for without them."""
    if settings.planes is None and settings.fill == "planes":
        raise ValueError('fill must not be "planes" where planes is None: set planes to "segments"')
    if settings.planes is None and "segments" in settings.keep:
        raise ValueError('keep must not hold "segments" where planes is None: set planes to "segments"')


def _check_paths(settings: Settings) -> None:
    """Raise ValueError where settings need different ways through the stages."""
    sampled = settings.step > 1 or settings.disparity_step > 1
    merged = settings.slant is not None or bool(settings.extra_windows)
    others = settings.cost.support is not None or settings.optimize is not None or sampled
    if merged and "costs" in settings.keep:
        raise ValueError('keep must be without "costs" where slant or extra_windows is set')
    semi_global = settings.optimize if isinstance(settings.optimize, SGM) else None
    if merged and semi_global and not sampled:
        _check_slanted_sgm(settings, semi_global)
    elif merged and others:
        raise ValueError(
            "slant and extra_windows go with box windows alone: not with a support as window, optimize, "
            "step or disparity_step"
        )
    if settings.upsample is not None and (merged or others):
        raise ValueError(
            "upsample goes with box windows alone: not with a support as window, slant, extra_windows, "
            "optimize, step or disparity_step"
        )
    if isinstance(settings.cost, Pixelwise):
        if (merged and not semi_global) or settings.upsample is not None:
            raise ValueError(
                f"cost must be one of {', '.join(COSTS)} with slant, extra_windows and upsample, "
                f"not {name_of(settings.cost)}"
            )
        if settings.channels == "separate" and settings.cost.largest(channels=3) >= WORST:
            raise ValueError(
                f"cost must sum to at most {WORST - 1} over three channels, which 16 bits hold, not "
                f"{settings.cost!r}: its box must be smaller, or channels grey"
            )
    if settings.sharpen is not None and not isinstance(settings.cost, Census | Rank):
        raise ValueError(f"sharpen goes with cost=Census or Rank, not {type(settings.cost).__name__}")
    if semi_global and settings.cost.support is None:
        channels = 3 if settings.channels == "separate" else 1
        if isinstance(settings.cost, Pixelwise):
            semi_global.unit_for(settings.cost.largest(channels), whole=True)
        elif isinstance(settings.cost, NCC | ZNCC):
            semi_global.unit_for(2.0, whole=False)
    kept = {"costs", "right_disparity", "planes"} & set(settings.keep)
    if settings.pyramid is not None and (kept or sampled):
        raise ValueError(
            "pyramid goes without step and disparity_step, and with a keep without "
            '"costs", "right_disparity" and "planes"'
        )
    if settings.optimize is not None and sampled:
        raise ValueError("optimize must be None where step or disparity_step is more than 1")


def _check_slanted_sgm(settings: Settings, solver: SGM) -> None:
    """Raise ValueError where semi-global matching does not go along the ground."""
    if settings.slant != "road" or settings.extra_windows:
        raise ValueError("with optimize=SGM, slant must be 'road' or None, and extra_windows empty")
    if settings.channels != "grey" or not streams_census(settings.cost, solver):
        raise ValueError(
            "with optimize=SGM, slant goes with what streams alone: channels grey, cost=Census of "
            f"aggregation 1, or 3 with up to {MOST_AGGREGATED} comparisons, a unit of at least 1, and no "
            "more_global"
        )
    if "right_disparity" in settings.keep:
        raise ValueError('keep must be without "right_disparity" where slant and optimize=SGM are set')


def as_disparities(value: Any) -> Disparities:
    """A range of candidates from ``(min, max)``; raises TypeError or ValueError for what is none."""
    if not isinstance(value, tuple | list | range) or (not isinstance(value, range) and len(value) != 2):
        raise TypeError(f"disparities must be (min, max), two whole numbers, not {value!r}")
    if isinstance(value, range):
        if value.step != 1:
            raise ValueError(f"disparities must step by 1, not {value!r}")
        value = (value.start, value.stop)
    if not all(is_whole(end) for end in value):
        raise TypeError(f"disparities must be two whole numbers, not {value!r}")
    low, high = int(value[0]), int(value[1])
    if not -(2**24) <= low < high <= 2**24:
        raise ValueError(
            f"disparities must be (min, max) with min < max, within 2^24 of 0, not {(low, high)}"
        )
    return Disparities(low, high)


def _from_text(name: str, text: str) -> Any:
    """What a setting's text on the command line stands for."""
    if name not in _NAMES:
        raise ValueError(f"unknown setting {name!r}{_nearest(name, _NAMES)}")
    if text.lower() in ("none", "off") and name != "keep":
        return () if name == "extra_windows" else None

    def number(part: str) -> int | float:
        try:
            return int(part)
        except ValueError:
            try:
                return float(part)
            except ValueError:
                raise ValueError(f"{name} must be a number, not {part!r}") from None

    match name:
        case (
            "cost" | "window" | "aggregation" | "channels" | "slant" | "subpixel" | "refine_window" | "preset"
        ):
            return text
        case "planes" | "planar" | "fill" | "confidence":
            return text
        case "optimize" | "optimize_data" | "smoothness":
            return text.lower()
        case "upsample":
            factor, _, how = text.partition(",")
            return number(factor), how.strip()
        case "disparities":
            low, _, high = text.partition(":")
            try:
                return int(low), int(high)
            except ValueError:
                raise ValueError(f"disparities must be MIN:MAX, such as 0:128, not {text!r}") from None
        case "vertical":
            if text == "estimate":
                return text
            return tuple(number(part) for part in text.split(",")) if "," in text else number(text)
        case "extra_windows":
            return tuple(
                int(part) if part.isdigit() else part for part in text.replace(" ", "").split(",") if part
            )
        case "keep":
            return tuple(part.strip() for part in text.split(",") if part.strip())
        case "speckle" | "weighted_median" | "edge_aware":
            return tuple(number(part) for part in text.split(",")) if "," in text else number(text)
        case "texture" | "sharpen" | "sky" if text == "auto":
            return text
        case "sky" | "blank" | "outlines" | "photometric" | "optimize_more_global":
            if text.lower() not in ("on", "true"):
                allowed = "on, off or auto" if name == "sky" else "on or off"
                raise ValueError(f"{name} must be {allowed}, not {text!r}")
            return True
        case _:
            return number(text)


def _same_refusal(error: Exception, make: Callable[[], object]) -> bool:
    """Whether `make` is refused for the same reason."""
    try:
        make()
    except (ValueError, TypeError) as other:
        return str(other) == str(error)
    return False


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        text = _files.read(path, _MAX_BYTES, "settings").decode("utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not a TOML file: {error.reason}") from None
    return _parse_toml(text, str(path))


def _parse_toml(text: str, source: str) -> dict[str, Any]:
    if not isinstance(text, str):
        raise TypeError(f"text must be a str, not {type(text).__name__}")
    try:
        values = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: numbers of thousands of digits, too
        raise ValueError(f"{source} is not TOML: {error}") from None
    return {
        name: None if isinstance(value, str) and value.lower() == "none" else value
        for name, value in values.items()
    }


# It matches once as usual and once along the ground; in units of 8 costs and penalties fit bytes.
_BALANCED = Settings(
    preset="balanced",
    # Half as many comparisons as a dense census, and half as much work.
    cost=Census(window=(9, 7), pattern="symmetric", aggregation=3),
    blank=True,
    vertical="estimate",
    sharpen="auto",
    optimize=SGM(paths=4, p1=72, p2=560, p2_min=260, contrast=20, unit=4),
    slant="road",
    left_right=1.0,
    sky="auto",
    median=3,
    speckle=(200, 1.0),
    planar=(49, 25),
    fill="background",
    outlines=True,
    photometric=True,
)
PRESETS: Mapping[str, Settings] = MappingProxyType(
    {
        # Flat: on a road, the surface that matters most, disparity changes from row to row.
        "fast": Settings(
            preset="fast",
            cost=ZNCC(window=(13, 7)),
            blank=True,
            vertical="estimate",
            left_right=1.0,
            texture=0.3,
            median=3,
            speckle=(200, 1.0),
        ),
        "balanced": _BALANCED,
        "accurate": dataclasses.replace(
            _BALANCED,
            preset="accurate",
            cost=Census(window=(9, 7), aggregation=3),
            optimize=SGM(paths=4, p1=140, p2=1100, p2_min=400, contrast=20, unit=8),
            median=5,
            # What else is wrong the confidence finds.
            speckle=(100, 1.0),
            fill="surfaces",
            confidence="calibrated",
            least_confidence=0.85,
        ),
        # The report's Algorithm 1: the data of its second pass are squared differences, not the correlation.
        "paper-smoothed": Settings(
            preset="paper-smoothed",
            cost=ZNCC(window=30),
            optimize=SecondPass(Smoothness("l2", 0.5), data="zssd"),
            subpixel=None,
        ),
        # The report's Algorithm 2; what it calls a window of 15 is a standard deviation.
        "paper-gaussian": Settings(
            preset="paper-gaussian", cost=ZNCC(window=Gaussian(sigma=15)), subpixel=None
        ),
        # Small windows where the surface is rich or broken, large ones elsewhere, and both along its slant.
        "local": Settings(
            preset="local",
            cost=ZNCC(window=15),
            blank=True,
            vertical="estimate",
            slant="planes",
            extra_windows=((31, 31),),
            left_right=1.0,
            median=3,
            speckle=(200, 1.0),
            fill="background",
        ),
    }
)
DEFAULT_PRESET = "fast"
PLAIN: Final = Settings()
"""No check and no filter: what a cost alone starts from."""
