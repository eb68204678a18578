"""The compensator of a dome or of a room."""

from typing import TYPE_CHECKING, Union

from procam.compensate.compensator import Compensated, Compensator
from procam.model.calibration import Calibration
from procam.model.screen import RoomScreen

if TYPE_CHECKING:
    from procam.compensate.room import RoomPicture
    from procam.compensate.room_frames import RoomFrames

AnyCompensator = Union[Compensator, "RoomFrames"]
AnyPicture = Union[Compensated, "RoomPicture"]


def compensator_for(calibration: Calibration) -> "type[Compensator] | type[RoomFrames]":
    """The class of compensator for the screen of a calibration; both are made in the same way."""
    if not isinstance(calibration.screen, RoomScreen):
        return Compensator
    from procam.compensate.room_frames import RoomFrames  # noqa: PLC0415 - SciPy

    return RoomFrames
