"""Lens calibration from photographs of a flat board.

`targets` finds boards and tags in photographs; `start` computes initial values, `adjustment` fits
them and `robust_fit` rejects outliers; `camera` solves one camera, `planar_pair` a camera and a projector.
"""
