"""Pixel directions, solid angles and footprint of a projector, and the camera's view of them."""

from dataclasses import replace

import numpy as np
import pytest
from tolerances import FLOAT32

from procam.compensate.projector_frames import projector_frames
from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.geometry.model import Observations, ParameterLayout, RigGeometry
from procam.estimate.geometry.pixel_directions import model_directions
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.light.footprint import lit_share, project_surface
from procam.estimate.light.separation import SeparatedLight
from procam.maths.geometry.lenses import Lens, project, unproject
from procam.maths.geometry.local_shift import REACH
from procam.maths.geometry.pose import Pose
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.maths.geometry.sphere import master_directions
from procam.model.calibration import Calibration
from procam.model.correspondence import ProjectorSurface
from procam.model.mask import Nudge
from procam.model.optics import CameraModel, Sensor
from simulators.solid_angles import grid_solid_angles

Surfaces = tuple[ProjectorSurface, ProjectorSurface]


def _camera(size: int = 300) -> CameraModel:
    lens = Lens(
        "kannala-brandt", np.full(2, size / 2 / 1.72), np.full(2, (size - 1) / 2 + 0.7), np.zeros(4)
    )
    return CameraModel(
        "c",
        (size, size),
        lens,
        Sensor(12, 64.0),
        Pose.from_vectors((0.03, 0.02, 0.5), (0.2, 0.3, -0.5)),
    )


def _view(calibration: Calibration, camera: CameraModel) -> ScreenView:
    width, height = camera.size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(float)
    seen = np.hypot(*np.moveaxis(pixels - camera.lens.centre, -1, 0)) <= width / 2
    return ScreenView.of(camera, calibration.screen, unproject(pixels, camera.lens), seen)


def _solution(
    calibration: Calibration, camera: CameraModel, sigma_px: float = 0.02
) -> GeometrySolution:
    """A rig known exactly, and noisy observations of the projector south."""
    model = calibration.projectors["south"].model
    rig = RigGeometry(RoundShape(calibration.screen.radius_m), {"c": camera}, {"south": model})
    width, height = model.size
    x, y = np.arange(0.5, width - 1, 2), np.arange(0.5, height - 1, 2)
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    off = centres + np.random.default_rng(1).normal(0, sigma_px, centres.shape)
    assert camera.camera_from_dome is not None
    points = calibration.screen.radius_m * model_directions(rig, model, off)
    seen = project(camera.camera_from_dome.apply(points), camera.lens)
    pair = ("c", "south")
    seen = Observations(seen, centres, np.full(len(centres), max(sigma_px, 1e-3)))
    layout = ParameterLayout.of(rig)
    covariance = np.zeros((layout.count, layout.count))
    for block, size in ((layout.cameras["c"], 1e-6), (layout.projectors["south"], 1e-3)):
        start = block.start
        covariance[range(start, start + 6), range(start, start + 6)] = size**2
    return GeometrySolution(
        rig, covariance, {pair: seen}, {}, {pair: 1.0}, np.zeros((0, layout.count)), 1.0, "c"
    )


class TestView:
    def test_camera_pixels_undo_the_view(self, calibration: Calibration) -> None:
        camera = _camera()
        view = _view(calibration, camera)
        back = view.camera_pixels(calibration.screen, view.direction)
        grid = np.stack(np.meshgrid(np.arange(300), np.arange(300)), axis=-1)
        # directions are kept in float32
        np.testing.assert_allclose(back[view.on_screen], grid[view.on_screen], atol=1e-4)


def test_lit_share_is_light_seen_over_light_expected(calibration: Calibration) -> None:
    camera = _camera()
    shape = (300, 300, 3)
    direct = np.ones(shape, np.float32)
    direct[:, :145], direct[:, 145:155] = 0.0, 0.25
    lit = np.broadcast_to(np.arange(300) >= 155, shape[:2])
    light = SeparatedLight(direct, 0 * direct, np.ones(3), lit)
    direction, inside = master_directions(150)
    seen = _view(calibration, camera).camera_pixels(calibration.screen, direction)
    share, column = lit_share(light, seen), seen[..., 0]
    assert (share[inside & (column > 156)] == 1).all()
    assert (share[inside & (column < 144)] == 0).all()
    near = inside & (np.abs(column - 149.5) < 4)
    assert near.any()
    np.testing.assert_allclose(share[near], 0.25, rtol=FLOAT32)


