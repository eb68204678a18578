"""The simulator's flux tracing against closed forms, within its own standard error.

Every value is a mean over independent replicates (random shifts of the ray pattern). The tests demand
|mean - expected| <= 4 standard errors, and a small standard error.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tolerances import FLOAT32, SIGMAS

import simulators.transport
from procam.maths.geometry.sphere import cap_solid_angle
from procam.maths.light.radiosity import albedo_from_feedback, floor_return
from simulators.presets import IDEAL, REALISTIC, Preset
from simulators.surface import Surface
from simulators.transport import Room

REPLICATES = 8
RAYS = 1024
RINGS, SECTORS = 12, 24  # of the dome; fewer patches than a demo has, more rays than it needs
DOME = RINGS * SECTORS
FLOOR_RINGS, FLOOR_SECTORS = 4, 8
FLOOR = slice(DOME, DOME + FLOOR_RINGS * FLOOR_SECTORS)
CLOSED = replace(IDEAL, tilt_deg=0.0)  # the deck closes the half sphere
WHITE_DECK = 0.3
Tracer = Callable[..., list[Room]]


@pytest.fixture(scope="module")
def trace() -> Tracer:
    """Independent rooms of a preset; each is traced once."""
    original, cache = np.random.default_rng, {}

    def rooms(preset: Preset, smooth: bool = True, count: int = REPLICATES) -> list[Room]:
        key = (preset, smooth, count)
        if key not in cache:
            with pytest.MonkeyPatch.context() as patch:
                sizes = {"DOME": (RINGS, SECTORS), "FLOOR": (FLOOR_RINGS, FLOOR_SECTORS)}
                for part, (rings, sectors) in sizes.items():
                    patch.setattr(simulators.transport, f"{part}_RINGS", rings)
                    patch.setattr(simulators.transport, f"{part}_SECTORS", sectors)
                if not smooth:
                    patch.setattr(
                        simulators.transport.Tracer,
                        "_smooth_over_neighbours",
                        lambda _, matrix: matrix,
                    )
                surface = Surface.build(preset)
                cache[key] = []
                for i in range(count):
                    patch.setattr(np.random, "default_rng", _shifted(original, i))
                    cache[key].append(Room.trace(surface, RAYS))
        return cache[key]

    return rooms


def _shifted(original: Callable[..., np.random.Generator], replicate: int) -> Callable[..., object]:
    """`default_rng` with other seeds; generators pass through."""
    return lambda seed: original([seed, replicate] if isinstance(seed, int) else seed)


def _judge(values: list[float] | np.ndarray, expected: float, standard_error: float) -> None:
    """Mean of replicates against `expected`; their relative standard error must be this small."""
    values = np.asarray(values)
    error = max(float(values.std(ddof=1) / np.sqrt(len(values))), FLOAT32 * abs(expected) / 10)
    assert error <= standard_error * abs(expected), f"standard error {error / expected:.2e}"
    z = (values.mean() - expected) / error
    assert abs(z) < SIGMAS, f"{values.mean():.8g} against {expected:.8g}, z = {z:.2f}"


def _one_sided(room: Room) -> np.ndarray:
    """Direct flux (P, 1) [m2 rel] on the front half of the dome alone."""
    flux = np.zeros((len(room.area_m2), 1))
    sector = np.arange(DOME) % SECTORS
    flux[:DOME, 0] = np.where((sector < 6) | (sector >= 18), room.area_m2[:DOME], 0.0)
    return flux


def _white(room: Room) -> np.ndarray:
    """Direct flux (P, 1) of a dome that is white all over: radiosity 1."""
    return np.where(np.arange(len(room.area_m2)) < DOME, room.area_m2, 0.0)[:, None]


def _mean(room: Room, values: np.ndarray, part: slice = slice(DOME)) -> float:
    area = room.area_m2[part]
    return float(area @ values[part] / area.sum())


class TestBlackDeck:
    """(I6): E = Phi / (A_s - a rho) everywhere on the sphere."""

    def _expected(self, room: Room, flux: np.ndarray) -> float:
        preset = room.surface.preset
        sphere = 4 * np.pi * preset.radius_m**2
        return float(flux.sum() / (sphere - preset.albedo * sphere / 2))

    def test_mean_irradiance(self, trace: Tracer) -> None:
        rooms = trace(IDEAL)
        flux = _one_sided(rooms[0])
        values = [_mean(r, r.irradiance(flux)[:, 0]) for r in rooms]
        _judge(values, self._expected(rooms[0], flux), 5e-4)

    def test_irradiance_is_uniform(self, trace: Tracer) -> None:
        """Scattered light of a one-sided picture is uniform within the noise."""
        rooms = trace(IDEAL)
        flux = _one_sided(rooms[0])
        light = np.stack([r.irradiance(flux)[:DOME, 0] for r in rooms])
        light = light / self._expected(rooms[0], flux) - 1
        sigma = np.sqrt(light.var(axis=0, ddof=1).mean() / REPLICATES)
        assert sigma < 3e-3
        # 288 patches: the largest of so many normals stays below 4.5
        assert np.abs(light.mean(axis=0)).max() < 4.5 * sigma

    def test_shares_of_cap_and_deck(self, trace: Tracer) -> None:
        rooms = trace(IDEAL)
        to_deck = (1 - np.sin(np.radians(IDEAL.tilt_deg))) / 2
        cap = [_mean(r, r.exchange[:, :DOME].sum(axis=1, dtype=float)) for r in rooms]
        deck = [_mean(r, r.exchange[:, FLOOR].sum(axis=1, dtype=float)) for r in rooms]
        _judge(cap, 0.5, 3e-4)
        _judge(deck, to_deck, 3e-4)

    def test_a_flat_deck_does_not_see_itself(self, trace: Tracer) -> None:
        for room in trace(IDEAL):
            assert not room.exchange[FLOOR, FLOOR].any()


class TestDeck:
    """Cap with a Lambertian deck: K = [1 + returned / f] / A_s, exact in the mean (I15)."""

    def _expected(self, preset: Preset, flux: np.ndarray) -> float:
        returned = floor_return(np.pi / 2, np.radians(preset.tilt_deg), WHITE_DECK)
        kernel = (1 + returned / 0.5) / (4 * np.pi * preset.radius_m**2)
        kappa = kernel * preset.albedo * 2 * np.pi * preset.radius_m**2
        return float(kernel * flux.sum() / (1 - kappa))

    def test_mean_irradiance(self, trace: Tracer) -> None:
        preset = replace(CLOSED, floor_albedo=WHITE_DECK)
        rooms = trace(preset)
        flux = _one_sided(rooms[0])
        values = [_mean(r, r.irradiance(flux)[:, 0]) for r in rooms]
        _judge(values, self._expected(preset, flux), 5e-4)

    def test_beside_a_gap_the_formula_is_a_little_low(self, trace: Tracer) -> None:
        """Places of the deck that see less of the dome receive less light and return less.

        `floor_return` uses one mean for both, and the mean of squares is larger (Jensen).
        """
        preset = replace(IDEAL, floor_albedo=WHITE_DECK)
        rooms = trace(preset)
        flux = _white(rooms[0])
        values = np.array([_mean(r, r.irradiance(flux)[:, 0]) for r in rooms])
        difference = values / self._expected(preset, flux) - 1
        error = difference.std(ddof=1) / np.sqrt(REPLICATES)
        assert SIGMAS * error < difference.mean() < 0.01

    def test_albedo_comes_back_from_the_feedback(self, trace: Tracer) -> None:
        rooms = trace(replace(CLOSED, floor_albedo=WHITE_DECK))
        cap = cap_solid_angle(np.pi / 2)
        returned = floor_return(np.pi / 2, 0.0, WHITE_DECK)
        values = []
        for room in rooms:
            feedback = _mean(room, CLOSED.albedo * room.irradiance(_white(room))[:, 0])
            found = albedo_from_feedback(np.array([feedback]), cap, cap, returned)
            values.append(float(found[0]))
        _judge(values, CLOSED.albedo, 3e-4)


class TestConservation:
    def test_furnace(self, trace: Tracer) -> None:
        """In a closed room whose walls emit 1 - rho, radiosity is 1 everywhere."""
        room = trace(replace(CLOSED, floor_albedo=WHITE_DECK))[0]
        np.testing.assert_allclose(room.exchange.sum(axis=1, dtype=float), 1, rtol=FLOAT32)
        glow = (1 - room.albedo) * room.area_m2
        np.testing.assert_allclose(room.irradiance(glow[:, None])[:, 0], 1, rtol=10 * FLOAT32)

    def test_all_light_is_absorbed(self, trace: Tracer) -> None:
        rooms = trace(replace(CLOSED, floor_albedo=WHITE_DECK))
        flux = _one_sided(rooms[0])
        absorbed = [float((r.area_m2 * (1 - r.albedo)) @ r.irradiance(flux)[:, 0]) for r in rooms]
        _judge(absorbed, float(flux.sum()), 5e-4)

    def test_reciprocity(self, trace: Tracer) -> None:
        """A_i F_ij = A_j F_ji between zones of dome, deck and pod, in z-scores."""
        preset = replace(REALISTIC, ovality=0.0, panel_step_m=0.0)
        rooms = trace(preset, smooth=False)
        zones = [slice(4 * SECTORS * i, 4 * SECTORS * (i + 1)) for i in range(3)]
        zones += [slice(FLOOR.start + 16 * i, FLOOR.start + 16 * (i + 1)) for i in range(2)]
        zones += [slice(FLOOR.stop, len(rooms[0].area_m2))]
        scores = []
        for i, one in enumerate(zones):
            for other in zones[:i]:
                difference = np.array([_flux(r, one, other) - _flux(r, other, one) for r in rooms])
                size = np.mean([_flux(r, one, other) for r in rooms])
                error = difference.std(ddof=1) / np.sqrt(REPLICATES)
                if size > 0:
                    assert error < 0.05 * size
                    scores.append(difference.mean() / error)
        assert len(scores) >= 13
        # Student's t with 7 degrees of freedom: 1e-3 in all for 15 pairs
        assert np.abs(scores).max() < 7.0
        assert np.sqrt(np.mean(np.square(scores))) < 2.0

    def test_no_light_is_created(self, trace: Tracer) -> None:
        for room in trace(REALISTIC, count=1):
            assert room.exchange.min() >= 0
            assert room.exchange.sum(axis=1, dtype=float).max() <= 1 + FLOAT32


def _flux(room: Room, seen_by: slice, source: slice) -> float:
    """A_i F_ij [m2] between two zones."""
    shares = room.exchange[seen_by, source].sum(axis=1, dtype=float)
    return float(room.area_m2[seen_by] @ shares)


def test_the_size_of_the_demo() -> None:
    """Patches as in the demo, an eighth of its rays, against (I6)."""
    room = Room.trace(Surface.build(IDEAL), 256)
    rings, sectors = simulators.transport.DOME_RINGS, simulators.transport.DOME_SECTORS
    flux = np.zeros((len(room.area_m2), 1))
    flux[:600, 0] = room.area_m2[:600]
    light = room.irradiance(flux)[: rings * sectors, 0].reshape(rings, sectors)
    # means over bands of five rings: patches share rays with their neighbours, bands hardly do
    bands = light.reshape(6, -1).mean(axis=1)
    _judge(bands, float(flux.sum() / (4 * np.pi * IDEAL.radius_m**2 * (1 - 0.25))), 5e-4)
