"""Faults in a set of photographs: each is reported, and the rest is put in order."""

import re
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest

from procam.errors import InputError
from procam.estimate.structured_light.codes import AxisCode, Code, generate, make_code
from procam.estimate.structured_light.consistency import probe_places
from procam.estimate.structured_light.decode import Decoder
from procam.estimate.structured_light.set_checks import SetReport, examine
from simulators.photograph_bench import PhotographBench
from simulators.presets import STANDARD
from simulators.scene import DomeScene, SceneSize
from studies.one_fringe import wave_code

SIZE = (320, 200)
CODES = ("micro-phase", "gray", "phase-heterodyne")
# one of each axis; the first and the last of equal steps are another case
PLANES = {
    "micro-phase": ("column wave 16.44 px at 200 deg", "row wave 18.28 px at 120 deg"),
    "gray": ("column bit 6 inverse", "row bit 0"),
    "phase-heterodyne": ("column wave 19.35 px at 90 deg", "row wave 16.88 px at 180 deg"),
}
CROP = np.s_[160:320, 180:340]


@dataclass(frozen=True)
class Shots:
    """Photographs in the order of a folder: `sequence` are their planes, `names` what they are called."""

    code: Code
    sequence: list[int]
    photographs: list[np.ndarray]
    names: list[str]

    def examine(self) -> SetReport:
        places = probe_places(self.photographs[0].shape)
        probes = [p[places] for p in self.photographs]
        return examine(self.code, self.sequence, probes, self.names)

    def place(self, words: str) -> int:
        """Where the photograph of the plane of this name is."""
        names = [str(p) for p in self.code.planes]
        return self.sequence.index(names.index(words))

    @property
    def order(self) -> list[int | None]:
        """The photograph of each plane."""
        return [self.sequence.index(i) for i in range(len(self.sequence))]

    def shown(self, photographs: list[np.ndarray]) -> "Shots":
        """Other photographs, numbered anew."""
        return replace(self, photographs=photographs, names=_names(len(photographs)))

    def exchanged(self, first: int, second: int) -> "Shots":
        shown = list(self.photographs)
        shown[first], shown[second] = shown[second], shown[first]
        return self.shown(shown)

    def replaced(self, place: int, photograph: np.ndarray) -> "Shots":
        shown = list(self.photographs)
        shown[place] = photograph
        return self.shown(shown)

    def without(self, place: int, numbered: bool) -> "Shots":
        shown = [p for i, p in enumerate(self.photographs) if i != place]
        if not numbered:
            return self.shown(shown)
        return replace(
            self, photographs=shown, names=[n for i, n in enumerate(self.names) if i != place]
        )

    def coverage(self, order: list[int | None]) -> float:
        """Share of a part of the picture that is decoded, and decoded right."""
        decoder = Decoder(self.code)
        for plane, photograph in enumerate(order):
            if photograph is not None:
                decoder.add(plane, self.photographs[photograph][CROP])
        found = decoder.result().map
        truth = bench().projector_pixels()[CROP]
        with np.errstate(invalid="ignore"):
            right = np.abs(found.projector_xy - truth).max(axis=-1) < 2.5
        assert np.mean(right[found.valid]) > 0.998
        return float(found.valid.mean())


def _names(count: int) -> list[str]:
    return [f"img_{i + 1:03d}.png" for i in range(count)]


_KEPT: list[PhotographBench] = []


def bench() -> PhotographBench:
    if not _KEPT:
        preset = STANDARD.altered(snr=50, defocus_px=0.7)
        size = SceneSize(projectors=1, projector_size=SIZE, camera_size=(500, 500), rays=64)
        scene = DomeScene(preset, size, 1)
        _KEPT.append(PhotographBench(scene, next(iter(scene.lights))))
    return _KEPT[0]


@pytest.fixture(scope="module")
def every() -> dict[str, Shots]:
    rng = np.random.default_rng(1)
    shots = {}
    for name in CODES:
        code = make_code(name, SIZE)
        signals = bench().photograph(generate(code))
        taken = [bench().digitise(signal, rng) for signal in signals]
        every = list(range(len(taken)))
        # stripes end with white and black, as OpenCV's do
        sequence = every if code.has_waves else [*every[2:], 0, 1]
        shots[name] = Shots(code, sequence, [taken[i] for i in sequence], _names(len(taken)))
    return shots


