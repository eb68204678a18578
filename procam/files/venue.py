"""venue.toml: what a person knows of the rig. Every mistake is one line with its dotted path."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, StringConstraints, ValidationError

from procam.errors import InputError
from procam.files.masks import Outline, dome_complaints, pixel_complaints
from procam.maths.lenses import Lens
from procam.maths.local_shift import LocalShift
from procam.model.optics import (
    TAG_COUNTS,
    USUAL_FAMILY,
    AprilTag,
    CameraModel,
    Distance,
    Fiducial,
    Sensor,
    TagFamily,
)
from procam.model.screen import Dome

Positive = Annotated[FiniteFloat, Field(gt=0)]
Share = Annotated[FiniteFloat, Field(ge=0, le=1)]
Pair = tuple[FiniteFloat, FiniteFloat]
# names become folders and file names
Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")]
# of photographs that are ingested: their light is linear, sRGB, or told by a table
Response = Annotated[str, StringConstraints(pattern=r"^(linear|srgb|.+\.csv)$")]
USUAL_RADIUS_M = 5.0  # where none was measured: a start
Size = tuple[Annotated[int, Field(ge=8, le=32766)], Annotated[int, Field(ge=8, le=32766)]]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=False)


class ScreenTable(_Table):
    """[screen]."""

    kind: Literal["dome"]
    radius_m: Positive | None = None
    half_angle_deg: Annotated[FiniteFloat, Field(gt=0, le=90)] = 90.0
    tilt_deg: Annotated[FiniteFloat, Field(ge=-90, le=90)] = 0.0
    floor_albedo: Share = 0.1
    floor_albedo_sigma: Share = 0.05
    masks: list[Outline] = []
    protected: list[Outline] = []


class CameraTable(_Table):
    """[cameras.NAME]."""

    backend: str
    size: Size
    model: Literal["kannala-brandt", "brown"]
    f: tuple[Positive, Positive]
    c: Pair
    k: list[FiniteFloat]
    intrinsics: Literal["fixed", "prior", "solve"] = "fixed"
    response: Response = "linear"
    bits: Annotated[int, Field(ge=8, le=16)]
    black_level: Annotated[FiniteFloat, Field(ge=0)]
    vignetting: list[FiniteFloat] = []
    glare: Annotated[FiniteFloat, Field(ge=0, lt=1)] = 0.0
    glare_sigma: Share = 0.0
    masks: list[Outline] = []


class ControlTable(_Table):
    """[projectors.NAME.control]: the serial remote control."""

    protocol: Literal["escvp21"]
    port: str


class NudgeTable(_Table):
    """[[projectors.NAME.nudges]]: the picture moves there by this many pixels, right and down.

    Counted from what cameras measure, in every solve anew: who looks again changes the entry.
    """

    pixel: Pair
    shift_px: Pair


class ProjectorTable(_Table):
    """[projectors.NAME]."""

    backend: str
    size: Size
    kind: Literal["projector"] = "projector"
    lens: Literal["brown", "kannala-brandt"] = "brown"
    control: ControlTable | None = None
    masks: list[Outline] = []
    nudges: list[NudgeTable] = []


class _PlaceTable(_Table):
    """A place on the dome. One angle is enough: the springline has an elevation, the front an azimuth."""

    azimuth_deg: FiniteFloat | None = None
    elevation_deg: Annotated[FiniteFloat, Field(ge=-90, le=90)] | None = None
    sigma_deg: Positive

    @property
    def place(self) -> tuple[float | None, float | None, float]:
        """Azimuth, elevation and sigma [rad]."""
        azimuth, elevation = (
            None if angle is None else float(np.radians(angle))
            for angle in (self.azimuth_deg, self.elevation_deg)
        )
        return azimuth, elevation, float(np.radians(self.sigma_deg))


class FiducialTable(_PlaceTable):
    """[[fiducials]]: a mark that a camera sees, or a projector shines, at a pixel."""

    name: str
    camera: str | None = None
    projector: str | None = None
    pixel: Pair


class TagTable(_PlaceTable):
    """[[apriltags]]: a printed tag whose middle is there; cameras find it."""

    family: TagFamily = USUAL_FAMILY
    id: Annotated[int, Field(ge=0)]

    @property
    def tag(self) -> AprilTag:
        """The tag as the solver wants it."""
        return AprilTag(self.family, self.id, *self.place)


class DistanceTable(_Table):
    """[[distances]]: metres between two cameras, projectors or fiducials."""

    a: str
    b: str
    metres: Positive
    sigma_m: Positive = 0.005


class CaptureTable(_Table):
    """[capture]: shutter times [s]; black is dim, so it wants a long one."""

    exposure_s: Positive
    black_exposure_s: Positive


class VenueTable(_Table):
    """The whole file; tables that belong to backends are cut out before it is validated."""

    screen: ScreenTable
    cameras: Annotated[dict[Name, CameraTable], Field(min_length=1)]
    projectors: Annotated[dict[Name, ProjectorTable], Field(min_length=1)]
    fiducials: list[FiducialTable] = []
    apriltags: list[TagTable] = []
    distances: list[DistanceTable] = []
    capture: CaptureTable


@dataclass(frozen=True, slots=True)
class Venue:
    """A venue folder and its validated file; `backends` holds each backend's own raw table."""

    directory: Path
    table: VenueTable
    backends: Mapping[str, Mapping[str, Any]]

    @property
    def screen(self) -> Dome:
        """The screen as the solver wants it; of unknown radius, of a usual one."""
        t = self.table.screen
        return Dome(
            t.radius_m or USUAL_RADIUS_M,
            float(np.radians(t.half_angle_deg)),
            float(np.radians(t.tilt_deg)),
            t.floor_albedo,
            t.floor_albedo_sigma,
        )

    @property
    def cameras(self) -> dict[str, CameraModel]:
        """The cameras, not yet placed."""
        return {name: _camera(name, t) for name, t in self.table.cameras.items()}

    @property
    def fiducials(self) -> list[Fiducial]:
        """The marks on the dome."""
        return [
            Fiducial(t.name, *t.place, t.camera or t.projector or "", np.array(t.pixel))
            for t in self.table.fiducials
        ]

    @property
    def tags(self) -> list[AprilTag]:
        """Tags on the dome that cameras find."""
        return [t.tag for t in self.table.apriltags]

    @property
    def distances(self) -> list[Distance]:
        """Distances that somebody measured."""
        return [Distance(t.a, t.b, t.metres, t.sigma_m) for t in self.table.distances]


