"""Changes of the light during a capture, by cause."""

import cv2
import numpy as np
import pytest

from procam.errors import OutOfModelRange
from procam.estimate.light.stability import StabilityChecks

SIZE = 120


def pictures(rng: np.random.Generator, noise: float = 0.01):
    """White, and a stripe picture with its inverse; half of the screen sees scattered light alone."""
    y, x = np.mgrid[0:SIZE, 0:SIZE]
    direct = np.where(x < SIZE / 2, 0.8 + 0.2 * np.cos(y / 30), 0)
    stripe = (x // 7) % 2
    scattered = 0.1 + 0.02 * np.sin(y / 20)

    def seen(share: np.ndarray, part: float) -> np.ndarray:
        light = (direct * share + scattered * part)[..., None] * np.ones(3)
        return (light + noise * rng.normal(size=light.shape)).astype(np.float32)

    return seen(np.ones_like(direct), 1), seen(stripe, 0.5), seen(1 - stripe, 0.5)


def checks(room: float = 0.0, drift: float = 0.0, seed: int = 0) -> StabilityChecks:
    white, pattern, inverse = pictures(np.random.default_rng(seed))
    found = StabilityChecks(white, np.ones((SIZE, SIZE), bool))
    found.add("7 and 8", [pattern * (1 + drift) + room, inverse * (1 + drift)])
    return found


def test_steady_light_has_no_note() -> None:
    for seed in range(10):
        found = checks(seed=seed)
        assert found.notes("north") == []
        (total,) = found.sums
        assert abs(total.room) < 4 * total.sigma and abs(total.drift) < 4 * total.sigma


def test_what_is_rounded_is_steady() -> None:
    """Noiseless light of few counts: its rounding is neither drift nor a lamp."""
    noted = {True: 0, False: 0}
    for number in range(20):
        step = 1 / (8 + number)
        rounded = [
            np.float32(step) * np.rint(picture / step)
            for picture in pictures(np.random.default_rng(number), noise=0.0)
        ]
        for known in noted:
            found = StabilityChecks(rounded[0], np.ones((SIZE, SIZE), bool), step if known else 0.0)
            found.add("7 and 8", rounded[1:])
            (total,) = found.sums
            noted[known] += max(abs(total.room), abs(total.drift)) > 5 * total.sigma
    assert noted[True] == 0 and noted[False] > 0


def tilted_picture(rng: np.random.Generator, shares: tuple[float, float], right_px: float = 0.0):
    """Stripes of two shares of white on a tilted square, with errors that are alike in blocks of 8 pixels."""
    y, x = np.mgrid[0:240, 0:240]
    across, down = x - 119 - right_px, y - 121
    along, beside = (
        np.cos(0.4) * a + np.sin(0.4) * b for a, b in ((across, down), (down, -across))
    )
    stripes = np.where((along // 7) % 2 == 1, *shares) * (np.maximum(abs(along), abs(beside)) < 80)
    light = cv2.GaussianBlur(0.8 * stripes, (0, 0), 0.8) + 0.04 * np.mean(shares)
    error = rng.normal(0, 0.06, (30, 30)).repeat(8, axis=0).repeat(8, axis=1)
    return ((light + error)[..., None] * np.ones(3)).astype(np.float32)


@pytest.mark.parametrize("moved_px", [0.0, 0.6])
def test_errors_alike_within_blocks_are_no_movement(
    rng: np.random.Generator, moved_px: float
) -> None:
    """As those of JPEG are."""
    found = []
    for _ in range(20):
        checks = StabilityChecks(tilted_picture(rng, (1, 1)), np.ones((240, 240), bool))
        halves = [tilted_picture(rng, shares, moved_px) for shares in ((1, 0), (0, 1))]
        checks.add("7 and 8", halves)
        found.append(checks.shift_px)
    assert found == pytest.approx([moved_px] * 20, abs=0.2 if moved_px else 0)


def test_a_lamp_in_the_room() -> None:
    (note,) = checks(room=0.005).notes("north")
    assert str(note).startswith("projector north: light of the room changed")
    assert "7 and 8" in str(note) and "+0.4" in str(note)


def test_drift() -> None:
    (note,) = checks(drift=-0.01).notes("north")
    assert "drifted" in str(note) and "-1.0" in str(note)
    assert (note.code, note.subject) == ("drift", "projector north")
    assert note.amount == pytest.approx(-2.0, rel=0.05)  # of 0.5 %, which is just noted


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"room": 0.05}, r"light of the room changed .+; at most 1\.0% is usable, photograph"),
        ({"drift": 0.06}, r"drifted .+; at most 1\.5% is usable, photograph it again"),
    ],
)
def test_large_changes_are_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(OutOfModelRange, match=message):
        checks(**change).notes("north")


@pytest.mark.parametrize(("surplus", "notes"), [(0.012, 0), (0.02, 1)])
def test_scattered_light_of_shot_marks_is_no_change_of_the_room(surplus: float, notes: int) -> None:
    """At most 0.3 of the light of marks that fill 5 % of the panel scatters to any place."""
    white, pattern, inverse = pictures(np.random.default_rng(5))
    found = StabilityChecks(white, np.ones((SIZE, SIZE), bool))
    found.add("7 and 8", [pattern + surplus, inverse], mark_share=0.05)
    assert len(found.notes("north")) == notes


