"""Finds settings of a projector that break calibration, in photographs of its test pictures.

Pictures that are compared carry the same flux, so that an effect of the picture is separated from a fault
of colours, levels and fine detail. `behaviour_driven` takes the photographs with devices, `behaviour_by_hand`
has people take them; what needs timing, people cannot do, and it stays untested.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, Image
from procam.errors import NotEnoughData
from procam.estimate.camera.checks import response_exponent
from procam.estimate.camera.exposure import green
from procam.estimate.camera.noise import NoiseLaw, noise_from_repeat
from procam.estimate.projector_tests import analysis
from procam.estimate.projector_tests.analysis import Effect
from procam.estimate.projector_tests.patches import (
    Patches,
    PatchLight,
    direct_light,
    find_patches,
)
from procam.estimate.projector_tests.patterns import (
    BRIGHT_LEVELS,
    DARK_LEVELS,
    GREYS,
    HALF_LIGHT,
    PatchLayout,
)
from procam.model.frame import Frame
from procam.model.optics import Sensor
from procam.workflows.doctor.findings import EXPONENT_OFF, NO_LIGHT, Behaviour

Pair = tuple[PatchLight, PatchLight]
Frames = Mapping[str, Frame]
HALF = 0.5  # of the exposure, to see that the camera follows it
LONGER = 60.0  # than white, at most, for steps near black: they give a hundredth of its light
CHANGE_S = (0.0, 0.2, 0.5)  # after a change, before the picture has settled
LEAST_CAMERA_PX = 2.0  # per projector pixel, for the shape of the camera's blur not to matter
LOAD_LIMIT, AFTER_BLACK_LIMIT, COLOUR_LIMIT, REMNANT_LIMIT = 0.005, 0.01, 0.01, 0.02
STEP_LIMIT, SLANT_LIMIT, SHARPNESS_LIMIT = 0.5, 0.05, 0.03
MOVED = "all else is judged {:.1%} less strictly, as the light moves; see to that, then test again"
COARSE = "pixel shift: a projector pixel is {:.1f} camera pixels wide, 2 or more are needed"
UNSURE = "{0.name}: known to {0.sigma:.1%} only, and {0.limit:.1%} is looked for"
BY_HAND = (
    "white after black, and what is left of the picture before: photographs by hand come too late"
)


def after_change(seconds: float) -> str:
    """Name of the photograph so long after a change."""
    return f"after-{seconds:g}-s"


def longer_for_dark(black_s: float, white_s: float) -> float:
    """Factor on white's exposure for steps near black, by the exposures of black and white."""
    return min(max(black_s / white_s, 1.0), LONGER)


def pictures_to_show(layout: PatchLayout) -> dict[str, Image]:
    """Pictures (H, W, 3) of a panel whose photographs are compared, by name, in the order of showing."""
    first, second = layout.pair()
    half, full = layout.pair(HALF_LIGHT), layout.pair(1.0)
    low, high = (grey / 255 for grey in GREYS)
    return {
        "first": first,
        "second": second,
        "bit-1": layout.bit(1),
        "bit-2": layout.bit(2),
        "half-first": half[0],
        "half-second": half[1],
        "full-first": full[0],
        "full-second": full[1],
        **{f"colour-{i}": picture for i, picture in enumerate(layout.colours())},
        "bright-steps": layout.steps(BRIGHT_LEVELS),
        "dark-steps": layout.steps(DARK_LEVELS),
        "stripes": layout.stripes(1, 0, 1),
        "grey-stripes": layout.stripes(1, low, high),
        "rising-stripes": layout.stripes(-1, 0, 1),
    }


def white_problem(white: Frame, half: Frame, sensor: Sensor) -> str:
    """Why nothing can be learnt from photographs of white, the second at half the exposure; or empty."""
    ratio = white.settings.exposure_s / half.settings.exposure_s
    bright, dim = (green(frame.counts) - sensor.black_level for frame in (white, half))
    lit = bright > 0.5 * np.quantile(bright, 0.99)
    if np.quantile(bright, 0.999) < NO_LIGHT * sensor.full_scale:
        return "no light of it is seen"
    if np.quantile(bright, 0.999) >= sensor.full_scale:
        return "white saturates the camera"
    if ratio < 1.2 or abs(response_exponent(bright, dim, ratio, lit) - 1) > EXPONENT_OFF:
        return "the camera does not follow its exposure; see to it first"
    return ""


