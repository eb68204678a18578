"""plan.json and the lines of index.jsonl, checked key by key: they may come from elsewhere, or be damaged.

Names become parts of file names, so nothing in them may lead out of the session's folder.
"""

import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, StringConstraints, ValidationError

from procam.errors import FileFormatError
from procam.files.names import NAME_PATTERN
from procam.files.venue.tables import Name
from procam.model.frame import PixelFormat
from procam.model.plan import Plan, Purpose, Shot

SCHEMA = 1
MAX_SHOWN = 40  # letters of a wrong name in a message
Model = TypeVar("Model", bound=BaseModel)
Positive = Annotated[FiniteFloat, Field(gt=0)]
FileName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9@._+-]*$")]
# both are empty for the dark shot
ProjectorName = Annotated[str, StringConstraints(pattern=rf"^$|{NAME_PATTERN}")]
PatternPath = Annotated[
    str, StringConstraints(pattern=r"^$|^([A-Za-z0-9_-]+/)*[A-Za-z0-9_-]+\.png$")
]


class _Shot(BaseModel):
    model_config = ConfigDict(extra="forbid")
    id: Name
    projector: ProjectorName
    pattern: PatternPath
    purpose: Purpose
    exposures_s: Annotated[list[Positive], Field(min_length=1)]
    pixel_format: PixelFormat = "rgb"
    detail: dict[Name, int | Name] = {}


class StoredFrame(BaseModel):
    """A line of index.jsonl: a frame that is on disk, and the sha256 of its counts.

    `bits` is the depth of counts that were decoded from an encoded photograph; None: as the camera
    delivered them, or decoded by an earlier version, with the depth of venue.toml.
    """

    model_config = ConfigDict(frozen=True)
    shot: Name
    file: FileName
    exposure_s: Positive  # planned
    in_force_s: Positive | None = None  # by the camera
    gain: Positive
    pixel_format: PixelFormat
    started_s: FiniteFloat
    ended_s: FiniteFloat
    sha256: str
    bits: Annotated[int, Field(ge=8, le=16)] | None = None


def parse_plan(path: Path, content: bytes) -> Plan:
    """The plan of a session.

    Raises
    ------
    FileFormatError
        If `content` is no such plan; `path` is its name in the message.
    """
    document = parse_object(path, content)
    if document.get("schema") != SCHEMA:
        raise FileFormatError(
            f"{path} has schema {document.get('schema')!r}, and this version of procam reads {SCHEMA}; use "
            "the version that wrote it"
        )
    shots = document.get("shots")
    if not isinstance(shots, list) or not shots:
        raise FileFormatError(f"{path} has no list of shots; restore the file")
    return Plan(tuple(_shots(path, shots)))


def _shots(path: Path, entries: list[Any]) -> Iterator[Shot]:
    known = set[str]()
    for number, entry in enumerate(entries):
        shot = checked(_Shot, entry, f"{path}: shot {number}", "restore the file")
        if shot.id in known:
            raise FileFormatError(f"{path}: two shots are called {shot.id}; restore the file")
        known.add(shot.id)
        yield Shot(**dict(shot) | {"exposures_s": tuple(shot.exposures_s)})


def plan_text(plan: Plan) -> str:
    """plan.json, as `parse_plan` reads it."""
    document = {"schema": SCHEMA, "shots": [asdict(shot) for shot in plan.shots]}
    return json.dumps(document, indent=1)


def parse_entry(path: Path, number: int, line: str) -> StoredFrame:
    """A line of an index; `path` and `number` are for the message of FileFormatError."""
    document = parse_object(path, line.encode())
    remedy = "restore the file, or remove the line and capture again"
    return checked(StoredFrame, document, f"{path}: line {number}", remedy)


def parse_object(path: Path, content: bytes) -> dict[str, Any]:
    """A JSON object; `path` is its name in the message of FileFormatError."""
    try:
        document = json.loads(content)
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise FileFormatError(f"{path} is damaged JSON ({error}); restore the file") from error
    if not isinstance(document, dict):
        raise FileFormatError(
            f"{path} holds a JSON {type(document).__name__}; it must be an object"
        )
    return document


def checked(model: type[Model], document: object, where: object, remedy: str) -> Model:
    """A document as a model; `where` and `remedy` are for the message of FileFormatError."""
    try:
        return model.model_validate(document)
    except ValidationError as error:
        found = _first_finding(error)
        raise FileFormatError(f"{where} is damaged ({found}); {remedy}") from error


def _first_finding(error: ValidationError) -> str:
    """The first finding in words: which key, what is wrong."""
    wrong = error.errors()[0]
    text = wrong["msg"][0].lower() + wrong["msg"][1:]
    if wrong["type"] == "string_pattern_mismatch":
        text = f"{str(wrong['input'])[:MAX_SHOWN]!r} is no name that procam gives"
    where = ".".join(map(str, wrong["loc"]))
    return f"{where}: {text}" if where else text
