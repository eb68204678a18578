"""Measurements of projectors whose pictures lie in a file, so that memory does not grow with their number."""

from collections.abc import Iterator, MutableMapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryFile
from typing import Self

import numpy as np

from procam.arrays import Image
from procam.estimate.light.measurement import ProjectorMeasurement

NOTHING = np.zeros((0, 0, 3), np.float32)


@dataclass(frozen=True, slots=True)
class _Kept:
    """A measurement without its pictures, where these start in the file, and their shape."""

    rest: ProjectorMeasurement
    starts: list[int]
    shape: tuple[int, ...]


class MeasurementsOnDisk(MutableMapping[str, ProjectorMeasurement]):
    """Measurements by projector; whenever one is read, its pictures are mapped into memory anew.

    A context manager, at whose end the file goes.

    `folder` must have room for them. The file has no name there, so a process that is killed leaves
    nothing behind.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._file = TemporaryFile(dir=folder)
        self._kept: dict[str, _Kept] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._file.close()

    def __setitem__(self, name: str, measured: ProjectorMeasurement) -> None:
        light = measured.light
        pictures = (light.direct, light.scattered, measured.black)
        rest = replace(light, direct=NOTHING, scattered=NOTHING)
        starts = [self._written(picture) for picture in pictures]
        self._kept[name] = _Kept(
            replace(measured, light=rest, black=NOTHING), starts, measured.black.shape
        )

    def __getitem__(self, name: str) -> ProjectorMeasurement:
        kept = self._kept[name]
        direct, scattered, black = (
            np.memmap(self._file, np.float32, "r", start, kept.shape) for start in kept.starts
        )
        light = replace(kept.rest.light, direct=direct, scattered=scattered)
        return replace(kept.rest, light=light, black=black)

    def __delitem__(self, name: str) -> None:
        del self._kept[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._kept)

    def __len__(self) -> int:
        return len(self._kept)

    def _written(self, picture: Image) -> int:
        """Append a picture (H, W, 3) to the file; where it starts."""
        try:
            start = self._file.seek(0, 2)
            self._file.write(np.ascontiguousarray(picture, np.float32).data)
            self._file.flush()
        except OSError as error:  # the file has no name that a message could have
            raise OSError(error.errno, error.strerror, str(self._folder)) from error
        return start
