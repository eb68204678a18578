"""Contrast and white to expect of a dome, planned or calibrated (docs/theory/interreflection.md).

A dome that is not built yet gets the calibration that it would have, so that its pictures are
compensated by the very code that compensates real ones. The file is longer than 300 lines because the
planned and the calibrated dome share every figure below.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import Array, BoolArray, Image
from procam.compensate.compensator import Compensator
from procam.errors import InputError
from procam.maths.geometry.sphere import (
    cap_solid_angle,
    master_directions,
    master_pixels,
    master_solid_angles,
)
from procam.maths.light.box_solver import solve_moments
from procam.maths.light.radiosity import add_interreflection, floor_return, sphere_scatter
from procam.maths.warp import sample
from procam.model.calibration import Calibration
from procam.model.screen import Dome
from procam.model.transport import Measured, ScreenMaps
from procam.workflows.judged_picture import LUMINANCE, Judged, PictureFigures, Seen, figures_of

SAMPLES = 512  # edge of the pictures that are judged [px]: 0.35 degrees


@dataclass(frozen=True, slots=True)
class PlannedDome:
    """A dome that is not built yet.

    Attributes
    ----------
    screen : its shape and floor; of the radius nothing here depends.
    albedo, albedo_sigma : of the paint, with its standard error.
    coverage, reflecting : shares of the cap that projectors light, and that reflect at all. What is
        not lit lies at the rim.
    contrast : full white to full black of the projectors themselves.
    """

    screen: Dome
    albedo: float
    albedo_sigma: float
    coverage: float
    reflecting: float
    contrast: float

    def __post_init__(self) -> None:
        if not 0 < self.albedo < 1:
            raise InputError(
                f"albedo: {self.albedo:g} is not between 0 and 1; dome paints have 0.3 to 0.8"
            )
        if not 0 <= self.albedo_sigma < min(self.albedo, 1 - self.albedo) / 1.96:
            raise InputError(
                f"albedo sigma: {self.albedo_sigma:g} must be 0 or more, and small enough that "
                f"{self.albedo:g} +- 1.96 sigma stays between 0 and 1"
            )
        if not 0 < self.reflecting <= 1:
            raise InputError(
                f"reflecting: {self.reflecting:g} is no share of the cap; it must be above 0 and at "
                "most 1"
            )
        if not 0 < self.coverage <= self.reflecting:
            raise InputError(
                f"coverage: {self.coverage:g} must be above 0 and at most {self.reflecting:g}, "
                "the share of the cap that reflects"
            )
        if not 1 < self.contrast:
            raise InputError(
                f"contrast: {self.contrast:g} must be above 1, such as 2000 for 2000:1"
            )
        if not 0 < self.screen.half_angle <= np.pi / 2 + 1e-9:
            raise InputError(
                f"half angle: {np.degrees(self.screen.half_angle):g} degrees must be above 0 and at "
                "most 90"
            )
        if not 0 <= self.screen.floor_albedo <= 1:
            raise InputError(f"floor albedo: {self.screen.floor_albedo:g} must be between 0 and 1")

    @property
    def lit_sr(self) -> float:
        """Solid angle that projectors light [sr]."""
        return self.coverage * cap_solid_angle(self.screen.half_angle)

    def feedback(self, albedo: float) -> float:
        """Light that all bounces add to the lit part's own [-], for one albedo."""
        cap_sr = cap_solid_angle(self.screen.half_angle)
        unlit_sr = self.reflecting * cap_sr - self.lit_sr
        patches = np.array([self.lit_sr, unlit_sr, cap_sr - unlit_sr - self.lit_sr])
        screen = self.screen
        returned = floor_return(screen.half_angle, screen.tilt, screen.floor_albedo)
        paint = np.array([[albedo], [albedo], [0.0]])
        return float(sphere_scatter(paint, patches, returned)[0, 0] * self.lit_sr)

    def calibration(self, albedo: float, size: int) -> Calibration:
        """A calibration with these properties, with maps of `size` pixels, and no device in it."""
        direction, _ = master_directions(size)
        rim = 2 * np.arcsin(np.sqrt(self.coverage) * np.sin(self.screen.half_angle / 2))
        solid = master_solid_angles(size)
        coverage = ((solid > 0) & (direction[..., 2] >= np.cos(rim))).astype(np.float32)
        feedback = self.feedback(albedo)
        scatter = feedback / float((solid * coverage).sum())
        flat = np.ones((size, size, 3), np.float32)
        lit = coverage[..., None] * flat
        maps = ScreenMaps(scatter * flat, albedo * flat, lit / self.contrast, lit, coverage)
        m, paint = (Measured(np.full(3, v), np.zeros(3)) for v in (feedback, albedo))
        return Calibration(self.screen, {}, {}, maps, m, paint, np.eye(3))


