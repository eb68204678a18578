"""Closed loop: show the compensated picture, photograph it, compare with the prediction, refine.

Three stages. The picture is corrected until it fits its prediction; that finds the scattered light, which
dark cells show. Gains come from an even grey instead, in which no cell is dark. The calibration that
follows is then tried on the picture and on one that it was not made from, and is kept if both are better.
"""

from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import Array, BoolArray, Image
from procam.estimate.closed_loop.patches import MAX_CORRECTIONS, MIN_PHOTOGRAPHS, VISIBLE_JND
from procam.estimate.closed_loop.refined import with_gains, with_scatter
from procam.files.venue.load import Venue
from procam.model.calibration import Calibration
from procam.model.quality import Figure, Goal
from procam.model.screen import Dome, Screen
from procam.workflows.events import Event, Steps
from procam.workflows.main_camera import MainCamera
from procam.workflows.photographs.driven import Photographer
from procam.workflows.refine.camera import LoopCamera
from procam.workflows.refine.shown_picture import PreparedPicture, ShownPicture, Trial

CLOSE_ENOUGH = 1.1  # times the noise floor: the goal
GREY = 0.6  # of white: its direct light is clear of black and of white on any dome
TINY = 1e-6  # of white
DIM = 0.06  # of white: the least that the unseen picture asks for, or it might be out of reach
SAME_LEVEL = 0.1  # departure of the light from the prediction; a third of a stop is twice as much
HARMLESS = 1e-3  # of white: rise of a picture's residual that is no regression


@dataclass(frozen=True, slots=True)
class Refined:
    """Outcome of a loop.

    Attributes
    ----------
    calibration : with gains and scattered light corrected by the photographs; the first one if no
        correction was needed, or if that was no better.
    residual : after calibration and after each correction, of one photograph [rel].
    own_residual : the same of the picture by the new calibration alone [rel]. noise_floor : [rel].
    left_jnd : what almost all cells are off by at most, noise of the photographs included, at the same times
        as `residual` [JND]. own_jnd : the same by the new calibration alone.
    unseen : residual before and after, of a picture that the loop did not learn from [rel]; None if no
        correction was needed.
    photographs : (LOOP_SIZE, LOOP_SIZE, 3) cell means by name: "before" (uncompensated), "after".
    target : (LOOP_SIZE, LOOP_SIZE, 3) what was predicted. free : cells that no limit holds.
    scatter_factor : (3,) scattered light over that of the calibration.
    level : light of the first photographs over the prediction, a median.
    shots : photographs taken. per_picture : of them for each picture.
    worse : what got worse, in a sentence; empty if nothing did.
    better : whether the new calibration is kept.
    """

    calibration: Calibration
    residual: list[float]
    own_residual: float
    noise_floor: float
    left_jnd: list[float]
    own_jnd: float
    unseen: tuple[float, float] | None
    photographs: dict[str, Array]
    target: Array
    free: BoolArray
    scatter_factor: Array
    level: float
    shots: int
    per_picture: int
    worse: str
    better: bool

    @property
    def corrections(self) -> int:
        """How often the picture was corrected."""
        return len(self.residual) - 1

    def notes(self) -> list[str]:
        """Warnings, one per line."""
        if abs(self.level - 1) <= SAME_LEVEL:
            return []
        return [
            f"photographs are {self.level:.0%} as bright as predicted: lamps may have aged, but another "
            "exposure, ISO or aperture than stated looks the same, and then white is wrong by as much"
        ]

    def figures(self) -> dict[str, Figure]:
        """The loop's figures by the names of summary.json."""
        cells = int(self.free.sum())
        figures = {
            "loop_residual_by_iteration": Figure(self.residual, "rel", None, cells),
            "loop_residual_own": Figure(self.own_residual, "rel", None, cells),
            "loop_noise_floor": Figure(self.noise_floor, "rel", None, self.per_picture),
            "loop_left_jnd_by_iteration": Figure(self.left_jnd, "JND", None, cells),
            "loop_own_jnd": Figure(self.own_jnd, "JND", None, cells),
            "loop_scatter_factor": Figure(self.scatter_factor.tolist(), "-", None, 3),
            "loop_iterations": Figure(self.corrections, "-", None),
            "loop_level": Figure(self.level, "-", None, cells),
        }
        if self.unseen:
            figures["loop_unseen_residual"] = Figure(list(self.unseen), "rel", None, cells)
        if self.noise_floor > 0:  # a simulated camera may be free of noise
            over = self.residual[-1] / self.noise_floor
            goal = Goal("<=", CLOSE_ENOUGH) if self.left_jnd[-1] > VISIBLE_JND else None
            note = f"no goal where almost all cells are within {VISIBLE_JND:g} JND"
            figures["loop_residual_over_floor"] = Figure(over, "-", goal, cells, note)
        return figures


