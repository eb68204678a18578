"""Geometry over many rigs: how far directions are off, seams, and whether the error bars are right.

Poses and lenses are perturbed for every seed. Observations come from `simulators.observations`: true
positions of patches with a decoder's noise, no pictures.
"""

import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context

import numpy as np
from numpy.typing import NDArray

from procam.errors import ProcamError
from procam.estimate.geometry.adjustment import RigProblem
from procam.estimate.geometry.model import Observations
from procam.estimate.geometry.pixel_directions import PixelDirections, fit_pixel_directions
from procam.estimate.geometry.solve import GeometrySolution, solve_geometry
from procam.estimate.geometry.start import ProjectorPrior
from procam.maths.geometry.lenses import project
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.maths.geometry.sphere import ARCMIN, angle_between, direction_from_angles, normalise
from procam.model.optics import CameraModel, Fiducial, Sensor
from simulators.builds import CameraBuild, ProjectorBuild
from simulators.observations import camera_pixels, lit_points, perturb_rig, simulate_observations
from simulators.placement import place_cameras, place_projectors
from simulators.presets import REALISTIC, STANDARD, Preset
from simulators.surface import Surface
from studies.measure import write

Array = NDArray[np.float64]
RADIUS_M, PANEL, CAMERA = 8.0, (1920, 1200), (2048, 2048)
PROJECTORS, CAMERAS = 6, 2
SIGMA_PX = 0.02  # of a patch: studies/codes.md finds 0.015 at SNR 50
FIDUCIALS_DEG = ((12.0, 35.0), (130.0, 30.0), (-110.0, 50.0))
FIDUCIAL_SIGMA = 1e-5  # rad: surveyed far better than the rig is solved
JUDGE_M = np.array([-1.6, -0.9, -0.4])  # a viewpoint that no camera of the solve had
SEAM_STEP_PX = 40
FOUND = 1e-7  # rad: a pixel that shows a direction
WORKERS = 2


@dataclass(frozen=True)
class Case:
    """One kind of dome, over how many seeds, with patches how large."""

    name: str
    preset: Preset
    seeds: int
    patch_px: int
    halves: bool  # whether to compare two solutions from half of the patches each, which is slow


CASES = (Case("standard", STANDARD, 100, 24, False), Case("realistic", REALISTIC, 3, 12, True))


@dataclass(frozen=True)
class Dome:
    """A dome with a perturbed rig."""

    surface: Surface
    projectors: list[ProjectorBuild]
    cameras: list[CameraBuild]


def main() -> None:
    """Run all cases and write studies/geometry.json and .md."""
    jobs = [(case, seed) for case in reversed(CASES) for seed in range(case.seeds)]
    with ProcessPoolExecutor(WORKERS, get_context("spawn")) as pool:
        rows = list(pool.map(_row, *zip(*jobs, strict=True)))
    write("geometry", {"rows": rows}, _report(rows))


def _row(case: Case, seed: int) -> dict[str, float | str]:
    row = {"case": case.name, "seed": seed, **run(case, seed)}
    print(row, flush=True)
    return row


def run(case: Case, seed: int) -> dict[str, float | str]:
    """Figures of one rig."""
    rng = np.random.default_rng(seed)
    preset = replace(case.preset, radius_m=RADIUS_M)
    surface = Surface.build(preset)
    projectors = place_projectors(PROJECTORS, PANEL, preset)
    placed = place_cameras(CAMERAS, CAMERA, "fisheye", preset)
    dome = Dome(surface, *perturb_rig(projectors, placed, rng))
    problem = _problem(dome, case.patch_px, rng)
    started = time.perf_counter()
    try:
        found = solve_geometry(problem)
    except ProcamError as error:
        return {"failed": str(error)}
    seconds = time.perf_counter() - started
    fitted = {b.name: fit_pixel_directions(found, b.name) for b in dome.projectors}
    error, sigma = _directions(dome, fitted)
    return {
        "rms_arcmin": float(np.sqrt(np.mean(error**2))),
        "max_arcmin": float(error.max()),
        "chi2": float(np.mean((error / sigma) ** 2)),
        "seam_rms_px": _seams(dome, fitted),
        "degree": found.rig.shape.degree,
        "sphere_ratio": found.sphere_systematic_ratio**2,
        "disagreement_arcmin": _cross_validated(problem, dome) if case.halves else np.nan,
        "solve_s": seconds,
    }


