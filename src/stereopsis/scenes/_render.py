"""From a list of solids to depth, hidden points and light, a band of rows at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from stereopsis.scenes._noise import Floats, Floats32, lattice
from stereopsis.scenes._shapes import NEAR, Rays
from stereopsis.scenes._surfaces import Colour, Hit, Item, Look, linear

Bools = npt.NDArray[np.bool_]
Ints = npt.NDArray[np.intp]

SUNLIGHT: Colour = (1.22, 1.17, 1.08)
SKYLIGHT: Colour = (0.62, 0.67, 0.75)
"""How much of each colour a white surface gives back under the bare sun and under the open sky."""

BAND = 1 << 18
"""Rays traced at once, so that their arrays stay in the caches."""


@dataclass(frozen=True)
class Camera:
    """One camera of the rig; it looks along z, with the other one's focal length and principal point."""

    focal: float
    cx: float
    cy: float
    x: float
    height: float
    shift: float = 0.0
    """Rows that the picture is shifted down by."""

    def directions(self, columns: Floats, rows: Floats) -> tuple[Floats, Floats]:
        """Return the x and y of the rays through image points, per metre of depth."""
        return (columns - self.cx) / self.focal, (self.cy + self.shift - rows) / self.focal


@dataclass(frozen=True)
class Day:
    """The light and the air."""

    sun: tuple[float, float, float]
    """Unit vector to the sun."""
    sky: int
    """Key of the clouds."""
    haze: float
    """Extinction of the air, per metre."""
    fog: bool
    """The haze hides the sky too."""
    overcast: float
    """0 under a blue sky, 1 where clouds hide the sun."""
    look: Look


@dataclass(frozen=True)
class Windows:
    """Where the solids of a list lie in a grid of rays: half-open rows and columns, int (n,) each."""

    top: Ints
    bottom: Ints
    left: Ints
    right: Ints

    def __iter__(self) -> Iterator[tuple[int, slice, slice]]:
        """Yield the index, the rows and the columns of every solid that the grid can meet."""
        for k in np.flatnonzero((self.top < self.bottom) & (self.left < self.right)):
            yield int(k), slice(self.top[k], self.bottom[k]), slice(self.left[k], self.right[k])


def windows(
    items: Sequence[Item],
    camera_x: float,
    height: float,
    dx: Floats,
    dy: Floats,
    reach: Floats | float = 0.0,
) -> Windows:
    """Return the windows of solids in a grid of rays whose `dx` rises and whose `dy` falls.

    A ray may lie up to `reach` to the right of where `dx` has it.
    """
    eye = np.array([camera_x, height, 0.0])
    low = np.array([item.solid.low for item in items]) - eye
    high = np.array([item.solid.high for item in items]) - eye
    near, far = np.maximum(low[:, 2], NEAR), high[:, 2]
    seen = far > near
    # A bound is farthest out where it is nearest, unless the axis runs through: then it is the other way
    # about.
    first = np.where(low < 0, low / near[:, None], low / np.maximum(far, NEAR)[:, None])
    last = np.where(high < 0, high / np.maximum(far, NEAR)[:, None], high / near[:, None])
    slack = 1e-9
    top, bottom = (np.searchsorted(-dy, side) for side in (-last[:, 1] - slack, -first[:, 1] + slack))
    left, right = (np.searchsorted(dx, side) for side in (first[:, 0] - slack, last[:, 0] + reach + slack))
    return Windows(top, np.where(seen, bottom, 0), left, right)


def trace(
    items: Sequence[Item], camera_x: float, height: float, dx: Floats, dy: Floats
) -> tuple[Floats, npt.NDArray[np.int32]]:
    """Return the depth of the nearest solid on each ray of a grid and its index: inf and -1 in the sky."""
    depth = np.full((dy.size, dx.size), np.inf)
    index = np.full((dy.size, dx.size), -1, np.int32)
    for k, rows, columns in windows(items, camera_x, height, dx, dy):
        rays = Rays(camera_x, height, 0.0, dx[None, columns], dy[rows, None])
        enter, leave = items[k].solid.span(rays)
        here = depth[rows, columns]
        hit = (enter < leave) & (enter > NEAR) & (enter < here)
        np.copyto(here, enter, where=hit)
        index[rows, columns][hit] = k
    return depth, index


