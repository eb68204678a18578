"""Scattered light that remains after compensation, by content: half skies, night, a room, white.

Calibrates a venue, compensates each content, and evaluates the picture that the simulator's flux tracing
gives for an audience at the dome's centre, and for one at the camera's place, which differs from the
centre where paint is not quite matte. Writes
studies/content.json and studies/content.md; `python -m studies content` remakes them.
"""

import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.files.calibration import load_calibration
from procam.files.images.layers import RGB, write_channels
from procam.files.venue.load import load_venue
from procam.interfaces.judge import judge_pictures
from procam.maths.geometry.sphere import master_directions, normalise
from procam.maths.warp import block_mean
from procam.model.calibration import Calibration
from procam.workflows.refine.stored_pictures import keep_pictures, read_frames
from simulators.backend import build_scene
from simulators.presets import PresetName
from simulators.scene import ALL_BANDS, DomeScene, SceneSize
from simulators.sight_lines import SightLines
from studies.contents import CONTENTS
from studies.measure import side_by_side, write
from studies.photometry import calibrate_venue, make_truth

Image = NDArray[np.float32]
Array = NDArray[np.float64]
Row = dict[str, Any]
VENUES: tuple[PresetName, ...] = ("standard", "realistic")
SIZE = SceneSize()  # the demo's
MASTER = 1024
FINE = 2  # oversampling of pictures, which are then averaged over pixels
GOAL = 0.01


def calibrate(folder: Path, preset: PresetName, size: SceneSize = SIZE) -> tuple[Path, Path]:
    """Calibrate a venue; folders of the calibration and of the truth, which is outside the venue."""
    truth = make_truth(folder / "truth", preset, size)
    here = folder / "venue"
    here.mkdir()
    (here / "venue.toml").write_text((folder / "truth" / "venue.toml").read_text())
    return calibrate_venue(load_venue(here)), truth


class Stage:
    """A calibrated venue on which pictures are shown."""

    def __init__(self, calibration_dir: Path, truth_dir: Path) -> None:
        self._folders = calibration_dir, truth_dir
        venue_dir = calibration_dir.parents[1]
        self._calibration = load_calibration(calibration_dir)
        self._scene = build_scene(load_venue(venue_dir).backends["simulated"], venue_dir)
        camera = next(iter(self._scene.cameras.values()))
        self._centre = sight_lines(self._scene, np.zeros(3))
        self._camera = sight_lines(self._scene, camera.camera_from_dome.inverse().translation)

    def judged(self, folder: Path, content: Image) -> Row:
        """Figures of one content (N, N, 3), whose pictures are stored in a folder."""
        made = keep_pictures(folder, self._calibration, content)
        sent = {method: read_frames(folder / "frames" / method) for method in made}
        figures = self._judge(folder, self._centre, sent)
        aside = self._judge(folder, self._camera, {m: sent[m] for m in ("none", "exact")})
        return {
            "interreflection_left": figures["interreflection_left"],
            **{name: figures[name] for name in figures if name.startswith("picture_error")},
            "scatter_left": figures["scatter_left_exact"],
            "from_camera": aside["scatter_left_exact"],
            "paper_eq12": figures["scatter_left_paper_eq12"],
            "before": figures["scatter_before"],
        }

    def left(self, folder: Path, content: Image, calibration: Calibration) -> float:
        """`scatter_left` of one content (N, N, 3) by another calibration of the same venue."""
        keep_pictures(folder, calibration, content)
        sent = {m: read_frames(folder / "frames" / m) for m in ("none", "exact")}
        return float(self._judge(folder, self._centre, sent)["scatter_left_exact"])

    def _judge(
        self, folder: Path, view: SightLines, sent: Mapping[str, dict[str, Image]]
    ) -> dict[str, Any]:
        """Figures by name, of the frames sent by method, seen along lines of sight."""
        calibration_dir, truth_dir = self._folders
        for kind in ("pictures", "scattered"):
            shutil.rmtree(truth_dir / kind, ignore_errors=True)
            (truth_dir / kind).mkdir()
        for method, frames in sent.items():
            full = dict.fromkeys(frames, 1.0)
            direct, bounced = self._scene.parts_of_drives(view, frames, full, ALL_BANDS, 0)
            for kind, light in ("pictures", direct + bounced), ("scattered", bounced):
                picture = block_mean(light, FINE)
                channels = {c: picture[..., i] for i, c in enumerate(RGB)}
                write_channels(truth_dir / kind / f"{method}.exr", channels)
        figures = judge_pictures(folder, calibration_dir, truth_dir)
        return {name: figure.value for name, figure in figures.items()}


