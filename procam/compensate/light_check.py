"""Predicts what the audience will see of light that was sent, from a calibration's maps alone.

This checks the compensator and what was written, so it shares neither the solver's nodes nor its
kernels: it evaluates docs/theory/interreflection.md (I16) in plain NumPy, with the solid angle of each
pixel, at one random pixel in each cell of the picture; of small pictures at every pixel.
"""

from dataclasses import dataclass
from random import Random

import numpy as np

from procam.arrays import AnyArray, Array, FloatArray, IndexArray, Map
from procam.errors import ShapeError
from procam.maths.geometry.canvas import STANDARD, Canvas
from procam.maths.geometry.sphere import master_pixels
from procam.maths.light.scatter_kernel import basis
from procam.maths.light.transfer import Transfer
from procam.model.calibration import Calibration
from procam.model.venue_state import VenueState

CELLS = 512  # cells along an edge, docs/decisions/compensation.md
SEED = 0  # of their random pixels
ROUNDING = 1e-5  # of a coverage: where it is less than 1 limits fade, and nothing is compared


@dataclass(frozen=True, slots=True)
class LightError:
    """How far the light that is seen is from the light asked for, where no limit holds.

    Attributes
    ----------
    white : largest difference at the sampled pixels [rel]; NaN where limits hold everywhere.
    codes : the same of the values sent, in steps of an integer type; NaN for floats.
    sigma : standard error of the scattered light, because its sum is over a sample [rel].
    """

    white: float
    codes: float
    sigma: float


class LightCheck:
    """Checks pictures of one size for one calibration.

    Parameters
    ----------
    calibration : with maps of the dome. size : edge of the pictures [px]. state : of the venue.
    gain : (M, M) by which content is multiplied for the white that is asked for, or None.
    """

    def __init__(
        self, calibration: Calibration, size: int, state: str | None, gain: Map | None
    ) -> None:
        maps = calibration.maps
        grid, counts = _sample(size)
        self._cells, place = counts, grid.reshape(2, -1)
        self._place = size, place
        self._canvas = calibration.dome_canvas
        direction, area = _directions(place, size, self._canvas)
        self._on_maps: Array = np.asarray(master_pixels(direction, maps.size))
        coverage = self._at(maps.coverage)
        # (I16): scattered = u (phi.B M) / (phi.g), with M = sum a phi b0
        self._phi, self._matrix = basis(direction, maps.kernel.degree), maps.kernel.matrix
        profile = self._phi @ maps.kernel.profile.T
        self._spread = self._at(maps.scatter_per_flux) / profile
        self._weight = (area * coverage * counts.ravel())[:, None]
        self._lo, self._hi = (self._at(m) for m in (maps.lo, maps.hi))
        self._ambient, self._gain = np.zeros((1, 3)), np.ones((1, 1))
        if gain is not None:
            self._gain = _interpolated(gain, self._on_nodes(len(gain)))[:, None]
        if state is not None:
            self._in_state(calibration.state(state))
        self._inside = coverage >= 1 - ROUNDING
        self._compared = self._inside & ~maps.is_protected(self._on_maps)

    def _in_state(self, condition: VenueState) -> None:
        self._spread *= condition.scatter_ratio
        if condition.ambient is not None:
            self._ambient = self._at(condition.ambient)

    def _at(self, field: Map) -> Array:
        """A map (M, M[, C]) at the sample: (S[, C]).

        Compensation keeps fields at M nodes or at each pixel of a smaller picture. Only on the maps' own
        canvas do its nodes lie at their pixels.
        """
        edge, (size, _) = len(field), self._place
        if self._canvas == STANDARD or size <= edge:
            return _interpolated(field, self._on_maps)
        nodes: Array = np.asarray(master_pixels(self._canvas.directions(edge)[0], edge))
        on_nodes = _interpolated(field, nodes.reshape(-1, 2)).reshape(field.shape)
        return _interpolated(on_nodes, self._on_nodes(edge))

    def _on_nodes(self, edge: int) -> Array:
        """Positions (S, 2) of the sample among nodes along an edge of the picture, as (column, row)."""
        size, place = self._place
        return np.asarray((place[::-1].T + 0.5) * (edge / size) - 0.5)

    def sampled(self, picture: AnyArray) -> AnyArray:
        """Values (S, 3) of a picture (N, N, 3) at the sample; refuses one of another size."""
        size, place = self._place
        if picture.shape != (size, size, 3):
            raise ShapeError("picture", picture.shape, f"({size}, {size}, 3)")
        return picture[place[0], place[1]]

    def of(self, content: Array, values: AnyArray, transfer: Transfer) -> LightError:
        """The error of values (S, 3) that were sent for content (S, 3) in linear light, at the sample."""
        whole = values.dtype.kind != "f"
        top = float(np.iinfo(values.dtype).max) if whole else 1.0
        share = np.asarray(values, float) / top
        sent = np.asarray(transfer.decode(share))
        inside = self._inside[:, None]
        direct = np.where(inside, np.clip(sent, self._lo, self._hi), sent)
        scattered, sigma = self._scattered(direct)
        wanted = self._gain * content - self._ambient - scattered
        most = np.minimum(self._hi, 1.0) if whole else self._hi
        free = self._compared[:, None] & (wanted > self._lo) & (wanted < most)
        if not free.any():
            return LightError(float("nan"), float("nan"), sigma)
        codes = float("nan")
        if whole:
            asked = np.asarray(transfer.encode(np.clip(wanted, 0, 1)))
            codes = float(top * np.abs(asked - share)[free].max())
        return LightError(float(np.abs(direct - wanted)[free].max()), codes, sigma)

    def _scattered(self, direct: Array) -> tuple[Array, float]:
        """Scattered light (S, 3) of direct light, and its largest standard error."""
        each = (self._phi[:, :, None] * (self._weight * direct)[:, None]).reshape(len(direct), -1)
        shape = self._phi.shape[1], 3
        moments, error = each.sum(axis=0).reshape(shape), self._standard_error(each).reshape(shape)
        form = np.einsum("sk,ckj->scj", self._phi, self._matrix)
        scattered = self._spread * np.einsum("scj,jc->sc", form, moments)
        squares = np.einsum("scj,jc->sc", form**2, error**2)
        largest = (np.abs(self._spread) * np.sqrt(squares))[self._inside].max(initial=0)
        return np.asarray(scattered), float(largest)

    def _standard_error(self, each: Array) -> Array:
        """Of sums of (S, ...) over the cells, from differences of neighbours; 0 if every pixel is there."""
        if (self._cells == 1).all():
            return np.zeros(each.shape[1])
        grid = each.reshape(*self._cells.shape, -1)
        apart = grid[:, 0::2] - grid[:, 1::2]
        return np.asarray(np.sqrt((apart**2).sum(axis=(0, 1))))