def refine(
    photographer: Photographer, venue: Venue, calibration: Calibration, content: Image
) -> Steps[Refined]:
    """Refine on `content` (H, W, 3) on the canvas of the calibration's maps.

    Raises
    ------
    OutOfModelRange
        The camera cannot resolve what would be corrected, or is dazzled; or the light in the room changed.
    """
    total, canvas = MAX_CORRECTIONS + 5, calibration.canvas
    calibration = calibration.on(calibration.screen.canvas)
    camera = LoopCamera(photographer, MainCamera.of(venue, calibration))
    plain = PreparedPicture.of(calibration, content, "none")
    prepared = PreparedPicture.of(calibration, content)
    before = _uncompensated(camera, plain, prepared)
    yield Event("refine", 1, total, "uncompensated picture photographed")
    shown = ShownPicture.start(camera, prepared)
    floor = shown.loop.residual_rms(shown.sigma)
    text = f"residual {shown.residual[0]:.3%} of white, noise {floor:.3%}"
    yield Event("refine", 2, total, text)
    while not shown.enough() and len(shown.residual) <= MAX_CORRECTIONS:
        shown.correct()
        text = f"residual {shown.residual[-1]:.3%} of white"
        yield Event("refine", 1 + len(shown.residual), total, text)
    trials = list[Trial]()
    if shown.loop.state.steps:
        shown.learn()
        better = _better(camera, calibration, shown)
        yield Event("refine", total - 1, total, "gains measured on an even grey")
        trials = _trials(shown, better, content)
    camera.check_dark()
    refined = _judged(shown, trials, before)
    refined = replace(refined, calibration=refined.calibration.on(canvas))
    yield Event("refine", total, total, "loop ended")
    return refined


def _uncompensated(camera: LoopCamera, plain: PreparedPicture, following: PreparedPicture) -> Array:
    """Photograph (N, N, 3) of the uncompensated picture, after some of the dark."""
    observed = plain.wanted.observed
    camera.plan(
        [
            ({}, observed, MIN_PHOTOGRAPHS),
            (plain.frames, observed, 1),
            (following.frames, following.wanted.observed, MIN_PHOTOGRAPHS),
        ]
    )
    camera.expose_for(observed)
    camera.measure_dark()
    camera.show(plain.frames)
    return camera.photographs(1)[0]


def _better(camera: LoopCamera, calibration: Calibration, shown: ShownPicture) -> Calibration:
    """The calibration with the scattered light that a picture showed, and gains measured on grey."""
    scattered = with_scatter(calibration, shown.loop.state.scatter_factor)
    size = shown.wanted.direct.shape[1]
    inside = calibration.screen.canvas.directions(size)[1][..., None]
    grey = np.repeat(np.float32(GREY) * inside, 3, axis=-1)
    even = ShownPicture.start(camera, PreparedPicture.of(scattered, grey), find_scatter=False)
    even.correct()  # once: wrong gains scatter a wrong light too
    even.learn()
    return with_gains(scattered, even.loop.gain_factor())


def _trials(shown: ShownPicture, better: Calibration, content: Image) -> list[Trial]:
    """The picture, and one that was not learnt from, by the calibration before and after."""
    unseen, camera = turned_and_inverted(content, shown.calibration.screen), shown.camera
    prepared = [
        PreparedPicture.of(better, content),
        PreparedPicture.of(shown.calibration, unseen),
        PreparedPicture.of(better, unseen),
    ]
    lit = [(p.frames, p.wanted.observed, MIN_PHOTOGRAPHS) for p in prepared]
    camera.plan([*lit, ({}, prepared[2].wanted.observed, 1)])  # dark again at the end
    own, before, after = (ShownPicture.start(camera, picture) for picture in prepared)
    return [Trial("picture", shown, own), Trial("turned and inverted picture", before, after)]


def turned_and_inverted(content: Image, screen: Screen) -> Image:
    """Content (H, W, 3) turned by a quarter, in a room mirrored, bright where it was dark.

    Nowhere is it quite dark.
    """
    inverted = np.maximum(GREY * (1 - content / max(float(content.max()), 1.0)), DIM)
    turned = np.rot90(inverted) if isinstance(screen, Dome) else inverted[:, ::-1]
    inside = screen.canvas.directions(content.shape[1])[1][..., None]
    return np.ascontiguousarray(turned * inside, np.float32)


def _judged(shown: ShownPicture, trials: list[Trial], before: Array) -> Refined:
    """The outcome: the new calibration is kept if neither picture got worse and their mean is better."""
    own = trials[0].after if trials else shown
    free = trials[0].free if trials else shown.loop.free
    worse = _worse(trials)
    rms = [trial.rms for trial in trials]
    before_rms, after_rms = np.mean(rms, axis=0) if rms else (0.0, 0.0)
    better = bool(not worse and after_rms < before_rms)
    calibration = own.calibration if better else shown.calibration
    target = shown.camera.cells.average_of(shown.wanted.observed)
    refined = Refined(
        calibration=calibration,
        residual=shown.residual,
        own_residual=own.residual[0],
        noise_floor=shown.loop.residual_rms(shown.sigma),
        left_jnd=shown.left,
        own_jnd=own.residual_jnd(free),
        unseen=rms[1] if rms else None,
        photographs={"before": before, "after": own.first},
        target=target,
        free=free,
        scatter_factor=shown.loop.state.scatter_factor,
        level=float(np.median(shown.first[free] / np.maximum(target[free], TINY))),
        shots=shown.camera.shots,
        per_picture=len(shown.seen),
        worse=worse,
        better=better,
    )
    if better:
        quality = {**calibration.quality, **refined.figures()}
        refined = replace(refined, calibration=replace(calibration, quality=quality))
    return refined


def _worse(trials: list[Trial]) -> str:
    """What got worse by the loop, in a sentence."""
    for trial in trials:
        before, after = trial.rms
        if after > before + HARMLESS:
            return (
                f"the {trial.name} was off by {before:.2%} of white before the loop and is by "
                f"{after:.2%} after it"
            )
        if found := trial.regression():
            return found
    return ""
