"""One frame of any kind through the compensator: encodings in and out, and the row of the report.

The module is longer than 300 lines because what is refused of a frame and what is said of it have one place.
"""

from collections.abc import Callable
from dataclasses import astuple, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from procam.arrays import AnyArray, BoolArray, Map
from procam.compensate.any_screen import AnyCompensator, compensator_for
from procam.compensate.compensator import Compensator
from procam.compensate.light_check import LightCheck
from procam.compensate.perceptual.settings import PERCEPTUAL, Perceptual
from procam.compensate.solved_frame import SolvedFrame
from procam.errors import FileFormatError, InputError
from procam.files.calibration import metered_white
from procam.files.images.stills import square_edge
from procam.kernels.native.arrays import least_colour
from procam.maths.geometry.canvas import STANDARD
from procam.maths.light.transfer import TRANSFER_NAMES, transfer
from procam.model.calibration import Calibration
from procam.model.screen import Dome
from procam.model.transport import ScreenMaps
from procam.workflows.playout.chunks import EXACT, VIDEO, ChunkedCompensator, Chunks
from procam.workflows.playout.encodings import decoded, output_encoding, recoded
from procam.workflows.playout.sources import ClipFrame, CompensatedFrame, Row

if TYPE_CHECKING:
    from procam.compensate.room_frames import RoomCheck

COLOURS = "rgb"
ERRORS = ("error", "error_codes", "error_sigma")  # columns of `LightError` in the report
UNCHECKED: Row = {"checked": "", **dict.fromkeys(ERRORS, float("nan"))}
MEASURED = ("scatter_per_flux", "lo", "hi")  # maps that measured light makes
ROUNDING = 1e-3  # of a coverage: half floats


@dataclass(frozen=True, slots=True)
class FrameSettings:
    """Settings of a run, as `Compensator` takes them; `db` and `white_nits` as `Perceptual` does."""

    method: str = "exact"
    state: str | None = None
    strength: float = 1.0
    white: str = "summed"
    transfer: str | None = None
    db: float | None = None
    white_nits: float | None = None

    @property
    def chunks(self) -> Chunks:
        """How a clip is split: a movie's pictures depend on those before them."""
        return VIDEO if self.method in PERCEPTUAL and PERCEPTUAL[self.method].video else EXACT

    def at(self, calibration_dir: Path) -> "FrameSettings":
        """The settings with the white that a hand meter has read there, if none is stated.

        It is the white of "summed"; content of another white is brighter, by how much is not known yet.
        """
        stated = self.white_nits is not None or self.white != "summed"
        if stated or self.method not in PERCEPTUAL:
            return self
        return replace(self, white_nits=metered_white(calibration_dir))

    def checked_method(self) -> str | Perceptual:
        """The method with the settings of its own; refuses them for one that has none."""
        own = {"--db": self.db, "--white-nits": self.white_nits}
        given = [option for option, value in own.items() if value is not None]
        if given and self.method not in PERCEPTUAL:
            raise InputError(
                f"{' and '.join(given)}: for --method {' or '.join(PERCEPTUAL)}, not {self.method}; "
                "choose one of these or leave it out"
            )
        return self.of(self.method)

    def of(self, method: str) -> str | Perceptual:
        """Another method, with the settings of its own."""
        if method not in PERCEPTUAL:
            return method
        usual = PERCEPTUAL[method]
        return Perceptual(
            usual.db if self.db is None else self.db,
            usual.white_nits if self.white_nits is None else self.white_nits,
            usual.video,
        )


