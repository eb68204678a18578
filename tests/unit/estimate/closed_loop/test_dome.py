"""The closed loop on a dome master against a known plant."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from tolerances import FLOAT32

from procam.errors import NotEnoughData
from procam.estimate.closed_loop import dome
from procam.estimate.closed_loop.dome import (
    CELL_ARCMIN,
    DomeLoop,
    LoopCells,
    low_pass_cells,
    noise_by_level,
    refined_calibration,
)
from procam.maths.geometry.sphere import master_directions, master_pixels, master_solid_angles
from procam.maths.warp import sample
from procam.model.calibration import Calibration
from procam.model.mask import Mask

Image = np.ndarray
LOOP_SIZE = 64  # a quarter of the real one: the same arithmetic, sixteen times as fast
SIZE = 128


@pytest.fixture(scope="module", autouse=True)
def few_cells() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dome, "LOOP_SIZE", LOOP_SIZE)
        yield


@pytest.fixture(scope="module")
def cells(few_cells: None) -> LoopCells:
    """A camera whose pixels are a dome master twice as fine as the loop's cells."""
    direction, inside = master_directions(2 * LOOP_SIZE)
    return LoopCells.of(direction.astype(np.float32), inside & (direction[..., 2] > 0.02))


@pytest.fixture
def direct(calibration: Calibration) -> Image:
    """Half of white above 20 degrees; the rest is at the black level."""
    direction, inside = master_directions(SIZE)
    lo = sample(calibration.maps.lo, master_pixels(direction, calibration.maps.size))
    high = (direction[..., 2] > np.sin(np.radians(20.0)))[..., None]
    return np.where(high, 0.5, lo).astype(np.float32) * inside[..., None]


@pytest.fixture
def loop(calibration: Calibration, cells: LoopCells, direct: Image) -> DomeLoop:
    return DomeLoop(calibration, cells, direct, _observed(calibration, direct))


def _observed(calibration: Calibration, direct: Image) -> Image:
    """Total light of direct light, by the calibration's scalar kernel."""
    direction, _ = master_directions(SIZE)
    where = master_pixels(direction, calibration.maps.size)
    lit = (sample(calibration.maps.coverage, where) * master_solid_angles(SIZE))[..., None]
    scatter = sample(calibration.maps.scatter_per_flux, where)
    return (direct + scatter * (lit * direct).sum(axis=(0, 1))).astype(np.float32)


def _sigma() -> np.ndarray:
    return np.full((LOOP_SIZE, LOOP_SIZE, 3), 1e-4)


class TestCells:
    def test_every_pixel_is_in_one_cell(self, cells: LoopCells) -> None:
        assert cells.count.sum() == cells.use.sum() == len(cells.index)
        assert cells.count.max() <= 9

    def test_averages_keep_levels_and_slopes(self, cells: LoopCells) -> None:
        picture = np.clip(cells.direction, -1, 1)
        means = cells.average(picture)
        direction, _ = master_directions(LOOP_SIZE)
        full = cells.count >= 4
        np.testing.assert_allclose(means[full], direction[full], atol=1.5 * np.pi / LOOP_SIZE / 2)

    def test_a_picture_and_its_photograph_have_the_same_means(self, cells: LoopCells) -> None:
        direction, _ = master_directions(300)
        master = np.abs(direction).astype(np.float32)
        where = master_pixels(cells.direction, 300)
        photograph = sample(master, where)
        np.testing.assert_allclose(
            cells.average_master(master), cells.average(photograph), atol=FLOAT32
        )


