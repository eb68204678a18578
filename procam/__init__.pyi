# What type checkers see of the names that `__init__.py` imports when they are first used.
from procam.compensate.compensator import Compensator
from procam.compensate.perceptual.settings import Perceptual
from procam.compensate.projector_frames import Warper
from procam.errors import CalibrationError, DeviceError, InputError, ProcamError
from procam.files.calibration import load_calibration, save_calibration
from procam.files.dataset import load_dataset
from procam.files.venue.load import create_venue
from procam.interfaces.api import calibrate_camera, capture, decode, generate_patterns, solve
from procam.maths.geometry.lenses import Lens
from procam.maths.geometry.pose import Pose
from procam.maths.light.radiosity import add_interreflection, remove_interreflection, sphere_scatter
from procam.model.calibration import Calibration
from procam.model.correspondence import CorrespondenceMap
from procam.model.optics import CameraModel, ProjectorModel
from procam.model.screen import Dome
from procam.model.venue_state import VenueState

__all__ = [
    "Calibration",
    "CalibrationError",
    "CameraModel",
    "Compensator",
    "CorrespondenceMap",
    "DeviceError",
    "Dome",
    "InputError",
    "Lens",
    "Perceptual",
    "Pose",
    "ProcamError",
    "ProjectorModel",
    "VenueState",
    "Warper",
    "add_interreflection",
    "calibrate_camera",
    "capture",
    "create_venue",
    "decode",
    "generate_patterns",
    "load_calibration",
    "load_dataset",
    "remove_interreflection",
    "save_calibration",
    "solve",
    "sphere_scatter",
]

__version__: str
