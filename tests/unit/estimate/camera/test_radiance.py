"""The radiometer against a simulated sensor."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from tolerances import FLOAT32

from procam.estimate.camera.radiance import Radiometer
from procam.maths.geometry.lenses import Lens, unproject
from procam.model.frame import CameraSettings, Frame
from procam.model.optics import CameraModel, Sensor

SIZE = (61, 47)


def _camera(glare: float = 0.0, bits: int = 16, kind: str = "kannala-brandt") -> CameraModel:
    centre = np.array([30.5, 22.75])
    if kind == "brown":
        lens = Lens("brown", np.full(2, 40.0), centre, np.zeros(5))
    else:
        lens = Lens("kannala-brandt", np.full(2, 14.0), centre, np.array([0.02, -0.008, 0, 0]))
    return CameraModel("c", SIZE, lens, Sensor(bits, 64.0, (-0.04, -0.004), glare))


def _photograph(
    camera: CameraModel, radiance: np.ndarray, exposure_s: float, pixel_format: str = "rgb"
) -> Frame:
    """Glare, then vignetting, exposure, black level and saturation."""
    width, height = SIZE
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    ray = unproject(np.stack([x, y], axis=-1).astype(float), camera.lens)
    theta = np.arccos(np.clip(ray[..., 2], -1, 1))
    circle = np.ones((height, width), bool)
    if camera.lens.kind == "kannala-brandt":
        circle = np.hypot(x - camera.lens.centre[0], y - camera.lens.centre[1]) <= min(SIZE) / 2
    fall = np.where(circle, 1 - 0.04 * theta**2 - 0.004 * theta**4, 0)
    g = camera.sensor.glare
    veiled = (1 - g) * radiance + g * radiance[circle].mean(axis=0)
    fall = fall[..., None] if radiance.ndim == 3 else fall
    counts = veiled * fall * exposure_s * camera.sensor.full_scale + camera.sensor.black_level
    limit = 2**camera.sensor.bits - 1
    counts = np.clip(np.rint(counts), 0, limit).astype(np.uint16)
    return Frame(counts, CameraSettings(exposure_s, pixel_format), 0.0, exposure_s)


@pytest.mark.parametrize("glare", [0.0, 0.02, 0.03])
def test_a_veil_near_its_light_is_taken_out(rng: np.random.Generator, glare: float) -> None:
    """It is a part of the glare, or all of it where less glare was stated."""
    local, spread = 0.02, 0.1
    sensor = replace(_camera(glare).sensor, near_glare=((local, spread),))
    camera = replace(_camera(glare), sensor=sensor)
    radiometer = Radiometer(camera)
    radiance = rng.uniform(0.5, 4.0, SIZE[::-1]) * (np.arange(SIZE[0]) < 30) * radiometer.seen
    even = max(glare - local, 0.0) * radiance[radiometer.seen].mean()
    near = gaussian_filter(radiance, spread * min(SIZE), mode="constant")
    plain = replace(camera, sensor=replace(sensor, glare=0.0))
    veiled = (1 - glare) * radiance + even + local * near
    found = radiometer.radiance(_photograph(plain, veiled, 0.1, "mono"))
    # cells of four pixels are coarse in so small a picture
    np.testing.assert_allclose(found[radiometer.seen], radiance[radiometer.seen], atol=0.01)


@pytest.mark.parametrize("kind", ["kannala-brandt", "brown"])
@pytest.mark.parametrize("glare", [0.0, 0.2])
@pytest.mark.parametrize("channels", [(), (3,)])
def test_undoes_the_sensor(
    rng: np.random.Generator, kind: str, glare: float, channels: tuple[int, ...]
) -> None:
    camera = _camera(glare, kind=kind)
    radiance = rng.uniform(0.5, 4.0, (SIZE[1], SIZE[0], *channels))
    frame = _photograph(camera, radiance, 0.1, "rgb" if channels else "mono")
    radiometer = Radiometer(camera)
    found = radiometer.radiance(frame)
    assert found.dtype == np.float32 and found.shape == radiance.shape
    half_a_count = 0.5 / (camera.sensor.full_scale * 0.1) / 0.6 / (1 - glare)
    seen = radiometer.seen
    np.testing.assert_allclose(found[seen], radiance[seen], rtol=FLOAT32, atol=1.5 * half_a_count)


def test_saturated_is_unknown_and_nothing_else() -> None:
    camera = _camera(0.003, bits=12)
    radiance = np.ones((SIZE[1], SIZE[0], 3))
    radiance[20, 30, 1] = 50.0
    found = Radiometer(camera).radiance(_photograph(camera, radiance, 0.1))
    assert np.argwhere(np.isnan(found)).tolist() == [[20, 30, 1]]


def test_the_image_circle_ends_at_the_short_side() -> None:
    seen = Radiometer(_camera()).seen
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    np.testing.assert_array_equal(seen, np.hypot(x - 30.5, y - 22.75) <= 23.5)
    assert Radiometer(_camera(kind="brown")).seen.all()


def test_pixels_beyond_the_fold_of_a_lens_are_not_seen() -> None:
    camera = _camera()
    folding = replace(camera.lens, distortion=np.array([-0.1, 0.0, 0.0, 0.0]))
    radius = np.hypot(*(np.indices(SIZE[::-1]) - camera.lens.centre[::-1, None, None]))
    theta = np.sqrt(1 / 0.3)  # where theta - 0.1 theta^3 is largest
    fold_px = 14 * theta * (1 - 0.1 * theta**2)
    seen = Radiometer(replace(camera, lens=folding)).seen
    assert 10 < fold_px < min(SIZE) / 2
    np.testing.assert_array_equal(seen, radius < fold_px)
