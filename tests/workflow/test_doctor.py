"""`procam doctor` passes a sound venue, names each fault in one line, and leaves the dome dark."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from edited_files import rewrite
from tiny_venue import (
    CAMERA,
    TINY,
    TINY_PAIR,
    Ran,
    Stage,
    make_venue,
    procam,
    replace_camera,
    take_session,
    watch_stage,
)

from procam.devices.protocols import BackendRig
from procam.errors import NotConnected
from procam.estimate.camera.radiance import Radiometer
from procam.files.venue.load import load_venue
from procam.model.frame import Frame
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.solve.decode import decode_pixels
from simulators.faults import FaultyProjector, apply_faults
from simulators.mistakes import AlteringCamera
from simulators.scene import SceneSize
from simulators.template import venue_text

MOST_PHOTOGRAPHS = 15  # two of the dark, five of each projector, three more with the first


def struck(*names: str) -> Callable[[Stage], BackendRig]:
    """Alters a stage by named faults."""
    return lambda stage: apply_faults(stage.backend, stage.wires, names)


def altered(change: Callable[[Frame, int], Frame]) -> Callable[[Stage], BackendRig]:
    """Alters a stage by a camera whose photographs change."""
    return lambda stage: replace_camera(stage.backend, lambda c: AlteringCamera(c, change))


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


@pytest.mark.parametrize(
    ("fault", "device", "kind"),
    [
        ("auto-exposure", "camera zenith", "auto-exposure"),
        ("camera-gamma", "camera zenith", "response"),
        ("ambient-light", "camera zenith", "ambient"),
        ("stuck-exposure", "camera zenith", "settings"),
        ("stale-frame", "camera zenith", "stale"),
        ("dim-projector", "projector north", "too-dim"),
        ("dynamic-black", "projector north", "dynamic-black"),
    ],
)
def test_each_is_named_alone(
    fault: str, device: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran, stage = examined(tmp_path, monkeypatch, struck(fault))
    assert findings(ran) == [(device, kind)]
    assert stage.lit() == []


class TestCameraFaults:
    def test_a_wrong_black_level(self, tmp_path: Path) -> None:
        make_venue(tmp_path)
        rewrite(tmp_path / "venue.toml", "black_level = 64.0", "black_level = 50.0")
        ran = procam("doctor", tmp_path, "--json")
        assert findings(ran) == [(f"camera {CAMERA}", "black-level")]
        assert "set black_level = 64.0" in ran.out

    def test_wrong_bits(self, tmp_path: Path) -> None:
        make_venue(tmp_path)
        rewrite(tmp_path / "venue.toml", "bits = 12", "bits = 10")
        assert (f"camera {CAMERA}", "bits") in findings(procam("doctor", tmp_path, "--json"))

    def test_a_camera_that_does_not_answer(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def dead(frame: Frame, taken: int) -> Frame:
            raise NotConnected("no answer; plug its cable in")

        ran, stage = examined(tmp_path, monkeypatch, altered(dead))
        assert findings(ran) == [(f"camera {CAMERA}", "NotConnected")]
        assert stage.lit() == []

    def test_a_picture_of_the_wrong_size(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        small = altered(lambda frame, _: replace(frame, counts=frame.counts[:100]))
        ran, _ = examined(tmp_path, monkeypatch, small)
        assert findings(ran) == [(f"camera {CAMERA}", "DeviceError")]
        assert "200x100 px, but venue.toml says 200x200" in ran.out


class TestProjectorFaults:
    @pytest.mark.parametrize(("factor", "kind"), [(0.1, "too-dim"), (8.0, "too-bright")])
    def test_the_exposure_it_names_puts_it_right(
        self, factor: float, kind: str, tmp_path: Path
    ) -> None:
        venue = make_venue(tmp_path)
        right = venue.table.capture.exposure_s
        rewrite(
            tmp_path / "venue.toml", f"exposure_s = {right} ", f"exposure_s = {right * factor:.4g} "
        )
        ran = procam("doctor", tmp_path, "--json")
        assert findings(ran) == [("projector south", kind)]
        line = re.search(r"set exposure_s = (\S+), black_exposure_s = (\S+) under", ran.out)
        assert line is not None
        rewrite(
            tmp_path / "venue.toml",
            f"exposure_s = {right * factor:.4g} ",
            f"exposure_s = {line[1]} ",
        )
        assert findings(procam("doctor", tmp_path, "--json")) == []

    def test_a_short_black(self, tmp_path: Path) -> None:
        make_venue(tmp_path)
        rewrite(tmp_path / "venue.toml", "black_exposure_s = 6.5", "black_exposure_s = 0.2")
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
        def interrupted(frame: Frame, taken: int) -> Frame:
            if taken == 4:
                raise KeyboardInterrupt
            return frame

        make_venue(tmp_path)
        stages = watch_stage(monkeypatch, altered(interrupted))
        assert procam("doctor", tmp_path).code == 130
        assert stages[-1].lit() == []

    def test_bad_input_is_no_finding(self, tmp_path: Path) -> None:
        make_venue(tmp_path)
        rewrite(tmp_path / "venue.toml", "[cameras.zenith]", "[cameras.nadir]")
        ran = procam("doctor", tmp_path)
        assert (ran.code, ran.out) == (2, "")


def with_last_projector(rig: BackendRig, alter: Callable[[np.ndarray], np.ndarray]) -> BackendRig:
    last = list(rig.projectors)[-1]
    struck = FaultyProjector(rig.projectors[last], alter)
    return replace(rig, projectors={**rig.projectors, last: struck})