def load_venue(directory: Path) -> Venue:
    """Read and validate DIRECTORY/venue.toml; all mistakes at once, a line each."""
    path = directory / "venue.toml"
    if not path.is_file():
        raise InputError(
            f"{path}: got no such file, expected a venue folder; make one with "
            f"`procam init {directory} --template NAME`"
        )
    try:
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: got invalid TOML ({error}), expected name = value") from error
    names = _backend_names(raw)
    backends = {name: raw.pop(name, {}) for name in names}
    try:
        table = VenueTable.model_validate(raw)
    except ValidationError as error:
        raise InputError("\n".join(_complaint(path, e) for e in error.errors())) from error
    _check_references(path, table)
    return Venue(directory, table, backends)


def template_names() -> list[str]:
    """Names of the venue templates that come with procam."""
    folder = resources.files("calib_data") / "venues"
    return sorted(entry.name for entry in folder.iterdir() if (entry / "venue.toml").is_file())


def template_text(name: str) -> str:
    """The commented venue.toml of a template."""
    if name not in template_names():
        raise InputError(f"template: got {name!r}, expected one of {', '.join(template_names())}")
    return (resources.files("calib_data") / "venues" / name / "venue.toml").read_text("utf-8")


def _backend_names(raw: Mapping[str, Any]) -> set[str]:
    devices = [*_tables(raw.get("cameras")), *_tables(raw.get("projectors"))]
    names = {d["backend"] for d in devices if isinstance(d.get("backend"), str)}
    return names - set(VenueTable.model_fields)


def _tables(group: object) -> list[Mapping[str, Any]]:
    values = group.values() if isinstance(group, dict) else ()
    return [v for v in values if isinstance(v, dict)]


def _camera(name: str, t: CameraTable) -> CameraModel:
    lens = Lens(t.model, np.array(t.f), np.array(t.c), np.array(t.k))
    sensor = Sensor(t.bits, t.black_level, tuple(t.vignetting), t.glare, t.glare_sigma)
    return CameraModel(name, t.size, lens, sensor)


def _check_references(path: Path, table: VenueTable) -> None:
    complaints = []
    for name, camera in table.cameras.items():
        expected = 4 if camera.model == "kannala-brandt" else 5
        if len(camera.k) != expected:
            complaints.append(
                f"{path}: cameras.{name}.k: got {len(camera.k)} numbers, expected {expected} "
                f"for model {camera.model!r}"
            )
    complaints += [f"{path}: {line}" for line in _mark_complaints(table)]
    complaints += [f"{path}: {line}" for line in _mask_complaints(table)]
    if complaints:
        raise InputError("\n".join(complaints))


