"""The photographs that workflows ask for (`Wanted`), and the photographer that drives devices."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from procam.arrays import Image
from procam.devices.rig import Rig
from procam.model.calibration import Calibration
from procam.model.frame import CameraSettings, Frame
from procam.workflows.capture.checked_camera import BREATH_S, CheckedCamera


@dataclass(frozen=True, slots=True)
class Wanted:
    """A photograph that is wanted.

    Attributes
    ----------
    pictures : drive (H, W, 3), 0..1, of each projector that is lit; all others are dark.
    exposure_s : shutter time [s].
    """

    pictures: Mapping[str, Image]
    exposure_s: float


class Photographer(ABC):
    """Who shows pictures and photographs them with one camera, in colour.

    `notes` are warnings on photographs that were given, one per line; `again` is the advice for photographs
    that turn out to be bad, or empty.
    """

    notes: Sequence[str] = ()

    @property
    def again(self) -> str:
        """A sentence without its stop."""
        return ""

    def plan(self, wanted: Sequence[Wanted]) -> None:  # noqa: B027 - devices need no notice
        """Say what will be asked for next, so that people can take it in one go."""

    @abstractmethod
    def take(self, wanted: Wanted) -> Frame:
        """The photograph."""

    @abstractmethod
    def retake(self, wanted: Wanted) -> Frame:
        """Another photograph of the same, if one can be had; else that of `take` again."""

    def end(self) -> None:  # noqa: B027 - devices keep nothing
        """The result is written, and the next one needs new photographs."""


class DrivenPhotographer(Photographer):
    """Shows and photographs with devices, with the camera that a calibration's light was measured with.

    Projectors are switched on for the first photograph. A new picture is given `settle_s` [s] before it is
    photographed, for irises that follow it.
    """

    def __init__(self, rig: Rig, calibration: Calibration, settle_s: float = 0.0) -> None:
        self._rig, self._settle_s, model = rig, settle_s, calibration.camera
        self._camera = CheckedCamera(
            rig.cameras[model.name], model.sensor, rig.clock, may_look_alike=True
        )
        self._shown: Mapping[str, Image] | None = None

    def take(self, wanted: Wanted) -> Frame:
        """The photograph."""
        self._show(wanted.pictures)
        of = ", ".join(wanted.pictures) or "the dark room"
        settings = CameraSettings(wanted.exposure_s, "rgb")
        return self._camera.photograph(f"photograph of {of}", settings, wanted.pictures)

    def retake(self, wanted: Wanted) -> Frame:
        """Show it again, wait and photograph: a camera may have delivered an old picture."""
        for name, picture in wanted.pictures.items():
            self._rig.projectors[name].show(np.ascontiguousarray(picture))
        self._rig.clock.sleep(BREATH_S)
        return self.take(wanted)

    def _show(self, pictures: Mapping[str, Image]) -> None:
        """Light the projectors of the pictures and show them; the others are dark."""
        if self._shown is None:
            self._rig.start()
        before = self._shown or {}
        if pictures is self._shown:
            return
        for name in before:
            if name not in pictures:
                self._rig.darken(name)
        for name, picture in pictures.items():
            if name not in before:
                self._rig.light(name)
            self._rig.projectors[name].show(np.ascontiguousarray(picture))
        self._rig.clock.sleep(self._settle_s)
        self._shown = pictures
