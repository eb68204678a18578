"""Radiance of a session's shots, one at a time, straight from the stored captures."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Image
from procam.errors import FileFormatError
from procam.estimate.camera.radiance import Radiometer
from procam.files.session import Session
from procam.model.frame import Frame
from procam.model.plan import Plan, Purpose, Shot
from procam.workflows.capture.by_hand import PREFIX
from procam.workflows.capture.capture import check_range, missing_shots

Counts = NDArray[np.uint16]
GREEN = 1
LONG = {"dark": 1, "black": 0, "dim": 1}  # which exposure is black's
CUT_OFF = 0.01  # of the pixels at 0: their noise raises the mean by 1/300 of its sigma
SHOWN = 5  # missing shots that a line names


@dataclass(frozen=True)
class SessionImages:
    """Stored shots of one camera, turned into radiance.

    `long_exposure` is the true duration of black's exposure over the stated one (`solve.long_exposure`).
    """

    session: Session
    plan: Plan
    radiometer: Radiometer
    long_exposure: float = 1.0

    @property
    def were_encoded(self) -> bool:
        """Whether the counts were decoded from photographs of a tone curve, as JPEG has."""
        return self.session.bits(self.radiometer.camera.name) is not None

    def light(self, shot: Shot, exposure: int = 0) -> Image:
        """Radiance (H, W) or (H, W, 3) of a shot at its first or another exposure."""
        light = self.radiometer.radiance(self._frame(shot, exposure))
        is_long = LONG.get(shot.purpose) == exposure
        return light / np.float32(self.long_exposure) if is_long else light

    def dim(self) -> Shot | None:
        """The dim picture at the end of a session; None if the plan has none or it was not photographed."""
        stored = self.session.stored(self.radiometer.camera.name)
        shots = (shot for shot in self.plan.shots if shot.purpose == "dim")
        return next((s for s in shots if all((s.id, e) in stored for e in s.exposures_s)), None)

    def _frame(self, shot: Shot, exposure: int) -> Frame:
        camera, exposure_s = self.radiometer.photographed, shot.exposures_s[exposure]
        by_hand = self.session.directory.name.startswith(PREFIX)
        if by_hand and (shot.id, exposure_s) not in self.session.stored(camera.name):
            raise FileFormatError(self._not_photographed())
        frame = self.session.load(camera.name, shot, exposure_s, camera.size)
        if shot.purpose == "white":
            check_range(shot, frame, camera.sensor)
        return frame

    def _not_photographed(self) -> str:
        """Message on pictures of this camera that a session by hand lacks: `capture` cannot retake them."""
        camera = self.radiometer.camera.name
        missing = [shot.id for shot in missing_shots(self.session, self.plan, [camera])]
        more = f" and {len(missing) - SHOWN} more" if len(missing) > SHOWN else ""
        return (
            f"{self.session.directory}: no photographs by camera {camera} of "
            f"{', '.join(missing[:SHOWN])}{more}, and all {len(self.plan.shots)} shots are needed; "
            "photograph them and `procam session add` again: it adds only what is missing"
        )

    def only(self, projector: str, purpose: Purpose) -> Shot:
        """The one shot of its kind."""
        shots = self.plan.of(projector, purpose)
        if len(shots) != 1:
            raise FileFormatError(
                f"{self.session.directory / 'plan.json'}: {len(shots)} shots {purpose!r} of projector "
                f"{projector or '(none)'} instead of one; restore the file"
            )
        return shots[0]

    def dark(self, projector: str = "") -> tuple[Image, Image]:
        """Room light (H, W, 3) with everything shuttered, at the two exposures of the plan.

        Of a projector that was photographed again, the dark of that time.
        Noise that is cut off at 0, as in photographs that a camera encodes, leaves a mean that is too
        high. The long exposure, of more light, then counts for both.
        """
        shot = self.only(projector if self.plan.of(projector, "dark") else "", "dark")
        short, long = self.light(shot, 0), self.light(shot, 1)
        if float(self.at_zero(shot)[self.radiometer.seen].mean()) > CUT_OFF:
            short = np.where(np.isnan(long), short, long)
        return short, long

    def code(self, projector: str) -> tuple[str, Iterator[tuple[int, Counts]]]:
        """Name of the code shown, and green counts of its pictures by number: white, black, planes."""
        shots = self.plan.of(projector, "code")
        names = {str(shot.detail["code"]) for shot in shots}
        if len(names) != 1:
            raise FileFormatError(
                f"{self.session.directory / 'plan.json'}: codes {sorted(names)} for projector "
                f"{projector} instead of one; restore the file"
            )
        return names.pop(), self._code_pictures(projector, shots)

    def _code_pictures(self, projector: str, shots: list[Shot]) -> Iterator[tuple[int, Counts]]:
        yield from enumerate(self.white_and_black(projector))
        for shot in shots:
            yield int(shot.detail["plane"]), self.counts(shot)

    def step(self, projector: str) -> float:
        """Radiance of a step of a projector's white: a count, or less where pixels are joined."""
        exposure_s = self.only(projector, "white").exposures_s[0]
        steps = self.radiometer.camera.sensor.full_scale * self.radiometer.binning.factor
        return 1 / (steps * exposure_s)

    def white_and_black(self, projector: str) -> tuple[Counts, Counts]:
        """Green counts (H, W) of white, and of black as if exposed like it [DN]."""
        white = self._frame(self.only(projector, "white"), 0)
        black = self._frame(self.only(projector, "black"), 0)
        return _green(white), self._exposed_as(white, black)

    def stripe_counts(self, projector: str) -> Iterator[tuple[Counts, Counts]]:
        """Green counts (H, W) of each stripe pattern for the separation, and of its inverse [DN]."""
        for _, _, pattern, inverse in self.stripes(projector):
            yield self.counts(pattern), self.counts(inverse)

    def counts(self, shot: Shot, exposure: int = 0) -> Counts:
        """Green counts (H, W) of a photograph, at its first or another exposure, no pixels joined [DN]."""
        return _green(self._frame(shot, exposure))

    def at_zero(self, shot: Shot, exposure: int = 0) -> Image:
        """Share (H, W) of the green counts that are 0, of each pixel of the radiance."""
        return self.radiometer.binning.means(self.counts(shot, exposure) == 0)

    def _exposed_as(self, wanted: Frame, frame: Frame) -> Counts:
        """Green counts of a frame as if exposed like `wanted`: black is photographed long."""
        level = self.radiometer.camera.sensor.black_level
        ratio = wanted.settings.exposure_s / frame.settings.exposure_s
        counts = _green(frame).astype(np.float32)
        counts -= np.float32(level)
        counts *= np.float32(ratio)
        counts += np.float32(level)
        return np.maximum(np.rint(counts, out=counts), 0).astype(np.uint16)

    def stripe_pairs(self, projector: str) -> Iterator[tuple[str, int, Image, Image]]:
        """(axis, bit, pattern, inverse) of the stripes for the separation."""
        for axis, bit, pattern, inverse in self.stripes(projector):
            yield axis, bit, self.light(pattern), self.light(inverse)

    def stripes(self, projector: str) -> Iterator[tuple[str, int, Shot, Shot]]:
        """(axis, bit, shot of the pattern, shot of its inverse) of the stripes."""
        shots = self.plan.of(projector, "stripes")
        for pattern, inverse in zip(shots[::2], shots[1::2], strict=True):
            same = all(pattern.detail[k] == inverse.detail[k] for k in ("axis", "bit"))
            if not same or (pattern.detail["inverse"], inverse.detail["inverse"]) != (0, 1):
                raise FileFormatError(
                    f"{self.session.directory / 'plan.json'}: shots {pattern.id} and {inverse.id} "
                    "are not a pattern and its inverse; restore the file"
                )
            yield str(pattern.detail["axis"]), int(pattern.detail["bit"]), pattern, inverse


def _green(frame: Frame) -> Counts:
    """Green counts (H, W) on their own; a view would keep all of (H, W, 3)."""
    return frame.counts if frame.counts.ndim == 2 else frame.counts[..., GREEN].copy()
