"""Black of projectors that cannot be made dark, from photographs of the dark that hold all their blacks.

Without a shutter or a switch, a photograph of one projector's black shows what the dark shows: every black,
and the room. Their difference is 0 whatever black is. Only shape separates them: a projector's black ends at
the edges of its picture, and the room's light does not. The dark is fitted by the projectors' pictures, each
with a factor of its own, and by smooth light of the room; none of them is below 0.

How black falls off over a picture is not known, and how smooth the room's light is neither. The fit is made
with black like white and with a uniform one, and with several rooms; the spread of those that explain the
dark about as well as the best is the error. Where one picture covers all that the camera sees, black and
room are not separated at all, and the spread shows that.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from procam.arrays import Array, BoolArray, Image, IndexArray
from procam.estimate.light.separation import SeparatedLight
from procam.maths.geometry.sphere import direction_from_angles

SHAPES = 2
ROOMS = (None, 0, 4, 12)  # no room; lobes of its light around the horizon, beside a uniform part
AS_GOOD = 2.0  # times the smallest misfit: such explanations of the dark count
LOBE_ELEVATION = np.radians(20.0)
MOST_PIXELS = 8000  # of the camera; thinned out beyond
EDGE = 0.3  # of a picture's usual light: a uniform black fades to its border below that
PROFILE = 0.1  # relative standard error of black, by the shape of its picture
ROOM_SHAPE = 0.05  # relative error of the room's light, of which black takes a part
LEAST, ROUNDING = 1e-12, 1e-6


@dataclass(frozen=True, slots=True)
class SharedBlack:
    """Black of projectors that are never dark.

    `factors` (K, 3) of the shapes of a picture (`_shapes`), by name: their sum is a black. `total` (3,) of
    all together, a mean over the screen, and its standard error `sigma` (3,), all in radiance.
    """

    factors: Mapping[str, Array]
    total: Array
    sigma: Array

    def black(self, name: str, light: SeparatedLight) -> Image:
        """Black (H, W, 3) of a projector, scattered light included, given the light of its white."""
        shapes = zip(self.factors[name].astype(np.float32), _shapes(light), strict=True)
        return np.asarray(sum(factor * shape for factor, shape in shapes), np.float32)


def fit_shared_black(
    dark: Image, lights: Mapping[str, SeparatedLight], direction: Image, on_screen: BoolArray
) -> SharedBlack:
    """Fit the blacks of projectors to one photograph of the dark.

    Parameters
    ----------
    dark : (H, W, 3) radiance with every projector black. lights : of each one's white.
    direction : (H, W, 3) of the dome that a pixel sees. on_screen : (H, W) pixels that see the screen.
    """
    at = _pixels(dark, lights, on_screen)
    samples = {n: [x.reshape(-1, 3)[at] for x in _shapes(light)] for n, light in lights.items()}
    rooms = [_room(direction.reshape(-1, 3)[at].astype(float), lobes) for lobes in ROOMS]
    light = dark.reshape(-1, 3)[at].astype(float)
    fits, misfits = list[Array](), list[float]()
    for k in range(SHAPES):
        shape = np.array([of[k] for of in samples.values()], float)
        for room in rooms:
            factors = np.zeros((len(lights), SHAPES, 3))
            factors[:, k], misfit = _factors(light, shape, room)
            fits.append(factors)
            misfits.append(misfit)
    least = max(min(misfits), ROUNDING * float(np.linalg.norm(light)))
    good = [fit for fit, misfit in zip(fits, misfits, strict=True) if misfit <= AS_GOOD * least]
    means = np.array([[x.mean(axis=0) for x in of] for of in samples.values()])
    totals = np.array([(fit * means).sum(axis=(0, 1)) for fit in good])
    total = totals.mean(axis=0)
    room_light = np.maximum(light.mean(axis=0) - total, 0)
    own = np.hypot(np.ptp(totals, axis=0) / 2, PROFILE * total)
    by_name = dict(zip(lights, np.mean(good, axis=0), strict=True))
    return SharedBlack(by_name, total, np.hypot(own, ROOM_SHAPE * room_light))


def _pixels(dark: Image, lights: Mapping[str, SeparatedLight], on_screen: BoolArray) -> IndexArray:
    """Indices of pixels of the screen whose light is known, thinned out."""
    good = on_screen & np.isfinite(dark).all(axis=-1)
    for light in lights.values():
        good &= np.isfinite(light.direct + light.scattered).all(axis=-1)
    found = np.flatnonzero(good)
    return found[:: max(1, len(found) // MOST_PIXELS)]


def _shapes(light: SeparatedLight) -> Iterator[Image]:
    """Pictures (H, W, 3) of black up to a factor: like white, and uniform within its border."""
    yield light.direct + light.scattered
    usual = np.median(light.direct[light.lit], axis=0)
    shown = np.clip(light.direct / np.maximum(EDGE * usual, LEAST), 0, 1) * usual
    yield (shown + light.scattered).astype(np.float32)


def _room(direction: Array, lobes: int | None) -> Array:
    """Smooth light (n, 1 + lobes) of the room that no combination makes negative; (n, 0) of none."""
    if lobes is None:
        return np.empty((len(direction), 0))
    azimuth = 2 * np.pi * np.arange(lobes) / max(lobes, 1)
    towards = direction_from_angles(azimuth, np.full(lobes, LOBE_ELEVATION))
    return np.hstack([np.ones((len(direction), 1)), ((1 + direction @ towards.T) / 2) ** 2])


def _factors(light: Array, shape: Array, room: Array) -> tuple[Array, float]:
    """Factors (P, 3) of pictures (P, n, 3) in the light (n, 3) of the dark, and what they do not explain."""
    factors, misfit = np.empty((len(shape), 3)), np.empty(3)
    for channel in range(3):
        columns = shape[..., channel].T
        scale = np.maximum(np.linalg.norm(columns, axis=0), LEAST)
        found, misfit[channel] = nnls(np.hstack([columns / scale, room]), light[:, channel])
        factors[:, channel] = found[: len(scale)] / scale
    return factors, float(np.linalg.norm(misfit))
