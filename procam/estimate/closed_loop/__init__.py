"""Closed loop: corrections of a compensated picture, and of its calibration, from photographs of it.

`patches` has the update on patches of any dome (`LoopState`) and the stop criteria; `dome` applies it to a
dome master through the main camera (`DomeLoop`), `gains` decides how much of it is the gains' and
`refined` makes a calibration of the result; `brackets` merges exposures where one is not enough.
"""
