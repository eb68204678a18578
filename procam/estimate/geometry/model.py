"""Bundle adjustment of cameras, projectors and a round screen (science.md s.3).

An observation is a camera pixel that sees a projector pixel: its ray ends on the screen, and the
projector must have sent that pixel there. There are no points to solve for, so that the normal
equations are as small as the rig, whatever the number of observations.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from procam.kernels import (
    ObservationBlock,
    PlacedDevice,
    ShapeDerivatives,
    bundle_equations,
    bundle_residuals,
)
from procam.kernels.bundle.reference import bundle_rows, rays_sent
from procam.maths.geometry.lens_derivatives import lens_parameters
from procam.maths.geometry.lenses import Lens, unproject
from procam.maths.geometry.pose import Pose, rotation_matrix
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.model.optics import CameraModel, ProjectorModel

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Pair = tuple[str, str]  # camera, projector
POSE, PUPIL = 6, 2


@dataclass(frozen=True, slots=True)
class Observations:
    """Camera pixels (N, 2) that see projector pixels (N, 2), to `sigma_px` (N,) projector pixels."""

    camera_px: Array
    projector_px: Array
    sigma_px: Array

    def some(self, which: Index | NDArray[np.bool_] | slice) -> "Observations":
        """A part of them."""
        return Observations(self.camera_px[which], self.projector_px[which], self.sigma_px[which])

    def thinned(self, most: int) -> "Observations":
        """Every so many of them, so that about `most` are left, up to twice that."""
        return self.some(slice(None, None, max(1, len(self.sigma_px) // most)))


@dataclass(frozen=True, slots=True)
class RigGeometry:
    """What is solved for: screen, cameras (placed) and projectors by name."""

    shape: RoundShape
    cameras: Mapping[str, CameraModel]
    projectors: Mapping[str, ProjectorModel]

    def moved(self, step: Array) -> "RigGeometry":
        """The rig changed by a step (P,) of all its parameters, in the order of `ParameterLayout`."""
        layout = ParameterLayout.of(self)
        screen = step[layout.screen]
        shape = replace(
            self.shape,
            radius_m=self.shape.radius_m * float(np.exp(screen[0])),
            bumps=self.shape.bumps + screen[1:],
        )
        cameras, projectors = dict(self.cameras), dict(self.projectors)
        for name, columns in layout.cameras.items():
            if step[columns].any():  # a step of one parameter is common: see `mark_rows`
                cameras[name] = moved_camera(cameras[name], step[columns])
        for name, columns in layout.projectors.items():
            if step[columns].any():
                projectors[name] = moved_projector(projectors[name], step[columns])
        return RigGeometry(shape, cameras, projectors)


@dataclass(frozen=True, slots=True)
class ParameterLayout:
    """Where each device's parameters stand among the (P,) of a rig.

    Screen: log radius, bumps. Camera: turn [rad] and shift [m] in its own frame, lens (focal, centre,
    distortion), pupil. Projector: turn, shift, lens.
    """

    screen: slice
    cameras: Mapping[str, slice]
    projectors: Mapping[str, slice]
    count: int

    @classmethod
    def of(cls, rig: RigGeometry) -> "ParameterLayout":
        """The layout of a rig."""
        end = 1 + rig.shape.bumps.size
        screen, cameras, projectors = slice(0, end), {}, {}
        for name, camera in rig.cameras.items():
            cameras[name] = slice(end, end + POSE + lens_count(camera.lens) + PUPIL)
            end = cameras[name].stop
        for name, projector in rig.projectors.items():
            projectors[name] = slice(end, end + POSE + lens_count(projector.lens))
            end = projectors[name].stop
        return cls(screen, cameras, projectors, end)

    def columns(self, pair: Pair) -> Index:
        """Parameters that a camera's view of a projector depends on."""
        camera, projector = self.cameras[pair[0]], self.projectors[pair[1]]
        return np.r_[self.screen, camera, projector]


def lens_count(lens: Lens) -> int:
    """Number of parameters of a lens."""
    return 4 + lens.distortion.size


def moved_pose(pose: Pose, x: Array) -> Pose:
    """`pose` turned by the rotation vector x[:3] about the device and shifted by x[3:6] [m]."""
    turn = rotation_matrix(x[:3])
    return Pose(turn @ pose.rotation, turn @ pose.translation + x[3:6])


def moved_lens(lens: Lens, x: Array) -> Lens:
    """A lens changed by (L,): focal, centre [px], distortion."""
    return Lens(lens.kind, lens.focal + x[:2], lens.centre + x[2:4], lens.distortion + x[4:])


def moved_camera(camera: CameraModel, x: Array) -> CameraModel:
    """A placed camera changed by its parameters."""
    assert camera.camera_from_dome is not None
    return replace(
        camera,
        camera_from_dome=moved_pose(camera.camera_from_dome, x[:POSE]),
        lens=moved_lens(camera.lens, x[POSE:-PUPIL]),
        pupil=camera.pupil + x[-PUPIL:],
    )


