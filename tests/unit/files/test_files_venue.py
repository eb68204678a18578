"""venue.toml: every mistake is one line that says where, what was got and what to do."""

from pathlib import Path

import numpy as np
import pytest
from tolerances import CLOSED_FORM

from procam.errors import InputError
from procam.files.venue import load_venue, template_names, template_text

PLAIN = template_text("simulated-ideal")
TAGS = """
[[apriltags]]
id = 7
azimuth_deg = -30.0
sigma_deg = 0.02

[[apriltags]]
family = "25h9"
id = 8
azimuth_deg = 10.0
elevation_deg = 40.0
sigma_deg = 0.02

"""


def _load(folder: Path, text: str) -> object:
    (folder / "venue.toml").write_text(text, encoding="utf-8")
    return load_venue(folder)


def _mistakes(folder: Path, text: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        _load(folder, text)
    return str(caught.value).splitlines()


def _edit(old: str, new: str, text: str = PLAIN) -> str:
    assert old in text
    return text.replace(old, new)


class TestTemplates:
    def test_there_are_some(self) -> None:
        assert "simulated-standard" in template_names()

    @pytest.mark.parametrize("name", template_names())
    def test_each_loads(self, tmp_path: Path, name: str) -> None:
        (tmp_path / "venue.toml").write_text(template_text(name))
        venue = load_venue(tmp_path)
        assert venue.cameras and venue.table.projectors and venue.screen.radius_m > 0

    def test_an_unknown_one_is_refused_with_the_known(self) -> None:
        with pytest.raises(InputError, match=r"template: got 'nope', expected one of .*simulated-"):
            template_text("nope")


class TestContent:
    def test_degrees_become_radians_and_names_are_kept(self, tmp_path: Path) -> None:
        (tmp_path / "venue.toml").write_text(PLAIN)
        venue = load_venue(tmp_path)
        assert venue.screen.half_angle == pytest.approx(np.pi / 2, rel=CLOSED_FORM)
        assert venue.screen.tilt == pytest.approx(np.radians(10), rel=CLOSED_FORM)
        camera = venue.cameras["zenith"]
        assert (camera.name, camera.size, camera.lens.kind) == (
            "zenith",
            (1600, 1600),
            "kannala-brandt",
        )
        assert camera.sensor.bits == 16 and camera.camera_from_dome is None
        left = venue.fiducials[1]
        assert left.azimuth == pytest.approx(np.radians(130), rel=CLOSED_FORM)
        assert left.elevation == pytest.approx(np.radians(30), rel=CLOSED_FORM)
        assert left.device == "zenith"
        assert left.sigma == pytest.approx(np.radians(0.01))

    def test_tags(self, tmp_path: Path) -> None:
        _load(tmp_path, _edit("[capture]", TAGS + "[capture]"))
        seven, eight = load_venue(tmp_path).tags
        assert (seven.name, seven.family, seven.number) == ("tag 7", "36h11", 7)
        assert seven.azimuth == pytest.approx(np.radians(-30), rel=CLOSED_FORM)
        assert (seven.elevation, seven.sigma) == (None, pytest.approx(np.radians(0.02)))
        assert (eight.name, eight.family) == ("tag 8 of 25h9", "25h9")
        assert eight.elevation == pytest.approx(np.radians(40), rel=CLOSED_FORM)
        distance = '[[distances]]\na = "tag 7"\nb = "tag 8 of 25h9"\nmetres = 3.0\n'
        _load(tmp_path, _edit("[capture]", TAGS + distance + "[capture]"))
        assert load_venue(tmp_path).distances[0].b == "tag 8 of 25h9"

    def test_a_backends_table_goes_through_unread(self, tmp_path: Path) -> None:
        _load(tmp_path, _edit("seed = 1\n", "seed = 1\nwhatever = [1, 'two']\n"))
        backends = load_venue(tmp_path).backends
        assert set(backends) == {"simulated"}
        assert backends["simulated"]["whatever"] == [1, "two"]


# what is edited, the dotted path complained of, and what the line says besides
MISTAKES = {
    "unknown key": (
        ("radius_m = 6.0", "radius_m = 6.0\nradios_m = 5.0"),
        "screen.radios_m",
        ["got 5.0", "check its spelling"],
    ),
    "unknown table": (("[capture]", "[captures]"), "captures", ["got a table", "spelling"]),
    "missing key": (
        ('backend = "simulated"\nsize = [1600', "size = [1600"),
        "cameras.zenith.backend",
        ["procam init"],
    ),
    "fiducial without an angle": (
        ("azimuth_deg = 12.0\nelevation_deg = 35.0\n", ""),
        "fiducials.front",
        ["got no angle", "azimuth_deg, elevation_deg or both"],
    ),
    "fiducial of two devices": (
        ('camera = "zenith"\npixel', 'camera = "zenith"\nprojector = "south"\npixel'),
        "fiducials.front",
        ["both or neither of camera and projector"],
    ),
    "tag without an angle": (
        ("[capture]", TAGS.replace("azimuth_deg = -30.0", "") + "[capture]"),
        "apriltags.0",
        ["got no angle", "azimuth_deg, elevation_deg or both"],
    ),
    "tag that the family has not": (
        ("[capture]", TAGS.replace("id = 8", "id = 35") + "[capture]"),
        "apriltags.1.id",
        ["got 35", "0..34", "'25h9'"],
    ),
    "tag of no family": (
        ("[capture]", TAGS.replace("25h9", "25h8") + "[capture]"),
        "apriltags.1.family",
        ["got '25h8'", "'36h11', '25h9' or '16h5'"],
    ),
    "tag listed twice": (
        ("[capture]", TAGS + TAGS.replace("id = 8", "id = 9") + "[capture]"),
        "apriltags.2",
        ["got tag 7 twice", "remove one"],
    ),
    "distance to nobody": (
        ("[capture]", '[[distances]]\na = "zenith"\nb = "moon"\nmetres = 3.0\n\n[capture]'),
        "distances.0.b",
        ["got 'moon'", "zenith, south, north, front"],
    ),
    "radius 0": (
        ("radius_m = 6.0", "radius_m = 0"),
        "screen.radius_m",
        ["got 0", "greater than 0"],
    ),
    "radius NaN": (("radius_m = 6.0", "radius_m = nan"), "screen.radius_m", ["got nan", "finite"]),
    "radius in words": (
        ("radius_m = 6.0", 'radius_m = "six"'),
        "screen.radius_m",
        ["got 'six'", "number"],
    ),
    "screen of another kind": (
        ('kind = "dome"', 'kind = "cave"'),
        "screen.kind",
        ["'cave'", "'dome'"],
    ),
    "more than a hemisphere": (
        ("half_angle_deg = 90.0", "half_angle_deg = 100"),
        "screen.half_angle_deg",
        ["got 100", "less than or equal to 90"],
    ),
    "albedo above 1": (
        ("floor_albedo = 0.0 ", "floor_albedo = 10 "),
        "screen.floor_albedo",
        ["got 10", "less than or equal to 1"],
    ),
    "wrong number of k": (
        ("k = [0.02, -0.008, 0.001, 0]", "k = [0.02, -0.008]"),
        "cameras.zenith.k",
        ["got 2 numbers", "expected 4", "kannala-brandt"],
    ),
    "model of a lens": (
        ('model = "kannala-brandt"', 'model = "fish"'),
        "cameras.zenith.model",
        ["'fish'", "'kannala-brandt' or 'brown'"],
    ),
    "size of three": (
        ("c = [802.8, 797.4]", "c = [802.8, 797.4, 3.0]"),
        "cameras.zenith.c",
        ["at most 2"],
    ),
    "projector size 0": (
        ("size = [1280, 800]\ncontrol", "size = [0, 800]\ncontrol"),
        "projectors.south.size.0",
        ["got 0", "greater than or equal to 8"],
    ),
    "control protocol": (
        ('"escvp21"', '"morse"'),
        "projectors.south.control.protocol",
        ["'morse'", "'escvp21'"],
    ),
    "fiducial naming an unknown camera": (
        (
            'elevation_deg = 35.0\nsigma_deg = 0.01\ncamera = "zenith"',
            'elevation_deg = 35.0\nsigma_deg = 0.01\ncamera = "zenit"',
        ),
        "fiducials.front.camera",
        ["got 'zenit'", "expected one of zenith"],
    ),
    "fiducial without pixel": (
        ("pixel = [302.50, 1023.38]", ""),
        "fiducials.1.pixel",
        ["procam init"],
    ),
    "exposure below 0": (
        ("exposure_s = 0.13", "exposure_s = -1"),
        "capture.exposure_s",
        ["got -1", "greater than 0"],
    ),
    "no capture": (
        (
            PLAIN[PLAIN.index("[capture]") : PLAIN.index("[simulated]")],
            "",
        ),
        "capture",
        ["procam init"],
    ),
}


class TestMistakes:
    @pytest.mark.parametrize("case", MISTAKES)
    def test_one_line_each(self, tmp_path: Path, case: str) -> None:
        edit, where, says = MISTAKES[case]
        lines = _mistakes(tmp_path, _edit(*edit))
        mine = [
            line for line in lines if line.startswith(f"{tmp_path / 'venue.toml'}: {where}: got ")
        ]
        assert len(mine) == 1, lines
        for words in says:
            assert words in mine[0]
        for line in lines:
            assert line.startswith(f"{tmp_path / 'venue.toml'}: ")

    def test_all_mistakes_at_once(self, tmp_path: Path) -> None:
        text = _edit("radius_m = 6.0", "radius_m = 0")
        text = _edit("bits = 16", "bits = 99", text)
        text = _edit('name = "left"', 'title = "left"', text)
        lines = _mistakes(tmp_path, text)
        paths = {line.split(": ")[1] for line in lines}
        assert paths == {
            "screen.radius_m",
            "cameras.zenith.bits",
            "fiducials.1.name",
            "fiducials.1.title",
        }
        assert len(lines) == 4

    def test_all_broken_references_at_once(self, tmp_path: Path) -> None:
        text = _edit("k = [0.02, -0.008, 0.001, 0]", "k = [0.02]")
        text = _edit('camera = "zenith"', 'camera = "nadir"', text)
        assert len(_mistakes(tmp_path, text)) == 4

    @pytest.mark.parametrize(
        "text", ["radius_m = = 6", "[screen", 'kind = "dome', "a = 1\na = 2", "x = 08"]
    )
    def test_bad_toml(self, tmp_path: Path, text: str) -> None:
        (line,) = _mistakes(tmp_path, text)
        assert line.startswith(f"{tmp_path / 'venue.toml'}: got invalid TOML (")
        assert "expected name = value" in line

    def test_not_even_text(self, tmp_path: Path) -> None:
        (tmp_path / "venue.toml").write_bytes(b"\xff\xfe\x00")
        with pytest.raises(InputError, match=r"venue\.toml: got invalid TOML"):
            load_venue(tmp_path)

    @pytest.mark.parametrize("text", ["", "cameras = 3\nprojectors = [1]", "screen = 1"])
    def test_hardly_anything(self, tmp_path: Path, text: str) -> None:
        assert len(_mistakes(tmp_path, text)) >= 4

    def test_no_file(self, tmp_path: Path) -> None:
        with pytest.raises(
            InputError, match=r"venue\.toml: got no such file.*procam init"
        ) as caught:
            load_venue(tmp_path)
        assert "\n" not in str(caught.value)

    def test_a_device_may_not_call_its_backend_as_a_table_of_the_file(self, tmp_path: Path) -> None:
        """Backend "screen" would have the [screen] table cut out from under the validator."""
        text = _edit(
            '[projectors.south]\nbackend = "simulated"', '[projectors.south]\nbackend = "screen"'
        )
        venue = _load(tmp_path, text)
        assert venue.screen.radius_m == 6.0
