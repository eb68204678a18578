"""`procam refine` and `procam state` of a venue that people drive, round by round."""

import errno
import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import photographer
import pytest
from edited_files import rewrite
from exact_room import coarse_rooms
from linear_pictures import write_picture
from looped_dome import SIZE, broad, quick_loop
from tiny_venue import (
    CAMERA,
    drift,
    make_venue,
    procam,
    refused,
    solved,
    take_session,
)

from procam.estimate.closed_loop.refined import with_scatter
from procam.files.calibration import load_calibration, save_calibration
from procam.files.images.photos import read_photo
from procam.files.images.pixels import read_image, write_image
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.generators import result_of
from procam.model.frame import CameraSettings, Frame
from procam.workflows.audience import measure_state
from procam.workflows.photographs.driven import DrivenPhotographer, Wanted
from procam.workflows.photographs.open import HandPhotographer
from procam.workflows.photographs.orders import PhotographsWanted
from procam.workflows.photographs.rounds import Rounds
from procam.workflows.venue_rig import open_rig

# so that slates are read
LARGER = replace(SIZE, projector_size=(240, 150), camera_size=(288, 288))
TOO_BRIGHT = 1.1  # scattered light that the calibration expects, over the dome's
DRIVEN = "backend = ", "control = "


@pytest.fixture(scope="module", autouse=True)
def quick() -> Iterator[None]:
    with coarse_rooms(), quick_loop():
        yield


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory, quick: None) -> Path:
    """A dome that devices drive, with a calibration and one that is wrong."""
    venue = make_venue(tmp_path_factory.mktemp("driven"), size=LARGER)
    good = solved(venue, take_session(venue))
    wrong = with_scatter(load_calibration(good), np.full(3, TOO_BRIGHT))
    save_calibration(wrong, good.with_name("0002"))
    drift(venue.directory)  # what people photograph has noise of its own
    return venue.directory


@pytest.fixture
def by_hand(driven: Path, tmp_path: Path) -> Path:
    """The same dome with people."""
    return with_people(driven, tmp_path / "by-hand")


