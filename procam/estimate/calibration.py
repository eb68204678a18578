"""Assemble a calibration from geometry and from the light of each projector.

Light is measured in camera channels. `assemble` converts it to content channels, in which the mean
projector's primaries are the unit vectors; computes footprints, blend weights and the common white;
estimates scatter, feedback and albedo of the dome (`light.dome_scatter`); and samples everything on
the maps of a dome master. `light.measure` measures the light of each projector. The file is longer than
300 lines because all of these parts meet in one place.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from procam.arrays import Array, Image
from procam.estimate.geometry.direction_samples import direction_sigmas
from procam.estimate.geometry.solve import MAX_SPHERE_RATIO, GeometrySolution
from procam.estimate.light.blend import Blender, common_white
from procam.estimate.light.calibrated_projector import (
    Placed,
    content_light,
    unblended_projector,
)
from procam.estimate.light.dome_scatter import DomeScatter, measure_scatter
from procam.estimate.light.edge_blend import edge_blend_notes
from procam.estimate.light.floor_albedo import floor_notes, flux_notes
from procam.estimate.light.full_white import FullWhite, black_light
from procam.estimate.light.luminance_matching import matched_white
from procam.estimate.light.measurement import ProjectorMeasurement
from procam.estimate.light.scatter_kernel import CELLS
from procam.estimate.light.separation import SeparatedLight
from procam.estimate.light.spots import spot_notes
from procam.estimate.light.unknown_vignetting import vignetting_notes
from procam.maths.geometry.sphere import master_directions, master_solid_angles
from procam.maths.warp import sample
from procam.memory import return_buffers
from procam.model.calibration import Calibration, ProjectorCalibration
from procam.model.provenance import Provenance
from procam.model.quality import Figure, Goal
from procam.model.transport import DomeMaps

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
    dome, view, unmix = placed.dome, placed.view, _content_matrix(measured)
    projectors = {
        name: unblended_projector(placed, name, each, unmix) for name, each in measured.items()
    }
    return_buffers()  # directions of a panel's pixels take ten times what is kept of them
    master = _Master(placed, projectors, map_size)
    hi, lit = master.white.light, master.coverage > COVERED
    shape = matched_white(hi, lit, falloff_per_rad)
    white = common_white(hi / shape[..., None], lit)
    projectors = Blender(_over(white, projectors), dome).blended()
    to_relative = np.diag(1 / white) @ unmix
    samples = [[x.converted(unmix) for x in m.scatter_samples] for m in measured.values()]
    lights = _ContentLight(measured, unmix).values()
    scatter = measure_scatter(
        dome, view, lights, samples, master.flux_in_cells(hi), master.coverage
    )
    lo = master.black_level(measured, to_relative)
    maps = master.maps(scatter, hi / white, lo, shape if falloff_per_rad else None)
    notes = [*provenance.notes, *(note for m in measured.values() for note in m.notes)]
    notes += [*floor_notes(dome, scatter.floor), *flux_notes(scatter.floor)]
    notes += [*spot_notes(scatter.solution.per_flux, view), *edge_blend_notes(projectors)]
    notes += vignetting_notes(scatter.solution.per_flux, view)
    return Calibration(
        scatter.dome,
        placed.geometry.rig.cameras,
        projectors,
        maps,
        scatter.feedback,
        scatter.albedo,
        to_relative,
        _quality(placed, measured, master, scatter),
        replace(provenance, notes=tuple(notes)),
        main_camera=placed.geometry.main,
    )


class _Master:
    """Pixels of the dome master of the maps: directions, camera positions, coverage."""

    def __init__(
        self, placed: Placed, projectors: Mapping[str, ProjectorCalibration], size: int
    ) -> None:
        self._dome, self._view, self._size = placed.dome, placed.view, size
        self.white = FullWhite(projectors, self._dome, size)
        direction, self.inside = master_directions(size)
        self.where = self._view.camera_pixels(self._dome, direction)
        self.coverage, solid_sr = self.white.coverage, master_solid_angles(size)
        self.solid_sr, self.inside_sr = solid_sr * self.coverage, float(solid_sr[self.inside].sum())

    def mean(self, values: Image) -> Array:
        """Mean (C,) over the lit part."""
        return np.asarray(np.tensordot(self.solid_sr, values, 2) / self.solid_sr.sum())

    def flux_in_cells(self, hi: Array) -> Array:
        """Flux (N, C) of full white in the cells of the scatter kernel's fit [rel sr]."""
        fine = self._size // CELLS
        light = hi * self.solid_sr[..., None]
        return np.asarray(
            light.reshape(CELLS, fine, CELLS, fine, -1).sum(axis=(1, 3)).reshape(CELLS**2, -1)
        )

    def maps(
        self, scatter: DomeScatter, white: Array, lo: Image, falloff: Image | None
    ) -> DomeMaps:
        """Maps of the dome; `white` (N, N, 3) is direct light of full white, `lo` that of black [rel]."""
        hi = (white * self.coverage[..., None]).astype(np.float32) + lo
        both = self._scatter_and_albedo(scatter)
        kernel = scatter.solution.fit.kernel
        return DomeMaps(*both, lo, hi, self.coverage, kernel=kernel, falloff=falloff)

    def _scatter_and_albedo(self, scatter: DomeScatter) -> tuple[Image, Image]:
        """Maps (N, N, C) of u [1/sr] and of the albedo.

        u of full white is proportional to the albedo, to 0.3 % over a floor of albedo 0.1. The profile
        of the kernel would correct for that, but gloss distorts it by percents.
        """
        u = sample(scatter.solution.per_flux, self.where) * self.inside[..., None]
        return u, (u / self.mean(u) * scatter.albedo.value).astype(np.float32)

    def black_level(
        self, measured: Mapping[str, ProjectorMeasurement], to_relative: Array
    ) -> Image:
        """Direct black light (N, N, 3) of all projectors together, smoothed [rel]."""
        rest = self._view, self._dome, to_relative, self._size
        total = sum(black_light(each, *rest) for each in measured.values())
        return np.asarray(np.maximum(total, 0) * self.coverage[..., None], np.float32)


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


