"""Initial board poses from viewing rays."""

import numpy as np
from simulated_boards import BOARD, FISHEYE, looking_at

from procam.estimate.boards.start import pose_from_rays
from procam.maths.geometry.lenses import project, unproject


def test_pose_from_rays_beyond_ninety_degrees() -> None:
    pose = looking_at(np.radians(97), 1.0, np.array([0.2, -0.3, 0.5]), 0.15)
    found = pose_from_rays(BOARD, unproject(project(pose.apply(BOARD), FISHEYE), FISHEYE))
    np.testing.assert_allclose(found.rotation, pose.rotation, atol=1e-6)
    np.testing.assert_allclose(found.translation, pose.translation, atol=1e-7)
