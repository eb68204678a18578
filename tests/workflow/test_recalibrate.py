"""`procam recalibrate`: one projector is measured anew, and all else stays to the last bit."""

import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tiny_venue import (
    TINY_PAIR,
    Stage,
    calibrated,
    contents,
    drift,
    make_venue,
    procam,
    refused,
    replace_camera,
    solved,
    take_session,
    watch_stage,
)

from procam.devices.protocols import BackendRig
from procam.estimate.geometry import solve as geometry
from procam.files.calibration import load_calibration
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.files.versions import calibration_in_use
from procam.interfaces.judge import direction_errors
from procam.maths.geometry.sphere import angle_between
from procam.model.frame import Frame
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.recalibrate import recalibrate, worse
from procam.workflows.recalibrate.one_projector import solve_again
from simulators.backend import build_scene
from simulators.mistakes import AlteringCamera, _with_person
from studies.seen import Seen, front, grey, seen

VERIFIED = 12  # photographs of two other projectors and of the dark, before the first of its own
SIZE = replace(TINY_PAIR, projectors=3, projector_size=(160, 100), camera_size=(320, 320))
NUDGE = '{ kind = "turned", projector = "south", size = 0.6, angle_deg = 40 }'
AGED = '{ kind = "aged", projector = "east", size = 0.2 }'


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory, no_report: None) -> Path:
    return calibrated(tmp_path_factory.mktemp("recalibrate") / "venue", SIZE).directory


