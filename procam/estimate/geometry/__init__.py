"""Poses, lenses and the screen's shape from what cameras saw, and the direction of every projector pixel.

`observations` reduces correspondence maps, `start` and `solve` find the rig with the bundle adjustment
of `model` and `adjustment`, `pixel_directions` gives the result; `diagnosis` names causes of a misfit.
"""
