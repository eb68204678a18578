"""Test pictures for judging a screen by eye: with and without compensation, and what to look for."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray, Image
from procam.compensate.any_screen import compensator_for
from procam.compensate.projector_frames import Warper
from procam.files import atomic
from procam.files.images.pixels import write_image
from procam.maths.codes.shot_id import DIGITS
from procam.maths.geometry.sphere import angles_from_direction, master_directions
from procam.maths.light.curves import srgb_decode, srgb_encode
from procam.model.calibration import Calibration
from procam.model.screen import Dome, RoomScreen, Screen
from procam.workflows.events import Event, Steps
from procam.workflows.playout.frame import require_photometry
from procam.workflows.room_stills import ROOM_STILLS
from procam.workflows.sample_content import BLACK_TEXT, HALF_SKY_TEXT, half_sky, white

SIZE = 1024  # px of the dome masters
MASTERS, CANVAS = "dome-masters", "canvas"
WITHOUT, WITH = "uncompensated", "compensated"
METHODS = {WITHOUT: "none", WITH: "exact"}
LINES_DEG, LABELS_DEG = 15.0, 30  # of the grid
LINE_DEG = 0.6
DOT_DEG = 0.9  # of the labels' digits, 3 x 5 dots
GREY, INK = 0.2, 0.9  # of the grid [rel]
PATCH_DEG = 18.0
STEPS = 16  # of the ramp
Stills = Mapping[str, tuple[Callable[[int], Image], str]]


def grid(size: int) -> Image:
    """Lines every 15 degrees with their azimuth and elevation every 30: (N, N, 3) linear."""
    azimuth, elevation, inside = _angles(size)
    circles = _from_multiple(elevation, LINES_DEG)
    spokes = _from_multiple(azimuth, LINES_DEG) * np.cos(np.radians(elevation))
    spokes = np.where(elevation > 90 - LINES_DEG, np.inf, spokes)  # they would merge at the zenith
    lines = np.minimum(circles, spokes) < LINE_DEG / 2
    for at, height, number in _labels():
        lines = lines & ~_block(azimuth, elevation, (at, height), number)
        lines = lines | _written(azimuth, elevation, (at, height), number)
    return _grey(np.where(lines, INK, GREY), inside)


def soft_checker(size: int) -> Image:
    """Patches of 18 degrees, light and dark, with soft edges: (N, N, 3) linear."""
    direction, inside = master_directions(size)
    azimuth, elevation = angles_from_direction(direction)
    from_pole = np.pi / 2 - elevation
    waves = [
        np.sin(np.pi * from_pole * turn(azimuth) / np.radians(PATCH_DEG))
        for turn in (np.cos, np.sin)
    ]
    return _grey(0.4 + 0.2 * np.tanh(4 * waves[0] * waves[1]), inside)


def ramp(size: int) -> Image:
    """Sixteen steps of grey from black in front to white at the back, on both sides: (N, N, 3) linear."""
    azimuth, _, inside = _angles(size)
    turned = np.abs((azimuth + 180) % 360 - 180) / 180
    step = np.minimum(np.floor(turned * STEPS), STEPS - 1) / (STEPS - 1)
    return _grey(srgb_decode(step), inside)


def black(size: int) -> Image:
    """Black: (N, N, 3) linear."""
    return np.zeros((size, size, 3), np.float32)


# picture, and what to look for in it
STILLS: Stills = {
    "grid": (
        grid,
        "Lines every 15 degrees; azimuth 0 is the front, 90 the left, 180 the back. Lines must be single and "
        "unbroken where projectors meet, circles round, and the numbers where the building has them.",
    ),
    "checker": (
        soft_checker,
        "Soft light and dark patches. Dark patches must be equally dark all over the dome, without seams. "
        "Without compensation they are paler.",
    ),
    "half-sky": (
        half_sky,
        HALF_SKY_TEXT,
    ),
    "ramp": (
        ramp,
        "Sixteen steps of grey, black in front. Steps must be neutral in colour, and equal on the left and "
        "on the right. The darkest ones look alike, because the light of the bright ones falls on them.",
    ),
    "white": (
        white,
        "Full white. No seam, no spot, no colour from one projector to the next. With compensation it is "
        "darker, as the scattered light is part of it.",
    ),
    "black": (
        black,
        BLACK_TEXT,
    ),
}


def write_stills(calibration: Calibration, folder: Path, size: int = SIZE) -> Steps[None]:
    """Write FOLDER/dome-masters/NAME.HOW.png, FOLDER/PROJECTOR/NAME.HOW.png and index.txt, 8 bits sRGB.

    Dome masters are on the standard canvas; a room has its canvas in FOLDER/canvas instead.

    HOW is "compensated" or "uncompensated". A calibration without projectors gives dome masters only. An
    event per picture.

    Raises
    ------
    InputError
        The calibration has no photometry.
    """
    require_photometry(calibration)
    calibration, kind = calibration.on(calibration.screen.canvas), compensator_for(calibration)
    warper = Warper(calibration, size) if calibration.projectors else None
    makers = {how: kind(calibration, size, m) for how, m in METHODS.items()}
    stills = _stills_of(calibration.screen)
    for done, (name, (draw, _)) in enumerate(stills.items(), 1):
        content = np.rint(srgb_encode(np.clip(draw(size), 0, 1)) * 255).astype(np.uint8)
        for how, maker in makers.items():
            whole = np.asarray(maker.frame(content), np.uint8)
            frames = warper.frame(whole) if warper else {}
            for where, picture in {_folder(calibration.screen): whole, **frames}.items():
                write_image(folder / where / f"{name}.{how}.png", picture)
        yield Event("stills", done, len(stills), name)
    atomic.write_text(folder / "index.txt", index_text(calibration))


def _stills_of(screen: Screen) -> Stills:
    if isinstance(screen, Dome):
        return STILLS
    return {
        name: (partial(_drawn, draw, screen), text) for name, (draw, text) in ROOM_STILLS.items()
    }


def _drawn(draw: Callable[[int, RoomScreen], Image], screen: RoomScreen, size: int) -> Image:
    return draw(size, screen)


def _folder(screen: Screen) -> str:
    return MASTERS if isinstance(screen, Dome) else CANVAS


def index_text(calibration: Calibration) -> str:
    """What each picture is and what to look for in it."""
    screen, projectors = calibration.screen, calibration.projectors
    dome = isinstance(screen, Dome)
    on = (
        "as dome masters of 180 degrees, the front at the bottom edge"
        if dome
        else "on the room's canvas"
    )
    where = f"{_folder(screen)}/ has them {on}"
    if projectors:
        where += f"; {', '.join(f'{name}/' for name in projectors)} as what each projector is sent"
    lines = [
        f"Test pictures for judging the {'dome' if dome else 'room'} by eye, from its middle and with eyes "
        "used to the dark.",
        f"{where}.",
        f"Show NAME.{WITHOUT}.png and NAME.{WITH}.png in turn, a few seconds each.",
        "",
        *(f"{name}\n  {text}\n" for name, (_, text) in _stills_of(screen).items()),
    ]
    return "\n".join(lines)


def _angles(size: int) -> tuple[Array, Array, BoolArray]:
    """Azimuth and elevation [degrees] of a master's pixels, and which of them are on the dome."""
    direction, inside = master_directions(size)
    azimuth, elevation = angles_from_direction(direction)
    return np.degrees(azimuth), np.degrees(elevation), inside


