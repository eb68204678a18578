"""Closed loop: show the compensated picture, photograph it, compare with the prediction, refine."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from procam.arrays import Array, BoolArray, Image
from procam.compensate.compensator import Compensated, Compensator
from procam.compensate.projector_frames import projector_frames
from procam.devices.rig import Rig
from procam.estimate.closed_loop import DomeLoop, noise_by_level, refined_calibration
from procam.estimate.closed_loop.patches import (
    MAX_CORRECTIONS,
    MIN_PHOTOGRAPHS,
    VISIBLE_JND,
    converged,
    just_noticeable,
    largest_regression,
    photographs_needed,
    residual_jnd,
)
from procam.maths.geometry.sphere import angles_from_direction
from procam.model.calibration import Calibration
from procam.model.quality import Figure, Goal
from procam.workflows.events import Event
from procam.workflows.refine.camera import LoopCamera

MAX_ITERATIONS = MAX_CORRECTIONS
CLOSE_ENOUGH = 1.1  # times the noise floor: the goal
CHANNEL_NAMES = ("red", "green", "blue")


@dataclass(frozen=True, slots=True)
class Refined:
    """Outcome of a loop.

    Attributes
    ----------
    calibration : with gains and scattered light corrected by the photographs; the first one if no
        correction was needed, or if that got worse.
    frames : by projector, of the picture as `calibration` compensates it.
    residual : after calibration and after each correction, of one photograph [rel].
    own_residual : of one photograph of `frames` [rel]. noise_floor : [rel].
    left_jnd : what almost all cells are off by at most, noise of the photographs included, at the same times
        as `residual` [JND]. own_jnd : the same of `frames`.
    photographs : (LOOP_SIZE, LOOP_SIZE, 3) cell means by name: "before" (uncompensated), "after".
    target : (LOOP_SIZE, LOOP_SIZE, 3) what was predicted. free : cells that no limit holds.
    scatter_factor : (3,) scattered light over that of the calibration.
    shots : photographs taken. per_picture : of them for each picture.
    worse : what got worse, in a sentence; empty if nothing did.
    """

    calibration: Calibration
    frames: Mapping[str, Image]
    residual: list[float]
    own_residual: float
    noise_floor: float
    left_jnd: list[float]
    own_jnd: float
    photographs: Mapping[str, Array]
    target: Array
    free: BoolArray
    scatter_factor: Array
    shots: int
    per_picture: int
    worse: str

    @property
    def corrections(self) -> int:
        """How often the picture was corrected."""
        return len(self.residual) - 1

    def figures(self) -> dict[str, Figure]:
        """The loop's figures by the names of summary.json."""
        cells = int(self.free.sum())
        figures = {
            "loop_residual_by_iteration": Figure(self.residual, "rel", None, cells),
            "loop_residual_own": Figure(self.own_residual, "rel", None, cells),
            "loop_noise_floor": Figure(self.noise_floor, "rel", None, self.per_picture),
            "loop_left_jnd_by_iteration": Figure(self.left_jnd, "JND", None, cells),
            "loop_own_jnd": Figure(self.own_jnd, "JND", Goal("<=", 1.0), cells),
            "loop_scatter_factor": Figure(self.scatter_factor.tolist(), "-", None, 3),
            "loop_iterations": Figure(self.corrections, "-", Goal("<=", MAX_ITERATIONS)),
        }
        if self.noise_floor > 0:  # a simulated camera may be free of noise
            over = self.residual[-1] / self.noise_floor
            goal = Goal("<=", CLOSE_ENOUGH) if self.left_jnd[-1] > VISIBLE_JND else None
            note = f"no goal where almost all cells are within {VISIBLE_JND:g} JND"
            figures["loop_residual_over_floor"] = Figure(over, "-", goal, cells, note)
        return figures


@dataclass
class _Run:
    """A loop under way.

    `sigma` (N, N, 3) of a photograph; `seen` those of the picture shown now; `first` the mean of those of
    the picture that the calibration compensated. `residual` of one photograph of each picture
    [rel], `left` of the mean of its photographs [JND].
    """

    camera: LoopCamera
    loop: DomeLoop
    sigma: Array
    seen: list[Array]
    first: Array
    residual: list[float] = field(default_factory=list)
    left: list[float] = field(default_factory=list)

    @classmethod
    def begin(cls, camera: LoopCamera, loop: DomeLoop) -> "_Run":
        """Photograph the picture often and long enough to resolve its distance from the goal."""
        seen = camera.photographs(MIN_PHOTOGRAPHS)
        sigma = noise_by_level(seen, camera.cells.count)
        if camera.hold(loop.goal[loop.free], sigma[loop.free]):
            seen = camera.photographs(MIN_PHOTOGRAPHS)
            sigma = noise_by_level(seen, camera.cells.count)
        wanted = photographs_needed(sigma[loop.free], loop.goal[loop.free])
        run = cls(camera, loop, sigma, seen + camera.photographs(wanted - MIN_PHOTOGRAPHS), seen[0])
        run.first = run.mean()
        run.note()
        return run

    def note(self) -> None:
        """Note how far off the picture shown now is."""
        self.residual.append(self.single())
        self.left.append(self.residual_jnd(self.loop.free))

    def residual_jnd(self, free: BoolArray) -> float:
        """What almost all `free` cells (N, N, 3) are off by at most [JND]."""
        return residual_jnd(self.loop.residual(self.mean())[free], self.loop.goal[free])

    def mean(self) -> Array:
        """Mean (N, N, 3) of the photographs of the picture shown now."""
        return np.asarray(np.mean(self.seen, axis=0))

    def single(self) -> float:
        """Residual of one photograph [rel]."""
        return self.loop.residual_rms(self.loop.residual(self.seen[0]))

    def enough(self) -> bool:
        """Whether another correction would be of no use."""
        free = self.loop.free
        left = self.loop.residual(self.mean())[free]
        return converged(left, self.sigma[free], self.loop.goal[free], len(self.seen))

    def show(self, frames: Mapping[str, Image]) -> None:
        """Show a picture and photograph it as often as the one before."""
        self.camera.show(frames)
        self.seen = self.camera.photographs(len(self.seen))


