"""What a solve must not write."""

from dataclasses import replace

import numpy as np
import pytest

from procam.errors import CalibrationError
from procam.model.calibration import Calibration
from procam.model.transport import Measured
from procam.workflows.solve.plausible import check_finite


@pytest.mark.parametrize("name", ["feedback", "albedo"])
@pytest.mark.parametrize("part", ["value", "sigma"])
def test_light_that_is_no_number_is_refused(calibration: Calibration, name: str, part: str) -> None:
    check_finite(calibration)
    good = {"value": np.full(3, 0.3), "sigma": np.full(3, 0.01)}
    bad = Measured(**good | {part: np.array([0.3, np.nan, 0.3])})
    with pytest.raises(CalibrationError, match=f"the {name} cannot be determined"):
        check_finite(replace(calibration, **{name: bad}))
