"""The perceptual methods: CPU time per megapixel of stills, and of movies' frames from the second on."""

from functools import cache

import cv2
import numpy as np

from benchmarks.measure import Goal, Report, Times, interleaved
from procam.compensate.compensator import Compensator
from procam.compensate.perceptual.settings import Perceptual
from procam.maths.geometry.sphere import master_directions, master_solid_angles
from procam.memory import keep_large_buffers
from procam.model.calibration import Calibration
from procam.model.screen import Dome
from procam.model.transport import Measured, ScreenMaps

NODES = 1024
STILL, MOVIE = 1024, 4096  # px
PAN_PX = 2
FEEDBACK = 0.33
OFFLINE, VIDEO = 5.0, 0.1  # CPU-s per Mpx
ROUNDS = 3


@cache
def calibration() -> Calibration:
    """A uniform dome without projectors."""
    direction, inside = master_directions(NODES)
    lit = inside & (direction[..., 2] > 0.1)
    one = np.ones((NODES, NODES, 3), np.float32)
    area = float((master_solid_angles(NODES) * lit).sum())
    maps = ScreenMaps(
        scatter_per_flux=one * np.float32(FEEDBACK / area),
        albedo=one * np.float32(0.5),
        lo=one * np.float32(0.0005),
        hi=one,
        coverage=lit.astype(np.float32),
    )
    known = Measured(np.full(3, FEEDBACK), np.full(3, 0.01))
    return Calibration(Dome(6.0, np.pi / 2), {}, {}, maps, known, known, np.eye(3), {}, {})


def dusk(size: int) -> np.ndarray:
    """Dark ground with detail under a bright sky (N, N, 3), 8 bits."""
    rng = np.random.default_rng(5)
    grain = cv2.resize(rng.integers(10, 70, (size // 8, size // 8), np.uint8), (size, size))
    light = np.where(np.arange(size)[:, None] < size // 2, 200, grain)
    return np.repeat(light[..., None], 3, axis=2).astype(np.uint8)


class Show:
    """Frames of a slow pan."""

    def __init__(self, method: Perceptual | str, size: int) -> None:
        self._compensator = Compensator(calibration(), size, method)
        first = dusk(size)
        self._frames = [first, np.ascontiguousarray(np.roll(first, PAN_PX, axis=1))]
        self._out, self._shown = np.empty_like(first), 0

    def __call__(self) -> None:
        """The next frame."""
        self._compensator.frame(self._frames[self._shown % 2], self._out)
        self._shown += 1


def bench() -> Report:
    """Stills of 1 Mpx, and a movie of 4096^2, of 8 bits."""
    keep_large_buffers()
    shows = {
        "still": Show(Perceptual(), STILL),
        "movie, a frame": Show(Perceptual(video=True), MOVIE),
        "exact, 4096^2": Show("exact", MOVIE),
    }
    times = interleaved(shows, rounds=ROUNDS)
    goals = (
        _per_mpx("still", times["still"], STILL, OFFLINE),
        _per_mpx("movie, a frame", times["movie, a frame"], MOVIE, VIDEO),
    )
    return Report("Perceptual compensation, 8 bits", times, goals)


def _per_mpx(name: str, times: Times, size: int, limit: float) -> Goal:
    return Goal(name, times.cpu_s / (size**2 / 1e6), "<=", limit, "CPU-s/Mpx")
