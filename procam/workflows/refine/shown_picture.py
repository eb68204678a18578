"""A picture on the screen, as a calibration compensates it, and photographs of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from procam.arrays import Array, BoolArray, Image
from procam.compensate.any_screen import AnyPicture, compensator_for
from procam.compensate.perceptual.settings import Perceptual
from procam.compensate.projector_frames import projector_frames
from procam.estimate.closed_loop.patches import (
    MIN_PHOTOGRAPHS,
    converged,
    just_noticeable,
    largest_regression,
    photographs_needed,
    residual_jnd,
    residual_without_noise,
)
from procam.estimate.closed_loop.picture_loop import PictureLoop, noise_by_level
from procam.model.calibration import Calibration
from procam.model.photometry import PRIMARIES
from procam.workflows.refine.camera import LoopCamera


@dataclass(frozen=True, slots=True)
class PreparedPicture:
    """A picture as a calibration compensates it.

    Attributes
    ----------
    calibration, wanted : the picture by the calibration. target : (N, N, 3) what it should look like.
    frames : drive (H, W, 3) by projector.
    """

    calibration: Calibration
    wanted: AnyPicture
    target: Image
    frames: Mapping[str, Image]

    @classmethod
    def of(
        cls, calibration: Calibration, content: Image, method: str | Perceptual = "exact"
    ) -> "PreparedPicture":
        """Content (N, N, 3), compensated by a method of `Compensator`."""
        compensator = compensator_for(calibration)(calibration, content.shape[1], method)
        wanted = compensator.predict(content)
        frames = projector_frames(wanted.direct, calibration)
        return cls(calibration, wanted, compensator.target(content), frames)


@dataclass
class ShownPicture:
    """A picture that is shown, corrected and shown again.

    Attributes
    ----------
    camera, calibration, wanted : the picture as the calibration compensates it.
    loop : on that picture.
    sigma : (N, N, 3) standard error of one photograph [rel].
    seen : photographs of what is shown now.
    first : (N, N, 3) mean of the photographs before any correction.
    residual, left : of one photograph [rel], and of the mean [JND], of each picture that was shown.
    """

    camera: LoopCamera
    calibration: Calibration
    wanted: AnyPicture
    loop: PictureLoop
    sigma: Array
    seen: list[Array]
    first: Array
    residual: list[float] = field(default_factory=list)
    left: list[float] = field(default_factory=list)

    @classmethod
    def start(
        cls, camera: LoopCamera, prepared: "PreparedPicture", find_scatter: bool = True
    ) -> "ShownPicture":
        """Show a picture, and photograph it often and long enough to resolve what is off."""
        wanted, calibration = prepared.wanted, prepared.calibration
        loop = PictureLoop(calibration, camera.cells, wanted.direct, prepared.target, find_scatter)
        camera.expose_for(wanted.observed)
        camera.show(prepared.frames)
        seen = camera.photographs(MIN_PHOTOGRAPHS)
        sigma = noise_by_level(seen, camera.cells.count)
        if camera.hold(loop.goal[loop.free], sigma[loop.free]):
            seen = camera.photographs(MIN_PHOTOGRAPHS)
            sigma = noise_by_level(seen, camera.cells.count)
        more = photographs_needed(sigma[loop.free], loop.goal[loop.free]) - MIN_PHOTOGRAPHS
        seen += camera.photographs(more)
        shown = cls(camera, calibration, wanted, loop, sigma, seen, np.mean(seen, axis=0))
        shown.note()
        return shown

    def correct(self) -> None:
        """Learn from the photographs, show the corrected picture and photograph it as often."""
        self.loop.update(self.mean(), self.sigma, len(self.seen))
        self.camera.show(projector_frames(self.loop.picture, self.calibration))
        self.seen = self.camera.photographs(len(self.seen))
        self.note()

    def learn(self) -> None:
        """Learn from the photographs of the picture shown now."""
        self.loop.learn(self.mean(), self.sigma, len(self.seen))

    def note(self) -> None:
        """Note how far off the picture shown now is."""
        off = self.loop.residual(self.seen[0])
        self.residual.append(self.loop.residual_rms(off))
        self.left.append(self.residual_jnd(self.loop.free))

    def mean(self) -> Array:
        """Mean (N, N, 3) of the photographs of the picture shown now."""
        return np.asarray(np.mean(self.seen, axis=0))

    def residual_jnd(self, free: BoolArray) -> float:
        """What almost all `free` cells (N, N, 3) are off by at most [JND]."""
        return residual_jnd(self.loop.residual(self.mean())[free], self.loop.goal[free])

    def enough(self) -> bool:
        """Whether another correction would be of no use."""
        free = self.loop.free
        left = self.loop.residual(self.mean())[free]
        return converged(left, self.sigma[free], self.loop.goal[free], len(self.seen))


@dataclass(frozen=True, slots=True)
class Trial:
    """A picture by two calibrations: before and after the loop."""

    name: str
    before: ShownPicture
    after: ShownPicture

    @property
    def free(self) -> BoolArray:
        """(N, N, 3) cells that no limit holds in either."""
        return self.before.loop.free & self.after.loop.free

    @property
    def rms(self) -> tuple[float, float]:
        """Root mean square residual before and after, photographs' noise taken off [rel]."""
        pictures = (self.before, self.before.first), (self.after, self.after.first)
        before, after = (
            residual_without_noise(
                p.loop.residual(seen)[self.free], p.sigma[self.free], len(p.seen)
            )
            for p, seen in pictures
        )
        return before, after

    def regression(self) -> str:
        """Where the picture got visibly worse, in a sentence; empty if nowhere."""
        loop, flat = self.before.loop, (-1, 3)
        noticed = just_noticeable(loop.goal).reshape(flat)
        first, last = (
            p.loop.residual(p.first).reshape(flat) / noticed for p in (self.before, self.after)
        )
        noise = self.before.sigma.reshape(flat) / noticed / np.sqrt(len(self.before.seen))
        found = largest_regression(first, last, noise, self.free.reshape(flat), loop.block.ravel())
        if found is None:
            return ""
        there = loop.direction.reshape(flat)[found.place]
        where = there[np.argmax(there @ there.mean(axis=0))]  # in a room the mean may be on no wall
        place = self.before.calibration.screen.named(where)
        return (
            f"{PRIMARIES[found.channel]} light at {place}, in the {self.name}, was off by "
            f"{found.before:.2g} JND before the loop and is by {found.after:.2g} after it"
        )
