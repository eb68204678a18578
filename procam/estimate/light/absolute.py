"""Absolute colour and luminance, from readings of a hand meter and the calibration's relative light.

A camera's spectral response differs from that of the standard observer, above all for laser light, but
a camera compares places well. So the calibration gives the relative light in content channels at the
place of each reading, and the readings determine the 3 x 3 matrix from content light to XYZ [cd/m2], by
least squares (`meter_samples`). The result is then tested:
does the light of each projector add up, does every projector agree with the others, do the residuals
agree with the meter's errors, and does black agree with the calibration?
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array
from procam.errors import NotEnoughData
from procam.estimate.light.colour_spaces import colour_difference
from procam.estimate.light.meter_samples import METER_SIGMA, MeterSamples, probability, reduced_chi2
from procam.estimate.light.panel_light import PanelLight
from procam.model.calibration import Calibration
from procam.model.photometry import PRIMARIES, AbsoluteColour
from procam.model.reading import BLACK, MeterReading, Spot, spot_name

MIN_PATCHES = 3
CONTRADICTION = 1e-3  # probability of one projector's readings given the others'
LARGEST_ADDITIVITY = 0.02
LARGEST_RESIDUAL = 2.0  # mean dE2000
MAX_BLACK_RATIO = 1.5  # between the meter's black and the calibration's


@dataclass(frozen=True, slots=True)
class Additivity:
    """Additivity error of a projector: luminance (red + green + blue) / white - 1.

    `sigma` follows from the meter's errors. X and Z are not used: for a saturated blue, the meter's error
    of x and y is equivalent to 10 % of them.
    """

    projector: str
    error: float
    sigma: float


@dataclass(frozen=True, slots=True)
class AbsoluteLight:
    """Result of `fit_absolute`.

    Attributes
    ----------
    colour : from content radiance to XYZ; its covariance is from the meter's errors, taken as independent,
        without errors of the calibration.
    readings : without those of black. residual_de2000 : (n,) of each, for the reference white.
    additivity : of the projector with the largest error; None if all four patches were read nowhere.
    contrast : lowest ratio of white to black; None without a reading of black.
    notes : warnings for the user.
    """

    colour: AbsoluteColour
    readings: tuple[MeterReading, ...]
    residual_de2000: Array
    additivity: Additivity | None
    contrast: float | None
    notes: tuple[str, ...]

    @property
    def worst(self) -> tuple[MeterReading, float]:
        """The reading of largest residual, and that residual [dE2000]."""
        at = int(np.argmax(self.residual_de2000))
        return self.readings[at], float(self.residual_de2000[at])


def fit_absolute(readings: Sequence[MeterReading], calibration: Calibration) -> AbsoluteLight:
    """Solve for XYZ of the content channels from full-panel patches of one or more projectors.

    A reading is the total light of the patch, plus black. Black is the reading of black at the same
    place, which includes light of the room; without one it is the calibration's.

    Raises
    ------
    NotEnoughData
        With fewer than three independent patches.
    InputError
        For a reading where no camera sees the dome or where its projector does not light it.
    """
    lit = [reading for reading in readings if reading.patch != BLACK]
    patches = {reading.patch for reading in lit}
    if len(patches) < MIN_PATCHES:
        raise NotEnoughData(
            f"the meter's readings are of {', '.join(sorted(patches)) or 'no colour'}; read three or more "
            f"of {', '.join(PRIMARIES)} and white"
        )
    light = PanelLight(calibration)
    blacks = {r.spot: r.xyz for r in readings if r.patch == BLACK}
    dark = {r.spot: light.black(r) for r in readings}
    samples = MeterSamples.of(lit, light, blacks, dark)
    matrix, covariance = samples.solve()
    chi2, white = reduced_chi2(samples, matrix), matrix.sum(axis=1)
    each = _additivities(readings, {s: matrix @ d for s, d in dark.items()} | blacks)
    additivity = max(each, key=lambda found: abs(found.error), default=None)
    notes = [
        *_additivity_note(additivity),
        *_chi2_note(chi2),
        *_contradiction_note(samples, white),
        *_black_notes(blacks, dark, matrix),
    ]
    return AbsoluteLight(
        AbsoluteColour(matrix, covariance * chi2),
        tuple(lit),
        colour_difference(samples.xyz, samples.predicted(matrix), white),
        additivity,
        _contrast(lit, blacks),
        tuple(notes),
    )


def _contradiction_note(samples: MeterSamples, white: Array) -> Iterator[str]:
    """The projector that contradicts the others most, if chance hardly explains it."""
    found = []
    for name in np.unique(samples.name):
        own, rest = samples.only(samples.name == name), samples.only(samples.name != name)
        if len(set(rest.patch)) >= MIN_PATCHES:
            matrix, covariance = rest.solve()
            # an error that all share, such as white boost, is no contradiction
            scale = reduced_chi2(rest, matrix)
            chance = probability(own, matrix, covariance, scale)
            found.append((chance, name, own, own.predicted(matrix)))
    chance, name, own, predicted = min(
        found, key=lambda each: each[0], default=(1.0, "", samples, white)
    )
    if chance < CONTRADICTION:
        brighter = float(np.exp(np.mean(np.log(own.xyz[:, 1] / predicted[:, 1]))) - 1)
        apart = float(colour_difference(own.xyz, predicted, white).max())
        others = ", ".join(np.unique(samples.name[samples.name != name]))
        yield (
            f"readings of {name} contradict those of {others}: {brighter:+.1%} in luminance, up to dE2000 "
            f"{apart:.1f}; check that all projectors are of one type, that the others were shuttered, and "
            "that no lamp has changed since the calibration"
        )


def _black_notes(
    blacks: dict[Spot, Array], dark: dict[Spot, Array], matrix: Array
) -> Iterator[str]:
    for spot, xyz in blacks.items():
        read, known = float(xyz[1]), float(matrix[1] @ dark[spot])
        if max(read, known) > MAX_BLACK_RATIO * max(min(read, known), 0.0):
            yield (
                f"{spot_name(spot)}: black is {read:.3g} cd/m2 by the meter and {known:.3g} by the "
                "calibration; check for light in the room, and the meter's range"
            )


def _additivities(
    readings: Sequence[MeterReading], dark: dict[Spot, Array]
) -> Iterator[Additivity]:
    """Additivity of each projector, from the places where all four patches were read."""
    each = {(*r.spot, r.patch): (r, float((r.xyz - dark[r.spot])[1])) for r in readings}
    whole = [s for s in dark if all((*s, p) in each for p in (*PRIMARIES, "white"))]
    for name in sorted({spot[0] for spot in whole}):
        spots = [spot for spot in whole if spot[0] == name]
        apart = [each[*spot, p] for spot in spots for p in PRIMARIES]
        white = [each[*spot, "white"] for spot in spots]
        total = sum(luminance for _, luminance in white)
        sigma = [METER_SIGMA[2] * r.xyz[1] / np.sqrt(r.count) for r, _ in (*apart, *white)]
        error = sum(luminance for _, luminance in apart) / total - 1
        yield Additivity(name, error, float(np.linalg.norm(sigma)) / total)


def _additivity_note(found: Additivity | None) -> Iterator[str]:
    if found is None:
        yield "no place has red, green, blue and white, so additivity is not tested"
    elif abs(found.error) > LARGEST_ADDITIVITY:
        yield (
            f"{found.projector}: red + green + blue differ by {found.error:+.1%} from white (meter's "
            f"error {found.sigma:.1%}), so its light does not add up; switch off white boost or "
            "brilliant colour, calibrate and read again"
        )


def _chi2_note(chi2: float) -> Iterator[str]:
    if chi2 > 1:
        yield (
            f"the residuals of the readings are {np.sqrt(chi2):.1f} times the meter's error; the standard "
            "errors are scaled up by as much"
        )


def _contrast(lit: Sequence[MeterReading], blacks: dict[Spot, Array]) -> float | None:
    found = [
        float(r.xyz[1] / blacks[r.spot][1])
        for r in lit
        if r.patch == "white" and r.spot in blacks and blacks[r.spot][1] > 0
    ]
    return min(found, default=None)
