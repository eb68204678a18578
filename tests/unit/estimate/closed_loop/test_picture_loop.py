"""The closed loop on a dome master against a known plant."""

from dataclasses import replace

import numpy as np
import pytest
from small_loop import LOOP_SIZE, SIZE, observed
from tolerances import FLOAT32

from procam.errors import NotEnoughData
from procam.estimate.closed_loop.patches import LoopObservation
from procam.estimate.closed_loop.picture_loop import (
    LoopCells,
    PictureLoop,
    cell_arcmin,
    low_pass_cells,
    nodes_for_means,
    noise_by_level,
)
from procam.maths.geometry.sphere import master_directions, master_pixels
from procam.maths.warp import block_mean, sample
from procam.model.calibration import Calibration
from procam.model.mask import Mask

Image = np.ndarray


def _sigma() -> np.ndarray:
    return np.full((LOOP_SIZE, LOOP_SIZE, 3), 1e-4)


class TestCells:
    def test_averages_keep_levels_and_slopes(self, cells: LoopCells) -> None:
        picture = np.clip(master_directions(2 * LOOP_SIZE)[0], -1, 1)
        means = cells.average(picture)
        direction, _ = master_directions(LOOP_SIZE)
        full = cells.count >= 4
        np.testing.assert_allclose(means[full], direction[full], atol=1.5 * np.pi / LOOP_SIZE / 2)

    def test_a_picture_and_its_photograph_have_the_same_means(self, cells: LoopCells) -> None:
        direction, _ = master_directions(300)
        master = np.abs(direction).astype(np.float32)
        where = master_pixels(master_directions(2 * LOOP_SIZE)[0], 300)
        photograph = sample(master, where)
        np.testing.assert_allclose(
            cells.average_of(master), cells.average(photograph), atol=FLOAT32
        )


