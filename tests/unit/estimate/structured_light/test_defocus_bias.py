"""Bias of blurred waves under a slope of light and at borders, against numerical integrals."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from procam.estimate.structured_light.defocus_bias import NEAREST_SIGMAS, correct_defocus_bias
from procam.model.correspondence import CorrespondenceMap

SHAPE = (110, 150)
SIGMA, PERIOD = np.array([2.0, 1.5]), np.array([18.0, 20.0])
NOWHERE = -1e9


@dataclass(frozen=True)
class Light:
    """Light along one axis: 1 + `slope` (u - 60), from column `start` on."""

    slope: float = 0.0
    start: float = NOWHERE

    def blurred(
        self, place: np.ndarray, sigma: float, period: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Apparent position of a wave blurred by a Gaussian [px], and the light there."""
        around = np.linspace(-7 * sigma, 7 * sigma, 1401)
        weight = np.exp(-(around**2) / (2 * sigma**2))
        table = np.linspace(place.min(), place.max(), 1000)
        u = table[:, None] + around
        light = np.where(u >= self.start, 1 + self.slope * (u - 60), 0.0) * weight
        shift = np.angle(light @ np.exp(2j * np.pi * around / period)) * period / (2 * np.pi)
        level = light.sum(axis=1) / weight.sum()
        return place + np.interp(place, table, shift), np.interp(place, table, level)


PANEL = (400, 400)


@dataclass(frozen=True)
class View:
    """A camera that sees the panel through an affine map; light, blur and shift are separable."""

    across: Light
    down: Light
    turn: float = 0.0  # [rad]

    def __post_init__(self) -> None:
        y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] - np.array([55, 75])[:, None, None]
        c, s = 0.5 * np.cos(self.turn), 0.5 * np.sin(self.turn)
        object.__setattr__(self, "truth", np.stack([60 + c * x - s * y, 60 + s * x + c * y], -1))

    def seen(self) -> tuple[CorrespondenceMap, np.ndarray]:
        """The map as decoded, with the faint parts left out, and the direct light."""
        xy = np.empty_like(self.truth)
        direct = np.ones(SHAPE)
        for i, light in enumerate((self.across, self.down)):
            place, level = light.blurred(self.truth[..., i].ravel(), SIGMA[i], PERIOD[i])
            xy[..., i], direct = place.reshape(SHAPE), direct * level.reshape(SHAPE)
        valid = direct > 0.1 * direct.max()
        xy[~valid] = np.nan
        sigma = np.where(valid[..., None], 0.05, np.nan) * np.ones(2)
        found = CorrespondenceMap(xy.astype(np.float32), sigma.astype(np.float32), valid)
        return found, direct.astype(np.float32)

    def corrected(self) -> CorrespondenceMap:
        """The corrected map; where a light has a border, the panel begins there."""
        found, direct = self.seen()
        starts = np.array([self.across.start, self.down.start])
        first = np.where(starts > NOWHERE, starts + 0.5, 0.0).astype(np.float32)
        moved = CorrespondenceMap(found.projector_xy - first, found.sigma_px, found.valid)
        after = correct_defocus_bias(moved, direct, SIGMA**2, PERIOD, PANEL)
        return replace(after, projector_xy=after.projector_xy + first)

    def errors(self, found: CorrespondenceMap) -> np.ndarray:
        return (found.projector_xy - self.truth)[found.valid]


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_a_slope_of_light_goes_into_the_standard_error(turn: float) -> None:
    view = View(Light(0.015), Light(-0.012), turn)
    before = view.errors(view.seen()[0])
    # Tweedie: variance times gradient of the logarithm, at the middle 4 x 0.015 and -2.25 x 0.012
    assert before[:, 0].mean() == pytest.approx(0.06, abs=0.015)
    assert before[:, 1].mean() == pytest.approx(-0.027, abs=0.01)
    after = view.corrected()
    assert after.valid.all() and after.shared_px is not None
    # it may be the screen's slope, which causes no bias: half of it is in the shared error
    np.testing.assert_array_equal(after.projector_xy, view.seen()[0].projector_xy)
    assert after.shared_px[..., 0].mean() == pytest.approx(0.03, abs=0.01)
    assert after.shared_px[..., 1].mean() == pytest.approx(0.0135, abs=0.006)
    np.testing.assert_allclose(after.sigma_px, np.hypot(0.05, after.shared_px), rtol=1e-5)


@pytest.mark.parametrize("turn", [0.0, 1.2, -2.5])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_straight_border(axis: int, turn: float) -> None:
    lights = [Light(), Light()]
    lights[axis] = Light(start=55.3)
    view = View(*lights, turn)
    found, _ = view.seen()
    after = view.corrected()
    away = (view.truth[..., axis] - 55.3) / SIGMA[axis]
    # nearer than this none is left, farther all are; borders are known to a camera pixel, 0.3 sigma
    assert not after.valid[away < NEAREST_SIGMAS - 0.6].any()
    assert after.valid[away > NEAREST_SIGMAS].mean() > 0.99
    inner = np.zeros(SHAPE, bool)
    inner[14:-14, 14:-14] = True  # the border is unknown outside the photograph
    assert after.valid[inner & (away > NEAREST_SIGMAS)].mean() > 0.998
    before, left = (np.abs(m.projector_xy - view.truth) for m in (found, after))
    assert np.max(before[after.valid & inner][:, axis]) > 0.25  # there was a bias to correct
    assert np.max(left[after.valid & inner][:, axis]) < 0.13
    assert np.sqrt(np.mean(left[after.valid][:, axis] ** 2)) < 0.025
    # no bias along the border
    assert np.max(left[after.valid & inner][:, 1 - axis]) < 0.06


def test_the_edge_of_the_photograph_is_no_border() -> None:
    """Where the camera sees only part of a picture nothing is missing of its light."""
    view = View(Light(), Light())
    after = view.corrected()
    assert after.valid.all()
    assert np.abs(view.errors(after)).max() < 1e-3


def test_small_gaps_are_no_borders() -> None:
    view = View(Light(), Light())
    found, direct = view.seen()
    holes = np.zeros(SHAPE, bool)
    holes[40:43, 60:66], holes[80, 20:120] = True, True
    valid = found.valid & ~holes
    xy = np.where(valid[..., None], found.projector_xy, np.nan)
    after = correct_defocus_bias(
        CorrespondenceMap(xy, found.sigma_px, valid), direct, SIGMA**2, PERIOD, PANEL
    )
    np.testing.assert_array_equal(after.valid, valid)
    assert np.abs(view.errors(after)).max() < 1e-3


@pytest.mark.parametrize("blur_px2", [[0.0, 0.0], [0.0, 2.0]])
def test_without_blur_nothing_moves(blur_px2: list[float]) -> None:
    found, direct = View(Light(0.015), Light(), 0.3).seen()
    after = correct_defocus_bias(found, direct, np.array(blur_px2), PERIOD, PANEL)
    assert after is found


def test_too_few_pixels_are_left_alone() -> None:
    found, direct = View(Light(0.015), Light(), 0.3).seen()
    valid = np.zeros(SHAPE, bool)
    valid[50:60, 50:69] = True
    few = CorrespondenceMap(found.projector_xy, found.sigma_px, valid)
    assert correct_defocus_bias(few, direct, SIGMA**2, PERIOD, PANEL) is few
