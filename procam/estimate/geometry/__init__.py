"""Poses, lenses and screen shape by bundle adjustment, and the direction of every projector pixel."""
