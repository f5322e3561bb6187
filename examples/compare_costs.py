"""Costs and windows on a street whose right image is brighter: python examples/compare_costs.py."""

from __future__ import annotations

from collections.abc import Sequence

import stereopsis as st

COSTS = (st.SAD, st.SSD, st.ZSSD, st.NCC, st.ZNCC)  # ZSAD takes its time with large windows


def main(
    width: int = 880, height: int = 400, windows: Sequence[int] = (7, 15, 31)
) -> dict[tuple[str, int], float]:
    """Print and return the fraction of pixels within 1 px of the truth, for each cost and window."""
    scene = st.scenes.street(width, height, seed=0, noise=1.5, exposure=1.1, offset=5.0)
    seen = ~scene.occluded  # what the right image does not show cannot be matched

    print("within 1 px   " + "".join(f"{f'{size} x {size}':>10}" for size in windows))
    within = {}
    for cost in COSTS:
        for size in windows:
            result = st.match(scene.pair, disparities=(0, 96), cost=cost(window=size))
            within[cost.__name__, size] = st.evaluate(result.disparity, scene.disparity, seen).all.within_1
        cells = "".join(f"{within[cost.__name__, size]:>10.1%}" for size in windows)
        print(f"{cost.__name__:<14}{cells}")
    return within


if __name__ == "__main__":
    main()
