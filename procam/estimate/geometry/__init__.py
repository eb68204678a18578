"""Poses, lenses and the screen's shape from what cameras saw, and the direction of every projector pixel.

`observations` reduces correspondence maps, `start` and `solve` find the rig with the bundle adjustment
of `model` and `adjustment`, `pixel_directions` gives the result; `diagnosis` names causes of a misfit.
"""

from procam.estimate.geometry.adjustment import RigProblem
from procam.estimate.geometry.apriltags import TagObservations, detect_tags, tag_fiducials
from procam.estimate.geometry.camera_view import DomeView
from procam.estimate.geometry.diagnosis import find_causes
from procam.estimate.geometry.direction_samples import sample_directions
from procam.estimate.geometry.fiducial_checks import check_fiducials, missing_fiducials
from procam.estimate.geometry.lens_glints import lens_glints
from procam.estimate.geometry.model import Observations, Pair, ParameterLayout, RigGeometry
from procam.estimate.geometry.observations import gather_observations
from procam.estimate.geometry.pixel_directions import PixelDirections, fit_pixel_directions
from procam.estimate.geometry.screen_points import intersect_screen, round_shape, screen_points
from procam.estimate.geometry.solve import MAX_SPHERE_RATIO, GeometrySolution, solve_geometry
from procam.estimate.geometry.start import MIN_OBSERVATIONS, ProjectorPrior

__all__ = [
    "MAX_SPHERE_RATIO",
    "MIN_OBSERVATIONS",
    "DomeView",
    "GeometrySolution",
    "Observations",
    "Pair",
    "ParameterLayout",
    "PixelDirections",
    "ProjectorPrior",
    "RigGeometry",
    "RigProblem",
    "TagObservations",
    "check_fiducials",
    "detect_tags",
    "find_causes",
    "fit_pixel_directions",
    "gather_observations",
    "intersect_screen",
    "lens_glints",
    "missing_fiducials",
    "round_shape",
    "sample_directions",
    "screen_points",
    "solve_geometry",
    "tag_fiducials",
]