def _problem(dome: Dome, patch_px: int, rng: np.random.Generator) -> RigProblem:
    seen = {}
    for camera in dome.cameras:
        for build in dome.projectors:
            pixels = simulate_observations(dome.surface, build, camera, patch_px, SIGMA_PX, rng)
            sigma = np.full(len(pixels[0]), SIGMA_PX)
            seen[camera.name, build.name] = Observations(*pixels, sigma)
    cameras = {c.name: CameraModel(c.name, c.size, c.lens, Sensor(12, 64.0)) for c in dome.cameras}
    return RigProblem(
        RoundShape(RADIUS_M),
        cameras,
        {b.name: ProjectorPrior(b.name, b.size) for b in dome.projectors},
        seen,
        dict.fromkeys(cameras, "fixed"),
        _fiducials(dome, rng),
    )


def _fiducials(dome: Dome, rng: np.random.Generator) -> list[Fiducial]:
    marks = []
    for i, (azimuth, elevation) in enumerate(np.radians(FIDUCIALS_DEG)):
        direction = direction_from_angles(azimuth, elevation)
        point = direction * dome.surface.radius(direction)
        off = rng.normal(0, FIDUCIAL_SIGMA, 2)
        pixel = camera_pixels(dome.cameras[0], point[None])[0]
        angles = azimuth + off[0] / np.cos(elevation), elevation + off[1]
        marks.append(Fiducial(f"f{i}", *angles, FIDUCIAL_SIGMA, dome.cameras[0].name, pixel))
    return marks


def _directions(dome: Dome, fitted: dict[str, PixelDirections]) -> tuple[Array, Array]:
    """Errors of all lit pixels, thinned, and their estimated sigmas [arcmin]."""
    errors, sigmas = [], []
    for build in dome.projectors:
        x, y = np.arange(3, build.size[0], 20), np.arange(5, build.size[1], 20)
        pixels = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2).astype(float)
        true = lit_points(dome.surface, build, pixels)
        lit = np.isfinite(true).all(axis=1)
        estimate = fitted[build.name].directions(x, y).reshape(-1, 3)[lit]
        errors.append(ARCMIN * angle_between(normalise(true[lit]), estimate))
        sigmas.append(fitted[build.name].sigma_arcmin(x, y).ravel()[lit])
    return np.concatenate(errors), np.concatenate(sigmas)


def _seams(dome: Dome, fitted: dict[str, PixelDirections]) -> float:
    """Rms distance [px], from a new viewpoint, of two projectors' pixels with equal estimated direction."""
    apart = []
    for first in dome.projectors:
        x, y = (np.arange(20, n - 20, SEAM_STEP_PX) for n in first.size)
        pixels = np.stack(np.meshgrid(x, y), axis=-1).astype(float)
        direction = fitted[first.name].at(pixels)
        here = _seen(dome, first, pixels)
        pixel = np.linalg.norm(_seen(dome, first, pixels + np.array([1.0, 0.0])) - here, axis=-1)
        for second in dome.projectors:
            if second.name != first.name:
                other = _pixel_of(fitted[second.name], direction)
                inside = ((other > 0) & (other < np.array(second.size) - 1.0)).all(axis=-1)
                there = _seen(dome, second, np.where(inside[..., None], other, 0.0))
                gap = np.linalg.norm(there - here, axis=-1) / pixel
                apart.append(gap[inside & np.isfinite(gap)])
    return float(np.sqrt(np.mean(np.concatenate(apart) ** 2)))


