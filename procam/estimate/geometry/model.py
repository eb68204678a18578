"""Bundle adjustment of cameras, projectors and a round screen (docs/theory/geometry.md (G2)).

An observation is a camera pixel that sees a projector pixel. The camera's ray is intersected with
the screen and the point projected into the projector; the residual is the difference to the
projector pixel that was decoded. No point on the screen is an unknown, so the normal equations have
one block per device, whatever the number of observations.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import Array, BoolArray, IndexArray
from procam.kernels import (
    ObservationBlock,
    PlacedDevice,
    ShapeDerivatives,
    bundle_equations,
    bundle_residuals,
)
from procam.kernels.bundle.reference import bundle_rows, rays_sent
from procam.maths.geometry.lenses import (
    Lens,
    lens_of_parameters,
    lens_parameters,
    project,
    unproject,
)
from procam.maths.geometry.pose import Pose
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.model.optics import CameraModel, ProjectorModel

Pair = tuple[str, str]  # camera, projector
POSE, PUPIL = 6, 2
PUPIL_STEPS = 3  # each gains three digits: pupils move by millimetres, screens are metres away


@dataclass(frozen=True, slots=True)
class Observations:
    """Camera pixels (N, 2), the projector pixels (N, 2) that they see, and the latter's `sigma_px` (N,).

    They are centres of patches of the panel with edges of `patch_px`; 0 for places that are seen themselves.
    """

    camera_px: Array
    projector_px: Array
    sigma_px: Array
    patch_px: float = 0.0

    def some(self, which: IndexArray | BoolArray | slice) -> "Observations":
        """A subset."""
        camera_px, projector_px = self.camera_px[which], self.projector_px[which]
        return Observations(camera_px, projector_px, self.sigma_px[which], self.patch_px)

    def thinned(self, most: int) -> "Observations":
        """Every n-th observation, so that between `most` and twice as many remain."""
        return self.some(slice(None, None, max(1, len(self.sigma_px) // most)))


@dataclass(frozen=True, slots=True)
class RigGeometry:
    """The unknowns of a solve: screen, cameras with poses, and projectors by name."""

    shape: RoundShape
    cameras: Mapping[str, CameraModel]
    projectors: Mapping[str, ProjectorModel]

    def moved(self, step: Array) -> "RigGeometry":
        """The rig after a step (P,) of its parameters, in the order of `ParameterLayout`."""
        layout = ParameterLayout.of(self)
        screen = step[layout.screen]
        shape = replace(
            self.shape,
            radius_m=self.shape.radius_m * float(np.exp(screen[0])),
            harmonic_coefficients=self.shape.harmonic_coefficients + screen[1:],
        )
        cameras, projectors = dict(self.cameras), dict(self.projectors)
        for name, columns in layout.cameras.items():
            if step[columns].any():  # numerical derivatives step one parameter at a time
                cameras[name] = moved_camera(cameras[name], step[columns])
        for name, columns in layout.projectors.items():
            if step[columns].any():
                projectors[name] = moved_projector(projectors[name], step[columns])
        return RigGeometry(shape, cameras, projectors)


@dataclass(frozen=True, slots=True)
class ParameterLayout:
    """Positions of each device's parameters among the (P,) of a rig.

    Screen: log radius, harmonic coefficients. Camera: rotation [rad] and translation [m] in its own
    frame, lens (focal, centre, distortion), pupil. Projector: rotation, translation, lens.
    """

    screen: slice
    cameras: Mapping[str, slice]
    projectors: Mapping[str, slice]
    count: int

    @classmethod
    def of(cls, rig: RigGeometry) -> "ParameterLayout":
        """The layout of a rig."""
        end = 1 + rig.shape.harmonic_coefficients.size
        screen, cameras, projectors = slice(0, end), {}, {}
        for name, camera in rig.cameras.items():
            cameras[name] = slice(end, end + POSE + lens_count(camera.lens) + PUPIL)
            end = cameras[name].stop
        for name, projector in rig.projectors.items():
            projectors[name] = slice(end, end + POSE + lens_count(projector.lens))
            end = projectors[name].stop
        return cls(screen, cameras, projectors, end)

    def columns(self, pair: Pair) -> IndexArray:
        """Indices of the parameters that a camera's observations of a projector depend on."""
        camera, projector = self.cameras[pair[0]], self.projectors[pair[1]]
        return np.r_[self.screen, camera, projector]


def lens_count(lens: Lens) -> int:
    """Number of parameters of a lens."""
    return 4 + lens.distortion.size


def moved_camera(camera: CameraModel, x: Array) -> CameraModel:
    """A camera with a pose after a step of its parameters."""
    assert camera.camera_from_dome is not None
    return replace(
        camera,
        camera_from_dome=camera.camera_from_dome.moved(x),
        lens=lens_of_parameters(camera.lens, lens_parameters(camera.lens) + x[POSE:-PUPIL]),
        pupil=camera.pupil + x[-PUPIL:],
    )


def moved_projector(projector: ProjectorModel, x: Array) -> ProjectorModel:
    """A projector after a step of its parameters."""
    return replace(
        projector,
        projector_from_dome=projector.projector_from_dome.moved(x),
        lens=lens_of_parameters(projector.lens, lens_parameters(projector.lens) + x[POSE:]),
    )


def camera_rays(camera: CameraModel, ray: Array) -> tuple[Array, Array]:
    """Origins (N, 3) [m] and unit directions (N, 3) in the dome frame of a camera's rays (N, 3)."""
    assert camera.camera_from_dome is not None
    return rays_sent(device_of(camera.camera_from_dome, camera.lens, camera.pupil), ray)


