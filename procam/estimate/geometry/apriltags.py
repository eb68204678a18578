"""AprilTags on the dome: fiducials that cameras find by themselves.

OpenCV identifies a tag and its corners to a third of a pixel (Olson 2011,
doi:10.1109/ICRA.2011.5979561). The centre then comes from a least-squares fit of the whole printed
pattern to the picture: Gauss-Newton on ten shifts (a homography and a bow of the paper) and six
shades, which reaches some hundredths of a pixel.
"""

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from procam.arrays import Array, BoolArray, Image
from procam.estimate.boards.start import homography_from_rays
from procam.maths.codes.april_tags import find_tags, tag_cells
from procam.maths.geometry.lenses import Lens, project, unproject
from procam.maths.warp import blur, sample
from procam.model.optics import AprilTag, CameraModel, Fiducial, TagFamily, tag_name
from procam.model.provenance import Note

TWICE = "sees it at several places and does not use it; take all but one down"

SCALES = (1, 2)  # of the picture in which tags are searched
DARK_BRIGHT_PERCENT = (1.0, 99.8)  # percentiles that become black and white
GAMMA = 2.0  # makes photon noise equal at all levels, so that dim tags are found
FAINTEST_DN = 40.0  # a picture with a smaller range shows only noise
SAME_PX = 2.0  # between two detections of one tag
CENTRE_PX = 0.05  # standard error of a centre
CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])  # in `find_tags`' order
FINENESS = (3, 8)  # fewest and most samples along a cell
LENS_BLUR_PX = 0.7
ROUNDS, CONVERGED_PX = 10, 0.002
FARTHEST = 0.5  # half edges: limit of the fitted shifts, beyond which the tag is lost
RIDGE = 1e-9  # keeps the fit regular in a picture without contrast
EXPLAINED = 0.8  # share of the picture's variance that a tag explains


@dataclass(frozen=True, slots=True)
class TagObservations:
    """The tags that one camera sees, by name.

    Attributes
    ----------
    centres : pixels (2,) of listed tags.
    doubled : listed tags that appear at several places.
    others : tags that are not listed.
    """

    centres: dict[str, Array] = field(default_factory=dict)
    doubled: set[str] = field(default_factory=set)
    others: set[str] = field(default_factory=set)


def detect_tags(
    pictures: Iterable[Image], lens: Lens, listed: Sequence[AprilTag], shown: Set[str] = frozenset()
) -> TagObservations:
    """Search for tags in pictures (H, W) [DN] of one camera, the best picture first.

    The next picture, or an enlarged copy, is searched only while listed tags are missing. `shown`:
    names of tags that projectors draw, which are not fiducials.
    """
    seen = TagObservations()
    for light, scale in ((p, s) for p in (pictures if listed else ()) for s in SCALES):
        missing = {t.name: t for t in listed if t.name not in {*seen.centres, *seen.doubled}}
        if not missing:
            break
        families = dict.fromkeys(t.family for t in missing.values())
        found = _centres(light, scale, lens, list(families))
        for name in found.keys() - shown:
            if name in missing and len(found[name]) == 1:
                seen.centres[name] = found[name][0]
            else:
                (seen.doubled if name in missing else seen.others).add(name)
    seen.others.difference_update(t.name for t in listed)
    return seen


def tag_fiducials(
    listed: Sequence[AprilTag],
    observed: Mapping[str, TagObservations],
    cameras: Mapping[str, CameraModel],
) -> list[Fiducial]:
    """One fiducial for every camera that sees a tag; `observed` by camera."""
    marks = []
    for tag in listed:
        seen = [camera for camera, tags in observed.items() if tag.name in tags.centres]
        for camera in seen:
            # the survey's error is common to all cameras; together they weigh as much as one
            survey = tag.sigma * len(seen) ** 0.5
            detection = CENTRE_PX / float(cameras[camera].lens.focal.mean())
            sigma, pixel = float(np.hypot(survey, detection)), observed[camera].centres[tag.name]
            angles = tag.azimuth, tag.elevation
            marks.append(Fiducial(tag.name, *angles, sigma, camera, pixel, detection))
    return marks


def tag_notes(listed: Sequence[AprilTag], observed: Mapping[str, TagObservations]) -> list[Note]:
    """Notes on listed tags that were not seen, or seen twice."""
    notes = [
        Note("tag twice", name, f"{camera} {TWICE}")
        for camera, tags in observed.items()
        for name in sorted(tags.doubled)
    ]
    seen = {name for tags in observed.values() for name in (*tags.centres, *tags.doubled)}
    lost = [tag.name for tag in listed if tag.name not in seen]
    others = sorted({name for tags in observed.values() for name in tags.others})
    if lost and not seen and others:
        text = (
            "no camera sees any of the tags that venue.toml lists, but "
            f"{', '.join(others)}; correct family and id"
        )
        notes.append(Note("tag unseen", ", ".join(lost), text))
    elif lost:
        text = "no camera sees it; light it, keep its white border free, or print it larger"
        notes.append(Note("tag unseen", ", ".join(lost), text))
    return notes


