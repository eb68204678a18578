"""Test patterns for a projector's settings (menu), and the analysis of their photographs.

`patterns` are shown, `patches` finds them in photographs and reads their light, `analysis` computes the
effects that would spoil a calibration.
"""