@pytest.fixture(scope="module")
def nudged(once: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The venue after a nudge and what was measured of it."""
    venue = Path(shutil.copytree(once, tmp_path_factory.mktemp("nudged") / "venue"))
    drift(venue, NUDGE)
    ran = procam("recalibrate", venue, "--projector", "south")
    assert ran.code == 0, ran
    assert ran.out == f"{venue}/calibrations/0002 written: south measured again\n"
    return venue


def relative_error(venue: Path, calibration: Path) -> float:
    """Rms error of directions less a common rotation [arcmin]."""
    scene = build_scene(load_venue(venue).backends["simulated"], venue)
    found, estimate, true = load_calibration(calibration), [], []
    for name, projector in found.projectors.items():
        use = projector.surface.valid & scene.lights[name].lit
        estimate.append(projector.surface.direction[use].astype(float))
        true.append(scene.lights[name].direction[use])
    _, relative = direction_errors(np.concatenate(estimate), np.concatenate(true))
    return float(np.sqrt(np.mean(np.square(relative))))


def test_a_nudged_projector_is_replaced_and_the_rest_stays(nudged: Path) -> None:
    old, new = (load_calibration(nudged / "calibrations" / n) for n in ("0001", "0002"))
    for name in ("north", "east"):
        a, b = old.projectors[name], new.projectors[name]
        assert all(
            np.array_equal(getattr(a.surface, field), getattr(b.surface, field), equal_nan=True)
            for field in ("direction", "solid_angle_sr", "valid", "measured", "sigma_arcmin")
        )
        assert np.array_equal(a.photometry.gain, b.photometry.gain)
        assert np.array_equal(a.photometry.response.values, b.photometry.response.values)
    for field in ("scatter_per_flux", "albedo"):
        assert np.array_equal(getattr(old.maps, field), getattr(new.maps, field))
    assert np.array_equal(old.content_from_camera, new.content_from_camera)
    before, after = (relative_error(nudged, nudged / "calibrations" / n) for n in ("0001", "0002"))
    assert after < 0.15 * before  # pixels of these panels have 40 arcmin
    assert procam("verify", nudged).code == 0  # compares with the new session
    assert procam("recalibrate", nudged).out.startswith("nothing to recalibrate")


def test_from_the_session_of_the_calibration_nothing_changes(once: Path) -> None:
    """Both go one way from light to a projector: what differs is how well its place alone is known."""
    venue, old = load_venue(once), load_calibration(once / "calibrations" / "0001")
    session = Session(once / "sessions" / "0001")
    new = solve_again(venue, session, session, old, "south").calibration
    a, b = (each.projectors["south"] for each in (old, new))
    moved = np.degrees(angle_between(a.surface.direction, b.surface.direction)) * 60
    assert np.nanmax(moved) < 4  # pixels have 40 arcmin
    sure = a.surface.valid & b.surface.valid
    assert sure.sum() > 0.99 * a.surface.valid.sum()
    np.testing.assert_allclose(b.photometry.colour_mix, a.photometry.colour_mix, atol=1e-3)
    gain = b.photometry.gain[sure] / a.photometry.gain[sure] - 1
    assert np.sqrt(np.mean(gain**2)) < 0.01 and abs(gain.mean()) < 1e-3
    for name in old.projectors:
        off = new.projectors[name].blend - old.projectors[name].blend
        assert np.abs(off).max() < 0.05, name
    lit = old.maps.coverage > 0.999
    white = new.maps.hi[lit] / old.maps.hi[lit] - 1
    assert np.sqrt(np.mean(white**2)) < 0.005 and abs(white.mean()) < 1e-3
    np.testing.assert_allclose(new.maps.lo[lit], old.maps.lo[lit], atol=1e-5)


def assert_seen_alike(part: Seen, whole: Seen) -> None:
    """Every projector sends what it does after a whole calibration, and the audience sees as much."""
    for name in whole.mean:
        assert part.share_lit[name] == pytest.approx(whole.share_lit[name], rel=0.02), name
        assert part.mean[name] == pytest.approx(whole.mean[name], rel=0.02), name
    assert part.level == pytest.approx(whole.level, abs=0.01)
    for where in (None, whole.seam, ~whole.seam):
        assert part.error(where) < 1.1 * whole.error(where) + 0.002


def test_it_is_as_good_as_a_whole_calibration_with_a_quarter_of_the_shots(
    nudged: Path, venue: Path
) -> None:
    drift(venue, NUDGE)
    shutil.rmtree(venue / "sessions")
    part, whole = (each / "calibrations" / "0002" for each in (nudged, venue))
    document = json.loads(procam("calibrate", venue, "--json").out)
    assert document["calibration"] == str(whole)
    assert relative_error(nudged, part) < 1.1 * relative_error(venue, whole)
    for content in (grey(), front()):
        assert_seen_alike(seen(nudged, part, content), seen(venue, whole, content))
    plan = Session(nudged / "sessions" / "0002").read_plan()
    assert sum(shot.projector == "south" for shot in plan.shots) < 0.4 * len(plan.shots)


def test_seams_sum_to_one_and_white_is_where_the_light_is(venue: Path) -> None:
    drift(venue, NUDGE, AGED)
    data = json.loads(procam("recalibrate", venue, "--json").out)
    assert sorted(data["projectors"]) == ["east", "south"]
    assert all("the dimmest place reaches " in note for note in data["notes"])
    new = load_calibration(Path(data["calibration"]))
    scene = build_scene(load_venue(venue).backends["simulated"], venue)
    for name in ("east", "south"):
        light, found = scene.lights[name], new.projectors[name]
        use = found.surface.valid & light.lit
        white = light.emit(np.ones((*light.lit.shape, 3), np.float32), slice(0, 3))
        true = (white * scene.surface.albedo(light.direction)[..., None])[use]
        ratio = found.photometry.gain[use] / (true @ new.content_from_camera.T)
        assert np.median(ratio) == pytest.approx(1.0, abs=0.015)
    old = load_calibration(venue / "calibrations" / "0001")
    lit = (old.maps.coverage > 0.99) & (new.maps.coverage > 0.99)
    change = new.maps.hi[lit] / old.maps.hi[lit]
    low, middle = np.quantile(change, (0.001, 0.5))
    assert low > 0.75 and middle == pytest.approx(0.94, abs=0.06)
    assert 0.5 < np.median(new.maps.lo[lit] / old.maps.lo[lit]) < 1.2


def test_a_dimmer_projector_that_cannot_show_white_any_more_is_named(venue: Path) -> None:
    drift(venue, AGED)
    ran = procam("recalibrate", venue, "--projector", "east", "--json")
    document = json.loads(ran.out)
    (note,) = document["notes"]
    assert ran.code == 0 and document["in_use"] == document["calibration"]
    reached = int(re.search(r"the dimmest place reaches (\d+)%", note)[1])  # type: ignore[index]
    assert 78 <= reached <= 85  # a fifth of its light is lost
    whole = seen(venue, venue / "calibrations" / "0002", grey(0.98))
    assert whole.error() < 0.03  # scattered light makes up for it where all is white


def test_light_that_came_into_the_room_is_no_black_of_a_projector(venue: Path) -> None:
    """Less than what stops a recalibration, and more than black."""
    drift(venue, NUDGE, '{ kind = "ambient", size = 0.0008 }')
    ran = procam("recalibrate", venue, "--projector", "south")
    assert (ran.code, ran.err) == (0, ""), ran
    old, new = (load_calibration(venue / "calibrations" / n) for n in ("0001", "0002"))
    lit = (old.maps.coverage > 0.99) & (new.maps.coverage > 0.99)
    assert new.maps.lo[lit].mean() == pytest.approx(old.maps.lo[lit].mean(), rel=0.05)
    assert procam("verify", venue).code == 0  # the dark of each projector's own time


def test_light_in_its_dark_photograph_alone_keeps_it_out_of_use(
    venue: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drift(venue, NUDGE)
    dark = SessionImages.dark

    def lit(self: SessionImages, projector: str = "") -> tuple[np.ndarray, np.ndarray]:
        short, long = dark(self, projector)
        more = 1e-3 * np.float32(bool(self.plan.of(projector, "dark")) and projector != "")
        return short + more, long + more

    monkeypatch.setattr(SessionImages, "dark", lit)
    ran = procam("recalibrate", venue, "--projector", "south")
    assert ran.code == 1 and "dark photograph of south" in " ".join(ran.out.split()), ran
    assert calibration_in_use(venue).name == "0001"


def test_one_that_fits_worse_is_written_and_not_used(
    venue: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drift(venue, NUDGE)
    monkeypatch.setattr(worse, "WORSE", 1e-6)
    monkeypatch.setattr(worse, "LEAST_RESIDUAL_PX", 1e-9)
    ran = procam("recalibrate", venue)
    assert ran.code == 1
    assert "note: south fits by " in ran.out and "stays in use" in ran.out
    assert calibration_in_use(venue).name == "0001"
    assert (venue / "calibrations" / "0002").is_dir()


def test_what_the_solve_knows_is_said_and_keeps_it_out_of_use(
    venue: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Somebody walks through the dome while the projector is photographed again."""

    def walked_through(stage: Stage) -> BackendRig:
        def walking(frame: Frame, taken: int) -> Frame:
            place = (0.3 + 0.4 * (0.37 * taken % 1), 0.5)
            return _with_person(place, 0.6, frame) if taken > VERIFIED else frame

        return replace_camera(stage.backend, lambda camera: AlteringCamera(camera, walking))

    watch_stage(monkeypatch, walked_through)
    ran = procam("recalibrate", venue, "--projector", "south", "--json")
    assert ran.code == 1
    notes = json.loads(ran.out)["notes"]
    assert any("someone or something moved before the screen" in note for note in notes)
    assert notes[-1] == recalibrate.STAYS
    assert calibration_in_use(venue).name == "0001"
    old, new = (load_calibration(venue / "calibrations" / n) for n in ("0001", "0002"))
    assert set(new.provenance.note_lines) - set(old.provenance.note_lines) <= set(notes)


@pytest.mark.parametrize(
    ("change", "words", "options"),
    [
        ('{ kind = "camera-moved", size = 1.0, angle_deg = 30 }', "zenith: camera moved: ", ()),
        ('{ kind = "aperture", size = 0.2 }', "zenith: camera exposure: ", ()),
        ('{ kind = "ambient", size = 0.05 }', "venue: ambient light: ", ("--projector", "south")),
    ],
)
def test_refused_where_the_camera_or_the_room_changed(
    change: str, words: str, options: tuple[str, ...], venue: Path
) -> None:
    drift(venue, NUDGE, change)
    before = [name for name in contents(venue) if "/logs/" not in f"/{name}"]
    complaint = refused("recalibrate", venue, *options)
    assert words in complaint
    assert "procam calibrate" in complaint
    assert [name for name in contents(venue) if not name.startswith("logs")] == before


def test_what_a_hand_must_mend_is_only_said(venue: Path) -> None:
    drift(venue, '{ kind = "overscan", projector = "north", size = 0.05 }')
    ran = procam("recalibrate", venue)
    assert ran.code == 0
    assert ran.out.startswith("note: north: picture setting: ")
    assert "nothing to recalibrate" in ran.out and calibration_in_use(venue).name == "0001"


def test_names_that_are_none(venue: Path) -> None:
    ran = procam("recalibrate", venue, "--projector", "up")
    assert ran.complaint.endswith("there is none of this name; choose from south, north, east")


def test_by_hand_is_refused(venue: Path) -> None:
    path = venue / "venue.toml"
    text, _, _ = path.read_text().partition("[simulated]")
    path.write_text(text.replace('backend = "simulated"\n', "").replace("control = ", "# "))
    assert "people drive its devices" in procam("recalibrate", venue).complaint


@pytest.fixture
def two_cameras(tmp_path: Path, no_report: None, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A venue whose calibration names first another camera than that of the light, as large ones do."""
    monkeypatch.setattr(geometry, "FEW", 100)  # in the first fits both cameras see as much
    folder, size = tmp_path / "venue", replace(SIZE, projectors=2, cameras=2)
    make_venue(folder, size=size)
    text = (folder / "venue.toml").read_text()
    pillar = "[cameras.zenith]\nmasks = [[[0, 0], [80, 0], [80, 319], [0, 319]]]"
    (folder / "venue.toml").write_text(text.replace("[cameras.zenith]", pillar))
    loaded = load_venue(folder)
    solved(loaded, take_session(loaded))
    yield folder


def test_the_main_camera_is_that_of_the_light_not_the_first(two_cameras: Path) -> None:
    before, after = (two_cameras / "calibrations" / n for n in ("0001", "0002"))
    old = load_calibration(before)
    assert list(old.cameras) == ["zenith", "second"] and old.main_camera == "second"
    drift(two_cameras)
    assert procam("recalibrate", two_cameras, "--projector", "south").code == 0
    new = load_calibration(after)
    assert new.main_camera == "second"
    gains = [c.projectors["south"].photometry.gain for c in (old, new)]
    both = (gains[0] > 0) & (gains[1] > 0)
    assert np.abs(gains[1][both] / gains[0][both] - 1).mean() < 0.02
    assert_seen_alike(seen(two_cameras, after, grey()), seen(two_cameras, before, grey()))
