"""What window costs take on images of 12 and 16 bits and on floats, beside the same image in 8 bits.

python benchmarks/pixels.py [LEFT RIGHT] [--window 21] [--repeats 9] [--checks] [--colour]

881 x 400 pixels, 128 disparities, one thread, whose own processor time counts. Without a pair, a
rendered street. Each round matches all kinds of pixels once; ratios are the median over rounds.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time

import numpy as np
import numpy.typing as npt

import stereopsis as st

COSTS = (st.SAD, st.SSD, st.ZSSD, st.NCC, st.ZNCC)
KINDS = ("8 bits", "12 bits", "16 bits", "float")
WIDTH, HEIGHT, DISPARITIES = 881, 400, (0, 128)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("pair", nargs="*", metavar="IMAGE")
    parser.add_argument("--window", type=int, default=21)
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--checks", action="store_true", help="with left-right check and uniqueness")
    parser.add_argument("--colour", action="store_true", help="sum over the three channels, not over grey")
    options = parser.parse_args()
    if len(options.pair) not in (0, 2):
        raise ValueError("a left and a right image, or none")
    if options.repeats < 1:
        raise ValueError(f"--repeats must be at least 1, not {options.repeats}")
    pair = st.read_pair(*options.pair) if options.pair else st.scenes.street(WIDTH, HEIGHT, seed=0).pair
    images = [[as_kind(kind, image, options.colour) for image in (pair.left, pair.right)] for kind in KINDS]
    chosen = st.Settings(disparities=st.Disparities(*DISPARITIES), subpixel="parabola", threads=1)
    chosen = chosen.changed(channels="separate") if options.colour else chosen
    chosen = chosen.changed(left_right=1, uniqueness=5) if options.checks else chosen
    print(f"| cost | ms, 8 bits | {' | '.join(f'{kind} ÷ 8' for kind in KINDS[1:])} |")
    print(f"| --- |{' ---: |' * len(KINDS)}")
    for cost in COSTS:
        times: list[list[float]] = [[] for _ in KINDS]
        for _ in range(options.repeats):
            for of_kind, (left, right) in zip(times, images, strict=True):
                start = time.process_time()
                st.match(left, right, settings=chosen.changed(cost=cost(options.window)))
                of_kind.append(time.process_time() - start)
        cells = [f"{1000 * statistics.median(times[0]):.1f}"]
        for of_kind in times[1:]:
            ratio = statistics.median(a / b for a, b in zip(of_kind, times[0], strict=True))
            cells.append(f"{ratio:.1f}")
        print(f"| {cost.__name__} {options.window} | {' | '.join(cells)} |", flush=True)


def as_kind(kind: str, image: npt.NDArray[np.generic], colour: bool) -> npt.NDArray[np.generic]:
    """The image's levels, of which only the first kind knows whole ones where grey is the channels' mean."""
    levels = np.array(image, np.float32)
    levels = levels.mean(axis=2) if levels.ndim == 3 and not colour else levels
    if kind == "8 bits":
        return levels.astype(np.uint8)
    # With a pixel between two levels they are not matched as bytes.
    levels[0, 0] += np.float32(0.3)
    if kind == "float":
        return levels / np.float32(255)
    return (levels * np.float32({"12 bits": 16, "16 bits": 256}[kind])).astype(np.uint16)


if __name__ == "__main__":
    try:
        main()
    except (ValueError, OSError) as error:
        sys.exit(f"error: {error}")
