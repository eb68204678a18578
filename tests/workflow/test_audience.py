"""`procam state` in a simulated dome with an audience, simulated as a brighter floor."""

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tiny_venue import (
    CAMERA,
    TINY_PAIR,
    calibrated,
    contents,
    procam,
    refused,
    watch_stage,
)

from procam.devices.rig import Rig
from procam.errors import InputError, NotEnoughData, OutOfModelRange
from procam.estimate.camera.radiance import Radiometer
from procam.estimate.structured_light.patterns import zone_count
from procam.files.calibration import load_calibration, save_calibration
from procam.files.images.layers import RGB
from procam.files.images.pixels import read_image, write_image
from procam.files.venue.load import Venue
from procam.generators import result_of
from procam.interfaces.cli import forecast as command
from procam.maths.geometry.sphere import master_directions, master_solid_angles
from procam.model.calibration import Calibration
from procam.model.frame import Frame
from procam.model.provenance import Provenance
from procam.model.venue_state import VenueState
from procam.workflows.audience import measure_state, with_state
from procam.workflows.forecast import sampled
from procam.workflows.photographs.driven import DrivenPhotographer
from procam.workflows.venue_rig import open_rig
from simulators.mistakes import AlteringCamera
from simulators.presets import PRESETS, Preset
from simulators.scene import ALL_BANDS, DomeScene
from simulators.sight_lines import SightLines

PEOPLE = 0.20  # albedo of the floor with people on it; 0.08 when it was calibrated
PHOTOGRAPHS = 1 + 2 * (1 + zone_count(2))  # dark; black and zones of each projector
MASTER = 128
GOAL = 0.01  # relative, of m


@pytest.fixture(scope="module")
def venue(tmp_path_factory: pytest.TempPathFactory) -> Venue:
    """Calibrated without an audience."""
    return calibrated(tmp_path_factory.mktemp("audience") / "venue", TINY_PAIR)


@pytest.fixture(scope="module")
def calibration(venue: Venue) -> Calibration:
    return load_calibration(venue.directory / "calibrations" / "0001")


@pytest.fixture(scope="module")
def full() -> Iterator[None]:
    """With the audience."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(PRESETS, "standard", _with_audience())
        yield


@pytest.fixture(scope="module")
def rig(venue: Venue, full: None) -> Iterator[Rig]:
    with open_rig(venue) as opened:
        yield opened


def _with_audience() -> Preset:
    return replace(PRESETS["standard"], floor_albedo=PEOPLE)


def _changed(rig: Rig, change: Callable[[Frame], Frame] = lambda frame: frame) -> Rig:
    """The rig, its camera's frames changed."""
    camera = AlteringCamera(rig.cameras[CAMERA], lambda frame, _: change(frame))
    return replace(rig, cameras={CAMERA: camera})


def _measured(
    rig: Rig, venue: Venue, calibration: Calibration, ambient_only: bool = False
) -> VenueState:
    photographer = DrivenPhotographer(rig, calibration)
    state, _ = result_of(measure_state(photographer, venue, calibration, "full", ambient_only))
    return state


def _true_feedback(preset: Preset) -> np.ndarray:
    """Feedback (3,) of full white in the traced room."""
    scene = DomeScene(preset, TINY_PAIR, 1)
    direction, inside = master_directions(MASTER)
    rays = np.where(inside[..., None], direction, np.nan)
    view = SightLines.along(scene.room, scene.lights, np.zeros(3), rays)
    flux = np.zeros((len(scene.room.area_m2), 3))
    direct = np.zeros((MASTER, MASTER, 3))
    lit = np.zeros((MASTER, MASTER), bool)
    for name, light in scene.lights.items():
        white = light.emit(np.ones((*light.lit.shape, 3), np.float32), ALL_BANDS)
        flux += light.patch_flux(white, len(flux))
        direct += view.direct(name, white)
        lit |= view.direct(name, light.lit[..., None].astype(np.float32))[..., 0] > 0
    scattered = view.scattered(scene.room, scene.room.irradiance(flux))
    solid = master_solid_angles(MASTER) * lit
    return np.tensordot(solid, scattered, 2) / np.tensordot(solid, direct, 2)


