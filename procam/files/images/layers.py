"""Maps as named channels and layers of EXR files, with a checksum.

Maps are stored without compression, because they then read five times as fast as with zip. An
uncompressed EXR has no means to detect damage, so the header holds the CRC-32 of each layer.
"""

import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from procam.arrays import Image
from procam.errors import FileFormatError
from procam.files.images.pixels import opened, read_rows, read_spec, write_image, write_spec

RGB = ("R", "G", "B")
LAYER_CHANNELS = (("",), RGB, ("x", "y", "z"))
CHECKSUM = "procam:crc32"


def read_channels(path: Path) -> dict[str, Image]:
    """Channels by name, each (H, W) float32; EXR does not keep their order."""
    pixels, spec = read_spec(path)
    if spec.get_string_attribute(CHECKSUM):
        layers = _layers(path, spec).items()
        sums = {n: zlib.crc32(np.ascontiguousarray(pixels[..., at]).data) for n, at in layers}
        _require_sums(path, spec, sums)
    names = enumerate(spec.channelnames)
    return {name: np.asarray(pixels[..., i], np.float32) for i, name in names}


def write_channels(path: Path, channels: Mapping[str, NDArray[np.generic]]) -> None:
    """Write named (H, W) channels as a float EXR."""
    stack = np.stack([np.asarray(c, np.float32) for c in channels.values()], axis=-1)
    write_image(path, stack, tuple(channels))


def write_layers(path: Path, layers: Mapping[str, NDArray[np.generic]]) -> None:
    """Write named layers, (H, W) or (H, W, 3) of colours, as an uncompressed float EXR."""
    data = {n: np.ascontiguousarray(layer, np.float32) for n, layer in layers.items()}
    stack = np.dstack(list(data.values()))
    spec = oiio.ImageSpec(stack.shape[1], stack.shape[0], stack.shape[2], "float")
    names = [[n] if layer.ndim == 2 else [f"{n}.{c}" for c in RGB] for n, layer in data.items()]
    spec.channelnames = tuple(name for layer in names for name in layer)
    spec.attribute("compression", "none")
    spec.attribute(CHECKSUM, _sums_text({n: zlib.crc32(layer.data) for n, layer in data.items()}))
    write_spec(path, stack, spec)


def read_layers(path: Path) -> dict[str, Image]:
    """Layers by name, float32: (H, W, 3) of channels such as hi.R, hi.G, hi.B, (H, W) of a single one.

    Read a few rows at a time, in half the memory and time of `read_channels`.
    """
    with opened(path) as source:
        spec = source.spec()
        places = _layers(path, spec)
        shape = (spec.height, spec.width)
        found = {n: np.empty((*shape, len(at)), np.float32) for n, at in places.items()}
        sums = dict.fromkeys(places, 0)
        for start, pixels in read_rows(path, source):
            for name, at in places.items():
                rows = found[name][start : start + len(pixels)]
                for i, k in enumerate(at):
                    rows[..., i] = pixels[..., k]
                sums[name] = zlib.crc32(rows.data, sums[name])
    _require_sums(path, spec, sums)
    return {name: layer[..., 0] if layer.shape[2] == 1 else layer for name, layer in found.items()}


def _layers(path: Path, spec: oiio.ImageSpec) -> dict[str, list[int]]:
    """Positions of the channels of each layer: of a single one, of R, G, B, or of x, y, z."""
    found: dict[str, dict[str, int]] = {}
    for place, name in enumerate(spec.channelnames):
        layer, _, part = name.rpartition(".")
        found.setdefault(layer or part, {})[part if layer else ""] = place
    places = {}
    for name, parts in found.items():
        order = next((o for o in LAYER_CHANNELS if set(o) == set(parts)), None)
        if order is None:
            raise FileFormatError(
                f"{path}: layer {name} has the channels {', '.join(f'{name}.{p}' for p in sorted(parts))}; "
                "it needs a single one, or R, G and B, or x, y and z. Restore the file"
            )
        places[name] = [parts[part] for part in order]
    return places


def _sums_text(sums: Mapping[str, int]) -> str:
    return " ".join(f"{name}:{sums[name]:08x}" for name in sorted(sums))


def _require_sums(path: Path, spec: oiio.ImageSpec, sums: Mapping[str, int]) -> None:
    """Refuse pixels that differ from those that were written.

    A file that another program made of some of the layers is not checked.
    """
    stored = spec.get_string_attribute(CHECKSUM)
    same_layers = {part.rpartition(":")[0] for part in stored.split()} == set(sums)
    if same_layers and stored != _sums_text(sums):
        raise FileFormatError(f"{path} is damaged: its checksum does not match. Restore the file")
