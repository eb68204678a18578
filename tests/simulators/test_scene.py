"""Projectors, cameras and the audience's view in a room whose bounces are known in closed form."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exact_room import PANEL, SIZE, exact_rooms
from tolerances import CLOSED_FORM, FLOAT32, SIGMAS

import simulators.truth
from procam.errors import InputError, ShapeError, UnitError
from procam.files.calibration import load_calibration
from procam.files.images.stills import read_picture
from procam.maths.geometry.lenses import project
from procam.maths.geometry.sphere import master_solid_angles
from procam.model.frame import CameraSettings, Frame
from simulators.backend import build_scene
from simulators.builds import CameraFlaws
from simulators.devices import SimulatedCamera, SimulatedProjector
from simulators.faults import STALE_FRAME, StaleCamera
from simulators.placement import place_cameras
from simulators.presets import IDEAL, PRESETS, STANDARD, Preset
from simulators.scene import ALL_BANDS, DomeScene, camera_circle
from simulators.sensor import _vignetting
from simulators.surface import Surface

EXPOSURE_S = 0.1


@pytest.fixture(scope="module", autouse=True)
def closed_form() -> Iterator[None]:
    with exact_rooms():
        yield


def _scene(preset: Preset = IDEAL, seed: int = 1) -> DomeScene:
    scene = DomeScene(preset, SIZE, seed)
    for state in scene.states.values():
        state.switch_on()
    scene.clock.sleep(1000)
    return scene


@pytest.fixture
def scene() -> DomeScene:
    return _scene()


def _show(scene: DomeScene, name: str, value: float) -> None:
    width, height = PANEL
    SimulatedProjector(scene, name).show(np.full((height, width, 3), value, np.float32))


def _photograph(scene: DomeScene, exposure_s: float = EXPOSURE_S, kind: str = "rgb") -> Frame:
    camera = SimulatedCamera(scene, "zenith")
    camera.configure(CameraSettings(exposure_s, kind))  # type: ignore[arg-type]
    return camera.capture()


def _signal(frame: Frame) -> np.ndarray:
    return frame.counts.astype(float) - 64.0


def _circle(scene: DomeScene) -> np.ndarray:
    return camera_circle(scene.cameras["zenith"])


class TestProjectorInput:
    def test_shows_the_drive_rounded_to_its_input(
        self, scene: DomeScene, rng: np.random.Generator
    ) -> None:
        drive = rng.random((PANEL[1], PANEL[0], 3)).astype(np.float32)
        shown = SimulatedProjector(scene, "south").show(drive)
        code = shown.drive * 1023.0
        np.testing.assert_allclose(code, np.rint(code), atol=1e-3)
        assert np.abs(shown.drive - drive).max() <= 0.5 / 1023 + 1e-6
        assert shown.at_s == scene.clock.now_s()

    def test_refuses_a_wrong_shape(self, scene: DomeScene) -> None:
        with pytest.raises(ShapeError, match=r"drive of projector south has shape \(4, 4, 3\)"):
            SimulatedProjector(scene, "south").show(np.zeros((4, 4, 3), np.float32))

    @pytest.mark.parametrize("bad", [-0.1, 1.5, np.nan])
    def test_refuses_values_outside_0_to_1(self, scene: DomeScene, bad: float) -> None:
        drive = np.zeros((PANEL[1], PANEL[0], 3), np.float32)
        drive[3, 3, 1] = bad
        with pytest.raises(UnitError, match=r"drive of projector south is .* must be 0\.\.1"):
            SimulatedProjector(scene, "south").show(drive)


class TestProjectorLight:
    def test_solid_angles_add_up_to_the_footprint(self, scene: DomeScene) -> None:
        """Random directions inside the panel by `project`, an independent computation."""
        rng = np.random.default_rng(4)
        z, azimuth = rng.random(1_000_000), rng.random(1_000_000) * 2 * np.pi
        floor = np.cos(scene.surface.lit_half_angle)
        z = floor + (1 - floor) * z
        across = np.sqrt(1 - z * z)
        direction = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=-1)
        lit_cap = 2 * np.pi * (1 - floor)
        for light in scene.lights.values():
            build = light.build
            xy = project(build.projector_from_dome.apply(6.0 * direction), build.lens)
            hit = np.all((xy > -0.5) & (xy < np.array(PANEL) - 0.5), axis=-1).mean()
            sigma = np.sqrt(hit * (1 - hit) / len(z)) * lit_cap
            # pixels on the edge of the blackout plates count as a whole: half a row of them
            edge = np.median(light.solid_angle_sr[light.lit]) * PANEL[0] / 2
            total = light.solid_angle_sr[light.lit].sum()
            assert abs(total - hit * lit_cap) < SIGMAS * sigma + edge

    def test_equal_pixels_send_equal_flux_except_for_the_falloff(self, scene: DomeScene) -> None:
        light = scene.lights["south"]
        flux = light.irradiance * light.solid_angle_sr
        y, x = np.mgrid[-1 : 1 : 1j * PANEL[1], -1 : 1 : 1j * PANEL[0]]
        falloff = 1 - light.build.falloff * (x * x + 0.6 * y * y) / 1.6
        ratio = (flux / falloff)[light.lit]
        np.testing.assert_allclose(ratio, ratio[0], rtol=FLOAT32)
        assert not light.irradiance[~light.lit].any()

    def test_all_reflected_light_arrives_in_the_patches(self, scene: DomeScene) -> None:
        light = scene.lights["north"]
        white = light.emit(np.ones((PANEL[1], PANEL[0], 3), np.float32), ALL_BANDS)
        patches = light.patch_flux(white, len(scene.room.area_m2))
        area = light.solid_angle_sr * IDEAL.radius_m**2
        expected = np.tensordot(IDEAL.albedo * area, white.astype(float), 2)
        np.testing.assert_allclose(patches.sum(axis=0), expected, rtol=FLOAT32)


class TestScene:
    def test_a_shutter_makes_it_dark(self, scene: DomeScene) -> None:
        _show(scene, "south", 1.0)
        _show(scene, "north", 1.0)
        view = scene.sight_lines("zenith")
        assert scene.radiance(view, ALL_BANDS, 0.5).max() > 1
        for state in scene.states.values():
            state.set_muted(True)
        assert not scene.radiance(view, ALL_BANDS, 0.5).any()

    def test_a_lamp_in_standby_is_dark_and_warms_up_slowly(self) -> None:
        scene = DomeScene(IDEAL, SIZE, 1)
        _show(scene, "south", 1.0)
        view = scene.sight_lines("zenith")
        assert not scene.radiance(view, ALL_BANDS, 0.0).any()
        scene.states["south"].switch_on()
        scene.clock.sleep(15.0)
        dim = scene.radiance(view, ALL_BANDS, 0.0)
        scene.clock.sleep(100.0)
        full = scene.radiance(view, ALL_BANDS, 0.0)
        np.testing.assert_allclose(dim, 0.25 * full, rtol=FLOAT32, atol=1e-6)

    def test_scattered_light_is_the_closed_form(self, scene: DomeScene) -> None:
        """b+ = rho Phi / (A_s - a rho), everywhere on the dome."""
        white = np.ones((PANEL[1], PANEL[0], 3), np.float32)
        view = scene.sight_lines("zenith")
        light = scene.lights["south"]
        flux = light.patch_flux(light.emit(white, ALL_BANDS), len(scene.room.area_m2))
        total = scene.radiance_of_drives(view, {"south": white}, {"south": 1.0}, ALL_BANDS, 0.0)
        rho, sphere = IDEAL.albedo, 4 * np.pi * IDEAL.radius_m**2
        expected = rho * flux.sum(axis=0) / (sphere - rho * sphere / 2)
        unlit = view.on_screen & (
            view.direct("south", np.ones((*PANEL[::-1], 1), np.float32))[..., 0] == 0
        )
        assert unlit.sum() > 1000
        np.testing.assert_allclose(
            total[unlit], np.broadcast_to(expected, total[unlit].shape), rtol=10 * FLOAT32
        )

    def test_direct_light_is_albedo_times_irradiance(self, scene: DomeScene) -> None:
        view = scene.sight_lines("zenith")
        seen = view.direct("south", np.full((*PANEL[::-1], 1), 3.0, np.float32))[..., 0]
        where, _ = view.sources["south"]
        inner = view.on_screen & np.all((where >= 0) & (where <= np.array(PANEL) - 1), axis=-1)
        assert inner.sum() > 1000
        np.testing.assert_allclose(seen[inner], 3.0 * IDEAL.albedo, rtol=FLOAT32)


class TestCamera:
    def test_counts_are_linear_in_exposure(self, scene: DomeScene) -> None:
        _show(scene, "south", 0.8)
        short, long = (_signal(_photograph(scene, e)) for e in (0.02, 0.06))
        assert short.max() > 1000 and long.max() < 65000
        # each is rounded to a count
        assert np.abs(long - 3 * short).max() <= 0.5 + 1.5 + 0.01

    def test_dark_outside_the_image_circle(self, scene: DomeScene) -> None:
        _show(scene, "south", 1.0)
        counts = _photograph(scene).counts
        assert (counts[~_circle(scene)] == 64).all()
        assert (counts[_circle(scene)] > 64).mean() > 0.8

    def test_mono_is_the_green_channel(self, scene: DomeScene) -> None:
        _show(scene, "north", 0.6)
        mono, rgb = _photograph(scene, kind="mono"), _photograph(scene)
        assert mono.counts.ndim == 2 and mono.settings.pixel_format == "mono"
        # floats are summed in another order
        assert np.abs(mono.counts.astype(int) - rgb.counts[..., 1]).max() <= 1

    def test_exposures_out_of_range_are_clipped_and_reported(self, scene: DomeScene) -> None:
        camera = SimulatedCamera(scene, "zenith")
        assert camera.configure(CameraSettings(1e-9)).exposure_s == 1e-4
        assert camera.configure(CameraSettings(1e9)).exposure_s == 60.0

    def test_a_picture_takes_its_time(self, scene: DomeScene) -> None:
        before = scene.clock.now_s()
        frame = _photograph(scene, 2.0)
        assert frame.started_s == before
        assert frame.ended_s == scene.clock.now_s() > before + 2.0

    def test_glare_adds_its_share_of_the_mean(self, scene: DomeScene) -> None:
        _show(scene, "south", 1.0)
        clear = _signal(_photograph(scene))
        scene.preset = replace(IDEAL, glare=0.1)
        veiled = _signal(_photograph(scene))
        circle = _circle(scene)
        camera = SimulatedCamera(scene, "zenith")
        fall = camera._sensor.vignetting[..., 0]
        light = clear / np.where(circle, fall, 1)[..., None]
        mean = light[circle].mean(axis=0)
        expected = (0.9 * light + 0.1 * mean) * np.where(circle, fall, 0)[..., None]
        assert np.abs(veiled - expected)[circle].max() < 2
        dark = circle & (clear[..., 1] < 0.02 * clear.max())
        assert dark.any() and (veiled[dark] > clear[dark]).all()

    def test_a_local_veil_stays_near_its_light_and_keeps_its_amount(self) -> None:
        veils = {}
        for local in (0.0, 1.0):
            scene = _scene(replace(IDEAL, glare=0.1, flaws=CameraFlaws(local_veil=local)))
            sensor, circle = SimulatedCamera(scene, "zenith")._sensor, _circle(scene)
            size = len(circle)
            spot = np.zeros((size, size, 1), np.float32)
            spot[size // 2 : size // 2 + size // 8, size // 4 : size // 4 + size // 8] = 1
            seen = (
                sensor.signal(spot.copy(), 1.0)
                / np.where(circle, sensor.vignetting[..., 0], 1)[..., None]
            )
            veils[local] = np.where(circle, (seen - 0.9 * spot)[..., 0], 0)
        assert veils[1.0].sum() == pytest.approx(veils[0.0].sum(), rel=0.02)
        far = size // 2, 3 * size // 4
        assert veils[0.0][far] > 1e-3 and abs(veils[1.0][far]) < 1e-6

    def test_the_black_level_drifts(self) -> None:
        scene = _scene(replace(IDEAL, flaws=CameraFlaws(black_drift_dn=4.0)))
        scale = 65535 / 4095  # a camera without noise has 16 bits
        before, start = _photograph(scene).counts[0, 0, 1], scene.clock.now_s()
        scene.clock.sleep(600)
        rise = int(_photograph(scene).counts[0, 0, 1]) - int(before)
        assert start > 0 and rise == pytest.approx(4.0 * scale, abs=2)

    def test_vignetting_may_be_off_its_centre(self, scene: DomeScene) -> None:
        (build,) = scene.cameras.values()
        slope = replace(build, flaws=CameraFlaws(vignetting_slope=(0.01, -0.02)))
        ratio = _vignetting(slope)[..., 0] / np.where(_circle(scene), _vignetting(build)[..., 0], 1)
        middle, out = len(ratio) // 2, 9 * len(ratio) // 10
        assert ratio[middle, out] == pytest.approx(1 + 0.01 * 0.8, abs=1e-3)
        assert ratio[out, middle] == pytest.approx(1 - 0.02 * 0.8, abs=1e-3)

    def test_a_ripple_is_in_its_rays_and_pixels(self, rng: np.random.Generator) -> None:
        (build,) = place_cameras(1, (400, 400), "fisheye")
        rippled = replace(build, flaws=CameraFlaws(ripple_px=0.2))
        pixel = rng.uniform(60, 340, (100, 2))
        ray = rippled.rays(pixel)
        np.testing.assert_allclose(rippled.pixels(5.0 * ray), pixel, atol=1e-4)
        away = np.linalg.norm(build.pixels(5.0 * ray) - pixel, axis=1)
        assert 0.15 < away.max() <= 0.2 + 1e-9


class TestNoise:
    FRAMES = 40

    def test_mean_and_variance_follow_the_model(self) -> None:
        """Shot noise of SNR 100 at seven tenths of full scale, 1.5 DN of read noise, rounding."""
        scene = _scene(replace(IDEAL, white_snr=100.0))
        _show(scene, "south", 0.7)
        stack = np.stack([_photograph(scene, 0.1).counts for _ in range(self.FRAMES)]).astype(float)
        full = 4095 - 64
        scene.preset = IDEAL  # noise-free, 16 bits
        signal = _signal(_photograph(scene, 0.1)) / (65535 - 64) * full
        # where the lowest counts stay above 0 and the highest below saturation
        use = _circle(scene)[..., None] & (signal < 0.9 * full)
        variance = signal * (0.7 * full / 100**2) + 1.5**2 + 1 / 12
        mean_z = (stack.mean(axis=0) - 64 - signal)[use] / np.sqrt(variance[use] / self.FRAMES)
        freedom = use.sum() * (self.FRAMES - 1)
        chi2 = (stack.var(axis=0, ddof=1)[use] * (self.FRAMES - 1) / variance[use]).sum()
        assert abs(mean_z.sum() / np.sqrt(use.sum())) < SIGMAS
        assert abs((mean_z**2).sum() - use.sum()) < SIGMAS * np.sqrt(2 * use.sum())
        assert abs(chi2 - freedom) < SIGMAS * np.sqrt(2 * freedom)

    def test_a_resumed_run_repeats_its_noise(self) -> None:
        """Noise depends on what is photographed, not on when or after what."""
        first, second = _scene(STANDARD), _scene(STANDARD)
        _show(first, "south", 0.5)
        expected = _photograph(first).counts
        _show(second, "south", 1.0)
        _photograph(second)
        second.clock.sleep(5000)
        _show(second, "south", 0.5)
        np.testing.assert_array_equal(_photograph(second).counts, expected)

    def test_the_same_picture_again_has_fresh_noise(self) -> None:
        scene = _scene(STANDARD)
        _show(scene, "south", 0.5)
        one, two = (_photograph(scene).counts.astype(float) for _ in range(2))
        circle = _circle(scene)
        assert 0 < np.abs(one - two)[circle].mean() < 40
        a, b = one[circle][:, 1], two[circle][:, 1]
        smooth = (a + b) / 2
        # halves of the difference must not follow each other: correlation of independent noise
        left, right = (a - smooth)[:-1], (a - smooth)[1:]
        assert abs(np.corrcoef(left, right)[0, 1]) < SIGMAS / np.sqrt(len(left))


class TestSurface:
    @pytest.mark.parametrize("field", ["ovality", "panel_step_m", "albedo_smooth", "seam"])
    def test_amplitudes_are_those_of_the_preset(self, rng: np.random.Generator, field: str) -> None:
        amount = {"ovality": 0.001, "panel_step_m": 0.002, "albedo_smooth": 0.05, "seam": 0.07}[
            field
        ]
        surface = Surface.build(replace(IDEAL, **{field: amount}))
        direction = _upper(rng, 20000)
        if field in ("ovality", "panel_step_m"):
            scale = 6.0 if field == "ovality" else 1.0
            departure = np.abs(surface.radius(direction) - 6.0) / scale
        else:
            departure = np.abs(surface.albedo(direction) / 0.5 - 1)
        assert 0.8 * amount < departure.max() < 1.05 * amount

    def test_rays_end_on_the_surface(self, rng: np.random.Generator) -> None:
        surface = Surface.build(replace(IDEAL, ovality=0.001))
        origin, ray = rng.uniform(-2, 2, (500, 3)), _upper(rng, 500)
        point = surface.intersect(origin, ray)
        distance = np.linalg.norm(point, axis=-1)
        np.testing.assert_allclose(distance, surface.radius(point / distance[:, None]), rtol=1e-8)
        along = point - origin
        np.testing.assert_allclose(np.cross(along, ray), 0, atol=1e-9)

    def test_the_blackout_plates_cover_their_share_of_the_cap(self) -> None:
        for name, share in (("ideal", 0.05), ("standard", 0.10)):
            surface = Surface.build(PRESETS[name])  # type: ignore[index]
            caps = [1 - np.cos(a) for a in (surface.lit_half_angle, surface.half_angle)]
            assert 1 - caps[0] / caps[1] == pytest.approx(share, rel=CLOSED_FORM)


def _upper(rng: np.random.Generator, count: int) -> np.ndarray:
    direction = rng.normal(size=(count, 3))
    direction[:, 2] = np.abs(direction[:, 2])
    return direction / np.linalg.norm(direction, axis=1, keepdims=True)


class TestFaults:
    def test_a_failed_trigger_repeats_one_picture(self, scene: DomeScene) -> None:
        camera = StaleCamera(SimulatedCamera(scene, "zenith"))
        camera.configure(CameraSettings(EXPOSURE_S))
        means = []
        for number in range(1, STALE_FRAME + 2):
            _show(scene, "south", number / 20)
            means.append(camera.capture().counts.mean())
        steps = np.diff(means)
        assert steps[STALE_FRAME - 2] == 0
        assert (np.delete(steps, STALE_FRAME - 2) > 0).all()


class TestBackend:
    @pytest.mark.parametrize(
        ("settings", "where"),
        [
            ({"preset": "perfect"}, "simulated.preset is 'perfect'"),
            ({"projectors": 0}, "simulated.projectors is 0"),
            ({"typo": 1}, "simulated.typo is 1"),
            ({"camera_size": [10]}, "simulated.camera_size.1"),
            ({"albedo": 0.96}, "simulated.albedo is 0.96"),
            ({"albedo": -0.1}, "simulated.albedo is -0.1"),
            ({"albedo": float("nan")}, "simulated.albedo is nan"),
            ({"snr": 0}, "simulated.snr is 0;"),
            ({"snr": 1e4}, "simulated.snr is 10000.0"),
            ({"defocus_px": -0.5}, "simulated.defocus_px is -0.5"),
            ({"gamma_left": "much"}, "simulated.gamma_left is 'much'"),
            ({"gamma_left": 0}, "simulated.gamma_left is 0;"),
        ],
    )
    def test_mistakes_are_a_line_each(self, settings: dict[str, object], where: str) -> None:
        with pytest.raises(InputError) as caught:
            build_scene(settings, Path("/venue"))
        assert str(caught.value).startswith(f"/venue/venue.toml: {where}")
        assert "\n" not in str(caught.value)

    def test_all_mistakes_at_once(self) -> None:
        with pytest.raises(InputError) as caught:
            build_scene({"projectors": 0, "cameras": 9, "seed": "x"}, Path("/venue"))
        assert len(str(caught.value).splitlines()) == 3


class TestTruth:
    MASTER = 128

    @pytest.fixture(scope="class")
    @classmethod
    def truth(cls, tmp_path_factory: pytest.TempPathFactory) -> Path:
        out = tmp_path_factory.mktemp("venue") / "truth"
        settings = {
            "preset": "ideal",
            "projector_size": PANEL,
            "camera_size": (64, 64),
            "rays": 64,
        }
        drive = np.ones((PANEL[1], PANEL[0], 3), np.float32)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(simulators.truth, "MASTER", cls.MASTER)
            simulators.truth.write_truth(
                settings, out.parent, out, {"white": {"south": drive, "north": drive}}
            )
        return out

    def test_feedback_is_the_closed_form(self, truth: Path) -> None:
        """m = a_L rho / (A_s - a rho) for what is lit of a half sphere."""
        found = load_calibration(truth)
        solid = master_solid_angles(self.MASTER)
        lit_sr = float((solid * found.maps.coverage).sum())
        expected = lit_sr * 0.5 / (4 * np.pi - 0.5 * 2 * np.pi)
        # flux is summed over projector pixels for the bounces and over master pixels for m: the
        # two grids differ by pixels of the border
        np.testing.assert_allclose(found.feedback.value, expected, rtol=0.02)
        u = np.tensordot(solid * found.maps.coverage, found.maps.scatter_per_flux, 2)
        np.testing.assert_allclose(u, found.feedback.value, rtol=1e-5)

    def test_picture_holds_direct_and_scattered_light(self, truth: Path) -> None:
        """All light of full white is (1 + m) times its direct light, on whatever grid."""
        found, picture = load_calibration(truth), read_picture(truth / "pictures" / "white.exr")[0]
        assert picture.shape == (self.MASTER, self.MASTER, 3)
        solid = master_solid_angles(self.MASTER) * found.maps.coverage
        total, direct = np.tensordot(solid, picture, 2), np.tensordot(solid, found.maps.hi, 2)
        # the picture is smeared by defocus, over the border of the lit part too
        np.testing.assert_allclose(total, (1 + found.feedback.value) * direct, rtol=0.01)
