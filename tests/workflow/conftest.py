"""Sizes for tests of whole runs: in full, each calibration is 50 MB to write, copy and read."""

from collections.abc import Iterator

import pytest

from procam.estimate import calibration
from procam.estimate.light import floor_albedo
from procam.interfaces.cli import _sessions
from procam.interfaces.plots import figure

MASTER = 128
FLOOR_DROPS = (0.2,)  # depths at which the floor may lie: one is as good for commands as five


@pytest.fixture(scope="module", autouse=True)
def small_results(request: pytest.FixtureRequest) -> Iterator[None]:
    """Small dome maps, pictures and charts, which files may replace; studies search the floor in full."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "MAP_SIZE", MASTER)
        patch.setattr(_sessions, "CONTENT_SIZE", MASTER)
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
