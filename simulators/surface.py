"""The dome as built: nearly a spherical cap, with paint, panels and seams.

The radius is the nominal one plus harmonics and panel steps; the albedo varies slowly and drops along
seams. Harmonics are evaluated as polynomials in x, y, z, which on the sphere are the same functions.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import sph_harm_y

from procam.arrays import Array, BoolArray, IndexArray
from procam.maths.geometry.sphere import (
    angle_between,
    angles_from_direction,
    direction_from_angles,
    intersect_sphere,
    normalise,
)
from simulators.presets import Preset

GORES, RINGS = 16, 5
SEAM_SIGMA_M = 0.025  # Gaussian profile of a joint
SURFACE_STEPS = 3
STAIN_SIGMA_DEG, STAIN_ELEVATION_DEG = 8.0, 40.0
BOUND = 1.01  # radius of a sphere outside all harmonics and steps, in nominal radii


@dataclass(frozen=True)
class Surface:
    """Shape and paint of the dome as functions of the direction from the centre."""

    preset: Preset
    shape_terms: Array  # radial harmonics l = 2..4, as a polynomial in x, y, z
    panel_steps_m: Array  # (RINGS, GORES)
    paint_terms: Array  # harmonics l = 1..3 of the slow albedo variation, likewise

    @classmethod
    def build(cls, preset: Preset) -> "Surface":
        """The dome of a preset; it is the same in every session."""
        rng = np.random.default_rng(20110)
        steps = rng.uniform(-1, 1, (RINGS, GORES)) * preset.panel_step_m
        return cls(preset, _unit_sum(rng, range(2, 5)), steps, _unit_sum(rng, range(1, 4)))

    @property
    def half_angle(self) -> float:
        """Pole to rim [rad]."""
        return float(np.radians(self.preset.half_angle_deg))

    @property
    def lit_half_angle(self) -> float:
        """Pole to the edge of the blackout plates [rad]."""
        rim = np.cos(self.half_angle)
        return float(np.arccos(rim + self.preset.strip_share * (1 - rim)))

    def radius(self, direction: Array) -> Array:
        """Distance (...) [m] of the surface along unit directions (..., 3)."""
        radius = np.full(direction.shape[:-1], self.preset.radius_m)
        if self.preset.ovality:
            shape = _polynomial(direction, self.shape_terms, 4)
            radius *= 1 + self.preset.ovality * shape
        if self.preset.panel_step_m:
            ring, gore = self._panel(direction)
            radius += self.panel_steps_m[ring, gore]
        return radius

    def intersect(self, origin: Array, direction: Array) -> Array:
        """Points (..., 3) [m] where rays from inside meet the surface (fixed-point on the radius)."""
        if not (self.preset.ovality or self.preset.panel_step_m):
            return intersect_sphere(origin, direction, self.preset.radius_m)
        point = intersect_sphere(origin, direction, BOUND * self.preset.radius_m)
        for _ in range(SURFACE_STEPS):
            radius = self.radius(point / np.linalg.norm(point, axis=-1, keepdims=True))
            nearer = intersect_sphere(origin, direction, radius)
            # a ray that grazes a panel just behind its edge keeps the last finite point
            point = np.where(np.isfinite(nearer), nearer, point)
        return point

    def albedo(self, direction: Array) -> Array:
        """Diffuse reflectance (...) of the paint along unit directions; the paint is neutral."""
        preset = self.preset
        value = np.full(direction.shape[:-1], preset.albedo)
        if preset.albedo_smooth:
            slow = _polynomial(direction, self.paint_terms, 3)
            value *= 1 + preset.albedo_smooth * slow
        if preset.dust:
            value *= 1 - preset.dust * (1 - direction[..., 0]) / 2
        if preset.seam:
            distance = self._seam_distance_m(direction) / SEAM_SIGMA_M
            value *= 1 - preset.seam * np.exp(-0.5 * distance**2)
        return np.asarray(value * self._soiling(direction))

    def sees(self, origin: Array, points: Array) -> BoolArray:
        """Whether nothing is between an origin (3,) and points (..., 3): in a dome, everywhere."""
        return np.ones(points.shape[:-1], bool)

    def relative_albedo(self, other: Preset, points: Array) -> Array:
        """Albedo at points (..., 3) over that of another paint; they may differ in mean, dirt and stains."""
        direction = normalise(points)
        ratio = np.asarray(self.preset.albedo / other.albedo)
        mine, theirs = self.preset, other
        if (mine.dirt, mine.stains) == (theirs.dirt, theirs.stains):
            return ratio
        before = replace(self, preset=other)
        return np.asarray(ratio * (self._soiling(direction) / before._soiling(direction)))

    def _soiling(self, direction: Array) -> Array:
        """Share (...) of the albedo that dirt and stains leave along unit directions."""
        share = np.ones(direction.shape[:-1])
        for loss, azimuth_deg in self.preset.dirt:
            side = direction_from_angles(np.radians(azimuth_deg), 0.0)
            share *= 1 - loss * (1 + direction @ side) / 2
        for loss, azimuth_deg in self.preset.stains:
            centre = direction_from_angles(*np.radians([azimuth_deg, STAIN_ELEVATION_DEG]))
            distance = angle_between(direction, centre) / np.radians(STAIN_SIGMA_DEG)
            share *= 1 - loss * np.exp(-0.5 * distance**2)
        return share

    def _panel(self, direction: Array) -> tuple[IndexArray, IndexArray]:
        azimuth, elevation = angles_from_direction(direction)
        ring = np.clip((np.pi / 2 - elevation) / self.half_angle * RINGS, 0, RINGS - 1)
        gore = (azimuth / (2 * np.pi) % 1.0) * GORES
        return ring.astype(np.intp), np.minimum(gore.astype(np.intp), GORES - 1)

    def _seam_distance_m(self, direction: Array) -> Array:
        azimuth, elevation = angles_from_direction(direction)
        theta = np.pi / 2 - elevation
        gore_angle, ring_angle = 2 * np.pi / GORES, self.half_angle / RINGS
        across = np.abs((azimuth / gore_angle + 0.5) % 1.0 - 0.5) * gore_angle * np.sin(theta)
        along = np.abs((theta / ring_angle + 0.5) % 1.0 - 0.5) * ring_angle
        at_top = theta < ring_angle  # the crown is one round panel
        nearest = np.where(at_top, np.abs(theta - ring_angle), np.minimum(across, along))
        return np.asarray(nearest * self.preset.radius_m)


def _unit_sum(rng: np.random.Generator, degrees: range) -> Array:
    """A random sum of harmonics as a polynomial with a largest value of 1 on the upper hemisphere."""
    probe = rng.normal(size=(4000, 3))
    probe[:, 2] = np.abs(probe[:, 2])
    probe /= np.linalg.norm(probe, axis=1, keepdims=True)
    azimuth, elevation = angles_from_direction(probe)
    total = np.zeros(len(probe))
    for degree in degrees:
        for order in range(-degree, degree + 1):
            wave = sph_harm_y(degree, abs(order), np.pi / 2 - elevation, azimuth)
            total += rng.normal() * (wave.real if order >= 0 else wave.imag)
    # on the sphere a harmonic of degree l is a polynomial of degree l, so the fit is exact
    columns = np.stack([_monomial(probe, p) for p in _powers(max(degrees))], axis=1)
    terms = np.linalg.lstsq(columns, total / np.abs(total).max(), rcond=None)[0]
    return np.asarray(terms)


def _polynomial(direction: Array, terms: Array, degree: int) -> Array:
    total = np.zeros(direction.shape[:-1])
    for coefficient, power in zip(terms, _powers(degree), strict=True):
        total += coefficient * _monomial(direction, power)
    return total


def _powers(degree: int) -> list[tuple[int, int, int]]:
    """Monomials up to `degree`, z at most linear, because z^2 = 1 - x^2 - y^2."""
    return [
        (i, j, k)
        for k in (0, 1)
        for i in range(degree + 1)
        for j in range(degree + 1)
        if i + j + k <= degree
    ]


def _monomial(direction: Array, power: tuple[int, int, int]) -> Array:
    value = np.ones(direction.shape[:-1])
    for axis, exponent in enumerate(power):
        for _ in range(exponent):
            value = value * direction[..., axis]
    return value
