"""AprilTags on the dome: marks that cameras find by themselves.

Olson, ICRA 2011, doi 10.1109/ICRA.2011.5979561. OpenCV tells which tag it is, and its corners to a
third of a pixel; the centre then comes from all edges of the whole tag.
"""

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from procam.estimate.boards.start import homography_from_rays
from procam.estimate.boards.targets import find_tags, tag_cells
from procam.maths.geometry.lenses import Lens, project, unproject
from procam.maths.warp import blur, sample
from procam.model.optics import AprilTag, CameraModel, Fiducial, TagFamily, tag_name

Array = NDArray[np.float64]
Image = NDArray[np.float32]
SCALES = (1, 2)
DARK_BRIGHT_PERCENT = (1.0, 99.8)
GAMMA = 2.0  # makes photon noise alike at all levels, so that tags in dim light stand out
FAINTEST_DN = 40.0  # a picture with less light in it shows noise and nothing else
SAME_PX = 2.0
CENTRE_PX = 0.05  # how well a centre is found
CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])  # in `find_tags`' order
FINENESS = (3, 8)  # fewest and most samples along a cell
LENS_BLUR_PX = 0.7
ROUNDS, SETTLED_PX = 10, 0.002
FARTHEST = 0.5  # half edges that a fit may move; what goes farther has lost the tag
RIDGE = 1e-9  # keeps a picture without contrast from being singular
EXPLAINED = 0.8  # of the picture's variance, by a tag that is really there


@dataclass(frozen=True, slots=True)
class TagObservations:
    """What one camera's pictures show of tags, by name.

    Attributes
    ----------
    centres : pixel (2,) of the listed ones. doubled : listed, and seen at several places.
    others : seen, and not listed.
    """

    centres: dict[str, Array] = field(default_factory=dict)
    doubled: set[str] = field(default_factory=set)
    others: set[str] = field(default_factory=set)


def detect_tags(
    pictures: Iterable[Image],
    lens: Lens,
    listed: Sequence[AprilTag],
    shown: Set[str] = frozenset(),
) -> TagObservations:
    """Look for tags in pictures (H, W) [DN] of one camera, the best one first.

    The next picture, or a larger copy, is only looked at for what has not been found. `shown`: names
    of tags that projectors draw; they are no marks.
    """
    look = TagObservations()
    for light, scale in ((p, s) for p in (pictures if listed else ()) for s in SCALES):
        missing = {t.name: t for t in listed if t.name not in {*look.centres, *look.doubled}}
        if not missing:
            break
        families = dict.fromkeys(t.family for t in missing.values())
        found = _sightings(light, scale, lens, list(families))
        for name in found.keys() - shown:
            if name in missing and len(found[name]) == 1:
                look.centres[name] = found[name][0]
            else:
                (look.doubled if name in missing else look.others).add(name)
    look.others.difference_update(t.name for t in listed)
    return look


def tag_fiducials(
    listed: Sequence[AprilTag],
    looks: Mapping[str, TagObservations],
    cameras: Mapping[str, CameraModel],
) -> list[Fiducial]:
    """A mark for every camera that sees a tag; `looks` by camera."""
    marks = []
    for tag in listed:
        seen = [camera for camera, look in looks.items() if tag.name in look.centres]
        for camera in seen:
            # all cameras see one survey's error: together they must weigh no more than one does
            survey = tag.sigma * len(seen) ** 0.5
            found = CENTRE_PX / float(cameras[camera].lens.focal.mean())
            sigma, pixel = float(np.hypot(survey, found)), looks[camera].centres[tag.name]
            marks.append(Fiducial(tag.name, tag.azimuth, tag.elevation, sigma, camera, pixel))
    return marks


def tag_notes(listed: Sequence[AprilTag], looks: Mapping[str, TagObservations]) -> list[str]:
    """What did not go well with listed tags, a line each."""
    lines = [
        f"{name}: {camera} sees it at several places and does not use it; take all but one down"
        for camera, look in looks.items()
        for name in sorted(look.doubled)
    ]
    seen = {name for look in looks.values() for name in (*look.centres, *look.doubled)}
    lost = [tag.name for tag in listed if tag.name not in seen]
    others = sorted({name for look in looks.values() for name in look.others})
    if lost and not seen and others:
        lines.append(
            f"{', '.join(lost)}: no camera sees any; got {', '.join(others)} instead, expected those "
            "that venue.toml lists; correct family and id"
        )
    elif lost:
        lines.append(
            f"{', '.join(lost)}: got no camera that sees it, expected one; light it, keep its white "
            "border free, or print it larger"
        )
    return lines


