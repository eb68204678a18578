"""Scattered light that remains after compensation, by content: half skies, night, a room, white.

Calibrates a venue, compensates each content, and evaluates the picture that the simulator's flux tracing
gives for an audience at the dome's centre. Two more evaluations separate the causes of the residual:
scattered light alone, with projectors that draw exactly what they are asked for; and everything seen
from the camera's place, which differs from the centre where paint is not quite matte. Writes
studies/content.json and studies/content.md; `python -m studies content` remakes them.
"""

import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
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
from procam.workflows.sample_content import CONTENTS
from simulators.backend import build_scene
from simulators.presets import PresetName
from simulators.scene import ALL_BANDS, DomeScene, SceneSize
from simulators.sight_lines import SightLines
from studies.measure import write
from studies.photometry import calibrate_venue, make_truth

Image = NDArray[np.float32]
Array = NDArray[np.float64]
Row = dict[str, Any]
VENUES: tuple[PresetName, ...] = ("standard", "realistic")
SIZE = SceneSize()  # the demo's
MASTER = 1024
FINE = 2  # oversampling of pictures, which are then averaged over pixels
GOAL = 0.02
WORKERS = 2


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
        pair = ("none", "exact")  # compared by scatter_left
        centre = {m: _drawn(self._scene, self._centre, sent[m]) for m in made}
        aside = {m: _drawn(self._scene, self._camera, sent[m]) for m in pair}
        alone = {
            m: _camera_bands(made[m].direct, self._calibration)
            + scattered(self._scene, self._centre, sent[m])
            for m in pair
        }
        figures = self._judge(folder, centre)
        return {
            "scatter_left": figures["scatter_left_exact"],
            "mean": figures["scatter_left_exact_mean"],
            "bounced_alone": self._judge(folder, alone)["scatter_left_exact"],
            "from_camera": self._judge(folder, aside)["scatter_left_exact"],
            "paper_eq12": figures["scatter_left_paper_eq12"],
            "before": figures["scatter_before"],
        }

    def left(self, folder: Path, content: Image, calibration: Calibration) -> float:
        """`scatter_left` of one content (N, N, 3) by another calibration of the same venue."""
        keep_pictures(folder, calibration, content)
        sent = {m: read_frames(folder / "frames" / m) for m in ("none", "exact")}
        shown = {m: _drawn(self._scene, self._centre, sent[m]) for m in sent}
        return float(self._judge(folder, shown)["scatter_left_exact"])

    def _judge(self, folder: Path, pictures: Mapping[str, Image]) -> dict[str, Any]:
        """Figures by name, of pictures by method."""
        calibration_dir, truth_dir = self._folders
        shutil.rmtree(truth_dir / "pictures")
        for method, picture in pictures.items():
            channels = {c: picture[..., i] for i, c in enumerate(RGB)}
            write_channels(truth_dir / "pictures" / f"{method}.exr", channels)
        figures = judge_pictures(folder, calibration_dir, truth_dir)
        return {name: figure.value for name, figure in figures.items()}


def sight_lines(scene: DomeScene, eye: Array) -> SightLines:
    """Lines of sight from `eye` (3,) [m] to the pixels of a fine dome master on the screen."""
    direction, inside = master_directions(FINE * MASTER)
    point = scene.surface.intersect(np.zeros(3), direction)
    rays = np.where(inside[..., None], normalise(point - eye), np.nan)
    return SightLines.along(scene.room, scene.lights, eye, rays)


def scattered(scene: DomeScene, view: SightLines, sent: dict[str, Image]) -> Image:
    """Scattered radiance (N, N, 3) of the frames that projectors are sent."""
    patches = len(scene.room.area_m2)
    flux = np.zeros((patches, len(RGB)))
    for name, drive in sent.items():
        light = scene.lights[name]
        flux += light.patch_flux(light.emit(drive, ALL_BANDS), patches)
    return block_mean(view.scattered(scene.room, scene.room.irradiance(flux)), FINE)


def _drawn(scene: DomeScene, view: SightLines, sent: dict[str, Image]) -> Image:
    full = dict.fromkeys(sent, 1.0)
    return block_mean(scene.radiance_of_drives(view, sent, full, ALL_BANDS, 0), FINE)


def _camera_bands(picture: Image, calibration: Calibration) -> Image:
    """A picture in camera channels, from content channels."""
    return picture @ np.linalg.inv(calibration.content_from_camera).T.astype(np.float32)


def study(preset: PresetName, size: SceneSize = SIZE, names: Iterable[str] = CONTENTS) -> list[Row]:
    """A row for each content."""
    with tempfile.TemporaryDirectory() as folder:
        stage = Stage(*calibrate(Path(folder), preset, size))
        rows = []
        for name in names:
            figures = stage.judged(Path(folder) / name, CONTENTS[name](MASTER))
            rows.append({"preset": preset, "content": name} | figures)
            print(rows[-1], flush=True)
    return rows


NOTES = (
    f"One calibration each at the demo's size; goal of `scatter_left` {GOAL:.0%}, as docs/figures.md defines",
    "it, for an audience at the dome's centre. The realistic camera's veiling glare was measured at a desk.",
    "",
    "- Scattered light alone: projectors draw exactly what they are asked for. This is what compensation",
    "  cannot remove; the rest of `scatter_left` is direct light: black level, gain, lens blur at edges.",
    "- From the camera's place: the same pictures seen from there. The difference is gloss, which depends",
    "  on the view.",
)
COLUMNS = {
    "scatter_left": "scatter_left",
    "mean": "signed mean",
    "bounced_alone": "scattered light alone",
    "from_camera": "from the camera's place",
    "paper_eq12": "paper eq. 12",
}


def table(rows: list[Row]) -> Iterator[str]:
    """Markdown lines, one per content."""
    yield "| venue | content | scattered light, of white | " + " | ".join(COLUMNS.values()) + " |"
    yield "|---|---|---|" + "---|" * len(COLUMNS)
    for row in rows:
        values = [f"{row[key]:.2%}" for key in COLUMNS]
        values[0] += "" if row["scatter_left"] <= GOAL else " (missed)"
        cells = [row["preset"], row["content"], f"{row['before']:.3f}", *values]
        yield "| " + " | ".join(cells) + " |"


def main() -> None:
    """Calibrate both venues and write the results; takes some minutes."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # each worker has a core of its own
    with ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn")) as pool:
        rows = [row for some in pool.map(study, VENUES) for row in some]
    publish(rows)


def publish(rows: list[Row]) -> None:
    """Write the results beside this file."""
    lines = ["# Scattered light that remains, by content", "", *NOTES, "", *table(rows)]
    write("content", {"size": SIZE.projector_size, "goal": GOAL, "rows": rows}, lines)
