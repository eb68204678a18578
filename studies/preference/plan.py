"""The plan of a preference test: which pictures there are, of which method, and what is asked.

plan.json names the methods. The page embeds only what `Plan.for_page` gives, so that nobody who looks into
it learns which picture is of which method.
"""

import json
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from procam.errors import FileFormatError

PLAN, PAGE, PICTURES = "plan.json", "page.html", "pictures"
Pair = tuple[str, str]


class _Entry(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Content(_Entry):
    """What is shown: a name, the file it is from, and its edge [px] as shown.

    `scale` is what its light was multiplied by, so that the brightest of its pictures is no brighter than
    white.
    """

    name: str
    source: str
    size_px: int
    scale: float


class Picture(_Entry):
    """Which method made a picture of which content."""

    content: str
    method: str


class Question(_Entry):
    """Two pictures of a content, by their files, that each observer compares some times.

    A `catch` question shows whether an observer looks at all; it is not one of those to be answered.
    """

    content: str
    pictures: Pair
    times: Annotated[int, Field(ge=1)]
    catch: bool


class Plan(_Entry):
    """All of plan.json; `id` is made from the calibration, the pictures and the settings."""

    schema_version: Literal[1] = 1
    id: str
    version: str
    command: str
    calibration: str
    on_dome: bool
    settings: dict[str, str | float | None]
    methods: tuple[str, ...]
    pairs: tuple[Pair, ...]
    catch: Pair | None
    repeats: Annotated[int, Field(ge=1)]
    seed: int
    contents: tuple[Content, ...]
    pictures: dict[str, Picture]
    questions: tuple[Question, ...]

    @property
    def trials(self) -> int:
        """How many answers each observer gives, with the catch trials."""
        return sum(question.times for question in self.questions)

    def pair_of(self, question: Question) -> Pair:
        """The methods of a question, in the order of the pair that they are."""
        first, second = (self.pictures[file].method for file in question.pictures)
        known = (*self.pairs, *([self.catch] if self.catch else ()))
        return (first, second) if (first, second) in known else (second, first)

    def for_page(self) -> dict[str, Any]:
        """What the page needs; the order in it says nothing of methods."""
        ordered = sorted(self.questions, key=lambda question: sorted(question.pictures))
        questions = [
            {"content": q.content, "pictures": sorted(q.pictures), "times": q.times}
            for q in ordered
        ]
        return {
            "plan": self.id,
            "seed": self.seed,
            "on_dome": self.on_dome,
            "questions": questions,
        }

    def to_json(self) -> str:
        """The text of plan.json."""
        return json.dumps(self.model_dump(mode="json"), indent=1) + "\n"


def read_plan(folder: Path) -> Plan:
    """The plan of a test's folder.

    Raises
    ------
    FileFormatError
        There is none, it is damaged, or it names a picture that it does not list.
    """
    path = folder / PLAN
    if not path.is_file():
        raise FileFormatError(f"{path}: no such file; OUT is the folder that `ask` has written")
    try:
        plan = Plan.model_validate_json(path.read_bytes())
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "it"
        raise FileFormatError(
            f"{path} is damaged ({where}: {first['msg']}); restore the file"
        ) from error
    for file in {file for question in plan.questions for file in question.pictures}:
        if file not in plan.pictures:
            raise FileFormatError(
                f"{path} is damaged: it asks for picture {file}, which it does not list; restore the file"
            )
    return plan