def _lamps(venue: Venue, calibration: Calibration, light: np.ndarray) -> Callable[[Frame], Frame]:
    """Adds uniform ambient light (3,) [rel] to frames."""
    camera = venue.cameras[CAMERA]
    theta = np.arccos(np.clip(Radiometer(camera).rays[..., 2], -1, 1))
    fall = 1 + sum(v * theta ** (2 * k) for k, v in enumerate(camera.sensor.vignetting, start=1))
    radiance = np.linalg.inv(calibration.content_from_camera) @ light
    per_s = camera.sensor.full_scale * np.maximum(fall, 0)[..., None] * radiance

    def lit(frame: Frame) -> Frame:
        counts = frame.counts + np.rint(per_s * frame.settings.exposure_s)
        top = 2**camera.sensor.bits - 1
        return replace(frame, counts=np.minimum(counts, top).astype(np.uint16))

    return lit


class TestMeasured:
    def test_feedback_is_that_of_the_traced_room(
        self, venue: Venue, calibration: Calibration, rig: Rig
    ) -> None:
        """The state's m has the error of the calibration's; the ratio must be right."""
        watched = _changed(rig)
        state = _measured(watched, venue, calibration)
        before, after = (
            _true_feedback(replace(_with_audience(), floor_albedo=0.08)),
            _true_feedback(_with_audience()),
        )
        assert 1.10 < (after / before).min() < 1.13  # a full audience
        error = state.scatter_ratio / (after / before) - 1
        assert np.abs(error).max() < GOAL
        off = state.feedback.value - after
        assert (np.abs(off) < 3 * state.feedback.sigma).all()
        own = state.scatter_ratio * calibration.feedback.sigma
        assert (state.feedback.sigma > own).all()
        assert watched.cameras[CAMERA]._taken == PHOTOGRAPHS  # type: ignore[attr-defined]

    def test_sigma_is_larger_without_the_calibrations_pictures(
        self, venue: Venue, calibration: Calibration, rig: Rig
    ) -> None:
        beside = _measured(rig, venue, calibration)
        alone = _measured(rig, venue, replace(calibration, provenance=Provenance("0042")))
        far = np.abs(alone.feedback.value - beside.feedback.value)
        assert (far < alone.feedback.sigma).all() and far.max() > 0
        assert (alone.feedback.sigma > 1.5 * beside.feedback.sigma).all()

    def test_lamps_do_not_change_the_ratio(
        self, venue: Venue, calibration: Calibration, rig: Rig
    ) -> None:
        light = np.array([0.012, 0.008, 0.004])
        dark = _measured(rig, venue, calibration)
        state = _measured(_changed(rig, _lamps(venue, calibration, light)), venue, calibration)
        assert state.ambient is not None
        lit = calibration.maps.coverage > 0.999
        # the camera's glare of 0.3 % is subtracted, but these lamps cause none
        np.testing.assert_allclose(state.ambient[lit].mean(axis=0), light, rtol=0.01)
        np.testing.assert_allclose(state.scatter_ratio, dark.scatter_ratio, rtol=0.003)

    def test_bright_lamps_take_a_shorter_exposure(
        self, venue: Venue, calibration: Calibration, rig: Rig
    ) -> None:
        light = np.array([0.3, 0.25, 0.2])
        lamps = _changed(rig, _lamps(venue, calibration, light))
        state = _measured(lamps, venue, calibration, ambient_only=True)
        assert lamps.cameras[CAMERA]._taken == 2  # type: ignore[attr-defined]
        assert state.ambient is not None
        lit = calibration.maps.coverage > 0.999
        np.testing.assert_allclose(state.ambient[lit].mean(axis=0), light, rtol=0.01)

    def test_ambient_only_keeps_the_known_ratio(
        self, venue: Venue, calibration: Calibration, rig: Rig
    ) -> None:
        plain = _measured(rig, venue, calibration, ambient_only=True)
        np.testing.assert_array_equal(plain.scatter_ratio, 1)
        np.testing.assert_array_equal(plain.feedback.value, calibration.feedback.value)
        known = with_state(calibration, replace(plain, scatter_ratio=np.full(3, 1.1)))
        again = _measured(rig, venue, known, ambient_only=True)
        np.testing.assert_array_equal(again.scatter_ratio, 1.1)

    def test_one_old_picture_is_taken_again(
        self, venue: Venue, calibration: Calibration, rig: Rig
    ) -> None:
        frames: list[Frame] = []

        def late(frame: Frame) -> Frame:
            frames.append(frame)
            return (
                frames[-2] if len(frames) == 4 else frame
            )  # a quarter, delivered as the one before

        late_rig = _changed(rig, late)
        state = _measured(late_rig, venue, calibration)
        assert len(frames) == PHOTOGRAPHS + 1
        assert (np.abs(state.scatter_ratio - 1.11) < 0.02).all()


