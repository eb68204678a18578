"""Closed loop: corrections of a compensated picture, and of its calibration, from photographs of it.

`patches` has the update on patches of any screen (`LoopState`) and the stop criteria, `scatter` and
`screen_scatter` the light between patches; `picture_loop` applies it to a canvas through the main camera
(`PictureLoop`), `gains` decides how much of it is the gains' and `refined` makes a calibration of the result;
`brackets` merges exposures where one is not enough.
"""
