"""Codewords and waves of the structured-light codes, shot marks and dither patterns.

All modules are independent; `estimate.structured_light` makes patterns and decoders of them.
"""
