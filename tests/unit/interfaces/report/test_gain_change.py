"""The loop's changes of the gain, over calibrations that only added a venue state."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from procam.files.calibration import save_calibration
from procam.files.versions import next_directory
from procam.interfaces.report.data import read_material
from procam.interfaces.report.light import gain_change
from procam.model.calibration import Calibration
from procam.model.provenance import Provenance
from procam.model.venue_state import VenueState


def _with_state(calibration: Calibration) -> Calibration:
    state = VenueState("full", calibration.feedback, np.full(3, 1.12))
    return replace(calibration, states={"full": state})


def _saved(folder: Path, calibrations: Sequence[Calibration]) -> Path:
    for calibration in calibrations:
        save_calibration(calibration, next_directory(folder))
    return folder


class TestGainChange:
    def brighter(self, calibration: Calibration) -> Calibration:
        """As a closed loop leaves it."""
        south = calibration.projectors["south"]
        light = replace(south.photometry, gain=south.photometry.gain * np.float32(1.02))
        projectors = {**calibration.projectors, "south": replace(south, photometry=light)}
        return replace(calibration, projectors=projectors)

    def test_calibrations_that_only_added_a_state_are_passed_over(
        self, tmp_path: Path, calibration: Calibration
    ) -> None:
        looped = self.brighter(calibration)
        material = read_material(_saved(tmp_path, [calibration, looped, _with_state(looped)]))
        change = gain_change(material, "south")
        assert change is not None
        valid = calibration.projectors["south"].surface.valid
        assert change[valid] == pytest.approx(1.02, rel=1e-6)

    def test_without_any_change_it_is_one(self, tmp_path: Path, calibration: Calibration) -> None:
        material = read_material(_saved(tmp_path, [calibration, _with_state(calibration)]))
        change = gain_change(material, "south")
        assert change is not None and np.nanmin(change) == np.nanmax(change) == 1

    def test_another_session_is_another_matter(
        self, tmp_path: Path, calibration: Calibration
    ) -> None:
        other = replace(calibration, provenance=Provenance("0007"))
        assert gain_change(read_material(_saved(tmp_path, [other, calibration])), "south") is None
