"""`procam session plan VENUE` and `procam session add`, with a photographer who knows only the pictures."""

import csv
import json
import shutil
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import photographer
import pytest
from picture_files import write_with_header
from scipy.ndimage import gaussian_filter, map_coordinates
from tiny_venue import (
    CAMERA,
    TINY,
    TINY_PAIR,
    Ran,
    contents,
    make_venue,
    procam,
    refused,
    solved,
    take_session,
)

from procam.estimate.comparison.compare import compare_calibrations
from procam.files.calibration import load_calibration
from procam.files.images.pixels import read_image, write_image
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.maths.light.curves import srgb_encode
from procam.workflows.capture.decoded import DECODED_BITS, with_decoded_bits

PANEL, PHOTO = (160, 100), (240, 200)
SIZE = replace(TINY_PAIR, projector_size=PANEL, camera_size=PHOTO)
SHOTS, EXPOSURES = 76, 78  # the first and the last shot have two
BITS, BLACK = 12, 64.0
GAMMA, BLUR_PX, NOISE_DN = 2.2, 0.6, 4.0


@dataclass(frozen=True)
class HandSession:
    """What lies on the disk after `procam session plan`: the session, and the folder for the rig."""

    session: Path
    out: Path

    def order(self) -> list[dict[str, str]]:
        return list(csv.DictReader((self.out / "order.csv").read_text().splitlines()))

    def shots(self) -> list[str]:
        return [entry["shot"] for entry in self.order()]

    def ingest(self, photos: Path, *more: object) -> Ran:
        return procam("session", "add", self.session, "--camera", CAMERA, "--photos", photos, *more)

    def stored(self) -> list[str]:
        frames = Session(self.session).stored(CAMERA)
        return sorted(f"{shot}@{exposure:g}" for shot, exposure in frames)


def start(folder: Path) -> HandSession:
    make_venue(folder, size=SIZE)
    ran = procam("session", "plan", folder, folder / "out", "--json")
    assert (ran.code, ran.err) == (0, "")
    return HandSession(Path(json.loads(ran.out)["session"]), folder / "out")


@pytest.fixture(scope="module")
def started(tmp_path_factory: pytest.TempPathFactory) -> HandSession:
    return start(tmp_path_factory.mktemp("started") / "dome")


@pytest.fixture
def hand_session(started: HandSession, tmp_path: Path) -> HandSession:
    """A copy of the started session."""
    folder = Path(shutil.copytree(started.out.parent, tmp_path / "dome"))
    return HandSession(folder / started.session.relative_to(started.out.parent), folder / "out")


