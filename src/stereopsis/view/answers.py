"""The page's questions and answers, as the description of the interface has them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field

Range = Annotated[list[int], Field(min_length=2, max_length=2, description="The end is excluded.")]
Point = Annotated[list[float], Field(min_length=2, max_length=2)]


class Problem(BaseModel):
    """Why there is no answer, in a sentence."""

    error: str


class Cost(BaseModel):
    """A matching cost with its fields and their defaults."""

    name: str
    fields: dict[str, Any]


class Solver(BaseModel):
    """An optimizer with the settings that it has, and their defaults."""

    name: str
    fields: dict[str, Any]


class FlagBit(BaseModel):
    """A bit of the flag map, and the red, green and blue that stand for it."""

    bit: int
    name: str
    colour: Annotated[list[int], Field(min_length=3, max_length=3)]


class Limits(BaseModel):
    """What the server takes at most."""

    upload_bytes: int
    pixels: int
    disparities: int


class Info(BaseModel):
    """What is looked at, and what can be chosen."""

    version: str
    title: str
    kind: Literal["scene", "pair", "map", "dataset", "results"]
    presets: list[str]
    costs: list[Cost]
    optimizers: list[Solver]
    colormaps: dict[str, str] = Field(description="256 times red, green and blue in base 64.")
    flags: list[FlagBit]
    limits: Limits
    defaults: dict[str, Any]


class Sample(BaseModel):
    """One thing that can be opened."""

    name: str
    has_truth: bool
    values: dict[str, float | str | None] = Field(description="Of the table's columns.")


class Samples(BaseModel):
    """Everything that can be opened, in order."""

    samples: list[Sample]
    columns: list[str]


class Calibration(BaseModel):
    """Pixels and metres; `stated` is false where nobody gave a calibration and a default stands in."""

    focal_length: float
    baseline: float
    doffs: float
    cx: float
    cy: float
    stated: bool


class Result(BaseModel):
    """A map: matched, or as it was opened."""

    result: str
    scene: str
    width: int
    height: int
    seconds: float
    stages: dict[str, float]
    path: str
    scores: dict[str, Any] | None
    disparities: Range
    density: float
    settings: dict[str, Any]
    arrays: list[str] = Field(description="Which of disparity, confidence, flags and error there are.")
    command: str
    python: str
    toml: str


class Scene(BaseModel):
    """What is known of a scene."""

    scene: str
    name: str
    width: int
    height: int
    channels: int
    bits: int
    dtype: str = Field(description="Of left.bin and right.bin: uint8, uint16 or float32.")
    has_left: bool
    has_right: bool
    has_truth: bool
    calibration: Calibration
    disparities: Range
    settings: dict[str, Any] | None = Field(description="To match it with at first, where that is its own.")
    result: Result | None


class Curve(BaseModel):
    """What every candidate costs at one pixel."""

    disparities: list[int]
    costs: list[float | None]
    winner: int | None
    subpixel: float | None
    fit: Fit | None
    note: str | None


class Fit(BaseModel):
    """The curve through the winner's cost and its neighbours': points of disparity and cost."""

    kind: str
    points: list[Point]


class Open(BaseModel):
    """Which sample to open."""

    sample: str = Field(max_length=1000)


class Match(BaseModel):
    """What to match, and how."""

    scene: str = Field(max_length=64)
    client: str = Field(min_length=1, max_length=64, description="Random, one a tab.")
    settings: dict[str, Any] = {}


Curve.model_rebuild()
