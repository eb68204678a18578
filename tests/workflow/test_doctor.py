"""`procam doctor` passes a sound venue, names each fault in one line, and leaves the dome dark."""

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from tiny_venue import (
    CAMERA,
    TINY,
    TINY_PAIR,
    Ran,
    Stage,
    make_venue,
    procam,
    quick_simulator,
    replace_camera,
    take_session,
    watch_stage,
)

from procam.devices.protocols import BackendRig
from procam.estimate.camera.radiance import Radiometer
from procam.files.venue.load import Venue, load_venue
from procam.model.frame import Frame
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.doctor.doctor import examine
from procam.workflows.doctor.findings import Diagnosis
from procam.workflows.solve.decode import decode_pixels
from procam.workflows.venue_rig import open_rig
from simulators.faults import FaultyCamera, FaultyProjector, apply_faults
from simulators.scene import SceneSize
from simulators.template import venue_text

MOST_PHOTOGRAPHS = 15  # two of the dark, five of each projector, three more with the first


@pytest.fixture(scope="module", autouse=True)
def small_and_quick() -> Iterator[None]:
    with quick_simulator():
        yield


def struck(*names: str) -> Callable[[Stage], BackendRig]:
    """Alters a stage by named faults."""
    return lambda stage: apply_faults(stage.backend, stage.wires, names)


def examined(
    directory: Path,
    monkeypatch: pytest.MonkeyPatch,
    alter: Callable[[Stage], BackendRig] = lambda stage: stage.backend,
    size: SceneSize = TINY_PAIR,
) -> tuple[Ran, Stage]:
    """Run `procam doctor --json` on a venue."""
    make_venue(directory, size=size)
    return again(directory, monkeypatch, alter)


def again(
    directory: Path, monkeypatch: pytest.MonkeyPatch, alter: Callable[[Stage], BackendRig]
) -> tuple[Ran, Stage]:
    stages = watch_stage(monkeypatch, alter)
    ran = procam("doctor", directory, "--json")
    return ran, stages[-1]


def findings(ran: Ran) -> list[tuple[str, str]]:
    """(device, kind) of each finding; each must be one line that says what to try."""
    document = json.loads(ran.out)
    assert ran.code == (1 if document["findings"] else 0)
    for finding in document["findings"]:
        assert re.fullmatch(r"(camera|projector) \S+: .+; .+", finding["line"])
    return [(f["device"], f["kind"]) for f in document["findings"]]


