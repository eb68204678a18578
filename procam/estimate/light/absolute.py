"""Absolute colour and luminance: a hand meter's readings against the calibration's relative light.

A camera sees RGB laser light with other eyes than people do, but it compares places well (science.md
s.4). So the meter tells what a unit of each content channel is, and the calibration what stood where.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import chdtrc

from procam.errors import NotEnoughData
from procam.estimate.light.colour_spaces import colour_difference, xyy_from_xyz
from procam.estimate.light.panel_light import PanelLight
from procam.model.calibration import Calibration
from procam.model.reading import BLACK, MeterReading, Spot, spot_name

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
# what data sheets of hand meters promise
METER_SIGMA = np.array([0.002, 0.002, 0.02])  # of x, y and, relative, Y
ENOUGH_PATCHES = 3
TIGHT = 1e-12
IMPROBABLE = 0.01  # of the misfit, above which the sigmas are widened
CONTRADICTS = 1e-3
LARGEST_ADDITIVITY = 0.02
LARGEST_RESIDUAL = 2.0  # mean dE2000
BLACKS_DIFFER = 1.5  # factor
PRIMARIES = ("red", "green", "blue")


@dataclass(frozen=True, slots=True)
class Additivity:
    """How far light of a projector adds up: luminance (red + green + blue) / white - 1.

    `sigma` is what a meter's own errors make. Of luminance alone: in X and Z an error of x and y of a
    saturated blue looks like one of 10 %.
    """

    projector: str
    error: float
    sigma: float


@dataclass(frozen=True, slots=True)
class AbsoluteLight:
    """What the meter tells.

    Attributes
    ----------
    xyz_from_content : (3, 3) from content radiance [rel] to XYZ [cd/m2].
    covariance : (9, 9) of its numbers, row by row: the meter's errors, taken as independent, and not
        those of the calibration.
    readings : those that were given, without black. residual_de2000 : (n,) of each, against the
        reference white.
    additivity : of the projector whose light adds up worst; None if all four were read nowhere.
    contrast : white over black, the lowest that was read; None without a reading of black.
    notes : what nobody should miss.
    """

    xyz_from_content: Array
    covariance: Array
    readings: tuple[MeterReading, ...]
    residual_de2000: Array
    additivity: Additivity | None
    contrast: float | None
    notes: tuple[str, ...]

    @property
    def sigma(self) -> Array:
        """Standard errors (3, 3) of `xyz_from_content` [cd/m2]."""
        return np.sqrt(np.diag(self.covariance)).reshape(3, 3)

    @property
    def white(self) -> Array:
        """XYZ (3,) of the reference white [cd/m2]."""
        return np.asarray(self.xyz_from_content.sum(axis=1))

    @property
    def nits_per_unit(self) -> tuple[float, float]:
        """Luminance of the reference white, relative radiance 1, and its standard error [cd/m2]."""
        return float(self.white[1]), float(np.sqrt(self.covariance[3:6, 3:6].sum()))

    @property
    def worst(self) -> tuple[MeterReading, float]:
        """The reading that fits worst, and its residual [dE2000]."""
        at = int(np.argmax(self.residual_de2000))
        return self.readings[at], float(self.residual_de2000[at])


def fit_absolute(readings: Sequence[MeterReading], calibration: Calibration) -> AbsoluteLight:
    """Solve for XYZ of the content channels from full-panel patches of one or more projectors.

    A reading is all the light there: direct, bounced, and black. Black is the one that was read at the
    same place, room light included; else what the calibration has for it.

    Raises
    ------
    NotEnoughData
        With fewer than three independent patches.
    InputError
        For a reading where no camera saw the dome or where its projector does not light it.
    """
    lit = [reading for reading in readings if reading.patch != BLACK]
    patches = {reading.patch for reading in lit}
    if len(patches) < ENOUGH_PATCHES:
        raise NotEnoughData(
            f"meter: got readings of {', '.join(sorted(patches)) or 'no colour'}, expected three or more "
            f"of {', '.join(PRIMARIES)} and white; read the others too"
        )
    light = PanelLight(calibration)
    blacks = {r.spot: r.xyz for r in readings if r.patch == BLACK}
    dark = {r.spot: light.black(r) for r in readings}
    samples = _Samples.of(lit, light, blacks, dark)
    matrix, covariance = samples.solve()
    excess, white = _excess(samples, matrix), matrix.sum(axis=1)
    each = _additivities(readings, {s: matrix @ d for s, d in dark.items()} | blacks)
    additivity = max(each, key=lambda found: abs(found.error), default=None)
    notes = [
        *_additivity_note(additivity),
        *_excess_note(excess),
        *_contradiction(samples, white),
        *_black_notes(blacks, dark, matrix),
    ]
    return AbsoluteLight(
        matrix,
        covariance * excess,
        tuple(lit),
        colour_difference(samples.xyz, samples.predicted(matrix), white),
        additivity,
        _contrast(lit, blacks),
        tuple(notes),
    )


@dataclass(frozen=True, slots=True)
class _Samples:
    """Readings as numbers: xyz = content @ matrix.T + offset, but for the meter's errors.

    `name`, `patch` (n,); `content`, `offset`, `xyz` (n, 3); `sigma` (n, 3) of x, y and, relative, Y;
    `level` (n,) the Y that it is relative to.
    """

    name: NDArray[np.str_]
    patch: NDArray[np.str_]
    content: Array
    offset: Array
    xyz: Array
    sigma: Array
    level: Array

    @classmethod
    def of(
        cls,
        lit: Sequence[MeterReading],
        light: PanelLight,
        blacks: dict[Spot, Array],
        dark: dict[Spot, Array],
    ) -> "_Samples":
        nothing = np.zeros(3)
        added = [nothing if r.spot in blacks else dark[r.spot] for r in lit]
        return cls(
            np.array([r.projector for r in lit]),
            np.array([r.patch for r in lit]),
            np.array([light.patch(r) for r in lit]) + added,
            np.array([blacks.get(r.spot, nothing) for r in lit]),
            np.array([r.xyz for r in lit]),
            METER_SIGMA / np.sqrt([[r.count] for r in lit]),
            np.array([r.xyz[1] for r in lit]),
        )

    def only(self, use: Mask) -> "_Samples":
        """Some of them."""
        return _Samples(
            self.name[use],
            self.patch[use],
            self.content[use],
            self.offset[use],
            self.xyz[use],
            self.sigma[use],
            self.level[use],
        )

    def predicted(self, matrix: Array) -> Array:
        """XYZ (n, 3) that should have been read [cd/m2]."""
        return self.content @ matrix.T + self.offset

    def misfit(self, matrix: Array) -> Array:
        """(n, 3) of x, y and Y, read less predicted, in the meter's sigmas."""
        read, told = xyy_from_xyz(self.xyz), xyy_from_xyz(self.predicted(matrix))
        return (read - told) / self._sigmas

    def slopes(self, matrix: Array) -> Array:
        """Derivatives (n, 3, 9) of the misfit by the matrix, row by row."""
        xyz = self.predicted(matrix)
        total = xyz.sum(axis=1)[:, None, None]
        by_xyz = np.zeros((len(xyz), 3, 3))
        by_xyz[:, :2] = np.eye(3)[:2] / total - xyz[:, :2, None] / total**2
        by_xyz[:, 2, 1] = 1
        by_xyz /= self._sigmas[..., None]
        return -np.einsum("nab,nc->nabc", by_xyz, self.content).reshape(-1, 3, 9)

    def solve(self) -> tuple[Array, Array]:
        """The matrix (3, 3) and the covariance (9, 9) of its numbers."""
        weight = 1 / self.xyz[:, 1:2]
        light = (self.xyz - self.offset) * weight
        start = np.asarray(np.linalg.lstsq(self.content * weight, light, rcond=None)[0].T, float)
        # weighed by what was read, readings that are too low by chance would count more
        expected = np.clip(self.predicted(start)[:, 1], self.level / 2, self.level * 2)
        return replace(self, level=expected)._refined(start)

    def _refined(self, start: Array) -> tuple[Array, Array]:
        def misfit(numbers: Array) -> Array:
            return self.misfit(numbers.reshape(3, 3)).ravel()

        def slopes(numbers: Array) -> Array:
            return self.slopes(numbers.reshape(3, 3)).reshape(-1, 9)

        found = least_squares(misfit, start.ravel(), slopes, method="lm", xtol=TIGHT, ftol=TIGHT)
        final = slopes(found.x)
        return found.x.reshape(3, 3), np.asarray(np.linalg.inv(final.T @ final))

    @property
    def _sigmas(self) -> Array:
        ones = np.ones_like(self.level)
        return self.sigma * np.stack([ones, ones, self.level], axis=1)


