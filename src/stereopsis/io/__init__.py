"""Files: images, disparity maps, calibrations, point clouds, pictures."""

from stereopsis.io.calibration import read_calibration, write_calibration
from stereopsis.io.disparity import read_disparity, write_disparity
from stereopsis.io.images import read_image, read_pair, write_image
from stereopsis.io.info import describe
from stereopsis.io.output import OUTPUT_SUFFIXES, check_output, write_output
from stereopsis.io.points import depth, points, write_depth, write_ply
from stereopsis.io.preview import colorize, write_preview

__all__ = [
    "OUTPUT_SUFFIXES",
    "check_output",
    "colorize",
    "depth",
    "describe",
    "points",
    "read_calibration",
    "read_disparity",
    "read_image",
    "read_pair",
    "write_calibration",
    "write_depth",
    "write_disparity",
    "write_image",
    "write_output",
    "write_ply",
    "write_preview",
]
