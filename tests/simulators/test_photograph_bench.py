"""Photographs without a rig: the same as the rig's camera takes, and the truth beside them."""

from collections.abc import Iterator

import numpy as np
import pytest
from exact_room import PANEL, SIZE, exact_rooms
from scipy.ndimage import map_coordinates

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
