"""Compensation of meshes: against the sphere's closed form, general solvers, and every set of limits."""

from dataclasses import dataclass

import mesh_shapes
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear
from tolerances import CLOSED_FORM, SOLVER

from procam.compensate.mesh import CompensatedMesh, MeshCompensator
from procam.errors import DidNotConverge, InputError, ShapeError, UnitError
from procam.maths.geometry.sphere import normalise
from procam.maths.light.box_solver import solve_moments
from procam.maths.mesh import active_set
from procam.maths.mesh.facets import face_areas
from procam.maths.mesh.form_factors import form_factors
from simulators.solid_angles import triangle_solid_angles

QP = 1e-7  # what is asked between our light and that of a general solver
COARSE, FINE, RADIUS_M = 5, 10, 2.0


@dataclass(frozen=True)
class Problem:
    """One colour: (N, 1) arrays but for factors (N, N), area and weight (N,)."""

    factors: np.ndarray
    albedo: np.ndarray
    area: np.ndarray
    lo: np.ndarray
    hi: np.ndarray
    target: np.ndarray
    weight: np.ndarray

    @property
    def bounces(self) -> np.ndarray:
        """N (N, N), by a dense inverse."""
        return np.linalg.inv(np.eye(len(self.area)) - self.albedo * self.factors)

    def compensator(self) -> MeshCompensator:
        return MeshCompensator(self.factors, self.albedo, self.area, lo=self.lo, hi=self.hi)

    def exact(self) -> CompensatedMesh:
        return self.compensator().exact(self.target)

    def least_squares(self) -> CompensatedMesh:
        return self.compensator().least_squares(self.target, self.weight)


def _problem(faces: int, seed: int, hardness: float, albedo: float = 0.6) -> Problem:
    """A room of random exchange, reciprocal and closed; `hardness` 0 clips nothing, 3 nearly everything."""
    rng = np.random.default_rng(seed)
    exchange = rng.uniform(0, 1, (faces, faces)) ** 3
    exchange += exchange.T
    area = exchange.sum(axis=1)
    lo, hi = rng.uniform(0, 0.02, (faces, 1)), rng.uniform(0.6, 0.9, (faces, 1))
    target = rng.uniform(0, 1, (faces, 1)) ** (1 + 2 * hardness) * 1.2
    if hardness == 0:
        lo, hi, target = lo - 9, hi + 9, target + 0.5
    unlit = rng.uniform(size=(faces, 1)) < 0.15
    lo, hi = np.where(unlit, 0, lo), np.where(unlit, 0, hi)
    return Problem(
        exchange / area[:, None],
        rng.uniform(0.4, 1, (faces, 1)) * albedo,
        area,
        lo,
        hi,
        target,
        rng.uniform(0.1, 3, faces),
    )


problems = st.builds(
    _problem,
    st.integers(2, 60),
    st.integers(0, 2**31),
    st.sampled_from([0.0, 0.5, 1.0, 3.0]),
    st.sampled_from([0.3, 0.6, 0.97]),
)


