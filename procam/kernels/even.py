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
from procam.kernels.frame import CHANNELS, Double, FrameModel
from procam.kernels.loader import chosen

Bytes = NDArray[np.uint8]
Words = NDArray[np.uint32]
GROUP, BLOCK = 8, 64
FULL = 2**22 - 1  # a sum's number for light of 1
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

    @property
    def groups(self) -> int:
        """Of 8 pixels in a row, made up to whole blocks."""
        return -(-self.model.size // BLOCK) * BLOCK // GROUP

    @property
    def rows(self) -> NDArray[np.int32]:
        """First row of each band, and the end."""
        grid = self.model.grid
        return np.append(grid.rows[: -1 : grid.shared], self.model.size).astype(np.int32)

    @cached_property
    def weight(self) -> NDArray[np.float32]:
        """Mean solid angle of the lit pixels of each group and band (bands, groups) [sr]."""
        rows, found = self.rows, []
        for first, end in pairwise(rows):
            every = slice(int(first), int(end))
            area = reference_frame.interpolated(self.model, self.model.solid_angle_sr, every)
            x = np.arange(self.model.size)
            lit = (x >= self.lit[every, :1]) & (x < self.lit[every, 1:])
            sums, count = ((v * lit).sum(axis=0) for v in (area, np.ones_like(area)))
            starts = np.arange(0, self.model.size, GROUP)
            total, number = (np.add.reduceat(v, starts) for v in (sums, count))
            means = total / np.maximum(number, 1)
            found.append(np.pad(means, (0, self.groups - len(means))))
        return np.ascontiguousarray(found, np.float32)

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


def even_sums(model: EvenModel, image: Bytes, table: Double) -> Double:
    """Sums (3,) over the dome of weight times `table` (3, 256) at the picture's codes, 0..1 [rel sr].

    To 22 bits, rounded: the sums of 8 pixels over 128 rows fit into 32.
    """
    words = np.ascontiguousarray(np.rint(np.clip(table, 0, 1) * FULL), np.uint32)
    image = np.ascontiguousarray(image)
    native = chosen()
    if native is None:
        return _reference_sums(model, image, words)
    sums = np.zeros((len(model.weight), CHANNELS))
    _run(native, model, (image, None), words, None, sums)
    return np.asarray(sums.sum(axis=0) / FULL)


def even_apply(
    model: EvenModel, image: Bytes, table: Double, threshold: NDArray[np.float32], out: Bytes
) -> Bytes:
    """Write codes by `table` (3, 256) of values 0..255, rounded up above `threshold` (64, 64) in 0..1."""
    words = np.ascontiguousarray(np.rint(np.clip(table, 0, 255) * 256), np.uint32)
    over = 255 - np.floor(threshold * 256).astype(np.uint8)
    image = np.ascontiguousarray(image)
    native = chosen()
    if native is None:
        out[...] = _reference_apply(model, image, words, over)
    else:
        _run(native, model, (image, out), words, np.ascontiguousarray(over), None)
    return out


def _at_codes(image: Bytes, words: Words) -> NDArray[np.int64]:
    each = [words[c].astype(np.int64)[image[..., c]] for c in range(CHANNELS)]
    return np.stack(each, axis=-1)


def _lit(model: EvenModel) -> NDArray[np.bool_]:
    x = np.arange(model.model.size)
    return (x >= model.lit[:, :1]) & (x < model.lit[:, 1:])


def _reference_sums(model: EvenModel, image: Bytes, words: Words) -> Double:
    kept = np.where(_lit(model)[..., None], _at_codes(image, words), 0)
    grouped = np.add.reduceat(kept, np.arange(0, model.model.size, GROUP), axis=1)
    band = np.searchsorted(model.rows, np.arange(model.model.size), "right") - 1
    weight = model.weight[band, : grouped.shape[1]].astype(float)
    return np.asarray(np.einsum("yg,ygc->c", weight, grouped) / FULL)


def _reference_apply(model: EvenModel, image: Bytes, words: Words, over: Bytes) -> Bytes:
    place = np.arange(model.model.size) % BLOCK
    words_here = _at_codes(image, words) + 255 - over[np.ix_(place, place)][..., None]
    return np.where(_lit(model)[..., None], np.minimum(words_here, 65535) >> 8, 0).astype(np.uint8)


class _Even(ctypes.Structure):
    """struct procam_even of c/kernels.h."""

    _fields_ = [
        *((name, ctypes.c_size_t) for name in ("size", "groups")),
        *(
            (name, ctypes.c_void_p)
            for name in ("image", "out", "table", "threshold", "lit", "rows", "weight", "totals")
        ),
    ]


def _run(
    native: tuple[ctypes.CDLL, int, int],
    model: EvenModel,
    pictures: tuple[Bytes, Bytes | None],
    words: Words,
    over: Bytes | None,
    sums: Double | None,
) -> None:
    library, level, threads = native
    how, rows = _Even(), model.rows
    how.size, how.groups = model.model.size, model.groups
    room = None if sums is None else np.empty((len(sums), CHANNELS, model.groups), np.uint32)
    arrays: dict[str, NDArray[Any] | None] = {"image": pictures[0], "out": pictures[1]}
    arrays |= {"table": words, "threshold": over}
    arrays |= {"lit": model.lit, "rows": rows, "weight": model.weight, "totals": room}
    for name, array in arrays.items():
        setattr(how, name, pointer(array))
    library.procam_even(level, threads, len(rows) - 1, ctypes.byref(how), pointer(sums))
