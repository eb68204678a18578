"""Errors and intervals of feedback, albedo, response and seams over noise seeds.

Every seed is a whole calibration of a small venue: capture, solve, judge; then flat pictures are
compensated and shown on the simulated dome. The realistic venue's camera has 1 % of veiling glare,
measured at a desk beforehand. Writes studies/photometry.json and studies/photometry.md;
`python -m studies photometry` remakes them.
"""

import re
import tempfile
from collections.abc import Iterator, Mapping
from functools import cache, partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.compensate.compensator import Compensator
from procam.compensate.projector_frames import projector_frames
from procam.estimate.camera.glare_and_vignetting import VeilingGlare, fit_glare
from procam.estimate.camera.radiance import Radiometer
from procam.estimate.light.blend import Blender
from procam.estimate.light.colour_spaces import colour_difference
from procam.estimate.structured_light.patterns import LEVELS
from procam.files.calibration import load_calibration
from procam.files.images.layers import RGB, read_channels
from procam.files.venue.load import Venue, load_venue
from procam.files.versions import calibration_in_use
from procam.generators import result_of
from procam.interfaces.judge import judge
from procam.maths.colour_science import colour_science
from procam.maths.geometry.sphere import master_directions, master_pixels
from procam.maths.warp import block_mean, sample
from procam.model.calibration import Calibration
from procam.model.frame import CameraSettings, Frame
from procam.model.optics import CameraModel
from procam.workflows.capture.capture import capture, prepare_session
from procam.workflows.solve.calibrate import solve
from procam.workflows.venue_rig import open_rig
from simulators.builds import ProjectorBuild
from simulators.placement import place_cameras
from simulators.presets import PRESETS, Preset, PresetName
from simulators.scene import SceneSize
from simulators.sensor import Sensor
from simulators.surface import Surface
from simulators.template import venue_text
from simulators.transport import Room
from simulators.truth import write_truth
from studies.measure import side_by_side, write

Image = NDArray[np.float32]
Array = NDArray[np.float64]
VENUES: tuple[PresetName, ...] = ("standard", "realistic")
SEEDS = {"standard": range(1, 11), "realistic": range(1, 101)}
SEAM_SEEDS = range(1, 4)
SIZE = SceneSize(projector_size=(480, 300), camera_size=(600, 600), rays=1024)
FLATS = {"grey": (0.4, 0.4, 0.4), "dark": (0.15, 0.15, 0.15), "orange": (0.5, 0.3, 0.15)}
MASTER, PATCHES = 1024, 256
SEAM = 0.02  # least blend weight of two projectors in a seam
EDGE = 0.999
TRAPS = ((0.5, 0.5), (0.3, 0.4), (0.6, 0.7))  # light traps, in shares of the picture
DESK_EXPOSURE_S = 0.5
TRACE = Room.trace


def make_truth(folder: Path, preset: PresetName, size: SceneSize = SIZE) -> Path:
    """Write the truth, the same for all seeds: a seed draws the noise, not the dome."""
    _write_venue(folder, preset, 1, size)
    write_truth(load_venue(folder).backends["simulated"], folder, folder / "truth", {})
    return folder / "truth"


def calibrate_and_judge(
    folder: Path, preset: PresetName, seed: int, truth_dir: Path, size: SceneSize = SIZE
) -> dict[str, Any]:
    """Figures of one calibration."""
    _write_venue(folder, preset, seed, size)
    found = calibrate_venue(load_venue(folder))
    calibration, truth = load_calibration(found), load_calibration(truth_dir)
    figures = judge(found, truth_dir)
    return {
        "seed": seed,
        "preset": preset,
        **_interval("feedback", calibration, truth),
        **_interval("albedo", calibration, truth),
        "response_error": response_error(calibration, truth),
        "direction_error_rms_arcmin": figures["direction_error_rms_arcmin"].value,
    }


def calibrate_venue(venue: Venue) -> Path:
    """Photograph a venue and solve it; returns the calibration's folder."""
    with open_rig(venue) as rig:
        session = prepare_session(venue, venue.directory / "sessions" / "0001")
        result_of(capture(rig, venue, session))
    return result_of(solve(venue, session)).directory


def _write_venue(folder: Path, preset: PresetName, seed: int, size: SceneSize) -> None:
    text = venue_text(preset, size, seed)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "venue.toml").write_text(text)
    if not PRESETS[preset].glare_known:
        veil = desk_veil(load_venue(folder).cameras, preset, size, seed)
        text = re.sub(r"glare = .*", f"glare = {veil.glare:.6f}", text, count=1)
        text = re.sub(r"glare_sigma = .*", f"glare_sigma = {veil.sigma:.6f}", text, count=1)
        (folder / "venue.toml").write_text(text)


