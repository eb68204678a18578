"""From direct light on the dome to what each projector is sent."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from procam.maths.curves import invert_curve
from procam.maths.sphere import master_pixels
from procam.maths.warp import sample
from procam.model.calibration import Calibration, ProjectorCalibration
from procam.model.transport import DomeMaps

Image = NDArray[np.float32]


def projector_frames(direct: Image, calibration: Calibration) -> dict[str, Image]:
    """Drives (H, W, 3) in 0..1 by projector for direct light (N, N, 3) [rel] on a dome master.

    Black is taken off what is asked for, the blend shares the rest out, each projector's colour
    mixing and response are undone. What a projector cannot give is clipped.
    """
    return {
        name: _frame(direct, projector, calibration.maps)
        for name, projector in calibration.projectors.items()
    }


def _frame(direct: Image, projector: ProjectorCalibration, maps: DomeMaps) -> Image:
    direction = np.nan_to_num(projector.surface.direction)
    asked = sample(direct, master_pixels(direction, direct.shape[0]))
    asked -= sample(maps.lo, master_pixels(direction, maps.size))
    photometry = projector.photometry
    gain = photometry.gain
    share = np.where(gain > 0, projector.blend[..., None] / np.maximum(gain, 1e-9), 0)
    linear = (asked * share) @ np.linalg.inv(photometry.colour_mix).T.astype(np.float32)
    linear = np.clip(linear, 0, 1)
    if photometry.exponent is not None:
        linear **= 1 / photometry.exponent
    response = photometry.response
    drive = invert_curve(linear, response.levels, response.values)
    return np.where(projector.surface.valid[..., None], drive, 0).astype(np.float32)


def quantised(frames: Mapping[str, Image]) -> dict[str, NDArray[np.uint16]]:
    """Frames as 16-bit pictures."""
    return {name: np.rint(frame * 65535).astype(np.uint16) for name, frame in frames.items()}
