"""The study of photometry at a quarter of its size or less, one seed: errors, intervals, response, seams."""

from pathlib import Path
from typing import Any

import pytest

from simulators import truth
from simulators.scene import SceneSize
from studies import photometry

MASTER = 128
SMALL = SceneSize(
    projectors=2, projector_size=(240, 150), camera_size=(320, 320), rays=256, map_size=MASTER
)


@pytest.fixture
def row(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """A realistic venue whose camera's veiling glare was measured at a desk."""
    with pytest.MonkeyPatch.context() as patch:
        for module, name in ((truth, "MASTER"), (photometry, "MASTER"), (photometry, "PATCHES")):
            patch.setattr(module, name, MASTER)
        shared, folder = (tmp_path_factory.mktemp(n) for n in ("truth", "venue"))
        truth_dir = photometry.make_truth(shared, "realistic", SMALL)
        found = photometry.calibrate_and_judge(folder, "realistic", 1, truth_dir, SMALL)
        return found | photometry.seams(folder)


def test_a_realistic_venue_is_within_its_intervals(row: dict[str, Any]) -> None:
    assert abs(row["feedback_error"]) < 0.01
    assert abs(row["albedo_error"]) < 0.025
    assert all(row["feedback_covers"]) and all(row["albedo_covers"])
    # two projectors average gloss less than four
    assert row["feedback_half_width"] < 0.045 and row["albedo_half_width"] < 0.07
    assert row["response_error"] < 0.003
    assert row["seam_delta_e_mean"] < 0.5
    # patches of 1.4 degrees, panel pixels of a third of a degree
    assert row["seam_delta_e_95"] < 1.2
    lines = list(photometry.table([row, row | {"preset": "standard"}]))
    assert len(lines) == 2 + len(photometry.COLUMNS)
    assert "| albedo, intervals that cover, widest | >= 88 %, +-6 % | 3 of 3" in lines[5]


def test_the_measured_glare_is_that_of_the_preset(tmp_path: Path) -> None:
    photometry._write_venue(tmp_path, "realistic", 2, SMALL)
    lines = (tmp_path / "venue.toml").read_text().splitlines()
    glare, sigma = (
        float(next(line for line in lines if line.startswith(key)).split("=")[1].split("#")[0])
        for key in ("glare =", "glare_sigma =")
    )
    assert abs(glare - 0.01) < 3 * sigma and sigma < 0.001
