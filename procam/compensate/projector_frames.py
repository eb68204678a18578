"""From direct light on the dome to what each projector is sent."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from procam.arrays import AnyArray, Array, FloatArray, Image
from procam.errors import InputError, ShapeError
from procam.kernels import WarpPlan, plan_warp, warp_frame
from procam.kernels.warp.reference import KNOTS
from procam.maths.codes.dither import dithered
from procam.maths.light.curves import invert_curve, srgb_decode
from procam.maths.warp import sample
from procam.model.calibration import Calibration, ProjectorCalibration
from procam.model.photometry import Photometry

Decode = Callable[[FloatArray], FloatArray]
CODES = 256
MOST_SHARE = (
    100.0  # larger shares add under 1 % of white, and cost precision of neighbouring pixels
)


@dataclass(frozen=True, slots=True)
class _Prepared:
    """One projector: its plan and its light."""

    plan: WarpPlan
    photometry: Photometry


class Warper:
    """Makes the frames of all projectors from dome masters of one size.

    At each pixel the master is sampled, black is subtracted, the blend's share applied, and the
    projector's colour mixing and response are inverted. Light beyond a projector's range is clipped;
    pixels that miss the screen, or whose light is unknown, are dark.

    Parameters
    ----------
    calibration : with photometry of each projector and the dome's black.
    size : edge of the masters [px].
    dtype : of the frames: uint8, dithered; uint16; float32, exact and slower.
    decode : linear light of encoded values 0..1, for 8-bit masters.
    thresholds : (64, 64) in [0, 1) of the dither; None rounds.

    Raises
    ------
    InputError
        If a size or type does not fit.

    Notes
    -----
    Preparing takes some seconds for large projectors and 20 bytes for each of their pixels: keep the
    object. A response that depends on position is inverted in NumPy, about 20 times slower.
    """

    def __init__(
        self,
        calibration: Calibration,
        size: int,
        dtype: Any = np.uint8,
        *,
        decode: Decode = srgb_decode,
        thresholds: FloatArray | None = None,
    ) -> None:
        self.size, self.dtype, self._shape = size, np.dtype(dtype), calibration.canvas.shape(size)
        if self.dtype not in (np.uint8, np.uint16, np.float32):
            raise InputError(
                f"frames: {self.dtype} is not supported; choose uint8, uint16 or float32"
            )
        if size < 2:
            raise InputError(f"size: {size} px is too small; 2 or more are needed")
        codes = decode(np.arange(CODES) / (CODES - 1))
        self._projectors = {
            name: _Prepared(
                _plan(projector, calibration, size, codes, thresholds), projector.photometry
            )
            for name, projector in calibration.projectors.items()
        }

    def frame(
        self, master: AnyArray, out: Mapping[str, AnyArray] | None = None
    ) -> dict[str, AnyArray]:
        """Frames (H, W, 3) by projector for a master (N, N, 3) of direct light.

        Parameters
        ----------
        master : uint8, encoded, or linear: uint16, of which 65535 is 1, float16, float32 [rel].
        out : frames to write to, instead of new ones.
        """
        if master.shape != (*self._shape, 3):
            raise ShapeError("picture", master.shape, f"({self._shape[0]}, {self._shape[1]}, 3)")
        return {
            name: self._frame(master, projector, None if out is None else out[name])
            for name, projector in self._projectors.items()
        }

    def _frame(self, master: AnyArray, projector: _Prepared, out: AnyArray | None) -> AnyArray:
        photometry = projector.photometry
        if self.dtype != np.float32 and photometry.exponent is None:
            return warp_frame(master, projector.plan, out, self.dtype)
        frame = _quantised(_exact_drive(master, projector), self.dtype, projector.plan.thresholds)
        if out is None:
            return frame
        out[...] = frame
        return out


def projector_frames(direct: Image, calibration: Calibration) -> dict[str, Image]:
    """Drives (H, W, 3) in 0..1 by projector for direct light (N, N, 3) [rel]; see `Warper`."""
    return Warper(calibration, direct.shape[1], np.float32).frame(np.asarray(direct, np.float32))


def _plan(
    projector: ProjectorCalibration,
    calibration: Calibration,
    size: int,
    codes: FloatArray,
    thresholds: FloatArray | None,
) -> WarpPlan:
    """The plan of a projector for the kernel."""
    surface, photometry, maps = projector.surface, projector.photometry, calibration.maps
    known = surface.valid[..., None] & np.isfinite(surface.direction)
    direction = np.where(known, surface.direction, 0)
    place = np.where(known[..., :2], calibration.canvas.pixels(direction, size), np.nan)
    black = sample(maps.lo, calibration.screen.canvas.pixels(direction, maps.size))
    gain = photometry.gain
    share = np.where(gain > 0, projector.blend[..., None] / np.maximum(gain, 1e-9), 0)
    return plan_warp(
        place,
        black,
        np.clip(share, 0, MOST_SHARE),
        np.linalg.inv(photometry.colour_mix),
        drives=_drives(photometry),
        decode=codes,
        thresholds=thresholds,
    )


def _drives(photometry: Photometry) -> Array:
    """Drives (513, 3) for the kernel's light."""
    response = photometry.response
    light = np.repeat(KNOTS[:, None], 3, axis=1)
    drives = np.clip(invert_curve(light, response.levels, response.values), 0, 1)
    drives[0] = 0  # no light is no drive, also where a response starts flat
    return np.maximum.accumulate(drives, axis=0)


def _exact_drive(master: AnyArray, projector: _Prepared) -> Image:
    """Drives by the response's own table, after its exponent where it depends on position."""
    photometry = projector.photometry
    light = warp_frame(master, projector.plan, dtype=np.float32)
    if photometry.exponent is not None:
        np.power(light, 1 / photometry.exponent, out=light)
    drive = invert_curve(light, photometry.response.levels, photometry.response.values)
    return np.where(light > 0, drive, 0).astype(np.float32)


def _quantised(drive: Image, dtype: np.dtype[Any], thresholds: Image) -> AnyArray:
    """Drives as values of a type: rounded to 16 bits, dithered to 8."""
    if dtype == np.float32:
        return drive
    if dtype == np.uint16:
        return np.rint(65535 * drive).astype(np.uint16)
    return dithered(255 * drive, thresholds)
