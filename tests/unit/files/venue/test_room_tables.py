"""Rooms in venue.toml: kinds, places on their canvas, and mistakes."""

from pathlib import Path

import numpy as np
import pytest

from procam.errors import InputError
from procam.files.venue.load import Venue, load_venue
from procam.files.venue.masks import screen_mask
from procam.model.screen import RoomScreen
from simulators.template import walls_text


def venue(folder: Path, text: str) -> Venue:
    (folder / "venue.toml").write_text(text, "utf-8")
    return load_venue(folder)


@pytest.fixture(scope="module")
def box() -> str:
    return walls_text("box", patch_m=1.0)


def test_a_box_is_read_with_what_is_not_lit(tmp_path: Path, box: str) -> None:
    text = box.replace("other_albedo =", "others = { ceiling = [0.7, 0.02] }\nother_albedo =", 1)
    screen = venue(tmp_path, text).screen
    assert isinstance(screen, RoomScreen)
    assert (screen.kind, screen.size) == ("box", (6.0, 5.0, 3.0))
    assert screen.others == (("back", 0.2, 0.05), ("ceiling", 0.7, 0.02))


def test_a_cylinder_is_read(tmp_path: Path) -> None:
    screen = venue(tmp_path, walls_text("cylinder", patch_m=1.0)).screen
    assert isinstance(screen, RoomScreen)
    assert (screen.kind, screen.size, screen.lit) == ("cylinder", (5.0, 120.0, 3.0), ("wall",))


def test_marks_lie_where_the_canvas_has_them(tmp_path: Path, box: str) -> None:
    read = venue(tmp_path, box)
    marks = {mark.name: mark for mark in read.fiducials}
    mark = marks["front-3"]  # the middle of the front wall, surveyed to millimetres
    assert (mark.azimuth, mark.elevation) == pytest.approx((0.0, 0.0), abs=0.01)
    floor = marks["floor-3"]
    assert floor.elevation == pytest.approx(-np.pi / 2, abs=0.01)
    assert mark.sigma >= 0.003 / 2.5  # 3 mm at 2.5 m


def test_a_polygon_on_the_canvas_is_masked(tmp_path: Path, box: str) -> None:
    text = box.replace(
        "other_albedo =", "masks = [[[5, 0], [11, 0], [11, 3], [5, 3]]]\nother_albedo =", 1
    )
    covered = screen_mask(venue(tmp_path, text), 160).covered
    assert covered.mean() == pytest.approx(6 * 3 / (16 * 8), abs=0.01)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("width_m = 6.0", "width_m = 6000.0", ["screen", "width_m is 6000.0", "500 or less"]),
        ("width_m = 6.0\n", "", ["screen", "width_m is missing"]),
        ('kind = "box"', 'kind = "cave"', ["screen.kind is 'cave'", "'dome', 'box', 'cylinder'"]),
        ('kind = "box"\n', "", ["screen.kind is missing"]),
        ("width_m = 6.0", "with_m = 6.0", ["did you mean width_m?", "The keys are kind, width_m"]),
        ("other_albedo =", "others.front = [0.3, 0.1]\nother_albedo =", ["others.front", "back, "]),
        ("[capture]", "[blend]\nfalloff_percent_per_deg = 1\n[capture]", ["is for domes", "a box"]),
        ('lit = ["left"', 'lit = ["roof"', ["lit", "roof", "'left'"]),
        ("sigma_m = 0.003\n", "", ["sigma_m is missing"]),
        ("sigma_m = 0.003", "sigma_m = 0.003\nazimuth_deg = 3", ["azimuth_deg", "canvas_m and sigma_m"]),
        ("other_albedo =", "masks = [[[5, 0], [17, 0], [11, 3]]]\nother_albedo =", ["16 x 8 m"]),
        ("canvas_m = [", "canvas_m = [1.0, 7.5] # [", ["canvas_m is [1.0, 7.5]", "nothing is lit"]),
    ],
)  # fmt: skip
def test_mistakes_are_named(tmp_path: Path, box: str, old: str, new: str, words: list[str]) -> None:
    with pytest.raises(InputError) as refused:
        venue(tmp_path, box.replace(old, new, 1))
    for word in words:
        assert word in str(refused.value)


def test_a_room_has_no_media_server(tmp_path: Path, box: str) -> None:
    text = box.replace("size = [1280, 800]", 'kind = "dome-master"\nsize = [1024, 1024]', 1)
    with pytest.raises(InputError, match="the screen is a box"):
        venue(tmp_path, text)
