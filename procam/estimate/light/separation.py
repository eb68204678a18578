"""Direct and scattered light from code pictures, and what the dome does to light (science.md s.1-2).

A pixel inside a dark stripe, well clear of its edges, sees nothing but light that has bounced; so
does every pixel outside a projector's picture. Both are measured in every picture.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.maths.codes.gray import is_bright, stripe_edge_distance
from procam.maths.light.radiosity import albedo_from_feedback, floor_return
from procam.maths.warp import blur_within, grow
from procam.model.screen import Dome
from procam.model.transport import Measured

Array = NDArray[np.float64]
Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
CLEAR_PX = 3.0  # distance from a stripe's edge beyond which neither lens nor pixel mixes it in
HOLE_PX = 3  # widest gap between decoded pixels that is closed
CLEAR_CAMERA_PX = 6  # likewise from the border of a projector's picture
GLOBAL_BLUR_PX = 1.0
EXTEND_PX = 3.0
# of m: the border of the lit area errs alike for all projectors, so their spread does not show it;
# three times the bias that studies/photometry.md finds
BORDER_SIGMA = 1e-3


@dataclass(frozen=True, slots=True)
class SeparatedLight:
    """One projector's full white, split, in camera radiance [full scale/s].

    Attributes
    ----------
    direct, scattered : (H, W, 3); `direct` fades over the border of the picture.
    extended : (H, W, 3) direct light continued a little beyond the border.
    flux : (3,) direct flux, sum of solid angle times direct [radiance sr].
    weight : (H, W) statistical weight of `scattered`; 0 where it was filled in.
    lit : (H, W) the pixel sees this projector's picture.
    """

    direct: Image
    scattered: Image
    extended: Image
    flux: Array
    weight: Image
    lit: Mask


class Separation:
    """Folds one projector's pictures in as they come; memory does not grow with their number.

    Parameters
    ----------
    white : (H, W, 3) white minus black. projector_xy : (H, W, 2), NaN outside the panel.
    lit : (H, W) decoded pixels. solid_angle_sr : (H, W) of the camera pixels; 0 off the screen.
    """

    def __init__(self, white: Image, projector_xy: Image, lit: Mask, solid_angle_sr: Array) -> None:
        usable = np.isfinite(white).all(axis=-1)
        # pixels on an edge of the finest stripes do not decode; they are lit all the same
        lit = grow(grow(lit, HOLE_PX), -HOLE_PX)
        self._solid = np.where(usable, solid_angle_sr, 0).astype(np.float32)
        self._white_flux = self.total(white)
        self._xy = projector_xy
        self._index = np.rint(np.nan_to_num(projector_xy)).astype(np.int32)
        self._inside = grow(lit & usable, -2)
        self._outside = (self._solid > 0) & ~grow(lit, CLEAR_CAMERA_PX)
        self._sum, self._count = np.nan_to_num(white), np.ones(lit.shape, np.float32)
        self._shares = np.ones(lit.shape, np.float32)  # of white's scattered light in the sum
        self._dark_sum = np.where(self._outside[..., None], self._sum, 0)
        self._dark_weight = self._outside.astype(np.float32)

    def total(self, light: Image) -> Array:
        """Total light (C,) on the screen [radiance sr]; saturated pixels count as dark."""
        total = np.tensordot(self._solid, light, 2).astype(float)
        if not np.isfinite(total).all():
            total = np.tensordot(self._solid, np.nan_to_num(light), 2).astype(float)
        return total

    def flux_share(self, light: Image) -> Array:
        """Flux (3,) of a picture relative to white's: totals scale as direct fluxes do."""
        return self.total(light) / self._white_flux

    def add_pair(self, axis: str, bit: int, pattern: Image, inverse: Image) -> None:
        """Fold in a stripe picture and its inverse, (H, W, 3), black taken off."""
        which = 0 if axis == "x" else 1
        with np.errstate(invalid="ignore"):
            near_edge = stripe_edge_distance(self._xy[..., which], bit) <= CLEAR_PX
        # a media server draws edges as greys, and these do not add up to white
        sound = ~near_edge
        self._sum += np.where(sound[..., None], pattern + inverse, 0)
        self._count += sound
        self._shares += sound * np.float32((self.flux_share(pattern) + self.flux_share(inverse))[1])
        clear = self._inside & sound & np.isfinite(self._xy[..., which])
        bright = is_bright(self._index[..., which], bit)
        self._add_dark(pattern, (clear & ~bright) | self._outside)
        self._add_dark(inverse, (clear & bright) | self._outside)

    def _add_dark(self, light: Image, dark: Mask) -> None:
        share = self.flux_share(light)
        weight = share[1] ** 2  # one weight for all channels: their shares differ by little
        self._dark_sum += light * dark[..., None] * (weight / share).astype(np.float32)
        self._dark_weight += dark * np.float32(weight)

    def result(self) -> SeparatedLight:
        """The split, after all pairs."""
        on_screen = self._solid > 0
        known = (self._dark_weight > 0) & on_screen & np.isfinite(self._dark_sum).all(axis=-1)
        ratio = self._dark_sum / np.maximum(self._dark_weight, 1e-12)[..., None]
        scattered = blur_within(ratio, known, GLOBAL_BLUR_PX)
        missing = on_screen & (scattered[..., 1] <= 0)
        if missing.any():
            scattered[missing] = blur_within(ratio, known, 8 * GLOBAL_BLUR_PX)[missing]
        near = grow(self._inside, 2 + CLEAR_CAMERA_PX) & on_screen
        white = self._sum - self._shares[..., None] * scattered
        direct = np.where(near[..., None], white / self._count[..., None], 0).astype(np.float32)
        beyond = blur_within(direct, grow(self._inside, -1), EXTEND_PX)
        extended = np.where(grow(self._inside, -1)[..., None], direct, beyond)
        return SeparatedLight(
            direct,
            scattered,
            extended.astype(np.float32),
            self.total(direct),
            self._dark_weight,
            self._inside,
        )