def _excess(samples: _Samples, matrix: Array) -> float:
    """Misfit per degree of freedom if chance hardly explains it, else 1."""
    freedom = samples.xyz.size - matrix.size
    square = float(np.sum(samples.misfit(matrix) ** 2))
    return square / freedom if freedom > 0 and chdtrc(freedom, square) < IMPROBABLE else 1.0


def _contradiction(samples: _Samples, white: Array) -> Iterator[str]:
    """Says which projector fits least to what the others tell, if chance hardly explains it."""
    found = []
    for name in np.unique(samples.name):
        own, rest = samples.only(samples.name == name), samples.only(samples.name != name)
        if len(set(rest.patch)) >= ENOUGH_PATCHES:
            matrix, covariance = rest.solve()
            # what nobody fits, such as white boost, is no contradiction
            doubt = _excess(rest, matrix)
            chance = _chance(own, matrix, covariance, doubt)
            found.append((chance, name, own, own.predicted(matrix)))
    chance, name, own, told = min(
        found, key=lambda each: each[0], default=(1.0, "", samples, white)
    )
    if chance < CONTRADICTS:
        brighter = float(np.exp(np.mean(np.log(own.xyz[:, 1] / told[:, 1]))) - 1)
        apart = float(colour_difference(own.xyz, told, white).max())
        others = ", ".join(np.unique(samples.name[samples.name != name]))
        yield (
            f"projectors contradict: {name} is {brighter:+.1%} in luminance and up to dE2000 {apart:.1f} "
            f"from what {others} told; are all of one type, were the others shuttered, has a lamp "
            "changed since the calibration?"
        )


