"""Random draws of a projector's directions, for the uncertainty of what is computed from them."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from procam.arrays import Array
from procam.estimate.geometry.model import RigGeometry
from procam.estimate.geometry.pixel_directions import (
    CELL_PX,
    SMOOTH,
    DirectionsOf,
    PixelDirections,
    fit_pixel_directions,
    model_directions,
    panel_grid,
    ray_directions,
)
from procam.estimate.geometry.screen_points import intersect_screen
from procam.estimate.geometry.solve import GeometrySolution
from procam.maths.geometry.sphere import ARCMIN, normalise
from procam.maths.warp import blur, sample

SIGMA_DRAWS = 40
FINE = 3  # samples per cell of random fields; interpolation between them keeps their variance


def sample_directions(
    solution: GeometrySolution,
    fitted: PixelDirections,
    pixels: Array,
    count: int,
    rng: np.random.Generator,
) -> Array:
    """Draws (count, ..., 3) of a projector's unit directions from their uncertainty.

    The standard deviation over draws is the standard error of a quantity that is computed from
    directions, such as a solid angle. Each draw moves the whole rig by a step from the solution's
    covariance; pixels follow their model or, with the weight of the measured field, the rays of the
    best camera. A random field with the smoothness of the measured one adds the latter's uncertainty.

    Parameters
    ----------
    solution, fitted : a solved rig, and the directions of one of its projectors.
    pixels : (..., 2) points of the panel [px]; no side longer than 32766.
    count : number of draws.
    rng : source of the draws. The same state gives the same rigs for another projector, so that
        seams can be drawn too.

    Returns
    -------
    (count, ..., 3); NaN where a pixel misses the screen.
    """
    mean = fitted.at(pixels).reshape(-1, 3)
    sources = _sources(fitted, pixels, mean)
    centre = _weighted_mean(sources, solution.rig)
    sigma = np.sqrt(sample(fitted.unknown, fitted.nodes(pixels)).reshape(-1, 1) / 2)
    drawn = np.empty((count, *mean.shape))
    for i, step in enumerate(_steps(solution.covariance, count, rng)):
        shift = _weighted_mean(sources, solution.rig.moved(step)) - centre
        drawn[i] = normalise(mean + shift + sigma * _smooth_noise(fitted.size, pixels, rng))
    return drawn.reshape(count, *pixels.shape[:-1], 3)


def direction_sigmas(solution: GeometrySolution) -> tuple[float, float]:
    """Standard errors [arcmin] of the directions of all projectors, root mean squares over their panels.

    The first is of directions relative to each other: a rotation of the whole rig, which the survey of
    marks decides, is taken from each draw. The second includes it.
    """
    drawn, means = list[Array](), list[Array]()
    for name, projector in solution.rig.projectors.items():
        same = np.random.default_rng(0)  # and so the same rigs for all
        pixels = panel_grid(projector.size).reshape(-1, 2)
        fitted = fit_pixel_directions(solution, name)
        drawn.append(sample_directions(solution, fitted, pixels, SIGMA_DRAWS, same))
        means.append(fitted.at(pixels[None])[0])
    mean, draws = np.concatenate(means), np.concatenate(drawn, axis=1)
    known = np.isfinite(mean).all(axis=1) & np.isfinite(draws).all(axis=(0, 2))
    mean, draws = mean[known], draws[:, known]
    turned = [Rotation.align_vectors(mean, one)[0].apply(one) for one in draws]
    relative, absolute = (np.sum((x - mean) ** 2, axis=-1) for x in (np.array(turned), draws))
    return float(ARCMIN * np.sqrt(relative.mean())), float(ARCMIN * np.sqrt(absolute.mean()))


def _sources(
    fitted: PixelDirections, pixels: Array, mean: Array
) -> list[tuple[Array, DirectionsOf]]:
    """Weights (N, 1) and directions of the model and of each camera's rays, for pixels (..., 2)."""
    rig, flat, name = fitted.rig, pixels.reshape(-1, 2), fitted.projector.name
    points, nodes = intersect_screen(rig.shape, np.zeros(3), mean), fitted.nodes(pixels)
    modelled, sources = np.ones((len(flat), 1)), []
    for camera, weights in fitted.rays.items():
        if weights.any():
            directions = ray_directions(rig, camera, points)[1]
            sees = np.isfinite(directions(rig)).all(axis=1, keepdims=True)
            share = np.where(sees, sample(weights, nodes).reshape(-1, 1), 0.0)
            modelled = modelled - share
            sources.append((share, directions))
    return [(modelled, lambda r: model_directions(r, r.projectors[name], flat)), *sources]


def _weighted_mean(sources: Sequence[tuple[Array, DirectionsOf]], rig: RigGeometry) -> Array:
    """Weighted mean (N, 3) of the sources' directions for a rig."""
    parts = [np.where(share > 0, share * directions(rig), 0.0) for share, directions in sources]
    return np.asarray(np.sum(parts, axis=0))


def _steps(covariance: Array, count: int, rng: np.random.Generator) -> Array:
    """Draws (count, P) of the rig's parameters from their covariance (P, P)."""
    sigma = np.sqrt(np.diag(covariance))
    scale = np.where(sigma > 0, sigma, 1.0)  # parameters have different units
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    root = vectors * np.sqrt(np.maximum(values, 0))
    return np.asarray(rng.standard_normal((count, len(sigma))) @ root.T * sigma)


def _smooth_noise(size: tuple[int, int], pixels: Array, rng: np.random.Generator) -> Array:
    """Random vectors (N, 3) of unit variance per component at pixels (..., 2), smooth over `SMOOTH`."""
    width, pitch = SMOOTH * FINE, CELL_PX / FINE
    margin = int(4 * width)  # keeps the variance at the border, where blur mirrors the field
    columns, rows = (int(n / pitch) + 2 + 2 * margin for n in size)
    white = rng.standard_normal((rows, columns, 3), np.float32)
    noise = blur(white, width) * np.sqrt(4 * np.pi) * width
    return np.asarray(sample(noise, (pixels + 0.5) / pitch + margin).reshape(-1, 3), float)
