"""Solid angles of the cells of a grid of directions."""

from procam.kernels.areas.api import solid_angles

__all__ = ["solid_angles"]