def tag_centre(light: Image, corners: Array, cells: BoolArray, lens: Lens) -> Array | None:
    """Pixel (2,) of a tag's centre; None if the picture does not show the tag.

    Parameters
    ----------
    light : (H, W) linear picture.
    corners : (4, 2) approximate [px].
    cells : (N, N) which of the tag's cells are white.
    lens : of the camera; the fit is in ray space, where a fisheye does not distort the tag.

    Notes
    -----
    Paper follows the dome's curvature. A camera off the centre then sees the middle away from the
    crossing of the diagonals, by 0.03 px for a tag of 40 px; the bow (shifts that grow with the square
    of the distance from the middle) accounts for that.
    """
    edge_px = float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).mean())
    sheet = _Sheet.of(cells, edge_px)
    flat = np.c_[CORNERS, np.ones(4)]
    plane = homography_from_rays(flat, unproject(corners, lens), np.ones(4))
    shifts, explained = np.zeros(sheet.slopes.shape[-1]), 0.0
    for _ in range(ROUNDS):
        seen = sample(light, _pixels(sheet.places, shifts, plane, lens))
        step, explained = sheet.step(seen.ravel().astype(float))
        shifts = shifts - step
        if np.abs(shifts).max() > FARTHEST:
            return None
        if np.abs(step).max() * edge_px / 2 < CONVERGED_PX:
            break
    return _pixels(np.zeros((1, 2)), shifts, plane, lens)[0] if explained > EXPLAINED else None


@dataclass(frozen=True, slots=True)
class _Sheet:
    """Samples of a printed tag; its black square extends from -1 to 1, x right and y down.

    Attributes
    ----------
    places : (N, 2) positions of the samples.
    shades : (N, 6) basis of its light: black and white levels that vary linearly over the sheet.
    slopes : (N, 10) derivatives of its whiteness by the shifts of `_basis`.
    """

    places: Array
    shades: Array
    slopes: Array

    @classmethod
    def of(cls, cells: BoolArray, edge_px: float) -> "_Sheet":
        """The samples of a tag that the picture shows with edges of some length [px]."""
        fine = int(np.clip(np.ceil(edge_px / len(cells)), *FINENESS))
        bordered = np.pad(cells, 1, constant_values=True)
        printed = np.kron(bordered, np.ones((fine, fine))).astype(np.float32)
        white = blur(printed, LENS_BLUR_PX * fine * len(cells) / edge_px).astype(float)
        step = 2 / (fine * len(cells))
        line = (np.arange(len(white)) + 0.5) * step - len(bordered) / len(cells)
        x, y = np.meshgrid(line, line)
        by_y, by_x = np.gradient(white, step)
        slopes = by_x[..., None] * _basis(x, y)[0] + by_y[..., None] * _basis(x, y)[1]
        linear = np.stack([np.ones_like(x), x, y], axis=-1)
        shades = np.concatenate([linear, white[..., None] * linear], axis=-1)
        inner = np.s_[fine // 2 : -(fine // 2), fine // 2 : -(fine // 2)]  # inside the paper's edge
        places = np.stack([x, y], axis=-1)
        return cls(*(a[inner].reshape(-1, a.shape[-1]) for a in (places, shades, slopes)))

    def step(self, seen: Array) -> tuple[Array, float]:
        """Error of the shifts (10,) given the picture's samples (N,), and the share of variance explained."""
        seen = (seen - seen.mean()) / max(float(seen.std()), 1e-30)
        shade = _least_squares(self.shades, seen)
        contrast = self.shades[:, :3] @ shade[3:]
        known = np.concatenate([self.shades, self.slopes * contrast[:, None]], axis=1)
        fit = _least_squares(known, seen)
        return fit[len(shade) :], float(np.var(known @ fit))


def _least_squares(known: Array, seen: Array) -> Array:
    """Coefficients (P,) of the columns of `known` (N, P) that fit `seen` (N,) best."""
    square = known.T @ known
    square[np.diag_indices_from(square)] += RIDGE * len(known)
    return np.asarray(cho_solve(cho_factor(square), known.T @ seen))


def _basis(x: Array, y: Array) -> tuple[Array, Array]:
    """Shifts (..., 10) of x and of y: eight of a homography and two of a bow."""
    zero, one, square = np.zeros_like(x), np.ones_like(x), x * x + y * y
    return (
        np.stack([one, x, y, zero, zero, zero, x * x, x * y, square, zero], axis=-1),
        np.stack([zero, zero, zero, one, x, y, x * y, y * y, zero, square], axis=-1),
    )


def _pixels(places: Array, shifts: Array, plane: Array, lens: Lens) -> Array:
    """Pixels (N, 2) of positions (N, 2) on a shifted sheet; `plane` (3, 3) maps the sheet to rays."""
    moved = places + np.stack([b @ shifts for b in _basis(*places.T)], axis=1)
    return project(np.c_[moved, np.ones(len(moved))] @ plane.T, lens)


def _centres(
    light: Image, scale: int, lens: Lens, families: Sequence[TagFamily]
) -> dict[str, list[Array]]:
    """Centres (2,) of all tags of some families in a picture, by name."""
    grey, found = to_8_bit(light), dict[str, list[Array]]()
    for family in families:
        for number, corners in find_tags(grey, family, scale):
            centre = tag_centre(light, corners, tag_cells(family, number), lens)
            places = found.setdefault(tag_name(family, number), [])
            if centre is not None and all(np.linalg.norm(centre - p) > SAME_PX for p in places):
                places.append(centre)
    return {name: places for name, places in found.items() if places}


def to_8_bit(light: Image) -> NDArray[np.uint8]:
    """A linear picture (H, W) [DN] in 8 bits with dim parts raised; black if there is no light."""
    low, high = np.percentile(light[::3, ::3], DARK_BRIGHT_PERCENT)
    if high - low < FAINTEST_DN:
        return np.zeros(light.shape, np.uint8)
    share = np.clip((light - low) / (high - low), 0, 1)
    return np.rint(255 * share ** (1 / GAMMA)).astype(np.uint8)
