"""Render a street, match it, score it, save a picture: python examples/first_pair.py [FOLDER]."""

from __future__ import annotations

import sys
from pathlib import Path

import stereopsis as st


def main(folder: Path, width: int = 880, height: int = 400) -> st.Scores:
    folder.mkdir(parents=True, exist_ok=True)
    scene = st.scenes.street(width, height, seed=0, noise=1.5)
    result = st.match(scene.pair, disparities=(0, 96), cost=st.ZNCC(window=15), left_right=1)

    print(f"{result.density:.1%} of the pixels answered in {1000 * result.seconds:.0f} ms")
    for flag in (st.Flag.OCCLUDED, st.Flag.MISMATCHED):
        print(f"{str(flag.name).lower()}: {((result.flags & flag) != 0).mean():.1%}")
    scores = st.evaluate(result.disparity, scene.disparity)
    print(scores)

    st.write_image(folder / "left.png", scene.left)
    st.write_preview(folder / "preview.png", result.disparity)
    st.write_disparity(folder / "disparity.pfm", result.disparity)
    return scores


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out"))
