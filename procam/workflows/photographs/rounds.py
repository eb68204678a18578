"""Photographs that people take, round by round: pictures go to disk, photographs come back in a folder.

VENUE/sessions/WORK-0001/
    wanted.json               what was asked for, in order: picture, exposure, round
    pictures/01/PROJECTOR.png the projectors that are lit; all others are dark
    pictures/02-slate/        the number of a picture that is much like an earlier one, shown before it
    order.csv                 the last round, for people
    captures/CAMERA/          the photographs, as a session keeps them
    ended                     when the workflow has its result

A workflow runs from its beginning each time. It is given the photographs that are stored, each once, by
picture and exposure, and stops with `PhotographsWanted` at the first one that is not.
"""

import math
import re
import time
from collections.abc import Container, Mapping, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np

from procam.arrays import Array
from procam.errors import FileFormatError, InputError
from procam.files import atomic
from procam.files.images.pixels import read_image, write_image
from procam.files.session import Session
from procam.model.frame import Frame
from procam.model.optics import CameraModel
from procam.workflows.photographs.driven import Wanted
from procam.workflows.photographs.likeness import (
    TOP,
    Counts,
    Pictures,
    Samples,
    alike,
    pixels,
    same,
    sampled,
    slate,
)
from procam.workflows.photographs.orders import (
    SLATE,
    Asked,
    Document,
    OrderRow,
    PhotographsWanted,
    order_table,
    read_document,
)

ENDED = "ended"


