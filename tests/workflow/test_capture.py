"""Capture takes the right pictures or stops with the right words; solve refuses damaged ones."""

import json
import os
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from edited_files import rewrite
from exact_room import coarse_rooms
from tiny_venue import (
    CAMERA,
    TINY_PAIR,
    Stage,
    calibrated,
    contents,
    make_venue,
    procam,
    quick_simulator,
    refused,
    replace_camera,
    take_session,
    watch_stage,
)

from procam.devices.protocols import BackendRig, Camera, Shown
from procam.devices.rig import Rig
from procam.errors import DeviceError, NotConnected, StaleFrame, WrongState
from procam.estimate.structured_light.patterns import plan_session
from procam.files.atomic import read_lines
from procam.files.images.pixels import read_image, write_image
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.model.frame import CameraSettings, Frame
from procam.workflows.capture.capture import capture, prepare_session
from procam.workflows.venue_rig import open_rig
from simulators.clock import SceneClock
from simulators.devices import SimulatedCamera
from simulators.faults import STALE_FRAME, FaultyCamera, StaleCamera
from simulators.mistakes import AlteringCamera

NO_PATTERN_BEFORE = 3  # the dark frames, and the white that follows them
FRAMES = Path("captures") / CAMERA
STUCK_S = 120.0
PATIENCE_S = 2.0  # with a disk


@pytest.fixture(scope="module", autouse=True)
def small_and_quick() -> Iterator[None]:
    with coarse_rooms(), quick_simulator():
        yield


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Venue:
    """Two projectors, captured and solved without a hitch."""
    return calibrated(tmp_path_factory.mktemp("whole"), TINY_PAIR)


@pytest.fixture
def venue(tmp_path: Path) -> Venue:
    return make_venue(tmp_path, size=TINY_PAIR)


def pictures(session: Path) -> dict[str, bytes]:
    return {n: c for n, c in contents(session).items() if n.endswith(".tif")}


def same_as(whole: Venue, venue: Venue) -> bool:
    """Whether a venue holds the whole session."""
    session = Path("sessions", "0001")
    return pictures(venue.directory / session) == pictures(whole.directory / session)


def only_whole_frames(whole: Venue, venue: Venue) -> int:
    """How many frames are stored, after checking that none differs from the whole session's."""
    expected = pictures(whole.directory / "sessions" / "0001")
    stored = pictures(venue.directory / "sessions" / "0001")
    index = read_lines(venue.directory / "sessions" / "0001" / FRAMES / "index.jsonl")
    assert sorted(str(FRAMES / json.loads(line)["file"]) for line in index) == sorted(stored)
    assert all(content == expected[name] for name, content in stored.items())
    return len(stored)


def at_frame(
    monkeypatch: pytest.MonkeyPatch, number: int, act: Callable[[Stage], None]
) -> list[Stage]:
    """Do something just before the camera takes its `number`-th picture."""
    stages = watch_stage(monkeypatch)
    take, taken = SimulatedCamera.capture, []

    def counted(camera: SimulatedCamera) -> Frame:
        taken.append(camera)
        if len(taken) == number:
            act(stages[-1])
        return take(camera)

    monkeypatch.setattr(SimulatedCamera, "capture", counted)
    return stages


def test_while_a_shot_is_taken_every_other_projector_is_shuttered(
    venue: Venue, monkeypatch: pytest.MonkeyPatch
) -> None:
    stages = watch_stage(monkeypatch)
    take, lit = SimulatedCamera.capture, []

    def watched(camera: SimulatedCamera) -> Frame:
        lit.append(stages[-1].lit())
        return take(camera)

    monkeypatch.setattr(SimulatedCamera, "capture", watched)
    session = prepare_session(venue, venue.directory / "sessions" / "0001")
    with open_rig(venue) as rig:
        assert len(list(capture(rig, venue, session))) == len(session.read_plan().shots)
        assert stages[-1].lit() == []  # what follows may photograph the dark dome
    shots = session.read_plan().shots
    expected = [[s.projector] if s.projector else [] for s in shots for _ in s.exposures_s]
    assert lit == expected