class TestRefusals:
    def _complaint(
        self,
        rig: Rig,
        venue: Venue,
        calibration: Calibration,
        error: type[Exception] = OutOfModelRange,
        name: str = "full",
    ) -> str:
        with pytest.raises(error) as caught:
            for _ in measure_state(DrivenPhotographer(rig, calibration), venue, calibration, name):
                pass
        assert "\n" not in str(caught.value)
        return str(caught.value)

    def test_a_camera_that_has_moved(
        self, venue: Venue, calibration: Calibration, rig: Rig
    ) -> None:
        def rolled(frame: Frame) -> Frame:
            return replace(frame, counts=np.roll(frame.counts, 5, axis=1))

        message = self._complaint(_changed(rig, rolled), venue, calibration)
        assert re.search(r"projector south.* [45]\.\d px ", message)
        assert "camera zenith or the projector has moved" in message
        assert message.endswith("calibrate again")

    def test_a_covered_lens(self, venue: Venue, calibration: Calibration, rig: Rig) -> None:
        def black(frame: Frame) -> Frame:
            return replace(frame, counts=np.full_like(frame.counts, 64))

        message = self._complaint(_changed(rig, black), venue, calibration)
        assert "not seen at all" in message

    def test_scattered_light_that_no_audience_explains(
        self, venue: Venue, calibration: Calibration, rig: Rig
    ) -> None:
        maps = calibration.maps
        repainted = replace(maps, scatter_per_flux=0.4 * maps.scatter_per_flux)
        other = replace(calibration, maps=repainted, provenance=Provenance())
        message = self._complaint(rig, venue, other)
        assert "27" in message and "50% to 200%" in message and "calibrate again" in message

    @pytest.mark.parametrize("level", [1.2, 30.0])
    def test_light_brighter_than_the_projectors(
        self, venue: Venue, calibration: Calibration, rig: Rig, level: float
    ) -> None:
        lamps = _lamps(venue, calibration, np.full(3, level))
        message = self._complaint(_changed(rig, lamps), venue, calibration)
        assert "more than the projectors' white" in message or "brighter than" in message

    def test_quarters_that_saturate(self, venue: Venue, calibration: Calibration, rig: Rig) -> None:
        def brighter(frame: Frame) -> Frame:
            return replace(frame, counts=np.minimum(frame.counts * 1.4, 4095).astype(np.uint16))

        message = self._complaint(_changed(rig, brighter), venue, calibration)
        assert "saturated" in message and "0.2%" in message

    def test_a_calibration_that_sees_nothing_lit(
        self, venue: Venue, calibration: Calibration, rig: Rig
    ) -> None:
        """Parts behind blackout plates or masks are skipped; if none remains, it is an error."""
        dark = {
            name: replace(p, surface=replace(p.surface, valid=np.zeros_like(p.surface.valid)))
            for name, p in calibration.projectors.items()
        }
        message = self._complaint(rig, venue, replace(calibration, projectors=dark), NotEnoughData)
        assert "2 are needed" in message and "masks" in message

    def test_names(self, venue: Venue, calibration: Calibration, rig: Rig) -> None:
        message = self._complaint(rig, venue, calibration, InputError, "a/b")
        assert "venue state 'a/b': its name needs letters, digits" in message
        south = calibration.projectors["south"]
        clash = replace(calibration, projectors={"state-full": south})
        message = self._complaint(rig, venue, clash, InputError)
        assert "is taken by the map of projector state-full; choose another" in message

    def test_a_calibration_of_other_devices(
        self, venue: Venue, calibration: Calibration, rig: Rig
    ) -> None:
        cameras = {"side": calibration.cameras[CAMERA]}
        other = replace(calibration, cameras=cameras, main_camera="side")
        message = self._complaint(rig, venue, other, InputError)
        assert "venue.toml: " in message and "no camera side" in message and "[200, " in message
        south = calibration.projectors["south"]
        larger = replace(south, model=replace(south.model, size=(256, 160)))
        projectors = {**calibration.projectors, "south": larger}
        message = self._complaint(
            rig, venue, replace(calibration, projectors=projectors), InputError
        )
        assert "[128, 80]" in message and "[256, 160]" in message
        assert message.endswith("calibrate it again")


