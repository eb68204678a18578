"""The contents of a venue's folder for its report, reduced to a size to show."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array, BoolArray, FloatArray, Image
from procam.errors import FileFormatError, InputError
from procam.files.calibration import load_calibration
from procam.files.images.layers import RGB, read_channels
from procam.files.venue.load import Venue, load_venue
from procam.files.versions import calibration_in_use, list_calibrations
from procam.interfaces.plots.charts import on_dome
from procam.interfaces.report.stored_loop import StoredLoop, read_loop
from procam.maths.geometry.sphere import master_directions, master_pixels, master_solid_angles
from procam.maths.warp import block_mean, sample
from procam.model.calibration import Calibration
from procam.model.correspondence import ProjectorSurface
from procam.workflows.other_seat import SeatCheck, check_from_other_seat

SIMULATED = "simulated"  # the backend of simulated venues
SHOWN = 450  # edge of a picture in the report, about [px]
JUDGED = 256  # edge of the patches that errors are averaged over, in patches
POINTS = 1_200_000  # most projector pixels that are drawn on a dome map
WHOLE = 0.999  # share from which a patch counts as lit, or as free of limits


@dataclass(frozen=True, slots=True)
class Truth:
    """The simulator's truth: pictures by method [rel]; feedback, albedo (3,); directory."""

    directory: Path
    pictures: Mapping[str, Image]
    feedback: Array
    albedo: Array


