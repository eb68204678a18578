"""How the screen scatters light, dome or room, as a calibration's maps have it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, Image
from procam.estimate.light.calibrated_projector import ContentLight, Placed
from procam.estimate.light.dome_scatter import measure_scatter
from procam.estimate.light.floor_albedo import floor_notes, flux_notes
from procam.estimate.light.map_pixels import MapPixels
from procam.estimate.light.measurement import ProjectorMeasurement
from procam.estimate.light.room_scatter import measure_room
from procam.estimate.light.spots import spot_notes
from procam.estimate.light.unknown_vignetting import vignetting_notes
from procam.maths.warp import sample
from procam.model.provenance import Note
from procam.model.quality import Figure
from procam.model.screen import Dome, RoomScreen, Screen
from procam.model.transport import Measured, ScatterKernel


@dataclass(frozen=True, slots=True)
class ScreenLight:
    """What the light of all projectors tells of the screen.

    Attributes
    ----------
    screen : with what was measured of it.
    scatter_per_flux, albedo_map : (H, W, 3) as in `ScreenMaps`. kernel : likewise.
    feedback, albedo : m, and the mean albedo. notes, figures : for the report.
    """

    screen: Screen
    scatter_per_flux: Image
    albedo_map: Image
    kernel: ScatterKernel
    feedback: Measured
    albedo: Measured
    notes: Sequence[Note]
    figures: Mapping[str, Figure]


def screen_light(
    placed: Placed,
    measured: Mapping[str, ProjectorMeasurement],
    content_from_camera: Array,
    pixels: MapPixels,
) -> ScreenLight:
    """The screen's scatter, feedback and albedo by the projectors' light in content channels."""
    if isinstance(placed.screen, Dome):
        return _of_dome(placed.screen, placed, measured, content_from_camera, pixels)
    return _of_room(placed.screen, placed, measured, content_from_camera, pixels)


def _of_dome(
    dome: Dome,
    placed: Placed,
    measured: Mapping[str, ProjectorMeasurement],
    content_from_camera: Array,
    pixels: MapPixels,
) -> ScreenLight:
    """By one kernel on the sphere.

    u of full white is proportional to the albedo, to 0.3 % over a floor of albedo 0.1. The profile of the
    kernel would correct for that, but gloss distorts it by percents.
    """
    view, white = placed.view, pixels.white.light
    samples = [
        [x.converted(content_from_camera) for x in m.scatter_samples] for m in measured.values()
    ]
    lights = ContentLight(measured, content_from_camera).values()
    found = measure_scatter(
        dome, view, lights, samples, pixels.flux_in_cells(white), pixels.coverage
    )
    seen, fit = found.solution.per_flux, found.solution.fit
    u = sample(seen, pixels.where) * pixels.inside[..., None]
    notes = [*floor_notes(dome, found.floor), *flux_notes(found.floor)]
    return ScreenLight(
        found.dome,
        u,
        (u / pixels.mean(u) * found.albedo.value).astype(np.float32),
        fit.kernel,
        found.feedback,
        found.albedo,
        [*notes, *spot_notes(seen, view), *vignetting_notes(seen, view)],
        {
            "floor_albedo_by_light": Figure(
                found.floor.albedo, "-", None, 1, f"sigma {found.floor.sigma:.3f}"
            ),
            "flux_doubt": Figure(
                found.floor.flux_inconsistency,
                "-",
                None,
                1,
                "spread of scattered over direct light",
            ),
            "scatter_degree": Figure(fit.kernel.degree, "-", None, 1, fit.summary()),
        },
    )


def _of_room(
    screen: RoomScreen,
    placed: Placed,
    measured: Mapping[str, ProjectorMeasurement],
    content_from_camera: Array,
    pixels: MapPixels,
) -> ScreenLight:
    """By the form factors between all faces."""
    lights = ContentLight(measured, content_from_camera).values()
    found = measure_room(screen, placed.view, lights, pixels.white.light, pixels.coverage)
    maps, values = (found.per_flux, found.albedo_map), (found.feedback, found.albedo)
    return ScreenLight(found.screen, *maps, ScatterKernel.scalar(), *values, [], {})
