"""Places of the screen whose scattered light is not that of the screen around them.

Scattered light is smooth over a dome, and so is paint. Where something stood before the screen in all
pictures, where dirt lies on the camera's lens, or where another projector's light counted as scattered
because someone hid the code there, it is not.
"""

import numpy as np
from scipy.ndimage import label

from procam.arrays import Array, BoolArray, Image
from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.light.bands import find_bands
from procam.maths.statistics import robust_sigma
from procam.maths.warp import blur_within, grow
from procam.model.provenance import Note

ROUNDS, OUTLIER_SIGMAS = 6, 3.0
MOST_FITTED = 200_000  # pixels that the polynomial is fitted to, evenly picked
SMOOTH_PX = 2.0
RIM_SHARE = 0.04  # of the picture: so far from the rim edges of the screen do not matter
DARK, BRIGHT = -0.1, 0.2  # logarithms of the light over that around
DARK_SHARE, AROUND_PX = (
    0.3,
    8,
)  # of white around, and how far that is: corners of lenses fade evenly
EDGE_PX = 3  # of what is too dark to tell: pixels lit in part are so too
LEAST_SHARE = 5e-4  # of the screen
GREEN = 1


def spot_notes(per_flux: Image, view: ScreenView) -> list[Note]:
    """Notes on spots and bands in the scatter per flux (H, W, C) of the screen in `view`; normally none."""
    light = per_flux[..., GREEN]
    use = view.on_screen & (light > 0)
    inner = grow(use, -max(1, round(RIM_SHARE * min(light.shape))))
    if not inner.any():
        return []
    departure = _departure(light, view.direction, use)
    notes = []
    bands = find_bands(departure, inner)
    if bands:
        notes.append(bands.note(view.camera.name))
        departure = np.asarray(departure - bands.profile, np.float32)
    for found, what, cause in (
        (inner & (departure < DARK), "darker", DARK_CAUSE),
        (inner & (departure > BRIGHT), "brighter", BRIGHT_CAUSE),
    ):
        share = float(view.weight[found].sum() / view.weight.sum())
        if share > LEAST_SHARE:
            size = float(np.abs(np.expm1(departure[found])).max())
            text = (
                f"scattered light is up to {size:.0%} {what} than around it on {share:.1%} of the screen, "
                f"{_place(view, found)}: {cause}"
            )
            notes.append(Note(f"{what} spot", "", text, share / LEAST_SHARE))
    return notes


def hidden_notes(name: str, white: Image, unknown: BoolArray, view: ScreenView) -> list[Note]:
    """A note on a place within a projector's picture that shows hardly any of its light; normally none.

    Scattered light is not measured there, so `spot_notes` cannot see it.

    Parameters
    ----------
    white : (H, W, 3) radiance of its white. unknown : (H, W) pixels that should see its picture, and are
        too dark to tell.
    """
    number, count = label(grow(unknown, -EDGE_PX))
    for i in range(1, count + 1):
        found = number == i
        share = float(view.weight[found].sum() / view.weight.sum())
        if share <= LEAST_SHARE:
            continue
        beside = grow(found, AROUND_PX + EDGE_PX) & ~grow(found, 2 * EDGE_PX) & view.on_screen
        light = white[..., GREEN]
        if np.nanmedian(light[found]) < DARK_SHARE * np.nanmedian(light[beside]):
            text = (
                f"{share:.1%} of the screen is too dark within its picture to measure its light, "
                f"{_place(view, found)}: {DARK_CAUSE}"
            )
            return [Note("hidden place", f"projector {name}", text, share / LEAST_SHARE)]
    return []


def _departure(light: Image, direction: Image, use: BoolArray) -> Image:
    """Logarithm (H, W) of light over a polynomial of degree 2 in the direction, fitted without outliers."""
    index = np.flatnonzero(use)
    every = -(-len(index) // MOST_FITTED)
    directions, values = direction.reshape(-1, 3), np.log(light.ravel()[index].astype(float))
    terms, known = _terms(directions[index[::every]]), values[::every]
    kept = np.ones(len(known), bool)
    for _ in range(ROUNDS):
        coefficients: Array = np.linalg.lstsq(terms[kept], known[kept], rcond=None)[0]
        residual = known - terms @ coefficients
        kept = np.abs(residual) <= OUTLIER_SIGMAS * robust_sigma(residual[kept], 0.0) + 1e-9
    for at in range(0, len(index), MOST_FITTED):  # all at once they are 72 bytes a pixel
        some = slice(at, at + MOST_FITTED)
        values[some] -= _terms(directions[index[some]]) @ coefficients
    departure = np.zeros(light.shape, np.float32)
    departure[use] = values
    return blur_within(departure, use, SMOOTH_PX)


def _terms(direction: Image) -> Array:
    """Terms (N, 9) of the polynomial."""
    x, y, z = direction.astype(float).T
    return np.stack([np.ones_like(x), x, y, z, x * x, x * y, x * z, y * y, y * z], axis=1)


def _place(view: ScreenView, found: BoolArray) -> str:
    """The middle of the largest spot in the camera's picture, in words."""
    number, _ = label(found)
    largest = 1 + int(np.argmax(np.bincount(number.ravel())[1:]))
    rows, columns = np.nonzero(number == largest)
    return (
        f"near pixel ({np.median(columns):.0f}, {np.median(rows):.0f}) of camera {view.camera.name}"
    )


DARK_CAUSE = (
    "something stood before the screen in all pictures, dirt is on the camera's lens, or the paint is "
    "darker there. Remove it and photograph again; what belongs to the dome, mask in venue.toml"
)
BRIGHT_CAUSE = (
    "a projector's picture was hidden there while its code was shown, or something shines by itself. Keep "
    "everybody out of the dome and photograph again; what belongs to the dome, mask in venue.toml"
)
