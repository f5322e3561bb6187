"""The methods of the corrected study, by name: plain settings of the library, no quirk, no truth.

A part is an experiment with a section of the page: "sweep" is run at every window, "subpixel", "supports",
"smoothing", "presets" and "checks" at one. The first method of "subpixel", "smoothing" and "checks" is what
the others are compared with. One line adds a method: `Method(name, label, part, window -> Settings)`. The
window is the full size in pixels, as on the report's axes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final, Literal

from stereopsis.optimize import BeliefPropagation, SecondPass, Smoothness
from stereopsis.settings import NCC, PRESETS, SAD, SSD, ZNCC, ZSSD, Settings
from stereopsis.supports import Adaptive, Bilateral, Cross, Gaussian

WINDOW: Final = 31
"""The window of every comparison that is not a sweep over windows."""


@dataclass(frozen=True)
class Method:
    """A way to match, up to its window.

    Attributes
    ----------
    name : str
        Short; as in ``--methods`` and in the table of results.
    label : str
        As on the page.
    part : str
        The experiment that it belongs to: "sweep" is run at every window, everything else at one.
    settings : callable
        From the window's size in pixels to `Settings`.
    windowed : bool
        Whether the window means anything to it.
    """

    name: str
    label: str
    part: str
    settings: Callable[[int], Settings]
    windowed: bool = True

    def setting(self, window: int) -> str:
        """What the table of results calls the method at a window."""
        return f"{self.name}-{window}" if self.windowed else self.name


def same_variance(window: int) -> float:
    """Standard deviation, in pixels, of the Gaussian that is as wide as a box window.

    A box of `window` pixels has the variance ``(window**2 - 1) / 12``. At equal spread a comparison of the
    two shapes is one; the report's "window 15" was ``sigma = 15``, as wide as a box of 52.
    """
    return float(((window**2 - 1) / 12) ** 0.5)


def zncc(**changes: Any) -> Callable[[int], Settings]:
    """Plain ZNCC over a box, with some settings changed."""
    return lambda window: Settings(cost=ZNCC(window=window), **changes)


def fixed(settings: Settings) -> Callable[[int], Settings]:
    """Settings that have a window of their own."""
    return lambda _: settings


def gaussian(window: int) -> Settings:
    """ZNCC under a Gaussian as wide as a box window."""
    return Settings(cost=ZNCC(window=Gaussian(sigma=same_variance(window))))


def smooth(norm: Literal["l1", "l2"], truncation: float | None = None) -> Callable[[int], Settings]:
    """Belief propagation over a small window, which leaves outlines to the smoothness."""
    solver = BeliefPropagation(Smoothness(norm, 0.1, truncation))
    return lambda _: Settings(cost=ZNCC(window=5), optimize=solver)


METHODS: Final[tuple[Method, ...]] = (
    # The sweep over windows: Figures 3-5, 7 and 8. Its names that begin with "zncc" stand in Figures 7 and 8.
    Method("ssd", "SSD", "sweep", lambda w: Settings(cost=SSD(window=w))),
    Method("zssd", "ZSSD", "sweep", lambda w: Settings(cost=ZSSD(window=w))),
    Method("ncc", "NCC", "sweep", lambda w: Settings(cost=NCC(window=w))),
    Method("zncc", "ZNCC", "sweep", zncc()),
    Method(
        "zncc-smoothed",
        "ZNCC, smoothed",
        "sweep",
        zncc(optimize=SecondPass(Smoothness("l2", 0.5), data="zssd")),
    ),
    Method("zncc-gaussian", "ZNCC, Gaussian", "sweep", gaussian),
    Method("sad", "SAD", "sweep", lambda w: Settings(cost=SAD(window=w), subpixel="equiangular")),
    # Sub-pixel: whole pixels first, the rest is compared with it.
    Method("zncc-integer", "none (whole pixels)", "subpixel", zncc(subpixel=None)),
    Method("zncc-parabola", "parabola", "subpixel", zncc(subpixel="parabola")),
    Method("zncc-equiangular", "equiangular", "subpixel", zncc(subpixel="equiangular")),
    Method("zncc-symmetric", "symmetric", "subpixel", zncc(subpixel="symmetric")),
    Method("zncc-correlation", "correlation-optimal", "subpixel", zncc(subpixel="correlation")),
    Method("zncc-lucas-kanade", "Lucas-Kanade", "subpixel", zncc(subpixel="lucas-kanade")),
    Method("zncc-affine", "Lucas-Kanade, slanted", "subpixel", zncc(subpixel="lucas-kanade-affine")),
    *(
        Method(
            f"zncc-upsampled-{how}", f"4 x as wide, {how}", "subpixel", zncc(subpixel=None, upsample=(4, how))
        )
        for how in ("nearest", "linear", "cubic", "lanczos", "area")
    ),
    # Support windows under ZNCC.
    Method("zncc-box", "box", "supports", zncc()),
    Method("zncc-gauss", "Gaussian", "supports", gaussian),
    Method("zncc-bilateral", "bilateral", "supports", lambda w: Settings(cost=ZNCC(window=Bilateral(w)))),
    Method("zncc-cross", "cross", "supports", lambda w: Settings(cost=ZNCC(window=Cross(arm=w // 2)))),
    Method(
        "zncc-adaptive", "adaptive", "supports", lambda _: Settings(cost=ZNCC(window=Adaptive(11))), False
    ),
    Method("zncc-slanted", "slanted", "supports", zncc(slant="planes")),
    # Smoothing: L1 against L2, truncated and not.
    Method("smooth-none", "none, window 5", "smoothing", lambda _: Settings(cost=ZNCC(window=5)), False),
    Method("smooth-l1", "L1", "smoothing", smooth("l1"), False),
    Method("smooth-l2", "L2", "smoothing", smooth("l2"), False),
    Method("smooth-l1-truncated", "L1, truncated at 3 px", "smoothing", smooth("l1", 3.0), False),
    Method("smooth-l2-truncated", "L2, truncated at 3 px", "smoothing", smooth("l2", 3.0), False),
    # Whole methods: every preset.
    *(Method(name, f"preset {name}", "presets", fixed(preset), False) for name, preset in PRESETS.items()),
    # Recognising what is invalid: the plain winner first, then the same under different checks.
    Method("checks-none", "no check", "checks", zncc()),
    Method("checks-texture", "texture", "checks", zncc(texture=1.0)),
    Method("checks-uniqueness", "uniqueness", "checks", zncc(uniqueness=2.0)),
    Method("checks-left-right", "left-right", "checks", zncc(left_right=1.0)),
    Method("checks-sky", "sky", "checks", zncc(left_right=1.0, sky=True)),
    Method(
        "checks-all",
        "all of them, and speckles",
        "checks",
        zncc(left_right=1.0, uniqueness=2.0, texture=1.0, speckle=(200, 1.0)),
    ),
)

PARTS: Final = tuple(dict.fromkeys(method.part for method in METHODS))


def named(names: Iterable[str]) -> tuple[Method, ...]:
    """The methods of these names, in the order of `METHODS`; all of them for no name.

    Raises
    ------
    ValueError
        For an unknown name, with the nearest known one.
    """
    import difflib

    wanted, known = list(names), [method.name for method in METHODS]
    for name in wanted:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
            hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(known)}"
            raise ValueError(f"unknown method {name!r}; {hint}")
    return tuple(method for method in METHODS if not wanted or method.name in wanted)
