"""Puts the measured pieces together: content channels, common white, blend, dome maps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.estimate.geometry.camera_view import DomeView
from procam.estimate.geometry.solve import ROUND_ENOUGH, GeometrySolution
from procam.estimate.light.blend import Blender, common_white
from procam.estimate.light.floor_albedo import FloorLight, contradiction, floor_of, measure_floor
from procam.estimate.light.footprint import camera_pixels, lit_share, project_surface
from procam.estimate.light.luminance_matching import matched_white
from procam.estimate.light.projector_response import ColourFit
from procam.estimate.light.scatter_kernel import (
    BLACK_BLUR_PX,
    CELLS,
    ScatterSample,
    ScatterSolution,
    solve_scatter,
)
from procam.estimate.light.separation import SeparatedLight, albedo, feedback
from procam.maths.geometry.sphere import (
    cap_solid_angle,
    master_directions,
    master_pixels,
    master_solid_angles,
)
from procam.maths.warp import blur, sample
from procam.model.calibration import Calibration, ProjectorCalibration
from procam.model.correspondence import ProjectorSurface
from procam.model.mask import Nudge
from procam.model.photometry import Photometry, ResponseCurve
from procam.model.quality import Figure, Goal
from procam.model.screen import Dome
from procam.model.transport import DomeMaps, Measured

Array = NDArray[np.float64]
Image = NDArray[np.float32]
MAP_SIZE = 1024
COVERED = 0.999
CONTRADICTS = 3.0  # sigmas
ROUGH_ALBEDO = 0.5  # shapes of bounced light hardly depend on it


@dataclass(frozen=True, slots=True)
class ProjectorMeasurement:
    """What was read off one projector's pictures, in camera channels.

    `black` (H, W, 3) is the radiance of its black picture, scattered light included; `scatter_samples` are
    the bounced light of its white, then of its other pictures; `exponent` is that of `Photometry`;
    `notes` what people should know.
    """

    light: SeparatedLight
    black: Image
    colour: ColourFit
    response: ResponseCurve
    scatter_samples: Sequence[ScatterSample] = ()
    exponent: Image | None = None
    notes: Sequence[str] = ()


def assemble(
    dome: Dome,
    geometry: GeometrySolution,
    view: DomeView,
    measured: Mapping[str, ProjectorMeasurement],
    nudges: Sequence[Nudge],
    provenance: Mapping[str, Any],
    falloff_per_rad: float = 0.0,
) -> Calibration:
    """The calibration of everything measured through one camera, and of what a person nudged.

    `falloff_per_rad`: by how much, relative, the white may change per radian (`matching`).
    """
    master = _Master(geometry, measured)
    unmix = _content_matrix(measured)
    content = {name: _converted(m.light, unmix) for name, m in measured.items()}
    surfaces = {
        name: project_surface(geometry, name, dome, light, nudges)
        for name, light in content.items()
    }
    blender = Blender(geometry.projectors, surfaces, dome)
    hi = master.blended(blender, content)
    lit = master.coverage > COVERED
    shape = matched_white(hi, lit, falloff_per_rad)
    white = common_white(hi / shape[..., None], lit)
    to_relative = np.diag(1 / white) @ unmix
    scatter_samples = [[x.converted(unmix) for x in m.scatter_samples] for m in measured.values()]
    bounced = _measure_scatter(dome, view, master, list(content.values()), scatter_samples, hi)
    lo = master.black_level(measured, to_relative)
    maps = DomeMaps(
        *master.scatter_and_albedo(bounced),
        lo,
        (hi / white * master.coverage[..., None]).astype(np.float32) + lo,
        master.coverage,
        kernel=bounced.spread.fit.kernel,
        falloff=shape if falloff_per_rad else None,
    )
    projectors = {
        name: _gain_and_blend(geometry, name, surfaces[name], light.extended / white, blender)
        for name, light in content.items()
    }
    return Calibration(
        bounced.dome,
        geometry.rig.cameras,
        _projectors(geometry, surfaces, measured, projectors),
        maps,
        bounced.feedback,
        bounced.albedo,
        to_relative,
        _quality(geometry, measured, master, bounced),
        {**provenance, "notes": [*provenance.get("notes", []), *_notes(measured, dome, bounced)]},
    )


def _projectors(
    geometry: GeometrySolution,
    surfaces: Mapping[str, ProjectorSurface],
    measured: Mapping[str, ProjectorMeasurement],
    gain_and_blend: Mapping[str, tuple[Image, Image]],
) -> dict[str, ProjectorCalibration]:
    mean_mix = np.mean([m.colour.mix for m in measured.values()], axis=0)
    found = {}
    for name, (gain, blend) in gain_and_blend.items():
        known = measured[name]
        mix = _relative_mix(mean_mix, known)
        photometry = Photometry(known.response, mix, gain, known.exponent)
        found[name] = ProjectorCalibration(
            geometry.projectors[name], surfaces[name], photometry, blend
        )
    return found


class _Master:
    """The dome master of the maps: directions, where the camera sees them, what is lit."""

    def __init__(
        self, geometry: GeometrySolution, measured: Mapping[str, ProjectorMeasurement]
    ) -> None:
        direction, self.inside = master_directions(MAP_SIZE)
        self.direction = direction.astype(np.float32)
        self.where = camera_pixels(geometry, direction)
        shares = [lit_share(geometry, direction, m.light) for m in measured.values()]
        # a ramp about one half, blind to noise near 0 and 1
        ramp = np.clip(2 * np.max(shares, axis=0) - 0.5, 0, 1) * self.inside
        self.coverage = ramp.astype(np.float32)
        self.solid_sr = master_solid_angles(MAP_SIZE) * self.coverage

    def mean(self, values: Image) -> Array:
        """Mean (C,) over what is lit."""
        return np.asarray(np.tensordot(self.solid_sr, values, 2) / self.solid_sr.sum())

    def blended(self, blender: Blender, lights: Mapping[str, SeparatedLight]) -> Array:
        """Direct light (N, N, 3) of all projectors at full white, blended."""
        weights = blender.weights(self.direction)
        each = [w[..., None] * sample(lights[n].extended, self.where) for n, w in weights.items()]
        return np.asarray(np.sum(each, axis=0), float)

    def flux_in_cells(self, hi: Array) -> Array:
        """Flux (N, C) of full white in the cells of the scatter's fit [rel sr]."""
        fine = MAP_SIZE // CELLS
        light = hi * self.solid_sr[..., None]
        return np.asarray(
            light.reshape(CELLS, fine, CELLS, fine, -1).sum(axis=(1, 3)).reshape(CELLS**2, -1)
        )

    def scatter_and_albedo(self, bounced: "_Scatter") -> tuple[Image, Image]:
        """U [1/sr] and the paint (N, N, C): full white brings nearly the same everywhere.

        To .3 % over a floor of .1. The kernel's profile of it is worse: gloss bends that by percents.
        """
        u = sample(bounced.spread.per_flux, self.where) * self.inside[..., None]
        return u, (u / self.mean(u) * bounced.albedo.value).astype(np.float32)

    def black_level(
        self, measured: Mapping[str, ProjectorMeasurement], to_relative: Array
    ) -> Image:
        """Direct black light (N, N, 3) of all projectors together, smoothed [rel].

        A projector's black is spread like its white, so it holds the same share of scattered light.
        """
        total = np.sum(
            [np.nan_to_num(m.black) * _direct_share(m.light) for m in measured.values()], axis=0
        )
        smooth = blur(total, BLACK_BLUR_PX) @ to_relative.T.astype(np.float32)
        level = np.maximum(sample(smooth, self.where), 0) * self.coverage[..., None]
        return np.asarray(level, np.float32)