def refine(rig: Rig, calibration: Calibration, content: Image) -> Iterator[Event]:
    """Refine on `content` (N, N, 3); the last event carries `data["refined"]`, a `Refined`.

    Raises
    ------
    OutOfModelRange
        The camera cannot resolve what would be corrected, or is dazzled.
    """
    total = MAX_ITERATIONS + 4
    camera = LoopCamera(rig, calibration)
    for name in rig.projectors:
        rig.light(name)
    before = _uncompensated(camera, calibration, content)
    yield Event("refine", 1, total, "uncompensated picture photographed")
    compensator = Compensator(calibration, content.shape[0])
    wanted = compensator.solve(content)
    camera.expose_for(wanted.observed)
    loop = DomeLoop(calibration, camera.cells, wanted.direct, compensator.target(content))
    camera.show(projector_frames(wanted.direct, calibration))
    run = _Run.begin(camera, loop)
    floor = loop.residual_rms(run.sigma)
    text = f"residual {run.residual[0]:.3%} of white, noise {floor:.3%}"
    yield Event("refine", 2, total, text)
    while not run.enough() and len(run.residual) <= MAX_ITERATIONS:
        loop.update(run.mean(), run.sigma, len(run.seen))
        run.show(projector_frames(loop.picture, calibration))
        run.note()
        text = f"residual {run.residual[-1]:.3%} of white"
        yield Event("refine", 1 + len(run.residual), total, text)
    refined = _finish(run, calibration, content, before, wanted)
    yield Event("refine", total, total, "loop ended", {"refined": refined})


def _uncompensated(camera: LoopCamera, calibration: Calibration, content: Image) -> Array:
    plain = Compensator(calibration, content.shape[0], "none").solve(content)
    camera.expose_for(plain.observed)
    camera.show(projector_frames(plain.direct, calibration))
    return camera.photographs(1)[0]


def _finish(
    run: _Run, calibration: Calibration, content: Image, before: Array, wanted: Compensated
) -> Refined:
    """Judge the result by a picture of the new calibration alone."""
    loop, better, own = run.loop, calibration, wanted
    floor = loop.residual_rms(run.sigma)
    if loop.state.steps:
        loop.learn(run.mean(), run.sigma, len(run.seen))
        better = refined_calibration(calibration, loop)
        own = Compensator(better, content.shape[0]).solve(content)
        run.show(projector_frames(own.direct, better))
    free = loop.free & loop.cells_where(own.free)
    refined = Refined(
        calibration=better,
        frames=projector_frames(own.direct, better),
        residual=run.residual,
        own_residual=run.single(),
        noise_floor=floor,
        left_jnd=run.left,
        own_jnd=run.residual_jnd(free),
        photographs={"before": before, "after": run.mean()},
        target=run.camera.cells.average_master(wanted.observed),
        free=free,
        scatter_factor=loop.state.scatter_factor,
        shots=run.camera.shots,
        per_picture=len(run.seen),
        worse=_worse(run, free),
    )
    if refined.worse:
        return replace(
            refined, calibration=calibration, frames=projector_frames(wanted.direct, calibration)
        )
    quality = {**better.quality, **refined.figures()}
    return replace(refined, calibration=replace(better, quality=quality))


def _worse(run: _Run, free: BoolArray) -> str:
    """What got worse by the loop, in a sentence."""
    loop, flat = run.loop, (-1, 3)
    noticed = just_noticeable(loop.goal).reshape(flat)
    first, last = (loop.residual(seen).reshape(flat) / noticed for seen in (run.first, run.mean()))
    noise = run.sigma.reshape(flat) / noticed / np.sqrt(len(run.seen))
    found = largest_regression(first, last, noise, free.reshape(flat), loop.block.ravel())
    if found is None:
        return ""
    azimuth, elevation = angles_from_direction(
        loop.direction.reshape(flat)[found.place].mean(axis=0)
    )
    return (
        f"{CHANNEL_NAMES[found.channel]} light at azimuth {np.degrees(azimuth):.0f}, elevation "
        f"{np.degrees(elevation):.0f} degrees was off by {found.before:.2g} JND before the loop "
        f"and is by {found.after:.2g} after it"
    )
