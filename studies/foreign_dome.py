"""A whole calibration of a dome that shares nothing with procam or its simulator, by hand, over seeds.

The photographs are files; so are the pictures that they show (`studies.foreign_photographs`). They are raw,
and once more JPEG of light that is far brighter in the middle of each panel. What the projectors really draw
is judged on the dome (`studies.foreign_room`). Writes studies/foreign_dome.json and studies/foreign_dome.md;
`python -m studies foreign-dome` remakes them in half an hour.
"""

import tempfile
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from procam.compensate.compensator import Compensator
from procam.compensate.projector_frames import projector_frames
from procam.interfaces import judge
from procam.maths.geometry.sphere import master_directions, master_pixels, master_solid_angles
from procam.maths.warp import block_mean, sample
from procam.model.calibration import Calibration
from procam.model.transport import Measured
from studies.contents import CONTENTS
from studies.foreign_bounces import RADIUS, hit
from studies.foreign_photographs import JPEG, RAW, FileKind, Size, Stage
from studies.foreign_room import PLATES, Cells, ForeignRoom
from studies.measure import rms, side_by_side, write

Array = NDArray[np.float64]
Image = NDArray[np.float32]
SEEDS = range(1, 11)
MASTER, PATCHES = 1024, 256
SHOWN = ("half-sky", "texture")
HOT_SPOT = 15.0  # of projectors that are photographed as JPEG
RAW_LEFT, JPEG_LEFT = 0.015, 0.05  # goals of the inter-reflection that is left
EVERY = 7  # pixel of a projector whose direction is compared
LINE_MEAN_DEG, LINE_PIXELS = 2.0, 100


