"""Puts a projector that was measured anew into a calibration, of which all else stays.

The content's unit, the dome's scattered light, the cameras and all other projectors stay to the last bit. New
are the projector itself, the blend weights where it overlaps others, before or now, and the maps of what full
white and black put on the dome there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from procam.arrays import Array, BoolArray, Image
from procam.estimate.calibration import converted
from procam.estimate.geometry.camera_view import DomeView
from procam.estimate.geometry.screen_points import round_shape, screen_points
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.light.blend import Blender
from procam.estimate.light.footprint import project_surface
from procam.estimate.light.measurement import ProjectorMeasurement, direct_black
from procam.estimate.light.scatter_kernel import BLACK_BLUR_PX
from procam.estimate.light.separation import SeparatedLight
from procam.maths.geometry.lenses import project_before_fold
from procam.maths.geometry.sphere import master_directions
from procam.maths.warp import blur, blur_within, sample
from procam.model.calibration import Calibration, ProjectorCalibration
from procam.model.mask import Nudge
from procam.model.photometry import Photometry
from procam.model.transport import DomeMaps

ARCMIN = 60 * 180 / np.pi
BORDER_PX = 2.0  # Gaussian that continues a gain beyond its border


def with_projector(
    calibration: Calibration,
    name: str,
    geometry: GeometrySolution,
    view: DomeView,
    before_and_now: tuple[ProjectorMeasurement, ProjectorMeasurement],
    nudges: Sequence[Nudge],
    provenance: Mapping[str, Any],
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
    content = converted(measured.light, calibration.content_from_camera)
    moved = float(measured.moved_px / np.mean(view.camera.lens.focal) * ARCMIN)
    surface = project_surface(geometry, name, calibration.screen, view, content, nudges, moved)
    # errors of the screen and the camera are those of before
    shared = calibration.projectors[name].surface.sigma_arcmin
    surface = replace(surface, sigma_arcmin=np.hypot(surface.sigma_arcmin, shared))
    photometry = _photometry(calibration, view, surface.direction, measured, content)
    gain = photometry.gain * surface.valid[..., None]
    unblended = np.full_like(surface.measured, np.nan)  # `_joined` blends it
    new = ProjectorCalibration(
        geometry.projectors[name], surface, replace(photometry, gain=gain), unblended
    )
    blacks = [_black(calibration, view, direct_black(each)) for each in before_and_now]
    return _joined(calibration, name, new, blacks, provenance)


def _photometry(
    calibration: Calibration,
    view: DomeView,
    direction: Image,
    measured: ProjectorMeasurement,
    content: SeparatedLight,
) -> Photometry:
    """Gain at each pixel's direction, and the colour mix in content channels."""
    at = view.camera_pixels(calibration.screen, np.nan_to_num(direction))
    gain = sample(content.extended(), at)
    mix = calibration.content_from_camera @ (measured.colour.mix * _white(measured)[:, None])
    mix = np.asarray(mix / mix.sum(axis=1, keepdims=True), float)
    return Photometry(measured.response, mix, np.maximum(gain, 0), measured.exponent)


def _white(measured: ProjectorMeasurement) -> Array:
    """Mean radiance (3,) of its white in camera channels, of which the colour mix has the shares."""
    light = measured.light
    return np.asarray(light.direct[light.lit].mean(axis=0, dtype=float))


def _black(calibration: Calibration, view: DomeView, direct: Image) -> Image:
    """Black light (N, N, 3) of one projector on the dome master [rel]."""
    smooth = blur(direct, BLACK_BLUR_PX) @ calibration.content_from_camera.T.astype(np.float32)
    at = view.camera_pixels(calibration.screen, _directions(calibration))
    return np.maximum(sample(smooth, at), 0)


def _directions(calibration: Calibration) -> Image:
    return master_directions(calibration.maps.size)[0].astype(np.float32)


def _joined(
    calibration: Calibration,
    name: str,
    new: ProjectorCalibration,
    blacks: Sequence[Image],
    provenance: Mapping[str, Any],
) -> Calibration:
    """The calibration with a new projector, seams blended anew."""
    projectors = {**calibration.projectors, name: new}
    direction = _directions(calibration)
    old, blender = (_blender(calibration, each) for each in (calibration.projectors, projectors))
    weights = blender.weights(direction)
    affected = (weights[name] > 0) | (old.weights(direction)[name] > 0)
    places = _panel_places(calibration, projectors, direction)
    maps = _maps(calibration.maps, projectors, weights, affected, blacks, places)
    blended = {n: _blended(p, n, blender) for n, p in projectors.items()}
    return replace(calibration, projectors=blended, maps=maps, provenance=provenance)


def _blender(calibration: Calibration, projectors: Mapping[str, ProjectorCalibration]) -> Blender:
    models = {name: each.model for name, each in projectors.items()}
    surfaces = {name: each.surface for name, each in projectors.items()}
    return Blender(models, surfaces, calibration.screen)


def _blended(projector: ProjectorCalibration, name: str, blender: Blender) -> ProjectorCalibration:
    """The projector with the weights of a blend."""
    surface = projector.surface
    weight = blender.weights(np.nan_to_num(surface.direction))[name]
    return replace(projector, blend=(weight * surface.valid).astype(np.float32))


def _panel_places(
    calibration: Calibration, projectors: Mapping[str, ProjectorCalibration], direction: Image
) -> dict[str, Array]:
    """Panel pixel (N, N, 2) of each projector that lights a direction of the master."""
    points = screen_points(round_shape(calibration.screen), direction)
    return {
        name: project_before_fold(each.model.projector_from_dome.apply(points), each.model.lens)
        for name, each in projectors.items()
    }


def _continued(projector: ProjectorCalibration) -> Image:
    """Gain (H, W, 3), continued beyond the border of the footprint, where samples would mix it with none."""
    gain, valid = projector.photometry.gain, projector.surface.valid
    return np.where(valid[..., None], gain, blur_within(gain, valid, BORDER_PX))


def _maps(
    maps: DomeMaps,
    projectors: Mapping[str, ProjectorCalibration],
    weights: Mapping[str, Image],
    affected: BoolArray,
    blacks: Sequence[Image],
    places: Mapping[str, Array],
) -> DomeMaps:
    """Maps of full white and black, and the coverage, new where they are affected."""
    shares = [sample(p.surface.measured, places[n]) for n, p in projectors.items()]
    reached = np.sum(list(weights.values()), axis=0) > 0
    ramp = np.clip(2 * np.max(shares, axis=0) - 0.5, 0, 1) * reached
    coverage = np.where(affected, ramp, maps.coverage).astype(np.float32)
    black = np.where(affected[..., None], maps.lo - blacks[0] + blacks[1], maps.lo)
    lo = (np.maximum(black, 0) * (coverage > 0)[..., None]).astype(np.float32)
    lo = np.where(affected[..., None], lo, maps.lo)
    white = np.sum(
        [weights[n][..., None] * sample(_continued(p), places[n]) for n, p in projectors.items()],
        axis=0,
    )
    hi = np.where(affected[..., None], white * coverage[..., None] + lo, maps.hi)
    return replace(maps, lo=lo, hi=hi.astype(np.float32), coverage=coverage)
