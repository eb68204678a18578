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
from procam.kernels.grid import BLOCK, CHANNELS, STRAIGHT
from procam.kernels.loader import chosen

Bytes = NDArray[np.uint8]
Words = NDArray[np.uint32]
Signed = NDArray[np.int8]
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
        if model.terms > 1:
            return None
        where, values = model.solid_angle_sr > 0, []
        for field in (model.spread, model.lo, model.hi, model.ambient, model.gain):
            value = np.zeros(CHANNELS) if field is None else _one_value(field, where)
            if value is None:
                return None
            values.append(np.asarray(value, float))
        lit = _spans(model)
        spread, lo, hi, ambient, gain = values
        hi = np.full(CHANNELS, np.inf) if model.hi is None else hi
        even = 1.0 if model.gain is None else float(gain)
        return None if lit is None else cls(model, spread, lo, hi, ambient, even, lit)

    @cached_property
    def rows(self) -> NDArray[np.int32]:
        """First row of each band, and the end."""
        grid = self.model.grid
        return np.append(grid.rows[: -1 : grid.shared], self.model.size).astype(np.int32)

    @cached_property
    def weights(self) -> "Weights":
        """Solid angles as the kernels count them."""
        return Weights.of(self)

    def light(self, content: Double, flux: Double, top: float) -> Double:
        """Light to send (K, 3) for content (K,) in linear light, all under the same flux (3,)."""
        wanted = self.gain * content[:, None] - self.ambient - self.spread * flux
        return np.clip(wanted, self.lo, np.minimum(self.hi, top))


@dataclass(frozen=True, eq=False)
class Weights:
    """Solid angles of pixels, in `step_sr`: along a band as 256 coarse + fine, changing from row to row.

    Attributes
    ----------
    coarse, fine : (bands, padded) at the band's middle, rounded so that sums along it are kept.
    slope : (bands, blocks) change from a row to the next, in `slope_sr`.
    own : (bands, blocks) number of a block whose solid angles do not change so, or -1; those of its
        pixels are `own_coarse`, `own_fine` (own blocks, rows, 64).
    lit_sr : of all that is lit [sr].
    """

    coarse: Signed
    fine: Signed
    own_coarse: Signed
    own_fine: Signed
    slope: Signed
    own: NDArray[np.int32]
    step_sr: float
    slope_sr: float
    lit_sr: float

    @classmethod
    def of(cls, model: EvenModel) -> "Weights":
        """Those of a dome."""
        middle, slope, own, areas = _areas(model)
        step = float(max(middle.max(), areas.max(initial=0))) / HEAVY
        along = np.rint(np.cumsum(middle / step, axis=1))
        whole, pixels = np.diff(along, axis=1, prepend=0), np.rint(areas / step)
        steep = max(float(np.abs(slope).max()), 1e-300) / 127
        slopes = np.rint(slope / steep).astype(np.int8)
        lit = step * float(whole.sum(axis=1) @ np.diff(model.rows) + pixels.sum())
        return cls(*_parts(whole), *_parts(pixels), slopes, own, step, steep, lit)


