"""Which build of the kernels runs: the best for this machine, or the one that a test asks for."""

from __future__ import annotations

import os

ENVIRONMENT = "STEREOPSIS_INSTRUCTIONS"
"""Environment variable that forces an instruction set, for tests: one that the core has for this machine."""


def forced() -> str:
    """Name of the instruction set asked for; empty for the best."""
    return os.environ.get(ENVIRONMENT, "")
