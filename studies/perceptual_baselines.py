"""Ways to show a picture on a screen that lights itself: procam's, and simpler ones to compare with."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from procam.compensate.perceptual.light import FieldTransport, Stage, interleaved, planes
from procam.compensate.perceptual.objective import luma
from procam.compensate.perceptual.settings import Perceptual
from procam.compensate.perceptual.small_pictures import REDUCTION
from procam.compensate.perceptual.targets import SAMPLE, MovieTargets, StillTargets
from procam.maths.warp import blur

Image = NDArray[np.float32]
Array = NDArray[np.float64]
BLACK = 1 / 2000  # direct light of a projector's black
WHITE_NITS = 14.0
PIXELS_PER_DEGREE = 20.0
HALVINGS = 40
BASE_BLUR_PX = 8.0
BASE_LIFT = 1.5  # of the scattered light, added to the base by its root of squares
CURVES = [
    (gamma, lift) for gamma in (0.6, 0.7, 0.8, 0.9, 1.0) for lift in (0.0, 0.01, 0.03, 0.06, 0.1)
]
#: thresholds against luminance, cd/m2: Ferwerda et al. (1996), doi:10.1145/237170.237262, cones
CONES = ((-2.6, -0.72), (1.9, -1.255))  # of log10 luminance: below, above


@dataclass(frozen=True)
class FlatScreen:
    """Pictures (N, N, 3) on a screen that scatters evenly: total = direct + feedback mean(direct)."""

    size: int
    feedback: float

    @cached_property
    def stage(self) -> Stage:
        return self._stage(self.size)

    def _stage(self, size: int) -> Stage:
        ones, area = (
            np.ones((3, size, size), np.float32),
            np.full((size, size), 1 / size**2, np.float32),
        )
        operator = np.full((3, 1, 1), self.feedback)
        transport = FieldTransport(ones, None, area, np.ones((1, 1, 1)), operator)
        degrees = self.size / PIXELS_PER_DEGREE
        return Stage(np.float32(BLACK) * ones, ones, area, transport, size / degrees)

    def limited(self, direct: Image) -> Image:
        """Direct light (3, N, N) within the limits."""
        return np.clip(direct, self.stage.lo, self.stage.hi)

    def exact(self, target: Image) -> Image:
        """Total light (N, N, 3) of the exact solution (P)."""
        wanted = planes(target)
        direct = self.limited(wanted - self._scattered(wanted)[:, None, None])
        return interleaved(self.stage.transport.total(direct))

    def moments(self, target: Image) -> Array:
        """Mean direct light (3, 1) of (P)."""
        return self._scattered(planes(target))[:, None] / self.feedback

    def _scattered(self, wanted: Image) -> Array:
        """s = feedback mean(clip(t - s)), which falls as s grows: by halving."""
        low, high = np.zeros(3), np.full(3, self.feedback)
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            direct = self.limited(wanted - middle[:, None, None].astype(np.float32))
            more = self.feedback * direct.mean(axis=(1, 2), dtype=float) > middle
            low, high = np.where(more, middle, low), np.where(more, high, middle)
        return np.asarray(low)

    def still(self, target: Image, settings: Perceptual) -> Image:
        """Total light of the perceptual method."""
        small = self._stage(self.size // REDUCTION)
        found = StillTargets(self.stage, small, settings).of(target, self.moments(target))
        return self.exact(found.target)

    def movie(self, settings: Perceptual) -> MovieTargets:
        """Targets of the method for movies."""
        small, sample = (self._stage(n) for n in (self.size // REDUCTION, min(self.size, SAMPLE)))
        return MovieTargets(small, sample, settings)


def uncompensated(screen: FlatScreen, target: Image) -> Image:
    """The picture as it is sent, clipped to what projectors can."""
    return interleaved(screen.stage.transport.total(screen.limited(planes(target))))


def least_squares(screen: FlatScreen, target: Image, weight: Image | None = None) -> Image:
    """(W): least weighted squares. x = clip(t - s + pull / w), pull = -feedback mean(w (y - t))."""
    found = np.empty_like(target)
    for c in range(3):
        t = target[..., c].astype(float)
        w = np.ones_like(t) if weight is None else weight.astype(float)

        def shown(pull: float, t: Array = t, w: Array = w) -> tuple[Array, float]:
            asked = t + pull / w
            low, high = 0.0, screen.feedback
            for _ in range(HALVINGS):
                s = (low + high) / 2
                more = screen.feedback * np.clip(asked - s, BLACK, 1).mean() > s
                low, high = (s, high) if more else (low, s)
            y = np.clip(asked - s, BLACK, 1) + s
            return y, pull + screen.feedback * float((w * (y - t)).mean())

        low, high = -4.0 * w.max(), 4.0 * w.max()
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            y, left = shown(middle)
            low, high = (middle, high) if left < 0 else (low, middle)
        found[..., c] = y
    return found


def thresholds(screen: FlatScreen, target: Image) -> Image:
    """Least squares of errors in visibility thresholds at the target's luminance.

    That is as far as the text of van Baar et al. (2011) defines its minimisation: errors weighted by what an
    eye adapted to each place can see, with light that is not negative.
    """
    log = np.log10(np.maximum(luma(planes(target)) * WHITE_NITS, 1e-4))
    threshold = np.where(
        log <= CONES[0][0],
        CONES[0][1],
        np.where(
            log >= CONES[1][0], log + CONES[1][1], np.maximum(0.249 * log + 0.65, 0) ** 2.7 - 0.72
        ),
    )
    seen = 10.0**-threshold
    return least_squares(screen, target, (seen / seen.mean()) ** 2)


def base_and_detail(screen: FlatScreen, target: Image) -> Image:
    """The picture's blurred light lifted above the scattered light, its detail kept; then (P)."""
    scattered = screen.feedback * float(screen.moments(target).mean())
    light = np.maximum(luma(planes(target)), 1e-4)
    base = np.exp(blur(np.log(light), BASE_BLUR_PX))
    lifted = np.sqrt(base**2 + (BASE_LIFT * scattered) ** 2) / base
    return screen.exact((target * lifted[..., None]).astype(np.float32))


