"""What gets into a bundle, and what does not."""

import json
from dataclasses import replace
from pathlib import Path

import bundles
import numpy as np
import pytest
from bundles import WHITE, contents, make_venue, take_session, write_bundle
from edited_files import rewrite

from procam.errors import FileFormatError, InputError
from procam.estimate.media_server.dome_master import DomeMaster, plan_server
from procam.estimate.structured_light.patterns import plan_session
from procam.files.bundle.read import open_bundle
from procam.files.bundle.redact import shared_plan
from procam.files.images.photos import load_response
from procam.files.images.pixels import read_image, write_image
from procam.files.session import Session
from procam.files.toml import read_toml
from procam.files.venue.load import Venue, load_venue
from procam.files.venue.masks import projector_masks
from procam.model.plan import Plan
from simulators.room_obj import obj_text
from simulators.scene import SceneSize
from simulators.template import walls_text

OLD, NEW = "0" * 64, "1" * 64  # hashes of an input


@pytest.fixture
def venue(tmp_path: Path) -> Venue:
    return make_venue(tmp_path / "venue")


@pytest.fixture
def session(venue: Venue) -> Session:
    return take_session(venue)


def test_the_same_session_gives_the_same_bytes(
    venue: Venue, session: Session, tmp_path: Path
) -> None:
    for name in ("a.zip", "b.zip"):
        write_bundle(venue, session, tmp_path / name)
    elsewhere = make_venue(tmp_path / "elsewhere")
    write_bundle(elsewhere, take_session(elsewhere, "0007"), tmp_path / "c.zip")
    first = (tmp_path / "a.zip").read_bytes()
    assert first == (tmp_path / "b.zip").read_bytes() == (tmp_path / "c.zip").read_bytes()


def test_all_that_a_solve_reads_comes_back(venue: Venue, session: Session, tmp_path: Path) -> None:
    write_bundle(venue, session, tmp_path / "out.zip")
    manifest = open_bundle(tmp_path / "out.zip", tmp_path / "new")
    assert (manifest.frames, manifest.planned) == (3, 3)
    opened, again = load_venue(tmp_path / "new"), Session(tmp_path / "new" / "sessions" / "0001")
    assert (
        opened.cameras["zenith"].lens.focal.tolist() == venue.cameras["zenith"].lens.focal.tolist()
    )
    assert opened.fiducials[0].azimuth == venue.fiducials[0].azimuth
    assert again.read_plan() == session.read_plan()
    assert np.array_equal(again.pattern(bundles.WHITE), session.pattern(bundles.WHITE))
    for shot, exposure in again.stored("zenith"):
        (planned,) = (s for s in again.read_plan().shots if s.id == shot)
        frames = [s.load("zenith", planned, exposure, (60, 60)) for s in (session, again)]
        assert np.array_equal(frames[0].counts, frames[1].counts)
        assert frames[0].settings == frames[1].settings
        assert frames[0].started_s - frames[1].started_s == 2e9
    assert np.array_equal(projector_masks(opened)["south"].covered, np.eye(64, dtype=bool)[:40])
    assert opened.table.screen.protected[1] == "masks/2.png"
    assert opened.table.screen.protected[0] == venue.table.screen.protected[0]
    table = opened.table.cameras["zenith"].response
    assert load_response(table, opened.directory)[1].tolist() == [0, 0.25, 1]  # type: ignore[index]


def test_a_response_solved_from_brackets_is_a_table(
    venue: Venue, session: Session, tmp_path: Path
) -> None:
    rewrite(venue.directory / "venue.toml", '"annika.csv"', '"solve"\nbrackets = "annika"')
    for kept in (False, True):
        if kept:
            solved = session.directory / "captures" / "zenith" / "response.csv"
            solved.write_text((venue.directory / "annika.csv").read_text())
        write_bundle(load_venue(venue.directory), session, tmp_path / f"{kept}.zip")
        open_bundle(tmp_path / f"{kept}.zip", tmp_path / str(kept))
        camera = read_toml(tmp_path / str(kept) / "venue.toml")["cameras"]["zenith"]
        assert "brackets" not in camera
        assert camera["response"] == ("responses/1.csv" if kept else "linear")


def test_figures_of_the_calibration_of_the_session_get_in(
    venue: Venue, session: Session, tmp_path: Path
) -> None:
    for number, (of, source, m) in enumerate(
        [("0001", OLD, 0.1), ("0001", NEW, 0.2), ("0001", NEW, 0.3), ("0002", NEW, 0.4)]
    ):
        folder = venue.directory / "calibrations" / f"{number + 1:04d}"
        folder.mkdir(parents=True)
        document = {
            "feedback": {"value": [m] * 3},
            "quality": {"coverage": {"value": 0.9, "note": "by annika"}},
            "provenance": {"session": of, "input_sha256": source, "notes": ["annika"]},
        }
        (folder / "calibration.json").write_text(json.dumps(document))
    write_bundle(venue, session, tmp_path / "out.zip")
    text = contents(tmp_path / "out.zip")["original/calibration.json"]
    found = json.loads(text)
    assert (
        found["feedback"]["value"][0] == 0.2
    )  # the next was refined, the last is of another session
    assert found["quality"]["coverage"]["value"] == 0.9
    assert found["provenance"]["input_sha256"] == NEW
    assert b"annika" not in text


def test_a_hash_that_equals_nothing(venue: Venue, session: Session, tmp_path: Path) -> None:
    folder = venue.directory / "calibrations" / "0001"
    folder.mkdir(parents=True)
    (folder / "calibration.json").write_text(
        '{"provenance": {"session": "0001", "input_sha256": NaN}}'
    )
    write_bundle(venue, session, tmp_path / "out.zip")
    found = json.loads(contents(tmp_path / "out.zip")["original/calibration.json"])
    assert found["provenance"]["input_sha256"] is None


