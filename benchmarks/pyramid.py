"""What coarse-to-fine matching gains and loses on a large image: a rendered street, enlarged four times.

python benchmarks/pyramid.py [--repeats N] [--levels 2,3,4]

2964 x 2000 pixels, 512 disparities, one thread, whose own processor time counts. Each round matches with and
without `pyramid`, and the ratio is the median over rounds. Scores are over pixels that both cameras see;
*filled* after filling holes as KITTI does.
"""

from __future__ import annotations

import argparse
import statistics
import time

import numpy as np
import numpy.typing as npt
from PIL import Image

import stereopsis as st
from stereopsis.settings import Settings

SIZE, TIMES, DISPARITIES = (741, 500), 4, (0, 512)
SETTINGS = {
    "ZNCC 9, plain": Settings(cost=st.ZNCC(9)),
    "ZNCC 9, left-right check": Settings(cost=st.ZNCC(9), left_right=1),
    "fast": Settings.make("fast"),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--levels", default="2,3,4")
    options = parser.parse_args()
    levels = [None, *(int(level) for level in options.levels.split(","))]
    left, right, truth, seen = scene()
    columns = ("density", "own D1", "own RMSE", "filled D1", "filled RMSE", "s", "÷ without")
    print(f"| settings | pyramid | {' | '.join(columns)} |\n| --- |{' ---: |' * (1 + len(columns))}")
    for name, settings in SETTINGS.items():
        times: dict[int | None, list[float]] = {level: [] for level in levels}
        scores = {}
        for _ in range(options.repeats):
            for level in levels:
                start = time.process_time()
                result = st.match(left, right, settings=settings.changed(
                    disparities=DISPARITIES, pyramid=level, threads=1
                ))  # fmt: skip
                times[level].append(time.process_time() - start)
                scores[level] = st.evaluate(result.disparity, truth, seen)
        for level in levels:
            ratio = statistics.median(a / b for a, b in zip(times[level], times[None], strict=True))
            score = scores[level]
            cells = (
                f"{score.density:.3f} | {score.own.d1:.1%} | {score.own.rmse:.1f} | {score.filled.d1:.1%} | "
                f"{score.filled.rmse:.1f} | {statistics.median(times[level]):.2f} | {ratio:.2f}"
            )
            print(f"| {name} | {level or 'none'} | {cells} |", flush=True)


def scene() -> tuple[
    npt.NDArray[np.uint8], npt.NDArray[np.uint8], npt.NDArray[np.float32], npt.NDArray[np.bool_]
]:
    """Both views enlarged by cubics, the truth by repeating, and what both cameras see of it."""
    small = st.scenes.street(*SIZE, seed=1, gray=True)
    size = tuple(TIMES * side for side in SIZE)
    left, right = (
        np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BICUBIC))
        for image in (small.left, small.right)
    )
    truth, seen = (
        map.repeat(TIMES, axis=0).repeat(TIMES, axis=1)
        for map in (TIMES * small.disparity, ~small.occluded & np.isfinite(small.disparity))
    )
    return left, right, truth, seen


if __name__ == "__main__":
    main()