@dataclass(frozen=True, slots=True)
class Prospect:
    """A dome at the low end, the middle and the high end of what is known of its paint.

    Attributes
    ----------
    ends : its calibration at each of the three.
    lit_sr : solid angle that projectors light [sr].
    """

    ends: tuple[Calibration, Calibration, Calibration]
    lit_sr: float


@dataclass(frozen=True, slots=True)
class Band:
    """A figure, with its least and largest value between the ends of what is known."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Levels:
    """White, black and contrast of a dome; light in units of the caller's choice.

    Attributes
    ----------
    feedback : m [-]. scattered_share : of the light of today's full white.
    white_before, white_after : of a full white picture, without and with compensation.
    black : of a black picture, its own bounces included; compensation cannot change it.
    on_off_before, on_off_after : white to black of whole pictures.
    checkerboard_scatter : of a half-white picture, were the projectors' black nothing: one figure,
        because compensation leaves it as it is.
    checkerboard_before, checkerboard_after : with the projectors' black.
    """

    feedback: float
    scattered_share: float
    white_before: float
    white_after: float
    black: float
    on_off_before: float
    on_off_after: float
    checkerboard_scatter: float
    checkerboard_before: float
    checkerboard_after: float


def planned(dome: PlannedDome, size: int = SAMPLES) -> Prospect:
    """The prospect of a planned dome, with the 95 % interval of its albedo."""
    step = 1.96 * dome.albedo_sigma
    low, middle, high = (dome.calibration(dome.albedo + s, size) for s in (-step, 0.0, step))
    return Prospect((low, middle, high), dome.lit_sr)


def measured(calibration: Calibration) -> Prospect:
    """The prospect of a calibrated dome, with the 95 % intervals of feedback and albedo."""
    feedback, albedo = calibration.feedback, calibration.albedo
    (m_low, m_high), (a_low, a_high) = feedback.interval(), albedo.interval()

    def at(m: Array, paint: Array) -> Calibration:
        factor = np.maximum(m, 0) / feedback.value
        maps = calibration.maps
        scatter = (maps.scatter_per_flux * factor).astype(np.float32)
        return replace(
            calibration,
            maps=replace(maps, scatter_per_flux=scatter),
            feedback=Measured(factor * feedback.value, feedback.sigma),
            albedo=Measured(paint, albedo.sigma),
        )

    lit_sr = float((master_solid_angles(calibration.maps.size) * calibration.maps.coverage).sum())
    return Prospect((at(m_low, a_low), calibration, at(m_high, a_high)), lit_sr)


def white_luminance(lumens: float, radius_m: float, lit_sr: float, albedo: float) -> float:
    """Luminance [cd/m2] of a matte screen's first bounce, if all lumens fall on what is lit.

    L = rho E / pi with E = lumens / (r^2 a_L).

    >>> round(white_luminance(4000 * np.pi**2, 2.0, np.pi, 0.5), 9)
    500.0
    """
    return albedo * lumens / (np.pi * radius_m**2 * lit_sr)


def light_levels(
    calibration: Calibration, reference: float = 1.0, state: str | None = None
) -> Levels:
    """White, black and contrast; `reference` is the light of a direct white of 1.0.

    `state` names a venue state; the light of its own lamps counts as white, and as black.
    """
    known = calibration if state is None else calibration.state(state)
    m, ambient = float(LUMINANCE @ known.feedback.value), ambient_level(calibration, state)
    black = black_level(calibration)
    total, white = black * (1 + m) + ambient, 1 + m + ambient
    return Levels(
        m,
        m / white,
        reference * white,
        reference,
        reference * total,
        ratio(white, total),
        ratio(1.0, total),
        checkerboard_contrast(m, 0.0),
        checkerboard_contrast(m, black, ambient=ambient),
        checkerboard_contrast(m, black, compensated=True, ambient=ambient),
    )


def black_level(calibration: Calibration) -> float:
    """Mean direct luminance of black over what is lit [rel]."""
    return _lit_mean(calibration.maps, calibration.maps.lo)


def ambient_level(calibration: Calibration, state: str | None) -> float:
    """Mean luminance of the room's own light over what is lit [rel]; 0 as it was calibrated."""
    light = None if state is None else calibration.state(state).ambient
    return 0.0 if light is None else _lit_mean(calibration.maps, light)