class TestSound:
    def test_all_is_well(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        ran, stage = examined(tmp_path, monkeypatch)
        document = json.loads(ran.out)
        assert (ran.code, findings(ran), stage.lit()) == (0, [], [])
        assert document["photographs"] == MOST_PHOTOGRAPHS
        assert {v["projector"] for v in document["views"]} == set(stage.scene.lights)
        camera = document["cameras"][CAMERA]
        assert camera["black_level_dn"] == pytest.approx(64, abs=0.3)
        assert camera["exponents"] == pytest.approx([1, 1], abs=0.01)
        for view in document["views"]:
            assert view["gamma"] == pytest.approx(2.15, abs=0.1)
            assert view["additivity"] == pytest.approx(1, abs=0.005)
        assert set(document["controls"]) == set(stage.scene.lights)

    def test_the_table_for_people(self, tmp_path: Path) -> None:
        venue = make_venue(tmp_path)
        ran = procam("doctor", tmp_path)
        assert (ran.code, ran.err) == (0, "")
        capture = re.search(r"exposure_s = (\S+), black_exposure_s = (\S+)", ran.out)
        assert capture is not None
        assert float(capture[1]) == pytest.approx(venue.table.capture.exposure_s, rel=0.1)
        assert ran.out.splitlines()[-1] == "10 photographs, all is well"

    @pytest.mark.parametrize("preset", ["ideal", "realistic"])
    def test_other_presets(self, preset: str, tmp_path: Path) -> None:
        make_venue(tmp_path, preset)  # type: ignore[arg-type]
        assert findings(procam("doctor", tmp_path, "--json")) == []

    @pytest.mark.parametrize("snr", [15.0, 60.0])
    def test_the_ratio_is_the_one_the_simulator_was_given(self, snr: float, tmp_path: Path) -> None:
        size = SceneSize(1, (320, 200), camera_size=(400, 400), rays=64)  # its darkest is no edge
        (tmp_path / "venue.toml").write_text(venue_text("standard", size, snr=snr), "utf-8")
        (view,) = json.loads(procam("doctor", tmp_path, "--json").out)["views"]
        venue = load_venue(tmp_path)
        longer = view["plan"]["exposure_s"] / venue.table.capture.exposure_s
        assert view["plan"]["snr"] == pytest.approx(snr * longer**0.5, rel=0.08)

    def test_the_error_is_the_one_the_decoder_finds(self, tmp_path: Path) -> None:
        size = SceneSize(1, (320, 200), camera_size=(330, 330), rays=64)
        venue = make_venue(tmp_path, size=size)
        (view,) = json.loads(procam("doctor", tmp_path, "--json").out)["views"]
        session = take_session(venue)
        readings = SessionImages(session, session.read_plan(), Radiometer(venue.cameras["zenith"]))
        pixels = decode_pixels(venue, readings, "south")
        found = pixels.map
        assert pixels.notes == []
        median = np.median(found.sigma_px[found.valid])
        # blur is not foreseen, and takes a little of the waves
        assert view["plan"]["column_sigma_px"] == pytest.approx(0.93 * median, rel=0.1)

    def test_events_count_up_to_their_total(self, tmp_path: Path) -> None:
        venue, diagnosis = make_venue(tmp_path), Diagnosis()
        with open_rig(venue) as rig:
            events = list(examine(rig, venue, diagnosis))
        assert [e.done for e in events] == list(range(1, events[0].total + 1))


class TestCameraFaults:
    @pytest.mark.parametrize(
        ("fault", "kind"),
        [
            ("auto-exposure", "auto-exposure"),
            ("camera-gamma", "response"),
            ("ambient-light", "ambient"),
            ("stuck-exposure", "settings"),
            ("stale-frame", "stale"),
        ],
    )
    def test_each_is_named_alone(
        self, fault: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        ran, stage = examined(tmp_path, monkeypatch, struck(fault))
        assert findings(ran) == [(f"camera {CAMERA}", kind)]
        assert stage.lit() == []

    def test_a_wrong_black_level(self, tmp_path: Path) -> None:
        make_venue(tmp_path)
        rewrite(tmp_path, "black_level = 64.0", "black_level = 50.0")
        ran = procam("doctor", tmp_path, "--json")
        assert findings(ran) == [(f"camera {CAMERA}", "black-level")]
        assert "set black_level = 64.0" in ran.out

    def test_wrong_bits(self, tmp_path: Path) -> None:
        make_venue(tmp_path)
        rewrite(tmp_path, "bits = 12", "bits = 10")
        assert (f"camera {CAMERA}", "bits") in findings(procam("doctor", tmp_path, "--json"))

    def test_a_camera_that_does_not_answer(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        class Dead(FaultyCamera):
            def capture(self) -> Frame:
                from procam.errors import NotConnected

                raise NotConnected("no answer; plug its cable in")

        def dead(stage: Stage) -> BackendRig:
            return replace_camera(stage.backend, Dead)

        ran, stage = examined(tmp_path, monkeypatch, dead)
        assert findings(ran) == [(f"camera {CAMERA}", "NotConnected")]
        assert stage.lit() == []

    def test_a_picture_of_the_wrong_size(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        class Small(FaultyCamera):
            def capture(self) -> Frame:
                frame = super().capture()
                return Frame(frame.counts[:100], frame.settings, frame.started_s, frame.ended_s)

        ran, _ = examined(tmp_path, monkeypatch, lambda s: replace_camera(s.backend, Small))
        assert findings(ran) == [(f"camera {CAMERA}", "DeviceError")]
        assert "200x100 px, but venue.toml says 200x200" in ran.out


class TestProjectorFaults:
    @pytest.mark.parametrize(
        ("fault", "kind"), [("dim-projector", "too-dim"), ("dynamic-black", "dynamic-black")]
    )
    def test_each_is_named_alone(
        self, fault: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        ran, stage = examined(tmp_path, monkeypatch, struck(fault))
        assert findings(ran) == [("projector north", kind)]
        assert stage.lit() == []

    @pytest.mark.parametrize(("factor", "kind"), [(0.1, "too-dim"), (8.0, "too-bright")])
    def test_the_exposure_it_names_puts_it_right(
        self, factor: float, kind: str, tmp_path: Path
    ) -> None:
        venue = make_venue(tmp_path)
        right = venue.table.capture.exposure_s
        rewrite(tmp_path, f"exposure_s = {right} ", f"exposure_s = {right * factor:.4g} ")
        ran = procam("doctor", tmp_path, "--json")
        assert findings(ran) == [("projector south", kind)]
        line = re.search(r"set exposure_s = (\S+), black_exposure_s = (\S+) under", ran.out)
        assert line is not None
        rewrite(tmp_path, f"exposure_s = {right * factor:.4g} ", f"exposure_s = {line[1]} ")
        assert findings(procam("doctor", tmp_path, "--json")) == []

    def test_a_short_black(self, tmp_path: Path) -> None:
        make_venue(tmp_path)
        rewrite(tmp_path, "black_exposure_s = 6.5", "black_exposure_s = 0.2")
        assert findings(procam("doctor", tmp_path, "--json")) == [
            ("projector south", "black-too-short")
        ]

    def test_no_light(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def dark(stage: Stage) -> BackendRig:
            return with_last_projector(stage.backend, lambda drive: 0 * drive)

        ran, stage = examined(tmp_path, monkeypatch, dark)
        assert findings(ran) == [("projector north", "no-light")]
        assert stage.lit() == []

    def test_another_gamma(self, tmp_path: Path) -> None:
        text = venue_text("standard", TINY, gamma_left=0.6)
        (tmp_path / "venue.toml").write_text(text, "utf-8")
        assert findings(procam("doctor", tmp_path, "--json")) == [("projector south", "gamma")]

    def test_a_complaint_of_its_own(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def hot(stage: Stage) -> BackendRig:
            stage.scene.states["south"].report_error("04")
            return stage.backend

        ran, _ = examined(tmp_path, monkeypatch, hot)
        assert findings(ran) == [("projector south", "complaint")]
        assert "internal temperature high" in ran.out

    def test_a_cable_pulled_on_the_way(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        ran, stage = examined(tmp_path, monkeypatch, struck("unplugged-serial"))
        document = json.loads(ran.out)
        assert ran.code == 1
        assert [f["device"] for f in document["findings"]] == ["projector north", "rig"]
        assert "check that the cable is plugged in" in document["findings"][0]["line"]
        assert "a projector may still be lit: north (" in document["findings"][1]["line"]
        assert [v["projector"] for v in document["views"]] == ["south"]
        assert not stage.scene.shown["north"].any()


class TestEnd:
    def test_an_interrupted_run_leaves_the_dome_dark(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        class Interrupted(FaultyCamera):
            taken = 0

            def capture(self) -> Frame:
                self.taken += 1
                if self.taken == 5:
                    raise KeyboardInterrupt
                return super().capture()

        make_venue(tmp_path)
        stages = watch_stage(monkeypatch, lambda s: replace_camera(s.backend, Interrupted))
        assert procam("doctor", tmp_path).code == 130
        assert stages[-1].lit() == []

    def test_bad_input_is_no_finding(self, tmp_path: Path) -> None:
        make_venue(tmp_path)
        rewrite(tmp_path, "[cameras.zenith]", "[cameras.nadir]")
        ran = procam("doctor", tmp_path)
        assert (ran.code, ran.out) == (2, "")


def rewrite(directory: Path, old: str, new: str) -> Venue:
    """Change a line of venue.toml."""
    path = directory / "venue.toml"
    text = path.read_text("utf-8")
    assert old in text
    path.write_text(text.replace(old, new), "utf-8")
    return load_venue(directory) if "nadir" not in new else None  # type: ignore[return-value]


def with_last_projector(rig: BackendRig, alter: Callable[[np.ndarray], np.ndarray]) -> BackendRig:
    from dataclasses import replace

    last = list(rig.projectors)[-1]
    struck = FaultyProjector(rig.projectors[last], alter)
    return replace(rig, projectors={**rig.projectors, last: struck})
