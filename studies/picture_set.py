"""Pictures for the study of the perceptual method: drawn here from seeds, or stored in calib_data.

All are (256, 256, 3) in linear light, 1.0 is white. Settings may be tuned on `TRAINING` alone; what is
reported is `HELD_OUT`. The split was committed before any setting was tried.
"""

import hashlib
from collections.abc import Callable, Mapping
from functools import partial
from importlib.resources import files

import cv2
import numpy as np
from numpy.typing import NDArray

from procam.maths.light.transfer import transfer

Image = NDArray[np.float32]
Array = NDArray[np.float64]
SIZE = 256
#: stored pictures by name, with the SHA-256 of their files
STORED: Mapping[str, str] = {
    "astronaut": "6920df7795cecc620fde643c0caa984e5f36cc657d580c50185f298e65c4332b",
    "coffee": "36647fac1777795aab040d342976333e585b2864c59b2d26eac7df2886955d4d",
    "earth-africa": "39775cae59e5b3768056d0369702bd122b35067d82b8662dd45a6f58e88001fc",
    "earth-americas": "f3ab53a641a4dd71aed33358d36b38359f0624d8410fc492c6132f9842d52933",
    "earth-asia": "add78250134674fb484ef48f11fe0e54c6be5ba1d1bb3c241d1cc292bbe1c5d4",
    "hopper": "636efe94f70e177dfcfca699ad294e2e5299911dba53307177923ec4bbda907a",
    "hubble": "e25bb56b37fa59401769371643e299528aee030f041a542058a4c3bbb848e8ab",
    "relief-alps": "7f9ebf053c70b7e615c1bdcf428e7d1772a9587a953ddb0bafb6463db39f52ef",
    "rocket": "ffa10813c06204cf44a34a856a0363ccfbffa99e440d39d13557360f78c7182f",
}
TRAINING = (
    *("astronaut", "coffee", "hubble", "rocket", "earth-americas"),
    *("sunset", "forest", "stars", "room", "slide-dark", "face"),
)
HELD_OUT = (
    *("hopper", "earth-africa", "earth-asia", "relief-alps"),
    *(
        "clouds",
        "milky-way",
        "nave",
        "page",
        "faces",
        "city-night",
        "reef",
        "aurora",
        "planet",
        "snow",
    ),
)


def picture(name: str) -> Image:
    """A picture by its name; a stored one must be the file that the study was made with."""
    if name in DRAWN:
        return np.clip(DRAWN[name](), 0, 1).astype(np.float32)
    data = files("calib_data").joinpath("pictures", f"{name}.png").read_bytes()
    if hashlib.sha256(data).hexdigest() != STORED[name]:
        raise ValueError(f"calib_data/pictures/{name}.png has changed; restore it")
    bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert bgr is not None
    return np.asarray(transfer("srgb").decode(bgr[..., ::-1] / 255), np.float32)


def _grid() -> tuple[Array, Array]:
    """Column x and row y of the pixels, 0 to 1, y downwards."""
    line = (np.arange(SIZE) + 0.5) / SIZE
    x, y = np.meshgrid(line, line)
    return x, y


def _noise(seed: int, power: float = 1.0, stretch: float = 1.0) -> Array:
    """Noise of mean 0 and deviation 1 whose amplitude falls with frequency to a power."""
    rng = np.random.default_rng(seed)
    across, down = np.fft.rfftfreq(SIZE)[None, :], np.fft.fftfreq(SIZE)[:, None]
    frequency = np.maximum(np.hypot(across, stretch * down), 1 / SIZE)
    spectrum = np.fft.rfft2(rng.normal(size=(SIZE, SIZE))) / frequency**power
    noise = np.fft.irfft2(spectrum, s=(SIZE, SIZE))
    return np.asarray((noise - noise.mean()) / noise.std())


def _mix(a: object, b: object, share: Array) -> Array:
    """Colours (or pictures) a where the share is 0, b where it is 1."""
    first, second = np.asarray(a, float), np.asarray(b, float)
    return np.asarray(first + (second - first) * np.clip(share, 0, 1)[..., None])


def _step(value: Array, width: float = 0.006) -> Array:
    """0 to 1 around 0, over a width."""
    return np.asarray(1 / (1 + np.exp(np.clip(-4 * value / width, -60, 60))))


def _stars(seed: int, count: int, sigma_px: float = 0.8) -> Array:
    """Light of stars, their magnitudes distributed as in the sky."""
    rng = np.random.default_rng(seed)
    light = np.zeros((SIZE, SIZE))
    at = rng.integers(0, SIZE, (2, count))
    np.add.at(light, tuple(at), 0.05 * rng.uniform(0.02, 1, count) ** -1.0)
    return np.asarray(cv2.GaussianBlur(light, (0, 0), sigma_px) * 2 * np.pi * sigma_px**2)