def tone_curve(screen: FlatScreen, target: Image) -> Image:
    """(P) of lift + (1 - lift) t^gamma, the two numbers chosen for each picture by procam's own objective."""
    problem = screen.stage.problem(planes(target), WHITE_NITS)

    def cost(light: Image) -> float:
        errors = problem.contrast.of(planes(light))[0], problem.guard.of(planes(light))[0]
        return float(np.log(np.maximum(errors, 1e-12)).sum())

    tried = [
        screen.exact((lift + (1 - lift) * target**gamma).astype(np.float32))
        for gamma, lift in CURVES
    ]
    return min(tried, key=cost)


def perceptual(screen: FlatScreen, target: Image, db: float) -> Image:
    return screen.still(target, Perceptual(db, WHITE_NITS))


def first_frame(screen: FlatScreen, target: Image, db: float) -> Image:
    """The method for movies, on a first frame."""
    targets = screen.movie(Perceptual(db, WHITE_NITS, video=True))
    return screen.exact(targets.of(target, screen.moments(target)).target)


METHODS: Mapping[str, Callable[[FlatScreen, Image], Image]] = {
    "none": uncompensated,
    "(P)": FlatScreen.exact,
    "(W)": least_squares,
    "thresholds": thresholds,
    "tone curve": tone_curve,
    "base and detail": base_and_detail,
    "perceptual, 0 dB": partial(perceptual, db=0.0),
    "perceptual, 1 dB": partial(perceptual, db=1.0),
    "perceptual-video, 0 dB": partial(first_frame, db=0.0),
    "perceptual-video, 1 dB": partial(first_frame, db=1.0),
}
