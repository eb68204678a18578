"""`procam forecast`: its table, its JSON, its plot, and a line for everything that is wrong."""

import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from linear_pictures import write_picture
from picture_files import write_wide_gamut
from tiny_venue import procam, refused

from procam.files.calibration import save_calibration
from procam.files.images.pixels import read_image, write_image
from procam.interfaces.cli import _forecast_room as room_command
from procam.interfaces.cli import forecast as command
from procam.maths.geometry.sphere import master_solid_angles
from procam.maths.mesh.rooms import BOX
from procam.model.calibration import Calibration
from procam.model.photometry import AbsoluteColour
from procam.workflows import forecast_room
from procam.workflows.forecast import sampled
from procam.workflows.sample_content import half_sky

PLAN = ("--albedo", 0.5, "--coverage", 0.9)
WIDEST = 100
SIZE = 64


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures and maps of planned domes are small here."""
    whole = command.planned
    monkeypatch.setattr(command, "planned", lambda dome: whole(dome, SIZE))
    monkeypatch.setattr(command, "sampled", lambda picture: sampled(picture, SIZE))


@pytest.fixture
def sky(tmp_path: Path) -> Path:
    write_picture(tmp_path / "sky.png", half_sky(128))
    return tmp_path / "sky.png"


@pytest.fixture
def venue(calibration: Calibration, tmp_path: Path) -> Path:
    save_calibration(calibration, tmp_path / "venue" / "calibrations" / "0001")
    return tmp_path / "venue"


def _document(*arguments: object) -> dict[str, Any]:
    ran = procam("forecast", *arguments, "--json")
    assert (ran.code, ran.err) == (0, ""), ran
    document = json.loads(ran.out, parse_constant=pytest.fail)  # no NaN, no Infinity
    assert isinstance(document, dict)
    return document


def _said(*arguments: object) -> str:
    ran = procam("forecast", *arguments)
    assert (ran.code, ran.err) == (0, ""), ran
    lines = (line for line in ran.out.splitlines() if not line.startswith("/"))  # a path
    assert max(map(len, lines)) <= WIDEST
    return ran.out


class TestPlanned:
    def test_lumens_and_radius_make_it_luminance(self) -> None:
        message = _document(*PLAN, "--lumens", 60000, "--radius-m", 8)
        area = 0.9 * 2 * np.pi * 64
        assert message["unit"] == "cd/m2"
        white = message["light"]["white_after"]
        assert white["value"] == pytest.approx(0.5 * 60000 / (np.pi * area))
        assert white["low"] == pytest.approx(white["value"] * (1 - 2 * 1.96 * 0.03))
        assert any("60000 lm, all on the 361.9 m2" in text for text in message["assumptions"])

    def test_the_table_says_what_the_document_says(self, sky: Path) -> None:
        said, message = _said(*PLAN, sky), _document(*PLAN, sky)
        light, picture = message["light"], message["pictures"][str(sky)]
        board = light["checkerboard_before"]
        row = "{value:.3g}:1 ({low:.3g} .. {high:.3g})".format(**board)
        assert re.search(rf"black beside white, half each +{re.escape(row)} ", said)
        assert "does not change the contrast of black beside white" in said
        clipped = {k: 100 * v for k, v in picture["clipped_black"].items()}
        assert "{value:.1f} % ({low:.1f} .. {high:.1f})".format(**clipped) in said
        assert re.search(r"can be shown without clipping +no\n", said)
        for text in message["assumptions"]:
            assert text.split()[0] in said.partition("assumed:")[2]

    def test_what_does_not_exist_is_null_and_a_dash(self, tmp_path: Path) -> None:
        grey = tmp_path / "grey.exr"
        write_image(grey, np.full((32, 32, 3), 0.5, np.float32), ("R", "G", "B"))
        restored = _document(*PLAN, grey)["pictures"][str(grey)]["contrast_restored"]
        assert restored == {"value": None, "low": None, "high": None}
        said = _said(*PLAN, grey)
        assert re.search(r"lost contrast restored +-\n", said)
        assert re.search(r"can be shown without clipping +yes\n", said)

    def test_what_only_one_end_allows(self, tmp_path: Path) -> None:
        """A dark just above the least that the middle of the band allows.

        m = 0.3, so that t = (m / (1 + m)) (1 + t) / 2 + 1 / 2000 at 0.1310.
        """
        halves = np.full((64, 64, 3), 1.0, np.float32)
        halves[:, :32] = 0.132
        write_image(tmp_path / "halves.exr", halves, ("R", "G", "B"))
        wide = (*PLAN, "--floor-albedo", 0, "--albedo-sigma", 0.05, tmp_path / "halves.exr")
        picture = next(iter(_document(*wide)["pictures"].values()))
        assert (picture["unclipped"]["low"], picture["unclipped"]["high"]) == (False, True)
        assert "but not at both ends" in _said(*wide)


class TestRoom:
    BOX = ("--box", 6, 4, 3, "--albedo", 0.6)

    @pytest.fixture(autouse=True)
    def coarse(self, monkeypatch: pytest.MonkeyPatch) -> None:
        whole = room_command.room_prospect
        monkeypatch.setattr(room_command, "room_prospect", lambda plan, _: whole(plan, 140))
        monkeypatch.setattr(forecast_room, "FACES", 500)

    def test_all_walls_of_one_albedo(self) -> None:
        """Each bounce in a closed room returns the albedo's share."""
        lit = [x for part in BOX for x in ("--lit", part)]
        light = _document(*self.BOX, *lit, "--lumens", 10000)["light"]
        for name, albedo in (
            ("low", 0.6 - 1.96 * 0.03),
            ("value", 0.6),
            ("high", 0.6 + 1.96 * 0.03),
        ):
            assert light["feedback"][name] == pytest.approx(albedo / (1 - albedo), rel=2e-3)
        direct = 0.6 * 10000 / (np.pi * 108)
        assert light["white_after"]["value"] == pytest.approx(direct, rel=5e-3)
        assert light["white_before"]["value"] == pytest.approx(direct / 0.4, rel=5e-3)
        # as on a dome where all that reflects is lit, though not by one scalar
        assert light["checkerboard_before"]["value"] == pytest.approx((1 + 0.75) / 0.75, rel=0.02)

    def test_a_picture_and_the_plot(self, tmp_path: Path) -> None:
        walls = np.zeros((30, 140, 3), np.float32)
        walls[:, :40] = 1.0
        write_image(tmp_path / "walls.exr", walls, ("R", "G", "B"))
        said = _said(*self.BOX, tmp_path / "walls.exr", "--out", tmp_path / "out")
        assert "albedo 0.6 with sigma 0.03 of front, left, right, 0.2 of the rest" in said
        assert "canvas 14 x 3 m" in said and "too bright (clips at black)" in said
        assert "contrast of black beside white: it dims" not in said  # so it is on domes
        assert read_image(tmp_path / "out" / "forecast.png").shape[1] > 900

    def test_a_cylinder(self) -> None:
        message = _document("--cylinder", 5, 120, 3, "--albedo", 0.6)
        assert any("canvas 10.47 x 3 m" in text for text in message["assumptions"])
        assert 0.03 < message["light"]["feedback"]["value"] < 0.1

    def test_a_panorama(self) -> None:
        message = _document("--cylinder", 5, 360, 3, "--albedo", 0.6, "--contrast", "inf")
        assert message["light"]["on_off_before"]["value"] is None  # infinite

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            (("--cylinder", 5, 2.09, 3, "--albedo", 0.5), "an arc of 2.09 degrees; 10 to 360"),
            (("--box", 6000, 4000, 3000, "--albedo", 0.5), "Are they millimetres?"),
            (("--box", 200, 4, 3, "--lit", "front", "--albedo", 0.5), "one side may be 50 times"),
            (("--lit", "front", "--albedo", 0.5), "are of a room; give --box too"),
            (
                ("--box", 6, 4, 3, "--cylinder", 5, 90, 3, "--albedo", 0.5),
                "are two rooms; give one of them",
            ),
            (("--box", 6, 4, 3), "forecast of a room needs --albedo"),
            (("--box", 6, 4, 3, "--albedo", 0.5, "--radius-m", 3), "--radius-m: only for domes"),
            (("--box", 6, 0, 3, "--albedo", 0.5), "box: 6 x 0 x 3 m; all lengths must be above 0"),
            (("--box", 6, 4, 3, "--albedo", 0.5, "--lit", "roof"), "name some of left, front"),
            (
                ("--cylinder", 5, 120, 3, "--albedo", 0.5, "--lit", "floor"),
                "of a cylinder the wall is lit",
            ),
            (("--box", 6, 4, 3, "--albedo", 0.97), "give a smaller --albedo-sigma, or another"),
            (("--box", 6, 4, 3, "--albedo", 0.03), "must stay between 0 and 0.999"),
            (
                ("--box", 6, 4, 3, "--albedo", 0.5, "--other-albedo", 1),
                "--other-albedo is 1; between 0 and",
            ),
            (("--box", 6, 4, 3, "--albedo", 0.5, "--contrast", 1), "must be above 1, such as 2000"),
            (("--box", 6, 4, 3, "--albedo", 0.5, "--lumens", -1), "--lumens is -1; the sum"),
        ],
    )
    def test_what_is_no_room(self, arguments: tuple[object, ...], words: str) -> None:
        assert words in refused("forecast", *arguments)

    def test_of_a_venue_that_is_calibrated(self, venue: Path) -> None:
        assert "is a venue, and --box" in refused("forecast", venue, *self.BOX)

    def test_a_picture_of_whole_pixels(self, tmp_path: Path) -> None:
        write_image(tmp_path / "a.exr", np.zeros((19, 100, 3), np.float32), ("R", "G", "B"))
        _document("--box", 16, 4, 3, "--lit", "front", "--albedo", 0.6, tmp_path / "a.exr")

    def test_a_picture_of_another_aspect(self, sky: Path) -> None:
        assert "the canvas of this room 14 x 3 m; make it 128 x 27 (--out draws where" in refused(
            "forecast", *self.BOX, sky
        )


