"""Photographs that people take, round by round: pictures go to disk, photographs come back in a folder.

VENUE/sessions/WORK-0001/
    wanted.json               what was asked for, in order: picture, exposure, round
    pictures/01/PROJECTOR.png the projectors that are lit; all others are dark
    order.csv                 the last round, for people
    captures/CAMERA/          the photographs, as a session keeps them
    ended                     when the workflow has its result

A workflow runs from its beginning each time. It is given the photographs that are stored, each once, by
picture and exposure, and stops with `PhotographsWanted` at the first one that is not.
"""

import csv
import io
import json
from collections.abc import Container, Mapping, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from procam.arrays import Array, FloatArray, Image
from procam.errors import FileFormatError, InputError
from procam.estimate.camera.exposure import round_down_exposure
from procam.files import atomic
from procam.files.images.pixels import read_image, write_image
from procam.files.names import NAME_PATTERN
from procam.files.session import Session
from procam.model.frame import Frame
from procam.model.optics import CameraModel
from procam.model.plan import Shot
from procam.workflows.photographs.driven import Wanted

TOP = 65535
SAMPLED_PX = 16  # every 16th pixel of a picture is compared
SAME = 4  # of TOP: a picture that is computed again is not the same to the last bit
ENDED = "ended"
Pictures = Mapping[str, Image]


class PhotographsWanted(Exception):
    """A workflow cannot go on without photographs; `rows` are the lines of its order."""

    def __init__(self, folder: Path, rows: Sequence["OrderRow"]) -> None:
        super().__init__(f"{folder}: photographs are wanted")
        self.folder, self.rows = folder, rows


