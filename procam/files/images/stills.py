"""Content pictures: read as linear light, or changed with everything else in their file kept.

`read_picture` is for light alone. `read_still` and `write_still` keep the other
channels, attributes, bit depth and straight alpha of a file whose colours are replaced.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio

from procam.arrays import AnyArray, FloatArray, Image
from procam.errors import FileFormatError
from procam.files.images.layers import CHECKSUM, RGB
from procam.files.images.pixels import (
    MOST_MIB,
    STORED_AS,
    read_spec,
    require_suffix,
    write_spec,
)
from procam.files.images.profiles import converted
from procam.maths.light.transfer import transfer

FORMAT_ATTRIBUTES = (
    "compression",
    "planarconfig",
    "oiio:BitsPerSample",
    "oiio:RowsPerChunk",
    "oiio:subimages",
)
FORMAT_PREFIXES = ("tiff:", "png:", "openexr:")
COLOUR_SPACES = {
    "srgb": "srgb",
    "lin": "linear",
    "linear": "linear",
    "g22": "gamma2.2",
    "g24": "gamma2.4",
    "g26": "gamma2.6",
}  # transfer function by the first part of OpenImageIO's name of a colour space


def read_picture(path: Path) -> tuple[Image, str]:
    """Content (H, W, 3) in linear light, and what became of its colour profile ("" for none).

    It is decoded by the transfer function that the file states; without one, EXR is linear, others sRGB.
    """
    still = read_still(path)
    if still.transfer is None:
        space = still.spec.get_string_attribute("oiio:ColorSpace")
        raise FileFormatError(
            f"{path} states the transfer function {space}, which procam does not know; convert it to sRGB"
        )
    picture = still.rgb
    if picture.dtype.kind != "f":
        picture = picture / np.float32(np.iinfo(picture.dtype).max)
    require_finite(path, picture)
    return transfer(still.transfer).decode(picture).astype(np.float32), still.note


def square_edge(picture: AnyArray, name: str) -> int:
    """Edge [px] of a dome master (N, N, ...); refuses what is not square. `name` is for the message."""
    height, width = picture.shape[:2]
    if height != width:
        raise FileFormatError(
            f"{name}: {width}x{height} px is no dome master, which is square; crop or pad it"
        )
    return height


def colour_places(path: Path, spec: oiio.ImageSpec) -> list[int]:
    """Positions of R, G and B among a picture's channels; refuses a picture that lacks one."""
    lookup = {name.upper(): i for i, name in enumerate(spec.channelnames)}
    if not set(RGB) <= set(lookup):
        raise FileFormatError(
            f"{path} has the channels {', '.join(spec.channelnames)}; R, G and B are needed. Convert "
            "it to RGB"
        )
    return [lookup[c] for c in RGB]


def require_finite(name: object, picture: FloatArray) -> None:
    """Refuse light that is NaN or infinite; `name` is the file's, for the message."""
    bad = int((~np.isfinite(picture)).sum())
    if bad:
        raise FileFormatError(
            f"{name}: {bad} values are NaN or infinite; render the frame again or paint over the holes"
        )


@dataclass(frozen=True, slots=True)
class Still:
    """A picture as stored.

    Attributes
    ----------
    pixels : (H, W, C) all channels in the file's own type. rgb : (H, W, 3) the colours.
    places : which channels R, G and B are. spec : the file's header. suffix : of its name.
    note : what became of a colour profile; "" for none. converted : whether `rgb` were converted from it.
    """

    pixels: AnyArray
    rgb: AnyArray
    places: tuple[int, ...]
    spec: oiio.ImageSpec
    suffix: str
    note: str = ""
    converted: bool = False

    @property
    def transfer(self) -> str | None:
        """Name of the transfer function in the file's header; None where it has one without a name."""
        return _stated_transfer(self.spec, self.rgb)


def read_still(path: Path) -> Still:
    """Read a picture with all its channels and attributes.

    Raises
    ------
    FileFormatError
        No complete RGB picture; more than one; premultiplied alpha that is not full everywhere.
    """
    pixels, spec = read_spec(path)
    parts = spec.get_int_attribute("oiio:subimages", 1)
    if parts > 1:
        raise FileFormatError(f"{path} holds {parts} pictures; one is needed. Split the file")
    places = colour_places(path, spec)
    _refuse_premultiplied(path, pixels, spec)
    whole = _display_window(path, pixels, spec)
    plain = places == list(range(whole.shape[2]))
    rgb = whole if plain else np.ascontiguousarray(whole[..., places])
    rgb, note, done = converted(path, rgb, spec, _stated_transfer(spec, rgb))
    return Still(whole, rgb, tuple(places), spec, path.suffix, note, done)