def hidden(
    items: Sequence[Item],
    camera_x: float,
    other_x: float,
    height: float,
    dx: Floats,
    dy: Floats,
    depth: Floats,
) -> Bools:
    """Return which points at the given depth something hides from another camera, to the right of the first.

    Points that lie outside the other image are judged like the rest.
    """
    base = other_x - camera_x
    # The other camera's ray through each point: d = focal * base / depth, per focal length.
    toward = dx[None, :] - base / depth
    result = np.zeros(depth.shape, np.bool_)
    # A point lies base / depth to the right of where the other camera has it, and none is nearer than its
    # row's.
    wide = windows(items, other_x, height, dx, dy)
    nearest = np.min(depth, axis=1)
    reach = np.array(
        [
            base / float(np.min(nearest[a:b])) if a < b else 0.0
            for a, b in zip(wide.top, wide.bottom, strict=True)
        ]
    )
    for k, rows, columns in windows(items, other_x, height, dx, dy, reach):
        rays = Rays(other_x, height, 0.0, toward[rows, columns], dy[rows, None])
        enter, leave = items[k].solid.span(rays)
        # The point's own surface is met at its own depth, up to rounding.
        before = enter < depth[rows, columns] * (1.0 - 1e-6)
        result[rows, columns] |= (enter < leave) & (enter > NEAR) & before
    return result


