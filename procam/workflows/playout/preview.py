"""Predicts what the audience will see of one picture, by each method, to choose between them."""

from collections.abc import Mapping

import numpy as np

from procam.arrays import Array, Image
from procam.compensate.compensator import Compensator
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
    return np.asarray(calibration.canvas.solid_angles(size) * lit)