def _stated_transfer(spec: oiio.ImageSpec, rgb: AnyArray) -> str | None:
    space = spec.get_string_attribute("oiio:ColorSpace")
    if not space:
        return "linear" if rgb.dtype.kind == "f" else "srgb"
    return COLOUR_SPACES.get(space.lower().split("_")[0])


def write_still(path: Path, rgb: AnyArray, like: Still, transfer: str) -> None:
    """Write colours (H, W, 3) durably with the other channels and the attributes of `like`.

    The type is that of `rgb`. A type or a suffix other than the source's changes the other channels'
    type and drops attributes that only the source's format has. `transfer` is the name of the transfer
    function of `rgb`.
    """
    require_suffix(path)
    spec = oiio.ImageSpec(like.spec)
    stored = like.pixels
    if rgb.dtype != like.rgb.dtype:
        spec.set_format(STORED_AS[str(rgb.dtype)])
        stored = _as_type(stored, rgb.dtype)
        spec.erase_attribute("oiio:BitsPerSample")
    if transfer != like.transfer:
        spec.attribute("oiio:ColorSpace", _space(transfer))
        spec.erase_attribute("oiio:Gamma")
    if path.suffix != like.suffix:
        _forget_format(path, spec)
    if path.suffix == ".png":
        spec.attribute("png:compressionLevel", 1)
    spec.erase_attribute(CHECKSUM)  # of the source's pixels
    write_spec(path, _with_colours(stored, rgb, like.places), spec)


def _with_colours(stored: AnyArray, rgb: AnyArray, places: tuple[int, ...]) -> AnyArray:
    if places == tuple(range(stored.shape[2])):
        return np.ascontiguousarray(rgb)
    whole = np.array(stored)
    whole[..., places] = rgb
    return whole


def _forget_format(path: Path, spec: oiio.ImageSpec) -> None:
    """Drop attributes that only the source's format has, and choose the new one's compression."""
    for attribute in list(spec.extra_attribs):
        if attribute.name in FORMAT_ATTRIBUTES or attribute.name.startswith(FORMAT_PREFIXES):
            spec.erase_attribute(attribute.name)
    spec.attribute("compression", "" if path.suffix == ".png" else "zip")
    spec.tile_width = spec.tile_height = 0


def _space(transfer: str) -> str:
    for start, name in COLOUR_SPACES.items():
        if name == transfer:
            return f"{start}_rec709_scene"
    return ""


def _as_type(values: AnyArray, dtype: np.dtype[Any]) -> AnyArray:
    """Channels as another type; full of an integer is 1.0."""
    peak = 1.0 if values.dtype.kind == "f" else float(np.iinfo(values.dtype).max)
    share = np.asarray(values, np.float32) / np.float32(peak)
    if dtype.kind == "f":
        return share.astype(dtype)
    top = np.iinfo(dtype).max
    return np.rint(np.clip(np.nan_to_num(share), 0, 1) * top).astype(dtype)


def _refuse_premultiplied(path: Path, pixels: AnyArray, spec: oiio.ImageSpec) -> None:
    place = spec.alpha_channel
    if place < 0 or spec.get_int_attribute("oiio:UnassociatedAlpha"):
        return
    alpha = pixels[..., place]
    full = 1.0 if alpha.dtype.kind == "f" else np.iinfo(alpha.dtype).max
    thin = int((alpha < full).sum())
    if thin:
        raise FileFormatError(
            f"{path} has premultiplied alpha below 1 in {thin} pixels; unpremultiply or flatten it"
        )


def _display_window(path: Path, pixels: AnyArray, spec: oiio.ImageSpec) -> AnyArray:
    """The whole picture where a renderer has stored a part of it (EXR's data window), the rest black."""
    shape = (spec.full_height, spec.full_width)
    top, left = spec.y - spec.full_y, spec.x - spec.full_x
    if pixels.shape[:2] == shape and not (top or left):
        return pixels
    if math.prod(shape) * pixels.shape[2] * pixels.itemsize > MOST_MIB << 20:
        raise FileFormatError(
            f"{path}: its display window has {shape[1]}x{shape[0]} px, more than {MOST_MIB} MiB; it is "
            "damaged, or must be cropped"
        )
    whole = np.zeros((*shape, pixels.shape[2]), pixels.dtype)
    rows = slice(max(top, 0), max(top, 0, min(top + pixels.shape[0], shape[0])))
    columns = slice(max(left, 0), max(left, 0, min(left + pixels.shape[1], shape[1])))
    whole[rows, columns] = pixels[
        rows.start - top : rows.stop - top, columns.start - left : columns.stop - left
    ]
    spec.x, spec.y = spec.full_x, spec.full_y
    spec.height, spec.width = shape
    return whole