class Asked(BaseModel):
    """A photograph that was asked for: number of its picture (0: all dark), exposure [s], and round."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    picture: int = Field(ge=0)
    projectors: list[str]
    exposure_s: float = Field(gt=0)
    round: int = Field(ge=1)


class OrderRow(BaseModel):
    """Photographs of one picture at one exposure."""

    model_config = ConfigDict(frozen=True)
    picture: str
    projectors: list[str]
    photographs: int
    exposure_s: float


class _Document(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")
    camera: str = Field(pattern=NAME_PATTERN)
    photographs: list[Asked]


class Rounds:
    """What was asked for and photographed, on disk."""

    def __init__(self, folder: Path, camera: CameraModel) -> None:
        self.folder, self.camera = folder, camera
        self.session = Session(folder)
        self.asked = self._read()
        self._samples = dict[int, dict[str, Array]]()

    @classmethod
    def newest(cls, venue_dir: Path, work: str, camera: CameraModel) -> "Rounds":
        """The newest of this work that has not ended, else a new one, which is on disk when it asks."""
        folder = venue_dir / "sessions"
        known = [p for p in folder.glob(f"{work}-{4 * '[0-9]'}") if p.is_dir()]
        numbers = [int(p.name[-4:]) for p in known]
        last = max(numbers, default=0)
        going_on = folder / f"{work}-{last:04d}"
        if last and not (going_on / ENDED).is_file():
            return cls(going_on, camera)
        return cls(folder / f"{work}-{last + 1:04d}", camera)

    @property
    def last_round(self) -> list[int]:
        """Numbers of the photographs of the last round."""
        last = self.asked[-1].round if self.asked else 0
        return [i for i, asked in enumerate(self.asked) if asked.round == last]

    def order(self) -> list[OrderRow]:
        """The last round, a row for photographs of one picture at one exposure."""
        asked = [self.asked[i] for i in self.last_round]
        return [
            OrderRow(
                picture="dark" if not of[0].picture else f"{of[0].picture:02d}",
                projectors=of[0].projectors,
                photographs=len(of),
                exposure_s=of[0].exposure_s,
            )
            for of in (list(g) for _, g in groupby(asked, lambda a: (a.picture, a.exposure_s)))
        ]

    def shot(self, number: int) -> Shot:
        """A photograph as the session stores it."""
        exposures_s = (self.asked[number].exposure_s,)
        return Shot(f"photograph-{number + 1:04d}", "", "", "dark", exposures_s)

    def find(self, wanted: Wanted, used: Container[int]) -> int | None:
        """Number of the first photograph of that picture and exposure that is stored, and not used."""
        stored, exposure_s = self._stored(), round_down_exposure(wanted.exposure_s)
        numbers = (
            number
            for number, asked in enumerate(self.asked[:stored])
            if number not in used and asked.exposure_s == exposure_s
        )
        return next((n for n in numbers if self._shows(self.asked[n], wanted.pictures)), None)

    def frame(self, number: int) -> Frame:
        """A stored photograph."""
        shot, name = self.shot(number), self.camera.name
        return self.session.load(name, shot, shot.exposures_s[0], self.camera.size)

    def ask(self, wanted: Sequence[Wanted]) -> PhotographsWanted:
        """Write what is wanted as the next round, in the place of one that nobody has photographed."""
        self.asked = self.asked[: self._stored()]
        following = self.asked[-1].round + 1 if self.asked else 1
        for each in wanted:
            asked = Asked(
                picture=self._picture_number(each.pictures),
                projectors=sorted(each.pictures),
                exposure_s=round_down_exposure(each.exposure_s),
                round=following,
            )
            self.asked.append(asked)
        document = _Document(camera=self.camera.name, photographs=self.asked)
        atomic.write_text(self.folder / "order.csv", _table(self.order()))
        atomic.write_text(self.folder / "wanted.json", document.model_dump_json(indent=1))
        return PhotographsWanted(self.folder, self.order())

    def end(self) -> None:
        """Note that the workflow has its result."""
        atomic.write_text(self.folder / ENDED, "")

    def _stored(self) -> int:
        """How many photographs are stored: the first ones."""
        slots = self.session.stored(self.camera.name)
        ids = ((self.shot(i).id, asked.exposure_s) for i, asked in enumerate(self.asked))
        return next((i for i, slot in enumerate(ids) if slot not in slots), len(self.asked))

    def _picture_number(self, pictures: Pictures) -> int:
        """Number of a picture, which is written to disk if it is new."""
        known = next((a.picture for a in self.asked if self._shows(a, pictures)), None)
        if known is not None or not pictures:
            return known or 0
        number = max((a.picture for a in self.asked), default=0) + 1
        for name, picture in pictures.items():
            write_image(self._path(number, name), _pixels(picture).astype(np.uint16))
        self._samples[number] = _sampled(pictures)
        return number

    def _shows(self, asked: Asked, pictures: Pictures) -> bool:
        """Whether a photograph is of these pictures."""
        if asked.projectors != sorted(pictures):
            return False
        if asked.picture not in self._samples:
            names = asked.projectors
            stored = {
                n: np.asarray(read_image(self._path(asked.picture, n)), float) / TOP for n in names
            }
            self._samples[asked.picture] = _sampled(stored)
        known, new = self._samples[asked.picture], _sampled(pictures)
        return all(
            known[n].shape == new[n].shape and np.abs(known[n] - new[n]).max() <= SAME
            for n in pictures
        )

    def _path(self, number: int, projector: str) -> Path:
        return self.folder / "pictures" / f"{number:02d}" / f"{projector}.png"

    def _read(self) -> list[Asked]:
        path = self.folder / "wanted.json"
        if not path.is_file():
            return []
        try:
            document = _Document.model_validate(json.loads(path.read_bytes()))
        except (ValueError, ValidationError, RecursionError) as error:
            raise FileFormatError(
                f"{path}: damaged; restore it, or remove the folder to begin again"
            ) from error
        if document.camera != self.camera.name:
            raise InputError(
                f"{path}: of camera {document.camera}, but the calibration in use is by camera "
                f"{self.camera.name}; remove the folder to begin again"
            )
        return document.photographs


class HandPhotographer:
    """Gives the photographs that are stored, and asks for the first that is not."""

    def __init__(self, rounds: Rounds) -> None:
        self._rounds = rounds
        self._used: list[int] = []
        self._planned: list[Wanted] = []

    def plan(self, wanted: Sequence[Wanted]) -> None:
        """Ask for these together, unless they belong to a longer plan."""
        if not any(_same(first, each) for first in wanted[:1] for each in self._planned):
            self._planned = [*wanted, *self._planned]

    def take(self, wanted: Wanted) -> Frame:
        """The photograph.

        Raises
        ------
        PhotographsWanted
            It was not taken yet.
        """
        self.plan([wanted])
        number = self._rounds.find(wanted, self._used)
        if number is None:
            raise self._rounds.ask(self._missing())
        self._used.append(number)
        at = next(i for i, each in enumerate(self._planned) if _same(wanted, each))
        del self._planned[at]
        return self._rounds.frame(number)

    def retake(self, wanted: Wanted) -> Frame:
        """The photograph of that picture that was given last."""
        return self._rounds.frame(self._used[-1])

    def end(self) -> None:
        """The next one begins a new folder."""
        self._rounds.end()

    def _missing(self) -> list[Wanted]:
        """What is planned and not stored."""
        used, missing = list(self._used), list[Wanted]()
        for each in self._planned:
            number = self._rounds.find(each, used)
            if number is None:
                missing.append(each)
            else:
                used.append(number)
        return missing


def _same(first: Wanted, second: Wanted) -> bool:
    """Whether two are of the same pictures and exposure."""
    same_pictures = first.pictures is second.pictures or not (first.pictures or second.pictures)
    return same_pictures and first.exposure_s == second.exposure_s


def _pixels(picture: FloatArray) -> Array:
    return np.asarray(np.rint(np.clip(picture, 0, 1) * TOP), float)


def _sampled(pictures: Mapping[str, FloatArray]) -> dict[str, Array]:
    """Some pixels (h, w, C) of each picture."""
    return {n: _pixels(p[::SAMPLED_PX, ::SAMPLED_PX]) for n, p in pictures.items()}


def _table(rows: Sequence[OrderRow]) -> str:
    """A round as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("picture", "projectors", "photographs", "exposure_s"))
    for row in rows:
        lit = " ".join(row.projectors)
        writer.writerow((row.picture, lit, row.photographs, f"{row.exposure_s:g}"))
    return text.getvalue()
