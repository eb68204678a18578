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


WHITE = Shot("w", "white", "p", "", (0.1,))
DIRECT, SCATTERED, ROOM = 0.6, 0.1, 0.05


class Photographs:
    """Waves before a camera whose pixels are the projector's, `factor` times as bright as predicted."""

    def __init__(self, factor: float, colour: bool) -> None:
        shots = [
            Shot(f"w-{n}", "code", "p", "", (0.1,), detail={"plane": n + 2}) for n in range(16)
        ]
        self.plan = SimpleNamespace(of=lambda *_: shots)
        self.only = lambda *_: WHITE
        self.session = SimpleNamespace(pattern=self._pattern)
        self._factor, self._colour = factor, colour

    def _pattern(self, shot: Shot) -> np.ndarray:
        white = np.ones((SIZE[1], SIZE[0], 3), np.float32)
        drive = white if shot is WHITE else np.array(_wave(shot.detail["plane"]))
        drive[:8, :8] = 1.0  # the number, in all pictures
        return drive

    def light(self, shot: Shot) -> np.ndarray:
        wave = _green(self._pattern(shot))
        green = self._factor * (DIRECT * wave + SCATTERED * wave.mean()) + ROOM
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
    panel = np.stack(np.meshgrid(*map(np.arange, SIZE)), axis=-1).astype(np.float32)
    every = np.ones((*panel.shape[:2], 3))
    found: Any = SimpleNamespace(
        response=ResponseCurve(LEVELS, values, 0 * values),
        colour=SimpleNamespace(mix=MIX),
        light=SimpleNamespace(direct=DIRECT * every, scattered=SCATTERED * every),
    )
    photographs: Any = Photographs(factor, colour)
    sound = np.ones(panel.shape[:2], bool)
    sound[5:9] = False
    notes = wave_notes(photographs, "p", panel, sound, ROOM * every, found)
    assert len(notes) == noted
    assert all(f"show {factor:.2f} times the light that its response" in n for n in notes)


def test_a_wave_with_the_light_of_another_exposure_is_named() -> None:
    shots = [Shot(f"w-{n}", "code", "p", "", (0.1,), detail={"plane": n}) for n in range(2, 7)]
    light = {0: 900.0, 1: 100.0, 2: 500.0, 3: 504.0, 4: 538.0, 5: 444.0, 6: 497.0}
    (note,) = odd_waves(light, shots, "p")
    assert "w-5 shows 0.86 times" in note
