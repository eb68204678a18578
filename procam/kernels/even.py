"""Domes that are the same everywhere: pictures of 8 bits by one table per colour."""

import ctypes
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.kernels import reference_frame
from procam.kernels.arrays import pointer
from procam.kernels.frame import Double, FrameModel
from procam.kernels.grid import CHANNELS
from procam.kernels.loader import chosen

Bytes = NDArray[np.uint8]
Words = NDArray[np.uint32]
Signed = NDArray[np.int8]
BLOCK = 64
TURNS = 256  # of a row, see c/even.h
FULL = 2**24 - TURNS  # a sum's number for light of 1, before it is shortened to 16 bits
HEAVY = 127 * 2**8 + 126  # the greatest weight: 256 coarse + fine can hold one more, by rounding
PHASE = 159  # of rows, in 1/256 of a step, see c/even.h
EVEN = 1e-6  # relative: what counts as the same everywhere


@dataclass(frozen=True, eq=False)
class EvenModel:
    """A `FrameModel` whose fields do not depend on the place, each row lit from one pixel to another.

    Attributes
    ----------
    spread, lo, hi, ambient : (3,). gain : one for all colours.
    lit : (N, 2) first lit pixel of each row, and the one behind the last.
    """

    model: FrameModel
    spread: Double
    lo: Double
    hi: Double
    ambient: Double
    gain: float
    lit: NDArray[np.int32]

    @classmethod
    def of(cls, model: FrameModel) -> "EvenModel | None":
        """The same dome, or None if it is not even."""
        where = model.coverage > 0
        none = np.zeros(CHANNELS, np.float32)
        fields = (model.spread, model.lo, model.hi, model.ambient, model.gain)
        values = [none if f is None else _one_value(f, where) for f in fields]
        if model.terms > 1 or any(v is None for v in values):
            return None
        lit = _spans(model)
        spread, lo, hi, ambient, gain = (np.asarray(v, float) for v in values)
        hi = np.full(CHANNELS, np.inf) if model.hi is None else hi
        even = 1.0 if model.gain is None else float(gain)
        return None if lit is None else cls(model, spread, lo, hi, ambient, even, lit)

    @cached_property
    def rows(self) -> NDArray[np.int32]:
        """First row of each band, and the end."""
        grid = self.model.grid
        return np.append(grid.rows[: -1 : grid.shared], self.model.size).astype(np.int32)

    @cached_property
    def area_sr(self) -> Double:
        """Mean solid angle of the lit pixels of each column of each band (bands, N) [sr]."""
        found = []
        for first, end in pairwise(self.rows):
            every = slice(int(first), int(end))
            area = reference_frame.interpolated(self.model, self.model.solid_angle_sr, every)
            lit = _lit(self, every)
            found.append((area * lit).sum(axis=0) / np.maximum(lit.sum(axis=0), 1))
        return np.array(found)

    @cached_property
    def step_sr(self) -> float:
        """Solid angle of 1 in `weights` [sr]."""
        return float(self.area_sr.max()) / HEAVY

    @cached_property
    def weights(self) -> tuple[Signed, Signed]:
        """The same areas as 256 coarse + fine (bands, padded), in a row rounded so that sums are kept."""
        along = np.rint(np.cumsum(self.area_sr / self.step_sr, axis=1))
        whole = np.diff(along, axis=1, prepend=0).astype(np.int64)
        whole = np.pad(whole, ((0, 0), (0, -self.model.size % BLOCK)))
        coarse = (whole + 128) >> 8
        return coarse.astype(np.int8), (whole - (coarse << 8)).astype(np.int8)

    @cached_property
    def lit_sr(self) -> float:
        """Solid angle of all that is lit, as sums weigh it [sr]."""
        one = np.full((self.model.size, 1, 1), 256, np.int64)
        return float(_reference_sums(self, one)[0]) / 256

    def light(self, content: Double, flux: Double, top: float) -> Double:
        """Light to send (K, 3) for content (K,) in linear light, all under the same flux (3,)."""
        wanted = self.gain * content[:, None] - self.ambient - self.spread * flux
        return np.clip(wanted, self.lo, np.minimum(self.hi, top))


def _one_value(field: NDArray[Any], where: NDArray[np.bool_]) -> NDArray[Any] | None:
    values = field[where]
    if not len(values):
        return None
    low, high = values.min(axis=0), values.max(axis=0)
    return (low + high) / 2 if (high - low <= EVEN * np.abs(high)).all() else None


def _spans(model: FrameModel) -> NDArray[np.int32] | None:
    found = np.zeros((model.size, 2), np.int32)
    step = 256
    for start in range(0, model.size, step):
        rows = slice(start, min(start + step, model.size))
        lit = reference_frame.interpolated(model, model.coverage, rows) > 0
        found[rows, 0] = lit.argmax(axis=1)
        found[rows, 1] = np.where(lit.any(axis=1), lit.shape[1] - lit[:, ::-1].argmax(axis=1), 0)
        if (lit.sum(axis=1) != np.maximum(found[rows, 1] - found[rows, 0], 0)).any():
            return None
    return found


