"""Refuses what a solve must not write: a picture beyond the dome's rim, and light that is no number."""

from collections.abc import Mapping

import numpy as np

from procam.errors import CalibrationError
from procam.estimate.geometry.camera_view import DomeView
from procam.estimate.geometry.model import Pair
from procam.model.calibration import Calibration
from procam.workflows.solve.direct_light import Decoded

# of a projector's decoded pixels: beyond it is noted and refused; some overshoot the rim on purpose
MUCH_BEYOND, MOST_BEYOND = 0.005, 0.2


def check_on_screen(view: DomeView, found: Mapping[Pair, Decoded]) -> list[str]:
    """Notes on projectors whose picture lies partly beyond the rim; much of it is refused.

    Two marks whose angles are exchanged or mirrored fit as well as the right ones, and turn the dome over.
    Where half_angle_deg is too small, the light of the rest is missing.

    Raises
    ------
    CalibrationError
        With the share and what is probably wrong.
    """
    notes = []
    for (camera, projector), decoded in found.items():
        seen = decoded.map
        if camera != view.camera.name or not seen.valid.any():
            continue
        beyond = float(np.mean(~view.on_screen[seen.valid]))
        if beyond > MOST_BEYOND:
            raise CalibrationError(
                f"{beyond:.0%} of the picture of {projector} would lie beyond the dome's rim. Check that no "
                "two fiducials are exchanged and that azimuths are positive to the left of the front, then "
                "half_angle_deg and tilt_deg"
            )
        if beyond > MUCH_BEYOND:
            notes.append(
                f"{beyond:.1%} of the picture of {projector} lie beyond the dome's rim and do not count as "
                "screen; if they do land on the dome, half_angle_deg is too small"
            )
    return notes


def check_finite(calibration: Calibration) -> None:
    """Refuse a calibration whose feedback or albedo is no number.

    Raises
    ------
    CalibrationError
        With what to look at.
    """
    for name, light in ("feedback", calibration.feedback), ("albedo", calibration.albedo):
        if not np.isfinite([light.value, light.sigma]).all():
            raise CalibrationError(
                f"the {name} cannot be determined from these pictures. Check the fiducials, half_angle_deg "
                "and what the camera sees of the dome"
            )
