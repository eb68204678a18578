"""Normal equations of the board adjustment against finite differences."""

import numpy as np
from simulated_boards import BEND, FISHEYE, fisheye_views

from procam.estimate.boards.adjustment import BoardAdjustment
from procam.estimate.boards.corners import BoardRig, stack_corners
from procam.estimate.boards.start import pose_from_rays
from procam.maths.geometry.lenses import lens_of_parameters, lens_parameters, unproject
from procam.maths.geometry.pose import Pose


def test_normal_equations_equal_finite_differences(rng) -> None:
    """The gradient against central differences of the cost, for all parameters."""
    views = fisheye_views(rng, FISHEYE, 3)
    corners = stack_corners(
        [v.points for v in views], [np.stack([v.pixels, v.pixels + 3]) for v in views]
    )
    devices = (
        Pose(np.eye(3), np.zeros(3)),
        Pose.from_vectors((0.1, -0.2, 0.05), (0.02, 0, 0.01)),
    )
    boards = tuple(pose_from_rays(v.points, unproject(v.pixels, FISHEYE)) for v in views)
    rig = BoardRig((FISHEYE, FISHEYE), devices, boards, BEND)
    bundle = BoardAdjustment(corners, (tuple(range(8)), (0, 3, 5)), np.array([1.0, 2.0]), bend=True)
    gradient = []
    for i in range(bundle.shared + 18):
        step = np.zeros(bundle.shared + 18)
        step[i] = 1e-6
        ahead, back = (bundle.cost(stepped(rig, bundle, sign * step)) for sign in (1, -1))
        gradient.append((ahead - back) / 4e-6)
    equations = bundle._equations(rig)
    ours = np.r_[equations.gradient, equations.own_gradient.ravel()]
    np.testing.assert_allclose(ours, gradient, rtol=1e-4, atol=1e-4 * np.abs(ours).max())


def stepped(rig: BoardRig, bundle: BoardAdjustment, x: np.ndarray) -> BoardRig:
    """The step of the parameters, written out for the rig of the test above."""
    first = lens_of_parameters(FISHEYE, lens_parameters(rig.lenses[0]) + x[:8])
    change = np.zeros(8)
    change[[0, 3, 5]] = x[8:11]
    second = lens_of_parameters(FISHEYE, lens_parameters(rig.lenses[1]) + change)
    own = x[bundle.shared :].reshape(-1, 6)
    return BoardRig(
        (first, second),
        (rig.devices[0], rig.devices[1].moved(x[11:17])),
        tuple(b.moved(s) for b, s in zip(rig.boards, own, strict=True)),
        rig.bend + x[17:20],
    )
