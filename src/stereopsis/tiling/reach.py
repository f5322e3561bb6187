"""How far what each setting does reaches, and what no tile can tell alone."""

from __future__ import annotations

import math
from typing import cast

from stereopsis import (
    _gaussian,
    confidence,
    cost,
    fill,
    optimize,
    pixelwise,
    rectify,
    refine,
    select,
    sgm,
    sharpen,
    slant,
    smooth,
    upsample,
    validate,
    weigh,
)
from stereopsis.settings import NCC, ZNCC, Settings
from stereopsis.supports import Gaussian, window_size
from stereopsis.types import WHOLE, Disparities, Halo, Vertical

COARSEST = 2**16
"""What the origin of a part is a multiple of at most."""


def halo(settings: Settings) -> Halo:
    """How far around a pixel its answer depends on the pair, summed over the stages.

    Parameters
    ----------
    settings : Settings
        With `disparities` and `vertical` known, not to be estimated.

    Returns
    -------
    Halo
        In pixels of both images. `WHOLE` where a stage looks along whole rows. For semi-global matching and
        for what `measured` names it is what is enough, not all.

    Raises
    ------
    ValueError
        For what `refuse` refuses, or a range that is not known.
    """
    refuse(settings)
    if settings.disparities is None or settings.vertical == "estimate":
        raise ValueError("disparities and vertical must be known for a halo, not still to be estimated")
    found = _matching(settings)
    if settings.texture is not None:
        found = found.beside(validate.texture_halo(settings.cost.size))
    if settings.subpixel in ("symmetric", "correlation", "lucas-kanade", "lucas-kanade-affine"):
        found = found.beside(_refinement(settings))
    if settings.sharpen is not None:
        found = found.then(sharpen.HALO)
    if isinstance(settings.vertical, Vertical) and any(settings.vertical):
        found = found.then(rectify.halo(settings.vertical))
    if settings.median is not None:
        found = found.then(refine.median_halo(settings.median))
    if settings.speckle is not None:
        found = found.then(validate.speckle_halo(settings.speckle[0]))
    if settings.fill is not None or settings.planar is not None:
        found = _bounded(found, fill.ALONG_ROWS if _fills_rows(settings) else fill.ALL_AROUND, settings)
    if settings.planar is not None:
        found = found.then(refine.planar_halo(window_size(settings.planar)))
    if settings.weighted_median is not None:
        found = found.then(smooth.weighted_median_halo(settings.weighted_median[0]))
    if settings.edge_aware is not None:
        found = found.then(smooth.edge_aware_halo(settings.edge_aware[0]))
    if settings.confidence is not None:
        found = _bounded(found, fill.ALONG_ROWS, settings).then(confidence.HALO)
    if settings.least_confidence is not None and settings.fill is not None:
        found = _bounded(found, fill.ALONG_ROWS if _fills_rows(settings) else fill.ALL_AROUND, settings)
        if settings.planar is not None:
            found = found.then(refine.planar_halo(window_size(settings.planar)))
    if settings.outlines:
        for decided in (fill.OUTLINES_HALO, fill.UNFATTEN_HALO):
            found = found.then(decided)
            if settings.median is not None:
                found = found.then(refine.median_halo(settings.median))
    if settings.photometric:
        found = found.then(refine.PHOTOMETRIC_HALO)
    return found


def _bounded(found: Halo, filling: Halo, settings: Settings) -> Halo:
    """Filling looks along whole rows; where paths are cut anyway, the overlap has to do for it."""
    return found if isinstance(settings.optimize, sgm.SGM) else found.then(filling)


def _fills_rows(settings: Settings) -> bool:
    return settings.fill in (None, "background")


def _matching(settings: Settings) -> Halo:
    """Of the winners, checks included."""
    disparities = cast(Disparities, settings.disparities)
    candidates = select.halo(disparities)
    found = _window(settings)
    if isinstance(settings.optimize, optimize.SecondPass):
        # Any candidate's cost depends on winners, and they on all candidates.
        found = found.then(candidates).then(optimize.second_pass_halo(settings.cost.size))
    if settings.left_right is not None:
        candidates = candidates.beside(validate.left_right_halo(disparities, settings.left_right))
    found = found.then(candidates)
    if settings.upsample is not None:
        found = found.then(upsample.HALO)
    if isinstance(settings.optimize, sgm.SGM):
        found = found.then(sgm.halo())
    if settings.step > 1:
        found = found.then(Halo.around(settings.step))
    return found


