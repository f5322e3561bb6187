"""Tiles: images larger than the memory at hand, matched piece by piece."""
