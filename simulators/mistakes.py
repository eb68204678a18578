"""Mistakes that leave photographs which look sound, each at a chosen strength.

The file is longer than 300 lines because every mistake is a short function of its own.

`make_mistake` builds one into a rig. What goes wrong where and when is drawn by a seed.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array32, Image
from procam.devices.protocols import BackendRig, Camera, Projector, Shown
from procam.model.frame import CameraSettings, Frame
from simulators.faults import BLACK_DN, GAMMA, TOP_DN, FaultyCamera, FaultyProjector

LONG = 2.0  # times the first exposure: from there an exposure counts as long
RADIUS_PX, SHARP_PX = 3, 1.2  # kernel and standard deviation of a sharpening filter
DUST = 0.03  # radius of a grain's shadow, as a share of the picture
PERSON = (0.10, 0.35)  # width and height of a person in the picture, as shares of it
CLOTHES = 0.15  # light of a person's clothes, as a share of that around them
SURE = 1e-4  # standard error of a glare of 0 that somebody is sure of

Counts = NDArray[np.uint16]
Altered = Callable[[Frame, int], Frame]  # by the number of photographs taken before


class AlteringCamera(FaultyCamera):
    """A camera whose photographs are altered, each as its number asks for."""

    def __init__(self, camera: Camera, alter: Altered) -> None:
        super().__init__(camera)
        self._alter, self._taken = alter, 0

    def capture(self) -> Frame:
        """The photograph, altered."""
        frame = self._alter(self._camera.capture(), self._taken)
        self._taken += 1
        return frame


class LimitedExposureCamera(FaultyCamera):
    """A camera that exposes long photographs shorter than it was asked to, and may say so."""

    def __init__(self, camera: Camera, share: float, *, says_so: bool) -> None:
        super().__init__(camera)
        self._share, self._says_so = share, says_so
        self._first_s: float | None = None
        self._requested = CameraSettings(0.1)

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """The settings in force, or those requested."""
        self._first_s = self._first_s or settings.exposure_s
        long = settings.exposure_s > LONG * self._first_s
        exposure_s = settings.exposure_s * (self._share if long else 1)
        self._requested = settings
        in_force = self._camera.configure(replace(settings, exposure_s=exposure_s))
        return in_force if self._says_so else settings

    def capture(self) -> Frame:
        """The photograph; its settings are those that the camera admits."""
        frame = self._camera.capture()
        return frame if self._says_so else replace(frame, settings=self._requested)


class LaggingCamera(FaultyCamera):
    """A camera that delivers the photograph before the requested one, with some probability."""

    def __init__(self, camera: Camera, share: float, rng: np.random.Generator) -> None:
        super().__init__(camera)
        self._share, self._rng = share, rng
        self._last: Frame | None = None

    def capture(self) -> Frame:
        """The photograph or the one before it, said to be of the settings that were asked for."""
        last, self._last = self._last, self._camera.capture()
        late = last is not None and last.counts.shape == self._last.counts.shape
        if not late or self._rng.random() >= self._share:
            return self._last
        assert last is not None
        return replace(last, settings=self._last.settings)


def _only(number: int, alter: Callable[[Frame], Frame], frame: Frame, taken: int) -> Frame:
    """Alter one photograph."""
    return alter(frame) if taken == number else frame


def _from(number: int, alter: Callable[[Frame], Frame], frame: Frame, taken: int) -> Frame:
    """Alter all photographs from one on."""
    return alter(frame) if taken >= number else frame


def _brighter(factor: float, frame: Frame) -> Frame:
    """As if exposed longer than stated."""
    return _with_light(frame, _light(frame) * np.float32(factor))


def _dusty(place: tuple[float, float], depth: float, frame: Frame) -> Frame:
    """Behind a grain of dust on the camera's lens, `depth` of the light dark in the middle."""
    light = _light(frame)
    height, width = light.shape[:2]
    y, x = np.mgrid[:height, :width].astype(np.float32)
    away = np.hypot(x - place[0] * width, y - place[1] * height) / (DUST * width)
    shadow = 1 - np.float32(depth) * np.exp(-(away**2))
    return _with_light(frame, light * (shadow if light.ndim == 2 else shadow[..., None]))


