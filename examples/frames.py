"""A loop over frames, as on a robot: python examples/frames.py [FOLDER]."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import stereopsis as st


def frames(count: int, width: int, height: int) -> Iterator[st.Pair]:
    """What two cameras would give, rectified: ``st.Pair(left, right)`` of uint8 arrays."""
    for seed in range(count):
        yield st.scenes.street(width, height, seed=seed).pair


def main(folder: Path, count: int = 5, width: int = 880, height: int = 400) -> list[float]:
    folder.mkdir(parents=True, exist_ok=True)
    settings = st.PRESETS["balanced"].changed(disparities=(0, 96))
    nearest = []
    for number, pair in enumerate(frames(count, width, height)):
        assert pair.calibration is not None
        start = time.perf_counter()
        result = st.match(pair, settings=settings)
        metres = st.depth(result.disparity, pair.calibration)
        metres[(result.flags & st.Flag.FILLED) != 0] = np.nan  # seen by both cameras, not guessed
        took = time.perf_counter() - start
        nearest.append(float(np.nanmin(metres)))
        seen = np.isfinite(metres).mean()
        print(f"frame {number}: {took * 1000:.0f} ms, {seen:.0%} seen, nearest {nearest[-1]:.2f} m")
        st.write_depth(folder / f"{number:04}-depth.png", metres)
    return nearest


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out"))