class TestMeasured:
    def test_a_calibration_gives_all(self, venue: Path, sky: Path) -> None:
        message = _document(venue, sky)
        feedback = message["light"]["feedback"]
        weights = np.array([0.2126, 0.7152, 0.0722])
        assert feedback["value"] == pytest.approx(weights @ [0.3, 0.33, 0.4])
        half = 1.96 * weights @ [0.002, 0.003, 0.004]
        assert feedback["high"] - feedback["low"] == pytest.approx(2 * half)
        assert set(message["pictures"]) == {str(sky)}
        assert any("calibrations/0001" in text for text in message["assumptions"])

    def test_with_lumens_the_radius_is_its_own(self, venue: Path, calibration: Calibration) -> None:
        message = _document(venue, "--lumens", 20000)
        assert any("radius 6 m" in text for text in message["assumptions"])
        maps = calibration.maps
        area = 36 * float((master_solid_angles(maps.size) * maps.coverage).sum())
        albedo = 0.2126 * 0.46 + 0.7152 * 0.5 + 0.0722 * 0.57
        expected = albedo * 20000 / (np.pi * area)
        assert message["light"]["white_after"]["value"] == pytest.approx(expected)

    def test_its_own_options_are_refused(self, venue: Path) -> None:
        assert "--albedo, --coverage, --radius-m cannot be combined with" in refused(
            "forecast", venue, *PLAN, "--radius-m", 5
        )

    def test_without_a_calibration(self, tmp_path: Path) -> None:
        assert "has no calibration.json; a calibration directory" in refused("forecast", tmp_path)