@dataclass(frozen=True)
class BehaviourTest:
    """The tests of one projector in photographs by one camera.

    Attributes
    ----------
    camera : its name. sensor : with the black level as measured. layout : of the panel's patches.
    frames : "black", "white", "half" (white at half the exposure), "again" (white, once more), and those
        of `pictures_to_show`; with devices also "after-black", and those of `after_change`.
    """

    camera: str
    sensor: Sensor
    layout: PatchLayout
    frames: Frames

    def run(self) -> Behaviour:
        """Judge."""
        white, again = self.frames["white"], self.frames["again"]
        if problem := white_problem(white, self.frames["half"], self.sensor):
            return Behaviour(self.camera, (), (problem,))
        noise = noise_from_repeat(green(white.counts), green(again.counts), self.sensor)
        try:
            patches = self._patches(noise)
        except NotEnoughData as error:
            return Behaviour(self.camera, (), (str(error),))
        return self._judged(patches, noise)

    def _scale(self, name: str) -> float:
        """White's exposure over that of a photograph: signals are compared at white's."""
        white, other = (self.frames[n].settings.exposure_s for n in ("white", name))
        return white / other

    def _judged(self, patches: Patches, noise: NoiseLaw) -> Behaviour:
        timed = "after-black" in self.frames
        pairs = [self._pair(patches, noise, load) for load in ("", "half-", "full-")]
        effects = list(self._unsteady(patches, pairs, noise))
        moved = max((abs(e.value) for e in effects if e.found), default=0.0)
        untested = [MOVED.format(moved)] if moved else []
        if timed:
            effects += self._changing(patches, pairs[0], noise, moved)
        else:
            untested.append(BY_HAND)
        effects += self._coloured(patches, pairs[0], noise, moved)
        bright, dark = self._steps(patches, pairs[0], noise)
        effects += [
            analysis.clipped_white(bright, STEP_LIMIT),
            analysis.clipped_black(dark, STEP_LIMIT),
        ]
        if patches.scale < LEAST_CAMERA_PX:
            untested.append(COARSE.format(patches.scale))
        effects += self._fine(patches, noise, bright, moved)
        untested += [f"{e.name}: too little of it is seen" for e in effects if not e.known]
        untested += [UNSURE.format(e) for e in effects if e.known and e.sigma > e.limit]
        return Behaviour(self.camera, tuple(e for e in effects if e.known), tuple(untested))

    def _patches(self, noise: NoiseLaw) -> Patches:
        """Where the patches are."""
        first, second, *bits = (self._green(n) for n in ("first", "second", "bit-1", "bit-2"))
        span = self._green("white") - self._green("black")
        return find_patches((first, second), bits, span, noise, self.layout)

    def _pair(self, patches: Patches, noise: NoiseLaw, load: str) -> Pair:
        """Light of patches in complementary pictures, with some light elsewhere."""
        first, second = (
            self._light(patches, f"{load}{name}", noise) for name in ("first", "second")
        )
        return first, second

    def _unsteady(self, patches: Patches, pairs: list[Pair], noise: NoiseLaw) -> Iterator[Effect]:
        """Light that changes with the picture, or with the one before it."""
        alone, half, full = (direct_light(pair) for pair in pairs)
        yield analysis.load_effect("load-half", half, alone, LOAD_LIMIT)
        yield analysis.load_effect("load-full", full, alone, LOAD_LIMIT)
        if "after-black" in self.frames:
            before, after = (self._light(patches, n, noise) for n in ("white", "after-black"))
            yield analysis.load_effect("white-after-black", before, after, AFTER_BLACK_LIMIT)

    def _changing(
        self, patches: Patches, pair: Pair, noise: NoiseLaw, moved: float
    ) -> Iterator[Effect]:
        """What is left of the first picture of the pair in the second, as it comes up."""
        direct = direct_light(pair)
        for name in map(after_change, CHANGE_S):
            early = self._light(patches, name, noise)
            yield analysis.persistence_effect(early, pair[1], direct, REMNANT_LIMIT + moved, name)

    def _coloured(
        self, patches: Patches, pair: Pair, noise: NoiseLaw, moved: float
    ) -> tuple[Effect, Effect]:
        """Whether primaries and secondaries add up to white."""
        colours = [self._light(patches, f"colour-{i}", noise) for i in range(3)]
        return analysis.colour_effects(colours, pair, COLOUR_LIMIT + moved)

    def _steps(
        self, patches: Patches, pair: Pair, noise: NoiseLaw
    ) -> tuple[analysis.Steps, analysis.Steps]:
        """Light of steps near white, and of steps near black, which are photographed longer."""
        black, bright, dark = (
            self._light(patches, name, noise) for name in ("black", "bright-steps", "dark-steps")
        )
        return (
            analysis.step_light(BRIGHT_LEVELS, bright, pair, black),
            analysis.step_light(DARK_LEVELS, dark, pair, black),
        )

    def _fine(
        self, patches: Patches, noise: NoiseLaw, bright: analysis.Steps, moved: float
    ) -> Iterator[Effect]:
        """Fine stripes."""
        white, black = self._green("white"), self._green("black")
        view = analysis.StripedView(white, black, noise, patches.largest_px)
        full, grey = (view.power(self._green(name)) for name in ("stripes", "grey-stripes"))
        yield analysis.sharpness_effect(grey, full, bright, SHARPNESS_LIMIT + moved)
        if patches.scale >= LEAST_CAMERA_PX:
            rising = view.power(self._green("rising-stripes"))
            yield analysis.slant_effect(full, rising, SLANT_LIMIT + moved)

    def _green(self, name: str) -> Array:
        """Signals (H, W) of the green channel above black level, as if exposed like white [DN]."""
        signal = green(self.frames[name].counts) - self.sensor.black_level
        return np.asarray(self._scale(name) * signal, float)

    def _light(self, patches: Patches, name: str, noise: NoiseLaw) -> PatchLight:
        """Light of the patches, as if exposed like white."""
        counts = self.frames[name].counts
        counts = counts if counts.ndim == 3 else counts[..., None]
        signal = np.asarray(counts - self.sensor.black_level, float)
        return patches.read(signal, noise).scaled(self._scale(name))
