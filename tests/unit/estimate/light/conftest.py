"""Traced rooms, once per session."""

from traced_rooms import bare, furnished

__all__ = ["bare", "furnished"]
