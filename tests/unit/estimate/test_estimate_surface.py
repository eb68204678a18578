"""Where projector pixels land and what a camera sees: there and back."""

import numpy as np
import pytest
from tolerances import CLOSED_FORM, FLOAT32, SIGMAS, SOLVER

from procam.estimate.geometry import GeometrySolution, changed_projector
from procam.estimate.surface import camera_pixels, directions, lit_share, project_surface
from procam.estimate.transport import Light
from procam.estimate.view import DomeView
from procam.maths.lenses import project, unproject
from procam.maths.sphere import cap_solid_angle, master_directions
from procam.maths.warp import grow
from procam.model.calibration import Calibration
from procam.model.optics import CameraModel, Lens, Pose, Sensor


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


def _view(calibration: Calibration, camera: CameraModel) -> DomeView:
    width, height = camera.size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(float)
    seen = np.hypot(*np.moveaxis(pixels - camera.lens.centre, -1, 0)) <= width / 2
    return DomeView.of(camera, calibration.screen, unproject(pixels, camera.lens), seen)


def test_a_projector_sees_what_it_lights(calibration: Calibration) -> None:
    model = calibration.projectors["south"].model
    found = directions(model, calibration.screen, np.arange(48), np.arange(30))
    np.testing.assert_allclose(np.linalg.norm(found, axis=-1), 1, rtol=CLOSED_FORM)
    points = calibration.screen.radius_m * found
    back = project(model.projector_from_dome.apply(points), model.lens)
    grid = np.stack(np.meshgrid(np.arange(48), np.arange(30)), axis=-1)
    np.testing.assert_allclose(back, grid, atol=SOLVER)


class TestView:
    def test_camera_pixels_undo_the_view(self, calibration: Calibration) -> None:
        camera = _camera()
        view = _view(calibration, camera)
        back = camera_pixels(camera, calibration.screen, view.direction)
        grid = np.stack(np.meshgrid(np.arange(300), np.arange(300)), axis=-1)
        # directions are kept in float32
        np.testing.assert_allclose(back[view.on_screen], grid[view.on_screen], atol=1e-4)

    def test_solid_angles_add_up_to_the_cap(self, calibration: Calibration) -> None:
        view = _view(calibration, _camera(600))
        # pixels at the rim are in or out as a whole
        assert view.solid_angle_sr.sum() == pytest.approx(cap_solid_angle(np.pi / 2), rel=2e-3)
        assert not view.solid_angle_sr[~view.on_screen].any()

    def test_projector_pixels_land_where_the_camera_looks(self, calibration: Calibration) -> None:
        view = _view(calibration, _camera())
        model = calibration.projectors["north"].model
        xy = view.projector_pixels(model, calibration.screen)
        inside = np.isfinite(xy[..., 0])
        assert 0.1 < inside.mean() < 0.9
        assert xy[inside].min() > -0.5 and (xy[inside] < np.array(model.size) - 0.5).all()
        rays = unproject(xy[inside].astype(float), model.lens)
        points = model.projector_from_dome.apply(6.0 * view.direction[inside].astype(float))
        cosine = np.sum(rays * points, axis=-1) / np.linalg.norm(points, axis=-1)
        assert cosine.min() > 1 - 1e-10


def test_lit_share_is_light_seen_over_light_expected(calibration: Calibration) -> None:
    camera = _camera()
    shape = (300, 300, 3)
    extended = np.ones(shape, np.float32)
    direct = extended.copy()
    direct[:, :145], direct[:, 145:155] = 0.0, 0.25
    lit = np.zeros(shape[:2], bool)
    light = Light(direct, 0 * direct, extended, np.ones(3), direct, grow(lit, 1))
    direction, inside = master_directions(150)
    share = lit_share(camera, calibration.screen, direction, light)
    column = camera_pixels(camera, calibration.screen, direction)[..., 0]
    assert (share[inside & (column > 156)] == 1).all()
    assert (share[inside & (column < 144)] == 0).all()
    near = inside & (np.abs(column - 149.5) < 4)
    assert near.any()
    np.testing.assert_allclose(share[near], 0.25, rtol=FLOAT32)


class TestProjectSurface:
    @pytest.fixture(scope="class")
    @classmethod
    def solution(cls, calibration: Calibration) -> GeometrySolution:
        model = calibration.projectors["south"].model
        return GeometrySolution(_camera(), {"south": model}, np.eye(18), {}, {})

    @staticmethod
    def _light(camera: CameraModel, calibration: Calibration) -> Light:
        """White all over, but behind blackout plates below 10 degrees."""
        view = _view(calibration, camera)
        lit = view.on_screen & (view.direction[..., 2] > np.sin(np.radians(10.0)))
        extended = np.ones((*lit.shape, 3), np.float32)
        direct = extended * lit[..., None]
        return Light(direct, 0 * direct, extended, np.ones(3), direct, lit)

    def test_is_the_known_surface(
        self, solution: GeometrySolution, calibration: Calibration
    ) -> None:
        truth = calibration.projectors["south"].surface
        light = self._light(solution.camera, calibration)
        found = project_surface(solution, "south", calibration.screen, light)
        np.testing.assert_allclose(found.direction, truth.direction, atol=1e-6)
        np.testing.assert_allclose(found.solid_angle_sr, truth.solid_angle_sr, rtol=FLOAT32)
        elevation = np.degrees(np.arcsin(truth.direction[..., 2]))
        clear = np.abs(elevation - 10) > 1.0  # the camera's pixels are 0.6 degrees wide
        np.testing.assert_array_equal(found.valid[clear], truth.valid[clear])
        np.testing.assert_array_equal(found.measured[clear] > 0.5, truth.valid[clear])

    def test_sigma_is_the_spread_of_directions(
        self, solution: GeometrySolution, calibration: Calibration, rng: np.random.Generator
    ) -> None:
        """Parameters drawn from their covariance move a pixel by as much as is predicted."""
        dome, light = calibration.screen, self._light(solution.camera, calibration)
        found = project_surface(solution, "south", dome, light)
        model, draws = solution.projectors["south"], 400
        assert model.covariance is not None
        place = (np.zeros(1), np.zeros(1))  # a node of the grid that sigma is interpolated on
        middle = directions(model, dome, *place)[0, 0]
        moved = [
            directions(changed_projector(model, x), dome, *place)[0, 0] - middle
            for x in rng.multivariate_normal(np.zeros(12), model.covariance / 100, draws)
        ]
        squared = np.sum(np.square(moved), axis=1)
        sigma = np.degrees(np.sqrt(squared.mean())) * 60 * 10
        # two axes at the least: the mean square is known to 1 / sqrt(draws)
        predicted = float(found.sigma_arcmin[0, 0])
        assert abs((sigma / predicted) ** 2 - 1) < SIGMAS * np.sqrt(2 / draws) + 0.02
