"""What a track holds: order of the numbers, textures, and the moves of the live variant."""

from dataclasses import replace

import numpy as np
import pytest
from furnished_domes import furnished

from procam.compensate.fields import Fields
from procam.compensate.track import TERMS, columns, moves, row, textures, uniforms
from procam.kernels.frame.reference import monomials
from procam.maths.geometry.sphere import master_directions, master_solid_angles
from procam.model.calibration import Calibration
from procam.model.mask import Mask

SIZE = 96  # of the maps: content's pixels are the fields' nodes


def test_terms_have_the_order_of_the_kernels() -> None:
    direction, _ = master_directions(5)
    x, y, z = np.moveaxis(direction, -1, 0)
    found = monomials(np.stack([x, y, z]), len(TERMS))
    for name, values in zip(TERMS, found, strict=True):
        python = "*".join(name) if name.isalpha() else name.replace("^", "**")
        expected = np.broadcast_to(eval(python, {"x": x, "y": y, "z": z}), x.shape)
        np.testing.assert_allclose(values, expected, atol=1e-15)


def test_a_row_is_term_by_term_and_rgb_in_each() -> None:
    numbers = np.arange(27.0).reshape(3, 9)
    named = dict(zip(columns(9), row(numbers, 9), strict=True))
    assert named["1.R"] == 0 and named["1.G"] == 9 and named["1.B"] == 18
    assert named["z^2.R"] == 8 and named["xy.B"] == 22
    assert list(named)[:4] == ["1.R", "1.G", "1.B", "x.R"]
    assert list(row(numbers, 1)) == [0, 9, 18]


class TestUniforms:
    @pytest.mark.parametrize(
        ("name", "transfer", "exponent"),
        [
            ("linear", 0, 1.0),
            ("srgb", 1, 1.0),
            ("gamma2.2", 2, 2.2),
            ("gamma2.4", 2, 2.4),
            ("gamma2.6", 2, 2.6),
            ("bt1886", 2, 2.4),
        ],
    )
    def test_transfer_function(self, name: str, transfer: int, exponent: float) -> None:
        found = uniforms(name, np.dtype(np.float32))
        assert (found["transfer"], found["exponent"]) == (transfer, exponent)

    @pytest.mark.parametrize(
        ("dtype", "top", "levels"),
        [(np.uint8, 1, 255), (np.uint16, 1, 0), (np.float16, 1e30, 0), (np.float32, 1e30, 0)],
    )
    def test_what_the_target_holds(self, dtype: type, top: float, levels: float) -> None:
        found = uniforms("srgb", np.dtype(dtype))
        assert (found["top"], found["levels"]) == (top, levels)


class TestTextures:
    def test_what_is_the_same_all_over_is_one_texel(self, calibration: Calibration) -> None:
        fields = Fields.of(calibration, SIZE)
        free = replace(fields, shown=replace(fields.shown, hi=None))
        found = textures(free)
        same = {"ambient": (0, 3), "hi": (1e30, 3), "gain": (1, 1), "protection": (0, 1)}
        for name, (value, channels) in same.items():
            assert found[name].shape == (1, 1, channels)
            assert (found[name] == np.float32(value)).all()

    def test_protected_places_are_of_the_content_s_size(self, calibration: Calibration) -> None:
        covered = np.zeros((SIZE, SIZE), bool)
        covered[30:40, 50:60] = True
        maps = replace(calibration.maps, protected=Mask("screen", covered))
        found = textures(Fields.of(replace(calibration, maps=maps), 2 * SIZE))
        assert found["protection"].shape == (2 * SIZE, 2 * SIZE, 1)
        assert found["protection"][60:80, 100:120].all()
        assert found["protection"].sum() == 400

    def test_thresholds_fill_their_range(self, calibration: Calibration) -> None:
        tile = textures(Fields.of(calibration, SIZE))["dither"]
        assert tile.shape == (64, 64, 1)
        assert 0 <= tile.min() < 0.01 and 0.99 < tile.max() < 1


class Dome:
    """A dome's light in plain sums over the nodes; `limits` may be left out."""

    def __init__(self, calibration: Calibration, target: np.ndarray, limits: bool = True) -> None:
        self.fields = Fields.of(calibration, SIZE)
        self.target, self.limits = target, limits
        direction, inside = master_directions(SIZE)
        self.terms = monomials(np.moveaxis(direction, -1, 0), len(TERMS))
        self.weight = master_solid_angles(SIZE) * self.fields.model.coverage * inside
        self.moves = moves(self.fields).astype(float)

    def moments(self, numbers: np.ndarray) -> np.ndarray:
        """(3, 9) of the direct light that numbers (3, 9) lead to."""
        model = self.fields.model
        direct = self.target - model.spread * np.tensordot(self.terms, numbers, (0, 1))
        if self.limits:
            direct = np.clip(direct, model.lo, model.hi)
        return np.tensordot(self.weight[..., None] * direct, self.terms, ((0, 1), (1, 2)))

    def step(self, numbers: np.ndarray) -> np.ndarray:
        """As solve.frag moves numbers (3, 9)."""
        from_moments = np.einsum("rkc,ck->cr", self.moves[:9], self.moments(numbers))
        return from_moments + np.einsum("rkc,ck->cr", self.moves[9:], numbers)


class TestMoves:
    def test_one_step_solves_what_no_limit_holds(self, calibration: Calibration) -> None:
        dome = Dome(furnished(calibration, 2), 0.5 + 0.3 * master_directions(SIZE)[0], limits=False)
        first = dome.step(np.zeros((3, 9)))
        np.testing.assert_allclose(dome.step(first), first, atol=1e-5 * np.abs(first).max())

    def test_steps_lead_to_numbers_that_agree_with_their_light(
        self, calibration: Calibration
    ) -> None:
        """Against plain iteration, which is slow but needs no slope: its factor is m."""
        dome = Dome(
            furnished(calibration, 2), np.clip(0.2 + 0.6 * master_directions(SIZE)[0], 0, None)
        )
        exact = np.zeros((3, 9))
        for _ in range(40):
            exact = dome.fields.coefficients_of(dome.moments(exact))
        numbers, errors = np.zeros((3, 9)), []
        for _ in range(8):
            numbers = dome.step(numbers)
            errors.append(np.abs(numbers - exact).max())
        assert errors[-1] < 1e-5 * np.abs(exact).max()
        assert errors[2] < 0.05 * errors[0]
