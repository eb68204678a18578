"""The pictures of a preference test: 8-bit sRGB under names that do not give their method."""

import hashlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from procam.arrays import AnyArray, Image
from procam.files.images.pixels import write_image
from procam.files.images.stills import square_edge
from procam.maths.codes.dither import dithered
from procam.maths.light.curves import srgb_encode
from procam.maths.warp import reduced_to
from procam.model.calibration import Calibration
from procam.workflows.playout.encodings import decoded
from procam.workflows.playout.frame import (
    linear_compensator,
    most_light,
    named_transfer,
)
from procam.workflows.playout.sources import ClipFrame
from studies.preference.plan import PICTURES, Content, Picture
from studies.preference.wanted import Wanted

MOST_ON_MONITOR = 1024  # px; more does not fit beside the controls of a usual screen
NAME_LETTERS, WHITE_CODE = 12, 255


class PictureMaker:
    """Writes the pictures of one content after another.

    Parameters
    ----------
    calibration : of the dome. wanted : what is asked about.
    key : from which file names are made. folder : of the test.

    Attributes
    ----------
    contents, pictures : what was written so far, pictures by file name. notes : for people.
    """

    def __init__(self, calibration: Calibration, wanted: Wanted, key: str, folder: Path) -> None:
        self._calibration, self._wanted, self._key, self._folder = calibration, wanted, key, folder
        self.contents, self.pictures, self.notes = (
            list[Content](),
            dict[str, Picture](),
            list[str](),
        )

    def make(self, name: str, source: Path, clip_frame: ClipFrame) -> Iterator[str]:
        """Write the pictures of a content; yields what each is."""
        lights, scale = self._lights(clip_frame), 1.0
        if not self._wanted.on_dome:
            held = list(lights)
            # one factor for all methods: a monitor cannot be brighter than white, a dome can
            scale = 1 / max(1.0, *(float(light.max()) for _, light in held))
            lights = iter(held)
        codes, size = dict[str, str](), 0
        for method, light in lights:
            pixels, size = eight_bits(light * np.float32(scale)), light.shape[0]
            file = self._file(name, method)
            write_image(self._folder / PICTURES / file, pixels)
            self.pictures[file] = Picture(content=name, method=method)
            codes[method] = hashlib.sha256(pixels.tobytes()).hexdigest()
            self._note_clipped(f"{name}, {method}", light * np.float32(scale))
            yield f"{name}, {method}"
        self.contents.append(Content(name=name, source=source.name, size_px=size, scale=scale))
        self._note_equal(name, codes)

    def _lights(self, clip_frame: ClipFrame) -> Iterator[tuple[str, Image]]:
        """Method and linear light (N, N, 3) to show."""
        settings = self._wanted.settings
        size = square_edge(clip_frame.rgb, clip_frame.name)
        content = decoded(clip_frame.rgb, named_transfer(clip_frame, settings))
        content = np.nan_to_num(content, nan=0, posinf=0, neginf=0)
        for method in self._wanted.needed:
            own = settings.of(method)
            compensator = linear_compensator(self._calibration, size, settings, own)
            solved = compensator.predict(content, most_light(clip_frame.rgb))
            yield method, solved.direct if self._wanted.on_dome else for_monitor(solved.observed)

    def _file(self, name: str, method: str) -> str:
        letters = hashlib.sha256(f"{self._key} {name} {method}".encode()).hexdigest()
        return f"{letters[:NAME_LETTERS]}.png"

    def _note_clipped(self, what: str, light: Image) -> None:
        beyond = int((light > 1 + 0.5 / WHITE_CODE).any(axis=-1).sum())
        if beyond:
            self.notes.append(
                f"{what}: {beyond} pixels ask for more than 1.0, which 8 bits do not hold; they are sent 1.0"
            )

    def _note_equal(self, name: str, codes: dict[str, str]) -> None:
        """People can only guess between equal pictures, which would hide a preference for others."""
        for first, second in self._wanted.pairs:
            if codes[first] == codes[second]:
                self.notes.append(
                    f"{name}: {first} and {second} give the same picture, so answers are guesses; leave "
                    "it out"
                )


def for_monitor(light: Image) -> Image:
    """Light (N, N, 3) as it fits a monitor: means over pixels where it is larger."""
    if light.shape[0] <= MOST_ON_MONITOR:
        return light
    return reduced_to(light, (MOST_ON_MONITOR, MOST_ON_MONITOR))


def eight_bits(light: Image) -> AnyArray:
    """Linear light (N, N, 3) as sRGB codes, dithered: bands in the dark would be what people compare."""
    encoded = np.asarray(srgb_encode(np.clip(light, 0, 1)), np.float32)
    return dithered(encoded * np.float32(WHITE_CODE))
