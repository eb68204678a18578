"""Forecasts against closed forms, a dense solve, and docs/theory/interreflection.md (I18)."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from procam.compensate.compensator import Compensator
from procam.errors import InputError
from procam.maths.geometry.sphere import cap_solid_angle, master_directions, master_solid_angles
from procam.model.calibration import Calibration
from procam.model.mask import Mask
from procam.model.screen import Dome
from procam.workflows.forecast import (
    Band,
    PlannedDome,
    band,
    black_level,
    checkerboard_contrast,
    light_levels,
    measured,
    picture_figures,
    planned,
    sampled,
    white_luminance,
)
from procam.workflows.judged_picture import LUMINANCE

HEMISPHERE = Dome(8.0, np.pi / 2)
SIZE = 64
PATCHES = 2000
FLOAT32 = 2e-6  # maps and pictures are float32


def _plan(**changes: Any) -> PlannedDome:
    """A hemisphere of albedo 0.5, all of it lit, over a black floor."""
    usual = {"albedo_sigma": 0.0, "coverage": 1.0, "reflecting": 1.0, "contrast": 2000.0}
    return PlannedDome(**{"screen": HEMISPHERE, "albedo": 0.5} | usual | changes)


class DenseRoom:
    """Equal patches of a cap and its floor with every exchange of light between two of them.

    The form factors are written out one by one: a_j / 4 pi between patches of a sphere; what
    misses the cap meets the floor's disc; the way back by reciprocity.
    """

    def __init__(self, plan: PlannedDome) -> None:
        half_angle = plan.screen.half_angle
        share = cap_solid_angle(half_angle) / (4 * np.pi)
        self.area = np.full(PATCHES, 4 * np.pi * share / PATCHES)
        factors = np.zeros((PATCHES + 1, PATCHES + 1))
        factors[:-1, :-1] = self.area / (4 * np.pi)
        factors[:-1, -1] = 1 - share
        disc = np.pi * np.sin(half_angle) ** 2
        factors[-1, :-1] = self.area * (1 - share) / disc
        paint = np.zeros(PATCHES + 1)
        paint[: round(plan.reflecting * PATCHES)] = plan.albedo
        paint[-1] = plan.screen.floor_albedo
        everything = np.linalg.inv(np.eye(PATCHES + 1) - paint[:, None] * factors)
        self.lit = np.arange(PATCHES) < round(plan.coverage * PATCHES)
        only = np.flatnonzero(self.lit)
        self.bounces = everything[np.ix_(only, only)]  # total of lit patches from their direct

    def contrast(self, white: np.ndarray, black: float, compensated: bool) -> float:
        """Of a picture that asks for 1 where `white`, 0 elsewhere; black cannot go below `black`."""
        direct = np.where(white, 1.0, black)
        if compensated:
            among, from_black = (
                self.bounces[np.ix_(white, white)],
                self.bounces[np.ix_(white, ~white)],
            )
            direct[white] = np.linalg.solve(among, 1 - from_black @ direct[~white])
        total = self.bounces @ direct
        return float(total[white].mean() / total[~white].mean())


@pytest.fixture(scope="module")
def furnished() -> PlannedDome:
    """Not all of it lit, not all of it painted, and a floor that reflects."""
    screen = Dome(8.0, np.radians(80.0), floor_albedo=0.2)
    return _plan(screen=screen, albedo=0.55, coverage=0.6, reflecting=0.85)


@pytest.fixture(scope="module")
def dense(furnished: PlannedDome) -> DenseRoom:
    return DenseRoom(furnished)


class TestFeedback:
    def test_of_a_dense_solve_with_unlit_paint_and_a_floor(
        self, furnished: PlannedDome, dense: DenseRoom, rng: np.random.Generator
    ) -> None:
        direct = rng.uniform(0, 1, int(dense.lit.sum()))
        total = dense.bounces @ direct
        found = (total.sum() - direct.sum()) / direct.sum()
        assert furnished.feedback(furnished.albedo) == pytest.approx(found, rel=1e-9)


class TestCheckerboard:
    @pytest.mark.parametrize("albedo", [0.3, 0.5, 0.8])
    @pytest.mark.parametrize("white_share", [0.1, 0.5, 0.9])
    @pytest.mark.parametrize("compensated", [False, True])
    def test_is_what_science_says(
        self, albedo: float, white_share: float, compensated: bool
    ) -> None:
        kappa = albedo * 0.5  # all of a hemisphere reflects, and is lit
        expected = (1 - kappa * (1 - white_share)) / (kappa * white_share)
        m = _plan().feedback(albedo)
        found = checkerboard_contrast(m, 0.0, white_share, compensated)
        assert found == pytest.approx(expected, rel=1e-9)

    @pytest.mark.parametrize("ambient", [0.01, 0.05])
    def test_light_of_the_room_falls_on_both(self, ambient: float) -> None:
        """Without compensation white is 1 + m/2 + A and black m/2 + A."""
        m = _plan().feedback(0.5)
        plain = checkerboard_contrast(m, 0.0, ambient=ambient)
        assert plain == pytest.approx((1 + m / 2 + ambient) / (m / 2 + ambient), rel=1e-9)
        dimmed = (1 - ambient) / (1 + m / 2)  # direct light of white, for a total of 1
        restored = checkerboard_contrast(m, 0.0, compensated=True, ambient=ambient)
        assert restored == pytest.approx(1 / (dimmed * m / 2 + ambient), rel=1e-9)

    @pytest.mark.parametrize("compensated", [False, True])
    def test_with_a_black_level_as_a_dense_solve(
        self,
        furnished: PlannedDome,
        dense: DenseRoom,
        rng: np.random.Generator,
        compensated: bool,
    ) -> None:
        white = rng.permutation(np.arange(int(dense.lit.sum())) % 4 == 0)
        m = furnished.feedback(furnished.albedo)
        found = checkerboard_contrast(m, 0.01, 0.25, compensated)
        assert found == pytest.approx(dense.contrast(white, 0.01, compensated), rel=1e-9)

    def test_without_any_light_on_black_it_has_no_limit(self) -> None:
        assert checkerboard_contrast(0.0, 0.0) == float("inf")


class TestLevels:
    def test_of_a_hemisphere(self) -> None:
        prospect = planned(_plan(), SIZE)
        levels = light_levels(prospect.ends[1], 30.0)
        assert levels.scattered_share == pytest.approx(0.25)
        assert levels.white_before == pytest.approx(40.0)
        assert levels.white_after == 30.0
        assert levels.black == pytest.approx(40.0 / 2000, rel=FLOAT32)
        assert levels.on_off_before == pytest.approx(2000, rel=FLOAT32)
        assert levels.on_off_after == pytest.approx(1500, rel=FLOAT32)
        assert levels.checkerboard_scatter == pytest.approx(7.0)
        assert levels.checkerboard_after < levels.checkerboard_before < 7.0

    def test_white_is_reflected_light_over_pi_and_area(self) -> None:
        lit_sr = np.pi  # half of a hemisphere; on a radius of 4 m, 16 pi m2
        white = white_luminance(20000.0, 4.0, lit_sr, 0.6)
        assert white == pytest.approx(0.6 * 20000 / (np.pi * 16 * np.pi))

    def test_ends_are_those_of_the_albedo(self) -> None:
        plan = _plan(albedo_sigma=0.02)
        ends = planned(plan, SIZE).ends
        for end, albedo in zip(ends, (0.5 - 0.0392, 0.5, 0.5 + 0.0392), strict=True):
            np.testing.assert_allclose(end.albedo.value, albedo)
            np.testing.assert_allclose(end.feedback.value, plan.feedback(albedo))

    def test_maps_hold_the_feedback_on_the_lit_cap(self, furnished: PlannedDome) -> None:
        prospect = planned(furnished, 256)
        maps = prospect.ends[1].maps
        solid = master_solid_angles(256) * maps.coverage
        found = float((solid * maps.scatter_per_flux[..., 0]).sum())
        assert found == pytest.approx(furnished.feedback(0.55), rel=FLOAT32)
        assert prospect.lit_sr == pytest.approx(0.6 * 2 * np.pi * (1 - np.cos(np.radians(80))))
        elevation = np.arccos(master_directions(256)[0][..., 2])[maps.coverage > 0]
        rim = np.arccos(1 - 0.6 * (1 - np.cos(np.radians(80.0))))
        assert rim - np.pi / 256 < elevation.max() <= rim  # to a pixel

    def test_a_band_counts_from_the_least_to_the_largest(self) -> None:
        assert band([3.0, 2.0, 1.0]) == Band(2.0, 1.0, 3.0)


def _halves(dark: float, bright: float = 1.0) -> np.ndarray:
    """The left half of a dome master dark, the right half bright: equal solid angles."""
    picture = np.full((SIZE, SIZE, 3), dark, np.float32)
    picture[:, SIZE // 2 :] = bright
    return picture


class TestPictures:
    def test_a_grey_one_is_exact_and_has_no_contrast_to_restore(self) -> None:
        calibration = planned(_plan(), SIZE).ends[1]
        figures, seen = picture_figures(calibration, _halves(0.5, 0.5))
        assert figures.unclipped
        assert figures.clipped_black == figures.clipped_white == 0
        assert figures.dark_lift_before == pytest.approx(0.5 / 3, rel=FLOAT32)
        assert figures.dark_lift_after == pytest.approx(0, abs=FLOAT32)
        assert figures.darkest == pytest.approx(0.5 * 0.25 + 1 / 2000, rel=FLOAT32)
        assert np.isnan(figures.contrast_restored)
        assert set(np.unique(seen.limits)) == {0, 3}

    def test_black_beside_white_is_the_checkerboard(self) -> None:
        calibration = planned(_plan(), SIZE).ends[1]
        figures, seen = picture_figures(calibration, _halves(0.0))
        levels = light_levels(calibration)
        assert figures.clipped_black == pytest.approx(0.5)
        assert figures.dark_lift_after == pytest.approx(1 / levels.checkerboard_after, rel=FLOAT32)
        before = (1 + (1 + 1 / 2000) / 6) / levels.checkerboard_before
        assert figures.dark_lift_before == pytest.approx(before, rel=FLOAT32)
        assert figures.darkest == pytest.approx(figures.dark_lift_after, rel=FLOAT32)
        dark, bright = seen.limits[:, : SIZE // 2], seen.limits[:, SIZE // 2 :]
        assert (set(np.unique(dark)), set(np.unique(bright))) == ({1, 3}, {0, 3})

    def test_unclipped_from_where_science_says(self, furnished: PlannedDome) -> None:
        """min t/rho >= a_L.t / (A_s - a_U.rho_U) + black / rho, over a black floor."""
        plan = replace(furnished, screen=replace(furnished.screen, floor_albedo=0.0), contrast=500)
        calibration = planned(plan, SIZE).ends[1]
        rho, lit = plan.albedo, plan.lit_sr
        unlit = (plan.reflecting / plan.coverage - 1) * lit
        gain = rho * lit / (4 * np.pi - rho * unlit)
        least = (gain * 0.5 + 1 / 500) / (1 - gain * 0.5)  # t = gain (1 + t) / 2 + black
        for factor, expected in ((0.999, False), (1.001, True)):
            figures, _ = picture_figures(calibration, _halves(least * factor))
            assert figures.unclipped is expected
            assert figures.clipped_black == pytest.approx(0.0 if expected else 0.5)
        assert figures.darkest == pytest.approx(least, rel=1e-3)  # at a thousandth above it

    def test_too_bright_for_the_projectors(self) -> None:
        calibration = planned(_plan(), SIZE).ends[1]
        figures, seen = picture_figures(calibration, _halves(0.6, 3.0))
        assert figures.clipped_white == pytest.approx(0.5)
        assert (seen.limits[:, SIZE // 2 :] != 1).all()
        assert not figures.unclipped

    def test_rms_contrast_of_two_levels(self) -> None:
        calibration = planned(_plan(), SIZE).ends[1]
        figures, _ = picture_figures(calibration, _halves(0.4))
        assert figures.contrast_target == pytest.approx(0.3 / 0.7, rel=FLOAT32)
        assert figures.contrast_before == pytest.approx(0.3 / (0.7 * 4 / 3), rel=FLOAT32)
        assert figures.contrast_after == pytest.approx(figures.contrast_target, rel=FLOAT32)
        assert figures.contrast_restored == pytest.approx(1.0, rel=1e-5)

    def test_an_all_black_one_has_no_figures_but_light(self) -> None:
        calibration = planned(_plan(), SIZE).ends[1]
        figures, _ = picture_figures(calibration, _halves(0.0, 0.0))
        assert np.isnan(figures.contrast_target)
        assert figures.dark_lift_before == pytest.approx(4 / 3 / 2000, rel=FLOAT32)
        assert figures.clipped_black == pytest.approx(1.0)

    def test_any_colour_that_clips_counts(self) -> None:
        calibration = planned(_plan(), SIZE).ends[1]
        picture = _halves(0.6, 0.6)
        picture[: SIZE // 2, :, 2] = 0.0
        figures, seen = picture_figures(calibration, picture)
        assert figures.clipped_black == pytest.approx(0.5)
        assert (seen.limits[: SIZE // 2] != 0).all()

    def test_sampling_keeps_values(self, rng: np.random.Generator) -> None:
        picture = rng.uniform(0, 1, (9, 9, 3)).astype(np.float32)
        np.testing.assert_array_equal(sampled(picture, 3), picture[1::3, 1::3])
        np.testing.assert_array_equal(sampled(picture, 9), picture)
        np.testing.assert_array_equal(sampled(picture, 18), picture.repeat(2, 0).repeat(2, 1))


class TestMeasured:
    def test_ends_are_the_intervals(self, calibration: Calibration) -> None:
        prospect = measured(calibration)
        assert prospect.ends[1] is calibration
        for end, sign in ((prospect.ends[0], -1), (prospect.ends[2], 1)):
            for name in ("feedback", "albedo"):
                was = getattr(calibration, name)
                expected = was.value + sign * 1.96 * was.sigma
                np.testing.assert_allclose(getattr(end, name).value, expected)
            factor = end.feedback.value / calibration.feedback.value
            expected = calibration.maps.scatter_per_flux * factor
            np.testing.assert_allclose(end.maps.scatter_per_flux, expected, rtol=1e-6)
        cap = 2 * np.pi * (1 - np.sin(np.radians(10.0)))
        assert prospect.lit_sr == pytest.approx(cap, rel=0.01)  # a pixel of the maps' rim

    def test_levels_weigh_the_colours(self, calibration: Calibration) -> None:
        levels = light_levels(calibration)
        assert levels.feedback == pytest.approx(LUMINANCE @ [0.3, 0.33, 0.4])
        assert black_level(calibration) == pytest.approx(0.003, rel=1e-6)
        assert levels.on_off_before == pytest.approx(1 / 0.003, rel=1e-6)

    def test_pictures_go_through_the_compensator(
        self, calibration: Calibration, rng: np.random.Generator
    ) -> None:
        content = rng.uniform(0.0, 1.0, (SIZE, SIZE, 3)).astype(np.float32)
        figures, seen = picture_figures(calibration, content)
        compensator = Compensator(calibration, SIZE)
        result = compensator.predict(content)
        np.testing.assert_array_equal(seen.after, result.observed)
        lit = seen.limits < 3
        at_rim = compensator.lit & ~lit
        assert not (lit & ~compensator.lit).any()
        assert at_rim.sum() < 0.05 * lit.sum()
        clipped = ~result.free.all(axis=-1) & lit
        np.testing.assert_array_equal((seen.limits == 1) | (seen.limits == 2), clipped)
        weight = master_solid_angles(SIZE)
        share = weight[clipped].sum() / weight[lit].sum()
        assert figures.clipped_black == pytest.approx(share)
        assert figures.clipped_white == 0

    def test_what_a_person_protects_is_no_failure(self, calibration: Calibration) -> None:
        size = calibration.maps.size
        everywhere = Mask("screen", np.ones((size, size), bool))
        protected = replace(calibration, maps=replace(calibration.maps, protected=everywhere))
        black = np.zeros((SIZE, SIZE, 3), np.float32)
        assert not picture_figures(calibration, black)[0].unclipped
        assert picture_figures(protected, black)[0].unclipped


class TestRefusals:
    @pytest.mark.parametrize(
        ("changes", "words"),
        [
            ({"albedo": 0.0}, "albedo: 0 is not between 0 and 1"),
            ({"albedo": 1.0}, "albedo: 1 is not between 0 and 1"),
            ({"albedo": float("nan")}, "albedo: nan is not between 0 and 1"),
            ({"albedo_sigma": -0.1}, "albedo sigma: -0.1 must be 0 or more"),
            ({"albedo_sigma": 0.3}, "0.5 +- 1.96 sigma stays between 0 and 1"),
            ({"coverage": 0.0}, "coverage: 0 must be above 0 and at most 1"),
            ({"coverage": 1.2}, "coverage: 1.2 must be above 0 and at most 1"),
            ({"reflecting": 0.7}, "coverage: 1 must be above 0 and at most 0.7"),
            ({"reflecting": 1.1}, "reflecting: 1.1 is no share of the cap"),
            ({"contrast": 1.0}, "contrast: 1 must be above 1, such as 2000"),
            ({"screen": Dome(8.0, 2.0)}, "half angle: 114.592 degrees must be above 0"),
            (
                {"screen": Dome(8.0, 1.0, floor_albedo=1.5)},
                "floor albedo: 1.5 must be between 0 and 1",
            ),
        ],
    )
    def test_one_line_each(self, changes: dict[str, Any], words: str) -> None:
        with pytest.raises(InputError) as caught:
            _plan(**changes)
        assert words in str(caught.value)
        assert "\n" not in str(caught.value)
