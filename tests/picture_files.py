"""Pictures with attributes that procam itself does not write, as cameras and other programs do."""

from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from procam.files.images.profiles import NAMED

TYPES = {"float16": "half", "float32": "float"}


def spec_of(pixels: np.ndarray, **attributes: object) -> oiio.ImageSpec:
    """Of pixels (H, W, C); in names of attributes `__` stands for a colon, tuples are floats."""
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, TYPES.get(str(pixels.dtype), str(pixels.dtype)))
    for key, value in attributes.items():
        name = key.replace("__", ":")
        if isinstance(value, tuple):
            spec.attribute(name, oiio.TypeDesc(f"float[{len(value)}]"), value)
        else:
            spec.attribute(name, value)
    return spec


def write_spec_as_is(path: Path, pixels: np.ndarray, spec: oiio.ImageSpec) -> Path:
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec), output.geterror()
    assert output.write_image(np.ascontiguousarray(pixels)), output.geterror()
    output.close()
    return path


def write_with_header(path: Path, pixels: np.ndarray, **attributes: object) -> Path:
    """Pixels (H, W[, C]) with attributes."""
    planes = pixels if pixels.ndim == 3 else pixels[..., None]
    return write_spec_as_is(path, planes, spec_of(planes, **attributes))


def write_wide_gamut(path: Path, size: int) -> Path:
    """A square of grey light in primaries of Rec.2020, which are noted in its header."""
    grey = np.full((size, size, 3), 0.5, np.float32)
    return write_with_header(path, grey, chromaticities=tuple(NAMED["Rec.2020"]))
