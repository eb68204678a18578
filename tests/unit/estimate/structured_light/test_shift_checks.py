"""Whether phases of several periods agree with the decoded columns."""

import numpy as np
import pytest

from procam.estimate.structured_light.shift_checks import phases_apart_deg, phases_note
from procam.maths.codes.phase import Waves, equal_steps

LENGTH = 192
COLUMNS = np.broadcast_to(np.arange(LENGTH, dtype=np.float32), (40, LENGTH))


def shown(periods: tuple[float, ...], shift_deg: float = 0.0) -> tuple[list[np.ndarray], Waves]:
    """Photographs of three steps of each period, all shifted, and the waves without that shift."""
    steps = np.tile(equal_steps(3), len(periods))
    waves = Waves(np.repeat(periods, 3), steps, 3)
    phase = COLUMNS[..., None] * (2 * np.pi / waves.periods) - steps - np.radians(shift_deg)
    return list(np.moveaxis(100 + 50 * np.cos(phase), -1, 0)), waves


def test_right_waves_agree() -> None:
    assert phases_note(*shown((16, 48, 192)), COLUMNS, LENGTH) == ""


def test_a_wrong_shift_moves_each_period_by_its_own_share() -> None:
    """Columns follow the finest period, and the others are off by the rest of the angle."""
    frames, waves = shown((16, 48, 192), 20.0)
    moved = COLUMNS - 20 / 360 * 16
    apart = dict(phases_apart_deg(frames, waves, moved, LENGTH))
    for period, off in apart.items():
        np.testing.assert_allclose(off, -20 * (1 - 16 / period), atol=0.01)
    note = phases_note(frames, waves, moved, LENGTH)
    assert note.startswith("the sinusoids of period 192 px lie up to 18 degrees from where")


def test_a_wrong_period_is_off_by_more_at_the_far_end() -> None:
    frames, waves = shown((16, 48))
    wrong = Waves(np.where(waves.periods == 16, 15.8, 48), waves.shifts, 3)
    apart = dict(phases_apart_deg(frames, wrong, COLUMNS, LENGTH))
    assert np.abs(apart[48.0]).max() < 0.01
    assert np.all(np.diff(apart[15.8]) < -5)
    assert "of period 15.8 px" in phases_note(frames, wrong, COLUMNS, LENGTH)


@pytest.mark.parametrize("kept", [[0, 1, 3, 4], [0, 1, 2, 3]])
def test_periods_of_unequal_or_few_steps_are_not_judged(kept: list[int]) -> None:
    frames, waves = shown((16, 48), 30.0)
    keep = np.isin(np.arange(6), kept)
    some = [frames[i] for i in kept]
    apart = dict(phases_apart_deg(some, waves.kept(keep), COLUMNS, LENGTH))
    assert set(apart) == ({16.0} if 2 in kept else set())