class TestLoop:
    def test_cells_at_a_limit_are_not_free(self, loop: PictureLoop) -> None:
        elevation = np.arcsin(np.clip(loop.direction[..., 2], -1, 1))
        assert loop.free[elevation > np.radians(26)].all()
        assert not loop.free[elevation < np.radians(14)].any()
        assert loop.known[(elevation > np.radians(15)) & (elevation < np.radians(17))].all()

    def test_the_predicted_photograph_changes_nothing(
        self, loop: PictureLoop, direct: Image
    ) -> None:
        loop.update(loop.goal, _sigma(), 4)
        assert np.abs(loop.correction[loop.free]).max() < 2e-4
        np.testing.assert_array_equal(loop.state.scatter_factor, 1)

    def test_one_step_is_enough_for_a_known_plant(
        self, loop: PictureLoop, cells: LoopCells, calibration: Calibration, direct: Image
    ) -> None:
        """Preconditioned by the dome's own scatter, the loop is dead-beat."""
        ripple = 0.02 * np.sin(8 * master_directions(SIZE)[0]).astype(np.float32)
        dimmed = direct * (1 + ripple)
        loop.update(cells.average_of(observed(calibration, dimmed)), _sigma(), 4)
        after = observed(calibration, loop.picture * (1 + ripple))
        before = loop.residual(cells.average_of(observed(calibration, dimmed)))
        left = loop.residual(cells.average_of(after))
        inner = loop.free & (loop.direction[..., 2:] > np.sin(np.radians(30)))  # clear of the edge
        assert np.abs(left[inner]).mean() < 0.03 * np.abs(before[inner]).mean()

    def test_corrected_light_stays_within_the_limits(
        self, loop: PictureLoop, calibration: Calibration
    ) -> None:
        for _ in range(4):
            loop.update(0.3 * loop.goal, _sigma(), 4)
        direction, inside = master_directions(SIZE)
        where = master_pixels(direction, calibration.maps.size)
        hi = sample(calibration.maps.hi, where)
        whole = inside & (direction[..., 2] > np.sin(np.radians(15)))
        assert (loop.picture[whole] <= hi[whole] + FLOAT32).all()
        assert (hi - loop.picture)[whole].min() < FLOAT32

    def test_no_more_than_twice_what_was_measured_is_asked_of_a_faint_border(
        self, calibration: Calibration, cells: LoopCells, direct: Image
    ) -> None:
        """Coverage 0.1 with a limit of 0.3: the two are not of one measurement, and 0.3 / 0.1 is no limit."""
        elevation = np.arcsin(np.clip(master_directions(96)[0][..., 2], -1, 1))
        faint = elevation < np.radians(45)
        maps = replace(
            calibration.maps,
            coverage=np.where(faint, 0.1 * calibration.maps.coverage, calibration.maps.coverage),
            hi=np.where(faint[..., None], np.float32(0.3), calibration.maps.hi),
        )
        above = np.arcsin(np.clip(master_directions(SIZE)[0][..., 2], -1, 1))
        asked = np.where((above < np.radians(45))[..., None], 2 * direct, direct)
        loop = PictureLoop(replace(calibration, maps=maps), cells, asked, asked)
        rim = (above > np.radians(25)) & (above < np.radians(40))
        np.testing.assert_allclose(loop.picture[rim], 0.6, rtol=1e-5)

    def test_protected_parts_do_not_change(
        self, calibration: Calibration, cells: LoopCells, direct: Image
    ) -> None:
        """Not at the border either, where the correction of cells outside would extend inwards."""
        covered = np.zeros((96, 96), bool)
        covered[30:50, 30:50] = True
        maps = replace(calibration.maps, protected=Mask("screen", covered))
        loop = PictureLoop(replace(calibration, maps=maps), cells, direct, direct)
        loop.update(loop.goal - 0.1, _sigma(), 4)
        there = maps.is_protected(master_pixels(master_directions(SIZE)[0], 96))
        np.testing.assert_array_equal(loop.picture[there], direct[there])
        assert not loop.known[40 * LOOP_SIZE // 96, 40 * LOOP_SIZE // 96].any()

    def test_a_picture_that_limits_hold_everywhere_is_refused(
        self, calibration: Calibration, cells: LoopCells
    ) -> None:
        black = np.zeros((SIZE, SIZE, 3), np.float32)
        with pytest.raises(
            NotEnoughData, match=r"limits of the projectors hold everywhere .* mid-tones"
        ):
            PictureLoop(calibration, cells, black, black)


class TestNodes:
    def test_their_interpolation_has_the_means(self, rng: np.random.Generator) -> None:
        """Over random cells; 64 samples of each."""
        means = rng.uniform(0.2, 0.8, (24, 24, 3))
        fine = (np.arange(24 * 8) + 0.5) / 8 - 0.5
        drawn = sample(nodes_for_means(means), np.stack(np.meshgrid(fine, fine), -1))
        inner = slice(4, -4)  # beyond the border there is nothing
        got = block_mean(drawn, 8)[inner, inner]
        assert np.abs(got - means[inner, inner]).max() < 0.02
        plain = block_mean(sample(means, np.stack(np.meshgrid(fine, fine), -1)), 8)
        assert np.abs(plain[inner, inner] - means[inner, inner]).max() > 0.1


class TestLearn:
    @pytest.mark.parametrize("photographs", [1, 4, 16])
    def test_the_mean_of_n_photographs_is_uncertain_by_sigma_over_root_n(
        self, loop: PictureLoop, monkeypatch: pytest.MonkeyPatch, photographs: int
    ) -> None:
        learnt: list[LoopObservation] = []
        monkeypatch.setattr(loop.state, "learn", learnt.append)
        loop.learn(loop.goal, _sigma(), photographs)
        even = loop.direction[loop._inside][:, 2] > np.sin(np.radians(45))  # no stray light there
        np.testing.assert_allclose(learnt[0].sigma[even], 1e-4 / np.sqrt(photographs), rtol=1e-3)
        assert learnt[0].photographs == photographs

    def test_stray_light_of_a_bright_neighbour_is_part_of_the_uncertainty(
        self, loop: PictureLoop, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """A twentieth of the step from 0.5 to black, up to three cells from it; noise is far smaller."""
        learnt: list[LoopObservation] = []
        monkeypatch.setattr(loop.state, "learn", learnt.append)
        loop.learn(loop.goal, _sigma(), 4)
        elevation = np.degrees(np.arcsin(loop.direction[loop._inside][:, 2]))
        beside = np.abs(elevation - 20) < 180 / LOOP_SIZE
        np.testing.assert_allclose(learnt[0].sigma[beside], 0.025, rtol=0.02)


class TestLowPass:
    def test_is_zero_while_registration_is_finer_than_the_cells(
        self, calibration: Calibration
    ) -> None:
        assert low_pass_cells(_registered(calibration, 0.2)) == 0
        assert (
            low_pass_cells(
                _registered(calibration, cell_arcmin(calibration.screen) / np.sqrt(12) / 2)
            )
            == 0
        )

    def test_is_twice_the_registration_error_together_with_the_cells(
        self, calibration: Calibration
    ) -> None:
        sigma = low_pass_cells(_registered(calibration, cell_arcmin(calibration.screen)))
        assert np.hypot(sigma, 1 / np.sqrt(12)) == pytest.approx(2, rel=1e-6)

    def test_removes_fine_structure_from_the_correction(
        self, calibration: Calibration, cells: LoopCells, direct: Image
    ) -> None:
        rows = np.indices((LOOP_SIZE, LOOP_SIZE))[0][..., None]
        stripes = np.where(rows % 2, 0.01, -0.01) * np.ones(3)
        sizes = []
        for arcmin in (0.2, cell_arcmin(calibration.screen)):
            loop = PictureLoop(_registered(calibration, arcmin), cells, direct, direct)
            loop.learn(loop.goal + stripes, _sigma(), 4)
            fine = np.diff(loop._whole(loop.state.surplus), axis=0)
            sizes.append(float(np.abs(fine[loop.free[1:] & loop.free[:-1]]).mean()))
        assert sizes[1] < 0.05 * sizes[0]


class TestNoise:
    def test_by_level_and_by_the_pixels_of_a_cell(self, rng: np.random.Generator) -> None:
        count = np.ones((64, 64))
        count[:32] = 4
        level = np.linspace(0.1, 1, 64)[None, :, None] * np.ones((64, 64, 3))
        true = 0.01 * np.sqrt(level / count[..., None])
        seen = [level + true * rng.normal(size=level.shape) for _ in range(4)]
        found = noise_by_level(seen, count)
        inner = (slice(None), slice(4, -4))
        np.testing.assert_allclose(found[inner], true[inner], rtol=0.15)


def _registered(calibration: Calibration, arcmin: float) -> Calibration:
    """The calibration with that standard error of its pixel directions."""
    projectors = {
        name: replace(
            p, surface=replace(p.surface, sigma_arcmin=np.full_like(p.surface.sigma_arcmin, arcmin))
        )
        for name, p in calibration.projectors.items()
    }
    return replace(calibration, projectors=projectors)
