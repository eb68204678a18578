"""Scatter, feedback and albedo of a room, from the light of all projectors in content channels.

Direct light D and scattered light G of a camera's picture are both light that leaves a matte wall. All of it
arrives at the walls again: E = F (D + G), F the form factors, and G = rho E. So the albedo is G / E, place by
place, and nothing has to be fitted. Parts that no camera sees and no projector lights have the albedo that
venue.toml states.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, BoolArray, Image
from procam.errors import OutOfModelRange
from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.light.room_view import RoomView
from procam.estimate.light.separation import SeparatedLight
from procam.maths.mesh.bounces import settled
from procam.maths.warp import local_median, sample
from procam.model.screen import RoomScreen
from procam.model.transport import Measured

BRIGHTEST = 0.98  # albedo
SEEN_OF_LIT = 0.5  # of the area of lit parts that the camera must see
# relative, of the albedo: stripes are not uniform within a face, which matters beside another wall; 0.6 %
# for panels of 640 px (docs/decisions/light.md)
MODEL_SIGMA = 0.007
OTHERS_SIGMA = 0.05  # relative, of the albedo of a part that is not lit
SINGLE_SIGMA = 0.01  # relative, of the albedo from one projector alone


@dataclass(frozen=True, slots=True)
class RoomScatter:
    """Scatter, feedback and albedo of a room.

    Attributes
    ----------
    per_flux, albedo_map : (H, W, 3) on the canvas: scattered light per direct flux of full white [1/m^2], and
        the albedo [-].
    screen : the room, whose parts that are not lit have the albedo that was measured, as far as it was.
    feedback, albedo : m of full white, and the mean albedo of the lit parts.
    """

    per_flux: Image
    albedo_map: Image
    screen: RoomScreen
    feedback: Measured
    albedo: Measured


def measure_room(
    screen: RoomScreen,
    view: ScreenView,
    lights: Collection[SeparatedLight],
    hi: Array,
    coverage: Image,
) -> RoomScatter:
    """Estimate scatter, feedback and albedo.

    Parameters
    ----------
    screen, view : the room, and the main camera's view of it.
    lights : white of each projector. hi, coverage : (H, W, C) direct light of full white, and what is lit of
        each pixel, on the canvas.

    Raises
    ------
    OutOfModelRange
        If the camera sees too little of the lit parts.
    """
    factors, seen = screen.factors, RoomView(screen, view)
    lit = np.isin(np.arange(len(factors.area)), screen.canvas.lit_faces)
    _check_seen(
        view.camera.name, float(factors.area[lit][seen.known[lit]].sum() / factors.area[lit].sum())
    )
    pairs = [(seen.mean(light.direct), seen.mean(light.scattered)) for light in lights]
    stated = screen.stated_albedo
    ratio = _Ratios(seen, pairs, lit, stated[:, 0])
    albedo = _with_sigma(
        ratio, factors.area, stated[:, 1], _veil(view, lights, factors.area, pairs)
    )
    faces = np.where(seen.known[:, None], ratio.of_faces(), stated[:, :1])
    faces[lit & ~seen.known] = albedo.value
    faces = np.clip(faces, 0, BRIGHTEST)
    raster = screen.canvas.raster(hi.shape[1])
    direct = raster.mean((hi * coverage[..., None]).astype(np.float32))
    irradiance = settled(factors, faces, direct)
    local = _local_albedo(screen, view, lights, ratio.irradiance_of_all(), faces, hi.shape[1])
    arriving = np.maximum(raster.field(irradiance), 0)
    area = screen.canvas.weights(hi.shape[1]) * coverage
    flux = np.tensordot(area, hi, 2)
    scattered = local * arriving
    m = np.tensordot(area, scattered, 2) / flux
    feedback = Measured(m, m * (1 + m) * albedo.sigma / albedo.value)
    return RoomScatter(
        (scattered / flux).astype(np.float32),
        local,
        _with_others(screen, faces, seen.known, factors.area),
        feedback,
        albedo,
    )


class _Ratios:
    """Scattered light over irradiance, face by face, of each projector."""

    def __init__(
        self, room: RoomView, pairs: list[tuple[Array, Array]], lit: BoolArray, stated: Array
    ) -> None:
        self._room, self._pairs, self._stated = room, pairs, stated
        self.use = lit & room.known
        self.irradiances = [room.arriving(np.sum(pair, axis=0), stated) for pair in pairs]

    def irradiance_of_all(self) -> Array:
        """E (F, C) of all projectors' whites together."""
        return np.asarray(np.sum(self.irradiances, axis=0))

    def of_faces(self) -> Array:
        """Albedo (F, C) of seen faces, by all projectors."""
        scattered = np.sum([g for _, g in self._pairs], axis=0)
        return np.asarray(scattered / np.maximum(self.irradiance_of_all(), 1e-30))

    def mean(self, which: int, irradiance: Array, area: Array) -> Array:
        """Mean albedo (C,) of the lit parts, by one projector."""
        weight = area[self.use, None]
        scattered = (weight * self._pairs[which][1][self.use]).sum(axis=0)
        return np.asarray(scattered / (weight * irradiance[self.use]).sum(axis=0))

    def together(self, area: Array, stated: Array | None = None) -> Array:
        """Mean albedo (C,) of the lit parts, by all projectors."""
        pair = tuple(np.sum(part, axis=0) for part in zip(*self._pairs, strict=True))
        stated = self._stated if stated is None else stated
        irradiance = self._room.arriving(np.sum(pair, axis=0), stated)
        weight = area[self.use, None]
        return np.asarray(
            (weight * pair[1][self.use]).sum(axis=0) / (weight * irradiance[self.use]).sum(axis=0)
        )


