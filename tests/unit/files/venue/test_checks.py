"""venue.toml: names, places, lenses and files that clash are refused when it is read, a line each."""

import re
from pathlib import Path

import pytest
from venue_texts import DISTANCE, MARK_PIXEL, TAGS, edit, load_venue_of, mistakes

MARK = """
[[fiducials]]
name = "front"
azimuth_deg = 12.0
elevation_deg = 35.0
sigma_deg = 0.01
projector = "south"
pixel = [640.0, 400.0]

"""
FOCAL = "f = [465.116279, 465.116279]"
CENTRE = "c = [802.8, 797.4]"


# the edit, the dotted path in the message, and other words in it
CLASHES = {
    "fiducial without an angle": (
        ("azimuth_deg = 12.0\nelevation_deg = 35.0\n", ""),
        "fiducials.front",
        ["has no angle", "azimuth_deg, elevation_deg or both"],
    ),
    "fiducial of two devices": (
        ('camera = "zenith"\npixel', 'camera = "zenith"\nprojector = "south"\npixel'),
        "fiducials.front",
        ["both or neither of camera and projector"],
    ),
    "tag without an angle": (
        ("[capture]", TAGS.replace("azimuth_deg = -30.0", "") + "[capture]"),
        "apriltags.0",
        ["has no angle", "azimuth_deg, elevation_deg or both"],
    ),
    "tag that the family has not": (
        ("[capture]", TAGS.replace("id = 8", "id = 35") + "[capture]"),
        "apriltags.1.id",
        ["is 35", "0..34", "'25h9'"],
    ),
    "tag listed twice": (
        ("[capture]", TAGS + TAGS.replace("id = 8", "id = 9") + "[capture]"),
        "apriltags.2",
        ["tag 7 is listed twice", "remove one"],
    ),
    "distance to nobody": (
        ("[capture]", '[[distances]]\na = "zenith"\nb = "moon"\nmetres = 3.0\n\n[capture]'),
        "distances.0.b",
        ["is 'moon'", "zenith, south, north, front"],
    ),
    "distance from a thing to itself": (
        ("[capture]", DISTANCE.replace('"south"', '"zenith"')),
        "distances.0",
        ["a and b are both 'zenith'", "correct either"],
    ),
    "focal length in millimetres": (
        (FOCAL, "f = [4.65, 4.65]"),
        "cameras.zenith.f",
        ["is [4.65, 4.65]", "80..80000 px", "0.05 to 50 widths", "not millimetres"],
    ),
    "focal lengths of two lenses": (
        (FOCAL, "f = [465.0, 931.0]"),
        "cameras.zenith.f",
        ["is [465.0, 931.0]", "factor of 2 at most"],
    ),
    "principal point far outside": (
        (CENTRE, "c = [802.8, -4801.0]"),
        "cameras.zenith.c",
        ["is [802.8, -4801.0]", "picture of 1600x1600 px or at most 4800 px outside", "middle"],
    ),
    "projector with a camera's name": (
        ("[projectors.south]", "[projectors.zenith]"),
        "projectors.zenith",
        ["has the name of a camera", "rename"],
    ),
    "projector with the name of the dome's maps": (
        ("[projectors.south]", "[projectors.Dome]"),
        "projectors.Dome",
        ["needs for a map of the dome", "rename it"],
    ),
    "half angle in radians": (
        ("half_angle_deg = 90.0", "half_angle_deg = 1.57"),
        "fiducials.front.elevation_deg",
        ["is 35", "half_angle_deg 1.57 ends at 88.43", "Correct either"],
    ),
    "black level of more bits": (
        ("black_level = 64.0", "black_level = 65535.0"),
        "cameras.zenith.black_level",
        ["is 65535", "saturate at 65535"],
    ),
    "fiducial with a camera's name": (
        ('name = "left"', 'name = "zenith"'),
        "fiducials.zenith",
        ["has the name of a camera or projector", "rename it"],
    ),
    "fiducials of one name elsewhere": (
        ("[capture]", MARK.replace("12.0", "-12.0") + "[capture]"),
        "fiducials.front",
        ["has azimuth_deg = -12.0, elevation_deg = 35.0 here and azimuth_deg = 12.0, elev"],
    ),
    "fiducials of one name, one without an angle": (
        ("[capture]", MARK.replace("elevation_deg = 35.0\n", "") + "[capture]"),
        "fiducials.front",
        ["has azimuth_deg = 12.0 here and azimuth_deg = 12.0, elevation_deg = 35.0 before"],
    ),
    "fiducials of one name on one camera": (
        ('name = "left"', 'name = "front"'),
        "fiducials.front",
        ["is listed twice for zenith", "rename or remove one"],
    ),
    "fiducial with a tag's name": (
        ("[capture]", TAGS + MARK.replace('"front"', '"tag 7"') + "[capture]"),
        "fiducials.tag 7",
        ["has azimuth_deg = 12.0, elevation_deg = 35.0 here and azimuth_deg = -30.0 before"],
    ),
    "fiducial outside the photograph": (
        (MARK_PIXEL, "pixel = [302.5, 1600.0]"),
        "fiducials.left.pixel",
        ["is [302.5, 1600.0]", "1600x1600 px of camera zenith"],
    ),
    "fiducial outside the panel": (
        ("[capture]", MARK.replace("640.0", "1279.6") + "[capture]"),
        "fiducials.front.pixel",
        ["is [1279.6, 400.0]", "1280x800 px of projector south"],
    ),
    "wrong number of k": (
        ("k = [0.02, -0.008, 0.001, 0]", "k = [0.02, -0.008]"),
        "cameras.zenith.k",
        ["has 2 numbers", "'kannala-brandt' needs 4"],
    ),
    "fiducial naming an unknown camera": (
        (
            'elevation_deg = 35.0\nsigma_deg = 0.01\ncamera = "zenith"',
            'elevation_deg = 35.0\nsigma_deg = 0.01\ncamera = "zenit"',
        ),
        "fiducials.front.camera",
        ["is 'zenit'", "must be one of zenith"],
    ),
}