class Judge:
    """The truth of the dome, and the figures of a calibration of it."""

    def __init__(self, room: ForeignRoom) -> None:
        self.room = room
        direction, inside = master_directions(MASTER)
        self._view: Cells = room.from_centre(direction, inside)
        sent = room.sent(
            {n: np.ones((*p.size[::-1], 3), np.float32) for n, p in room.projectors.items()}
        )
        direct = self._view.direct(sent)
        self._lit = direct[..., 1] > 0.05 * np.median(direct[..., 1][direct[..., 1] > 0])
        self._scattered = self._bounced(sent)
        weight = (master_solid_angles(MASTER) * self._lit)[..., None]
        self._flux = (weight * direct).sum(axis=(0, 1))
        self.feedback = (weight * self._scattered).sum(axis=(0, 1)) / self._flux
        self.albedo = float((weight[..., 0] * self._view.albedo).sum() / weight.sum())

    def _bounced(self, sent: dict[str, Image]) -> Image:
        return self._view.scattered(self.room.bounced(sent))

    def figures(self, found: Calibration) -> dict[str, Any]:
        """Errors, and what was stated of them."""
        relative, absolute, stated = self._directions(found)
        return {
            "m": _compared(found.feedback, self.feedback[1]),
            "albedo": _compared(found.albedo, self.albedo),
            "relative_arcmin": relative,
            "absolute_arcmin": absolute,
            "stated_arcmin": stated,
            "line": self._line(found),
            **{f"left_{name}": self._left(found, CONTENTS[name](MASTER)) for name in SHOWN},
            "notes": found.provenance.note_lines,
        }

    def _directions(self, found: Calibration) -> tuple[float, float, float]:
        pairs = [self._pair(found, name) for name in self.room.projectors]
        estimate, true, stated = (np.concatenate(each) for each in zip(*pairs, strict=True))
        absolute, relative = judge.direction_errors(estimate, true)
        return float(rms(relative)), float(rms(absolute)), float(rms(stated))

    def _pair(self, found: Calibration, name: str) -> tuple[Array, Array, Array]:
        """Directions found and true (n, 3), and standard errors (n,) [arcmin], of some lit pixels."""
        true, surface = self._true_directions[name], found.projectors[name].surface
        use = surface.valid & (true[..., 2] > np.cos(PLATES))
        use &= np.indices(use.shape).sum(axis=0) % EVERY == 0
        return surface.direction[use].astype(float), true[use], surface.sigma_arcmin[use]

    @cached_property
    def _true_directions(self) -> dict[str, Array]:
        directions = {}
        for name, projector in self.room.projectors.items():
            width, height = projector.size
            pixel = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(
                float
            )
            rays = projector.rays(pixel).reshape(-1, 3)
            points, _ = hit(np.broadcast_to(projector.place, rays.shape), rays)
            directions[name] = (points / RADIUS).reshape(height, width, 3)
        return directions

    def _line(self, found: Calibration) -> float:
        """The largest mean, along a row or column of a panel, of what is fine in the scatter map's error."""
        size = found.maps.size
        true = block_mean(self._scattered[..., 1] / self._flux[1], MASTER // size)
        lit = block_mean(self._lit.astype(np.float32), MASTER // size) > judge.WHOLE
        use = (lit & (found.maps.coverage > judge.WHOLE)).astype(np.float32)
        ratio = use * found.maps.scatter_per_flux[..., 1] / np.maximum(true, 1e-9)
        width = 2 * [2 * round(LINE_MEAN_DEG / 2 / (180 / size)) + 1]
        detail = ratio - cv2.blur(ratio, width) / np.maximum(cv2.blur(use, width), 1e-9)
        detail = np.where(use > 0, detail, np.nan).astype(np.float32)
        worst = 0.0
        for direction in self._true_directions.values():
            seen = sample(detail, master_pixels(direction, size))
            for axis in (0, 1):
                enough = np.isfinite(seen).sum(axis=axis) >= LINE_PIXELS
                means = np.nanmean(seen, axis=axis)[enough]
                worst = max(worst, float(np.abs(means).max()))
        return worst

    def _left(self, found: Calibration, content: Image) -> float:
        """`interreflection_left` (docs/figures.md) of the frames that are really shown."""
        to_content = found.content_from_camera.T.astype(np.float32)
        compensator = Compensator(found, MASTER)
        made = compensator.predict(content)
        error = (
            made.direct + self._shown(found, made.direct) @ to_content - compensator.target(content)
        )
        plain = Compensator(found, MASTER, "none").predict(content).direct
        before = self._shown(found, plain) @ to_content
        free = (made.free & self._lit[..., None]).astype(np.float32)
        weight = master_solid_angles(PATCHES)[..., None] * (_patches(free) > judge.WHOLE)
        left = [np.sum(weight * _patches(p) ** 2, axis=(0, 1)) for p in (error, before)]
        return float(np.sqrt(left[0] / left[1]).max())

    def _shown(self, found: Calibration, direct: Image) -> Image:
        """Scattered light (N, N, 3) [camera] of direct light, as the projectors draw it."""
        return self._bounced(self.room.sent(projector_frames(direct, found)))


def _compared(found: Measured, true: float) -> list[float]:
    """Value and standard error in the green channel, and the truth."""
    return [float(found.value[1]), float(found.sigma[1]), float(true)]


def _patches(picture: Image) -> Image:
    return block_mean(picture, MASTER // PATCHES)


GOALS = {
    "directions less a common rotation [arcmin]": ("relative_arcmin", 0.25),
    "lines in the scatter map": ("line", 0.02),
}


def table(rows: list[dict[str, Any]], most_left: float) -> Iterator[str]:
    """Markdown lines: a row per figure; `most_left` is the goal of the inter-reflection that is left."""
    yield "| figure | goal | mean | worst |"
    yield "|---|---|---|---|"
    left = {f"inter-reflection left, {n}": (f"left_{n}", most_left) for n in SHOWN}
    for title, (key, goal) in (GOALS | left).items():
        values = np.array([row[key] for row in rows])
        missed = "" if values.max() <= goal else " (missed)"
        yield f"| {title} | <= {goal} | {values.mean():.4f} | {values.max():.4f}{missed} |"
    for name, goal in (("m", "within 1 %, covers in 9 of 10"), ("albedo", "covers in 9 of 10")):
        value, sigma, true = np.array([row[name] for row in rows]).T
        error, covered = value / true - 1, (np.abs(value - true) < 1.96 * sigma).sum()
        worst = error[np.abs(error).argmax()]
        yield (
            f"| {name}, error; covers in {covered} of {len(rows)}; median sigma "
            f"{np.median(sigma / value):.2%} | {goal} | {error.mean():+.2%} | {worst:+.2%} |"
        )
    notes = [note for row in rows for note in row["notes"]]
    yield f"| notes; nothing is wrong with these photographs | 0 | {len(notes)} in all | |"
    wrong, stated = (rms([row[f"{k}_arcmin"] for row in rows]) for k in ("absolute", "stated"))
    yield f"| directions with the marks by hand [arcmin], {stated:.2f} stated | | {wrong:.2f} | |"


def row_of(job: tuple[Stage, int]) -> dict[str, Any]:
    """Figures of one seed."""
    stage, seed = job
    with tempfile.TemporaryDirectory() as folder:
        found = stage.calibrate(seed, Path(folder))
    return {"seed": seed, **Judge(stage.room).figures(found)}


def _rows(kind: FileKind, size: Size) -> list[dict[str, Any]]:
    """Figures of all seeds."""
    with tempfile.TemporaryDirectory() as folder:
        stage = Stage(size.room(), Path(folder), kind)
        stage.prepare()
        return side_by_side(row_of, [(stage, seed) for seed in SEEDS])


def main() -> None:
    """Run all seeds of both kinds and write the results."""
    raw, jpeg = _rows(RAW, Size()), _rows(JPEG, Size(hot_spot=HOT_SPOT))
    write("foreign_dome", {"raw": raw, "jpeg": jpeg}, document(raw, jpeg))


def document(raw: list[dict[str, Any]], jpeg: list[dict[str, Any]]) -> Iterator[str]:
    """Markdown lines."""
    yield from ("# A dome of another program's making", "", "Raw photographs of 12 bits:", "")
    yield from table(raw, RAW_LEFT)
    yield from (
        "",
        f"JPEG of 8 bits, and white {HOT_SPOT:g} times as bright in the middle of a panel as in its corners:",
        "",
    )
    yield from table(jpeg, JPEG_LEFT)
