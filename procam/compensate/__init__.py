"""From content to projector frames: compensation of inter-reflections, and the warp.

`compensator` compensates dome masters by `fields` (the calibration on a grid), `equations` (of one
frame) and `solver` (their root); `projector_frames` warps the result; `track` exports all of it for a
player, with the programs in shader/; `mesh` compensates screens of any shape, face by face.
"""
