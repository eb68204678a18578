"""The contents of a venue's folder for its report, reduced to a size to show."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray, Image
from procam.errors import FileFormatError, InputError
from procam.files.calibration import load_calibration
from procam.files.images.layers import RGB, read_channels
from procam.files.venue.load import Venue, load_venue
from procam.files.versions import calibration_in_use, list_calibrations
from procam.interfaces.plots.charts import on_canvas
from procam.interfaces.report.before_after import WHOLE, BeforeAfter, Limits
from procam.interfaces.report.stored_loop import StoredLoop, read_loop
from procam.maths.geometry.canvas import STANDARD
from procam.maths.warp import block_mean, pixel_places, sample
from procam.model.calibration import Calibration
from procam.model.correspondence import ProjectorSurface
from procam.model.screen import ContentCanvas, Dome, Screen
from procam.workflows.other_seat import SeatCheck, check_from_other_seat

SIMULATED = "simulated"  # the backend of simulated venues
SHOWN = 450  # width of a picture in the report, about [px]
POINTS = 1_200_000  # most projector pixels that are drawn on a map


@dataclass(frozen=True, slots=True)
class Truth:
    """The simulator's truth: pictures by method [rel]; feedback, albedo (3,); directory."""

    directory: Path
    pictures: Mapping[str, Image]
    feedback: Array
    albedo: Array


@dataclass(frozen=True, slots=True)
class Material:
    """Everything a report shows; what a venue does not have is None or empty.

    Attributes
    ----------
    calibration : that in use, `used` its folder; calibrations : all of them, oldest first.
    figures : the entries of summary.json by name. pictures : (H, W, 3) by name, size to show.
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

    @property
    def word(self) -> str:
        """What its screen is called."""
        return "dome" if self.is_dome else "room"

    @property
    def screen(self) -> Screen | None:
        """The screen of the calibration, or else of venue.toml; None where nothing is known."""
        return _screen(self.calibration, self.venue)

    @property
    def is_dome(self) -> bool:
        """Whether its screen is a dome; it is where nothing is known."""
        return self.screen is None or isinstance(self.screen, Dome)

    @property
    def canvas(self) -> ContentCanvas:
        """The canvas of all pictures: that of a calibration's maps."""
        return self.screen.canvas if self.screen else STANDARD

    def inside(self, size: int) -> BoolArray:
        """Which pixels (H, W) of a picture of that width lie on the screen."""
        return self.canvas.directions(size)[1]

    def resized(self, picture: Image, size: int) -> Image:
        """A picture at another width."""
        return fitted(self.canvas, picture, size)

    def on_screen(self, surface: ProjectorSurface, values: FloatArray) -> Array:
        """Values (H, W) of a projector's pixels as a picture (h, w); NaN where no pixel falls."""
        step = max(1, int(np.sqrt(surface.valid.size / POINTS)))
        valid = surface.valid[::step, ::step]
        rows, columns = self.canvas.shape(SHOWN)
        size = int(np.clip(np.sqrt(valid.sum() * columns / rows) / 1.6, 24, SHOWN))
        direction = surface.direction[::step, ::step][valid]
        return on_canvas(self.canvas, direction, values[::step, ::step][valid], size)

    def coverage(self, size: int) -> Image:
        """Share (H, W) of each place that a projector can light."""
        assert self.calibration is not None
        return self.resized(self.calibration.maps.coverage, size)

    def protected(self, size: int) -> BoolArray:
        """Where (H, W) the picture is left as it is."""
        assert self.calibration is not None
        maps, inside = self.calibration.maps, self.inside(size)
        return maps.is_protected(pixel_places(inside.shape, maps.coverage.shape)) & inside

    def before_after(self) -> BeforeAfter | None:
        """Before and after, from the best source: simulator, then camera, then prediction."""
        if self.calibration is None or not self.pictures:
            return None
        if self.truth and {"none", "exact"} <= set(self.truth.pictures):
            shown = self.truth.pictures
            return self._seen(shown["none"], shown.get("refined", shown["exact"]), "simulator")
        if self.loop:
            seen = self._seen(self.photographs["before"], self.photographs["after"], "camera")
            return replace(seen, free=self.photographs["free"])  # less what the camera does not see
        before, after = self.pictures["uncompensated"], self.pictures["compensated"]
        return self._seen(before, after, "prediction")

    def _seen(self, before: Image, after: Image, source: str) -> BeforeAfter:
        """Both, with the target at their size."""
        size = before.shape[1]
        target, free = (self.resized(self.pictures[name], size) for name in ("target", "free"))
        weight = self.canvas.weights(size)
        return BeforeAfter(before, after, target, free, self.coverage(size), weight, source)

    def limits(self) -> Limits | None:
        """Where a limit holds; None without a compensated picture."""
        if self.calibration is None or not self.pictures:
            return None
        held = 1 - self.pictures["free"]
        above = self.pictures["compensated"] > self.pictures["target"]
        size = held.shape[1]
        judged = self.coverage(size) * ~self.protected(size)
        weight = (self.canvas.weights(size) * (judged > WHOLE))[..., None]
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
    venue = load_venue(venue_dir) if (venue_dir / "venue.toml").is_file() else None
    screen = _screen(calibration, venue)
    canvas = screen.canvas if screen else STANDARD
    pictures = _pictures(venue_dir / "pictures", canvas)
    size = pictures["target"].shape[1] if pictures else SHOWN
    return Material(
        venue_dir,
        calibrations,
        used,
        calibration,
        summary.get("figures", {}),
        summary.get("preset"),
        *_loop(venue_dir / "loop", calibration, canvas),
        pictures,
        _truth(venue_dir / "truth", calibration, size),
        venue,
        _other_seat(venue_dir, used, calibration),
    )


