"""The bias of few wide fringes caused by scattered light, measured where no light falls directly.

The total flux of each pattern changes with its shift, and so does the scattered light. A camera pixel
therefore sees the sum of two waves, that of the direct and that of the scattered light, and its phase is
biased (docs/theory/scatter-bias.md). Pixels without direct light see the wave of the scattered light alone.
There the flux of each pattern relative to white is measured (`flux_share_maps`); from it and the wave follows
the scattered light of each pixel (`scattered_light`), and `remove_phasor` takes the wave out.
"""

import numpy as np
from numpy.typing import NDArray

from procam.arrays import AnyArray, Array, BoolArray, FloatArray, Map
from procam.errors import NotEnoughData
from procam.maths.polynomials import fit_surface
from procam.maths.warp import block_mean, grow

DIM = 0.1  # of the white - black of the median lit pixel: darker pixels are off the screen
MIN_PIXELS = 1000
BLOCK_PX, DEGREE = 8, 2  # of the polynomial over blocks of camera pixels
LIT_AMPLITUDE = (
    0.2  # of white - black: the wave of direct light is stronger, that of the flux weaker
)
AWAY_PX = 12  # from lit pixels: farther than the blur reaches
HALF_FULL = 0.5  # of a block
LEAST_Q = (
    0.01  # where the wave of the flux is nearly as deep as that of direct light, q is not smaller
)
ODD_STEPS = 7  # with as many steps the third harmonic can be distinguished from the wave


def remove_scatter_bias(
    frames: AnyArray, white: AnyArray, black: AnyArray, amplitude: Map, shifts: Array
) -> Map:
    """Photographs (K, H, W) of equal `shifts` of one period, as if all had half of white's flux.

    `amplitude` (H, W) of the wave shows which pixels have direct light. Errors as of `flux_share_maps`.
    """
    span = np.subtract(white, black, dtype=np.float32)
    near = grow(amplitude > LIT_AMPLITUDE * span, AWAY_PX)
    shares = flux_share_maps(frames, white, black, near)
    scattered = scattered_light(frames, white, black, shares, shifts)
    return remove_phasor(frames, shares, scattered)


def flux_share_maps(frames: AnyArray, white: AnyArray, black: AnyArray, lit: BoolArray) -> Map:
    """Flux (K, H, W) of K patterns, 0 for black and 1 for white, by the pixels that see no direct light.

    It varies smoothly over the photograph, for screens that are no sphere: a polynomial over the camera's
    pixels, fitted where no light falls directly and extrapolated over the lit part.

    Parameters
    ----------
    frames, white, black : photographs (K, H, W), (H, W), (H, W), linear, in one unit.
    lit : (H, W) pixels that may have direct light, borders and blur included.

    Raises
    ------
    NotEnoughData : too little of the screen is without direct light.
    """
    span, unlit = _unlit(white, black, lit)
    weight = block_mean(unlit.astype(np.float32), BLOCK_PX)
    rows, columns = np.nonzero(weight > HALF_FULL)
    total = block_mean(np.where(unlit, span, 0), BLOCK_PX)[rows, columns]
    values = [
        block_mean(np.where(unlit, np.subtract(f, black, dtype=np.float32), 0), BLOCK_PX)
        for f in frames
    ]
    ratios = np.stack([v[rows, columns] / total for v in values], axis=1).astype(float)
    middle = np.stack([columns, rows], axis=1).astype(float) * BLOCK_PX + (BLOCK_PX - 1) / 2
    surface = fit_surface(middle, ratios, DEGREE)
    fitted = surface(middle)
    low, high = fitted.min(axis=0), fitted.max(axis=0)
    slack = high - low  # limits the extrapolation
    height, width = lit.shape
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    maps = surface(pixels.reshape(-1, 2).astype(float)).clip(low - slack, high + slack)
    maps = maps.reshape(height, width, -1)
    return np.ascontiguousarray(np.moveaxis(maps, -1, 0), np.float32)


def scattered_light(
    frames: AnyArray, white: AnyArray, black: AnyArray, shares: FloatArray, shifts: Array
) -> Map:
    """The scattered part (H, W) of white - black, from equal `shifts` (K,) [rad] of ONE period.

    `shares` (K,) or (K, H, W) of white's flux. With white - black = D + G, the photographs' wave
    is d D e^(i phase) + f G, where d and f are known: a quadratic equation for D.
    """
    span = np.subtract(white, black, dtype=float)
    wave = _phasor(frames, shifts)
    of_flux = _phasor(shares, shifts)
    free = wave - span * of_flux
    depth = 0.5
    direct = _direct(free, of_flux, depth)
    if len(frames) >= ODD_STEPS:
        depth -= _third_harmonic(frames, shifts, free + direct * of_flux, direct)
        direct = _direct(free, of_flux, depth)
    return np.clip(span - direct, 0, np.maximum(span, 0)).astype(np.float32)


def remove_phasor(frames: AnyArray, shares: FloatArray, scattered: Map) -> Map:
    """Photographs (K, H, W) as if all patterns had half of white's flux.

    `shares` (K,) or (K, H, W); `scattered` (H, W) is the scattered part of white - black.
    """
    surplus = np.asarray(shares, np.float32) - np.float32(0.5)
    surplus = surplus.reshape(len(frames), *(surplus.shape[1:] or (1, 1)))
    return np.asarray(frames - surplus * scattered, np.float32)


def _unlit(white: AnyArray, black: AnyArray, lit: BoolArray) -> tuple[Map, BoolArray]:
    """White - black (H, W), and the screen's pixels (H, W) without direct light."""
    span = np.subtract(white, black, dtype=np.float32)
    level = float(np.median(span[lit])) if lit.any() else np.inf
    unlit = ~lit & (span > DIM * level)
    if unlit.sum() < MIN_PIXELS:
        raise NotEnoughData(
            f"flux shares: only {unlit.sum()} pixels of the screen have no direct light, and at least "
            f"{MIN_PIXELS} are needed; some of the screen must lie outside this projector's picture"
        )
    return span, np.asarray(unlit)


def _phasor(values: AnyArray, shifts: Array) -> NDArray[np.complex128]:
    """Complex amplitude (...) of values (K, ...) on the wave cos(phase - shift)."""
    return np.asarray(2 / len(shifts) * np.tensordot(np.exp(1j * shifts), values, axes=1))


def _direct(free: NDArray[np.complex128], of_flux: NDArray[np.complex128], depth: float) -> Array:
    """Positive root D of |free + D of_flux| = depth D."""
    q = np.maximum(depth**2 - np.abs(of_flux) ** 2, LEAST_Q)
    half = np.real(free * np.conj(of_flux))
    return np.asarray((half + np.sqrt(half**2 + q * np.abs(free) ** 2)) / q)


def _third_harmonic(
    frames: AnyArray, shifts: Array, wave: NDArray[np.complex128], direct: Array
) -> float:
    """Depth that the wave loses by a response that keeps black and white; without loss it is 1/2."""
    third = _phasor(frames, 3 * shifts) * np.exp(-3j * np.angle(wave))
    bright = direct > 0.5 * np.quantile(direct, 0.9)
    return float(np.real(third[bright]).sum() / direct[bright].sum())
