"""Rigid motions. `camera_from_dome` reads right to left: x_camera = camera_from_dome.apply(x_dome)."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from procam.arrays import Array


@dataclass(frozen=True, slots=True)
class Pose:
    """x_to = rotation @ x_from + translation.

    Attributes
    ----------
    rotation : (3, 3) orthonormal, right-handed [-].
    translation : (3,) [m].
    """

    rotation: Array
    translation: Array

    @classmethod
    def from_vectors(cls, rotation_vector: ArrayLike, translation: ArrayLike) -> Self:
        """Pose from a rotation vector (axis times angle) [rad] and a translation [m]."""
        return cls(rotation_matrix(rotation_vector), np.asarray(translation, float).reshape(3))

    def apply(self, points: Array) -> Array:
        """Move points (..., 3) [m]."""
        return points @ self.rotation.T + self.translation

    def rotate(self, directions: Array) -> Array:
        """Rotate directions (..., 3) [-]; the translation does not act on them."""
        return directions @ self.rotation.T

    def inverse(self) -> "Pose":
        """The inverse motion: `p.inverse().apply(p.apply(x)) == x`."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def moved(self, x: Array) -> "Pose":
        """The pose of a device that is turned by the vector x[:3] [rad] and then shifted by x[3:6] [m]."""
        turn = rotation_matrix(x[:3])
        return Pose(turn @ self.rotation, turn @ self.translation + x[3:6])

    @property
    def origin(self) -> Array:
        """Position (3,) [m] of the device in the frame that the pose maps from."""
        return -self.rotation.T @ self.translation


def rotation_matrix(rotation_vector: ArrayLike) -> Array:
    """Rotation matrix (3, 3) of a rotation vector (axis times angle) [rad] (Rodrigues).

    >>> rotation_matrix([0, 0, np.pi / 2]).round(6).tolist()
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    vector = np.asarray(rotation_vector, float).reshape(3)
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    # the sinc forms are exact at angle zero
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)


def rotation_vector(rotation: Array) -> Array:
    """Rotation vector (3,) [rad] of a rotation matrix; the inverse of `rotation_matrix`."""
    sine_axis = 0.5 * np.array(
        [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
    )
    cosine = np.clip((np.trace(rotation) - 1) / 2, -1.0, 1.0)
    sine = float(np.linalg.norm(sine_axis))
    angle = np.arctan2(sine, cosine)
    if sine > 1e-6:
        return sine_axis * (angle / sine)
    if cosine > 0:
        return sine_axis
    # a rotation by pi: the longest column of R + I is along the axis
    column = rotation + np.eye(3)
    axis = column[:, int(np.argmax(np.linalg.norm(column, axis=0)))]
    return np.asarray(np.pi * axis / np.linalg.norm(axis))


def align_rotation(source: Array, target: Array) -> Array:
    """Least-squares rotation (3, 3) from directions `source` (N, 3) to `target` (N, 3) (Kabsch 1976)."""
    left, _, right = np.linalg.svd(target.T @ source)
    sign = np.sign(np.linalg.det(left @ right))
    return np.asarray(left @ np.diag([1.0, 1.0, sign]) @ right)
