"""venue.toml: the message about each mistake is one line with the place and what to do."""

import re
from pathlib import Path

import numpy as np
import pytest
from tolerances import CLOSED_FORM
from venue_texts import DISTANCE, MARK_PIXEL, PLAIN, TAGS, edit, load_venue_of, mistakes

from procam.errors import InputError
from procam.files.images.pixels import write_image
from procam.files.venue.load import create_venue, load_venue, template_names, template_text


class TestTemplates:
    def test_there_are_some(self) -> None:
        assert "simulated-standard" in template_names()

    @pytest.mark.parametrize("name", template_names())
    def test_each_loads(self, tmp_path: Path, name: str) -> None:
        venue = load_venue(create_venue(tmp_path / "venue", name))
        assert venue.cameras and venue.table.projectors and venue.screen.shape.radius_m > 0

    def test_the_by_hand_template_loads_with_all_its_examples(self, tmp_path: Path) -> None:
        text = template_text("by-hand")
        plain = load_venue_of(tmp_path / "plain", text)
        shape = (len(plain.cameras), len(plain.table.projectors), len(plain.fiducials))
        assert shape == (2, 3, 0) and plain.backends == {}
        full = tmp_path / "full"
        full.mkdir()
        (full / "curve.csv").write_text("level,light\n0,0\n1,1\n")
        write_image(full / "zenith-pillar.png", np.zeros((4000, 4000), np.uint8))
        examples = re.sub(r"(?m)^# (?=\w+ = |\[\[|\[acceptance)", "", text)
        venue = load_venue_of(full, examples.replace('response = "linear"', "", 1))
        camera, north = venue.table.cameras["zenith"], venue.table.projectors["north"]
        assert (len(camera.masks), camera.response) == (2, "curve.csv")
        assert (len(north.masks), len(north.nudges)) == (1, 1)
        assert venue.table.screen.masks and venue.table.screen.protected
        assert (len(venue.fiducials), len(venue.tags), len(venue.distances)) == (2, 1, 1)
        assert venue.table.acceptance.limits["coverage"] == 0.9

    def test_an_unknown_one_is_refused_with_the_known(self) -> None:
        with pytest.raises(
            InputError, match=r"template 'nope' does not exist; choose one of .*simulated-"
        ):
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
        clicked = 0.01 / np.mean(venue.table.cameras["zenith"].f)
        assert left.sigma == pytest.approx(np.hypot(np.radians(0.01), clicked))

    def test_tags(self, tmp_path: Path) -> None:
        load_venue_of(tmp_path, edit("[capture]", TAGS + "[capture]"))
        seven, eight = load_venue(tmp_path).tags
        assert (seven.name, seven.family, seven.number) == ("tag 7", "36h11", 7)
        assert seven.azimuth == pytest.approx(np.radians(-30), rel=CLOSED_FORM)
        assert (seven.elevation, seven.sigma) == (None, pytest.approx(np.radians(0.02)))
        assert (eight.name, eight.family) == ("tag 8 of 25h9", "25h9")
        assert eight.elevation == pytest.approx(np.radians(40), rel=CLOSED_FORM)
        distance = '[[distances]]\na = "tag 7"\nb = "tag 8 of 25h9"\nmetres = 3.0\n'
        load_venue_of(tmp_path, edit("[capture]", TAGS + distance + "[capture]"))
        assert load_venue(tmp_path).distances[0].b == "tag 8 of 25h9"

    def test_a_backends_table_is_not_validated(self, tmp_path: Path) -> None:
        load_venue_of(tmp_path, edit("seed = 1\n", "seed = 1\nwhatever = [1, 'two']\n"))
        backends = load_venue(tmp_path).backends
        assert set(backends) == {"simulated"}
        assert backends["simulated"]["whatever"] == [1, "two"]