def moved_projector(projector: ProjectorModel, x: Array) -> ProjectorModel:
    """A projector changed by its parameters."""
    return replace(
        projector,
        projector_from_dome=moved_pose(projector.projector_from_dome, x[:POSE]),
        lens=moved_lens(projector.lens, x[POSE:]),
    )


def camera_rays(camera: CameraModel, ray: Array) -> tuple[Array, Array]:
    """Origins (N, 3) [m] and unit directions (N, 3) in the dome's frame of rays (N, 3) in its own."""
    assert camera.camera_from_dome is not None
    return rays_sent(device_of(camera.camera_from_dome, camera.lens, camera.pupil), ray)


def points_seen(rig: RigGeometry, camera: str, camera_px: Array) -> Array:
    """Points (N, 3) [m] of the screen that a camera's pixels (N, 2) see; NaN where they miss it."""
    model = rig.cameras[camera]
    return rig.shape.meet(*camera_rays(model, unproject(camera_px, model.lens)))


def shape_derivatives(rig: RigGeometry, camera: str, ray: Array) -> ShapeDerivatives | None:
    """The screen's harmonics where a camera's rays (N, 3) meet it; None for an exact sphere.

    What the functions below take from here need not be of quite the same rig: see `RoundShape.relief`.
    """
    if rig.shape.exact:
        return None
    return rig.shape.relief(*camera_rays(rig.cameras[camera], ray))


def residuals(
    rig: RigGeometry,
    pair: Pair,
    seen: Observations,
    ray: Array | None = None,
    relief: ShapeDerivatives | None = None,
) -> Array:
    """Projector pixels (N, 2) that the rig predicts minus those that were seen.

    `ray` (N, 3): what the camera's lens makes of the pixels, if that is known already; `relief`:
    that of the screen where they meet it, as well.
    """
    ray, relief = _known(rig, pair, seen, ray, relief)
    return bundle_residuals(_sight(rig, pair), ray, seen.projector_px, relief)


def residual_slopes(
    rig: RigGeometry,
    pair: Pair,
    seen: Observations,
    ray: Array | None = None,
    relief: ShapeDerivatives | None = None,
) -> tuple[Array, Array]:
    """Residuals (N, 2) and their slopes (N, 2, K) by the parameters `ParameterLayout.columns(pair)`.

    With `ray` given the camera's lens and pupil count as fixed: their slopes are left 0.
    """
    lens_free = ray is None
    ray, relief = _known(rig, pair, seen, ray, relief)
    return bundle_rows(_sight(rig, pair), ray, seen.projector_px, relief, lens_free)


def normal_equations(
    rig: RigGeometry,
    seen: Mapping[Pair, Observations],
    weight: Mapping[Pair, Array],
    free: NDArray[np.bool_],
    rays: Mapping[Pair, Array],
    reliefs: Mapping[Pair, ShapeDerivatives | None] | None = None,
) -> tuple[Array, Array]:
    """Normal matrix (P, P) and gradient (P,) of the weighted squares of all residuals.

    `weight` (N,) per pair; `free` (P,) the parameters that are solved for, the others' rows stay 0;
    `rays` of the pairs whose camera's lens and pupil are fixed; `reliefs` as far as they are known.
    """
    layout = ParameterLayout.of(rig)
    matrix, gradient = np.zeros((layout.count, layout.count)), np.zeros(layout.count)
    for pair, some in seen.items():
        lens_free = pair not in rays
        ray, relief = _known(rig, pair, some, rays.get(pair), (reliefs or {}).get(pair))
        found = bundle_equations(
            _sight(rig, pair), ray, some.projector_px, weight[pair], relief, lens_free
        )
        columns = layout.columns(pair)
        used = free[columns]
        matrix[np.ix_(columns[used], columns[used])] += found.matrix[np.ix_(used, used)]
        gradient[columns[used]] += found.gradient[used]
    return matrix, gradient


def _known(
    rig: RigGeometry,
    pair: Pair,
    seen: Observations,
    ray: Array | None,
    relief: ShapeDerivatives | None,
) -> tuple[Array, ShapeDerivatives | None]:
    """Rays and relief of a camera's pixels, made where they are not given."""
    ray = unproject(seen.camera_px, rig.cameras[pair[0]].lens) if ray is None else ray
    return ray, shape_derivatives(rig, pair[0], ray) if relief is None else relief


def _sight(rig: RigGeometry, pair: Pair) -> ObservationBlock:
    """A camera and a projector as the kernels take them."""
    camera, projector = rig.cameras[pair[0]], rig.projectors[pair[1]]
    assert camera.camera_from_dome is not None
    return ObservationBlock(
        device_of(camera.camera_from_dome, camera.lens, camera.pupil),
        device_of(projector.projector_from_dome, projector.lens, np.zeros(PUPIL)),
        rig.shape.radius_m,
        rig.shape.bumps,
    )


def device_of(pose: Pose, lens: Lens, pupil: Array) -> PlacedDevice:
    """A camera or projector as the kernels take it."""
    return PlacedDevice(pose.rotation, pose.translation, lens.kind, lens_parameters(lens), pupil)
