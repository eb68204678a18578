"""What the overrides of [simulated] do to the light, and to the venue file."""

import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from exact_room import PANEL, SIZE, coarse_rooms, exact_rooms
from scipy.ndimage import distance_transform_edt
from scipy.special import ndtri
from tolerances import FLOAT32, SIGMAS

from procam.files.venue.load import load_venue
from procam.model.frame import CameraSettings
from simulators.backend import build_scene
from simulators.devices import SimulatedCamera, SimulatedProjector
from simulators.photograph_bench import PhotographBench
from simulators.placement import place_projectors
from simulators.presets import EXPOSURE_S, IDEAL, PRESETS, STANDARD, PresetName, white_exposure_s
from simulators.scene import GREEN, DomeScene
from simulators.template import venue_text

WHITE = np.full((*PANEL[::-1], 1), 255, np.uint8)
BLACK = np.zeros_like(WHITE)
CAMERA_BLUR_PX = 1.3 * 0.5  # on the projector's grid


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


def _signal(scene: DomeScene, picture: np.ndarray) -> np.ndarray:
    """Share of full scale (H, W) of a picture of projector south."""
    return next(PhotographBench(scene, "south", exposure_s=EXPOSURE_S).photograph([picture]))


def _levels(scene: DomeScene) -> tuple[np.ndarray, np.ndarray]:
    """White without the vignetting (H, W), and where no projector lights the dome."""
    bench = PhotographBench(scene, "south")
    view, fall = scene.sight_lines("zenith"), bench._sensor.vignetting[..., 0]
    lit = _smeared_mask(np.isfinite(bench.projector_pixels()[..., 0]))
    return _signal(scene, WHITE) / np.where(fall > 0, fall, 1), view.on_screen & ~lit & (fall > 0)


def _smeared_mask(mask: np.ndarray) -> np.ndarray:
    """The mask and ten pixels round it."""
    return np.asarray(distance_transform_edt(~mask) < 10)


class TestAlbedo:
    @pytest.mark.parametrize("albedo", [0.0, 0.3, 0.6, 0.8, 0.95])
    def test_scattered_light_is_the_closed_form(self, ideal: DomeScene, albedo: float) -> None:
        """m = kappa / (1 - kappa) with kappa = rho / 2 on a half sphere that reflects all over."""
        scene = ideal.altered(albedo=albedo)
        level, unlit = _levels(scene)
        assert unlit.sum() > 1000
        light = scene.lights["south"]
        flux = light.patch_flux(light.emit_grey(WHITE, GREEN), len(scene.room.area_m2)).sum()
        feedback = level[unlit] / EXPOSURE_S * 2 * np.pi * IDEAL.radius_m**2 / flux
        kappa = albedo / 2
        np.testing.assert_allclose(feedback, kappa / (1 - kappa), rtol=10 * FLOAT32)

    @pytest.mark.parametrize("albedo", [0.0, 0.3, 0.95])
    def test_direct_light_keeps_its_level(self, ideal: DomeScene, albedo: float) -> None:
        """Scattered light is the same all over this dome, so that it can be taken off."""
        direct = []
        for scene in (ideal, ideal.altered(albedo=albedo)):
            level, unlit = _levels(scene)
            direct.append((level - level[unlit].mean())[scene.sight_lines("zenith").on_screen])
        assert direct[0].max() > 0.5
        np.testing.assert_allclose(direct[1], direct[0], rtol=0, atol=10 * FLOAT32)

    def test_one_override_after_another(self) -> None:
        preset = STANDARD.altered(albedo=0.8).altered(snr=5.0).altered(albedo=0.0)
        assert preset.darkest_snr == 5 and not preset.bounces
        again = preset.altered(albedo=0.3)
        assert again.bounces and again.albedo == 0.3
        assert again.albedo * again.brightness == pytest.approx(
            STANDARD.albedo * STANDARD.brightness
        )


class TestSharing:
    """A scene altered from another is the scene built with these overrides from the start."""

    @pytest.mark.parametrize(
        "overrides",
        [{"albedo": 0.8}, {"albedo": 0.0}, {"defocus_px": 2.0, "gamma_left": 0.9}, {"snr": 12.0}],
    )
    def test_an_altered_scene_equals_a_new_one(
        self, standard: DomeScene, overrides: dict[str, float]
    ) -> None:
        new = DomeScene(STANDARD.altered(**overrides), SIZE, 1)  # type: ignore[arg-type]
        altered = standard.altered(**overrides)  # type: ignore[arg-type]
        picture = np.random.default_rng(8).integers(0, 256, WHITE.shape, dtype=np.uint8)
        one, two = _signal(new, picture), _signal(altered, picture)
        np.testing.assert_allclose(two, one, rtol=0, atol=FLOAT32)
        assert new.preset == altered.preset
        assert (PhotographBench(new, "south")._sensor.noise is None) == (
            new.preset.white_snr is None
        )


