"""Rigs behind a media server: one projector that shows dome masters with known directions.

`dome_master` models and plans it, `tags` draws fiducials into masters, `camera_pose` finds cameras from
them, `local_response` measures how its response varies over the dome.
"""

from procam.estimate.media_server.camera_pose import (
    PlacedCamera,
    check_rotation,
    find_master_tags,
    place_camera,
    server_geometry,
)
from procam.estimate.media_server.dome_master import DomeMaster, lit_by_stripes, plan_server
from procam.estimate.media_server.local_response import Levels, fit_exponent, level_samples
from procam.estimate.media_server.tags import TAG_PICTURES

__all__ = [
    "TAG_PICTURES",
    "DomeMaster",
    "Levels",
    "PlacedCamera",
    "check_rotation",
    "find_master_tags",
    "fit_exponent",
    "level_samples",
    "lit_by_stripes",
    "place_camera",
    "plan_server",
    "server_geometry",
]
