"""Rigs behind a media server: one projector that shows dome masters with known directions.

`dome_master` models and plans it, `tags` draws fiducials into masters, `camera_pose` finds cameras from
them, `local_response` measures how its response varies over the dome.
"""
