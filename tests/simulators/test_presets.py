"""The presets' table, and the venue files that are made from it."""

import numpy as np
import pytest

from procam.files.venue.load import load_venue, template_text
from procam.maths.geometry.lenses import project
from procam.maths.geometry.sphere import direction_from_angles
from simulators.placement import place_cameras, place_projectors
from simulators.presets import PRESETS
from simulators.surface import Surface

NAMES = ("ideal", "standard", "realistic", "faulty")


@pytest.mark.parametrize("name", NAMES)
def test_fiducials_are_where_the_camera_sees_them(
    tmp_path_factory: pytest.TempPathFactory, name: str
) -> None:
    folder = tmp_path_factory.mktemp(name)
    (folder / "venue.toml").write_text(template_text(f"simulated-{name}"))
    venue = load_venue(folder)
    surface = Surface.build(PRESETS[name])  # type: ignore[index]
    (build,) = place_cameras(1, (1600, 1600), "fisheye")
    assert len(venue.fiducials) == 3
    for mark in venue.fiducials:
        assert mark.azimuth is not None and mark.elevation is not None
        direction = direction_from_angles(mark.azimuth, mark.elevation)
        point = direction * surface.radius(direction)
        pixel = project(build.camera_from_dome.apply(point), build.lens)
        if name == "ideal":
            np.testing.assert_allclose(mark.pixel, pixel, atol=0.0051)  # two decimals
        else:
            degree_px = build.lens.focal[0] * np.pi / 180
            sigma = np.hypot(0.3, 0.05 * degree_px)
            assert 0.1 * sigma < np.abs(mark.pixel - pixel).max() < 3 * sigma


class TestRig:
    def test_pictures_are_the_right_way_round(self) -> None:
        """Top of the panel is up on the dome, and its left is left as seen from the projector."""
        (build,) = place_projectors(1, (1280, 800))
        ahead = build.projector_from_dome.rotation[2]
        higher = ahead + np.array([0.0, 0.0, 0.2])
        left = ahead + np.cross([0.0, 0.0, 1.0], ahead) * 0.2
        middle, up, aside = project(
            build.projector_from_dome.rotate(np.stack([ahead, higher, left])), build.lens
        )
        assert up[1] < middle[1]
        assert aside[0] < middle[0]

    def test_the_front_is_to_the_right_of_the_first_camera(self) -> None:
        """Rotated by 0.4 rad, so the front is to the right of the middle."""
        (build,) = place_cameras(1, (400, 400), "fisheye")
        front = 6.0 * direction_from_angles(0.0, np.radians(30.0))
        assert project(build.camera_from_dome.apply(front), build.lens)[0] > 300
