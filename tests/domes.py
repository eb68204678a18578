"""Rigs in simulated domes and camera observations of them, for tests of geometry."""

from dataclasses import dataclass, replace

import numpy as np

from procam.estimate.geometry.adjustment import RigProblem
from procam.estimate.geometry.model import Observations, Pair, ParameterLayout, RigGeometry
from procam.estimate.geometry.pixel_directions import fit_pixel_directions
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.geometry.start import ProjectorPrior
from procam.maths.geometry.pose import Pose, rotation_vector
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.maths.geometry.sphere import (
    ARCMIN,
    angle_between,
    direction_from_angles,
    normalise,
)
from procam.model.optics import CameraModel, Fiducial, ProjectorModel, Sensor
from simulators.builds import CameraBuild, ProjectorBuild
from simulators.observations import (
    camera_pixels,
    lit_points,
    perturb_rig,
    simulate_observations,
)
from simulators.placement import place_cameras, place_projectors
from simulators.presets import STANDARD, Preset
from simulators.surface import Surface

MARKS_DEG = {
    "front": (12.0, 35.0),
    "left": (130.0, 30.0),
    "right": (-110.0, 50.0),
    "back": (-170.0, 25.0),
    "top": (40.0, 75.0),
}
SENSOR = Sensor(12, 64.0)


@dataclass(frozen=True)
class SimulatedDome:
    """A dome, its rig, and random numbers for measurement errors."""

    surface: Surface
    projectors: list[ProjectorBuild]
    cameras: list[CameraBuild]
    rng: np.random.Generator

    @classmethod
    def build(
        cls,
        seed: int,
        preset: Preset = STANDARD,
        projectors: int = 3,
        cameras: int = 2,
        radius_m: float = 8.0,
    ) -> "SimulatedDome":
        """A rig that is installed differently for every seed."""
        rng = np.random.default_rng(seed)
        preset = replace(preset, radius_m=radius_m)
        builds = place_projectors(projectors, (1920, 1200), preset)
        placed = place_cameras(cameras, (2048, 2048), "fisheye", preset)
        surface = Surface.build(preset)
        return cls(surface, *perturb_rig(builds, placed, rng), rng)

    @property
    def shape(self) -> RoundShape:
        """A sphere of the dome's radius."""
        return RoundShape(self.surface.preset.radius_m)

    def rig(self) -> RigGeometry:
        """The truth, where the dome is a sphere."""
        return RigGeometry(
            self.shape,
            {
                c.name: replace(self._camera(c), camera_from_dome=c.camera_from_dome)
                for c in self.cameras
            },
            {
                p.name: ProjectorModel(p.name, p.size, p.lens, p.projector_from_dome)
                for p in self.projectors
            },
        )

    def observations(self, patch_px: int = 32, sigma_px: float = 0.02) -> dict[Pair, Observations]:
        """Observations of every projector by every camera."""
        found = {}
        for camera in self.cameras:
            for build in self.projectors:
                seen = simulate_observations(
                    self.surface, build, camera, patch_px, sigma_px, self.rng
                )
                sigma = np.full(len(seen[0]), max(sigma_px, 1e-4))
                found[camera.name, build.name] = Observations(*seen, sigma)
        return found

    def fiducials(self, sigma: float = 1e-5, count: int = 3, off: float = 1.0) -> list[Fiducial]:
        """Fiducials of the first camera, surveyed to `sigma` [rad], with errors of `off` sigmas."""
        marks = []
        for name, angles in list(MARKS_DEG.items())[:count]:
            azimuth, elevation = np.radians(angles)
            direction = direction_from_angles(azimuth, elevation)
            point = direction * self.surface.radius(direction)
            pixel = camera_pixels(self.cameras[0], point[None])[0]
            error = off * self.rng.normal(0, sigma, 2)
            marks.append(
                Fiducial(
                    name,
                    azimuth + error[0] / np.cos(elevation),
                    elevation + error[1],
                    sigma,
                    self.cameras[0].name,
                    pixel,
                )
            )
        return marks

    def problem(self, observations: dict[Pair, Observations], **changes: object) -> RigProblem:
        """The input of a solver, with some of it changed."""
        problem = RigProblem(
            self.shape,
            {c.name: self._camera(c) for c in self.cameras},
            {p.name: ProjectorPrior(p.name, p.size) for p in self.projectors},
            observations,
            dict.fromkeys((c.name for c in self.cameras), "fixed"),
            self.fiducials(),
        )
        return replace(problem, **changes)  # type: ignore[arg-type]

    def direction_errors(self, found: GeometrySolution) -> tuple[np.ndarray, np.ndarray]:
        """Errors and estimated standard errors [arcmin] over all lit pixels, thinned."""
        errors, sigmas = [], []
        for build in self.projectors:
            fitted = fit_pixel_directions(found, build.name)
            x, y = np.arange(7, build.size[0], 40), np.arange(9, build.size[1], 40)
            pixels = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2).astype(float)
            true = lit_points(self.surface, build, pixels)
            lit = np.isfinite(true).all(axis=1)
            estimate = fitted.directions(x, y).reshape(-1, 3)[lit]
            errors.append(ARCMIN * angle_between(normalise(true[lit]), estimate))
            sigmas.append(fitted.sigma_arcmin(x, y).ravel()[lit])
        return np.concatenate(errors), np.concatenate(sigmas)

    def _camera(self, build: CameraBuild) -> CameraModel:
        return CameraModel(build.name, build.size, build.lens, SENSOR)


def step_between(found: RigGeometry, truth: RigGeometry) -> np.ndarray:
    """The step (P,) that leads from one rig to another, as `RigGeometry.moved` counts it."""
    layout = ParameterLayout.of(found)
    step = np.zeros(layout.count)
    for devices, others, blocks, pose in (
        (found.cameras, truth.cameras, layout.cameras, "camera_from_dome"),
        (found.projectors, truth.projectors, layout.projectors, "projector_from_dome"),
    ):
        for name, block in blocks.items():
            here, there = devices[name], others[name]
            lens = [np.r_[d.lens.focal, d.lens.centre, d.lens.distortion] for d in (here, there)]
            move = _move(getattr(here, pose), getattr(there, pose))
            parts = [move, lens[1] - lens[0]]
            if pose == "camera_from_dome":
                parts.append(there.pupil - here.pupil)  # type: ignore[union-attr]
            step[block] = np.concatenate(parts)
    return step


def _move(here: Pose, there: Pose) -> np.ndarray:
    turn = there.rotation @ here.rotation.T
    return np.r_[rotation_vector(turn), there.translation - turn @ here.translation]