def _direct_share(light: SeparatedLight) -> Image:
    both = np.maximum(light.direct + light.scattered, 1e-9)
    return np.where(light.lit[..., None], light.direct / both, 0)


def _notes(
    measured: Mapping[str, ProjectorMeasurement], dome: Dome, bounced: "_Scatter"
) -> list[str]:
    """What was seen of each projector; and a floor that is not what venue.toml says."""
    notes, floor = [note for m in measured.values() for note in m.notes], bounced.floor
    if contradiction(dome, floor) < CONTRADICTS:
        return notes
    told = (
        f"floor_albedo: venue.toml says {dome.floor_albedo:g} +- {dome.floor_albedo_sigma:g}, the "
        f"light that the floor returns {floor.albedo:.2f} +- {floor.sigma:.2f}; the albedo of the "
        "screen hangs on it, nothing else does"
    )
    return [*notes, told]


@dataclass(frozen=True, slots=True)
class _Scatter:
    """What the dome does to light; `dome` with what is now known of its floor."""

    dome: Dome
    spread: ScatterSolution
    floor: FloorLight
    feedback: Measured
    albedo: Measured


def _measure_scatter(
    dome: Dome,
    view: DomeView,
    master: _Master,
    lights: list[SeparatedLight],
    scatter_samples: list[list[ScatterSample]],
    hi: Array,
) -> _Scatter:
    white, together = master.flux_in_cells(hi), [x for each in scatter_samples for x in each]
    spread = solve_scatter(lights, scatter_samples, view, white)
    floor = measure_floor(together, spread.in_cells, white, dome, ROUGH_ALBEDO)
    value, sigma = floor_of(dome, floor)
    floored = replace(dome, floor_albedo=value, floor_albedo_sigma=sigma)
    at = master_pixels(np.nan_to_num(view.direction), MAP_SIZE)
    lit_sr = sample(master.coverage, at) * view.solid_angle_sr
    doubts = view.camera.sensor.glare_sigma, floor.flux_doubt / np.sqrt(len(together))
    m = feedback(lights, lit_sr, view.solid_angle_sr, spread.strengths, doubts)
    screen_sr, lit = cap_solid_angle(dome.half_angle), float(master.solid_sr.sum())
    return _Scatter(floored, spread, floor, m, albedo(m, lit, screen_sr, floored, floor.flux_doubt))