class TestLoop:
    def test_the_picture_at_the_start_is_the_compensated_one(
        self, loop: DomeLoop, direct: Image
    ) -> None:
        np.testing.assert_allclose(loop.picture, direct, atol=FLOAT32)

    def test_cells_at_a_limit_are_not_free(self, loop: DomeLoop) -> None:
        elevation = np.arcsin(np.clip(loop.direction[..., 2], -1, 1))
        assert loop.free[elevation > np.radians(26)].all()
        assert not loop.free[elevation < np.radians(14)].any()
        assert loop.known[(elevation > np.radians(15)) & (elevation < np.radians(17))].all()

    def test_residual_rms_is_over_free_cells(self, loop: DomeLoop) -> None:
        residual = np.full((LOOP_SIZE, LOOP_SIZE, 3), 0.25)
        residual[~loop.free] = 99.0
        assert loop.residual_rms(residual) == pytest.approx(0.25)

    def test_the_predicted_photograph_changes_nothing(self, loop: DomeLoop, direct: Image) -> None:
        loop.update(loop.goal, _sigma(), 4)
        assert np.abs(loop.correction[loop.free]).max() < 2e-4
        np.testing.assert_array_equal(loop.state.scatter_factor, 1)

    def test_one_step_is_enough_for_a_known_plant(
        self, loop: DomeLoop, cells: LoopCells, calibration: Calibration, direct: Image
    ) -> None:
        """Preconditioned by the dome's own scatter, the loop is dead-beat."""
        ripple = 0.02 * np.sin(8 * master_directions(SIZE)[0]).astype(np.float32)
        dimmed = direct * (1 + ripple)
        loop.update(cells.average_master(_observed(calibration, dimmed)), _sigma(), 4)
        after = _observed(calibration, loop.picture * (1 + ripple))
        before = loop.residual(cells.average_master(_observed(calibration, dimmed)))
        left = loop.residual(cells.average_master(after))
        inner = loop.free & (loop.direction[..., 2:] > np.sin(np.radians(30)))  # clear of the edge
        assert np.abs(left[inner]).mean() < 0.03 * np.abs(before[inner]).mean()

    def test_dark_cells_are_released_when_they_need_more_light(
        self, loop: DomeLoop, cells: LoopCells
    ) -> None:
        """Cells at lo that are darker than the goal are no longer held."""
        dark = loop.known & ~loop.free
        loop.goal = loop.goal + np.where(dark, 0.05, 0)
        loop.update(loop.goal - np.where(dark, 0.05, 0), _sigma(), 4)
        inner = dark & (loop.direction[..., 2:] < np.sin(np.radians(17)))
        assert (loop.correction[inner] > 0.01).mean() > 0.9
        assert (loop.picture >= 0).all()

    def test_corrected_light_stays_within_the_limits(
        self, loop: DomeLoop, calibration: Calibration
    ) -> None:
        for _ in range(4):
            loop.update(0.3 * loop.goal, _sigma(), 4)
        direction, inside = master_directions(SIZE)
        where = master_pixels(direction, calibration.maps.size)
        hi = sample(calibration.maps.hi, where)
        whole = inside & (direction[..., 2] > np.sin(np.radians(15)))
        assert (loop.picture[whole] <= hi[whole] + FLOAT32).all()
        assert (hi - loop.picture)[whole].min() < FLOAT32

    def test_protected_parts_do_not_change(
        self, calibration: Calibration, cells: LoopCells, direct: Image
    ) -> None:
        """Not at the border either, where the correction of cells outside would extend inwards."""
        covered = np.zeros((96, 96), bool)
        covered[30:50, 30:50] = True
        maps = replace(calibration.maps, protected=Mask("screen", covered))
        loop = DomeLoop(replace(calibration, maps=maps), cells, direct, direct)
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
            DomeLoop(calibration, cells, black, black)


