"""The tables of venue.toml: keys, types and bounds.

The module is longer than 300 lines because each table is a list of keys.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, FiniteFloat, StringConstraints

from procam.files.names import NAME_PATTERN
from procam.files.venue.commands import command_words
from procam.files.venue.outlines import Outline
from procam.model.optics import USUAL_FAMILY, TagFamily, tag_name

Positive = Annotated[FiniteFloat, Field(gt=0)]
Exposure = Annotated[FiniteFloat, Field(ge=1e-6, le=1e5)]  # s, of any camera
Share = Annotated[FiniteFloat, Field(ge=0, le=1)]
PositiveShare = Annotated[FiniteFloat, Field(gt=0, le=1)]
Pair = tuple[FiniteFloat, FiniteFloat]
Point = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
Length = Annotated[FiniteFloat, Field(ge=0.1, le=500)]  # m, of a room
BoxPart = Literal["left", "front", "right", "back", "floor", "ceiling"]
Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]
# of photographs that are ingested: linear, sRGB, measured by a table or from brackets
RESPONSE_PATTERN = r"^(linear|srgb|solve|.+\.csv)$"
Response = Annotated[str, StringConstraints(pattern=RESPONSE_PATTERN)]
CLOCK_PATTERN = r"^([01]\d|2[0-3]):[0-5]\d$"
BY_HAND = "by-hand"  # the backend of devices that procam does not drive
Size = tuple[Annotated[int, Field(ge=8, le=32766)], Annotated[int, Field(ge=8, le=32766)]]


def _check_command(text: str) -> str:
    command_words(text)
    return text


Command = Annotated[str, AfterValidator(_check_command)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=False)


class _AnyScreen(_Table):
    """What every [screen] has; `map_size` is the width of the calibration's maps [px]."""

    masks: list[Outline] = []
    protected: list[Outline] = []
    map_size: Annotated[int, Field(ge=64, le=4096, multiple_of=64)] = 1024


class DomeTable(_AnyScreen):
    """[screen] of kind "dome"."""

    kind: Literal["dome"]
    radius_m: Annotated[FiniteFloat, Field(ge=0.1, le=1000)] | None = None
    half_angle_deg: Annotated[FiniteFloat, Field(gt=0, le=90)] = 90.0
    tilt_deg: Annotated[FiniteFloat, Field(ge=-90, le=90)] = 0.0
    floor_albedo: Share = 0.1
    floor_albedo_sigma: Share = 0.05


class RoomTable(_AnyScreen):
    """[screen] of any room.

    `other_albedo` is that of the parts that are not lit; `others` has single parts: albedo, sigma.
    """

    other_albedo: Share = 0.2
    other_albedo_sigma: Share = 0.1
    others: dict[Name, tuple[Share, Share]] = {}


class BoxTable(RoomTable):
    """[screen] of kind "box"; `lit` are the parts that projectors light."""

    kind: Literal["box"]
    width_m: Length
    depth_m: Length
    height_m: Length
    lit: Annotated[list[BoxPart], Field(min_length=1)] = ["left", "front", "right"]


class CylinderTable(RoomTable):
    """[screen] of kind "cylinder": an upright wall over an arc about the front."""

    kind: Literal["cylinder"]
    radius_m: Length
    arc_deg: Annotated[FiniteFloat, Field(ge=10, le=360)]
    height_m: Length


class MeshTable(RoomTable):
    """[screen] of kind "mesh": an OBJ file [m], its groups the parts, its texture coordinates the canvas.

    `canvas` is the size of the pictures that they were made for [px], `origin_m` a point of the mesh that
    sees all that is lit; `smooth`: faces sample curved walls.
    """

    kind: Literal["mesh"]
    file: Annotated[str, StringConstraints(min_length=1)]
    lit: Annotated[list[Name], Field(min_length=1)]
    canvas: Size
    origin_m: Point = (0.0, 0.0, 0.0)
    smooth: bool = False


ScreenTable = Annotated[
    DomeTable | BoxTable | CylinderTable | MeshTable, Field(discriminator="kind")
]


class CameraTable(_Table):
    """[cameras.NAME]."""

    backend: str = BY_HAND
    size: Size
    model: Literal["kannala-brandt", "brown"]
    f: tuple[Positive, Positive]
    c: Pair
    k: list[FiniteFloat]
    intrinsics: Literal["fixed", "prior", "solve"] = "prior"
    response: Response = "linear"
    brackets: str | None = None
    bits: Annotated[int, Field(ge=8, le=16)]
    black_level: Annotated[FiniteFloat, Field(ge=0)]
    vignetting: list[FiniteFloat] = []
    glare: Annotated[FiniteFloat, Field(ge=0, lt=1)] = 0.0
    glare_sigma: Share = 0.01  # of an unmeasured lens
    masks: list[Outline] = []


class ControlTable(_Table):
    """[projectors.NAME.control]: the serial remote control."""

    protocol: Literal["escvp21"]
    port: str


class NudgeTable(_Table):
    """[[projectors.NAME.nudges]]: shifts the picture at a pixel, to the right and down.

    The shift is relative to the measured geometry, in every solve anew.
    """

    pixel: Pair
    shift_px: Pair