def _mark_complaints(table: VenueTable) -> list[str]:
    found = []
    for fiducial in table.fiducials:
        where = f"fiducials.{fiducial.name}"
        if (fiducial.camera is None) == (fiducial.projector is None):
            found.append(
                f"{where}: got both or neither of camera and projector, expected one of them"
            )
        for key, name, known in (
            ("camera", fiducial.camera, list(table.cameras)),
            ("projector", fiducial.projector, list(table.projectors)),
        ):
            if name is not None and name not in known:
                found.append(f"{where}.{key}: got {name!r}, expected one of {', '.join(known)}")
        found += _angle_complaints(where, fiducial)
    found += _tag_complaints(table.apriltags)
    marks = [*(f.name for f in table.fiducials), *(t.tag.name for t in table.apriltags)]
    names = [*table.cameras, *table.projectors, *marks]
    for i, distance in enumerate(table.distances):
        for key, name in (("a", distance.a), ("b", distance.b)):
            if name not in names:
                found.append(
                    f"distances.{i}.{key}: got {name!r}, expected one of {', '.join(names)}"
                )
    return found


def _angle_complaints(where: str, entry: _PlaceTable) -> list[str]:
    if entry.azimuth_deg is None and entry.elevation_deg is None:
        return [f"{where}: got no angle, expected azimuth_deg, elevation_deg or both"]
    return []


def _tag_complaints(tables: Sequence[TagTable]) -> list[str]:
    found, before = list[str](), set[str]()
    for i, entry in enumerate(tables):
        where = f"apriltags.{i}"
        found += _angle_complaints(where, entry)
        if entry.id >= (count := TAG_COUNTS[entry.family]):
            found.append(
                f"{where}.id: got {entry.id}, expected 0..{count - 1} of family {entry.family!r}; "
                "correct id or family"
            )
        if entry.tag.name in before:
            found.append(f"{where}: got {entry.tag.name} twice, expected each once; remove one")
        before.add(entry.tag.name)
    return found


def _mask_complaints(table: VenueTable) -> list[str]:
    found = dome_complaints("screen.masks", table.screen.masks)
    found += dome_complaints("screen.protected", table.screen.protected)
    for name, camera in table.cameras.items():
        found += pixel_complaints(f"cameras.{name}.masks", camera.masks, camera.size)
    for name, projector in table.projectors.items():
        where = f"projectors.{name}"
        found += pixel_complaints(f"{where}.masks", projector.masks, projector.size)
        found += _nudge_complaints(where, projector)
    return found


def _nudge_complaints(where: str, projector: ProjectorTable) -> list[str]:
    nudges, (width, height) = projector.nudges, projector.size
    found = [
        f"{where}.nudges.{i}.pixel: got {list(nudge.pixel)}, expected a place on the panel of "
        f"{width}x{height} px; correct it"
        for i, nudge in enumerate(nudges)
        if not (-0.5 <= nudge.pixel[0] <= width - 0.5 and -0.5 <= nudge.pixel[1] <= height - 0.5)
    ]
    pixels, by = np.array([(n.pixel, n.shift_px) for n in nudges]).reshape(-1, 2, 2).swapaxes(0, 1)
    shift = LocalShift.on_panel(projector.size, pixels, by)
    torn = shift.torn_at()
    if torn is not None:
        found.append(
            f"{where}.nudges.{torn}: got shift_px {by[torn].tolist()} at pixel "
            f"{pixels[torn].tolist()}, where the picture would lie over itself; expected less than "
            f"{2 / 3 * shift.reach_px:.0f} px, and neighbours whose shifts differ by less than they "
            "are apart; correct or remove it"
        )
    return found


def _complaint(path: Path, error: Any) -> str:
    where = ".".join(str(part) for part in error["loc"])
    got = error["input"]
    shown = "a table" if isinstance(got, dict) else repr(got)
    shown = "nothing" if error["type"] == "missing" else shown
    advice = {
        "extra_forbidden": "remove it or check its spelling",
        "missing": "add it; `procam init` writes a complete example",
    }.get(error["type"], "correct it")
    return f"{path}: {where}: got {shown}; {error['msg']}; {advice}"
