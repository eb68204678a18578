"""Inter-reflection between two plates, by hand."""

import numpy as np
import pytest

from procam.errors import InputError
from procam.maths.mesh.radiosity import (
    add_mesh_interreflection,
    check_gain,
    remove_mesh_interreflection,
)

FACTORS = np.array([[0, 0.5], [0.5, 0]], np.float32)
ALBEDO = np.array([[0.8], [0.4]])


def test_two_plates() -> None:
    """B1 = e1 + 0.4 b2 and b2 = e2 + 0.2 b1, so b1 = (e1 + 0.4 e2) / (1 - 0.08)."""
    direct = np.array([[1.0], [0.5]])
    first = (1 + 0.4 * 0.5) / (1 - 0.08)
    total = add_mesh_interreflection(direct, ALBEDO, FACTORS)
    np.testing.assert_allclose(total, [[first], [0.5 + 0.2 * first]], rtol=1e-6)
    np.testing.assert_allclose(
        remove_mesh_interreflection(total, ALBEDO, FACTORS), direct, rtol=1e-6
    )


def test_a_gain_of_1_or_a_negative_albedo_is_refused() -> None:
    check_gain(np.full((2, 1), 1.9), FACTORS)
    with pytest.raises(InputError, match="returns 1 of its light at every bounce"):
        check_gain(np.full((2, 1), 2.0), FACTORS)
    with pytest.raises(InputError, match=r"the lowest is -0\.1"):
        check_gain(np.full((2, 1), -0.1), FACTORS)
