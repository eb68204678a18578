"""Fixtures of several test files: seeded randomness and a small, fully known calibration."""

import signal
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from procam.devices.interrupts import SIGNALS
from procam.maths.geometry.lenses import Lens, unproject
from procam.maths.geometry.pose import Pose
from procam.maths.geometry.sphere import intersect_sphere, master_directions, normalise
from procam.model.calibration import Calibration, ProjectorCalibration
from procam.model.correspondence import ProjectorSurface
from procam.model.optics import CameraModel, ProjectorModel, Sensor
from procam.model.photometry import Photometry, ResponseCurve
from procam.model.provenance import Provenance
from procam.model.quality import Figure, Goal
from procam.model.screen import Dome
from procam.model.transport import Measured, ScreenMaps
from simulators.solid_angles import grid_solid_angles

# the same examples in every run; a busy machine is not a failure
settings.register_profile(
    "repeatable",
    derandomize=True,
    deadline=None,
    database=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("repeatable")


# test modules of minutes in all that rarely fail alone: small studies, builds for other processors, processes
# that are killed, commands of documents, fits on many samples
LONG = frozenset(
    f"test_{name}"
    for name in """
    acceptance audience behaviour camera cli_bundle cli_camera cli_chunks cli_external cli_pair
    cli_response content_small crash dataset_small demo_small diagnosis direction_samples doctor
    drifts_small eight_bits floor_albedo foreign_codes_small foreign_dome_small full_disk_commands
    fuzz howto_commands kernels_build kernels_frame large_camera light_refusals measured_rooms meshed_dome
    mistakes_small
    mutations notebooks other_seat own_devices page photometry_small physics_foreign_boards
    physics_forms planar_pair precision_small predecessor preference preference_statistics
    recalibrate refine response rooms_small rounds server set_checks shot_id solve solve_lens
    solve_tags unattended unattended_runs
    """.split()
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the long tests, and run them first, so that workers finish together."""
    for item in items:
        if item.path.stem in LONG:
            item.add_marker("long")
    items.sort(key=lambda item: item.get_closest_marker("long") is None)


@pytest.fixture(autouse=True)
def handlers_of_signals() -> Iterator[None]:
    """A command that a signal stopped leaves its process deaf to others."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture(scope="session", autouse=True)
def buffers_are_returned() -> Iterator[None]:
    """A command keeps its buffers until it ends; a process of tests runs hundreds of them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("procam.memory.LARGEST", 1 << 20)
        patch.setattr("procam.memory.NEVER", 1 << 20)
        yield


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(2011)


@pytest.fixture(scope="session")
def make_calibration() -> Callable[..., Calibration]:
    """The function `_calibration`."""
    return _calibration


@pytest.fixture(scope="session")
def calibration() -> Calibration:
    return _calibration()


def _calibration(
    *, size: int = 96, feedback: tuple[float, float, float] = (0.3, 0.33, 0.4), lo: float = 0.003
) -> Calibration:
    """Two projectors on a hemisphere of 6 m, lit down to 10 degrees above the springline.

    `feedback` is m on the maps' own solid angles before their slow waves; `lo` the black level.
    """
    dome = Dome(6.0, np.pi / 2, float(np.radians(10.0)), 0.1, 0.03)
    camera = CameraModel(
        "zenith",
        (64, 48),
        Lens("kannala-brandt", np.full(2, 18.0), np.array([31.7, 23.4]), np.array([0.02, 0, 0, 0])),
        Sensor(12, 64.0, (-0.04, -0.004), 0.003, 0.0003),
        Pose.from_vectors((0.05, -0.03, 0.4), (0.1, 0.2, -0.5)),
    )
    projectors = {
        name: _projector(name, azimuth, dome)
        for name, azimuth in (("south", 0.0), ("north", np.pi))
    }
    return Calibration(
        dome,
        {"zenith": camera},
        projectors,
        _maps(size, np.array(feedback), lo),
        Measured(np.array(feedback), np.array([0.002, 0.003, 0.004])),
        Measured(np.array([0.46, 0.5, 0.57]), np.array([0.01, 0.01, 0.02])),
        np.array([[9.0, -0.5, 0.1], [-0.4, 8.0, -0.3], [0.0, -0.2, 7.0]]),
        {"ratio": Figure(1.25, "-", Goal("<=", 2.0), 30, "a ratio")},
        Provenance("0001"),
        main_camera="zenith",
    )


def _maps(size: int, feedback: np.ndarray, lo: float) -> ScreenMaps:
    direction, inside = master_directions(size)
    elevation = np.arcsin(np.clip(direction[..., 2], -1, 1))
    coverage = np.where(inside & (elevation > np.radians(10.0)), 1.0, 0.0)
    wave = 1 + 0.03 * direction[..., 0] - 0.02 * direction[..., 1]
    lit_sr = 2 * np.pi * (1 - np.sin(np.radians(10.0)))
    scatter = wave[..., None] * feedback / lit_sr * inside[..., None]
    hi = (1.1 + 0.2 * direction[..., 2])[..., None] * np.ones(3)
    fields = {
        "scatter_per_flux": scatter,
        "albedo": wave[..., None] * np.array([0.46, 0.5, 0.57]),
        "lo": lo * coverage[..., None] * np.ones(3),
        "hi": hi * coverage[..., None],
        "coverage": coverage,
    }
    return ScreenMaps(**{name: field.astype(np.float32) for name, field in fields.items()})


def _projector(name: str, azimuth: float, dome: Dome) -> ProjectorCalibration:
    width, height = 48, 30
    place = dome.radius_m * np.array([-0.9 * np.cos(azimuth), -0.9 * np.sin(azimuth), 0.05])
    ahead = np.array([np.cos(azimuth) * 0.9, np.sin(azimuth) * 0.9, np.sqrt(1 - 0.81)])
    right = normalise(np.cross(ahead, [0.0, 0.0, 1.0]))
    rotation = np.stack([right, np.cross(ahead, right), ahead])
    lens = Lens(
        "brown", np.array([22.0, 22.5]), np.array([23.2, 17.0]), np.array([-0.02, 0.002, 0, 0, 0])
    )
    pose = Pose(rotation, -rotation @ place)
    model = ProjectorModel(name, (width, height), lens, pose, np.diag(np.arange(1.0, 13.0)) * 1e-6)

    def directions(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        pixels = np.stack(np.meshgrid(x, y), axis=-1).astype(float)
        rays = unproject(pixels, lens) @ rotation
        return normalise(intersect_sphere(place, rays, dome.radius_m))

    direction = directions(np.arange(width), np.arange(height))
    corners = directions(np.arange(width + 1) - 0.5, np.arange(height + 1) - 0.5)
    valid = direction[..., 2] > np.sin(np.radians(10.0))
    surface = ProjectorSurface(
        direction.astype(np.float32),
        grid_solid_angles(corners).astype(np.float32),
        valid,
        valid.astype(np.float32),
        np.full((height, width), 0.2, np.float32),
    )
    levels = np.linspace(0, 1, 33)
    values = np.stack([levels**g for g in (2.2, 2.3, 2.0)], axis=1)
    mix = np.array([[0.93, 0.06, 0.01], [0.05, 0.9, 0.05], [0.01, 0.04, 0.95]])
    gain = (1.2 + 0.3 * direction[..., :1]) * np.array([1.0, 1.1, 0.9]) * valid[..., None]
    blend = np.clip(0.5 + 0.4 * direction[..., 0] * np.sign(np.cos(azimuth)), 0, 1) * valid
    return ProjectorCalibration(
        model,
        surface,
        Photometry(
            ResponseCurve(levels, values, np.full_like(values, 1e-3)),
            mix,
            gain.astype(np.float32),
        ),
        blend.astype(np.float32),
    )
