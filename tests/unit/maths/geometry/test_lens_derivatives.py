"""Derivatives of lenses against central differences of `project` and `unproject`."""

from dataclasses import replace

import numpy as np
import pytest

from procam.kernels.bundle.lenses import ray_slopes
from procam.maths.geometry.lenses import (
    Lens,
    lens_parameters,
    project,
    project_with_derivatives,
    unproject,
)

LENSES = {
    "brown": Lens(
        "brown",
        np.array([800.0, 790.0]),
        np.array([600.0, 700.0]),
        np.array([-0.12, 0.03, 0.001, -0.002, 0.004]),
    ),
    "kannala-brandt": Lens(
        "kannala-brandt",
        np.array([400.0, 402.0]),
        np.array([520.0, 500.0]),
        np.array([0.02, -0.008, 0.001, -0.0002]),
    ),
}


def _points(kind: str) -> np.ndarray:
    rng = np.random.default_rng(3)
    points = rng.normal(size=(200, 3)) * [1, 1, 0.5] * 3
    if kind == "brown":
        points[:, 2] = np.abs(points[:, 2]) + 3
    points[0] = [0, 0, 2]
    points[1] = [1e-9, 0, 2]
    return points


def _changed(lens: Lens, i: int, step: float) -> Lens:
    values = np.r_[lens.focal, lens.centre, lens.distortion]
    values[i] += step
    return replace(lens, focal=values[:2], centre=values[2:4], distortion=values[4:])


@pytest.mark.parametrize("kind", LENSES)
def test_project(kind: str) -> None:
    lens, points = LENSES[kind], _points(kind)
    pixels, by_point, by_lens = project_with_derivatives(points, lens)
    np.testing.assert_allclose(pixels, project(points, lens), atol=1e-9)
    for i in range(3):
        step = 1e-6 * np.eye(3)[i]
        slope = (project(points + step, lens) - project(points - step, lens)) / 2e-6
        np.testing.assert_allclose(by_point[..., i], slope, atol=2e-4, rtol=1e-5)
    for i in range(by_lens.shape[-1]):
        ahead, behind = (
            project(points, _changed(lens, i, 1e-5)),
            project(points, _changed(lens, i, -1e-5)),
        )
        np.testing.assert_allclose(by_lens[..., i], (ahead - behind) / 2e-5, atol=1e-4, rtol=1e-5)


@pytest.mark.parametrize("kind", LENSES)
def test_unproject(kind: str) -> None:
    lens = LENSES[kind]
    pixels = np.random.default_rng(4).uniform(60, 1000, (300, 2))
    pixels[0] = lens.centre
    by_lens = ray_slopes(unproject(pixels, lens), lens.kind, lens_parameters(lens))
    for i in range(by_lens.shape[-1]):
        step = 1e-3 if i < 4 else 1e-6
        ahead = unproject(pixels, _changed(lens, i, step))
        behind = unproject(pixels, _changed(lens, i, -step))
        np.testing.assert_allclose(
            by_lens[..., i], (ahead - behind) / (2 * step), atol=1e-7, rtol=1e-5
        )


def test_points_behind_a_pinhole_give_nan() -> None:
    pixels, by_point, _ = project_with_derivatives(np.array([[0.0, 1.0, -1.0]]), LENSES["brown"])
    assert np.isnan(pixels).all() and np.isnan(by_point).all()
