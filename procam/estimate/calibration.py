"""Assemble a calibration from geometry and from the light of each projector.

Light is measured in camera channels. `assemble` converts it to content channels, in which the mean
projector's primaries are the unit vectors; computes footprints, blend weights and the common white;
estimates scatter, feedback and albedo of the screen (`light.screen_light`); and samples everything on the
maps of its canvas. `light.measure` measures the light of each projector.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from procam.arrays import Array
from procam.estimate.geometry.direction_samples import direction_sigmas
from procam.estimate.geometry.solve import MAX_SPHERE_RATIO, GeometrySolution
from procam.estimate.light.blend import Blender, common_white
from procam.estimate.light.calibrated_projector import Placed, unblended_projector
from procam.estimate.light.edge_blend import edge_blend_notes
from procam.estimate.light.luminance_matching import matched_white
from procam.estimate.light.map_pixels import MapPixels
from procam.estimate.light.measurement import ProjectorMeasurement
from procam.estimate.light.screen_light import ScreenLight, screen_light
from procam.memory import return_buffers
from procam.model.calibration import Calibration, ProjectorCalibration
from procam.model.provenance import Provenance
from procam.model.quality import Figure, Goal
from procam.model.screen import Dome
from procam.model.transport import ScreenMaps

COVERED = 0.999  # coverage of a pixel that limits the common white
MAX_ADDITIVITY_ERROR = 0.01


def assemble(
    placed: Placed,
    measured: Mapping[str, ProjectorMeasurement],
    provenance: Provenance,
    falloff_per_rad: float,
    map_size: int,
) -> Calibration:
    """Assemble the calibration of what one camera measured.

    Parameters
    ----------
    placed : solved poses, the screen, the main camera's view of it, manual shifts of the picture.
    measured : light of each projector.
    provenance : stored with the calibration; notes are added to it.
    falloff_per_rad : largest relative change of the white per radian (`luminance_matching`).
    map_size : edge of the dome maps [px], a multiple of `CELLS`.
    """
    screen, unmix = placed.screen, _content_matrix(measured)
    projectors = {
        name: unblended_projector(placed, name, each, unmix) for name, each in measured.items()
    }
    return_buffers()  # directions of a panel's pixels take ten times what is kept of them
    pixels = MapPixels(placed, projectors, map_size)
    hi, lit = pixels.white.light, pixels.coverage > COVERED
    shape = matched_white(hi, lit, falloff_per_rad)
    white = common_white(hi / shape[..., None], lit)
    projectors = Blender(_over(white, projectors), screen).blended()
    to_relative = np.diag(1 / white) @ unmix
    light = screen_light(placed, measured, unmix, pixels)
    lo = pixels.black_level(measured, to_relative)
    maps = ScreenMaps(
        light.scatter_per_flux,
        light.albedo_map,
        lo,
        (hi / white * pixels.coverage[..., None]).astype(np.float32) + lo,
        pixels.coverage,
        kernel=light.kernel,
        falloff=shape if falloff_per_rad else None,
    )
    notes = [*provenance.notes, *(note for m in measured.values() for note in m.notes)]
    notes += light.notes
    if isinstance(screen, Dome):  # in a room pictures end on walls that are not lit
        notes += edge_blend_notes(projectors)
    return Calibration(
        light.screen,
        placed.geometry.rig.cameras,
        projectors,
        maps,
        light.feedback,
        light.albedo,
        to_relative,
        _quality(placed, measured, pixels, light),
        replace(provenance, notes=tuple(notes)),
        main_camera=placed.geometry.main,
        canvas=screen.canvas,
    )


def _content_matrix(measured: Mapping[str, ProjectorMeasurement]) -> Array:
    """(3, 3) from camera radiance to amounts of the mean projector's primaries."""
    white = np.mean([m.white for m in measured.values()], axis=0)
    mix = np.mean([m.colour.mix for m in measured.values()], axis=0)
    return np.asarray(np.linalg.inv(mix) / white, float)


def _over(
    white: Array, projectors: Mapping[str, ProjectorCalibration]
) -> dict[str, ProjectorCalibration]:
    """The projectors with their gains in parts of a white (3,)."""
    small = white.astype(np.float32)
    return {
        name: replace(p, photometry=replace(p.photometry, gain=p.photometry.gain / small))
        for name, p in projectors.items()
    }


def _direction_sigmas(geometry: GeometrySolution, moved_arcmin: float) -> dict[str, Figure]:
    relative, absolute = (float(np.hypot(s, moved_arcmin)) for s in direction_sigmas(geometry))
    lens = 'a lens that is "fixed" counts as exact'
    note = f"less a rotation; {lens}"
    return {
        "direction_sigma_relative_arcmin": Figure(relative, "arcmin", note=note),
        "direction_sigma_arcmin": Figure(
            absolute, "arcmin", note=f"with the survey of marks; {lens}"
        ),
    }


def _quality(
    placed: Placed,
    measured: Mapping[str, ProjectorMeasurement],
    pixels: MapPixels,
    light: ScreenLight,
) -> dict[str, Figure]:
    geometry = placed.geometry
    residual = np.concatenate(list(geometry.residual_px.values()))
    additivity = max(m.colour.additivity_error for m in measured.values())
    return {
        "geometry_residual_rms_px": Figure(
            float(np.sqrt(np.mean(residual**2))), "px", samples=len(residual)
        ),
        "sphere_variance_ratio": Figure(
            geometry.sphere_systematic_ratio**2,
            "-",
            Goal("<=", MAX_SPHERE_RATIO**2),
            len(residual),
            "above it the screen is not what it is stated to be: a sphere, or a room of these dimensions",
        ),
        **_direction_sigmas(geometry, placed.moved_arcmin),
        "shape_degree": Figure(float(geometry.rig.shape.degree), "-"),
        "additivity_error": Figure(
            additivity, "-", Goal("<=", MAX_ADDITIVITY_ERROR), len(measured)
        ),
        "coverage": Figure(float(pixels.weight.sum()) / pixels.inside_weight, "-"),
        **light.figures,
    }
