"""Solids that a ray meets in closed form, and the nearest of them along each ray of a camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis.scenes._noise import Floats

NEAR = 1e-6
"""Metres: nothing nearer to the camera is drawn."""

FAR = 1e6
"""Metres: how far the ground reaches."""

Scalars = Any
"""A float or an ndarray of float64; the components of rays broadcast against each other."""


@dataclass(frozen=True)
class Plane:
    """The half-space ``x px + y py + z pz <= offset``, of unit normal ``(x, y, z)``."""

    x: float
    y: float
    z: float
    offset: float

    def dot(self, px: Scalars, py: Scalars, pz: Scalars) -> Scalars:
        """Return the component along the normal."""
        total: Scalars = 0.0
        # A normal along an axis keeps rows and columns apart, so that whole grids cost a row and a column.
        for weight, coordinate in ((self.x, px), (self.y, py), (self.z, pz)):
            if weight:
                total = total + weight * coordinate
        return total


@dataclass(frozen=True)
class Round:
    """``sum(((p - centre) / radius)**2) <= 1``; an infinite radius makes a cylinder along that axis."""

    centre: tuple[float, float, float]
    radii: tuple[float, float, float]


@dataclass(frozen=True)
class Rays:
    """Rays ``(ox, oy, oz) + t (dx, dy, dz)``; camera rays have ``dz = 1``, so that t is the depth."""

    ox: Scalars
    oy: Scalars
    oz: Scalars
    dx: Scalars
    dy: Scalars
    dz: Scalars = 1.0


@dataclass(frozen=True)
class Solid:
    """A convex solid: half-spaces and at most one quadric, intersected.

    Coordinates are metres: x to the right, y up from the road, z ahead of the cameras.
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    planes: tuple[Plane, ...] = ()
    round: Round | None = None

    def span(self, rays: Rays) -> tuple[Scalars, Scalars]:
        """Return where each ray enters and leaves, as t; it misses where ``enter >= leave``."""
        enter: Scalars = -np.inf
        leave: Scalars = np.inf
        for p in self.planes:
            along = p.dot(rays.dx, rays.dy, rays.dz)
            along = np.where(along == 0.0, 1e-300, along)  # parallel: never in, or never out
            t = (p.offset - p.dot(rays.ox, rays.oy, rays.oz)) / along
            enter = np.maximum(enter, np.where(along < 0.0, t, -np.inf))
            leave = np.minimum(leave, np.where(along > 0.0, t, np.inf))
        if self.round is not None:
            a: Scalars = 0.0
            b: Scalars = 0.0
            c: Scalars = -1.0
            origin = (rays.ox, rays.oy, rays.oz)
            direction = (rays.dx, rays.dy, rays.dz)
            for o, d, centre, radius in zip(
                origin, direction, self.round.centre, self.round.radii, strict=True
            ):
                if np.isfinite(radius):
                    o, d = (o - centre) / radius, d / radius
                    a, b, c = a + d * d, b + o * d, c + o * o
            square = b * b - a * c
            root = np.sqrt(np.maximum(square, 0.0))
            enter = np.maximum(enter, np.where(square > 0.0, (-b - root) / a, np.inf))
            leave = np.minimum(leave, np.where(square > 0.0, (-b + root) / a, -np.inf))
        return enter, leave

    def face(self, px: Floats, py: Floats, pz: Floats) -> npt.NDArray[np.intp]:
        """Return which face surface points lie on: its plane's index; ``len(planes)`` is the quadric."""
        gaps = [p.dot(px, py, pz) - p.offset for p in self.planes]
        if self.round is not None:
            q: Scalars = -1.0
            for p, centre, radius in zip((px, py, pz), self.round.centre, self.round.radii, strict=True):
                if np.isfinite(radius):
                    q = q + ((p - centre) / radius) ** 2
            gaps.append(0.5 * min(self.round.radii) * q)
        index: npt.NDArray[np.intp] = np.argmax(np.stack(gaps), axis=0)
        return index

    def normal(
        self, face: npt.NDArray[np.intp], px: Floats, py: Floats, pz: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Return the outward unit normal of surface points on the given faces."""
        normals = np.array([(p.x, p.y, p.z) for p in self.planes] + [(0.0, 0.0, 0.0)])[face]
        nx, ny, nz = normals[:, 0], normals[:, 1], normals[:, 2]
        if self.round is not None:
            curved = face == len(self.planes)
            g = [
                (p - c) / (r * r) if np.isfinite(r) else np.zeros_like(p)
                for p, c, r in zip((px, py, pz), self.round.centre, self.round.radii, strict=True)
            ]
            length = np.sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2])
            nx, ny, nz = (np.where(curved, gi / length, ni) for gi, ni in zip(g, (nx, ny, nz), strict=True))
        return nx, ny, nz


def box(x0: float, x1: float, y0: float, y1: float, z0: float, z1: float) -> Solid:
    """Return an axis-aligned box; its faces are -x, +x, -y, +y, -z, +z."""
    return Solid(
        (x0, y0, z0),
        (x1, y1, z1),
        (
            Plane(-1.0, 0.0, 0.0, -x0),
            Plane(1.0, 0.0, 0.0, x1),
            Plane(0.0, -1.0, 0.0, -y0),
            Plane(0.0, 1.0, 0.0, y1),
            Plane(0.0, 0.0, -1.0, -z0),
            Plane(0.0, 0.0, 1.0, z1),
        ),
    )


def ground() -> Solid:
    """Return everything below the road plane y = 0."""
    return Solid((-FAR, -FAR, -FAR), (FAR, 0.0, FAR), (Plane(0.0, 1.0, 0.0, 0.0),))


def cylinder(x: float, z: float, radius: float, y0: float, y1: float) -> Solid:
    """Return an upright cylinder; its faces are -y, +y and the round one."""
    return Solid(
        (x - radius, y0, z - radius),
        (x + radius, y1, z + radius),
        (Plane(0.0, -1.0, 0.0, -y0), Plane(0.0, 1.0, 0.0, y1)),
        Round((x, 0.0, z), (radius, np.inf, radius)),
    )


def wheel(x0: float, x1: float, y: float, z: float, radius: float) -> Solid:
    """Return a cylinder along x; its faces are -x, +x and the round one."""
    return Solid(
        (x0, y - radius, z - radius),
        (x1, y + radius, z + radius),
        (Plane(-1.0, 0.0, 0.0, -x0), Plane(1.0, 0.0, 0.0, x1)),
        Round((0.0, y, z), (np.inf, radius, radius)),
    )


def ellipsoid(x: float, y: float, z: float, rx: float, ry: float, rz: float) -> Solid:
    """Return an ellipsoid with its axes along x, y and z."""
    return Solid((x - rx, y - ry, z - rz), (x + rx, y + ry, z + rz), (), Round((x, y, z), (rx, ry, rz)))


def prism(
    profile: Sequence[tuple[float, float]], along: str, low: float, high: float, lean: float = 0.0
) -> Solid:
    """Extrude a convex profile, given counter-clockwise as (across, y).

    Parameters
    ----------
    profile : sequence of (float, float)
        Corners; the first coordinate is z where `along` is ``"x"``, and x where it is ``"z"``.
    along : "x" or "z"
        Axis of extrusion.
    low, high : float
        Where the two ends stand at the lowest corner.
    lean : float
        How far the ends lean inwards, in metres per metre of height.

    Returns
    -------
    Solid
        Its faces are the two ends, low and high, then one a profile edge, in order.
    """
    across = [a for a, _ in profile]
    heights = [y for _, y in profile]
    floor = min(heights)
    length = float(np.sqrt(1.0 + lean * lean))
    ends = []
    for sign, where in ((-1.0, low), (1.0, high)):
        nx, nz = (sign / length, 0.0) if along == "x" else (0.0, sign / length)
        ends.append(Plane(nx, lean / length, nz, (sign * where + lean * floor) / length))
    edges = []
    for (a0, y0), (a1, y1) in zip(profile, [*profile[1:], profile[0]], strict=True):
        size = float(np.sqrt((a1 - a0) ** 2 + (y1 - y0) ** 2))
        na, ny = (y1 - y0) / size, (a0 - a1) / size
        nx, nz = (0.0, na) if along == "x" else (na, 0.0)
        edges.append(Plane(nx, ny, nz, na * a0 + ny * y0))
    bounds = ((low, high), (floor, max(heights)), (min(across), max(across)))
    (x0, x1), (y0, y1), (z0, z1) = bounds if along == "x" else bounds[::-1]
    return Solid((x0, y0, z0), (x1, y1, z1), (*ends, *edges))
