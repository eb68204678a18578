"""Where a calibration comes from, and what is doubtful about it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class Note:
    """Something that makes figures of a calibration wrong or doubtful.

    Attributes
    ----------
    code : its kind, in a few words that no version changes, for scripts and to compare calibrations.
    subject : "projector NAME", "camera NAME", the name of a mark, or "" of the venue.
    text : what is wrong and what to do, a sentence or two.
    amount : how much of it there is, in what is just noted, with its sign; 1 where it is no matter of degree.
    """

    code: str
    subject: str
    text: str
    amount: float = 1.0

    def __str__(self) -> str:
        return f"{self.subject}: {self.text}" if self.subject else self.text


@dataclass(frozen=True, slots=True)
class Provenance:
    """What a calibration was solved from; empty where it is not known.

    Attributes
    ----------
    session : name of the folder. input_sha256 : of the plan, venue.toml and all captures.
    backends : of the devices. python, versions : of the programs, by package.
    notes : warnings of the solve.
    recalibrated : names of projectors that were measured again since.
    by_hand : masks, protected parts and nudges, as `files.venue.masks.manual_edits` gives them.
    meter : readings of a hand meter and the results, as `procam meter` writes them.
    """

    session: str = ""
    input_sha256: str = ""
    backends: tuple[str, ...] = ()
    python: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    recalibrated: tuple[str, ...] = ()
    by_hand: Mapping[str, Any] = field(default_factory=dict)
    meter: Mapping[str, Any] = field(default_factory=dict)

    @property
    def note_lines(self) -> list[str]:
        """The notes, one line each."""
        return [str(note) for note in self.notes]