def _screen(calibration: Calibration | None, venue: Venue | None) -> Screen | None:
    if calibration:
        return calibration.screen
    return venue.screen if venue else None


def _other_seat(
    venue_dir: Path, used: Path | None, calibration: Calibration | None
) -> SeatCheck | None:
    if used is None or calibration is None or not isinstance(calibration.screen, Dome):
        return None  # rooms are not compared
    return check_from_other_seat(venue_dir, used, calibration)


def fitted(canvas: ContentCanvas, picture: Image, size: int) -> Image:
    """A picture on a canvas at another width: averaged down, then sampled."""
    shape = canvas.shape(size)
    smaller = block_mean(picture, max(1, picture.shape[1] // size))
    if smaller.shape[:2] == shape:
        return smaller
    return sample(smaller, pixel_places(shape, smaller.shape))


def _pictures(folder: Path, canvas: ContentCanvas) -> dict[str, Image]:
    names = ("target", "uncompensated", "compensated", "direct", "free")
    if not all((folder / f"{n}.exr").is_file() for n in names):
        return {}
    return {n: _picture(folder / f"{n}.exr", canvas) for n in names}


def _loop(
    folder: Path, calibration: Calibration | None, canvas: ContentCanvas
) -> tuple[StoredLoop | None, dict[str, Image]]:
    """The last loop and its photographs; none if it was of another session than the calibration."""
    names = ("before", "after", "predicted", "free")
    stored = read_loop(folder / "loop.json")
    if stored is None or not all((folder / f"{n}.exr").is_file() for n in names):
        return None, {}
    session = calibration.provenance.session if calibration else None
    if stored.session not in (None, session):
        return None, {}
    return stored, {n: _picture(folder / f"{n}.exr", canvas) for n in names}


def _truth(folder: Path, calibration: Calibration | None, size: int) -> Truth | None:
    document = read_document(folder / "calibration.json")
    if not document or calibration is None:
        return None
    matrix, canvas = calibration.content_from_camera.T.astype(np.float32), calibration.screen.canvas
    files = {n: folder / "pictures" / f"{n}.exr" for n in ("none", "exact", "refined")}
    there = {n: _picture(p, canvas) @ matrix for n, p in files.items() if p.is_file()}
    pictures = {n: fitted(canvas, p, size) for n, p in there.items()}
    feedback, albedo = (np.array(document[k]["value"]) for k in ("feedback", "albedo"))
    return Truth(folder, pictures, feedback, albedo)


def _picture(path: Path, canvas: ContentCanvas) -> Image:
    """An RGB file averaged down to the size of the report; NaN becomes black."""
    channels = read_channels(path)
    if not set(RGB) <= set(channels):
        raise FileFormatError(
            f"{path}: channels R, G and B are missing (it has {', '.join(channels)}); make it again"
        )
    picture = np.nan_to_num(np.stack([channels[c] for c in RGB], axis=-1))
    width = picture.shape[1]
    return fitted(canvas, picture, width // max(1, round(width / SHOWN)))


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