def _sunset() -> Array:
    x, y = _grid()
    sky = _mix((0.10, 0.14, 0.35), (0.95, 0.45, 0.16), (y / 0.62) ** 2)
    sun = np.exp(-((np.hypot(x - 0.6, y - 0.52) / 0.05) ** 2))
    sky = _mix(sky, (1.0, 0.92, 0.7), sun + 0.4 * np.exp(-np.hypot(x - 0.6, y - 0.52) / 0.12))
    sky *= 1 - 0.35 * np.clip(_noise(11, 1.6, 4.0), 0, 1)[..., None]
    hills = 0.62 + 0.03 * np.sin(9 * x) + 0.02 * np.sin(23 * x + 1)
    ground = np.array([0.030, 0.026, 0.020]) * (1 + 0.5 * _noise(12, 0.8)[..., None])
    return _mix(sky, ground, _step(y - hills))


def _forest() -> Array:
    x, y = _grid()
    scene = _mix((0.55, 0.70, 0.85), (0.75, 0.80, 0.70), y / 0.6)
    for layer, (base, tone) in enumerate(((0.45, 0.16), (0.55, 0.07), (0.68, 0.02))):
        crown = base - 0.10 * np.abs(((x * (9 - 2 * layer) + 0.3 * layer) % 1) * 2 - 1)
        crown += 0.012 * _noise(21 + layer, 0.6)
        leaves = tone * np.array([0.7, 1.0, 0.5]) * np.exp(0.5 * _noise(31 + layer, 0.7))[..., None]
        scene = _mix(scene, leaves, _step(y - crown))
    return scene


def _night_sky() -> Array:
    _, y = _grid()
    sky = _mix((0.004, 0.005, 0.010), (0.05, 0.04, 0.03), y**3)
    return np.asarray(sky + _stars(41, 400)[..., None] * np.array([0.95, 0.97, 1.0]))


def _room() -> Array:
    x, y = _grid()
    wall = _mix((0.34, 0.31, 0.26), (0.20, 0.18, 0.15), y) * (1 + 0.03 * _noise(51, 0.5)[..., None])
    pane = np.abs((x * 3) % 1 - 0.5)
    window = _step(0.34 - pane) * _step(0.20 - np.abs(y - 0.38)) * _step(pane - 0.01)
    scene = _mix(wall, (0.92, 0.96, 1.0), window * _step(np.abs(y - 0.38) - 0.006))
    floor = np.array([0.11, 0.06, 0.03]) * (1 + 0.3 * np.sin(60 * x / (y + 0.2)))[..., None]
    scene = _mix(scene, floor, _step(y - 0.78))
    shelf = np.array([0.05, 0.035, 0.025]) * (1 + 0.4 * _noise(52, 0.6)[..., None])
    return _mix(scene, shelf, _step(0.12 - np.abs(x - 0.2)) * _step(y - 0.62) * _step(0.95 - y))