def _with_sigma(ratio: _Ratios, area: Array, stated_sigma: Array, veil: Array) -> Measured:
    """The mean albedo of the lit parts, with the spread over projectors and what others and glare add."""
    value = ratio.together(area)
    each = np.array([ratio.mean(i, e, area) for i, e in enumerate(ratio.irradiances)])
    few = len(each) < 2
    spread = SINGLE_SIGMA * value if few else each.std(axis=0, ddof=1) / np.sqrt(len(each))
    by_others = ratio.together(area, ratio._stated + stated_sigma) - value
    parts = (spread, by_others, veil, MODEL_SIGMA * value)
    return Measured(value, np.sqrt(np.sum(np.square(parts), axis=0)))


def _veil(
    view: ScreenView,
    lights: Collection[SeparatedLight],
    area: Array,
    pairs: list[tuple[Array, Array]],
) -> Array:
    """Standard error (C,) of the albedo by the camera's glare, which adds to all scattered light."""
    on = view.on_screen
    mean = sum(np.nan_to_num(each.direct + each.scattered)[on].mean(axis=0) for each in lights)
    arriving = sum((area[:, None] * (d + g)).sum(axis=0) for d, g in pairs)
    return np.asarray(view.camera.sensor.glare_sigma * mean / (arriving / area.sum()))


def _local_albedo(
    screen: RoomScreen,
    view: ScreenView,
    lights: Collection[SeparatedLight],
    irradiance: Array,
    faces: Array,
    size: int,
) -> Image:
    """Albedo (H, W, C) of the canvas, place by place, as the camera sees it; elsewhere that of its face."""
    raster, (direction, lit) = screen.canvas.raster(size), screen.canvas.directions(size)
    scattered = np.sum([light.scattered for light in lights], axis=0)
    at = view.camera_pixels(screen, direction)
    weight = view.on_screen.astype(np.float32)
    covered = sample(weight, at)
    seen = (
        sample(np.nan_to_num(scattered) * weight[..., None], at)
        / np.maximum(covered, 1e-6)[..., None]
    )
    arriving = raster.field(irradiance)
    local = np.where(lit[..., None], faces[raster.face], 0)
    good = (covered > 0.99) & lit & (arriving > 0).all(axis=-1)
    local[good] = seen[good] / arriving[good]
    # borders of projectors' pictures are a few pixels wide, and show a little of their direct light
    local = np.stack([local_median(plane, lit) for plane in np.moveaxis(local, -1, 0)], axis=-1)
    return np.clip(local * lit[..., None], 0, BRIGHTEST).astype(np.float32)


def _with_others(screen: RoomScreen, faces: Array, known: BoolArray, area: Array) -> RoomScreen:
    """The room with the measured albedo of the parts that are not lit, where the camera sees half of one."""
    found, room = list[tuple[str, float, float]](), screen.room
    for name, stated, sigma in screen.others:
        own = room.part == room.names.index(name)
        seen = own & known
        if area[seen].sum() < SEEN_OF_LIT * area[own].sum():
            found.append((name, stated, sigma))
            continue
        value = float(np.average(faces[seen].mean(axis=1), weights=area[seen]))
        found.append((name, round(value, 4), round(OTHERS_SIGMA * value, 4)))
    return screen.with_others(tuple(found))


def _check_seen(camera: str, share: float) -> None:
    if share < SEEN_OF_LIT:
        raise OutOfModelRange(
            f"camera {camera}: it sees {share:.0%} of the parts that projectors light, and at least "
            f"{SEEN_OF_LIT:.0%} are needed; move it, or take a wider lens"
        )
