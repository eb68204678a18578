"""A whole calibration of a dome that shares nothing with procam or its simulator, by hand, over noise seeds.

The photographs are files; so are the pictures that they show. `studies.foreign_room` renders them, and
judges what the projectors really draw. The owner states what owners know: a lens of another law by its data
sheet, half a percent off, a veil measured at a desk, marks by hand. Writes studies/foreign_dome.json and
studies/foreign_dome.md; `python -m studies foreign-dome` remakes them in twenty minutes.
"""

import csv
import os
import shutil
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from procam.compensate.compensator import Compensator
from procam.compensate.projector_frames import projector_frames
from procam.estimate.camera.glare_and_vignetting import VeilingGlare, fit_glare
from procam.estimate.camera.radiance import Radiometer
from procam.files.calibration import load_calibration
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.interfaces import judge
from procam.maths.geometry.sphere import (
    direction_from_angles,
    master_directions,
    master_pixels,
    master_solid_angles,
)
from procam.maths.warp import block_mean, sample
from procam.model.calibration import Calibration
from procam.model.frame import CameraSettings, Frame
from procam.workflows.capture.by_hand import export, prepare_by_hand
from procam.workflows.capture.ingest import ingest
from procam.workflows.sample_content import CONTENTS
from procam.workflows.solve.calibrate import solve
from studies.foreign_room import (
    DECK_ALBEDO,
    HALF_ANGLE,
    PLATES,
    RADIUS,
    Cells,
    ForeignRoom,
    hit,
)
from studies.measure import rms, write

Array = NDArray[np.float64]
Image = NDArray[np.float32]
SEEDS, WORKERS = range(1, 11), 2
CAMERA = "zenith"
BITS, BLACK_LEVEL, READ_DN, WHITE_SNR = 12, 64.0, 1.5, 100.0
GLARE, LOCAL, NEAR, WIDE = 0.01, 0.5, 0.05, 0.5  # of the veil: share, and spreads [of the picture]
BLACK_DRIFT_DN, GAIN_DRIFT = 0.2, 0.002  # during the session
LENS_OFF = 1.005  # stated focal length, of the true one
MARKS_DEG = {"a": (12.0, 35.0), "b": (130.0, 30.0), "c": (-110.0, 50.0), "d": (60.0, 65.0)}
SURVEY_DEG, CLICK_PX = 0.05, 0.3
EXPOSURE_S, BLACK_EXPOSURE_S = 0.5, 15.0
TRAPS = ((0.5, 0.5), (0.3, 0.4), (0.6, 0.7))  # light traps, in shares of the picture
MASTER, PATCHES = 1024, 256
SHOWN = ("half-sky", "texture")
EVERY = 7  # pixel of a projector whose direction is compared
LINE_MEAN_DEG, LINE_PIXELS = 2.0, 100


@dataclass(frozen=True)
class Size:
    """Projectors' and camera's pixels, and rays for each receiver of bounced light."""

    panel: tuple[int, int] = (1024, 640)
    camera: int = 720
    walks: int = 16384
    rays: int = 32768

    def room(self) -> ForeignRoom:
        """The dome at this size."""
        return ForeignRoom(self.panel, self.camera, self.walks, self.rays)


