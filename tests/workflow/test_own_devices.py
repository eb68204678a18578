"""The backend of docs/howto/own-devices.md works as it stands there."""

import json
import re
import sys
import types
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from tiny_venue import (
    CAMERA,
    TINY_PAIR,
    drift,
    make_venue,
    procam,
    solved,
    take_session,
)

import simulators.backend
from procam.files.calibration import load_calibration
from procam.files.venue.load import load_venue
from procam.model.frame import CameraSettings
from procam.workflows import venue_rig
from procam.workflows.venue_rig import open_rig
from simulators.scene import DomeScene

PAGE = Path(__file__).parents[2] / "docs" / "howto" / "own-devices.md"
PHOTOGRAPH = """\
import sys, cv2, numpy as np
shown = cv2.imread("{shown}")[..., 1].astype(float) / 255
counts = np.full((200, 200, 3), 64 + 2000 * float(sys.argv[1]) * shown.mean())
cv2.imwrite(sys.argv[2], counts.astype(np.uint16))
"""


@pytest.fixture
def backend(monkeypatch: pytest.MonkeyPatch) -> types.ModuleType:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    module = types.ModuleType("procam_files")
    exec(compile(code, str(PAGE), "exec"), vars(module))
    real = venue_rig.open_backend
    monkeypatch.setattr(venue_rig, "known_backends", lambda: ["files", "simulated"])
    monkeypatch.setattr(
        venue_rig,
        "open_backend",
        lambda name, *given: module.open_rig(*given) if name == "files" else real(name, *given),
    )
    return module


def test_the_example(
    backend: types.ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = make_venue(tmp_path / "dome").directory
    script = tmp_path / "photograph.py"
    script.write_text(PHOTOGRAPH.format(shown=folder / "south.png"))
    text = (folder / "venue.toml").read_text("utf-8").partition("[simulated]")[0]
    text = re.sub(r"(?m)^control = .*$", "", text).replace('"simulated"', '"files"')
    (folder / "venue.toml").write_text(
        f"""{text}
[files.cameras.{CAMERA}]
size = [200, 200]
command = ["{sys.executable}", "{script}"]
[files.projectors.south]
size = [128, 80]
file = "south.png"
settle_s = 0.0
"""
    )
    monkeypatch.chdir(tmp_path)
    with open_rig(load_venue(folder)) as rig:
        shown = rig.projectors["south"].show(np.full((80, 128, 3), 0.5, np.float32))
        assert shown.drive[0, 0, 0] == pytest.approx(128 / 255)
        camera = rig.cameras[CAMERA]
        in_force = camera.configure(CameraSettings(0.5))
        frame = camera.capture()
        assert frame.settings == in_force and frame.counts.shape == (200, 200, 3)
        assert frame.counts.mean() == pytest.approx(64 + 1000 * 128 / 255, abs=1)
        assert camera.configure(CameraSettings(0.5, "mono")).pixel_format == "mono"
        assert camera.capture().counts.shape == (200, 200)
    assert not cv2.imread(str(folder / "south.png")).any()  # dark at the end


def test_black_of_a_rig_without_shutters_is_noted_and_within_its_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same dome twice: with shutters black is measured, without them the dark holds it."""
    size = replace(TINY_PAIR, projector_size=(160, 100), camera_size=(256, 256), map_size=256)
    venue = make_venue(tmp_path / "with", size=size)
    measured = load_calibration(solved(venue, take_session(venue)))
    assert "black_level" not in measured.quality
    build = simulators.backend.build_scene

    def always_lit(*where: object) -> DomeScene:
        scene = build(*where)  # type: ignore[arg-type]
        for state in scene.states.values():
            state.switch_on()
        scene.clock.sleep(3600)
        return scene

    monkeypatch.setattr(simulators.backend, "build_scene", always_lit)
    folder = make_venue(tmp_path / "without", size=size).directory
    text = (folder / "venue.toml").read_text("utf-8")
    (folder / "venue.toml").write_text(re.sub(r"(?m)^control = .*$", "", text))
    ran = procam("calibrate", folder)
    assert ran.code == 0, ran
    assert "note: black of south, north: procam has no shutter to close there" in ran.out
    estimated = load_calibration(folder / "calibrations" / "0001")
    ran = procam("verify", folder)
    assert (ran.code, "all is well" in ran.out) == (0, True), ran
    advised = procam("doctor", folder, "--json").out
    for each in (venue.directory, folder):
        drift(each, '{ kind = "raised-black", projector = "south", size = 0.045 }')
        ran = procam("recalibrate", each, "--projector", "south")
        assert ran.code == 0, ran
    repaired = [
        load_calibration(each / "calibrations" / "0002") for each in (venue.directory, folder)
    ]
    lit = measured.maps.coverage > 0.99
    figure = estimated.quality["black_level"]
    true = measured.maps.lo[lit].mean(axis=0)
    assert np.all(np.abs(np.array(figure.value) - true) < 2 * np.array(figure.sigma))
    assert np.all(np.array(figure.sigma) < 0.5 * true)
    rise = [
        new.maps.lo[lit].mean(axis=0) - old.maps.lo[lit].mean(axis=0)
        for new, old in zip(repaired, (measured, estimated), strict=True)
    ]
    assert np.all(rise[0] > 0.3 * true) and rise[1] == pytest.approx(rise[0], rel=0.1)
    document = json.loads(advised)
    assert (
        document["capture"]["black_exposure_s"] >= load_venue(folder).table.capture.black_exposure_s
    )
    assert "black-too-short" not in {finding["kind"] for finding in document["findings"]}
