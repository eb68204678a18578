"""The scatter kernel: basis, moments, fit and prediction."""

import numpy as np
import pytest
from numpy.typing import NDArray

from procam.maths.geometry.sphere import master_directions, master_solid_angles
from procam.maths.light import scatter_kernel
from procam.maths.light.box_solver import solve_moments
from procam.maths.light.scatter_kernel import ZoneMeasurements, basis, moments, predicted_ratio

Array = NDArray[np.float64]
SIZE = 24
DEGREE = 2


class Dome:
    """Patches of a hemisphere of random albedo, and a random reciprocal kernel."""

    def __init__(self, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        direction, inside = master_directions(SIZE)
        self.direction, self.solid = direction[inside], master_solid_angles(SIZE)[inside]
        self.phi = basis(self.direction, DEGREE)
        bend = rng.normal(0, 0.01, (self.phi.shape[1],) * 2)
        self.kernel = np.diag(np.eye(len(bend))[0]) + bend + bend.T
        self.albedo = 0.1 * (1 + 0.1 * rng.normal(size=len(self.solid)))
        self.white = np.ones(len(self.solid))
        self.pictures = [
            np.maximum(self.direction @ rng.normal(size=3), 0) + (self.direction[:, 0] > edge)
            for edge in rng.uniform(-0.5, 0.5, 12)
        ]

    def moment(self, picture: Array) -> Array:
        return moments(picture[:, None], self.solid, self.phi)[:, 0]

    def scattered(self, picture: Array) -> Array:
        return self.albedo * (self.phi @ self.kernel @ self.moment(picture))

    @property
    def per_flux(self) -> Array:
        return self.scattered(self.white) / (self.solid @ self.white)

    def measurements(self, degree: int) -> ZoneMeasurements:
        size = (degree + 1) ** 2
        ratio = np.stack([self.scattered(p) / self.per_flux for p in self.pictures])
        moment = np.stack([self.moment(p)[:size] for p in self.pictures])
        pictures = ratio, np.ones_like(ratio), moment
        return ZoneMeasurements.of(self.phi[:, :size], pictures, self.moment(self.white)[:size])


@pytest.fixture(scope="module")
def dome() -> Dome:
    return Dome()


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_functions_are_orthonormal_over_the_upper_half_sphere(degree: int) -> None:
    points, weight = np.polynomial.legendre.leggauss(8)
    azimuth = np.arange(11) * 2 * np.pi / 11
    z, turn = (part.ravel() for part in np.meshgrid((points + 1) / 2, azimuth, indexing="ij"))
    across = np.sqrt(1 - z * z)
    phi = basis(np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1), degree)
    share = np.repeat(weight / weight.sum() / len(azimuth), len(azimuth))[:, None]
    np.testing.assert_allclose((share * phi).T @ phi, np.eye((degree + 1) ** 2), atol=1e-12)


def test_a_picture_held_out_is_predicted(dome: Dome, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten pictures determine the kernel for any albedo; it predicts the others."""
    monkeypatch.setattr(scatter_kernel, "PRIOR_WEIGHT", 1e-8)
    take = np.arange(12) < 10
    matrix, profile = dome.measurements(DEGREE).fit(take)
    np.testing.assert_allclose(matrix, matrix.T)
    for picture in dome.pictures[10:]:
        predicted = (
            dome.per_flux
            * predicted_ratio(dome.phi, matrix, profile, dome.moment(picture)[None])[0]
        )
        np.testing.assert_allclose(predicted, dome.scattered(picture), rtol=1e-3)


def test_entries_that_no_picture_determines_are_those_of_a_bare_sphere(dome: Dome) -> None:
    """The same picture ten times has no information on light that falls elsewhere."""
    picture = 1 + 0.5 * dome.direction[:, 0]
    ratio = np.stack([dome.scattered(picture) / dome.per_flux] * 10)
    moment = np.stack([dome.moment(picture)] * 10)
    measurements = ZoneMeasurements.of(
        dome.phi, (ratio, np.ones_like(ratio), moment), dome.moment(dome.white)
    )
    matrix, _ = measurements.fit(np.ones(10, bool))
    assert np.abs(matrix - np.diag(np.eye(9)[0])).max() < 0.03


def test_full_white_is_reproduced(dome: Dome) -> None:
    white = dome.moment(dome.white)
    matrix, profile = dome.measurements(DEGREE).fit(np.ones(12, bool))
    ratio = predicted_ratio(dome.phi, matrix, profile, white[None])[0]
    np.testing.assert_allclose(ratio, white[0], rtol=1e-6)
    assert (dome.phi @ profile).mean() == pytest.approx(1, rel=1e-9)


def test_unknown_patches_have_no_weight(dome: Dome) -> None:
    known = dome.measurements(1)
    ratio = np.stack([dome.scattered(p) / dome.per_flux for p in dome.pictures])
    moment = np.stack([dome.moment(p)[:4] for p in dome.pictures])
    weight = np.ones_like(ratio)
    spoiled, spoiled[:, :50], weight[:, :50] = np.nan * ratio, np.nan, 1.0
    spoiled[:, 50:] = ratio[:, 50:]
    white = dome.moment(dome.white)[:4]
    without = ZoneMeasurements.of(dome.phi[50:, :4], (ratio[:, 50:], weight[:, 50:], moment), white)
    found = ZoneMeasurements.of(dome.phi[:, :4], (spoiled, weight, moment), white)
    np.testing.assert_allclose(found.normal, without.normal, rtol=1e-12)
    assert not np.allclose(found.normal, known.normal)


class TestSolveMoments:
    @pytest.mark.parametrize("seed", range(3))
    def test_self_consistent_and_exact_where_free(self, seed: int) -> None:
        dome = Dome(seed)
        spread = 2 * dome.albedo[:, None] * (dome.phi @ dome.kernel)
        collect = dome.solid[:, None] * dome.phi
        target = 0.3 * dome.pictures[0]
        lo, hi = np.full_like(target, 0.005), np.full_like(target, 0.3)
        found = solve_moments(target, spread, collect, lo, hi)
        wanted = target - spread @ found
        direct = np.clip(wanted, lo, hi)
        assert 0.02 < np.mean(direct != wanted) < 0.98
        np.testing.assert_allclose(collect.T @ direct, found, rtol=1e-9, atol=1e-12)
        total = direct + (spread @ collect.T) @ direct
        free = direct == wanted
        np.testing.assert_allclose(total[free], target[free], rtol=1e-9)
