"""Shows as pictures what compensation does to one frame, and what each method would make of it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from procam.arrays import Array, Image
from procam.compensate.compensator import Compensator
from procam.files.images.layers import RGB, write_channels
from procam.files.images.stills import square_edge
from procam.model.calibration import Calibration
from procam.workflows.playout.encodings import decoded
from procam.workflows.playout.frame import (
    FrameSettings,
    linear_compensator,
    most_light,
    named_transfer,
    require_photometry,
)
from procam.workflows.playout.sources import ClipFrame

TARGET, BEFORE = "target", "none"
METHODS = (BEFORE, "exact", "least-squares", "perceptual")


@dataclass(frozen=True, slots=True)
class Explained:
    """One frame, all (N, N, 3) linear light [rel] on its own dome master.

    Attributes
    ----------
    content : what is asked for. without : what would be seen of it without compensation.
    scattered : the scattered light in `without`. direct : what is sent instead.
    observed : what will be seen of that.
    limits : 0 where no limit holds: `observed` is the content under its white (or what a perceptual
        method chose), 1 where even black is too bright, -1 where even white is too dark; NaN where nothing
        is lit and where a person protects the content.
    """

    content: Image
    without: Image
    scattered: Image
    direct: Image
    observed: Image
    limits: Image


def explain(calibration: Calibration, clip_frame: ClipFrame, settings: FrameSettings) -> Explained:
    """Solve a frame with (in full, whatever the strength) and without compensation, in linear light."""
    size = square_edge(clip_frame.rgb, clip_frame.name)
    content = decoded(clip_frame.rgb, named_transfer(clip_frame, settings))
    ours = linear_compensator(calibration, size, settings, settings.checked_method())
    plain = Compensator(calibration, size, "none", settings.state, transfer_name="linear")
    found, without = (each.predict(content, most_light(clip_frame.rgb)) for each in (ours, plain))
    limits = np.sign(found.observed - ours.target(content))
    limits[found.free] = 0
    limits[~ours.lit | ours.protected] = np.nan
    return Explained(
        content,
        without.observed,
        without.observed - without.direct,
        found.direct,
        found.observed,
        limits.astype(np.float32),
    )


def picture_files(folder: Path) -> dict[str, Path]:
    """FOLDER/NAME.exr by name, one for each picture."""
    return {name: folder / f"{name}.exr" for name in Explained.__slots__}


def write_pictures(folder: Path, explained: Explained) -> None:
    """Write FOLDER/NAME.exr, one for each picture."""
    for name, path in picture_files(folder).items():
        picture = getattr(explained, name)
        write_channels(path, {c: picture[..., i] for i, c in enumerate(RGB)})


def views(
    calibration: Calibration, clip_frame: ClipFrame, settings: FrameSettings
) -> Mapping[str, Image]:
    """Total light (N, N, 3) by method, and the `TARGET`: the content, beyond what projectors can show.

    Of the settings only state, white, transfer and those of the perceptual method count.
    """
    require_photometry(calibration)
    size = square_edge(clip_frame.rgb, clip_frame.name)
    content = np.nan_to_num(
        decoded(clip_frame.rgb, named_transfer(clip_frame, settings)), nan=0, posinf=0, neginf=0
    )
    found = dict[str, Image]()
    for method in METHODS:
        compensator = linear_compensator(calibration, size, settings, settings.of(method))
        found[method] = compensator.predict(content, most_light(clip_frame.rgb)).observed
        found[TARGET] = compensator.target(content)
    return found


def lit_solid_angles(calibration: Calibration, size: int) -> Array:
    """Solid angles (N, N) [sr] of pixels that projectors reach and that are not protected, else 0."""
    compensator = Compensator(calibration, size, BEFORE)
    lit = compensator.lit & ~compensator.protected
    return np.asarray(calibration.canvas.weights(size) * lit)