def project_to_camera(camera: CameraModel, points: Array) -> Array:
    """Pixels (..., 2) at which a camera sees points (..., 3) [m] of the dome frame."""
    assert camera.camera_from_dome is not None
    own = from_pupil = camera.camera_from_dome.apply(points)
    if camera.pupil.any():
        for _ in range(PUPIL_STEPS):
            aside = np.linalg.norm(from_pupil[..., :2], axis=-1)
            square = np.arctan2(aside, from_pupil[..., 2]) ** 2
            forward = camera.pupil[0] * square + camera.pupil[1] * square**2
            from_pupil = own - forward[..., None] * np.array([0.0, 0.0, 1.0])
    return project(from_pupil, camera.lens)


def points_seen(rig: RigGeometry, camera: str, camera_px: Array) -> Array:
    """Points (N, 3) [m] of the screen that a camera's pixels (N, 2) see; NaN where they miss."""
    model = rig.cameras[camera]
    return rig.shape.intersect(*camera_rays(model, unproject(camera_px, model.lens)))


def screen_derivatives(rig: RigGeometry, camera: str, ray: Array) -> ShapeDerivatives | None:
    """The screen's harmonics where a camera's rays (N, 3) meet it; None for an exact sphere.

    They also serve for slightly different rigs, see `RoundShape.shape_derivatives`.
    """
    if rig.shape.is_sphere:
        return None
    return rig.shape.shape_derivatives(*camera_rays(rig.cameras[camera], ray))


def residuals(
    rig: RigGeometry,
    pair: Pair,
    seen: Observations,
    ray: Array | None = None,
    shape_derivatives: ShapeDerivatives | None = None,
) -> Array:
    """Projector pixels (N, 2) that the rig predicts minus those that were observed.

    `ray` (N, 3) of the camera's pixels and `shape_derivatives` of the screen where they meet it are
    computed unless given.
    """
    ray, shape_derivatives = _with_defaults(rig, pair, seen, ray, shape_derivatives)
    return bundle_residuals(_kernel_pair(rig, pair), ray, seen.projector_px, shape_derivatives)


def residual_slopes(rig: RigGeometry, pair: Pair, seen: Observations) -> tuple[Array, Array]:
    """Residuals (N, 2) and their derivatives (N, 2, K) by the parameters `layout.columns(pair)`."""
    ray, shape_derivatives = _with_defaults(rig, pair, seen, None, None)
    return bundle_rows(
        _kernel_pair(rig, pair), ray, seen.projector_px, shape_derivatives, lens_free=True
    )


def normal_equations(
    rig: RigGeometry,
    seen: Mapping[Pair, Observations],
    weight: Mapping[Pair, Array],
    free: BoolArray,
    rays: Mapping[Pair, Array],
    shape_derivatives: Mapping[Pair, ShapeDerivatives | None],
) -> tuple[Array, Array]:
    """Normal matrix (P, P) and gradient (P,) of the weighted squares of all residuals.

    Parameters
    ----------
    rig, seen : the linearisation point, and observations by (camera, projector).
    weight : (N,) per pair [1/px^2].
    free : (P,) the parameters that are solved for; rows and columns of the others stay 0.
    rays : (N, 3) of the pairs whose camera's lens and pupil are fixed.
    shape_derivatives : per pair; computed where missing.
    """
    layout = ParameterLayout.of(rig)
    matrix, gradient = np.zeros((layout.count, layout.count)), np.zeros(layout.count)
    for pair, some in seen.items():
        lens_free = pair not in rays
        ray, known = _with_defaults(rig, pair, some, rays.get(pair), shape_derivatives.get(pair))
        found = bundle_equations(
            _kernel_pair(rig, pair), ray, some.projector_px, weight[pair], known, lens_free
        )
        columns = layout.columns(pair)
        used = free[columns]
        matrix[np.ix_(columns[used], columns[used])] += found.matrix[np.ix_(used, used)]
        gradient[columns[used]] += found.gradient[used]
    return matrix, gradient


def _with_defaults(
    rig: RigGeometry,
    pair: Pair,
    seen: Observations,
    ray: Array | None,
    shape_derivatives: ShapeDerivatives | None,
) -> tuple[Array, ShapeDerivatives | None]:
    """Rays and shape derivatives of a camera's pixels, computed where not given."""
    ray = unproject(seen.camera_px, rig.cameras[pair[0]].lens) if ray is None else ray
    return ray, screen_derivatives(
        rig, pair[0], ray
    ) if shape_derivatives is None else shape_derivatives


def _kernel_pair(rig: RigGeometry, pair: Pair) -> ObservationBlock:
    """A camera, a projector and the screen in the form that the kernels take."""
    camera, projector = rig.cameras[pair[0]], rig.projectors[pair[1]]
    assert camera.camera_from_dome is not None
    return ObservationBlock(
        device_of(camera.camera_from_dome, camera.lens, camera.pupil),
        device_of(projector.projector_from_dome, projector.lens, np.zeros(PUPIL)),
        rig.shape.radius_m,
        rig.shape.harmonic_coefficients,
    )


def device_of(pose: Pose, lens: Lens, pupil: Array) -> PlacedDevice:
    """A camera or projector in the form that the kernels take."""
    return PlacedDevice(pose.rotation, pose.translation, lens.kind, lens_parameters(lens), pupil)