@pytest.mark.parametrize(
    ("entry", "where"),
    [
        ('masks = ["../secret.png"]', "projectors.south.masks"),
        ('masks = ["link.png"]', "projectors.south.masks"),
        ('masks = ["{absolute}"]', "projectors.south.masks"),
    ],
)
def test_files_outside_the_venue_are_refused_by_name(
    venue: Venue, session: Session, tmp_path: Path, entry: str, where: str
) -> None:
    write_image(tmp_path / "secret.png", np.ones((40, 64), np.uint8))
    (venue.directory / "link.png").symlink_to(tmp_path / "secret.png")
    entry = entry.replace("{absolute}", str(tmp_path / "secret.png"))
    rewrite(venue.directory / "venue.toml", 'masks = ["annika/desk.png"]', entry)
    with pytest.raises(InputError, match=f"{where} names .*outside the venue's folder; copy"):
        write_bundle(load_venue(venue.directory), session, tmp_path / "out.zip")
    assert not (tmp_path / "out.zip").exists()


def test_a_response_outside_the_venue_is_refused(
    venue: Venue, session: Session, tmp_path: Path
) -> None:
    (venue.directory / "annika.csv").rename(tmp_path / "annika.csv")
    rewrite(venue.directory / "venue.toml", "annika.csv", "../annika.csv")
    with pytest.raises(InputError, match=r"cameras\.zenith.response names \.\./annika\.csv"):
        write_bundle(load_venue(venue.directory), session, tmp_path / "out.zip")


def test_a_session_without_frames_is_refused(
    venue: Venue, session: Session, tmp_path: Path
) -> None:
    for frame in session.directory.glob("captures/*/*.tif"):
        frame.unlink()
    with pytest.raises(InputError, match="no frames are stored"):
        write_bundle(venue, session, tmp_path / "out.zip")


def test_a_session_that_lacks_a_frame_is_bundled(
    venue: Venue, session: Session, tmp_path: Path
) -> None:
    (session.directory / "captures" / "zenith" / "dark@6.5.tif").unlink()
    manifest = write_bundle(venue, session, tmp_path / "out.zip")
    assert (manifest.frames, manifest.planned) == (2, 3)
    index = contents(tmp_path / "out.zip")["sessions/0001/captures/zenith/index.jsonl"]
    assert b"6.5" not in index


def test_an_edited_frame_is_refused_and_nothing_is_left(
    venue: Venue, session: Session, tmp_path: Path
) -> None:
    frame = session.directory / "captures" / "zenith" / "dark@0.13.tif"
    write_image(frame, read_image(frame) + np.uint16(1))
    with pytest.raises(FileFormatError, match="differs from the frame captured"):
        write_bundle(venue, session, tmp_path / "out" / "out.zip")
    assert list((tmp_path / "out").iterdir()) == []


def test_names_that_some_systems_cannot_have_are_refused(tmp_path: Path) -> None:
    venue = make_venue(tmp_path / "venue")
    rewrite(venue.directory / "venue.toml", "zenith", "con")
    session = take_session(venue)
    (session.directory / "captures" / "zenith").rename(session.directory / "captures" / "con")
    with pytest.raises(FileFormatError, match=r"cannot hold '.*/con/.*'.*rename the camera"):
        write_bundle(load_venue(venue.directory), session, tmp_path / "out.zip")


def test_what_procam_notes_about_patterns_stays_in_the_plan() -> None:
    server = plan_server(DomeMaster("south", 512), 0.1, 2.0)
    plans = [plan_session({"south": (64, 40)}, 0.1, 2.0), server]
    for plan, _ in plans:
        assert shared_plan(plan) == plan
    noted = replace(WHITE, detail={"number": 3, "code": "micro-phase", "by": "annika"})
    assert shared_plan(Plan((noted,))).shots[0].detail == {"code": "micro-phase", "number": 3}


def test_a_mesh_goes_without_the_words_of_its_file(tmp_path: Path) -> None:
    """Its parts have numbers for names, but those of usual walls."""
    size = SceneSize(camera_size=(60, 60), projector_size=(64, 40), rays=64)
    text = walls_text("L", size).split("[simulated]")[0]
    text = text.replace('backend = "simulated"', 'backend = "by-hand"')
    text = text.replace('control = { protocol = "escvp21", port = "backend" }', "")
    text = text.replace('"inner-front", "floor"]', '"annikas-wall", "floor"]')
    text = text.replace("other_albedo =", "others = {inner-right = [0.3, 0.1]}\nother_albedo =")
    folder = tmp_path / "venue"
    folder.mkdir()
    (folder / "venue.toml").write_text(text, "utf-8")
    mesh = obj_text().replace("g inner-front", "# annika\ng annikas wall")
    (folder / "room.obj").write_text(mesh, "utf-8")
    venue = load_venue(folder)
    write_bundle(venue, take_session(venue), tmp_path / "out.zip")
    for name, content in contents(tmp_path / "out.zip").items():
        assert b"annika" not in content, name
    open_bundle(tmp_path / "out.zip", tmp_path / "new")
    opened = load_venue(tmp_path / "new").screen
    assert opened.lit == ("front", "part-2", "floor")  # type: ignore[union-attr]
    assert ("part-1", 0.3, 0.1) in opened.others  # type: ignore[union-attr]
    assert opened.size == venue.screen.size  # type: ignore[union-attr]