def _darkest(scene: DomeScene, exposure_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Camera pixels (H, W) near the 0.5 percentile, and white less black (H, W), full scale 1."""
    benches = [PhotographBench(scene, name, exposure_s=exposure_s) for name in scene.lights]
    quantiles = []
    for bench in benches:
        light = bench._light
        margin = 4 * np.hypot(light.build.defocus_px, CAMERA_BLUR_PX)
        inside = distance_transform_edt(np.pad(light.lit, 1))[1:-1, 1:-1] > margin
        where = bench.projector_pixels()
        clear = np.isfinite(where[..., 0])
        column, row = np.rint(where[clear]).astype(int).T
        clear[clear] = inside[row.clip(0, PANEL[1] - 1), column.clip(0, PANEL[0] - 1)]
        white, black = bench.photograph([WHITE, BLACK])
        quantiles.append((np.quantile((white - black)[clear], 0.005), clear, white - black))
    level, clear, difference = min(quantiles, key=lambda entry: entry[0])
    return clear & (np.abs(difference / level - 1) < 0.015), difference


def _ratio(stack: np.ndarray, use: np.ndarray, difference: np.ndarray) -> tuple[float, float]:
    """SNR of repeated frames (K, H, W) over like pixels, and its standard error."""
    sigma = np.sqrt(stack[:, use].var(axis=0, ddof=1).mean())
    ratio = float((4095 - 64) * difference[use].mean() / sigma)
    return ratio, ratio / np.sqrt(2 * use.sum() * (len(stack) - 1))


class TestSnr:
    FRAMES = 100
    SAME_PIXELS = 0.01  # the darkest ones are picked twice, each time with margins of its own

    @pytest.mark.parametrize(
        ("scene_name", "overrides"),
        [
            ("ideal", {"snr": 30.0}),
            ("standard", {"snr": 8.0}),
            ("standard", {"snr": 200.0, "albedo": 0.8, "defocus_px": 1.5}),
        ],
    )
    def test_frames_have_the_requested_snr(
        self, request: pytest.FixtureRequest, scene_name: str, overrides: dict[str, float]
    ) -> None:
        scene: DomeScene = request.getfixturevalue(scene_name).altered(**overrides)
        exposure_s = white_exposure_s(scene.preset)
        use, difference = _darkest(scene, exposure_s)
        names = list(scene.lights)
        shown = min(names, key=lambda n: difference[use].mean() - _white_at(scene, n, use))
        stack = self._frames(scene, shown, exposure_s)
        found, error = _ratio(stack, use, difference)
        assert error < 0.01 * overrides["snr"]
        limit = SIGMAS * error + self.SAME_PIXELS * overrides["snr"]
        assert abs(found - overrides["snr"]) < limit, f"{found:.3f} +- {error:.3f}"

    def _frames(self, scene: DomeScene, projector: str, exposure_s: float) -> np.ndarray:
        """White of one projector, again and again, by the camera that the rig has."""
        scene.states[projector].switch_on()
        scene.clock.sleep(100.0)
        width, height = PANEL
        SimulatedProjector(scene, projector).show(np.ones((height, width, 3), np.float32))
        camera = SimulatedCamera(scene, "zenith")
        camera.configure(CameraSettings(exposure_s, "mono"))
        return np.stack([camera.capture().counts for _ in range(self.FRAMES)]).astype(float)

    def test_an_snr_beyond_the_bits_is_refused(
        self, ideal: DomeScene, rng: np.random.Generator
    ) -> None:
        bench = PhotographBench(ideal, "south", exposure_s=0.01)
        with pytest.raises(
            Exception, match="snr of camera zenith is 5000; 12 bits allow less than"
        ):
            bench.digitise(np.zeros((200, 200), np.float32), rng, 5000.0)


def _white_at(scene: DomeScene, projector: str, use: np.ndarray) -> float:
    white, black = PhotographBench(
        scene, projector, exposure_s=white_exposure_s(scene.preset)
    ).photograph([WHITE, BLACK])
    return float((white - black)[use].mean())


class TestDefocus:
    # below a pixel a profile that is linear between pixels is no normal integral any more
    @pytest.mark.parametrize(
        ("defocus_px", "tolerance"), [(0.0, 0.05), (1.0, 0.02), (2.0, 0.02), (4.0, 0.02)]
    )
    def test_an_edge_has_the_requested_blur(
        self, ideal: DomeScene, defocus_px: float, tolerance: float
    ) -> None:
        """Its profile over projector columns is a normal integral: the slope of its probit."""
        scene = ideal.altered(defocus_px=defocus_px, albedo=0.0)
        edge = WHITE.copy()
        edge[:, : PANEL[0] // 2] = 0
        bench = PhotographBench(scene, "south")
        white, black, half = bench.photograph([WHITE, BLACK, edge])
        where = bench.projector_pixels()
        inner = (np.abs(where[..., 0] - PANEL[0] / 2) < 30) & (np.abs(where[..., 1] - 50) < 25)
        share = (half - black)[inner] / (white - black)[inner]
        rising = (share > 0.03) & (share < 0.97)
        assert rising.sum() > 30
        slope = np.polyfit(where[inner][rising, 0], ndtri(share[rising].astype(float)), 1)[0]
        # 1/6 from linear interpolation between pixels, -1/12 from a sum in place of an integral
        expected = np.sqrt(defocus_px**2 + CAMERA_BLUR_PX**2 + 1 / 12)
        assert 1 / slope == pytest.approx(expected, rel=tolerance)


class TestGamma:
    @pytest.mark.parametrize("factor", [1.0, 0.8, 1.1])
    def test_grey_levels_follow_the_altered_gamma(self, ideal: DomeScene, factor: float) -> None:
        scene = ideal.altered(gamma_left=factor)
        bench = PhotographBench(scene, "south")
        grey = np.array([0, 20, 64, 128, 200, 255], np.uint8)
        lit = np.isfinite(bench.projector_pixels()[..., 0])
        signals = np.array(
            [s[lit].mean() for s in bench.photograph(np.full_like(WHITE, g) for g in grey)]
        )
        found = (signals - signals[0]) / (signals[-1] - signals[0])
        (nominal,) = place_projectors(1, PANEL, IDEAL)
        v = np.rint(grey / 255 * 1023)[:, None] / 1023  # the input has 10 bits
        toe = nominal.toe * v * v * (3 - 2 * v)
        primaries = (1 - nominal.toe) * v ** (nominal.gamma * factor) + toe
        expected = primaries @ nominal.colour_mix[1] / nominal.colour_mix[1].sum()
        np.testing.assert_allclose(found, expected, atol=10 * FLOAT32)


class TestVenueFile:
    OVERRIDES = {"albedo": 0.8, "snr": 10.0, "defocus_px": 0.0, "gamma_left": 1.05}  # noqa: RUF012

    @pytest.mark.parametrize("preset", ["ideal", "standard"])
    def test_overrides_are_written_and_reach_the_scene(
        self, tmp_path: Path, preset: PresetName
    ) -> None:
        text = venue_text(preset, SIZE, 3, **self.OVERRIDES)  # type: ignore[arg-type]
        (tmp_path / "venue.toml").write_text(text)
        venue = load_venue(tmp_path)
        settings = venue.backends["simulated"]
        assert self.OVERRIDES.items() <= settings.items()
        assert tomllib.loads(text)["cameras"]["zenith"]["bits"] == 12
        scene = build_scene(settings, tmp_path)
        assert scene.preset == PRESETS[preset].altered(**self.OVERRIDES)  # type: ignore[arg-type]
        assert {light.build.defocus_px for light in scene.lights.values()} == {0.0}
        assert tomllib.loads(text)["capture"]["exposure_s"] == white_exposure_s(scene.preset)

    @pytest.mark.parametrize("albedo", [None, 0.0, 0.3, 0.8, 0.95])
    @pytest.mark.parametrize("snr", [None, 3.0, 10.0])
    def test_white_is_just_below_saturation(
        self, albedo: float | None, snr: float | None, traced: DomeScene, rng: np.random.Generator
    ) -> None:
        scene = traced.altered(albedo=albedo, snr=snr)
        bench = PhotographBench(scene, "south")
        (signal,) = bench.photograph([WHITE])
        saturated = bench.digitise(signal, rng) == 4095
        assert saturated.mean() < 1e-3
        assert signal.max() > (0.75 if snr is None else 0.55)

    @pytest.fixture(scope="class")
    @classmethod
    def traced(cls) -> Iterator[DomeScene]:
        """A room with a bright deck, as the presets have it."""
        with coarse_rooms():
            yield DomeScene(STANDARD, SIZE, 1)
