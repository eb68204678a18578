"""Masks of the projector lenses that a camera sees."""

from dataclasses import replace

import numpy as np
import pytest
from domes import SimulatedDome

from procam.estimate.geometry.camera_view import GLARE_PX, HOUSING_RADIUS_M, ScreenView, lens_glints
from procam.estimate.geometry.model import RigGeometry
from procam.maths.geometry.lenses import project, unproject
from procam.maths.geometry.pose import Pose
from procam.model.screen import Dome

SIZE = (512, 512)
RADIUS_M = 8.0


@pytest.fixture(scope="module")
def rig() -> RigGeometry:
    """Three projectors just inside the rim; the first camera takes pictures of a quarter's size."""
    rig = SimulatedDome.build(4).rig()
    camera = rig.cameras["zenith"]
    lens = replace(camera.lens, focal=camera.lens.focal / 4, centre=camera.lens.centre / 4)
    return replace(rig, cameras={"zenith": replace(camera, size=SIZE, lens=lens)})


def rays_of(rig: RigGeometry) -> np.ndarray:
    pixels = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1).astype(float)
    return unproject(pixels, rig.cameras["zenith"].lens)


def with_lens_at(rig: RigGeometry, place: np.ndarray) -> RigGeometry:
    """The rig with one projector only, its lens at a position (3,) [m] in the camera's frame."""
    camera, (name, projector) = rig.cameras["zenith"], next(iter(rig.projectors.items()))
    assert camera.camera_from_dome is not None
    rotation = projector.projector_from_dome.rotation
    pose = Pose(rotation, -rotation @ camera.camera_from_dome.inverse().apply(place))
    return replace(rig, projectors={name: replace(projector, projector_from_dome=pose)})


def radius_px(rig: RigGeometry, distance_m: float) -> float:
    focal = float(rig.cameras["zenith"].lens.focal.mean())
    return focal * np.arcsin(HOUSING_RADIUS_M / distance_m) + GLARE_PX


class TestDiscs:
    def test_every_lens_is_covered(self, rig: RigGeometry) -> None:
        covered, camera = (
            lens_glints(rig, rig.cameras["zenith"], rays_of(rig)),
            rig.cameras["zenith"],
        )
        assert camera.camera_from_dome is not None
        expected = 0.0
        for projector in rig.projectors.values():
            place = camera.camera_from_dome.apply(projector.projector_from_dome.origin)
            x, y = np.rint(project(place, camera.lens)).astype(int)
            assert covered[y, x]
            expected += np.pi * radius_px(rig, float(np.linalg.norm(place))) ** 2
        # at 90 degrees a fisheye shows things pi/2 times as wide as high
        assert 0.9 * expected < covered.sum() < 1.8 * expected

    @pytest.mark.parametrize("distance_m", [1.0, 6.0])
    def test_on_the_axis_the_mask_is_a_disc_of_the_housings_size(
        self, rig, distance_m: float
    ) -> None:
        one = with_lens_at(rig, np.array([0.0, 0.0, distance_m]))
        covered = lens_glints(one, one.cameras["zenith"], rays_of(one))
        pixels = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1)
        off = np.linalg.norm(pixels - one.cameras["zenith"].lens.centre, axis=-1)
        radius = radius_px(one, distance_m)
        assert covered[off < 0.97 * radius].all()
        assert not covered[off > 1.03 * radius].any()

    @pytest.mark.parametrize(("beyond_m", "seen"), [(-0.05, True), (0.1, True), (0.3, False)])
    def test_a_lens_behind_the_screen_is_not_masked(self, rig, beyond_m, seen) -> None:
        """A lens in a hole of the screen still shines through it."""
        camera = rig.cameras["zenith"].camera_from_dome
        up = camera.rotate(np.array([0.0, 0.0, 1.0]))
        screen_m = np.sqrt(RADIUS_M**2 - np.sum(camera.origin[:2] ** 2)) - camera.origin[2]
        one = with_lens_at(rig, (screen_m + beyond_m) * up)
        assert lens_glints(one, one.cameras["zenith"], rays_of(one)).any() == seen

    def test_a_camera_inside_the_housing_is_masked_on_that_side(self, rig: RigGeometry) -> None:
        one = with_lens_at(rig, np.array([0.0, 0.0, 0.1]))
        rays = rays_of(one)
        assert lens_glints(one, one.cameras["zenith"], rays)[rays[..., 2] > 0].all()


def test_a_view_without_masked_pixels_excludes_their_solid_angle(rig: RigGeometry) -> None:
    rays = rays_of(rig)
    dome = Dome(RADIUS_M, np.pi / 2, 0.0, 0.1, 0.05)
    view = ScreenView.of(rig.cameras["zenith"], dome, rays, np.ones(SIZE[::-1], bool))
    covered = lens_glints(rig, rig.cameras["zenith"], rays)
    assert (covered & view.on_screen).any()
    less = view.without(covered)
    assert np.array_equal(less.on_screen, view.on_screen & ~covered)
    assert not less.weight[covered].any()
    assert np.array_equal(less.weight[~covered], view.weight[~covered])
    assert less.direction is view.direction
