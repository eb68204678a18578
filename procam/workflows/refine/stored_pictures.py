"""Files in, files out: projector frames, and what a demo and a loop have shown."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from procam.arrays import FloatArray, Image
from procam.compensate.any_screen import AnyPicture, compensator_for
from procam.compensate.projector_frames import Warper, projector_frames
from procam.files import atomic
from procam.files.images.layers import RGB, write_channels
from procam.files.images.pixels import read_image, write_image
from procam.files.images.stills import read_picture, square_edge
from procam.model.calibration import Calibration
from procam.model.screen import Dome
from procam.workflows.refine.refine import Refined


def write_frames(frames: Mapping[str, Image], out: Path) -> None:
    """Write OUT/PROJECTOR.png, 16 bits."""
    for name, drive in frames.items():
        write_image(out / f"{name}.png", np.rint(65535 * drive).astype(np.uint16))


def read_frames(directory: Path) -> dict[str, Image]:
    """Frames written by `write_frames`, 0..1."""
    return {
        path.stem: np.asarray(read_image(path), np.float32) / np.float32(65535)
        for path in sorted(directory.glob("*.png"))
    }


def read_square(path: Path) -> tuple[Image, str]:
    """A dome master (N, N, 3) in linear light, and what became of its colour profile ("" for none)."""
    picture, note = read_picture(path)
    square_edge(picture, str(path))
    return picture, note


def keep_pictures(
    venue_dir: Path, calibration: Calibration, content: Image
) -> dict[str, AnyPicture]:
    """Compute and store VENUE/pictures and VENUE/frames for content on the maps' canvas; returns them."""
    size, screen = content.shape[1], calibration.screen
    calibration, kind = calibration.on(screen.canvas), compensator_for(calibration)
    methods = ("none", "exact", "paper-eq12") if isinstance(screen, Dome) else ("none", "exact")
    compensators = {m: kind(calibration, size, m) for m in methods}
    results: dict[str, AnyPicture] = {m: c.predict(content) for m, c in compensators.items()}
    pictures = venue_dir / "pictures"
    _write_rgb(pictures / "target.exr", compensators["exact"].target(content))
    _write_rgb(pictures / "uncompensated.exr", results["none"].observed)
    _write_rgb(pictures / "compensated.exr", results["exact"].observed)
    _write_rgb(pictures / "direct.exr", results["exact"].direct)
    _write_rgb(pictures / "free.exr", results["exact"].free.astype(np.float32))
    warper = Warper(calibration, size, np.float32)
    for method, result in results.items():
        write_frames(warper.frame(result.direct), venue_dir / "frames" / method)
    return results


def keep_loop(venue_dir: Path, refined: Refined, content: Image) -> None:
    """Store VENUE/loop: curve, photographs, prediction; and frames of content by the refined calibration."""
    loop = venue_dir / "loop"
    _write_rgb(loop / "before.exr", refined.photographs["before"])
    _write_rgb(loop / "after.exr", refined.photographs["after"])
    _write_rgb(loop / "predicted.exr", refined.target)
    _write_rgb(loop / "free.exr", refined.free.astype(np.float32))
    calibration = refined.calibration.on(refined.calibration.screen.canvas)
    compensator = compensator_for(calibration)(calibration, content.shape[1])
    direct = compensator.predict(content).direct
    frames = projector_frames(direct, calibration)
    write_frames(frames, venue_dir / "frames" / "refined")
    curve = {
        "session": refined.calibration.provenance.session,
        "residual": refined.residual,
        "noise_floor": refined.noise_floor,
        "left_jnd": refined.left_jnd,
        "scatter_factor": refined.scatter_factor.tolist(),
        "unseen": refined.unseen,
        "worse": refined.worse,
    }
    atomic.write_text(loop / "loop.json", json.dumps(curve, indent=1))


def _write_rgb(path: Path, picture: FloatArray) -> None:
    write_channels(path, {c: picture[..., i] for i, c in enumerate(RGB)})
