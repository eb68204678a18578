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

    `black` (H, W, 3) by name, scattered light included; `total` (3,) of all together, a mean over the screen,
    and its standard error `sigma` (3,), all in radiance.
    """

    black: Mapping[str, Image]
    total: Array
    sigma: Array


def fit_shared_black(
    dark: Image, lights: Mapping[str, SeparatedLight], direction: Image, on_screen: BoolArray
) -> SharedBlack:
    """Fit the blacks of projectors to one photograph of the dark.

    Parameters
    ----------
    dark : (H, W, 3) radiance with every projector black. lights : of each one's white.
    direction : (H, W, 3) of the dome that a pixel sees. on_screen : (H, W) pixels that see the screen.
    """
    shapes = list(_shapes(lights))
    good = on_screen & np.isfinite(dark).all(axis=-1)
    good &= np.isfinite([*shapes[0].values()]).all(axis=(0, -1))
    at = np.flatnonzero(good)[:: max(1, int(good.sum()) // MOST_PIXELS)]
    rooms = [_room(direction.reshape(-1, 3)[at].astype(float), lobes) for lobes in ROOMS]
    light = dark.reshape(-1, 3)[at].astype(float)
    fits, misfits = list[dict[str, Image]](), list[float]()
    for shape in shapes:
        for room in rooms:
            factors, misfit = _factors(light, shape, at, room)
            named = zip(shape.items(), factors, strict=True)
            fits.append({name: (f * image).astype(np.float32) for (name, image), f in named})
            misfits.append(misfit)
    least = max(min(misfits), ROUNDING * float(np.linalg.norm(light)))
    fits = [fit for fit, misfit in zip(fits, misfits, strict=True) if misfit <= AS_GOOD * least]
    black = {n: np.asarray(np.mean([fit[n] for fit in fits], axis=0), np.float32) for n in lights}
    totals = np.array([np.sum([_mean(fit[n], at) for n in lights], axis=0) for fit in fits])
    total = totals.mean(axis=0)
    room_light = np.maximum(light.mean(axis=0) - total, 0)
    own = np.hypot(np.ptp(totals, axis=0) / 2, PROFILE * total)
    return SharedBlack(black, total, np.hypot(own, ROOM_SHAPE * room_light))


def _mean(image: Image, at: IndexArray) -> Array:
    return np.asarray(image.reshape(-1, 3)[at].mean(axis=0), float)


def _shapes(lights: Mapping[str, SeparatedLight]) -> Iterator[dict[str, Image]]:
    """Pictures (H, W, 3) of black up to a factor: like white, and uniform within its border."""
    yield {n: light.direct + light.scattered for n, light in lights.items()}
    flat = dict[str, Image]()
    for name, light in lights.items():
        usual = np.median(light.direct[light.lit], axis=0)
        shown = np.clip(light.direct / np.maximum(EDGE * usual, LEAST), 0, 1) * usual
        flat[name] = (shown + light.scattered).astype(np.float32)
    yield flat


def _room(direction: Array, lobes: int | None) -> Array:
    """Smooth light (n, 1 + lobes) of the room that no combination makes negative; (n, 0) of none."""
    if lobes is None:
        return np.empty((len(direction), 0))
    azimuth = 2 * np.pi * np.arange(lobes) / max(lobes, 1)
    towards = direction_from_angles(azimuth, np.full(lobes, LOBE_ELEVATION))
    return np.hstack([np.ones((len(direction), 1)), ((1 + direction @ towards.T) / 2) ** 2])


def _factors(
    light: Array, shape: Mapping[str, Image], at: IndexArray, room: Array
) -> tuple[Array, float]:
    """Factors (P, 3) of the pictures in the light (n, 3) of the dark, and what is not explained of it."""
    factors, misfit = np.empty((len(shape), 3)), np.empty(3)
    for channel in range(3):
        columns = np.stack([image[..., channel].ravel()[at] for image in shape.values()], axis=1)
        scale = np.maximum(np.linalg.norm(columns, axis=0), LEAST)
        found, misfit[channel] = nnls(np.hstack([columns / scale, room]), light[:, channel])
        factors[:, channel] = found[: len(scale)] / scale
    return factors, float(np.linalg.norm(misfit))
