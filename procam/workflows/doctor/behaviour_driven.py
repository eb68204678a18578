"""Photographs of a projector's test pictures with devices: 24, and about a minute and a half of waiting."""

from collections.abc import Iterator

import numpy as np

from procam.arrays import Image
from procam.estimate.camera.exposure import meter
from procam.estimate.projector_tests.patterns import PatchLayout
from procam.files.venue.tables import CaptureTable
from procam.model.frame import Frame
from procam.workflows.doctor.behaviour import (
    CHANGE_S,
    HALF,
    after_change,
    longer_for_dark,
    pictures_to_show,
    white_problem,
)
from procam.workflows.doctor.examined_camera import DIM, METERINGS, ExaminedCamera

SETTLED_S = 1.0  # after a picture has changed
REST_S, BLACK_S = 10.0, 30.0


class DrivenTest:
    """One projector before one camera that has looked at the dark."""

    def __init__(self, examined: ExaminedCamera, projector: str) -> None:
        self._examined, self._projector = examined, projector
        self._layout = PatchLayout(examined.rig.projectors[projector].size)
        self._black = np.zeros((*self._layout.size[::-1], 3), np.float32)
        self._exposure_s = 0.0

    def photograph(self, capture: CaptureTable) -> dict[str, Frame]:
        """Photographs by name; of white alone if nothing could be learnt from more."""
        black, metered = self._examined.metered(self._projector, capture, SETTLED_S)
        self._exposure_s = metered.settings.exposure_s
        self._examined.rig.clock.sleep(REST_S)
        white = self._metered_white()
        frames = {"black": black, "white": white, "again": white, "half": self._take(HALF)}
        if white_problem(white, frames["half"], self._examined.measured):
            return frames
        self._show(self._black, BLACK_S)
        frames["after-black"] = frames["again"] = self._photograph(np.ones_like(self._black))
        self._show(self._black, REST_S)
        longer = longer_for_dark(black.settings.exposure_s, self._exposure_s)
        for name, picture in pictures_to_show(self._layout).items():
            frames[name] = self._photograph(picture, longer if name == "dark-steps" else 1.0)
        return frames | dict(self._changing())

    def _metered_white(self) -> Frame:
        """White that has been up for long: an iris that was closed at first is open now."""
        for _ in range(METERINGS):
            white = self._take()
            better_s = meter(white.counts, self._exposure_s, self._examined.measured)
            if self._exposure_s <= better_s <= self._exposure_s / DIM:
                break
            self._exposure_s = better_s
        self._exposure_s = white.settings.exposure_s
        return white

    def _changing(self) -> Iterator[tuple[str, Frame]]:
        """The second picture of the pair as it comes up after the first."""
        first, second = self._layout.pair()
        self._show(first, REST_S)
        shown_s = self._show(second)
        for after_s in CHANGE_S:
            self._examined.rig.clock.sleep(shown_s + after_s - self._examined.rig.clock.now_s())
            yield after_change(after_s), self._take()

    def _show(self, picture: Image, wait_s: float = 0.0) -> float:
        """Show a picture for so long; when it was up [s]."""
        shown = self._examined.rig.projectors[self._projector].show(picture)
        self._examined.rig.clock.sleep(wait_s)
        return shown.at_s

    def _take(self, longer: float = 1.0) -> Frame:
        """A photograph of what is up."""
        return self._examined.take(longer * self._exposure_s)

    def _photograph(self, picture: Image, longer: float = 1.0) -> Frame:
        """A photograph of a picture that has settled."""
        exposure_s = longer * self._exposure_s
        return self._examined.photograph(
            self._projector, picture, exposure_s, wait_s=SETTLED_S, title="a test picture"
        )
