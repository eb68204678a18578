"""The tree of exceptions that procam raises on purpose.

::

    ProcamError
    |-- InputError            an argument or a file cannot be used; exit code 2
    |   |-- ShapeError        an array of the wrong shape
    |   |-- UnitError         a number outside what its unit allows
    |   `-- FileFormatError   a file that is missing, truncated, foreign or inconsistent
    |-- CalibrationError      the photographs do not determine the result
    |   |-- NotEnoughData     too few observations
    |   |-- DidNotConverge    a solve stopped short of its tolerance
    |   `-- OutOfModelRange   the measurement contradicts the model
    `-- DeviceError           a projector, camera or connection failed
        |-- NotConnected      no answer from the device
        |-- WrongState        the device cannot do this now
        |-- Unsupported       the device can never do this
        |-- DeviceTimeout     no answer in time
        `-- StaleFrame        the camera delivered a picture from before the pattern

A message is one or two plain sentences: what is wrong and where, what is needed, and what to do next.
"""

from collections.abc import Sequence


class ProcamError(Exception):
    """Base class of all errors that procam raises on purpose."""


class InputError(ProcamError, ValueError):
    """An argument or a file cannot be used."""


class ShapeError(InputError):
    """An array has the wrong shape.

    Parameters
    ----------
    what : the array. shape : its shape. needed : the shape that it should have, and why.
    """

    def __init__(self, what: str, shape: Sequence[int], needed: str) -> None:
        super().__init__(f"{what} has shape {tuple(shape)}; it needs {needed}")


class UnitError(InputError):
    """A number lies outside what its unit allows."""


class FileFormatError(InputError):
    """A file is missing, truncated, foreign or inconsistent with its neighbours."""


class CalibrationError(ProcamError):
    """The photographs do not determine the result."""


class NotEnoughData(CalibrationError):
    """There are too few observations to solve for the unknowns."""


class DidNotConverge(CalibrationError):
    """A solve stopped short of its tolerance."""


class OutOfModelRange(CalibrationError):
    """A measurement contradicts the model."""


class DeviceError(ProcamError):
    """A projector, camera or connection failed."""


class NotConnected(DeviceError):
    """The device does not answer."""


class WrongState(DeviceError):
    """The device cannot do this in its present state."""


class Unsupported(DeviceError):
    """The device can never do this."""


class DeviceTimeout(DeviceError):
    """The device did not answer in time."""


class StaleFrame(DeviceError):
    """The camera delivered a picture taken before the pattern was up."""