def _sample(size: int) -> tuple[IndexArray, Array]:
    """A random row and column (2, C, C) in each of C x C cells, and the pixels (C, C) that a cell holds."""
    cells = min(size, CELLS)
    edges = np.arange(cells + 1) * size // cells
    start, length = edges[:-1], np.diff(edges)
    draws = Random(SEED).randbytes(8 * cells**2)  # NumPy's would have to be imported
    down, right = np.frombuffer(draws, np.uint32).reshape(2, cells, cells) / 2**32
    rows = start[:, None] + (down * length[:, None]).astype(int)
    columns = start + (right * length).astype(int)
    return np.stack([rows, columns]), np.multiply.outer(length, length).astype(float)


def _directions(place: IndexArray, size: int, canvas: Canvas) -> tuple[Array, Array]:
    """Directions (S, 3) and solid angles (S,) [sr] of pixels, docs/theory/geometry.md (G4)."""
    down, right = (place - (size - 1) / 2) / (size / 2)
    q = np.hypot(down, right)
    theta = q * canvas.fov / 2
    across = np.sin(theta) / np.where(q > 0, q, 1)
    area = np.where(q <= 1, np.sinc(theta / np.pi) * (canvas.fov / size) ** 2, 0)
    azimuth = np.arctan2(-right, down) + canvas.rotation
    x, y = (q * across * f(azimuth) for f in (np.cos, np.sin))
    return np.stack([x, y, np.cos(theta)], axis=-1), area


def _interpolated(field: FloatArray, at: FloatArray) -> Array:
    """A map (M, M[, C]) at its pixels (S, 2), as (column, row): (S[, C])."""
    edge = len(field)
    at = np.clip(at.T[::-1], 0, edge - 1)
    first = np.minimum(at.astype(int), edge - 2)
    share = (at - first).reshape(2, -1, *(1,) * (field.ndim - 2))
    (y, x), (down, right) = first, share
    upper = field[y, x] + right * (field[y, x + 1] - field[y, x])
    lower = field[y + 1, x] + right * (field[y + 1, x + 1] - field[y + 1, x])
    return np.asarray(upper + down * (lower - upper))
