"""Checks what a preference test is to ask about, before anything is computed."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

from procam.compensate.perceptual.settings import PERCEPTUAL
from procam.errors import InputError
from procam.workflows.playout.explain import METHODS
from procam.workflows.playout.frame import FrameSettings
from studies.preference.plan import Pair

CATCH = ("exact", "none")  # the two that differ most, so that whoever looks sees a difference


@dataclass(frozen=True, slots=True)
class Wanted:
    """What to ask about.

    Attributes
    ----------
    pictures : files, of each of which the first frame counts. methods : two or more different ones.
    repeats : how often each observer compares each pair of pictures.
    on_dome : the dome itself shows the pictures, which are then the light to send. Otherwise a monitor
        shows them, and they are what the audience would see.
    settings : state, white, transfer function and those of the perceptual method; its method is not used.
    """

    pictures: Sequence[Path]
    methods: tuple[str, ...]
    repeats: int
    on_dome: bool
    settings: FrameSettings

    def __post_init__(self) -> None:
        for method in self.methods:
            if method not in METHODS:
                raise InputError(
                    f"--methods: {method!r} is unknown; choose two or more of {', '.join(METHODS)}"
                )
        if len(set(self.methods)) < max(2, len(self.methods)):
            raise InputError(
                f"--methods: {','.join(self.methods)} are not two or more different ones; name them "
                "with a comma between, such as exact,perceptual"
            )
        if self.repeats < 1:
            raise InputError(f"--repeats is {self.repeats}; it must be 1 or more, such as 2")
        own = {"--db": self.settings.db, "--white-nits": self.settings.white_nits}
        given = [option for option, value in own.items() if value is not None]
        if given and not set(self.methods) & set(PERCEPTUAL):
            raise InputError(
                f"{' and '.join(given)}: for the method perceptual, which --methods does not name; add "
                "it or leave the option out"
            )

    @property
    def pairs(self) -> tuple[Pair, ...]:
        """Pairs of methods that are asked about."""
        return tuple(combinations(self.methods, 2))

    @property
    def catch(self) -> Pair | None:
        """The pair of the catch trials, unless it is asked about anyway."""
        return None if set(CATCH) <= set(self.methods) else CATCH

    @property
    def needed(self) -> tuple[str, ...]:
        """All methods of which pictures are shown."""
        return tuple(dict.fromkeys((*self.methods, *(self.catch or ()))))