def _content_matrix(measured: Mapping[str, ProjectorMeasurement]) -> Array:
    """(3, 3) from camera radiance to amounts of the mean projector's primaries."""
    lights = [m.light for m in measured.values()]
    white = np.mean([light.direct[light.lit].mean(axis=0) for light in lights], axis=0)
    mix = np.mean([m.colour.mix for m in measured.values()], axis=0)
    return np.asarray(np.linalg.inv(mix) / white, float)


def _relative_mix(mean_mix: Array, measurement: ProjectorMeasurement) -> Array:
    """Colour mixing (3, 3) in content channels; rows sum to 1."""
    mix = np.asarray(np.linalg.inv(mean_mix) @ measurement.colour.mix, float)
    return mix / mix.sum(axis=1, keepdims=True)


def _converted(light: SeparatedLight, unmix: Array) -> SeparatedLight:
    """A light split in camera channels, in content channels."""
    matrix = unmix.T.astype(np.float32)
    return SeparatedLight(
        light.direct @ matrix,
        light.scattered @ matrix,
        light.extended @ matrix,
        light.flux @ unmix.T,
        light.weight,
        light.lit,
    )


def _gain_and_blend(
    geometry: GeometrySolution,
    name: str,
    surface: ProjectorSurface,
    white_light: NDArray[np.floating],
    blender: Blender,
) -> tuple[Image, Image]:
    """Gain (H, W, 3), read off the camera where each pixel lands, and blend (H, W)."""
    direction = np.nan_to_num(surface.direction)
    gain = sample(white_light, camera_pixels(geometry, direction))
    gain = np.maximum(gain, 0) * surface.valid[..., None]
    blend = blender.weights(direction)[name] * surface.valid
    return gain.astype(np.float32), blend.astype(np.float32)


def _quality(
    geometry: GeometrySolution,
    measured: Mapping[str, ProjectorMeasurement],
    master: _Master,
    bounced: "_Scatter",
) -> dict[str, Figure]:
    residual = np.concatenate(list(geometry.residual_px.values()))
    floor, fit = bounced.floor, bounced.spread.fit
    inside_sr = float((master_solid_angles(MAP_SIZE) * master.inside).sum())
    additivity = max(m.colour.additivity_error for m in measured.values())
    return {
        "geometry_residual_rms_px": Figure(
            float(np.sqrt(np.mean(residual**2))), "px", samples=len(residual)
        ),
        "sphere_variance_ratio": Figure(
            geometry.sphere_excess**2,
            "-",
            Goal("<=", ROUND_ENOUGH**2),
            len(residual),
            "above it the dome is not a sphere",
        ),
        "shape_degree": Figure(float(geometry.rig.shape.degree), "-"),
        "additivity_error": Figure(additivity, "-", Goal("<=", 0.01), len(measured)),
        "coverage": Figure(float(master.solid_sr.sum()) / inside_sr, "-"),
        "floor_albedo_by_light": Figure(floor.albedo, "-", None, 1, f"sigma {floor.sigma:.3f}"),
        "flux_doubt": Figure(floor.flux_doubt, "-", None, 1, "direct against bounced light"),
        "scatter_degree": Figure(fit.kernel.degree, "-", None, 1, fit.explained()),
    }
