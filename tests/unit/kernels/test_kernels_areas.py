"""solid_angles against its reference implementation and against closed forms."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from procam import kernels
from procam.errors import InputError, ShapeError
from procam.kernels.areas import reference
from procam.maths.geometry.sphere import cap_solid_angle, direction_from_angles, grid_solid_angles

GRIDS = [
    (1, 1),
    (1, 9),
    (9, 1),
    (3, 5),
    (17, 16),
    (33, 31),
    (5, 255),
    (5, 256),
    (40, 259),
    (2, 600),
]
ROUNDINGS = 1e-13  # of a cell 1e-4 rad across: the corners themselves are good to 1e-16


def panel(height: int, width: int, half_width: float = 0.8) -> np.ndarray:
    """Corner directions (H + 1, W + 1, 3) of a pinhole panel, `half_width` in focal lengths."""
    x = np.linspace(-half_width, half_width, width + 1)
    y = np.linspace(-0.6, 0.5, height + 1)
    points = np.stack(np.broadcast_arrays(*np.meshgrid(x, y), 1.0), axis=-1)
    return points / np.linalg.norm(points, axis=-1, keepdims=True)


@pytest.mark.parametrize("grid", GRIDS, ids=str)
def test_equals_the_reference(level: str, grid: tuple[int, int]) -> None:
    corners = panel(*grid)
    found = kernels.solid_angles([corners], grid)
    assert found.dtype == np.float64
    np.testing.assert_allclose(found, reference.solid_angles(corners), rtol=ROUNDINGS)


def test_the_reference_is_the_formula_of_the_maths(rng: np.random.Generator) -> None:
    corners = panel(7, 9)
    np.testing.assert_array_equal(reference.solid_angles(corners), grid_solid_angles(corners))


@pytest.mark.parametrize("turned", [False, True])
def test_cells_as_large_as_an_octant(level: str, turned: bool) -> None:
    """Elevations 0, 45, 90 degrees by azimuths of 90: a hemisphere, whichever way round."""
    azimuth, elevation = np.meshgrid(np.radians([0, 90, 180, 270, 360]), np.radians([0, 45, 90]))
    corners = direction_from_angles(azimuth, elevation)
    corners = corners[::-1] if turned else corners
    assert kernels.solid_angles([corners], (2, 4)).sum() == pytest.approx(2 * np.pi, rel=1e-14)


def test_tiny_cells_lose_no_digits(level: str) -> None:
    """Cells of 1e-7 rad: the sum of a million is the solid angle of the rectangle."""
    half = 5e-5
    x = np.linspace(-half, half, 1001)
    points = np.stack(np.broadcast_arrays(*np.meshgrid(x, x), 1.0), axis=-1)
    corners = points / np.linalg.norm(points, axis=-1, keepdims=True)
    exact = 4 * np.arcsin(np.sin(np.arctan(half)) ** 2)
    found = kernels.solid_angles([corners], (1000, 1000))
    assert found.sum() == pytest.approx(exact, rel=1e-12)
    np.testing.assert_allclose(found, exact / 1e6, rtol=2e-8)  # corners are rounded to 1e-16


def test_a_cap_in_rings(level: str) -> None:
    """Rings of chords lie inside the cap's rim: less than its area by (2 pi / n)^2 / 6."""
    sides, angle = 2000, 0.9
    rows = np.linspace(np.pi / 2, np.pi / 2 - angle, 51)
    azimuth, elevation = np.meshgrid(np.linspace(0, 2 * np.pi, sides + 1), rows)
    found = kernels.solid_angles([direction_from_angles(azimuth, elevation)], (50, sides)).sum()
    assert found == pytest.approx(cap_solid_angle(angle), rel=3e-6)


@pytest.mark.parametrize("cuts", [[1], [7, 11], [0, 2, 2, 20], [40]], ids=str)
def test_blocks_are_one_grid(level: str, cuts: list[int]) -> None:
    corners = panel(40, 37)
    blocks = (block for block in np.split(corners, cuts))
    found = kernels.solid_angles(blocks, (40, 37))
    np.testing.assert_array_equal(found, kernels.solid_angles([corners], (40, 37)))


@pytest.mark.parametrize("grid", [(0, 5), (5, 0)], ids=str)
def test_grids_of_nothing(level: str, grid: tuple[int, int]) -> None:
    corners = np.ones((grid[0] + 1, grid[1] + 1, 3))
    assert kernels.solid_angles([corners], grid).shape == grid


