"""Requests for photographs by people, as they are on disk and on the screen."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from procam.errors import FileFormatError
from procam.files.csv_text import csv_text
from procam.files.names import NAME_PATTERN
from procam.model.plan import Shot

SLATE = "-slate"  # behind the number of a picture
# s; wider than those of venue.toml, from which they differ by stops, and so that ratios are finite
Exposure = Annotated[float, Field(gt=1e-12, lt=1e12)]


class PhotographsWanted(Exception):
    """A workflow cannot go on without photographs by a camera; `rows` are the lines of its order."""

    def __init__(self, folder: Path, camera: str, rows: Sequence["OrderRow"]) -> None:
        super().__init__(f"{folder}: photographs are wanted")
        self.folder, self.camera, self.rows = folder, camera, rows


class Asked(BaseModel):
    """A photograph that was asked for: number of its picture (0: all dark), exposure [s], and round.

    With `slate` it is of the picture's number, shown before it.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    id: str = Field(pattern=NAME_PATTERN)
    round: int = Field(ge=1)
    picture: int = Field(ge=0)
    projectors: list[str]
    exposure_s: Exposure
    slate: bool = False

    @property
    def shown(self) -> str:
        """Folder of the pictures, and what people call them."""
        return f"{self.picture:02d}{SLATE if self.slate else ''}" if self.picture else "dark"

    @property
    def shot(self) -> Shot:
        """As the session stores it."""
        return Shot(self.id, "", "", "dark", (self.exposure_s,))


class OrderRow(BaseModel):
    """Photographs of one picture at one exposure."""

    model_config = ConfigDict(frozen=True)
    picture: str
    projectors: list[str]
    photographs: int
    exposure_s: float

    @property
    def slate(self) -> bool:
        """Whether it is of a picture's number."""
        return self.picture.endswith(SLATE)


class Document(BaseModel):
    """What was asked for, of what work.

    `rounds` and `pictures` are the highest numbers so far, replaced ones too: a number is never used twice.
    `exposure_s` is white's, from which all others follow. `asked_s` is when the last round was asked for,
    since 1970 [s]; None in files of earlier versions.
    """

    model_config = ConfigDict(extra="forbid")
    of: str
    camera: str = Field(pattern=NAME_PATTERN)
    exposure_s: Exposure
    rounds: int = Field(ge=0)
    pictures: int = Field(ge=0)
    photographs: list[Asked]
    asked_s: float | None = Field(default=None, allow_inf_nan=False)


def read_document(folder: Path) -> Document | None:
    """What was asked for in a folder; None if nothing was."""
    path = folder / "wanted.json"
    if not path.is_file():
        return None
    try:
        return Document.model_validate(json.loads(path.read_bytes()))
    except (ValueError, ValidationError, RecursionError) as error:
        raise FileFormatError(
            f"{path}: damaged; restore it, or remove the folder to begin again"
        ) from error


def order_table(camera: str, rows: Sequence[OrderRow]) -> str:
    """A round as CSV."""
    lines = (
        (camera, r.picture, " ".join(r.projectors), r.photographs, f"{r.exposure_s:g}")
        for r in rows
    )
    return csv_text([("camera", "picture", "projectors", "photographs", "exposure_s"), *lines])
