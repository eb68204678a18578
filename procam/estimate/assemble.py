"""Puts the measured pieces together: content channels, common white, blend, dome maps."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.estimate.blend import Blender, common_white
from procam.estimate.geometry import GeometrySolution, sphere_test
from procam.estimate.photometry import ColourFit
from procam.estimate.surface import camera_pixels, lit_share, project_surface
from procam.estimate.transport import Light, albedo, feedback, scatter_per_flux
from procam.estimate.view import DomeView
from procam.maths.sphere import (
    cap_solid_angle,
    master_directions,
    master_pixels,
    master_solid_angles,
)
from procam.maths.warp import blur, sample
from procam.model.calibration import Calibration, ProjectorCalibration
from procam.model.correspondence import ProjectorSurface
from procam.model.photometry import Photometry, ResponseCurve
from procam.model.quality import Figure, Goal
from procam.model.screen import Dome
from procam.model.transport import DomeMaps

Array = NDArray[np.float64]
Image = NDArray[np.float32]
MAP_SIZE = 1024
BLACK_BLUR_PX = 4.0


def assemble(  # noqa: PLR0913, PLR0917
    dome: Dome,
    geometry: GeometrySolution,
    view: DomeView,
    lights: Mapping[str, Light],
    blacks: Mapping[str, Image],
    colours: Mapping[str, ColourFit],
    responses: Mapping[str, ResponseCurve],
    provenance: Mapping[str, Any],
) -> Calibration:
    """The calibration of everything measured through one camera.

    `blacks` are (H, W, 3) radiances of each projector's black, scattered light included.
    """
    names = list(lights)
    unmix = _content_matrix(lights, colours)
    content = {n: _converted(lights[n], unmix) for n in names}
    surfaces = {n: project_surface(geometry, n, dome, lights[n]) for n in names}
    blender = Blender(geometry.projectors, surfaces, dome)
    direction, inside = master_directions(MAP_SIZE)
    direction32 = direction.astype(np.float32)
    where = camera_pixels(geometry.camera, dome, direction)
    coverage = _coverage(geometry, dome, direction, lights) * inside
    weights = blender.weights(direction32)
    hi = np.sum([weights[n][..., None] * sample(content[n].extended, where) for n in names], axis=0)
    white = common_white(hi, coverage > 0.999)
    to_relative = np.diag(1 / white) @ unmix
    u_camera = scatter_per_flux(list(content.values()))
    lit_sr = sample(coverage, _master_at(view)) * view.solid_angle_sr
    measured = feedback(
        list(content.values()), lit_sr, view.solid_angle_sr, geometry.camera.sensor.glare_sigma
    )
    screen_sr = cap_solid_angle(dome.half_angle)
    solid = master_solid_angles(MAP_SIZE) * coverage
    reflectance = albedo(measured, float(solid.sum()), screen_sr, dome)
    u = sample(u_camera, where) * inside[..., None]
    lo = _black_level(blacks, to_relative, measured.value, lights, where) * coverage[..., None]
    mean_u = np.tensordot(solid, u, 2) / solid.sum()
    maps = DomeMaps(
        u,
        (u / mean_u * reflectance.value).astype(np.float32),
        lo.astype(np.float32),
        (hi / white * coverage[..., None]).astype(np.float32) + lo.astype(np.float32),
        coverage.astype(np.float32),
    )
    calibrated = {
        n: _projector(
            n, geometry, dome, surfaces[n], blender, content[n], white, responses, colours
        )
        for n in names
    }
    return Calibration(
        dome,
        {geometry.camera.name: geometry.camera},
        calibrated,
        maps,
        measured,
        reflectance,
        to_relative,
        _quality(geometry, dome, colours, coverage, inside),
        dict(provenance),
    )


def _content_matrix(lights: Mapping[str, Light], colours: Mapping[str, ColourFit]) -> Array:
    """(3, 3) from camera radiance to amounts of the mean projector's primaries."""
    white = np.mean([light.direct[light.lit].mean(axis=0) for light in lights.values()], axis=0)
    mix = np.mean([c.mix for c in colours.values()], axis=0)
    return np.asarray(np.linalg.inv(mix) / white, float)


