"""Captures in, models out. No files, no clock, no printing."""