def even_sums(model: EvenModel, image: Bytes, light: Double) -> Double:
    """Sums (3,) over the dome of weight times `light` (3, 256) at the picture's codes, 0..1 [rel sr].

    Light counts in 16 bits, rounded up or down by turns of the rows: over 256 of them to 24.
    """
    image = np.ascontiguousarray(image)
    words = np.ascontiguousarray(np.rint(np.clip(light, 0, 1) * FULL), np.uint32)
    if chosen() is None:
        phase = (np.arange(model.model.size) * PHASE % TURNS)[:, None, None]
        return _reference_sums(model, (_at_codes(image, words) + phase) // TURNS) * TURNS / FULL
    sums = _run(model, {"image": image, "table": words}, counts=True)
    assert sums is not None
    return sums * TURNS / FULL


def even_apply(
    model: EvenModel, image: Bytes, coded: "Coded", out: Bytes, change: Double | None = None
) -> Double:
    """Write codes to `out`; return the sums (3,) of `change` (3, 256) over the dome [rel sr].

    It counts in 8 bits between its extremes: enough for what little a step changes.
    """
    image = np.ascontiguousarray(image)
    low, step = _scale(np.zeros((CHANNELS, 256)) if change is None else change)
    counted = None if change is None else _bytes(np.rint((change - low) / step))
    if chosen() is None:
        sums = None if counted is None else _reference_sums(model, _at_codes(image, counted) << 8)
        out[...] = _reference_apply(model, image, coded)
    else:
        given: dict[str, Any] = {"image": image, "out": out, "threshold": coded.over}
        given |= {"change": counted} | dict(zip(("whole", "rest"), coded.bytes, strict=True))
        sums = _run(model, given, counts=change is not None)
    if sums is None:
        return np.zeros(CHANNELS)
    return low[:, 0] * model.lit_sr + step[:, 0] * sums / 256


def _bytes(numbers: NDArray[Any]) -> Bytes:
    return np.ascontiguousarray(numbers, np.uint8)


def _scale(table: Double) -> tuple[Double, Double]:
    """Least value of each colour (3, 1), and a step of 255 to the greatest."""
    low, high = (f(table, axis=1, keepdims=True) for f in (np.min, np.max))
    return low, np.maximum(high - low, 1e-300) / 255


@dataclass(frozen=True, slots=True)
class Coded:
    """What to write: values (3, 256) 0..255 by code, rounded up above `threshold` (64, 64) in 0..1."""

    values: Double
    threshold: NDArray[np.float32]

    @property
    def bytes(self) -> tuple[Bytes, Bytes]:
        """Whole values, and their rests in 1/256 (3, 256)."""
        words = np.rint(np.clip(self.values, 0, 255) * 256).astype(np.uint16)
        return _bytes(words >> 8), _bytes(words & 255)

    @property
    def over(self) -> Bytes:
        """(64, 64) rests above which values are rounded up, in 1/256."""
        return _bytes(255 - np.floor(self.threshold * 256))


def _at_codes(image: Bytes, table: NDArray[Any]) -> NDArray[np.int64]:
    each = [table[c].astype(np.int64)[image[..., c]] for c in range(CHANNELS)]
    return np.stack(each, axis=-1)


def _lit(model: EvenModel, rows: slice = slice(None)) -> NDArray[np.bool_]:
    x = np.arange(model.model.size)
    return (x >= model.lit[rows, :1]) & (x < model.lit[rows, 1:])


def _reference_sums(model: EvenModel, numbers: NDArray[np.int64]) -> Double:
    """Sums of numbers of 16 bits times areas, less what the low bytes of both give [sr]."""
    kept = np.where(_lit(model)[..., None], numbers, 0)
    band = np.searchsorted(model.rows, np.arange(model.model.size), "right") - 1
    coarse, fine = (w[band, : model.model.size].astype(np.int64) for w in model.weights)
    high, low = kept >> 8, kept & 255
    first = np.einsum("yx,yxc->c", coarse, high)
    second = np.einsum("yx,yxc->c", fine, high) + np.einsum("yx,yxc->c", coarse, low)
    return model.step_sr * (65536.0 * first + 256.0 * second)


def _reference_apply(model: EvenModel, image: Bytes, coded: Coded) -> Bytes:
    place = np.arange(model.model.size) % BLOCK
    whole, rest = (_at_codes(image, table) for table in coded.bytes)
    word = np.minimum(whole + (rest > coded.over[np.ix_(place, place)][..., None]), 255)
    return np.where(_lit(model)[..., None], word, 0).astype(np.uint8)


class _Even(ctypes.Structure):
    """struct procam_even of c/kernels.h."""

    _fields_ = [
        *((name, ctypes.c_size_t) for name in ("size", "padded")),
        *(
            (name, ctypes.c_void_p)
            for name in (
                *("image", "out", "table", "whole", "rest", "change"),
                *("threshold", "lit", "rows", "coarse", "fine"),
            )
        ),
    ]


def _run(model: EvenModel, given: dict[str, NDArray[Any]], counts: bool) -> Double | None:
    """Sums (3,) of the table that is given, if it `counts`, before they are scaled [sr]."""
    native = chosen()
    assert native is not None
    library, level, threads = native
    how, (coarse, fine) = _Even(), model.weights
    how.size, how.padded = model.model.size, coarse.shape[1]
    found = np.zeros((len(coarse), CHANNELS)) if counts else None
    arrays: dict[str, NDArray[Any]] = {"lit": model.lit, "rows": model.rows}
    arrays |= {"coarse": coarse, "fine": fine}
    for name, array in (arrays | given).items():
        setattr(how, name, pointer(array))
    library.procam_even(level, threads, len(coarse), ctypes.byref(how), pointer(found))
    return None if found is None else model.step_sr * np.asarray(found.sum(axis=0))
