"""Codes, their pictures, and the projector pixel that each camera pixel saw."""
