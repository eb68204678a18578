"""Changes of a simulated venue after it was calibrated, for a verification to find.

A drift is a change of the preset (the room) or of one device, and `drifted` opens the venue with it.
Angles in a picture are counter-clockwise: 0 is to the right, 90 upwards.
"""

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from pydantic import ConfigDict

from procam.arrays import Array
from procam.errors import InputError
from procam.maths.geometry.pose import Pose, rotation_matrix
from simulators.builds import CameraBuild, ProjectorBuild, Scaler
from simulators.presets import Preset
from simulators.scene import Devices, DomeScene

# relative, of each channel of a camera between two sessions: its sensor is about a degree warmer or colder
GAIN_SIGMA = 4e-4
HIGHEST_FLOOR_ALBEDO = 0.9
MOVED_M_PER_DEG = 0.005  # shift of a camera's tripod that comes with a turn [m/deg]


@dataclass(frozen=True)
class Drift:
    """One change of a venue.

    Attributes
    ----------
    kind : one of `KINDS`.
    size : how large it is. Degrees for "turned" and "camera-moved" (with 5 mm of shift per degree),
        projector px for "shifted" and "defocused" (Gaussian sigma, added in quadrature), else a
        share: of focal length (zoomed), of the edge that becomes shorter (keystone), of the picture
        (overscan), of light that is lost (aged, colour-aged, dynamic-black on a black picture,
        warming at first), of the exponent (gamma), of the drive added to black (raised-black), of
        albedo that is lost (dust, stain), of the radiance of one projector's white (ambient), of a
        photograph's light (aperture); an albedo for "floor". Without meaning for "mirrored",
        "dead-channel" and "no-picture".
    projector : which one, for kinds that change a projector.
    angle_deg : direction in the picture (turned: of its axis; shifted; keystone: the edge that becomes
        shorter, the nearest of four), azimuth (dust, stain), or a draw (camera-moved).
    channel : primary 0..2 (colour-aged, dead-channel).
    """

    __pydantic_config__ = ConfigDict(extra="forbid")
    kind: str
    size: float
    projector: str = ""
    angle_deg: float = 0.0
    channel: int = 0

    def __post_init__(self) -> None:
        if self.kind not in RANGES:
            raise InputError(f"drift {self.kind} is not one of {', '.join(KINDS)}.")
        allowed = RANGES[self.kind]
        if not allowed.least <= self.size <= allowed.most:
            raise InputError(
                f"the size of drift {self.kind} is {self.size:g}; "
                f"it must be {allowed.least:g} to {allowed.most:g}."
            )
        if bool(self.projector) != (self.kind in PROJECTOR_CHANGES):
            need = "needs the name of a projector" if not self.projector else "takes no projector"
            raise InputError(f"drift {self.kind} {need}.")
        if self.channel not in (0, 1, 2):
            raise InputError(
                f"the channel of drift {self.kind} is {self.channel}; it must be 0 to 2."
            )
        if not np.isfinite(self.angle_deg):
            raise InputError(f"the angle_deg of drift {self.kind} is {self.angle_deg}.")


@dataclass(frozen=True)
class _Range:
    """Sizes from `least` to `most` are allowed; `drawn` are typical, of either sign if `signed`."""

    least: float
    most: float
    drawn: tuple[float, float]
    signed: bool = False


RANGES: Mapping[str, _Range] = {
    "turned": _Range(0, 20, (0.05, 0.5)),
    "shifted": _Range(0, 500, (1.5, 10)),
    "zoomed": _Range(-0.5, 1, (0.005, 0.03), signed=True),
    "keystone": _Range(0, 0.9, (0.02, 0.1)),
    "mirrored": _Range(0, 1, (1, 1)),
    "overscan": _Range(0, 1, (0.02, 0.06)),
    "defocused": _Range(0, 20, (1.2, 3)),
    "aged": _Range(0, 1, (0.05, 0.3)),
    "colour-aged": _Range(0, 1, (0.06, 0.3)),
    "gamma": _Range(-0.9, 5, (0.05, 0.2), signed=True),
    "raised-black": _Range(0, 1, (0.02, 0.08)),
    "dynamic-black": _Range(0, 1, (0.3, 0.8)),
    "dead-channel": _Range(0, 1, (1, 1)),
    "no-picture": _Range(0, 1, (1, 1)),
    "warming": _Range(0, 1, (0.06, 0.25)),
    "dust": _Range(0, 0.95, (0.04, 0.15)),
    "stain": _Range(0, 0.95, (0.1, 0.4)),
    "floor": _Range(-1, 1, (0.12, 0.4)),
    "ambient": _Range(0, 10, (0.01, 0.1)),
    "camera-moved": _Range(0, 20, (0.2, 2)),
    "aperture": _Range(-0.95, 10, (0.05, 0.3), signed=True),
}
KINDS = tuple(RANGES)