def _converted(light: Light, unmix: Array) -> Light:
    """A light split in camera channels, in content channels."""
    matrix = unmix.T.astype(np.float32)
    return Light(
        light.direct @ matrix,
        light.scattered @ matrix,
        light.extended @ matrix,
        light.flux @ unmix.T,
        light.weight,
        light.lit,
    )


def _coverage(
    geometry: GeometrySolution, dome: Dome, direction: Array, lights: Mapping[str, Light]
) -> NDArray[np.float32]:
    """Share (...) of each place that is lit; a ramp about one half, blind to noise near 0 and 1."""
    shares = [lit_share(geometry.camera, dome, direction, light) for light in lights.values()]
    return np.asarray(np.clip(2 * np.max(shares, axis=0) - 0.5, 0, 1), np.float32)


def _master_at(view: DomeView) -> NDArray[np.floating]:
    """Where each camera pixel lies in the dome maps."""
    return master_pixels(np.nan_to_num(view.direction), MAP_SIZE)


def _black_level(
    blacks: Mapping[str, Image],
    to_relative: Array,
    feedback_value: Array,
    lights: Mapping[str, Light],
    where: Array,
) -> Image:
    """Direct black light of all projectors together on the dome master, smoothed.

    A projector's black is spread like its white, so it holds the same share of scattered light.
    """
    total = np.zeros((1, 1, 3), np.float32)
    for name, black in blacks.items():
        light = lights[name]
        direct_share = np.where(
            light.lit[..., None], light.direct / np.maximum(light.direct + light.scattered, 1e-9), 0
        )
        total = total + np.nan_to_num(black) * direct_share
    smooth = blur(total, BLACK_BLUR_PX) @ to_relative.T.astype(np.float32)
    return np.maximum(sample(smooth, where), 0)


def _projector(  # noqa: PLR0913, PLR0917
    name: str,
    geometry: GeometrySolution,
    dome: Dome,
    surface: ProjectorSurface,
    blender: Blender,
    light: Light,
    white: Array,
    responses: Mapping[str, ResponseCurve],
    colours: Mapping[str, ColourFit],
) -> ProjectorCalibration:
    """One projector's part; its gain is read off the camera where each of its pixels lands."""
    where = camera_pixels(geometry.camera, dome, np.nan_to_num(surface.direction))
    gain = sample(light.extended, where) / white.astype(np.float32)
    gain = np.maximum(gain, 0) * surface.valid[..., None]
    mean_mix = np.mean([c.mix for c in colours.values()], axis=0)
    mix = np.linalg.inv(mean_mix) @ colours[name].mix
    mix = np.asarray(mix / mix.sum(axis=1, keepdims=True), float)
    blend = blender.weights(np.nan_to_num(surface.direction))[name] * surface.valid
    return ProjectorCalibration(
        geometry.projectors[name],
        surface,
        Photometry(responses[name], mix, gain.astype(np.float32)),
        blend.astype(np.float32),
    )


def _quality(
    geometry: GeometrySolution,
    dome: Dome,
    colours: Mapping[str, ColourFit],
    coverage: NDArray[np.float32],
    inside: NDArray[np.bool_],
) -> dict[str, Figure]:
    ratio, systematic = sphere_test(geometry, dome)
    residual = np.concatenate(list(geometry.residual_px.values()))
    solid = master_solid_angles(MAP_SIZE)
    return {
        "geometry_residual_rms_px": Figure(
            float(np.sqrt(np.mean(residual**2))), "px", samples=len(residual)
        ),
        "sphere_variance_ratio": Figure(
            ratio, "-", Goal("<=", 2.0), len(residual), "above 2 the dome is not a sphere"
        ),
        "sphere_systematic_arcmin": Figure(systematic, "arcmin", samples=len(residual)),
        "additivity_error": Figure(
            max(c.additivity_error for c in colours.values()), "-", Goal("<=", 0.01), len(colours)
        ),
        "coverage": Figure(float((solid * coverage).sum() / (solid * inside).sum()), "-"),
    }