class TestProjectSurface:
    @pytest.fixture(scope="class")
    @classmethod
    def solution(cls, calibration: Calibration) -> GeometrySolution:
        return _solution(calibration, _camera(), 1e-4)

    @staticmethod
    def _light(camera: CameraModel, calibration: Calibration) -> SeparatedLight:
        """White everywhere but below 10 degrees, where blackout plates are."""
        view = _view(calibration, camera)
        lit = view.on_screen & (view.direction[..., 2] > np.sin(np.radians(10.0)))
        direct = np.repeat(lit[..., None], 3, axis=2).astype(np.float32)
        return SeparatedLight(direct, 0 * direct, np.ones(3), lit)

    def test_is_the_known_surface(
        self, solution: GeometrySolution, calibration: Calibration
    ) -> None:
        truth = calibration.projectors["south"].surface
        light, view = self._light(solution.camera, calibration), _view(calibration, solution.camera)
        found = project_surface(solution, "south", calibration.screen, view, light)
        np.testing.assert_allclose(found.direction, truth.direction, atol=1e-4)
        np.testing.assert_allclose(found.solid_angle_sr, truth.solid_angle_sr, rtol=1e-3)
        elevation = np.degrees(np.arcsin(truth.direction[..., 2]))
        clear = np.abs(elevation - 10) > 1.0  # the camera's pixels are 0.6 degrees wide
        np.testing.assert_array_equal(found.valid[clear], truth.valid[clear])
        np.testing.assert_array_equal(found.measured[clear] > 0.5, truth.valid[clear])

    def test_a_camera_that_turned_widens_standard_errors(
        self, solution: GeometrySolution, calibration: Calibration
    ) -> None:
        light, view = self._light(solution.camera, calibration), _view(calibration, solution.camera)
        still, turned = (
            project_surface(solution, "south", calibration.screen, view, light, moved_arcmin=moved)
            for moved in (0.0, 4.0)
        )
        known = np.isfinite(still.sigma_arcmin)
        np.testing.assert_allclose(
            turned.sigma_arcmin[known], np.hypot(still.sigma_arcmin[known], 4.0), rtol=1e-5
        )

    def test_pixels_that_mostly_miss_the_screen_are_not_part_of_it(
        self, solution: GeometrySolution, calibration: Calibration
    ) -> None:
        """A plate that lets a third of the light through ends the picture."""
        light = self._light(solution.camera, calibration)
        view = _view(calibration, solution.camera)
        behind = view.direction[..., 2] < np.sin(np.radians(30.0))
        direct = np.where(behind[..., None], 0.3, 1) * light.direct
        dimmed = replace(light, direct=direct, lit=light.lit & ~behind)
        found = project_surface(solution, "south", calibration.screen, view, dimmed)
        elevation = np.degrees(np.arcsin(found.direction[..., 2]))
        third = (elevation > 25) & (elevation < 28)  # the light is continued so far
        assert third.any() and not found.valid[third].any()
        np.testing.assert_allclose(found.measured[third], 0.3, rtol=1e-4)
        assert found.valid[elevation > 32].all()


class TestNudges:
    """The picture of the projector south, manually moved 2 px to the right and 1 px up."""

    PIXEL, SHIFT = (22, 14), (2, -1)
    NUDGE = Nudge("south", PIXEL, SHIFT)

    @pytest.fixture(scope="class")
    @classmethod
    def surfaces(cls, calibration: Calibration) -> Surfaces:
        """As measured, and nudged."""
        solution = _solution(calibration, _camera(), 1e-4)
        light = TestProjectSurface._light(solution.camera, calibration)
        view = _view(calibration, solution.camera)
        other = Nudge("north", (10, 10), (1, 1))
        plain, nudged = (
            project_surface(solution, "south", calibration.screen, view, light, nudges)
            for nudges in ([other], [cls.NUDGE, other])
        )
        return plain, nudged

    def test_the_shifted_pixel_has_the_direction_of_the_original_one(
        self, surfaces: Surfaces
    ) -> None:
        plain, nudged = surfaces
        (x, y), (right, down) = self.PIXEL, self.SHIFT
        np.testing.assert_allclose(
            nudged.direction[y + down, x + right], plain.direction[y, x], atol=1e-6
        )

    def test_far_away_nothing_changes(self, surfaces: Surfaces) -> None:
        plain, nudged = surfaces
        x, y = np.meshgrid(np.arange(48), np.arange(30))
        far = np.hypot(x - 24, y - 13) > REACH * 48 + 1  # a pixel's corners move too
        np.testing.assert_array_equal(nudged.direction[far], plain.direction[far])
        np.testing.assert_array_equal(nudged.solid_angle_sr[far], plain.solid_angle_sr[far])
        assert (nudged.direction != plain.direction).any(axis=-1)[~far].mean() > 0.7

    def test_solid_angles_are_those_of_the_nudged_directions(self, surfaces: Surfaces) -> None:
        plain, nudged = surfaces
        total = plain.solid_angle_sr.sum()
        assert nudged.solid_angle_sr.sum() == pytest.approx(total, rel=1e-5)
        # of cells between the pixels' centres: means of four pixels, up to their curvature
        between = grid_solid_angles(nudged.direction.astype(float))
        own = nudged.solid_angle_sr
        mean = (own[1:, 1:] + own[1:, :-1] + own[:-1, 1:] + own[:-1, :-1]) / 4
        np.testing.assert_allclose(between, mean, rtol=0.03)
        changed = nudged.solid_angle_sr / plain.solid_angle_sr
        assert changed.max() > 1.3 and changed.min() < 0.7

    def test_a_spot_moves_on_the_panel_by_the_nudge(
        self, calibration: Calibration, surfaces: Surfaces
    ) -> None:
        plain, nudged = surfaces
        direction, _ = master_directions(512)
        apart = direction @ plain.direction[self.PIXEL[1], self.PIXEL[0]].astype(float)
        spot = np.exp((apart - 1) / np.radians(1.5) ** 2)  # a pixel is some 2 degrees wide
        content = np.repeat(spot[..., None], 3, axis=-1).astype(np.float32)
        south = calibration.projectors["south"]
        places = []
        for surface in (plain, nudged):
            shown = replace(calibration, projectors={"south": replace(south, surface=surface)})
            frame = projector_frames(content, shown)["south"].sum(axis=-1)
            light = np.where(frame > 0.3 * frame.max(), frame, 0)
            places.append(
                [light.sum(0) @ np.arange(48), light.sum(1) @ np.arange(30)] / light.sum()
            )
        np.testing.assert_allclose(places[0], self.PIXEL, atol=0.1)
        np.testing.assert_allclose(places[1] - places[0], self.SHIFT, atol=0.15)
