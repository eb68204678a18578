"""What a solve must not write."""

from dataclasses import replace

import numpy as np
import pytest

from procam.errors import CalibrationError
from procam.model.calibration import Calibration
from procam.model.transport import Measured
from procam.workflows.solve import plausible
from procam.workflows.solve.plausible import check_calibration


@pytest.mark.parametrize("name", ["feedback", "albedo"])
@pytest.mark.parametrize("part", ["value", "sigma"])
def test_light_that_is_no_number_is_refused(calibration: Calibration, name: str, part: str) -> None:
    check_calibration(calibration)
    good = {"value": np.full(3, 0.3), "sigma": np.full(3, 0.01)}
    bad = Measured(**good | {part: np.array([0.3, np.nan, 0.3])})
    with pytest.raises(CalibrationError, match=f"the {name} cannot be determined"):
        check_calibration(replace(calibration, **{name: bad}))


def test_frames_that_leave_a_hole_are_noted_and_refused(
    calibration: Calibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A blend of zeros, where each part of the calibration looks right."""
    assert check_calibration(calibration) == []
    south = calibration.projectors["south"]
    blend = south.blend.copy()
    blend[:3] = 0
    holed = {**calibration.projectors, "south": replace(south, blend=blend)}
    unknown = replace(south.photometry, gain=np.full_like(south.photometry.gain, np.nan))
    unread = {**calibration.projectors, "south": replace(south, photometry=unknown)}
    with pytest.raises(CalibrationError, match="a uniform picture would be off"):
        check_calibration(replace(calibration, projectors=unread))
    spoilt = replace(calibration, projectors=holed)
    with pytest.raises(
        CalibrationError, match="shares of their pixels: south from 88%, north from "
    ):
        check_calibration(spoilt)
    monkeypatch.setattr(plausible, "OFF_REFUSED", 0.2)  # a picture of this panel has few pixels
    (note,) = check_calibration(spoilt)
    assert str(note).startswith(
        "a uniform picture would be off by a tenth or more on 11.1% of the lit"
    )
