"""Solid angles of the pixels of a 4K panel."""

import tracemalloc

import numpy as np

from benchmarks import floor
from benchmarks.measure import (
    Goal,
    Report,
    at_least,
    at_levels,
    between_levels,
    interleaved,
    over_floor,
)
from procam import kernels
from procam.kernels.native.arrays import planes
from procam.maths.geometry.areas import panel_solid_angles
from procam.maths.geometry.sphere import grid_solid_angles, intersect_sphere, normalise

SIZE = (3840, 2160)
LARGEST = (7680, 4320)
PLACE = np.array([-3.0, 2.0, 0.3])
RADIUS_M = 6.0


def directions(size: tuple[int, int], x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Where an off-centre pinhole's pixels land, from the centre of a dome of 6 m."""
    rays = np.empty((len(y), len(x), 3))
    rays[..., 0] = 1.0
    rays[..., 1] = (0.5 - x / size[0]) * 1.6
    rays[..., 2] = ((0.5 - y / size[1]) * 0.9)[:, None] + 0.6
    return normalise(intersect_sphere(PLACE, normalise(rays), RADIUS_M))


def held(size: tuple[int, int]) -> float:
    """Bytes that a streamed panel takes beside its result."""
    tracemalloc.start()
    found = panel_solid_angles(size, lambda x, y: directions(size, x, y))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak - found.nbytes


def bench() -> Report:
    """Corners given, 3840x2160 cells, float64."""
    width, height = SIZE
    corners = directions(SIZE, np.arange(width + 1) - 0.5, np.arange(height + 1) - 0.5)
    out = planes((height, 2 * width), 1)[0].view(np.float64)

    def kernel() -> None:
        kernels.solid_angles([corners], (height, width), out=out)

    times = interleaved(
        {
            "kernel": kernel,
            **at_levels("kernel", kernel),
            "NumPy": lambda: grid_solid_angles(corners),
            "floor": floor.Floor(corners, out.nbytes),
        },
        rounds=5,
    )
    apart = float(np.abs(out / grid_solid_angles(corners) - 1).max())
    return Report(
        "Solid angles, 3840x2160 cells from corner directions, float64",
        times,
        (
            at_least(times, "kernel", "NumPy", 40),
            Goal(
                "kernel against NumPy, one core each",
                times["NumPy"].cpu_s / times["kernel"].cpu_s,
                ">=",
                40,
            ),
            *over_floor(times, "kernel", "floor", {"avx512": 2, "avx2": 4.4}),
            *between_levels(times, "kernel", 2.2),
            Goal("largest difference from NumPy, relative", apart, "<=", 1e-9, ""),
            Goal("held beside the result, 7680x4320", held(LARGEST) / 2**20, "<=", 16, "MiB"),
        ),
        (floor.name(), "results are written to an array that exists"),
    )
