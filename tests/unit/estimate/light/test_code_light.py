"""Light of a code's waves: of each against the others, and of all against the projector's response."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from procam.estimate.light.code_light import odd_waves, wave_notes
from procam.estimate.light.projector_images import Picture
from procam.model.photometry import ResponseCurve
from procam.model.plan import Shot

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


DIRECT, SCATTERED, ROOM = 0.6, 0.1, 0.05


def photographs(factor: float, colour: bool) -> Any:
    """Waves before a camera whose pixels are the projector's, `factor` times as bright as predicted."""

    def picture(drive: np.ndarray) -> Picture:
        drive = np.array(drive)
        drive[:8, :8] = 1.0  # the number, in all pictures
        wave = _green(drive)
        green = factor * (DIRECT * wave + SCATTERED * wave.mean()) + ROOM
        green[0, 0] = np.nan  # saturated
        light = np.stack([0 * green, green, 9 * green], -1) if colour else green
        return Picture("w", "code", lambda: drive, lambda: light)

    white = np.ones((SIZE[1], SIZE[0], 3), np.float32)
    code = [picture(_wave(n + 2)) for n in range(16)]
    return SimpleNamespace(name="p", white=picture(white), code=code)


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
        light=SimpleNamespace(
            direct=DIRECT * every, scattered=SCATTERED * every, lit=np.ones(panel.shape[:2], bool)
        ),
    )
    unpatterned = np.zeros(panel.shape[:2], bool)
    unpatterned[5:9] = True
    sight: Any = SimpleNamespace(xy=panel, base=ROOM * every, unpatterned=unpatterned)
    notes = wave_notes(photographs(factor, colour), sight, found)
    assert len(notes) == noted
    assert all(f"show {factor:.2f} times the light that its response" in str(n) for n in notes)


def test_a_wave_with_the_light_of_another_exposure_is_named() -> None:
    shots = [Shot(f"w-{n}", "code", "p", "", (0.1,), detail={"plane": n}) for n in range(2, 7)]
    light = {0: 900.0, 1: 100.0, 2: 500.0, 3: 504.0, 4: 538.0, 5: 444.0, 6: 497.0}
    (note,) = odd_waves(light, shots, "p")
    assert "other light than the rest of them: w-5 (0.86 times). Their" in str(note)
    assert note.amount == pytest.approx(1.4, abs=0.05)
    light[3] = 700.0  # one more is more of it
    (both,) = odd_waves(light, shots, "p")
    assert "w-3 (1.50 times), w-5" in str(both) and both.amount > 2 * note.amount + 1
