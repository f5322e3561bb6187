"""DrivingStereo, pairs kept side by side in one flat folder.

G. Yang et al.: DrivingStereo: a large-scale dataset for stereo matching in autonomous driving scenarios. CVPR
2019, doi:10.1109/CVPR.2019.00099. The truth comes from a lidar: sparse, and not split by occlusion.
"""

from __future__ import annotations

from pathlib import Path

from stereopsis.datasets.sample import Sample, present, views

NAME = "DrivingStereo"
LAYOUT = "NAME-left.jpg, NAME-right.jpg, NAME-disparity.png"


def find(folder: Path) -> tuple[Sample, ...]:
    """List the pairs of a folder, none if it is laid out otherwise."""
    return tuple(
        _sample(left, left.name.removesuffix(f"-left{left.suffix}"))
        for left in sorted(folder.glob("*-left.*"))
        if left.suffix in (".jpg", ".png")
    )


def _sample(left: Path, name: str) -> Sample:
    return Sample(
        name,
        *views(left, left.with_name(f"{name}-right{left.suffix}")),
        truth_file=present(left.with_name(f"{name}-disparity.png")),
    )
