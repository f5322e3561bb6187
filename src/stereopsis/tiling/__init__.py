"""Tiles: images larger than the memory at hand, matched piece by piece, from files into files."""

from stereopsis.tiling.large import Job, Tiled, assemble, match, prepare, whole_fits
from stereopsis.tiling.reach import halo, measured

__all__ = ["Job", "Tiled", "assemble", "halo", "match", "measured", "prepare", "whole_fits"]
