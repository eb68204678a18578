"""Pictures in and out through OpenImageIO: PNG, TIFF and EXR.

Every read checks that the whole file was there: a truncated EXR must never read as black.
"""

import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from procam.errors import FileFormatError
from procam.files.atomic import replacing
from procam.maths.light.curves import srgb_decode, srgb_encode

RGB = ("R", "G", "B")
Image = NDArray[np.float32]
STORED_AS = {"uint8": "uint8", "uint16": "uint16", "float16": "half", "float32": "float"}
PARTS = (("",), RGB, ("x", "y", "z"))  # of a layer
ROWS = 64  # at a time
CHECKSUM = "procam:crc32"  # of layers, which uncompressed nothing else tells damage of
SUFFIXES = (".png", ".tif", ".tiff", ".exr")  # what is lossless; OpenImageIO would write more


def write_image(path: Path, pixels: NDArray[np.generic], channels: Sequence[str] = ()) -> None:
    """Write (H, W) or (H, W, C) pixels durably, by the suffix and dtype (a key of `STORED_AS`).

    TIFF is written uncompressed (raw captures: speed), EXR losslessly with zip.
    """
    require_suffix(path)
    data = np.ascontiguousarray(pixels if pixels.ndim == 3 else pixels[..., None])
    height, width, count = data.shape
    spec = oiio.ImageSpec(width, height, count, STORED_AS[str(data.dtype)])
    spec.attribute("compression", {".exr": "zip", ".tif": "none"}.get(path.suffix, ""))
    if path.suffix == ".png":
        spec.attribute("png:compressionLevel", 1)
    if channels:
        spec.channelnames = tuple(channels)
    write_spec(path, data, spec)


def require_suffix(path: Path) -> None:
    """Refuse a name whose suffix no lossless picture has."""
    if path.suffix not in SUFFIXES:
        raise FileFormatError(
            f"{path}: got the suffix {path.suffix!r}, expected .png, .tif or .exr; rename it"
        )


def write_spec(path: Path, data: NDArray[np.generic], spec: oiio.ImageSpec) -> None:
    """Write contiguous pixels (H, W, C) durably, as OpenImageIO's `spec` describes them."""
    with replacing(path) as temporary:
        output = oiio.ImageOutput.create(str(temporary))
        assert output is not None
        if not (output.open(str(temporary), spec) and output.write_image(data)):
            raise FileFormatError(f"{path}: could not be written ({_one_line(output.geterror())})")
        if not output.close():
            raise FileFormatError(f"{path}: could not be written ({_one_line(output.geterror())})")


def read_image(path: Path) -> NDArray[np.generic]:
    """Pixels (H, W, C) in the file's own type."""
    return read_spec(path)[0]


def read_channels(path: Path) -> dict[str, Image]:
    """Channels by name, each (H, W) float32; EXR does not keep their order."""
    pixels, spec = read_spec(path)
    names = spec.channelnames
    if spec.get_string_attribute(CHECKSUM):
        layers = _layers(path, spec).items()
        sums = {n: zlib.crc32(np.ascontiguousarray(pixels[..., at]).data) for n, at in layers}
        _require_sums(path, spec, sums)
    return {name: np.asarray(pixels[..., i], np.float32) for i, name in enumerate(names)}


def write_channels(path: Path, channels: Mapping[str, NDArray[np.generic]]) -> None:
    """Write named (H, W) channels as a float EXR."""
    stack = np.stack([np.asarray(c, np.float32) for c in channels.values()], axis=-1)
    write_image(path, stack, tuple(channels))


def write_layers(path: Path, layers: Mapping[str, NDArray[np.generic]]) -> None:
    """Write named layers (H, W) or (H, W, 3) of colours as an uncompressed float EXR, with a checksum.

    It reads five times as fast as zip, which would have told damage by itself.
    """
    data = {n: np.ascontiguousarray(layer, np.float32) for n, layer in layers.items()}
    stack = np.dstack(list(data.values()))
    spec = oiio.ImageSpec(stack.shape[1], stack.shape[0], stack.shape[2], "float")
    names = [[n] if layer.ndim == 2 else [f"{n}.{c}" for c in RGB] for n, layer in data.items()]
    spec.channelnames = tuple(name for layer in names for name in layer)
    spec.attribute("compression", "none")
    spec.attribute(CHECKSUM, _told({name: zlib.crc32(layer.data) for name, layer in data.items()}))
    write_spec(path, stack, spec)


def read_layers(path: Path) -> dict[str, Image]:
    """Layers by name, float32: (H, W, 3) of channels such as hi.R, hi.G, hi.B, (H, W) of a single one.

    Read by a few rows, which the cache holds: half the memory and time of `read_channels`.
    """
    with _opened(path) as source:
        spec = source.spec()
        places = _layers(path, spec)
        shape = (spec.height, spec.width)
        found = {n: np.empty((*shape, len(at)), np.float32) for n, at in places.items()}
        sums = dict.fromkeys(places, 0)
        for start, pixels in _by_rows(path, source):
            for name, at in places.items():
                rows = found[name][start : start + len(pixels)]
                for i, k in enumerate(at):
                    rows[..., i] = pixels[..., k]
                sums[name] = zlib.crc32(rows.data, sums[name])
    _require_sums(path, spec, sums)
    return {name: layer[..., 0] if layer.shape[2] == 1 else layer for name, layer in found.items()}


