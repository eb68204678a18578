"""Light of a code's waves: of each against the others, and of all against the projector's response."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from procam.model.photometry import ResponseCurve
from procam.model.plan import Shot
from procam.workflows.solve.code_light import odd_waves, wave_notes

SIZE, PERIOD = (96, 64), 16.0
LEVELS = np.linspace(0, 1, 257)
GAMMAS = (2.0, 2.4, 2.2)  # of the primaries
MIX = np.array([[0.8, 0.15, 0.05], [0.1, 0.7, 0.2], [0.0, 0.1, 0.9]])


def _wave(number: int) -> np.ndarray:
    x = np.arange(SIZE[0])
    drive = (0.5 + 0.5 * np.cos(2 * np.pi * x / PERIOD - number)) ** (1 / 2.2)
    return np.broadcast_to(drive[None, :, None], (SIZE[1], SIZE[0], 3)).astype(np.float32)


def _green(drive: np.ndarray) -> np.ndarray:
    """What the camera's green sees of grey drives (H, W, 3), by the model's formula."""
    return sum(MIX[1, c] * drive[..., c] ** g for c, g in enumerate(GAMMAS))  # type: ignore[return-value]


class Photographs:
    """Waves as a camera sees them whose pixels are the projector's, with light `base` in the room."""

    def __init__(self, factor: float, base: float, colour: bool) -> None:
        shots = [
            Shot(f"w-{n}", "code", "p", "", (0.1,), detail={"plane": n + 2}) for n in range(16)
        ]
        self.plan = SimpleNamespace(of=lambda *_: shots)
        self.session = SimpleNamespace(pattern=lambda s: _wave(s.detail["plane"]))
        self._factor, self._base, self._colour = factor, base, colour

    def light(self, shot: Shot) -> np.ndarray:
        green = 0.7 * _green(_wave(shot.detail["plane"])) * self._factor + self._base
        green[0, 0] = np.nan  # saturated
        return np.stack([0 * green, green, 9 * green], -1) if self._colour else green


@pytest.mark.parametrize("colour", [False, True])
@pytest.mark.parametrize(
    ("factor", "noted"), [(1.0, False), (1.008, False), (1.012, True), (0.98, True)]
)
def test_waves_are_as_bright_as_the_response_predicts(
    factor: float, noted: bool, colour: bool
) -> None:
    values = np.stack([LEVELS**g for g in GAMMAS], axis=1)
    found: Any = SimpleNamespace(
        response=ResponseCurve(LEVELS, values, 0 * values), colour=SimpleNamespace(mix=MIX)
    )
    photographs: Any = Photographs(factor, 0.05, colour)
    panel = np.stack(np.meshgrid(*map(np.arange, SIZE)), axis=-1).astype(np.float32)
    white, base = np.full(panel.shape[:2], 0.7), np.full(panel.shape[:2], 0.05)
    white[5:9] = np.nan  # sees no pattern
    notes = wave_notes(photographs, "p", panel, white, base, found)
    assert len(notes) == noted
    assert all(f"show {factor:.2f} times the light that its response predicts" in n for n in notes)


def test_a_wave_with_the_light_of_another_exposure_is_named() -> None:
    shots = [Shot(f"w-{n}", "code", "p", "", (0.1,), detail={"plane": n}) for n in range(2, 7)]
    light = {0: 900.0, 1: 100.0, 2: 500.0, 3: 504.0, 4: 538.0, 5: 444.0, 6: 497.0}
    (note,) = odd_waves(light, shots, "p")
    assert "w-5 shows 0.86 times" in note
