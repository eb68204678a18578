"""What a unit of each channel is, from readings that were summed up pixel by pixel."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hand_meter import (
    EVERY,
    LEFT,
    MIDDLE,
    RIGHT,
    XYZ_FROM_CONTENT,
    Meter,
    known_dome,
    with_noise,
)
from tolerances import SIGMAS

from procam.errors import InputError, NotEnoughData
from procam.estimate.light.absolute import fit_absolute
from procam.model.calibration import Calibration
from procam.model.reading import MeterReading
from procam.model.transport import ScatterKernel

EXACT = 1e-6  # of white; the maps are float32
HERE = ("south", MIDDLE)
SPOTS = (HERE, ("south", LEFT), ("north", MIDDLE), ("north", RIGHT))


@pytest.fixture(scope="module")
def dome(make_calibration: Callable[..., Calibration]) -> Calibration:
    return known_dome(make_calibration)


@pytest.fixture(scope="module")
def meter(dome: Calibration) -> Meter:
    return Meter(dome)


@pytest.fixture(scope="module")
def readings(meter: Meter) -> list[MeterReading]:
    """Red, green, blue and white at four places."""
    return meter.read_all(*SPOTS)


def error(found: np.ndarray, truth: np.ndarray = XYZ_FROM_CONTENT) -> float:
    return float(np.abs(found - truth).max() / truth[1].sum())


def scaled(reading: MeterReading, factor: float) -> MeterReading:
    return replace(reading, xyz=factor * reading.xyz)


class TestExact:
    @pytest.mark.parametrize("spots", [SPOTS[:1], SPOTS[2:3], SPOTS], ids=["south", "north", "all"])
    def test_without_noise(self, dome: Calibration, meter: Meter, spots: tuple) -> None:
        found = fit_absolute(meter.read_all(*spots), dome)
        assert error(found.colour.xyz_from_content) < EXACT
        assert found.colour.nits_per_unit[0] == pytest.approx(XYZ_FROM_CONTENT[1].sum(), rel=EXACT)
        assert found.residual_de2000.max() < 1e-3
        assert found.additivity is not None
        assert found.additivity.error == pytest.approx(0, abs=EXACT)
        assert (found.contrast, found.notes) == (None, ())

    @pytest.mark.parametrize("missing", ["red", "green", "blue", "white"])
    def test_three_patches_do(self, dome: Calibration, meter: Meter, missing: str) -> None:
        patches = tuple({"red", "green", "blue", "white"} - {missing})
        found = fit_absolute(meter.read_all(HERE, patches=patches), dome)
        assert error(found.colour.xyz_from_content) < EXACT
        assert found.additivity is None
        assert found.notes == (
            "no place has red, green, blue and white, so additivity is not tested",
        )

    def test_a_reading_of_black_subtracts_the_light_of_the_room(self, dome: Calibration) -> None:
        lit_room = Meter(dome, room=(0.2, 0.25, 0.1))
        found = fit_absolute(lit_room.read_all(*SPOTS[:2], patches=EVERY), dome)
        assert error(found.colour.xyz_from_content) < EXACT
        assert found.additivity.error == pytest.approx(0, abs=EXACT)
        assert len(found.notes) == 2
        assert "black is 0.3" in found.notes[0]
        left_in = fit_absolute(lit_room.read_all(*SPOTS[:2]), dome)
        assert error(left_in.colour.xyz_from_content) > 0.005

    def test_contrast(self, dome: Calibration, meter: Meter) -> None:
        found = fit_absolute(meter.read_all(HERE, patches=EVERY), dome)
        assert found.contrast == pytest.approx(1.004 / 0.004)
        assert found.notes == ()

    def test_a_kernel_of_higher_degree(self, dome: Calibration) -> None:
        """1 + b (3 x x' + 3 y y' + 12 (z - 1/2)(z' - 1/2)): B is diagonal on the half sphere."""
        b = 0.2
        kernel = ScatterKernel(1, np.tile(np.diag([1, b, b, b]), (3, 1, 1)), np.eye(4)[[0, 0, 0]])
        bent = replace(dome, maps=replace(dome.maps, kernel=kernel))

        def shape(place: np.ndarray, patches: np.ndarray) -> np.ndarray:
            flat = 3 * patches[:, :2] @ place[:2]
            return 1 + b * (flat + 12 * (patches[:, 2] - 0.5) * (place[2] - 0.5))

        readings = Meter(dome, shape=shape).read_all(*SPOTS)
        assert error(fit_absolute(readings, bent).colour.xyz_from_content) < EXACT
        assert error(fit_absolute(readings, dome).colour.xyz_from_content) > 100 * EXACT


def test_the_errors_of_a_meter_are_as_large_as_stated(
    dome: Calibration, readings: list[MeterReading]
) -> None:
    rng, runs = np.random.default_rng(7), 90
    z = np.empty((runs, 10))
    contradictions = 0
    for run in range(runs):
        found = fit_absolute(with_noise(readings, rng), dome)
        (nits, sigma), colour = found.colour.nits_per_unit, found.colour
        z[run, :9] = ((colour.xyz_from_content - XYZ_FROM_CONTENT) / colour.sigma).ravel()
        z[run, 9] = (nits - XYZ_FROM_CONTENT[1].sum()) / sigma
        contradictions += any("contradict" in note for note in found.notes)
        assert found.residual_de2000.mean() < 2
    assert np.abs(z.mean(axis=0)).max() < SIGMAS / np.sqrt(runs)
    assert np.abs(z.var(axis=0) - 1).max() < SIGMAS * np.sqrt(2 / runs)
    assert contradictions <= 1  # one in a thousand is allowed


def test_more_readings_are_surer(dome: Calibration, readings: list[MeterReading]) -> None:
    once = fit_absolute(readings, dome).colour.sigma
    often = fit_absolute([replace(r, count=4) for r in readings], dome).colour.sigma
    assert often == pytest.approx(once / 2)


def test_sigma_of_additivity(dome: Calibration, meter: Meter) -> None:
    rng, readings = np.random.default_rng(8), meter.read_all(*SPOTS[:2])
    found = [fit_absolute(with_noise(readings, rng), dome).additivity for _ in range(60)]
    z = np.array([a.error / a.sigma for a in found])
    assert abs(z.mean()) < SIGMAS / np.sqrt(60)
    assert abs(z.var() - 1) < SIGMAS * np.sqrt(2 / 60)


class TestNotes:
    def test_white_boost(self, dome: Calibration, readings: list[MeterReading]) -> None:
        boosted = [scaled(r, 1.25) if r.patch == "white" else r for r in readings]
        found = fit_absolute(boosted, dome)
        assert found.additivity.error == pytest.approx(1 / 1.25 - 1, abs=0.002)
        assert found.notes[0] == (
            "south: red + green + blue differ by -20.1% from white (meter's error 1.6%), so its light does "
            "not add up; switch off white boost or brilliant colour, calibrate and read again"
        )
        assert "times the meter's error" in found.notes[1]
        assert not any("contradict" in note for note in found.notes)
        assert found.worst[1] > 3
        assert (found.colour.sigma > fit_absolute(readings, dome).colour.sigma).all()

    def test_projectors_that_contradict(
        self, dome: Calibration, readings: list[MeterReading]
    ) -> None:
        dimmed = [scaled(r, 0.85) if r.projector == "north" else r for r in readings]
        (note,) = (n for n in fit_absolute(dimmed, dome).notes if "contradict" in n)
        assert "those of north: +17.6%" in note or "those of south: -15.0%" in note
        assert "dE2000" in note

    def test_the_one_of_three_that_contradicts(self, dome: Calibration, meter: Meter) -> None:
        south = dome.projectors["south"]
        three = replace(dome, projectors={**dome.projectors, "third": south})
        third = [replace(r, projector="third") for r in meter.read_all(HERE)]
        # without a reading, black would be divided among all that reach a place
        blacks = meter.read_all(HERE, ("north", RIGHT), patches=("black",))
        blacks.append(replace(blacks[0], projector="third"))
        rest = [*meter.read_all(HERE, ("north", RIGHT)), *blacks]
        dimmed = [replace(r, xyz=r.xyz * np.array([0.9, 0.8, 0.9])) for r in third]
        (note,) = (n for n in fit_absolute([*rest, *dimmed], three).notes if "contradict" in n)
        assert "third contradict those of north, south: -20.0% in luminance" in note

    def test_a_projector_with_white_alone_can_contradict(
        self, dome: Calibration, meter: Meter
    ) -> None:
        readings = meter.read_all(HERE, ("south", LEFT))
        white = meter.read("north", "white")
        assert fit_absolute([*readings, white], dome).notes == ()
        (note,) = fit_absolute([*readings, scaled(white, 0.85)], dome).notes[-1:]
        assert note.startswith("readings of north contradict those of south: -15.0% in luminance")

    def test_which_reading_fits_worst(
        self, dome: Calibration, readings: list[MeterReading]
    ) -> None:
        found = fit_absolute([scaled(readings[0], 0.7), *readings[1:]], dome)
        assert found.worst[0] is found.readings[0]
        assert found.worst[1] > 2


class TestRefusals:
    @pytest.mark.parametrize("patches", [("red", "green", "black"), ("white",), ("black",), ()])
    def test_too_few_patches(
        self, dome: Calibration, meter: Meter, patches: tuple[str, ...]
    ) -> None:
        read = ", ".join(p for p in ("green", "red", "white") if p in patches) or "no colour"
        with pytest.raises(NotEnoughData) as caught:
            fit_absolute(meter.read_all(HERE, HERE, patches=patches), dome)
        assert str(caught.value) == (
            f"the meter's readings are of {read}; read three or more of red, green, blue and white"
        )

    def _refused(self, dome: Calibration, readings: list[MeterReading]) -> str:
        with pytest.raises(InputError) as caught:
            fit_absolute(readings, dome)
        return str(caught.value)

    def test_where_no_camera_sees(self, dome: Calibration, readings: list[MeterReading]) -> None:
        low = MeterReading("south", "red", 82.0, 0.0, np.ones(3))
        assert self._refused(dome, [*readings, low]) == (
            "red of south at azimuth 82, elevation 0 deg: no camera sees this place, so the calibration "
            "has no light for it; read it elsewhere, or remove the line"
        )

    # beside its picture, at its cut-off lower edge, behind it
    @pytest.mark.parametrize("place", [(176.0, 20.0), (-3.5, 9.0), (-177.0, 58.0)])
    @pytest.mark.parametrize("patch", ["white", "black"])
    def test_where_the_projector_does_not_light(
        self,
        dome: Calibration,
        readings: list[MeterReading],
        place: tuple[float, float],
        patch: str,
    ) -> None:
        dark = MeterReading("south", patch, *place, np.ones(3))
        assert self._refused(dome, [*readings, dark]) == (
            f"{dark}: south does not light this place, or only in part; read it well inside its picture, "
            "or remove the line"
        )

    def test_a_calibration_without_a_ray_there(
        self, dome: Calibration, readings: list[MeterReading]
    ) -> None:
        south = dome.projectors["south"]
        direction = south.surface.direction.copy()
        direction[10:20, 20:30] = np.nan
        holed = replace(south, surface=replace(south.surface, direction=direction))
        other = replace(dome, projectors={**dome.projectors, "south": holed})
        assert "south does not light" in self._refused(other, readings)