def _areas(model: EvenModel) -> tuple[Double, Double, NDArray[np.int32], Double]:
    """Middle, slope, own as in `Weights`, and areas of its pixels, 0 where they are not lit [sr]."""
    area_sr, blocks = model.model.solid_angle_sr, -(-model.model.size // BLOCK)
    middle, slope = (np.zeros((len(model.rows) - 1, *n)) for n in ((blocks, BLOCK), (blocks,)))
    own = np.full(slope.shape, -1, np.int32)
    areas: list[Double] = []
    most, tall = float(area_sr.max()), int(np.diff(model.rows).max())
    for band, (first, end) in enumerate(pairwise(model.rows)):
        if first == end:
            continue
        found = reference_frame.interpolated(model.model, area_sr, slice(first, end))
        found = np.pad(found, ((0, 0), (0, -found.shape[1] % BLOCK)))
        area = found.reshape(-1, blocks, BLOCK)
        middle[band], slope[band], mine = _lines(area, STRAIGHT * most)
        mine[model.model.size // BLOCK :] = True  # a block that is not whole
        own[band, mine] = np.arange(mine.sum()) + sum(len(a) for a in areas)
        areas.append(
            np.pad(area[:, mine].swapaxes(0, 1), ((0, 0), (0, tall - end + first), (0, 0)))
        )
        middle[band, mine] = slope[band, mine] = 0
    return middle.reshape(len(middle), -1), slope, own, np.concatenate(areas)


def _lines(area: Double, most: float) -> tuple[Double, Double, NDArray[np.bool_]]:
    """Means of columns (blocks, 64) of areas (R, blocks, 64), one slope of each block, where it misses.

    By more than `most`, or if not all of a block is lit.
    """
    middle, lit = area.mean(axis=0), area > 0
    slope = (area[-1] - area[0]).mean(axis=-1) / max(len(area) - 1, 1)
    beyond = np.arange(len(area))[:, None, None] - (len(area) - 1) / 2
    off = np.abs(area - middle - beyond * slope[:, None]).max(axis=(0, 2))
    return middle, slope, (off > most) | lit.any(axis=(0, 2)) & ~lit.all(axis=(0, 2))


def _parts(whole: Double) -> tuple[Signed, Signed]:
    """Coarse and fine: 256 coarse + fine."""
    coarse = np.floor((whole + 128) / 256)
    fine = whole - 256 * coarse
    return np.ascontiguousarray(coarse, np.int8), np.ascontiguousarray(fine, np.int8)


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
        lit = reference_frame.interpolated(model, model.solid_angle_sr, rows) > 0
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
        numbers = None if counted is None else _at_codes(image, counted) << 8
        sums = None if numbers is None else _reference_sums(model, numbers, finely=False)
        out[...] = _reference_apply(model, image, coded)
    else:
        given: dict[str, Any] = {"image": image, "out": out, "threshold": coded.over}
        given |= {"change": counted} | dict(zip(("whole", "rest"), coded.bytes, strict=True))
        sums = _run(model, given, counts=change is not None)
    if sums is None:
        return np.zeros(CHANNELS)
    return low[:, 0] * model.weights.lit_sr + step[:, 0] * sums / 256


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


def _reference_sums(model: EvenModel, numbers: NDArray[np.int64], finely: bool = True) -> Double:
    """Sums of numbers of 16 bits times areas, less what the low bytes of both give [sr].

    If not `finely`, by coarse weights alone.
    """
    found, kept = np.zeros(CHANNELS), model.weights
    size = model.model.size
    for band, (first, end) in enumerate(pairwise(model.rows)):
        coarse, fine = (w[: end - first, :size].astype(float) for w in _band(model, band))
        rise = (
            np.repeat(kept.slope[band].astype(float), BLOCK)[:size] * kept.slope_sr / kept.step_sr
        )
        rows = np.arange(first, end)[:, None]
        fine += (rows - (first + end - 1) / 2) * rise
        high, low = np.divmod(
            np.where(_lit(model, slice(first, end))[..., None], numbers[first:end], 0), 256
        )
        found += 65536 * np.einsum("yx,yxc->c", coarse, high)
        if finely:
            found += 256 * (
                np.einsum("yx,yxc->c", fine, high) + np.einsum("yx,yxc->c", coarse, low)
            )
    return kept.step_sr * found


def _band(model: EvenModel, band: int) -> list[Signed]:
    """Coarse and fine weights of a band's rows (rows at most, padded)."""
    kept, found = model.weights, []
    for along, own in ((kept.coarse, kept.own_coarse), (kept.fine, kept.own_fine)):
        every = np.broadcast_to(along[band], (own.shape[1], along.shape[1])).copy()
        blocks = every.reshape(len(every), -1, BLOCK)
        mine = kept.own[band] >= 0
        blocks[:, mine] = np.moveaxis(own[kept.own[band, mine]], 0, 1)
        found.append(every)
    return found


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
                *("threshold", "lit", "rows", "coarse", "fine", "slope"),
            )
        ),
        ("steps", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("own", "own_coarse", "own_fine")),
        ("tall", ctypes.c_size_t),
    ]


def _run(model: EvenModel, given: dict[str, NDArray[Any]], counts: bool) -> Double | None:
    """Sums (3,) of the table that is given, if it `counts`, before they are scaled [sr]."""
    native = chosen()
    assert native is not None
    library, level, threads = native
    how, kept = _Even(), model.weights
    how.size, how.padded = model.model.size, kept.coarse.shape[1]
    how.tall, how.steps = kept.own_coarse.shape[1], kept.slope_sr / kept.step_sr
    found = np.zeros((len(kept.coarse), CHANNELS)) if counts else None
    names = ("coarse", "fine", "slope", "own_coarse", "own_fine")
    arrays = {"lit": model.lit, "rows": model.rows, "own": kept.own}
    arrays |= {name: getattr(kept, name) for name in names}
    for name, array in (arrays | given).items():
        setattr(how, name, pointer(array))
    library.procam_even(level, threads, len(kept.coarse), ctypes.byref(how), pointer(found))
    return None if found is None else kept.step_sr * np.asarray(found.sum(axis=0))
