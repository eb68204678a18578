"""Normal equations and residuals of the bundle adjustment, against reference and differences."""

from collections.abc import Callable

import numpy as np
import pytest

from procam import kernels
from procam.errors import InputError, ShapeError
from procam.kernels import ObservationBlock, PlacedDevice, ShapeDerivatives
from procam.kernels.bundle import lenses as reference_lenses
from procam.kernels.bundle import reference as reference_bundle
from procam.maths.geometry.pose import rotation_matrix
from procam.maths.geometry.ray_to_screen import RoundShape, shape_coefficient_count

COUNTS = [(0, 4), (1, 0), (63, 4), (64, 0), (129, 4), (4097, 0)]  # C handles 64, NumPy 4096 at once
RADIUS_M = 6.0
LENSES = {
    "brown": np.array([870.0, 872, 960, 640, -0.02, 0.002, 0.001, -0.0005, 0.0007]),
    "kannala-brandt": np.array([900.0, 905, 1500, 1499, 0.02, -0.008, 0.001, -0.0002]),
}
TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
ROUNDINGS = 1e-11  # of the product of two columns' lengths
Case = tuple[ObservationBlock, np.ndarray, np.ndarray, np.ndarray, ShapeDerivatives | None]


def device(kind: str, turn: tuple, shift: tuple, pupil: tuple = (0.0, 0.0)) -> PlacedDevice:
    return PlacedDevice(
        rotation_matrix(turn) @ TURN, np.array(shift), kind, LENSES[kind], np.array(pupil)
    )


def case(
    count: int, camera: str = "kannala-brandt", projector: str = "brown", degree: int = 0
) -> Case:
    """Rays that end in the projector's view, so that none is nearly behind it."""
    rng = np.random.default_rng(4)
    shape = RoundShape(RADIUS_M, rng.normal(0, 2e-3, shape_coefficient_count(degree)), degree)
    eye = device(camera, (0.1, -0.05, 0.3), (0.3, -0.2, 0.5), (0.004, 0.002))
    source = device(projector, (-0.4, 0.3, 0.2), (0.2, 0.5, 3.0))
    ray = np.c_[rng.uniform(-0.7, 0.7, (count, 2)), np.ones(count)]
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    block = ObservationBlock(eye, source, RADIUS_M, shape.harmonic_coefficients)
    derivatives = shape.shape_derivatives(*reference_bundle.rays_sent(eye, ray))
    seen = rng.normal(0, 3, (count, 2)) + reference_bundle.bundle_residuals(
        block, ray, np.zeros((count, 2)), derivatives
    )
    return block, ray, seen, rng.uniform(0.5, 2, count), derivatives


def assert_same(found: kernels.NormalEquations, wanted: kernels.NormalEquations) -> None:
    length = np.sqrt(np.diag(wanted.matrix))
    length = np.where(length > 0, length, 1.0)
    np.testing.assert_allclose(
        found.matrix / np.outer(length, length),
        wanted.matrix / np.outer(length, length),
        atol=ROUNDINGS,
    )
    size = np.sqrt(wanted.cost)
    np.testing.assert_allclose(
        found.gradient / length, wanted.gradient / length, atol=ROUNDINGS * size
    )
    assert found.cost == pytest.approx(wanted.cost, rel=ROUNDINGS)


@pytest.mark.parametrize(
    ("camera", "projector", "degree", "lens_free"),
    [
        (camera, projector, 4 if (camera == projector) is free else 0, free)
        for camera in LENSES
        for projector in LENSES
        for free in (False, True)
    ],
)
class TestKinds:
    def test_equations_equal_the_reference(
        self, level: str, camera: str, projector: str, degree: int, lens_free: bool
    ) -> None:
        given = case(777, camera, projector, degree)
        found = kernels.bundle_equations(*given, lens_free=lens_free)
        assert_same(found, reference_bundle.bundle_equations(*given, lens_free))
        np.testing.assert_array_equal(found.matrix, found.matrix.T)

    def test_slopes_are_those_of_the_residuals(
        self, camera: str, projector: str, degree: int, lens_free: bool
    ) -> None:
        """Central differences of every parameter, rays and all, each on its own scale."""
        block, ray, seen, _, derivatives = case(40, camera, projector, degree)
        error, slopes = reference_bundle.bundle_rows(block, ray, seen, derivatives, lens_free)
        residuals = reference_bundle.bundle_residuals(block, ray, seen, derivatives)
        np.testing.assert_allclose(error, residuals, atol=1e-9)
        for i in range(slopes.shape[2]):
            ahead, behind = (_moved(block, ray, i, step, lens_free) for step in (1e-6, -1e-6))
            difference = np.subtract(
                reference_bundle.bundle_residuals(*ahead, seen, derivatives),
                reference_bundle.bundle_residuals(*behind, seen, derivatives),
            )
            size = np.abs(slopes[:, :, i]).max() + 1
            np.testing.assert_allclose(difference / 2e-6, slopes[:, :, i], atol=1e-6 * size)


