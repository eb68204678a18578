"""Poses, lenses, spheres, directions and solid angles."""