@pytest.fixture(params=CODES)
def sound(request: pytest.FixtureRequest, every: dict[str, Shots]) -> Shots:
    return every[request.param]


def test_a_sound_set_has_no_notes(sound: Shots) -> None:
    verdict = sound.examine()
    assert (verdict.order, verdict.notes) == (sound.order, [])


class TestOrder:
    @pytest.mark.parametrize("seed", range(2))
    def test_two_exchanged_along_an_axis(self, sound: Shots, seed: int) -> None:
        rng = np.random.default_rng(seed)
        axis = "xy"[seed % 2]
        planes = [i for i, p in enumerate(sound.code.planes) if p.axis == axis]
        places = [sound.sequence.index(i) for i in rng.choice(planes, 2, replace=False)]
        self._check(sound, *sorted(places))

    @pytest.mark.parametrize(
        ("axis", "bit"), [("column", 0), ("column", 8), ("row", 0), ("row", 6)]
    )
    def test_a_pattern_exchanged_with_its_inverse(
        self, every: dict[str, Shots], axis: str, bit: int
    ) -> None:
        """The likeliest exchange, and the hardest to detect: coarse planes only mirror parts of the map.

        Row bit 7 is not here: on this panel its two orders cannot be distinguished.
        """
        gray = every["gray"]
        first, second = gray.place(f"{axis} bit {bit}"), gray.place(f"{axis} bit {bit} inverse")
        self._check(gray, first, second)

    def test_the_last_column_and_the_first_row(self, sound: Shots) -> None:
        planes = sound.code.planes
        first = next(
            i for i, (p, q) in enumerate(pairwise(planes)) if (p.axis, q.axis) == ("x", "y")
        )
        self._check(sound, sound.sequence.index(first), sound.sequence.index(first + 1))

    def _check(self, sound: Shots, first: int, second: int) -> None:
        verdict = sound.exchanged(first, second).examine()
        expected = sound.order
        i, j = expected.index(first), expected.index(second)
        expected[i], expected[j] = second, first
        assert verdict.order == expected
        names = f"{sound.names[first]} and {sound.names[second]}"
        assert verdict.notes == [f"{names}: in each other's place (wrong order); exchanged"]


class TestNumber:
    @pytest.mark.parametrize("numbered", [True, False])
    @pytest.mark.parametrize("which", [0, 1])
    @pytest.mark.parametrize("name", CODES)
    def test_one_missing(
        self, every: dict[str, Shots], name: str, which: int, numbered: bool
    ) -> None:
        sound, words = every[name], PLANES[name][which]
        gap = sound.place(words)
        shots = sound.without(gap, numbered)
        verdict = shots.examine()
        expected = [None if p == gap else p - (p > gap) for p in sound.order if p is not None]
        assert verdict.order == expected
        before = shots.names[gap - 1]
        assert verdict.notes == [f"missing: {words}, after {before}; done without"]

    @pytest.mark.parametrize("words", ["column bit 8", "row bit 0 inverse"])
    def test_the_first_or_the_last_missing(self, every: dict[str, Shots], words: str) -> None:
        sound = every["gray"]
        gap = sound.place(words)
        shots = sound.without(gap, numbered=True)
        verdict = shots.examine()
        assert verdict.order.index(None) == sound.sequence[gap]
        where = f"after {shots.names[gap - 1]}" if gap else "before img_002.png"
        assert verdict.notes == [f"missing: {words}, {where}; done without"]

    def test_the_ends_of_one_set_of_equal_steps(self, every: dict[str, Shots]) -> None:
        """Without the first of them the rest is a set whose columns are shifted, so numbers decide."""
        code = wave_code(SIZE, (64.0, 64.0))
        rng = np.random.default_rng(2)
        taken = [bench().digitise(s, rng) for s in bench().photograph(generate(code))]
        sound = Shots(code, list(range(len(taken))), taken, _names(len(taken)))
        first = sound.place("row wave 64 px at 0 deg")
        with pytest.raises(
            InputError, match=r"one is missing, .*the others fit either way; number"
        ):
            sound.without(first, numbered=False).examine()
        verdict = sound.without(first, numbered=True).examine()
        assert verdict.order.index(None) == sound.sequence[first]

    @pytest.mark.parametrize("words", ["white", "black"])
    def test_without_white_or_black_nothing_is_decoded(self, sound: Shots, words: str) -> None:
        for numbered in (True, False):
            with pytest.raises(InputError, match=r"^pictures: "):
                sound.without(sound.place(words), numbered).examine()

    @pytest.mark.parametrize("name", CODES)
    def test_one_doubled(self, every: dict[str, Shots], name: str) -> None:
        sound = every[name]
        rng = np.random.default_rng(3)
        for words in ("white", *PLANES[name]):
            at = sound.place(words)
            again = sound.photographs[at] + rng.integers(0, 3, (500, 500)).astype(np.uint16)
            shown = [*sound.photographs[: at + 1], again, *sound.photographs[at + 1 :]]
            shots = sound.shown(shown)
            verdict = shots.examine()
            kept = [at if p == at else p + (p > at) for p in sound.order if p is not None]
            either = [at + 1 if p == at else p for p in kept]
            assert verdict.order in (kept, either)
            (note,) = verdict.notes
            assert re.match(rf"({shots.names[at]}|{shots.names[at + 1]}): doubled, it shows", note)

    def test_one_too_many_that_doubles_none(self, every: dict[str, Shots]) -> None:
        gray = every["gray"]
        with pytest.raises(
            InputError, match="there are 37, one more than the code has, and none repeats"
        ):
            gray.shown([*gray.photographs, gray.photographs[3]]).examine()

    @pytest.mark.parametrize("count", [2, 40])
    def test_far_too_few_or_many(self, sound: Shots, count: int) -> None:
        shots = sound.shown((3 * sound.photographs)[:count])
        expected = (
            f"{sound.code.name} on 320x200 px has {len(sound.sequence)}, and {count} were given"
        )
        with pytest.raises(InputError, match=expected):
            shots.examine()


