"""Decodes a projector's code in the photographs of one camera, where its stripes show direct light."""

from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import BoolArray
from procam.errors import CalibrationError
from procam.estimate.camera.binning import Binning
from procam.estimate.geometry.model import Observations
from procam.estimate.geometry.observations import gather_observations
from procam.estimate.light.code_light import odd_waves
from procam.estimate.light.direct_light import DirectLight
from procam.estimate.structured_light.codes import make_code
from procam.estimate.structured_light.decode import Decoder
from procam.estimate.structured_light.limits import limits_by_noise
from procam.estimate.structured_light.outliers import keep_only
from procam.files.venue.load import Venue
from procam.files.venue.masks import camera_masks, projector_masks
from procam.model.correspondence import CorrespondenceMap
from procam.model.optics import CameraModel
from procam.model.provenance import Note
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.solve.direct_light import check_decoded, stripe_light

BYTES_PER_PIXEL = 80
BESIDE_PX = 48  # of the picture, that is decoded with it: blur and scattered light show there


@dataclass(frozen=True, slots=True)
class Decoded:
    """What one camera sees of a projector.

    Attributes
    ----------
    valid : (h, w) its pixels are decoded. direct : where it is lit at all, by stripes. Both are masks of
        the pixels that the camera's light is measured with (`Binning`).
    share : of the image circle that is decoded.
    """

    valid: BoolArray
    direct: DirectLight
    share: float


@dataclass(frozen=True, slots=True)
class DecodedPixels:
    """Panel pixels (h, w) of a `window` of a camera's picture, (rows, columns), and notes.

    `direct` (H, W) is of the whole picture.
    """

    map: CorrespondenceMap
    window: tuple[slice, slice]
    direct: DirectLight
    notes: list[Note]


def decode_bytes(camera: CameraModel) -> float:
    """Memory that decoding one projector takes [byte]."""
    return float(BYTES_PER_PIXEL * camera.size[0] * camera.size[1])


def decode_projector(
    venue: Venue, images: SessionImages, name: str
) -> tuple[Decoded, Observations, list[Note]]:
    """What a camera sees of a projector, pixel by pixel and by patches of the panel; and notes."""
    pixels = decode_pixels(venue, images, name)
    camera, seen = images.radiometer.camera, images.radiometer.seen
    covered = camera_masks(venue)[camera.name].covered
    valid, direct = np.zeros(covered.shape, bool), pixels.direct
    valid[pixels.window] = pixels.map.valid & ~covered[pixels.window]
    check_decoded(images, name, valid | ~direct.dim, direct.seen & seen & ~covered)
    # masked pixels shine while the light is measured: only the geometry does without them
    masked = projector_masks(venue)[name].at(pixels.map.projector_xy)
    used = keep_only(pixels.map, valid[pixels.window] & ~masked)
    observations = gather_observations(used, venue.table.projectors[name].size)
    rows, columns = pixels.window
    shifted = observations.camera_px + np.array([columns.start, rows.start])
    binning, share = Binning.of(camera), float(valid.sum() / seen.sum())
    return (
        Decoded(binning.most(valid), direct.binned(binning), share),
        replace(observations, camera_px=shifted),
        pixels.notes,
    )


def decode_pixels(venue: Venue, images: SessionImages, name: str) -> DecodedPixels:
    """Panel pixels that a camera sees of a projector, where there is direct light of it."""
    radiometer = images.radiometer
    white, black = images.white_and_black(name)
    law, direct = stripe_light(images, name, white, black)
    window = _around(direct.seen)
    white, black = white[window].copy(), black[window].copy()
    limits = limits_by_noise(white, black, law, radiometer.camera.sensor)
    code_name, pictures = images.code(name)
    decoder = Decoder(make_code(code_name, venue.table.projectors[name].size), limits)
    light = dict[int, float]()
    for number, counts in pictures:
        decoder.add(number, counts[window].copy())  # lets go of the rest
        light[number] = float(counts[radiometer.seen].mean(dtype=float))
    decoded = decoder.result()
    if decoded.refused:
        raise CalibrationError(f"projector {name}: {decoded.refused[0]}")
    notes = odd_waves(light, images.plan.of(name, "code"), name)
    return DecodedPixels(decoded.map, window, direct, notes)


def _around(seen: BoolArray) -> tuple[slice, slice]:
    """Rows and columns of what is `seen` (H, W) and of what is beside it; all if nothing is."""
    where = (np.flatnonzero(seen.any(axis=axis)) for axis in (1, 0))
    rows, columns = (
        slice(max(0, int(at[0]) - BESIDE_PX), int(at[-1]) + 1 + BESIDE_PX)
        if at.size
        else slice(0, None)
        for at in where
    )
    return rows, columns
