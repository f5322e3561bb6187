"""Randomness as a function: an integer hash, and the texture, the normal numbers and the dice made from it.

Everything random in a scene is a hash of where it is, never a stream that is drawn from, so a surface point
has one colour whoever looks at it and however the picture is cut into bands. Only uint32 arithmetic and
operations that IEEE 754 rounds exactly are used here, so the same arguments give the same bytes on every
platform.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Floats32 = npt.NDArray[np.float32]
Words = npt.NDArray[np.uint32]
T = TypeVar("T")

_A, _B, _C = np.uint32(0x9E3779B1), np.uint32(0x85EBCA77), np.uint32(0xC2B2AE3D)
_MIX1, _MIX2 = np.uint32(0x7FEB352D), np.uint32(0x846CA68B)
_WORD = 0xFFFFFFFF


def _scramble(h: Words) -> Words:
    """Wellons' lowbias32 finaliser, in place: every input bit moves half of the output bits."""
    h ^= h >> np.uint32(16)
    h *= _MIX1
    h ^= h >> np.uint32(15)
    h *= _MIX2
    h ^= h >> np.uint32(16)
    return h


def words(*coordinates: npt.ArrayLike) -> Words:
    """Hash integer coordinates (broadcast against each other, any sign) to uniform uint32 words."""
    h: Words = np.ones(np.broadcast_shapes(*(np.shape(c) for c in coordinates)), np.uint32)
    for c in coordinates:
        h *= _A
        h += np.asarray(c, np.int64).astype(np.uint32)
        h = _scramble(h)
    return h


def uniform(*coordinates: npt.ArrayLike) -> Floats32:
    """Hash integer coordinates to float32 in [0, 1)."""
    return (words(*coordinates) >> np.uint32(8)).astype(np.float32) * np.float32(2.0**-24)


def normal(*coordinates: npt.ArrayLike) -> Floats32:
    """Hash integer coordinates to standard normal float32: the sum of twelve uniform bytes, bounded by 6."""
    total: npt.NDArray[np.uint16] = np.zeros(
        np.broadcast_shapes(*(np.shape(c) for c in coordinates)), np.uint16
    )
    for draw in range(3):
        h = words(*coordinates, draw)
        octets = h.reshape(-1).view(np.uint8).reshape(*h.shape, 4)
        for i in range(4):
            total += octets[..., i]
    # Twelve bytes have mean 12 * 127.5 and variance 12 * (256**2 - 1) / 12.
    return (total.astype(np.float32) - np.float32(1530.0)) * np.float32(1.0 / np.sqrt(65535.0))


def _smooth(t: Floats32) -> Floats32:
    return t * t * (np.float32(3.0) - np.float32(2.0) * t)


def lattice(u: Floats, v: Floats, key: npt.ArrayLike) -> Floats32:
    """Value noise on the unit lattice: float32 in [-1, 1), continuous with its first derivative."""
    iu, iv = np.floor(u), np.floor(v)
    fu, fv = _smooth((u - iu).astype(np.float32)), _smooth((v - iv).astype(np.float32))
    # float64 -> int64 -> uint32 wraps as two's complement everywhere; float -> uint32 of a negative does not.
    a0 = iu.astype(np.int64).astype(np.uint32) * _A
    b0 = iv.astype(np.int64).astype(np.uint32) * _B
    b0 += np.asarray(key, np.int64).astype(np.uint32) * _C
    a1, b1 = a0 + _A, b0 + _B

    def corner(a: Words, b: Words) -> Floats32:
        h = a ^ b
        h *= _MIX1
        h ^= h >> np.uint32(15)
        h *= _MIX2
        h >>= np.uint32(8)
        return h.astype(np.float32)

    upper, lower = corner(a0, b0), corner(a0, b1)
    upper += fu * (corner(a1, b0) - upper)
    lower += fu * (corner(a1, b1) - lower)
    upper += fv * (lower - upper)
    upper *= np.float32(2.0**-23)
    upper -= np.float32(1.0)
    return upper


def texture(
    u: Floats,
    v: Floats,
    size: Floats | float,
    key: int,
    *,
    stretch_u: float = 0.0,
    stretch_v: float = 0.0,
    finest: float = 0.008,
    octaves: int = 4,
) -> Floats32:
    """Band-limited noise of a surface: octaves of `lattice` whose cells follow the size of a pixel on it.

    The finest cell is between two and four pixels wide and the octaves fade in and out with distance, so that
    far texture neither aliases nor goes flat. The result depends on the surface point alone, so two cameras
    at the same depth see the same colour.

    Parameters
    ----------
    u, v : ndarray of float64, (n,)
        Coordinates on the surface in metres.
    size : ndarray of float64, (n,), or float
        Width of a pixel at that depth in metres.
    key : int
        Selects one of 2**20 independent textures.
    stretch_u, stretch_v : float
        1 / metres: a cell of size ``c`` is drawn ``max(1, c * stretch)`` times longer along that axis, which
        undoes the foreshortening of a surface that recedes.
    finest : float
        Grain of the material in metres: no cell is smaller, however near the surface.
    octaves : int
        How many octaves.

    Returns
    -------
    ndarray of float32, (n,)
        Zero mean, a standard deviation near 0.4.
    """
    mantissa, level = np.frexp(np.maximum(np.multiply(size, 2.0), finest))
    fade = (2.0 - 2.0 * mantissa).astype(np.float32)
    total: Any = np.float32(0.0)
    for octave in range(octaves):
        step = level + octave
        cell = np.ldexp(1.0, step)
        noise = lattice(
            u / (cell * np.maximum(1.0, cell * stretch_u)),
            v / (cell * np.maximum(1.0, cell * stretch_v)),
            step.astype(np.int64) + 4096 * key,
        )
        if octave == 0:
            noise *= fade
        elif octave == octaves - 1:
            noise *= np.float32(1.0) - fade
        total = total + noise
    result: Floats32 = total * np.float32(1.0 / np.sqrt(octaves - 1.0))
    return result


class Dice:
    """Throws for laying a scene out: a counter through the hash, the same with every version of NumPy."""

    def __init__(self, *key: int) -> None:
        self._key = key
        self._count = 0

    def throw(self) -> float:
        """Return a float in [0, 1)."""
        self._count += 1
        h = 1
        for part in (*self._key, self._count):
            h = (h * 0x9E3779B1 + part) & _WORD
            h = ((h ^ (h >> 16)) * 0x7FEB352D) & _WORD
            h = ((h ^ (h >> 15)) * 0x846CA68B) & _WORD
            h ^= h >> 16
        return h * 2.0**-32

    def between(self, low: float, high: float) -> float:
        return low + (high - low) * self.throw()

    def integer(self, low: int, high: int) -> int:
        """Return an integer in low ... high, both included."""
        return low + int(self.throw() * (high - low + 1))

    def choice(self, options: Sequence[T]) -> T:
        return options[self.integer(0, len(options) - 1)]

    def chance(self, probability: float) -> bool:
        return self.throw() < probability
