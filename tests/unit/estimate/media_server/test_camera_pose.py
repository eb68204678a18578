"""Poses of cameras from a server's tags, in photographs made from rays, a sphere and a dome master."""

from dataclasses import replace

import numpy as np
import pytest

from procam.errors import CalibrationError, NotEnoughData
from procam.estimate.geometry.direction_samples import sample_directions
from procam.estimate.geometry.pixel_directions import fit_pixel_directions
from procam.estimate.media_server.camera_pose import (
    MIN_TAGS,
    check_rotation,
    find_master_tags,
    place_camera,
    server_geometry,
)
from procam.estimate.media_server.dome_master import DomeMaster
from procam.estimate.media_server.tags import TAG_PICTURES, draw_tags, master_tags
from procam.maths.geometry.lenses import Lens, project, unproject
from procam.maths.geometry.pose import Pose, rotation_vector
from procam.maths.geometry.sphere import (
    direction_from_angles,
    intersect_sphere,
    master_directions,
    master_pixels,
)
from procam.maths.warp import blur, sample
from procam.model.optics import CameraModel, Fiducial, Sensor

RADIUS_M, SIZE, PHOTO, GAMMA = 6.0, 512, 640, 2.2
MASTER = DomeMaster("server", SIZE)
TURN = Pose.from_vectors((0.05, -0.03, 0.4), (0, 0, 0)).rotation
PLACE_M = np.array([0.48, -0.36, 0.5])
POSE = Pose(TURN, -TURN @ PLACE_M)
LENS = Lens(
    "kannala-brandt",
    np.full(2, PHOTO / 3.44),
    np.array([PHOTO / 2 + 2.0, PHOTO / 2 - 3.0]),
    np.array([0.02, -0.008, 0.001, 0.0]),
)
CAMERA = CameraModel("zenith", (PHOTO, PHOTO), LENS, Sensor(12, 64.0))


def photograph(picture: np.ndarray) -> np.ndarray:
    """Counts (H, W) of an aligned dome's picture, a little out of focus and noisy."""
    rng = np.random.default_rng(3)
    pixels = np.stack(np.meshgrid(np.arange(PHOTO), np.arange(PHOTO)), -1).astype(float)
    back = POSE.inverse()
    rays = back.rotate(unproject(pixels, LENS))
    direction = intersect_sphere(back.translation, rays, RADIUS_M) / RADIUS_M
    light = (picture.astype(np.float32) / 255) ** GAMMA
    seen = sample(light, master_pixels(direction, SIZE))[..., 0] * (direction[..., 2] > 0)
    counts = 64 + 3000 * blur(seen, 0.6) + rng.normal(0, 8, seen.shape)
    return counts.astype(np.float32)


@pytest.fixture(scope="module")
def photos() -> list[np.ndarray]:
    shown = [master_tags(SIZE, np.pi, i) for i in range(TAG_PICTURES)]
    return [photograph(draw_tags(MASTER.model, tags, np.pi)) for tags in shown]


@pytest.fixture(scope="module")
def tags(photos: list[np.ndarray]) -> list[Fiducial]:
    return find_master_tags(CAMERA, MASTER, photos)


def with_focal(factor: float) -> CameraModel:
    return replace(CAMERA, lens=replace(LENS, focal=LENS.focal * factor))


def moved(tags: list[Fiducial], by_px: float, count: int) -> list[Fiducial]:
    """Tags of which some have wrong pixels."""
    return [replace(t, pixel=t.pixel + by_px * (i < count)) for i, t in enumerate(tags)]


class TestPlaced:
    def test_most_tags_are_found_and_no_name_comes_twice(self, tags: list[Fiducial]) -> None:
        assert len(tags) > 50
        assert len({tag.name for tag in tags}) == len(tags)

    def test_the_pose(self, tags: list[Fiducial]) -> None:
        found = place_camera(CAMERA, "fixed", RADIUS_M, tags)
        pose = found.camera.camera_from_dome
        assert pose is not None
        off = pose.origin - PLACE_M
        turn = rotation_vector(pose.rotation @ TURN.T)
        sigma = np.sqrt(np.diag(found.covariance))[1:7]
        # in the camera's own frame: turn, then shift as it enters the translation
        assert (np.abs(turn) < 4 * sigma[:3] + 1e-5).all()
        assert np.linalg.norm(off) < 4 * np.linalg.norm(sigma[3:])
        assert np.linalg.norm(sigma[3:]) < 1e-3
        assert found.rms_arcmin < 1 and not found.dropped

    def test_a_guessed_lens_is_solved(self, tags: list[Fiducial]) -> None:
        found = place_camera(with_focal(1.06), "solve", RADIUS_M, tags)
        np.testing.assert_allclose(found.camera.lens.focal, LENS.focal, rtol=0.005)
        assert found.rms_arcmin < 1

    def test_misread_tags_are_left_out_by_name(self, tags: list[Fiducial]) -> None:
        found = place_camera(CAMERA, "fixed", RADIUS_M, moved(tags, 15.0, 5))
        assert list(found.dropped) == [tag.name for tag in tags[:5]]
        assert found.rms_arcmin < 1