class ProjectorTable(_Table):
    """[projectors.NAME]; kind "dome-master" is a media server with an aligned dome."""

    backend: str = BY_HAND
    size: Size
    kind: Literal["projector", "dome-master"] = "projector"
    lens: Literal["brown", "kannala-brandt"] = "brown"
    fov_deg: Annotated[FiniteFloat, Field(ge=20, le=250)] = 180.0
    rotation_deg: Annotated[FiniteFloat, Field(ge=-360, le=360)] = 0.0
    control: ControlTable | None = None
    masks: list[Outline] = []
    nudges: list[NudgeTable] = []


class PlaceTable(_Table):
    """A position on the screen with its standard error.

    On a dome by angles, of which one is enough: the springline has an elevation, the front an azimuth. In a
    room by metres on the canvas, to the right and down from its upper left corner; on a mesh also by its
    coordinates.
    """

    azimuth_deg: FiniteFloat | None = None
    elevation_deg: Annotated[FiniteFloat, Field(ge=-90, le=90)] | None = None
    sigma_deg: Positive | None = None
    canvas_m: Pair | None = None
    point_m: Point | None = None
    sigma_m: Positive | None = None


class FiducialTable(PlaceTable):
    """[[fiducials]]: a mark that a camera sees, or a projector shows, at a pixel.

    `sigma_px`: standard error of the pixel as somebody clicked it [px].
    """

    name: str
    camera: str | None = None
    projector: str | None = None
    pixel: Pair
    sigma_px: Positive = 0.3


class TagTable(PlaceTable):
    """[[apriltags]]: the centre of a printed tag, which is detected in photographs."""

    family: TagFamily = USUAL_FAMILY
    id: Annotated[int, Field(ge=0)]

    @property
    def name(self) -> str:
        """Its name in messages."""
        return tag_name(self.family, self.id)


class DistanceTable(_Table):
    """[[distances]]: metres between two cameras, projectors or fiducials."""

    a: str
    b: str
    metres: Annotated[FiniteFloat, Field(ge=0.001, le=1000)]
    sigma_m: Positive = 0.005


class CaptureTable(_Table):
    """[capture]: shutter times [s]; black is dim and needs a long one.

    `shot_s`: time from one photograph to the next, from which the duration of a capture is estimated.
    """

    exposure_s: Exposure
    black_exposure_s: Exposure
    shot_s: Positive | None = None


class BlendTable(_Table):
    """[blend]: luminance matching.

    `falloff_percent_per_deg`: largest change of white per degree seen from the dome's centre; 0 gives a
    uniform white, as bright as the dimmest place.
    """

    falloff_percent_per_deg: Annotated[FiniteFloat, Field(ge=0, le=10)] = 0.0

    @property
    def falloff_per_rad(self) -> float:
        """Largest relative change of white per radian."""
        return float(self.falloff_percent_per_deg / 100 / np.radians(1))


class HistoryTable(_Table):
    """[history]: `keep_sessions` is how many of the newest sessions keep their captures when pruned."""

    keep_sessions: Annotated[int, Field(ge=1, le=9999)] | None = None


class AcceptanceTable(_Table):
    """[acceptance]: the client's limits, by the figures of `model.acceptance.CRITERIA`."""

    model_config = ConfigDict(strict=True)  # true is no limit

    direction_sigma_relative_arcmin: Positive | None = None
    direction_sigma_arcmin: Positive | None = None
    server_misalignment_rms_arcmin: Positive | None = None
    geometry_residual_rms_px: Positive | None = None
    sphere_variance_ratio: Annotated[FiniteFloat, Field(ge=1)] | None = None  # 1 is a sphere
    coverage: PositiveShare | None = None
    additivity_error: PositiveShare | None = None
    feedback: Positive | None = None
    albedo: PositiveShare | None = None
    loop_residual_own: PositiveShare | None = None
    loop_own_jnd: Positive | None = None
    loop_unseen_residual: PositiveShare | None = None
    other_seat_direction_relative_rms_arcmin: Positive | None = None
    other_seat_direction_relative_over_sigma: Positive | None = None
    other_seat_direction_rms_arcmin: Positive | None = None
    other_seat_solid_angle_sum: PositiveShare | None = None
    other_seat_feedback: PositiveShare | None = None
    other_seat_albedo: PositiveShare | None = None

    @property
    def limits(self) -> dict[str, float]:
        """The limits that are given, by the figure's name."""
        return self.model_dump(exclude_none=True)


class UnattendedTable(_Table):
    """[unattended]: when and how projectors may be lit with nobody there to see it.

    `interlock` is a command that ends with 0 where nobody is in the dome; `begin` and `end` are local times,
    the next day where `end` is earlier. `power_on`: lamps that are off may be switched on. `notify` is a
    command that gets what happened as its last argument. No shell runs them.
    """

    interlock: Command
    begin: Annotated[str, StringConstraints(pattern=CLOCK_PATTERN)]
    end: Annotated[str, StringConstraints(pattern=CLOCK_PATTERN)]
    power_on: bool = False
    notify: Command | None = None


class VenueTable(_Table):
    """The whole file without the tables of backends, which are removed before it is validated."""

    screen: ScreenTable
    cameras: Annotated[dict[Name, CameraTable], Field(min_length=1)]
    projectors: Annotated[dict[Name, ProjectorTable], Field(min_length=1)]
    fiducials: list[FiducialTable] = []
    apriltags: list[TagTable] = []
    distances: list[DistanceTable] = []
    capture: CaptureTable
    blend: BlendTable = BlendTable()
    history: HistoryTable = HistoryTable()
    unattended: UnattendedTable | None = None
    acceptance: AcceptanceTable = AcceptanceTable()
