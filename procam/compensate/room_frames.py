"""Compensation of frames on the canvas of a room, with the interface of `Compensator`."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from procam.arrays import AnyArray, Array, Array32, BoolArray, Image
from procam.compensate.content import ContentCodec
from procam.compensate.light_check import LightError
from procam.compensate.perceptual.settings import Perceptual
from procam.compensate.room import RoomCompensator, RoomPicture
from procam.compensate.solved_frame import Certificate, SolvedFrame
from procam.errors import InputError, ShapeError
from procam.maths.light.transfer import Transfer, transfer
from procam.maths.warp import pixel_places, reduced_to, sample
from procam.model.calibration import Calibration
from procam.model.screen import RoomScreen

METHODS = ("exact", "none")
SMALL = 512  # width of the pictures [px] on which larger ones are solved first


@dataclass(frozen=True, slots=True)
class RoomMaps:
    """A calibration's maps of a room at the size of the content, (H, W, 3) and (H, W)."""

    albedo: Image
    lo: Image
    hi: Image
    coverage: Image
    protected: BoolArray

    @classmethod
    def of(cls, calibration: Calibration, screen: RoomScreen, size: int) -> "RoomMaps":
        """Maps for content of that width."""
        maps, shape = calibration.maps, screen.canvas.shape(size)
        place = pixel_places(shape, maps.coverage.shape)
        planes = (maps.albedo, maps.lo, maps.hi, maps.coverage)
        if maps.coverage.shape != shape:
            planes = tuple(sample(plane, place) for plane in planes)  # type: ignore[assignment]
        return cls(*planes, maps.is_protected(place))


class RoomFrames:
    """Compensates frames of one width for the calibration of a room.

    Parameters
    ----------
    calibration, size : of a room; width of the content [px].
    method : "exact" solves (P), docs/theory/compensation.md (C2); "none" clamps.
    state, white : only None and "summed".
    strength, transfer_name : as for `Compensator`.

    Raises
    ------
    InputError
        What is for domes only.
    """

    def __init__(
        self,
        calibration: Calibration,
        size: int,
        method: str | Perceptual = "exact",
        state: str | None = None,
        *,
        strength: float = 1.0,
        white: str = "summed",
        transfer_name: str | None = None,
    ) -> None:
        screen = calibration.screen
        assert isinstance(screen, RoomScreen)
        if method not in METHODS:
            name = method.name if isinstance(method, Perceptual) else method
            raise InputError(
                f"method: {name!r} is for domes; in a room choose {' or '.join(METHODS)}"
            )
        if state is not None or white != "summed":
            raise InputError(
                "venue states and --white keep are for domes; leave them out in a room"
            )
        self.size, self.method, self._shape = size, str(method), screen.canvas.shape(size)
        maps = RoomMaps.of(calibration, screen, size)
        self.protected, self.lit = maps.protected, maps.coverage > 0
        self._room = _compensator(screen, maps, size)
        self._small: RoomCompensator | None = None
        if size > SMALL:
            self._small = _compensator(screen, RoomMaps.of(calibration, screen, SMALL), SMALL)
        known = transfer(transfer_name) if transfer_name else None
        self._codec = ContentCodec(
            known, strength, maps.protected if maps.protected.any() else None
        )

    def restart(self) -> None:
        """Forget the frames before; each is solved alone."""

    def frame(self, image: AnyArray, out: AnyArray | None = None) -> AnyArray:
        """The light to send, encoded as the content is."""
        return self.solve(image, out).sent

    def solve(self, image: AnyArray, out: AnyArray | None = None) -> SolvedFrame:
        """Solve a frame (H, W, 3); see `Compensator.solve`."""
        if image.shape != (*self._shape, 3):
            raise ShapeError("picture", image.shape, f"({self._shape[0]}, {self._shape[1]}, 3)")
        content, coding = self._codec.linear(image)
        content = np.nan_to_num(content, nan=0.0, posinf=0.0, neginf=0.0)
        held, overwritten = (
            self._codec.protected_pixels(image),
            out is not None and np.may_share_memory(image, out),
        )
        picture = self.predict(content, coding.top)
        sent = self._codec.finished(image, picture.direct, coding, out, held)
        certify = None if overwritten else partial(self._certificate, content, picture)
        return SolvedFrame(sent, np.zeros((3, 9)), None, certify)

    def predict(self, image: Image, top: float = np.inf) -> RoomPicture:
        """The picture in linear light and as the audience sees it; `top` is the most that is sent."""
        room = self._room.limited(top)
        if self.method != "exact":
            return room.none(image)
        return room.exact(image, self._near(image, top))

    def _near(self, image: Image, top: float) -> Array32 | None:
        """The irradiance (F, 3) of a smaller picture; None if it is small itself."""
        if self._small is None:
            return None
        rows, columns = self._small.canvas.face.shape
        small = reduced_to(image, (rows, columns))
        return self._small.limited(top).irradiance(small)

    def seen(self, direct: Image) -> Array:
        """Total light (H, W, 3) of direct light that is sent."""
        return np.asarray(self._room.none(direct).observed, float)

    @property
    def limits(self) -> tuple[Image, Image]:
        """Least and most direct light (H, W, 3)."""
        return self._room.limits

    def target(self, image: Image) -> Image:
        """The total light to aim for (H, W, 3)."""
        return np.where(self.lit[..., None], image, np.float32(0))

    def _certificate(self, content: Image, picture: RoomPicture) -> Certificate:
        weight = self._room.canvas.area * self.lit
        lit, free = self.lit[..., None], picture.free
        missed = np.abs(picture.observed - self.target(content))[free]
        brightest = max(float(np.abs(content).max()), 1e-5)
        again = np.abs(self.seen(picture.direct) - picture.observed).max()
        lo, hi = self._room.limits
        exact = self.method == "exact"

        def share(where: BoolArray) -> Array:
            return np.asarray(np.tensordot(weight, (where & lit).astype(float), 2) / weight.sum())

        return Certificate(
            float(missed.max(initial=0.0)) / brightest if exact else float("nan"),
            float(again) / brightest,
            share(picture.direct <= lo),
            share(picture.direct >= hi),
            np.tensordot(weight, content.astype(float), 2),
            np.tensordot(weight, picture.direct.astype(float), 2),
        )


