"""Whether a dome shows what the perceptual method predicts, as well as it shows what (P) predicts.

A simulated dome is calibrated and refined, at the demo's size. Pictures are compensated both ways, shown,
and photographed by the simulated camera; the photographs are compared with the light that was predicted,
and the closed loop corrects what is off, as for any picture. Distances are in units of the photographs'
noise. The dome's light is found by flux tracing, which shares nothing with the prediction. Writes
studies/perceptual_dome.json and studies/perceptual_dome.md; `python -m studies perceptual-dome` remakes them.
"""

import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from procam.compensate.compensator import Compensator
from procam.compensate.perceptual.settings import Perceptual
from procam.estimate.closed_loop.patches import MAX_CORRECTIONS
from procam.files.calibration import load_calibration
from procam.files.venue.load import load_venue
from procam.generators import result_of
from procam.maths.geometry.sphere import master_directions
from procam.maths.warp import blur
from procam.model.calibration import Calibration
from procam.workflows.main_camera import MainCamera
from procam.workflows.photographs.driven import DrivenPhotographer
from procam.workflows.refine.camera import LoopCamera
from procam.workflows.refine.refine import refine
from procam.workflows.refine.shown_picture import PreparedPicture, ShownPicture
from procam.workflows.venue_rig import open_rig
from simulators.scene import SceneSize
from studies import content
from studies.contents import CONTENTS
from studies.measure import write
from studies.picture_set import picture

Image = NDArray[np.float32]
Row = dict[str, Any]
LEARNT = "interior"
DEMO = "half-sky"  # the demo's own picture
PICTURES = ("sunset", "hopper", "earth-africa", "reef", "clouds")
SOFT_PX = (
    4.0  # blur of the dome master, 0.7 degrees: finer detail is not drawn by the demo's projectors
)
DB = 1.0
GOAL = 1.3  # noise floors


def on_dome(name: str) -> Image:
    """A picture of the set, spread over a dome master and softened; or the demo's."""
    size = content.MASTER
    if name == DEMO:
        return CONTENTS[name](size)
    wide = cv2.resize(picture(name), (size, size), interpolation=cv2.INTER_CUBIC)
    wide = blur(wide, SOFT_PX)
    inside = master_directions(size)[1][..., None]
    return np.asarray(np.clip(wide, 0, 1) * inside, np.float32)


def photographed(camera: LoopCamera, calibration: Calibration, target: Image, method: Any) -> Row:
    """How far photographs of a picture are from its prediction: at once, and after the loop."""
    prepared = PreparedPicture.of(calibration, target, method)
    shown = ShownPicture.start(camera, replace(prepared, target=prepared.wanted.observed))
    known, free = shown.loop.known, shown.loop.free
    off, floor = shown.loop.residual(shown.seen[0]), shown.loop.residual_rms(shown.sigma)
    at_limits = known & ~free
    while not shown.enough() and len(shown.residual) <= MAX_CORRECTIONS:
        shown.correct()
    solved = Compensator(calibration, len(target), method).solve(target)
    return {
        "from_exact": solved.certificate.from_exact,
        "limited": float(at_limits.sum() / known.sum()),
        "floor": floor,
        "first": shown.residual[0] / floor,
        "first_at_limits": rms(off[at_limits]) / rms(shown.sigma[at_limits])
        if at_limits.any()
        else 0,
        "last": shown.residual[-1] / floor,
        "corrections": len(shown.residual) - 1,
    }


def rms(values: NDArray[np.floating[Any]]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def study(folder: Path, size: SceneSize, pictures: Mapping[str, Image]) -> list[Row]:
    """A row for each picture and method."""
    calibration_dir, _ = content.calibrate(folder, "standard", size)
    first, rows = load_calibration(calibration_dir), list[Row]()
    venue = load_venue(calibration_dir.parents[1])
    with open_rig(venue) as rig:
        learnt = CONTENTS[LEARNT](content.MASTER)
        refined = result_of(refine(DrivenPhotographer(rig, first), venue, first, learnt))
        known = refined.calibration
        camera = LoopCamera(DrivenPhotographer(rig, known), MainCamera.of(venue, known))
        camera.measure_dark()
        for name, target in pictures.items():
            for label, method in (("(P)", "exact"), ("perceptual", Perceptual(DB))):
                row = photographed(camera, known, target, method)
                rows.append({"picture": name, "method": label} | row)
                print(rows[-1], flush=True)
    return rows


def table(rows: list[Row]) -> Iterator[str]:
    head = ["picture", "method", "share of the way from (P)", "cells at a limit", "noise floor"]
    head += ["first photograph", "the same at limits", "after the loop", "corrections"]
    yield f"| {' | '.join(head)} |"
    yield "|---" * len(head) + "|"
    for row in rows:
        share = "" if row["method"] == "(P)" else f"{row['from_exact']:.2f}"
        yield (
            f"| {row['picture']} | {row['method']} | {share} | {row['limited']:.0%} | {row['floor']:.3%} | "
            f"{row['first']:.2f} | {row['first_at_limits']:.2f} | {row['last']:.2f} | {row['corrections']} |"
        )


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        rows = study(Path(folder), content.SIZE, {n: on_dome(n) for n in (DEMO, *PICTURES)})
    lines = [
        "# Photographs of what the perceptual method predicts",
        "",
        f"The demo's dome, its calibration refined on one picture; {DB:g} dB allowed. Residuals of one",
        f"photograph in noise floors. Goal: after the loop within {GOAL}, as (P)'s.",
        "",
        *table(rows),
    ]
    write("perceptual_dome", {"rows": rows}, lines)
