"""What the report's experiment does that its text does not say: a switch for each."""

from __future__ import annotations

from dataclasses import dataclass, fields

CORRELATIONS = ("ncc", "zncc", "zncc_smoothed", "zncc_gaussian")
SMOOTHED = ("ssd_smoothed", "zssd_smoothed", "zncc_smoothed")


@dataclass(frozen=True)
class Quirks:
    """The published experiment's departures from what its report describes, each off unless asked for.

    Attributes
    ----------
    swapped_grey : bool
        The weights of red and blue change places: ``0.299 B + 0.587 G + 0.114 R``. Off: the standard grey.
        Either way in 15-bit fixed point.
    truth_range : bool
        The search ends one above the whole part of the largest true disparity: a leak. Off: one for all
        pairs.
    right_frame : bool
        The left image moves and the right one stays, so the map belongs to the right view; it is scored
        against the left view's truth all the same. Off: the right image moves; the map is the left view's.
    wraps : bool
        The image that moves is rolled: what leaves it on one side comes back on the other. Off: a candidate
        counts only where its match lies inside the image.
    uint8_squares : bool
        SSD is taken in eight bits: ``(l - r)**2`` modulo 256. Off: in floating point.
    high_pass : bool
        ZSSD and ZNCC take from each pixel the mean of the window around that pixel, and so match two
        high-pass filtered images. Off: the mean that a window loses is its own, for all of its pixels.
    stale_mean : bool
        In ZSSD, the mean of the image that moves stays behind where that image was. Off: both move.
    zssd_data : bool
        The second pass of smoothed ZNCC weighs the disparity's smoothness against ZSSD. Off: against ZNCC.
    sigma_is_window : bool
        A Gaussian "window of 15" has a sigma of 15 pixels, and 121 taps. Off: it is as wide as the box window
        of that size, with its standard deviation, ``sqrt((window**2 - 1) / 12)``.
    undefined_wins : bool
        A correlation over a window without any contrast is 0 / 0; its first NaN wins over every number, and
        where rounding leaves a trace of contrast, any number may result. Off: such a correlation is 0.
    slope_subpixel : bool
        Sub-pixel refinement picks the candidate where the un-centred score rises most, against its curvature.
        Off: it fits a parabola.
    last_pair_dropped : bool
        The tables' means are the sum over all pairs but the last, divided by the number of all. Off: means.

    Notes
    -----
    The borders are no quirk: windows reflect at them, in either case.
    """

    swapped_grey: bool = False
    truth_range: bool = False
    right_frame: bool = False
    wraps: bool = False
    uint8_squares: bool = False
    high_pass: bool = False
    stale_mean: bool = False
    zssd_data: bool = False
    sigma_is_window: bool = False
    undefined_wins: bool = False
    slope_subpixel: bool = False
    last_pair_dropped: bool = False

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """List the switches in the order in which they act."""
        return tuple(field.name for field in fields(cls))


PUBLISHED = Quirks(**dict.fromkeys(Quirks.names(), True))
"""Every switch on: the experiment that the report printed."""


def acts(quirk: str, method: str) -> bool:
    """Whether a switch can change the whole disparities that a method finds.

    Sub-pixel refinement and the tables' mean come after those.
    """
    match quirk:
        case "swapped_grey" | "truth_range" | "right_frame" | "wraps":
            return True
        case "uint8_squares":
            return method in ("ssd", "ssd_smoothed")
        case "high_pass":
            return method not in ("ssd", "ssd_smoothed", "ncc")
        case "stale_mean":
            return method in ("zssd", "zssd_smoothed", "zncc_smoothed")
        case "zssd_data":
            return method == "zncc_smoothed"
        case "sigma_is_window":
            return method == "zncc_gaussian"
        case "undefined_wins":
            return method in CORRELATIONS
        case _:
            return False
