"""Self-calibration of sinusoidal pictures: blur, harmonic, flux surplus and noise.

Every pixel of an axis shares four properties: the blur that lowers the amplitude of short periods, the
second harmonic that a wrong gamma adds, each picture's flux beyond half of white's, and the noise law.
They are estimated from the residuals of some forty thousand per-pixel fits. A Gauss-Newton iteration
with priors solves for the first three, with every pixel's offset, amplitude and column eliminated
(variable projection, Golub and Pereyra 1973, doi:10.1137/0710036). Each step also updates the pixels'
scattered light and so the data, so a fixed number of steps replaces a descent on one cost.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from procam import kernels
from procam.arrays import AnyArray, Array, BoolArray, Map
from procam.errors import NotEnoughData
from procam.estimate.camera.noise import (
    CUT_MEAN,
    CUT_SIGMAS,
    NO_NOISE,
    NoiseLaw,
    fit_noise_law,
)
from procam.estimate.structured_light.cells import Cells, find_in_cells
from procam.maths.codes.phase import (
    FIT_PARTS,
    WaveDistortion,
    WaveFit,
    Waves,
    search_columns,
    shared_sensitivity,
)
from procam.maths.statistics import robust_sigma

MAX_PIXELS = 40_000  # evenly picked; more change nothing
MIN_PIXELS = 50
UNKNOWNS = 3  # of a pixel: offset, amplitude, column
ROUNDS = 4
PRIOR_BLUR_PX2, PRIOR_HARMONIC, PRIOR_SURPLUS = 20.0, 0.1, 0.02  # sigmas about zero
MAX_BLUR_PX2, MAX_HARMONIC = 100.0, 0.3
MIN_AMPLITUDE = 0.1  # of a bright pixel's: below, there is no direct light
BRIGHT_QUANTILE = 0.9
MAX_RESIDUAL = 6.0  # over the median of bright pixels: above, edges and mixtures


@dataclass(frozen=True, slots=True)
class SinusoidImages:
    """The photographs of one axis.

    Attributes
    ----------
    frames : K photographs (H, W).
    waves, length : their waves; columns of the panel.
    span : (H, W) white - black.
    usable : (H, W) pixels for the self-calibration.
    dropped : K masks (H, W) of saturated or dark samples.
    variance : (H, W) of a sample, for merged exposures; None to estimate a noise law.
    surplus_sigma : prior of the pictures' flux beyond half of white's, as a share of it.
    cells : what the stripes beneath the sinusoids show, if there are any.
    restored : how many of the frames were computed from white and black.
    """

    frames: Sequence[AnyArray]
    waves: Waves
    length: int
    span: Map
    usable: BoolArray
    dropped: Sequence[BoolArray]
    variance: Map | None = None
    surplus_sigma: float = PRIOR_SURPLUS
    cells: Cells | None = None
    restored: int = 0

    @property
    def hides_harmonic(self) -> bool:
        """Whether a wrong gamma moves columns and leaves hardly a residual: three steps, and one more."""
        return self.waves.base == UNKNOWNS and len(self.frames) - self.restored <= UNKNOWNS + 1


@dataclass(frozen=True, slots=True)
class SelfCalibration:
    """Shared properties of one axis; `surplus` (K,) is each picture's flux beyond half of white's."""

    distortion: WaveDistortion
    surplus: Array
    noise: NoiseLaw = NO_NOISE


def self_calibrate(pictures: SinusoidImages) -> SelfCalibration:
    """Estimate blur, harmonic, flux surplus and noise of one axis from pixels without dropped samples.

    Raises
    ------
    NotEnoughData
        Too few pixels, or too few in which the wave moves.

    Notes
    -----
    Scattered light adds to each picture in proportion to its flux. The surplus is that proportion beyond
    one half, and so the phasor by which scattered light biases columns. Given variances become the unit
    of the noise law.
    """
    where = np.flatnonzero(pictures.usable & ~np.logical_or.reduce(pictures.dropped))
    if where.size < MIN_PIXELS:
        raise NotEnoughData(
            f"waves: only {where.size} pixels have light and no saturated sample; at least {MIN_PIXELS} are "
            "needed. Check that the projector is on and the exposure right"
        )
    where = where[:: max(1, where.size // MAX_PIXELS)]
    raw = np.stack([np.ravel(f)[where] for f in pictures.frames], axis=1).astype(float)
    full = np.ravel(pictures.span)[where].astype(float)
    if pictures.variance is not None:
        scale = 1 / np.sqrt(np.ravel(pictures.variance)[where].astype(float))
        raw, full = raw * scale[:, None], full * scale
    cells = None if pictures.cells is None else pictures.cells.at(where)
    now = SelfCalibration(WaveDistortion(), np.zeros(raw.shape[1]))
    if cells is not None and raw.shape[1] == UNKNOWNS:
        return replace(now, noise=_level_noise(raw, pictures, cells))
    scattered = np.zeros(len(where))
    for _ in range(ROUNDS):
        samples = raw - scattered[:, None] * now.surplus
        fit, seen = _fitted(samples, pictures, now.distortion, cells)
        direct = 2 / now.distortion.depth(pictures.waves) * fit.amplitude
        scattered[seen] = np.maximum(full[seen] - direct, 0)
        now = _step(samples[seen], pictures, now, fit, scattered[seen])
    fit, _ = _fitted(raw - scattered[:, None] * now.surplus, pictures, now.distortion, cells)
    return replace(now, noise=_residual_noise(fit, raw.shape[1]))


def _fitted(
    samples: Array, pictures: SinusoidImages, distortion: WaveDistortion, cells: Cells | None
) -> tuple[WaveFit, BoolArray]:
    """Fit of the pixels with a visible wave among samples (n, K), and which (n,) these are."""
    columns = list(np.ascontiguousarray(samples.T, np.float32))
    found = find_columns(columns, pictures.waves, distortion, pictures.length, cells)
    seen = np.isfinite(found.position)
    if seen.sum() < MIN_PIXELS:
        raise NotEnoughData(
            f"waves: they move in only {seen.sum()} pixels; at least {MIN_PIXELS} are needed. Check that the "
            "projector did not freeze on one picture"
        )
    parts = (found.position, found.variance, found.offset, found.amplitude, found.residual)
    return WaveFit(*(part[seen].astype(float) for part in parts)), seen


def find_columns(
    frames: Sequence[AnyArray],
    waves: Waves,
    distortion: WaveDistortion,
    length: int,
    cells: Cells | None = None,
) -> kernels.PhaseFit:
    """Best column of every pixel; waves of a single period without cells give it only within the period.

    Without a base set of three pictures, every pixel searches all columns.
    """
    if cells is not None:
        return find_in_cells(frames, waves, distortion, length, cells)
    if waves.single:
        length = 1
    if waves.base >= UNKNOWNS:
        modulation, harmonics = distortion.modulation(waves), distortion.harmonics(waves)
        return kernels.search_phase(
            frames, waves.periods, waves.shifts, modulation, harmonics, waves.base, length
        )
    samples = np.stack([np.ravel(f) for f in frames], axis=1).astype(float)
    fit, margin = search_columns(samples, waves, distortion, length)
    parts = (fit.x, fit.variance, fit.amplitude, fit.offset, fit.residual, margin)
    return kernels.PhaseFit(*(p.reshape(frames[0].shape).astype(np.float32) for p in parts))


def _step(
    samples: Array, pictures: SinusoidImages, now: SelfCalibration, fit: WaveFit, scattered: Array
) -> SelfCalibration:
    """One Gauss-Newton step from the samples (n, K), their fit and scattered light (n,)."""
    use = _representative(fit)
    fit = WaveFit(*(getattr(fit, name)[use] for name in FIT_PARTS))
    residual, by_shared, basis = shared_sensitivity(
        samples[use], pictures.waves, now.distortion, fit
    )
    matrix, gradient = _shared_equations(residual, by_shared, basis, scattered[use])
    noise = max(float(np.mean(residual**2)), 1e-20)
    values = np.r_[now.distortion.blur_px2, now.distortion.harmonic, now.surplus]
    size = np.r_[PRIOR_BLUR_PX2, PRIOR_HARMONIC, np.full(len(now.surplus), pictures.surplus_sigma)]
    gradient = gradient / noise - values / size**2
    values = values + np.linalg.solve(matrix / noise + np.diag(size**-2), gradient)
    blur_px2 = float(np.clip(values[0], 0.0, MAX_BLUR_PX2))
    harmonic = float(np.clip(values[1], -MAX_HARMONIC, MAX_HARMONIC))
    return SelfCalibration(WaveDistortion(blur_px2, harmonic), values[2:])


def _shared_equations(
    residual: Array, by_shared: Array, basis: Array, scattered: Array
) -> tuple[Array, Array]:
    """Normal matrix (2 + K, 2 + K) and gradient of blur, harmonic and each picture's surplus.

    A surplus adds that share of the scattered light (n,) to one picture. The pixel's own fit absorbs
    the component along its basis.
    """
    count = residual.shape[1]
    absorbed = (basis * scattered[:, None]).transpose(2, 0, 1).reshape(count, -1)
    by_flux = np.sum(scattered**2) * np.eye(count) - absorbed @ absorbed.T
    both = np.einsum("ink,n->ik", by_shared, scattered)
    own = np.einsum("ink,jnk->ij", by_shared, by_shared)
    matrix = np.block([[own, both], [both.T, by_flux]])
    return matrix, np.r_[np.einsum("ink,nk->i", by_shared, residual), scattered @ residual]


def _representative(fit: WaveFit) -> BoolArray:
    """Pixels with a clear wave that the model explains: no edges, no mixtures, no unlit pixels."""
    bright = fit.amplitude > MIN_AMPLITUDE * np.quantile(fit.amplitude, BRIGHT_QUANTILE)
    if not bright.any():
        return np.isfinite(fit.residual)
    limit = MAX_RESIDUAL * np.median(fit.residual[bright]) + 1e-12
    return np.asarray(bright & (fit.residual <= limit))


def _residual_noise(fit: WaveFit, pictures: int) -> NoiseLaw:
    """Noise law from the residual variance of the representative pixels.

    Leaving out large residuals lowers the mean of the others, as it does that of a chi squared.
    """
    use, free = _representative(fit), pictures - UNKNOWNS
    most = MAX_RESIDUAL * chi2.median(free)
    kept = chi2.cdf(most, free + 2) / chi2.cdf(most, free)
    return fit_noise_law(fit.offset[use], fit.residual[use] / (free * kept))


def _level_noise(raw: Array, pictures: SinusoidImages, cells: Cells) -> NoiseLaw:
    """Noise law from white and black, for three sinusoids, whose own fit leaves no residual.

    The mean of white and black less the offset of the fit has 1/2 and the sum of the squared weights of a
    sample's variance. A part in proportion to the amplitude comes from the projector's response.
    """
    fit, seen = _fitted(raw, pictures, WaveDistortion(), cells)
    use = _representative(fit)
    miss = (cells.middle[seen] - fit.offset)[use] / fit.amplitude[use]
    rest = (miss - np.median(miss)) * fit.amplitude[use]
    shifts = pictures.waves.shifts
    rows = np.stack([np.ones(UNKNOWNS), np.cos(shifts), np.sin(shifts)], axis=1)
    share = 0.5 + float(np.sum(np.linalg.inv(rows)[0] ** 2))
    cut = np.abs(rest) <= CUT_SIGMAS * robust_sigma(rest)
    return fit_noise_law(fit.offset[use][cut], rest[cut] ** 2 / (share * CUT_MEAN))
