"""Synthetic scenes with exact truth: a street for the eye, a slanted plane for the tests of a matcher."""

from stereopsis.scenes._plane import plane
from stereopsis.scenes._scene import Scene
from stereopsis.scenes._street import street

__all__ = ["Scene", "plane", "street"]
