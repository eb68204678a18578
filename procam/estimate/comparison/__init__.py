"""Comparison of two calibrations of one rig within their error bars.

`common_pixels` matches the pixels of a projector, `verdict` finds the probable cause of a difference,
`compare` puts both together with areas and light.
"""
