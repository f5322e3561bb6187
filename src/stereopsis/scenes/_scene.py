"""What a synthetic scene hands out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from stereopsis.types import Calibration, Disparities, DisparityMap, Image, Pair


@dataclass(frozen=True, eq=False)
class Scene:
    """A rendered pair and everything that is known about it.

    Attributes
    ----------
    left, right : ndarray
        ``(H, W, 3)`` RGB or ``(H, W)`` grey; uint8, uint16 (12 bits: 0 ... 4095) or float32 (0 ... 255).
    disparity : ndarray of float32, (H, W)
        Truth of the left view at pixel centres; NaN in the sky.
    right_disparity : ndarray of float32, (H, W)
        Truth of the right view as it was rendered: positive too, the match is at ``x + d`` on the left. NaN
        in the sky.
    occluded : ndarray of bool, (H, W)
        Left pixels whose surface point the right image does not show: hidden by something nearer, or out of
        view.
    out_of_view : ndarray of bool, (H, W)
        The part of `occluded` whose match lies outside the right image, ``x - d`` outside ``[-0.5, W -
        0.5)``.
    sky : ndarray of bool, (H, W)
        Left pixels that meet no surface.
    textured : ndarray of bool, (H, W)
        Left pixels on surfaces with texture of their own: asphalt, paving, walls, roofs, foliage; not sky,
        bodywork, glass of cars, poles or signs.
    calibration : Calibration
        The rig's geometry.
    name : str
        What messages and tables call the scene.
    """

    left: Image
    right: Image
    disparity: DisparityMap
    right_disparity: DisparityMap
    occluded: npt.NDArray[np.bool_]
    out_of_view: npt.NDArray[np.bool_]
    sky: npt.NDArray[np.bool_]
    textured: npt.NDArray[np.bool_]
    calibration: Calibration
    name: str

    @property
    def pair(self) -> Pair:
        """What a matcher may see: the images and the calibration, nothing of the truth."""
        return Pair(self.left, self.right, self.calibration, self.name)

    @property
    def disparities(self) -> Disparities:
        """The smallest range that holds every true disparity of the left view.

        Ground truth knowledge, meant for tests: a matcher that is to be measured must find its range by
        itself.
        """
        known = self.disparity[np.isfinite(self.disparity)]
        if not known.size:
            return Disparities(0, 1)
        return Disparities(int(np.floor(known.min())), int(np.ceil(known.max())) + 1)
