"""From a pair and its calibration to depth and a point cloud: python examples/depth.py [FOLDER]."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import stereopsis as st

FARTHEST = 65.0  # metres: at the default size a tenth of a pixel is a metre of depth there


def main(folder: Path, width: int = 880, height: int = 400) -> float:
    folder.mkdir(parents=True, exist_ok=True)
    scene = st.scenes.street(width, height, seed=0)
    result = st.match(scene.pair, preset="fast", disparities=(0, 96))

    metres = st.depth(result.disparity, scene.calibration)
    metres[metres > FARTHEST] = np.nan
    truth = st.depth(scene.disparity, scene.calibration)
    error = float(np.nanmedian(np.abs(metres - truth) / truth))
    print(f"nearest {np.nanmin(metres):.2f} m, median error {error:.2%} of the depth")
    np.save(folder / "depth.npy", metres)

    xyz, rgb = st.points(result.disparity, scene.calibration, scene.left, max_depth=FARTHEST)
    st.write_ply(folder / "points.ply", xyz, rgb)
    print(f"{len(xyz)} points")
    return error


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out"))
