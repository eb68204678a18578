"""venue.toml, the description of a rig by its owner. Every mistake is one line with its dotted path."""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from procam.errors import InputError
from procam.files.atomic import write_text
from procam.files.toml import read_toml
from procam.files.venue.checks import find_mistakes
from procam.files.venue.messages import explain
from procam.files.venue.screens import angles_of, screen_of
from procam.files.venue.tables import BY_HAND, CameraTable, VenueTable
from procam.maths.geometry.lenses import Lens
from procam.model.optics import AprilTag, CameraModel, Distance, Fiducial, Sensor
from procam.model.screen import Screen


@dataclass(frozen=True, slots=True)
class Venue:
    """A venue folder and its validated file.

    `backends` holds each backend's own raw table, and `screen` is what the table describes.
    """

    directory: Path
    table: VenueTable
    backends: Mapping[str, Mapping[str, Any]]
    screen: Screen

    @property
    def cameras(self) -> dict[str, CameraModel]:
        """The cameras, without poses."""
        return {name: _camera(name, t) for name, t in self.table.cameras.items()}

    def with_bits(self, bits: Mapping[str, int]) -> "Venue":
        """The venue with other depths of its cameras' counts, by name."""
        cameras = {
            name: camera.model_copy(update={"bits": bits.get(name, camera.bits)})
            for name, camera in self.table.cameras.items()
        }
        return replace(self, table=self.table.model_copy(update={"cameras": cameras}))

    @property
    def fiducials(self) -> list[Fiducial]:
        """The fiducials on the screen.

        Cameras that see the same fiducial share the error of its survey, so each gets that sigma times
        the root of their number.
        """
        seen = Counter(t.name for t in self.table.fiducials)
        marks = []
        for t in self.table.fiducials:
            azimuth, elevation, survey = angles_of(t, self.screen, self.table.screen)
            focal = np.mean(self.table.cameras[t.camera].f) if t.camera else np.inf
            seen_sigma = float(t.sigma_px / focal)
            sigma = float(np.hypot(survey * np.sqrt(seen[t.name]), seen_sigma))
            device, pixel = t.camera or t.projector or "", np.array(t.pixel)
            marks.append(Fiducial(t.name, azimuth, elevation, sigma, device, pixel, seen_sigma))
        return marks

    @property
    def tags(self) -> list[AprilTag]:
        """AprilTags on the screen."""
        return [
            AprilTag(t.family, t.id, *angles_of(t, self.screen, self.table.screen))
            for t in self.table.apriltags
        ]

    @property
    def distances(self) -> list[Distance]:
        """Measured distances."""
        return [Distance(t.a, t.b, t.metres, t.sigma_m) for t in self.table.distances]


def load_venue(directory: Path) -> Venue:
    """Read and validate DIRECTORY/venue.toml; all mistakes at once, one per line."""
    path = directory / "venue.toml"
    if not path.is_file():
        raise InputError(
            f"{path}: no such file; make a venue folder with `procam init {directory} --template NAME`"
        )
    return checked_venue(directory, read_toml(path))


def checked_venue(directory: Path, raw: dict[str, Any]) -> Venue:
    """The venue of a venue.toml that is read already; all mistakes at once, one per line."""
    path, names = directory / "venue.toml", _backend_names(raw)
    backends = {name: raw.pop(name, {}) for name in names}
    try:
        table = VenueTable.model_validate(raw)
    except ValidationError as error:
        raise _refusal(path, [explain(e, sorted(names)) for e in error.errors()]) from error
    screen = screen_of(table.screen, directory)
    if found := find_mistakes(table, screen, directory):
        raise _refusal(path, found)
    return Venue(directory, table, backends, screen)


def template_names() -> list[str]:
    """Names of the venue templates that come with procam."""
    folder = resources.files("calib_data") / "venues"
    return sorted(entry.name for entry in folder.iterdir() if (entry / "venue.toml").is_file())


def template_text(name: str) -> str:
    """The commented venue.toml of a template."""
    return _template_files(name)["venue.toml"]


def _template_files(name: str) -> dict[str, str]:
    """The texts of a template's files, by name."""
    if name not in template_names():
        raise InputError(
            f"template {name!r} does not exist; choose one of {', '.join(template_names())}"
        )
    folder = resources.files("calib_data") / "venues" / name
    return {entry.name: entry.read_text("utf-8") for entry in folder.iterdir() if entry.is_file()}


def create_venue(directory: str | Path, template: str) -> Path:
    """Write a template's files, such as `directory`/venue.toml, as `procam init` does; returns the folder.

    Parameters
    ----------
    directory : folder to make.
    template : such as "simulated-standard", "by-hand" or "through-server".

    Returns
    -------
    venue : the folder.

    Raises
    ------
    InputError
        An unknown template, or one of its files exists.

    Examples
    --------
    >>> create_venue("/nowhere", "no-such-dome")
    Traceback (most recent call last):
    procam.errors.InputError: ...
    """
    path = Path(directory) / "venue.toml"
    if re.search(r"@\d+$", path.parent.name):
        raise InputError(
            f"{directory}: a name that ends in @ and a number stands for a calibration; choose another name"
        )
    files = _template_files(template)
    for name in files:
        if path.with_name(name).exists():
            raise InputError(
                f"{path.with_name(name)} exists already and is left as it is; choose another folder"
            )
    for name in sorted(files):  # venue.toml comes last: it names the others
        write_text(path.with_name(name), files[name])
    return path.parent


def _refusal(path: Path, found: list[str]) -> InputError:
    return InputError("\n".join(f"{path}: {line}" for line in found))


def _backend_names(raw: Mapping[str, Any]) -> set[str]:
    """Backends that may have a table of their own; "by-hand" needs none."""
    devices = [*_tables(raw.get("cameras")), *_tables(raw.get("projectors"))]
    names = {d["backend"] for d in devices if isinstance(d.get("backend"), str)}
    return names - {BY_HAND, *VenueTable.model_fields}


def _tables(group: object) -> list[Mapping[str, Any]]:
    values = group.values() if isinstance(group, dict) else ()
    return [v for v in values if isinstance(v, dict)]


def _camera(name: str, t: CameraTable) -> CameraModel:
    lens = Lens(t.model, np.array(t.f), np.array(t.c), np.array(t.k))
    sensor = Sensor(t.bits, t.black_level, tuple(t.vignetting), t.glare, t.glare_sigma)
    return CameraModel(name, t.size, lens, sensor)
