"""All that a few photographs show to have changed at a venue: geometry first, then light.

The order matters: light is compared at places of the dome, which the camera's pose gives, and the pose needs
the places of the pictures.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import BoolArray, FloatArray
from procam.estimate.drift.banding import find_banding
from procam.estimate.drift.camera_motion import (
    CLOSE_PX,
    WIDE_PX,
    CameraMotion,
    find_camera_motion,
)
from procam.estimate.drift.dome_change import DEAD, DomeChange, find_dome_change
from procam.estimate.drift.light_change import WindowLight
from procam.estimate.drift.panel import all_seen, find_picture, from_pose, make_panel
from procam.estimate.drift.pictures import VenuePhotographs
from procam.estimate.drift.projector_change import ProjectorChange, measure_projector
from procam.estimate.drift.scatter_change import ambient_light, scatter_ratio, scattered_share
from procam.estimate.light.bands import Bands
from procam.model.calibration import Calibration
from procam.model.transport import Measured

# grid px: less motion and blur than this, for the light of the screen and the room
STEADY_PX, SHARP_PX2 = 2.0, 1.0


@dataclass(frozen=True, slots=True)
class VenueChange:
    """What has changed of a venue.

    Attributes
    ----------
    projectors : by name. camera : of the camera. dome : of the screen.
    scatter : scattered light per direct light over that before (3,); None where it is not seen.
    ambient : rise (3,) of the light of the dark room [rel].
    bands : in today's photographs; None where there are none, or the camera moved.
    """

    projectors: Mapping[str, ProjectorChange]
    camera: CameraMotion
    dome: DomeChange
    scatter: Measured | None
    ambient: Measured
    bands: Bands | None = None


def find_changes(
    calibration: Calibration,
    before: VenuePhotographs,
    now: VenuePhotographs,
    level_pictures: Mapping[str, FloatArray],
) -> VenueChange:
    """Compare photographs of a venue with those of its calibration.

    Parameters
    ----------
    calibration : of the session that `before` is of.
    before, now : by the same camera, `now` as if it stood where it stood.
    level_pictures : (H, W, C) drive 0..1 of the level tiles that each projector showed.
    """
    panels = [
        make_panel(calibration, before, name, level_pictures[name]) for name in before.projectors
    ]
    camera = CameraMotion(before.camera, False)
    found = {panel.name: find_picture(panel, now) for panel in panels}
    for same_px in (WIDE_PX, CLOSE_PX, CLOSE_PX):
        motion = find_camera_motion(before.camera, all_seen(panels, now, found), same_px)
        if motion.moved:
            camera = motion
            now = from_pose(calibration, before, now, camera)
            found = {panel.name: find_picture(panel, now) for panel in panels}
    shares = {panel.name: scattered_share(calibration, panel.name, panel.grid) for panel in panels}
    changes, lights = {}, {}
    for panel in panels:
        changes[panel.name], lights[panel.name] = measure_projector(
            calibration, panel, before, now, found[panel.name], shares[panel.name]
        )
    change = _with_room(calibration, before, now, camera, changes, lights)
    if camera.moved:
        return change
    still = [n for n, each in changes.items() if _is_still(each)]
    return replace(change, bands=find_banding(before, now, still))


def _is_still(change: ProjectorChange) -> bool:
    """Whether a picture stands where it stood, as sharp as it was."""
    return bool(
        change.moved_px < STEADY_PX * change.step and change.blur_px2 < SHARP_PX2 * change.step**2
    )


def _with_room(
    calibration: Calibration,
    before: VenuePhotographs,
    now: VenuePhotographs,
    camera: CameraMotion,
    changes: dict[str, ProjectorChange],
    lights: dict[str, WindowLight | None],
) -> VenueChange:
    """The change of the room and the screen, and the lamps' own without it."""
    usable = {n: light for n, light in lights.items() if light is not None}
    steady = [n for n in usable if changes[n].moved_px < STEADY_PX * changes[n].step]
    shining = {n: usable[n].level()[0] > np.log(DEAD) for n in steady}
    alive = [n for n in steady if shining[n].any()]
    scatter = scatter_ratio(calibration, before, now, alive)
    if scatter is not None:
        scatter = _without_dead(scatter, np.all([shining[n] for n in alive], axis=0))
    ratio = Measured(np.ones(3), np.zeros(3)) if scatter is None else scatter
    usable = {n: light.without_scatter(ratio.value) for n, light in usable.items()}
    sharp = [n for n in steady if _is_still(changes[n])]
    dome = find_dome_change({n: usable[n] for n in sharp}, float(np.abs(ratio.value - 1).max()))
    for name, light in usable.items():
        level, sigma = light.level(dome.log_albedo(light.direction))
        response = changes[name].response
        if response is not None:
            response = response.without_scatter(float(np.median(light.scattered)), ratio)
        changes[name] = replace(changes[name], light=level, light_sigma=sigma, response=response)
    return VenueChange(changes, camera, dome, scatter, ambient_light(calibration, before, now))


def _without_dead(scatter: Measured, shining: BoolArray) -> Measured | None:
    """The ratio, where channels that a projector lacks have the mean of the others."""
    if not shining.any():
        return None
    value, sigma = (np.where(shining, v, v[shining].mean()) for v in (scatter.value, scatter.sigma))
    return Measured(value, sigma)
