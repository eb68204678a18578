"""MeshScreen holds what a tracer can use, and nothing else."""

import dataclasses

import numpy as np
import pytest

from procam.errors import InputError, ShapeError
from procam.model.screen import MeshScreen

VERTICES = np.array([[3.0, 0, 0], [3, 1, 0], [3, 0, 1]])
FACES = np.array([[0, 2, 1]], np.int32)


def test_holds_arrays() -> None:
    screen = MeshScreen(VERTICES, FACES)
    assert screen.vertices is VERTICES
    assert screen.faces is FACES
    with pytest.raises(dataclasses.FrozenInstanceError):
        screen.faces = FACES  # type: ignore[misc]


def test_can_be_the_key_of_what_is_kept_for_it() -> None:
    one, other = MeshScreen(VERTICES, FACES), MeshScreen(VERTICES, FACES)
    assert {one: 1, other: 2}[one] == 1
    assert one != other


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"vertices": VERTICES[:, :2]}, ShapeError, r"vertices has shape \(3, 2\)"),
        ({"faces": FACES[0]}, ShapeError, r"faces has shape \(3,\)"),
        ({"faces": FACES[:0]}, ShapeError, r"faces has shape \(0, 3\)"),
        (
            {"vertices": VERTICES.astype("f4")},
            InputError,
            "vertices: got float32, expected float64",
        ),
        ({"faces": FACES.astype(int)}, InputError, "faces: got int64, expected int32"),
        ({"vertices": VERTICES * np.nan}, InputError, "vertices: got NaN or infinite ones"),
        ({"faces": FACES + 1}, InputError, "faces: got vertices 1 to 3, expected 0 to 2"),
        ({"faces": FACES - 1}, InputError, "faces: got vertices -1 to 1, expected 0 to 2"),
    ],
)
def test_what_cannot_be_traced_is_refused(change: dict, error: type, text: str) -> None:
    with pytest.raises(error, match=text):
        MeshScreen(**({"vertices": VERTICES, "faces": FACES} | change))
