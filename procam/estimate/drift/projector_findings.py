"""Causes of what has changed of one projector."""

from collections.abc import Iterator, Mapping

import numpy as np

from procam.estimate.drift.dome_change import DEAD
from procam.estimate.drift.finding import (
    CERTAIN,
    MOST_BLUR_PX2,
    MOST_COLOUR,
    MOST_LIGHT,
    MOST_MOVED_ARCMIN,
    MOST_TREND,
    TREND_SIGMA,
    Cause,
    Finding,
    not_seen,
    unsized,
)
from procam.estimate.drift.panel import NO_LIGHT
from procam.estimate.drift.projector_change import MotionKind, ProjectorChange
from procam.estimate.drift.response_findings import name_settings
from procam.maths.geometry.sphere import ARCMIN
from procam.maths.statistics import MEDIAN_SIGMA
from procam.model.calibration import Calibration
from procam.model.photometry import PRIMARIES
from procam.model.screen import RoomScreen

THINNED = 97  # every so many pixels of a panel, for a median
MOTIONS: Mapping[MotionKind, tuple[Cause, str, str]] = {
    "moved": ("moved", "its picture moved", "recalibrate it: procam recalibrate"),
    "keystone": (
        "picture setting",
        "its picture is bent by a keystone correction",
        "switch it off in its menu",
    ),
    "stretched": (
        "picture setting",
        "its picture is stretched",
        "feed it its native resolution, unscaled",
    ),
    "scaled": (
        "picture setting",
        "its picture is scaled inside an edge that stayed: overscan or zoom in its menu",
        "switch it off",
    ),
}


def is_warming(projector: ProjectorChange) -> bool:
    """Whether a projector's light still changed during the run."""
    return abs(projector.trend) > max(
        MOST_TREND, CERTAIN * np.hypot(projector.trend_sigma, TREND_SIGMA)
    )


def name_projector_causes(
    calibration: Calibration, name: str, change: ProjectorChange, common: float, camera_blur: float
) -> Iterator[Finding]:
    """Causes of the change of one projector.

    `common` is the log of the light that all photographs gained, `camera_blur` what the camera's lens adds to
    the blur of all pictures [px^2].
    """
    if np.isnan(change.shows):
        yield not_seen(name, "the camera sees hardly any of it, so it is not judged")
        return
    if change.shows < NO_LIGHT:
        yield unsized(
            "no picture",
            name,
            "it shows nothing",
            "check its lamp, shutter, input and cable",
        )
        return
    if change.motion is None:
        yield _no_texture(name, change)
        return
    motion = list(_motion(calibration, name, change))
    yield from motion
    if abs(change.blur_px2 - camera_blur) > max(MOST_BLUR_PX2, CERTAIN * change.blur_sigma):
        size = change.blur_px2 - camera_blur
        yield Finding(
            "focus",
            name,
            size,
            change.blur_sigma,
            "px2",
            f"its picture is {'more blurred' if size > 0 else 'sharper'}, by {np.sqrt(abs(size)):.1f} pixels",
            "focus its lens, then recalibrate it",
        )
    if is_warming(change):
        yield Finding(
            "warming up",
            name,
            change.trend,
            float(np.hypot(change.trend_sigma, TREND_SIGMA)),
            "rel",
            f"its light changed by {change.trend:+.1%} during the run; how bright it is cannot be judged yet",
            "wait until lamps are warm, and verify again",
        )
    else:
        yield from _light(name, change, common)
    drawn_anew = any(finding.cause == "picture setting" for finding in motion)
    yield from name_settings(name, change, drawn_anew=drawn_anew)


def _no_texture(name: str, change: ProjectorChange) -> Finding:
    if change.turned_over != "as it was":
        return unsized(
            "picture setting",
            name,
            f"its picture is {change.turned_over}",
            "undo the projection mode (ceiling or rear) in its menu",
        )
    return unsized(
        "another picture",
        name,
        "it is lit, but its picture is not recognised: it moved far, is zoomed or out of focus, or something "
        "else plays",
        "look at it; check its place, lens, input and cable",
    )


def _pixel_arcmin(calibration: Calibration, name: str) -> float:
    """Width of a projector's pixels, in a room as seen from its middle."""
    surface, screen = calibration.projectors[name].surface, calibration.screen
    width = float(np.sqrt(np.median(surface.solid_angle_sr[surface.valid])))
    if isinstance(screen, RoomScreen):
        direction = surface.direction[surface.valid][::THINNED].astype(float)
        width /= float(np.median(screen.shape.radius_at(direction)))
    return width * ARCMIN


def _motion(calibration: Calibration, name: str, change: ProjectorChange) -> Iterator[Finding]:
    projector = calibration.projectors[name]
    pixel_arcmin = _pixel_arcmin(calibration, name)
    limit = MOST_MOVED_ARCMIN / pixel_arcmin
    if change.moved_px <= max(limit, CERTAIN * change.moved_sigma):
        return
    cause, text, advice = MOTIONS[change.kind_of_motion(projector.model)]
    arcmin = change.moved_px * pixel_arcmin
    yield Finding(
        cause,
        name,
        change.moved_px,
        change.moved_sigma,
        "px",
        f"{text}, by {change.moved_px:.2f} pixels on average ({arcmin:.1f} arcmin)",
        advice,
    )


def _light(name: str, change: ProjectorChange, common: float) -> Iterator[Finding]:
    alive = change.light > np.max(change.light) + np.log(DEAD)
    for channel in np.flatnonzero(~alive):
        yield unsized(
            "dead channel",
            name,
            f"it shows no {PRIMARIES[channel]}",
            "check its cable and colour settings; else it needs repair",
        )
    if not alive.any():
        return
    own = change.light - common
    level = float(np.median(own[alive]))
    each = float(np.median(change.light_sigma[alive]))
    sigma = each * MEDIAN_SIGMA / np.sqrt(alive.sum())
    size = float(np.expm1(level))
    if abs(size) > max(MOST_LIGHT, CERTAIN * sigma):
        yield Finding(
            "light",
            name,
            size,
            sigma * (1 + size),
            "rel",
            f"it is {abs(size):.1%} {'brighter' if size > 0 else 'darker'}",
            "recalibrate it; replace the lamp if it goes on",
        )
    for channel in np.flatnonzero(alive):
        own_size = float(np.expm1(own[channel] - level))
        spread = float(np.hypot(change.light_sigma[channel], each)) * (1 + own_size)
        if abs(own_size) > max(MOST_COLOUR, CERTAIN * spread):
            yield Finding(
                "colour",
                name,
                own_size,
                spread,
                "rel",
                f"its {PRIMARIES[channel]} is {abs(own_size):.1%} {'brighter' if own_size > 0 else 'darker'} "
                "beside its other colours",
                "recalibrate it",
            )
