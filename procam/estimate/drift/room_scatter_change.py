"""Change of the scattered light of a room, from photographs of full white, by its form factors."""

from collections.abc import Sequence

import numpy as np

from procam.arrays import Array, BoolArray, Image
from procam.estimate.drift.pictures import VenuePhotographs
from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.light.audience import GREEN, UNSEEN_SIGMA, expected_light
from procam.estimate.light.room_view import RoomView
from procam.estimate.light.separation import CLEAR_CAMERA_PX
from procam.maths.mesh.bounces import settled_by
from procam.maths.warp import grow, sample
from procam.model.calibration import Calibration
from procam.model.screen import RoomScreen
from procam.model.transport import Measured

FEWEST = 2  # projectors: one gives no estimate of its own error
LEAST_DARK = 0.05  # of the lit parts that the camera sees
ROUNDS, SAME = 20, 1e-4  # of the iteration for the ratio
TOLERANCE = 1e-4  # of the brightest irradiance


def room_scatter_ratio(
    calibration: Calibration, before: VenuePhotographs, now: VenuePhotographs, names: Sequence[str]
) -> Measured | None:
    """Scattered light per direct light over that of before (3,), by the whites of some projectors.

    None if it is seen beside the direct light of fewer than `FEWEST`.
    """
    old, new = (_seen_factors(calibration, each, names) for each in (before, now))
    ratio = new / old
    ratio = ratio[np.isfinite(ratio).all(axis=1)]
    if len(ratio) < FEWEST:
        return None
    value, spread = ratio.mean(axis=0), ratio.std(axis=0, ddof=1) / np.sqrt(len(ratio))
    return Measured(value, np.hypot(spread, UNSEEN_SIGMA * (value - 1)))


def content_light(calibration: Calibration, image: Image) -> Image:
    """Content light (H, W, 3) of radiance (H, W, 3)."""
    return np.asarray(image @ calibration.content_from_camera.T.astype(np.float32), np.float32)


def _seen_factors(
    calibration: Calibration, photographs: VenuePhotographs, names: Sequence[str]
) -> Array:
    """Scattered light over that of the calibration (N, 3), of each projector's white."""
    scattering = RoomScattering(calibration, photographs.view)
    whites = {n: content_light(calibration, photographs.projectors[n].white) for n in names}
    return np.array([scattering.factor(name, white) for name, white in whites.items()])


class RoomScattering:
    """A calibrated room, seen by its main camera."""

    def __init__(self, calibration: Calibration, view: ScreenView) -> None:
        screen, maps = calibration.screen, calibration.maps
        assert isinstance(screen, RoomScreen)
        self._calibration, self._view, self._room = calibration, view, RoomView(screen, view)
        places = screen.canvas.pixels(np.nan_to_num(view.direction), maps.size)
        self._paint = sample(maps.albedo, places)
        self._albedo = screen.face_albedo(screen.canvas.raster(maps.size).mean(maps.albedo))
        self._factors = screen.factors

    def factor(self, name: str, light: Image) -> Array:
        """Scattered light over that of the calibration (3,), in a projector's white (H, W, 3) without black.

        It is seen alone where no direct light falls; NaN if that is hardly anywhere.
        """
        height, width = self._calibration.projectors[name].model.size[::-1]
        picture = np.ones((height, width, 1), np.float32)
        lit = expected_light(self._calibration, self._view, name, picture) > 0
        finite, near = np.isfinite(light).all(axis=-1), grow(lit, CLEAR_CAMERA_PX)
        on_canvas = self._paint[..., GREEN] > 0
        canvas = self._view.weight * (self._view.on_screen & on_canvas & finite)
        weight = canvas * ~near
        if weight.sum() < LEAST_DARK * canvas.sum():
            return np.full(3, np.nan)
        direct = np.where((near & self._view.on_screen)[..., None], np.nan_to_num(light), 0)
        seen, found = np.tensordot(weight, np.nan_to_num(light), 2), np.ones(3)
        for _ in range(ROUNDS):
            last = found
            expected = np.tensordot(weight, self._scattered(direct, near, last), 2)
            found = seen / np.maximum(expected, 1e-30)
            if np.abs(found - last).max() < SAME:
                break
        return np.asarray(found)

    def _scattered(self, light: Image, near: BoolArray, factor: Array) -> Image:
        """Scattered light (H, W, 3) by the calibration, of a picture that is known at `near` places."""

        def direct(irradiance: Array) -> Array:
            scattered = factor * self._of(irradiance)
            return self._room.mean(np.where(near[..., None], light - scattered, 0))

        return self._of(settled_by(self._factors, self._albedo, direct, TOLERANCE))

    def _of(self, irradiance: Array) -> Image:
        return np.asarray(self._paint * self._room.at_pixels(irradiance))
