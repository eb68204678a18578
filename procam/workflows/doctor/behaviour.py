"""Shows a projector test pictures and photographs them, to find settings that break calibration.

24 photographs and about a minute and a half of waiting for each projector. Pictures that are compared
carry the same flux, so that an effect of the picture is separated from a fault of
colours, levels and fine detail.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, Image
from procam.estimate import projector_tests as estimate
from procam.estimate.camera.checks import response_exponent
from procam.estimate.camera.exposure import green, meter
from procam.estimate.camera.noise import NoiseLaw, noise_from_repeat
from procam.estimate.projector_tests import Effect, Patches, PatchLight
from procam.estimate.projector_tests.patterns import (
    BRIGHT_LEVELS,
    DARK_LEVELS,
    GREYS,
    HALF_LIGHT,
    PatchLayout,
)
from procam.files.venue.load import CaptureTable
from procam.model.frame import Frame
from procam.workflows.doctor.examined_camera import DIM, METERINGS, NO_LIGHT, ExaminedCamera
from procam.workflows.doctor.findings import EXPONENT_OFF, Behaviour

Pair = tuple[PatchLight, PatchLight]
SETTLED_S = 1.0  # after a picture has changed
REST_S, BLACK_S = 10.0, 30.0
CHANGE_S = (0.0, 0.2, 0.5)  # after a change, before the picture has settled
LONGER = 60.0  # than white, at most, for steps near black: they give a hundredth of its light
HALF = 0.5  # of the exposure, to see that the camera follows it
LEAST_CAMERA_PX = 2.0  # per projector pixel, for the shape of the camera's blur not to matter
LOAD_LIMIT, AFTER_BLACK_LIMIT, COLOUR_LIMIT, REMNANT_LIMIT = 0.005, 0.01, 0.01, 0.02
STEP_LIMIT, SLANT_LIMIT, SHARPNESS_LIMIT = 0.5, 0.05, 0.03
MOVED = "all else is judged {:.1%} less strictly, as the light moves; see to that, then test again"
COARSE = "pixel shift: a projector pixel is {:.1f} camera pixels wide, 2 or more are needed"


@dataclass(frozen=True)
class _Whites:
    """Photographs of black, of white after ten seconds of white and after half a minute of black."""

    black: Frame
    white: Frame
    after_black: Frame
    noise: NoiseLaw


class BehaviourTest:
    """The tests of one projector before one camera that has looked at the dark."""

    def __init__(self, examined: ExaminedCamera, projector: str) -> None:
        self._examined, self._projector = examined, projector
        self._layout = PatchLayout(examined.rig.projectors[projector].size)
        self._black = np.zeros((*self._layout.size[::-1], 3), np.float32)
        self._exposure_s = 0.0

    def run(self, capture: CaptureTable) -> Behaviour:
        """Photograph and judge; raises `NotEnoughData` if this camera does not see enough."""
        camera = self._examined.camera.name
        whites = self._whites(capture)
        if isinstance(whites, str):
            return Behaviour(camera, (), (whites,))
        patches, pairs = self._pairs(whites)
        effects = [*self._unsteady(patches, pairs, whites)]
        moved = max((abs(e.value) for e in effects if e.found), default=0.0)
        untested = [MOVED.format(moved)] if moved else []
        effects += self._changing(patches, pairs[0], whites.noise, moved)
        effects += self._coloured(patches, pairs[0], whites.noise, moved)
        bright, dark = self._steps(patches, pairs[0], whites)
        effects += [
            estimate.clipped_white(bright, STEP_LIMIT),
            estimate.clipped_black(dark, STEP_LIMIT),
        ]
        if patches.scale < LEAST_CAMERA_PX:
            untested.append(COARSE.format(patches.scale))
        effects += self._fine(patches, whites, bright, moved)
        untested += [f"{e.name}: too little of it is seen" for e in effects if not e.known]
        return Behaviour(camera, tuple(e for e in effects if e.known), tuple(untested))

    def _whites(self, capture: CaptureTable) -> _Whites | str:
        """The whites, or why there is nothing to learn from this camera."""
        black, metered = self._examined.metered(self._projector, capture, SETTLED_S)
        self._exposure_s = metered.settings.exposure_s
        self._examined.rig.clock.sleep(REST_S)
        white, half = self._metered_white(), self._take(HALF)
        ratio = white.settings.exposure_s / half.settings.exposure_s
        bright, dim = self._green(white), self._green(half)
        full = self._examined.measured.full_scale
        lit = bright > 0.5 * np.quantile(bright, 0.99)
        if np.quantile(bright, 0.999) < NO_LIGHT * full:
            return "no light of it is seen"
        if np.quantile(bright, 0.999) >= full:
            return "white saturates the camera"
        if ratio < 1.2 or abs(response_exponent(bright, dim, ratio, lit) - 1) > EXPONENT_OFF:
            return "the camera does not follow its exposure; see to it first"
        self._show(self._black, BLACK_S)
        after_black = self._photograph(np.ones_like(self._black))
        both = green(white.counts), green(after_black.counts)
        noise = noise_from_repeat(*both, self._examined.measured)
        return _Whites(black, white, after_black, noise)

    def _metered_white(self) -> Frame:
        """White that has been up for long: an iris that was closed at first is open now."""
        for _ in range(METERINGS):
            white = self._take()
            better_s = meter(white.counts, self._exposure_s, self._examined.measured)
            if self._exposure_s <= better_s <= self._exposure_s / DIM:
                break
            self._exposure_s = better_s
        self._exposure_s = white.settings.exposure_s
        return white

    def _pairs(self, whites: _Whites) -> tuple[Patches, list[Pair]]:
        """Patches, and their light in complementary pictures with ever more light elsewhere."""
        self._show(self._black, REST_S)
        first, second = (self._photograph(picture) for picture in self._layout.pair())
        bits = [self._green(self._photograph(self._layout.bit(bit))) for bit in (1, 2)]
        pair = self._green(first), self._green(second)
        span = self._green(whites.white) - self._dark(whites)
        patches = estimate.find_patches(pair, bits, span, whites.noise, self._layout)
        alone = tuple(self._light(patches, frame, whites.noise) for frame in (first, second))
        loaded = [
            tuple(
                self._light(patches, self._photograph(picture), whites.noise)
                for picture in self._layout.pair(elsewhere)
            )
            for elsewhere in (HALF_LIGHT, 1.0)
        ]
        return patches, [(a, b) for a, b in (alone, *loaded)]

    def _unsteady(self, patches: Patches, pairs: list[Pair], whites: _Whites) -> Iterator[Effect]:
        """Light that changes with the picture, or with the one before it."""
        alone, half, full = (estimate.direct_light(pair) for pair in pairs)
        yield estimate.load_effect("load-half", half, alone, LOAD_LIMIT)
        yield estimate.load_effect("load-full", full, alone, LOAD_LIMIT)
        before, after = (
            self._light(patches, frame, whites.noise)
            for frame in (whites.white, whites.after_black)
        )
        yield estimate.load_effect("white-after-black", before, after, AFTER_BLACK_LIMIT)

    def _changing(
        self, patches: Patches, pair: Pair, noise: NoiseLaw, moved: float
    ) -> Iterator[Effect]:
        """What is left of the first picture of the pair in the second, as it comes up."""
        first, second = self._layout.pair()
        direct = estimate.direct_light(pair)
        self._show(first, REST_S)
        shown_s = self._show(second)
        for after_s in CHANGE_S:
            self._examined.rig.clock.sleep(shown_s + after_s - self._examined.rig.clock.now_s())
            early = self._light(patches, self._take(), noise)
            name = f"after-{after_s:g}-s"
            yield estimate.persistence_effect(early, pair[1], direct, REMNANT_LIMIT + moved, name)

    def _coloured(
        self, patches: Patches, pair: Pair, noise: NoiseLaw, moved: float
    ) -> tuple[Effect, Effect]:
        """Whether primaries and secondaries add up to white."""
        colours = [
            self._light(patches, self._photograph(picture), noise)
            for picture in self._layout.colours()
        ]
        return estimate.colour_effects(colours, pair, COLOUR_LIMIT + moved)

    def _steps(
        self, patches: Patches, pair: Pair, whites: _Whites
    ) -> tuple[estimate.Steps, estimate.Steps]:
        """Light of steps near white, and of steps near black, which are photographed longer."""
        longer = min(max(whites.black.settings.exposure_s / self._exposure_s, 1.0), LONGER)
        frames = (
            self._photograph(self._layout.steps(BRIGHT_LEVELS)),
            self._photograph(self._layout.steps(DARK_LEVELS), longer),
        )
        black, bright, dark = (
            self._light(patches, frame, whites.noise).scaled(
                self._exposure_s / frame.settings.exposure_s
            )
            for frame in (whites.black, *frames)
        )
        return (
            estimate.step_light(BRIGHT_LEVELS, bright, pair, black),
            estimate.step_light(DARK_LEVELS, dark, pair, black),
        )

    def _fine(
        self, patches: Patches, whites: _Whites, bright: estimate.Steps, moved: float
    ) -> Iterator[Effect]:
        """Fine stripes."""
        view = estimate.StripedView(
            self._green(whites.white), self._dark(whites), whites.noise, patches.largest_px
        )
        low, high = (grey / 255 for grey in GREYS)
        full, grey = (self._power(view, 1, *levels) for levels in ((0, 1), (low, high)))
        yield estimate.sharpness_effect(grey, full, bright, SHARPNESS_LIMIT + moved)
        if patches.scale >= LEAST_CAMERA_PX:
            rising = self._power(view, -1, 0, 1)
            yield estimate.slant_effect(full, rising, SLANT_LIMIT + moved)

    def _power(self, view: estimate.StripedView, slant: int, low: float, high: float) -> Array:
        """Strength of stripes by tile."""
        frame = self._photograph(self._layout.stripes(slant, low, high))
        return view.power(self._green(frame))

    def _show(self, picture: Image, wait_s: float = 0.0) -> float:
        """Show a picture for so long; when it was up [s]."""
        shown = self._examined.rig.projectors[self._projector].show(picture)
        self._examined.rig.clock.sleep(wait_s)
        return shown.at_s

    def _take(self, longer: float = 1.0) -> Frame:
        """A photograph of what is up."""
        return self._examined.take(longer * self._exposure_s)

    def _photograph(self, picture: Image, longer: float = 1.0) -> Frame:
        """A photograph of a picture that has settled."""
        exposure_s = longer * self._exposure_s
        return self._examined.photograph(
            self._projector, picture, exposure_s, wait_s=SETTLED_S, title="a test picture"
        )

    def _signal(self, frame: Frame) -> Array:
        """Signals (H, W, C) above black [DN]."""
        counts = frame.counts if frame.counts.ndim == 3 else frame.counts[..., None]
        return np.asarray(counts - self._examined.measured.black_level, float)

    def _green(self, frame: Frame) -> Array:
        """Signals (H, W) of the green channel above black [DN]."""
        return np.asarray(green(frame.counts) - self._examined.measured.black_level, float)

    def _dark(self, whites: _Whites) -> Array:
        """Signals (H, W) of black at the exposure of white [DN]."""
        share = self._exposure_s / whites.black.settings.exposure_s
        return np.asarray(share * self._green(whites.black), float)

    def _light(self, patches: Patches, frame: Frame, noise: NoiseLaw) -> PatchLight:
        """Light of the patches."""
        return patches.read(self._signal(frame), noise)
