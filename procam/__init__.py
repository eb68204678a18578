"""procam: calibrates projection domes with cameras and removes the light that bounces round them.

    >>> import procam
    >>> patterns = procam.generate_patterns((128, 80))
    >>> found = procam.decode(patterns, (128, 80))
    >>> found.projector_xy.shape
    (80, 128, 2)

Names are imported when they are first used; which module holds them is not part of the interface.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_MODULES = {
    "compensate.compensator": ("Compensator",),
    "compensate.perceptual.settings": ("Perceptual",),
    "compensate.projector_frames": ("Warper",),
    "errors": ("CalibrationError", "DeviceError", "InputError", "ProcamError"),
    "files.calibration": ("load_calibration", "save_calibration"),
    "files.dataset": ("load_dataset",),
    "files.venue.load": ("create_venue",),
    "interfaces.api": ("calibrate_camera", "capture", "decode", "generate_patterns", "solve"),
    "maths.geometry.lenses": ("Lens",),
    "maths.geometry.pose": ("Pose",),
    "maths.light.radiosity": ("add_interreflection", "remove_interreflection", "sphere_scatter"),
    "model.calibration": ("Calibration",),
    "model.correspondence": ("CorrespondenceMap",),
    "model.optics": ("CameraModel", "ProjectorModel"),
    "model.screen": ("Dome",),
    "model.venue_state": ("VenueState",),
}
_HOME = {name: module for module, names in _MODULES.items() for name in names}

__all__ = sorted(_HOME)  # noqa: PLE0605 - __init__.pyi lists them for type checkers


def __getattr__(name: str) -> Any:
    """Import a public name on its first use (PEP 562)."""
    if name not in _HOME:
        raise AttributeError(f"module 'procam' has no attribute {name!r}")
    value = getattr(import_module(f"procam.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
