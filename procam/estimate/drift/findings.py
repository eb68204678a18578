"""Names the causes of what has changed, with size, standard error and what to do.

A change is named if it is larger than what matters and than five of its standard errors. Of explanations that
fit alike the one with fewest causes is taken: one camera's exposure rather than six lamps.
"""

from collections.abc import Iterator

import numpy as np

from procam.arrays import Array
from procam.estimate.drift.camera_motion import CameraMotion
from procam.estimate.drift.changes import VenueChange
from procam.estimate.drift.dome_change import DEAD
from procam.estimate.drift.finding import (
    AMBIENT_SIGMA,
    CERTAIN,
    MOST_AMBIENT,
    MOST_BLUR_PX2,
    MOST_LIGHT,
    MOST_SCATTER,
    SAME_LIGHT,
    Finding,
)
from procam.estimate.drift.projector_change import ProjectorChange
from procam.estimate.drift.projector_findings import is_warming, name_projector_causes
from procam.estimate.light.bands import ADVICE
from procam.maths.statistics import MEDIAN_SIGMA
from procam.model.calibration import Calibration
from procam.model.photometry import PRIMARIES
from procam.model.screen import Dome

AT_CENTRE_M = 1e-6  # of the dome: where a media server counts as a projector


def name_causes(calibration: Calibration, change: VenueChange) -> list[Finding]:
    """The causes of a change: of the camera, the room and the screen, then of each projector."""
    common = _common_light(change)
    found = [*_camera(calibration, change, common), *_room(calibration, change)]
    blurred, _ = _camera_blur(change)
    for name, projector in change.projectors.items():
        found += name_projector_causes(calibration, name, projector, common, blurred)
    return found


def _camera(calibration: Calibration, change: VenueChange, common: float) -> Iterator[Finding]:
    name, motion = change.camera.camera.name, change.camera
    if motion.moved and _is_alone(calibration, motion):
        (only,) = motion.unmoved
        yield Finding(
            "moved",
            only,
            motion.turned_deg,
            motion.turned_sigma,
            "deg",
            f"its picture moved as if the camera were turned by {motion.turned_deg:.2f} degrees: no other "
            "projector's picture is seen that would show which of the two moved",
            "put the camera back as it stood and verify again; if that changes nothing, calibrate again",
        )
    elif motion.moved:
        yield Finding(
            "camera moved",
            name,
            motion.turned_deg,
            motion.turned_sigma,
            "deg",
            f"it is turned by {motion.turned_deg:.2f} degrees and shifted by {motion.shifted_mm:.0f} mm; "
            "its new pose was solved, and all else is measured from there. All projectors together on one "
            "stand would look the same",
            "nothing has to be done if the camera was touched; to refine, calibrate again or put it back",
        )
    if common:
        size = float(np.expm1(common))
        each = float(np.median([np.nanmedian(p.light_sigma) for p in change.projectors.values()]))
        sigma = each * MEDIAN_SIGMA / np.sqrt(len(PRIMARIES))
        yield Finding(
            "camera exposure",
            name,
            size,
            sigma * (1 + size),
            "rel",
            f"all photographs are {abs(size):.1%} {'brighter' if size > 0 else 'darker'}: another aperture, "
            "ISO or exposure than stated, or all lamps alike",
            "check the camera's settings; if they are right, all lamps have changed alike: calibrate again",
        )
    blur, blur_sigma = _camera_blur(change)
    if blur:
        yield Finding(
            "camera focus",
            name,
            blur,
            blur_sigma,
            "px2",
            f"all pictures are blurred alike, by {np.sqrt(blur):.1f} projector pixels",
            "focus the camera",
        )
    if change.bands:
        bands = change.bands
        yield Finding("banding", name, bands.amplitude, bands.sigma, "rel", bands.text, ADVICE)


def _is_alone(calibration: Calibration, motion: CameraMotion) -> bool:
    """Whether one projector is all that is seen, and no media server, whose own never move together."""
    models = [projector.model for projector in calibration.projectors.values()]
    at_centre = np.linalg.norm(models[0].projector_from_dome.origin) < AT_CENTRE_M
    return len(motion.unmoved) == 1 and not at_centre


