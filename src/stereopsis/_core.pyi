"""The compiled kernels. Private: shapes, dtypes and ranges are checked, but in few words."""

from collections.abc import Callable
from typing import Any, TypeVar, overload

import numpy as np
import numpy.typing as npt

_U8 = npt.NDArray[np.uint8]
_I32 = npt.NDArray[np.int32]
_I64 = npt.NDArray[np.int64]
_F32 = npt.NDArray[np.float32]
_F64 = npt.NDArray[np.float64]
_T = TypeVar("_T")

narrow_limit: int
largest_stride: int

def with_crew(work: Callable[[], _T], /) -> _T: ...
def instruction_sets() -> list[str]: ...
@overload
def grey(rgb: _U8, out: _U8, threads: int, instructions: str, /) -> None: ...
@overload
def grey(rgb: _I32, out: _I32, threads: int, instructions: str, /) -> None: ...
def match_narrow(
    left: _U8,
    right: _U8,
    first: int,
    count: int,
    cost: int,
    window_width: int,
    window_height: int,
    subpixel: int,
    left_right: float | None,
    uniqueness: float | None,
    disparity: _F32,
    confidence: _F32,
    flags: _U8,
    winning_cost: _F32 | None,
    threads: int,
    instructions: str,
    /,
) -> None: ...
def narrow_costs(
    left: _U8,
    right: _U8,
    first: int,
    cost: int,
    window_width: int,
    window_height: int,
    costs: _F32,
    threads: int,
    instructions: str,
    /,
) -> None: ...
def match_wide(
    left: _I32,
    right: _I32,
    first: int,
    count: int,
    cost: int,
    window_width: int,
    window_height: int,
    subpixel: int,
    left_right: float | None,
    uniqueness: float | None,
    disparity: _F32,
    confidence: _F32,
    flags: _U8,
    winning_cost: _F32 | None,
    threads: int,
    instructions: str,
    /,
) -> None: ...
def match_gaussian(
    left: _U8,
    right: _U8,
    first: int,
    count: int,
    cost: int,
    stride: int,
    taps: npt.NDArray[np.float64],
    subpixel: int,
    left_right: float | None,
    uniqueness: float | None,
    disparity: _F32,
    confidence: _F32,
    flags: _U8,
    threads: int,
    instructions: str,
    /,
) -> None: ...
def terms(
    left: _I32,
    right: _I32,
    first: int,
    window_width: int,
    window_height: int,
    term: int,
    out: _I64,
    threads: int,
    /,
) -> None: ...
def box(terms: _I64, window_width: int, window_height: int, sums: _I64, threads: int, /) -> None: ...
def score(
    left: _I32,
    right: _I32,
    first: int,
    window_width: int,
    window_height: int,
    cost: int,
    narrow: bool,
    sums: _I64,
    costs: npt.NDArray[Any],
    threads: int,
    /,
) -> None: ...
def score_zsad(
    left: _I32, right: _I32, first: int, window_width: int, window_height: int, costs: _F32, threads: int, /
) -> None: ...
@overload
def census(
    image: _U8, points: _I32, strings: npt.NDArray[np.uint64], threads: int, instructions: str, /
) -> None: ...
@overload
def census(
    image: _I32, points: _I32, strings: npt.NDArray[np.uint64], threads: int, instructions: str, /
) -> None: ...
def pixel_costs(
    kind: int,
    left: npt.NDArray[Any],
    right: npt.NDArray[Any],
    bits: int,
    first: int,
    most: int,
    table: _U8 | None,
    box_width: int,
    box_height: int,
    add: bool,
    costs: npt.NDArray[np.uint16],
    threads: int,
    instructions: str,
    /,
) -> None: ...
def combine(
    costs: npt.NDArray[np.uint16],
    other: npt.NDArray[np.uint16],
    factor: int,
    other_factor: int,
    threads: int,
    /,
) -> None: ...
def separable_costs(
    left: _I32,
    right: _I32,
    first: int,
    cost: int,
    step: int,
    disparity_step: int,
    taps: npt.NDArray[np.float64],
    costs: _F32,
    threads: int,
    instructions: str,
    /,
) -> None: ...
def reach_costs(
    left: _I32,
    right: _I32,
    first: int,
    cost: int,
    step: int,
    disparity_step: int,
    cross: bool,
    reach: _I32,
    costs: _F32,
    threads: int,
    instructions: str,
    /,
) -> None: ...
def bilateral_costs(
    left: _I32,
    right: _I32,
    first: int,
    cost: int,
    step: int,
    disparity_step: int,
    window_width: int,
    window_height: int,
    sigma_space: float,
    sigma_colour: float,
    costs: _F32,
    threads: int,
    instructions: str,
    /,
) -> None: ...
def cross_arms(image: _I32, arm: int, threshold: float, reach: _I32, threads: int, /) -> None: ...
def relative_costs(volume: npt.NDArray[Any], costs: _F32, least: _F64, threads: int, /) -> None: ...
def right_volume(left: npt.NDArray[Any], first: int, right: npt.NDArray[Any], threads: int, /) -> None: ...
def second_pass(
    volume: npt.NDArray[Any],
    guide: _I32,
    window_width: int,
    window_height: int,
    penalties: _I64,
    scale: float,
    weight: float,
    total: _F32,
    threads: int,
    /,
) -> None: ...
def distance_transform(h: _F32, power: int, weight: float, truncation: float, best: _F32, /) -> None: ...
def iterated_conditional_modes(
    costs: _F32,
    power: int,
    weight: float,
    truncation: float,
    iterations: int,
    labels: _I32,
    threads: int,
    /,
) -> None: ...
def tree_reweighted(
    costs: _F32,
    power: int,
    weight: float,
    truncation: float,
    iterations: int,
    labels: _I32,
    threads: int,
    /,
) -> float: ...
def belief_propagation(
    costs: _F32,
    power: int,
    weight: float,
    truncation: float,
    iterations: int,
    levels: int,
    labels: _I32,
    threads: int,
    /,
) -> None: ...
def find_plane(
    disparity: _F32,
    top: int,
    radius: int,
    most_a: float,
    least_b: float,
    most_b: float,
    tolerance: float,
    trials: int,
    sample: int,
    found: npt.NDArray[np.float64],
    threads: int,
    instructions: str,
    /,
) -> int: ...
@overload
def warp(
    image: _U8,
    plane: tuple[float, ...],
    floor: float,
    lowest: int,
    highest: int,
    warped: _U8,
    threads: int,
    /,
) -> None: ...
@overload
def warp(
    image: _I32,
    plane: tuple[float, ...],
    floor: float,
    lowest: int,
    highest: int,
    warped: _I32,
    threads: int,
    /,
) -> None: ...
@overload
def move_rows(
    image: _U8,
    offset: tuple[float, ...],
    lowest: int,
    highest: int,
    moved: _U8,
    threads: int,
    instructions: str,
    /,
) -> None: ...
@overload
def move_rows(
    image: _I32,
    offset: tuple[float, ...],
    lowest: int,
    highest: int,
    moved: _I32,
    threads: int,
    instructions: str,
    /,
) -> None: ...
def continue_over(
    rows: _I32,
    columns: _I32,
    row_pixels: _U8,
    column_pixels: _U8,
    top: int,
    left: int,
    pixels: _U8,
    threads: int,
    /,
) -> None: ...
def find_hidden(
    disparity: _F32,
    sign: float,
    rows: _I32 | None,
    columns: _I32 | None,
    other_rows: _I32 | None,
    other_columns: _I32 | None,
    top: int,
    left: int,
    hidden: _U8,
    threads: int,
    /,
) -> None: ...
@overload
def sharpen(image: _U8, amount: int, sharp: _U8, threads: int, /) -> None: ...
@overload
def sharpen(image: _I32, amount: int, sharp: _I32, threads: int, /) -> None: ...
def halve(image: _U8, means: _U8, threads: int, instructions: str, /) -> None: ...
def stretch(image: _I32, low: float, factor: float, bytes: _U8, instructions: str, /) -> None: ...
def corners(
    image: _U8,
    tile: int,
    stride: int,
    reach: int,
    least: float,
    found: _I32,
    threads: int,
    instructions: str,
    /,
) -> None: ...
def track(
    left: _U8,
    right: _U8,
    points: _I32,
    reach: int,
    iterations: int,
    motion: npt.NDArray[np.float64],
    correlation: npt.NDArray[np.float64],
    threads: int,
    instructions: str,
    /,
) -> None: ...
def unbow(
    disparity: _F32, bow: float, middle: float, least: float, most: float, of_right: bool, threads: int, /
) -> None: ...
def fit_rows(
    across: _F64, down: _F64, rows: _F64, slope: float, keystone: float, settled: float, field: _F64, /
) -> float: ...
def merge_pass(
    disparity: _F32,
    confidence: _F32,
    cost: _F32,
    flags: _U8,
    kind: int,
    plane: tuple[float, ...],
    floor: float,
    handicap: float,
    least: float,
    most: float,
    beyond: bool,
    number: int,
    best: tuple[npt.NDArray[Any], ...],
    threads: int,
    /,
) -> None: ...
def merge_window(
    other: tuple[npt.NDArray[Any], ...],
    kind: int,
    best: tuple[npt.NDArray[Any], ...],
    variance: _F32,
    threads: int,
    /,
) -> None: ...
def select_left(
    volume: npt.NDArray[Any],
    first: int,
    width: int,
    step: int,
    disparity_step: int,
    index: _I32,
    cost: npt.NDArray[Any],
    before: npt.NDArray[Any],
    after: npt.NDArray[Any],
    second: npt.NDArray[Any],
    threads: int,
    /,
) -> None: ...
def select_right(
    volume: npt.NDArray[Any],
    first: int,
    width: int,
    step: int,
    disparity_step: int,
    index: _I32,
    threads: int,
    /,
) -> None: ...
def select_at(
    volume: npt.NDArray[Any],
    first: int,
    index: _I32,
    cost: npt.NDArray[Any],
    before: npt.NDArray[Any],
    after: npt.NDArray[Any],
    second: npt.NDArray[Any],
    threads: int,
    /,
) -> None: ...
@overload
def texture(image: _U8, window_width: int, window_height: int, mean: _F32, threads: int, /) -> None: ...
@overload
def texture(image: _I32, window_width: int, window_height: int, mean: _F32, threads: int, /) -> None: ...
@overload
def refuse_dull(
    image: _U8,
    window_width: int,
    window_height: int,
    least: float,
    bit: int,
    disparity: _F32,
    confidence: _F32,
    flags: _U8,
    threads: int,
    instructions: str,
    /,
) -> None: ...
@overload
def refuse_dull(
    image: _I32,
    window_width: int,
    window_height: int,
    least: float,
    bit: int,
    disparity: _F32,
    confidence: _F32,
    flags: _U8,
    threads: int,
    instructions: str,
    /,
) -> None: ...
def left_right_maps(
    left: _F32, right: _F32, least: int, most: int, tolerance: float, flags: _U8, threads: int, /
) -> None: ...
def speckle(
    disparity: _F32, area: int, difference: float, out: _U8, threads: int, instructions: str, /
) -> None: ...
def refuse_speckle(
    area: int,
    difference: float,
    bit: int,
    disparity: _F32,
    confidence: _F32,
    flags: _U8,
    threads: int,
    instructions: str,
    /,
) -> None: ...
def cut_off(
    disparity: _F32,
    left: int,
    area: int,
    difference: float,
    nearer: float,
    out: _U8,
    instructions: str,
    /,
) -> None: ...
def relief(planes: _F32, calm: float, unit: float, out: _U8, threads: int, instructions: str, /) -> None: ...
def flood(relief: _U8, out: _U8, /) -> None: ...
def keep_regions(inside: _U8, marked: _U8, share: float, others: bool, out: _U8, /) -> None: ...
def noise_means(image: _F32, height: int, width: int, out: _F64, threads: int, /) -> None: ...
def accept(
    disparity: _F32, confidence: _F32, flags: _U8, accepted: _F32, trust: _F32, threads: int, /
) -> None: ...
def judge(
    winners: _F32 | None,
    confidence: _F32,
    least: float,
    most: float,
    near: float,
    revocable: int,
    wrong: int,
    smooth: _F32,
    flags: _U8,
    accepted: _F32,
    trust: _F32,
    threads: int,
    /,
) -> None: ...
def median(disparity: _F32, size: int, out: _F32, threads: int, instructions: str, /) -> None: ...
def planar(
    disparity: _F32,
    window_width: int,
    window_height: int,
    tolerance: float,
    iterations: int,
    out: _F32,
    threads: int,
    instructions: str,
    /,
) -> None: ...
def weighted_median(
    disparity: _F32, guide: _U8, size: int, slope: int, out: _F32, threads: int, /
) -> None: ...
def edge_aware(
    disparity: _F32, guide: _I32, tables: _F32, strength: float, iterations: int, out: _F32, threads: int, /
) -> None: ...
def probability(
    surface: _F32,
    answered: _U8,
    sharpness: _F32,
    winners: _F32,
    texture: _F32,
    weights: _F32,
    logistic: _F32,
    out: _F32,
    threads: int,
    /,
) -> None: ...
@overload
def background(disparity: _F32, filled: _F32, threads: int, /) -> None: ...
@overload
def background(disparity: _F64, filled: _F64, threads: int, /) -> None: ...
def interpolate(disparity: _F32, occluded: _U8, out: _F32, /) -> None: ...
def fill_surfaces(
    disparity: _F32,
    occluded: _U8,
    guide: _I32,
    tables: _F32,
    strength: float,
    least: float,
    most: float,
    out: _F32,
    threads: int,
    /,
) -> None: ...
def nearer(disparity: _F32, doubtful: _U8, again: _F32, out: _F32, threads: int, /) -> None: ...
def outlines(disparity: _F32, doubtful: _U8, image: _U8, alike: _I32, out: _F32, threads: int, /) -> None: ...
def photometric(
    disparity: _F32,
    doubtful: _U8,
    left: _U8,
    right: _U8,
    least: float,
    most: float,
    out: _F32,
    threads: int,
    instructions: str,
    /,
) -> None: ...
def unfatten(
    disparity: _F32, doubtful: _U8, left: _U8, right: _U8, image: _U8, alike: _I32, out: _F32, threads: int, /
) -> None: ...
def align(
    left: _I32,
    right: _I32,
    window_width: int,
    window_height: int,
    alignment: int,
    centred: bool,
    narrow: bool,
    start: _F32,
    disparity: _F32,
    threads: int,
    /,
) -> None: ...
def align_planes(
    left: _I32,
    right: _I32,
    window_width: int,
    window_height: int,
    start: _F32,
    disparity: _F32,
    slopes: _F32,
    threads: int,
    /,
) -> None: ...
def align_intervals(
    left: _I32,
    right: _I32,
    window_width: int,
    window_height: int,
    steps: int,
    start: _F32,
    disparity: _F32,
    threads: int,
    /,
) -> None: ...