def _window(settings: Settings) -> Halo:
    """Of a candidate's cost."""
    chosen = settings.cost
    if isinstance(chosen, pixelwise.Pixelwise):
        found = pixelwise.halo(chosen)
    elif chosen.support is not None:
        found = weigh.halo(chosen.support)
        if isinstance(chosen.support, Gaussian):
            found = found.beside(_gaussian.halo(chosen.support.sigma, chosen.support.truncate))
    else:
        found = cost.halo(chosen.size)
    if settings.slant is not None or settings.extra_windows:
        first = (slant.FIRST_WINDOW,) if settings.slant is not None and settings.optimize is None else ()
        for window in (chosen.size, *settings.extra_windows, *first):
            found = found.beside(slant.halo(window))
    return found


def _refinement(settings: Settings) -> Halo:
    """Of a sub-pixel fit from the images, about a match that lies somewhere in the range."""
    candidates = select.halo(cast(Disparities, settings.disparities))
    asked = None if settings.refine_window is None else window_size(settings.refine_window)
    match settings.subpixel:
        case "symmetric":
            own = refine.symmetric_halo(asked or (15, 5))
        case "correlation":
            own = refine.aligned_halo(asked or settings.cost.size)
        case "lucas-kanade":
            own = refine.aligned_halo(asked or (15, 5))
        case _:
            own = refine.aligned_halo(asked or (21, 11))
    return own.then(candidates)


def alignment(settings: Settings) -> int:
    """What a part's first row and column are multiples of, so that all that counts from them agrees."""
    found = 2  # where halves are rounded to even
    found = math.lcm(found, settings.step)
    support = settings.cost.support
    if isinstance(support, Gaussian):
        found = math.lcm(found, _gaussian.filter_of(support.sigma, support.truncate).stride)
    return found


def measured(settings: Settings) -> tuple[str, ...]:
    """Settings for which tiles give what the whole image gives nearly everywhere, not to the bit.

    Parameters
    ----------
    settings : Settings

    Returns
    -------
    tuple of str
        Their names; none where every pixel is the same.
    """
    check(settings)
    named = {
        "optimize": isinstance(settings.optimize, sgm.SGM),
        "slant": settings.slant is not None,
        "fill": settings.fill in ("interpolate", "surfaces"),
        "weighted_median": settings.weighted_median is not None,
        "edge_aware": settings.edge_aware is not None,
    }
    return tuple(name for name, it_is in named.items() if it_is)


def refuse(settings: Settings) -> None:
    """Raise ValueError for settings that need the whole image at once.

    Raises
    ------
    TypeError
        For what are no settings.
    ValueError
        Naming the setting, and what to set instead.
    """
    check(settings)
    solver = settings.optimize
    if solver is not None and not isinstance(solver, sgm.SGM | optimize.SecondPass):
        raise ValueError(
            "optimize must be SGM, SecondPass or None in tiles: the labels of other solvers depend on the "
            "whole image"
        )
    if isinstance(solver, sgm.SGM) and not isinstance(settings.cost, pixelwise.Pixelwise | NCC | ZNCC):
        raise ValueError(
            "cost must be a cost of pixels, NCC or ZNCC with SGM in tiles, as the units of others depend on "
            f"the whole image, not {type(settings.cost).__name__}"
        )
    if isinstance(settings.cost, pixelwise.Pixelwise) and pixelwise.needs_information(settings.cost):
        raise ValueError("cost must not be MutualInformation in tiles: it is learnt from the whole image")
    # What "auto" means for the sky, a tiled match decides for all tiles.
    for name, allowed in (
        ("reflection", (None,)),
        ("sky", (False, "auto")),
        ("planes", (None,)),
        ("pyramid", (None,)),
    ):
        value = getattr(settings, name)
        if value not in allowed:
            choices = " or ".join(map(repr, allowed))
            raise ValueError(
                f"{name} must be {choices} in tiles, not {value!r}: it looks at the whole image at once"
            )
    if settings.keep:
        raise ValueError(f"keep must be empty in tiles, not {settings.keep!r}: arrays are not put together")


def check(settings: Settings) -> None:
    """Raise TypeError for what are no settings."""
    if not isinstance(settings, Settings):
        raise TypeError(f"settings must be a Settings, not {type(settings).__name__}")


def reaches_across(found: Halo) -> bool:
    """Whether it takes whole rows."""
    return found.left >= WHOLE or found.right >= WHOLE
