"""Scattered and ambient light of a venue state, relative to the calibration.

An audience changes how much light scatters, but hardly its distribution, which the calibration gives.
So a few pictures that light parts of the dome determine one ratio per channel: scattered light where
no direct light falls, over the prediction from u, the kernel and the picture's direct light. The
direct light is measured in the same pictures, so that neither an aged lamp nor another exposure
changes the ratio (docs/theory/photometry.md, "Venue states").
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, BoolArray, Image, Map
from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.light.scatter_kernel import BLACK_BLUR_PX, ScatterCells, cell_basis
from procam.estimate.light.separation import CLEAR_CAMERA_PX
from procam.maths.geometry.sphere import master_directions, master_pixels
from procam.maths.warp import blur_within, grow, sample
from procam.model.calibration import Calibration
from procam.model.transport import Measured

ROUNDS = 20  # of the fixed-point iteration for the ratio
TINY = 1e-9
# relative, of a change of the ratio: light scattered back right beside where it falls changes most, and
# no picture shows it; in traced rooms with other floors 4 to 8 % of the change is missed
UNSEEN_SIGMA = 0.1
# relative, of the ratio if the calibration's own pictures are gone: residual of its u and kernel
KERNEL_SIGMA = 0.03
# a lit part ends at half of the 5 % quantile of its expected light
BORDER_LEVEL, BORDER_QUANTILE = 0.5, 0.05
GREEN = 1


@dataclass(frozen=True, slots=True)
class ZoneObservation:
    """A photograph of a picture that lights a part of the dome, averaged over cells.

    Attributes
    ----------
    scattered : (N, C) mean where scattered light is seen alone, else NaN.
    flux : (N, C) all light on and near the lit part [rel sr]. near_sr : (N,) its solid angle.
    """

    scattered: Array
    flux: Array
    near_sr: Array

    def moment(self, channel: int, phi: Array, spread: Array) -> Array:
        """Moments (K,) of the direct light; scattered light is `spread` (N, K) times them."""
        scattered = phi.T @ (self.near_sr[:, None] * spread)
        direct = np.linalg.solve(np.eye(len(scattered)) + scattered, phi.T @ self.flux[:, channel])
        return np.asarray(direct, float)


class AudienceView:
    """A calibrated dome, seen by its main camera; `view` excludes manual masks."""

    def __init__(self, calibration: Calibration, view: ScreenView) -> None:
        maps = calibration.maps
        self.calibration, self.view = calibration, view
        self._cells = ScatterCells(view.direction, view.weight)
        places = master_pixels(np.nan_to_num(view.direction), maps.size)
        u, _ = self._cells.mean(sample(maps.scatter_per_flux, places), view.on_screen)
        self._u = np.nan_to_num(u)
        self._covered = sample(maps.coverage, places)
        self._lit_sr = self._summed(self._covered)

    def expected(self, projector: str, picture: Image) -> Image:
        """See `expected_light`."""
        return expected_light(self.calibration, self.view, projector, picture)

    def ambient(self, light: Image) -> tuple[Map, Array]:
        """Ambient light (N, N, 3) on the dome master, and its mean (3,) over the lit part [rel].

        `light` (H, W, 3) is a photograph with all projectors shuttered, NaN where saturated. Places
        that the camera does not see get 0.
        """
        maps = self.calibration.maps
        known = self.view.on_screen & np.isfinite(light).all(axis=-1)
        smooth = blur_within(np.nan_to_num(light), known, BLACK_BLUR_PX)
        direction, inside = master_directions(maps.size)
        where = self.view.camera_pixels(self.calibration.screen, direction)
        level = np.maximum(sample(smooth, where), 0) * inside[..., None]
        lit_sr = self._covered * self.view.weight * known
        mean = np.tensordot(lit_sr, np.nan_to_num(light), 2) / lit_sr.sum()
        return level.astype(np.float32), np.maximum(mean, 0)

    def observe(self, light: Image, lit: BoolArray) -> ZoneObservation:
        """Observation from a photograph (H, W, 3), black subtracted [rel], NaN where saturated.

        `lit` (H, W) is where the direct light falls, from `expected`.
        """
        near = grow(lit, CLEAR_CAMERA_PX) & self.view.on_screen
        dark = self.view.on_screen & ~near
        seen = self._cells.scatter_sample(light, dark, np.where(near[..., None], light, 0))
        return ZoneObservation(seen.scattered, seen.direct, self._summed(near.astype(np.float32)))

    def scatter_ratio(
        self, observations: Sequence[ZoneObservation], calibrated: Sequence[ZoneObservation] = ()
    ) -> Measured:
        """Scattered light per direct light, over that of the calibration (3,).

        Parameters
        ----------
        observations : of two pictures or more.
        calibrated : of the same pictures in the calibration's session, if they are still there; the
            errors of u and kernel then cancel.

        Notes
        -----
        Every place of the lit dome has the same weight, however many pictures leave it dark. The
        standard error is a jackknife over the pictures, plus `UNSEEN_SIGMA` and `KERNEL_SIGMA`.
        """

        def found(at: list[int]) -> Array:
            before = self._ratios([calibrated[i] for i in at]) if calibrated else np.ones(3)
            return self._ratios([observations[i] for i in at]) / before

        every = list(range(len(observations)))
        ratio, without = found(every), [found([j for j in every if j != i]) for i in every]
        jackknife = np.std(without, axis=0) * np.sqrt(len(every) - 1)
        kernel = 0.0 if calibrated else KERNEL_SIGMA
        return Measured(
            ratio, np.sqrt(jackknife**2 + (UNSEEN_SIGMA * (ratio - 1)) ** 2 + (kernel * ratio) ** 2)
        )

    def _ratios(self, observations: Sequence[ZoneObservation]) -> Array:
        """Ratio (C,) of scattered light to its prediction by the calibration's u and kernel."""
        return np.array([self._ratio(c, observations) for c in range(self._u.shape[1])])

    def _ratio(self, channel: int, observations: Sequence[ZoneObservation]) -> float:
        """Ratio of one channel, by fixed-point iteration.

        The direct light is what is seen of the lit part less the scattered light there, which depends
        on the ratio.
        """
        kernel, u = self.calibration.maps.kernel, self._u[:, channel]
        phi = cell_basis()[:, : kernel.profile.shape[1]]
        spread = (u / (phi @ kernel.profile[channel]))[:, None] * (phi @ kernel.matrix[channel])
        seen = np.stack([each.scattered[:, channel] for each in observations])
        known = np.isfinite(seen)
        measured = np.where(known, seen, 0).sum(axis=0)
        weight = self._lit_sr * u * known.any(axis=0)
        ratio = 1.0
        for _ in range(ROUNDS):
            moments = [each.moment(channel, phi, ratio * spread) for each in observations]
            expected = (known * (np.array(moments) @ spread.T)).sum(axis=0)
            ratios = measured / np.where(weight > 0, expected, 1)
            following = float(weight @ ratios / weight.sum())
            if abs(following - ratio) < TINY:
                break
            ratio = following
        return following

    def _summed(self, share: Image) -> Array:
        """Solid angle (N,) of a share (H, W) of the pixels, summed over cells [sr]."""
        nothing = np.zeros(share.shape, bool)
        return self._cells.scatter_sample(share[..., None], nothing, share[..., None]).direct[:, 0]