def _in_box(problem: Problem, matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """The least |matrix x - right| within the limits, where they leave a choice; elsewhere x is 0."""
    choice = (problem.lo < problem.hi)[:, 0]
    bounds = (problem.lo[choice, 0], problem.hi[choice, 0])
    return lsq_linear(matrix[:, choice], right, bounds, method="bvls", tol=1e-15).x


@given(problem=problems)
def test_what_is_free_is_exact_and_what_is_held_wants_to_go_further(problem: Problem) -> None:
    shown = problem.exact()
    total = problem.bounces @ shown.direct
    excess, choice = total - problem.target, problem.lo < problem.hi
    np.testing.assert_allclose(shown.total, total, atol=SOLVER)
    assert np.abs(excess[shown.free]).max(initial=0) < 1e-10
    assert (excess[choice & (shown.direct == problem.lo)] >= -SOLVER).all()
    assert (excess[choice & (shown.direct == problem.hi)] <= SOLVER).all()
    assert ((shown.direct >= problem.lo) & (shown.direct <= problem.hi)).all()


@pytest.mark.parametrize("seed", range(4))
def test_exact_is_the_least_energy_by_a_general_solver(seed: int) -> None:
    """(P) minimises 1/2 x' G x - x' G N^-1 t, G = diag(area / albedo) N; reciprocity makes it symmetric."""
    problem = _problem(40, seed, 1.0)
    energy = (problem.area / problem.albedo[:, 0])[:, None] * problem.bounces
    np.testing.assert_allclose(energy, energy.T, atol=1e-11 * energy.max())
    choice = (problem.lo < problem.hi)[:, 0]
    root = np.linalg.cholesky((energy + energy.T) / 2).T
    unclipped = np.linalg.solve(problem.bounces, problem.target)[:, 0]
    expected = _in_box(problem, root, root @ unclipped)
    np.testing.assert_allclose(problem.exact().direct[choice, 0], expected, atol=QP)


@pytest.mark.parametrize("albedo", [0.3, 0.9])
@pytest.mark.parametrize("seed", range(4))
def test_least_squares_by_a_general_solver(seed: int, albedo: float) -> None:
    problem = _problem(40, seed, 1.0, albedo)
    choice = (problem.lo < problem.hi)[:, 0]
    root = np.sqrt(problem.weight)[:, None]
    expected = _in_box(problem, root * problem.bounces, (root * problem.target)[:, 0])
    shown = problem.least_squares()
    np.testing.assert_allclose(shown.direct[choice, 0], expected, atol=QP)
    assert shown.certificate.kkt[0] < SOLVER
    assert 0 < shown.free.sum() < choice.sum()


@settings(max_examples=25)
@given(problem=problems)
def test_least_squares_slopes_point_out_of_the_box(problem: Problem) -> None:
    shown, bounces = problem.least_squares(), problem.bounces
    slope = bounces.T @ (problem.weight[:, None] * (bounces @ shown.direct - problem.target))
    slope /= (bounces.T @ (problem.weight[:, None] * bounces)).diagonal()[:, None]
    choice = problem.lo < problem.hi
    assert np.abs(slope[shown.free]).max(initial=0) < SOLVER
    assert (slope[choice & (shown.direct == problem.lo)] >= -SOLVER).all()
    assert (slope[choice & (shown.direct == problem.hi)] <= SOLVER).all()


def test_faces_nobody_looks_at_and_nothing_lights_may_weigh_nothing() -> None:
    problem = _problem(30, 2, 1.0)
    unlit = (problem.lo == problem.hi)[:, 0]
    weight = np.where(unlit, 0, problem.weight)
    assert unlit.any()
    shown = problem.compensator().least_squares(problem.target, weight)
    root = np.sqrt(weight)[:, None]
    expected = _in_box(problem, root * problem.bounces, (root * problem.target)[:, 0])
    np.testing.assert_allclose(shown.direct[~unlit, 0], expected, atol=QP)


@dataclass(frozen=True)
class Sphere:
    """A whole sphere of flat faces, and what its closed form says of it."""

    middle: np.ndarray
    solid: np.ndarray
    area: np.ndarray
    factors: np.ndarray

    @classmethod
    def of(cls, steps: int) -> "Sphere":
        half, faces = mesh_shapes.hemisphere(RADIUS_M, steps)
        both = np.concatenate([faces, faces[:, ::-1] + len(half)])
        vertices, faces = mesh_shapes.welded(np.concatenate([half, half * [1, 1, -1]]), both)
        corners = normalise(vertices)[faces]
        solid = np.abs(triangle_solid_angles(*np.moveaxis(corners, 1, 0)))
        middle = normalise(corners.mean(axis=1))
        return cls(middle, solid, face_areas(vertices, faces), form_factors(vertices, faces))

    def problem(self, rest: float) -> Problem:
        """The upper half lit, of uneven paint; the rest of albedo `rest`."""
        x, y, z = self.middle.T
        lit = z > 0
        bright = np.where(np.abs(y) < 0.35, 1.05, 0.5)
        target = np.where(x > 0, bright + 0.1 * z, np.where(z > 0.6, 0.25, 0.02))
        columns = (
            np.where(lit, 0.6 + 0.1 * x, rest),
            np.where(lit, 0.003, 0),
            np.where(lit, 0.9, 0),
            np.where(lit, target, 0),
        )
        albedo, lo, hi, target = (c[:, None] for c in columns)
        return Problem(self.factors, albedo, self.area, lo, hi, target, self.area)

    def closed_form(self, problem: Problem) -> tuple[np.ndarray, np.ndarray]:
        """Direct and scattered light (N,) of (P) on the sphere itself, every face its share of it."""
        albedo, lo, hi, target = (
            a[:, 0] for a in (problem.albedo, problem.lo, problem.hi, problem.target)
        )
        scatter = albedo / (4 * np.pi - self.solid @ albedo)
        flux = solve_moments(target, scatter[:, None], self.solid[:, None], lo, hi)
        scattered = scatter * flux
        return np.clip(target - scattered, lo, hi), scattered


@pytest.fixture(scope="module")
def spheres() -> tuple[Sphere, Sphere]:
    return Sphere.of(COARSE), Sphere.of(FINE)


@pytest.mark.parametrize("rest", [0.0, 0.5])
def test_a_meshed_sphere_is_a_sphere(spheres: tuple[Sphere, Sphere], rest: float) -> None:
    """Flat faces send each other a little less than the sphere's, which falls with their area."""
    errors = []
    for sphere in spheres:
        problem = sphere.problem(rest)
        shown = problem.exact()
        direct, scattered = sphere.closed_form(problem)
        assert min(shown.certificate.share_lo[0], shown.certificate.share_hi[0]) > 0.05
        assert shown.certificate.kkt[0] < 1e-12 and shown.certificate.self_consistency[0] < 1e-12
        error = sphere.area @ (shown.direct[:, 0] - direct) ** 2
        errors.append(np.sqrt(error / (sphere.area @ scattered**2)))
        missing = 1 - sphere.area.sum() / (4 * np.pi * RADIUS_M**2)
        assert errors[-1] < 1.5 * missing  # what flat faces lack of the sphere's area
    assert errors[1] < 0.4 * errors[0]  # faces of a quarter of the area


def test_each_colour_is_a_problem_of_its_own() -> None:
    red, blue = _problem(20, 3, 1.0), _problem(20, 3, 1.0, 0.3)
    both = MeshCompensator(
        red.factors,
        np.hstack([red.albedo, blue.albedo]),
        red.area,
        lo=np.hstack([red.lo, blue.lo]),
        hi=np.hstack([red.hi, blue.hi]),
    ).exact(np.hstack([red.target, blue.target]))
    np.testing.assert_array_equal(both.direct, np.hstack([p.exact().direct for p in (red, blue)]))


def test_the_certificate_gives_fluxes_and_shares() -> None:
    problem = _problem(30, 4, 1.0)
    shown = problem.exact()
    certificate, choice = shown.certificate, (problem.lo < problem.hi)[:, 0]
    at_lo, at_hi = ((shown.direct == limit)[:, 0] & choice for limit in (problem.lo, problem.hi))
    assert certificate.flux_in[0] == pytest.approx(problem.area @ problem.target[:, 0])
    assert certificate.flux_out[0] == pytest.approx(problem.area @ shown.direct[:, 0])
    assert certificate.share_lo[0] == pytest.approx(
        problem.area[at_lo].sum() / problem.area[choice].sum()
    )
    assert certificate.share_hi[0] == pytest.approx(
        problem.area[at_hi].sum() / problem.area[choice].sum()
    )


def test_the_certificate_sees_light_that_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = _problem(30, 4, 1.0)
    right = active_set.exact_light
    monkeypatch.setattr(
        "procam.compensate.mesh.exact_light", lambda *a: np.clip(right(*a) + 1e-3, a[2], a[3])
    )
    assert problem.exact().certificate.kkt[0] > 3e-4


def test_a_dark_room_and_a_black_one() -> None:
    problem = _problem(10, 5, 1.0)
    black = MeshCompensator(
        problem.factors, 0 * problem.albedo, problem.area, lo=problem.lo, hi=problem.hi
    )
    shown = black.exact(problem.target)
    np.testing.assert_array_equal(shown.direct, np.clip(problem.target, problem.lo, problem.hi))
    none = MeshCompensator(
        problem.factors, problem.albedo, problem.area, lo=0 * problem.lo, hi=0 * problem.hi
    ).exact(0 * problem.target)
    assert not none.total.any() and not none.free.any()
    assert (none.certificate.share_lo == 0).all()


class TestNewtonIsNotTrusted:
    """Steps that lead nowhere are replaced by those that bring all points closer."""

    @pytest.fixture(autouse=True)
    def _misled(self, monkeypatch: pytest.MonkeyPatch) -> None:
        step = active_set._step
        monkeypatch.setattr(
            active_set,
            "_step",
            lambda right, once, accuracy: (
                100 * right
                if accuracy == active_set.NEWTON_ACCURACY
                else step(right, once, accuracy)
            ),
        )

    def test_exact(self) -> None:
        assert _problem(25, 6, 1.0).exact().certificate.kkt[0] < CLOSED_FORM

    def test_it_gives_up_and_says_so(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(active_set, "STEPS", 5)
        with pytest.raises(DidNotConverge, match=r"light still changes by .* after 5 steps"):
            _problem(25, 6, 1.0).exact()

    def test_a_balance_that_is_not_found(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(active_set, "_step", lambda right, *_: 0 * right)
        room = active_set.MeshRoom(np.full(3, 0.5), np.full((3, 3), 1 / 3))
        with pytest.raises(DidNotConverge, match="no solution after 200 corrections"):
            room.total(np.ones(3))


class TestRefusals:
    good = _problem(8, 7, 1.0)

    def _refused(self, error: type[InputError], match: str, **changed: np.ndarray) -> None:
        parts = {k: getattr(self.good, k) for k in ("factors", "albedo", "area", "lo", "hi")}
        parts |= changed
        with pytest.raises(error, match=match) as refusal:
            MeshCompensator(
                parts["factors"], parts["albedo"], parts["area"], lo=parts["lo"], hi=parts["hi"]
            )
        assert "\n" not in str(refusal.value)

    def test_shapes(self) -> None:
        good = self.good
        self._refused(ShapeError, "form factors has shape .7, 8.", factors=good.factors[1:])
        self._refused(ShapeError, "form factors has shape .0, 0.", factors=np.zeros((0, 0)))
        self._refused(ShapeError, "albedo has shape .8,.; it needs", albedo=good.albedo[:, 0])
        self._refused(ShapeError, "area_m2 has shape .7,.; it needs .8,.", area=good.area[1:])
        self._refused(ShapeError, "lo has shape .7, 1.", lo=good.lo[1:])
        self._refused(ShapeError, "hi has shape .8, 2.", hi=np.hstack([good.hi, good.hi]))

    def test_what_is_not_finite(self) -> None:
        good = self.good
        for key, name in (("albedo", "albedo"), ("area", "area_m2"), ("lo", "lo"), ("hi", "hi")):
            bad = getattr(good, key).copy()
            bad[2] = np.nan
            self._refused(InputError, f"{name}: NaN or infinity on 1 of 8", **{key: bad})
        bad = good.factors.copy()
        bad[2, 3] = np.inf
        self._refused(InputError, "form factors: some are neg", factors=bad)
        self._refused(InputError, "form factors: some are neg", factors=-good.factors)

    def test_units(self) -> None:
        good = self.good
        self._refused(
            UnitError, "area_m2: the least is 0; areas must be above 0", area=0 * good.area
        )
        self._refused(
            UnitError, "albedo: .* to 1 is not all within.*percent", albedo=good.albedo * 0 + 1
        )
        self._refused(UnitError, "albedo: -.* is not all within 0", albedo=-good.albedo)

    def test_a_room_that_never_darkens(self) -> None:
        half = np.full((8, 8), 0.25)
        self._refused(
            InputError, "returns 1.8 of its light", factors=half, albedo=np.full((8, 1), 0.9)
        )

    def test_limits_that_cross(self) -> None:
        swapped = {"lo": self.good.hi, "hi": self.good.lo}
        self._refused(InputError, "lo is above hi on .* of 8 values; .*swapped", **swapped)

    def test_targets(self) -> None:
        compensator, target = self.good.compensator(), self.good.target
        for solve in (compensator.exact, compensator.least_squares):
            with pytest.raises(ShapeError, match=r"target has shape .7, 1.; it needs"):
                solve(target[1:])
            with pytest.raises(InputError, match="target: NaN or infinity on 8 of 8"):
                solve(target * np.nan)

    def test_weights(self) -> None:
        compensator, target = self.good.compensator(), self.good.target
        for error, match, weight in (
            (ShapeError, "weight has shape .7,.", np.ones(7)),
            (InputError, "weight: NaN or infinity on 8", np.full(8, np.nan)),
            (UnitError, "weight: the least is -1; none", np.full(8, -1.0)),
            (InputError, "weight: 0 on .* light can be chosen", np.zeros(8)),
        ):
            with pytest.raises(error, match=match):
                compensator.least_squares(target, weight)
