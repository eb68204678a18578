"""What projectors' menus have switched on does to their light, and to nothing else."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exact_room import PANEL, SIZE, exact_rooms
from scipy.special import ndtr
from tolerances import CODE_8BIT, FLOAT32

from procam.errors import InputError
from simulators.backend import build_scene
from simulators.builds import UNSHARP_PX, Features
from simulators.clock import SceneClock
from simulators.devices import SETTLE_S, SimulatedProjector
from simulators.placement import place_projectors
from simulators.presets import STANDARD
from simulators.projector_light import ProjectorLight, _blurred_flux
from simulators.projector_state import ProjectorState
from simulators.scene import ALL_BANDS, DomeScene
from simulators.surface import Surface

BUILD = place_projectors(1, PANEL)[0]
RNG = np.random.default_rng(5)


def build(**sizes: float):
    return replace(BUILD, features=Features(**sizes))


def grey(level: float) -> np.ndarray:
    return np.full((4, 6, 3), level, np.float32)


@pytest.fixture(scope="module")
def scene() -> Iterator[DomeScene]:
    with exact_rooms():
        yield DomeScene(STANDARD.with_features({"north": {"picture-delay-s": 0.4}}), SIZE, 1)


class TestNames:
    def test_from_the_table_of_the_backend(self) -> None:
        settings = {
            "preset": "standard",
            "projectors": 2,
            "projector_size": PANEL,
            "camera_size": [32, 32],
            "rays": 64,
            "features": {"north": {"white-boost": 0.25}},
        }
        with exact_rooms():
            scene = build_scene(settings, Path())
        assert scene.lights["north"].build.features.white_boost == 0.25
        assert scene.lights["south"].build.features == Features()

    @pytest.mark.parametrize(
        ("sizes", "message"),
        [
            (
                {"gremlins": 1},
                r"feature gremlins is not one of constant-light, dynamic-b",
            ),
            ({"constant-light": 1.5}, r"constant-light is 1.5; it must be 0 to 1"),
            ({"pixel-shift": -0.5}, r"pixel-shift is -0.5; it must be 0 to 4"),
            ({"white-boost": float("nan")}, r"white-boost is nan; it must be 0 to 5"),
        ],
    )
    def test_others_are_refused(self, sizes: dict[str, float], message: str) -> None:
        with pytest.raises(InputError, match=message):
            Features.named(sizes)

    def test_of_an_unknown_projector(self) -> None:
        preset = STANDARD.with_features({"attic": {"white-boost": 0.1}})
        with pytest.raises(InputError, match="projector attic is not one of south, north"):
            DomeScene(preset, SIZE, 1)


class TestPicture:
    def test_white_boost_makes_pure_colours_darker(self) -> None:
        plain, boosted = BUILD, build(white_boost=0.25)
        colours = np.eye(3, dtype=np.float32)
        for drive in (colours, 1 - colours):
            assert np.allclose(boosted.linear(drive), plain.linear(drive) / 1.25, rtol=FLOAT32)
        for level in (0.3, 1.0):  # the light of grey's weakest primary comes back
            light, expected = boosted.linear(grey(level)), plain.linear(grey(level))
            shared = expected.min(axis=-1, keepdims=True)
            assert np.allclose(light, (expected + 0.25 * shared) / 1.25, rtol=FLOAT32)
        assert np.allclose(boosted.linear(grey(1.0)), 1)

    @pytest.mark.parametrize(
        ("code", "becomes"), [(0, 0), (16, 0), (235, 1), (255, 1), (125.5, 0.5)]
    )
    def test_limited_range_takes_16_for_black_and_235_for_white(
        self, code: float, becomes: float
    ) -> None:
        processed = Features(limited_range=1).processed(grey(code / 255))
        assert np.allclose(processed, becomes, atol=FLOAT32)

    def test_edges_are_enhanced_and_flat_parts_are_not(self) -> None:
        drive = np.full((9, 41, 3), 0.3, np.float32)
        drive[:, 20:] = 0.6
        processed = Features(edge_enhancement=0.5).processed(drive)
        assert np.allclose(processed[:, :12], 0.3) and np.allclose(processed[:, 29:], 0.6)
        smooth = 0.3 + 0.3 * ndtr(0.5 / UNSHARP_PX)  # beside the edge, of a Gaussian's integral
        assert processed[4, 20, 0] == pytest.approx(0.6 + 0.5 * (0.6 - smooth), abs=3e-3)

    def test_grey_tables_agree_with_pictures(self) -> None:
        light = ProjectorLight.on(
            Surface.build(STANDARD), build(limited_range=1, edge_enhancement=0.5)
        )
        picture = RNG.integers(0, 256, (*PANEL[::-1], 1), np.uint8)
        drive = np.repeat(picture / np.float32(255), 3, axis=2)
        assert np.allclose(
            light.emit_grey(picture, ALL_BANDS), light.emit(drive, ALL_BANDS), rtol=FLOAT32
        )

    @pytest.mark.parametrize("shift", [0.5, 1.0])
    def test_pixel_shift_is_half_the_light_elsewhere(self, shift: float) -> None:
        point = np.zeros((31, 41, 2), np.float32)
        point[15, 20] = 1
        seen = _blurred_flux(point, 1.2, shift)[..., 0]
        rows, columns = np.indices(seen.shape)
        assert seen.sum() == pytest.approx(1, rel=FLOAT32)
        assert (seen * columns).sum() == pytest.approx(20 + shift / 2, abs=1e-3)
        assert (seen * rows).sum() == pytest.approx(15 + shift / 2, abs=1e-3)
        spread = (seen * (columns - 20 - shift / 2) * (rows - 15 - shift / 2)).sum()
        assert spread == pytest.approx(shift**2 / 4, rel=2e-3)  # of two points


class TestLoad:
    def factor(self, load: float, after_s: float, **sizes: float) -> float:
        """Share of the light after a while of a picture that follows black."""
        clock = SceneClock()
        state = ProjectorState(clock, on=True, features=Features(**sizes))
        state.follow(load)
        clock.sleep(after_s)
        return state.light_factor()

    def test_an_iris_opens_slowly(self) -> None:
        for after_s in (0.0, 0.5, 30.0):
            behind = 0.6 * (1 - np.exp(-after_s / 2))
            found = self.factor(0.6, after_s, dynamic_black=0.4, iris_s=2.0)
            assert found == pytest.approx(1 - 0.4 * (1 - behind))

    def test_bright_pictures_dim_at_once(self) -> None:
        assert self.factor(0.5, 0.0, constant_light=0.2) == pytest.approx(0.9)

    def test_a_picture_sets_its_mean_drive(self, scene: DomeScene) -> None:
        scene.states["south"] = ProjectorState(
            scene.clock, on=True, features=Features(constant_light=0.2)
        )
        width, height = PANEL
        half = np.zeros((height, width, 3), np.float32)
        half[:, : width // 2] = 1
        SimulatedProjector(scene, "south").show(half)
        assert scene.states["south"].light_factor() == pytest.approx(0.9, abs=CODE_8BIT)

    def test_a_late_picture(self, scene: DomeScene) -> None:
        white = np.ones((*PANEL[::-1], 3), np.float32)
        SimulatedProjector(scene, "north").show(white)
        assert not scene.on_screen("north").any()
        scene.clock.sleep(0.4 - SETTLE_S + 1e-6)
        assert scene.on_screen("north").all()
