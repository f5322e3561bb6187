"""What a worker does: load a scene, match it, look at one pixel, write files."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from stereopsis import io, scenes
from stereopsis.evaluate import evaluate
from stereopsis.io.formats._limits import at_most
from stereopsis.pipeline import estimate_disparities, estimate_vertical, match
from stereopsis.settings import Settings
from stereopsis.types import Calibration, Disparities, DisparityMap, Image
from stereopsis.view.curve import curve
from stereopsis.view.sources import Files, Scene, Source, Street

Arrays = dict[str, npt.NDArray[Any]]
Facts = dict[str, Any]


class Desk:
    """Does jobs by their names, on the scenes that it was handed."""

    def __init__(self) -> None:
        self._scenes: dict[str, Scene] = {}
        self._functions: dict[str, Callable[..., Any]] = {
            "nothing": lambda *scene: None,
            "load": load,
            "matched": matched,
            "given": given,
            "curve": curve,
            "picture": picture,
            "download": download,
        }

    def keep(self, key: str | None, scene: Scene | None, gone: tuple[str, ...]) -> None:
        """Take what came with a job, and let go of what is not wanted: also where the job itself is not."""
        for old in gone:
            self._scenes.pop(old, None)
        if key is not None and scene is not None:
            self._scenes[key] = scene

    def do(self, function: str, key: str | None, arguments: tuple[Any, ...]) -> Any:
        """Do one job."""
        scene = () if key is None else (self._scenes[key],)
        return self._functions[function](*scene, *arguments)


def load(source: Source, pixels: int) -> Scene:
    """Read or render a scene of at most so many pixels."""
    match source:
        case Street(width, height, seed, options):
            street = scenes.street(width, height, seed, **dict(options))  # type: ignore[arg-type]
            truth, calibration = street.disparity, street.calibration
            return _scene(street.left, street.right, truth, None, None, calibration)
        case Files():
            with at_most(pixels), _told(source):
                return _read(source)


@contextmanager
def _told(files: Files) -> Iterator[None]:
    """Names files by what they are for: where they lie is nobody's business."""
    try:
        yield
    except (ValueError, OSError) as error:
        text = f"{error.filename}: {error.strerror}" if isinstance(error, OSError) else str(error)
        for part in ("left", "right", "truth", "calibration", "disparity"):
            path = getattr(files, part)
            if isinstance(path, Path):
                text = text.replace(str(path), part)
        raise ValueError(text) from error


def _read(files: Files) -> Scene:
    left = io.read_image(files.left) if files.left else None
    right = io.read_image(files.right) if files.right else None
    if left is not None and right is not None and (left.shape, left.dtype) != (right.shape, right.dtype):
        sides = ", ".join(f"{image.shape[1]} x {image.shape[0]} {image.dtype}" for image in (left, right))
        raise ValueError(f"the images of a pair must be alike in size, colours and type, not {sides}")
    disparity = io.read_disparity(files.disparity) if files.disparity else None
    truth = (
        files.read_truth() if files.read_truth else io.read_disparity(files.truth) if files.truth else None
    )
    mask = files.read_mask() if files.read_mask else None
    stated: Any = files.read_calibration() if files.read_calibration else files.calibration
    calibration = io.read_calibration(stated) if isinstance(stated, Path) else stated
    return _scene(left, right, truth, mask, disparity, calibration)


def _scene(
    left: Image | None,
    right: Image | None,
    truth: DisparityMap | None,
    mask: npt.NDArray[np.bool_] | None,
    disparity: DisparityMap | None,
    calibration: Calibration | None,
) -> Scene:
    shapes = {
        name: array.shape[:2]
        for name, array in (("left", left), ("truth", truth), ("mask", mask), ("disparity", disparity))
        if array is not None
    }
    if calibration is not None and calibration.width and calibration.height:
        shapes["calibration"] = (calibration.height, calibration.width)
    if len(set(shapes.values())) > 1:
        told = ", ".join(f"{name} {width} x {height}" for name, (height, width) in shapes.items())
        raise ValueError(f"what belongs to one scene must have one size, not {told}")
    if not shapes:
        raise ValueError("there is neither an image nor a disparity map to look at")
    if left is not None and right is not None:
        disparities = estimate_disparities(left, right)
    else:
        seen = disparity if disparity is not None else truth
        disparities = Disparities(0, 1) if seen is None else _span(seen)
    return Scene(left, right, truth, mask, disparity, calibration, disparities)


def _span(disparity: DisparityMap) -> Disparities:
    found = disparity[np.isfinite(disparity)]
    if not found.size:
        return Disparities(0, 1)
    low, high = (int(end) for end in np.clip((found.min(), found.max()), -(2**24) + 1, 2**24 - 2))
    return Disparities(low - (found.min() < low), high + 1 + (found.max() > high))


def matched(scene: Scene, chosen: Settings) -> tuple[Facts, Arrays]:
    """Match a scene's pair, and score it where the truth is known."""
    pair, ranges = scene.pair(), chosen.disparities or scene.disparities
    chosen = chosen.changed(disparities=ranges)
    if chosen.vertical == "estimate":
        # From the images and the range alone: what else is set does not change it.
        if ranges not in scene.vertical:
            scene.vertical[ranges] = estimate_vertical(pair.left, pair.right, ranges, threads=chosen.threads)
        chosen = chosen.changed(vertical=scene.vertical[ranges])
    result = match(pair, settings=chosen)
    facts = {
        "seconds": result.seconds,
        "stages": dict(result.timings),
        "path": result.path,
        "density": result.density,
        "used": result.settings,
    }
    arrays: Arrays = {"disparity": result.disparity, "confidence": result.confidence, "flags": result.flags}
    return {**facts, "scores": _scores(scene, result.disparity)}, arrays


def given(scene: Scene) -> tuple[Facts, Arrays]:
    """The map that was opened, as if it had been matched here."""
    assert scene.disparity is not None
    density = float(np.mean(np.isfinite(scene.disparity)))
    facts = {"seconds": 0.0, "stages": {}, "path": "opened", "density": density, "used": None}
    return {**facts, "scores": _scores(scene, scene.disparity)}, {"disparity": scene.disparity}


def _scores(scene: Scene, disparity: DisparityMap) -> Facts | None:
    return None if scene.truth is None else evaluate(disparity, scene.truth, scene.mask).to_dict()


def picture(scene: Scene, side: str) -> bytes:
    """An image as an 8-bit PNG to be looked at."""
    image: Image = getattr(scene, side)
    return _file("picture.png", lambda path: io.write_image(path, _eight_bits(image)))


def _eight_bits(image: Image) -> npt.NDArray[np.uint8]:
    if image.dtype == np.uint8:
        return image
    values = image.astype(np.float32)
    low, high = (0.0 if image.dtype == np.uint16 else float(min(values.min(), 0)), float(values.max()))
    grey: npt.NDArray[np.uint8] = np.clip(
        (values - low) * (255 / (high - low) if high > low else 0), 0, 255
    ).astype(np.uint8)
    return grey


def download(scene: Scene, disparity: DisparityMap, calibration: Calibration, name: str) -> bytes:
    """A map as the file that its name asks for."""
    return _file(
        name, lambda path: io.write_output(path, disparity, image=scene.left, calibration=calibration)
    )


def _file(name: str, write: Callable[[Path], None]) -> bytes:
    with tempfile.TemporaryDirectory(prefix="stereopsis-view-") as folder:
        path = Path(folder, name)
        try:
            write(path)
        except ValueError as error:
            raise ValueError(str(error).replace(str(path), name)) from error
        return path.read_bytes()
