"""The objective's slopes, and the optimum against a general solver's."""

import numpy as np
import pytest
from scipy.optimize import minimize

from procam.compensate.perceptual.descent import Descent, Multiplier
from procam.compensate.perceptual.light import FieldTransport, Stage
from procam.compensate.perceptual.objective import Contrast, Guard
from procam.maths.vision.pu21 import pu21
from procam.maths.vision.pyramid import Pyramid

SIZE = 24
WHITE = 14.0


def scene(rng: np.random.Generator, size: int = SIZE) -> np.ndarray:
    """Bright on the left, dark with detail on the right: (3, N, N)."""
    light = np.where(np.arange(size) < size // 2, 0.7, 0.05)
    detail = np.exp(0.5 * rng.normal(size=(3, size, size)))
    return np.clip(light * detail, 0.001, 1).astype(np.float32)


def screen(size: int = SIZE, feedback: float = 0.33, terms: int = 1) -> Stage:
    ones = np.ones((3, size, size), np.float32)
    area = np.full((size, size), 1 / size**2, np.float32)
    line = np.linspace(-1, 1, size)
    phi = np.stack([np.ones((size, size)), *np.meshgrid(line, line), np.zeros((size, size))])
    operator = np.zeros((3, terms, terms))
    operator[:, 0, 0] = feedback
    if terms > 1:
        operator[:, 1, 1], operator[:, 0, 1] = 0.1, 0.02
    transport = FieldTransport(ones, None, area, phi[:terms], operator)
    return Stage(np.float32(0.0005) * ones, ones, area, transport, 20.0)


def slope_along(costs: Contrast | Guard, picture: np.ndarray, step: np.ndarray) -> float:
    ahead, behind = (costs.of(picture + sign * step)[0] for sign in (1, -1))
    return (ahead - behind) / 2


@pytest.mark.parametrize("kind", ["rough", "smooth"])
@pytest.mark.parametrize("part", [Contrast, Guard])
def test_slopes(part: type, kind: str, rng: np.random.Generator) -> None:
    target = scene(rng, 64)
    weight = np.full(target.shape[1:], 1 / 64**2, np.float32)
    levels = (Pyramid(np.ones_like(weight), 20.0),) if part is Contrast else ()
    costs = part(*levels, target, weight, WHITE)
    picture = (0.9 * target + 0.08).astype(np.float32)
    shape = (3, 64, 64) if kind == "rough" else (3, 1, 1)
    step = (0.002 * rng.normal(size=shape) * picture).astype(np.float32)
    value, slope = costs.of(picture)
    found = slope_along(costs, picture, step)
    assert abs(found - np.vdot(slope, step)) < 0.02 * abs(found) + 1e-5 * value


def test_a_picture_like_its_target_costs_nothing(rng: np.random.Generator) -> None:
    target = scene(rng)
    weight = np.full(target.shape[1:], 1 / SIZE**2, np.float32)
    contrast = Contrast(Pyramid(np.ones_like(weight), 20.0), target, weight, WHITE)
    guard = Guard(target, weight, WHITE)
    for costs in (contrast, guard):
        value, slope = costs.of(target)
        assert value == 0
        assert np.abs(slope).max() == 0
    dimmer = np.float32(0.8) * target  # contrast is that of the picture's own mean
    assert contrast.of(dimmer)[0] < 1e-6 * contrast.of(target + np.float32(0.1))[0]
    assert guard.of(dimmer)[0] > 1


def test_the_guard_counts_luminance_and_colours(rng: np.random.Generator) -> None:
    target = np.repeat(scene(rng)[:1], 3, axis=0)
    weight = rng.uniform(0, 1, target.shape[1:]).astype(np.float32)
    weight /= weight.sum()
    seen = target + np.float32(0.1)
    units = [pu21(light[0] * WHITE) for light in (seen, target)]
    error = float((weight * (units[0] - units[1]) ** 2).sum())
    # the same error in all colours and in luminance: 1 + 3 times 0.1
    assert Guard(target, weight, WHITE).of(seen)[0] == pytest.approx(1.3 * error, rel=1e-3)


@pytest.mark.parametrize("terms", [1, 4])
def test_adjoint_of_the_transport(terms: int, rng: np.random.Generator) -> None:
    transport = screen(terms=terms).transport
    x, g = rng.uniform(size=(2, 3, SIZE, SIZE)).astype(np.float32)
    left, right = np.vdot(transport.total(x), g), np.vdot(x, transport.adjoint(g))
    assert left == pytest.approx(right, rel=1e-5)


@pytest.mark.parametrize("lamps", [False, True])
def test_total_light(lamps: bool, rng: np.random.Generator) -> None:
    known = screen().transport
    extra = np.full_like(known.spread, 0.01) if lamps else None
    transport = FieldTransport(known.spread, extra, known.area, known.terms, known.operator)
    direct = rng.uniform(size=known.spread.shape).astype(np.float32)
    expected = direct + 0.33 * direct.mean(axis=(1, 2), keepdims=True) + (0.01 if lamps else 0)
    np.testing.assert_allclose(transport.total(direct), expected, rtol=1e-5)


def test_the_optimum_is_near_that_of_a_general_solver(rng: np.random.Generator) -> None:
    target, stage = scene(rng, 16), screen(16)
    problem = stage.problem(target, WHITE)
    scattered = np.full_like(target, 0.33 * target.mean())
    exact = np.clip(target - scattered, stage.lo, stage.hi)
    start = problem.transport.total(exact)
    most = problem.guard.of(start)[0]
    multiplier = Multiplier()
    direct = Descent(problem, scattered, multiplier).run(exact, most, 60, 0.12)

    def cost(x: np.ndarray) -> tuple[float, np.ndarray]:
        total = problem.transport.total(x.reshape(target.shape).astype(np.float32))
        (j, sharp), (p, guarded) = problem.contrast.of(total), problem.guard.of(total)
        slope = problem.transport.adjoint(sharp / j + guarded * (multiplier.value / most))
        return np.log(j) + multiplier.value * p / most, slope.ravel().astype(float)

    limits = list(zip(stage.lo.ravel(), stage.hi.ravel(), strict=True))
    best = minimize(cost, direct.ravel(), jac=True, bounds=limits, options={"maxiter": 300}).fun
    before, found = cost(exact.ravel())[0], cost(direct.ravel())[0]
    assert found < before
    assert before - found > 0.85 * (before - best)
    assert problem.guard.of(problem.transport.total(direct))[0] < 1.2 * most
