"""Structured light: codes, their patterns, and the projector pixel that each camera pixel saw.

`codes` and `patterns` make what is shown; `decode` turns the photographs into a correspondence map,
with `stripes` or `axis` per coordinate; the other modules check photographs and correct the map.
"""