def drifted(base: DomeScene, drifts: Sequence[Drift], session: int = 0) -> DomeScene:
    """The venue after `drifts`, one upon the other, in standby; what did not change is used again.

    `base` itself may have drifted. Lamps keep the light they had, cameras their law of noise. Noise of the
    photographs and gain of the cameras are those of `base` (session 0) unless `session` differs.
    """
    preset, cameras = base.preset, [_of_session(c, session) for c in base.cameras.values()]
    projectors = {name: light.build for name, light in base.lights.items()}
    for drift in drifts:
        if drift.kind in PROJECTOR_CHANGES:
            _require_projector(drift, projectors)
            change = PROJECTOR_CHANGES[drift.kind]
            projectors[drift.projector] = change(projectors[drift.projector], drift)
        elif drift.kind in ROOM_CHANGES:
            preset = ROOM_CHANGES[drift.kind](preset, drift)
        else:
            cameras[0] = CAMERA_CHANGES[drift.kind](cameras[0], drift)
    devices = Devices(tuple(projectors.values()), cameras, session)
    return DomeScene(preset, base.size, base.seed, like=base, devices=devices)


def _of_session(build: CameraBuild, session: int) -> CameraBuild:
    """A camera with the gain that it has in another session than its first, 0."""
    if not session:
        return build
    rng = np.random.default_rng([session, zlib.crc32(build.name.encode())])
    red, green, blue = np.exp(GAIN_SIGMA * rng.standard_normal(3))
    return replace(build, flaws=replace(build.flaws, gain=(float(red), float(green), float(blue))))


def draw_drift(kind: str, rng: np.random.Generator, projectors: Sequence[str]) -> Drift:
    """A drift of a size that a crew meets and would want found, of one of the `projectors`."""
    if kind not in RANGES:
        raise InputError(f"drift {kind} is not one of {', '.join(KINDS)}.")
    drawn = RANGES[kind].drawn
    size = float(rng.uniform(*drawn))
    sign = -1 if RANGES[kind].signed and rng.random() < 0.5 else 1
    projector = str(rng.choice(projectors)) if kind in PROJECTOR_CHANGES else ""
    return Drift(kind, sign * size, projector, float(rng.uniform(0, 360)), int(rng.integers(3)))


def _require_projector(drift: Drift, names: Mapping[str, ProjectorBuild]) -> None:
    if drift.projector not in names:
        raise InputError(
            f"drift {drift.kind}: projector {drift.projector} is not one of {', '.join(names)}."
        )


def _in_picture(angle_deg: float) -> Array:
    """Unit vector (2,) of an angle in a picture, whose y points down."""
    return np.array([np.cos(np.radians(angle_deg)), -np.sin(np.radians(angle_deg))])


def _turned(build: ProjectorBuild, drift: Drift) -> ProjectorBuild:
    axis = np.append(_in_picture(drift.angle_deg), 0.0)
    turn = rotation_matrix(np.radians(drift.size) * axis)
    old = build.projector_from_dome
    return replace(build, projector_from_dome=Pose(turn @ old.rotation, turn @ old.translation))


def _shifted(build: ProjectorBuild, drift: Drift) -> ProjectorBuild:
    centre = build.lens.centre + drift.size * _in_picture(drift.angle_deg)
    return replace(build, lens=replace(build.lens, centre=centre))


def _zoomed(build: ProjectorBuild, drift: Drift) -> ProjectorBuild:
    return replace(build, lens=replace(build.lens, focal=build.lens.focal * (1 + drift.size)))


def _keystone(build: ProjectorBuild, drift: Drift) -> ProjectorBuild:
    """The nearest edge, 0 right, 1 upper, 2 left, 3 lower, with both its ends moved inwards."""
    width, height = build.size
    corners = np.array([[width, height], [width, 0], [0, 0], [0, height]], np.float32) - 0.5
    edge = round(drift.angle_deg / 90) % 4
    ends = [edge, (edge + 1) % 4]
    moved = corners.copy()
    moved[ends] += 0.5 * np.float32(drift.size) * (corners[ends[::-1]] - corners[ends])
    return _rescaled(build, np.asarray(cv2.getPerspectiveTransform(corners, moved), float))


