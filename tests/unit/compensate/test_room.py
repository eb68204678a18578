"""Compensation on the canvas of a room."""

import numpy as np
import pytest

from procam.compensate.mesh import MeshCompensator
from procam.compensate.room import RoomCompensator
from procam.errors import InputError, ShapeError
from procam.maths.mesh.canvas import MeshCanvas, mesh_canvas
from procam.maths.mesh.compressed import CompressedFactors, compressed_factors
from procam.maths.mesh.facets import face_areas
from procam.maths.mesh.form_factors import form_factors
from procam.maths.mesh.rooms import BOX, Room, box_room

SIZE_M = np.array([6.0, 4.0, 3.0])
SIZE = 200, 110  # pixels of 10 cm
RAYS, BOUNCES = 200_000, 30
LO = 0.001

Parts = tuple[Room, MeshCanvas, CompressedFactors]


@pytest.fixture(scope="module")
def parts() -> Parts:
    room = box_room((6.0, 4.0, 3.0), BOX, 0.35)
    place = room.place / np.array(room.size_m)
    canvas = mesh_canvas(room.vertices, room.faces, room.part, place, SIZE)
    return room, canvas, compressed_factors(room.vertices, room.faces)


def compensator(parts: Parts, albedo: float, lo: float = 0.0) -> RoomCompensator:
    _, canvas, factors = parts
    return RoomCompensator(canvas, factors, np.full((len(factors.area), 3), albedo), lo)


def picture(value: float) -> np.ndarray:
    return np.full((SIZE[1], SIZE[0], 3), value, np.float32)


@pytest.mark.parametrize("albedo", [0.2, 0.5, 0.8])
def test_uniform_light_in_a_closed_room(parts: Parts, albedo: float) -> None:
    """Each bounce returns the albedo's share: 1 / (1 - albedo) in all."""
    room, lit = compensator(parts, albedo), parts[1].lit
    shown = room.none(picture(0.1))
    np.testing.assert_allclose(shown.observed[lit], 0.1 / (1 - albedo), rtol=1e-3)
    exact = room.exact(picture(0.1))
    np.testing.assert_allclose(exact.observed[lit], 0.1, rtol=1e-5)
    np.testing.assert_allclose(exact.direct[lit], 0.1 * (1 - albedo), rtol=1e-3)
    assert exact.free[lit].all() and not exact.free[~lit].any() and not exact.observed[~lit].any()


def half_lit(parts: Parts) -> np.ndarray:
    """The left half of the front wall is white."""
    content, (room, _, _) = picture(0.0), parts
    left, top, width, height = (round(10 * x) for x in room.layout()["front"])
    content[top : top + height, left : left + width // 2] = 1.0
    return content


def test_the_light_of_all_bounces_is_that_of_random_walks(
    parts: Parts, rng: np.random.Generator
) -> None:
    """A tracer that knows planes and nothing of meshes, canvases or form factors."""
    albedo = 0.6
    shown = compensator(parts, albedo).none(half_lit(parts))
    room, canvas, _ = parts
    for name, row, column in (("floor", 0.5, 0.5), ("back", 0.3, 0.7), ("right", 0.5, 0.5)):
        left, top, width, height = room.layout()[name]
        pixel = round(10 * (top + row * height)), round(10 * (left + column * width))
        corners = room.vertices[room.faces[canvas.face[pixel]]]
        places = (canvas.at_pixels @ room.vertices).reshape(*canvas.face.shape, 3)
        start = places[pixel] + SIZE_M[[1, 0, 2]] * 0.5
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        seen, sigma = walked(start, normal / np.linalg.norm(normal), albedo, rng)
        assert shown.observed[pixel][0] == pytest.approx(
            albedo * seen, abs=4 * albedo * sigma + 2e-4
        )


def walked(
    start: np.ndarray, normal: np.ndarray, albedo: float, rng: np.random.Generator
) -> tuple[float, float]:
    """Light that arrives at a point of the box (0, 0, 0) to (4, 6, 3), and its standard error."""
    box = SIZE_M[[1, 0, 2]]
    at, normals = np.tile(start, (RAYS, 1)), np.tile(normal, (RAYS, 1))
    weight, total = 1.0, np.zeros(RAYS)
    for _ in range(BOUNCES):
        ray = rng.normal(size=(RAYS, 3))
        ray = normals + ray / np.linalg.norm(ray, axis=1, keepdims=True)  # Lambert's cosine law
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        far = np.where(ray > 0, (box - at) / ray, -at / ray)
        axis, steps = far.argmin(axis=1), far.min(axis=1)
        at = np.clip(at + steps[:, None] * ray, 0, box)
        side = ray[np.arange(RAYS), axis] > 0
        normals = np.zeros((RAYS, 3))
        normals[np.arange(RAYS), axis] = np.where(side, -1, 1)
        total += weight * ((axis == 0) & side & (at[:, 1] > 3))
        weight *= albedo
    return float(total.mean()), float(total.std() / np.sqrt(RAYS))


def test_it_agrees_with_the_dense_active_set(parts: Parts) -> None:
    """Of light that is constant over each face."""
    room, canvas, _ = parts
    lit = np.isin(room.part, [1, 4])
    albedo = np.where(lit, 0.6, 0.3)[:, None] * np.ones(3)
    dense = form_factors(room.vertices, room.faces)
    rng = np.random.default_rng(3)
    target = np.repeat(rng.choice([0.0, 0.7], size=(len(lit), 1)), 3, axis=1)
    hi, area = lit[:, None] * np.ones(3), face_areas(room.vertices, room.faces)
    reference = MeshCompensator(dense, albedo, area, lo=LO * hi, hi=hi).exact(target * hi)
    within = np.where(lit[canvas.face] & canvas.lit, 1.0, 0.0)[..., None]
    own = RoomCompensator(canvas, parts[2], albedo, LO * within, within * np.ones(3))
    found = own.exact((target[canvas.face] * within).astype(np.float32))
    off = (canvas.mean(found.direct) - reference.direct)[lit]
    # a face at a limit in part is not a face at a limit
    assert np.sqrt(np.mean(off**2)) < 0.02 and abs(off.mean()) < 2e-3


def test_light_that_cannot_be_negative_is_not_and_the_rest_is_exact(parts: Parts) -> None:
    room, lit = compensator(parts, 0.6, LO), parts[1].lit
    target = half_lit(parts)
    shown = room.exact(target)
    bright = lit & (target[..., 0] > 0)
    np.testing.assert_allclose(shown.observed[bright], 1.0, atol=1e-5)
    np.testing.assert_allclose(shown.direct[lit & ~bright], LO, atol=1e-6)
    assert not shown.free[~bright].any()


def test_bad_input(parts: Parts) -> None:
    _, canvas, factors = parts
    count = len(factors.area)
    with pytest.raises(ShapeError, match="albedo"):
        RoomCompensator(canvas, factors, np.full((count, 1), 0.5))
    for wrong in (1.0, -0.1, np.nan):
        with pytest.raises(InputError, match=r"albedo: .+ 0 to 0.999 are needed"):
            RoomCompensator(canvas, factors, np.full((count, 3), wrong))
    with pytest.raises(InputError, match="swapped"):
        RoomCompensator(canvas, factors, np.full((count, 3), 0.5), 1.0, 0.5)