def _with_person(place: tuple[float, float], scale: float, frame: Frame) -> Frame:
    """A person in dark clothes before the screen, `scale` times as large as at arm's length."""
    light = _light(frame)
    height, width = light.shape[:2]
    body = np.zeros((height, width), np.uint8)
    centre = (round(place[0] * width), round(place[1] * height))
    axes = (round(scale * PERSON[0] * width / 2), round(scale * PERSON[1] * height / 2))
    cv2.ellipse(body, centre, axes, 0.0, 0.0, 360.0, 1, -1)
    clothes = CLOTHES * light.mean(axis=(0, 1))
    mask = body.astype(bool)
    light[mask] = clothes
    return _with_light(frame, light)


def _sharpened(amount: float, frame: Frame) -> Frame:
    """Sharpened by an unsharp mask in the camera."""
    light = _light(frame)
    soft = cv2.GaussianBlur(light, (2 * RADIUS_PX + 1,) * 2, SHARP_PX)
    return _with_light(frame, light + np.float32(amount) * (light - soft))


def _shifted(shift_px: tuple[float, float], frame: Frame) -> Frame:
    """By a camera that was turned a little."""
    light = _light(frame)
    moved = np.array([[1, 0, shift_px[0]], [0, 1, shift_px[1]]], np.float32)
    size = (light.shape[1], light.shape[0])
    turned = cv2.warpAffine(light, moved, size, flags=cv2.INTER_CUBIC)
    return _with_light(frame, np.asarray(turned, np.float32))


def blended(width: float, drive: Array32) -> Array32:
    """A picture (H, W, 3) with the edge blend of a projector's menu, `width` of it on each side."""
    columns = drive.shape[1]
    away = np.minimum(np.arange(columns), np.arange(columns)[::-1]) / (width * columns)
    ramp = np.clip(away, 0, 1) ** np.float32(1 / GAMMA)
    return np.asarray(drive * ramp[None, :, None], np.float32)


def with_dynamic_black(depth: float, drive: Array32) -> Array32:
    """A picture (H, W, 3) of a projector that dims dark pictures, black by `depth` of its light."""
    share = 1 - depth * (1 - float(drive.mean()))
    return drive * np.float32(share ** (1 / GAMMA))


def sharpened_picture(amount: float, drive: Array32) -> Array32:
    """A picture (H, W, 3) sharpened by the projector."""
    soft = cv2.GaussianBlur(drive, (2 * RADIUS_PX + 1,) * 2, SHARP_PX)
    return np.asarray(np.clip(drive + np.float32(amount) * (drive - soft), 0, 1), np.float32)


def _light(frame: Frame) -> Image:
    return frame.counts.astype(np.float32) - BLACK_DN


def _with_light(frame: Frame, light: Image) -> Frame:
    counts = np.rint(np.clip(light + BLACK_DN, 0, TOP_DN)).astype(np.uint16)
    return replace(frame, counts=counts)


PICTURE_MISTAKES: Mapping[str, Callable[[float, Array32], Array32]] = {
    "edge blend left on": blended,
    "dynamic black left on": with_dynamic_black,
    "sharpening in the projectors": sharpened_picture,
}


class FlippedProjector(FaultyProjector):
    """A projector that is switched to mirrored (rear projection, ceiling) after some of its pictures."""

    def __init__(self, projector: Projector, after: int, *, upside_down: bool) -> None:
        super().__init__(projector, self._flipped)
        self._after, self._upside_down, self._changes = after, upside_down, 0

    def show(self, drive: Array32) -> Shown:
        """Show the picture, mirrored once the menu was changed."""
        self._changes += 1
        return super().show(drive)

    def _flipped(self, drive: Array32) -> Array32:
        if self._changes <= self._after:
            return drive
        return np.ascontiguousarray(drive[::-1] if self._upside_down else drive[:, ::-1])


def _banded(bands: float, phase: float, depth: float, frame: Frame) -> Frame:
    """By a rolling shutter under light that pulses, in step with it: the same rows are dark each time."""
    light = _light(frame)
    row = np.arange(len(light)) / len(light)
    pulse = 1 + depth * np.sin(2 * np.pi * (bands * row + phase))
    return _with_light(frame, light * pulse.astype(np.float32).reshape(-1, *[1] * (light.ndim - 1)))


def _darker_at_edge(loss: float, frame: Frame) -> Frame:
    """By a lens that leaves so much less at the edge of the picture than the camera's own."""
    light = _light(frame)
    height, width = light.shape[:2]
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j].astype(np.float32)
    fall = 1 - np.float32(loss) * np.minimum(x**2 + y**2, 1)
    return _with_light(frame, light * fall.reshape(height, width, *[1] * (light.ndim - 2)))


