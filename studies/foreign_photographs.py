"""Photographs of a dome that shares nothing with procam or its simulator, and what its owner states.

The owner states what owners know: a lens of another law by its data sheet, a veil measured at a desk, a
floor by eye, marks by hand. All is drawn by seed, within what is stated; the lens is half a percent off.
Photographs are raw, or what a camera makes of them that saves JPEG.
"""

import csv
import shutil
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from procam.estimate.camera.glare_and_vignetting import VeilingGlare, fit_glare
from procam.estimate.camera.radiance import Radiometer
from procam.files.calibration import load_calibration
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.generators import result_of
from procam.maths.geometry.sphere import direction_from_angles
from procam.model.calibration import Calibration
from procam.model.frame import CameraSettings, Frame
from procam.workflows.capture.by_hand import write_by_hand
from procam.workflows.capture.ingest import ingest
from procam.workflows.solve.calibrate import solve
from studies.foreign_bounces import ALBEDOS, DECK_FLOOR, HALF_ANGLE, RADIUS
from studies.foreign_room import ForeignRoom

Array = NDArray[np.float64]
Image = NDArray[np.float32]
CAMERA = "zenith"
BITS, BLACK_LEVEL, READ_DN, WHITE_SNR = 12, 64.0, 1.5, 100.0
# of the veil: share of the light, spreads of its parts [of the picture], and how much is in each
GLARE, SPREADS, PARTS = 0.01, (0.02, 0.05, 0.12, 0.5), (0.15, 0.2, 0.15, 0.5)
BLACK_DRIFT_DN, GAIN_DRIFT = 0.2, 0.002  # during the session
LENS_OFF = 0.005  # of the stated focal length
CENTRE_SIGMA_PX, RIM_SIGMA_DEG, FLOOR_SIGMA = 0.5, 0.2, 0.05
MARKS_DEG = {"a": (12.0, 35.0), "b": (130.0, 30.0), "c": (-110.0, 50.0), "d": (60.0, 65.0)}
SURVEY_DEG, CLICK_PX = 0.05, 0.3
EXPOSURE_S, BLACK_EXPOSURE_S = 0.5, 15.0  # of raw photographs
JPEG_QUALITY = 92
TRAPS = ((0.5, 0.5), (0.3, 0.4), (0.6, 0.7))  # light traps, in shares of the picture
COARSE_PX = 8  # cells in which the veil is spread


@dataclass(frozen=True)
class Size:
    """Projectors' and camera's pixels, rays for each receiver of bounced light, and how even the light is.

    `hot_spot` : white in the middle of a panel over that in its corners, beside an even lens.
    """

    panel: tuple[int, int] = (1024, 640)
    camera: int = 720
    walks: int = 16384
    rays: int = 32768
    hot_spot: float = 1.0

    def room(self) -> ForeignRoom:
        """The dome at this size."""
        return ForeignRoom(self.panel, self.camera, self.walks, self.rays, self.hot_spot)


@dataclass(frozen=True)
class FileKind:
    """Photographs as files: a suffix, what venue.toml says of them, and the exposure that suits them."""

    suffix: str
    response: str
    bits: int
    black_level: float
    exposure_s: float

    def write(self, path: Path, counts: NDArray[np.uint16]) -> None:
        """Write raw counts (H, W, 3) as PATH with this suffix."""
        if self == RAW:
            options = [cv2.IMWRITE_TIFF_COMPRESSION, 1]
        else:
            light = np.clip((counts - BLACK_LEVEL) / (2**BITS - 1 - BLACK_LEVEL), 0, 1)
            counts = np.rint((2**self.bits - 1) * _srgb(light)).astype(np.uint8)
            options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
            options += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
        cv2.imwrite(str(path.with_suffix(self.suffix)), counts[..., ::-1], options)