def _grey(light: FloatArray, inside: BoolArray) -> Image:
    return np.repeat((light * inside)[..., None], 3, axis=-1).astype(np.float32)


def _from_multiple(angle: Array, step: float) -> Array:
    """Distance of angles from the nearest multiple of `step`, in their unit."""
    return np.abs(angle - step * np.round(angle / step))


def _labels() -> Iterator[tuple[float, float, int]]:
    """Azimuth, elevation and number of each label [degrees], above a line."""
    clear = 4 * DOT_DEG
    for azimuth in range(0, 360, LABELS_DEG):
        yield azimuth, LINES_DEG + clear, azimuth
    for azimuth in range(45, 360, 90):
        for elevation in range(LABELS_DEG, 90, LABELS_DEG):
            yield azimuth, elevation + clear, elevation


def _local(azimuth: Array, elevation: Array, place: tuple[float, float]) -> tuple[Array, Array]:
    """Dots to the right and downwards from a place, as somebody sees them who faces it."""
    aside = ((place[0] - azimuth + 180) % 360 - 180) * np.cos(np.radians(elevation))
    return aside / DOT_DEG, (place[1] - elevation) / DOT_DEG


def _block(azimuth: Array, elevation: Array, place: tuple[float, float], number: int) -> BoolArray:
    """Where a label keeps the lines away."""
    right, down = _local(azimuth, elevation, place)
    return (np.abs(right) < 2 * len(str(number)) + 1) & (np.abs(down) < 3.5)


def _written(
    azimuth: Array, elevation: Array, place: tuple[float, float], number: int
) -> BoolArray:
    """Where a number is written, in the middle of a place."""
    right, down = _local(azimuth, elevation, place)
    dots = _dots(number)
    row, column = (
        np.floor(offset + length / 2).astype(int)
        for offset, length in zip((down, right), dots.shape, strict=True)
    )
    within = (row >= 0) & (row < dots.shape[0]) & (column >= 0) & (column < dots.shape[1])
    return within & dots[row * within, column * within]


def _dots(number: int) -> BoolArray:
    """A number in dots (5, 4 K - 1), a column between its digits."""
    table = " ".join(DIGITS).split()
    digits = [np.array([dot == "1" for dot in table[int(d)]]).reshape(5, 3) for d in str(number)]
    return np.concatenate([np.pad(d, ((0, 0), (0, 1))) for d in digits], axis=1)[:, :-1]
