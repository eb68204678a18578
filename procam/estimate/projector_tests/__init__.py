"""Test pictures that show which projector settings break a calibration, and their analysis."""
