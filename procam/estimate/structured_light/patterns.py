"""The patterns that each projector shows, and the plan of a whole capture session.

Each projector shows, alone: white and black, the structured-light code, and the patterns that measure
light (`light_pictures`). `plan_of` numbers them as shots of a plan.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from procam.estimate.structured_light.codes import (
    AXES,
    DEFAULT_CODE,
    NOMINAL_GAMMA,
    Picture,
    make_code,
    picture,
)
from procam.maths.codes.gray import stripe
from procam.model.plan import Plan, Shot

SEPARATION_BITS = (5, 6)  # of stripes so wide that many pixels see no edge
ZONE_ROWS = 2
LEVELS = (0, 16, 32, 48, 64, 80, 96, 112, 128, 144, 160, 176, 192, 208, 224, 240, 255)
LEVEL_PICTURES = 2
DIM = 0.5  # light of the dim picture at black's exposure, of white at its own


def plan_session(
    projectors: dict[str, tuple[int, int]], exposure_s: float, black_exposure_s: float
) -> tuple[Plan, dict[str, Picture]]:
    """The plan for projectors of given sizes (width, height), and its patterns (H, W, 1 or 3) by path.

    First everything is dark; then each projector shows its patterns alone; at the end the first one shows
    a dim picture, which shows whether the camera stayed where it was, and the true ratio of the two exposure
    times.
    """
    zones = zone_count(len(projectors))
    each = {
        name: _pictures(size, zones, exposure_s, black_exposure_s)
        for name, size in projectors.items()
    }
    return plan_of(each, exposure_s, black_exposure_s)


def plan_of(
    pictures: Mapping[str, Iterable[tuple[Shot, Picture]]],
    exposure_s: float,
    black_exposure_s: float,
) -> tuple[Plan, dict[str, Picture]]:
    """The plan that shows the pictures of each projector in turn, and the pictures by path.

    The shots come without id, projector and path. The plan starts with a dark shot and ends with the
    `dim_picture` of the first projector.
    """
    shots = [Shot("dark", "", "", "dark", (exposure_s, black_exposure_s))]
    patterns: dict[str, Picture] = {}
    count = dict.fromkeys(pictures, 0)

    def add(name: str, shown: Iterable[tuple[Shot, Picture]]) -> None:
        for number, (shot, image) in enumerate(shown, start=count[name]):
            path = f"patterns/{name}/{number:04d}.png"
            shots.append(replace(shot, id=f"{name}-{number:04d}", projector=name, pattern=path))
            patterns[path] = image
            count[name] = number + 1

    for name, shown in pictures.items():
        add(name, shown)
    first = next(iter(pictures))
    white = patterns[shots[1].pattern]
    add(first, [dim_picture(white, exposure_s, black_exposure_s)])
    return Plan(tuple(shots)), patterns


def dim_picture(white: Picture, exposure_s: float, black_exposure_s: float) -> tuple[Shot, Picture]:
    """A dim picture to photograph at both exposures, without id; dark where `white` (H, W, C) is."""
    light = DIM * min(1.0, exposure_s / black_exposure_s)
    drive = round(255 * light ** (1 / NOMINAL_GAMMA))
    both = tuple(dict.fromkeys((exposure_s, black_exposure_s)))
    return Shot("", "", "", "dim", both), np.where(white > 0, np.uint8(drive), np.uint8(0))


def black_picture(
    white: Picture, exposure_s: float, black_exposure_s: float
) -> tuple[Shot, Picture]:
    """A black picture, without id; photographed at white's exposure too, which black's is checked by."""
    both = tuple(dict.fromkeys((black_exposure_s, exposure_s)))
    return Shot("", "", "", "black", both), 0 * white


def _pictures(
    size: tuple[int, int], zone_total: int, exposure_s: float, black_exposure_s: float
) -> Iterator[tuple[Shot, Picture]]:
    width, height = size
    full = np.full((height, width, 1), 255, np.uint8)
    once = (exposure_s,)
    yield Shot("", "", "", "white", once), full
    yield black_picture(full, exposure_s, black_exposure_s)
    code = make_code(DEFAULT_CODE, size)
    for number, plane in enumerate(code.planes[2:], start=2):
        detail: dict[str, int | str] = {"code": code.name, "plane": number}
        yield Shot("", "", "", "code", once, "mono", detail), picture(code, plane)
    zones = [zone_picture(size, zone, zone_total) for zone in range(zone_total)]
    yield from light_pictures(size, SEPARATION_BITS, zones, exposure_s)


def light_pictures(
    size: tuple[int, int], bits: tuple[int, int], zones: Iterable[Picture], exposure_s: float
) -> Iterator[tuple[Shot, Picture]]:
    """Patterns that measure light: stripes, zones, primaries, levels, as shots without id.

    Gray stripes of `bits` with inverses separate direct from scattered light, zones show where
    scattered light goes, primaries give the colours, levels the projector's response.
    """
    width, height = size
    once = (exposure_s,)
    for axis in AXES:
        for bit in bits[::-1]:
            for inverse in (0, 1):
                detail: dict[str, int | str] = {"axis": axis, "bit": bit, "inverse": inverse}
                stripes = stripe_picture(size, axis, bit, bool(inverse))
                yield Shot("", "", "", "stripes", once, "rgb", detail), stripes
    for zone, white in enumerate(zones):
        yield Shot("", "", "", "zone", once, "rgb", {"zone": zone}), white
    for channel in range(3):
        primary = np.zeros((height, width, 3), np.uint8)
        primary[..., channel] = 255
        yield Shot("", "", "", "primary", once, "rgb", {"channel": channel}), primary
    for levels in level_pictures(size):
        yield Shot("", "", "", "levels", once), levels


def stripe_picture(size: tuple[int, int], axis: str, bit: int, inverse: bool) -> Picture:
    """One plane (H, W, 1) of the Gray code along "x" (columns) or "y" (rows)."""
    width, height = size
    line = stripe(width if axis == "x" else height, bit) ^ inverse
    plane = np.broadcast_to(line[None, :] if axis == "x" else line[:, None], (height, width))
    return (255 * plane[..., None]).astype(np.uint8)


def zone_count(projectors: int) -> int:
    """Number of zones that each projector shows.

    Twelve in all determine a scatter kernel of degree 2, wherever they are. A single projector shows
    eight, to limit the number of photographs.
    """
    return {1: 8, 2: 6}.get(projectors, 4)


def zone_picture(size: tuple[int, int], zone: int, count: int) -> Picture:
    """One white zone (H, W, 1) of the `count` that divide the panel, in two rows from the top left."""
    width, height = size
    columns = count // ZONE_ROWS
    down, across = divmod(zone, columns)
    picture = np.zeros((height, width, 1), np.uint8)
    rows = slice(down * height // ZONE_ROWS, (down + 1) * height // ZONE_ROWS)
    picture[rows, across * width // columns : (across + 1) * width // columns] = 255
    return picture


def level_tile(size: tuple[int, int]) -> int:
    """Edge of a level tile [px]: small enough for many tiles of every level, wider than the blur."""
    return max(16, min(64, size[0] // 40))


def level_pictures(size: tuple[int, int]) -> list[Picture]:
    """Pictures (H, W, 1) of tiles of all drive levels, shuffled; each level covers the same area."""
    width, height = size
    tile = level_tile(size)
    rng = np.random.default_rng(0)
    rows, columns = -(-height // tile), -(-width // tile)
    pictures = []
    for _ in range(LEVEL_PICTURES):
        deck = np.resize(np.array(LEVELS, np.uint8), rows * columns)
        tiles = rng.permutation(deck).reshape(rows, columns)
        picture = np.kron(tiles, np.ones((tile, tile), np.uint8))
        pictures.append(picture[:height, :width, None].astype(np.uint8))
    return pictures
