"""Refuses what must not be written: a picture beyond the rim, light that is no number, uneven pictures."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from procam.compensate.predicted_picture import predict_picture
from procam.errors import CalibrationError
from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.geometry.model import Pair
from procam.model.calibration import Calibration
from procam.model.provenance import Note
from procam.workflows.solve.decode import Decoded

# of a projector's decoded pixels: beyond it is noted and refused; some overshoot the rim on purpose
MUCH_BEYOND, MOST_BEYOND = 0.005, 0.2
OFF_NOTED, OFF_REFUSED = 0.001, 0.02  # of the lit screen, by the frames of the calibration itself


def check_on_screen(view: ScreenView, found: Mapping[Pair, Decoded]) -> list[Note]:
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
        if camera != view.camera.name or not decoded.valid.any():
            continue
        beyond = float(np.mean(~view.on_screen[decoded.valid]))
        if beyond > MOST_BEYOND:
            raise CalibrationError(
                f"{beyond:.0%} of the picture of {projector} would lie beyond the dome's rim. Check that no "
                "two fiducials are exchanged and that azimuths are positive to the left of the front, then "
                "half_angle_deg and tilt_deg"
            )
        if beyond > MUCH_BEYOND:
            text = (
                f"{beyond:.1%} of its picture lie beyond the dome's rim and do not count as screen; if they "
                "do land on the dome, half_angle_deg is too small"
            )
            notes.append(
                Note("beyond the rim", f"projector {projector}", text, beyond / MUCH_BEYOND)
            )
    return notes


def check_calibration(calibration: Calibration) -> list[Note]:
    """Notes on a calibration whose own frames would not make a uniform picture; by much it is refused.

    Whatever makes a calibration asks this before it is written: its parts may each look right.

    Raises
    ------
    CalibrationError
        Also if the feedback or the albedo is no number; with what to look at.
    """
    _check_finite(calibration)
    share, text = uneven_picture(calibration)
    advice = (
        "Did somebody stand in their light, or a device move, between photographs? Calibrate again"
    )
    if share > OFF_REFUSED:
        raise CalibrationError(f"{text}. {advice}")
    return [Note("uneven", "", f"{text}. {advice}", share / OFF_NOTED)] if text else []


def uneven_picture(calibration: Calibration) -> tuple[float, str]:
    """Share of the screen where a calibration's own frames make a uniform picture uneven, and a sentence.

    It has no stop, and is empty where so little is uneven that it may be the summing of pixels.
    """
    picture = predict_picture(calibration)
    sends = ", ".join(f"{name} from {share:.0%}" for name, share in picture.share_lit.items())
    text = (
        f"a uniform picture would be off by a tenth or more on {picture.share_off:.1%} of the lit screen, by "
        f"this calibration itself; projectors would send light from these shares of their pixels: {sends}"
    )
    return picture.share_off, text if picture.share_off > OFF_NOTED else ""


def _check_finite(calibration: Calibration) -> None:
    for name, light in ("feedback", calibration.feedback), ("albedo", calibration.albedo):
        if not np.isfinite([light.value, light.sigma]).all():
            raise CalibrationError(
                f"the {name} cannot be determined from these pictures. Check the fiducials, half_angle_deg "
                "and what the camera sees of the dome"
            )


def noted(calibration: Calibration) -> Calibration:
    """The calibration with what its own picture says of it."""
    known = calibration.provenance
    notes = (*known.notes, *check_calibration(calibration))
    return replace(calibration, provenance=replace(known, notes=notes))