def desk_veil(
    cameras: Mapping[str, CameraModel], preset: PresetName, size: SceneSize, seed: int
) -> VeilingGlare:
    """Veiling glare of the first camera, from photographs of a bright wall with a light trap."""
    build = place_cameras(1, size.camera_size, size.camera_kind, PRESETS[preset])[0]
    sensor = Sensor(
        SimpleNamespace(preset=PRESETS[preset], cameras={build.name: build}), build.name
    )
    radiometer = Radiometer(cameras[build.name])
    rng = np.random.Generator(np.random.SFC64(seed))
    width, height = size.camera_size
    radius, settings = width / 20, CameraSettings(DESK_EXPOSURE_S, "mono")
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    lights, traps = [], []
    for across, down in TRAPS:
        place = (across * width, down * height)
        wall = 1 + 0.3 * np.cos(x / width * 4) * np.sin(y / height * 3)
        wall[np.hypot(x - place[0], y - place[1]) < 1.5 * radius] = 0
        signal = sensor.signal(wall[..., None].astype(np.float32), DESK_EXPOSURE_S)
        counts = sensor.digitise(signal, rng, sensor.noise)[..., 0]
        lights.append(radiometer.radiance(Frame(counts, settings, 0.0, DESK_EXPOSURE_S)))
        traps.append((*place, radius))
    return fit_glare(lights, traps, radiometer.seen)


def _interval(name: str, found: Calibration, truth: Calibration) -> dict[str, Any]:
    measured, true = getattr(found, name), getattr(truth, name).value
    low, high = measured.interval()
    error = measured.value / true - 1
    return {
        f"{name}_error": float(error[np.argmax(np.abs(error))]),
        f"{name}_covers": [bool(c) for c in (low <= true) & (true <= high)],
        f"{name}_half_width": float(((high - low) / 2 / measured.value).max()),
    }


def response_error(found: Calibration, truth: Calibration) -> float:
    """Rms over drives of the response error, in the worst channel of all projectors."""
    errors, _ = response_errors(found, truth)
    return float(np.sqrt(np.mean(errors**2, axis=1)).max())


def response_errors(found: Calibration, truth: Calibration) -> tuple[Array, Array]:
    """Errors (P, L, 3) of the responses, of range, at the drives of the pictures; their sigmas.

    The truth is what the projectors' input makes of a drive of 8 bits.
    """
    errors, sigmas = list[Array](), list[Array]()
    drives, steps = np.array(LEVELS) / 255, 2**ProjectorBuild.bits - 1
    for name, projector in found.projectors.items():
        curve, true = projector.photometry.response, truth.projectors[name].photometry.response
        ideal = _at(np.rint(drives * steps) / steps, true.levels, true.values)
        ideal = (ideal - ideal[0]) / (ideal[-1] - ideal[0])
        errors.append(_at(drives, curve.levels, curve.values) - ideal)
        sigmas.append(_at(drives, curve.levels, curve.sigma))
    return np.stack(errors), np.stack(sigmas)


def _at(drives: Array, levels: Array, table: Array) -> Array:
    """Columns (K, 3) of a table over `levels` (K,), at drives (L,)."""
    return np.stack([np.interp(drives, levels, column) for column in table.T], axis=1)


def _shown(calibration: Calibration, rgb: tuple[float, float, float]) -> dict[str, Image]:
    content = np.broadcast_to(np.float32(rgb), (MASTER, MASTER, 3)).copy()
    return projector_frames(Compensator(calibration, MASTER).frame(content), calibration)


def seams(folder: Path) -> dict[str, float]:
    """DE2000 of flat pictures in the seams, over patches of 0.7 degrees, against the content.

    `folder` is a calibrated venue; its pictures are shown on the simulated dome.
    """
    calibration = load_calibration(calibration_in_use(folder))
    frames = {name: _shown(calibration, rgb) for name, rgb in FLATS.items()}
    settings, pictures = load_venue(folder).backends["simulated"], folder / "flats" / "pictures"
    write_truth(settings, folder, folder / "flats", frames)
    where = seam_patches(calibration)
    errors = np.concatenate(
        [
            delta_e(_seen(pictures / f"{name}.exr", calibration)[where], np.array(rgb))
            for name, rgb in FLATS.items()
        ]
    )
    return {
        "seam_delta_e_mean": float(errors.mean()),
        "seam_delta_e_95": float(np.quantile(errors, 0.95)),
    }


