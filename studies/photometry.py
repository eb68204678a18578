"""Light measured with doubt: feedback, albedo, response and seams over noise seeds, and their intervals.

Every seed is a whole visit to a small venue: capture, solve, judge; then flat pictures are compensated
and shown on the simulated dome. The realistic venue's camera has 1 % of veiling glare, which was
measured at a desk before the visit. Writes studies/photometry.json and studies/photometry.md;
`python -m studies photometry` remakes them.
"""

import json
import re
import sys
import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import colour
import numpy as np
from numpy.typing import NDArray

from procam.compensate.exact import Compensator
from procam.compensate.projector_frames import projector_frames
from procam.estimate.blend import Blender
from procam.files.calibration import load_calibration
from procam.files.images import RGB, read_channels
from procam.files.venue import load_venue
from procam.interfaces.judge import judge
from procam.maths.sphere import master_directions, master_pixels
from procam.maths.warp import block_mean, sample
from procam.model.calibration import Calibration
from procam.workflows.calibrate import solve
from procam.workflows.capture import capture, prepare_session
from procam.workflows.venue_rig import open_rig
from simulators.presets import PresetName
from simulators.scene import SceneSize
from simulators.template import venue_text
from simulators.truth import write_truth

Image = NDArray[np.float32]
Array = NDArray[np.float64]
SEEDS = range(1, 101)
PRESETS: tuple[PresetName, ...] = ("standard", "realistic")
SIZE = SceneSize(projector_size=(640, 400), camera_size=(800, 800), rays=1024)
FLATS = {"grey": (0.4, 0.4, 0.4), "dark": (0.15, 0.15, 0.15), "orange": (0.5, 0.3, 0.15)}
MASTER, PATCHES = 1024, 256
SEAM = 0.02  # least blend weight of two projectors where pictures meet
EDGE = 0.999
WORKERS = 2


def visit(folder: Path, preset: PresetName, seed: int, size: SceneSize = SIZE) -> dict[str, Any]:
    """Figures of one visit."""
    _write_venue(folder, preset, seed, size)
    venue = load_venue(folder)
    with open_rig(venue) as rig:
        session = prepare_session(venue, folder / "sessions" / "0001")
        for _ in capture(rig, venue, session):
            pass
    *_, last = solve(venue, session)
    found = Path(last.data["calibration"])
    calibration = load_calibration(found)
    frames = {name: _shown(calibration, rgb) for name, rgb in FLATS.items()}
    write_truth(venue.backends["simulated"], folder, folder / "truth", frames)
    truth = load_calibration(folder / "truth")
    figures = judge(found, folder / "truth")
    return {
        "seed": seed,
        "preset": preset,
        **_interval("feedback", calibration, truth),
        **_interval("albedo", calibration, truth),
        "response_error": response_error(calibration, truth),
        **seams(calibration, folder / "truth" / "pictures"),
        "direction_error_rms_arcmin": figures["direction_error_rms_arcmin"].value,
    }


def _write_venue(folder: Path, preset: PresetName, seed: int, size: SceneSize) -> None:
    text = venue_text(preset, size, seed)
    if preset == "realistic":
        glare, sigma = desk_glare_of(seed)
        text = re.sub(r"glare = .*", f"glare = {glare:.6f}", text, count=1)
        text = re.sub(r"glare_sigma = .*", f"glare_sigma = {sigma:.6f}", text, count=1)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "venue.toml").write_text(text)


def desk_glare_of(seed: int) -> tuple[float, float]:
    return 0.01, 0.0005


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
    """Rms over drives of measured against true response, the worst channel of all projectors."""
    errors = []
    for name, projector in found.projectors.items():
        measured, true = projector.photometry.response, truth.projectors[name].photometry.response
        span = true.values[-1] - true.values[0]
        ideal = (true.values - true.values[0]) / span
        at = np.stack(
            [np.interp(true.levels, measured.levels, measured.values[:, c]) for c in range(3)], -1
        )
        errors.append(np.sqrt(np.mean((at - ideal) ** 2, axis=0)).max())
    return float(max(errors))


def _shown(calibration: Calibration, rgb: tuple[float, float, float]) -> dict[str, Image]:
    content = np.broadcast_to(np.float32(rgb), (MASTER, MASTER, 3)).copy()
    return projector_frames(Compensator(calibration, MASTER).frame(content), calibration)


def seams(calibration: Calibration, pictures: Path) -> dict[str, float]:
    """DE2000 of flat pictures where projectors meet: patches of 0.7 degrees against what was meant."""
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
    surfaces = {n: p.surface for n, p in calibration.projectors.items()}
    models = {n: p.model for n, p in calibration.projectors.items()}
    direction, inside = master_directions(PATCHES)
    blender = Blender(models, surfaces, calibration.screen)
    weights = np.stack(list(blender.weights(direction.astype(np.float32)).values()))
    maps = calibration.maps
    covered = sample(maps.coverage, master_pixels(direction, maps.size)) > EDGE
    return np.asarray(((weights > SEAM).sum(axis=0) >= 2) & covered & inside)


def delta_e(seen: Array, meant: Array) -> Array:
    """DE2000 (N,) of linear light (N, 3) in which 1 is the reference white, read as sRGB's primaries."""
    to_xyz = colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ
    white = colour.XYZ_to_xy(to_xyz @ np.ones(3))
    labs = [colour.XYZ_to_Lab(np.maximum(rgb, 0) @ to_xyz.T, white) for rgb in (seen, meant)]
    return np.asarray(colour.delta_E(*labs, method="CIE 2000"))


def _seen(path: Path, calibration: Calibration) -> Array:
    channels = read_channels(path)
    picture = np.stack([channels[c] for c in RGB], axis=-1)
    relative = picture @ calibration.content_from_camera.T.astype(np.float32)
    return np.asarray(block_mean(relative, MASTER // PATCHES), float)