def _veiled(glare: float, frame: Frame) -> Frame:
    """Behind a lens that veils every pixel by a share of the mean."""
    light = _light(frame)
    return _with_light(frame, light + np.float32(glare) * (light.mean(axis=(0, 1)) - light))


def _cropped(share: float, frame: Frame) -> Frame:
    """Cropped by a share and enlarged to its size again, as by a stabiliser or a lens correction."""
    light = _light(frame)
    height, width = light.shape[:2]
    y, x = round(share * height / 2), round(share * width / 2)
    middle = np.ascontiguousarray(light[y : height - y, x : width - x])
    enlarged = cv2.resize(middle, (width, height), interpolation=cv2.INTER_LINEAR)
    return _with_light(frame, np.asarray(enlarged, np.float32))


def cropped_pixel(
    share: float, pixel: tuple[float, float], size: tuple[int, int]
) -> tuple[float, float]:
    """Where a place of a picture of `size` lies once it is cropped, as somebody clicks on it."""
    x, y = (
        (n - 1) / 2 + (p - (n - 1) / 2) * n / (n - 2 * round(share * n / 2))
        for p, n in zip(pixel, size, strict=True)
    )
    return x, y


def without_vignetting(_: float, __: Mapping[str, Any]) -> dict[str, Any]:
    """Keys of a camera in venue.toml if nobody has measured its vignetting."""
    return {"vignetting": []}


def without_glare(_: float, __: Mapping[str, Any]) -> dict[str, Any]:
    """Keys of a camera in venue.toml if somebody is sure that the lens has no veil."""
    return {"glare": 0.0, "glare_sigma": SURE}


# What is wrong in venue.toml, by the keys of a camera that are there; the rest is in the photographs.
SETTING_MISTAKES: Mapping[str, Callable[[float, Mapping[str, Any]], dict[str, Any]]] = {
    "vignetting left out": without_vignetting,
    "glare left out": without_glare,
}
STRENGTHS: Mapping[str, tuple[float, float, float]] = {
    "long exposures shorter, reported": (0.95, 0.7, 0.4),
    "long exposures shorter, unreported": (0.95, 0.7, 0.4),
    "one photograph exposed wrongly": (1.02, 1.1, 1.5),
    "a person in one photograph": (0.3, 0.6, 1.0),
    "a person in all photographs": (0.3, 0.6, 1.0),
    "dust on the camera's lens": (0.05, 0.15, 0.4),
    "edge blend left on": (0.03, 0.1, 0.25),
    "dynamic black left on": (0.01, 0.05, 0.3),
    "sharpening in the projectors": (0.3, 1.0, 2.0),
    "sharpening in the camera": (0.3, 1.0, 2.0),
    "photographs lag by one": (0.02, 0.1, 1.0),
    "the camera was nudged": (0.3, 0.6, 1.0),
    "vignetting left out": (0.0, 0.1, 0.2),
    "glare left out": (0.0, 0.01, 0.03),
    "banding in step": (0.01, 0.03, 0.1),
    "photographs cropped": (0.01, 0.02, 0.05),
    "a projector mirrored midway": (0.3, 0.6, 0.8),
}


def make_mistake(
    rig: BackendRig, name: str, strength: float, photographs: int, seed: int
) -> BackendRig:
    """A rig with a mistake of `STRENGTHS` built in; a session takes so many photographs."""
    rng = np.random.default_rng([20262, seed])
    if name == "a projector mirrored midway":
        last = list(rig.projectors)[-1]
        after = round(strength * photographs / len(rig.projectors))
        upside_down = bool(rng.integers(2))
        flipped = FlippedProjector(rig.projectors[last], after, upside_down=upside_down)
        return replace(rig, projectors={**rig.projectors, last: flipped})
    if name in PICTURE_MISTAKES:
        alter = partial(PICTURE_MISTAKES[name], strength)
        faulty: dict[str, Projector] = {
            n: FaultyProjector(p, alter) for n, p in rig.projectors.items()
        }
        return replace(rig, projectors=faulty)
    cameras = {n: _camera(c, name, strength, photographs, rng) for n, c in rig.cameras.items()}
    return replace(rig, cameras=cameras)


