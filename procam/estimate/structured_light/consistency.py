"""Measures how well a set of photographs agrees with a code, on a sample of pixel triples.

Three camera pixels in a row see projector pixels on a nearly straight line. So if the photographs are
of this code and in the right order, most triples decode to a straight line; otherwise few do. The
share of straight triples scores any order of the photographs without decoding whole pictures.
"""

from collections.abc import Sequence

import numpy as np

from procam.arrays import AnyArray, IndexArray, Map
from procam.estimate.structured_light.cells import CellImages, Cells
from procam.estimate.structured_light.codes import AXES, Axis, Code
from procam.estimate.structured_light.limits import DecodeLimits, default_limits
from procam.estimate.structured_light.self_calibration import UNKNOWNS, find_columns
from procam.estimate.structured_light.sinusoids import MIN_SAMPLES, complete_base_set
from procam.estimate.structured_light.stripes import StripeDecoder
from procam.maths.codes.phase import WaveDistortion

Order = list[int | None]  # per plane of the code, the index of its photograph
Places = tuple[IndexArray, IndexArray]
TRIPLES = 3000
APART_PX = 5  # between the pixels of a triple: far enough to leave a few stripes
STRAIGHT_PX = 1.6  # second difference of a triple that rounding, noise and curvature can make
MISFIT = 0.05  # of the squared amplitude, per photograph: the residual of a misread wave
UNREAD = 0.7  # factor on the trust in a set for each plane that is not resolved


def probe_places(shape: tuple[int, int]) -> Places:
    """Rows and columns (n, 3) of triples of pixels, spread over a photograph of `shape`."""
    height, width = shape
    step = max(
        1, int(np.sqrt(height * width / TRIPLES / 4))
    )  # only a quarter of the photograph may be lit
    rows, columns = np.mgrid[
        step // 2 : height : step, step // 2 : max(width - 2 * APART_PX, 1) : step
    ]
    across = np.minimum(columns.ravel()[:, None] + APART_PX * np.arange(3), width - 1)
    return np.repeat(rows.ravel()[:, None], 3, axis=1), across


class OrderConsistency:
    """Share of lit triples that decode to a straight line, for any order of the photographs.

    Orders that were scored before are not decoded again.

    Parameters
    ----------
    probes : samples (n, 3) of each photograph at `probe_places`, float32.
    """

    def __init__(self, code: Code, probes: Sequence[AnyArray]) -> None:
        self._code, self._probes = code, probes
        self._scored: dict[tuple[int | None, ...], float] = {}
        self._lit_of: dict[tuple[int, int], tuple[list[AnyArray], float | Map]] = {}

    def along(self, order: Order, axis: Axis) -> float:
        """Share of the triples, 0..1, that are straight along one axis."""
        planes = [0, 1, *self._code.planes_of(axis)]
        key = tuple(order[i] for i in planes)
        if key not in self._scored:
            self._scored[key] = self._straight_share(order, axis)
        return self._scored[key]

    def of(self, order: Order) -> float:
        """Sum of the shares of both axes, 0..2; 0 without white or black."""
        if order[0] is None or order[1] is None:
            return 0.0
        return sum(self.along(order, axis) for axis in AXES)

    def _straight_share(self, order: Order, axis: Axis) -> float:
        assert order[0] is not None and order[1] is not None
        levels = order[0], order[1]
        if levels not in self._lit_of:
            self._lit_of[levels] = self._lit_probes(*levels)
        probes, contrast = self._lit_of[levels]
        if not probes[0].size:
            return 0.0
        planes = self._code.planes_of(axis)
        shown = {i: probes[p] for i in planes if (p := order[i]) is not None}
        white, black = (probes[i] for i in levels)
        x, trust = _columns(self._code, axis, shown, white, black, contrast)
        bend = np.abs(x[:, 0] - 2 * x[:, 1] + x[:, 2])
        straight = bend <= STRAIGHT_PX * self._code.axis(axis).resolution_px  # false for NaN
        return float(np.mean(straight * trust.min(axis=1)))

    def _lit_probes(self, white: int, black: int) -> tuple[list[AnyArray], float | Map]:
        """Samples (n, 3) of every photograph in the lit triples, and the least contrast of a bit."""
        span = self._probes[white] - self._probes[black]
        limits = default_limits(self._probes[white], self._probes[black])
        enough = max(limits.white_black, 0.1 * float(np.ptp(self._probes[white])))
        lit = (span > enough).all(axis=1)
        return [p[lit] for p in self._probes], limits.contrast


def _columns(
    code: Code,
    axis: Axis,
    shown: dict[int, AnyArray],
    white: AnyArray,
    black: AnyArray,
    contrast: float | Map,
) -> tuple[AnyArray, AnyArray]:
    """Columns (n, 3) by a fast decoding, NaN where unknown, and how far to trust them, 0..1."""
    codewords = code.axis(axis).codewords
    if codewords is None or code.axis(axis).waves is not None:
        return _by_waves(code, axis, shown, white, black)
    trust = np.ones(white.shape, np.float32)
    decoder = StripeDecoder(codewords, white, black, DecodeLimits(0.0, contrast))
    for i, photograph in shown.items():
        decoder.add(code.planes[i], photograph)
    found = decoder.result()
    for _ in found.lost:
        trust = trust * UNREAD  # or photographs without light would seem to agree
    return found.x, trust


def _by_waves(
    code: Code, axis: Axis, shown: dict[int, AnyArray], white: AnyArray, black: AnyArray
) -> tuple[AnyArray, AnyArray]:
    """Columns and trust from sinusoidal patterns; NaN and 1 where there are too few."""
    coding = code.axis(axis)
    unknown = np.full(white.shape, np.nan, np.float32), np.ones(white.shape, np.float32)
    sines = coding.sines(axis)
    there = {sines.index(p): f for i, f in shown.items() if (p := code.planes[i]).kind == "sine"}
    if coding.waves is None or not there:
        return unknown
    frames = complete_base_set(there, coding.waves, white, black)
    waves = coding.waves.kept(np.isin(np.arange(len(sines)), list(frames)))
    cells = _cells(code, axis, shown, white, black)
    if len(there) < MIN_SAMPLES if cells is None else waves.base < UNKNOWNS:
        return unknown
    ordered = [frames[number] for number in sorted(frames)]
    found = find_columns(ordered, waves, WaveDistortion(), coding.length, cells)
    scale = MISFIT * len(there) * np.maximum(found.amplitude, 1e-9) ** 2
    return found.position, np.nan_to_num(np.exp(-found.residual / scale))


def _cells(
    code: Code, axis: Axis, shown: dict[int, AnyArray], white: AnyArray, black: AnyArray
) -> Cells | None:
    """What the stripes beneath the sinusoids show; None for a code without."""
    coding = code.axis(axis)
    if coding.codewords is None:
        return None
    images = CellImages(coding, white, black)
    for i, photograph in shown.items():
        if code.planes[i].kind == "binary":
            images.add(code.planes[i], photograph)
    return images.result()