def _seen(dome: Dome, build: ProjectorBuild, pixels: Array) -> Array:
    """True directions (..., 3) of pixels from the judge's viewpoint; NaN where not lit."""
    flat = lit_points(dome.surface, build, pixels.reshape(-1, 2))
    return normalise(flat - JUDGE_M).reshape(*pixels.shape[:-1], 3)


def _pixel_of(directions: PixelDirections, direction: Array) -> Array:
    """The pixels (H, W, 2) with estimated directions `direction` (H, W, 3), by Newton's method."""
    model, radius_m = directions.projector, directions.rig.shape.radius_m
    pixel = project(model.projector_from_dome.apply(radius_m * direction), model.lens)
    for _ in range(3):
        here = directions.at(np.nan_to_num(pixel))
        steps = [directions.at(np.nan_to_num(pixel) + s) - here for s in np.eye(2)]
        slope = np.stack(steps, axis=-1)
        square = np.einsum("...ia,...ib->...ab", slope, slope) + 1e-18 * np.eye(2)
        right = np.einsum("...ia,...i->...a", slope, direction - here)
        pixel = pixel + np.linalg.solve(square, right[..., None])[..., 0]
    missed = np.linalg.norm(directions.at(np.nan_to_num(pixel)) - direction, axis=-1) > FOUND
    return np.where(missed[..., None], np.nan, pixel)  # no pixel of this panel shows it


def _cross_validated(problem: RigProblem, dome: Dome) -> float:
    """RMS angle between two solutions, each from every other patch [arcmin]."""
    halves = []
    for start in (0, 1):
        seen = {pair: o.some(slice(start, None, 2)) for pair, o in problem.observations.items()}
        halves.append(solve_geometry(replace(problem, observations=seen)))
    angles = [_angle(halves, build) for build in dome.projectors]
    return float(np.sqrt(np.mean(np.concatenate(angles) ** 2)))


def _angle(halves: list[GeometrySolution], build: ProjectorBuild) -> Array:
    x, y = np.arange(3, build.size[0], 40), np.arange(5, build.size[1], 40)
    first, second = (fit_pixel_directions(h, build.name).directions(x, y) for h in halves)
    angle = ARCMIN * angle_between(first, second)
    return np.asarray(angle[np.isfinite(angle)])


def _report(rows: list[dict]) -> list[str]:
    lines = [
        "# Geometry: directions, seams and error bars",
        "",
        f"{PROJECTORS} projectors of {PANEL[0]}x{PANEL[1]}, {CAMERAS} fisheyes of {CAMERA[0]}x{CAMERA[1]}, "
        f"dome of {RADIUS_M:g} m; poses perturbed by 3 to 9 degrees and decimetres for every seed, no start "
        f"values; {SIGMA_PX} px noise per patch, lenses of the cameras known.",
        "",
        "| case | seeds | converged | direction rms, mean and worst [arcmin] | max, worst | chi2 of "
        "error/sigma, mean and worst | seams rms, worst [px] | two halves apart [arcmin] | solve [s] |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for case in CASES:
        mine = [r for r in rows if r["case"] == case.name]
        good = [r for r in mine if "failed" not in r]

        def values(key: str, good: list[dict] = good) -> Array:
            return np.array([r[key] for r in good])

        rms, chi2 = values("rms_arcmin"), values("chi2")
        lines.append(
            f"| {case.name} | {len(mine)} | {len(good)} | {rms.mean():.3f}, {rms.max():.3f} | "
            f"{values('max_arcmin').max():.2f} | {chi2.mean():.2f}, {chi2.max():.2f} | "
            f"{values('seam_rms_px').max():.3f} | {_or_dash(values('disagreement_arcmin').mean())} | "
            f"{np.median(values('solve_s')):.1f} |"
        )
    goals = (
        "standard <= 0.3 rms, <= 1 max; realistic <= 1 rms; seams <= 0.25 px; realistic chi2 <= 1.3"
    )
    return [*lines, "", f"Goals: {goals}; all converge."]


def _or_dash(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else "-"
