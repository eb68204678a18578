"""One projector measured again, beside a whole calibration: shots, directions, and what an audience sees.

Simulated domes are calibrated, one projector is turned by half a degree or loses a tenth of its light,
and the dome is calibrated again: once by `procam recalibrate`, once as a whole. Domes behind media servers
of several canvases are calibrated once. All are judged by the frames that each projector is sent and by the
picture on the dome. Writes studies/recalibration.json and studies/recalibration.md; `python -m studies
recalibration` remakes them in an hour. tests/workflow/test_recalibrate.py and test_server.py have small
ones.
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
from procam.generators import converted, result_of
from procam.interfaces.judge import direction_errors
from procam.workflows.capture.newest import capture_newest
from procam.workflows.recalibrate.recalibrate import recalibrate
from procam.workflows.solve.calibrate import solve
from procam.workflows.venue_rig import rig_owner
from simulators.backend import build_scene
from simulators.scene import DomeScene, SceneSize
from simulators.template import SIZES, server_text, venue_text
from studies.measure import rms, side_by_side, write
from studies.seen import Seen, front, grey, seen

EVERY = 5  # pixels of a panel, along rows and columns
CHANGES = {"turned": 0.5, "aged": 0.1}  # by degrees; by a share of its light
CAMERA = (800, 800)
PAIR = ("south", "north")
# venue, its devices, the projectors that are changed in turn
VENUES = {
    "small": (SIZES["small"], PAIR),
    "standard": (SceneSize(2, (640, 400), 1, CAMERA, rays=512), PAIR),
    "two cameras": (SceneSize(2, (640, 400), 2, CAMERA, rays=512), PAIR),
    "six projectors": (
        SceneSize(6, (320, 200), 1, (600, 600), rays=512),
        (*PAIR, "east", "west", "aft", "fore"),
    ),
}
SERVERS = ((180, 0), (220, 0), (180, 90), (220, -50))  # field of view and rotation [deg]
SERVER_SIZE, MASTER = SceneSize(2, (640, 400), 1, CAMERA, rays=512), 1024


def main() -> None:
    """Nudge projectors, one at a time, calibrate behind servers, and write the results."""
    cases = [(venue, name) for venue, (_, names) in VENUES.items() for name in names]
    rows = [row for some in side_by_side(_changed_rows, cases) for row in some]
    served = side_by_side(_served_row, SERVERS)
    write("recalibration", {"rows": rows, "servers": served}, _tables(rows, served))


def _changed_rows(case: tuple[str, str]) -> list[dict[str, Any]]:
    """A projector turned, and the same dimmed."""
    venue, name = case
    size, _ = VENUES[venue]
    with tempfile.TemporaryDirectory() as folder:
        calibrated = Path(folder) / "calibrated"
        _calibrate(calibrated, venue_text("standard", size))
        return [
            {"venue": venue, "change": kind} | _row(calibrated, Path(folder) / kind, name, kind)
            for kind in CHANGES
        ]


def _calibrate(folder: Path, text: str) -> Path:
    """Write venue.toml and calibrate; returns the calibration's folder."""
    folder.mkdir(exist_ok=True)
    (folder / "venue.toml").write_text(text, "utf-8")
    return _calibrate_again(folder)


def _calibrate_again(folder: Path) -> Path:
    venue = load_venue(folder)
    return result_of(solve(venue, result_of(capture_newest(venue)))).directory


def _row(calibrated: Path, folder: Path, name: str, kind: str) -> dict[str, Any]:
    """One projector changed: shots, directions less a common rotation [arcmin], and what is seen."""
    part, whole = (Path(shutil.copytree(calibrated, folder / kind)) for kind in ("part", "whole"))
    for venue in (part, whole):
        with (venue / "venue.toml").open("a", encoding="utf-8") as file:
            drift = f'kind = "{kind}", projector = "{name}", size = {CHANGES[kind]}, angle_deg = 40'
            file.write(f"session = 1\ndrifts = [{{ {drift} }}]\n")
    venue = load_venue(part)
    with rig_owner(venue) as rig:
        stages = list[str]()
        steps = recalibrate(rig, venue, part / "calibrations" / "0001", [name])
        made = result_of(converted(steps, lambda event: stages.append(event.stage)))
    assert made.session is not None
    plan = Session(made.session).read_plan()
    shots = stages.count("verify") - 1
    shots += sum(shot.projector == name for shot in plan.shots)
    found = {"before": part / "calibrations" / "0001", "part": part / "calibrations" / "0002"}
    found["whole"] = _calibrate_again(whole)
    scene = build_scene(load_venue(part).backends["simulated"], part)
    shown = {key: seen(part, path, grey()) for key, path in found.items()}
    return {
        "projector": name,
        "shots": shots,
        "whole_shots": len(Session(part / "sessions" / "0001").read_plan().shots),
        "notes": made.notes,
        **{key: _error(scene, path) for key, path in found.items()},
        "seen": {key: _figures(each, name) for key, each in shown.items()},
        "beside": _beside(shown["part"], shown["whole"]),
    }