def _text(ink: float, paper: float, seed: int, lines: int) -> Array:
    """A page of words; its letters are OpenCV's."""
    mask = np.zeros((4 * SIZE, 4 * SIZE), np.uint8)
    words = "night sky dome light calibrate at the edge of a screen where black is grey".split()
    rng = np.random.default_rng(seed)
    pitch = 4 * SIZE // (lines + 1)
    for line in range(lines):
        said = " ".join(rng.choice(words, 7))
        at = (40, (line + 1) * pitch)
        cv2.putText(mask, said, at, cv2.FONT_HERSHEY_SIMPLEX, pitch / 50, 255, max(pitch // 22, 2))
    share = cv2.resize(mask, (SIZE, SIZE), interpolation=cv2.INTER_AREA) / 255
    return _mix((paper,) * 3, (ink,) * 3, share)


def _slide() -> Array:
    x, y = _grid()
    page = _text(0.75, 0.006, 61, 9)
    chart = _step(0.012 - np.abs(y - 0.75 + 0.12 * np.sin(12 * x))) * _step(x - 0.55)
    return _mix(page, (0.9, 0.35, 0.1), chart)


def _head(x: Array, y: Array, skin: object, seed: int) -> tuple[Array, Array]:
    """Colour and cover of a head about the origin, lit from the left: smooth gradients and soft edges."""
    round_ = np.sqrt(np.clip(1 - (x / 0.75) ** 2 - y**2, 0, 1))
    normal = np.stack([x / 0.75, y, round_], axis=-1)
    light = np.clip(normal @ np.array([-0.55, -0.35, 0.76]), 0.02, 1)[..., None]
    colour = np.asarray(skin, float) * light * (1 + 0.02 * _noise(seed, 0.4)[..., None])
    for side in (-1, 1):
        eye = np.exp(-(((x - 0.28 * side) / 0.11) ** 2 + ((y + 0.12) / 0.06) ** 2) * 2)
        colour = _mix(colour, (0.02, 0.015, 0.012), eye)
    mouth = np.exp(-((x / 0.25) ** 2 + ((y - 0.45) / 0.05) ** 2) * 2)
    colour = _mix(colour, np.asarray(skin) * np.array([0.7, 0.3, 0.3]), mouth)
    hair = _step(-0.45 - y + 0.15 * x**2, 0.1)
    colour = _mix(
        colour, np.array([0.03, 0.02, 0.012]) * np.exp(0.4 * _noise(seed + 1, 0.5))[..., None], hair
    )
    return colour, _step(1 - np.hypot(x / 0.75, y), 0.04)


def _portraits(
    heads: tuple[tuple[float, float, float, tuple[float, float, float]], ...],
    back: Array,
    seed: int,
) -> Array:
    x, y = _grid()
    scene = back
    for number, (across, down, radius, skin) in enumerate(heads):
        colour, cover = _head((x - across) / radius, (y - down) / radius, skin, seed + 10 * number)
        scene = _mix(scene, colour, cover)
    return scene


def _face() -> Array:
    x, _ = _grid()
    return _portraits(
        ((0.5, 0.5, 0.40, (0.75, 0.50, 0.38)),), _mix((0.5, 0.5, 0.55), (0.02, 0.02, 0.03), x), 71
    )


def _faces() -> Array:
    _, y = _grid()
    heads = (
        (0.22, 0.45, 0.24, (0.80, 0.58, 0.46)),
        (0.54, 0.55, 0.26, (0.22, 0.12, 0.08)),
        (0.83, 0.42, 0.20, (0.50, 0.33, 0.22)),
    )
    return _portraits(heads, _mix((0.85, 0.82, 0.75), (0.25, 0.22, 0.20), y), 171)


def _clouds() -> Array:
    x, y = _grid()
    cover = np.clip(0.5 + 0.55 * _noise(81, 1.5, 2.0), 0, 1) ** 1.5
    sky = _mix(_mix((0.10, 0.25, 0.65), (0.45, 0.60, 0.80), y / 0.7), (0.95, 0.95, 0.95), cover)
    ridge = 0.70 + 0.05 * np.sin(7 * x + 0.5) + 0.015 * _noise(82, 1.4)
    ground = np.array([0.05, 0.08, 0.025]) * np.exp(0.7 * _noise(83, 0.9))[..., None]
    return _mix(sky, ground, _step(y - ridge))


def _milky_way() -> Array:
    x, y = _grid()
    band = np.exp(-(((x - y) / 0.18) ** 2)) * np.exp(0.5 * _noise(91, 1.2))
    dust = np.exp(-(((x - y + 0.02) / 0.05) ** 2)) * np.clip(0.6 + 0.6 * _noise(92, 1.1), 0, 1)
    glow = band * (1 - 0.8 * np.clip(dust, 0, 1))
    sky = np.array([0.004, 0.005, 0.008]) + 0.07 * glow[..., None] * np.array([1.0, 0.88, 0.75])
    return np.asarray(sky + (_stars(93, 900, 0.7) * (0.4 + glow))[..., None])


def _nave() -> Array:
    x, y = _grid()
    depth = np.hypot(x - 0.5, 0.8 * (y - 0.55))
    stone = np.array([0.16, 0.13, 0.10]) * (0.15 + 1.6 * depth)[..., None]
    angle = np.arctan2(y - 0.55, x - 0.5)
    ribs = 0.7 + 0.3 * np.cos(24 * angle) * np.cos(10 / (depth + 0.1))
    stone = stone * ribs[..., None] * (1 + 0.1 * _noise(101, 0.6)[..., None])
    glass = np.stack(
        [0.5 + 0.5 * np.sin(40 * x + k) * np.sin(50 * y + 2 * k) for k in range(3)], axis=-1
    )
    rose = _step(0.11 - np.hypot(x - 0.5, y - 0.3))
    side = _step(0.03 - np.abs(np.abs(x - 0.5) - 0.33)) * _step(0.17 - np.abs(y - 0.40))
    return _mix(stone, glass * np.array([1.0, 0.75, 0.9]), rose + side)


def _city_night() -> Array:
    x, y = _grid()
    rng = np.random.default_rng(111)
    sky = _mix((0.006, 0.008, 0.02), (0.06, 0.04, 0.035), y)
    height = 0.25 + 0.5 * rng.random(16)
    tower = _step(y - height[np.minimum((x * 16).astype(int), 15)])
    scene = _mix(sky, np.array([0.010, 0.011, 0.014]), tower)
    cell = (np.floor(x * 64) + 64 * np.floor(y * 64)).astype(int)
    on = (
        (rng.random(64 * 64) < 0.25)[cell]
        * (np.abs((x * 64) % 1 - 0.5) < 0.3)
        * (np.abs((y * 64) % 1 - 0.5) < 0.3)
    )
    tint = rng.uniform(0.3, 1, (64 * 64, 1)) * np.array([1.0, 0.75, 0.4])
    return _mix(scene, tint[cell], on * tower)


def _reef() -> Array:
    x, y = _grid()
    water = _mix((0.25, 0.65, 0.70), (0.005, 0.03, 0.10), y**0.7)
    rays = np.clip(np.sin(30 * (x + 0.4 * y) + 2 * _noise(121, 2.0)), 0, 1) * (1 - y) ** 2
    water = water * (1 + 0.6 * rays[..., None])
    coral = np.stack([np.exp(0.8 * _noise(122 + k, 0.9)) for k in range(3)], axis=-1) * np.array(
        [0.09, 0.04, 0.05]
    )
    return _mix(water, coral, _step(y - 0.68 - 0.06 * _noise(125, 1.4), 0.02))


def _aurora() -> Array:
    x, y = _grid()
    fold = 0.45 + 0.10 * np.sin(5 * x + 0.8 * _noise(131, 2.0)[0])
    curtain = np.exp(-np.clip(fold - y, 0, None) / 0.18) * _step(fold - y, 0.03)
    curtain = curtain * (0.6 + 0.4 * np.sin(90 * x + 3 * np.sin(9 * x)))
    colour = _mix((0.45, 0.10, 0.50), (0.10, 0.80, 0.35), 1 - np.clip((fold - y) / 0.3, 0, 1))
    sky = (
        np.array([0.006, 0.008, 0.016])
        + 0.7 * curtain[..., None] * colour
        + _stars(132, 250)[..., None]
    )
    ground = np.array([0.02, 0.025, 0.03]) * np.exp(0.4 * _noise(133, 0.9))[..., None]
    return _mix(sky, ground, _step(y - 0.80 - 0.02 * np.sin(14 * x)))


def _planet() -> Array:
    x, y = _grid()
    across, down = (x - 0.46) / 0.30, (y - 0.5) / 0.30
    depth = np.sqrt(np.clip(1 - across**2 - down**2, 0, 1))
    light = np.clip(-0.6 * across - 0.2 * down + 0.77 * depth, 0, 1)
    bands = _mix(
        (0.85, 0.70, 0.50),
        (0.50, 0.33, 0.20),
        0.5 + 0.5 * np.sin(18 * down + 0.4 * _noise(141, 1.5)),
    )
    disc = _step(1 - np.hypot(across, down), 0.02)
    ring = np.hypot(across, 3.2 * (down + 0.25 * across))
    lit = 0.5 + 0.3 * np.sin(40 * ring)
    scene = np.zeros((SIZE, SIZE, 3)) + 0.3 * _stars(142, 200)[..., None]
    scene = _mix(scene, bands * light[..., None], disc)
    front = (
        _step(ring - 1.25, 0.03)
        * _step(1.9 - ring, 0.03)
        * np.maximum(1 - disc, down + 0.25 * across > 0)
    )
    return _mix(scene, lit[..., None] * np.array([0.60, 0.52, 0.42]), 0.85 * front)


def _snow() -> Array:
    x, y = _grid()
    slope = _mix((0.80, 0.84, 0.90), (0.55, 0.62, 0.78), 0.5 + 0.4 * _noise(151, 1.7))
    scene = _mix(slope, (0.35, 0.50, 0.80), _step(0.30 + 0.06 * np.sin(8 * x) - y))
    for number in range(14):
        at, foot = (number * 0.618) % 1, 0.45 + 0.5 * ((number * 0.382) % 1)
        size = 0.05 + 0.16 * (foot - 0.4)
        tree = _step((y - foot + 2.4 * size) * 0.32 - np.abs(x - at)) * _step(foot - y)
        bark = np.array([0.010, 0.018, 0.012]) * np.exp(0.6 * _noise(152, 0.6))[..., None]
        scene = _mix(scene, bark, tree)
    return scene


DRAWN: Mapping[str, Callable[[], Array]] = {
    "sunset": _sunset,
    "forest": _forest,
    "stars": _night_sky,
    "room": _room,
    "slide-dark": _slide,
    "face": _face,
    "clouds": _clouds,
    "milky-way": _milky_way,
    "nave": _nave,
    "page": partial(_text, 0.01, 0.85, 161, 11),
    "faces": _faces,
    "city-night": _city_night,
    "reef": _reef,
    "aurora": _aurora,
    "planet": _planet,
    "snow": _snow,
}
