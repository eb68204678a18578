"""`procam doctor --behaviour` names the setting to switch off, and none of a sound projector."""

import json
import re
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import photographer
import pytest
from tiny_venue import CAMERA, Ran, procam, refused

import simulators.transport
from procam.devices.protocols import Camera, ControlState, Power
from procam.devices.rig import Rig
from procam.estimate.projector_tests.analysis import Effect
from procam.files.images.photos import read_photo
from procam.files.images.pixels import read_image, write_image
from procam.files.venue.load import Venue, load_venue
from procam.model.frame import CameraSettings, Frame
from procam.workflows.doctor.behaviour_by_hand import examine_behaviour_by_hand
from procam.workflows.doctor.doctor import examine
from procam.workflows.doctor.findings import (
    BEHAVIOUR,
    SWITCH,
    Behaviour,
    Diagnosis,
    judge_behaviour,
)
from procam.workflows.photographs.driven import Wanted
from simulators.builds import Features
from simulators.devices import SimulatedCamera, SimulatedProjector
from simulators.faults import AutoExposureCamera, FaultyCamera, GammaCamera
from simulators.presets import PRESETS, PresetName
from simulators.projector_state import ProjectorState
from simulators.scene import DomeScene, SceneSize
from simulators.template import venue_text

SIZE = SceneSize(1, (96, 60), camera_size=(240, 240), rays=64)
PHOTOGRAPHS = 24


@pytest.fixture(scope="module", autouse=True)
def small_and_quick() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulators.transport, "DOME_RINGS", 12)
        patch.setattr(simulators.transport, "DOME_SECTORS", 24)
        yield


class Shutter:
    """A remote control without a wire."""

    def __init__(self, state: ProjectorState) -> None:
        self._state = state

    def state(self) -> ControlState:
        return ControlState(Power.ON)

    def set_power(self, on: bool) -> None:
        raise AssertionError

    def set_input(self, source: str) -> None:
        raise AssertionError

    def set_shutter(self, closed: bool) -> None:
        self._state.set_muted(closed)

    def close(self) -> None:
        return


class Stage:
    """One venue whose projector is given other features from test to test."""

    def __init__(self, directory: Path, preset: PresetName, size: SceneSize = SIZE) -> None:
        directory.mkdir(parents=True, exist_ok=True)
        (directory / "venue.toml").write_text(venue_text(preset, size), "utf-8")
        self.venue: Venue = load_venue(directory)
        self.scene = DomeScene(PRESETS[preset], size, 1)

    def examined(
        self, wrap: dict[str, type[FaultyCamera]] | None = None, **sizes: float
    ) -> Diagnosis:
        """`procam doctor --behaviour` of a projector with some features."""
        scene, features = self.scene, Features(**sizes)
        for name, light in scene.lights.items():
            scene.lights[name] = replace(light, build=replace(light.build, features=features))
            scene.states[name] = ProjectorState(scene.clock, on=True, features=features)
        cameras: dict[str, Camera] = {n: SimulatedCamera(scene, n) for n in scene.cameras}
        cameras |= {name: kind(cameras[name]) for name, kind in (wrap or {}).items()}
        projectors = {n: SimulatedProjector(scene, n) for n in scene.lights}
        controls = {n: Shutter(state) for n, state in scene.states.items()}
        diagnosis = Diagnosis()
        with Rig(cameras, projectors, controls, scene.clock) as rig:
            events = list(examine(rig, self.venue, diagnosis, behaviour=True))
        assert [e.done for e in events] == list(range(1, events[0].total + 1))
        assert all(state.muted for state in scene.states.values())
        return diagnosis


@pytest.fixture(scope="module")
def standard(tmp_path_factory: pytest.TempPathFactory) -> Stage:
    return Stage(tmp_path_factory.mktemp("standard"), "standard")


