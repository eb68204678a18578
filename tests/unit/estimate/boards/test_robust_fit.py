"""What determines a pose and a focal length; outliers are in the tests of the camera and the pair."""

import numpy as np
import pytest
from simulated_boards import BOARD, FISHEYE, PINHOLE, fisheye_views

from procam.errors import DidNotConverge, NotEnoughData
from procam.estimate.boards.corners import BoardRig, stack_corners
from procam.estimate.boards.robust_fit import (
    IDENTITY,
    BoardFit,
    check_focal,
    check_tilts,
    determines_pose,
)
from procam.estimate.boards.start import start_camera
from procam.maths.geometry.pose import Pose


def test_corners_that_determine_a_pose() -> None:
    assert determines_pose(BOARD)
    assert not determines_pose(BOARD[:7])
    assert not determines_pose(BOARD[:13])  # one row


@pytest.mark.parametrize(("tilt_deg", "enough"), [(4.0, False), (6.0, True)])
def test_tilts(tilt_deg: float, enough: bool) -> None:
    boards = tuple(Pose.from_vectors((np.radians(a), 0, 0), (0, 0, 1)) for a in (0, tilt_deg))
    rig = BoardRig((PINHOLE,), (IDENTITY,), boards, np.zeros(3))
    if enough:
        check_tilts(rig)
    else:
        with pytest.raises(NotEnoughData, match=r"parallel within 4\.0 degrees"):
            check_tilts(rig)


def test_an_uncertain_focal_length() -> None:
    check_focal(PINHOLE, np.diag(np.square([10.0, 10.0])))
    with pytest.raises(NotEnoughData, match="uncertain by 3%, more than 2%"):
        check_focal(PINHOLE, np.diag(np.square([10.0, 0.03 * PINHOLE.focal[1]])))


def test_a_fit_that_does_not_settle(rng, monkeypatch: pytest.MonkeyPatch) -> None:
    views = fisheye_views(rng, FISHEYE, 4)
    corners = stack_corners([v.points for v in views], [v.pixels[None] for v in views])
    rig = start_camera("kannala-brandt", (1300, 1020), corners)
    solve = "procam.estimate.boards.adjustment.BoardAdjustment.solve"
    monkeypatch.setattr(solve, lambda self, rig: (rig, False))
    with pytest.raises(DidNotConverge, match="did not settle within 200 steps"):
        BoardFit((tuple(range(8)),)).fit_inliers(corners, rig)
