"""The presets' table, and the venue files that are made from it."""

import numpy as np
import pytest

from procam.files.venue.load import load_venue, template_text
from procam.maths.geometry.lenses import project
from procam.maths.geometry.sphere import direction_from_angles
from simulators.placement import place_cameras, place_projectors
from simulators.presets import PRESETS
from simulators.surface import Surface
from simulators.template import venue_text

# amplitudes, not peak to peak
TABLE = {
    "ovality": (0.0, 0.0, 0.001, 0.001),
    "panel_step_m": (0.0, 0.0, 0.002, 0.002),
    "strip_share": (0.05, 0.10, 0.10, 0.10),
    "floor_albedo": (0.0, 0.08, 0.12, 0.12),
    "pod": (False, False, True, True),
    "albedo": (0.5, 0.5, 0.5, 0.5),
    "albedo_smooth": (0.0, 0.05, 0.05, 0.05),
    "seam": (0.0, 0.07, 0.07, 0.07),
    "gloss": (0.0, 0.0, 0.03, 0.03),
    "glare": (0.0, 0.003, 0.01, 0.01),
    "white_snr": (None, 100.0, 100.0, 100.0),
    "drift": (0.0, 0.0, 0.003, 0.003),
}
NAMES = ("ideal", "standard", "realistic", "faulty")


@pytest.mark.parametrize("field", TABLE)
def test_the_table(field: str) -> None:
    assert tuple(getattr(PRESETS[name], field) for name in NAMES) == TABLE[field]


def test_glare_is_known_for_standard_alone_and_faults_are_named() -> None:
    assert PRESETS["standard"].glare_known and not PRESETS["realistic"].glare_known
    assert PRESETS["faulty"].faults and not PRESETS["realistic"].faults


@pytest.mark.parametrize("name", NAMES)
def test_the_committed_template_is_current(name: str) -> None:
    """Made by `python -m simulators.template PRESET`."""
    assert template_text(f"simulated-{name}") == venue_text(name)  # type: ignore[arg-type]


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
    @pytest.mark.parametrize("count", [1, 2, 6])
    def test_projectors_are_inside_the_rim_and_pointed_across(self, count: int) -> None:
        builds = place_projectors(count, (1280, 800))
        assert len({b.name for b in builds}) == count
        for build in builds:
            place = build.projector_from_dome.origin
            assert 0.9 * 6 < np.linalg.norm(place) < 6
            ahead = build.projector_from_dome.rotation[2]
            assert ahead @ place < -0.8 * 6

    def test_no_two_are_alike(self) -> None:
        one, two = place_projectors(2, (1280, 800))
        assert not np.allclose(one.lens.focal, two.lens.focal, rtol=1e-4)
        assert not np.allclose(one.colour_mix, two.colour_mix, rtol=1e-3)
        assert not np.allclose(one.gamma, two.gamma, rtol=1e-4)

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

    @pytest.mark.parametrize("kind", ["fisheye", "pinhole"])
    def test_cameras_point_up_from_off_the_centre(self, kind: str) -> None:
        for build in place_cameras(4, (400, 400), kind):
            assert build.camera_from_dome.rotation[2] @ [0, 0, 1] > 0.95
            assert 0.05 * 6 < np.linalg.norm(build.camera_from_dome.origin) < 0.5 * 6

    def test_the_front_is_to_the_right_of_the_first_camera(self) -> None:
        """Rotated by 0.4 rad, so the front is to the right of the middle."""
        (build,) = place_cameras(1, (400, 400), "fisheye")
        front = 6.0 * direction_from_angles(0.0, np.radians(30.0))
        assert project(build.camera_from_dome.apply(front), build.lens)[0] > 300
