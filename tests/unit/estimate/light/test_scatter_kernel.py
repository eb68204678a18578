"""Degree of the scatter kernel by cross-validation, and albedo of the floor, in traced rooms."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from procam.errors import OutOfModelRange
from procam.estimate.light.floor_albedo import (
    FloorLight,
    combined_floor_albedo,
    discrepancy,
    measure_floor,
)
from procam.estimate.light.scatter_kernel import (
    CELLS,
    ScatterCells,
    ScatterSample,
    cell_basis,
    fit_scatter,
)
from procam.maths.geometry.sphere import master_directions, master_pixels, master_solid_angles
from procam.maths.warp import sample
from procam.model.screen import Dome
from simulators.presets import PRESETS
from simulators.surface import Surface
from simulators.transport import DOME_RINGS, DOME_SECTORS, Room

Array = NDArray[np.float64]
Where = Callable[[Array], NDArray[np.bool_]]
DIRECTION = master_directions(CELLS)[0].reshape(-1, 3)
INSIDE = master_directions(CELLS)[1].ravel()
TILT = np.radians(10.0)


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

    def __init__(self, floor_albedo: float, pod: bool = False) -> None:
        preset = replace(PRESETS["standard"], floor_albedo=floor_albedo, pod=pod)
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
        image = self.room.dome_image(self.room.irradiance(flux))[..., 0]
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


@pytest.fixture(scope="module")
def furnished() -> TracedRoom:
    return TracedRoom(0.3, pod=True)


@pytest.fixture(scope="module")
def bare() -> TracedRoom:
    return TracedRoom(0.0)


def fitted(room: TracedRoom, noise: float = 0.003):  # type: ignore[no-untyped-def]
    per_flux, white = room.known()
    found = [room.scatter_sample(lit, noise) for lit in parts()]
    return fit_scatter(found, per_flux, cell_basis().T @ white)


def test_a_bare_dome_takes_one_scalar(bare: TracedRoom) -> None:
    fit = fitted(bare)
    assert fit.kernel.degree == 0
    assert "one scalar per colour used" in fit.summary()
    assert fit.held_out[0] < 0.02


def test_a_furnished_one_takes_a_higher_degree(furnished: TracedRoom) -> None:
    fit = fitted(furnished)
    assert fit.kernel.degree >= 1
    assert fit.held_out[fit.kernel.degree] < 0.5 * fit.held_out[0]
    assert f"degree {fit.kernel.degree} used" in fit.summary()


def test_pictures_that_miss_the_dome_are_left_out(furnished: TracedRoom) -> None:
    per_flux, white = furnished.known()
    found = [furnished.scatter_sample(lit, 0.003) for lit in parts()]
    dark = replace(found[0], direct=1e-4 * found[0].direct, scattered=1e-4 * found[0].scattered)
    moment = cell_basis().T @ white
    chosen = fit_scatter([*found, dark], per_flux, moment)
    assert chosen.kernel.degree == fit_scatter(found, per_flux, moment).kernel.degree >= 1
    assert max(chosen.held_out.values()) < 0.2


@pytest.mark.parametrize(
    ("per_flux", "white", "message"),
    [
        (-1.0, 1.0, "no scattered light .+ glare or black_level"),
        (1.0, np.nan, "full white is unknown"),
    ],
)
def test_impossible_light_is_refused(
    per_flux: float, white: float, message: str, bare: TracedRoom
) -> None:
    found = [bare.scatter_sample(lit, 0.0) for lit in parts()[:2]]
    with pytest.raises(OutOfModelRange, match=message):
        fit_scatter(found, np.full((CELLS**2, 1), per_flux), np.full((9, 1), white))


def test_too_few_pictures_take_one_scalar(furnished: TracedRoom) -> None:
    per_flux, white = furnished.known()
    found = [furnished.scatter_sample(lit, 0.0) for lit in parts()[:1]]
    fit = fit_scatter(found, per_flux, cell_basis().T @ white)
    assert fit.kernel.degree == 0 and not fit.held_out
    assert "too few pictures" in fit.summary()


@pytest.mark.parametrize("asked", [0.0, 0.3])
def test_floor_albedo_of_a_traced_room(
    asked: float, bare: TracedRoom, furnished: TracedRoom
) -> None:
    room = furnished if asked else bare
    per_flux, white = room.known()
    found = [room.scatter_sample(lit, 0.003) for lit in parts()]
    dome = Dome(6.0, np.pi / 2, TILT, 0.1, 0.05)
    floor = measure_floor(found, per_flux, white, dome, 0.5)
    assert abs(floor.albedo - asked) < 2.5 * floor.sigma + 0.005
    assert floor.sigma < 0.04
    assert floor.flux_inconsistency < 0.02


def test_scales_of_pictures_do_not_count_for_the_floor(furnished: TracedRoom) -> None:
    """A projector that has drifted, or whose gloss hides light, gives the same floor."""
    per_flux, white = furnished.known()
    found = [furnished.scatter_sample(lit, 0.0) for lit in parts()]
    drifted = [replace(x, scattered=x.scattered * (1 + 0.1 * i)) for i, x in enumerate(found)]
    dome = Dome(6.0, np.pi / 2, TILT, 0.1, 0.05)
    first, second = (measure_floor(x, per_flux, white, dome, 0.5) for x in (found, drifted))
    assert second.albedo == pytest.approx(first.albedo, rel=0.02)
    assert second.flux_inconsistency == pytest.approx(np.std(0.1 * np.arange(8)), rel=0.1)


def test_known_and_measured_floor_are_weighted_by_their_sigmas() -> None:
    dome = Dome(6.0, np.pi / 2, 0.0, 0.10, 0.03)
    assert combined_floor_albedo(dome, FloorLight(0.2, np.inf, 0.0)) == pytest.approx((0.10, 0.03))
    assert combined_floor_albedo(dome, FloorLight(0.12, 0.03, 0.0)) == pytest.approx(
        (0.11, 0.03 / np.sqrt(2))
    )


def test_a_discrepancy_widens_the_error() -> None:
    dome, found = Dome(6.0, np.pi / 2, 0.0, 0.10, 0.03), FloorLight(0.28, 0.03, 0.0)
    value, sigma = combined_floor_albedo(dome, found)
    assert value == pytest.approx(0.19)
    assert sigma == pytest.approx(0.18 / np.sqrt(2) / np.sqrt(2))
    assert discrepancy(dome, found) == pytest.approx(0.18 / 0.03 / np.sqrt(2))


class TestCells:
    def camera(self) -> ScatterCells:
        direction, inside = master_directions(4 * CELLS)
        self.inside = inside
        return ScatterCells(direction.astype(np.float32), inside * master_solid_angles(4 * CELLS))

    def test_means_and_flux(self) -> None:
        cells = self.camera()
        picture = np.full((4 * CELLS, 4 * CELLS, 3), 0.5, np.float32)
        found = cells.scatter_sample(picture, self.inside, 2 * picture)
        known = found.pixels > 0
        np.testing.assert_allclose(found.scattered[known], 0.5)
        np.testing.assert_allclose(found.direct.sum(axis=0), 2 * np.pi, rtol=2e-3)
        np.testing.assert_allclose(found.moment[0], found.direct.sum(axis=0))

    def test_cells_with_direct_light_in_them_are_unknown(self) -> None:
        cells = self.camera()
        picture = np.ones((4 * CELLS, 4 * CELLS, 3), np.float32)
        known = self.inside.copy()
        known[: 2 * CELLS + 2] = False  # half of a row of cells
        mean, pixels = cells.mean(picture, known)
        rows = np.isfinite(mean[:, 0]).reshape(CELLS, CELLS).any(axis=1)
        assert not rows[: CELLS // 2 + 1].any() and rows[CELLS // 2 + 1 :].any()
        assert (pixels[~np.isfinite(mean[:, 0])] == 0).all()

    def test_other_channels(self) -> None:
        scatter_sample = ScatterSample(np.ones((4, 3)), np.ones(4), np.ones((4, 3)))
        found = scatter_sample.converted(np.diag([1.0, 2.0, 3.0]))
        np.testing.assert_allclose(found.direct[0], [1, 2, 3])
        np.testing.assert_allclose(found.scattered[0], [1, 2, 3])
