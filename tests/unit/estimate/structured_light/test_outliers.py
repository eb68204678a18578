"""Outliers are dropped, and nothing is filled in."""

import numpy as np
import pytest

from procam.estimate.structured_light.outliers import SIGMAS, STEP_PX, drop_outliers
from procam.model.correspondence import CorrespondenceMap

SHAPE = (40, 60)


@pytest.fixture
def smooth(rng: np.random.Generator) -> CorrespondenceMap:
    """A tilted, gently curved view with a hole and a ragged border."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    xy = np.stack([20 + 0.8 * x + 0.1 * y + 1e-3 * x * y, 30 + 0.9 * y - 2e-3 * x**2], -1)
    xy += rng.normal(0, 0.05, xy.shape)
    valid = np.hypot((x - 30) / 28, (y - 20) / 18) < 1
    valid[15:19, 22:27] = False
    xy[~valid] = np.nan
    sigma = np.where(valid[..., None], 0.05, np.nan) * np.ones(2)
    return CorrespondenceMap(xy.astype(np.float32), sigma.astype(np.float32), valid)


def changed(found: CorrespondenceMap, at: tuple[int, int], by: float, axis: int) -> None:
    found.projector_xy[*at, axis] += by


class TestDropOutliers:
    def test_a_smooth_map_stays_as_it_is(self, smooth: CorrespondenceMap) -> None:
        found = drop_outliers(smooth)
        np.testing.assert_array_equal(found.valid, smooth.valid)
        np.testing.assert_array_equal(found.projector_xy, smooth.projector_xy)
        np.testing.assert_array_equal(found.sigma_px, smooth.sigma_px)

    @pytest.mark.parametrize("axis", [0, 1])
    @pytest.mark.parametrize("by", [-18.3, 3.0])
    def test_a_pixel_on_another_fringe_goes(
        self, smooth: CorrespondenceMap, axis: int, by: float
    ) -> None:
        at = [(20, 30), (8, 40), (33, 20), (19, 24)]
        for place in at:
            changed(smooth, place, by, axis)
        found = drop_outliers(smooth)
        gone = smooth.valid & ~found.valid
        assert sorted(map(tuple, np.argwhere(gone).tolist())) == sorted(at)
        assert np.isnan(found.projector_xy[gone]).all() and np.isnan(found.sigma_px[gone]).all()

    def test_a_small_group_goes_too(self, smooth: CorrespondenceMap) -> None:
        smooth.projector_xy[10:13, 30:33, 0] += 18.0
        found = drop_outliers(smooth)
        assert not found.valid[10:13, 30:33].any()
        assert (smooth.valid & ~found.valid).sum() == 9

    def test_an_error_within_its_sigma_stays(self, smooth: CorrespondenceMap) -> None:
        far = STEP_PX + (SIGMAS - 1) * 2.0
        changed(smooth, (20, 30), far, 0)
        assert not drop_outliers(smooth).valid[20, 30]
        smooth.sigma_px[20, 30] = 2.0
        assert drop_outliers(smooth).valid[20, 30]

    def test_nothing_at_all(self) -> None:
        nothing = np.full((9, 9, 2), np.nan, np.float32)
        found = drop_outliers(CorrespondenceMap(nothing, nothing, np.zeros((9, 9), bool)))
        assert not found.valid.any()

    def test_an_isolated_pixel_is_kept(self) -> None:
        xy = np.full((11, 11, 2), np.nan, np.float32)
        xy[5, 5] = 100
        valid = np.isfinite(xy[..., 0])
        found = drop_outliers(CorrespondenceMap(xy, 0 * xy + 0.1, valid))
        np.testing.assert_array_equal(found.valid, valid)
