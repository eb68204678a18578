"""Puts a projector that was measured anew into a calibration, of which all else stays.

The content's unit, the scattered light, the cameras and all other projectors stay to the last bit. New
are the projector itself, the blend weights where it overlaps others, before or now, and the maps of what full
white and black put on the screen there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from procam.arrays import BoolArray, Image
from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.light.blend import Blender
from procam.estimate.light.calibrated_projector import Placed, unblended_projector
from procam.estimate.light.full_white import FullWhite, black_light
from procam.estimate.light.measurement import ProjectorMeasurement
from procam.model.calibration import Calibration, ProjectorCalibration
from procam.model.mask import Nudge
from procam.model.provenance import Provenance
from procam.model.transport import ScreenMaps


def with_projector(
    calibration: Calibration,
    name: str,
    geometry: GeometrySolution,
    view: ScreenView,
    before_and_now: tuple[ProjectorMeasurement, ProjectorMeasurement],
    nudges: Sequence[Nudge],
    provenance: Provenance,
) -> Calibration:
    """A calibration with projector `name` as it was measured anew.

    Parameters
    ----------
    geometry : the known rig, in which that projector was solved (`geometry.known_rig`).
    view : of the main camera. before_and_now : the projector's light in its channels, in the session of the
        calibration and in the new one.
    provenance : of the new calibration.
    """
    _, measured = before_and_now
    screen, matrix, size = (
        calibration.screen,
        calibration.content_from_camera,
        calibration.maps.size,
    )
    placed = Placed.of(geometry, screen, view, nudges, [measured])
    new = unblended_projector(placed, name, measured, matrix)
    blacks = [black_light(each, view, screen, matrix, size) for each in before_and_now]
    projectors = {**calibration.projectors, name: _with_shared_error(calibration, name, new)}
    return replace(
        calibration,
        projectors=Blender(projectors, screen).blended(),
        maps=_maps(calibration, projectors, name, blacks[1] - blacks[0]),
        provenance=provenance,
    )


def _with_shared_error(
    calibration: Calibration, name: str, new: ProjectorCalibration
) -> ProjectorCalibration:
    """The projector with the errors of the screen and the camera, which are those of before."""
    shared = calibration.projectors[name].surface.sigma_arcmin
    surface = replace(new.surface, sigma_arcmin=np.hypot(new.surface.sigma_arcmin, shared))
    return replace(new, surface=surface)


def _maps(
    calibration: Calibration,
    projectors: Mapping[str, ProjectorCalibration],
    name: str,
    added: Image,
) -> ScreenMaps:
    """Maps of full white and black, and the coverage, new where a projector lights, or lit before."""
    maps, screen = calibration.maps, calibration.screen
    new = FullWhite(projectors, screen, maps.size)
    direction = screen.canvas.directions(maps.size)[0].astype(np.float32)
    before = Blender(calibration.projectors, screen).weights(direction)[name]
    affected = (new.weights[name] > 0) | (before > 0)
    coverage = np.where(affected, new.coverage, maps.coverage)
    lo = np.maximum(maps.lo + added, 0) * (coverage > 0)[..., None]
    hi = new.light * coverage[..., None] + lo
    return replace(
        maps,
        lo=_where(affected, lo, maps.lo),
        hi=_where(affected, hi, maps.hi),
        coverage=coverage,
    )


def _where(affected: BoolArray, new: Image, old: Image) -> Image:
    return np.where(affected[..., None], new, old).astype(np.float32)
