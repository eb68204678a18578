"""A cause of change, with its size and standard error, and the limits from which causes are named."""

from dataclasses import dataclass
from typing import Literal

Cause = Literal[
    "moved",
    "picture setting",
    "another picture",
    "focus",
    "light",
    "colour",
    "dead channel",
    "no picture",
    "not seen",
    "gamma setting",
    "signal range",
    "black level",
    "dynamic setting",
    "warming up",
    "dust",
    "stain",
    "floor or audience",
    "ambient light",
    "camera moved",
    "camera exposure",
    "camera focus",
    "banding",
    "calibration",
]
CERTAIN = 5.0  # sigmas
MOST_MOVED_ARCMIN = 1.5  # about what is seen as double where projectors overlap
MOST_BLUR_PX2 = 0.6
MOST_LIGHT, MOST_COLOUR = 0.02, 0.025  # relative
SAME_LIGHT = 0.012  # log: projectors that agree
MOST_EXPONENT = 0.03
EXPONENT_SIGMA = 0.002  # of a camera's own curve, between two pictures
MOST_BLACK, LEAST_BLACK, LEAST_RAISED = 1.2, 0.85, 0.008
MOST_SPAN = 0.025
SPAN_SIGMA = 0.0013
MOST_TREND, TREND_SIGMA = 0.004, 5e-4  # of white during the run
MOST_SCATTER = 0.03
MOST_AMBIENT = 0.003  # of white
AMBIENT_SIGMA = 0.006  # relative: veiling glare of a picture without anything dark
NOT_ALARMING: tuple[Cause, ...] = ("camera moved", "not seen")


RECALIBRATE, BY_HAND = (
    ("recalibrate it: procam recalibrate", "recalibrate it"),
    "calibrate again: procam session plan, add, solve",
)


def advice_by_hand(advice: str) -> str:
    """Advice where people drive all devices, for whom single projectors cannot be recalibrated."""
    said = next((text for text in RECALIBRATE if text in advice), "")
    return advice.replace(said, BY_HAND) if said else advice


@dataclass(frozen=True, slots=True)
class Finding:
    """One cause of change.

    Attributes
    ----------
    cause : its name. subject : the projector or camera; "" for the dome and the room.
    size, sigma : how much, and its standard error; NaN where there is no size.
    unit : of the size. text : what happened. advice : what to do.
    """

    cause: Cause
    subject: str
    size: float
    sigma: float
    unit: str
    text: str
    advice: str

    @property
    def sigmas(self) -> float:
        """Size in standard errors; infinite where there is no size."""
        return abs(self.size) / self.sigma if self.sigma > 0 else float("inf")

    @property
    def alarm(self) -> bool:
        """Whether the dome shows it; a camera that stands elsewhere only matters to the next photograph."""
        return self.cause not in NOT_ALARMING


def unsized(cause: Cause, subject: str, text: str, advice: str) -> Finding:
    """A cause that has no size."""
    return Finding(cause, subject, float("nan"), float("nan"), "-", text, advice)


def not_seen(projector: str, text: str) -> Finding:
    """What the camera sees too little of to judge it."""
    advice = "look at masks in venue.toml, and at what stands before the camera"
    return unsized("not seen", projector, text, advice)
