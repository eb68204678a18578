"""The photographer of a venue whose devices people drive."""

from collections.abc import Sequence

from procam.model.frame import Frame
from procam.workflows.photographs.driven import Wanted
from procam.workflows.photographs.likeness import same, sampled
from procam.workflows.photographs.orders import Asked
from procam.workflows.photographs.rounds import Rounds


class HandPhotographer:
    """Gives the photographs that are stored, and asks for the first that is not."""

    def __init__(self, rounds: Rounds, notes: Sequence[str] = ()) -> None:
        self._rounds, self.notes = rounds, notes
        self._used: list[str] = []
        self._planned: list[Wanted] = []
        self._last: Asked

    @property
    def again(self) -> str:
        """What to do if the photographs turn out to be bad."""
        return (
            "Give other photographs of the last round with --photos and --replace, or remove "
            f"{self._rounds.folder} to begin again"
        )

    def plan(self, wanted: Sequence[Wanted]) -> None:
        """Ask for these together, unless they belong to a longer plan."""
        if not any(_equal(first, each) for first in wanted[:1] for each in self._planned):
            self._planned = [*wanted, *self._planned]

    def take(self, wanted: Wanted) -> Frame:
        """The photograph.

        Raises
        ------
        PhotographsWanted
            It was not taken yet.
        """
        self.plan([wanted])
        asked = self._rounds.find(wanted, self._used)
        if asked is None:
            raise self._rounds.ask(self._missing())
        self._used.append(asked.id)
        at = next(i for i, each in enumerate(self._planned) if _equal(wanted, each))
        del self._planned[at]
        self._last = asked
        return self._rounds.frame(asked)

    def retake(self, wanted: Wanted) -> Frame:
        """The photograph that was given last."""
        return self._rounds.frame(self._last)

    def end(self) -> None:
        """The next one begins a new folder, unless photographs of this one are replaced."""
        self._rounds.end()

    def _missing(self) -> list[Wanted]:
        """What is planned and not stored."""
        used, missing = list(self._used), list[Wanted]()
        for each in self._planned:
            asked = self._rounds.find(each, used)
            if asked is None:
                missing.append(each)
            else:
                used.append(asked.id)
        return missing


def _equal(first: Wanted, second: Wanted) -> bool:
    """Whether two are of the same pictures and exposure."""
    if first.exposure_s != second.exposure_s or first.pictures.keys() != second.pictures.keys():
        return False
    return same(sampled(first.pictures), sampled(second.pictures))