def _moved(
    block: ObservationBlock, ray: np.ndarray, i: int, step: float, lens_free: bool
) -> tuple[ObservationBlock, np.ndarray]:
    """The block and its rays with parameter i changed, in the order of `bundle_rows`."""
    harmonics = block.harmonic_coefficients.size
    counts = [1, harmonics, 6, len(block.camera.lens), 2, 6, len(block.projector.lens)]
    x = np.split(step * np.eye(sum(counts))[i], np.cumsum(counts)[:-1])
    if not lens_free:
        x[3], x[4] = 0 * x[3], 0 * x[4]
    if x[3].any():  # a ray whose pixel stays: by its slopes, which have a test of their own
        ray = ray + reference_lenses.ray_slopes(ray, *block.camera[2:4]) @ x[3]
    eye, source = _turned(block.camera, x[2]), _turned(block.projector, x[5])
    eye = eye._replace(lens=eye.lens + x[3], pupil=eye.pupil + x[4])
    source = source._replace(lens=source.lens + x[6])
    return ObservationBlock(
        eye, source, RADIUS_M * float(np.exp(x[0][0])), block.harmonic_coefficients + x[1]
    ), ray


def _turned(device: PlacedDevice, x: np.ndarray) -> PlacedDevice:
    turn = rotation_matrix(x[:3])
    return device._replace(
        rotation=turn @ device.rotation, translation=turn @ device.translation + x[3:]
    )


@pytest.mark.parametrize(("count", "degree"), COUNTS)
def test_any_number_of_observations(level: str, count: int, degree: int) -> None:
    given = case(count, degree=degree)
    for lens_free in (False, True):
        found = kernels.bundle_equations(*given, lens_free=lens_free)
        assert found.matrix.shape == (1 + shape_coefficient_count(degree) + 31,) * 2
        assert_same(found, reference_bundle.bundle_equations(*given, lens_free))
    block, ray, seen, _, derivatives = given
    wanted = reference_bundle.bundle_residuals(block, ray, seen, derivatives)
    np.testing.assert_allclose(
        kernels.bundle_residuals(block, ray, seen, derivatives), wanted, atol=1e-9
    )


@pytest.mark.parametrize("degree", [0, 4])
def test_what_is_not_a_number_counts_as_nothing(level: str, degree: int) -> None:
    """Rays that miss, points behind the projector, unknown rays, pixels and weights."""
    block, ray, seen, weight, derivatives = case(300, degree=degree)
    keep = np.ones(300, bool)
    keep[[3, 70, 71, 140, 200]] = False
    sound = None if derivatives is None else ShapeDerivatives(*(part[keep] for part in derivatives))
    wanted = reference_bundle.bundle_equations(
        block, ray[keep], seen[keep], weight[keep], sound, True
    )
    away = np.array([0.0, 0, -1])  # lights the dome's other side, behind the projector
    ray[3], ray[70, 1], seen[71], weight[140], seen[200, 0] = away, np.nan, np.nan, np.nan, np.inf
    found = kernels.bundle_equations(block, ray, seen, weight, derivatives, lens_free=True)
    assert_same(found, wanted)
    residuals = kernels.bundle_residuals(block, ray, seen, derivatives)
    assert np.isnan(residuals[[3, 70, 71]]).all()
    assert np.isfinite(residuals[keep]).all()


def test_rays_that_miss_the_screen(level: str) -> None:
    """From outside of the sphere, most go past it."""
    block, ray, seen, weight, _ = case(200)
    far = block._replace(camera=block.camera._replace(translation=np.array([7.0, 0, 1])))
    residuals = kernels.bundle_residuals(far, ray, seen)
    lost = np.isnan(residuals).any(axis=1)
    assert 0 < lost.sum() < 200
    assert_same(
        kernels.bundle_equations(far, ray, seen, weight, lens_free=True),
        reference_bundle.bundle_equations(far, ray, seen, weight, None, True),
    )


