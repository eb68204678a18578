"""Camera pixels of the patches of a panel, with standard errors and coverage."""

from dataclasses import dataclass

import numpy as np
import pytest

from procam.estimate.structured_light.panel_map import (
    MIN_PIXELS,
    MISFIT_PX,
    SMALLEST_PATCH_PX,
    drop_inconsistent,
    fit_projector_map,
    patch_size,
)
from procam.model.correspondence import CorrespondenceMap, ProjectorMap

SHAPE = (400, 520)
SIZE = (320, 240)
NOISE = 0.2


def panel_from_camera(place: np.ndarray) -> np.ndarray:
    """A turned, tilted and bulging view (..., 2), about 0.6 projector px per camera pixel."""
    u, v = (place[..., 0] - 260) / 260, (place[..., 1] - 200) / 200
    x = 160 + 150 * u + 25 * v + 14 * u * v + 9 * u**2 - 6 * u**3
    y = 120 + 118 * v - 16 * u - 10 * u * v + 8 * v**2 + 5 * u**2 * v
    return np.stack([x, y], axis=-1)


def slopes(place: np.ndarray) -> np.ndarray:
    """Its derivatives (..., 2, 2) by differences."""
    steps = [
        (panel_from_camera(place + h) - panel_from_camera(place - h)) / 2e-3
        for h in (np.array([1e-3, 0]), np.array([0, 1e-3]))
    ]
    return np.stack(steps, axis=-1)


def camera_from_panel(xy: np.ndarray) -> np.ndarray:
    """The inverse by Newton's method."""
    place = np.stack([260 + 1.7 * (xy[..., 0] - 160), 200 + 1.7 * (xy[..., 1] - 120)], axis=-1)
    for _ in range(30):
        step = np.linalg.solve(slopes(place), (xy - panel_from_camera(place))[..., None])[..., 0]
        place = place + np.clip(step, -30, 30)
    return place