class Rounds:
    """What was asked for and photographed, on disk.

    Parameters
    ----------
    folder : of the work. camera : that photographs. exposure_s : of white, of which all exposures are a
        third of a stop, or several, away [s]. of : what the work is of.
    """

    def __init__(self, folder: Path, camera: CameraModel, exposure_s: float, of: str) -> None:
        self.folder, self.camera, self.session = folder, camera, Session(folder)
        self.document = read_document(folder) or Document(  # venue.toml may have changed since
            of=of,
            camera=camera.name,
            exposure_s=exposure_s,
            rounds=0,
            pictures=0,
            photographs=[],
        )
        if (known := self.document.camera) != camera.name:
            raise InputError(
                f"{folder / 'wanted.json'}: of camera {known}, but the calibration in use is by camera "
                f"{camera.name}; remove the folder to begin again"
            )
        self._samples = dict[int, Samples]()

    @classmethod
    def newest(
        cls,
        venue_dir: Path,
        work: str,
        camera: CameraModel,
        exposure_s: float,
        of: str,
        *,
        ended: bool = False,
    ) -> "Rounds":
        """The newest of this work that has not ended, else a new one, which is on disk when it asks.

        With `ended` it may have ended.
        """
        folder = venue_dir / "sessions"
        known = sorted(p for p in folder.glob(f"{work}-{4 * '[0-9]'}") if p.is_dir())
        for path in reversed(known):
            done = (path / ENDED).is_file() and not ended
            document = None if done else read_document(path)
            if document and document.of == of:
                return cls(path, camera, exposure_s, of)
        number = int(known[-1].name[-4:]) + 1 if known else 1
        return cls(folder / f"{work}-{number:04d}", camera, exposure_s, of)

    def unfinished(self) -> Path | None:
        """The newest folder of this kind of work that has started and not ended, if there is one."""
        kind = self.folder.name[:-4] + 4 * "[0-9]"
        started = (p.parent for p in self.folder.parent.glob(f"{kind}/wanted.json"))
        return max((p for p in started if not (p / ENDED).is_file()), default=None)

    @property
    def asked(self) -> list[Asked]:
        """The photographs of all rounds."""
        return self.document.photographs

    @property
    def last_round(self) -> list[Asked]:
        """The photographs of the last round."""
        return [a for a in self.asked if a.round == self.asked[-1].round]

    def order(self) -> list[OrderRow]:
        """The last round, a row for photographs of one picture at one exposure."""
        return [
            OrderRow(
                picture=of[0].shown,
                projectors=of[0].projectors,
                photographs=len(of),
                exposure_s=of[0].exposure_s,
            )
            for of in (
                list(g) for _, g in groupby(self.last_round, lambda a: (a.shown, a.exposure_s))
            )
        ]

    def find(self, wanted: Wanted, used: Container[str]) -> Asked | None:
        """The first photograph of that picture and exposure that is stored, and not used."""
        stored, exposure_s = self._stored(), self._rounded(wanted.exposure_s)
        right = (a for a in stored if not (a.slate or a.id in used) and a.exposure_s == exposure_s)
        return next((a for a in right if self._shows(a, wanted.pictures)), None)

    def frame(self, asked: Asked) -> Frame:
        """A stored photograph."""
        return self.session.load(self.camera.name, asked.shot, asked.exposure_s, self.camera.size)

    def ask(self, wanted: Sequence[Wanted]) -> PhotographsWanted:
        """Write the wanted photographs as the next round, in place of those not photographed yet."""
        before = self.asked
        self.document.photographs = self._stored()
        number, new = self._next_round(), list[Asked]()
        for each in wanted:
            picture = self._picture_number(each.pictures, [*before, *new])
            asked = Asked(
                id=_name(number, new),
                round=number,
                picture=picture,
                projectors=sorted(each.pictures),
                exposure_s=self._rounded(each.exposure_s),
            )
            if (
                picture
                and picture not in {a.picture for a in new}
                and self._needs_slate(asked, new)
            ):
                self._write(f"{picture:02d}{SLATE}", slate(picture, each.pictures))
                new.append(asked.model_copy(update={"slate": True}))
                asked = asked.model_copy(update={"id": _name(number, new)})
            new.append(asked)
        pending = before[len(self.asked) :]
        if [_content(a) for a in pending] == [_content(a) for a in new]:
            new = pending  # asked for already
        else:
            self.document.rounds, self.document.asked_s = number, time.time()
        self.document.photographs = [*self.asked, *new]
        self.write()
        return PhotographsWanted(self.folder, self.camera.name, self.order())

    def reopen(self) -> None:
        """Ask again for the photographs that were given last, in the place of those and of later ones."""
        stored = self._stored()
        if not stored:
            raise InputError(
                f"{self.folder}: no photographs were given yet that others could replace"
            )
        last, number = stored[-1].round, self._next_round()
        again = [a for a in self.asked if a.round == last]
        new = list[Asked]()
        for each in again:
            new.append(each.model_copy(update={"id": _name(number, new), "round": number}))
        self.document.rounds = number
        self.document.photographs = [*(a for a in stored if a.round != last), *new]

    def _next_round(self) -> int:
        """A number that no photograph has, not even one of a round that was given up."""
        stored = self.session.stored(self.camera.name)
        return max(self.document.rounds, *(_round_of(shot) for shot, _ in stored), 0) + 1

    def write(self) -> None:
        """Write what is asked for to disk."""
        (self.folder / ENDED).unlink(missing_ok=True)
        atomic.write_text(self.folder / "order.csv", order_table(self.camera.name, self.order()))
        atomic.write_text(self.folder / "wanted.json", self.document.model_dump_json(indent=1))

    def end(self) -> None:
        """Note that the workflow has its result."""
        atomic.write_text(self.folder / ENDED, "")

    def _rounded(self, exposure_s: float) -> float:
        """An exposure that cameras have, shorter by less than a third of a stop."""
        white_s = self.document.exposure_s
        thirds = math.floor(3 * math.log2(exposure_s / white_s) + 1e-6)
        return float(f"{white_s * 2 ** (thirds / 3):.4g}")

    def _stored(self) -> list[Asked]:
        slots = self.session.stored(self.camera.name)
        return [a for a in self.asked if (a.id, a.exposure_s) in slots]

    def _picture_number(self, pictures: Pictures, asked: Sequence[Asked]) -> int:
        """Number of a picture, which is written to disk if it is none of those asked for."""
        known = next((a.picture for a in asked if self._shows(a, pictures)), None)
        if known is not None or not pictures:
            return known or 0
        self.document.pictures = number = self.document.pictures + 1
        self._write(f"{number:02d}", {n: pixels(p) for n, p in pictures.items()})
        self._samples[number] = sampled(pictures)
        return number

    def _write(self, shown: str, pixels: Mapping[str, Counts]) -> None:
        for name, each in pixels.items():
            write_image(self._path(shown, name), each)

    def _needs_slate(self, asked: Asked, new: Sequence[Asked]) -> bool:
        """Whether photographs of a picture could pass for others.

        For those of another picture, earlier or in this round, that is alike; or for the same of the
        projectors before, which is known from the first slate of a round.
        """
        others = {a.picture: a for a in [*self.asked, *new] if a.projectors == asked.projectors}
        others.pop(asked.picture, None)
        own = self._samples_of(asked)
        if any(alike(self._samples_of(a), own) for a in others.values()):
            return True
        lit = [a.projectors for a in self.asked if a.picture]
        shines = any(part.any() for part in own.values())
        first = not any(a.slate for a in new)
        return first and shines and bool(lit) and lit[-1] != asked.projectors

    def _shows(self, asked: Asked, pictures: Pictures) -> bool:
        """Whether a photograph is of these pictures."""
        same_projectors = asked.projectors == sorted(pictures)
        return same_projectors and same(self._samples_of(asked), sampled(pictures))

    def _samples_of(self, asked: Asked) -> Samples:
        if asked.picture not in self._samples:
            stored = {n: self._stored_picture(asked.picture, n) for n in asked.projectors}
            self._samples[asked.picture] = sampled(stored)
        return self._samples[asked.picture]

    def _stored_picture(self, number: int, projector: str) -> Array:
        path = self._path(f"{number:02d}", projector)
        if not path.is_file():
            raise FileFormatError(
                f"{path}: this picture of an earlier round is gone; copy the folder pictures back, or "
                f"remove {self.folder} to begin again"
            )
        return np.asarray(read_image(path), float) / TOP

    def _path(self, shown: str, projector: str) -> Path:
        return self.folder / "pictures" / shown / f"{projector}.png"


def _round_of(name: str) -> int:
    found = re.fullmatch(r"round-(\d+)-\d+", name)
    return int(found[1]) if found else 0


def _name(number: int, asked: Sequence[Asked]) -> str:
    """Of the next photograph of a round."""
    return f"round-{number:03d}-{len(asked) + 1:02d}"


def _content(asked: Asked) -> tuple[object, ...]:
    return asked.shown, asked.projectors, asked.exposure_s
