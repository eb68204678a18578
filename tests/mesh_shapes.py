"""Meshes of known shapes, counter-clockwise seen from the inside."""

import numpy as np
from scipy.spatial import ConvexHull

Mesh = tuple[np.ndarray, np.ndarray]


def hemisphere(radius: float, steps: int) -> Mesh:
    """4 steps^2 triangles: the upper faces of an octahedron, subdivided and projected on the sphere."""
    rows = [(i, j) for i in range(steps + 1) for j in range(steps + 1 - i)]
    number = {place: n for n, place in enumerate(rows)}
    one = []
    for i in range(steps):
        for j in range(steps - i):
            one.append([number[i, j], number[i, j + 1], number[i + 1, j]])
            if i + j < steps - 1:
                one.append([number[i + 1, j], number[i, j + 1], number[i + 1, j + 1]])
    i, j = np.array(rows, float).T
    corner = np.stack([i, j, steps - i - j], axis=1)
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    points = np.concatenate([corner @ np.linalg.matrix_power(quarter, n) for n in range(4)])
    faces = np.concatenate([np.array(one) + n * len(rows) for n in range(4)])
    return welded(radius * points / np.linalg.norm(points, axis=1, keepdims=True), faces)


def scattered_sphere(radius: float, count: int, seed: int = 1) -> Mesh:
    """A whole sphere through random points: triangles of any shape."""
    points = np.random.default_rng(seed).normal(0, 1, (count, 3))
    points *= radius / np.linalg.norm(points, axis=1, keepdims=True)
    faces = ConvexHull(points).simplices
    a, b, c = np.moveaxis(points[faces], 1, 0)
    outwards = np.einsum("fi,fi->f", a, np.cross(b, c)) > 0
    return points, np.where(outwards[:, None], faces[:, ::-1], faces).astype(np.int32)


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    """12 triangles."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    vertices = np.array(low) + corners * (np.array(high) - np.array(low))
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = [f for a, b, c, d in quads for f in ((a, c, b), (a, d, c))]
    return vertices, np.array(faces, np.int32)[:, ::-1].copy()


def fine_box(low: tuple[float, float, float], high: tuple[float, float, float], cuts: int) -> Mesh:
    """12 cuts^2 triangles, wall by wall as `box`."""
    vertices, faces = box(low, high)
    weight = np.array([[i, j, cuts - i - j] for i in range(cuts + 1) for j in range(cuts + 1 - i)])
    number = {(i, j): n for n, (i, j, _) in enumerate(weight.tolist())}
    up = [
        (number[i, j], number[i + 1, j], number[i, j + 1])
        for i in range(cuts)
        for j in range(cuts - i)
    ]
    down = [
        (number[i + 1, j], number[i + 1, j + 1], number[i, j + 1])
        for i in range(cuts)
        for j in range(cuts - 1 - i)
    ]
    points = np.einsum("pk,fki->fpi", weight / cuts, vertices[faces])
    parts = np.array(up + down) + len(weight) * np.arange(len(faces))[:, None, None]
    return welded(points.reshape(-1, 3), parts.reshape(-1, 3))


def cylinder(radius: float, height: float, sides: int, closed: bool = False) -> Mesh:
    """A prism round z from 0 to `height`; closed by a floor and a ceiling on request."""
    angle = np.arange(sides) * 2 * np.pi / sides
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    floor, ceiling = (np.column_stack([ring, np.full(sides, z)]) for z in (0.0, height))
    vertices = np.concatenate([floor, ceiling, [[0, 0, 0], [0, 0, height]]])
    n = np.arange(sides)
    m = (n + 1) % sides
    walls = [np.stack([n, n + sides, m], 1), np.stack([m, n + sides, m + sides], 1)]
    ends = [np.stack([n, m, np.full(sides, 2 * sides)], 1)]
    ends += [np.stack([m + sides, n + sides, np.full(sides, 2 * sides + 1)], 1)]
    if not closed:
        return vertices[: 2 * sides], np.concatenate(walls).astype(np.int32)
    return vertices, np.concatenate(walls + ends).astype(np.int32)


def welded(points: np.ndarray, faces: np.ndarray) -> Mesh:
    """The mesh with equal vertices merged."""
    _, first, place = np.unique(points.round(9), axis=0, return_index=True, return_inverse=True)
    return points[first], place.reshape(-1)[faces].astype(np.int32)


def cell_room(cells: set[tuple[int, int, int]], cuts: int) -> Mesh:
    """The walls about cells of a grid of 1 m, 2 cuts^2 triangles each: an L of three cells, for instance."""
    at = np.arange(cuts + 1) / cuts
    corners, faces = [], []
    for cell in sorted(cells):
        for axis in range(3):
            for side in (0, 1):
                beyond = list(cell)
                beyond[axis] += 2 * side - 1
                if tuple(beyond) in cells:
                    continue
                wall = np.zeros((cuts + 1, cuts + 1, 3))
                wall[..., axis] = side
                wall[..., (axis + 1) % 3], wall[..., (axis + 2) % 3] = np.meshgrid(
                    at, at, indexing="ij"
                )
                number = (
                    np.arange((cuts + 1) ** 2).reshape(cuts + 1, -1)
                    + len(corners) * (cuts + 1) ** 2
                )
                a, b = number[:-1, :-1].ravel(), number[1:, :-1].ravel()
                c, d = number[1:, 1:].ravel(), number[:-1, 1:].ravel()
                both = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
                corners.append((wall + cell).reshape(-1, 3))
                faces.append(both if side == 0 else both[:, ::-1])
    return welded(np.concatenate(corners), np.concatenate(faces))
