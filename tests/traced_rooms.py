"""Scattered light of domes over a floor, by ray tracing, in the cells of the scatter kernel's fit."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from procam.estimate.light.scatter_kernel import CELLS, ScatterSample
from procam.maths.geometry.sphere import master_directions, master_pixels
from procam.maths.warp import sample
from simulators.presets import PRESETS
from simulators.surface import Surface
from simulators.transport import DOME_RINGS, DOME_SECTORS, Room

Array = NDArray[np.float64]
Where = Callable[[Array], NDArray[np.bool_]]
DIRECTION = master_directions(CELLS)[0].reshape(-1, 3)
INSIDE = master_directions(CELLS)[1].ravel()


def parts() -> list[Where]:
    """Quarters of two pictures that share the dome, each of them front or back."""

    def quarter(front: float, left: float, high: bool) -> Where:
        def lit(d: Array) -> NDArray[np.bool_]:
            return (
                (front * d[:, 0] + 0.4 * d[:, 2] > 0)
                & (left * d[:, 1] > 0)
                & ((d[:, 2] > 0.55) == high)
                & (d[:, 2] > 0.1)
            )

        return lit

    sides = (1.0, -1.0)
    return [quarter(f, side, high) for f in sides for side in sides for high in (False, True)]


class TracedRoom:
    """Scattered light of a dome over a floor, by ray tracing."""

    def __init__(self, floor_albedo: float, pod: bool = False, **rest: Any) -> None:
        preset = replace(PRESETS["standard"], floor_albedo=floor_albedo, pod=pod, **rest)
        self.room = Room.trace(Surface.build(preset), 512)
        self.patches = self._patches()

    def _patches(self) -> Array:
        ring, sector = np.divmod(np.arange(DOME_RINGS * DOME_SECTORS), DOME_SECTORS)
        z, azimuth = 1 - (ring + 0.5) / DOME_RINGS, (sector + 0.5) / DOME_SECTORS * 2 * np.pi
        across = np.sqrt(1 - z * z)
        return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1)

    def scattered(self, lit: Where) -> Array:
        """Scattered light in the cells, per albedo."""
        flux = np.zeros((len(self.room.area_m2), 1))
        count = len(self.patches)
        flux[:count, 0] = lit(self.patches) * self.room.area_m2[:count]
        image = self.room.patch_image(self.room.irradiance(flux))[..., 0]
        return sample(image, self.room.dome_image_coordinates(DIRECTION)[None])[0].astype(float)

    def scatter_sample(self, lit: Where, noise: float) -> ScatterSample:
        met = lit(DIRECTION) & INSIDE
        rng = np.random.default_rng(int(1000 * met.sum()))
        light = self.scattered(lit)
        seen = light + noise * light.mean() * rng.normal(size=len(light))
        seen = np.where(INSIDE & ~met, seen, np.nan)[:, None]
        return ScatterSample(seen, np.isfinite(seen[:, 0]) * 1.0, self.flux(lit))

    def flux(self, lit: Where) -> Array:
        """Direct flux (N, 1) in the cells, patch by patch."""
        place = np.rint(master_pixels(self.patches, CELLS)).astype(int).clip(0, CELLS - 1)
        each = lit(self.patches) * 2 * np.pi / len(self.patches)
        return np.bincount(place[:, 1] * CELLS + place[:, 0], each, CELLS**2)[:, None]

    def known(self) -> tuple[Array, Array]:
        """Scattered light of white per flux (N, 1), and white's flux in the cells (N, 1)."""
        white = self.flux(lambda d: d[:, 2] > 0.1)
        light = self.scattered(lambda d: d[:, 2] > 0.1)
        return np.where(INSIDE, light / white.sum(), np.nan)[:, None], white


@pytest.fixture(scope="session")
def furnished() -> TracedRoom:
    return TracedRoom(0.3, pod=True)


@pytest.fixture(scope="session")
def bare() -> TracedRoom:
    return TracedRoom(0.0)