def test_a_run_cut_short_within_a_shot_takes_only_the_exposure_that_is_missing(
    whole: Venue, venue: Venue, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = venue.directory / "sessions" / "0001"
    shutil.copytree(whole.directory / "sessions" / "0001", session)
    index = session / FRAMES / "index.jsonl"
    first, second, *rest = index.read_text().splitlines(keepends=True)
    assert json.loads(first)["shot"] == json.loads(second)["shot"] == "dark"
    index.write_text("".join([first, *rest]))
    taken = []
    take = SimulatedCamera.capture

    def counted(camera: SimulatedCamera) -> Frame:
        taken.append(take(camera))
        return taken[-1]

    monkeypatch.setattr(SimulatedCamera, "capture", counted)
    take_session(venue)
    assert [frame.settings.exposure_s for frame in taken] == [json.loads(second)["exposure_s"]]
    assert same_as(whole, venue)


@pytest.mark.parametrize("unplugged", ["south", "north"])
def test_an_unplugged_cable_ends_in_words_and_the_run_resumes_once_it_is_back(
    unplugged: str, whole: Venue, venue: Venue, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        stages = at_frame(patch, 7, lambda stage: stage.wires[unplugged].unplug())
        with pytest.raises(DeviceError) as caught:
            take_session(venue)
    assert f"projector {unplugged}" in str(caught.value)
    assert stages[-1].wires[unplugged].port in str(caught.value)
    assert all(not shown.any() for shown in stages[-1].scene.shown.values())
    assert set(stages[-1].lit()) <= {unplugged}
    stored = only_whole_frames(whole, venue)
    assert 7 <= stored < len(pictures(whole.directory))
    take_session(venue)  # plugged in again
    assert same_as(whole, venue)


@pytest.mark.parametrize(
    ("stuck", "words"), [("south", "shutter closed"), ("north", "shutter open")]
)
def test_a_shutter_that_does_not_confirm_stops_the_capture(
    stuck: str, words: str, whole: Venue, venue: Venue, monkeypatch: pytest.MonkeyPatch
) -> None:
    def jam(stage: Stage) -> None:
        stage.scene.states[stuck].shutter_stuck = True

    at_frame(monkeypatch, 7, jam)
    with pytest.raises(WrongState, match=rf"{words} is not confirmed: projector {stuck}"):
        take_session(venue)
    only_whole_frames(whole, venue)
    names = pictures(venue.directory)
    assert names
    assert not [name for name in names if "north" in name]


class LaggingCamera(FaultyCamera):
    """A camera whose every first picture of a pattern is the one before."""

    def __init__(self, camera: Camera) -> None:
        super().__init__(camera)
        self._last: Frame | None = None
        self._late = False
        self.slips = self.good = 0

    def capture(self) -> Frame:
        self._late = not self._late and self.good >= NO_PATTERN_BEFORE
        if self._late and self._last is not None:
            self.slips += 1
            return self._last
        self._last = self._camera.capture()
        self.good += 1
        return self._last


def put_in(wrap: Callable[[SimulatedCamera], object]) -> Callable[[Stage], BackendRig]:
    return lambda stage: replace_camera(stage.backend, wrap)


def test_a_stale_frame_is_taken_again(
    whole: Venue, venue: Venue, monkeypatch: pytest.MonkeyPatch
) -> None:
    cameras: list[StaleCamera] = []

    def wrap(camera: SimulatedCamera) -> StaleCamera:
        cameras.append(StaleCamera(camera))
        return cameras[-1]

    watch_stage(monkeypatch, put_in(wrap))
    take_session(venue)
    assert cameras[0]._taken == len(pictures(venue.directory)) + 1 > STALE_FRAME
    assert same_as(whole, venue)


def test_a_camera_that_always_lags_by_one_is_retaken_every_time(
    whole: Venue, venue: Venue, monkeypatch: pytest.MonkeyPatch
) -> None:
    cameras: list[LaggingCamera] = []

    def wrap(camera: SimulatedCamera) -> LaggingCamera:
        cameras.append(LaggingCamera(camera))
        return cameras[-1]

    watch_stage(monkeypatch, put_in(wrap))
    take_session(venue)
    assert cameras[0].slips == len(pictures(venue.directory)) - NO_PATTERN_BEFORE
    assert same_as(whole, venue)


@pytest.mark.parametrize("dies_at", [4, 5, 9, 30])
def test_a_camera_that_stays_stale_is_an_error_that_names_the_shot(
    dies_at: int, whole: Venue, venue: Venue, monkeypatch: pytest.MonkeyPatch
) -> None:
    shots = Session(whole.directory / "sessions" / "0001").read_plan().shots
    frames = [shot.id for shot in shots for _ in shot.exposures_s]
    seen: list[Frame] = []

    def frozen(frame: Frame, taken: int) -> Frame:
        """The same picture for ever once the trigger has died."""
        seen.append(frame)
        return seen[min(taken, dies_at - 1)]

    watch_stage(monkeypatch, put_in(lambda camera: AlteringCamera(camera, frozen)))
    with pytest.raises(StaleFrame, match=f"shot {frames[dies_at]}: "):
        take_session(venue)
    assert only_whole_frames(whole, venue) == dies_at


@pytest.mark.parametrize("at_the_disk", [False, True])
def test_ctrl_c_makes_projectors_dark_although_the_disk_hangs(
    at_the_disk: bool, venue: Venue, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At once, and then the disk is waited for, which is said."""
    stages, writes, may_go_on = watch_stage(monkeypatch), threading.Event(), threading.Event()
    monkeypatch.setattr("procam.workflows.capture.capture.DISK_PATIENCE_S", PATIENCE_S)
    take, store, said, stopped_s = SimulatedCamera.capture, Session.store, [], list[float]()

    def hangs(*frame: object) -> None:
        if stages[-1].lit():
            writes.set()
            assert may_go_on.wait(STUCK_S)
        store(*frame)  # type: ignore[arg-type]

    def stop() -> None:
        stopped_s.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)

    lit_photographs = count()

    def stopped(camera: SimulatedCamera) -> Frame:
        second = bool(stages[-1].lit()) and next(lit_photographs) == 1
        if second:  # the first one is on its way to the disk
            assert writes.wait(STUCK_S)
        if second and not at_the_disk:
            stop()
        frame = take(camera)
        if second:
            threading.Timer(0.2, stop).start()
        return frame

    def announced(text: str) -> None:
        said.append((text, stages[-1].lit(), time.monotonic() - stopped_s[0]))

    monkeypatch.setattr("procam.workflows.capture.capture.announce", announced)
    monkeypatch.setattr(SimulatedCamera, "capture", stopped)
    monkeypatch.setattr(Session, "store", hangs)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with pytest.raises(KeyboardInterrupt):
        take_session(venue)
    waited_s = time.monotonic() - stopped_s[0]
    may_go_on.set()
    ((text, lit, after_s),) = said
    assert text.startswith("all projectors are dark; waiting for the disk to write the last photog")
    assert lit == [] and after_s < PATIENCE_S
    assert PATIENCE_S <= waited_s < 2 * PATIENCE_S
    assert stages[-1].lit() == []


class Panel:
    """A projector's picture input and nothing else."""

    def __init__(self, name: str, size: tuple[int, int]) -> None:
        self.name, self.size = name, size

    def show(self, drive: np.ndarray) -> Shown:
        assert drive.shape == (self.size[1], self.size[0], 3)
        return Shown(drive, 0.0)


class BusyCamera:
    """Never sees the same picture twice."""

    name, size = CAMERA, TINY_PAIR.camera_size

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng

    def configure(self, settings: CameraSettings) -> CameraSettings:
        self._settings = settings
        return settings

    def capture(self) -> Frame:
        counts = self._rng.integers(500, 3000, (*self.size, 3)).astype(np.uint16)
        return Frame(counts, self._settings, 0.0, 1.0)


def test_projectors_may_differ_in_size(venue: Venue, rng: np.random.Generator) -> None:
    sizes = {"small": (64, 40), "large": (96, 60)}
    session = Session(venue.directory / "sessions" / "0001")
    session.write_plan(*plan_session(sizes, 0.1, 1.0))
    panels = {name: Panel(name, size) for name, size in sizes.items()}
    with Rig({CAMERA: BusyCamera(rng)}, panels, {}, SceneClock()) as rig:
        *_, last = capture(rig, venue, session)
    assert last.done == last.total == len(session.read_plan().shots)


@pytest.mark.parametrize(
    ("exposure", "words"),
    [("0.9", "of the pixels are saturated"), ("0.0002", "south is black in the photograph")],
)
def test_a_wrong_exposure_is_named(exposure: str, words: str, venue: Venue) -> None:
    path = venue.directory / "venue.toml"
    rewrite(path, "\nexposure_s = 0.13 ", f"\nexposure_s = {exposure} ")
    complaint = refused("session", "capture", venue.directory)
    assert "shot south-0000: " in complaint
    assert words in complaint


def test_a_camera_that_clips_below_its_full_scale_is_refused(
    venue: Venue, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its photographs would show no saturated pixel, and an m that is far too large."""

    def clipped(frame: Frame, _: int) -> Frame:
        level = max(int(np.quantile(frame.counts, 0.97)), 1000)
        return replace(frame, counts=np.minimum(frame.counts, level).astype(np.uint16))

    watch_stage(monkeypatch, put_in(lambda camera: AlteringCamera(camera, clipped)))
    assert "and none has more, though 12 bits allow 4095: the camera clips there" in refused(
        "session", "capture", venue.directory
    )


def test_the_faulty_preset_ends_in_the_right_named_errors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    venue = make_venue(tmp_path, "faulty", TINY_PAIR)
    stages = watch_stage(monkeypatch)
    with pytest.raises(NotConnected) as caught:
        take_session(venue)
    assert "projector north" in str(caught.value)
    assert stages[-1].wires["north"].port in str(caught.value)
    assert "cable" in str(caught.value)
    assert isinstance(stages[-1].backend.cameras[CAMERA], StaleCamera)
    files = pictures(tmp_path)  # the stale frame was taken again, and nothing of north is stored
    taken = stages[-1].backend.cameras[CAMERA]._taken
    assert len(files) == taken - 1 > STALE_FRAME
    assert not [name for name in files if "north" in name]
    assert len(set(files.values())) == len(files)
    ran = procam("session", "capture", venue.directory)
    assert ran.code == 1
    assert "projector north" in ran.complaint


def test_a_damaged_capture_is_refused_and_calibrations_stay_as_they_are(
    whole: Venue, tmp_path: Path
) -> None:
    """As edited by hand; test_session.py has other damages."""
    shutil.copytree(whole.directory, tmp_path, dirs_exist_ok=True)
    before = contents(tmp_path / "calibrations")
    path = tmp_path / "sessions" / "0001" / FRAMES / "south-0002@0.13.tif"
    pixels = np.array(read_image(path))
    pixels[0, 0] += 1
    write_image(path, pixels)
    complaint = refused("session", "solve", tmp_path / "sessions" / "0001")
    assert "differs from the frame captured for shot south-0002" in complaint
    assert str(tmp_path) in complaint
    assert contents(tmp_path / "calibrations") == before
