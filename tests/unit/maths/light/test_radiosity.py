"""Adding and removing inter-reflection as arrays; the physics is in tests/physics."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tolerances import CLOSED_FORM, SOLVER

from procam.errors import InputError, ShapeError
from procam.maths.geometry.sphere import cap_solid_angle
from procam.maths.light.radiosity import (
    add_interreflection,
    albedo_from_feedback,
    floor_return,
    flux,
    remove_interreflection,
    sphere_scatter,
)

counts = st.integers(1, 40)
seeds = st.integers(0, 2**31)


def _scene(patches: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 2, (patches, 3)), rng.uniform(0, 0.3, (patches, 3)), rng.random(patches)


@given(patches=counts, seed=seeds)
def test_removing_undoes_adding(patches: int, seed: int) -> None:
    direct, u, a = _scene(patches, seed)
    total = add_interreflection(direct, u, a)
    np.testing.assert_allclose(remove_interreflection(total, u, a), direct, atol=SOLVER)


def test_channels_do_not_mix() -> None:
    direct, u, a = _scene(7, 1)
    alone = np.zeros_like(direct)
    alone[:, 1] = direct[:, 1]
    total = add_interreflection(alone, u, a)
    assert not total[:, [0, 2]].any()
    np.testing.assert_array_equal(total[:, 1], add_interreflection(direct, u, a)[:, 1])


def test_flux_refuses_patches_that_do_not_match() -> None:
    with pytest.raises(ShapeError, match=r"solid_angle_sr has shape \(3,\); it needs \(4,\)"):
        flux(np.ones((4, 3)), np.ones(3))


@pytest.mark.parametrize(
    ("light", "scatter", "areas"),
    [((4,), (4, 1), (4,)), ((4, 1), (4,), (4,)), ((4, 1), (1, 1), (4,)), ((4, 3), (4, 1), (4,))],
)
@pytest.mark.parametrize("change", [add_interreflection, remove_interreflection])
def test_shapes_that_would_broadcast_are_refused(
    change: Callable[..., np.ndarray], light: tuple, scatter: tuple, areas: tuple
) -> None:
    with pytest.raises(ShapeError):
        change(np.ones(light), np.full(scatter, 0.1), np.ones(areas))


@pytest.mark.parametrize(
    ("albedo", "areas", "returned", "words"),
    [
        (2.0, 1.0, 0.0, "albedo: each value needs to be between 0 and 1"),
        (-0.1, 1.0, 0.0, "albedo: each value"),
        (np.nan, 1.0, 0.0, "albedo: each value"),
        (0.5, 0.0, 0.0, "the sum is 0 sr; none may be below 0"),
        (0.5, 4.0, 0.0, "at most that of a sphere"),
        (0.5, 1.0, -1.0, "returned: -1.0 is no share of light"),
        (0.5, 1.0, 1.0, "returned: 1.0 is no share of light"),
    ],
)
def test_light_that_no_sphere_scatters_is_refused(
    albedo: float, areas: float, returned: float, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        sphere_scatter(np.full((4, 1), albedo), np.full(4, areas), returned)


class TestFloorReturn:
    @pytest.mark.parametrize("half_angle_deg", [30.0, 60.0, 90.0])
    def test_a_level_floor_that_closes_the_cap(self, half_angle_deg: float) -> None:
        """Returned share is rho_f (1 - f): K = [1 + rho_f (1 - f)/f] / A_s (I14)."""
        half_angle = np.radians(half_angle_deg)
        fraction = cap_solid_angle(half_angle) / (4 * np.pi)
        found = floor_return(half_angle, 0.0, 0.2)
        assert found == pytest.approx(0.2 * (1 - fraction), rel=CLOSED_FORM)

    def test_a_black_floor_returns_nothing(self) -> None:
        assert floor_return(np.pi / 2, 0.2, 0.0) == 0.0

    def test_leaning_either_way_is_the_same(self) -> None:
        assert floor_return(1.5, 0.2, 0.3) == floor_return(1.5, -0.2, 0.3)

    def test_a_gap_at_the_rim_loses_light(self) -> None:
        shares = [floor_return(np.pi / 2, np.radians(t), 0.2) for t in (0, 5, 10, 20)]
        assert shares == sorted(shares, reverse=True) and len(set(shares)) == 4


class TestAlbedo:
    @given(
        albedo=st.floats(0.05, 0.95), lit=st.floats(0.1, 1.0), half_angle=st.floats(0.3, np.pi / 2)
    )
    def test_inverse_of_the_feedback_of_a_cap(
        self, albedo: float, lit: float, half_angle: float
    ) -> None:
        screen = cap_solid_angle(half_angle)
        fraction = screen / (4 * np.pi)
        returned = floor_return(half_angle, 0.0, 0.3)
        kernel = (1 + returned / fraction) / (4 * np.pi)
        feedback = albedo * kernel * lit * screen / (1 - albedo * kernel * screen)
        found = albedo_from_feedback(np.array([feedback]), lit * screen, screen, returned)
        assert found[0] == pytest.approx(albedo, rel=1e-10)

    @pytest.mark.parametrize("lit", [0.0, -1.0, 6.4])
    def test_refuses_a_lit_part_larger_than_the_screen(self, lit: float) -> None:
        with pytest.raises(InputError, match=r"lit solid angle is .* half_angle_deg"):
            albedo_from_feedback(np.array([0.3]), lit, 2 * np.pi)
