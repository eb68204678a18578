"""The backend of docs/howto/own-devices.md works as it stands there."""

import re
import sys
import types
from pathlib import Path

import cv2
import numpy as np
import pytest
from tiny_venue import CAMERA, make_venue

from procam.files.venue.load import load_venue
from procam.model.frame import CameraSettings
from procam.workflows import venue_rig
from procam.workflows.venue_rig import open_rig

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