class Sensor:
    """The camera's counts: a veil of which half stays near its light, uneven vignetting, drift, noise."""

    def __init__(self, room: ForeignRoom) -> None:
        size, camera = room.camera.size, room.camera
        x, y = np.meshgrid(np.arange(size, dtype=float), np.arange(size, dtype=float))
        rays = camera.rays(np.stack([x, y], axis=-1))
        self.circle = np.isfinite(rays[..., 0])
        self.polar = np.arccos(np.clip(rays @ camera.rotation[2], -1, 1))
        slope = 1 + (0.004 * (x - size / 2) - 0.003 * (y - size / 2)) / (size / 2)
        self._fall = np.where(self.circle, self.radial(self.polar) * slope, 0)[..., None]
        circle = self.circle.astype(np.float32)[..., None]
        self._mean = [self._spread(circle, s)[self.circle].mean() for s in (NEAR, WIDE)]

    @staticmethod
    def radial(polar: Array) -> Array:
        """Vignetting (...,) off the axis."""
        return np.asarray(1 / (1 + 0.04 * polar**2 + 0.01 * polar**4))

    @staticmethod
    def _spread(light: Image, share: float) -> Image:
        size = len(light)
        small = cv2.resize(light, (size // 8, size // 8), interpolation=cv2.INTER_AREA)
        soft = cv2.GaussianBlur(small, (0, 0), share * size / 8, borderType=cv2.BORDER_CONSTANT)
        return cv2.resize(soft, (size, size)).reshape(light.shape)

    def counts(
        self, light: Image, exposure_s: float, seed: tuple[int, ...], share: float = 0.0
    ) -> NDArray[np.uint16]:
        """Counts (H, W, C) of radiance (H, W, C), after a share of the session."""
        near, wide = (
            self._spread(light, s) / m for s, m in zip((NEAR, WIDE), self._mean, strict=True)
        )
        seen = (1 - GLARE) * light + GLARE * (LOCAL * near + (1 - LOCAL) * wide)
        full = 2**BITS - 1 - BLACK_LEVEL
        signal = full * seen * self._fall * exposure_s * (1 + GAIN_DRIFT * share)
        sigma = np.sqrt(np.maximum(signal, 0) * 0.7 * full / WHITE_SNR**2 + READ_DN**2)
        noise = np.random.default_rng(seed).standard_normal(signal.shape, np.float32)
        counts = signal + sigma * noise + BLACK_LEVEL + BLACK_DRIFT_DN * share
        return np.clip(np.rint(counts), 0, 2**BITS - 1).astype(np.uint16)

    def desk_veil(self, radiometer: Radiometer, seed: int) -> VeilingGlare:
        """Veiling glare as the owner measures it: a bright wall with a light trap, three times."""
        size = len(self.circle)
        x, y = np.meshgrid(np.arange(size), np.arange(size))
        lights, traps = [], []
        for number, (across, down) in enumerate(TRAPS):
            place, radius = (across * size, down * size), size / 20
            wall = 1 + 0.3 * np.cos(x / size * 4) * np.sin(y / size * 3)
            wall[np.hypot(x - place[0], y - place[1]) < 1.5 * radius] = 0
            light = (wall * self.circle)[..., None].astype(np.float32)
            counts = self.counts(light, EXPOSURE_S, (seed, 1, number))[..., 0]
            settings = CameraSettings(EXPOSURE_S, "mono")
            lights.append(radiometer.radiance(Frame(counts, settings, 0.0, EXPOSURE_S)))
            traps.append((*place, radius))
        return fit_glare(lights, traps, radiometer.seen)


def venue_text(room: ForeignRoom, sensor: Sensor, veil: VeilingGlare) -> str:
    """What the owner states; the values are drawn once, within what is stated of them."""
    camera, rng = room.camera, np.random.default_rng(5)
    polar = np.linspace(0, 1.5, 50)[1:]
    powers = np.stack([polar**2, polar**4], axis=1)
    vignetting = np.linalg.lstsq(powers, sensor.radial(polar) - 1, rcond=None)[0]
    projectors = "".join(
        f"[projectors.{name}]\nsize = {list(p.size)}\n" for name, p in room.projectors.items()
    )
    return f"""\
[screen]
kind = "dome"
radius_m = {RADIUS}
half_angle_deg = {np.degrees(HALF_ANGLE) + 0.2:.1f}
tilt_deg = 0.0
floor_albedo = {DECK_ALBEDO - 0.04:.2f}
floor_albedo_sigma = 0.05
[cameras.{CAMERA}]
size = {[camera.size] * 2}
model = "kannala-brandt"
f = {[round(float(camera.focal_px) * LENS_OFF, 3)] * 2}
c = {np.round(camera.centre + np.array([0.3, -0.2]), 2).tolist()}
k = [{-1 / 24:.6f}, {1 / 1920:.6f}, 0.0, 0.0]
intrinsics = "prior"
response = "linear"
bits = {BITS}
black_level = {BLACK_LEVEL}
vignetting = {np.round(vignetting, 5).tolist()}
glare = {veil.glare:.6f}
glare_sigma = {veil.sigma:.6f}
{projectors}
[capture]
exposure_s = {EXPOSURE_S}
black_exposure_s = {BLACK_EXPOSURE_S}
""" + "".join(_mark(room, name, rng) for name in MARKS_DEG)


def _mark(room: ForeignRoom, name: str, rng: np.random.Generator) -> str:
    azimuth, elevation = MARKS_DEG[name]
    point = RADIUS * direction_from_angles(np.radians(azimuth), np.radians(elevation))
    pixel = room.camera.pixel_of(point) + CLICK_PX * rng.normal(size=2)
    off = SURVEY_DEG * rng.normal(size=2) / (np.cos(np.radians(elevation)), 1)
    return f"""\
[[fiducials]]
name = "{name}"
azimuth_deg = {azimuth + off[0]:.4f}
elevation_deg = {elevation + off[1]:.4f}
sigma_deg = {SURVEY_DEG}
camera = "{CAMERA}"
pixel = {np.round(pixel, 2).tolist()}
sigma_px = {CLICK_PX}
"""


@dataclass(frozen=True)
class Stage:
    """The dome, and a folder: its venue, the pictures for its projectors, and their light in numpy files."""

    room: ForeignRoom
    folder: Path

    def prepare(self) -> None:
        """Write venue.toml and the pictures, and render them all without noise."""
        venue = self.folder / "venue"
        venue.mkdir(parents=True)
        sensor = Sensor(self.room)
        (venue / "venue.toml").write_text(venue_text(self.room, sensor, VeilingGlare(0, 0.01, ())))
        veil = sensor.desk_veil(Radiometer(load_venue(venue).cameras[CAMERA]), 0)
        (venue / "venue.toml").write_text(venue_text(self.room, sensor, veil))
        export(prepare_by_hand(load_venue(venue)), self.folder / "out", movie=False)
        view = self.room.from_camera()
        for entry in self._order():
            drives = {}
            if entry["picture"]:
                picture = cv2.imread(
                    str(self.folder / "out" / entry["picture"]), cv2.IMREAD_UNCHANGED
                )
                grey = picture.ndim == 2
                rgb = np.dstack([picture] * 3) if grey else picture[..., ::-1]
                drives[entry["projector"]] = rgb.astype(np.float32) / 255
            np.save(self.folder / f"{entry['shot']}.npy", self.room.photographed(view, drives))

    def _order(self) -> list[dict[str, str]]:
        return list(csv.DictReader((self.folder / "out" / "order.csv").read_text().splitlines()))

    def calibrate(self, seed: int, folder: Path) -> Calibration:
        """A calibration from photographs with the noise of a seed."""
        shutil.copytree(self.folder / "venue", folder / "venue")
        (folder / "photographs").mkdir()
        sensor, order = Sensor(self.room), self._order()
        for number, entry in enumerate(order):
            light = np.load(self.folder / f"{entry['shot']}.npy")
            for each, exposure in enumerate(map(float, entry["exposures_s"].split())):
                counts = sensor.counts(
                    light, exposure, (seed, 2, number, each), number / len(order)
                )
                name = folder / "photographs" / f"{number:03d}_{each}.tif"
                cv2.imwrite(str(name), counts[..., ::-1], [cv2.IMWRITE_TIFF_COMPRESSION, 1])
        venue = load_venue(folder / "venue")
        (session,) = (folder / "venue" / "sessions").iterdir()
        for _ in ingest(venue, Session(session), CAMERA, folder / "photographs"):
            pass
        *_, last = solve(venue, Session(session))
        return load_calibration(Path(last.data["calibration"]))


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
            "m": [
                float(v)
                for v in (found.feedback.value[1], found.feedback.sigma[1], self.feedback[1])
            ],
            "albedo": [
                float(v) for v in (found.albedo.value[1], found.albedo.sigma[1], self.albedo)
            ],
            "relative_arcmin": relative,
            "absolute_arcmin": absolute,
            "stated_arcmin": stated,
            "line": self._line(found),
            **{f"left_{name}": self._left(found, CONTENTS[name](MASTER)) for name in SHOWN},
            "notes": list(found.provenance["notes"]),
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
            directions[name] = (points / np.linalg.norm(points, axis=-1, keepdims=True)).reshape(
                height, width, 3
            )
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
        made = compensator.solve(content)
        error = (
            made.direct + self._shown(found, made.direct) @ to_content - compensator.target(content)
        )
        plain = Compensator(found, MASTER, "none").solve(content).direct
        before = self._shown(found, plain) @ to_content
        free = (made.free & self._lit[..., None]).astype(np.float32)
        weight = master_solid_angles(PATCHES)[..., None] * (_patches(free) > judge.WHOLE)
        left = [np.sum(weight * _patches(p) ** 2, axis=(0, 1)) for p in (error, before)]
        return float(np.sqrt(left[0] / left[1]).max())

    def _shown(self, found: Calibration, direct: Image) -> Image:
        """Scattered light (N, N, 3) [camera] of direct light, as the projectors draw it."""
        return self._bounced(self.room.sent(projector_frames(direct, found)))


def _patches(picture: Image) -> Image:
    return block_mean(picture, MASTER // PATCHES)


GOALS = {
    "directions less a common rotation [arcmin]": ("relative_arcmin", 0.25),
    "lines in the scatter map": ("line", 0.02),
    "inter-reflection left, half sky": ("left_half-sky", 0.015),
    "inter-reflection left, texture": ("left_texture", 0.015),
}


def table(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Markdown lines: a row per figure."""
    yield "| figure | goal | mean | worst |"
    yield "|---|---|---|---|"
    for title, (key, goal) in GOALS.items():
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
    wrong, stated = (rms([row[f"{k}_arcmin"] for row in rows]) for k in ("absolute", "stated"))
    yield f"| directions with the marks by hand [arcmin], {stated:.2f} stated | | {wrong:.2f} | |"


def row_of(job: tuple[Stage, int]) -> dict[str, Any]:
    """Figures of one seed."""
    stage, seed = job
    with tempfile.TemporaryDirectory() as folder:
        found = stage.calibrate(seed, Path(folder))
    return {"seed": seed, **Judge(stage.room).figures(found)}


def main() -> None:
    """Run all seeds and write the results."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # each worker has a core of its own
    rows = []
    with (
        tempfile.TemporaryDirectory() as folder,
        ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn")) as pool,
    ):
        stage = Stage(Size().room(), Path(folder))
        stage.prepare()
        for row in pool.map(row_of, [(stage, seed) for seed in SEEDS]):
            rows.append(row)
            print(row, flush=True)
    write(
        "foreign_dome", {"rows": rows}, ["# A dome of another program's making", "", *table(rows)]
    )
