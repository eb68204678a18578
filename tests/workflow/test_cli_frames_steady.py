"""Why the numbers of a frame are not smoothed over time: on a pan, at a cut, with film grain.

What is seen is reckoned here from the light that is sent, by the bare sphere's own law.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest

from procam.compensate.compensator import Compensator
from procam.maths.geometry.sphere import master_solid_angles
from procam.model.calibration import Calibration
from procam.workflows.playout.frame import ClipEngine, FrameSettings
from procam.workflows.playout.sources import ClipFrame
from procam.workflows.sample_content import half_sky

SIZE, FRAMES, PAN_PX = 96, 12, 2
STEADY = 0.0022  # rms log change that the plain exact solution is known for on a 2 px/frame pan
ALPHAS = (0.6, 0.3, 0.1)
Frames = Sequence[np.ndarray]


@dataclass(frozen=True)
class Show:
    """A dome that scatters half as much as projectors send, and what is seen there."""

    calibration: Calibration

    def play(self, frames: Frames, alpha: float = 1.0) -> Frames:
        """What is sent for frames with numbers that are smoothed over time; 1 is not at all."""
        compensator, numbers, sent = Compensator(self.calibration, SIZE), None, []
        for frame in frames:
            own = compensator.solve(frame).coefficients
            numbers = own if numbers is None else numbers + alpha * (own - numbers)
            sent.append(np.asarray(compensator.apply(frame, numbers)))
        return sent

    def seen(self, sent: np.ndarray) -> np.ndarray:
        """Light on the dome (N, N, 3), all bounces: b0 + u (a . b0)."""
        maps = self.calibration.maps
        flux = np.tensordot(master_solid_angles(SIZE) * maps.coverage, sent.astype(float), 2)
        return (sent + maps.scatter_per_flux * flux) * (maps.coverage > 0)[..., None]

    def free(self, sent: np.ndarray) -> np.ndarray:
        """Where no limit holds."""
        maps = self.calibration.maps
        inside = (sent > maps.lo + 1e-6) & (sent < maps.hi - 1e-6)
        return inside & (maps.coverage > 0)[..., None]

    def shimmer(self, alpha: float = 1.0) -> float:
        """Root mean square log change of the seen light of registered frames, where no limit holds."""
        changes = []
        for before, after in pairwise(self.play(pan(), alpha)):
            was, now = self.seen(before)[:, PAN_PX:], self.seen(after)[:, :-PAN_PX]
            both = self.free(before)[:, PAN_PX:] & self.free(after)[:, :-PAN_PX]
            changes.append(np.log(now[both] / was[both]))
        return float(np.sqrt(np.mean(np.concatenate(changes) ** 2)))

    def worst_error(self, frames: Frames, alpha: float = 1.0) -> list[float]:
        """How far what is seen is from the content where no limit holds, per frame, of white."""
        return [
            float(np.abs(self.seen(s) - f)[self.free(s)].max(initial=0))
            for s, f in zip(self.play(frames, alpha), frames, strict=True)
        ]


@pytest.fixture(scope="module")
def show(make_calibration: Callable[..., Calibration]) -> Show:
    return Show(make_calibration(feedback=(0.5, 0.5, 0.5), lo=0.0005))


def pan() -> Frames:
    """A sky that moves to the left by 2 px per frame; registered by moving it back."""
    wide = half_sky(2 * SIZE)[SIZE // 2 :]
    return [np.ascontiguousarray(wide[:SIZE, PAN_PX * k :][:, :SIZE]) for k in range(FRAMES)]


def dark() -> Frames:
    return [np.ascontiguousarray(0.2 * frame[::-1]) for frame in pan()]


def test_a_pan_does_not_shimmer(show: Show) -> None:
    assert show.shimmer() < STEADY / 1000


@pytest.mark.parametrize("alpha", ALPHAS)
def test_smoothing_would_make_it_shimmer(show: Show, alpha: float) -> None:
    assert show.shimmer(alpha) > STEADY / 2


def test_at_a_cut_nothing_lags(show: Show) -> None:
    frames = [*pan()[:3], *dark()[:4]]
    assert max(show.worst_error(frames)) < 1e-6
    assert show.worst_error(frames, 0.3)[3] > 0.05


def test_the_first_frame_after_a_cut_has_its_own_numbers(show: Show) -> None:
    engine = ClipEngine(show.calibration, FrameSettings(), ".exr")
    for number, frame in enumerate([*pan()[:3], dark()[0]]):
        made = engine.make(ClipFrame(number, f"frame {number}", frame, "linear"))
    alone = ClipEngine(show.calibration, FrameSettings(), ".exr").make(
        ClipFrame(0, "alone", dark()[0], "linear")
    )
    for colour in "rgb":
        assert made.row[f"s_{colour}"] == pytest.approx(alone.row[f"s_{colour}"], rel=2e-6)
    np.testing.assert_allclose(made.rgb, alone.rgb, atol=2e-6)


def test_film_grain_does_not_flicker(show: Show) -> None:
    """Grain of 5 % of white, new in each frame: the mean of so many pixels hardly moves."""
    rng = np.random.default_rng(6)
    compensator, numbers = Compensator(show.calibration, SIZE), []
    for _ in range(8):
        noise = rng.normal(0, 0.05, (SIZE, SIZE, 3)).astype(np.float32)
        solved = compensator.solve(np.clip(half_sky(SIZE) + noise, 0, 1))
        numbers.append(solved.coefficients[:, 0])
    spread = np.std(numbers, axis=0) / np.mean(numbers, axis=0)
    of_a_mean = 0.05 / 0.3 / np.sqrt(np.pi * (SIZE / 2) ** 2)  # of a picture whose mean is 0.3
    assert spread.max() < 4 * of_a_mean