class ClipEngine:
    """Compensates the frames of a clip, which are all of the first one's size.

    Parameters
    ----------
    calibration : of the dome. settings : method, state, strength, white and transfer function.
    suffix : of the pictures that will be written; EXR takes linear light, and PNG takes none.
    certify : add the certificate to each row, at the cost of a few evaluations; without it a frame is
        compensated in place. chunks : of the clip, if not those of the settings.
    """

    def __init__(
        self,
        calibration: Calibration,
        settings: FrameSettings,
        suffix: str,
        certify: bool = True,
        chunks: Chunks | None = None,
    ) -> None:
        require_photometry(calibration)
        self._calibration, self._settings, self._suffix = calibration, settings, suffix
        self._certify = certify
        self._chunks = ChunkedCompensator(self._compensator, chunks or settings.chunks)
        self._like: tuple[int, np.dtype[Any], str] | None = None  # size and encoding of the first

    def make(self, clip_frame: ClipFrame) -> CompensatedFrame | None:
        """Compensate a frame; None of one that only precedes those that are wanted."""
        named = named_transfer(clip_frame, self._settings)
        dtype, out = output_encoding(clip_frame.rgb.dtype, named, self._suffix)
        rgb = recoded(clip_frame.rgb, named, dtype, out)
        self._require_alike(clip_frame, dtype, out)
        row: Row = {"frame": clip_frame.number, "above_one": clip_frame.above_one}
        if not (self._certify and clip_frame.wanted):
            sent = self._chunks.solve(clip_frame.number, rgb, rgb).sent
            return CompensatedFrame(sent, out, row, _unchecked) if clip_frame.wanted else None
        solved = self._chunks.solve(clip_frame.number, rgb)
        row |= _worth(solved, self._settings.method) | UNCHECKED
        check = self._check(clip_frame, solved, named, out, row)
        return CompensatedFrame(solved.sent, out, row, check)

    def _check(
        self, clip_frame: ClipFrame, solved: SolvedFrame, named: str, out: str, row: Row
    ) -> Callable[[ClipFrame, str], None]:
        """What completes the row of a frame with what its values, read back, make the audience see.

        Values are decoded as the file states, or by the function that the user named for both.
        """
        light_check = self._light_check
        content = decoded(light_check.sampled(clip_frame.rgb), named).astype(float)
        if solved.chosen is not None:
            content = light_check.sampled(solved.chosen).astype(float)

        def check(written: ClipFrame, covers: str) -> None:
            name = (None if self._settings.transfer else written.transfer) or out
            values = light_check.sampled(written.rgb)
            found = light_check.of(content, values, transfer(name))
            row.update(zip(ERRORS, astuple(found), strict=True), checked=covers)

        return check

    @cached_property
    def _light_check(self) -> "LightCheck | RoomCheck":
        first = self._chunks.first
        if not isinstance(first, Compensator):
            from procam.compensate.room_frames import RoomCheck  # noqa: PLC0415 - SciPy

            return RoomCheck(self._calibration, first.size)
        gain = first.fields.shown.gain
        return LightCheck(self._calibration, first.size, self._settings.state, gain)

    def _require_alike(self, clip_frame: ClipFrame, dtype: np.dtype[Any], out: str) -> None:
        """Refuse a frame whose size or encoding is not the first one's."""
        size = canvas_size(clip_frame.rgb, clip_frame.name, self._calibration)
        self._like = first_size, *encoding = self._like or (size, dtype, out)
        if size != first_size:
            raise FileFormatError(
                f"{clip_frame.name}: {size} px, but the first frame has {first_size}; "
                "render all frames in one size"
            )
        if [dtype, out] != encoding:
            raise FileFormatError(
                f"{clip_frame.name}: {clip_frame.rgb.dtype} pixels in {out}, but the first frame has "
                f"{encoding[0]} in {encoding[1]}; render all frames alike"
            )

    def _compensator(self) -> AnyCompensator:
        assert self._like is not None
        settings, (size, _, out) = self._settings, self._like
        return compensator_for(self._calibration)(
            self._calibration,
            size,
            settings.checked_method(),
            settings.state,
            strength=settings.strength,
            white=settings.white,
            transfer_name=out,
        )


def canvas_size(picture: AnyArray, name: str, calibration: Calibration) -> int:
    """Width [px] of a picture (H, W, 3); refuses one that has not the aspect of the calibration's canvas."""
    if isinstance(calibration.screen, Dome):
        return square_edge(picture, name)
    rows, columns = picture.shape[:2]
    needed = calibration.canvas.shape(columns)[0]
    if rows != needed:
        width_m, height_m = calibration.screen.room.size_m
        raise FileFormatError(
            f"{name}: {columns}x{rows} px, and the canvas of this room is {width_m:g} x "
            f"{height_m:g} m; make it {columns}x{needed} (`procam venue canvas` draws what lies where)"
        )
    return columns


def linear_compensator(
    calibration: Calibration, size: int, settings: FrameSettings, method: str | Perceptual
) -> AnyCompensator:
    """A compensator for pictures in linear light, in full whatever the strength."""
    return compensator_for(calibration)(
        calibration,
        size,
        method,
        settings.state,
        white=settings.white,
        transfer_name="linear",
    )


