"""[acceptance] of venue.toml: its keys are the figures of the registry, and its mistakes are named."""

from pathlib import Path

import pytest
from venue_texts import PLAIN, load_venue_of, mistakes

from procam.files.venue.tables import AcceptanceTable
from procam.model.acceptance import CRITERIA


def test_keys_are_the_figures_of_the_registry() -> None:
    assert list(AcceptanceTable.model_fields) == list(CRITERIA)


def test_limits_that_are_given(tmp_path: Path) -> None:
    assert load_venue_of(tmp_path, PLAIN).table.acceptance.limits == {}
    text = f"{PLAIN}\n[acceptance]\ncoverage = 1\nalbedo = 0.55\n"
    assert load_venue_of(tmp_path, text).table.acceptance.limits == {"coverage": 1, "albedo": 0.55}


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("coverage = 90", "acceptance.coverage is 90; it must be 1 or less"),
        ("coverage = 0.0", "acceptance.coverage is 0.0; it must be more than 0"),
        ("albedo = -1", "acceptance.albedo is -1; it must be more than 0"),
        ("loop_own_jnd = nan", "acceptance.loop_own_jnd is nan; it must be a finite number"),
        ("feedback = true", "acceptance.feedback is True; it must be a number"),
        ('feedback = "0.5"', "acceptance.feedback is '0.5'; it must be a number"),
        ("feedback = [0.5]", "acceptance.feedback is [0.5]; it must be a number"),
        (
            "sphere_variance_ratio = 0.9",
            "acceptance.sphere_variance_ratio is 0.9; it must be 1 or more",
        ),
        (
            "covrage = 0.9",
            "acceptance.covrage is not a known key; did you mean coverage? The keys are "
            + ", ".join(CRITERIA),
        ),
        (
            "sharpness = 1",
            "acceptance.sharpness is not a known key; remove it or check its spelling. The keys are "
            + ", ".join(CRITERIA),
        ),
    ],
)
def test_a_mistake_is_one_line(tmp_path: Path, line: str, message: str) -> None:
    (found,) = mistakes(tmp_path, f"{PLAIN}\n[acceptance]\n{line}\n")
    assert found == f"{tmp_path / 'venue.toml'}: {message}"