class TestLowPass:
    def test_is_zero_while_registration_is_finer_than_the_cells(
        self, calibration: Calibration
    ) -> None:
        assert low_pass_cells(_registered(calibration, 0.2)) == 0
        assert low_pass_cells(_registered(calibration, CELL_ARCMIN / np.sqrt(12) / 2)) == 0

    def test_is_twice_the_registration_error_together_with_the_cells(
        self, calibration: Calibration
    ) -> None:
        sigma = low_pass_cells(_registered(calibration, CELL_ARCMIN))
        assert np.hypot(sigma, 1 / np.sqrt(12)) == pytest.approx(2, rel=1e-6)

    def test_removes_fine_structure_from_the_correction(
        self, calibration: Calibration, cells: LoopCells, direct: Image
    ) -> None:
        rows = np.indices((LOOP_SIZE, LOOP_SIZE))[0][..., None]
        stripes = np.where(rows % 2, 0.01, -0.01) * np.ones(3)
        sizes = []
        for arcmin in (0.2, CELL_ARCMIN):
            loop = DomeLoop(_registered(calibration, arcmin), cells, direct, direct)
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


class TestRefinedCalibration:
    @pytest.fixture
    def refined(self, loop: DomeLoop, calibration: Calibration) -> Calibration:
        """By a loop that found 5 % too little light everywhere and 10 % more scatter."""
        loop.state.surplus = -0.05 * loop._asked[loop._inside]
        loop.state.scatter_factor[:] = 1.1
        return refined_calibration(calibration, loop)

    def test_gains_are_light_got_per_light_asked(
        self, loop: DomeLoop, calibration: Calibration, refined: Calibration
    ) -> None:
        factor = loop.gain_factor()
        np.testing.assert_allclose(factor[loop.free], 0.95, rtol=1e-5)
        rim = loop.direction[..., 2] < np.sin(
            np.radians(-5)
        )  # far from all cells that the camera sees
        assert (factor[rim] == 1.0).all()
        for name, old in calibration.projectors.items():
            high = old.surface.direction[..., 2] > np.sin(np.radians(30))
            gain = refined.projectors[name].photometry.gain
            np.testing.assert_allclose(gain[high], 0.95 * old.photometry.gain[high], rtol=1e-4)

    def test_cells_that_no_pixel_sees_follow_their_neighbours(
        self, calibration: Calibration, direct: Image
    ) -> None:
        direction, inside = master_directions(2 * LOOP_SIZE)
        inside = inside & (direction[..., 2] > 0.02)
        inside[LOOP_SIZE : LOOP_SIZE + 2] = False  # a row of cells at the zenith
        few = LoopCells.of(direction.astype(np.float32), inside)
        loop = DomeLoop(calibration, few, direct, _observed(calibration, direct))
        loop.state.surplus = -0.05 * loop._asked[loop._inside]
        hole = (LOOP_SIZE // 2, slice(LOOP_SIZE // 2 - 5, LOOP_SIZE // 2 + 5))
        assert (few.count[hole] == 0).all()
        np.testing.assert_allclose(loop.gain_factor()[hole], 0.95, rtol=1e-5)

    def test_feedback_maps_and_albedo_follow(
        self, calibration: Calibration, refined: Calibration
    ) -> None:
        np.testing.assert_allclose(refined.feedback.value, 1.1 * calibration.feedback.value)
        np.testing.assert_allclose(
            refined.maps.scatter_per_flux, 1.1 * calibration.maps.scatter_per_flux, rtol=FLOAT32
        )
        centre = calibration.maps.size // 2
        hi, was = (c.maps.hi[centre, centre] for c in (refined, calibration))
        lo = calibration.maps.lo[centre, centre]
        np.testing.assert_allclose(hi - lo, 0.95 * (was - lo), rtol=1e-4)
        brighter = refined.albedo.value / calibration.albedo.value
        assert ((brighter > 1.03) & (brighter < 1.1)).all()


def _registered(calibration: Calibration, arcmin: float) -> Calibration:
    """The calibration with that standard error of its pixel directions."""
    projectors = {
        name: replace(
            p, surface=replace(p.surface, sigma_arcmin=np.full_like(p.surface.sigma_arcmin, arcmin))
        )
        for name, p in calibration.projectors.items()
    }
    return replace(calibration, projectors=projectors)
