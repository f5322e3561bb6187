"""Images: one file in, one array out, and back."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stereopsis.io._errors import StrPath, naming
from stereopsis.io.atomic import write_bytes
from stereopsis.io.calibration import read_calibration
from stereopsis.io.formats import Raster, jpeg, load, netpbm, npy, pfm, png, tiff
from stereopsis.types import Calibration, Image, Pair


def read_image(path: StrPath) -> Image:
    """Read a PNG, JPEG, TIFF, PGM, PPM, PFM or NPY image; the content decides, not the file's name.

    Values are as the file has them: 12-bit data in a 16-bit file stays within 0 … 4095. Palettes become
    colour, 1 bit becomes 0 and 255, alpha is dropped, doubles become float32; of a TIFF the first page is
    read. JPEG gives the bytes of ``cv2.imread``, in RGB order. The Exif or TIFF orientation is obeyed, as
    ``cv2.imread`` does.

    Parameters
    ----------
    path : str or path-like
        The file.

    Returns
    -------
    ndarray, (H, W) or (H, W, 3)
        uint8, uint16 or float32; RGB; C-contiguous, native byte order.

    Raises
    ------
    OSError
        The file cannot be read; `FileNotFoundError` when it is not there.
    ValueError
        Its content is not an image, is truncated or damaged, is larger than 2²⁸ pixels, has a pixel type or
        colours that are not supported (signed or 32-bit integers, CMYK), or holds NaN or infinity.
    """
    raster = load(path)
    with naming(path):
        return as_image(raster)


def as_image(raster: Raster) -> Image:
    """The pixels of a raster, when they are an image; see `read_image`."""
    pixels = raster.pixels
    if pixels.ndim == 3 and pixels.shape[2] != 3:
        raise ValueError(f"an image has 1 or 3 channels, not {pixels.shape[2]}")
    if pixels.dtype.kind == "f":
        with np.errstate(over="ignore", invalid="ignore"):
            pixels = pixels.astype(np.float32)
        broken = pixels.size - int(np.isfinite(pixels).sum())
        if broken:
            raise ValueError(f"{broken} of {pixels.size} values are NaN or infinite; an image's are finite")
    elif pixels.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"an image holds uint8, uint16 or float32, not {pixels.dtype}")
    return np.array(pixels, order="C")


def write_image(path: StrPath, image: Image) -> None:
    """Write an image in the format of the file's suffix, whole or not at all.

    ========================  ==========================
    suffix                    pixels
    ========================  ==========================
    ``.png``                  uint8, uint16
    ``.jpg``, ``.jpeg``       uint8, quality 95
    ``.tif``, ``.tiff``       uint8, uint16, float32
    ``.pgm``, ``.ppm``        uint8, uint16; grey, RGB
    ``.pfm``                  float32
    ``.npy``                  uint8, uint16, float32
    ========================  ==========================

    Parameters
    ----------
    path : str or path-like
        The file; an existing one is replaced.
    image : ndarray, (H, W) or (H, W, 3)
        uint8, uint16 or float32; RGB; any strides.

    Raises
    ------
    TypeError
        `image` is not an array of one of these types.
    ValueError
        Its shape is another, or the format of the suffix does not hold it.
    OSError
        The file cannot be written.
    """
    image = check_image("image", image)
    with naming(path):
        data = _encode(Path(path).suffix.lower(), image)
    write_bytes(path, data)


def _encode(suffix: str, image: Image) -> bytes:
    depth, grey = image.dtype.name, image.ndim == 2
    match suffix:
        case ".png" if depth != "float32":
            return png.encode(image)
        case ".jpg" | ".jpeg" if depth == "uint8":
            return jpeg.encode(image)
        case ".tif" | ".tiff":
            return tiff.encode(image)
        case ".pgm" if depth != "float32" and grey:
            return netpbm.encode(image)
        case ".ppm" if depth != "float32" and not grey:
            return netpbm.encode(image)
        case ".pfm" if depth == "float32":
            return pfm.encode(image)
        case ".npy":
            return npy.encode(image)
        case ".png" | ".jpg" | ".jpeg" | ".pgm" | ".ppm" | ".pfm":
            colours = "grey" if grey else "RGB"
            raise ValueError(f"{suffix} does not hold {colours} pixels of {depth}; .tif holds every image")
        case _:
            raise ValueError(
                f"unknown suffix {suffix!r}; .png, .jpg, .tif, .pgm, .ppm, .pfm and .npy are written"
            )


def check_image(name: str, image: Image) -> Image:
    """`image` itself, when its type and shape are an image's.

    Raises
    ------
    TypeError, ValueError
        Naming the argument `name`.
    """
    if not isinstance(image, np.ndarray) or image.dtype not in (np.uint8, np.uint16, np.float32):
        what = image.dtype if isinstance(image, np.ndarray) else type(image).__name__
        raise TypeError(f"{name} must be an array of uint8, uint16 or float32, not {what}")
    if image.ndim not in (2, 3) or image.shape[2:] not in ((), (3,)) or image.size == 0:
        raise ValueError(f"{name} must have the shape (H, W) or (H, W, 3), not {image.shape}")
    return image


def read_pair(
    left: StrPath,
    right: StrPath,
    calibration: StrPath | Calibration | None = None,
    name: str | None = None,
) -> Pair:
    """Read a rectified pair.

    Parameters
    ----------
    left, right : str or path-like
        The images; see `read_image`.
    calibration : str, path-like or Calibration, optional
        The pair's geometry, or the file that holds it; see `read_calibration`.
    name : str, optional
        What messages and tables call the pair; the left file's name without its suffix by default.

    Returns
    -------
    Pair

    Raises
    ------
    OSError
        A file cannot be read.
    ValueError
        A file is not what it should be, the two images differ in size, colours or type, or the calibration
        is for another size.
    """
    images = read_image(left), read_image(right)
    if images[0].shape != images[1].shape or images[0].dtype != images[1].dtype:
        sides = [f"{path} is {_describe(image)}" for path, image in zip((left, right), images, strict=True)]
        raise ValueError(f"the images of a pair must be alike: {sides[0]}, {sides[1]}")
    if calibration is not None and not isinstance(calibration, Calibration):
        calibration = read_calibration(calibration)
    if calibration is not None:
        height, width = images[0].shape[:2]
        if (calibration.width or width, calibration.height or height) != (width, height):
            size = f"{calibration.width} x {calibration.height}"
            raise ValueError(f"the calibration is for {size} pixels, but {left} has {width} x {height}")
    return Pair(*images, calibration=calibration, name=Path(left).stem if name is None else name)


def _describe(image: Image) -> str:
    return f"{image.shape[1]} x {image.shape[0]} {'grey' if image.ndim == 2 else 'RGB'} {image.dtype}"
