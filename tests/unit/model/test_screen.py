"""MeshScreen accepts only arrays that a tracer can use."""

import numpy as np
import pytest

from procam.errors import InputError, ShapeError
from procam.model.screen import MeshScreen

VERTICES = np.array([[3.0, 0, 0], [3, 1, 0], [3, 0, 1]])
FACES = np.array([[0, 2, 1]], np.int32)


def test_can_be_the_key_of_a_cache() -> None:
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
            "vertices has type float32; it needs float64",
        ),
        ({"faces": FACES.astype(int)}, InputError, "faces has type int64; it needs int32"),
        ({"vertices": VERTICES * np.nan}, InputError, "vertices contain NaN or infinity"),
        ({"faces": FACES + 1}, InputError, "vertices 1 to 3; the mesh has vertices 0 to 2"),
        ({"faces": FACES - 1}, InputError, "vertices -1 to 1; the mesh has vertices 0 to 2"),
    ],
)
def test_unusable_meshes_are_refused(change: dict, error: type, text: str) -> None:
    with pytest.raises(error, match=text):
        MeshScreen(**({"vertices": VERTICES, "faces": FACES} | change))
