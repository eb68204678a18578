"""A calibration: the result of one capture session of a venue, with quality and provenance."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from procam.arrays import Array, Array32
from procam.errors import CalibrationError, InputError, ShapeError
from procam.maths.geometry.canvas import STANDARD, Canvas
from procam.model.correspondence import ProjectorSurface
from procam.model.optics import CameraModel, ProjectorModel
from procam.model.photometry import AbsoluteColour, Photometry
from procam.model.provenance import Provenance
from procam.model.quality import Figure
from procam.model.screen import ContentCanvas, Dome, Screen
from procam.model.transport import Measured, ScreenMaps
from procam.model.venue_state import VenueState

SCHEMA_VERSION = 2


@dataclass(frozen=True, slots=True)
class ProjectorCalibration:
    """One projector: model, pixel directions, light, and blend weight (H, W)."""

    model: ProjectorModel
    surface: ProjectorSurface
    photometry: Photometry
    blend: Array32


@dataclass(frozen=True, slots=True)
class Calibration:
    """Rig, maps of the screen, light of each projector, and how good they are.

    Attributes
    ----------
    screen, cameras, projectors : the rig.
    maps : light on the screen, on its own canvas.
    feedback, albedo : m (docs/theory/interreflection.md, I10) and mean albedo per content channel.
    content_from_camera : (3, 3) matrix from camera radiance [full scale per second] to relative
        content radiance; 1.0 in every channel is the reference white.
    quality : figures of the solve. provenance : what it was solved from.
    states : venue states measured since, by name.
    canvas : that content is drawn on; of a dome, a master that a media server is fed with.
    main_camera : name of the camera that light was measured with; "" if it is not recorded.
    absolute : what content light is in cd/m2, by a hand meter; None if none was used.
    """

    screen: Screen
    cameras: Mapping[str, CameraModel]
    projectors: Mapping[str, ProjectorCalibration]
    maps: ScreenMaps
    feedback: Measured
    albedo: Measured
    content_from_camera: Array
    quality: Mapping[str, Figure] = field(default_factory=dict)
    provenance: Provenance = field(default_factory=Provenance)
    schema_version: int = SCHEMA_VERSION
    states: Mapping[str, VenueState] = field(default_factory=dict)
    main_camera: str = ""
    canvas: ContentCanvas = STANDARD
    absolute: AbsoluteColour | None = None

    def __post_init__(self) -> None:
        if self.main_camera and self.main_camera not in self.cameras:
            raise InputError(
                f"main_camera is {self.main_camera!r}; it needs the name of one of the cameras "
                f"({', '.join(self.cameras) or 'there are none'})"
            )
        for name, state in self.states.items():
            if state.ambient is not None and state.ambient.shape != self.maps.hi.shape:
                needed = f"{self.maps.hi.shape}, as the maps"
                raise ShapeError(f"ambient of venue state {name}", state.ambient.shape, needed)

    @property
    def dome(self) -> Dome:
        """The screen, for what is of domes only.

        Raises
        ------
        InputError
            It is a room.
        """
        if isinstance(self.screen, Dome):
            return self.screen
        raise InputError(f"this is for domes only, and the calibration is of a {self.screen.kind}")

    @property
    def dome_canvas(self) -> Canvas:
        """The dome master that content is drawn on; raises InputError of a room, as `dome`."""
        assert self.dome and isinstance(self.canvas, Canvas)
        return self.canvas

    @property
    def camera(self) -> CameraModel:
        """The camera that light was measured with.

        Raises
        ------
        CalibrationError
            It is not recorded, as by earlier versions in calibrations of several cameras.
        """
        if not self.main_camera:
            raise CalibrationError(
                f"the calibration does not record which of its cameras ({', '.join(self.cameras)}) its light "
                "was measured with; solve its session again (`procam session solve VENUE/sessions/ID`)"
            )
        return self.cameras[self.main_camera]

    def on(self, canvas: ContentCanvas) -> "Calibration":
        """The calibration for content that is drawn on another canvas."""
        return replace(self, canvas=canvas)

    def state(self, name: str) -> VenueState:
        """The measured venue state of that name.

        Raises
        ------
        InputError
            For a name that was not measured.
        """
        if name not in self.states:
            measured = ", ".join(self.states) or "none"
            raise InputError(
                f"venue state {name!r} was not measured (measured states: {measured}); run "
                f"`procam state VENUE {name}`"
            )
        return self.states[name]