@pytest.mark.parametrize("case", CLASHES)
def test_one_line_each(tmp_path: Path, case: str) -> None:
    change, where, words = CLASHES[case]
    lines = mistakes(tmp_path, edit(*change))
    mine = [
        line for line in lines if re.match(rf"{tmp_path}/venue.toml: {re.escape(where)}[ :]", line)
    ]
    assert len(mine) == 1, lines
    assert all(word in mine[0] for word in words), mine
    assert all(line.startswith(f"{tmp_path / 'venue.toml'}: ") for line in lines)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "[projectors.south]\n",
            '[projectors.south]\nmasks = ["door.png"]\n',
            "projectors.south.masks.0: {}/door.png: no such file; a PNG",
        ),
        (
            "[screen]\n",
            '[screen]\nmasks = [[[0, 1], [9, 1], [5, 9]], "d.png"]\n',
            "screen.masks.1: {}/d.png: no such file; a PNG",
        ),
        (
            "[screen]\n",
            '[screen]\nprotected = ["d.png"]\n',
            "screen.protected.0: {}/d.png: no such file; a PNG",
        ),
        (
            'response = "linear"',
            'response = "curve.csv"',
            "cameras.zenith.response: {}/curve.csv: no such file; a table of",
        ),
    ],
)
def test_files_that_are_not_there(tmp_path: Path, old: str, new: str, message: str) -> None:
    (line,) = mistakes(tmp_path, edit(old, new))
    assert line.startswith(f"{tmp_path / 'venue.toml'}: {message.format(tmp_path)}")


def test_one_mark_seen_by_several_devices(tmp_path: Path) -> None:
    venue = load_venue_of(tmp_path, edit("[capture]", MARK + "[capture]"))
    assert [f.device for f in venue.fiducials if f.name == "front"] == ["zenith", "south"]


def test_lenses_at_the_bounds(tmp_path: Path) -> None:
    text = edit(CENTRE, "c = [-4800.0, 6400.0]", edit(FOCAL, "f = [80.0, 160.0]"))
    assert load_venue_of(tmp_path, text).cameras["zenith"].lens.focal.tolist() == [80, 160]