@pytest.fixture(scope="module")
def roll(started: HandSession, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All photographs of the started session, in order, named img_0.tif ..."""
    folder, hand_session = tmp_path_factory.mktemp("roll"), started
    photos, number = folder / "photos", 0
    photos.mkdir()
    for entry in hand_session.order():
        for exposure in map(float, entry["exposures_s"].split()):
            write_image(photos / f"img_{number}.tif", photograph(hand_session.out, entry, exposure))
            number += 1
    return photos


@pytest.fixture
def photos(roll: Path, tmp_path: Path) -> Path:
    """A copy of the roll, to be spoilt."""
    shutil.copytree(roll, tmp_path / "photos")
    return tmp_path / "photos"


def photograph(
    out: Path, entry: dict[str, str], exposure_s: float, *, blur_px: float = BLUR_PX
) -> np.ndarray:
    """12-bit counts of a picture on a bent screen, out of focus; white just fits at 0.13 s."""
    rng = np.random.default_rng(7)
    light = np.full((PANEL[1], PANEL[0], 3), 1e-3)
    if entry["picture"]:
        picture = np.asarray(read_image(out / entry["picture"]), float) / 255
        light = light + np.broadcast_to(picture, light.shape) ** GAMMA
    v, u = np.mgrid[: PHOTO[1], : PHOTO[0]].astype(float)
    x = 0.7 * u + 0.06 * v + 2e-4 * u * v - 8
    y = 0.6 * v - 0.05 * u + 2e-4 * v * v
    planes = [
        map_coordinates(gaussian_filter(plane, blur_px), [y, x], order=1)
        for plane in np.moveaxis(light, -1, 0)
    ]
    counts = BLACK + 3000 * np.stack(planes, -1) * exposure_s / 0.13
    counts += rng.normal(0, NOISE_DN, counts.shape)
    return np.rint(np.clip(counts, 0, 2**BITS - 1)).astype(np.uint16)


class TestPatterns:
    def test_a_session_and_a_folder_for_the_rig(self, hand_session: HandSession) -> None:
        assert hand_session.session.name == "hand-0001"
        plan = Session(hand_session.session).read_plan()
        assert len(plan.shots) == SHOTS
        for shot in plan.shots[1:]:
            same = (hand_session.out / shot.pattern, hand_session.session / shot.pattern)
            assert same[0].read_bytes() == same[1].read_bytes()
        assert (hand_session.out / "plan.json").read_text() == (
            hand_session.session / "plan.json"
        ).read_text()
        lists = [p.name for p in hand_session.out.glob("*.m3u")]
        assert sorted(lists) == ["north.m3u", "south-end.m3u", "south.m3u"]
        assert "#EXTINF:5,south-0000\npatterns/south/0000.png\n" in (
            hand_session.out / "south.m3u"
        ).read_text("utf-8")

    def test_the_order_gives_numbers_exposures_and_times(self, hand_session: HandSession) -> None:
        order = hand_session.order()
        assert [entry["number"] for entry in order] == ["", *map(str, range(1, SHOTS))]
        assert order[0] | {"exposures_s": "", "hold_s": ""} == {
            **{"number": "", "shot": "dark", "projector": "", "purpose": "dark", "picture": ""},
            **{"exposures_s": "", "start_s": "0", "hold_s": ""},
        }
        for projector in ("south", "north"):
            mine = [e for e in order if e["projector"] == projector and e["purpose"] != "dim"]
            ends = np.cumsum([int(e["hold_s"]) for e in mine])
            assert [int(e["start_s"]) for e in mine] == [0, *ends[:-1]]
            assert all(int(e["hold_s"]) > 2 * float(e["exposures_s"]) for e in mine)
        assert (order[-1]["shot"], order[-1]["purpose"], order[-1]["start_s"]) == (
            f"south-{SHOTS // 2 - 1:04d}",
            "dim",
            "0",
        )

    def test_each_capture_is_a_new_session_that_capture_leaves_alone(
        self, hand_session: HandSession
    ) -> None:
        venue = hand_session.session.parents[1]
        ran = procam("session", "plan", venue, venue / "again", "--json")
        assert Path(json.loads(ran.out)["session"]).name == "hand-0002"
        ran = procam("session", "capture", venue, "--json")
        assert Path(json.loads(ran.out)["session"]).name == "0001"

    def test_refusals(self, hand_session: HandSession, tmp_path: Path) -> None:
        venue, new = hand_session.session.parents[1], tmp_path / "new"
        for arguments, message in (
            ((venue, hand_session.out), "give a new or empty folder"),
            ((venue / "no", new), "venue.toml: no such file"),
            ((f"{venue}@1", new), "takes no calibration, but a venue"),
        ):
            assert message in refused("session", "plan", *arguments)
        assert not new.exists()
        assert [p.name for p in hand_session.session.parent.iterdir()] == ["hand-0001"]

    def test_movies_without_their_extra(
        self, hand_session: HandSession, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setitem(sys.modules, "av", None)
        venue = hand_session.session.parents[1]
        assert "pip install 'procam[video]'" in refused(
            "session", "plan", venue, venue / "new", "--movie"
        )
        assert not (venue / "new").exists()
        assert [p.name for p in hand_session.session.parent.iterdir()] == ["hand-0001"]


class TestIngest:
    def test_a_whole_roll(self, hand_session: HandSession, roll: Path) -> None:
        ran = hand_session.ingest(roll)
        assert (ran.code, ran.err) == (0, "")
        first, *_, last = ran.out.splitlines()
        assert first == "img_0.tif, img_1.tif: no number is readable; taken as dark by the order"
        assert last == f"nothing is missing; now run: procam session solve {hand_session.session}"
        session = Session(hand_session.session)
        plan = session.read_plan()
        assert len(hand_session.stored()) == plan.exposures == EXPOSURES
        shot = plan.of("north", "primary")[1]
        frame = session.load(CAMERA, shot, shot.exposures_s[0], PHOTO)
        number = 1 + [s.id for s in plan.shots].index(shot.id)
        np.testing.assert_array_equal(frame.counts, read_image(roll / f"img_{number}.tif"))
        code = plan.of("south", "code")[0]
        assert session.load(CAMERA, code, code.exposures_s[0], PHOTO).counts.ndim == 2

    def test_any_order_with_missing_and_doubled_ones(
        self, hand_session: HandSession, photos: Path
    ) -> None:
        rng = np.random.default_rng(3)
        order = hand_session.order()
        soft = photograph(hand_session.out, order[9], 0.13, blur_px=1.2)
        write_image(photos / "soft.tif", soft)
        write_image(photos / "stranger.tif", rng.integers(60, 90, (33, 44, 3)).astype(np.uint16))
        (photos / "notes.txt").write_text("lens cap!")
        for number in (20, 40):
            (photos / f"img_{number}.tif").unlink()
        renamed = {p: f"x{n}{p.suffix}" for p, n in zip(
            sorted(photos.glob("img_*")), rng.permutation(200), strict=False)}  # fmt: skip
        names = {p.name: new for p, new in renamed.items()}
        for path, new in renamed.items():
            path.rename(photos / new)
        ran = hand_session.ingest(photos, "--json")
        document = json.loads(ran.out)
        shots = hand_session.shots()
        assert document["missing"] == ["dark", shots[19], shots[39]]
        assert document["stored"] == EXPOSURES - 4
        notes = "\n".join(document["notes"])
        assert f"soft.tif: shows {shots[9]} too; {names['img_10.tif']} is kept" in notes
        assert "stranger.tif: is of another size and shows no number; left out" in notes
        assert "notes.txt: is no photograph; left out" in notes
        kept = Session(hand_session.session).stored(CAMERA)
        assert (shots[9], 0.13) in kept
        # the dark ones have no number: a person names them; what was missing comes later
        more = photos.parent / "more"
        more.mkdir()
        for number in (20, 40):
            write_image(
                more / f"{number}.tif", photograph(hand_session.out, order[number - 1], 0.13)
            )
        for name, exposure in (("a.tif", 0.13), ("b.tif", 6.5)):
            write_image(more / name, photograph(hand_session.out, order[0], exposure))
        index = photos.parent / "index.csv"
        index.write_text("file,shot\na.tif,dark\nb.tif,dark\n")
        ran = hand_session.ingest(more, "--index", index)
        assert "4 photographs stored" in ran.out and "nothing is missing" in ran.out
        assert len(hand_session.stored()) == EXPOSURES

    def test_an_unreadable_number_is_guessed_only_if_asked(
        self, hand_session: HandSession, photos: Path
    ) -> None:
        """Two exchanged photographs without numbers would swap two projectors, and look right."""
        photographs = sorted(photos.glob("img_*.tif"), key=lambda p: int(p.stem[4:]))
        for path in (photographs[10], photographs[11]):
            write_image(path, np.full_like(read_image(path), 260))  # a hand before the lens
        ran = hand_session.ingest(photos)
        shots = hand_session.shots()
        text = (
            f"left out. By their order they show {shots[9]}, {shots[10]}: if you are sure, say --by"
        )
        assert text in ran.out and f"missing: {shots[9]}, {shots[10]}" in ran.out
        ran = hand_session.ingest(photos, "--by-order")
        assert f"taken as {shots[9]}, {shots[10]} by the order" in ran.out
        assert "2 photographs stored" in ran.out and "nothing is missing" in ran.out

    def test_what_is_stored_is_replaced_only_if_asked(
        self, hand_session: HandSession, roll: Path, tmp_path: Path
    ) -> None:
        hand_session.ingest(roll)
        before, shots = contents(hand_session.session), hand_session.shots()
        order = hand_session.order()
        write_image(tmp_path / "again" / "a.tif", photograph(hand_session.out, order[7], 0.13) // 2)
        assert f"{shots[7]} is stored already" in hand_session.ingest(tmp_path / "again").out
        assert contents(hand_session.session) == before
        ran = hand_session.ingest(tmp_path / "again", "--replace")
        assert "1 photographs stored" in ran.out and "nothing is missing" in ran.out
        changed = [n for n, c in contents(hand_session.session).items() if before[n] != c]
        assert {Path(n).name for n in changed} == {f"{shots[7]}@0.13.tif", "index.jsonl"}

    @pytest.mark.parametrize(
        ("old", "new", "words"),
        [
            ("[projectors.south]", "[projectors.sud]", "no pictures for projector sud, but"),
            (
                f"size = {list(PANEL)}",
                "size = [800, 600]",
                "px for projector south, but venue.toml",
            ),
        ],
    )
    def test_pictures_of_another_venue_toml(
        self, hand_session: HandSession, roll: Path, old: str, new: str, words: str
    ) -> None:
        venue = hand_session.session.parents[1]
        text = (venue / "venue.toml").read_text("utf-8")
        assert old in text
        (venue / "venue.toml").write_text(text.replace(old, new), "utf-8")
        doctor = procam("doctor", venue, "--camera", CAMERA, "--photos", roll)
        for ran in (
            hand_session.ingest(roll),
            procam("session", "solve", hand_session.session),
            doctor,
        ):
            assert (ran.code, words in ran.complaint) == (2, True), ran
        assert not hand_session.stored()

    def test_what_is_stored_is_set_aside(self, hand_session: HandSession, roll: Path) -> None:
        undo = "session", "undo", hand_session.session, "--camera", CAMERA
        ran = procam(*undo)
        assert (ran.code, "there is nothing to undo" in ran.complaint) == (2, True)
        for number in (1, 2):
            hand_session.ingest(roll)
            stored = hand_session.stored()
            ran = procam(*undo)
            aside = hand_session.session / "undone" / f"{CAMERA}-{number}"
            assert f"are in {aside} now" in ran.out and not hand_session.stored()
            assert len(list(aside.glob("*.tif"))) == len(stored)
        assert "no camera 'other'; venue.toml has" in refused(
            "session", "undo", hand_session.session, "--camera", "other"
        )

    def test_headers_tell_exposure_and_time(
        self, hand_session: HandSession, tmp_path: Path
    ) -> None:
        photos = tmp_path / "dcim"
        photos.mkdir()
        exposures = {"0.13": 0.125, "6.5": 6.0}
        second, names = 0, iter(np.random.default_rng(1).permutation(500))
        for entry in hand_session.order()[:12]:
            for planned in entry["exposures_s"].split():
                second += 3
                pixels = photograph(hand_session.out, entry, exposures[planned])
                header = {
                    "ExposureTime": exposures[planned],
                    "Exif__DateTimeOriginal": f"2026:01:02 03:{second // 60:02d}:{second % 60:02d}",
                }
                write_with_header(photos / f"P{next(names):03d}.tif", pixels, **header)
        ran = hand_session.ingest(photos)
        assert (ran.code, "13 photographs stored" in ran.out) == (0, True), ran
        plan = Session(hand_session.session).read_plan()
        assert plan.shots[0].exposures_s == (0.125, 6.0)
        assert plan.shots[1].exposures_s == (0.125,)
        assert plan.shots[-1].exposures_s == (0.13, 6.5)  # not photographed yet
        stored = Session(hand_session.session).stored(CAMERA)
        assert stored["dark", 6.0].started_s == stored["dark", 0.125].started_s + 3
        again = hand_session.ingest(photos)
        assert (again.code, "0 photographs stored" in again.out) == (0, True), again
        dark = photograph(hand_session.out, hand_session.order()[0], 3.0)
        (tmp_path / "one").mkdir()
        write_with_header(tmp_path / "one" / "dark.tif", dark, ExposureTime=3.0)
        (tmp_path / "index.csv").write_text("dark.tif,dark\n", "utf-8")
        index = "--index", tmp_path / "index.csv"
        ran = hand_session.ingest(tmp_path / "one", "--replace", *index)
        assert ran.code == 0, ran  # of the only camera: exposures are its own
        procam("session", "undo", hand_session.session, "--camera", CAMERA)
        assert Session(hand_session.session).read_plan().shots[0].exposures_s == (0.13, 6.5)


def _spoil_size(photos: Path) -> None:
    path = photos / "img_5.tif"
    write_image(path, np.ascontiguousarray(np.swapaxes(read_image(path), 0, 1)[:, ::-1]))


def _spoil_colour(photos: Path) -> None:
    path = photos / "img_2.tif"
    write_image(path, np.asarray(read_image(path))[..., 1])


def _spoil_iso(photos: Path) -> None:
    for number, aperture in ((4, 4.0), (5, 5.6)):
        path = photos / f"img_{number}.tif"
        write_with_header(path, np.asarray(read_image(path)), FNumber=aperture)


class TestRefused:
    @pytest.mark.parametrize(
        ("spoil", "message"),
        [
            (_spoil_size, "img_5.tif: 200x240 px, but venue.toml gives its camera 240x200"),
            (_spoil_colour, "img_2.tif: one channel, but shot south-0000 needs R, G and B"),
            (
                _spoil_iso,
                "img_5.tif: aperture f/5.6, but others have 4; only the shutter time may change",
            ),
        ],
    )
    def test_and_nothing_is_written(
        self, spoil, message: str, hand_session: HandSession, photos: Path
    ) -> None:
        spoil(photos)
        before = contents(hand_session.session)
        ran = hand_session.ingest(photos)
        assert (ran.code, message in ran.complaint) == (2, True), ran
        after = contents(hand_session.session)
        assert after == before

    def test_a_wrong_session_camera_folder_or_index(
        self, hand_session: HandSession, photos: Path, tmp_path: Path
    ) -> None:
        index = tmp_path / "i.csv"
        for lines, message in (
            ("img_3.tif,nope\n", "entry 1: the shot 'nope'"),
            ("nope.tif,dark\n", "entry 1: the file 'nope.tif'"),
            ("img_3.tif\n", "entry 1: ['img_3.tif'] is not of the form file,shot"),
            (
                "img_3.tif,dark\nimg_3.tif,dark\n",
                "entry 2: the file 'img_3.tif' stands there twice",
            ),
        ):
            index.write_text(lines)
            assert message in hand_session.ingest(photos, "--index", index).complaint
        assert "no such file" in hand_session.ingest(photos, "--index", tmp_path / "x").complaint
        empty = tmp_path / "empty"
        empty.mkdir()
        assert "holds no photographs" in hand_session.ingest(empty).complaint
        assert "no such folder" in hand_session.ingest(tmp_path / "gone").complaint
        ran = procam("session", "add", hand_session.session, "--camera", "b", "--photos", photos)
        assert "--camera: no camera 'b'; venue.toml has zenith" in ran.complaint
        ran = procam("session", "add", tmp_path, "--camera", CAMERA, "--photos", photos)
        assert ran.code == 2
        assert hand_session.stored() == []

    def test_photographs_of_something_else(self, hand_session: HandSession, tmp_path: Path) -> None:
        folder = tmp_path / "cats"
        folder.mkdir()
        for number in range(3):
            noise = np.random.default_rng(number).integers(60, 900, (PHOTO[1], PHOTO[0], 3))
            write_image(folder / f"{number}.tif", noise.astype(np.uint16))
        ran = hand_session.ingest(folder)
        assert (ran.code, "3 photographs, none of a shot" in ran.complaint) == (2, True)


class TestResponse:
    @pytest.mark.parametrize("bits", [BITS, 8])
    def test_srgb_photographs_become_linear(
        self, hand_session: HandSession, photos: Path, bits: int
    ) -> None:
        """They keep their resolution, whatever venue.toml says of the camera's depth."""
        toml = hand_session.session.parents[1] / "venue.toml"
        text = toml.read_text().replace('response = "linear"', 'response = "srgb"')
        toml.write_text(text.replace(f"bits = {BITS}", f"bits = {bits}"))
        truth = {}
        for number in range(2, 8):
            path = photos / f"img_{number}.tif"
            truth[number] = (np.asarray(read_image(path), float) - BLACK).clip(0) / (4095 - BLACK)
            encoded = np.rint(255 * srgb_encode(truth[number])).astype(np.uint8)
            write_image(photos / f"img_{number}.png", encoded)
        for path in photos.glob("*.tif"):
            path.unlink()
        ran = hand_session.ingest(photos)
        assert (ran.code, "6 photographs stored" in ran.out) == (0, True), ran
        session = Session(hand_session.session)
        shot = session.read_plan().shots[1]
        frame = session.load(CAMERA, shot, shot.exposures_s[0], PHOTO)
        light = (frame.counts - BLACK) / (2**DECODED_BITS - 1 - BLACK)
        assert session.bits(CAMERA) == DECODED_BITS
        np.testing.assert_allclose(srgb_encode(light), srgb_encode(truth[2]), atol=0.51 / 255)

    def test_counts_that_an_earlier_version_decoded_keep_their_depth(
        self, hand_session: HandSession, photos: Path
    ) -> None:
        venue = hand_session.session.parents[1]
        toml, index = venue / "venue.toml", hand_session.session / "captures" / CAMERA
        toml.write_text(toml.read_text().replace('"linear"', '"srgb"'))
        write_image(photos / "img_2.png", np.asarray(read_image(photos / "img_2.tif")) // 16)
        for path in photos.glob("*.tif"):
            path.unlink()
        assert hand_session.ingest(photos).code == 0
        session, loaded = Session(hand_session.session), load_venue(venue)
        assert with_decoded_bits(loaded, session).cameras[CAMERA].sensor.bits == DECODED_BITS
        text = (index / "index.jsonl").read_text()
        (index / "index.jsonl").write_text(text.replace(f', "bits": {DECODED_BITS}', ""))
        assert with_decoded_bits(loaded, session).cameras[CAMERA].sensor.bits == BITS
        hand_session.ingest(photos, "--replace")
        assert session.bits(CAMERA) is None
        (slot,) = session.stored(CAMERA)
        shot = next(shot for shot in session.read_plan().shots if shot.id == slot[0])
        assert session.load(CAMERA, shot, slot[1], PHOTO).counts.max() < 2**BITS


@pytest.mark.usefixtures("no_report")
def test_solves_like_a_driven_session(tmp_path: Path) -> None:
    """Photographed by a camera of another venue, with only the PNGs; then the same dome, driven."""
    size = replace(TINY, projector_size=(320, 200), camera_size=(400, 400))
    venue = make_venue(tmp_path / "venue", size=size)
    assert procam("session", "plan", venue.directory, tmp_path / "out").code == 0
    make_venue(tmp_path / "elsewhere", size=size)
    photographer.main(tmp_path / "elsewhere", tmp_path / "out", tmp_path / "photos")
    session = venue.directory / "sessions" / "hand-0001"
    ran = procam("session", "add", session, "--camera", CAMERA, "--photos", tmp_path / "photos")
    assert (ran.code, "nothing is missing" in ran.out) == (0, True), ran
    ran = procam("session", "solve", session)
    assert (ran.code, "calibrations/0001 and " in ran.out) == (0, True), ran
    driven = solved(venue, take_session(venue))
    found = compare_calibrations(
        *map(load_calibration, (venue.directory / "calibrations/0001", driven))
    )
    assert found.verdict.sound
    assert found.together.as_is.rms < 5  # arcmin; a camera's pixel is 27, and its lens is solved
    assert found.together.as_is.error_over_sigma < 1
    assert found.together.areas.alone < 0.01
    for step in found.light.values():
        assert (np.abs(np.subtract(step.first, step.second)) < 2 * np.array(step.sigma)).all()