def seen(noise: float | np.ndarray = NOISE, seed: int = 1) -> CorrespondenceMap:
    """A decoded map with noise [px]."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    truth = panel_from_camera(np.stack([x, y], -1).astype(float))
    valid = ((truth > -0.5) & (truth < np.array(SIZE) - 0.5)).all(axis=-1)
    scale = np.broadcast_to(noise, (*SHAPE, 2))
    xy = truth + scale * np.random.default_rng(seed).standard_normal(truth.shape)
    xy, sigma = (np.where(valid[..., None], v, np.nan).astype(np.float32) for v in (xy, scale))
    return CorrespondenceMap(xy, sigma, valid)


def without(found: CorrespondenceMap, gone: np.ndarray) -> CorrespondenceMap:
    valid = found.valid & ~gone
    xy, sigma = (
        np.where(valid[..., None], v, np.nan) for v in (found.projector_xy, found.sigma_px)
    )
    return CorrespondenceMap(xy, sigma, valid)


@dataclass(frozen=True)
class Judged:
    """Errors of the valid patches (P, 2) [projector px] and the standard error (P, 1) claimed."""

    error: np.ndarray
    sigma: np.ndarray

    @property
    def chi2(self) -> float:
        return float(np.mean((self.error / self.sigma) ** 2))


def centres(found: ProjectorMap) -> np.ndarray:
    rows, columns = np.indices(found.valid.shape)
    return (np.stack([columns, rows], -1) + 0.5) * found.patch_px - 0.5


def judged(found: ProjectorMap) -> Judged:
    ok = found.valid
    truth = camera_from_panel(centres(found)[ok])
    ahead = (found.camera_px[ok] - truth)[..., None]
    return Judged((slopes(truth) @ ahead)[..., 0], found.sigma_px[ok][:, None])


def whole(found: ProjectorMap) -> np.ndarray:
    """Patches (h, w) that the camera sees whole."""
    middle, half = centres(found), found.patch_px / 2
    corners = [middle + np.array([a, b]) for a in (-half, half) for b in (-half, half)]
    inside = (corners[3] <= np.array(SIZE) - 0.5).all(axis=-1)
    for corner in corners:
        place = camera_from_panel(corner)
        inside &= ((place > 0) & (place < np.array(SHAPE[::-1]) - 1)).all(axis=-1)
    return inside


@pytest.fixture(scope="module")
def fitted() -> ProjectorMap:
    return fit_projector_map(seen(), SIZE)


class TestFit:
    @pytest.mark.parametrize("noise", [0.05, 0.3])
    def test_standard_errors_hold(self, noise: float, monkeypatch: pytest.MonkeyPatch) -> None:
        # these pixels share no error with their neighbours
        monkeypatch.setattr("procam.estimate.structured_light.panel_map.SHARED_PX", 0.0)
        found = fit_projector_map(seen(noise), SIZE)
        result = judged(found)
        assert len(result.error) >= 2000
        assert 0.9 < result.chi2 < 1.1
        assert np.mean((result.error / result.sigma) ** 2 < 9) > 0.99
        # noise over the root of the pixels in a patch, a little more off its middle
        predicted = noise / np.sqrt(found.count[found.valid].mean())
        assert np.sqrt(np.mean(result.error**2)) == pytest.approx(predicted, rel=0.12)
        assert np.abs(result.error.mean(axis=0)).max() < 4 * predicted / len(result.error) ** 0.5

    def test_a_corner_of_a_block_does_not_bend(self) -> None:
        """Curvature is fitted in blocks of patches; from one patch of them it would be wild."""
        for seed in range(4):
            result = judged(fit_projector_map(seen(0.4, seed), SIZE))
            assert np.abs(result.error / result.sigma).max() < 6

    def test_unequal_noise_is_weighted(self) -> None:
        y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
        noise = np.where((x // 2 + y // 3) % 2, 0.6, 0.05)[..., None]
        result = judged(fit_projector_map(seen(noise), SIZE))
        assert 0.85 < result.chi2 < 1.15
        # as if only the better half were there
        assert np.sqrt(np.mean(result.error**2)) < 0.05 * np.sqrt(2 / 60)

    def test_slopes(self, fitted: ProjectorMap) -> None:
        truth = slopes(camera_from_panel(centres(fitted)[fitted.valid]))
        assert np.abs(fitted.slope[fitted.valid] - truth).max() < 0.06
        assert np.sqrt(np.mean((fitted.slope[fitted.valid] - truth) ** 2)) < 0.012

    @pytest.mark.parametrize(("noise", "short"), [(0.0, 1e-3), (0.3, 0.03)])
    def test_coverage_is_one_inside(self, noise: float, short: float) -> None:
        """Noise moves pixels over the edges of patches, and so flattens their slopes a little."""
        found = fit_projector_map(seen(noise), SIZE)
        inner = whole(found)
        assert inner.sum() > 2000
        assert found.coverage[inner].mean() == pytest.approx(1, abs=short)
        # camera pixels fall out or in at the patch's edges
        assert np.std(found.coverage[inner]) < 1.2 / np.sqrt(found.count[inner].mean())
        assert found.coverage.max() < 1.5
        assert (found.coverage[~found.valid] == 0).all()


class TestHoles:
    def test_holes_stay(self) -> None:
        y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
        truth = panel_from_camera(np.stack([x, y], -1).astype(float))
        gone = (np.abs(truth - [140, 90]) < 30).all(axis=-1)
        found = fit_projector_map(without(seen(), gone), SIZE)
        patch = found.patch_px
        empty = (np.abs(centres(found) - [140, 90]) < 30 - patch / 2 - 1).all(axis=-1)
        assert empty.sum() >= 9
        assert not found.valid[empty].any() and (found.coverage[empty] == 0).all()
        for field in (found.camera_px, found.sigma_px, found.slope):
            assert np.isnan(field[~found.valid]).all()
            assert np.isfinite(field[found.valid]).all()
        assert 0.9 < judged(found).chi2 < 1.1

    def test_half_a_patch_is_no_patch(self) -> None:
        """Its centre must lie near the middle of what is seen: nothing is extrapolated."""
        y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
        truth = panel_from_camera(np.stack([x, y], -1).astype(float))
        complete = fit_projector_map(seen(), SIZE)
        patch = complete.patch_px
        column = 30
        cut = patch * (column + 0.4) - 0.5
        found = fit_projector_map(without(seen(), truth[..., 0] > cut), SIZE)
        assert found.patch_px == patch
        assert complete.valid[:, column].sum() > 20 and not found.valid[:, column:].any()
        before = np.s_[:, : column - 1]
        np.testing.assert_array_equal(found.valid[before], complete.valid[before])

    def test_nothing_at_all(self) -> None:
        nothing = without(seen(), np.ones(SHAPE, bool))
        found = fit_projector_map(nothing, SIZE)
        assert found.patch_px == SMALLEST_PATCH_PX and not found.valid.any()
        assert found.valid.shape == (60, 80)

    def test_few_pixels_make_no_patch(self) -> None:
        keep = np.zeros(SHAPE, bool)
        keep[200:203, 260:263] = True
        assert MIN_PIXELS > 9
        assert not fit_projector_map(without(seen(), ~keep), SIZE).valid.any()


class TestPatchSize:
    @pytest.mark.parametrize("density", [0.5, 7.0])
    def test_follows_the_density(self, density: float) -> None:
        step = 1 / np.sqrt(density)
        grid = np.stack(np.meshgrid(np.arange(0, 320, step), np.arange(0, 240, step)), -1)
        expected = max(SMALLEST_PATCH_PX, np.sqrt(72 / density))
        assert patch_size(grid.reshape(-1, 2)) == pytest.approx(expected, abs=0.7)


class TestOutliers:
    @pytest.mark.parametrize("rate", [1e-3, 0.02])
    def test_misread_pixels_are_dropped_and_change_little_else(self, rate: float) -> None:
        clean = seen()
        rng = np.random.default_rng(7)
        bad = clean.valid & (rng.random(SHAPE) < rate)
        xy = clean.projector_xy.copy()
        xy[bad] += rng.choice([-18.3, -9.0, 9.0, 18.3], (bad.sum(), 2)).astype(np.float32)
        dirty = CorrespondenceMap(xy, clean.sigma_px, clean.valid)
        fitted = fit_projector_map(dirty, SIZE)
        found = drop_inconsistent(dirty, fitted)
        place = np.floor((xy + 0.5) / fitted.patch_px)
        inside = bad & ((place >= 0) & (place < fitted.valid.shape[::-1])).all(axis=-1)
        column, row = place[inside].astype(int).T
        judgeable = fitted.valid[row, column]
        assert judgeable.sum() > 1.5e5 * rate
        assert not found.valid[inside][judgeable].any()
        good = clean.valid & ~bad
        assert found.valid[good].mean() > 0.9999
        assert fitted.valid.sum() >= 0.99 * fit_projector_map(clean, SIZE).valid.sum()
        assert 0.9 < judged(fitted).chi2 < 1.15

    def test_an_error_is_judged_by_its_sigma(self, fitted: ProjectorMap) -> None:
        row, column = 200, 260
        for off, kept in ((MISFIT_PX + 4 * NOISE, True), (MISFIT_PX + 8 * NOISE, False)):
            clean = seen(0.0)
            sigma = np.where(clean.valid[..., None], NOISE, np.nan).astype(np.float32) * np.ones(2)
            xy = clean.projector_xy.copy()
            xy[row, column, 1] += off
            dirty = CorrespondenceMap(xy, sigma.astype(np.float32), clean.valid)
            assert drop_inconsistent(dirty, fitted).valid[row, column] == kept

    def test_pixels_of_patches_without_a_fit_are_kept(self, fitted: ProjectorMap) -> None:
        invalid = ProjectorMap(
            fitted.patch_px,
            np.full_like(fitted.camera_px, np.nan),
            np.full_like(fitted.sigma_px, np.nan),
            np.full_like(fitted.slope, np.nan),
            0 * fitted.coverage,
            0 * fitted.count,
            np.zeros_like(fitted.valid),
        )
        np.testing.assert_array_equal(drop_inconsistent(seen(), invalid).valid, seen().valid)
