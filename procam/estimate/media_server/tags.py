"""AprilTags drawn into dome masters at chosen directions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, Array32
from procam.estimate.structured_light.codes import NOMINAL_GAMMA, Picture
from procam.maths.codes.april_tags import tag_cells
from procam.maths.codes.shot_id import CELLS_PER_MASTER, shot_id_blocks
from procam.maths.geometry.lenses import project, unproject
from procam.maths.geometry.pose import rotation_matrix
from procam.maths.geometry.sphere import normalise
from procam.maths.warp import block_mean
from procam.model.optics import AprilTag, ProjectorModel, TagFamily

TAG_PICTURES = 2
FAMILY: TagFamily = "25h9"  # another one than that of the shot marks
EDGES = 26  # tags across the field of view: 7 degrees each, 50 px at 8 px per degree
# rings of both pictures: share of the half angle, and number of tags
RINGS = (((0.23, 5), (0.44, 9), (0.65, 12), (0.85, 12)), ((0.33, 7), (0.54, 11), (0.75, 14)))
CELLS, QUIET_CELLS = 7, 2  # across a tag, and of white border
FINE_PX = 4096  # samples across a master: several per pixel of small ones


@dataclass(frozen=True, slots=True)
class MasterTag:
    """A tag's `number`, and the ray (3,) of its centre in the frame of the master's model."""

    number: int
    ray: Array

    def on_dome(self, model: ProjectorModel, sigma: float) -> AprilTag:
        """The tag as a fiducial on the dome with standard error `sigma` [rad]."""
        x, y, z = model.projector_from_dome.inverse().rotate(self.ray)
        azimuth, elevation = float(np.arctan2(y, x)), float(np.arcsin(np.clip(z, -1, 1)))
        return AprilTag(FAMILY, self.number, azimuth, elevation, sigma)


def master_tags(size: int, fov: float, picture: int) -> list[MasterTag]:
    """Tags of one picture, spread over the master, clear of its shot mark.

    Both pictures have the same tags at different positions.
    """
    found: list[MasterTag] = []
    for ring, (share, count) in enumerate(RINGS[picture]):
        for i in range(count):
            angle = 2 * np.pi * (i + 0.5 * (ring % 2)) / count
            theta = share * fov / 2
            ray = np.array([np.cos(angle), np.sin(angle), 0]) * np.sin(theta)
            ray[2] = np.cos(theta)
            at = (size - 1) / 2 + share * size / 2 * np.array([np.cos(angle), np.sin(angle)])
            if _is_clear(at, size):
                found.append(MasterTag(len(found), ray))
    return found


def draw_tags(model: ProjectorModel, tags: Sequence[MasterTag], fov: float) -> Picture:
    """A picture (N, N, 1) of tags on black, each a square in the plane tangent at its centre.

    Grey levels at edges are encoded with a projector's usual response, which keeps edges in place.
    """
    light = np.zeros((model.size[1], model.size[0]), np.float32)
    fine = max(1, FINE_PX // model.size[0])
    for tag in tags:
        x0, y0, x1, y1 = _box(model, tag, fov)
        x, y = (
            (np.arange(fine * (end - start)) + 0.5) / fine + start - 0.5
            for start, end in ((x0, x1), (y0, y1))
        )
        rays = unproject(np.stack(np.meshgrid(x, y), axis=-1), model.lens)
        light[y0:y1, x0:x1] += block_mean(_whiteness(rays, tag, fov), fine)
    drive = np.rint(255 * np.clip(light, 0, 1) ** (1 / NOMINAL_GAMMA))
    return drive.astype(np.uint8)[..., None]


def _whiteness(rays: Array, tag: MasterTag, fov: float) -> Array32:
    """Light (H, W) 0..1 of a tag with its white border along rays (H, W, 3)."""
    cells = tag_cells(FAMILY, tag.number)
    printed = np.pad(cells, QUIET_CELLS, constant_values=True)
    across, down, ahead = np.moveaxis(rays @ _turn_to(tag.ray), -1, 0)
    cell = 2 * np.tan(fov / EDGES / 2) / len(cells)
    middle = len(printed) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        column, row = (np.floor(middle + a / ahead / cell) for a in (across, down))
    on = (ahead > 0) & (np.minimum(column, row) >= 0) & (np.maximum(column, row) < len(printed))
    column, row = (np.where(on, a, 0).astype(np.intp) for a in (column, row))
    return (printed[row, column] & on).astype(np.float32)


def _turn_to(ray: Array) -> Array:
    """Axes (3, 3), columns right, down and ahead, rotated from the master's centre to a ray."""
    horizontal = float(np.hypot(ray[0], ray[1]))
    axis = np.array([-ray[1], ray[0], 0.0]) / max(horizontal, 1e-12)
    return rotation_matrix(axis * np.arctan2(horizontal, ray[2]))


def _box(model: ProjectorModel, tag: MasterTag, fov: float) -> tuple[int, int, int, int]:
    """Bounding box (x0, y0, x1, y1) of a tag with its border [px]."""
    half = np.tan(fov / EDGES / 2) * (1 + 2 * QUIET_CELLS / CELLS)
    line = np.linspace(-half, half, 9)
    places = np.stack([*np.meshgrid(line, line), np.ones((9, 9))], axis=-1)
    pixels = project(normalise(places @ _turn_to(tag.ray).T), model.lens)
    low = np.floor(pixels.min(axis=(0, 1))) - 1
    high = np.ceil(pixels.max(axis=(0, 1))) + 2
    (x0, y0), (x1, y1) = (np.clip(p, 0, model.size).astype(int) for p in (low, high))
    return int(x0), int(y0), int(x1), int(y1)


def _is_clear(at: Array, size: int) -> bool:
    """Whether a tag at a position (2,) [px] does not touch the shot mark."""
    reach = size / EDGES * (0.5 + QUIET_CELLS / CELLS) * np.sqrt(2) * 1.2
    for x, y, width, height in shot_id_blocks((size, size), CELLS_PER_MASTER):
        off = np.maximum(np.abs(at - [x + width / 2, y + height / 2]) - [width / 2, height / 2], 0)
        if np.hypot(*off) < reach:
            return False
    return True
