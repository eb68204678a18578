"""What an audience and a show's own lamps change about a calibrated dome (science.md s.4).

The calibration knows how bounced light spreads; a few pictures tell by how much there is more or less
of it now. Direct light is read off the same pictures, so that neither a lamp that has aged nor
another exposure counts as bounced light.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.estimate.geometry.camera_view import DomeView
from procam.estimate.geometry.screen_points import round_shape, screen_points
from procam.estimate.light.scatter_kernel import BLACK_BLUR_PX, ScatterCells, cell_basis
from procam.estimate.light.separation import CLEAR_CAMERA_PX
from procam.maths.geometry.lenses import project
from procam.maths.geometry.sphere import master_directions, master_pixels
from procam.maths.warp import blur_within, grow, sample
from procam.model.calibration import Calibration
from procam.model.transport import Map, Measured

Array = NDArray[np.float64]
Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
ROUNDS = 20
TINY = 1e-9
# of a change of the ratio: what bounces back right beside where light falls changes most, and no
# picture shows it; traced rooms of other floors miss 4 to 8 % of it
UNSEEN = 0.1
# of the ratio, where the calibration's own pictures are gone: what its u and kernel leave of them
KERNEL = 0.03
HALF, DIMMEST = 0.5, 0.05  # a lit part ends where half of its dimmest twentieth is left
GREEN = 1


@dataclass(frozen=True, slots=True)
class ZoneObservation:
    """A picture that lights a part of the dome, in cells of it.

    `scattered` (N, C) mean where nothing but bounced light is seen, else NaN; `flux` (N, C) of all light
    on and near what is lit [rel sr], `near_sr` (N,) how much of each cell that is.
    """

    scattered: Array
    flux: Array
    near_sr: Array

    def moment(self, channel: int, phi: Array, spread: Array) -> Array:
        """Moments (K,) of the direct light, where bounced light is `spread` (N, K) times them."""
        fed = phi.T @ (self.near_sr[:, None] * spread)
        direct = np.linalg.solve(np.eye(len(fed)) + fed, phi.T @ self.flux[:, channel])
        return np.asarray(direct, float)


class AudienceView:
    """A calibrated dome through its main camera.

    `view` is without what a person has masked.
    """

    def __init__(self, calibration: Calibration, view: DomeView) -> None:
        maps = calibration.maps
        self.calibration, self.view = calibration, view
        self._cells = ScatterCells(view.direction, view.solid_angle_sr)
        places = master_pixels(np.nan_to_num(view.direction), maps.size)
        u, _ = self._cells.mean(sample(maps.scatter_per_flux, places), view.on_screen)
        self._u = np.nan_to_num(u)
        self._covered = sample(maps.coverage, places)
        self._lit_sr = self._summed(self._covered)

    def expected(self, projector: str, picture: Image) -> Image:
        """Direct green light (H, W) [rel] of a projector's picture (H, W, 1) 0..1, roughly.

        Without response and smear: it tells where the light falls, not how much it is.
        """
        known = self.calibration.projectors[projector]
        gain = known.photometry.gain[..., GREEN] * known.surface.valid * picture[..., 0]
        xy = self.view.projector_pixels(known.model, self.calibration.screen)
        return sample(gain, xy) * self.view.on_screen

    def ambient(self, light: Image) -> tuple[Map, Array]:
        """The room's own light (N, N, 3) on the dome master, and its mean (3,) over what is lit [rel].

        `light` (H, W, 3) is a photograph without any projector, NaN where saturated. Places that the
        camera does not see have none.
        """
        maps, camera = self.calibration.maps, self.view.camera
        known = self.view.on_screen & np.isfinite(light).all(axis=-1)
        smooth = blur_within(np.nan_to_num(light), known, BLACK_BLUR_PX)
        direction, inside = master_directions(maps.size)
        assert camera.camera_from_dome is not None
        points = screen_points(round_shape(self.calibration.screen), direction)
        where = project(camera.camera_from_dome.apply(points), camera.lens)
        level = np.maximum(sample(smooth, where), 0) * inside[..., None]
        lit_sr = self._covered * self.view.solid_angle_sr * known
        mean = np.tensordot(lit_sr, np.nan_to_num(light), 2) / lit_sr.sum()
        return level.astype(np.float32), np.maximum(mean, 0)

    def observe(self, light: Image, lit: Mask) -> ZoneObservation:
        """A photograph (H, W, 3) without black [rel], NaN where saturated, of a picture.

        `lit` (H, W) is where the calibration expects its direct light.
        """
        near = grow(lit, CLEAR_CAMERA_PX) & self.view.on_screen
        dark = self.view.on_screen & ~near
        seen = self._cells.scatter_sample(light, dark, np.where(near[..., None], light, 0))
        return ZoneObservation(seen.scattered, seen.direct, self._summed(near.astype(np.float32)))

    def scatter_ratio(
        self, looks: Sequence[ZoneObservation], calibrated: Sequence[ZoneObservation] = ()
    ) -> Measured:
        """Bounced light per direct light, over the calibration's (3,), from two pictures or more.

        Light where nothing but bounces is seen, over what the calibration's u and kernel make of the
        direct light where it falls; each place of the lit dome counts alike, however many pictures
        leave it dark. `calibrated` are the same pictures as the calibration was made of: what u and
        kernel leave of both cancels. The sigma is told by how much single pictures sway the result,
        and by how much of the change may be where no picture shows it.
        """

        def found(at: list[int]) -> Array:
            then = self._ratios([calibrated[i] for i in at]) if calibrated else np.ones(3)
            return self._ratios([looks[i] for i in at]) / then

        every = list(range(len(looks)))
        ratio, without = found(every), [found([j for j in every if j != i]) for i in every]
        spread = np.std(without, axis=0) * np.sqrt(len(every) - 1)  # the jackknife's
        kernel = 0.0 if calibrated else KERNEL
        return Measured(
            ratio, np.sqrt(spread**2 + (UNSEEN * (ratio - 1)) ** 2 + (kernel * ratio) ** 2)
        )

    def _ratios(self, looks: Sequence[ZoneObservation]) -> Array:
        """Ratio (C,) to what the calibration's u and kernel predict."""
        return np.array([self._ratio(c, looks) for c in range(self._u.shape[1])])

    def _ratio(self, channel: int, looks: Sequence[ZoneObservation]) -> float:
        """Ratio of one channel.

        Where direct light falls, what bounced there has to come off it, and that hangs on the ratio:
        solved in turn.
        """
        kernel, u = self.calibration.maps.kernel, self._u[:, channel]
        phi = cell_basis()[:, : kernel.profile.shape[1]]
        paint = u / (phi @ kernel.profile[channel])
        spread = paint[:, None] * (phi @ kernel.matrix[channel])
        seen = np.stack([look.scattered[:, channel] for look in looks])
        known = np.isfinite(seen)
        measured = np.where(known, seen, 0).sum(axis=0)
        weight = self._lit_sr * u * known.any(axis=0)
        ratio = 1.0
        for _ in range(ROUNDS):
            moments = [look.moment(channel, phi, ratio * spread) for look in looks]
            expected = (known * (np.array(moments) @ spread.T)).sum(axis=0)
            each = measured / np.where(weight > 0, expected, 1)
            following = float(weight @ each / weight.sum())
            if abs(following - ratio) < TINY:
                break
            ratio = following
        return following

    def _summed(self, share: Image) -> Array:
        """Solid angle (N,) of cells that a share (H, W) of pixels takes [sr]."""
        nothing = np.zeros(share.shape, bool)
        return self._cells.scatter_sample(share[..., None], nothing, share[..., None]).direct[:, 0]


def centre_shift(light: Image, expected: Image, usable: Mask) -> float:
    """How far [px] the middle of lit pixels is from where it should be; NaN if there is no light.

    `light`, `expected` (H, W) of one channel; both are cut at a level below nearly all that is lit, for
    a level within would follow the fall-off rather than the border.
    """
    inside = usable & (expected > 0)
    cut = HALF * np.quantile(expected[inside], DIMMEST)
    bright = np.nan_to_num(light, nan=np.inf)
    bright = bright - np.median(bright[usable & ~inside])  # what has bounced
    scale = float(np.median(bright[inside] / expected[inside]))
    lit = usable & (bright > scale * cut)
    if not scale > 0 or not lit.any():
        return float("nan")
    return float(np.hypot(*(_middle(lit) - _middle(inside & (expected > cut)))))


def audience_feedback(calibration: Calibration, ratio: Measured) -> Measured:
    """M (3,) in a state whose bounced light is `ratio` times the calibration's."""
    m = calibration.feedback
    sigma = np.hypot(ratio.value * m.sigma, m.value * ratio.sigma)
    return Measured(ratio.value * m.value, sigma)


def _middle(mask: Mask) -> Array:
    return np.array([np.mean(index) for index in np.nonzero(mask)])