most_aggregated_bits: int

def sgm_sums(
    costs: npt.NDArray[np.uint16],
    paths: int,
    most: int,
    p1: int,
    p2: _I32,
    guide: _U8 | None,
    sums: npt.NDArray[np.uint16],
    threads: int,
    instructions: str,
    /,
) -> None: ...
def hide_out_of_view(sums: npt.NDArray[np.uint16], first: int, beyond: _I32, threads: int, /) -> None: ...
def mgm_sums(
    costs: npt.NDArray[np.uint16],
    paths: int,
    most: int,
    p1: int,
    p2: _I32,
    guide: _U8 | None,
    sums: npt.NDArray[np.uint16],
    threads: int,
    instructions: str,
    /,
) -> None: ...
def sgm_census(
    left: npt.NDArray[np.uint64],
    right: npt.NDArray[np.uint64],
    bits: int,
    aggregated: bool,
    unit: int,
    first: int,
    count: int,
    shift: npt.NDArray[np.int16] | None,
    paths: int,
    most: int,
    p1: int,
    p2: _I32,
    guide: _U8 | None,
    subpixel: int,
    left_right: float | None,
    uniqueness: float | None,
    disparity: _F32,
    confidence: _F32,
    flags: _U8,
    winning_cost: _F32 | None,
    threads: int,
    instructions: str,
    /,
) -> None: ...
def fit_planes(
    seen: tuple[_F32, _F32, _F32],
    model: tuple[float, ...],
    label: _I32,
    trials: int,
    planes: _F64,
    threads: int,
    /,
) -> None: ...
def move_boundaries(
    seen: tuple[_F32, _F32, _F32],
    model: tuple[float, ...],
    planes: _F64,
    sweeps: int,
    label: _I32,
    threads: int,
    /,
) -> None: ...
def smooth_planes(
    seen: tuple[_F32, _F32, _F32],
    model: tuple[float, ...],
    label: _I32,
    columns: int,
    rounds: int,
    planes: _F64,
    threads: int,
    /,
) -> None: ...
def render_planes(
    label: _I32, planes: _F64, least: float, most: float, disparity: _F32, threads: int, /
) -> None: ...