class TestRefused:
    def test_a_dark_room(self, photos: list[np.ndarray]) -> None:
        dark = [np.full_like(p, 64.0) for p in photos]
        with pytest.raises(NotEnoughData, match=f"finds 0 of .* tags, and {MIN_TAGS} or more"):
            find_master_tags(CAMERA, MASTER, dark)

    def test_a_mirrored_dome(self, photos: list[np.ndarray]) -> None:
        flipped = [np.ascontiguousarray(p[:, ::-1]) for p in photos]
        with pytest.raises(NotEnoughData, match=r"tags in a mirror and 0 as they are.*flip"):
            find_master_tags(CAMERA, MASTER, flipped)

    @pytest.mark.parametrize(("fov_deg", "stretch"), [(160, "1.1[0-4]")])
    def test_another_field_of_view_is_named(
        self, photos: list[np.ndarray], fov_deg: float, stretch: str
    ) -> None:
        other = DomeMaster("server", SIZE, float(np.radians(fov_deg)))
        tags = find_master_tags(CAMERA, other, photos)
        cause = f"if the master spanned {stretch} times the angle: correct the projector's fov_deg"
        with pytest.raises(CalibrationError, match=cause):
            place_camera(CAMERA, "fixed", RADIUS_M, tags)

    def test_pictures_in_another_order(self, photos: list[np.ndarray]) -> None:
        tags = find_master_tags(CAMERA, MASTER, photos[::-1])
        with pytest.raises(
            CalibrationError, match=r"zenith: tags are .* the pictures' order are right"
        ):
            place_camera(CAMERA, "fixed", RADIUS_M, tags)


class TestGeometry:
    def test_directions_are_those_of_the_master(self, tags: list[Fiducial]) -> None:
        placed = place_camera(CAMERA, "fixed", RADIUS_M, tags)
        geometry = server_geometry(MASTER, RADIUS_M, {"zenith": placed})
        fitted = fit_pixel_directions(geometry, "server")
        line = np.arange(0.0, SIZE, 37)
        direction, inside = master_directions(SIZE)
        wanted, found = direction[::37, ::37], fitted.directions(line, line)
        np.testing.assert_allclose(found[inside[::37, ::37]], wanted[inside[::37, ::37]], atol=1e-9)
        sigma = fitted.sigma_arcmin(line, line)
        np.testing.assert_allclose(sigma, placed.rms_arcmin, rtol=1e-5)
        assert geometry.main == "zenith"
        (residual,) = geometry.residual_px.values()
        arcmin = np.linalg.norm(residual, axis=1) * 180 * 60 / SIZE
        assert np.sqrt(np.mean(arcmin**2)) == pytest.approx(placed.rms_arcmin, rel=0.2)
        draws = sample_directions(
            geometry, fitted, found[:2, :2, :2] * 0 + 256.0, 3, np.random.default_rng(1)
        )
        assert np.isfinite(draws).all()

    @pytest.mark.parametrize("turn_deg", [-30.0, 90.0])
    def test_fiducials_reveal_a_rotated_server(self, tags: list[Fiducial], turn_deg: float) -> None:
        """The server shows azimuth 0 at `turn_deg`."""
        placed = place_camera(CAMERA, "fixed", RADIUS_M, tags)
        geometry = server_geometry(MASTER, RADIUS_M, {"zenith": placed})

        def marks(off_deg: float) -> list[Fiducial]:
            found = []
            for name, azimuth in (("front", 10.0), ("left", 100.0)):
                seen = direction_from_angles(np.radians(azimuth - off_deg), np.radians(35.0))
                pixel = project(POSE.apply(RADIUS_M * seen), LENS)
                place = float(np.radians(azimuth)), float(np.radians(35.0))
                found.append(Fiducial(name, *place, 0.001, "zenith", pixel))
            return found

        check_rotation(geometry, MASTER, [])
        check_rotation(geometry, MASTER, marks(0.5))
        with pytest.raises(CalibrationError, match=f"Set rotation_deg = {turn_deg:.0f}, or turn"):
            check_rotation(geometry, MASTER, marks(turn_deg))