def _chance(samples: _Samples, matrix: Array, covariance: Array, doubt: float) -> float:
    """Probability of readings as far from what others told, all variances `doubt` times as large."""
    slopes = samples.slopes(matrix).reshape(-1, 9)
    misfit = samples.misfit(matrix).ravel()
    spread = np.eye(len(misfit)) + slopes @ covariance @ slopes.T
    return float(chdtrc(len(misfit), misfit @ np.linalg.solve(spread, misfit) / doubt))


def _black_notes(
    blacks: dict[Spot, Array],
    dark: dict[Spot, Array],
    matrix: Array,
) -> Iterator[str]:
    for spot, xyz in blacks.items():
        read, told = float(xyz[1]), float(matrix[1] @ dark[spot])
        if max(read, told) > BLACKS_DIFFER * max(min(read, told), 0.0):
            yield (
                f"{spot_name(spot)}: the meter reads a black of {read:.3g} cd/m2, the calibration has "
                f"{told:.3g}; was there light in the room, or is it below the meter's range?"
            )


def _additivities(
    readings: Sequence[MeterReading], dark: dict[Spot, Array]
) -> Iterator[Additivity]:
    """Of each projector, from the places where all four patches were read."""
    each = {(*r.spot, r.patch): (r, float((r.xyz - dark[r.spot])[1])) for r in readings}
    whole = [s for s in dark if all((*s, p) in each for p in (*PRIMARIES, "white"))]
    for name in sorted({spot[0] for spot in whole}):
        spots = [spot for spot in whole if spot[0] == name]
        apart = [each[*spot, p] for spot in spots for p in PRIMARIES]
        white = [each[*spot, "white"] for spot in spots]
        total = sum(luminance for _, luminance in white)
        doubt = [METER_SIGMA[2] * r.xyz[1] / np.sqrt(r.count) for r, _ in (*apart, *white)]
        error = sum(luminance for _, luminance in apart) / total - 1
        yield Additivity(name, error, float(np.linalg.norm(doubt)) / total)


def _additivity_note(found: Additivity | None) -> Iterator[str]:
    if found is None:
        yield "no place has red, green, blue and white: whether light adds up stays untested"
    elif abs(found.error) > LARGEST_ADDITIVITY:
        yield (
            f"{found.projector}: red + green + blue are {found.error:+.1%} from white (the meter's own "
            f"error: {found.sigma:.1%}), so its light does not add up; switch off white boost or "
            "brilliant colour, calibrate and read again"
        )


def _excess_note(excess: float) -> Iterator[str]:
    if excess > 1:
        yield (
            f"the readings disagree by {np.sqrt(excess):.1f} times the meter's own error; the standard "
            "errors are widened by as much"
        )


def _contrast(lit: Sequence[MeterReading], blacks: dict[Spot, Array]) -> float | None:
    found = [
        float(r.xyz[1] / blacks[r.spot][1])
        for r in lit
        if r.patch == "white" and r.spot in blacks and blacks[r.spot][1] > 0
    ]
    return min(found, default=None)
