"""The closed loop's arithmetic against a plant of which everything is known."""

from dataclasses import replace

import numpy as np
import pytest
from tolerances import FLOAT32

from procam.estimate.feedback import LOOP_SIZE, Cells, Loop
from procam.maths.radiosity import add_interreflection
from procam.maths.sphere import master_directions, master_pixels, master_solid_angles
from procam.maths.warp import sample
from procam.model.calibration import Calibration
from procam.model.mask import Mask


@pytest.fixture(scope="module")
def cells() -> Cells:
    """A camera whose pixels are a dome master twice as fine as the loop's cells."""
    direction, inside = master_directions(2 * LOOP_SIZE)
    return Cells.of(direction.astype(np.float32), inside & (direction[..., 2] > 0.02))


@pytest.fixture
def loop(calibration: Calibration, cells: Cells) -> Loop:
    direction, _ = master_directions(calibration.maps.size)
    free = (direction[..., 2] > np.sin(np.radians(20.0)))[..., None].repeat(3, axis=-1)
    return Loop(calibration, cells, free)


class TestCells:
    def test_every_pixel_is_in_one_cell(self, cells: Cells) -> None:
        assert cells.count.sum() == cells.use.sum() == len(cells.index)
        assert cells.count.max() <= 9

    def test_averages_keep_levels_and_slants(self, cells: Cells) -> None:
        picture = np.clip(cells.direction, -1, 1)
        means = cells.average(picture)
        direction, _ = master_directions(LOOP_SIZE)
        full = cells.count >= 4
        np.testing.assert_allclose(means[full], direction[full], atol=1.5 * np.pi / LOOP_SIZE / 2)

    def test_a_master_is_read_where_the_camera_looks(self, cells: Cells) -> None:
        """Same sampling: a picture and the photograph of it have the same cell means."""
        direction, _ = master_directions(300)
        master = np.abs(direction).astype(np.float32)
        where = master_pixels(cells.direction, 300)
        photograph = sample(master, where)
        np.testing.assert_allclose(
            cells.average_master(master), cells.average(photograph), atol=FLOAT32
        )


class TestLoop:
    def test_free_cells_alone_are_corrected(self, loop: Loop) -> None:
        loop.update(np.ones((LOOP_SIZE, LOOP_SIZE, 3)), 1)
        assert 0.3 < loop.free.mean() < 0.8
        assert not loop.correction[~loop.free].any()

    def test_residual_rms_is_over_free_cells(self, loop: Loop) -> None:
        residual = np.full((LOOP_SIZE, LOOP_SIZE, 3), 0.25)
        residual[~loop.free] = 99.0
        assert loop.residual_rms(residual) == pytest.approx(0.25)

    def test_one_step_is_enough_for_a_known_plant(self, loop: Loop) -> None:
        """Preconditioned by the dome's own bounces, the loop is dead-beat (science.md s.6)."""
        residual = np.where(loop.free, 0.1, 0.0)
        loop.update(residual, 1)
        solid = master_solid_angles(LOOP_SIZE).ravel()
        direct = loop.correction.reshape(-1, 3)
        change = add_interreflection(direct, loop._scatter.reshape(-1, 3), solid)
        left = (residual.reshape(-1, 3) - change)[loop.free.reshape(-1, 3)]
        assert np.abs(left).max() < 1e-3 * 0.1

    def test_a_plain_update_would_not_be(self, loop: Loop) -> None:
        solid = master_solid_angles(LOOP_SIZE).ravel()
        direct = np.where(loop.free, 0.1, 0.0).reshape(-1, 3)
        change = add_interreflection(direct, loop._scatter.reshape(-1, 3), solid)
        assert np.abs(change - direct)[loop.free.reshape(-1, 3)].mean() > 0.1 * 0.1

    def test_every_photograph_weighs_the_same(self, loop: Loop) -> None:
        """The first step is whole; then each counts for its share of the photographs so far."""
        residual = np.where(loop.free, 0.01, 0.0)
        steps = []
        for photographs in (4, 2, 2, 2):
            before = loop.correction.copy()
            loop.update(residual, photographs)
            steps.append(float((loop.correction - before)[loop.free].mean()))
        np.testing.assert_allclose(np.array(steps) / steps[0], [1, 2 / 6, 2 / 8, 2 / 10])

    def test_corrected_adds_only_where_light_is_asked_for(self, loop: Loop) -> None:
        loop.update(np.where(loop.free, 0.1, 0.0), 1)
        direct = np.full((128, 128, 3), 0.5, np.float32)
        direct[60:70] = 0.0
        found = loop.corrected(direct)
        assert not found[60:70].any()
        assert found[40, 64].min() > 0.55 and found.min() >= 0

    def test_corrected_leaves_what_is_protected_alone(
        self, calibration: Calibration, cells: Cells
    ) -> None:
        """Up to its border, where the correction of cells outside would reach in."""
        covered = np.zeros((96, 96), bool)
        covered[30:50, 30:50] = True
        maps = replace(calibration.maps, protected=Mask("screen", covered))
        free = np.repeat(~covered[..., None], 3, axis=-1)
        loop = Loop(replace(calibration, maps=maps), cells, free)
        loop.update(np.where(loop.free, 0.1, 0.0), 1)
        direct = np.full((96, 96, 3), 0.5, np.float32)
        found = loop.corrected(direct)
        np.testing.assert_array_equal(found[covered], direct[covered])
        assert (found[26:28, 30:50] > 0.55).all()

    def test_gain_factor_is_light_got_per_light_asked(self, loop: Loop, cells: Cells) -> None:
        """A projector that gives 5 % too little needs 1/0.95 of what was asked."""
        direct = np.full((256, 256, 3), 0.5, np.float32)
        loop.correction = np.where(loop.free, 0.5 / 0.95 - 0.5, 0.0)
        factor = loop.gain_factor(direct, cells)
        inner = master_directions(LOOP_SIZE)[0][..., 2] > np.sin(np.radians(30.0))
        np.testing.assert_allclose(factor[inner], 0.95, rtol=1e-5)
        assert (factor[~loop.free] == 1.0).all()