def sight_lines(scene: DomeScene, eye: Array) -> SightLines:
    """Lines of sight from `eye` (3,) [m] to the pixels of a fine dome master on the screen."""
    direction, inside = master_directions(FINE * MASTER)
    point = scene.surface.intersect(np.zeros(3), direction)
    rays = np.where(inside[..., None], normalise(point - eye), np.nan)
    return SightLines.along(scene.room, scene.lights, eye, rays)


def study(preset: PresetName, size: SceneSize = SIZE, names: Iterable[str] = CONTENTS) -> list[Row]:
    """A row for each content."""
    with tempfile.TemporaryDirectory() as folder:
        stage = Stage(*calibrate(Path(folder), preset, size))
        rows = []
        for name in names:
            figures = stage.judged(Path(folder) / name, CONTENTS[name](MASTER))
            rows.append({"preset": preset, "content": name} | figures)
    return rows


NOTES = (
    "One calibration each at the demo's size, for an audience at the dome's centre; the figures are defined",
    "in docs/figures.md. The realistic camera's veiling glare was measured at a desk. half-sky, left-right",
    "and interior are soft, checker has hard edges, texture has detail of all sizes.",
    "",
    f"- interreflection_left, goal {GOAL:.0%}: projectors draw exactly what they are asked for. It is what",
    "  compensation answers for, where light does not have to be negative.",
    "- picture_error_jnd: all errors, over all that is lit, in just noticeable differences; 95 % of the",
    "  picture is off by at most this. Its parts, each alone: light that bounces, where it would take",
    "  negative light too; the projectors' black; and how they draw (blur of lenses, gains, quantisation).",
    "- scatter_left: error over scattered light where no limit holds, with what the projectors really draw,",
    "  and the same pictures seen from the camera's place. The difference is gloss: it depends on the view.",
)
SHARES = {
    "interreflection_left": "interreflection_left",
    "scatter_left": "scatter_left",
    "from_camera": "from the camera's place",
    "paper_eq12": "paper eq. 12",
}
VISIBLE = {
    "picture_error_jnd_before": "picture_error_jnd before",
    "picture_error_jnd": "after",
    "picture_error_jnd_interreflection": "bounced",
    "picture_error_jnd_black": "black",
    "picture_error_jnd_drawing": "drawn",
}


def table(rows: list[Row]) -> Iterator[str]:
    """Markdown lines, one per content."""
    names = ["venue", "content", "scattered light, of white", *SHARES.values(), *VISIBLE.values()]
    yield "| " + " | ".join(names) + " |"
    yield "|---" * len(names) + "|"
    for row in rows:
        shares = [f"{row[key]:.2%}" for key in SHARES]
        shares[0] += "" if row["interreflection_left"] <= GOAL else " (missed)"
        visible = [f"{row[key]:.1f}" for key in VISIBLE]
        cells = [row["preset"], row["content"], f"{row['before']:.3f}", *shares, *visible]
        yield "| " + " | ".join(cells) + " |"


def main() -> None:
    """Calibrate both venues and write the results; takes some minutes."""
    rows = [row for some in side_by_side(study, VENUES) for row in some]
    publish(rows)


def publish(rows: list[Row]) -> None:
    """Write the results beside this file."""
    lines = ["# Scattered light that remains, by content", "", *NOTES, "", *table(rows)]
    write("content", {"size": SIZE.projector_size, "goal": GOAL, "rows": rows}, lines)