def _layers(path: Path, spec: oiio.ImageSpec) -> dict[str, list[int]]:
    """Places of the channels of each layer: of one, of R, G, B, or of x, y, z."""
    found: dict[str, dict[str, int]] = {}
    for place, name in enumerate(spec.channelnames):
        layer, _, part = name.rpartition(".")
        found.setdefault(layer or part, {})[part if layer else ""] = place
    places = {}
    for name, parts in found.items():
        order = next((o for o in PARTS if set(o) == set(parts)), None)
        if order is None:
            raise FileFormatError(
                f"{path}: got {', '.join(f'{name}.{p}' for p in sorted(parts))} for its layer {name}, "
                "expected one channel, or R, G and B, or x, y and z; restore it"
            )
        places[name] = [parts[part] for part in order]
    return places


def _told(sums: Mapping[str, int]) -> str:
    """Checksums of layers as a file tells them."""
    return " ".join(f"{name}:{sums[name]:08x}" for name in sorted(sums))


def _require_sums(path: Path, spec: oiio.ImageSpec, sums: Mapping[str, int]) -> None:
    """Refuse pixels that are not those that were written; a picture made of some layers is another."""
    told = spec.get_string_attribute(CHECKSUM)
    same = {part.rpartition(":")[0] for part in told.split()} == set(sums)
    if same and told != _told(sums):
        raise FileFormatError(
            f"{path}: got a damaged image (its checksum is another), expected the pixels that were "
            "written; restore it"
        )


def _by_rows(path: Path, source: oiio.ImageInput) -> Iterator[tuple[int, NDArray[np.generic]]]:
    """First row and pixels (R, W, C) of each part of a picture; one of tiles is one part."""
    spec = source.spec()
    if spec.tile_width:
        yield 0, _whole(path, source, source.read_image("float"))
        return
    for y in range(0, spec.height, ROWS):
        rows = spec.y + y, spec.y + min(y + ROWS, spec.height)
        yield y, _whole(path, source, source.read_scanlines(*rows, 0, 0, spec.nchannels, "float"))


def read_picture(path: Path) -> Image:
    """Content (H, W, 3) in linear light 0..: EXR as stored, PNG and TIFF decoded from sRGB."""
    pixels, spec = read_spec(path)
    picture = np.asarray(pixels[..., colour_places(path, spec)])
    if np.issubdtype(picture.dtype, np.integer):
        encoded = picture / np.float32(np.iinfo(picture.dtype).max)
        return srgb_decode(encoded).astype(np.float32)
    require_finite(path, picture)
    return picture.astype(np.float32)


def write_picture(path: Path, linear: Image) -> None:
    """Write linear light (H, W, 3): EXR as is, PNG and TIFF as 16-bit sRGB."""
    if path.suffix == ".exr":
        write_image(path, linear.astype(np.float32), RGB)
        return
    encoded = np.rint(srgb_encode(np.clip(linear, 0, 1)) * 65535)
    write_image(path, encoded.astype(np.uint16))


def colour_places(path: Path, spec: oiio.ImageSpec) -> list[int]:
    """Where R, G and B are among a picture's channels; refuses a picture that lacks one."""
    lookup = {name.upper(): i for i, name in enumerate(spec.channelnames)}
    if not set(RGB) <= set(lookup):
        raise FileFormatError(
            f"{path}: got channels {', '.join(spec.channelnames)}, expected R, G and B; convert it "
            "to RGB"
        )
    return [lookup[c] for c in RGB]


def require_finite(name: object, picture: NDArray[np.floating]) -> None:
    """Refuse light that is NaN or infinite; `name` tells whose it is."""
    bad = int((~np.isfinite(picture)).sum())
    if bad:
        raise FileFormatError(
            f"{name}: got {bad} values that are NaN or infinite, expected finite light; "
            "render the frame again or paint over the holes"
        )


def read_spec(path: Path) -> tuple[NDArray[np.generic], oiio.ImageSpec]:
    """Pixels (H, W, C) in the file's own type, as stored, and what the file says of them."""
    with _opened(path) as source:
        spec = source.spec()
        pixels = _whole(path, source, source.read_image(spec.format))
    return pixels.reshape(spec.height, spec.width, spec.nchannels), spec


@contextmanager
def _opened(path: Path) -> Iterator[oiio.ImageInput]:
    """A picture to be read; OpenImageIO would multiply straight alpha into colours unless told otherwise."""
    if not path.is_file():
        raise FileFormatError(f"{path}: got no such file, expected an image; check the name")
    wanted = oiio.ImageSpec()
    wanted.attribute("oiio:UnassociatedAlpha", 1)
    source = oiio.ImageInput.open(str(path), wanted)
    if source is None:
        raise FileFormatError(f"{path}: got no readable image ({_one_line(oiio.geterror())})")
    try:
        yield source
    finally:
        source.close()


def _whole(
    path: Path, source: oiio.ImageInput, pixels: NDArray[np.generic] | None
) -> NDArray[np.generic]:
    """Pixels as they were read, if nothing was amiss."""
    complaint, spec = source.geterror(), source.spec()
    if pixels is None or complaint:
        raise FileFormatError(
            f"{path}: got a truncated or damaged image ({_one_line(complaint)}), expected "
            f"{spec.width}x{spec.height} whole pixels; copy or capture it again"
        )
    return np.asarray(pixels)


def _one_line(complaint: str) -> str:
    return " ".join(complaint.split())
