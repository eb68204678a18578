"""Finds what has changed at a venue since it was calibrated, from a few photographs of each projector.

`pictures` samples photographs on the panels, `displacement` finds where a panel's picture went and how sharp
it is, `camera_motion` whether the camera moved instead, `response_change`, `light_change` and `dome_change`
compare the light, and `findings` names the causes.
"""