def test_someone_who_walks_through_is_an_outlier() -> None:
    white, pattern, inverse = pictures(np.random.default_rng(3))
    pattern[40:60, 20:50] = 0
    found = StabilityChecks(white, np.ones((SIZE, SIZE), bool))
    found.add("7 and 8", [pattern, inverse])
    (note,) = found.notes("north")
    assert "someone or something moved before the screen" in str(note) and "on 3." in str(note)
    (total,) = found.sums
    assert abs(total.drift) < 4 * total.sigma and found.shift_px == 0


def test_saturated_pixels_and_an_unseen_projector() -> None:
    white, pattern, inverse = pictures(np.random.default_rng(4))
    pattern[:10] = np.nan
    found = StabilityChecks(white, np.ones((SIZE, SIZE), bool))
    found.add("7 and 8", [pattern, inverse])
    assert found.notes("north") == []
    unseen = StabilityChecks(0 * white, np.zeros((SIZE, SIZE), bool))
    unseen.add("7 and 8", [pattern, inverse])
    assert unseen.notes("north") == []


class TestMovedCamera:
    """A bright picture with soft borders, shifted by part of a pixel."""

    def seen(self, rng: np.random.Generator, shift: float, part: np.ndarray) -> np.ndarray:
        y, x = np.mgrid[0:SIZE, 0:SIZE].astype(float)
        x = x - shift
        inside = 1 / (1 + np.exp(-(x - 30) * 1.5)) / (1 + np.exp((x - 90) * 1.5))
        inside = inside / (1 + np.exp(-(y - 20) * 1.5)) / (1 + np.exp((y - 95) * 1.5))
        light = (inside * part + 0.05)[..., None] * np.ones(3)
        return (light + 0.01 * rng.normal(size=light.shape)).astype(np.float32)

    def sums(self, shift: float, seed: int) -> StabilityChecks:
        rng, half = np.random.default_rng(seed), np.arange(SIZE)[:, None] % 20 < 10
        checks = StabilityChecks(self.seen(rng, 0, half | ~half), np.ones((SIZE, SIZE), bool))
        pair = [self.seen(rng, shift, part) - 0.025 for part in (half, ~half)]
        checks.add("7 and 8", pair)
        return checks

    @pytest.mark.parametrize("shift", [0.1, 0.3, 0.6])
    def test_the_shift_is_measured_and_named(self, shift: float) -> None:
        for seed in range(5):
            checks = self.sums(shift, seed)
            (total,) = checks.sums
            assert abs(total.shift_px - shift) < 4 * total.shift_sigma_px + 0.1 * shift
            assert total.shift_sigma_px < 0.01
            (note,) = checks.notes("north")
            assert "the camera or the projector moved: the pictures 7 and 8" in str(note)
            assert checks.shift_px == total.shift_px

    @pytest.mark.parametrize(
        ("turn", "scale"), [(0.005, 0.0), (0.0, 0.005)], ids=["turned", "refocused"]
    )
    def test_a_picture_that_turned_or_changed_its_scale(self, turn: float, scale: float) -> None:
        """By 0.2 to 0.25 px at the borders, where its mean shift is none."""
        rng = np.random.default_rng(1)
        full = np.ones((SIZE, SIZE))
        white, after = (self.seen(rng, 0, full), self.seen(rng, 0, full))
        middle = np.array([60.0, 57.5])
        matrix = np.array([[1 + scale, -turn], [turn, 1 + scale]])
        move = np.c_[matrix, middle - matrix @ middle].astype(np.float32)
        moved = cv2.warpAffine(after, move, (SIZE, SIZE), flags=cv2.INTER_CUBIC)
        checks = StabilityChecks(white, np.ones((SIZE, SIZE), bool))
        checks.add("7 and 8", [moved])
        (total,) = checks.sums
        assert total.shift_px == pytest.approx(0.2, abs=0.06)
        assert "the camera or the projector moved" in str(checks.notes("north")[-1])

    def test_a_camera_that_stands_still(self) -> None:
        for seed in range(20):
            checks = self.sums(0.0, seed)
            assert checks.notes("north") == [] and checks.shift_px == 0

    def test_borders_in_few_parts_of_the_picture_are_no_movement(self) -> None:
        """As of a picture that a small camera sees: errors of so few are not known."""
        noted = 0
        for seed in range(40):
            rng, full = np.random.default_rng(seed), np.ones((SIZE, SIZE))
            part = np.zeros((SIZE, SIZE), bool)
            part[32:48, 16:48] = True  # two tiles with one border
            checks = StabilityChecks(self.seen(rng, 0, full), part)
            checks.add("7 and 8", [self.seen(rng, 0, full)])
            noted += bool(checks.notes("north"))
        assert noted == 0

    @pytest.mark.parametrize("dimming", [0.01, 1.0])
    def test_a_dimmed_white_shows_movement_alone(self, dimming: float) -> None:
        rng, full = np.random.default_rng(3), np.ones((SIZE, SIZE))
        for shift in (0.0, 0.3):
            checks = StabilityChecks(self.seen(rng, 0, full), np.ones((SIZE, SIZE), bool))
            checks.add_dimmed("at the end", dimming * self.seen(rng, shift, full))
            assert checks.shift_px == pytest.approx(shift, abs=0.03)
            assert len(checks.notes("north")) == bool(shift)
        checks.add_dimmed("nothing", 0 * self.seen(rng, shift, full))
        assert len(checks.sums) == 1
