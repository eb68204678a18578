"""Sizes of what these tests write: in full, each calibration is 50 MB to write, copy and read."""

from collections.abc import Iterator

import pytest

from procam.estimate import calibration
from procam.interfaces.cli import _sessions

MASTER = 128


@pytest.fixture(scope="module", autouse=True)
def small_maps() -> Iterator[None]:
    """Dome maps and sample pictures of 128 pixels; test files may choose other sizes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "MAP_SIZE", MASTER)
        patch.setattr(_sessions, "CONTENT_SIZE", MASTER)
        yield