# the edit, the dotted path in the message, and other words in it
MISTAKES = {
    "unknown key": (
        ("radius_m = 6.0", "radius_m = 6.0\nradios_m = 5.0"),
        "screen.radios_m",
        ["not a known key; did you mean radius_m?", "The keys are kind, radius_m, "],
    ),
    "unknown key like no other": (
        ("radius_m = 6.0", "radius_m = 6.0\ncolour = 5.0"),
        "screen.colour",
        ["The keys are kind, radius_m, ", "; remove it or check its spelling."],
    ),
    "unknown key of a fiducial": (
        (MARK_PIXEL, MARK_PIXEL + "\nsigma_degrees = 1"),
        "fiducials.1.sigma_degrees",
        [
            "not a known key",
            "azimuth_deg, elevation_deg, sigma_deg, canvas_m, point_m, sigma_m",
            "did you mean sigma_deg?",
        ],
    ),
    "unknown key of a control": (
        (
            'port = "backend" }  # or a device such as "/dev/ttyUSB0"\n\n[projectors.north]',
            'prt = "backend" }\n\n[projectors.north]',
        ),
        "projectors.south.control.prt",
        ["did you mean port? The keys are protocol, port"],
    ),
    "table of a backend that nobody names": (
        ("[simulated]", "[dreamt]"),
        "dreamt",
        ["not a known key", "and the table of a backend that a device names (simulated now)"],
    ),
    "table of what is done by hand": (
        ("[simulated]", "[by-hand]"),
        "by-hand",
        ["not a known key", "(simulated now)"],
    ),
    "unknown table": (
        ("[capture]", "[captures]"),
        "captures",
        ["not a known key", "mean capture?"],
    ),
    "missing key": (
        ('model = "kannala-brandt"\n', ""),
        "cameras.zenith.model",
        ["is missing; add it", "procam init"],
    ),
    "tag of no family": (
        ("[capture]", TAGS.replace("25h9", "25h8") + "[capture]"),
        "apriltags.1.family",
        ["is '25h8'", "'36h11', '25h9' or '16h5'"],
    ),
    "distance of no metres": (
        ("[capture]", DISTANCE.replace("3.0", "0.0001")),
        "distances.0.metres",
        ["is 0.0001; it must be 0.001 or more"],
    ),
    "name with a space": (
        ("[projectors.south]", '[projectors."so uth"]'),
        "projectors.so uth",
        ["is 'so uth'", "must be a name of letters, digits, - and _"],
    ),
    "response of no kind": (
        ('response = "linear"', 'response = "rec709"'),
        "cameras.zenith.response",
        ["is 'rec709'", 'must be "linear", "srgb", "solve" or a table\'s name that ends in .csv'],
    ),
    "size in halves": (
        ("size = [1600, 1600]", "size = [1600, 1600.5]"),
        "cameras.zenith.size.1",
        ["is 1600.5; it must be a whole number"],
    ),
    "a camera that is no table": (
        ("[capture]", "[cameras]\nsecond = 3\n\n[capture]"),
        "cameras.second",
        ["is 3; it must be a table of name = value"],
    ),
    "backend that is no text": (
        ('backend = "simulated"\nsize = [1600', "backend = 3\nsize = [1600"),
        "cameras.zenith.backend",
        ["is 3; it must be text in quotes"],
    ),
    "one distance as a plain table": (
        ("[capture]", DISTANCE.replace("[[distances]]", "[distances]")),
        "distances",
        ["is a table; it must be a list of tables, each under [[distances]]"],
    ),
    "radius 0": (
        ("radius_m = 6.0", "radius_m = 0"),
        "screen.radius_m",
        ["is 0; it must be 0.1 or more"],
    ),
    "maps of 100 px": (
        ("radius_m = 6.0", "map_size = 100"),
        "screen.map_size",
        ["is 100; it must be a multiple of 64"],
    ),
    "radius NaN": (("radius_m = 6.0", "radius_m = nan"), "screen.radius_m", ["is nan", "finite"]),
    "radius in words": (
        ("radius_m = 6.0", 'radius_m = "six"'),
        "screen.radius_m",
        ["is 'six'", "number"],
    ),
    "size of three": (
        ("c = [802.8, 797.4]", "c = [802.8, 797.4, 3.0]"),
        "cameras.zenith.c",
        ["at most 2 of them"],
    ),
}


class TestMistakes:
    @pytest.mark.parametrize("case", MISTAKES)
    def test_one_line_each(self, tmp_path: Path, case: str) -> None:
        change, where, words = MISTAKES[case]
        lines = mistakes(tmp_path, edit(*change))
        mine = [
            line for line in lines if line.startswith(f"{tmp_path / 'venue.toml'}: {where} is ")
        ]
        assert len(mine) == 1, lines
        for word in words:
            assert word in mine[0]
        assert not any(pydantic in mine[0] for pydantic in ("Input", "should", "permitted"))
        for line in lines:
            assert line.startswith(f"{tmp_path / 'venue.toml'}: ")

    def test_without_a_backend_devices_are_driven_by_hand(self, tmp_path: Path) -> None:
        text = PLAIN[: PLAIN.index("[simulated]")].replace('backend = "simulated"\n', "")
        venue = load_venue_of(tmp_path, text)
        assert venue.table.cameras["zenith"].backend == "by-hand"
        assert venue.table.projectors["south"].backend == "by-hand"
        assert venue.backends == {}

    def test_all_mistakes_at_once(self, tmp_path: Path) -> None:
        text = edit("radius_m = 6.0", "radius_m = 0")
        text = edit("bits = 16", "bits = 99", text)
        text = edit('name = "left"', 'title = "left"', text)
        lines = mistakes(tmp_path, text)
        paths = {line.split(": ")[1].split(" is ")[0] for line in lines}
        assert paths == {
            "screen.radius_m",
            "cameras.zenith.bits",
            "fiducials.1.name",
            "fiducials.1.title",
        }
        assert len(lines) == 4

    def test_all_broken_references_at_once(self, tmp_path: Path) -> None:
        text = edit("k = [0.02, -0.008, 0.001, 0]", "k = [0.02]")
        text = edit('camera = "zenith"', 'camera = "nadir"', text)
        assert len(mistakes(tmp_path, text)) == 4

    @pytest.mark.parametrize(
        "text", ["radius_m = = 6", "[screen", 'kind = "dome', "a = 1\na = 2", "x = 08"]
    )
    def test_bad_toml(self, tmp_path: Path, text: str) -> None:
        (line,) = mistakes(tmp_path, text)
        assert line.startswith(f"{tmp_path / 'venue.toml'} is not valid TOML: ")

    def test_a_file_that_is_not_text(self, tmp_path: Path) -> None:
        (tmp_path / "venue.toml").write_bytes(b"\xff\xfe\x00")
        with pytest.raises(InputError, match=r"venue\.toml is not valid TOML"):
            load_venue(tmp_path)

    @pytest.mark.parametrize("text", ["", "cameras = 3\nprojectors = [1]", "screen = 1"])
    def test_an_almost_empty_file(self, tmp_path: Path, text: str) -> None:
        assert len(mistakes(tmp_path, text)) >= 4

    def test_no_file(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match=r"venue\.toml: no such file.*procam init") as caught:
            load_venue(tmp_path)
        assert "\n" not in str(caught.value)

    def test_a_device_may_not_call_its_backend_as_a_table_of_the_file(self, tmp_path: Path) -> None:
        """Backend "screen" would have the [screen] table cut out from under the validator."""
        text = edit(
            '[projectors.south]\nbackend = "simulated"', '[projectors.south]\nbackend = "screen"'
        )
        venue = load_venue_of(tmp_path, text)
        assert venue.screen.radius_m == 6.0
