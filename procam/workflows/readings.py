"""Radiance of a session's shots, one at a time, straight from the stored captures."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.errors import FileFormatError
from procam.estimate.decode import CodePair
from procam.estimate.patterns import SEPARATION_BITS
from procam.estimate.radiance import Radiometer
from procam.files.session import Session
from procam.model.plan import Plan, Purpose, Shot

Image = NDArray[np.float32]
GREEN = 1


@dataclass(frozen=True)
class Readings:
    """Stored shots of one camera, turned into radiance."""

    session: Session
    plan: Plan
    radiometer: Radiometer

    def light(self, shot: Shot, exposure: int = 0) -> Image:
        """Radiance (H, W) or (H, W, 3) of a shot at its first or another exposure."""
        camera = self.radiometer.camera
        frame = self.session.load(camera.name, shot, shot.exposures_s[exposure], camera.size)
        return self.radiometer.radiance(frame)

    def only(self, projector: str, purpose: Purpose) -> Shot:
        """The one shot of its kind."""
        shots = self.plan.of(projector, purpose)
        if len(shots) != 1:
            raise FileFormatError(
                f"{self.session.directory / 'plan.json'}: got {len(shots)} shots {purpose!r} of "
                f"projector {projector or '(none)'}, expected one"
            )
        return shots[0]

    def dark(self) -> tuple[Image, Image]:
        """Room light (H, W, 3) with everything shuttered, at the two exposures of the plan."""
        shot = self.only("", "dark")
        return self.light(shot, 0), self.light(shot, 1)

    def code_pairs(self, projector: str) -> Iterator[CodePair]:
        """Stripe pictures with their inverses, green, in the plan's order."""
        for pattern, inverse in self._pairs(projector):
            yield CodePair(
                str(pattern.detail["axis"]),
                int(pattern.detail["bit"]),
                _green(self.light(pattern)),
                _green(self.light(inverse)),
            )

    def colour_pairs(self, projector: str) -> Iterator[tuple[str, int, Image, Image]]:
        """(axis, bit, pattern, inverse) of the pairs taken in colour."""
        for pattern, inverse in self._pairs(projector):
            if pattern.pixel_format == "rgb" and pattern.detail["bit"] in SEPARATION_BITS:
                yield (
                    str(pattern.detail["axis"]),
                    int(pattern.detail["bit"]),
                    self.light(pattern),
                    self.light(inverse),
                )

    def _pairs(self, projector: str) -> Iterator[tuple[Shot, Shot]]:
        shots = self.plan.of(projector, "code")
        for pattern, inverse in zip(shots[::2], shots[1::2], strict=True):
            same = all(pattern.detail[k] == inverse.detail[k] for k in ("axis", "bit"))
            if not same or (pattern.detail["inverse"], inverse.detail["inverse"]) != (0, 1):
                raise FileFormatError(
                    f"{self.session.directory / 'plan.json'}: shots {pattern.id} and {inverse.id} "
                    "are no pattern and inverse, expected pairs in order"
                )
            yield pattern, inverse


def _green(light: Image) -> Image:
    return light if light.ndim == 2 else light[..., GREEN]