def bands(rows: int, rays_per_row: int) -> Iterator[slice]:
    """Cut rows into bands of about `BAND` rays."""
    step = max(1, BAND // max(rays_per_row, 1))
    for start in range(0, rows, step):
        yield slice(start, min(start + step, rows))


def lit(items: Sequence[Item], sun: tuple[float, float, float], hit: Hit) -> Floats32:
    """Return 1 where the sun reaches level points, given in rows of falling z, and 0 in shadow."""
    result = np.ones(hit.x.size, np.float32)
    sx, sy, sz = sun
    casters = [item.solid for item in items if item.shadow]
    low, high = np.array([c.low for c in casters]), np.array([c.high for c in casters])
    # A shadow reaches from the foot of its caster to where the sun throws its top.
    fall = high[:, 1:2] * np.array([[-sx / sy, 0.0, -sz / sy]])
    low, high = np.minimum(low, low + fall), np.maximum(high, high + fall)
    minus_z = -hit.z
    starts, stops = np.searchsorted(minus_z, -high[:, 2]), np.searchsorted(minus_z, -low[:, 2])
    for k in np.flatnonzero(starts < stops):
        part = slice(starts[k], stops[k])
        x = hit.x[part]
        near = np.flatnonzero((x > low[k, 0]) & (x < high[k, 0]))
        if near.size:
            rays = Rays(x[near], hit.y[part][near], hit.z[part][near], sx, sy, sz)
            enter, leave = casters[k].span(rays)
            result[part.start + near[leave > np.maximum(enter, 1e-6)]] = 0
    return result


def sky_light(day: Day, dx: Floats, dy: Floats) -> Floats32:
    """Return the sky's light along rays, (3, n): a gradient and soft clouds, both at infinity."""
    up = np.maximum(dy, 0.0)
    blend = (up / (up + 0.30)).astype(np.float32)
    base = linear((0.80, 0.87, 0.94)) * (1 - blend) + linear((0.30, 0.52, 0.84)) * blend
    u, v = dx / (up + 0.16), 1.0 / (up + 0.16)
    cloud = np.zeros(dx.shape, np.float32)
    for octave in range(5):
        scale = 1.1 * 2.0**octave
        cloud += np.float32(0.55**octave) * lattice(u * scale, 1.7 * v * scale, day.sky + octave)
    cover = np.clip((cloud - np.float32(0.05)) * np.float32(1.1), 0, 1)
    cover = cover * cover * (3 - 2 * cover) * np.float32(0.85)
    white = linear((1.0, 0.99, 0.98)) * (1 - np.float32(0.22) * np.clip(cloud - np.float32(0.5), 0, 1))
    base += cover * (white - base)
    grey = linear((0.80, 0.82, 0.84)) * (1 + np.float32(0.10) * np.clip(cloud, -1, 1))
    base += np.float32(day.overcast) * (grey - base)
    base *= 1 - np.float32(0.85 * day.look.night)
    result: Floats32 = base
    return result


def light(items: Sequence[Item], day: Day, camera: Camera, columns: Floats, rows: Floats) -> Floats32:
    """Return the light along the rays of a grid of image points, (3, rows, columns), linear."""
    dx, dy = camera.directions(columns, rows)
    depth, index = trace(items, camera.x, camera.height, dx, dy)
    result = np.empty((3, index.size), np.float32)
    flat_depth = depth.reshape(-1)
    air = linear((0.80, 0.85, 0.90)) * np.float32(0.95 - 0.80 * day.look.night)

    order = np.argsort(index, axis=None, kind="stable")
    found, starts = np.unique(index.reshape(-1)[order], return_index=True)
    for k, points in zip(found, np.split(order, starts[1:]), strict=True):
        r, c = points // dx.size, points % dx.size
        if k < 0:
            colour = sky_light(day, dx[c], dy[r])
            if day.fog:
                # A layer of fog 60 m thick.
                clear = np.exp(-day.haze * 60.0 / np.maximum(dy[r], 1e-3)).astype(np.float32)
                colour = air + clear * (colour - air)
        else:
            z = flat_depth[points]
            x, y = camera.x + dx[c] * z, camera.height + dy[r] * z
            colour = surface_light(items, day, items[k], x, y, z)
            clear = np.exp(-day.haze * z).astype(np.float32)
            colour = air + clear * (colour - air)
        result[:, points] = colour
    return result.reshape(3, *index.shape)


def surface_light(items: Sequence[Item], day: Day, item: Item, x: Floats, y: Floats, z: Floats) -> Floats32:
    """Return the light that leaves surface points towards the rig, (3, n)."""
    solid = item.solid
    face = solid.face(x, y, z)
    hit = Hit(x, y, z, z * day.look.pixel, face, *solid.normal(face, x, y, z))
    paint = item.surface.paint(hit, day.look)
    sx, sy, sz = day.sun
    incident = np.maximum(hit.nx * sx + hit.ny * sy + hit.nz * sz, 0.0).astype(np.float32)
    # Open sky above, half of it seen by a wall, and a little light from the ground.
    ambient = (0.62 + 0.38 * hit.ny).astype(np.float32)
    if item.shaded:
        level = hit.ny > 0.5
        order = np.flatnonzero(level)
        bright = np.ones(x.size, np.float32)
        bright[order] = lit(items, day.sun, replace(hit, x=x[order], y=y[order], z=z[order]))
        incident *= bright
        ambient *= contact(items, x, y, z)
    dim = 1.0 - 0.75 * day.look.night
    direct = np.array(SUNLIGHT, np.float32)[:, None] * np.float32(dim * dim * (1.0 - 0.9 * day.overcast))
    diffuse = np.array(SKYLIGHT, np.float32)[:, None] * np.float32(dim * (1.0 + 0.35 * day.overcast))
    colour = paint.albedo * (direct * incident + diffuse * ambient)
    if paint.glow is not None:
        colour += paint.glow
    result: Floats32 = colour
    return result


def contact(items: Sequence[Item], x: Floats, y: Floats, z: Floats) -> Floats32:
    """Return how much of the sky level points see under and beside things that stand on the road, (n,)."""
    result = np.ones(x.size, np.float32)
    for item in items:
        if not item.occludes_sky:
            continue
        (x0, _, z0), (x1, _, z1) = item.solid.low, item.solid.high
        soft = 0.35
        near = np.flatnonzero((x > x0 - soft) & (x < x1 + soft) & (z > z0 - soft) & (z < z1 + soft))
        if near.size:
            ax, az = x[near], z[near]
            inside = np.minimum(np.minimum(ax - x0, x1 - ax), np.minimum(az - z0, z1 - az))
            result[near] *= (1.0 - 0.85 * np.clip((inside + soft) / (2 * soft), 0.0, 1.0)).astype(np.float32)
    return result