def kinds(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    return [(f.device, f.kind) for f in diagnosis.findings]


def value(diagnosis: Diagnosis, name: str) -> float:
    return next(e.value for e in diagnosis.behaviour["south"].effects if e.name == name)


class TestSound:
    @pytest.mark.parametrize("preset", ["standard", "realistic"])
    def test_no_setting_is_blamed(self, preset: PresetName, tmp_path: Path) -> None:
        diagnosis = Stage(tmp_path, preset).examined()
        behaviour = diagnosis.behaviour["south"]
        assert (kinds(diagnosis), behaviour.untested) == ([], ())
        assert {e.name for e in behaviour.effects} == set(BEHAVIOUR)
        assert diagnosis.photographs == PHOTOGRAPHS + 10
        document = json.loads(json.dumps(diagnosis.as_dict(), allow_nan=False))
        assert {e["name"] for e in document["behaviour"]["south"]["effects"]} == set(BEHAVIOUR)
        assert value(diagnosis, "load-full") == pytest.approx(0, abs=2e-3)
        assert value(diagnosis, "primaries") == pytest.approx(0, abs=5e-3)


class TestFeatures:
    @pytest.mark.parametrize(
        ("feature", "size", "kind"),
        [
            ("white_boost", 0.02, "white-boost"),
            ("constant_light", 0.2, "constant-light"),
            ("dynamic_black", 0.012, "dynamic-black"),
            ("pixel_shift", 0.4, "pixel-shift"),
            ("limited_range", 1.0, "limited-range"),
            ("edge_enhancement", 0.08, "edge-enhancement"),
        ],
    )
    def test_each_is_named_alone(
        self, feature: str, size: float, kind: str, standard: Stage
    ) -> None:
        diagnosis = standard.examined(**{feature: size})
        assert kinds(diagnosis) == [("projector south", kind)]
        (finding,) = diagnosis.findings
        assert re.fullmatch(r"projector south: .+ \(needed: .+ at most\); .+", str(finding))
        assert finding.text.endswith(SWITCH[kind])

    def test_a_slow_iris_is_no_fault_of_the_camera(self, standard: Stage) -> None:
        diagnosis = standard.examined(dynamic_black=0.3, iris_s=4.0)
        assert kinds(diagnosis) == [("projector south", "dynamic-black")]
        # a second of white after half a minute of black, against ten seconds of white
        after_black = (1 - 0.3 * np.exp(-10 / 4)) / (1 - 0.3 * np.exp(-1.1 / 4))
        assert value(diagnosis, "white-after-black") == pytest.approx(after_black - 1, rel=0.1)
        assert "less strictly, as the light moves" in diagnosis.behaviour["south"].untested[0]

    def test_sizes_are_those_of_the_projector(self, standard: Stage) -> None:
        boosted = standard.examined(white_boost=0.25)
        assert value(boosted, "primaries") == pytest.approx(0.25, rel=0.15)
        assert kinds(boosted) == [("projector south", "white-boost")]
        late = standard.examined(picture_delay_s=0.3)
        assert kinds(late) == [("projector south", "slow-picture")]
        assert value(late, "after-0.2-s") == pytest.approx(0, abs=0.01)  # 0.1 s are gone by then
        assert value(late, "after-0-s") == pytest.approx(1, abs=0.01)


class TestCameras:
    @pytest.mark.parametrize(
        ("fault", "kind"), [(AutoExposureCamera, "auto-exposure"), (GammaCamera, "response")]
    )
    def test_their_faults_are_not_put_on_projectors(
        self, fault: type[FaultyCamera], kind: str, standard: Stage
    ) -> None:
        diagnosis = standard.examined({CAMERA: fault})
        assert kinds(diagnosis) == [(f"camera {CAMERA}", kind)]
        (why,) = diagnosis.behaviour["south"].untested
        assert re.search("does not follow its exposure|saturates", why)

    def test_a_coarse_one_cannot_tell_a_pixel_shift(self, tmp_path: Path) -> None:
        diagnosis = Stage(tmp_path, "standard", replace(SIZE, camera_size=(180, 180))).examined()
        assert kinds(diagnosis) == []
        (why,) = diagnosis.behaviour["south"].untested
        assert re.fullmatch(r"pixel shift: a projector pixel is 1\.\d camera pixels wide, .+", why)

    def test_one_that_sees_nothing_leaves_it_to_the_next(self, tmp_path: Path) -> None:
        class Capped(FaultyCamera):
            def capture(self) -> Frame:
                frame = super().capture()
                return replace(frame, counts=np.full_like(frame.counts, 64))

        stage = Stage(tmp_path, "standard", replace(SIZE, cameras=2, camera_size=(240, 240)))
        diagnosis = stage.examined({CAMERA: Capped})
        assert diagnosis.behaviour["south"].camera == "second"
        assert diagnosis.behaviour["south"].effects
        diagnosis = stage.examined({CAMERA: Capped, "second": Capped})
        assert diagnosis.behaviour["south"].untested == ("no light of it is seen",)


class TestCommand:
    def test_table_and_exit_code(self, tmp_path: Path) -> None:
        boosted = "features = { south = { white-boost = 0.1 } }\n"
        (tmp_path / "venue.toml").write_text(venue_text("standard", SIZE) + boosted, "utf-8")
        ran = procam("doctor", tmp_path, "--behaviour")
        assert (ran.code, ran.err) == (1, "")
        assert re.search(r"primaries +\+1[01]\.\d+% +0\.\d+% +1\.0%  WRONG", ran.out)
        assert re.search(r"\nWRONG  projector south: .+ switch .+white boost. off\n", ran.out)
        assert ran.out.splitlines()[-1] == "34 photographs, 1 finding"


class People:
    """People before two projectors, of which one boosts white, with a player and a camera."""

    def __init__(self, folder: Path) -> None:
        two = replace(SIZE, projectors=2, projector_size=(320, 200), camera_size=(384, 384))
        boosted = "features = { south = { white-boost = 0.1 } }\n"
        self.driven, self.venue, self._cards = folder / "driven", folder / "hand", folder
        for place in (self.driven, self.venue):
            place.mkdir()
        text = venue_text("standard", two)
        (self.driven / "venue.toml").write_text(text + boosted, "utf-8")
        lines = text.partition("[simulated]")[0].splitlines()
        own = [line for line in lines if not line.startswith(("backend = ", "control = "))]
        (self.venue / "venue.toml").write_text("\n".join(own) + "\n", "utf-8")

    def doctor(self, *more: object) -> Ran:
        return procam("doctor", self.venue, "--behaviour", "--camera", CAMERA, *more)

    def card(self, name: str) -> Path:
        """Photographs of the last round."""
        photos = self._cards / name
        photographer.main(self.driven, self.venue / "sessions" / "behaviour-0001", photos)
        return photos


class Capped:
    """People who forgot the lens cap."""

    notes, again = (), "again"

    def plan(self, wanted: Sequence[Wanted]) -> None:
        return

    def take(self, wanted: Wanted) -> Frame:
        counts = np.random.default_rng(1).integers(63, 66, (384, 384, 3)).astype(np.uint16)
        return Frame(counts, CameraSettings(wanted.exposure_s), 0.0, 0.1)

    def end(self) -> None:
        return


class TestByHand:
    @pytest.fixture
    def people(self, tmp_path: Path) -> People:
        return People(tmp_path)

    def test_photographs_by_hand_show_what_devices_show(self, people: People) -> None:
        first = people.doctor()
        then = f"then: procam doctor {people.venue} --behaviour --camera {CAMERA} --photos FOLDER"
        assert then in first.out and "1 of 5.241 s  15: south" in first.out  # steps near black
        one = people.card("one")
        _without_header(one / "img_1.tif")
        second = people.doctor("--photos", one)
        assert second.code == 0 and "settings of south" in second.out and then in second.out
        assert second.err.startswith("note: img_1.tif: no exposure in the headers of 1 photographs")
        two = people.card("two")
        (two / "img_1.tif").rename(people.venue / "slate.tif")
        shutil.copy(one / "img_1.tif", two / "img_1.tif")  # the player shows the projector before
        ran = people.doctor("--photos", two)
        assert (ran.code, "no readable number, but the slate of" in ran.complaint) == (2, True)
        (people.venue / "slate.tif").rename(two / "img_1.tif")
        ran = people.doctor("--photos", two)
        assert (ran.code, ran.err) == (1, "")
        assert re.search(r"primaries +\+1[01]\.\d+% +0\.\d+% +1\.0%  WRONG", ran.out)
        wrong = re.findall(r"\nWRONG  projector (\w+): .+ switch .+white boost. off", ran.out)
        assert wrong == ["south"]
        assert ran.out.count("photographs by hand come too late") == 2
        assert (people.venue / "sessions" / "behaviour-0001" / "ended").is_file()

    def test_exposures_that_differ_by_a_third_of_a_stop_count_as_they_are(
        self, people: People
    ) -> None:
        people.doctor()
        photos = people.card("one")
        asked = json.loads((people.venue / "sessions/behaviour-0001/wanted.json").read_bytes())
        shown = [entry["picture"] for entry in asked["photographs"]]
        for number in np.flatnonzero(np.isin(shown, [9, 10])):  # white beyond the patches
            _shorter(photos / f"img_{number}.tif", 2 ** (1 / 3))
        ran = people.doctor("--photos", photos)
        assert re.search(r"load-full +[-+]0\.\d+% .+%\n", ran.out), ran

    def test_what_shows_nothing_is_a_finding(self, people: People) -> None:
        """The lens cap is on."""
        venue, diagnosis, capped = load_venue(people.venue), Diagnosis(), Capped()
        examine_behaviour_by_hand(capped, venue, venue.cameras[CAMERA], diagnosis)  # type: ignore[arg-type]
        assert [(f.device, f.kind) for f in diagnosis.findings] == [
            ("projector south", "untested"),
            ("projector north", "untested"),
        ]
        assert "no light of it is seen" in str(diagnosis.findings[0])
        assert str(diagnosis.findings[0]).endswith("again")

    def test_devices_and_people_do_not_take_turns(self, people: People, tmp_path: Path) -> None:
        assert "driven by hand; leave it out" in refused(
            "doctor", people.driven, "--behaviour", "--photos", tmp_path
        )
        assert "--replace: goes with --behaviour" in refused(
            "doctor", people.venue, "--photos", tmp_path, "--replace"
        )
        assert "--camera: it is for photographs by hand" in refused(
            "doctor", people.driven, "--camera", CAMERA
        )
        text = (people.driven / "venue.toml").read_text("utf-8")
        mixed = text.replace('[projectors.north]\nbackend = "simulated"', "[projectors.north]")
        assert mixed != text
        (people.driven / "venue.toml").write_text(mixed, "utf-8")
        assert "or none; north is by hand. Remove" in refused(
            "doctor", people.driven, "--behaviour"
        )


def _without_header(path: Path) -> None:
    write_image(path, np.array(read_image(path)))


def _shorter(path: Path, factor: float) -> None:
    counts, exposure_s = np.array(read_image(path), float), read_photo(path).exposure_s
    assert exposure_s
    less = np.rint(64 + (counts - 64) / factor).astype(np.uint16)
    photographer.write_photo(path, less, exposure_s / factor)


class TestFindings:
    def test_the_strongest_sign_of_a_setting_counts(self) -> None:
        diagnosis = Diagnosis()
        effects = (
            Effect("load-half", -0.02, 1e-4, 0.005),
            Effect("load-full", -0.03, 1e-4, 0.005),
            Effect("white-after-black", 0.05, 1e-4, 0.01),
            Effect("primaries", 0.02, 0.01, 0.01),  # no more than noise
        )
        diagnosis.behaviour["south"] = Behaviour(CAMERA, effects)
        judge_behaviour(diagnosis, "south")
        assert [f.kind for f in diagnosis.findings] == ["constant-light", "dynamic-black"]
        assert str(diagnosis.findings[0]) == (
            "projector south: -3.0% (sigma 0.0%) in a white patch as white comes up elsewhere "
            '(needed: 0.5% at most); switch "constant light" / "constant brightness" and power saving off'
        )
