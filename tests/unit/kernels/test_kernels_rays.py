"""fisheye_rays against its reference implementation and against the projection of the lens."""

from collections.abc import Callable

import numpy as np
import pytest

from procam import kernels
from procam.kernels.bundle import lenses as reference_lenses
from procam.maths.geometry.lenses import Lens, project

LENS = np.array([900.0, 905, 1500, 1499, 0.02, -0.008, 0.001, 0.0])
FOLDING = np.array([900.0, 905, 1500, 1499, -0.1, 0.0, 0.0, 0.0])  # at 1.83 rad


def _pixels(count: int) -> np.ndarray:
    return np.random.default_rng(2).uniform(200, 2800, (count, 2))


@pytest.mark.parametrize("count", [0, 1, 64, 65, 5000])
def test_equals_the_reference(level: str, count: int) -> None:
    found = kernels.fisheye_rays(_pixels(count), LENS)
    np.testing.assert_allclose(
        found, reference_lenses.fisheye_rays(_pixels(count), LENS), atol=4e-15
    )
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, rtol=1e-14)


def test_ends_where_the_pixel_is(level: str) -> None:
    pixels = np.r_[_pixels(300), [[1500, 1499], [1500 + 1e-9, 1499]]]
    lens = Lens("kannala-brandt", LENS[:2], LENS[2:4], LENS[4:])
    np.testing.assert_allclose(project(kernels.fisheye_rays(pixels, LENS), lens), pixels, atol=1e-9)


def test_up_to_where_the_lens_folds(level: str) -> None:
    """The picture's edge, where it hardly widens any more: angles to 1e-6 of 0.1 % before it."""
    theta = np.linspace(0, 0.99 * np.sqrt(1 / 0.3), 500)
    radius = reference_lenses.fisheye_radius(theta, FOLDING[4:])
    ray = kernels.fisheye_rays(np.c_[1500 + 900 * radius, np.full(500, 1499)], FOLDING)
    np.testing.assert_allclose(np.arctan2(ray[:, 0], ray[:, 2]), theta, atol=1e-12)


def test_any_shape_and_type(level: str, odd_layout: Callable[[np.ndarray], np.ndarray]) -> None:
    pixels = _pixels(12).reshape(3, 4, 2)
    wanted = kernels.fisheye_rays(pixels, LENS)
    assert wanted.shape == (3, 4, 3) and wanted.dtype == np.float64
    np.testing.assert_array_equal(kernels.fisheye_rays(odd_layout(pixels), LENS), wanted)
    np.testing.assert_array_equal(kernels.fisheye_rays(pixels[1, 2], LENS), wanted[1, 2])
    coarse = kernels.fisheye_rays(pixels.astype(np.float32), LENS)
    np.testing.assert_allclose(coarse, wanted, atol=1e-6)


def test_what_is_not_a_number_stays_so(level: str) -> None:
    pixels = _pixels(70)
    pixels[5], pixels[66, 1] = np.nan, np.nan
    found = kernels.fisheye_rays(pixels, LENS)
    np.testing.assert_array_equal(np.isnan(found).any(axis=1), np.isin(np.arange(70), [5, 66]))


def test_threads_change_nothing(level: str) -> None:
    found = []
    for threads in (1, 2):
        with kernels.forced(level, threads):
            found.append(kernels.fisheye_rays(_pixels(9001), LENS))
    np.testing.assert_array_equal(*found)
