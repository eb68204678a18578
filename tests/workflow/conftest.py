"""Sizes for tests of whole runs: in full, each calibration is 50 MB to write, copy and read."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from tiny_venue import quick_simulator

from procam.estimate.light import floor_albedo
from procam.files.calibration import save_calibration
from procam.interfaces.cli import _sessions
from procam.interfaces.plots import figure
from procam.model.calibration import Calibration

FLOOR_DROPS = (0.2,)  # depths at which the floor may lie: one is as good for commands as five


@pytest.fixture(scope="module", autouse=True)
def small_results(request: pytest.FixtureRequest) -> Iterator[None]:
    """A quick simulator and small charts; studies search the floor in full."""
    with quick_simulator(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(figure, "DPI", 90)
        if not request.module.__name__.endswith("_small"):
            patch.setattr(floor_albedo, "DROPS", FLOOR_DROPS)
        yield


@pytest.fixture(scope="module")
def no_report() -> Iterator[None]:
    """Commands write no report of a calibration; test_cli_report.py shows it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_sessions, "write_report", lambda venue: venue / "report.html")
        yield


@pytest.fixture(scope="session")
def kept(tmp_path_factory: pytest.TempPathFactory, calibration: Calibration) -> Path:
    """The small, fully known calibration on disk; no test writes there."""
    directory = tmp_path_factory.mktemp("kept") / "0001"
    save_calibration(calibration, directory)
    return directory


@pytest.fixture
def venue(once: Path, tmp_path: Path) -> Path:
    """A copy of the venue that a module has calibrated `once`."""
    return Path(shutil.copytree(once, tmp_path / "venue"))