class TestContent:
    @pytest.mark.parametrize("name", CODES)
    def test_a_black_picture(self, every: dict[str, Shots], name: str) -> None:
        sound = every[name]
        for words in PLANES[name]:
            at = sound.place(words)
            verdict = sound.replaced(at, sound.photographs[sound.place("black")]).examine()
            assert verdict.order == [None if p == at else p for p in sound.order]
            assert verdict.notes == [f"{sound.names[at]}: black, expected {words}; left out"]

    def test_a_stale_picture(self, sound: Shots) -> None:
        planes = sound.code.planes
        for at in range(1, len(sound.sequence), 3):
            plane = planes[sound.sequence[at]]
            if plane.axis == "" or planes[sound.sequence[at - 1]].kind == "black":
                continue
            verdict = sound.replaced(at, sound.photographs[at - 1]).examine()
            assert verdict.order == [None if p == at else p for p in sound.order]
            before = sound.names[at - 1]
            note = f"{sound.names[at]}: stale, it shows what {before} shows; left out"
            assert verdict.notes == [note]

    @pytest.mark.parametrize("name", CODES)
    def test_the_rest_is_decoded_as_well(self, every: dict[str, Shots], name: str) -> None:
        sound = every[name]
        whole = sound.coverage(sound.order)
        assert whole > 0.9
        for words in PLANES[name]:
            gap = sound.place(words)
            left = [None if p == gap else p for p in sound.order]
            assert sound.coverage(left) > 0.97 * whole

    def test_photographs_of_another_code(self, every: dict[str, Shots]) -> None:
        gray = every["gray"]
        words = np.random.default_rng(5).permutation(SIZE[0])
        other = Code("shuffled", SIZE, AxisCode(SIZE[0], codewords=words), gray.code.y)
        verdict = replace(gray, code=other).examine()
        assert "agree with the code shuffled of a 320x200 projector" in verdict.notes[-1]

    def test_waves_of_another_shift(self, every: dict[str, Shots]) -> None:
        """They decode, to wrong places, so that fewer agreeing pixels are enough for a refusal."""
        shots = every["phase-heterodyne"]
        waves = shots.code.x.waves
        assert waves is not None
        wrong = replace(waves, shifts=waves.shifts * np.resize([1.0, 0.5, 1.3], len(waves.shifts)))
        code = replace(shots.code, x=replace(shots.code.x, waves=wrong))
        with pytest.raises(InputError, match="agree with the code phase-heterodyne"):
            replace(shots, code=code).examine()

    def test_half_a_panel_is_no_fault(self, every: dict[str, Shots]) -> None:
        """Planes that are all bright or dark where the camera looks are not black or stale."""
        gray = every["gray"]
        verdict = gray.shown([p[170:330, 190:270] for p in gray.photographs]).examine()
        assert (verdict.order, verdict.notes) == (gray.order, [])