def expected_light(
    calibration: Calibration, view: ScreenView, projector: str, picture: Image
) -> Image:
    """Where the direct light of a projector's picture (H, W, 1) 0..1 falls: (H, W) [rel], green.

    Response and blur are ignored, so the levels are approximate.
    """
    known = calibration.projectors[projector]
    gain = known.photometry.gain[..., GREEN] * known.surface.valid * picture[..., 0]
    xy = view.projector_pixels(known.model, calibration.screen)
    return sample(gain, xy) * view.on_screen


def centre_shift(light: Image, expected: Image, usable: BoolArray) -> float:
    """Distance [px] between the centroids of the lit pixels and of the expected ones; NaN without light.

    `light`, `expected` (H, W) are of one channel. Both are thresholded below nearly all lit pixels: a
    higher threshold would follow the falloff of the light instead of its border.
    """
    inside = usable & (expected > 0)
    threshold = BORDER_LEVEL * np.quantile(expected[inside], BORDER_QUANTILE)
    bright = np.nan_to_num(light, nan=np.inf)
    bright = bright - np.median(bright[usable & ~inside])  # the scattered light
    scale = float(np.median(bright[inside] / expected[inside]))
    lit = usable & (bright > scale * threshold)
    if not scale > 0 or not lit.any():
        return float("nan")
    return float(np.hypot(*(_centroid(lit) - _centroid(inside & (expected > threshold)))))


def audience_feedback(calibration: Calibration, ratio: Measured) -> Measured:
    """Feedback m (3,) in a state with `ratio` times the calibration's scattered light."""
    m = calibration.feedback
    sigma = np.hypot(ratio.value * m.sigma, m.value * ratio.sigma)
    return Measured(ratio.value * m.value, sigma)


def _centroid(mask: BoolArray) -> Array:
    return np.array([np.mean(index) for index in np.nonzero(mask)])
