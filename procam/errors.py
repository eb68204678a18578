"""Everything procam can refuse or fail at, in one tree.

::

    ProcamError
    |-- InputError            the caller's or the file's fault; exit code 2
    |   |-- ShapeError        an array of the wrong shape
    |   |-- UnitError         a number outside what its unit allows
    |   `-- FileFormatError   a file that is missing, truncated, foreign or inconsistent
    |-- CalibrationError      the captures do not carry the answer
    |   |-- NotEnoughData     too little was seen
    |   |-- DidNotConverge    a solve stopped short of its tolerance
    |   `-- OutOfModelRange   the measured thing does not obey the model
    `-- DeviceError           a projector, camera or wire misbehaved
        |-- NotConnected      nothing answers
        |-- WrongState        it answers, but cannot do this now
        |-- Unsupported       it never can
        |-- DeviceTimeout     it did not answer in time
        `-- StaleFrame        the camera delivered an old picture

A message says what, what was got, what was expected, and what to try next.
"""

from collections.abc import Sequence


class ProcamError(Exception):
    """Base of all errors that procam raises on purpose."""


class InputError(ProcamError, ValueError):
    """The caller or a file gave something that cannot be used."""


class ShapeError(InputError):
    """An array has the wrong shape."""

    def __init__(self, what: str, got: Sequence[int], expected: str) -> None:
        super().__init__(f"{what}: got shape {tuple(got)}, expected {expected}")


class UnitError(InputError):
    """A number lies outside what its unit allows."""


class FileFormatError(InputError):
    """A file is missing, truncated, foreign or inconsistent with its neighbours."""


class CalibrationError(ProcamError):
    """The captures do not carry the answer."""


class NotEnoughData(CalibrationError):
    """Too little was seen to solve for what is asked."""


class DidNotConverge(CalibrationError):
    """A solve stopped short of its tolerance."""


class OutOfModelRange(CalibrationError):
    """The measured thing does not obey the model."""


class DeviceError(ProcamError):
    """A projector, camera or wire misbehaved."""


class NotConnected(DeviceError):
    """Nothing answers."""


class WrongState(DeviceError):
    """The device answers, but cannot do this now."""


class Unsupported(DeviceError):
    """The device can never do this."""


class DeviceTimeout(DeviceError):
    """The device did not answer in time."""


class StaleFrame(DeviceError):
    """The camera delivered a picture taken before the pattern was up."""