@dataclass(frozen=True, slots=True)
class BeforeAfter:
    """A picture before and after compensation and its target, all (N, N, 3) [rel].

    `free` (N, N, 3) is the share of each patch where no limit holds. `source` of `before` and `after`:
    simulator, camera or prediction.
    """

    before: Image
    after: Image
    target: Image
    free: Image
    coverage: Image
    source: str

    def error_rms(self) -> tuple[float, float]:
        """Difference from the target before and after, where no limit holds [rel]."""
        size = max(1, len(self.target) // JUDGED)
        small = [block_mean(p, size) for p in (self.before, self.after, self.target, self.free)]
        whole = (small[3] > WHOLE) & (block_mean(self.coverage, size) > WHOLE)[..., None]
        weight = master_solid_angles(len(whole))[..., None] * whole
        total = max(float(weight.sum()), 1e-12)
        before, after = (np.sum(weight * (p - small[2]) ** 2) / total for p in small[:2])
        return float(np.sqrt(before)), float(np.sqrt(after))


@dataclass(frozen=True, slots=True)
class Limits:
    """Where the compensated picture meets a limit of the projectors.

    `codes` (N, N, 3): 0 exact, 1 too bright, 2 too dark, 3 not lit or protected. `too_bright` and
    `too_dark` (3,) are shares of the lit dome that is not protected.
    """

    codes: NDArray[np.integer]
    too_bright: Array
    too_dark: Array


@dataclass(frozen=True, slots=True)
class Material:
    """Everything a report shows; what a venue does not have is None or empty.

    Attributes
    ----------
    calibration : that in use, `used` its folder; calibrations : all of them, oldest first.
    figures : the entries of summary.json by name. pictures : (N, N, 3) by name, size to show.
    loop, photographs : the closed loop, and its photographs by name. venue : its venue.toml.
    other_seat : its check from another seat.
    """

    directory: Path
    calibrations: list[Path]
    used: Path | None
    calibration: Calibration | None
    figures: Mapping[str, Mapping[str, Any]]
    preset: str | None
    loop: StoredLoop | None
    photographs: Mapping[str, Image]
    pictures: Mapping[str, Image]
    truth: Truth | None
    venue: Venue | None = None
    other_seat: SeatCheck | None = None

    @property
    def name(self) -> str:
        """The venue's name: that of its folder."""
        return self.directory.resolve().name

    @property
    def calibrated_at(self) -> datetime | None:
        """When the calibration in use was written, in local time."""
        return written_at(self.used) if self.used else None

    @property
    def is_simulated(self) -> bool:
        """Whether light and photographs were computed."""
        known = self.calibration.provenance.backends if self.calibration else ()
        return self.truth is not None or SIMULATED in known

    def coverage(self, size: int) -> Image:
        """Share (N, N) of each direction that a projector can light."""
        assert self.calibration is not None
        return resized(self.calibration.maps.coverage, size)

    def protected(self, size: int) -> BoolArray:
        """Where (N, N) the picture is left as it is."""
        assert self.calibration is not None
        maps, (direction, inside) = self.calibration.maps, master_directions(size)
        return maps.is_protected(master_pixels(direction, maps.size)) & inside

    def before_after(self) -> BeforeAfter | None:
        """Before and after, from the best source: simulator, then camera, then prediction."""
        if self.calibration is None or not self.pictures:
            return None
        target, free = self.pictures["target"], self.pictures["free"]
        coverage = self.coverage(len(target))
        if self.truth and {"none", "exact"} <= set(self.truth.pictures):
            shown = self.truth.pictures
            after = shown.get("refined", shown["exact"])
            return BeforeAfter(shown["none"], after, target, free, coverage, "simulator")
        if self.loop:
            photographs = self.photographs
            size = len(photographs["before"])
            target, free, coverage = (resized(p, size) for p in (target, free, coverage))
            before, after = photographs["before"], photographs["after"]
            return BeforeAfter(before, after, target, free, coverage, "camera")
        before, after = self.pictures["uncompensated"], self.pictures["compensated"]
        return BeforeAfter(before, after, target, free, coverage, "prediction")

    def limits(self) -> Limits | None:
        """Where a limit holds; None without a compensated picture."""
        if self.calibration is None or not self.pictures:
            return None
        held = 1 - self.pictures["free"]
        above = self.pictures["compensated"] > self.pictures["target"]
        judged = self.coverage(len(held)) * ~self.protected(len(held))
        weight = (master_solid_angles(len(held)) * (judged > WHOLE))[..., None]
        total = max(float(weight.sum()), 1e-12)
        codes = np.where(held > 0.5, np.where(above, 1, 2), 0)
        codes = np.where((judged > 0.5)[..., None], codes, 3)
        shares = ((weight * held * side).sum(axis=(0, 1)) / total for side in (above, ~above))
        return Limits(codes, *shares)


def written_at(calibration: Path) -> datetime:
    """When a calibration was written, in local time."""
    stamp = (calibration / "calibration.json").stat().st_mtime
    return datetime.fromtimestamp(stamp).astimezone()


def read_material(venue_dir: Path) -> Material:
    """Read a venue's folder."""
    calibrations = list_calibrations(venue_dir)
    summary = read_document(venue_dir / "summary.json")
    if not (calibrations or summary or (venue_dir / "venue.toml").is_file()):
        raise InputError(
            f"{venue_dir}: this is no venue's folder, as it has neither venue.toml nor a calibration; "
            "`procam demo` makes one to try"
        )
    used = calibration_in_use(venue_dir) if calibrations else None
    calibration = load_calibration(used) if used else None
    pictures = _pictures(venue_dir / "pictures")
    size = len(pictures["target"]) if pictures else SHOWN
    return Material(
        venue_dir,
        calibrations,
        used,
        calibration,
        summary.get("figures", {}),
        summary.get("preset"),
        *_loop(venue_dir / "loop", calibration),
        pictures,
        _truth(venue_dir / "truth", calibration, size),
        load_venue(venue_dir) if (venue_dir / "venue.toml").is_file() else None,
        check_from_other_seat(venue_dir, used, calibration) if used and calibration else None,
    )


def resized(picture: Image, size: int) -> Image:
    """A dome master at another size: averaged down, then sampled."""
    if len(picture) == size:
        return picture
    smaller = block_mean(picture, max(1, len(picture) // size))
    direction, _ = master_directions(size)
    return sample(smaller, master_pixels(direction, len(smaller)))


def on_master(surface: ProjectorSurface, values: FloatArray) -> Array:
    """Values (H, W) of a projector's pixels as a dome master; NaN where no pixel falls."""
    step = max(1, int(np.sqrt(surface.valid.size / POINTS)))
    valid = surface.valid[::step, ::step]
    pixels = int(valid.sum())
    size = int(np.clip(np.sqrt(pixels) / 1.6, 24, SHOWN))
    return on_dome(surface.direction[::step, ::step][valid], values[::step, ::step][valid], size)


def _pictures(folder: Path) -> dict[str, Image]:
    names = ("target", "uncompensated", "compensated", "direct", "free")
    if not all((folder / f"{n}.exr").is_file() for n in names):
        return {}
    return {n: _picture(folder / f"{n}.exr") for n in names}


def _loop(
    folder: Path, calibration: Calibration | None
) -> tuple[StoredLoop | None, dict[str, Image]]:
    """The last loop and its photographs; none if it was of another session than the calibration."""
    names = ("before", "after", "predicted", "free")
    stored = read_loop(folder / "loop.json")
    if stored is None or not all((folder / f"{n}.exr").is_file() for n in names):
        return None, {}
    session = calibration.provenance.session if calibration else None
    if stored.session not in (None, session):
        return None, {}
    return stored, {n: _picture(folder / f"{n}.exr") for n in names}


def _truth(folder: Path, calibration: Calibration | None, size: int) -> Truth | None:
    document = read_document(folder / "calibration.json")
    if not document or calibration is None:
        return None
    matrix = calibration.content_from_camera.T.astype(np.float32)
    files = {n: folder / "pictures" / f"{n}.exr" for n in ("none", "exact", "refined")}
    pictures = {n: resized(_picture(p) @ matrix, size) for n, p in files.items() if p.is_file()}
    feedback, albedo = (np.array(document[k]["value"]) for k in ("feedback", "albedo"))
    return Truth(folder, pictures, feedback, albedo)


def _picture(path: Path) -> Image:
    """An RGB file averaged down to the size of the report; NaN becomes black."""
    channels = read_channels(path)
    if not set(RGB) <= set(channels):
        raise FileFormatError(
            f"{path}: channels R, G and B are missing (it has {', '.join(channels)}); make it again"
        )
    picture = np.nan_to_num(np.stack([channels[c] for c in RGB], axis=-1))
    return block_mean(picture, max(1, round(len(picture) / SHOWN)))


def read_document(path: Path) -> dict[str, Any]:
    """A JSON file's object; empty if there is none."""
    if not path.is_file():
        return {}
    try:
        document = json.loads(path.read_text("utf-8"))
    except (ValueError, RecursionError) as error:
        raise FileFormatError(
            f"{path}: this is not valid JSON ({error}); delete it or make it again"
        ) from error
    if not isinstance(document, dict):
        raise FileFormatError(f"{path}: a JSON object is needed; delete it or make it again")
    return document
