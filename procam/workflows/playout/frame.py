"""One frame of any kind through the compensator: encodings in and out, and what a report says of it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.compensate.compensator import Compensator
from procam.errors import FileFormatError, InputError
from procam.kernels.native.arrays import least_colour
from procam.maths.light.transfer import TRANSFER_NAMES, transfer
from procam.model.calibration import Calibration
from procam.model.transport import DomeMaps
from procam.workflows.playout.sources import ClipFrame

Pixels = NDArray[Any]
COLOURS = "rgb"
MEASURED = ("scatter_per_flux", "lo", "hi")  # maps that measured light makes
ROUNDING = 1e-3  # of a coverage: half floats


@dataclass(frozen=True, slots=True)
class FrameSettings:
    """Settings of a run, as `Compensator` takes them."""

    method: str = "exact"
    state: str | None = None
    strength: float = 1.0
    white: str = "summed"
    transfer: str | None = None


@dataclass(frozen=True, slots=True)
class CompensatedFrame:
    """A frame that is made: encoded colours (N, N, 3), their transfer function, the report's row."""

    rgb: Pixels
    transfer: str
    row: dict[str, Any]


class ClipEngine:
    """Compensates the frames of a clip, which are all of the first one's size.

    Parameters
    ----------
    calibration, how : what to compensate, and how.
    suffix : of the pictures that will be written; EXR takes linear light, and PNG takes none.
    certify : say in the rows what each frame is worth, which costs a few looks at it; without, a frame
        is made in place.
    """

    def __init__(
        self, calibration: Calibration, how: FrameSettings, suffix: str, certify: bool = True
    ) -> None:
        require_photometry(calibration)
        self._calibration, self._how, self._suffix = calibration, how, suffix
        self._certify = certify
        self._compensator: Compensator | None = None
        self._encoding: tuple[np.dtype[Any], str] | None = None

    def make(self, piece: ClipFrame) -> CompensatedFrame:
        """Compensate a frame."""
        named = named_transfer(piece, self._how)
        dtype, out = output_encoding(piece.rgb.dtype, named, self._suffix)
        rgb = recoded(piece.rgb, named, dtype, out)
        compensator = self._for(piece, dtype, out)
        row: dict[str, Any] = {"frame": piece.number, "above_one": piece.above_one}
        if not self._certify:
            return CompensatedFrame(compensator.frame(rgb, rgb), out, row)
        made = compensator.frame(rgb)
        return CompensatedFrame(made, out, row | _worth(compensator))

    def _for(self, piece: ClipFrame, dtype: np.dtype[Any], out: str) -> Compensator:
        size = square_edge(piece)
        if self._compensator is None or self._encoding is None:
            how = self._how
            self._compensator = Compensator(
                self._calibration,
                size,
                how.method,
                how.state,
                strength=how.strength,
                white=how.white,
                transfer_name=out,
            )
            self._encoding = (dtype, out)
        if size != self._compensator.size:
            raise FileFormatError(
                f"{piece.name}: got {size}x{size} px, expected {self._compensator.size} as the first "
                "frame has; render all frames in one size"
            )
        if (dtype, out) != self._encoding:
            raise FileFormatError(
                f"{piece.name}: got {piece.rgb.dtype} pixels in {out}, expected "
                f"{self._encoding[0]} in {self._encoding[1]} as the first frame has"
            )
        return self._compensator


def require_photometry(calibration: Calibration) -> None:
    """Refuse a calibration in which no place of the dome has light that was measured, or a map is broken."""
    maps = calibration.maps
    measured = least_colour((maps.hi > 0) & np.isfinite(maps.scatter_per_flux))
    if not ((maps.coverage > 0) & measured).any():
        raise InputError(
            "CALIBRATION: got no photometry, expected the light of every projector; capture and "
            "solve it with white, black and response pictures"
        )
    for name, (wrong, said) in _wrong_places(maps).items():
        if wrong.any():
            raise InputError(
                f"CALIBRATION: got {int(wrong.sum())} places of its map {name} that are {said}, expected "
                "none; restore it or run `procam solve` on its session again"
            )