def test_the_axis_of_a_fisheye(level: str) -> None:
    """There a direction across is not known, but every slope is."""
    block, ray, seen, weight, _ = case(65, projector="kannala-brandt")
    ray[:] = [0, 0, 1]
    straight = PlacedDevice(
        np.eye(3), np.zeros(3), "kannala-brandt", LENSES["kannala-brandt"], np.ones(2)
    )
    for projector in (straight, block.projector):
        pair = ObservationBlock(straight, projector, RADIUS_M, np.zeros(0))
        found = kernels.bundle_equations(pair, ray, seen, weight, lens_free=True)
        assert np.isfinite(found.matrix).all() and found.cost > 0
        assert_same(found, reference_bundle.bundle_equations(pair, ray, seen, weight, None, True))


def test_threads_change_nothing(level: str) -> None:
    block, ray, seen, weight, derivatives = case(5000, degree=2)
    found = []
    for threads in (1, 2, 3):
        with kernels.forced(level, threads):
            equations = kernels.bundle_equations(
                block, ray, seen, weight, derivatives, lens_free=True
            )
            residuals = kernels.bundle_residuals(block, ray, seen, derivatives)
            found.append((*equations, residuals))
    for other in found[1:]:
        for a, b in zip(found[0], other, strict=True):
            np.testing.assert_array_equal(a, b)


def test_odd_layouts(level: str, odd_layout: Callable[[np.ndarray], np.ndarray]) -> None:
    block, ray, seen, weight, derivatives = case(100, degree=2)
    wanted = kernels.bundle_equations(block, ray, seen, weight, derivatives)
    odd = [odd_layout(array) for array in (ray, seen, weight)]
    laid = ShapeDerivatives(*map(odd_layout, derivatives))
    found = kernels.bundle_equations(block, *odd, laid)
    np.testing.assert_allclose(found.matrix, wanted.matrix, rtol=ROUNDINGS)
    np.testing.assert_allclose(
        kernels.bundle_residuals(block, *odd[:2], laid),
        kernels.bundle_residuals(block, ray, seen, derivatives),
    )


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"ray": np.ones((5, 2))}, ShapeError, r"ray has shape \(5, 2\); it needs \(5, 3\)"),
        ({"seen": np.ones((4, 2))}, ShapeError, r"seen has shape \(4, 2\); it needs \(5, 2\)"),
        ({"weight": np.ones(6)}, ShapeError, r"weight has shape \(6,\)"),
        ({"derivatives": None}, InputError, "derivatives: the screen has 5 harmonic coefficients"),
    ],
)
def test_what_does_not_fit_is_refused(
    level: str, change: dict, error: type[Exception], text: str
) -> None:
    names = ("block", "ray", "seen", "weight", "derivatives")
    with pytest.raises(error, match=text):
        kernels.bundle_equations(**dict(zip(names, case(5, degree=2), strict=True)) | change)


def test_derivatives_of_other_harmonics_is_refused(level: str) -> None:
    block, ray, seen, weight, derivatives = case(5, degree=2)
    with pytest.raises(ShapeError, match=r"values has shape \(5, 5\); it needs \(5, 4\)"):
        kernels.bundle_equations(
            block._replace(harmonic_coefficients=np.zeros(4)), ray, seen, weight, derivatives
        )


def test_unknown_lenses_are_refused(level: str) -> None:
    block, ray, seen, weight, _ = case(5)
    for wrong in ({"kind": "orthographic"}, {"lens": np.ones(9)}):
        with pytest.raises(InputError, match="lens: kind"):
            kernels.bundle_equations(
                block._replace(camera=block.camera._replace(**wrong)), ray, seen, weight
            )


def test_too_many_harmonics_are_refused(level: str) -> None:
    block, ray, seen, weight, derivatives = case(5, degree=8)
    assert np.isfinite(kernels.bundle_equations(block, ray, seen, weight, derivatives, True).cost)
    block, ray, seen, weight, derivatives = case(5, degree=10)
    with pytest.raises(InputError, match="harmonic_coefficients: 117 are too many, at most 94"):
        kernels.bundle_equations(block, ray, seen, weight, derivatives)