def scatter_per_flux(
    lights: Sequence[SeparatedLight], strengths: Sequence[Image] | None = None
) -> Image:
    """U (H, W, C) [1/sr]: scattered radiance per direct flux, all projectors weighed together.

    `strengths` (H, W, C): by how much more than full white's a unit of flux of each projector brings
    to a pixel; None where all bring the same.
    """
    top = np.zeros_like(lights[0].scattered)
    bottom = np.zeros_like(top)
    for i, light in enumerate(lights):
        flux = light.flux.astype(np.float32) * (1 if strengths is None else strengths[i])
        weight = np.maximum(light.weight, 1e-3)[..., None]
        top += weight * flux * light.scattered
        bottom += weight * flux**2
    return np.asarray(top / bottom)


def feedback(
    lights: list[SeparatedLight],
    lit_sr: Array,
    on_screen_sr: Array,
    strengths: Sequence[Image],
    doubts: tuple[float, float],
) -> Measured:
    """M (C,) over lit solid angles (H, W) [sr], with sigma.

    Each projector measures m by itself. Their scatter tells what depends on where the light falls;
    an unknown veil of glare adds to every scattered sample alike (science.md s.2). `doubts`:
    sigma of that veil, and of the direct light of all projectors, relative.
    """
    glare_sigma, flux_sigma = doubts
    each = np.stack(
        [
            np.tensordot(lit_sr, x.scattered / s, 2) / x.flux
            for x, s in zip(lights, strengths, strict=True)
        ]
    )
    value = np.tensordot(lit_sr, scatter_per_flux(lights, strengths), 2)
    spread = each.std(axis=0, ddof=1) / np.sqrt(len(each)) if len(each) > 1 else 0.01 * value
    spread = np.hypot(spread, BORDER_SIGMA * value)
    mean_light = np.mean(
        [
            np.tensordot(on_screen_sr, light.direct + light.scattered, 2) / light.flux
            for light in lights
        ],
        axis=0,
    )
    veil = glare_sigma * mean_light * lit_sr.sum() / on_screen_sr.sum()
    return Measured(value, np.sqrt(spread**2 + veil**2 + (flux_sigma * value) ** 2))


def albedo(
    measured: Measured, lit_sr: float, screen_sr: float, dome: Dome, flux_doubt: float
) -> Measured:
    """Mean albedo (C,) from the feedback, with what is unknown of feedback and floor in its sigma.

    Assumes that the unlit part of the cap has the same paint (science.md s.1). `flux_doubt`: how much
    direct light the camera may have missed, relative; by gloss it misses some of all pictures.
    """

    def at(m: Array, floor: float) -> Array:
        returned = floor_return(dome.half_angle, dome.tilt, floor)
        return albedo_from_feedback(m, lit_sr, screen_sr, returned)

    value = at(measured.value, dome.floor_albedo)
    by_feedback = at(measured.value + measured.sigma, dome.floor_albedo) - value
    by_floor = at(measured.value, dome.floor_albedo + dome.floor_albedo_sigma) - value
    return Measured(value, np.sqrt(by_feedback**2 + by_floor**2 + (flux_doubt * value) ** 2))
