"""Smooth errors of the main camera's light, and what they do to the feedback.

Vignetting that venue.toml has slightly wrong, and a pose or lens that is uncertain, change the light that
is attributed to the screen by a factor that varies slowly over the picture. Direct light falls on a part of
the screen and scattered light on all of it, so their ratio changes (docs/theory/photometry.md (U1)).
"""

from collections.abc import Sequence

import numpy as np

from procam.arrays import Array
from procam.estimate.geometry.camera_view import DomeView
from procam.estimate.geometry.model import ParameterLayout, RigGeometry, moved_camera
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.light.separation import SeparatedLight
from procam.maths.geometry.lenses import unproject
from procam.model.optics import CameraModel
from procam.model.screen import Dome

GRID = 150  # rows of the coarse grid; the errors are smooth
GREEN = 1
# standard errors of a camera's light that no key of venue.toml states: a lens whose vignetting is off its
# centre, from there to the edge of the picture; and theta squared, of a fit to photographs [1/rad^2]
SLOPE_SIGMA, VIGNETTING_SIGMA = 0.005, 0.002
NEGLIGIBLE = 1e-9  # relative, of the covariance's largest eigenvalue


def stride(height: int) -> int:
    """Every how many pixels of a picture the coarse grid has one."""
    return max(1, height // GRID)


def field_errors(geometry: GeometrySolution, dome: Dome, view: DomeView) -> Array:
    """Independent relative errors (F, h, w) of the light of pixels, a standard error each.

    They are those of vignetting, and of the camera's pose and lens by the covariance of the solve; (h, w)
    is every `stride`-th pixel of the camera.
    """
    camera = geometry.camera
    width, height = camera.size
    every = stride(height)
    x, y = np.meshgrid(np.arange(0, width, every), np.arange(0, height, every))
    pixels = np.stack([x, y], axis=-1).astype(float)
    return np.concatenate([_vignetting(camera, pixels), _geometry(geometry, dome, view, pixels)])


def _vignetting(camera: CameraModel, pixels: Array) -> Array:
    theta = np.arccos(np.clip(unproject(pixels, camera.lens)[..., 2], -1, 1))
    middle = (np.array(camera.size) - 1) / 2
    slopes = SLOPE_SIGMA * (pixels - middle) / middle.min()
    return np.stack([slopes[..., 0], slopes[..., 1], VIGNETTING_SIGMA * theta**2])


def _geometry(geometry: GeometrySolution, dome: Dome, view: DomeView, pixels: Array) -> Array:
    """Relative changes (F, h, w) of solid angle by each eigenvector of the camera's covariance."""
    every = stride(view.on_screen.shape[0])
    seen, camera = view.on_screen[::every, ::every], geometry.camera
    block = ParameterLayout.of(_without_projectors(geometry)).cameras[geometry.main]
    values, vectors = np.linalg.eigh(geometry.covariance[block, block])
    kept = values > NEGLIGIBLE * values[-1]
    steps = (vectors[:, kept] * np.sqrt(values[kept])).T

    def size(of: CameraModel) -> Array:
        return DomeView.of(of, dome, unproject(pixels, of.lens), seen).solid_angle_sr

    usual = np.maximum(size(camera), 1e-30)
    changes = [size(moved_camera(camera, step)) / usual - 1 for step in steps]
    return np.where(seen, np.array(changes).reshape(-1, *seen.shape), 0.0)


def _without_projectors(geometry: GeometrySolution) -> RigGeometry:
    rig = geometry.rig
    return RigGeometry(rig.shape, rig.cameras, {})  # cameras come first in the layout


def feedback_sigma(errors: Array, lights: Sequence[SeparatedLight], lit_sr: Array) -> float:
    """Relative standard error of m by errors (F, h, w) of `field_errors`, (U1).

    `lit_sr` (H, W) is the solid angle of the camera's pixels on the lit part.
    """
    every = stride(lit_sr.shape[0])
    solid = lit_sr[::every, ::every]
    weights = np.array([light.flux[GREEN] ** 2 for light in lights])
    change = np.zeros(len(errors))
    for light, weight in zip(lights, weights / weights.sum(), strict=True):
        scattered, direct = (
            np.nan_to_num(part[::every, ::every, GREEN]) * solid
            for part in (light.scattered, light.direct)
        )
        by_scattered, by_direct = (
            np.tensordot(errors, part, 2) / part.sum() for part in (scattered, direct)
        )
        change += weight * (by_scattered - by_direct)
    return float(np.linalg.norm(change))
