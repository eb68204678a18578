"""How much memory a solve will take."""

from collections.abc import Iterable

from procam.estimate.camera.binning import Binning
from procam.model.optics import CameraModel
from procam.workflows.solve.decode import decode_bytes
from procam.workflows.solve.side_by_side import workers
from procam.workflows.solve.sight import sight_bytes

PROGRAM = 0.7e9  # bytes of the program and its libraries
VIEW = 75.0  # bytes of each pixel of light, at all times


def solve_bytes(cameras: Iterable[CameraModel]) -> float:
    """Largest memory of a solve [byte], whatever the number of projectors (benchmarks/memory.md)."""
    return PROGRAM + max(max(_decoding(camera), _light(camera)) for camera in cameras)


def _decoding(camera: CameraModel) -> float:
    each = decode_bytes(camera)
    return workers(each) * each


def _light(camera: CameraModel) -> float:
    width, height = Binning.of(camera).size
    each = sight_bytes(camera)
    return workers(each) * each + VIEW * width * height
