"""Finds the light that costs the eye least where subtraction would need negative light."""