def _common_light(change: VenueChange) -> float:
    """Log of the light that most projectors share; 0 if most are as they were."""
    levels = [
        float(np.median(p.light[p.light > np.log(DEAD)]))
        for p in change.projectors.values()
        if _judged(p) and (p.light > np.log(DEAD)).any()
    ]
    if len(levels) < 2:
        return 0.0
    agreeing = {level: sum(abs(level - other) < SAME_LIGHT for other in levels) for level in levels}
    still = sum(abs(level) < max(SAME_LIGHT, MOST_LIGHT / 2) for level in levels)
    best = max(agreeing, key=lambda level: agreeing[level])
    majority = max(2, len(levels) // 2 + 1)
    if agreeing[best] < majority or agreeing[best] <= still or abs(np.expm1(best)) < MOST_LIGHT:
        return 0.0
    return float(np.median([level for level in levels if abs(level - best) < SAME_LIGHT]))


def _judged(projector: ProjectorChange) -> bool:
    """Whether a projector's light says something of its lamp."""
    return projector.motion is not None and not is_warming(projector)


def _camera_blur(change: VenueChange) -> tuple[float, float]:
    """Rise of the blur that all of several projectors share [px^2], and its standard error.

    0 if one is as sharp as before.
    """
    found = [p for p in change.projectors.values() if p.motion is not None]
    blurs = [p.blur_px2 for p in found]
    if len(blurs) <= 2 or min(blurs) <= MOST_BLUR_PX2:
        return 0.0, 0.0
    each = np.hypot(np.median([p.blur_sigma for p in found]), np.std(blurs, ddof=1))
    return float(np.median(blurs)), float(MEDIAN_SIGMA * each / np.sqrt(len(blurs)))


def _room(calibration: Calibration, change: VenueChange) -> Iterator[Finding]:
    # in bands of a few directions dust and stains would be found, too
    dust, stain = (None, None) if change.bands else (change.dome.dust, change.dome.stain)
    or_lamps = ", or what lights it there" if len(change.projectors) == 1 else ""
    if dust:
        yield Finding(
            "dust",
            "",
            dust.loss,
            dust.sigma,
            "rel",
            f"the screen reflects up to {dust.loss:.1%} less, most at "
            f"{calibration.screen.named(dust.direction)}{or_lamps}",
            "clean the screen; if it stays, calibrate again",
        )
    if stain:
        yield Finding(
            "stain",
            "",
            stain.loss,
            stain.sigma,
            "rel",
            f"a spot at {calibration.screen.named(stain.direction)} reflects {stain.loss:.0%} less, about "
            f"{np.degrees(2 * stain.width):.0f} degrees wide{or_lamps}",
            "look at the screen there; clean it or calibrate again",
        )
    if change.scatter:
        yield from _floor(calibration, change)
    ambient = float(change.ambient.value.mean())
    sigma = float(np.hypot(np.sqrt(np.mean(change.ambient.sigma**2)), AMBIENT_SIGMA * ambient))
    if abs(ambient) > max(MOST_AMBIENT, CERTAIN * sigma):
        yield Finding(
            "ambient light",
            "",
            ambient,
            sigma,
            "rel",
            f"the room's own light is {abs(ambient):.2%} of white {'more' if ambient > 0 else 'less'} than "
            "at the calibration",
            f"switch off what is lit, close doors and curtains; or {_measure(calibration)}",
        )


def _floor(calibration: Calibration, change: VenueChange) -> Iterator[Finding]:
    """Scattered light that the screen's own change does not explain."""
    assert change.scatter is not None
    ratio = change.scatter.value / scatter_by_dome(calibration, change)
    size, sigma = float(ratio.mean() - 1), float(change.scatter.sigma.mean())
    if abs(size) > max(MOST_SCATTER, CERTAIN * sigma):
        yield Finding(
            "floor or audience",
            "",
            size,
            sigma,
            "rel",
            f"scattered light is {abs(size):.0%} {'more' if size > 0 else 'less'}: another floor, furniture "
            "or audience",
            f"take it out again, or {_measure(calibration)}",
        )


def _measure(calibration: Calibration) -> str:
    """How light is compensated that is there to stay."""
    dome = isinstance(calibration.screen, Dome)
    return "measure it, to compensate with it: procam state" if dome else "calibrate again"


def scatter_by_dome(calibration: Calibration, change: VenueChange) -> Array:
    """Scattered per direct light over that before (3,), by the change of the screen's albedo alone."""
    screen = calibration.screen
    direction, inside = screen.canvas.directions(64)
    on_screen = inside & screen.contains(direction)
    change_of_albedo = float(np.mean(change.dome.log_albedo(direction[on_screen])))
    return np.asarray(np.exp(change_of_albedo * (1 + calibration.feedback.value)))