def seam_patches(calibration: Calibration) -> NDArray[np.bool_]:
    """Patches (N, N) where two projectors or more share the picture."""
    direction, inside = master_directions(PATCHES)
    blender = Blender(calibration.projectors, calibration.screen)
    weights = np.stack(list(blender.weights(direction.astype(np.float32)).values()))
    maps = calibration.maps
    covered = sample(maps.coverage, master_pixels(direction, maps.size)) > EDGE
    return np.asarray(((weights > SEAM).sum(axis=0) >= 2) & covered & inside)


def delta_e(seen: Array, content: Array) -> Array:
    """DE2000 (N,) of linear light (N, 3), 1 the reference white, taken in sRGB's primaries."""
    to_xyz = colour_science().RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ
    first, second = (np.maximum(rgb, 0) @ to_xyz.T for rgb in (seen, content))
    return colour_difference(first, second, to_xyz @ np.ones(3))


def _seen(path: Path, calibration: Calibration) -> Array:
    channels = read_channels(path)
    picture = np.stack([channels[c] for c in RGB], axis=-1)
    relative = picture @ calibration.content_from_camera.T.astype(np.float32)
    return np.asarray(block_mean(relative, MASTER // PATCHES), float)


def table(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Markdown lines, one per figure, a column per venue."""
    yield "| figure | goal | " + " | ".join(VENUES) + " |"
    yield "|---|---|" + "---|" * len(VENUES)
    by_venue = [[row for row in rows if row["preset"] == v] for v in VENUES]
    for name, goal, cell in COLUMNS:
        yield f"| {name} | {goal} | " + " | ".join(cell(some) for some in by_venue) + " |"


def _worst(key: str, rows: list[dict[str, Any]]) -> str:
    values = np.array([row[key] for row in rows])
    return f"{values.mean():+.2%}, {values[np.argmax(np.abs(values))]:+.2%}"


def _covers(key: str, rows: list[dict[str, Any]]) -> str:
    covered = np.array([row[f"{key}_covers"] for row in rows])
    width = max(row[f"{key}_half_width"] for row in rows)
    return f"{covered.sum()} of {covered.size}, +-{width:.1%}"


def _largest(key: str, rows: list[dict[str, Any]]) -> str:
    values = [row[key] for row in rows if key in row]
    return f"{np.mean(values):.3g}, {max(values):.3g}"


COLUMNS = (
    ("feedback m, error: mean, worst", "<= 1 %", partial(_worst, "feedback_error")),
    ("m, intervals that cover, widest", ">= 88 %", partial(_covers, "feedback")),
    ("albedo, error: mean, worst", "<= 2 %", partial(_worst, "albedo_error")),
    ("albedo, intervals that cover, widest", ">= 88 %, +-6 %", partial(_covers, "albedo")),
    ("response, rms of range: mean, worst", "<= 0.003", partial(_largest, "response_error")),
    ("seams, DE2000: mean of means, worst", "<= 0.5", partial(_largest, "seam_delta_e_mean")),
    ("seams, DE2000, 95 %: mean, worst", "<= 1", partial(_largest, "seam_delta_e_95")),
    (
        "directions, rms arcmin: mean, worst",
        "",
        partial(_largest, "direction_error_rms_arcmin"),
    ),
)


@cache
def traced(preset: Preset, rays: int) -> Room:
    """A preset's room, traced once per process."""
    return TRACE(Surface.build(preset), rays)


def _row(job: tuple[PresetName, int, Path]) -> dict[str, Any]:
    venue, seed, truth = job
    Room.trace = lambda surface, rays: traced(surface.preset, rays)
    with tempfile.TemporaryDirectory() as folder:
        row = calibrate_and_judge(Path(folder), venue, seed, truth)
        return row | (seams(Path(folder)) if seed in SEAM_SEEDS else {})


def main() -> None:
    """Run all seeds and write the results; takes most of an hour."""
    with tempfile.TemporaryDirectory() as shared:
        truths = {v: make_truth(Path(shared) / v, v) for v in VENUES}
        rows = side_by_side(_row, [(v, seed, truths[v]) for v in VENUES for seed in SEEDS[v]])
    document = {
        "size": SIZE.projector_size,
        "rows": rows,
    }
    lines = [
        "# Light over noise seeds, 480x300 projectors, 600x600 camera",
        "",
        f"{len(SEEDS['standard'])} and {len(SEEDS['realistic'])} calibrations; three channels each. Seams: "
        "patches of 0.7 degrees where projectors share the picture, of flat pictures "
        f"{', '.join(FLATS)} in the first {len(SEAM_SEEDS)} calibrations. The realistic "
        "camera's veiling glare of 1 % was measured at a desk, by three photographs of a light trap.",
        "",
        *table(rows),
    ]
    write("photometry", document, lines)
