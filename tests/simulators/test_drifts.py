"""What changes of a venue after its calibration do to its light, and what they leave alone."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exact_room import PANEL, SIZE, coarse_rooms, exact_rooms
from tolerances import FLOAT32

from procam.errors import InputError
from procam.maths.geometry.sphere import angle_between, direction_from_angles, normalise
from procam.model.frame import CameraSettings
from simulators.backend import build_scene
from simulators.builds import SETTLING_S
from simulators.devices import SimulatedCamera, SimulatedProjector
from simulators.drifts import (
    GAIN_SIGMA,
    KINDS,
    PROJECTOR_CHANGES,
    RANGES,
    Drift,
    draw_drift,
    drifted,
)
from simulators.presets import IDEAL, STANDARD
from simulators.scene import ALL_BANDS, DomeScene
from simulators.sensor import Sensor
from simulators.server import MediaServer, Relay

EXPOSURE_S = 0.05
WIDTH, HEIGHT = PANEL
WHITE = np.ones((HEIGHT, WIDTH, 3), np.float32)
RAMP = WHITE * np.linspace(0.4, 1, WIDTH, dtype=np.float32)[:, None]
VENUE: Mapping[str, Any] = {"projector_size": PANEL, "camera_size": (64, 64), "rays": 64}


@pytest.fixture(scope="module", autouse=True)
def closed_form() -> Iterator[None]:
    with exact_rooms():
        yield


@pytest.fixture(scope="module")
def ideal() -> DomeScene:
    return DomeScene(IDEAL, SIZE, 1)


@pytest.fixture(scope="module")
def standard() -> DomeScene:
    return DomeScene(STANDARD, SIZE, 1)


def south(kind: str, size: float = 1.0, **rest: float) -> Drift:
    return Drift(kind, size, "south", **rest)  # type: ignore[arg-type]


def counts(scene: DomeScene, drive: np.ndarray = WHITE) -> np.ndarray:
    """Counts above black (H, W, 3) of a picture of projector south, all lamps on and warm."""
    for state in scene.states.values():
        state.switch_on()
    scene.clock.sleep(3600)
    SimulatedProjector(scene, "south").show(drive)
    camera = SimulatedCamera(scene, "zenith")
    camera.configure(CameraSettings(EXPOSURE_S, "rgb"))
    return camera.capture().counts - 64.0


def emitted(scene: DomeScene, drive: np.ndarray) -> np.ndarray:
    """Light (H, W, 3) of a drive relative to the irradiance of white, black taken off."""
    light = scene.lights["south"]
    lit = np.where(light.lit, light.irradiance, 1)[..., None]
    white = light.build.colour_mix.sum(axis=1)
    return (light.emit(drive, ALL_BANDS) - light.black_irradiance[..., None] * white) / lit


def rays(scene: DomeScene) -> np.ndarray:
    """Unit directions (H, W, 3) of a perfect dome's points under south's pixels, from its lens."""
    light = scene.lights["south"]
    return normalise(IDEAL.radius_m * light.direction - light.build.projector_from_dome.origin)


class TestReuse:
    def test_no_drift_changes_nothing(self, standard: DomeScene) -> None:
        base = counts(DomeScene(STANDARD, SIZE, 1))
        assert np.array_equal(counts(drifted(standard, [])), base)
        again = counts(drifted(standard, [], session=1)) - base
        assert abs(again.mean()) < 5 * GAIN_SIGMA * base.mean() and 0.1 < again.std()

    def test_a_camera_photographs_with_its_gain(self) -> None:
        before, now = DomeScene(STANDARD, SIZE, 1), DomeScene(STANDARD, SIZE, 1)
        build = now.cameras["zenith"]
        now.cameras["zenith"] = replace(build, flaws=replace(build.flaws, gain=(0.9, 1.0, 1.2)))
        ratio = counts(now).mean(axis=(0, 1)) / counts(before).mean(axis=(0, 1))
        np.testing.assert_allclose(ratio, (0.9, 1.0, 1.2), rtol=2e-3)

    def test_sight_lines_are_those_of_a_new_trace(self) -> None:
        base = DomeScene(replace(STANDARD, gloss=0.03, ovality=0.001), SIZE, 1)
        drifts = [south("turned", 2, angle_deg=30), Drift("stain", 0.3, angle_deg=50)]
        scene = drifted(base, [*drifts, Drift("dust", 0.2, angle_deg=-20)])
        found, expected = scene.sight_lines("zenith"), scene._traced_lines(scene.cameras["zenith"])
        np.testing.assert_allclose(found.albedo, expected.albedo, rtol=FLOAT32)
        for name, (where, gain) in expected.sources.items():
            near = [np.clip(at, -10, 2 * WIDTH) for at in (found.sources[name][0], where)]
            np.testing.assert_allclose(near[0], near[1], atol=1e-3)
            np.testing.assert_allclose(found.sources[name][1], gain, rtol=1e-4, atol=1e-6)
        moved = found.sources["south"][0] - base.sight_lines("zenith").sources["south"][0]
        assert np.abs(moved).max() > 1

    def test_a_repainted_room_is_a_traced_one(self) -> None:
        with coarse_rooms():
            base = DomeScene(STANDARD, SIZE, 1)
            drifts = [Drift("dust", 0.2, angle_deg=40), Drift("stain", 0.4), Drift("floor", 0.3)]
            scene = drifted(base, drifts)
            new = DomeScene(scene.preset, SIZE, 1)
        flux = new.lights["south"].patch_flux(
            new.lights["south"].emit(WHITE, ALL_BANDS), len(new.room.area_m2)
        )
        found, expected = scene.room.irradiance(flux), new.room.irradiance(flux)
        np.testing.assert_allclose(found, expected, rtol=1e-3)
        assert (found / base.room.irradiance(flux)).max() > 1.05
        np.testing.assert_allclose(
            scene.lights["south"].reflected_m2, new.lights["south"].reflected_m2, rtol=FLOAT32
        )

    def test_overrides_come_before_a_drift(self, ideal: DomeScene) -> None:
        with pytest.raises(InputError, match="set them before it drifts"):
            drifted(ideal, []).altered(snr=10)


class TestGeometry:
    def test_turned_about_the_lens(self, ideal: DomeScene) -> None:
        scene = drifted(ideal, [south("turned", 0.5, angle_deg=40)])
        old, new = (s.lights["south"].build.projector_from_dome for s in (ideal, scene))
        np.testing.assert_allclose(new.origin, old.origin, atol=1e-12)
        axis = old.rotation.T @ [np.cos(np.radians(40)), -np.sin(np.radians(40)), 0]
        lever = np.linalg.norm(np.cross(rays(ideal), axis), axis=-1)  # chord of a rotation
        expected = 2 * np.arcsin(np.sin(np.radians(0.25)) * lever)
        np.testing.assert_allclose(angle_between(rays(scene), rays(ideal)), expected, rtol=1e-9)

    @pytest.mark.parametrize(("angle_deg", "x", "y"), [(0, 3, 0), (90, 0, -3)])
    def test_shifted_by_whole_pixels(
        self, ideal: DomeScene, angle_deg: float, x: int, y: int
    ) -> None:
        scene = drifted(ideal, [south("shifted", 3, angle_deg=angle_deg)])
        back = np.roll(rays(scene), (-y, -x), axis=(0, 1))
        np.testing.assert_allclose(back[3:-3, 3:-3], rays(ideal)[3:-3, 3:-3], atol=1e-9)

    def test_zooming_keeps_the_flux_of_a_pixel(self, ideal: DomeScene) -> None:
        old, new = (s.lights["south"] for s in (ideal, drifted(ideal, [south("zoomed", -0.03)])))
        both = old.lit & new.lit
        flux = [light.irradiance[both] * light.area_m2[both] for light in (old, new)]
        np.testing.assert_allclose(flux[1], flux[0], rtol=FLOAT32)
        middle = (slice(HEIGHT // 4, HEIGHT // 2), slice(WIDTH // 4, -WIDTH // 4))
        ratio = np.median(new.irradiance[middle] / old.irradiance[middle])
        assert 0.85 < ratio < 0.97  # about 0.97^2: a larger picture is dimmer
        np.testing.assert_allclose(new.build.lens.focal, 0.97 * old.build.lens.focal)

    def test_a_tripod_put_back(self, ideal: DomeScene) -> None:
        old, new = (
            s.cameras["zenith"].camera_from_dome
            for s in (ideal, drifted(ideal, [Drift("camera-moved", 2, angle_deg=70)]))
        )
        cosine = (np.trace(new.rotation @ old.rotation.T) - 1) / 2
        assert np.degrees(np.arccos(cosine)) == pytest.approx(2)
        assert np.linalg.norm(new.origin - old.origin) == pytest.approx(0.01)

    def test_only_the_first_camera_moves(self) -> None:
        base = DomeScene(IDEAL, replace(SIZE, cameras=2), 1)
        scene = drifted(base, [Drift("camera-moved", 1), Drift("aperture", 0.2)])
        assert scene.sight_lines("second") is base.sight_lines("second")
        assert not np.array_equal(
            scene.sight_lines("zenith").point, base.sight_lines("zenith").point
        )
        assert [c.aperture for c in scene.cameras.values()] == [1.2, 1.0]


class TestPicture:
    def shown(self, base: DomeScene, drift: Drift, drive: np.ndarray) -> np.ndarray:
        scaler = drifted(base, [drift]).lights["south"].build.scaler
        assert scaler is not None
        return scaler.scaled(drive)

    @pytest.mark.parametrize("edge", range(4))
    def test_keystone_shortens_one_edge(self, ideal: DomeScene, edge: int) -> None:
        drift = south("keystone", 0.2, angle_deg=90 * edge - 20)
        seen = self.shown(ideal, drift, WHITE)[..., 0]
        borders = [seen[:, -1], seen[0], seen[:, 0], seen[-1]]  # right, upper, left, lower
        for number, border in enumerate(borders):
            if number == edge:
                assert border.mean() == pytest.approx(0.8, abs=0.015)
                np.testing.assert_allclose(border, border[::-1], atol=0.05)
            elif number == (edge + 2) % 4:
                assert border.mean() > 0.85  # half a pixel of it fades

    def test_overscan_about_the_middle(self, ideal: DomeScene) -> None:
        y, x = np.mgrid[-1 : 1 : 1j * HEIGHT, -1 : 1 : 1j * WIDTH]
        drive = np.stack([(1 + x) / 2, (1 + y) / 2, 0 * x], -1).astype(np.float32)
        seen = self.shown(ideal, south("overscan", 0.05), drive)
        step = 1 / 32 / HEIGHT  # OpenCV reads places to 1/32 px
        np.testing.assert_allclose(seen[..., 0], (1 + x / 1.05) / 2, atol=step)
        np.testing.assert_allclose(seen[..., 1], (1 + y / 1.05) / 2, atol=step)

    def test_a_scaled_picture_reaches_the_dome(self, ideal: DomeScene) -> None:
        half = WHITE.copy()
        half[:, : WIDTH // 2] = 0
        scene = drifted(ideal, [south("mirrored")])
        assert np.array_equal(emitted(scene, half), emitted(ideal, half[:, ::-1]))
        code = np.uint8(255 * half[..., :1])
        light = scene.lights["south"]
        assert np.array_equal(light.emit_grey(code, ALL_BANDS), light.emit(half, ALL_BANDS))

    def test_raised_black(self, ideal: DomeScene) -> None:
        seen = self.shown(ideal, south("raised-black", 0.1), 0.5 * WHITE)
        np.testing.assert_allclose(seen, 0.55, rtol=FLOAT32)

    def test_a_lost_input_is_black(self, ideal: DomeScene) -> None:
        lost = counts(drifted(ideal, [south("no-picture")]))
        assert np.array_equal(lost, counts(drifted(ideal, []), 0 * WHITE))


class TestLight:
    def test_a_lamp_that_has_aged(self, ideal: DomeScene) -> None:
        base, aged = (counts(drifted(ideal, d)) for d in ([], [south("aged", 0.2)]))
        black = counts(drifted(ideal, [Drift("aged", 1.0, "south")]))  # only north's black
        bright = base[..., 1] > 1e4
        np.testing.assert_allclose((aged - black)[bright], 0.8 * (base - black)[bright], rtol=1e-3)

    def test_one_primary(self, ideal: DomeScene) -> None:
        red = WHITE * np.array([1, 0, 0], np.float32)
        for drift, share in (
            (south("colour-aged", 0.3, channel=0), 0.7),
            (south("dead-channel"), 0.0),
        ):
            scene = drifted(ideal, [drift])
            lit = scene.lights["south"].lit
            np.testing.assert_allclose(
                emitted(scene, red)[lit], share * emitted(ideal, red)[lit], atol=1e-6
            )
            np.testing.assert_allclose(
                emitted(scene, WHITE - red)[lit], emitted(ideal, WHITE - red)[lit], atol=1e-6
            )

    def test_another_gamma(self, ideal: DomeScene) -> None:
        old, new = (s.lights["south"].build for s in (ideal, drifted(ideal, [south("gamma", 0.1)])))
        v = np.array([0.0, 0.3, 1.0])
        power = (1 - old.toe) * (v[:, None] ** (1.1 * old.gamma) - v[:, None] ** old.gamma)
        np.testing.assert_allclose(new.response(v) - old.response(v), power, atol=1e-12)

    def test_defocus_adds_in_quadrature(self, ideal: DomeScene) -> None:
        scene = drifted(ideal, [south("defocused", 2.4)])
        assert scene.lights["south"].build.defocus_px == pytest.approx(2.5)  # with 0.7
        assert scene.lights["north"].build.defocus_px == 0.7

    def test_a_lamp_that_settles(self, ideal: DomeScene) -> None:
        scene = drifted(ideal, [south("warming", 0.2)])
        state = scene.states["south"]
        state.switch_on()
        for after_s, expected in ((30.0, 0.8), (SETTLING_S, 1 - 0.2 / np.e), (1e4, 1.0)):
            scene.clock.sleep(after_s)
            assert state.light_factor() == pytest.approx(expected)

    def test_an_aperture(self, ideal: DomeScene) -> None:
        base, wider = (counts(drifted(ideal, d)) for d in ([], [Drift("aperture", 0.2)]))
        np.testing.assert_allclose(wider, 1.2 * base, atol=1.2)


class TestRoom:
    def test_dust_and_stains(self, standard: DomeScene) -> None:
        az, el = np.radians([30, 210, 30, 30]), np.radians([0, 0, 40, 48])
        direction = direction_from_angles(az, el)
        clean = standard.surface.albedo(direction)
        dusty = drifted(standard, [Drift("dust", 0.1, angle_deg=30)]).surface.albedo(direction)
        np.testing.assert_allclose(dusty[:2] / clean[:2], [0.9, 1.0])
        stained = drifted(standard, [Drift("stain", 0.4, angle_deg=30)]).surface.albedo(direction)
        np.testing.assert_allclose(stained[2:] / clean[2:], [0.6, 1 - 0.4 * np.exp(-0.5)])

    def test_floor_albedo_stays_possible(self, standard: DomeScene) -> None:
        for size, albedo in ((0.2, 0.28), (1.0, 0.9), (-1.0, 0.0)):
            scene = drifted(standard, [Drift("floor", size)])
            assert scene.preset.floor_albedo == pytest.approx(albedo)

    def test_ambient_light_adds(self, ideal: DomeScene) -> None:
        on_dome = ideal.sight_lines("zenith").on_screen
        base, lit = (counts(drifted(ideal, d)) for d in ([], [Drift("ambient", 0.05)]))
        added = (lit - base)[..., 1] / Sensor(ideal, "zenith").vignetting[..., 0].clip(1e-9)
        expected = 0.05 * IDEAL.brightness * IDEAL.albedo * EXPOSURE_S * (2**16 - 1 - 64)
        np.testing.assert_allclose(added[on_dome], expected, atol=2.0)
        assert not added[~on_dome].any()


class TestSettings:
    TURNED: Mapping[str, Any] = {
        "kind": "turned",
        "projector": "south",
        "size": 0.3,
        "angle_deg": 40,
    }

    def test_drifts_of_the_venue_file(self) -> None:
        scene = build_scene({**VENUE, "drifts": [self.TURNED]}, Path())
        expected = drifted(build_scene(VENUE, Path()), [Drift("turned", 0.3, "south", 40)])
        assert np.array_equal(rays(scene), rays(expected))
        assert not np.array_equal(rays(scene), rays(build_scene(VENUE, Path())))

    def test_behind_a_media_server(self) -> None:
        """The server renders as it was aligned; lamps are switched together and stay different."""
        drifts = [self.TURNED, {"kind": "warming", "projector": "north", "size": 0.2}]
        settings = {**VENUE, "server": True, "server_size": 64, "drifts": drifts}
        scene = build_scene(settings, Path())
        master = np.full((64, 64, 3), 0.5, np.float32)
        found, before = (MediaServer(s, 64).frames(master) for s in (scene, scene.undrifted))
        assert all(np.array_equal(found[name], before[name]) for name in before)
        relay = Relay(scene)
        relay.switch_on()
        scene.clock.sleep(30)
        assert [s.light_factor() for s in scene.states.values()] == pytest.approx([1, 0.8])
        relay.set_muted(True)
        assert [s.light_factor() for s in scene.states.values()] == [0, 0]
        relay.set_muted(False)
        relay.switch_off()
        assert [str(s.power) for s in scene.states.values()] == ["cooling", "cooling"]

    @pytest.mark.parametrize(
        ("drift", "message"),
        [
            (
                {"kind": "wobbled", "size": 1},
                r"drifts.0 is .*; drift wobbled is not one of turned,",
            ),
            ({"kind": "aged", "size": 0.1}, r"drift aged needs the name of a projector\."),
            ({"kind": "dust", "size": 0.1, "projector": "south"}, r"dust takes no projector\."),
            ({**TURNED, "size": -1}, r"size of drift turned is -1; it must be 0 to 20\."),
            ({**TURNED, "size": float("nan")}, r"size of drift turned is nan"),
            ({**TURNED, "channel": 3}, r"channel of drift turned is 3; it must be 0 to 2\."),
            ({**TURNED, "angle_deg": float("inf")}, r"angle_deg of drift turned is inf\."),
            ({**TURNED, "projector": "attic"}, r"projector attic is not one of south, north\."),
            ({**TURNED, "degrees": 3}, r"drifts.0.degrees"),
        ],
    )
    def test_others_are_refused(self, drift: dict[str, Any], message: str) -> None:
        with pytest.raises(InputError, match=message):
            build_scene({**VENUE, "drifts": [drift]}, Path())


class TestDraw:
    def test_every_kind_opens_and_shows_a_picture(self, standard: DomeScene) -> None:
        rng = np.random.default_rng(3)
        base = counts(drifted(standard, []), RAMP)
        assert len(KINDS) == 21
        for kind in KINDS:
            drift = draw_drift(kind, rng, ["south"])
            low, high = RANGES[kind].drawn
            assert low <= abs(drift.size) <= high
            assert bool(drift.projector) == (kind in PROJECTOR_CHANGES)
            changed = np.abs(counts(drifted(standard, [drift]), RAMP) - base).max() > 3
            assert changed == (kind not in ("warming", "floor")), kind  # warm, and no scatter here
