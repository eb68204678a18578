"""Photographs from which `procam lens glare` and `procam lens vignetting` measure a camera."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from procam.arrays import AnyArray
from procam.errors import FileFormatError, InputError
from procam.files.images.photos import SUFFIXES, photo_counts, read_photo
from procam.files.images.pixels import read_image
from procam.files.venue.load import load_venue
from procam.interfaces.cli._paths import photographs
from procam.model.optics import CameraModel

FlatPhotosOption = Annotated[
    Path, typer.Option(metavar="DIR", help="Linear 16-bit TIFF or PNG, or EXR; in order of names.")
]


def named_camera(venue: Path, name: str) -> CameraModel:
    """A camera of a venue."""
    cameras = load_venue(venue).cameras
    if name not in cameras:
        raise InputError(
            f"--camera {name!r} is not in venue.toml; choose one of {', '.join(cameras)}"
        )
    return cameras[name]


def linear_photographs(photos: Path) -> list[Path]:
    """The photographs of a folder by name."""
    return photographs(photos, (*SUFFIXES, ".exr"))


def linear_counts(path: Path, camera: CameraModel) -> AnyArray:
    """Linear counts (H, W, C), or light in floating point of an EXR, of the camera's size."""
    if path.suffix.lower() == ".exr":
        pixels = np.asarray(read_image(path), float)
        counts: AnyArray = pixels[..., : 1 if pixels.shape[2] < 3 else 3]
    else:
        photo = read_photo(path)
        if photo.pixels.dtype == np.uint8:
            raise FileFormatError(
                f"{path}: 8 bits are too coarse: veiling glare is below their last step. Develop the raw "
                "file to linear 16-bit TIFF"
            )
        counts = photo_counts(photo, None, camera.sensor)
    height, width = counts.shape[:2]
    if (width, height) != tuple(camera.size):
        raise FileFormatError(
            f"{path}: the photograph has {width}x{height} px, and the camera in venue.toml "
            f"{camera.size[0]}x{camera.size[1]}; export it whole and unrotated, or correct the camera's size"
        )
    return counts
