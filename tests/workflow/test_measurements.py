"""Measurements whose pictures lie in a file."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from procam.estimate.light.measurement import ProjectorMeasurement
from procam.estimate.light.separation import SeparatedLight
from procam.workflows.solve.measurements import MeasurementsOnDisk


def measured(rng: np.random.Generator) -> ProjectorMeasurement:
    direct, scattered, black = rng.normal(size=(3, 5, 7, 3)).astype(np.float32)
    light = SeparatedLight(direct, scattered, np.ones(3), direct[..., 0] > 0)
    anything: Any = SimpleNamespace()
    return ProjectorMeasurement(light, black, anything, anything, notes=["a note"])


def assert_same(found: ProjectorMeasurement, right: ProjectorMeasurement) -> None:
    np.testing.assert_array_equal(found.black, right.black)
    np.testing.assert_array_equal(found.light.direct, right.light.direct)
    np.testing.assert_array_equal(found.light.scattered, right.light.scattered)
    np.testing.assert_array_equal(found.light.lit, right.light.lit)
    assert found.notes == right.notes and found.colour is right.colour


def test_what_was_put_in_comes_out(tmp_path: Path, rng: np.random.Generator) -> None:
    pair = {name: measured(rng) for name in ("south", "north")}
    other = replace(pair["south"], black=2 * pair["south"].black)
    with MeasurementsOnDisk(tmp_path) as kept:
        kept.update(pair)
        assert list(kept) == ["south", "north"] and len(kept) == 2
        for name, each in pair.items():
            assert_same(kept[name], each)
        kept["south"] = other
        assert_same(kept["south"], other)
        assert_same(kept["north"], pair["north"])
        del kept["south"]
        assert list(kept) == ["north"]


def test_the_file_has_no_name_and_is_not_written_to(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    with MeasurementsOnDisk(tmp_path) as kept:
        kept["south"] = measured(rng)
        assert list(tmp_path.iterdir()) == []
        with pytest.raises(ValueError, match="read-only"):
            kept["south"].black[0, 0] = 1