def most_light(rgb: AnyArray) -> float:
    """The most that pictures of a type send [rel]: integers end at 1."""
    return float("inf") if rgb.dtype.kind == "f" else 1.0


def require_standard_canvas(calibration: Calibration, what: str, instead: str) -> None:
    """Refuse `what` where the media server is fed with other masters than the standard ones."""
    if not isinstance(calibration.screen, Dome):
        return
    canvas = calibration.dome_canvas
    if canvas != STANDARD:
        raise InputError(
            f"{what} is for dome masters of 180 degrees with the front at the bottom edge, and the server's "
            f"span {np.degrees(canvas.fov):g} degrees with azimuth {np.degrees(canvas.rotation):g} there; "
            f"{instead}"
        )


def require_photometry(calibration: Calibration) -> None:
    """Refuse a calibration in which no place of the dome has light that was measured, or a map is broken."""
    maps = calibration.maps
    if not any(
        _measured(*row) for row in zip(maps.coverage, maps.hi, maps.scatter_per_flux, strict=True)
    ):
        raise InputError(
            "CALIBRATION has no photometry, which compensation needs; capture white, black and "
            "response pictures of every projector and solve again"
        )
    for name, (right, otherwise) in _right_places(maps).items():
        if not right.all():
            wrong = np.count_nonzero(~(right if right.ndim == 2 else least_colour(right)))
            raise InputError(
                f"CALIBRATION is damaged: {wrong} places of its map {name} are {otherwise}; "
                "restore it or run `procam session solve` on its session again"
            )


def _measured(coverage: Map, hi: Map, scatter: Map) -> bool:
    """Whether a row of the maps has a lit place whose light was measured."""
    return bool(((coverage > 0) & least_colour((hi > 0) & np.isfinite(scatter))).any())


def _right_places(maps: ScreenMaps) -> dict[str, tuple[BoolArray, str]]:
    """Where (N, N[, 3]) each map is as calibrations make it, and what the others are.

    Unlit places count where interpolation would carry what is wrong to lit ones.
    """
    within = (maps.coverage >= 0) & (maps.coverage <= 1 + ROUNDING)
    found = {"coverage": (within, "below 0, above 1 or NaN")}
    for name in MEASURED:
        found[name] = (np.isfinite(getattr(maps, name)), "NaN or infinite")
    if maps.falloff is not None:
        usable = (maps.coverage <= 0) | (maps.falloff > 0)
        found["falloff"] = (np.isfinite(maps.falloff) & usable, "0 or less, NaN or infinite")
    return found


def named_transfer(clip_frame: ClipFrame, settings: FrameSettings) -> str:
    """The transfer function of a frame; refuses one without a name."""
    named = settings.transfer or clip_frame.transfer
    if named is None:
        stated = f" (its file says {clip_frame.stated})" if clip_frame.stated else ""
        raise InputError(
            f"{clip_frame.name}: no transfer function that procam knows{stated}; give one with --transfer: "
            f"{', '.join(TRANSFER_NAMES)}"
        )
    transfer(named)
    if clip_frame.converted and named != clip_frame.transfer:
        raise InputError(
            f"{clip_frame.name}: its colour profile was converted to {clip_frame.transfer}, but "
            f"--transfer is {named}; leave --transfer out, or remove the profile"
        )
    return named


def _unchecked(written: ClipFrame, covers: str) -> None:
    """No certificate was asked for."""


def _worth(solved: SolvedFrame, method: str) -> dict[str, float]:
    """The certificate of a frame, for the report."""
    found = solved.certificate
    row: dict[str, float] = {}
    columns = {
        "share_lo": found.share_lo,
        "share_hi": found.share_hi,
        "flux_in": found.flux_in,
        "flux_out": found.flux_out,
        "s": solved.coefficients[:, 0],
    }
    for name, values in columns.items():
        row |= {f"{name}_{c}": float(v) for c, v in zip(COLOURS, values, strict=True)}
    row |= {"kkt": float(found.kkt), "self_consistency": float(found.self_consistency)}
    if method in PERCEPTUAL:
        row |= {"from_exact": found.from_exact, "luminance_loss_db": found.luminance_loss_db}
    return row