class _ContentLight(Mapping[str, SeparatedLight]):
    """Light of projectors in content channels, converted when it is used."""

    def __init__(self, measured: Mapping[str, ProjectorMeasurement], matrix: Array) -> None:
        self._measured, self._matrix = measured, matrix

    def __getitem__(self, name: str) -> SeparatedLight:
        return content_light(self._measured[name], self._matrix)

    def __iter__(self) -> Iterator[str]:
        return iter(self._measured)

    def __len__(self) -> int:
        return len(self._measured)


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
    master: _Master,
    scatter: DomeScatter,
) -> dict[str, Figure]:
    geometry = placed.geometry
    residual = np.concatenate(list(geometry.residual_px.values()))
    floor, fit = scatter.floor, scatter.solution.fit
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
            "above it the dome is not a sphere",
        ),
        **_direction_sigmas(geometry, placed.moved_arcmin),
        "shape_degree": Figure(float(geometry.rig.shape.degree), "-"),
        "additivity_error": Figure(
            additivity, "-", Goal("<=", MAX_ADDITIVITY_ERROR), len(measured)
        ),
        "coverage": Figure(float(master.solid_sr.sum()) / master.inside_sr, "-"),
        "floor_albedo_by_light": Figure(floor.albedo, "-", None, 1, f"sigma {floor.sigma:.3f}"),
        "flux_doubt": Figure(
            floor.flux_inconsistency, "-", None, 1, "spread of scattered over direct light"
        ),
        "scatter_degree": Figure(fit.kernel.degree, "-", None, 1, fit.summary()),
    }
