"""A capture plan: the pictures to show and photograph, in order."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from procam.model.frame import PixelFormat

Purpose = Literal[
    "dark",
    "white",
    "black",
    "tags",
    "code",
    "stripes",
    "zone",
    "primary",
    "levels",
    "dim",
]


@dataclass(frozen=True, slots=True)
class Shot:
    """One picture of a plan; every other projector is dark while it shows.

    Attributes
    ----------
    id : unique name, such as "south-0007".
    projector : the one that shows it; empty for the dark shot, with all shuttered. A projector that is
        photographed again has a dark shot of its own, of that time.
    pattern : path of the picture inside the session; empty for dark shots.
    purpose : its use. exposures_s : shutter times of its photographs [s].
    detail : describes the pattern. For codes: the code's name and the number of the plane; for
        stripes: axis ("x"/"y"), bit (0 = finest), inverse (0/1); for zones: their number; for
        primaries: channel (0, 1, 2); for tags: the picture (0, 1). A shot mark drawn into the
        picture is there as "number". The session ends with a check of itself, a "dim" picture of the
        first projector at both exposures.
    """

    id: str
    projector: str
    pattern: str
    purpose: Purpose
    exposures_s: tuple[float, ...]
    pixel_format: PixelFormat = "rgb"
    detail: Mapping[str, int | str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Plan:
    """The shots of a session in the order they are taken."""

    shots: tuple[Shot, ...]

    def of(self, projector: str, purpose: Purpose) -> list[Shot]:
        """Shots of one projector and purpose, in order."""
        return [s for s in self.shots if (s.projector, s.purpose) == (projector, purpose)]

    @property
    def exposures(self) -> int:
        """Photographs per camera."""
        return sum(len(shot.exposures_s) for shot in self.shots)
