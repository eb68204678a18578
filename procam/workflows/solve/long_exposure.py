"""Measures the true ratio of the two exposure times, by pictures photographed at both.

A dim picture at the end of a session gives the ratio of all long exposures; black itself shows whether that
of one projector was an exception.
"""

from dataclasses import replace

import numpy as np

from procam.arrays import Image
from procam.errors import OutOfModelRange
from procam.estimate.camera.checks import exposure_ratio
from procam.model.plan import Shot
from procam.model.provenance import Note
from procam.workflows.capture.session_images import LONG, Counts, SessionImages

GREEN = 1
NOTED, CERTAIN = 0.02, 5.0  # departure from 1, and sigmas
LEAST, MOST = 0.1, 3.0  # ratios that a camera may make; others are of another picture
CUT_PERCENT = 99  # of the pixels that read 0
ENCODED = (
    0.02  # standard error: JPEG moves dim colours towards grey, by a third of a count of 8 bits
)
BLACK_NOTED = (
    0.1  # departure from 1; a short photograph of black is so dim that 0.05 may be the camera's
)


def with_long_exposure(images: SessionImages) -> tuple[SessionImages, list[Note]]:
    """Images rescaled to the measured exposure time, and a warning if it differs.

    Where it cannot be measured, the warning is that it is not checked.

    Raises
    ------
    OutOfModelRange
        If the photographs cannot be of the dim picture, or black is hardly exposed.
    """
    planned = [shot for shot in images.plan.shots if shot.purpose == "dim"]
    if not planned:
        return images, []
    shot, camera = images.dim(), images.radiometer.camera.name
    if shot is None:
        text = (
            "the dim picture at the end, was not photographed: whether the camera moved between projectors, "
            "and how long black was exposed, is not checked"
        )
        return images, [Note("not checked", "", f"{planned[0].id}, {text}")]
    if len(shot.exposures_s) == 1:
        return images, []
    ratio, sigma = _ratio(images, shot)
    if np.isnan(ratio):
        text = (
            f"{shot.id}: the dim picture at the end is too dark at {shot.exposures_s[0]:g} s, so how long "
            "black was exposed is not checked"
        )
        return images, [Note("not checked", "", text)]
    if abs(ratio - 1) <= max(NOTED, CERTAIN * sigma):
        return images, []
    found = (
        f"photographs of {shot.exposures_s[1]:g} s were exposed {ratio:.3g} times as long, "
        f"by the light of {shot.id}"
    )
    if not LEAST < ratio < MOST:
        raise OutOfModelRange(
            f"camera {camera}: {found}; are both photographs of that picture? Photograph it again, with a "
            "black_exposure_s that the camera can do"
        )
    text = (
        f"{found}; black is rescaled to that. Check the longest exposure that the camera can "
        "do, and [capture] black_exposure_s"
    )
    amount = np.log(ratio) / NOTED
    return replace(images, long_exposure=ratio), [
        Note("long exposure", f"camera {camera}", text, float(amount))
    ]


def black_notes(images: SessionImages, name: str) -> list[Note]:
    """A note if a projector's black is not as bright at white's exposure as at its own.

    Nothing is said of black that does not show at white's exposure, as it is below 1/5000 of white.
    """
    shot = images.only(name, "black")
    if len(shot.exposures_s) == 1:
        return []
    ratio, sigma = _ratio(images, shot)
    if not abs(ratio - 1) > max(BLACK_NOTED, CERTAIN * sigma):
        return []
    text = (
        f"its black is {ratio:.3g} times as bright at {shot.exposures_s[0]:g} s as at "
        f"{shot.exposures_s[1]:g} s; the exposure time of a photograph of black or of the dark "
        "differs from its file's, or stray light got in. Photograph again; until then black is wrong"
    )
    return [Note("black exposure", f"projector {name}", text, float(np.log(ratio) / BLACK_NOTED))]


def _ratio(images: SessionImages, shot: Shot) -> tuple[float, float]:
    """True over stated ratio of the exposures of a picture, and its sigma; NaN if it does not show."""
    long, usable = LONG[shot.purpose], images.radiometer.seen
    dark = [_green(each) for each in images.dark(shot.projector)]
    light = [_green(images.light(shot, i)) for i in (1 - long, long)]
    cut = usable & (images.at_zero(shot, 1 - long) > 0)
    if cut.any():  # noise that is cut off at 0 counts as light
        usable = usable & (light[1] > np.nanpercentile(light[1][cut], CUT_PERCENT))
    short, longer = (
        np.where(usable, x - d, np.float32(np.nan)) for x, d in zip(light, dark, strict=True)
    )
    full = images.radiometer.camera.sensor.full_scale
    step = _step(images.counts(shot, 1 - long)) / (full * shot.exposures_s[1 - long])
    ratio, sigma = exposure_ratio(short, longer, step)
    return ratio, float(np.hypot(sigma, ENCODED * images.were_encoded))


def _green(light: Image) -> Image:
    """Green light (H, W) on its own; a view would keep all of (H, W, 3)."""
    return light[..., GREEN].copy()


def _step(counts: Counts) -> int:
    """What all counts are multiples of: 16 of a camera that writes 12 bits as the upper ones of 16."""
    return max(1, int(np.gcd.reduce(np.unique(counts))))