def _beside(part: Seen, whole: Seen) -> dict[str, float]:
    """Frames and picture of a recalibration beside those of a whole one; the picture over white.

    Of all projectors the largest difference of the share that sends light, and of the mean drive.
    """
    use = part.judged & whole.judged
    off = part.total - whole.total
    return {
        "share_lit": max(abs(part.share_lit[n] - whole.share_lit[n]) for n in part.share_lit),
        "mean": max(abs(part.mean[n] / whole.mean[n] - 1) for n in part.mean),
        "picture": float(rms(off[use])),
        "seams": float(rms(off[use & part.seam])),
    }


def _served_row(canvas: tuple[int, int]) -> dict[str, Any]:
    fov_deg, rotation_deg = canvas
    text = server_text(SERVER_SIZE, MASTER).replace("fov_deg = 180.0", f"fov_deg = {fov_deg}")
    text = text.replace("rotation_deg = 0.0", f"rotation_deg = {rotation_deg}")
    text += f"server_fov_deg = {fov_deg}\nserver_rotation_deg = {rotation_deg}\n"
    with tempfile.TemporaryDirectory() as folder:
        calibration = _calibrate(Path(folder), text)
        shown = seen(Path(folder), calibration, front(load_calibration(calibration).canvas))
    return {"fov_deg": fov_deg, "rotation_deg": rotation_deg, **_figures(shown, "server")}


def _figures(shown: Seen, name: str) -> dict[str, float]:
    """Of a projector: share of its panel that is lit, mean drive; of the picture: errors over its mean."""
    return {
        "share_lit": shown.share_lit[name],
        "mean": shown.mean[name],
        "level": shown.level,
        "error": shown.error(),
        "seam_error": shown.error(shown.seam),
    }


def _error(scene: DomeScene, path: Path) -> float:
    calibration, estimate, true = load_calibration(path), [], []
    for name, projector in calibration.projectors.items():
        use = projector.surface.valid & scene.lights[name].lit
        estimate.append(projector.surface.direction[use][::EVERY].astype(float))
        true.append(scene.lights[name].direction[use][::EVERY])
    _, relative = direction_errors(np.concatenate(estimate), np.concatenate(true))
    return float(rms(relative))


def _tables(rows: list[dict[str, Any]], served: list[dict[str, Any]]) -> Iterator[str]:
    yield from (
        "# One projector measured again",
        "",
        f"Turned by {CHANGES['turned']:g} degrees, or dimmed by {CHANGES['aged']:.0%}. Shots include those "
        "that check the camera and the room; errors are of directions less a common rotation, root mean "
        "square over all projectors.",
        "",
        "| venue | projector | shots, of a whole session's | before [arcmin] | recalibrated | as a whole |",
        "|---|---|---|---|---|---|",
    )
    for row in rows:
        share = f"{row['shots']} of {row['whole_shots']}, {row['shots'] / row['whole_shots']:.0%}"
        errors = " | ".join(f"{row[key]:.3g}" for key in ("before", "part", "whole"))
        yield f"| {row['venue']} | {_changed(row)} | {share} | {errors} |"
    yield from (
        "",
        "The recalibration's frames and picture beside those of the whole one, of an even grey of 0.4 with "
        "every projector lit: over all projectors the largest difference of the share of a panel that sends "
        "light and of the mean drive; root mean square difference of what is seen, over white, everywhere "
        "and where projectors overlap.",
        "",
        "| venue | projector | lit | mean drive | picture | seams |",
        "|---|---|---|---|---|---|",
    )
    for row in rows:
        cells = " | ".join(f"{value:.2%}" for value in row["beside"].values())
        yield f"| {row['venue']} | {_changed(row)} | {cells} |"
    yield from (
        "",
        "The same, each by itself: of the changed projector the share of its panel that sends light and its "
        "mean drive; of the picture its level, and its root mean square error everywhere and in seams, over "
        "the mean of what was meant.",
        "",
        "| venue | projector | calibration | lit | mean drive | level | error | in seams |",
        "|---|---|---|---|---|---|---|---|",
    )
    names = {"before": "before the repair", "part": "recalibrated", "whole": "whole"}
    for row in rows:
        for key, text in names.items():
            yield f"| {row['venue']} | {_changed(row)} | {text} | {_cells(row['seen'][key])} |"
    yield from (
        "",
        "Behind a media server, content drawn on the canvas that it plays; brighter at the front.",
        "",
        "| canvas | lit | mean drive | level | error | in seams |",
        "|---|---|---|---|---|---|",
    )
    for row in served:
        yield f"| {row['fov_deg']} degrees, turned by {row['rotation_deg']} | {_cells(row)} |"


def _changed(row: dict[str, Any]) -> str:
    return f"{row['projector']} {'turned' if row['change'] == 'turned' else 'dimmed'}"


def _cells(figures: dict[str, float]) -> str:
    shares = f"{figures['share_lit']:.1%} | {figures['mean']:.3f} | {figures['level']:.3f}"
    return f"{shares} | {figures['error']:.2%} | {figures['seam_error']:.2%}"
