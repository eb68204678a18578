"""Compensated frames against double precision; studies/precision.md has the large ones."""

import numpy as np
import pytest

from studies import precision

SIZE = 1024


@pytest.mark.parametrize("measured", [False, True])
def test_light(measured: bool) -> None:
    found = precision.study(SIZE, measured, np.float32)
    assert found["kkt"] < 1e-8
    assert found["flux"] < 1e-8
    assert found["moments"] < 2e-5
    assert found["picture"] < 2.5e-7


@pytest.mark.parametrize("measured", [False, True])
def test_codes(measured: bool) -> None:
    found = precision.study(SIZE, measured, np.uint8)
    assert max(found["kkt"], found["flux"], found["moments"]) < 2e-5
    assert found["picture"] < 0.53


@pytest.mark.parametrize("measured", [False, True])
def test_structures(measured: bool) -> None:
    for row in precision.structured(SIZE, measured):
        assert row["off"] < (5e-5 if row["structure"] == "one row" else 2e-5), row
