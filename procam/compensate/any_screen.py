"""The compensator of a dome or of a room."""

from typing import TYPE_CHECKING, Any, Union

from procam.compensate.compensator import Compensator
from procam.compensate.perceptual.settings import Perceptual
from procam.model.calibration import Calibration
from procam.model.screen import RoomScreen

if TYPE_CHECKING:
    from procam.compensate.room_frames import RoomFrames

AnyCompensator = Union[Compensator, "RoomFrames"]


def compensator_of(
    calibration: Calibration,
    size: int,
    method: str | Perceptual = "exact",
    state: str | None = None,
    *,
    strength: float = 1.0,
    white: str = "summed",
    transfer_name: str | None = None,
) -> AnyCompensator:
    """The compensator for a calibration of a dome or of a room; see `Compensator`."""
    kind: Any = Compensator
    if isinstance(calibration.screen, RoomScreen):
        from procam.compensate.room_frames import RoomFrames  # noqa: PLC0415 - SciPy

        kind = RoomFrames
    made: AnyCompensator = kind(
        calibration,
        size,
        method,
        state,
        strength=strength,
        white=white,
        transfer_name=transfer_name,
    )
    return made