def tag_centre(light: Image, corners: Array, cells: NDArray[np.bool_], lens: Lens) -> Array | None:
    """Pixel (2,) of the centre of a tag on the dome, to some hundredths; None if it is not there.

    `light` (H, W) is linear; `corners` (4, 2) [px] are where it is about, `cells` (N, N) the white
    ones. The tag is laid along rays, which a fisheye does not bend. A sheet of paper takes the dome's
    bow, which moves its middle off the crossing of its diagonals as a camera away from the centre
    sees it (.03 px where the tag has 40): shifts that grow with the square of the distance from the
    middle are solved for.
    """
    edge_px = float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).mean())
    sheet = _Sheet.of(cells, edge_px)
    flat = np.c_[CORNERS, np.ones(4)]
    plane = homography_from_rays(flat, unproject(corners, lens), np.ones(4))
    moves, explained = np.zeros(sheet.slopes.shape[-1]), 0.0
    for _ in range(ROUNDS):
        seen = sample(light, _pixels(sheet.places, moves, plane, lens))
        step, explained = sheet.step(seen.ravel().astype(float))
        moves = moves - step
        if np.abs(moves).max() > FARTHEST:
            return None
        if np.abs(step).max() * edge_px / 2 < SETTLED_PX:
            break
    return _pixels(np.zeros((1, 2)), moves, plane, lens)[0] if explained > EXPLAINED else None


@dataclass(frozen=True, slots=True)
class _Sheet:
    """A tag as it is printed, sampled; its black square reaches from -1 to 1, x right and y down.

    Attributes
    ----------
    places : (N, 2) samples. shades : (N, 6) what light may make of it: black and white that change
        evenly over the sheet. slopes : (N, 10) of its whiteness by the moves of `_basis`.
    """

    places: Array
    shades: Array
    slopes: Array

    @classmethod
    def of(cls, cells: NDArray[np.bool_], edge_px: float) -> "_Sheet":
        """The sheet of a tag that is seen with an edge of some length."""
        fine = int(np.clip(np.ceil(edge_px / len(cells)), *FINENESS))
        bordered = np.pad(cells, 1, constant_values=True)
        printed = np.kron(bordered, np.ones((fine, fine))).astype(np.float32)
        white = blur(printed, LENS_BLUR_PX * fine * len(cells) / edge_px).astype(float)
        step = 2 / (fine * len(cells))
        line = (np.arange(len(white)) + 0.5) * step - len(bordered) / len(cells)
        x, y = np.meshgrid(line, line)
        by_y, by_x = np.gradient(white, step)
        slopes = by_x[..., None] * _basis(x, y)[0] + by_y[..., None] * _basis(x, y)[1]
        even = np.stack([np.ones_like(x), x, y], axis=-1)
        shades = np.concatenate([even, white[..., None] * even], axis=-1)
        inner = np.s_[fine // 2 : -(fine // 2), fine // 2 : -(fine // 2)]  # off the paper's edge
        places = np.stack([x, y], axis=-1)
        return cls(*(a[inner].reshape(-1, a.shape[-1]) for a in (places, shades, slopes)))

    def step(self, seen: Array) -> tuple[Array, float]:
        """How the moves (10,) are off for samples (N,) as seen, and the share that is explained."""
        seen = (seen - seen.mean()) / max(float(seen.std()), 1e-30)
        shade = _least_squares(self.shades, seen)
        contrast = self.shades[:, :3] @ shade[3:]
        known = np.concatenate([self.shades, self.slopes * contrast[:, None]], axis=1)
        fit = _least_squares(known, seen)
        return fit[len(shade) :], float(np.var(known @ fit))


def _least_squares(known: Array, seen: Array) -> Array:
    """What (P,) of each column of `known` (N, P) is in `seen` (N,)."""
    square = known.T @ known
    square[np.diag_indices_from(square)] += RIDGE * len(known)
    return np.asarray(cho_solve(cho_factor(square), known.T @ seen))


def _basis(x: Array, y: Array) -> tuple[Array, Array]:
    """Shifts (..., 10) of x and of y by each move: those of a homography, and a bow."""
    zero, one, square = np.zeros_like(x), np.ones_like(x), x * x + y * y
    return (
        np.stack([one, x, y, zero, zero, zero, x * x, x * y, square, zero], axis=-1),
        np.stack([zero, zero, zero, one, x, y, x * y, y * y, zero, square], axis=-1),
    )


def _pixels(places: Array, moves: Array, plane: Array, lens: Lens) -> Array:
    """Pixels (N, 2) of places (N, 2) of a sheet that is moved; `plane` (3, 3) leads to rays."""
    moved = places + np.stack([b @ moves for b in _basis(*places.T)], axis=1)
    return project(np.c_[moved, np.ones(len(moved))] @ plane.T, lens)


def _sightings(
    light: Image, scale: int, lens: Lens, families: Sequence[TagFamily]
) -> dict[str, list[Array]]:
    """Centres (2,) of all tags of some families in a picture, by name."""
    grey, found = toned(light), dict[str, list[Array]]()
    for family in families:
        for number, corners in find_tags(grey, family, scale):
            centre = tag_centre(light, corners, tag_cells(family, number), lens)
            places = found.setdefault(tag_name(family, number), [])
            if centre is not None and all(np.linalg.norm(centre - p) > SAME_PX for p in places):
                places.append(centre)
    return {name: places for name, places in found.items() if places}


def toned(light: Image) -> NDArray[np.uint8]:
    """A picture (H, W) [DN], linear, as 8 bits in which dim parts show; black if there is no light."""
    low, high = np.percentile(light[::3, ::3], DARK_BRIGHT_PERCENT)
    if high - low < FAINTEST_DN:
        return np.zeros(light.shape, np.uint8)
    share = np.clip((light - low) / (high - low), 0, 1)
    return np.rint(255 * share ** (1 / GAMMA)).astype(np.uint8)