def _lit_mean(maps: ScreenMaps, light: Image) -> float:
    """Mean luminance over what is lit."""
    solid = master_solid_angles(maps.size) * maps.coverage
    return float(LUMINANCE @ np.tensordot(solid, light, 2) / solid.sum())


def checkerboard_contrast(
    feedback: float,
    black: float,
    white_share: float = 0.5,
    compensated: bool = False,
    ambient: float = 0.0,
) -> float:
    """White to black [-] of a picture that holds nothing else, with a share p of white.

    Without black C = (1 + m p) / (m p), which is (1 - rho f_R (1-p)) / (rho f_R p) where all that
    reflects is lit (docs/theory/interreflection.md (I18)). Compensation dims the white and the light that it
    scatters on the black by one factor: C stays. A `black` [rel to direct white] is not dimmed with
    them, nor is `ambient`, light of the room's own, so that C then falls a little.
    """
    wanted, area = np.array([1.0, 0.0]), np.array([white_share, 1 - white_share])
    scatter, lo, hi = np.full(2, feedback), np.full(2, black), np.ones(2)
    if compensated:
        target = wanted - ambient
        flux = solve_moments(target, scatter[:, None], area[:, None], lo, hi)
        wanted = target - scatter * flux
    direct = np.clip(wanted, lo, hi)
    total = add_interreflection(direct[:, None], scatter[:, None], area)[:, 0] + ambient
    return ratio(float(total[0]), float(total[1]))


def picture_figures(
    calibration: Calibration, content: Image, state: str | None = None
) -> tuple[PictureFigures, Seen]:
    """What is expected of linear light (N, N, 3) on the calibration's canvas, in a venue state if named."""
    size = content.shape[0]
    compensator = Compensator(calibration, size, state=state)
    exact = compensator.predict(content)
    none = Compensator(calibration, size, "none", state).predict(content)
    content = compensator.target(content)
    lit, black = _covered(calibration, size), black_level(calibration)
    free = ~compensator.protected
    weight = calibration.canvas.weights(size)
    return figures_of(content, none.observed, exact, Judged(lit, free, weight, black))


def sampled(picture: Image, width: int = SAMPLES, height: int | None = None) -> Image:
    """Every so many-th pixel of a picture (H, W, 3), as (height, width, 3); square if no height is given.

    Values stay what they are: means would hide small lights and shadows that clip.
    """
    rows, columns = (
        ((np.arange(count) + 0.5) * (length / count)).astype(int)
        for length, count in zip(picture.shape, (height or width, width), strict=False)
    )
    return picture[np.ix_(rows, columns)]


def band(values: Sequence[float], counts: int = 1) -> Band:
    """The figure of (low end, middle, high end); the middle counts."""
    return Band(values[counts], min(values), max(values))


def _covered(calibration: Calibration, size: int) -> BoolArray:
    """Pixels (N, N) of a picture that are lit for the most part: limits at the rim are guesses."""
    maps, (direction, inside) = calibration.maps, calibration.canvas.directions(size)
    return np.asarray(inside & (sample(maps.coverage, master_pixels(direction, maps.size)) > 0.5))


def ratio(top: float, bottom: float) -> float:
    """A contrast; infinite over nothing."""
    return top / bottom if bottom > 0 else float("inf")