class TestFiles:
    def test_plot_and_document(self, sky: Path, tmp_path: Path) -> None:
        out = tmp_path / "new" / "out"
        for _ in range(2):  # a second time in the same place
            said = _said(*PLAN, sky, "--out", out)
        assert "forecast.png and " in said
        assert sorted(p.name for p in out.iterdir()) == ["forecast.json", "forecast.png"]
        assert json.loads((out / "forecast.json").read_text()) == _document(*PLAN, sky)
        picture = np.asarray(read_image(out / "forecast.png"))
        alone = tmp_path / "alone"
        _said(*PLAN, "--out", alone)
        assert picture.shape[0] > 1.5 * np.asarray(read_image(alone / "forecast.png")).shape[0]
        assert picture.std() > 10  # something is drawn

    def test_without_matplotlib_nothing_is_written(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setitem(sys.modules, "matplotlib", None)
        assert 'run: pip install "procam[report]"' in refused(
            "forecast", *PLAN, "--out", tmp_path / "out"
        )
        assert not (tmp_path / "out").exists()


class TestRefusals:
    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            (("--albedo", 0.5), "forecast needs --albedo and --coverage, or a VENUE"),
            ((*PLAN, "--lumens", 9), "--lumens needs --radius-m"),
            (
                (*PLAN, "--lumens", 0, "--radius-m", 5),
                "--lumens is 0; the sum of all projectors is above 0",
            ),
        ],
    )
    def test_one_line_each(self, arguments: tuple[object, ...], words: str) -> None:
        assert words in refused("forecast", *arguments)

    def test_a_picture_that_is_not_square(self, tmp_path: Path) -> None:
        write_image(tmp_path / "wide.png", np.zeros((10, 20, 3), np.uint8))
        assert "wide.png: 20x10 px is no dome master" in refused(
            "forecast", *PLAN, tmp_path / "wide.png", "--out", tmp_path / "out"
        )
        assert not (tmp_path / "out").exists()


def test_a_venue_with_a_hand_meter_is_forecast_in_its_units(
    calibration: Calibration, venue: Path
) -> None:
    relative = _document(venue)["light"]["white_before"]["value"]
    matrix = np.array([[5.0, 4, 2], [3.0, 7, 1], [0.1, 1, 9]])  # white of 11 cd/m2
    metered = replace(calibration, absolute=AbsoluteColour(matrix, 1e-4 * np.eye(9)))
    save_calibration(metered, venue / "calibrations" / "0002")
    document = _document(venue)
    assert document["unit"] == "cd/m2"
    assert document["light"]["white_before"]["value"] == pytest.approx(11 * relative)
    assert "by a hand meter 1.0 is 11 cd/m2, as direct light" in document["assumptions"]
    assert _document(f"{venue}@1")["unit"] == "x direct white"


def test_a_picture_of_other_primaries_is_converted_and_named(tmp_path: Path) -> None:
    ran = procam("forecast", *PLAN, write_wide_gamut(tmp_path / "wide.exr", SIZE), "--json")
    assert "has the colour profile Rec.2020" in json.loads(ran.out)["assumptions"][-1]
