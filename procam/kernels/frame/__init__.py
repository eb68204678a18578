"""Compensation of one frame: sums of its light over the dome, and the light to send."""
