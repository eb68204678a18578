"""Whether a projector shows every pixel it is sent, judged from a decoded map."""

import numpy as np
import pytest

from procam.estimate.structured_light.codes import AxisCode, Code, make_code
from procam.estimate.structured_light.panel_checks import (
    UNSEEN_SHARE,
    orientation,
    panel_notes,
    unseen_share,
)
from procam.maths.codes.phase import Waves, equal_steps
from procam.model.correspondence import CorrespondenceMap

SIZE = (160, 100)
GRAY = make_code("gray", SIZE)


def seen(shown: np.ndarray, per_line: float = 1.0) -> CorrespondenceMap:
    """A camera of `per_line` pixels to a screen pixel, which shows panel pixel `shown` (H, W, 2)."""
    rows, columns = (
        np.minimum(np.arange(int(n * per_line)) / per_line, n - 1).astype(int)
        for n in shown.shape[:2]
    )
    xy = shown[rows[:, None], columns].astype(np.float32)
    valid = np.ones(xy.shape[:2], bool)
    valid[:3], valid[:, -2:] = False, False
    xy[~valid] = np.nan
    return CorrespondenceMap(xy, np.where(valid[..., None], 0.3, np.nan) * np.ones(2), valid)


def panel() -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1)


def scaled(across: float, down: float) -> np.ndarray:
    """The picture of a projector that scales its input to a part of its panel, by nearest neighbours."""
    height, width = int(SIZE[1] * down), int(SIZE[0] * across)
    rows, columns = (np.arange(height) / down).astype(int), (np.arange(width) / across).astype(int)
    return panel()[rows[:, None], columns]


class TestOrientation:
    @pytest.mark.parametrize("turns", range(4))
    def test_a_turned_picture_needs_no_note(self, turns: int) -> None:
        assert orientation(GRAY, seen(np.rot90(panel(), turns))) == ([], [])

    def test_a_mirrored_picture_is_noted(self) -> None:
        (note,), refused = orientation(GRAY, seen(panel()[:, ::-1]))
        assert note.startswith("the camera sees the picture mirrored: right with rear projection")
        assert not refused

    def test_a_picture_mirrored_in_parts_is_refused(self) -> None:
        shown = panel()
        shown[:, 80:] = shown[:, :79:-1]
        notes, (refused,) = orientation(GRAY, seen(shown))
        assert not notes
        assert "% of the map is mirrored and the rest is not, as no surface makes it" in refused

    def test_a_position_within_a_period_is_not_judged(self) -> None:
        waves = Waves(np.full(4, 16.0), equal_steps(4), 4)
        code = Code("fringes", SIZE, *(AxisCode(length, waves) for length in SIZE))
        assert orientation(code, seen(panel()[:, ::-1] % 16)) == ([], [])

    def test_few_pixels_are_not_judged(self) -> None:
        assert orientation(GRAY, seen(panel()[:24, 23::-1])) == ([], [])


class TestNotes:
    @pytest.mark.parametrize("per_line", [1.0, 3.0])
    def test_a_sound_map_needs_no_note(self, per_line: float) -> None:
        assert panel_notes(GRAY, seen(panel(), per_line)) == []

    @pytest.mark.parametrize(
        ("across", "down", "words"),
        [
            (0.9, 1.0, "10% of the columns are never"),
            (1.0, 0.9, "10% of the rows are never"),
            (0.8, 0.75, "20% of the columns and 25% of the rows are never"),
        ],
    )
    def test_dropped_lines_are_reported(self, across: float, down: float, words: str) -> None:
        (note,) = panel_notes(GRAY, seen(scaled(across, down), 2.0))
        share = [int(w[:-1]) for w in note.split() if w.endswith("%")]
        expected = [int(w[:-1]) for w in words.split() if w.endswith("%")]
        np.testing.assert_allclose(share, expected, atol=1)
        assert ("columns" in note, "rows" in note) == ("columns" in words, "rows" in words)
        assert "switch off its keystone correction" in note

    def test_sinusoids_give_no_note(self) -> None:
        for name in ("micro-phase", "phase-heterodyne"):
            assert panel_notes(make_code(name, SIZE), seen(scaled(0.8, 1.0))) == []

    def test_nothing_decoded_gives_no_note(self) -> None:
        found = seen(scaled(0.8, 1.0))
        nothing = CorrespondenceMap(
            np.full_like(found.projector_xy, np.nan), found.sigma_px, np.zeros_like(found.valid)
        )
        assert panel_notes(GRAY, nothing) == []

    def test_noise_between_neighbours_hides_nothing(self, rng: np.random.Generator) -> None:
        """A pixel that now and then reads its neighbour's bit does not fill in dropped lines."""
        found = seen(panel(), 2.0)
        swap = rng.random(found.valid.shape) < 0.02
        xy = np.where(swap[..., None], found.projector_xy + 1, found.projector_xy)
        assert panel_notes(GRAY, CorrespondenceMap(xy, found.sigma_px, found.valid)) == []


class TestShare:
    def test_few_pixels_to_a_line_mean_nothing(self) -> None:
        lines = np.setdiff1d(np.arange(100), np.arange(5, 100, 10))
        assert unseen_share(np.repeat(lines, 20)) == 0
        assert unseen_share(np.zeros(0)) == 0

    def test_a_thin_end_is_not_judged(self) -> None:
        """A corner that the camera hardly sees lacks columns, which is no fault."""
        body = np.repeat(np.arange(100), 60)
        corner = np.arange(102, 140, 3)
        assert unseen_share(np.concatenate([body, corner])) <= UNSEEN_SHARE