def _srgb(light: Array) -> Array:
    """The curve of IEC 61966-2-1."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


RAW = FileKind(".tif", "linear", BITS, BLACK_LEVEL, EXPOSURE_S)
JPEG = FileKind(".jpg", "srgb", 8, 0.0, 2 * EXPOSURE_S)


class Sensor:
    """The camera's counts: a veil of which half stays near its light, uneven vignetting, drift, noise.

    The near veil is a peak with a long tail, no Gaussian.
    """

    def __init__(self, room: ForeignRoom) -> None:
        size, camera = room.camera.size, room.camera
        x, y = np.meshgrid(np.arange(size, dtype=float), np.arange(size, dtype=float))
        rays = camera.rays(np.stack([x, y], axis=-1))
        self.circle = np.isfinite(rays[..., 0])
        self.polar = np.arccos(np.clip(rays @ camera.rotation[2], -1, 1))
        slope = 1 + (0.004 * (x - size / 2) - 0.003 * (y - size / 2)) / (size / 2)
        self._fall = np.where(self.circle, self.radial(self.polar) * slope, 0)[..., None]
        circle = self.circle.astype(np.float32)[..., None]
        self._mean = [self._spread(circle, s)[self.circle].mean() for s in SPREADS]

    @staticmethod
    def radial(polar: Array) -> Array:
        """Vignetting (...,) off the axis."""
        return np.asarray(1 / (1 + 0.04 * polar**2 + 0.01 * polar**4))

    @staticmethod
    def _spread(light: Image, share: float) -> Image:
        size = len(light)
        small = cv2.resize(
            light, (size // COARSE_PX, size // COARSE_PX), interpolation=cv2.INTER_AREA
        )
        soft = cv2.GaussianBlur(
            small, (0, 0), share * size / COARSE_PX, borderType=cv2.BORDER_CONSTANT
        )
        return cv2.resize(soft, (size, size)).reshape(light.shape)

    def counts(
        self, light: Image, exposure_s: float, seed: tuple[int, ...], share: float = 0.0
    ) -> NDArray[np.uint16]:
        """Counts (H, W, C) of radiance (H, W, C), after a share of the session."""
        each = zip(SPREADS, PARTS, self._mean, strict=True)
        veil = sum(part / mean * self._spread(light, spread) for spread, part, mean in each)
        seen = (1 - GLARE) * light + GLARE * veil
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
            place, radius = (
                (across * size, down * size),
                size / 50,
            )  # small, as `procam lens glare` asks
            wall = 1 + 0.3 * np.cos(x / size * 4) * np.sin(y / size * 3)
            wall[np.hypot(x - place[0], y - place[1]) < 1.5 * radius] = 0
            light = (wall * self.circle)[..., None].astype(np.float32)
            counts = self.counts(light, EXPOSURE_S, (seed, 1, number))[..., 0]
            settings = CameraSettings(EXPOSURE_S, "mono")
            lights.append(radiometer.radiance(Frame(counts, settings, 0.0, EXPOSURE_S)))
            traps.append((*place, radius))
        return fit_glare(lights, traps, radiometer.seen)


def venue_text(
    room: ForeignRoom,
    sensor: Sensor,
    veil: VeilingGlare,
    seed: int,
    kind: FileKind = RAW,
    map_size: int = 1024,
) -> str:
    """What the owner of a seed states."""
    camera, rng = room.camera, np.random.default_rng((seed, 3))
    focal = float(camera.focal_px * (1 + LENS_OFF * rng.choice([-1, 1])))
    centre = camera.centre + CENTRE_SIGMA_PX * rng.normal(size=2)
    rim = min(90.0, np.degrees(HALF_ANGLE) + RIM_SIGMA_DEG * rng.normal())
    floor = max(0.0, ALBEDOS[DECK_FLOOR] + FLOOR_SIGMA * rng.normal())
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
half_angle_deg = {rim:.1f}
tilt_deg = 0.0
floor_albedo = {floor:.3f}
floor_albedo_sigma = {FLOOR_SIGMA}
map_size = {map_size}
[cameras.{CAMERA}]
size = {[camera.size] * 2}
model = "kannala-brandt"
f = {[round(focal, 3)] * 2}
c = {np.round(centre, 2).tolist()}
k = [{-1 / 24:.6f}, {1 / 1920:.6f}, 0.0, 0.0]
intrinsics = "prior"
response = "{kind.response}"
bits = {kind.bits}
black_level = {kind.black_level}
vignetting = {np.round(vignetting, 5).tolist()}
glare = {veil.glare:.6f}
glare_sigma = {veil.sigma:.6f}
{projectors}
[capture]
exposure_s = {kind.exposure_s}
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
    """The dome, and a folder: its venue, the pictures for its projectors, and their light in numpy files.

    `kind` : of the files that the camera saves. `map_size` : edge of the calibration's dome maps [px].
    """

    room: ForeignRoom
    folder: Path
    kind: FileKind = RAW
    map_size: int = 1024

    def prepare(self) -> None:
        """Write the pictures, and render them all without noise."""
        venue = self.folder / "venue"
        self._state(venue, 0)
        write_by_hand(load_venue(venue), self.folder / "out", movie=False)
        view = self.room.from_camera()
        for entry in self._order():
            drives = {}
            if entry["picture"]:
                picture = cv2.imread(str(self.folder / "out" / entry["picture"]), cv2.IMREAD_COLOR)
                drives[entry["projector"]] = picture[..., ::-1].astype(np.float32) / 255
            np.save(self.folder / f"{entry['shot']}.npy", self.room.photographed(view, drives))

    def _state(self, venue: Path, seed: int) -> None:
        """Write VENUE/venue.toml, with a veil that was measured at a desk."""
        venue.mkdir(parents=True, exist_ok=True)
        sensor, stated = Sensor(self.room), venue / "venue.toml"
        stated.write_text(venue_text(self.room, sensor, VeilingGlare(0, 0.01, ()), seed))
        # at the desk the camera is known, but for its veil, and photographs are raw
        veil = sensor.desk_veil(Radiometer(load_venue(venue).cameras[CAMERA]), seed)
        stated.write_text(venue_text(self.room, sensor, veil, seed, self.kind, self.map_size))

    def _order(self) -> list[dict[str, str]]:
        return list(csv.DictReader((self.folder / "out" / "order.csv").read_text().splitlines()))

    def calibrate(self, seed: int, folder: Path) -> Calibration:
        """A calibration from the photographs of a seed, and what the owner states."""
        shutil.copytree(self.folder / "venue", folder / "venue")
        self._state(folder / "venue", seed)
        (folder / "photographs").mkdir()
        sensor, order = Sensor(self.room), self._order()
        for number, entry in enumerate(order):
            light = np.load(self.folder / f"{entry['shot']}.npy")
            for each, exposure in enumerate(map(float, entry["exposures_s"].split())):
                counts = sensor.counts(
                    light, exposure, (seed, 2, number, each), number / len(order)
                )
                self.kind.write(folder / "photographs" / f"{number:03d}_{each}", counts)
        venue = load_venue(folder / "venue")
        (session,) = (folder / "venue" / "sessions").iterdir()
        result_of(ingest(venue, Session(session), CAMERA, folder / "photographs"))
        return load_calibration(result_of(solve(venue, Session(session))).directory)
