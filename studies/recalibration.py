"""One nudged projector of six, recalibrated alone: how many shots, and how good beside a whole calibration?

A simulated dome is calibrated, one projector is turned by half a degree, and the dome is calibrated again:
once by `procam recalibrate`, once as a whole. Writes studies/recalibration.json and studies/recalibration.md;
`python -m studies recalibration` remakes them in five minutes. tests/workflow/test_recalibrate.py has a
small one.
"""

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from procam.files.calibration import load_calibration
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.interfaces.judge import direction_errors
from procam.workflows.capture.newest import capture_newest
from procam.workflows.recalibrate import recalibrate
from procam.workflows.solve.calibrate import solve
from simulators.backend import build_scene
from simulators.scene import DomeScene
from studies.drifts import make_venue
from studies.measure import rms, write

PROJECTORS, EVERY = 6, 5
NUDGED = ("south", "east", "fore")
SIZE_DEG = 0.5


def main() -> None:
    """Nudge three projectors, one at a time, and write studies/recalibration.json and .md."""
    with tempfile.TemporaryDirectory() as folder:
        make_venue(Path(folder) / "venue", "standard", PROJECTORS)
        rows = [_row(Path(folder) / "venue", Path(folder) / name, name) for name in NUDGED]
    write("recalibration", {"rows": rows}, _table(rows))


def _row(calibrated: Path, folder: Path, name: str) -> dict[str, Any]:
    """One projector nudged: shots, and errors of directions less a common rotation [arcmin]."""
    part, whole = (Path(shutil.copytree(calibrated, folder / kind)) for kind in ("part", "whole"))
    for venue in (part, whole):
        with (venue / "venue.toml").open("a", encoding="utf-8") as file:
            drift = f'kind = "turned", projector = "{name}", size = {SIZE_DEG}, angle_deg = 40'
            file.write(f"session = 1\ndrifts = [{{ {drift} }}]\n")
    events = list(recalibrate(load_venue(part), part / "calibrations" / "0001", [name]))
    shots = sum(event.stage == "verify" for event in events) - 1
    plan = Session(Path(events[-1].data["session"])).read_plan()
    shots += sum(shot.projector == name for shot in plan.shots)
    *_, captured = capture_newest(load_venue(whole))
    *_, solved = solve(load_venue(whole), Session(captured.data["session"]))
    scene = build_scene(load_venue(part).backends["simulated"], part)
    return {
        "projector": name,
        "shots": shots,
        "whole_shots": len(plan.shots),
        "before": _error(scene, part / "calibrations" / "0001"),
        "part": _error(scene, part / "calibrations" / "0002"),
        "whole": _error(scene, Path(solved.data["calibration"])),
    }


def _error(scene: DomeScene, path: Path) -> float:
    calibration, estimate, true = load_calibration(path), [], []
    for name, projector in calibration.projectors.items():
        use = projector.surface.valid & scene.lights[name].lit
        estimate.append(projector.surface.direction[use][::EVERY].astype(float))
        true.append(scene.lights[name].direction[use][::EVERY])
    _, relative = direction_errors(np.concatenate(estimate), np.concatenate(true))
    return float(rms(relative))


def _table(rows: list[dict[str, Any]]) -> Iterator[str]:
    yield from (
        "# One nudged projector of six",
        "",
        f"Turned by {SIZE_DEG:g} degrees. Shots include those that check the camera and the room; errors are "
        "of directions less a common rotation, root mean square over all projectors.",
        "",
        "| projector | shots, of a whole session's | before [arcmin] | recalibrated | as a whole |",
        "|---|---|---|---|---|",
    )
    for row in rows:
        share = f"{row['shots']} of {row['whole_shots']}, {row['shots'] / row['whole_shots']:.0%}"
        errors = " | ".join(f"{row[key]:.3g}" for key in ("before", "part", "whole"))
        yield f"| {row['projector']} | {share} | {errors} |"
