"""The demonstration: render a street, match it, score it, write all of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from stereopsis.evaluate import Scores, error_map, evaluate
from stereopsis.io import write_calibration, write_disparity, write_image, write_output
from stereopsis.pipeline import match
from stereopsis.scenes import street
from stereopsis.settings import Settings
from stereopsis.types import Result


@dataclass(frozen=True)
class Demonstration:
    """What `demonstrate` made.

    Attributes
    ----------
    result : Result
        The matched pair.
    scores : Scores
        Against the scene's exact truth, over every pixel that shows a surface.
    files : tuple of Path
        Everything that was written, in that order.
    """

    result: Result
    scores: Scores
    files: tuple[Path, ...]


def demonstrate(folder: Path, width: int, height: int, seed: int, settings: Settings) -> Demonstration:
    """Render a street scene, match it, score it and write everything into a folder.

    Parameters
    ----------
    folder : Path
        Where the files go; it is made if it is not there. Files of the same names are replaced.
    width, height : int
        Size of the images in pixels.
    seed : int
        Which street.
    settings : Settings
        How to match.

    Returns
    -------
    Demonstration

    Raises
    ------
    ValueError
        If a size or the seed is out of range, or the street so small that nothing of it is matched. Then
        nothing has been written.
    OSError
        If the folder or a file cannot be written.
    """
    scene = street(width, height, seed)
    result = match(scene.pair, settings=settings)
    if not (result.disparity > 0).any():
        raise ValueError(f"no pixel of a street of {width} x {height} pixels was matched: it must be larger")
    scores = evaluate(result.disparity, scene.disparity)
    errors = error_map(result.disparity, scene.disparity)

    folder.mkdir(parents=True, exist_ok=True)
    inputs = [folder / name for name in ("left.png", "right.png", "truth.pfm", "calib.txt")]
    write_image(inputs[0], scene.left)
    write_image(inputs[1], scene.right)
    write_disparity(inputs[2], scene.disparity)
    write_calibration(inputs[3], scene.calibration)

    outputs = [folder / name for name in ("disparity.png", "disparity.pfm", "preview.png", "points.ply")]
    for path in outputs:
        write_output(path, result.disparity, image=scene.left, calibration=scene.calibration)
    picture = folder / "error.png"
    write_image(picture, errors)
    return Demonstration(result=result, scores=scores, files=(*inputs, *outputs, picture))