@pytest.fixture(scope="module")
def first_round(driven: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its first round of refine is asked for, and photographed in the folder card."""
    folder = with_people(driven, tmp_path_factory.mktemp("first") / "by-hand")
    photographed(driven, run("refine", folder), folder / "card")
    return folder


def with_people(driven: Path, folder: Path) -> Path:
    """A copy of a venue, driven by hand."""
    shutil.copytree(driven, folder)
    text = (driven / "venue.toml").read_text("utf-8").partition("[simulated]")[0]
    lines = (line for line in text.splitlines() if not line.startswith(DRIVEN))
    (folder / "venue.toml").write_text("\n".join([*lines, ""]), "utf-8")
    return folder


def photographed(driven: Path, ran: dict[str, Any], photos: Path) -> Path:
    """Photographs of what a round asks for."""
    photographer.main(driven, Path(ran["order"]).parent, photos)
    return photos


def dated(card: Path, folder: Path, day: str, more: int = 0) -> Path:
    """The photographs of a folder by a camera with a clock, brighter by some counts."""
    folder.mkdir()
    for path in sorted(card.iterdir()):
        pixels, minute = np.array(read_image(path)), int(path.stem.partition("_")[2])
        when = {"Exif:DateTimeOriginal": f"{day} 12:{minute:02d}:00"}
        exposure_s = read_photo(path).exposure_s
        assert exposure_s is not None
        photographer.write_photo(folder / path.name, pixels + np.uint16(more), exposure_s, **when)
    return folder


def run(*arguments: object) -> dict[str, Any]:
    ran = procam(*arguments, "--json")
    assert ran.code in {0, 1} and not ran.err, ran  # 1: so small a dome misses a goal
    return dict(json.loads(ran.out))


def test_refine_by_hand_finds_what_the_loop_finds(driven: Path, by_hand: Path) -> None:
    write_picture(by_hand / "broad.exr", broad())
    again = "refine", by_hand, "--picture", by_hand / "broad.exr"
    found, rounds = run(*again), 0
    assert found["wanted"][0] == {
        "picture": "dark",
        "projectors": [],
        "photographs": 4,
        "exposure_s": found["wanted"][0]["exposure_s"],
    }
    assert [row["picture"] for row in found["wanted"]] == ["dark", "01", "02"]
    while "wanted" in found:
        rounds += 1
        assert rounds <= 10
        photos = photographed(driven, found, by_hand / f"card-{rounds}")
        found = run(*again, "--photos", photos)
    assert rounds >= 5
    assert found["calibration"].endswith("0003")
    assert found["figures"]["loop_level"]["value"] == pytest.approx(1, abs=0.05)
    good, refined = (
        load_calibration(by_hand / "calibrations" / name).feedback.value
        for name in ("0001", "0003")
    )
    np.testing.assert_allclose(refined, good, rtol=0.03)
    assert "wanted" in run("refine", by_hand)  # the next one begins anew
    assert (by_hand / "sessions" / "refine-0002").is_dir()
    first = by_hand / "calibrations" / "0002"  # photographs of what has ended can still be replaced
    last = "--picture", by_hand / "broad.exr", "--photos", photos, "--replace"
    assert run("refine", first, *last)["calibration"].endswith("0004")


def test_a_state_by_hand_is_that_of_devices(driven: Path, by_hand: Path) -> None:
    first = by_hand / "calibrations" / "0001"  # another is in use
    asked = run("state", first, "full")
    lit = [row["projectors"] for row in asked["wanted"]]
    assert not any("slate" in row["picture"] for row in asked["wanted"])  # pictures differ much
    assert lit[:2] == [[], []] and {tuple(names) for names in lit[2:]} == {("south",), ("north",)}
    photos = photographed(driven, asked, by_hand / "card")
    found = run("state", first, "full", "--photos", photos)
    assert found["calibration"] == str(first.with_name("0003"))
    with open_rig(load_venue(driven)) as rig:
        calibration = load_calibration(driven / "calibrations" / "0001")
        work = DrivenPhotographer(rig, calibration)
        state, _ = result_of(measure_state(work, load_venue(driven), calibration, "full"))
    np.testing.assert_allclose(found["scatter_ratio"], state.scatter_ratio, atol=2e-3)
    assert (by_hand / "sessions" / "state-full-0001" / "ended").is_file()


def test_each_photograph_counts_once(by_hand: Path) -> None:
    camera = load_venue(by_hand).cameras[CAMERA]
    picture = {"south": np.full((150, 240, 3), 0.5, np.float32)}
    wanted = [Wanted(picture, 0.1), Wanted(picture, 0.1), Wanted({}, 0.1)]

    def rounds() -> Rounds:
        return Rounds.newest(by_hand, "refine", camera, 0.1, "a sky")

    photographer = HandPhotographer(rounds())
    photographer.plan(wanted)
    with pytest.raises(PhotographsWanted) as asked:
        photographer.take(wanted[0])
    assert [(row.picture, row.photographs) for row in asked.value.rows] == [("01", 2), ("dark", 1)]
    for number in range(3):
        counts = np.full((288, 288, 3), number, np.uint16)
        frame = Frame(counts, CameraSettings(0.1, "rgb"), 0.0, 0.1)
        rounds().session.store(CAMERA, rounds().asked[number].shot, 0.1, frame)
    photographer = HandPhotographer(rounds())
    given = [photographer.take(each).counts[0, 0, 0] for each in (wanted[2], *wanted[:2])]
    assert given == [2, 0, 1]
    assert photographer.retake(wanted[1]).counts[0, 0, 0] == 1
    with pytest.raises(PhotographsWanted) as asked:
        photographer.take(wanted[1])
    assert [(row.picture, row.photographs) for row in asked.value.rows] == [("01", 1)]


def test_what_to_do_is_said(by_hand: Path) -> None:
    ran = procam("refine", by_hand)
    assert (ran.code, ran.err) == (0, "")
    assert f"9 photographs by camera {CAMERA} are needed, in this order" in ran.out
    assert (
        "slate" not in ran.out
        and " 4 of " in ran.out
        and "s  dark" in ran.out
        and "01: north, south" in ran.out
    )
    assert f"then: procam refine {by_hand} --photos FOLDER" in ran.out


def _full_disk(*_: object) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


class TestRefusals:
    @pytest.fixture
    def by_hand(self, first_round: Path, tmp_path: Path) -> Path:
        shutil.copytree(first_round, tmp_path / "by-hand")
        return tmp_path / "by-hand"

    @pytest.fixture
    def card(self, by_hand: Path) -> Path:
        return by_hand / "card"

    def complaint(self, by_hand: Path, card: Path) -> str:
        ran = procam("refine", by_hand, "--photos", card)
        assert ran.code == 2, ran
        assert not list((by_hand / "sessions" / "refine-0001").glob("captures/*/*.tif"))
        return ran.complaint

    def test_one_too_few(self, by_hand: Path, card: Path) -> None:
        (card / "img_8.tif").unlink()
        said = self.complaint(by_hand, card)
        assert "8 photographs instead of 9: 4 of dark at" in said and "in this order" in said

    def test_two_pictures_exchanged(self, by_hand: Path, card: Path) -> None:
        for old, new in ((4, 99), (6, 4), (99, 6)):
            (card / f"img_{old}.tif").rename(card / f"img_{new}.tif")
        assert "should show the same picture" in self.complaint(by_hand, card)

    def test_photographs_of_the_round_before(self, by_hand: Path, card: Path) -> None:
        asked = run("refine", by_hand, "--photos", card)
        assert [row["photographs"] for row in asked["wanted"]] == [1, 4]
        for number in range(4):
            (card / f"img_{number}.tif").unlink()
        assert "img_4.tif: no readable number" in refused("refine", by_hand, "--photos", card)

    def test_a_photograph_of_the_round_before(
        self, driven: Path, by_hand: Path, card: Path
    ) -> None:
        photos = photographed(driven, run("refine", by_hand, "--photos", card), by_hand / "two")
        shutil.copy(card / "img_7.tif", photos / "img_3.tif")
        assert "img_3.tif was given for an earlier round" in refused(
            "refine", by_hand, "--photos", photos
        )

    def test_photographs_of_an_earlier_piece_of_work(
        self, driven: Path, by_hand: Path, card: Path
    ) -> None:
        """Those of last month's round, in the same order and at the same exposures."""
        run("refine", by_hand, "--photos", card)
        sessions = by_hand / "sessions"
        (sessions / "refine-0001" / "ended").touch()
        assert "refine-0002" in run("refine", by_hand)["order"]
        assert "img_4.tif was given as one of refine-0001 already; give the photo" in refused(
            "refine", by_hand, "--photos", card
        )
        assert not list(sessions.glob("refine-0002/captures/*/*.tif"))

    def test_photographs_taken_before_what_was_there(self, by_hand: Path, card: Path) -> None:
        first = dated(card, by_hand / "first", "2050:11:20")  # by a clock that is ahead
        run("refine", by_hand, "--photos", first)
        (by_hand / "sessions" / "refine-0001" / "ended").touch()
        run("refine", by_hand)
        earlier = dated(card, by_hand / "second", "2050:10:20", more=1)
        said = procam("refine", by_hand, "--photos", earlier).complaint
        assert "was taken on 2050-10-20 12:00, before the photographs of refine-0001" in said

    def test_old_photographs_have_a_note(self, by_hand: Path, card: Path) -> None:
        old = dated(card, by_hand / "old", "2020:10:20")
        ran = procam("refine", by_hand, "--photos", old)
        assert ran.code == 0 and "img_0.tif: of 2020-10-20 12:00 by the camera's clock" in ran.err

    def test_the_slate_of_another_picture(self, driven: Path, by_hand: Path, card: Path) -> None:
        """The player still shows what it showed before: photographs of it would look right."""
        ran = procam("refine", by_hand, "--photos", card)
        assert "a slate is the number of the next picture" in ran.out
        two = photographed(driven, run("refine", by_hand), by_hand / "two")
        asked = run("refine", by_hand, "--photos", two)
        assert [row["picture"] for row in asked["wanted"]] == ["04-slate", "04"]
        photos = photographed(driven, asked, by_hand / "three")
        shutil.copy(two / "img_0.tif", photos / "img_0.tif")
        assert "img_0.tif: the number 03, but the slate of" in refused(
            "refine", by_hand, "--photos", photos
        )

    def test_another_size(self, by_hand: Path, card: Path) -> None:
        pixels = read_image(card / "img_3.tif")
        write_image(card / "img_3.tif", np.ascontiguousarray(pixels[:200]))
        assert "288x200 px in 3 channels" in self.complaint(by_hand, card)

    def test_another_aperture_than_the_calibration_had(self, by_hand: Path, card: Path) -> None:
        known = by_hand / "sessions" / "0001" / "captures" / CAMERA / "settings.json"
        known.write_text('{"aperture f/": 4}', "utf-8")
        path = card / "img_3.tif"
        exposure_s = read_photo(path).exposure_s
        photographer.write_photo(path, np.array(read_image(path)), exposure_s, FNumber=5.6)
        said = self.complaint(by_hand, card)
        assert "img_3.tif: aperture f/5.6, but others have 4; only the shutter time" in said
        known.write_text('{"aperture f/": []}', "utf-8")
        assert "settings.json: damaged; remove it" in self.complaint(by_hand, card)

    def test_photographs_that_cannot_be_used(self, by_hand: Path, card: Path) -> None:
        """Light in the room at the end."""
        dark = np.array(read_image(card / "img_0.tif"))
        for number in range(4):
            write_image(card / f"img_{number}.tif", dark + np.uint16(500 + 1000 * (number % 2)))
        said = self.complaint(by_hand, card)
        assert "should show the same picture" in said
        for number in range(9):
            write_image(card / f"img_{number}.tif", np.full_like(dark, 4095))
        ran = procam("refine", by_hand, "--photos", card)
        folder = by_hand / "sessions" / "refine-0001"
        assert ran.code == 2 and "saturated" in ran.err
        assert (
            f"? Give other photographs of the last round with --photos and --replace, or remove {folder}"
            in (ran.err)
        )

    def test_another_exposure(self, by_hand: Path, card: Path) -> None:
        path = card / "img_5.tif"
        exposure_s = read_photo(path).exposure_s
        photographer.write_photo(path, np.array(read_image(path)), exposure_s / 2)
        assert "img_5.tif: exposed 0.3" in self.complaint(by_hand, card)

    def test_another_picture_has_rounds_of_its_own(self, by_hand: Path, card: Path) -> None:
        write_picture(by_hand / "broad.exr", broad())
        before = (by_hand / "sessions" / "refine-0001" / "wanted.json").read_bytes()
        complaint = refused("refine", by_hand, "--picture", by_hand / "broad.exr", "--photos", card)
        assert "run the command without --photos first" in complaint
        assert "refine-0001 has started, for another calibration or picture" in complaint
        other = run("refine", by_hand, "--picture", by_hand / "broad.exr")
        assert "refine-0002" in other["order"]
        assert (by_hand / "sessions" / "refine-0001" / "wanted.json").read_bytes() == before
        again = run("refine", by_hand, "--photos", card)
        assert "refine-0001" in again["order"]

    def test_a_photograph_that_is_gone_is_asked_for_alone(
        self, driven: Path, by_hand: Path, card: Path
    ) -> None:
        second = run("refine", by_hand, "--photos", card)
        third = run("refine", by_hand, "--photos", photographed(driven, second, by_hand / "two"))
        folder = by_hand / "sessions" / "refine-0001"
        (gone,) = folder.glob("captures/*/round-001-07@*.tif")
        gone.unlink()
        hole = run("refine", by_hand)
        assert [(row["picture"], row["photographs"]) for row in hole["wanted"]] == [
            ("02-slate", 1),
            ("02", 1),
        ]
        photos = photographed(driven, hole, by_hand / "three")
        path = photos / "img_1.tif"
        exposure_s, pixels = read_photo(path).exposure_s, np.array(read_image(path))
        pixels[0, 0] += 1  # two photographs are never the same, but simulated ones
        photographer.write_photo(path, pixels, exposure_s)
        last = run("refine", by_hand, "--photos", photos)
        assert [r["picture"] for r in third["wanted"]] == ["04-slate", "04"]
        assert [r["picture"] for r in last["wanted"]] == ["05-slate", "05"]  # never a number twice

    def test_photographs_are_replaced(self, driven: Path, by_hand: Path, card: Path) -> None:
        """Something was wrong with them, which showed only afterwards."""
        folder = by_hand / "sessions" / "refine-0001"
        assert "no photographs were given yet" in refused(
            "refine", by_hand, "--photos", card, "--replace"
        )
        second = run("refine", by_hand, "--photos", card)
        before = (folder / "wanted.json").read_bytes()
        (card / "img_8.tif").rename(by_hand / "img_8.tif")
        ran = procam("refine", by_hand, "--photos", card, "--replace")
        assert (ran.code, "8 photographs instead of 9" in ran.complaint) == (2, True)
        assert (folder / "wanted.json").read_bytes() == before
        (by_hand / "img_8.tif").rename(card / "img_8.tif")
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Session, "store", _full_disk)
            ran = procam("refine", by_hand, "--photos", card, "--replace")
            assert ran.code == 2 and (folder / "wanted.json").read_bytes() == before
        again = run("refine", by_hand, "--photos", card, "--replace")
        assert [row["picture"] for row in second["wanted"]] == ["03-slate", "03"]
        assert [row["picture"] for row in again["wanted"]] == ["04-slate", "04"]  # no number twice
        asked = json.loads((folder / "wanted.json").read_bytes())["photographs"]
        assert [a["round"] for a in asked] == 9 * [3] + 5 * [4]
        third = run("refine", by_hand, "--photos", photographed(driven, again, by_hand / "two"))
        assert [row["picture"] for row in third["wanted"]] == ["05-slate", "05"]
        assert "--replace: needs --photos" in refused("refine", by_hand, "--replace")

    def test_another_exposure_in_venue_toml_changes_no_unfinished_work(
        self, by_hand: Path, card: Path
    ) -> None:
        second = run("refine", by_hand, "--photos", card)
        rewrite(by_hand / "venue.toml", "exposure_s = 0.13", "exposure_s = 0.12")
        assert run("refine", by_hand)["wanted"] == second["wanted"]

    def test_ids_of_a_round_that_was_given_up_are_not_used_again(
        self, by_hand: Path, card: Path
    ) -> None:
        """Photographs of a replacement that was killed must not pass for those of the next round."""
        run("refine", by_hand, "--photos", card)
        folder, stored = by_hand / "sessions" / "refine-0001", list[object]()
        store = Session.store

        def killed(*arguments: Any) -> None:
            if stored:
                raise OSError(errno.ENOSPC, "No space left on device")
            store(*arguments)
            stored.append(arguments)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Session, "store", killed)
            procam("refine", by_hand, "--photos", card, "--replace")
        (
            by_hand / "sessions" / "refine-0001" / "captures" / CAMERA / "round-001-07@0.6552.tif"
        ).unlink()
        run("refine", by_hand)
        asked = json.loads((folder / "wanted.json").read_bytes())["photographs"]
        assert [a["round"] for a in asked] == 8 * [1] + [4]

    def test_pictures_that_are_gone(self, by_hand: Path, card: Path) -> None:
        run("refine", by_hand, "--photos", card)
        shutil.rmtree(by_hand / "sessions" / "refine-0001" / "pictures")
        assert "copy the folder pictures back" in refused("refine", by_hand)

    def test_nothing_was_asked_for(self, by_hand: Path, card: Path) -> None:
        assert "run the command without --photos first" in refused(
            "state", by_hand, "full", "--photos", card
        )

    def test_devices_take_their_own(self, driven: Path, card: Path) -> None:
        assert "all driven by hand; leave it out" in refused("refine", driven, "--photos", card)

    def test_a_damaged_round(self, by_hand: Path, card: Path) -> None:
        path = by_hand / "sessions" / "refine-0001" / "wanted.json"
        rewrite(path, "photographs", "pictures")
        assert "wanted.json: damaged" in refused("refine", by_hand)

    def test_another_camera(self, by_hand: Path, card: Path) -> None:
        rewrite(by_hand / "sessions" / "refine-0001" / "wanted.json", CAMERA, "other")
        assert "of camera other, but" in refused("refine", by_hand)