def _wrong_places(maps: DomeMaps) -> dict[str, tuple[NDArray[np.bool_], str]]:
    """Where (N, N) each map is what no calibration makes it, and what that is.

    Unlit places count where interpolation would carry what is wrong to lit ones.
    """
    within = (maps.coverage >= 0) & (maps.coverage <= 1 + ROUNDING)
    found = {"coverage": (~within, "below 0, above 1 or NaN")}
    for name in MEASURED:
        found[name] = (~least_colour(np.isfinite(getattr(maps, name))), "NaN or infinite")
    if maps.falloff is not None:
        finite, lit = np.isfinite(maps.falloff), maps.coverage > 0
        found["falloff"] = (~finite | (lit & (maps.falloff <= 0)), "0 or less, NaN or infinite")
    return found


def named_transfer(piece: ClipFrame, how: FrameSettings) -> str:
    """The transfer function of a frame; refuses one without a name."""
    named = how.transfer or piece.transfer
    if named is None:
        said = f" (its file says {piece.said})" if piece.said else ""
        raise InputError(
            f"{piece.name}: got no transfer function that procam knows{said}, expected one of "
            f"{', '.join(TRANSFER_NAMES)}; name it with --transfer"
        )
    transfer(named)
    return named


def square_edge(piece: ClipFrame) -> int:
    """Edge [px] of a dome master; refuses what is not square."""
    height, width = piece.rgb.shape[:2]
    if height != width:
        raise FileFormatError(
            f"{piece.name}: got {width}x{height} px, expected a square dome master; crop or pad it"
        )
    return height


def output_encoding(dtype: np.dtype[Any], named: str, suffix: str) -> tuple[np.dtype[Any], str]:
    """Type and transfer function of what is made of pixels of a type, encoded as `named`.

    As they came, but EXR takes light (from integers: linear float) and PNG takes integers (from
    linear light: 16-bit sRGB).

    >>> output_encoding(np.dtype(np.uint8), "srgb", ".exr")
    (dtype('float32'), 'linear')
    """
    if suffix == ".exr" and dtype.kind != "f":
        return np.dtype(np.float32), "linear"
    if suffix == ".png" and dtype.kind == "f":
        return np.dtype(np.uint16), "srgb" if named == "linear" else named
    return dtype, named


def recoded(rgb: Pixels, named: str, dtype: np.dtype[Any], out: str) -> Pixels:
    """Encoded colours in another type and transfer function; integers clip at 1."""
    if rgb.dtype == dtype and named == out:
        return rgb
    light = decoded(rgb, named)
    encoded = light if out == "linear" else transfer(out).encode(np.clip(light, 0, 1))
    if dtype.kind == "f":
        return np.asarray(encoded, dtype)
    top = np.iinfo(dtype).max
    return np.rint(np.clip(encoded, 0, 1) * np.float32(top)).astype(dtype)


def decoded(rgb: Pixels, named: str) -> NDArray[np.float32]:
    """Linear light (N, N, 3) of encoded colours."""
    peak = 1 if rgb.dtype.kind == "f" else np.iinfo(rgb.dtype).max
    share = np.asarray(rgb, np.float32) / np.float32(peak)
    return share if named == "linear" else np.asarray(transfer(named).decode(share), np.float32)


def _worth(compensator: Compensator) -> dict[str, float]:
    """What a report says of the last frame."""
    found = compensator.certificate
    row: dict[str, float] = {}
    columns = {
        "share_lo": found.share_lo,
        "share_hi": found.share_hi,
        "flux_in": found.flux_in,
        "flux_out": found.flux_out,
        "s": compensator.coefficients[:, 0],
    }
    for name, values in columns.items():
        row |= {f"{name}_{c}": float(v) for c, v in zip(COLOURS, values, strict=True)}
    return row | {"kkt": float(found.kkt), "self_consistency": float(found.self_consistency)}