def _mirrored(build: ProjectorBuild, _drift: Drift) -> ProjectorBuild:
    return _rescaled(build, np.array([[-1.0, 0, build.size[0] - 1], [0, 1, 0], [0, 0, 1]]))


def _overscan(build: ProjectorBuild, drift: Drift) -> ProjectorBuild:
    x, y = (np.array(build.size) - 1) / 2
    s = drift.size
    return _rescaled(build, np.array([[1 + s, 0, -s * x], [0, 1 + s, -s * y], [0, 0, 1]]))


def _rescaled(build: ProjectorBuild, warp: Array) -> ProjectorBuild:
    """The build whose pictures are warped by a homography (3, 3) on top of what they are."""
    old = build.scaler or Scaler()
    return replace(build, scaler=replace(old, panel_from_input=warp @ old.panel_from_input))


def _raised_black(build: ProjectorBuild, drift: Drift) -> ProjectorBuild:
    old = build.scaler or Scaler()
    lift = old.lift + drift.size * (1 - old.lift)
    return replace(build, scaler=replace(old, lift=lift))


def _no_picture(build: ProjectorBuild, _drift: Drift) -> ProjectorBuild:
    return replace(build, scaler=replace(build.scaler or Scaler(), connected=False))


def _dimmed(build: ProjectorBuild, channels: slice, loss: float) -> ProjectorBuild:
    """The build without a share of the light of some primaries, black included."""
    mix = build.colour_mix.copy()
    mix[:, channels] *= 1 - loss
    return replace(build, colour_mix=mix)


def _one(drift: Drift) -> slice:
    return slice(drift.channel, drift.channel + 1)


def _floor(preset: Preset, drift: Drift) -> Preset:
    albedo = np.clip(preset.floor_albedo + drift.size, 0.0, HIGHEST_FLOOR_ALBEDO)
    return replace(preset, floor_albedo=float(albedo))


def _camera_moved(build: CameraBuild, drift: Drift) -> CameraBuild:
    """The camera on a tripod put back roughly; axis and shift are directions that the angle fixes."""
    a = np.radians(drift.angle_deg)
    axis = np.array([np.cos(a), np.sin(a), np.cos(5 * a)])
    turn = rotation_matrix(np.radians(drift.size) * axis / np.linalg.norm(axis))
    away = np.array([np.cos(3 * a), np.sin(3 * a), np.sin(2 * a)])
    shift = drift.size * MOVED_M_PER_DEG * away / np.linalg.norm(away)
    old = build.camera_from_dome
    rotation = turn @ old.rotation
    return replace(build, camera_from_dome=Pose(rotation, -rotation @ (old.origin + shift)))


PROJECTOR_CHANGES: Mapping[str, Callable[[ProjectorBuild, Drift], ProjectorBuild]] = {
    "turned": _turned,
    "shifted": _shifted,
    "zoomed": _zoomed,
    "keystone": _keystone,
    "mirrored": _mirrored,
    "overscan": _overscan,
    "defocused": lambda b, d: replace(b, defocus_px=float(np.hypot(b.defocus_px, d.size))),
    "aged": lambda b, d: _dimmed(b, slice(3), d.size),
    "colour-aged": lambda b, d: _dimmed(b, _one(d), d.size),
    "gamma": lambda b, d: replace(b, gamma=b.gamma * (1 + d.size)),
    "raised-black": _raised_black,
    "dynamic-black": lambda b, d: replace(b, features=replace(b.features, dynamic_black=d.size)),
    "dead-channel": lambda b, d: _dimmed(b, _one(d), 1.0),
    "no-picture": _no_picture,
    "warming": lambda b, d: replace(b, features=replace(b.features, settling=d.size)),
}
ROOM_CHANGES: Mapping[str, Callable[[Preset, Drift], Preset]] = {
    "dust": lambda p, d: replace(p, dirt=(*p.dirt, (d.size, d.angle_deg))),
    "stain": lambda p, d: replace(p, stains=(*p.stains, (d.size, d.angle_deg))),
    "floor": _floor,
    "ambient": lambda p, d: replace(p, ambient=p.ambient + d.size),
}
CAMERA_CHANGES: Mapping[str, Callable[[CameraBuild, Drift], CameraBuild]] = {
    "camera-moved": _camera_moved,
    "aperture": lambda b, d: replace(b, aperture=b.aperture * (1 + d.size)),
}
