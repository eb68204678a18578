"""Standard errors of lenses on boards and lenses outside the models; studies/boards.md has 100 seeds."""

import json

import numpy as np
import pytest
from real_captures import ov_plane_views

from procam.estimate.boards.camera import CameraFit, fit_camera
from procam.maths.geometry.lenses import lens_parameters
from studies import boards as study
from studies.measure import HERE


def test_the_study_meets_its_goals() -> None:
    for row in json.loads((HERE / "boards.json").read_text())["rows"]:
        assert min(row["covered"]) >= 0.9, row
        assert max(row["sigma_over_error"]) <= 2, row


@pytest.mark.parametrize(("command", "seeds"), [("camera", 2), ("pair", 3)])
def test_prisms_before_a_curled_board(command: str, seeds: int) -> None:
    """The first seeds of the study: covered as there, with intervals as long as there."""
    case = next(c for c in study.CASES if (c.command, c.name) == (command, "both"))
    rows = json.loads((HERE / "boards.json").read_text())["rows"]
    whole = next(row for row in rows if (row["command"], row["case"]) == (command, "both"))
    results = (study.errors(case, seed) for seed in range(seeds))
    error, sigma = (np.array(part) for part in zip(*results, strict=True))
    assert np.mean(np.abs(error) <= 2 * sigma) >= 0.9
    ratio = np.median(sigma, axis=0) / whole["rms_error"]
    assert (ratio <= 2).all()
    assert np.median(ratio) >= 0.7


def test_halves_of_a_real_set_agree() -> None:
    """With sigmas from noise alone they differ by up to 13 sigma."""
    views = [*ov_plane_views("train"), *ov_plane_views("test")]
    middle = len(views) // 2
    one, other = (
        fit_camera(half, (1280, 800), "kannala-brandt") for half in (views[:middle], views[middle:])
    )
    z = standardised(one, other)
    print(z)
    assert np.abs(z).max() < 2
    # nor are the intervals so wide that anything agrees
    assert np.sqrt(np.mean(z**2)) > 0.25


def standardised(one: CameraFit, other: CameraFit) -> np.ndarray:
    """Differences (P,) of the parameters over their standard errors."""
    variance = np.diag(one.covariance) + np.diag(other.covariance)
    return (lens_parameters(one.lens) - lens_parameters(other.lens)) / np.sqrt(variance)