def test_nan_corners_spoil_their_cells_only(level: str) -> None:
    corners = panel(9, 300)
    clean = kernels.solid_angles([corners], (9, 300))
    corners[4, 7, 1] = corners[0, 0, 0] = corners[9, 300, 2] = np.nan
    spoilt = np.zeros((9, 300), bool)
    spoilt[3:5, 6:8] = spoilt[0, 0] = spoilt[8, 299] = True
    found = kernels.solid_angles([corners], (9, 300))
    np.testing.assert_array_equal(np.isnan(found), spoilt)
    np.testing.assert_array_equal(found[~spoilt], clean[~spoilt])


def test_nan_beside_a_wide_cell(level: str) -> None:
    corners = direction_from_angles(*np.meshgrid(np.arange(6.0), [0.0, 0.8]))
    corners[0, 0] = np.nan
    found = kernels.solid_angles([corners], (1, 5))
    np.testing.assert_allclose(found, reference.solid_angles(corners), rtol=ROUNDINGS)


def test_cells_without_extent_are_nothing(level: str) -> None:
    corners = np.broadcast_to([0.0, 0.0, 1.0], (3, 20, 3)).copy()
    np.testing.assert_array_equal(kernels.solid_angles([corners], (2, 19)), 0)
    corners[:, 1::2] *= -1  # opposite points: every great circle joins them
    assert not np.isnan(kernels.solid_angles([corners], (2, 19))).any()


def test_odd_layouts(level: str, odd_layout: Callable[[np.ndarray], np.ndarray]) -> None:
    corners = panel(9, 21)
    expected = kernels.solid_angles([corners], (9, 21))
    np.testing.assert_array_equal(kernels.solid_angles([odd_layout(corners)], (9, 21)), expected)
    wide = np.zeros((20, 30, 3))
    wide[::-2, 4:26] = corners  # rows apart and upwards: read as they lie
    np.testing.assert_array_equal(kernels.solid_angles([wide[::-2, 4:26]], (9, 21)), expected)


def test_threads_change_nothing(level: str) -> None:
    corners = panel(70, 301)
    found = []
    for threads in (1, 2):
        with kernels.forced(level, threads):
            found.append(kernels.solid_angles([corners], (70, 301)))
    np.testing.assert_array_equal(*found)


def test_writes_to_the_array_given(level: str) -> None:
    corners, room = panel(6, 9), np.full((8, 9), -1.0)
    found = kernels.solid_angles([corners], (6, 9), out=room[1:7])
    assert np.shares_memory(found, room)
    np.testing.assert_array_equal(found, kernels.solid_angles([corners], (6, 9)))
    assert (room[[0, 7]] == -1).all()


@given(st.integers(0, 2**31), st.integers(1, 4), st.integers(1, 40), st.floats(1e-6, 3))
def test_any_grid(seed: int, height: int, width: int, step: float) -> None:
    """Random corners, from nearly one point to all over the sphere."""
    rng = np.random.default_rng(seed)
    points = [0, 0, 1] + step * rng.normal(0, 1, (height + 1, width + 1, 3))
    corners = points / np.linalg.norm(points, axis=-1, keepdims=True)
    expected = reference.solid_angles(corners)
    for name in kernels.available():
        with kernels.forced(name):
            found = kernels.solid_angles([corners], (height, width))
        # of a folded cell the two triangles cancel: judged by the size of the corners' spread
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-13 * min(step, 1) ** 2)


@pytest.mark.parametrize(
    ("blocks", "error", "text"),
    [
        ([], InputError, "blocks: 0 rows of cells were given; 4"),
        ([np.ones((4, 4, 3))], InputError, "blocks: 3 rows of cells were given; 4"),
        ([np.ones((6, 4, 3))], InputError, "blocks: 5 rows of cells or more were given; 4"),
        ([np.ones((3, 4, 3))] * 2, InputError, "blocks: 5 rows of cells or more were given; 4"),
        ([np.ones((5, 3, 3))], ShapeError, r"blocks has shape \(5, 3, 3\); it needs \(n, 4, 3\)"),
        ([np.ones((5, 12))], ShapeError, r"blocks has shape \(5, 12\)"),
        ([np.ones((5, 4, 3), np.float32)], InputError, "blocks: float32 is too coarse"),
    ],
)
def test_what_does_not_fit_is_refused(blocks: list, error: type, text: str) -> None:
    with pytest.raises(error, match=text):
        kernels.solid_angles(blocks, (4, 3))


@pytest.mark.parametrize(
    ("out", "text"),
    [
        (np.ones((3, 4)), r"out has shape \(3, 4\)"),
        (np.ones((4, 3), np.float32), "out: it is float32; float64 is needed"),
        (np.ones((4, 6))[:, ::2], "out: a writable, contiguous"),
    ],
)
def test_results_that_cannot_be_written_are_refused(out: np.ndarray, text: str) -> None:
    with pytest.raises(InputError, match=text):
        kernels.solid_angles([np.ones((5, 4, 3))], (4, 3), out=out)