class TestCommand:
    def test_adds_a_state_and_changes_nothing_else(
        self, venue: Venue, full: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ) -> None:
        first = venue.directory / "calibrations" / "0001"
        before, stages = contents(first), watch_stage(monkeypatch)
        ran = procam("state", venue.directory, "full", "--json")
        assert (ran.code, ran.err) == (0, "")
        document = json.loads(ran.out)
        assert document["calibration"] == str(venue.directory / "calibrations" / "0002")
        assert stages[-1].lit() == []
        assert contents(first) == before
        found, old = load_calibration(Path(document["calibration"])), load_calibration(first)
        assert list(found.states) == ["full"] and not old.states
        assert found.states["full"].scatter_ratio.tolist() == document["scatter_ratio"]
        np.testing.assert_array_equal(found.maps.scatter_per_flux, old.maps.scatter_per_flux)
        assert found.provenance == old.provenance
        self.used(Path(document["calibration"]), tmp_path)

    def used(self, directory: Path, folder: Path) -> None:
        """`procam compensate` sends less light in the state."""
        write_image(folder / "in.exr", np.full((64, 64, 3), 0.6, np.float32), RGB)
        flux = []
        for more in ((), ("--state", "full")):
            ran = procam(
                "compensate", directory, folder / "in.exr", folder / "out.exr", *more, "--json"
            )
            assert ran.code == 0, ran
            flux.append(float(np.asarray(read_image(folder / "out.exr"), float).sum()))
            assert json.loads(ran.out)["state"] == (more[1] if more else None)
        assert 0.95 < flux[1] / flux[0] < 0.99
        assert "'x' was not measured (measured states: full)" in refused(
            "compensate", directory, folder / "in.exr", folder / "no.exr", "--state", "x"
        )
        assert not (folder / "no.exr").exists()
        assert json.loads(procam("inspect", directory, "--json").out)["states"] == ["full"]

    def test_prints_one_line_per_channel(self, venue: Venue, full: None) -> None:
        ran = procam("state", venue.directory, "exit-signs", "--ambient-only")
        lines = ran.out.splitlines()
        assert ran.code == 0 and lines[0].endswith("written, with venue state exit-signs")
        assert [line[:3] for line in lines[1:]] == ["  R", "  G", "  B"]
        assert "100.0% of the calibration's; the room's own light 0.0" in lines[1]


class TestForecast:
    @pytest.fixture(autouse=True)
    def small(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(command, "sampled", lambda picture: sampled(picture, 64))

    @pytest.fixture
    def with_states(self, tmp_path: Path, calibration: Calibration) -> Path:
        """A venue with two states, the second with lamps."""
        lamps = np.full((MASTER, MASTER, 3), 0.02, np.float32)
        for name, ratio, ambient in (("school", 1.05, None), ("full", 1.12, lamps)):
            values = np.full(3, ratio)
            m = replace(calibration.feedback, value=ratio * calibration.feedback.value)
            calibration = with_state(calibration, VenueState(name, m, values, ambient))
        save_calibration(calibration, tmp_path / "calibrations" / "0001")
        return tmp_path

    def test_bands_over_states(self, with_states: Path, tmp_path: Path) -> None:
        write_image(tmp_path / "grey.exr", np.full((64, 64, 3), 0.5, np.float32), RGB)
        ran = procam("forecast", with_states, tmp_path / "grey.exr", "--json")
        document = json.loads(ran.out)
        states, m = document["states"], document["light"]["feedback"]["value"]
        assert states["names"] == ["school", "full"]
        found = states["light"]
        assert found["feedback"] == pytest.approx({"value": m, "low": m, "high": 1.12 * m})
        black = document["light"]["black"]["value"] / (1 + m)
        high = black * (1 + 1.12 * m) + 0.02
        assert found["black"]["high"] == pytest.approx(high, rel=1e-5)
        assert found["white_before"]["high"] == pytest.approx(1 + 1.12 * m + 0.02, rel=1e-5)
        assert found["white_after"] == {"value": 1.0, "low": 1.0, "high": 1.0}
        # white 1, and black with the scattered light of half a white, both less the lamps
        p, u, a, b = 0.5, 1.12 * m, 0.02, black
        flux = (p * (1 - a) + (1 - p) * b) / (1 + u * p)
        assert found["checkerboard_after"]["low"] == pytest.approx(1 / (b + u * flux + a), rel=1e-5)
        picture = states["pictures"][str(tmp_path / "grey.exr")]
        assert picture["darkest"]["high"] > picture["darkest"]["value"] + 0.02

    def test_prints_the_names(self, with_states: Path) -> None:
        printed = procam("forecast", with_states).out
        assert "as calibrated, in brackets with venue states: school, full\n" in printed
        assert printed.count("full white : full black") == 2
