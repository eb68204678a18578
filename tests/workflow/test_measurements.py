"""Measurements whose pictures lie in a file."""

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


def test_the_file_has_no_name_and_is_not_written_to(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    with MeasurementsOnDisk(tmp_path) as kept:
        kept["south"] = measured(rng)
        assert list(tmp_path.iterdir()) == []
        with pytest.raises(ValueError, match="read-only"):
            kept["south"].black[0, 0] = 1