def _camera(
    camera: Camera, name: str, strength: float, photographs: int, rng: np.random.Generator
) -> Camera:
    number = int(rng.integers(2, photographs))  # of the photograph that is wrong
    middle = photographs // 4 + number // 2  # from which a nudged camera stands elsewhere
    place = (float(rng.uniform(0.3, 0.7)), float(rng.uniform(0.3, 0.7)))
    angle = float(rng.uniform(0, 2 * np.pi))
    shift = (strength * np.cos(angle), strength * np.sin(angle))
    if name.startswith("long exposures"):
        return LimitedExposureCamera(camera, strength, says_so=name.endswith(" reported"))
    if name == "photographs lag by one":
        return LaggingCamera(camera, strength, rng)
    bands, phase = float(rng.uniform(2, 12)), float(rng.uniform())
    alter: dict[str, Altered] = {
        "one photograph exposed wrongly": partial(_only, number, partial(_brighter, strength)),
        "a person in one photograph": partial(
            _only, number, partial(_with_person, place, strength)
        ),
        "a person in all photographs": partial(_from, 0, partial(_with_person, place, strength)),
        "dust on the camera's lens": partial(_from, 0, partial(_dusty, place, strength)),
        "sharpening in the camera": partial(_from, 0, partial(_sharpened, strength)),
        "the camera was nudged": partial(_from, middle, partial(_shifted, shift)),
        "vignetting left out": partial(_from, 0, partial(_darker_at_edge, strength)),
        "glare left out": partial(_from, 0, partial(_veiled, strength)),
        "banding in step": partial(_from, 0, partial(_banded, bands, phase, strength)),
        "photographs cropped": partial(_from, 0, partial(_cropped, strength)),
    }
    return AlteringCamera(camera, alter[name])


def reading_limited_range(share: float, drive: Array32) -> Array32:
    """A picture (H, W, 3) by an input that takes its full range for a limited one, or a share of that."""
    low, high = share * BLACK_CODE, 1 - share * (1 - WHITE_CODE)
    return np.asarray(np.clip((drive - low) / (high - low), 0, 1), np.float32)


def sent_in_limited_range(share: float, drive: Array32) -> Array32:
    """A picture (H, W, 3) in a limited range that the input takes for the full one, or a share of that."""
    low, high = share * BLACK_CODE, 1 - share * (1 - WHITE_CODE)
    return np.asarray(low + (high - low) * drive, np.float32)


def with_clipped_white(share: float, drive: Array32) -> Array32:
    """A picture (H, W, 3) whose brightest drives are all white: too much contrast."""
    return np.asarray(np.minimum(drive / (1 - share * (1 - WHITE_CODE)), 1), np.float32)


def with_other_blue(exponent: float, drive: Array32) -> Array32:
    """A picture (H, W, 3) with another gamma of blue."""
    return np.asarray(drive ** np.array([1, 1, exponent], np.float32), np.float32)


BLACK_CODE, WHITE_CODE = 16 / 255, 235 / 255  # drives of black and white in a limited range
# of one projector, after a calibration
LATER_PICTURES: Mapping[str, Callable[[float, Array32], Array32]] = {
    "one input takes full range for limited": reading_limited_range,
    "one input takes limited range for full": sent_in_limited_range,
    "too much contrast in one projector": with_clipped_white,
    "dynamic black switched on in one": with_dynamic_black,
    "another gamma of blue in one": with_other_blue,
}
LATER_STRENGTHS: Mapping[str, tuple[float, float, float]] = {
    "one input takes full range for limited": (0.3, 0.6, 1.0),
    "one input takes limited range for full": (0.3, 0.6, 1.0),
    "too much contrast in one projector": (0.4, 0.7, 1.0),
    "dynamic black switched on in one": (0.1, 0.3, 0.6),
    "another gamma of blue in one": (1.08, 1.15, 1.3),
}


def make_later_mistake(rig: BackendRig, name: str, strength: float) -> BackendRig:
    """A rig whose last projector has a mistake of `LATER_STRENGTHS`."""
    last = list(rig.projectors)[-1]
    faulty = FaultyProjector(rig.projectors[last], partial(LATER_PICTURES[name], strength))
    return replace(rig, projectors={**rig.projectors, last: faulty})


def with_zeros(size: int, rng: np.random.Generator, data: bytes) -> bytes:
    """A file's data with `size` bytes of zeros somewhere behind its first tenth."""
    first = len(data) // 10
    start = int(rng.integers(first, max(len(data) - size, first + 1)))
    return data[:start] + bytes(len(data[start : start + size])) + data[start + size :]
