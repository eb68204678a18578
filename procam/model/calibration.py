"""A calibration: everything procam knows about one venue at one time."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.errors import InputError, ShapeError
from procam.model.correspondence import ProjectorSurface
from procam.model.optics import CameraModel, ProjectorModel
from procam.model.photometry import Photometry
from procam.model.quality import Figure
from procam.model.screen import Dome
from procam.model.transport import DomeMaps, Measured
from procam.model.venue_state import VenueState

SCHEMA_VERSION = 1


@dataclass(frozen=True, slots=True)
class ProjectorCalibration:
    """One projector: its model, where its pixels land, its light, and its blend weight (H, W)."""

    model: ProjectorModel
    surface: ProjectorSurface
    photometry: Photometry
    blend: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Calibration:
    """All of it, with quality and provenance.

    Attributes
    ----------
    screen, cameras, projectors : the rig.
    maps : the dome's own maps.
    feedback, albedo : m and mean albedo per content channel, with sigma.
    content_from_camera : (3, 3) matrix from camera radiance [full scale per second] to relative
        content radiance: 1.0 in every channel is the reference white W.
    quality : figures of the solve. provenance : versions, seeds, input hashes.
    states : the house in other states than when it was calibrated, by name.
    """

    screen: Dome
    cameras: Mapping[str, CameraModel]
    projectors: Mapping[str, ProjectorCalibration]
    maps: DomeMaps
    feedback: Measured
    albedo: Measured
    content_from_camera: NDArray[np.float64]
    quality: Mapping[str, Figure] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    schema_version: int = SCHEMA_VERSION
    states: Mapping[str, VenueState] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, state in self.states.items():
            if state.ambient is not None and state.ambient.shape != self.maps.hi.shape:
                expected = f"{self.maps.hi.shape}, as the maps"
                raise ShapeError(f"ambient of house state {name}", state.ambient.shape, expected)

    def state(self, name: str) -> VenueState:
        """The house in a state that was measured."""
        if name not in self.states:
            there = f"one of {', '.join(self.states)}" if self.states else "none"
            raise InputError(
                f"house state: got {name!r}, expected {there}; `procam state VENUE {name}` "
                "measures it"
            )
        return self.states[name]
