"""Poses, lenses, rays, spheres, harmonics and solid angles: arrays in, arrays out.

Frames and signs are those of docs/nomenclature.md, equations those of docs/theory/geometry.md.
"""
