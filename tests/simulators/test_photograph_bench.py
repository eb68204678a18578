"""Photographs without a rig: the same as the rig's camera takes, and the truth beside them."""

from collections.abc import Iterator

import numpy as np
import pytest
from exact_room import PANEL, SIZE, exact_rooms
from scipy.ndimage import distance_transform_edt, map_coordinates

from procam.errors import ShapeError, UnitError
from procam.maths.geometry.lenses import project
from procam.model.frame import CameraSettings
from simulators.devices import SimulatedCamera, SimulatedProjector
from simulators.photograph_bench import PhotographBench
from simulators.presets import IDEAL, PRESETS, PresetName
from simulators.scene import DomeScene

SHAPE = (*PANEL[::-1], 1)
WHITE = np.full(SHAPE, 255, np.uint8)


@pytest.fixture(scope="module", autouse=True)
def closed_form() -> Iterator[None]:
    with exact_rooms():
        yield


@pytest.fixture(scope="module")
def scene() -> DomeScene:
    return DomeScene(IDEAL, SIZE, 1)


def _picture(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 256, SHAPE, dtype=np.uint8)


class TestPhotograph:
    @pytest.mark.parametrize("preset", ["ideal", "realistic"])
    def test_equals_the_photograph_of_the_rigs_camera(
        self, preset: PresetName, rng: np.random.Generator
    ) -> None:
        scene = DomeScene(PRESETS[preset], SIZE, 1)
        picture = _picture(rng)
        scene.states["north"].switch_on()
        scene.clock.sleep(100.0)
        SimulatedProjector(scene, "north").show(np.repeat(picture, 3, -1) / np.float32(255))
        camera = SimulatedCamera(scene, "zenith")
        camera.configure(CameraSettings(0.1, "mono"))
        gain = 1 + PRESETS[preset].drift * scene.clock.now_s() / 600
        noise = scene.noise_stream("zenith", camera.configure(CameraSettings(0.1, "mono")))
        scene._repeats.clear()  # the camera draws the same noise again
        counts = camera.capture().counts
        bench = PhotographBench(scene, "north", exposure_s=0.1)
        (signal,) = bench.photograph([picture])
        assert signal.dtype == np.float32
        # floats are summed in another order
        again = bench.digitise(signal * np.float32(gain), noise)
        assert np.abs(again.astype(int) - counts).max() <= 1

    def test_pictures_come_one_by_one(self, scene: DomeScene, rng: np.random.Generator) -> None:
        pictures = [_picture(rng) for _ in range(3)]
        bench = PhotographBench(scene, "south")
        frames = list(bench.photograph(iter(pictures)))
        assert len({frame.tobytes() for frame in frames}) == 3
        for picture, frame in zip(pictures, frames, strict=True):
            np.testing.assert_array_equal(next(bench.photograph([picture])), frame)

    def test_digitising_does_not_change_the_signal(
        self, scene: DomeScene, rng: np.random.Generator
    ) -> None:
        bench = PhotographBench(scene, "south")
        (signal,) = bench.photograph([WHITE])
        before = signal.copy()
        one, two = (bench.digitise(signal, rng, 20.0) for _ in range(2))
        np.testing.assert_array_equal(signal, before)
        assert (one != two).mean() > 0.3 and one.dtype == np.uint16

    @pytest.mark.parametrize("snr", [None, 5.0])
    def test_the_same_generator_gives_the_same_counts(
        self, scene: DomeScene, snr: float | None
    ) -> None:
        bench = PhotographBench(scene, "south")
        (signal,) = bench.photograph([WHITE])
        one, two = (bench.digitise(signal, np.random.default_rng(3), snr) for _ in range(2))
        np.testing.assert_array_equal(one, two)

    def test_refuses_other_pictures(self, scene: DomeScene) -> None:
        bench = PhotographBench(scene, "south")
        with pytest.raises(ShapeError, match="picture of projector south"):
            next(bench.photograph([WHITE[..., 0]]))
        with pytest.raises(UnitError, match="picture of projector south has float64"):
            next(bench.photograph([WHITE / 255]))


class TestProjectorPixels:
    @pytest.mark.parametrize("preset", ["ideal", "realistic"])
    @pytest.mark.parametrize("name", ["south", "north"])
    def test_agree_with_tracing_from_the_projector(self, preset: PresetName, name: str) -> None:
        """From the projector's pixel to the dome and on into the camera, and back by the map."""
        scene = DomeScene(PRESETS[preset], SIZE, 1)
        light, build = scene.lights[name], scene.cameras["zenith"]
        truth = PhotographBench(scene, name).projector_pixels()
        point = light.direction * scene.surface.radius(light.direction)[..., None]
        pixel = project(build.camera_from_dome.apply(point), build.lens)
        column, row = np.moveaxis(pixel, -1, 0)
        found = [
            map_coordinates(truth[..., i], [row, column], order=1, cval=np.nan) for i in (0, 1)
        ]
        y, x = np.mgrid[: PANEL[1], : PANEL[0]]
        # a blocked pixel may keep a corner that is interpolated between lit ones
        known = np.isfinite(found[0])
        assert (known & light.lit).sum() > 0.85 * light.lit.sum()
        assert (known & ~light.lit).sum() < 0.01 * light.lit.sum()
        error = np.hypot(found[0] - x, found[1] - y)[known]
        # the map bends between camera pixels, and a step between panels breaks it
        assert np.median(error) < 0.02 and np.quantile(error, 0.99) < 0.2

    def test_white_lights_those_pixels_only(self, scene: DomeScene) -> None:
        bench = PhotographBench(scene.altered(albedo=0.0, defocus_px=0.0), "south")
        covered = np.isfinite(bench.projector_pixels()).all(axis=-1)
        (white,) = bench.photograph([WHITE])
        inside = distance_transform_edt(covered) > 3
        outside = distance_transform_edt(~covered) > 4
        assert inside.sum() > 5000 and outside.sum() > 5000
        assert white[inside].min() > 0.05
        assert white[outside].max() < 1e-4

    def test_pixels_behind_the_plates_are_nan(self, scene: DomeScene) -> None:
        bench = PhotographBench(scene, "south")
        where, blocked = scene.sight_lines("zenith").sources["south"][0], ~bench._light.lit
        assert blocked.any()
        truth = bench.projector_pixels()
        inside = np.all((where > 0) & (where < np.array(PANEL) - 1), axis=-1)
        column, row = np.rint(where[inside]).astype(int).T
        np.testing.assert_array_equal(np.isnan(truth[inside][:, 0]), blocked[row, column])
        lit = np.isfinite(truth[..., 0])
        np.testing.assert_array_equal(truth[lit], where[lit])
