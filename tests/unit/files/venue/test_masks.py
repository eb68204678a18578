"""Masks by hand: polygons and PNGs as pixels, and what venue.toml refuses."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from procam.errors import FileFormatError, InputError, ShapeError
from procam.files.images.pixels import write_image
from procam.files.venue.load import Venue, load_venue, template_text
from procam.files.venue.masks import (
    camera_masks,
    manual_edits,
    nudges,
    projector_masks,
    protected_mask,
    screen_mask,
)
from procam.files.venue.outlines import polygon_pixels
from procam.maths.geometry.sphere import angles_from_direction, master_directions
from procam.model.mask import Mask, Nudge

PLAIN = template_text("simulated-ideal")


def load(folder: Path, *, screen: str = "", camera: str = "", projector: str = "") -> Venue:
    text = PLAIN
    for head, lines in (
        ("[screen]", screen),
        ("[cameras.zenith]", camera),
        ("[projectors.south]", projector),
    ):
        assert head in text
        text = text.replace(head, f"{head}\n{lines}")
    (folder / "venue.toml").write_text(text, encoding="utf-8")
    return load_venue(folder)


def mistake(folder: Path, **tables: str) -> str:
    with pytest.raises(InputError) as caught:
        load(folder, **tables)
    (line,) = str(caught.value).splitlines()
    return line


class TestPolygons:
    @given(
        st.lists(
            st.tuples(st.floats(-5, 25, width=32), st.floats(-5, 20, width=32)),
            min_size=3,
            max_size=7,
        )
    )
    def test_even_odd_as_counted_edge_by_edge(self, corners: list[tuple[float, float]]) -> None:
        inside = polygon_pixels(np.array(corners), (20, 15))
        for row in range(15):
            for column in range(20):
                crossings = 0
                for (x0, y0), (x1, y1) in zip(corners, corners[1:] + corners[:1], strict=True):
                    if min(y0, y1) <= row < max(y0, y1):
                        crossings += x0 + (row - y0) * (x1 - x0) / (y1 - y0) <= column
                assert inside[row, column] == (crossings % 2 == 1)


class TestVenue:
    def test_masks_of_devices(self, tmp_path: Path) -> None:
        door = np.zeros((1600, 1600), np.uint8)
        door[10:20, 30:40] = 255
        write_image(tmp_path / "door.png", door)
        venue = load(
            tmp_path,
            camera='masks = ["door.png", [[99.5, 199.5], [109.5, 199.5], [109.5, 219.5], [99.5, 219.5]]]',
            projector="masks = [[[-0.5, -0.5], [9.5, -0.5], [9.5, 4.5], [-0.5, 4.5]]]",
        )
        seen = camera_masks(venue)["zenith"].covered
        assert (seen[10:20, 30:40].all(), seen.sum()) == (True, 100 + 200)
        assert seen[200:220, 100:110].all()
        panels = projector_masks(venue)
        assert panels["south"].covered.shape == (800, 1280)
        assert (panels["south"].covered.sum(), panels["north"].covered.sum()) == (50, 0)
        assert panels["south"].covered[:5, :10].all()

    def test_masks_of_the_dome(self, tmp_path: Path) -> None:
        venue = load(
            tmp_path,
            screen="masks = [[[170, 10], [190, 10], [190, 25], [170, 25]]]\n"
            "protected = [[[0, 60], [90, 60], [180, 60], [270, 60]]]",
        )
        direction, inside = master_directions(256)
        azimuth, elevation = (np.degrees(a) for a in angles_from_direction(direction))
        door = screen_mask(venue, 256)
        # edges are straight in the master: they cut the parallels' arcs by a little
        well_in = (np.abs(np.abs(azimuth) - 180) < 9) & (elevation > 12) & (elevation < 24)
        well_out = (np.abs(np.abs(azimuth) - 180) > 11) | (elevation < 9) | (elevation > 27)
        assert door.covered[well_in & inside].all()
        assert not door.covered[well_out].any()
        pole = protected_mask(venue, 256)
        assert pole.covered[elevation > 70].all() and not pole.covered[elevation < 59].any()

    def test_nudges(self, tmp_path: Path) -> None:
        venue = load(
            tmp_path, projector="nudges = [{ pixel = [640, 400], shift_px = [-1.5, 0.25] }]"
        )
        assert nudges(venue) == [Nudge("south", (640, 400), (-1.5, 0.25))]

    def test_none_are_needed(self, tmp_path: Path) -> None:
        venue = load(tmp_path)
        assert not any(m.covered.any() for m in (*camera_masks(venue).values(),))
        assert not screen_mask(venue, 64).covered.any() and nudges(venue) == []
        assert manual_edits(venue) == {}

    def test_the_entries_of_a_calibration(self, tmp_path: Path) -> None:
        half = np.zeros((1600, 1600), np.uint8)
        half[:800] = 9
        write_image(tmp_path / "half.png", half)
        venue = load(
            tmp_path,
            screen="protected = [[[0, 30], [90, 30], [180, 30], [270, 30]]]\n"
            "masks = [[[0, 0], [90, 0], [180, 0], [270, 0]]]",
            camera='masks = ["half.png"]',
            projector="masks = [[[-0.5, -0.5], [127.5, -0.5], [127.5, 799.5], [-0.5, 799.5]]]\n"
            "nudges = [{ pixel = [640, 400], shift_px = [-1.5, 0.25] }]",
        )
        entries = manual_edits(venue)
        assert json.loads(json.dumps(entries)) == entries
        camera, panel, dome = entries["masks"]
        assert camera == {"of": "camera zenith", "file": "half.png", "share": 0.5}
        assert panel == {"of": "projector south", "corners": 4, "share": pytest.approx(0.1)}
        # squares in the master: of a half angle of pi / 2 and of pi / 3, shares of 2 pi sr
        assert (dome["of"], dome["corners"]) == ("dome", 4)
        (pole,) = entries["protected"]
        for entry, half_angle in ((dome, np.pi / 2), (pole, np.pi / 3)):
            side = np.linspace(-1, 1, 2001) * half_angle
            x, y = np.meshgrid(side, side)
            theta = np.where(np.abs(x) + np.abs(y) <= half_angle, np.hypot(x, y), np.nan)
            solid = np.nansum(np.sinc(theta / np.pi)) * (side[1] - side[0]) ** 2
            assert entry["share"] == pytest.approx(solid / (2 * np.pi), rel=2e-3)
        moved = {"projector": "south", "pixel": [640, 400], "shift_px": [-1.5, 0.25]}
        assert entries["nudges"] == [moved]

    @pytest.mark.parametrize(
        ("tables", "message"),
        [
            (
                {"camera": "masks = [[[0, 0], [1, 1]]]"},
                "cameras.zenith.masks.0 is a polygon of 2 corners; it needs at least 3",
            ),
            (
                {"camera": "masks = [[[0, 0], [1600, 0], [5, 5]]]"},
                "cameras.zenith.masks.0: the corner [1600.0, 0.0] lies outside "
                "-0.5..1599.5 and -0.5..1599.5 px; clip",
            ),
            (
                {"projector": "masks = [[[0, 0], [3, 900], [5, 5]]]"},
                "projectors.south.masks.0: the corner [3.0, 900.0] lies outside",
            ),
            (
                {"screen": "masks = [[[0, 10], [10, 10], [5, 95]]]"},
                "screen.masks.0: the corner [5.0, 95.0] lies outside azimuth",
            ),
            ({"screen": "protected = [[[0, 10]]]"}, "screen.protected.0 is a polygon of 1"),
            ({"screen": "masks = [7]"}, "screen.masks.0 is 7; it must be a polygon"),
            (
                {"projector": "nudges = [{ pixel = [1280, 0], shift_px = [0, 1] }]"},
                "projectors.south.nudges.0.pixel is [1280.0, 0.0]; it must lie on the panel",
            ),
            (
                {
                    "projector": "nudges = [{ pixel = [9, 9], shift_px = [0, 1] }, "
                    "{ pixel = [640, 400], shift_px = [3, 0] }, "
                    "{ pixel = [642, 400], shift_px = [-2, 1] }]"
                },
                "projectors.south.nudges.1: shift_px [3.0, 0.0] at pixel [640.0, 400.0] folds "
                "the picture over itself; it must be less than 142 px, and neighbours' shifts "
                "must differ by less than their distance",
            ),
        ],
    )
    def test_mistakes(self, tmp_path: Path, tables: dict[str, str], message: str) -> None:
        assert message in mistake(tmp_path, **tables)

    def test_a_picture_of_another_size_or_none(self, tmp_path: Path) -> None:
        message = mistake(tmp_path, camera='masks = ["m.png"]')
        assert f"cameras.zenith.masks.0: {tmp_path}/m.png: no such file; a PNG" in message
        write_image(tmp_path / "m.png", np.zeros((20, 30), np.uint8))
        venue = load(tmp_path, camera='masks = ["m.png"]')
        with pytest.raises(
            FileFormatError, match="is a mask of 30x20 px, and 1600x1600 are needed; draw"
        ):
            camera_masks(venue)


class TestMask:
    def test_places_between_pixels_and_outside(self) -> None:
        mask = Mask("m", np.array([[True, False], [False, True]]))
        xy = np.array([[[0.4, -0.4], [0.6, 0.0]], [[1.49, 1.49], [1.5, 1.0]]])
        assert mask.at(xy).tolist() == [[True, False], [True, False]]

    def test_only_flat_truths(self) -> None:
        with pytest.raises(ShapeError, match=r"mask m has shape \(2, 2, 1\)"):
            Mask("m", np.zeros((2, 2, 1), bool))