def _compensator(screen: RoomScreen, maps: RoomMaps, size: int) -> RoomCompensator:
    """The compensator of pictures of some width."""
    raster = screen.canvas.raster(size)
    albedo = screen.face_albedo(raster.mean(maps.albedo))
    room = RoomCompensator(raster, screen.factors, albedo, maps.lo, maps.hi)
    return room.with_paint(maps.albedo, maps.protected & (maps.coverage > 0))


class RoomCheck:
    """Checks pictures of one width for the calibration of a room, as `LightCheck` those of a dome.

    All light is summed again over all bounces, from the values alone.
    """

    def __init__(self, calibration: Calibration, size: int) -> None:
        self._frames = RoomFrames(calibration, size, "none")

    def sampled(self, picture: AnyArray) -> AnyArray:
        """The picture (H, W, 3) itself, for every place is compared."""
        return picture

    def of(self, content: Array, values: AnyArray, transfer: Transfer) -> LightError:
        """The error of values (H, W, 3) that were sent for content (H, W, 3) in linear light."""
        whole = values.dtype.kind != "f"
        top = float(np.iinfo(values.dtype).max) if whole else 1.0
        share = np.asarray(values, float) / top
        picture = self._frames.predict(np.asarray(transfer.decode(share), np.float32))
        wanted = content - (picture.observed - picture.direct)
        lo, hi = self._frames.limits
        free = self._frames.lit[..., None] & ~self._frames.protected[..., None]
        free = free & (wanted > lo) & (wanted < (np.minimum(hi, 1.0) if whole else hi))
        if not free.any():
            return LightError(float("nan"), float("nan"), 0.0)
        codes = float("nan")
        if whole:
            asked = np.asarray(transfer.encode(np.clip(wanted, 0, 1)))
            codes = float(top * np.abs(asked - share)[free].max())
        return LightError(float(np.abs(picture.direct - wanted)[free].max()), codes, 0.0)
